"""Table of each result."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.tables.drawing import deposit_table, read_out_table
from benchmarks.tables.machine_code import machine_code_table
from benchmarks.tables.markdown import Case, table
from benchmarks.tables.orbits import access_table, orbits_table
from benchmarks.tables.sky import places_table, star_tables
from benchmarks.tables.speed import fps_table, peers_table, scaling_table, settings_table, stages_table
from benchmarks.tables.targets import signatures_table

TABLES: dict[str, Callable[[list[Case]], list[str]]] = {
    "registers": machine_code_table,
    "light_error": signatures_table,
    "ns_per_pixel": read_out_table,
    "deposit_error": deposit_table,
    "peer": peers_table,
    "setting": settings_table,
    "scaling": scaling_table,
    "stage_us": stages_table,
    "psf_error": fps_table,
    "switches": places_table,
    "rules": access_table,
    "propagation_s": orbits_table,
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


def plain_table(cases: list[Case]) -> list[str]:
    """Everything that cases say, where nothing better is known."""
    names = list(dict.fromkeys(name for c in cases for name in c))
    rows = ((f"{c[n]:.4g}" if isinstance(c.get(n), float) else c.get(n, "-") for n in names) for c in cases)
    return table(" | ".join(names), (tuple(row) for row in rows))
