"""Fields of the page that change the scene: field of view, point spread, noise, exposure, pointing, seed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene

PSF, SIGMA = "optics__psf", "optics__sigma_px"

MOST_NAMES = 1000
"""Targets that a page lets one choose of."""

_NUMBERS = (
    ("field of view [deg]", "camera__fov_deg"),
    ("focal length [m]", "camera__focal_length_m"),
    ("aperture [m]", "optics__aperture_m"),
    ("smear [urad]", "optics__smear_urad"),
    ("NEI{} [W/cm2]", "detector__nei_w_cm2"),
    ("read noise [e]", "detector__read_noise_e"),
    ("dark current [e/s]", "detector__dark_e_s"),
    ("exposure [s]", "detector__exposure_s"),
)

PAUSE_S = 0.7
"""A text counts as written when no letter was changed for so long."""

_NOTE = (
    '<div style="padding:0 10px;font:11px sans-serif;color:#888">A number counts a moment after it is typed. '
    "Without a sigma a Gaussian's is 0.42 lambda F.</div>"
)


class Change(NamedTuple):
    """A field of the scene."""

    label: str
    path: str
    """As `Scene.replace` takes it."""
    value: Any
    """None where it is left out."""
    options: tuple[str, ...] = ()
    """Of a field that is a name."""


def changes(scenario: Scenario, kind: str) -> list[Change]:
    """Return what can be changed of a scene and of one of its kinds of sensors.

    A detector in electrons has its noise in the place of an NEI; a Gaussian's sigma has the value None where it follows
    from the aperture.
    """
    number = list(scenario.instruments).index(kind)
    start, data = f"sensors__{number}__", scenario.scene.to_dict()["sensors"][number]
    found = []
    for label, path in _NUMBERS:
        part, name = path.split("__")
        value = data[part].get(name)
        of_band = value if isinstance(value, dict) else {"": value}
        for band, one in of_band.items():
            if isinstance(one, int | float):
                own = f"{path}__{band}" if band else path
                found.append(Change(label.format(f" {band}" if band else ""), start + own, float(one)))
        if path == "optics__aperture_m" and data["optics"]["psf"] != "table":
            found.append(Change("PSF", start + PSF, data["optics"]["psf"], ("airy", "gaussian")))
            found.append(Change("sigma [px]", start + SIGMA, data["optics"].get("sigma_px")))
    found += _pointings(scenario, data.get("pointing", []), start)
    return [*found, Change("seed", "seed", scenario.scene.seed)]


def _pointings(scenario: Scenario, pointings: list[dict[str, Any]], start: str) -> Iterator[Change]:
    """What cameras track, for all satellites of a pointing, and from each step of a schedule on."""
    for number, pointing in enumerate(pointings):
        on = f" ({', '.join(pointing['on'])})" if len(pointings) > 1 else ""
        steps = [(pointing, "", "")]
        for k, step in enumerate(pointing.get("steps", [])):
            steps.append((step, f"steps__{k}__", f" from {step['start_s']:g} s"))
        for step, path, when in steps:
            if isinstance(step.get("track"), str):
                names = (step["track"], "main", "group", *scenario.group_names, *scenario.target_names[:MOST_NAMES])
                label = f"pointed at{when}{on}"
                yield Change(
                    label, f"{start}pointing__{number}__{path}track", step["track"], tuple(dict.fromkeys(names))
                )


def changed_scene(scenario: Scenario, changes: list[Change], values: Callable[[Change], Any]) -> Scene:
    """Return the scene with those values that differ from it; a Gaussian's sigma goes with the Gaussian.

    Raises:
        InputError: A value is out of its range.
    """
    different = {change.path: value for change in changes if (value := values(change)) != change.value}
    for path, value in list(different.items()):
        if path.endswith(PSF) and value != "gaussian":
            different[path.removesuffix(PSF) + SIGMA] = None
    return Scene.from_dict(scenario.scene.to_dict()).replace(**different)


class SceneControls:
    """Fields that change the scene, of one kind of sensors at a time.

    Args:
        gui: The server's `gui`.
        scenario: What is shown.
        kind: Of the sensors whose numbers are shown at first.
        when_changed: Called, in a thread of its own, when a value was changed.
    """

    def __init__(self, gui: Any, scenario: Scenario, kind: str, when_changed: Callable[[], None]) -> None:
        self.changes = changes(scenario, kind)
        """Fields, with the values that are in force."""
        self._gui, self._scenario, self._when_changed = gui, scenario, when_changed
        self._timer: threading.Timer | None = None
        self._telling, self._closed = threading.Lock(), False
        self.fields: dict[str, Any] = {}
        """What stands on the page, by path."""
        self._kind = kind
        self._folder = gui.add_folder("Scene", expand_by_default=False)
        with self._folder:
            gui.add_html(_NOTE)
            self.kind = gui.add_dropdown("sensors", tuple(scenario.instruments), initial_value=kind)
            self.kind.visible = len(scenario.instruments) > 1
            self.kind.on_update(lambda _: self._show_kind())
        self._add_fields()

    def _add_fields(self) -> None:
        with self._folder:
            for change in self.changes:
                self.fields[change.path] = self._field(change)
        self._enable()

    def _field(self, change: Change) -> Any:
        if change.options:
            field = self._gui.add_dropdown(change.label, change.options, initial_value=change.value)
            field.on_update(lambda _: self._changed(0.0))
            return field
        if isinstance(change.value, int):
            field = self._gui.add_number(change.label, change.value, step=1)
        else:
            field = self._gui.add_text(change.label, _text(change.value))  # as 1e-18 is no number of the page's
        field.on_update(lambda _: self._changed(PAUSE_S))
        return field

    def _enable(self) -> None:
        """Let nobody write the sigma of what is no Gaussian."""
        for path, field in self.fields.items():
            if path.endswith(SIGMA):
                field.disabled = self.fields[path.removesuffix(SIGMA) + PSF].value != "gaussian"

    def _show_kind(self) -> None:
        """Show the fields of another kind of sensors, once changes of the one before are in force."""
        with self._telling:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
                self._when_changed()
            fields, self.fields = self.fields, {}
            for field in fields.values():
                field.remove()
            self._kind = self.kind.value
            self.changes = changes(self._scenario, self._kind)
            self._add_fields()

    def _changed(self, pause_s: float) -> None:
        """Tell that a value was changed, unless another is within the pause: letters come one by one."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = threading.Timer(pause_s, self._tell)
        self._timer.daemon = True
        self._timer.start()

    def _tell(self) -> None:
        with self._telling:
            if self._timer is threading.current_thread():
                self._timer = None
            if not self._closed:
                self._when_changed()

    def accept(self, scenario: Scenario) -> None:
        """Take a scene, which has the values of the fields, for the one in force."""
        self._scenario, self.changes = scenario, changes(scenario, self._kind)
        for change in self.changes:
            if change.path.endswith(SIGMA) and self.value(change) != change.value:
                self.fields[change.path].value = _text(change.value)
        self._enable()

    def value(self, change: Change) -> Any:
        """What stands in a field; a text that is no number stays a text, which the scene refuses."""
        value = self.fields[change.path].value
        if change.options or isinstance(change.value, int):
            return value
        if change.path.endswith(SIGMA) and not value.strip():
            return None
        try:
            return float(value)
        except ValueError:
            return value

    def close(self) -> None:
        """Forget changes that are not under way yet; return when none is."""
        with self._telling:
            self._closed = True


def _text(value: float | None) -> str:
    return "" if value is None else repr(value)
