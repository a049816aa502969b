"""Results of benchmarks as Markdown tables: of each its columns, and the order of its rows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from operator import itemgetter
from typing import Any

Case = dict[str, Any]
Columns = Mapping[str, str | Callable[[Case], object]]
"""Cell by head: a format string over the facts of a case, or a function of it."""


class _Unknown:
    """A fact that a case does not have."""

    def __format__(self, form: str) -> str:
        return "-"


def cases_of(data: dict[str, Any]) -> list[Case]:
    """Facts that each benchmark of a result records."""
    return [case for benchmark in data["benchmarks"] if (case := benchmark["extra_info"])]


def table(cases: Iterable[Case], columns: Columns) -> list[str]:
    """Lines of a table, with a dash for what a case does not know."""
    lines = [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)]
    for case in cases:
        facts = defaultdict(_Unknown, {name: value for name, value in case.items() if value is not None})
        cells = (cell.format_map(facts) if isinstance(cell, str) else cell(case) for cell in columns.values())
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return lines


def _device(case: Case) -> str:
    """Name of the device, with a word on counts that stay there."""
    return f"{case['device']}, resident" if case.get("resident") else str(case["device"])


_FPS: Columns = {
    "pixels": "{n_pixel}^2",
    "sensors": lambda c: c.get("n_sensor", 1),
    "stars in view": "{n_star:,}",
    "PSF": "{psf}",
    "device": _device,
    "frames/s": "{fps:,.0f}",
    "paper": "{paper_fps}",
    "ratio": lambda c: f"{c['fps'] / c['paper_fps']:.1f}",
    "sensors at 30 Hz": lambda c: f"{c['fps'] // 30:,.0f}",
    "worst PSF error per pixel": "{psf_error:.1e}",
}


def fps_table(cases: list[Case]) -> list[str]:
    """Frames per second, with the paper's figure, sensors in real time, and the error of the point spread function."""
    order = sorted(cases, key=lambda c: (c["device"], c["psf"], c.get("n_star", 0), c.get("n_sensor", 1), c["n_pixel"]))
    return table(order, _FPS)


def stages_table(cases: list[Case]) -> list[str]:
    """Microseconds per image by stage; the whole is measured apart."""
    cases = sorted(cases, key=itemgetter("device", "psf", "n_star", "n_pixel"))
    none = dict.fromkeys(cases[0]["stage_us"], 0.0)
    columns: Columns = {
        **{name: _FPS[name] for name in ("pixels", "stars in view", "PSF", "device")},
        **{name: f"{{{name}:,.1f}}" for name in none},
        "sum": "{sum_us:,.1f}",
        "whole": "{whole_us:,.1f}",
    }
    return table((c | none | c["stage_us"] | {"sum_us": sum(c["stage_us"].values())} for c in cases), columns)


def scaling_table(cases: list[Case]) -> list[str]:
    """Time per image against what grows, and what each step of it adds."""
    lines: list[str] = []
    for scaling in dict.fromkeys(c["scaling"] for c in cases):
        group = sorted((c for c in cases if c["scaling"] == scaling), key=itemgetter("x"))
        columns = {scaling: "{x:,}", "us per image": "{us_per_image:,.1f}"}
        columns |= {head: f"{{{key}:,.1f}}" for key, head in MORE_OF_SCALING.items() if key in group[0]}
        if scaling in LINEAR:
            columns["ns for each one more"] = "{slope:.2g}"
            slopes = [(b["us_per_image"] - a["us_per_image"]) / (b["x"] - a["x"]) * 1e3 for a, b in pairwise(group)]
            group = [c | {"slope": slope} for c, slope in zip(group, [None, *slopes], strict=True)]
        lines += [*table(group, columns), ""]
    return lines[:-1]


LINEAR = ("pixels of an image", "sources in view")
"""Quantity that cost should grow with evenly."""

MORE_OF_SCALING = {"gather_stars_us": "of that, gather_stars", "buffer_mb": "buffers [MB]"}


def settings_table(cases: list[Case]) -> list[str]:
    """Time against error for each setting of accuracy, of images and of tracks."""
    lines = table(
        (c for c in cases if "error_nei" in c),
        {
            "setting": "{setting}",
            "value": "{value}",
            "pixels": "{n_pixel}^2",
            "us per image": "{us_per_image:,.1f}",
            "error of the worst pixel [noise]": "{error_nei:.1e}",
        },
    )
    if nodes := [c for c in cases if "n_node" in c]:
        of_tracks = {
            "error of tracks asked [m]": "{value:g}",
            "nodes a day": "{n_node}",
            "seconds per scene, 28 satellites": "{scene_s:.2f}",
            "error [m]": "{error_m:.1e}",
        }
        lines += ["", *table(nodes, of_tracks)]
    return lines


def signatures_table(cases: list[Case]) -> list[str]:
    """Signatures: observations a second by terms and threads; then time against the error of quadratures."""
    terms = sorted((c for c in cases if c["kind"] == "terms"), key=lambda c: (-c["observations_per_s"], c["n_thread"]))
    errors = sorted((c for c in cases if c["kind"] == "error"), key=lambda c: (c["exposure_s"], -c["asked"]))
    each = {"us each": "{us_per_observation:.2f}"}
    observed = {"terms": "{terms}", "threads": "{n_thread}", "targets observed per second": "{observations_per_s:,.0f}"}
    asked = {"exposure [s]": "{exposure_s:g}", "error asked": "{asked:.0e}", "error of the light": "{light_error:.1e}"}
    return [*table(terms, observed | each), "", *table(errors, asked | each)]


def star_tables(cases: list[Case]) -> list[str]:
    """Star look-up: time, errors and memory against the number of stars; then time at a fixed density."""
    same = itemgetter("n_star", "method", "device")
    build_s = {same(c): c["build_s"] for c in cases if c["kind"] == "build"}
    queries = [c | {"build_s": build_s.get(same(c))} for c in cases if c["kind"] == "query"]
    zones = sorted((c for c in cases if c["kind"] == "fixed density"), key=itemgetter("device", "method", "n_star"))
    lines = table(sorted(queries, key=same), _QUERIES) if queries else []
    if zones:
        lines += ["", "The same views of equally dense catalogs:", "", *table(zones, _ZONES)]
    return lines


def _us_per_cone(case: Case) -> str:
    return format(case["us_per_cone"], ",.3g" if case["us_per_cone"] < 100 else ",.0f")


def _found(case: Case) -> str:
    return f"{case['n_found'] / case['n_cone']:.1f}"


_QUERIES: Columns = {
    "stars": "{n_star:,}",
    "method": "{method}",
    "device": "{device}",
    "us per cone": _us_per_cone,
    "stars found per cone": _found,
    "lost + extra": "{lost} + {extra} of {n_right:,}",
    "displaced [arcsec]": "{displaced_arcsec:.2g}",
    "tested per found": "{tested_per_found:.1f}",
    "bytes per star": "{bytes_per_star:.1f}",
    "on the device [MB]": "{device_mb:,.1f}",
    "build [s]": "{build_s:.3g}",
}
_ZONES: Columns = {
    "stars in the catalog": "{n_star:,}",
    "method": "{method}",
    "device": "{device}",
    "us per cone": "{us_per_cone:.1f}",
    "stars found per cone": _found,
}


def plain_table(cases: list[Case]) -> list[str]:
    """Everything that cases say, where nothing better is known."""
    return table(cases, {name: _plain(name) for c in cases for name in c})


def _plain(name: str) -> Callable[[Case], object]:
    return lambda c: f"{c[name]:.4g}" if isinstance(c.get(name), float) else c.get(name, "-")


def _in_order(columns: Columns, order: Callable[[Case], Any] | None = None) -> Callable[[list[Case]], list[str]]:
    """Return the function of a table whose rows are sorted, or stand as they were measured."""
    return lambda cases: table(sorted(cases, key=order) if order else cases, columns)


machine_code_table = _in_order(
    {
        "kernel": "{kernel}",
        "scene": "{scene}",
        "threads of a block": "{block_dim}",
        "registers": "{registers}",
        "spilled: stores, loads": "{spill_stores}, {spill_loads}",
        "stack [bytes]": "{stack_bytes}",
        "instructions": "{instructions:,}",
        "unit": "{unit}",
        "instructions of a unit": "{instructions_per_unit:,.0f}",
        "at least": "{least_per_unit:,.0f}",
    }
)
"""Registers, spills and instructions of each kernel, in the order of the stages."""

TABLES: dict[str, Callable[[list[Case]], list[str]]] = {
    "registers": machine_code_table,
    "light_error": signatures_table,
    "ns_per_pixel": _in_order(
        {
            "detector": "{detector}",
            "ns per pixel": "{ns_per_pixel:.2f}",
            "distance from a Gaussian": "{distance:.1e}",
        }
    ),
    "deposit_error": _in_order(
        {
            "what": "{group}",
            "way": "{way}",
            "ns per source": "{ns_per_source:,.0f}",
            "error of the worst pixel": "{deposit_error:.1e}",
            "light left out": "{left_out:.1e}",
        },
        itemgetter("group", "ns_per_source"),
    ),
    "peer": _in_order(
        {
            "peer": "{peer}",
            "threads: ours, peer": "{n_thread}, {peer_threads}",
            "pixels": "{n_pixel}^2",
            "PSF": "{psf}",
            "stars in view": "{n_star:,}",
            "our stamps": "{stamps}",
            "ours, frames/s": "{fps:,.0f}",
            "peer, frames/s": "{peer_fps:,.0f}",
            "ratio: median (quartiles)": "**{ratio:.2f}** ({ratio_quartiles[0]:.2f} to {ratio_quartiles[1]:.2f})",
            "pairs": "{n_pair}",
            "worst pixel, ours [noise]": "{error_nei:.1e}",
            "peer [noise]": "{peer_error_nei:.1e}",
            "cores of others": "{cores_of_others:.2f}",
        },
        itemgetter("peer", "one_thread", "n_star", "psf", "stamps", "n_pixel"),
    ),
    "setting": settings_table,
    "scaling": scaling_table,
    "stage_us": stages_table,
    "psf_error": fps_table,
    "switches": _in_order(
        {
            "steps on": "{switches}",
            "us per view": "{us_per_view:.2f}",
            "error [arcsec]": "{error_arcsec:.1e}",
            "bytes per star": "{bytes_per_star:.1f}",
        },
        lambda c: -c["error_arcsec"],
    ),
    "rules": _in_order(
        {
            "satellites": "{n_satellite:,}",
            "rules": "{rules}",
            "step [s]": "{step_s:g}",
            "intervals": "{n_interval:,}",
            "seconds": "{access_s:.2f}",
            "us per satellite and step": "{us_per_pair:.2f}",
            "lost + extra": "{lost} + {extra} of {n_right}",
            "worst end [ms]": "{end_error_ms:.2f}",
        },
        itemgetter("n_satellite", "access_s"),
    ),
    "propagation_s": _in_order(
        {
            "method": "{method}",
            "satellites": "{n_satellite:,}",
            "seconds": "{propagation_s:.3f}",
            "error after a day [m]": "{error_m:.1e}",
        },
        itemgetter("method", "n_satellite"),
    ),
    "n_cone": star_tables,
}
"""Columns of single benchmarks, and how they are shown."""

WITH_DEVICE = ("stage_us", "psf_error", "n_cone")
"""Those whose tables have a column for the device."""


def tables_of(cases: list[Case]) -> list[str]:
    """Lines of the tables of a result; those without a column for it are made for each device apart."""
    key = next((key for key in TABLES if any(key in c for c in cases)), None)
    show = TABLES[key] if key else plain_table
    devices = list(dict.fromkeys(c.get("device", "cpu") for c in cases))
    if devices == ["cpu"] or key in WITH_DEVICE:
        return show(cases)
    lines: list[str] = []
    for device in devices:
        lines += [f"On {device}:", "", *show([c for c in cases if c.get("device", "cpu") == device]), ""]
    return lines[:-1]
