"""Curves of targets over time, as a part of a page."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.render.light_curves import light_curves
from warpsim.scene.scenario import Scenario

F64 = NDArray[np.float64]

N_TIME = 400
"""Times of a curve over the whole scene."""

QUANTITIES = ("SNR", "irradiance [W/cm2]", "range [km]", "aspect [deg]", "temperature [K]", "projected area [m2]")

_NO_ACCESS = "no access"
_COLOURS = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442")
_DOT = 2.5  # dots, as lines would join what is on both sides of a gap


class Curves:
    """A chart of one quantity of a target as a sensor sees it, with a mark at the instant that the page shows.

    Args:
        gui: The server's `gui`.
        scenario: What is shown.
    """

    def __init__(self, gui: Any, scenario: Scenario) -> None:
        self._gui, self.folder = gui, gui.add_folder("Curves")
        self._plot: Any = None
        self._time_s = np.linspace(0.0, scenario.scene.duration_s, N_TIME)
        self._lines: dict[str, F64] = {}

    def choose(self, scenario: Scenario, sensor: str, target: str, band: str, quantity: str) -> None:
        """Draw another curve."""
        curves = light_curves(scenario, self._time_s, [sensor], [target], [band])
        lit = np.where(curves.irradiance_w_cm2[:, 0, 0, 0] > 0, 1.0, np.nan)
        instrument = scenario.instrument_of(sensor)
        access = instrument.has_access(instrument.index(sensor), self._time_s)
        if quantity == QUANTITIES[1]:
            self._lines = {name: lit * values[:, 0, 0, 0] for name, values in curves.terms_w_cm2.items()}
        else:
            values = {
                QUANTITIES[0]: lit * curves.snr[:, 0, 0, 0],
                QUANTITIES[2]: curves.range_km[:, 0, 0],
                QUANTITIES[3]: curves.aspect_deg[:, 0, 0],
                QUANTITIES[4]: curves.temperature_k[:, 0, 0],
                QUANTITIES[5]: curves.projected_area_m2[:, 0, 0],
            }
            self._lines = {quantity: values[quantity]}
        total = next(iter(self._lines.values())) if len(self._lines) == 1 else sum(self._lines.values())
        self._lines = {name: np.where(access, values, np.nan) for name, values in self._lines.items()}
        self._lines[_NO_ACCESS] = np.where(access, np.nan, total)
        if self._plot is not None:
            self._plot.remove()
        series = [{"label": "t [s]"}, *(_dots(name, colour, _DOT) for name, colour in self._coloured())]
        mark = _dots("now", "#ff6b4a", 9)
        axis = {"stroke": "#aaa", "grid": {"stroke": "#333"}}
        scales = {"x": {"time": False, "range": (0.0, self._time_s[-1])}, "y": {"range": self._range()}}
        with self.folder:
            self._plot = self._gui.add_uplot(
                data=self._data(0.0), series=(*series, mark), height=170, scales=scales, axes=(axis, axis),
                title=f"{target} from {sensor}, band {band}: {quantity}",
            )  # fmt: skip

    def _range(self) -> tuple[float, float]:
        """Of the vertical axis: all values, and some room."""
        values = np.concatenate(list(self._lines.values()))
        values = values[np.isfinite(values)]
        low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
        room = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
        return low - room, high + room

    def _coloured(self) -> list[tuple[str, str]]:
        colours = [*_COLOURS[: len(self._lines) - 1], "#777"]
        return list(zip(self._lines, colours, strict=True))

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
