"""Tables of whole images: frames per second, stages, scaling, peers, settings of accuracy."""

from __future__ import annotations

from itertools import pairwise

from benchmarks.tables.markdown import Case, shown, table


def fps_table(cases: list[Case]) -> list[str]:
    """Frames per second, with the paper's figure, sensors in real time, and the error of the point spread function."""
    order = sorted(cases, key=lambda c: (c["device"], c["psf"], c.get("n_star", 0), c.get("n_sensor", 1), c["n_pixel"]))
    return table(
        "pixels | sensors | stars in view | PSF | device | frames/s | paper | ratio | sensors at 30 Hz "
        "| worst PSF error per pixel",
        (
            (
                f"{c['n_pixel']}^2",
                c.get("n_sensor", 1),
                shown(c.get("n_star"), ","),
                c["psf"],
                device_of(c),
                f"{c['fps']:,.0f}",
                c["paper_fps"],
                f"{c['fps'] / c['paper_fps']:.1f}",
                f"{c['fps'] // 30:,.0f}",
                f"{c['psf_error']:.1e}",
            )
            for c in order
        ),
    )


def device_of(case: Case) -> str:
    """Name of the device, with a word on counts that stay there."""
    return f"{case['device']}, resident" if case.get("resident") else str(case["device"])


def stages_table(cases: list[Case]) -> list[str]:
    """Microseconds per image by stage; the whole is measured apart."""
    cases = sorted(cases, key=lambda c: (c["device"], c["psf"], c["n_star"], c["n_pixel"]))
    names = list(cases[0]["stage_us"])
    return table(
        " | ".join(["pixels | stars in view | PSF | device", *names, "sum", "whole"]),
        (
            (
                f"{c['n_pixel']}^2",
                f"{c['n_star']:,}",
                c["psf"],
                device_of(c),
                *(f"{c['stage_us'].get(name, 0.0):,.1f}" for name in names),
                f"{sum(c['stage_us'].values()):,.1f}",
                f"{c['whole_us']:,.1f}",
            )
            for c in cases
        ),
    )


def scaling_table(cases: list[Case]) -> list[str]:
    """Time per image against what grows, and what each step of it adds."""
    lines: list[str] = []
    for scaling in dict.fromkeys(c["scaling"] for c in cases):
        group = sorted((c for c in cases if c["scaling"] == scaling), key=lambda c: c["x"])
        more = [(key, name) for key, name in MORE_OF_SCALING.items() if key in group[0]]
        head = [scaling, "us per image", *(name for _, name in more)]
        rows = [[f"{c['x']:,}", f"{c['us_per_image']:,.1f}", *(f"{c[key]:,.1f}" for key, _ in more)] for c in group]
        if scaling in LINEAR:
            head.append("ns for each one more")
            slopes = [(b["us_per_image"] - a["us_per_image"]) / (b["x"] - a["x"]) * 1e3 for a, b in pairwise(group)]
            rows = [[*row, shown(slope, ".2g")] for row, slope in zip(rows, [None, *slopes], strict=True)]
        lines += table(" | ".join(head), rows)
        lines.append("")
    return lines[:-1]


LINEAR = ("pixels of an image", "sources in view")
"""Quantity that cost should grow with evenly."""

MORE_OF_SCALING = {"gather_stars_us": "of that, gather_stars", "buffer_mb": "buffers [MB]"}


def peers_table(cases: list[Case]) -> list[str]:
    """Ratios of speeds by turns, with quartiles, and the error of either image."""
    order = sorted(
        cases, key=lambda c: (c["peer"], c["one_thread"], c["n_star"], c["psf"], c["stamps"], c["n_pixel"])
    )  # fmt: skip
    return table(
        "peer | threads: ours, peer | pixels | PSF | stars in view | our stamps | ours, frames/s | peer, frames/s "
        "| ratio: median (quartiles) | pairs | worst pixel, ours [noise] | peer [noise] | cores of others",
        (
            (
                c["peer"],
                f"{c['n_thread']}, {c['peer_threads']}",
                f"{c['n_pixel']}^2",
                c["psf"],
                f"{c['n_star']:,}",
                c["stamps"],
                f"{c['fps']:,.0f}",
                f"{c['peer_fps']:,.0f}",
                f"**{c['ratio']:.2f}** ({c['ratio_quartiles'][0]:.2f} to {c['ratio_quartiles'][1]:.2f})",
                c["n_pair"],
                f"{c['error_nei']:.1e}",
                f"{c['peer_error_nei']:.1e}",
                f"{c['cores_of_others']:.2f}",
            )
            for c in order
        ),
    )


def settings_table(cases: list[Case]) -> list[str]:
    """Time against error for each setting of accuracy."""
    images = [c for c in cases if "error_nei" in c]
    nodes = [c for c in cases if "n_node" in c]
    lines = table(
        "setting | value | pixels | us per image | error of the worst pixel [noise]",
        (
            (c["setting"], c["value"], f"{c['n_pixel']}^2", f"{c['us_per_image']:,.1f}", f"{c['error_nei']:.1e}")
            for c in images
        ),
    )
    if nodes:
        rows = ((f"{c['value']:g}", c["n_node"], f"{c['scene_s']:.2f}", f"{c['error_m']:.1e}") for c in nodes)
        head = "error of tracks asked [m] | nodes a day | seconds per scene, 28 satellites | error [m]"
        lines += ["", *table(head, rows)]
    return lines
