"""Controls of the page: time, images and curves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from warpsim.arrays import F64
from warpsim.live.scene_controls import MOST_NAMES
from warpsim.output.grey import CEILING_NEI
from warpsim.render.light_curves import light_curves
from warpsim.scene.scenario import Scenario

FIRST = "first"
"""Of the bands: that of each sensor which is its first."""
EARTH, GROUP = "Earth", "group"

N_TIME = 400
"""Times of a curve over the whole scene."""

QUANTITIES = {
    "SNR": "snr",
    "irradiance [W/cm2]": "irradiance_w_cm2",
    "range [km]": "range_km",
    "aspect [deg]": "aspect_deg",
    "temperature [K]": "temperature_k",
    "projected area [m2]": "projected_area_m2",
}
"""Arrays of light curves by what the page calls them."""

_NO_ACCESS = "no access"
_COLOURS = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442")
_DOT = 2.5  # dots, as lines would join what is on both sides of a gap


class Controls:
    """Sliders, fields and buttons; they hold what the user chose.

    Args:
        gui: The server's `gui`.
        scenario: What is shown.
        sensors: Sensors with images.
        frames: Numbers of the first and the last frame, and of the one to begin with.
    """

    def __init__(self, gui: Any, scenario: Scenario, sensors: Sequence[str], frames: tuple[int, int, int]) -> None:
        first, last, begin = frames
        self._groups = scenario.group_names
        self.status = gui.add_html("")
        self.slider = gui.add_slider("frame", first, max(last, first + 1), 1, begin)
        self.buttons = gui.add_button_group("time", ("play", "pause", "step"))
        self.speed = gui.add_slider("times real", 0.1, 100.0, 0.1, 10.0)
        self.view = gui.add_dropdown("show", (EARTH, GROUP) if scenario.targets else (EARTH,))
        groups = [self._groups[number] for number in sorted({target.group for target in scenario.targets})]
        self.group = gui.add_dropdown("group", tuple(groups) or ("none",))
        self.group.visible = len(groups) > 1
        self.moving = gui.add_checkbox("play in 3-D too", True, hint="off: images play faster where no GPU draws")
        with gui.add_folder("Images"):
            self.sensors = gui.add_text("sensors", ",".join(sensors))
            self.band = gui.add_dropdown("band", (FIRST, *scenario.bands))
            self.ceiling = gui.add_slider("white at [NEI]", 5.0, 5000.0, 5.0, CEILING_NEI)
            self.overlay = gui.add_checkbox("boxes and names", True)
            self.crop = gui.add_checkbox("targets only", False)
        self.access = gui.add_html("")
        self.curves = Curves(gui, scenario, sensors)

    @property
    def chosen_group(self) -> int | None:
        """Number of the group that is shown instead of the Earth; None for the Earth."""
        return self._groups.index(self.group.value) if self.view.value == GROUP else None

    @property
    def chosen_band(self) -> str | None:
        """The band to show; None for the first of each sensor."""
        return None if self.band.value == FIRST else str(self.band.value)

    @property
    def chosen_sensors(self) -> list[str]:
        """Names and patterns as they are written."""
        return [name.strip() for name in self.sensors.value.split(",") if name.strip()]

    def when_changed(self, again: Callable[[], None], curve: Callable[[], None]) -> None:
        """Call `again` when images are to be shown in another way, `curve` when another curve is asked for."""
        for control in (self.ceiling, self.overlay, self.crop, self.band, self.sensors):
            control.on_update(lambda _: again())
        for control in (self.curves.target, self.curves.sensor, self.curves.quantity, self.band):
            control.on_update(lambda _: curve())


def first_frame(scenario: Scenario, sensors: Sequence[str], frames: Sequence[int]) -> int:
    """Return the middle of the first sensor's access, so that there is something to see."""
    if not sensors:
        return frames[0]
    instrument = scenario.instrument_of(sensors[0])
    seen = instrument.has_access(instrument.index(sensors[0]), instrument.frame_time_s(frames))
    with_access = np.flatnonzero(seen)
    return frames[int(with_access[len(with_access) // 2])] if len(with_access) else frames[0]


class Curves:
    """A chart of one quantity of a target as a sensor sees it, with a mark at the instant that the page shows.

    Args:
        gui: The server's `gui`.
        scenario: What is shown.
        sensors: Sensors with images.
    """

    def __init__(self, gui: Any, scenario: Scenario, sensors: Sequence[str]) -> None:
        self._gui, self._folder = gui, gui.add_folder("Curves")
        self._plot: Any = None
        with self._folder:
            self.target = gui.add_dropdown("target", tuple(scenario.target_names[:MOST_NAMES]) or ("none",))
            self.sensor = gui.add_dropdown("sensor", list(sensors) or scenario.sensor_names)
            self.quantity = gui.add_dropdown("quantity", tuple(QUANTITIES))
        self._time_s = np.linspace(0.0, scenario.scene.duration_s, N_TIME)
        self._lines: dict[str, F64] = {}

    def draw(self, scenario: Scenario, band: str, time_s: float) -> None:
        """Draw the chosen curve; in the sensor's first band where it does not have the chosen one."""
        sensor, target, quantity = self.sensor.value, self.target.value, self.quantity.value
        instrument = scenario.instrument_of(sensor)
        bands = instrument.sensor.bands
        band = band if band in bands else bands[0]
        curves = light_curves(scenario, self._time_s, [sensor], [target], [band])
        name = QUANTITIES[quantity]
        parts = curves.terms_w_cm2 if name == "irradiance_w_cm2" else {quantity: getattr(curves, name)}
        lines = {label: values.reshape(N_TIME) for label, values in parts.items()}
        access = instrument.has_access(instrument.index(sensor), self._time_s)
        total = sum(lines.values())
        self._lines = {label: np.where(access, values, np.nan) for label, values in lines.items()}
        self._lines[_NO_ACCESS] = np.where(access, np.nan, total)
        if name in ("snr", "irradiance_w_cm2"):  # not of what gives no light
            for values in self._lines.values():
                values[curves.irradiance_w_cm2.reshape(N_TIME) <= 0] = np.nan
        if self._plot is not None:
            self._plot.remove()
        colours = zip(self._lines, [*_COLOURS[: len(lines)], "#777"], strict=True)
        series = [{"label": "t [s]"}, *(_dots(label, colour, _DOT) for label, colour in colours)]
        mark = _dots("now", "#ff6b4a", 9)
        axis = {"stroke": "#aaa", "grid": {"stroke": "#333"}}
        scales = {"x": {"time": False, "range": (0.0, self._time_s[-1])}, "y": {"range": self._range()}}
        with self._folder:
            self._plot = self._gui.add_uplot(
                data=self._data(time_s), series=(*series, mark), height=170, scales=scales, axes=(axis, axis),
                title=f"{target} from {sensor}, band {band}: {quantity}",
            )  # fmt: skip

    def _range(self) -> tuple[float, float]:
        """Of the vertical axis: all values, and some room."""
        values = np.concatenate(list(self._lines.values()))
        values = values[np.isfinite(values)]
        low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
        room = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
        return low - room, high + room

    def _data(self, time_s: float) -> tuple[F64, ...]:
        now = np.full(N_TIME, np.nan)
        nearest = int(np.argmin(np.abs(self._time_s - time_s)))
        there = [values[nearest] for values in self._lines.values() if np.isfinite(values[nearest])]
        now[nearest] = there[0] if there else np.nan
        return (self._time_s, *self._lines.values(), now)

    def show(self, time_s: float) -> None:
        """Move the mark to an instant [s after the epoch]."""
        if self._plot is not None:
            self._plot.data = self._data(time_s)


def _dots(label: str, colour: str, size: float) -> dict[str, Any]:
    return {"label": label, "stroke": colour, "width": 0, "points": {"show": True, "size": size, "fill": colour}}
