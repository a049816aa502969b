"""Report of how cameras point and targets turn: laws and errors of pointing, tables and what they miss, fallbacks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from warpsim.output.check_views import FieldContents, field_contents, spread_views
from warpsim.output.wording import counted
from warpsim.scene.instrument import Instrument
from warpsim.scene.pointing import ALL, BodyPointing, FixedPointing, Pointing, SchedulePointing, TrackPointing
from warpsim.scene.scenario import Scenario
from warpsim.target.attitude_table import AttitudeRows
from warpsim.target.torque_free import Nutation, TorqueFreeMotion

ROUGH_DEG = 0.1
"""An error from which on a report warns."""

MOST_VIEWS_COUNTED = 1_000_000
"""Views in which fallback axes are counted."""


def target_attitude_lines(scenario: Scenario) -> list[str]:
    """Lines about the tables by which targets turn, and about free rotations, each once."""
    rows_of: dict[AttitudeRows, str] = {}
    free: dict[Nutation, str] = {}
    for target, attitude in zip(scenario.targets, scenario.attitudes, strict=True):
        if isinstance(attitude, AttitudeRows):
            rows_of.setdefault(attitude, target.spec.name)
        if isinstance(attitude, TorqueFreeMotion):
            free.setdefault(attitude.nutation, target.spec.name)
    lines = [line for rows, name in rows_of.items() for line in _attitude_lines(name, rows, scenario.scene.duration_s)]
    return lines + [_free_line(name, nutation) for nutation, name in free.items()]


def _free_line(name: str, nutation: Nutation) -> str:
    words = f"{name} turns freely, {nutation.precession_rev_s:.4g} rev/s about its angular momentum"
    if nutation.rate_rev_s == 0.0:
        return f"  attitude   {words}"
    return f"  attitude   {words}, and nutates in {1.0 / nutation.rate_rev_s:.4g} s"


def _attitude_lines(name: str, rows: AttitudeRows, duration_s: float) -> list[str]:
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


def pointing_warning(instruments: Iterable[Instrument], frames_of: Mapping[str, Sequence[int]]) -> str | None:
    """Return a warning of fallback camera axes, counted over the frames of each sensor; None if there are none."""
    n_up = n_boresight = n_view = 0
    for instrument in instruments:
        for sensor, time_s in spread_views(instrument, frames_of, MOST_VIEWS_COUNTED):
            commanded = instrument.commanded_axes(sensor, time_s)
            n_up += int(commanded.up_replaced.sum())
            n_boresight += int(commanded.boresight_replaced.sum())
            n_view += len(time_s)
    reasons = {
        "with pointing.up along the line of sight, its fallback is up": n_up,
        "with no direction to track, the motion's is taken": n_boresight,
    }
    return "; ".join(f"{counted(n, 'view')} of {n_view:,} {words}" for words, n in reasons.items() if n) or None


def pointing_lines(
    instrument: Instrument,
    scenario: Scenario,
    frames_of: Mapping[str, Sequence[int]],
    views: Mapping[str, Sequence[int]],
) -> list[str]:
    """Return lines about the pointing of the cameras, and the contents of the views, or of some spread over them."""
    pointings = instrument.sensor.pointing
    lines = []
    for number, pointing in enumerate(pointings):
        on = "all others" if number and ALL in pointing.on else ", ".join(pointing.on)
        lines.append(f"  pointing   {_pointing_text(pointing)}{f'; on {on}' if len(pointings) > 1 else ''}")
    bodies_of = {own.attitude: None for own in instrument.program.sensors if own.attitude is not None}
    lines += [line for rows in bodies_of for line in _attitude_lines("body", rows, scenario.scene.duration_s)]
    found = field_contents(instrument, scenario.tracks, views)
    n_view = counted(found.n_view, "view")
    if any(frames_of.values()):
        what = _counted_text(found, scenario)
        lines.append(f"  in field   {what} in {found.target:,} of {n_view}")
        if not found.target:
            lines.append(f"  warning    no view has {what} in the field")
    bodies = {"Earth": 0 if instrument.background.earth else found.earth, "Sun": found.sun}
    lines += [
        f"  warning    the {name} is in the field of {n:,} of {n_view} ({n / found.n_view:.0%}), and is not drawn"
        for name, n in bodies.items()
        if n
    ]
    if found.slewing:
        lines.append(f"  note       the camera slews or settles in {found.slewing:,} of {n_view}")
    warning = pointing_warning([instrument], frames_of)
    return lines if warning is None else [*lines, f"  warning    {warning}"]


def _pointing_text(pointing: Pointing) -> str:
    if isinstance(pointing, TrackPointing):
        what = f"tracks {pointing.track}"
    elif isinstance(pointing, BodyPointing):
        what = f"fixed in a body, {pointing.file}"
    elif isinstance(pointing, SchedulePointing):
        what = f"{counted(len(pointing.steps), 'step')}"
    else:
        what = "fixed" if isinstance(pointing, FixedPointing) else f"table, {pointing.mode}"
    errors = []
    if pointing.bias:
        errors.append(f"bias {_size_text(pointing.bias.rms_urad, pointing.bias.urad)} urad")
    if pointing.drift:
        errors.append(f"drift {_size_text(pointing.drift.rms_urad_s, pointing.drift.urad_s)} urad/s")
    if pointing.jitter:
        errors.append(f"jitter {pointing.jitter.rms_urad:g} urad (rms)")
    up = [] if isinstance(pointing, BodyPointing) else [f"{pointing.up} up"]
    return ", ".join([what, *up, *errors])


def _size_text(rms: float | None, axes: tuple[float, float] | None) -> str:
    """Size of an error of pointing: drawn for each sensor, or about the two axes."""
    return f"{rms:g} (rms)" if axes is None else f"({axes[0]:g}, {axes[1]:g})"


def _counted_text(found: FieldContents, scenario: Scenario) -> str:
    """Targets that access counts by, in words."""
    if len(found.counted) == 1:
        return scenario.target_names[next(iter(found.counted))]
    groups = {scenario.targets[target].group for target in found.counted}
    return f"a target of {scenario.group_names[groups.pop()]}" if len(groups) == 1 else "a target"
