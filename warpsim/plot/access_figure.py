"""Figures of access: the intervals of every sensor, and its range to its targets (the paper's Fig. 8)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.arrays import F64
from warpsim.plot.figure import BLUE, DASHES, GREY, PALE, SERIES, literal, new_axes, plain
from warpsim.scene.pointing import ANY
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of

if TYPE_CHECKING:
    from astropy.table import Table
    from matplotlib.axes import Axes

Spans = dict[str, list[tuple[float, float, str]]]
"""Start and end [s] and target of the intervals of each sensor, in the order of time."""

_LABEL_WIDTH = 0.055  # of a label's letters, over that of the axes
_N_TIME = 801
_TALLEST_INCH = 40.0


def plot_access(
    scene: Scene | Scenario,
    ax: Axes | None = None,
    only_with_access: bool = False,
    access: Table | None = None,
    sensors: Sequence[str] | None = None,
) -> Axes:
    """Draw the intervals of access: a row per sensor, a bar per interval.

    Bars carry their start and end [s after the epoch] where there is room; the total stands on the right. Where access
    counts by several things, bars have a colour for each.

    Args:
        scene: The scene.
        ax: Where to draw; a new figure grows with the number of sensors.
        only_with_access: Leave out sensors without access; otherwise their names are grey.
        access: Result of `scene.access` for a target, sensors or constraints; the scene's if left out.
        sensors: Names of the sensors, or of the kinds, that it is about; all if left out.

    Raises:
        InputError: A name is no sensor.
    """
    scenario = scenario_of(scene)
    table = scenario.access() if access is None else access
    chosen = scenario.select_sensors(sensors)
    seen = set(table["sensor"])
    names = [name for name in chosen if name in seen or not only_with_access]
    ax = ax or new_axes(9.0, min(1.6 + 0.27 * max(3, len(names)), _TALLEST_INCH))
    duration_s = scenario.scene.duration_s
    _draw_bars(ax, names, _spans(table), duration_s)
    if not names:
        ax.text(0.5, 0.5, "no sensor has access", ha="center", transform=ax.transAxes)
    ax.set_yticks(range(len(names)), names, fontsize=8)
    for name, tick in zip(names, ax.get_yticklabels(), strict=True):
        tick.set_color("black" if name in seen else PALE)
    ax.set(xlim=(0, duration_s), ylim=(max(len(names), 1) - 0.4, -0.6), xlabel="time after the epoch [s]")
    number = f"{len(seen.intersection(chosen))} of {len(chosen)} sensors"
    words = f"access to {_counted_words(scenario, chosen, table)}, {number}"
    ax.set_title(f"{literal(scenario.scene.name)}: {words}", fontsize=10)
    ax.grid(axis="x", alpha=0.35)
    ax.set_axisbelow(True)
    return ax


def _spans(table: Table) -> Spans:
    spans: Spans = {}
    columns = (np.asarray(table[name]).tolist() for name in ("sensor", "start_s", "end_s", "target"))
    for sensor, *span in zip(*columns, strict=True):
        spans.setdefault(sensor, []).append(tuple(span))
    return {sensor: sorted(found) for sensor, found in spans.items()}


def _draw_bars(ax: Axes, names: Sequence[str], spans_of: Spans, duration_s: float) -> None:
    """A row of bars for each sensor, with the total on the right, and a legend where they have several colours."""
    targets = list(dict.fromkeys(target for spans in spans_of.values() for _, _, target in spans))
    coloured = 1 < len(targets) <= len(SERIES)
    colours = dict(zip(targets, SERIES, strict=False)) if coloured else dict.fromkeys(targets, BLUE)
    for row, name in enumerate(names):
        spans = spans_of.get(name, [])
        filled_s = 0.0  # up to here the row is full, of bars and words
        for number, (start_s, end_s, target) in enumerate(spans):
            ax.barh(row, end_s - start_s, left=start_s, height=0.68, color=colours[target],
                    edgecolor=colours[target], linewidth=0.6)  # the edge shows bars of milliseconds  # fmt: skip
            next_s = spans[number + 1][0] if number + 1 < len(spans) else duration_s
            filled_s = _label_bar(ax, row, start_s, end_s, (filled_s, next_s), _LABEL_WIDTH * duration_s)
        total_s = sum(end_s - start_s for start_s, end_s, _ in spans)
        total = f"{total_s / 60:.1f} min" if total_s >= 6.0 else f"{plain(total_s, 2)} s"
        ax.text(1.01, row, total if spans else "no access", transform=ax.get_yaxis_transform(),
                va="center", fontsize=8, color="black" if spans else PALE)  # fmt: skip
    if coloured:
        for target, colour in colours.items():
            ax.barh(0, 0, color=colour, label={ANY: "any target"}.get(target, target))
        ax.legend(loc="center left", bbox_to_anchor=(1.09, 0.5), fontsize=8, frameon=False)


def _label_bar(ax: Axes, row: int, start_s: float, end_s: float, free_s: tuple[float, float], number_s: float) -> float:
    """Write start and end of a bar, and return where the bar or its words end.

    They stand inside where they fit (a number is number_s wide), else together behind or before it if it is free there.
    """
    n_decimal = 1 if end_s - start_s >= 0.1 else 3
    first, last, inset_s = f"{start_s:.{n_decimal}f}", f"{end_s:.{n_decimal}f}", 0.12 * number_s
    if end_s - start_s > 2.4 * number_s:
        ax.text(start_s + inset_s, row, first, va="center", ha="left", color="white", fontsize=8)
        ax.text(end_s - inset_s, row, last, va="center", ha="right", color="white", fontsize=8)
    elif free_s[1] - end_s > 2.8 * number_s:
        ax.text(end_s + inset_s, row, f"{first} to {last}", va="center", ha="left", color=GREY, fontsize=8)
        return end_s + 2.8 * number_s
    elif start_s - free_s[0] > 2.8 * number_s:
        ax.text(start_s - inset_s, row, f"{first} to {last}", va="center", ha="right", color=GREY, fontsize=8)
    return end_s


def _counted_words(scenario: Scenario, sensors: Sequence[str], access: Table) -> str:
    """Name what access counts by: a target, a group, any target, or what each sensor tracks."""
    if access.meta["target"] in (*scenario.target_names, *scenario.group_names):
        return str(access.meta["target"])
    counted = {tuple(targets) for sensor in sensors for _, targets in _counted(scenario, sensor, access)}
    if len(counted) != 1:
        return "what each sensor tracks"
    (targets,) = counted
    called = scenario.roster.called(targets)
    return "any target" if called == ANY else called


def _counted(scenario: Scenario, sensor: str, access: Table) -> list[tuple[float, Sequence[int]]]:
    """The targets that a table of access counts by for a sensor, with start times [s]."""
    if access.meta["target"] in (*scenario.target_names, *scenario.group_names):
        return [(-np.inf, scenario.roster.members(access.meta["target"]))]
    instrument = scenario.instrument_of(sensor)
    return list(instrument.access_targets(instrument.index(sensor)))


def plot_range(
    scene: Scene | Scenario,
    sensors: Sequence[str] | None = None,
    ax: Axes | None = None,
    access: Table | None = None,
) -> Axes:
    """Draw the distance from sensors to a target against time; thick where there is access (the paper's Fig. 8).

    Where a sensor's access counts by several targets it is the distance to the nearest of those that exist.

    Args:
        scene: The scene.
        sensors: Names of sensors or of kinds; those with access at some time if left out.
        ax: Where to draw; seconds after the epoch, and km.
        access: Result of `scene.access` for a target, sensors or constraints; the scene's if left out.

    Raises:
        InputError: A name is no sensor.
    """
    scenario = scenario_of(scene)
    table = scenario.access() if access is None else access
    if sensors is None:
        chosen = [name for name in scenario.sensor_names if name in set(table["sensor"])]
    else:
        chosen = scenario.select_sensors(sensors)
    ax = ax or new_axes(9.0, 5.0)
    spans, time_s = _spans(table), np.linspace(0, scenario.scene.duration_s, _N_TIME)
    for number, name in enumerate(chosen):
        # After each round of colours the dashes change.
        style: dict[str, Any] = {"color": SERIES[number % len(SERIES)]}
        style["linestyle"] = DASHES[number // len(SERIES) % len(DASHES)]
        counted = _counted(scenario, name, table)
        ax.plot(time_s, _range_km(scenario, name, counted, time_s), linewidth=0.8, **style)
        for part, (start_s, end_s, _) in enumerate(spans.get(name, [])):
            span_s, label = np.linspace(start_s, end_s, _N_TIME), None if part else name
            ax.plot(span_s, _range_km(scenario, name, counted, span_s), linewidth=3, label=label, **style)
        if name not in spans:
            ax.plot([], [], linewidth=0.8, label=name, **style)
    kinds = table.meta["rules_by_kind"].values()
    for farthest_km in sorted({kind["max_range_km"] for kind in kinds if "max_range_km" in kind}):
        ax.axhline(farthest_km, color=GREY, linestyle=(0, (6, 3)), linewidth=1)
        ax.text(0.995, farthest_km, "farthest allowed", color=GREY, fontsize=8, ha="right", va="bottom",
                transform=ax.get_yaxis_transform())  # fmt: skip
    ax.set(xlim=(0, scenario.scene.duration_s), ylim=(0, None))
    words = _counted_words(scenario, chosen or scenario.sensor_names, table)
    ax.set(xlabel="time after the epoch [s]", ylabel=f"range to {words} [km]")
    ax.set_title(f"{literal(scenario.scene.name)}: thick lines mark access", fontsize=10)
    ax.grid(alpha=0.3)
    if 0 < len(chosen) <= 24:
        ax.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, handlelength=3)
    return ax


def _range_km(scenario: Scenario, sensor: str, counted: Sequence[tuple[float, Sequence[int]]], time_s: F64) -> F64:
    """Distance from a sensor to the nearest target that exists [km], (n,), without light time.

    NaN where there is no target, and at the first time at which others are there than before, so that lines break.
    """
    sensor_m = scenario.position_m(sensor, time_s)
    nearest_m, changes = np.full(time_s.shape, np.inf), np.zeros(time_s.shape, dtype=bool)
    ends_s = [start_s for start_s, _ in counted[1:]] + [np.inf]
    for (start_s, targets), end_s in zip(counted, ends_s, strict=True):
        for target in targets:
            there = scenario.tracks.exist(target, time_s) & (time_s >= start_s) & (time_s < end_s)
            line_m = scenario.tracks.target_state(target, time_s)[0] - sensor_m
            nearest_m = np.where(there, np.minimum(nearest_m, np.linalg.norm(line_m, axis=1)), nearest_m)
            changes[1:] |= there[1:] != there[:-1]
    return np.where(np.isfinite(nearest_m) & ~changes, nearest_m / 1e3, np.nan)
