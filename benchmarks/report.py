"""Prints a benchmark result as Markdown tables: python benchmarks/report.py [RESULT.json] [--plot PICTURE.png]."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from pictures import PICTURES, Case


def report(path: Path) -> str:
    """Machine and date, then the tables of a result of one of the benchmarks here."""
    data = json.loads(path.read_text("utf-8"))
    machine = data["machine_info"]
    cases = cases_of(data)
    threads = f"{cases[0]['n_thread']} threads, " if "n_thread" in cases[0] else ""
    lines = [
        f"{machine['cpu'].get('brand_raw', machine['processor'])}, {threads}"
        f"Python {machine['python_version']}, {data['datetime'][:10]}",
        "",
    ]
    tables = next((table for key, table in TABLES.items() if key in cases[0]), star_tables)
    return "\n".join(lines + tables(cases))


def cases_of(data: dict[str, Any]) -> list[Case]:
    """What each benchmark says of itself."""
    return [benchmark["extra_info"] for benchmark in data["benchmarks"]]


def fps_table(cases: list[Case]) -> list[str]:
    """Frames per second against resolution, with the paper's figure and the error of the point spread function."""
    cases = sorted(cases, key=lambda c: (c["device"], c["psf"], c["n_pixel"]))
    return [
        "| pixels | PSF | device | frames/s | paper | ratio | worst PSF error per pixel |",
        "|---|---|---|---|---|---|---|",
        *(
            f"| {c['n_pixel']}^2 | {c['psf']} | {c['device']} | {c['fps']:,.0f} | {c['paper_fps']} "
            f"| {c['fps'] / c['paper_fps']:.1f} | {c['psf_error']:.1e} |"
            for c in cases
        ),
    ]


def places_table(cases: list[Case]) -> list[str]:
    """Apparent places: time against error."""
    return [
        "| steps on | us per view | error [arcsec] | bytes per star |",
        "|---|---|---|---|",
        *(
            f"| {c['switches']} | {c['us_per_view']:.2f} | {c['error_arcsec']:.1e} | {c['bytes_per_star']:.1f} |"
            for c in sorted(cases, key=lambda c: -c["error_arcsec"])
        ),
    ]


def read_out_table(cases: list[Case]) -> list[str]:
    """Read-out: time by the terms of the detector, with the error of its noise."""
    errors = ["-" if c["distance"] is None else f"{c['distance']:.1e}" for c in cases]
    rows = [f"| {c['detector']} | {c['ns_per_pixel']:.2f} | {e} |" for c, e in zip(cases, errors, strict=True)]
    return ["| detector | ns per pixel | distance from a Gaussian |", "|---|---|---|", *rows]


def deposit_table(cases: list[Case]) -> list[str]:
    """Drawing: time per source against the error of the worst pixel, way by way."""
    return [
        "| what | way | ns per source | error of the worst pixel | light left out |",
        "|---|---|---|---|---|",
        *(
            f"| {c['group']} | {c['way']} | {c['ns_per_source']:,.0f} | {c['deposit_error']:.1e} "
            f"| {shown(c.get('left_out'), '.1e')} |"
            for c in sorted(cases, key=lambda c: (c["group"], c["ns_per_source"]))
        ),
    ]


def access_table(cases: list[Case]) -> list[str]:
    """Access: time against the number of satellites and the rules, with what a fine scan says of the intervals."""
    return [
        "| satellites | rules | step [s] | intervals | seconds | us per satellite and step | lost + extra "
        "| worst end [ms] |",
        "|---|---|---|---|---|---|---|---|",
        *(
            f"| {c['n_satellite']:,} | {c['rules']} | {c['step_s']:g} | {c['n_interval']:,} | {c['access_s']:.2f} "
            f"| {c['us_per_pair']:.2f} | {c['lost']} + {c['extra']} of {c['n_right']} | {c['end_error_ms']:.2f} |"
            for c in sorted(cases, key=lambda c: (c["n_satellite"], c["access_s"]))
        ),
    ]


def orbits_table(cases: list[Case]) -> list[str]:
    """Orbits: time for a day in steps of 30 s against the error at its end."""
    return [
        "| method | satellites | seconds | error after a day [m] |",
        "|---|---|---|---|",
        *(
            f"| {c['method']} | {c['n_satellite']:,} | {c['propagation_s']:.3f} | {c['error_m']:.1e} |"
            for c in sorted(cases, key=lambda c: (c["method"], c["n_satellite"]))
        ),
    ]


def earthlight_table(cases: list[Case]) -> list[str]:
    """Light of the Earth: time of one evaluation against its error, for each method."""

    def method(c: Case) -> str:
        return f"series to l = {c['degree']}" if c["degree"] else f"{c['n_node']} nodes"

    return [
        "| light | shape | method | us | worst error here | bound |",
        "|---|---|---|---|---|---|",
        *(
            f"| {c['light']} | {c['shape']} | {method(c)} | {c['us_per_evaluation']:.2f} | {c['error']:.1e} "
            f"| {c['error_bound']:.0e} |"
            for c in sorted(cases, key=lambda c: (c["light"], c["shape"], -c["error_bound"], c["us_per_evaluation"]))
        ),
    ]


def signatures_table(cases: list[Case]) -> list[str]:
    """Signatures: observations a second by terms and threads; then time against the error of quadratures."""
    terms = sorted((c for c in cases if c["kind"] == "terms"), key=lambda c: (-c["observations_per_s"], c["n_thread"]))
    errors = sorted((c for c in cases if c["kind"] == "error"), key=lambda c: (c["exposure_s"], -c["asked"]))
    return [
        "| terms | threads | targets observed per second | us each |",
        "|---|---|---|---|",
        *(
            f"| {c['terms']} | {c['n_thread']} | {c['observations_per_s']:,.0f} | {c['us_per_observation']:.2f} |"
            for c in terms
        ),
        "",
        "| exposure [s] | error asked | error of the light | us each |",
        "|---|---|---|---|",
        *(
            f"| {c['exposure_s']:g} | {c['asked']:.0e} | {c['light_error']:.1e} | {c['us_per_observation']:.2f} |"
            for c in errors
        ),
    ]


TABLES = {
    "light_error": signatures_table,
    "ns_per_pixel": read_out_table,
    "deposit_error": deposit_table,
    "psf": fps_table,
    "switches": places_table,
    "rules": access_table,
    "propagation_s": orbits_table,
    "error_bound": earthlight_table,
}
"""What a case says only in one benchmark, and how it is shown."""


def star_tables(cases: list[Case]) -> list[str]:
    """Star look-up: time, errors and memory against the number of stars; then time at a fixed density."""
    build_s = {key_of(c): c["build_s"] for c in cases if c["kind"] == "build"}
    queries = sorted((c for c in cases if c["kind"] == "query"), key=lambda c: (c["n_star"], c["method"], c["device"]))
    lines = []
    if queries:
        lines += [
            "| stars | method | device | us per cone | stars found per cone | lost + extra | displaced [arcsec] "
            "| tested per found | bytes per star | on the device [MB] | build [s] |",
            "|---|---|---|---|---|---|---|---|---|---|---|",
        ]
    for c in queries:
        cells = [
            f"{c['n_star']:,}",
            c["method"],
            c["device"],
            f"{c['us_per_cone']:,.3g}" if c["us_per_cone"] < 100 else f"{c['us_per_cone']:,.0f}",
            f"{c['n_found'] / c['n_cone']:.1f}",
            f"{c['lost']} + {c['extra']} of {c['n_right']:,}",
            shown(c.get("displaced_arcsec"), ".2g"),
            shown(c.get("tested_per_found"), ".1f"),
            shown(c.get("bytes_per_star"), ".1f"),
            shown(c.get("device_mb"), ",.1f"),
            shown(build_s.get(key_of(c)), ".3g"),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    zones = sorted(
        (c for c in cases if c["kind"] == "fixed density"), key=lambda c: (c["device"], c["method"], c["n_star"])
    )
    if zones:
        lines += ["", "The same views of equally dense catalogs:", ""]
        lines += [
            "| stars in the catalog | method | device | us per cone | stars found per cone |",
            "|---|---|---|---|---|",
        ]
    lines += [
        f"| {c['n_star']:,} | {c['method']} | {c['device']} | {c['us_per_cone']:.1f} "
        f"| {c['n_found'] / c['n_cone']:.1f} |"
        for c in zones
    ]
    return lines


def key_of(case: Case) -> tuple[int, str, str]:
    """What a query and the building of its index have in common."""
    return case["n_star"], case["method"], case["device"]


def shown(value: float | None, form: str) -> str:
    """A number, or a dash where there is none."""
    return "-" if value is None else format(value, form)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("result", type=Path, nargs="?", default=Path(__file__).parent / "results" / "fps.json")
    parser.add_argument("--plot", type=Path, metavar="PNG", help="also draw a result that has a picture")
    options = parser.parse_args()
    print(report(options.result))
    if options.plot:
        cases = cases_of(json.loads(options.result.read_text("utf-8")))
        draw = next((draw for key, draw in PICTURES.items() if key in cases[0]), None)
        if draw is None:
            parser.error(f"--plot: {options.result.name} has no picture")
        draw(cases, options.plot)
