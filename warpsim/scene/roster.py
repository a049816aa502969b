"""The roster of a scene: its sensors and targets by name."""

from __future__ import annotations

import fnmatch
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from warpsim.errors import InputError
from warpsim.scene.instrument import Instrument
from warpsim.scene.targets import SceneTarget


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

    def members(self, name: str, field: str = "target") -> tuple[int, ...]:
        """Return the index of a target, or those of a group."""
        if name in self.groups and name not in self.target_names:
            group = self.groups.index(name)
            return tuple(index for index, target in enumerate(self.targets) if target.group == group)
        return (self.target(name, field),)

    def called(self, targets: Sequence[int]) -> str:
        """Return the common name of some targets: of a target, a group, or any."""
        if len(targets) == 1:
            return self.targets[targets[0]].name
        groups = {self.targets[target].group for target in targets}
        return self.groups[groups.pop()] if len(groups) == 1 else "any"


def some_names(names: Sequence[str]) -> str:
    """Return the first of some names, for messages."""
    return ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
