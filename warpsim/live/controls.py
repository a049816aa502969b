"""Controls of the page: time, images and curves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from warpsim.live.changes import MOST_NAMES
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
        self._groups = scenario.group_names
        self.status = gui.add_html("")
        self.slider = gui.add_slider("frame", first, max(last, first + 1), 1, begin)
        self.buttons = gui.add_button_group("time", ("play", "pause", "step"))
        self.speed = gui.add_slider("times real", 0.1, 100.0, 0.1, 10.0)
        self.view = gui.add_dropdown("show", (EARTH, GROUP) if scenario.targets else (EARTH,))
        self.group = gui.add_dropdown("group", groups_with_targets(scenario) or ("none",))
        self.group.visible = len(self.group.options) > 1
        self.moving = gui.add_checkbox("play in 3-D too", True, hint="off: images play faster where no GPU draws")
        with gui.add_folder("Images"):
            self.sensors = gui.add_text("sensors", ",".join(sensors))
            self.band = gui.add_dropdown("band", (FIRST, *scenario.bands))
            self.ceiling = gui.add_slider("white at [NEI]", 5.0, 5000.0, 5.0, CEILING_NEI)
            self.overlay = gui.add_checkbox("boxes and names", True)
            self.crop = gui.add_checkbox("targets only", False)
        self.access = gui.add_html("")
        self.curves = Curves(gui, scenario)
        with self.curves.folder:
            self.target = gui.add_dropdown("target", tuple(scenario.target_names[:MOST_NAMES]) or ("none",))
            self.sensor = gui.add_dropdown("sensor", list(sensors) or scenario.sensor_names)
            self.quantity = gui.add_dropdown("quantity", QUANTITIES)

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
        for control in (self.target, self.sensor, self.quantity, self.band):
            control.on_update(lambda _: curve())

    def draw_curve(self, scenario: Scenario) -> None:
        """Draw the chosen curve; in the sensor's first band where it does not have the chosen one."""
        bands = scenario.instrument_of(self.sensor.value).sensor.bands
        band = self.band.value if self.band.value in bands else bands[0]
        self.curves.choose(scenario, self.sensor.value, self.target.value, band, self.quantity.value)


def groups_with_targets(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the groups that have targets."""
    numbers = sorted({target.group for target in scenario.targets})
    return tuple(scenario.group_names[number] for number in numbers)
