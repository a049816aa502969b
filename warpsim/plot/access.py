"""Pictures of access: the intervals of every sensor, and its range to the main target (the paper's Fig. 8)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.plot.figure import BLUE, GREY, SERIES, new_axes
from warpsim.scene.scene import Scene

if TYPE_CHECKING:
    from astropy.table import Table
    from matplotlib.axes import Axes

F64 = NDArray[np.float64]

_LABEL_SHARE = 0.055  # width of a label's letters over that of the axes
_PALE = "0.6"
_N_TIME = 801
_TALLEST_INCH = 40.0


def plot_access(
    scene: Scene,
    ax: Axes | None = None,
    only_with_access: bool = False,
    access: Table | None = None,
    sensors: Sequence[str] | None = None,
) -> Axes:
    """Draw when each sensor can observe a target: a row per sensor, a bar per interval.

    Bars carry their start and end [s after the epoch] where there is room; the total stands on the right.

    Args:
        scene: The scene.
        ax: Where to draw; a new figure grows with the number of sensors.
        only_with_access: Leave out sensors without access; otherwise their names are grey.
        access: What `scene.access` gave for a target, sensors or rules of one's own; the scene's if left out.
        sensors: Names of the sensors that it is about; all if left out.

    Raises:
        InputError: A name is no sensor.
    """
    table = scene.access() if access is None else access
    sensors = _checked_sensors(scene, scene.sensor_names if sensors is None else sensors)
    seen = set(table["sensor"])
    names = [name for name in sensors if name in seen or not only_with_access]
    ax = ax or new_axes(9.0, min(1.6 + 0.27 * max(3, len(names)), _TALLEST_INCH))
    duration_s = scene.duration_s
    room_s = _LABEL_SHARE * duration_s
    for row, name in enumerate(names):
        spans = sorted((float(r["start_s"]), float(r["end_s"])) for r in table if r["sensor"] == name)
        taken_s = 0.0  # up to here the row is full, of bars and words
        for number, (start_s, end_s) in enumerate(spans):
            ax.barh(row, end_s - start_s, left=start_s, height=0.68, color=BLUE)
            next_s = spans[number + 1][0] if number + 1 < len(spans) else duration_s
            taken_s = _label_bar(ax, row, (start_s, end_s), room_s, (start_s - taken_s, next_s - end_s))
        total_min = sum(end_s - start_s for start_s, end_s in spans) / 60
        ax.text(1.01, row, f"{total_min:.1f} min" if spans else "no access", transform=ax.get_yaxis_transform(),
                va="center", fontsize=8, color="black" if spans else _PALE)  # fmt: skip
    if not names:
        ax.text(0.5, 0.5, "no sensor has access", ha="center", transform=ax.transAxes)
    ax.set_yticks(range(len(names)), names, fontsize=8)
    for name, tick in zip(names, ax.get_yticklabels(), strict=True):
        tick.set_color("black" if name in seen else _PALE)
    ax.set(xlim=(0, duration_s), ylim=(max(len(names), 1) - 0.4, -0.6), xlabel="time after the epoch [s]")
    share = f"{len(seen)} of {len(sensors)} sensors"
    ax.set_title(f"{scene.name}: access to {table.meta['target']}, {share}", fontsize=10)
    ax.grid(axis="x", alpha=0.35)
    ax.set_axisbelow(True)
    return ax


def _label_bar(ax: Axes, row: int, span_s: tuple[float, float], room_s: float, free_s: tuple[float, float]) -> float:
    """Start and end of a bar: inside where they fit, else together behind or before it where it is free, else nowhere.

    Returns where the bar or its words end.

    Args:
        ax: Where to write.
        row: Of the bar.
        span_s: Its start and end.
        room_s: Width of one number.
        free_s: Gaps before and behind the bar.
    """
    first, last = (f"{value:.1f}" for value in span_s)
    inset_s = 0.12 * room_s
    if span_s[1] - span_s[0] > 2.4 * room_s:
        ax.text(span_s[0] + inset_s, row, first, va="center", ha="left", color="white", fontsize=8)
        ax.text(span_s[1] - inset_s, row, last, va="center", ha="right", color="white", fontsize=8)
    elif free_s[1] > 2.8 * room_s:
        ax.text(span_s[1] + inset_s, row, f"{first} to {last}", va="center", ha="left", color=GREY, fontsize=8)
        return span_s[1] + 2.8 * room_s
    elif free_s[0] > 2.8 * room_s:
        ax.text(span_s[0] - inset_s, row, f"{first} to {last}", va="center", ha="right", color=GREY, fontsize=8)
    return span_s[1]


def plot_range(
    scene: Scene, sensors: Sequence[str] | None = None, ax: Axes | None = None, access: Table | None = None
) -> Axes:
    """Draw the distance from sensors to a target against time; thick where there is access (the paper's Fig. 8).

    Args:
        scene: The scene.
        sensors: Names of sensors; those with access at some time if left out.
        ax: Where to draw; seconds after the epoch, and km.
        access: What `scene.access` gave for a target, sensors or rules of one's own; the scene's if left out.

    Raises:
        InputError: A name is no sensor.
    """
    table = scene.access() if access is None else access
    target = table.meta["target"]
    if sensors is None:
        sensors = [name for name in scene.sensor_names if name in set(table["sensor"])]
    sensors = _checked_sensors(scene, sensors)
    ax = ax or new_axes(9.0, 5.0)
    time_s = np.linspace(0, scene.duration_s, _N_TIME)
    for number, name in enumerate(sensors):
        # After each round of colours the dashes change.
        style = ("-", "--", ":", "-.")[number // len(SERIES) % 4]
        colour = SERIES[number % len(SERIES)]
        ax.plot(time_s, range_km(scene, name, target, time_s), style, color=colour, linewidth=0.8)
        spans = [row for row in table if row["sensor"] == name]
        for part, row in enumerate(spans):
            span_s = np.linspace(row["start_s"], row["end_s"], _N_TIME)
            ax.plot(span_s, range_km(scene, name, target, span_s), style, color=colour, linewidth=3,
                    label=None if part else name)  # fmt: skip
        if not spans:
            ax.plot([], [], style, color=colour, linewidth=0.8, label=name)
    farthest_km = table.meta["rules"].get("max_range_km")
    if farthest_km is not None:
        ax.axhline(farthest_km, color=GREY, linestyle=(0, (6, 3)), linewidth=1)
        ax.text(0.995, farthest_km, "farthest allowed", color=GREY, fontsize=8, ha="right", va="bottom",
                transform=ax.get_yaxis_transform())  # fmt: skip
    ax.set(xlim=(0, scene.duration_s), ylim=(0, None))
    ax.set(xlabel="time after the epoch [s]", ylabel=f"range to {target} [km]")
    ax.set_title(f"{scene.name}: thick lines mark access", fontsize=10)
    ax.grid(alpha=0.3)
    if 0 < len(sensors) <= 24:
        ax.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, handlelength=3)
    return ax


def range_km(scene: Scene, sensor: str, target: str, time_s: F64) -> F64:
    """Distance from a sensor to a target [km], shape (n,), without light time."""
    sight_m = scene.position_m(target, time_s) - scene.position_m(sensor, time_s)
    return np.asarray(np.linalg.norm(sight_m, axis=1) / 1e3)


def _checked_sensors(scene: Scene, names: Sequence[str]) -> list[str]:
    for name in names:
        if name not in scene.sensor_names:
            raise InputError("must be sensors of the scene", "sensors", name)
    return list(names)
