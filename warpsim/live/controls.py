"""Controls of the page: time, images, curves, and what changes the scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from warpsim.live.changes import Change, changes
from warpsim.live.curves import QUANTITIES, Curves
from warpsim.output.grey import CEILING_NEI
from warpsim.scene.scenario import Scenario

FIRST = "first"
"""Of the bands: that of each sensor which is its first."""
EARTH, GROUP = "Earth", "group"


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
        self.status = gui.add_html("")
        self.slider = gui.add_slider("frame", first, max(last, first + 1), 1, begin)
        self.buttons = gui.add_button_group("time", ("play", "pause", "step"))
        self.speed = gui.add_slider("times real", 0.1, 100.0, 0.1, 10.0)
        self.view = gui.add_dropdown("show", (EARTH, GROUP) if scenario.targets else (EARTH,))
        with gui.add_folder("Images"):
            self.sensors = gui.add_text("sensors", ",".join(sensors))
            self.band = gui.add_dropdown("band", (FIRST, *scenario.bands))
            self.ceiling = gui.add_slider("white at [NEI]", 5.0, 5000.0, 5.0, CEILING_NEI)
            self.overlay = gui.add_checkbox("boxes and names", True)
            self.crop = gui.add_checkbox("targets only", False)
        self.access = gui.add_html("")
        self.curves = Curves(gui, scenario)
        with self.curves.folder:
            self.target = gui.add_dropdown("target", scenario.target_names or ("none",))
            self.sensor = gui.add_dropdown("sensor", list(sensors) or scenario.sensor_names)
            self.quantity = gui.add_dropdown("quantity", QUANTITIES)

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
        for control in (self.target, self.sensor, self.quantity, self.band):
            control.on_update(lambda _: curve())

    def draw_curve(self, scenario: Scenario) -> None:
        """Draw the chosen curve; in the sensor's first band where it does not have the chosen one."""
        bands = scenario.instrument_of(self.sensor.value).sensor.bands
        band = self.band.value if self.band.value in bands else bands[0]
        self.curves.choose(scenario, self.sensor.value, self.target.value, band, self.quantity.value)


class SceneControls:
    """Fields that change the scene.

    Args:
        gui: The server's `gui`.
        scenario: What is shown.
        sensor: One of the kind of sensors whose numbers are shown.
        when_changed: Called when a value was changed.
    """

    def __init__(self, gui: Any, scenario: Scenario, sensor: str, when_changed: Callable[[], None]) -> None:
        self.changes = changes(scenario, sensor)
        self._fields = {}
        with gui.add_folder("Scene", expand_by_default=False):
            for change in self.changes:
                if change.options:
                    field = gui.add_dropdown(change.label, change.options, initial_value=change.value)
                elif isinstance(change.value, int):
                    field = gui.add_number(change.label, change.value, step=1)
                else:
                    field = gui.add_text(change.label, repr(change.value))  # as 1e-18 is no number of the page's
                field.on_update(lambda _: when_changed() if self._is_changed() else None)
                self._fields[change.path] = field

    def _is_changed(self) -> bool:
        return any(self.value(change) != change.value for change in self.changes)

    def reset(self) -> None:
        """Let all fields show what is in force."""
        for change in self.changes:
            field = self._fields[change.path]
            shown = repr(change.value) if isinstance(change.value, float) else change.value
            if field.value != shown:
                field.value = shown

    def value(self, change: Change) -> Any:
        """What stands in a field; a text that is no number stays a text, which the scene refuses."""
        value = self._fields[change.path].value
        if isinstance(change.value, float):
            try:
                return float(value)
            except ValueError:
                return value
        return value
