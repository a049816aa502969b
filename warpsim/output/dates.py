"""Dates of frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.instant import years_ahead

if TYPE_CHECKING:
    from warpsim.scene.scene import Scene


def utc_dates(scene: Scene, time_s: npt.ArrayLike) -> npt.NDArray[Any]:
    """ISO 8601 dates, UTC to the microsecond, of times after a scene's epoch [s]."""
    from astropy.time import TimeDelta

    # TAI seconds: UTC days may hold a leap second.
    with years_ahead():
        times = (scene.epoch.tai + TimeDelta(np.asarray(time_s, dtype=np.float64), format="sec")).utc
        times.precision = 6
        return np.asarray(times.isot)
