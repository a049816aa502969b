"""Curves of the light of targets as custom properties of CZML: irradiance by sensor and band."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.output.czml_parts import MOST_SAMPLES, Dates, body_span_s
from warpsim.output.czml_views import within
from warpsim.render.light_curves import light_curves
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario

F64 = NDArray[np.float64]

MOST_FRAMES = 1000
"""Frames of a sensor during access that curves have; of more, every second, third, ..."""

_DIGITS = 6


def light_properties(scenario: Scenario, dates: Dates, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return properties "irradiance_w_cm2/SENSOR/BAND" of targets by name: samples at the sensor's frames [W/cm2].

    They are there while the sensor has access and the target exists, an interval for each access, linear within it.

    Raises:
        InputError: They would be more than MOST_SAMPLES samples.
    """
    found: dict[str, dict[str, Any]] = {name: {} for name in names}
    views = list(_views(scenario))
    n_sample = sum(len(time_s) * len(instrument.bands) for instrument, _, time_s in views) * len(names)
    if n_sample > MOST_SAMPLES:
        raise InputError(f"take {n_sample} samples, more than {MOST_SAMPLES}: choose fewer targets", "curves")
    for instrument, index, time_s in views:
        sensor = instrument.names[index]
        curves = light_curves(scenario, time_s, [sensor], list(names))
        for number, name in enumerate(names):
            for band, own in zip(curves.bands, curves.irradiance_w_cm2[:, 0, :, number].T, strict=True):
                pieces = _pieces(scenario, instrument, index, name, time_s, own, dates)
                if pieces:
                    found[name][f"irradiance_w_cm2/{sensor}/{band}"] = pieces[0] if len(pieces) == 1 else pieces
    return found


def _views(scenario: Scenario) -> Iterator[tuple[Instrument, int, F64]]:
    """Sensors with a frame during access, as kind and index, with the times of these frames, MOST_FRAMES at most."""
    for instrument in scenario.instruments.values():
        all_s = instrument.frame_time_s(np.arange(instrument.frames.count))
        for index in range(len(instrument.names)):
            seen_s = all_s[instrument.has_access(index, all_s)]
            if len(seen_s):
                yield instrument, index, seen_s[:: -(-len(seen_s) // MOST_FRAMES)]


def _pieces(
    scenario: Scenario, instrument: Instrument, index: int, name: str, time_s: F64, light_w_cm2: F64, dates: Dates
) -> list[dict[str, Any]]:
    """A curve as sampled numbers, in an interval for each access with a frame."""
    (epoch,) = dates([0.0])
    pieces = []
    for span_s in within(instrument.access, index, body_span_s(scenario, name)):
        chosen = (time_s >= span_s[0]) & (time_s <= span_s[1])
        if chosen.any():
            rows = [(time, float(f"{light:.{_DIGITS}g}")) for time, light in zip(time_s[chosen].tolist(),
                    light_w_cm2[chosen].tolist(), strict=True)]  # fmt: skip
            numbers = [value for row in rows for value in row]
            start, end = dates(span_s)
            pieces.append({"interval": f"{start}/{end}", "epoch": epoch, "number": numbers})
    return pieces
