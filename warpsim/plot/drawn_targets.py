"""Targets as figures draw them: their kinds, the paths of their groups, and the targets of sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.plot.figure import INK, MARKERS, PURPLE, SERIES, VERMILION
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class TargetKind:
    """Targets of one entry of a group; a main target is a kind of its own."""

    number: int
    """Counts through all groups."""
    name: str
    """Of the entry."""
    group: int
    """Index of the group."""
    targets: list[int]
    """Indices of the targets."""
    is_main: bool
    """Whether it is the main target of its group, which the others leave."""

    @property
    def label(self) -> str:
        """Name, and how many there are."""
        return self.name if len(self.targets) == 1 else f"{self.name} ({len(self.targets)})"

    @property
    def colour(self) -> str:
        """Colour; the first kind is vermilion, which no other is."""
        others = [colour for colour in SERIES if colour != VERMILION]
        return VERMILION if self.number == 0 else others[(self.number - 1) % len(others)]

    @property
    def style(self) -> dict[str, Any]:
        """Mark and colour as arguments of `Axes.plot`; main targets are stars."""
        if self.is_main:
            return {"linestyle": "none", "marker": "*", "color": self.colour, "markersize": 13,
                    "markeredgecolor": INK, "zorder": 5}  # fmt: skip
        mark = MARKERS[(self.number - 1) % len(MARKERS)]
        return {"linestyle": "none", "marker": mark, "color": self.colour, "markersize": 5.5,
                "markeredgecolor": "white", "markeredgewidth": 0.4, "zorder": 3}  # fmt: skip


def target_kinds(scenario: Scenario) -> list[TargetKind]:
    """Return the kinds of targets of all groups, in the order of the targets."""
    rows: dict[tuple[int, int], list[int]] = {}
    for index, target in enumerate(scenario.targets):
        rows.setdefault((target.group, target.entry), []).append(index)
    kinds = []
    for number, ((group, entry), targets) in enumerate(rows.items()):
        described = scenario.scene.groups[group]
        is_main = entry == 0 and described.orbits is None
        kinds.append(TargetKind(number, described.targets[entry].name, group, targets, is_main))
    return kinds


@dataclass(frozen=True)
class GroupPath:
    """Paths of a group: that of its main target, or those of all its targets where each has its own orbit."""

    label: str
    targets: list[int]
    """Indices of the targets."""
    span_s: tuple[float, float]
    """From when to when they exist within the scene [s after the epoch]."""
    number: int
    """Index of the group."""

    @property
    def is_first(self) -> bool:
        """True for the scene's first group, whose lines are vermilion."""
        return self.number == 0

    @property
    def style(self) -> dict[str, Any]:
        """Colour and dashes of its lines as arguments of `Axes.plot`."""
        if self.is_first:
            return {"color": VERMILION}
        return {"color": PURPLE, "linestyle": ("-", "--", ":", "-.")[(self.number - 1) % 4]}

    def exists(self, time_s: float) -> bool:
        """Return whether its targets are there at a time."""
        return self.span_s[0] <= time_s <= self.span_s[1]

    def time_s(self, n: int) -> F64:
        """Return evenly spread times of its existence [s after the epoch], shape (n,)."""
        return np.linspace(*self.span_s, n)


def group_paths(scenario: Scenario) -> list[GroupPath]:
    """Return the paths of all groups."""
    found = []
    for number, group in enumerate(scenario.scene.groups):
        leading = [
            index for index, target in enumerate(scenario.targets) if target.group == number and not target.is_released
        ]
        if not leading:
            continue  # a file of orbits without any
        first_s, last_s = scenario.targets[leading[0]].exists_s
        span_s = max(first_s, 0.0), min(last_s, scenario.scene.duration_s)
        label = scenario.target_names[leading[0]] if group.orbits is None else f"{group.name} ({len(leading)})"
        found.append(GroupPath(label, leading, span_s, number))
    return found


def counted_targets(instrument: Instrument, sensor: int, time_s: float) -> Sequence[int]:
    """Return the targets that a sensor's access counts by at a time; none before the first step of its program."""
    found: Sequence[int] = ()
    for start_s, targets in instrument.access_targets(sensor):
        if start_s <= time_s:
            found = targets
    return found


def observed_targets(scenario: Scenario, instrument: Instrument, sensor: int, time_s: float) -> list[int]:
    """Return the targets at the ends of a sensor's lines of sight while it has access.

    They are those that its access counts by and that it can observe: the ones that are on the paths of their groups;
    one of the others where it can observe none of these.
    """
    counted = counted_targets(instrument, sensor, time_s)
    if len(counted) < 2:
        return list(counted)
    can_observe = instrument.can_observe([sensor], np.array([time_s]))[0, 0]
    seen = [target for target in counted if can_observe[target]]
    leading = [target for target in seen if not scenario.targets[target].is_released]
    return leading or seen[:1] or list(counted[:1])  # at the very end of an access none may be left
