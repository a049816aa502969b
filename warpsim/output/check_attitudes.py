"""How targets turn by tables, and what these miss between their rows, or freely, in the report of a scene."""

from __future__ import annotations

import numpy as np

from warpsim.output.wording import counted
from warpsim.scene.scenario import Scenario
from warpsim.target.attitude_table import AttitudeRows
from warpsim.target.torque_free import Nutation, TorqueFreeMotion

ROUGH_DEG = 0.1
"""An error from which on a report warns."""


def target_attitude_lines(scenario: Scenario) -> list[str]:
    """Lines about the tables by which targets turn, and about free rotations, each once."""
    rows_of: dict[AttitudeRows, str] = {}
    free: dict[Nutation, str] = {}
    for target, attitude in zip(scenario.targets, scenario.attitudes, strict=True):
        if isinstance(attitude, AttitudeRows):
            rows_of.setdefault(attitude, target.spec.name)
        if isinstance(attitude, TorqueFreeMotion):
            free.setdefault(attitude.nutation, target.spec.name)
    lines = [line for rows, name in rows_of.items() for line in attitude_lines(name, rows, scenario.scene.duration_s)]
    return lines + [_free_line(name, nutation) for nutation, name in free.items()]


def _free_line(name: str, nutation: Nutation) -> str:
    """A line about a free rotation: its two turns."""
    words = f"{name} turns freely, {nutation.precession_rev_s:.4g} rev/s about its angular momentum"
    if nutation.rate_rev_s == 0.0:
        return f"  attitude   {words}"
    return f"  attitude   {words}, and nutates in {1.0 / nutation.rate_rev_s:.4g} s"


def attitude_lines(name: str, rows: AttitudeRows, duration_s: float) -> list[str]:
    """A line about a table, with the error of its rows as estimated, and a warning where that is large."""
    error_rad, near_s = rows.worst_error(0.0, duration_s)
    given = rows.time_s if rows.given_s is None else rows.given_s
    error_deg = float(np.degrees(error_rad))
    parts = [f"{name} by {counted(len(given), 'row')}", *([rows.note] if rows.note else [])]
    if len(given) > 2:
        parts.append(f"some {error_deg:.1g} deg off between rows near {near_s:.6g} s")
    lines = [f"  attitude   {', '.join(parts)}"]
    if error_deg >= ROUGH_DEG:
        lines.append(f"  warning    {name}: rows of attitudes are too far apart, or give rates that are not used")
    return lines
