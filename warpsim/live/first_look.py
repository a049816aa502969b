"""What a page shows at first: which frame, and from where."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from warpsim.directions import normalised
from warpsim.scene.scenario import Scenario

CAMERA_OF_GROUP = (-7.0, -10.0, 5.0)
"""Behind and above it."""


def first_frame(scenario: Scenario, sensors: Sequence[str], frames: Sequence[int]) -> int:
    """Return the middle of the first sensor's access, so that there is something to see."""
    if not sensors:
        return frames[0]
    instrument = scenario.instrument_of(sensors[0])
    seen = instrument.has_access(instrument.index(sensors[0]), instrument.frame_time_s(frames))
    with_access = np.flatnonzero(seen)
    return frames[int(with_access[len(with_access) // 2])] if len(with_access) else frames[0]


def camera_of_earth(scenario: Scenario) -> tuple[float, float, float]:
    """Return where the page's camera stands at first: above the first target, or satellite."""
    middle = np.array([0.5 * scenario.scene.duration_s])
    body = (scenario.target_names or scenario.satellite_names)[0]
    x, y, z = 26.0 * normalised(scenario.position_m(body, middle)[0])
    return float(x), float(y), float(z)
