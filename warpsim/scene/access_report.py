"""Access report: the intervals in which sensors of a scene can observe its targets, and tables of times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.errors import InputError
from warpsim.orbit.access_constraints import AccessConstraints, MarginFunction
from warpsim.scene.instrument import Instrument
from warpsim.scene.roster import Roster

if TYPE_CHECKING:
    from astropy.table import Table


Row = tuple[str, str, float, float]
"""Sensor, what its access counts by, first and last time [s]."""


def access_report(
    roster: Roster,
    target: str | None,
    sensors: str | Sequence[str] | None,
    rules: AccessConstraints | None,
    custom: Mapping[str, MarginFunction] | None,
    step_s: float,
    epoch_utc: str,
) -> Table:
    """Return the intervals of access of sensors to a target, or to the targets that their access counts by."""
    chosen = chosen_sensors(roster, sensors)
    check_rules(rules, custom)
    members = None if target is None else roster.members(target)
    rows: list[Row] = []
    counted: set[str] = set()
    kinds: dict[str, dict[str, Any]] = {}
    for kind, instrument in roster.instruments.items():
        own = [instrument.index(name) for name in chosen if name in instrument.index_of]
        if own:
            found = instrument.access_intervals(own, members, rules, custom, step_s)
            kinds[kind] = enabled_constraints(rules or instrument.access_rules)
            counted |= {roster.called(some) for index in own for _, some in instrument.access_targets(index)}
        for row, start_s, end_s in zip(found.row, found.start_s, found.end_s, strict=True) if own else ():
            name, ends_s = instrument.names[own[row]], (float(start_s), float(end_s))
            rows += [(name, target, *ends_s)] if target else _parts(roster, instrument, own[row], *ends_s)
    order = {name: index for index, name in enumerate(chosen)}
    meta = {
        "target": target or (counted.pop() if len(counted) == 1 else "tracked"),
        "epoch_utc": epoch_utc,
        "rules": kinds[roster.instrument_of(chosen[0]).sensor.name],
        "rules_by_kind": kinds,
        "custom_rules": list(custom or {}),
    }
    return access_table(sorted(rows, key=lambda row: (order[row[0]], row[2])), meta)


def chosen_sensors(roster: Roster, sensors: str | Sequence[str] | None) -> list[str]:
    """Return the sensors asked for."""
    chosen = roster.select_sensors(sensors)
    if len(set(chosen)) < len(chosen):
        raise InputError(f"must be one or more without repeats, got {', '.join(chosen)}", "sensors")
    return chosen


def check_rules(rules: AccessConstraints | None, custom: Mapping[str, MarginFunction] | None) -> None:
    """Check the types of constraints; InputError where one is wrong."""
    if rules is not None and not isinstance(rules, AccessConstraints):
        raise InputError(f"must be AccessConstraints, got {type(rules).__name__}", "rules")
    if custom is not None and not isinstance(custom, Mapping):
        raise InputError(f"must be a dict of names and functions, got {type(custom).__name__}", "custom")


def _parts(roster: Roster, instrument: Instrument, sensor: int, start_s: float, end_s: float) -> list[Row]:
    """Parts of an interval of access in which it counts by different things."""
    targets = instrument.access_targets(sensor)
    starts_s = [step_s for step_s, _ in targets]

    def counted(time_s: float) -> str:
        return roster.called(targets[int(np.searchsorted(starts_s, time_s, side="right")) - 1][1])

    cuts_s = [start_s, *(step_s for step_s in starts_s if start_s < step_s < end_s)]
    said = [(time_s, counted(time_s)) for time_s in cuts_s]
    kept = [said[0], *(after for before, after in pairwise(said) if after[1] != before[1])]
    ends_s = [time_s for time_s, _ in kept[1:]] + [end_s]
    name = instrument.names[sensor]
    return [(name, what, time_s, last_s) for (time_s, what), last_s in zip(kept, ends_s, strict=True)]


def access_table(rows: Iterable[tuple[str, str, float, float]], meta: Mapping[str, Any]) -> Table:
    """Return intervals of access as a table."""
    whole = [(sensor, target, start_s, end_s, end_s - start_s) for sensor, target, start_s, end_s in rows]
    return _table_of_times(whole, ("sensor", "target", "start_s", "end_s", "duration_s"), meta)


def enabled_constraints(rules: AccessConstraints) -> dict[str, Any]:
    """Return the enabled constraints."""
    return {name: value for name, value in asdict(rules).items() if value is not None and value is not False}


def eclipse_table(eclipses: Sequence[Any], meta: Mapping[str, Any]) -> Table:
    """Return passages through the Earth's shadow as a table."""
    rows = [(*eclipse, eclipse.end_s - eclipse.start_s) for eclipse in eclipses]
    return _table_of_times(rows, ("start_s", "umbra_start_s", "umbra_end_s", "end_s", "duration_s"), meta)


def _table_of_times(rows: Sequence[tuple[Any, ...]], names: Sequence[str], meta: Mapping[str, Any]) -> Table:
    """Table whose time columns carry the unit."""
    from astropy.table import Table

    table = Table(rows=rows or None, names=names, dtype=[float if name.endswith("_s") else str for name in names])
    table.meta.update(meta)
    for name in names:
        if name.endswith("_s"):
            table[name].unit = "s"
            table[name].info.format = ".3f"
    return table
