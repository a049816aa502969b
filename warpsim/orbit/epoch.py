"""Epochs and time scales: scene time is SI seconds since an epoch given as a UTC instant.

SI seconds advance TAI and TT alike, so `TT = epoch.tt + time_s`, also across a leap second. Nothing here needs UT1 or
any table from the network. Behind the last announced leap second none are counted: ERFA calls years some way ahead
"dubious" for that, which warpsim says in its documentation and not at every call.
"""

from __future__ import annotations

import functools
import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.constants import DAY_S
from warpsim.errors import InputError
from warpsim.instant import Instant, instant_of, plain_instant, years_ahead

if TYPE_CHECKING:
    from astropy.time import Time

    from warpsim.instant import Epoch


FIRST_YEAR, LAST_YEAR = 1960, 2100
"""UTC begins with 1960; the ephemeris of Earth and Sun ends with 2100."""


@functools.lru_cache(maxsize=64)
def instant(text: str) -> Instant:
    """Parse as utc_time does, for arithmetic: plain dates without astropy, whose import is slow.

    Raises:
        InputError: As utc_time.
    """
    plain = plain_instant(text.strip().removesuffix("Z"))
    known = plain is not None and FIRST_YEAR <= int(plain.isot[:4]) < LAST_YEAR
    return plain if plain is not None and known else instant_of(utc_time(text))


def utc_time(text: str) -> Time:
    """Parse an ISO 8601 UTC instant (`2025-03-20T12:00:00`, a trailing `Z` is allowed).

    Raises:
        InputError: When text is not such an instant, or lies outside the years 1960 to 2099.
    """
    from astropy.time import Time

    rule = "must be an ISO 8601 UTC instant like 2025-03-20T12:00:00"
    year = re.match(r"\s*(\d{4})-", str(text))
    if year and not FIRST_YEAR <= int(year[1]) < LAST_YEAR:
        raise InputError(f"must be in the years {FIRST_YEAR} to {LAST_YEAR - 1}", "epoch_utc", text)
    try:
        with years_ahead():
            epoch = Time(str(text).strip().removesuffix("Z"), scale="utc")
            _ = epoch.tai, epoch.tt, epoch.isot  # kept by astropy, so that nobody is warned of the year later
        good = year is not None and epoch.isscalar and math.isfinite(epoch.jd1 + epoch.jd2)
    except Exception:
        good = False
    if not good:
        raise InputError(rule, "epoch_utc", text)
    return epoch


def tt_jd(epoch: Epoch, time_s: ArrayLike) -> tuple[float, NDArray[np.float64]]:
    """Return Terrestrial Time as a two-part Julian date (whole part, fraction of the shape of time_s) [d].

    The fraction stays below the scene's length, so its rounding is about 1e-11 s per day of scene time.
    """
    tt = epoch.tt
    return float(tt.jd1), float(tt.jd2) + np.asarray(time_s, np.float64) / DAY_S


def tdb_jd(epoch: Epoch, time_s: ArrayLike) -> tuple[float, NDArray[np.float64]]:
    """Return Barycentric Dynamical Time at the geocentre as a two-part Julian date [d].

    TDB - TT is the Fairhead and Bretagnon series (`erfa.dtdb`), up to 1.7 ms: 50 m of the Earth's motion. Its
    observer terms (2 microseconds) vanish at the geocentre, so no UT1 is needed.
    """
    import erfa

    whole, fraction = tt_jd(epoch, time_s)
    tdb_minus_tt_s: Any = erfa.dtdb(whole, fraction, 0.0, 0.0, 0.0, 0.0)
    return whole, fraction + tdb_minus_tt_s / DAY_S
