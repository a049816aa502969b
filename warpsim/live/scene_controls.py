"""Fields of the page that change the scene."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from warpsim.live.changes import PSF, SIGMA, Change, changes
from warpsim.scene.scenario import Scenario

PAUSE_S = 0.7
"""A text counts as written when no letter was changed for so long."""

_NOTE = (
    '<div style="padding:0 10px;font:11px sans-serif;color:#888">A number counts a moment after it is typed. '
    "Without a sigma a Gaussian's is 0.42 lambda F.</div>"
)


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
