"""Instants of UTC in the time scales that motion needs, by ERFA alone: importing astropy.time takes half a second.

Numbers are those of an astropy Time, to the last bit (`tests/test_instant.py`), and so are the names. Scene time is SI
seconds since an epoch: these advance TAI and TT alike, so `TT = epoch.tt + time_s`, also across a leap second. Nothing
here needs UT1 or any table from the network. Behind the last announced leap second none are counted: ERFA calls years
some way ahead "dubious" for that, which warpsim says in its documentation and not at every call.
"""

from __future__ import annotations

import functools
import math
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.arrays import F64
from warpsim.constants import DAY_S
from warpsim.errors import InputError

if TYPE_CHECKING:
    from astropy.time import Time


FIRST_YEAR, LAST_YEAR = 1960, 2100
"""UTC begins with 1960; the ephemeris of Earth and Sun ends with 2100."""

_PLAIN = re.compile(r"([0-9]{4})-([0-9]{2})-([0-9]{2})(?:[T ]([0-9]{2}):([0-9]{2})(?::([0-9]{2}))?)?")


class JulianDate(NamedTuple):
    """A Julian date of one time scale."""

    jd1: float
    """The nearest whole number of days."""
    jd2: float
    """The rest, -0.5 to 0.5."""

    @property
    def jd(self) -> float:
        """Their sum, good to 40 microseconds."""
        return self.jd1 + self.jd2


@dataclass(frozen=True)
class Instant:
    """An instant of UTC."""

    isot: str
    """ISO 8601, to milliseconds."""
    utc: JulianDate
    tai: JulianDate
    tt: JulianDate


def instant_after(start: Instant, time_s: float) -> Instant:
    """The instant some SI seconds after another one, good to 1e-10 s; itself after none."""
    import erfa

    if time_s == 0.0:
        return start
    tai = _julian_date(start.tai.jd1, start.tai.jd2 + time_s / DAY_S)
    with years_ahead():
        utc = _julian_date(*erfa.taiutc(*tai))
        year, month, day, (hour, minute, second, fraction) = erfa.d2dtf("UTC", 3, *utc)
    isot = f"{int(year):04}-{int(month):02}-{int(day):02}T{hour:02}:{minute:02}:{second:02}.{fraction:03}"
    return Instant(isot, utc, tai, _julian_date(*erfa.taitt(*tai)))


Epoch: TypeAlias = "Time | Instant"
"""Origin of scene times: both have `utc`, `tai` and `tt` with `jd1` and `jd2`."""


@contextmanager
def years_ahead() -> Iterator[None]:
    """Dates within may lie in years whose leap seconds nobody knows: ERFA does not warn of them."""
    import erfa

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*dubious year", category=erfa.ErfaWarning)
        yield


def plain_instant(text: str) -> Instant | None:
    """The instant of a date like 2025-03-20, 2025-03-20T12:00 or 2025-03-20 12:00:00; None where it is no such date."""
    import erfa

    parts = _PLAIN.fullmatch(text)
    if parts is None:
        return None
    year, month, day, hour, minute, second = (int(part or 0) for part in parts.groups())
    if hour > 23 or minute > 59 or second > 59:  # 24 hours, and leap seconds, are left to astropy
        return None
    _take_leap_seconds()
    try:
        with years_ahead():
            utc = _julian_date(*erfa.dtf2d("UTC", year, month, day, hour, minute, float(second)))
            tai = erfa.utctai(*utc)
    except erfa.ErfaError:
        return None
    isot = f"{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.000"
    return Instant(isot, utc, _julian_date(*tai), _julian_date(*erfa.taitt(*tai)))


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


def tt_jd(epoch: Epoch, time_s: ArrayLike) -> tuple[float, F64]:
    """Return Terrestrial Time as a two-part Julian date (whole part, fraction of the shape of time_s) [d].

    The fraction stays below the scene's length, so its rounding is about 1e-11 s per day of scene time.
    """
    tt = epoch.tt
    return float(tt.jd1), float(tt.jd2) + np.asarray(time_s, np.float64) / DAY_S


def tdb_jd(epoch: Epoch, time_s: ArrayLike) -> tuple[float, F64]:
    """Return Barycentric Dynamical Time at the geocentre as a two-part Julian date [d].

    TDB - TT is the Fairhead and Bretagnon series (`erfa.dtdb`), up to 1.7 ms: 50 m of the Earth's motion. Its
    observer terms (2 microseconds) vanish at the geocentre, so no UT1 is needed.
    """
    import erfa

    whole, fraction = tt_jd(epoch, time_s)
    tdb_minus_tt_s: Any = erfa.dtdb(whole, fraction, 0.0, 0.0, 0.0, 0.0)
    return whole, fraction + tdb_minus_tt_s / DAY_S


def instant_of(time: Time) -> Instant:
    """The instant of an astropy Time."""
    scales = (JulianDate(float(scale.jd1), float(scale.jd2)) for scale in (time.utc, time.tai, time.tt))
    return Instant(str(time.utc.isot), *scales)


def _julian_date(part: float, other: float) -> JulianDate:
    """The sum of two parts, exactly, as astropy splits it."""
    whole = float(round(part + other))
    return JulianDate(whole, math.fsum((part, other, -whole)))


@functools.cache
def _take_leap_seconds() -> None:
    """Give ERFA those leap seconds of the IERS's list that it lacks, as astropy does; the list comes with astropy."""
    import erfa
    from astropy_iers_data import IERS_LEAP_SECOND_FILE

    # Columns: modified Julian date, day, month, year, TAI - UTC.
    rows = np.loadtxt(IERS_LEAP_SECOND_FILE, usecols=(3, 2, 4), dtype=erfa.dt_eraLEAPSECOND)
    if rows[-1] != erfa.leap_seconds.get()[-1]:
        erfa.leap_seconds.update(rows)


def utc_dates(epoch_utc: str, time_s: ArrayLike) -> NDArray[Any]:
    """Return ISO 8601 dates, UTC to the microsecond, of times after an epoch [s]."""
    with years_ahead():
        times = _utc(epoch_utc, time_s)
        times.precision = 6
        return np.asarray(times.isot)


def utc_mjd(epoch_utc: str, time_s: ArrayLike) -> NDArray[np.float64]:
    """Return modified Julian dates of UTC, good to a microsecond, of times after an epoch [s]."""
    with years_ahead():
        return np.asarray(_utc(epoch_utc, time_s).mjd)


def _utc(epoch_utc: str, time_s: ArrayLike) -> Time:
    from astropy.time import TimeDelta

    # TAI seconds: UTC days may hold a leap second.
    return (utc_time(epoch_utc).tai + TimeDelta(np.asarray(time_s, dtype=np.float64), format="sec")).utc
