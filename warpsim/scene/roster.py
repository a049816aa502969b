"""The roster of a scene: its sensors and targets by name, and tables of when the former can observe the latter."""

from __future__ import annotations

import fnmatch
import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.arguments import some_names
from warpsim.errors import InputError
from warpsim.orbit.access_constraints import AccessConstraints, MarginFunction
from warpsim.scene.instrument import Instrument
from warpsim.scene.targets import SceneTarget

if TYPE_CHECKING:
    from astropy.table import Table

Row = tuple[str, str, float, float]
"""Sensor, what its access counts by, first and last time [s]."""


@dataclass(frozen=True)
class Roster:
    """Sensors and targets by name."""

    instruments: Mapping[str, Instrument]
    """Each kind of sensor, by name."""
    targets: Sequence[SceneTarget]
    groups: Sequence[str]
    """Names of the groups."""

    @property
    def sensor_names(self) -> list[str]:
        """Names of all sensors, kind by kind."""
        return [name for instrument in self.instruments.values() for name in instrument.names]

    @property
    def target_names(self) -> list[str]:
        """Names of the single targets."""
        return [target.name for target in self.targets]

    def instrument_of(self, sensor: str) -> Instrument:
        """Return the kind that a sensor, or a name of a kind, belongs to."""
        for name, instrument in self.instruments.items():
            if sensor == name or sensor in instrument.index_of:
                return instrument
        raise InputError(f"must be a sensor of the scene ({some_names(self.sensor_names)})", "sensor", sensor)

    def select_sensors(self, names: str | Sequence[str] | None) -> list[str]:
        """Return names of sensors for names of sensors and kinds, and patterns of either like "sat11.*"; all for None.

        A sensor that a kind or a pattern means besides comes once; plain names of sensors stay as they are.
        """
        known = self.sensor_names
        if names is None:
            return known
        if not isinstance(names, str | Sequence):
            raise InputError("must be a list of names", "sensors", names)
        asked = [names] if isinstance(names, str) else names
        chosen = [sensor for name in asked for sensor in self._meant_by(name, known)]
        if not chosen:
            raise InputError("must name at least one", "sensors")
        return chosen if all(name in known for name in asked) else list(dict.fromkeys(chosen))

    def _meant_by(self, name: str, known: Sequence[str]) -> list[str]:
        """Return those of the known sensors that a name or a pattern of names means."""
        if name in known:
            return [name]
        if name in self.instruments:
            return self.instruments[name].names
        matches = functools.partial(fnmatch.fnmatchcase, pat=str(name))
        found = [one for kind, own in self.instruments.items() for one in own.names if matches(kind) or matches(one)]
        if not found:
            kinds = "" if len(self.instruments) == 1 else f", or of the kinds {', '.join(self.instruments)}"
            raise InputError(f"must be sensors of the scene ({some_names(known)}{kinds})", "sensors", name)
        return found

    def target(self, name: str, field: str = "name") -> int:
        """Return the index of a target."""
        names = self.target_names
        if name not in names:
            raise InputError(f"must be a target of the scene ({some_names(names)})", field, name)
        return names.index(name)

    def members(self, name: str) -> tuple[int, ...]:
        """Return the index of a target, or those of a group."""
        if name in self.groups and name not in self.target_names:
            group = self.groups.index(name)
            return tuple(index for index, target in enumerate(self.targets) if target.group == group)
        return (self.target(name, "target"),)

    def called(self, targets: Sequence[int]) -> str:
        """Return the common name of some targets: of a target, a group, or any."""
        if len(targets) == 1:
            return self.targets[targets[0]].name
        groups = {self.targets[target].group for target in targets}
        return self.groups[groups.pop()] if len(groups) == 1 else "any"

    def distinct_sensors(self, sensors: str | Sequence[str] | None) -> list[str]:
        """Return the sensors asked for; none may come twice."""
        chosen = self.select_sensors(sensors)
        if len(set(chosen)) < len(chosen):
            raise InputError(f"must be one or more without repeats, got {', '.join(chosen)}", "sensors")
        return chosen

    def access(
        self,
        target: str | None,
        sensors: str | Sequence[str] | None,
        rules: AccessConstraints | None,
        custom: Mapping[str, MarginFunction] | None,
        step_s: float,
        epoch_utc: str,
    ) -> Table:
        """Return the intervals of access of sensors to a target, or to the targets that their access counts by."""
        chosen = self.distinct_sensors(sensors)
        check_rules(rules, custom)
        members = None if target is None else self.members(target)
        rows: list[Row] = []
        counted: set[str] = set()
        kinds: dict[str, dict[str, Any]] = {}
        for kind, instrument in self.instruments.items():
            own = [instrument.index(name) for name in chosen if name in instrument.index_of]
            if not own:
                continue
            found = instrument.access_intervals(own, members, rules, custom, step_s)
            enabled = asdict(rules or instrument.access_rules).items()
            kinds[kind] = {name: value for name, value in enabled if value is not None and value is not False}
            counted |= {self.called(some) for index in own for _, some in instrument.access_targets(index)}
            columns = (column.tolist() for column in (found.row, found.start_s, found.end_s))
            for row, start_s, end_s in zip(*columns, strict=True):
                name = instrument.names[own[row]]
                rows += [(name, target, start_s, end_s)] if target else self._parts(instrument, name, start_s, end_s)
        order = {name: index for index, name in enumerate(chosen)}
        meta = {
            "target": target or (counted.pop() if len(counted) == 1 else "tracked"),
            "epoch_utc": epoch_utc,
            "rules": kinds[self.instrument_of(chosen[0]).sensor.name],
            "rules_by_kind": kinds,
            "custom_rules": list(custom or {}),
        }
        whole = [(*row, row[3] - row[2]) for row in sorted(rows, key=lambda row: (order[row[0]], row[2]))]
        return table_of_times(whole, ("sensor", "target", "start_s", "end_s", "duration_s"), meta)

    def _parts(self, instrument: Instrument, sensor: str, start_s: float, end_s: float) -> list[Row]:
        """Parts of an interval of access in which it counts by different things."""
        targets = instrument.access_targets(instrument.index(sensor))
        starts_s = [step_s for step_s, _ in targets]

        def counted(time_s: float) -> str:
            return self.called(targets[int(np.searchsorted(starts_s, time_s, side="right")) - 1][1])

        cuts_s = [start_s, *(step_s for step_s in starts_s if start_s < step_s < end_s)]
        said = [(time_s, counted(time_s)) for time_s in cuts_s]
        kept = [said[0], *(after for before, after in pairwise(said) if after[1] != before[1])]
        ends_s = [time_s for time_s, _ in kept[1:]] + [end_s]
        return [(sensor, what, time_s, last_s) for (time_s, what), last_s in zip(kept, ends_s, strict=True)]


def check_rules(rules: AccessConstraints | None, custom: Mapping[str, MarginFunction] | None) -> None:
    """Check the types of constraints; InputError where one is wrong."""
    if rules is not None and not isinstance(rules, AccessConstraints):
        raise InputError(f"must be AccessConstraints, got {type(rules).__name__}", "rules")
    if custom is not None and not isinstance(custom, Mapping):
        raise InputError(f"must be a dict of names and functions, got {type(custom).__name__}", "custom")


def table_of_times(rows: Sequence[tuple[Any, ...]], names: Sequence[str], meta: Mapping[str, Any]) -> Table:
    """Return a table whose time columns carry the unit."""
    from astropy.table import Table

    table = Table(rows=rows or None, names=names, dtype=[float if name.endswith("_s") else str for name in names])
    table.meta.update(meta)
    for name in names:
        if name.endswith("_s"):
            table[name].unit = "s"
            table[name].info.format = ".3f"
    return table
