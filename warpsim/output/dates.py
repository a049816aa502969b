"""Dates of frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.instant import utc_time, years_ahead

if TYPE_CHECKING:
    from astropy.time import Time


def utc_dates(epoch_utc: str, time_s: npt.ArrayLike) -> npt.NDArray[Any]:
    """Return ISO 8601 dates, UTC to the microsecond, of times after an epoch [s]."""
    with years_ahead():
        times = _utc(epoch_utc, time_s)
        times.precision = 6
        return np.asarray(times.isot)


def utc_mjd(epoch_utc: str, time_s: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return modified Julian dates of UTC, good to a microsecond, of times after an epoch [s]."""
    with years_ahead():
        return np.asarray(_utc(epoch_utc, time_s).mjd)


def _utc(epoch_utc: str, time_s: npt.ArrayLike) -> Time:
    from astropy.time import TimeDelta

    # TAI seconds: UTC days may hold a leap second.
    return (utc_time(epoch_utc).tai + TimeDelta(np.asarray(time_s, dtype=np.float64), format="sec")).utc
