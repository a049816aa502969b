"""Pictures of benchmark results, drawn by report.py."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.tables import Case

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def plot_signatures(cases: list[Case], path: Path) -> None:
    """Draw time per observation against the error of the light, and the terms' cost beside it."""
    figure = _figure(10, 4.5)
    left, right = figure.subplots(1, 2)
    for exposure_s in sorted({c["exposure_s"] for c in cases if c["kind"] == "error"}):
        points = sorted(
            (c["us_per_observation"], c["light_error"], c["asked"])
            for c in cases
            if c["kind"] == "error" and c["exposure_s"] == exposure_s
        )
        times, found, asked = zip(*points, strict=True)
        left.loglog(times, found, "o-", label=f"exposure {exposure_s:g} s" if exposure_s else "instant")
        for time, error, rule in zip(times, found, asked, strict=True):
            left.annotate(f"{rule:.0e}", (time, error), textcoords="offset points", xytext=(4, 4), fontsize=7)
    left.set(xlabel="time per observation [us]", ylabel="largest error of the light", title="error asked beside points")
    left.grid(alpha=0.3)
    left.legend()
    terms = [c for c in cases if c["kind"] == "terms"]
    for n_thread in sorted({c["n_thread"] for c in terms}):
        mine = [c for c in terms if c["n_thread"] == n_thread]
        rates = [c["observations_per_s"] for c in mine]
        right.plot([c["terms"] for c in mine], rates, "o-", label=f"{n_thread} thread{'' if n_thread == 1 else 's'}")
    right.set(ylabel="targets observed per second", title="terms of the light", yscale="log")
    right.grid(alpha=0.3)
    right.legend()
    figure.savefig(path, dpi=150)


def plot_star_query(cases: list[Case], path: Path) -> None:
    """Draw time per cone against the number of stars in the catalog."""
    figure = _figure(7, 5)
    axes = figure.add_subplot()
    lines: dict[str, list[tuple[int, float]]] = {}
    for c in cases:
        if c["kind"] != "build":
            where = "" if c["device"] == "host" else f", {c['device']}"
            note = ", same views at fixed density" if c["kind"] == "fixed density" else ""
            lines.setdefault(f"{c['method']}{where}{note}", []).append((c["n_star"], c["us_per_cone"]))
    for label, points in sorted(lines.items()):
        style = "s--" if "fixed" in label else "o-"
        axes.loglog(*zip(*sorted(points), strict=True), style, label=label)
    axes.set(xlabel="stars in the catalog", ylabel="time per cone of 0.72 deg [us]")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=2, fontsize=8)
    figure.savefig(path, dpi=150)


def plot_deposit(cases: list[Case], path: Path) -> None:
    """Draw time per source against the error of the worst pixel: ways to find pixel fractions, stamps, streaks."""
    figure = _figure(16, 5)
    panels = {
        "fractions": "how pixel fractions are found",
        "stamps": "where stamps end",
        "streak": "nodes along streaks",
    }
    others = [c for c in cases if not any(word in c["group"] for word in panels)]
    columns = [*panels.items(), *([("", "how light is added up")] if others else [])]
    for axes, (word, title) in zip(figure.subplots(1, len(columns)), columns, strict=True):
        shown = [c for c in cases if word in c["group"]] if word else others
        for label in sorted({_line(c) for c in shown}):
            line = [(max(c["deposit_error"], 1e-13), c["ns_per_source"]) for c in shown if _line(c) == label]
            axes.loglog(*zip(*sorted(line), strict=True), "o-" if word else "o", label=label)
        axes.set(xlabel="error of the worst pixel, fraction of the light", ylabel="ns per source", title=title)
        axes.margins(y=0.35 if word != "stamps" else 0.1)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=6, ncols=2 if word == "fractions" else 1, loc="upper right")
    figure.savefig(path, dpi=130)


def _line(case: Case) -> str:
    """Name of a case's line: the way without its error."""
    if "sums" in case["group"]:
        return f"{case['way']}, {case['group'].removeprefix('sums of ')}"
    kind = case["group"].partition(",")[0]
    way = case["way"].rpartition(", ")[0] or case["way"]
    return f"{kind}, {way}" if "fractions" in case["group"] else case["group"]


def plot_read_out(cases: list[Case], path: Path) -> None:
    """Draw time per pixel by the terms of the detector, and how far the noise is from what it should be."""
    figure = _figure(9, 5)
    axes = figure.add_subplot()
    ordered = sorted(cases, key=lambda c: -c["ns_per_pixel"])
    axes.barh([c["detector"] for c in ordered], [c["ns_per_pixel"] for c in ordered])
    for number, case in enumerate(ordered):
        note = "" if case["distance"] is None else f"  distance {case['distance']:.0e}"
        axes.text(case["ns_per_pixel"], number, note, va="center", fontsize=8)
    axes.set(xlabel="ns per pixel, one thread", title="reading out; largest distance of counts from their distribution")
    axes.margins(x=0.2)
    figure.savefig(path, dpi=130)


def plot_settings(cases: list[Case], path: Path) -> None:
    """Draw time per image against the error of the worst pixel, setting by setting."""
    figure = _figure(13, 5)
    left, right = figure.subplots(1, 2)
    images = [c for c in cases if "error_nei" in c]
    for setting in dict.fromkeys(c["setting"] for c in images):
        group = [c for c in images if c["setting"] == setting]
        axes = left if group[0]["n_pixel"] <= 256 else right
        line = sorted((max(c["error_nei"], 1e-5), c["us_per_image"]) for c in group)
        axes.plot(*zip(*line, strict=True), "o-", label=setting)
        for c in group:
            place = (max(c["error_nei"], 1e-5), c["us_per_image"])
            axes.annotate(f"{c['value']}", place, textcoords="offset points", xytext=(4, 4), fontsize=7)
    for axes, n_pixel in ((left, 256), (right, 1024)):
        if not axes.lines:
            continue
        axes.set(xscale="log", xlabel="error of the worst pixel [noise]", ylabel="us per image, one thread")
        axes.set(title=f"{n_pixel} x {n_pixel} pixels, setting beside points", ylim=(0, None))
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    figure.savefig(path, dpi=130)


def plot_scaling(cases: list[Case], path: Path) -> None:
    """Draw time per image against what grows."""
    names = list(dict.fromkeys(c["scaling"].partition(",")[0] for c in cases))
    figure = _figure(4.5 * len(names), 4)
    for axes, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
        for scaling in dict.fromkeys(c["scaling"] for c in cases if c["scaling"].partition(",")[0] == name):
            group = [c for c in cases if c["scaling"] == scaling]
            line = sorted((c["x"], c["us_per_image"]) for c in group)
            axes.loglog(*zip(*line, strict=True), "o-", label=scaling.partition(", ")[2] or "whole image")
            if parts := sorted((c["x"], c["gather_stars_us"]) for c in group if "gather_stars_us" in c):
                axes.loglog(*zip(*parts, strict=True), "s--", label="gather_stars")
        axes.set(xlabel=name, ylabel="us per image, one thread")
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize=8)
    figure.savefig(path, dpi=130)


def plot_peers(cases: list[Case], path: Path) -> None:
    """Draw how many times as fast as each peer, against image size, with quartiles."""
    psfs = [psf for psf in ("gaussian", "airy") if any(c["psf"] == psf for c in cases)]
    figure = _figure(6.5 * len(psfs), 6.5)
    for axes, psf in zip(figure.subplots(1, len(psfs), squeeze=False)[0], psfs, strict=True):
        groups: dict[str, list[Case]] = {}
        for c in cases:
            if c["psf"] == psf:
                threads = ", one thread each" if c["one_thread"] else ""
                name = f"{c['peer']}{threads}, {c['n_star']:,} stars, stamps: {c['stamps']}"
                groups.setdefault(name, []).append(c)
        for name, group in groups.items():
            group.sort(key=lambda c: c["n_pixel"])
            ratio = [c["ratio"] for c in group]
            spread = [[abs(c["ratio_quartiles"][k] - c["ratio"]) for c in group] for k in (0, 1)]
            axes.errorbar([c["n_pixel"] for c in group], ratio, spread, fmt="o-", capsize=3, label=name)
        axes.axhline(1.0, color="grey", linestyle=":")
        axes.set(xscale="log", yscale="log", title=psf, xlabel="pixels on a side", ylabel="our frames/s over theirs")
        axes.set_xticks([128, 256, 512, 1024], ["128", "256", "512", "1024"])
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(psfs), fontsize=8)
    figure.savefig(path, dpi=130)


def plot_stages(cases: list[Case], path: Path) -> None:
    """Draw the fraction of each stage in the time of an image."""
    cases = sorted(cases, key=lambda c: (c["device"], c["psf"], c["n_star"], c["n_pixel"]), reverse=True)
    labels = [f"{c['n_pixel']}^2, {c['n_star']:,} stars, {c['psf']}, {c['device']}" for c in cases]
    figure = _figure(10, 1.5 + 0.35 * len(cases))
    axes = figure.add_subplot()
    begin = [0.0] * len(cases)
    for name in cases[0]["stage_us"]:
        width = [100 * c["stage_us"].get(name, 0.0) / c["whole_us"] for c in cases]
        axes.barh(labels, width, left=begin, label=name)
        begin = [a + b for a, b in zip(begin, width, strict=True)]
    axes.set(xlabel="percent of the time of an image, one thread; what is missing is no stage")
    figure.legend(loc="outside upper center", ncols=4, fontsize=8)
    figure.savefig(path, dpi=130)


PICTURES: dict[str, Callable[[list[Case], Path], None]] = {
    "light_error": plot_signatures,
    "deposit_error": plot_deposit,
    "ns_per_pixel": plot_read_out,
    "peer": plot_peers,
    "setting": plot_settings,
    "scaling": plot_scaling,
    "stage_us": plot_stages,
    "n_cone": plot_star_query,
}
"""Columns of single benchmarks, and how they are drawn."""


def picture_of(cases: list[Case]) -> Callable[[Path], None] | None:
    """Return the function that draws a result to a file; None where there is none."""
    draw = next((draw for key, draw in PICTURES.items() if any(key in c for c in cases)), None)
    return None if draw is None else partial(draw, cases)
