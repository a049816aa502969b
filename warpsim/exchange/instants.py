"""Instants of files: dates of several time systems as whole TAI days and seconds, exact to 2e-11 s.

Leap seconds are erfa's, as far as they are announced. TDB differs from TT by the series of `erfa.dtdb` (1.7 ms).
"""

from __future__ import annotations

import datetime
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.constants import DAY_S
from warpsim.errors import InputError

if TYPE_CHECKING:
    from astropy.time import Time

    from warpsim.instant import Epoch

F64 = NDArray[np.float64]

TIME_SYSTEMS = ("UTC", "TAI", "TT", "TDB", "GPS")
"""Time systems of dates that are read and written."""

FIRST_YEAR, LAST_YEAR = 1960, 2100
"""Dates of the years 1960 to 2099 are read, as those of scenes are."""

_TT_MINUS_TAI_S = 32.184
_TAI_MINUS_GPS_S = 19.0
_MJD_ZERO = datetime.date(1858, 11, 17).toordinal()
_JD_OF_MJD_ZERO = 2_400_000.5
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")

_CLOCK = r"(\d{1,2}):(\d{2}):(\d{1,2}(?:\.\d*)?)"
_CALENDAR = re.compile(rf"(\d{{4}})-(\d{{2}})-(\d{{2}})[T ]{_CLOCK}Z?", re.ASCII)
_DAY_OF_YEAR = re.compile(rf"(\d{{4}})-(\d{{3}})[T ]{_CLOCK}Z?", re.ASCII)
_GREGORIAN = re.compile(rf"(\d{{1,2}}) +([A-Za-z]{{3}})[a-z]* +(\d{{4}}) +{_CLOCK}", re.ASCII)


@dataclass(frozen=True, eq=False)
class FileInstants:
    """Instants as whole TAI days and TAI seconds of the day, each (n,); or seconds since a scene's epoch."""

    day: F64
    """Whole modified Julian days, TAI; 0 where relative."""

    second: F64
    """Seconds of that day, 0 to 86400; where relative, seconds since the scene's epoch."""

    relative: bool = False
    """Whether they count from the epoch of the scene that uses them."""

    def __len__(self) -> int:
        return len(self.day)

    def __getitem__(self, rows: Any) -> FileInstants:
        return FileInstants(np.atleast_1d(self.day[rows]), np.atleast_1d(self.second[rows]), self.relative)

    def steps_s(self) -> F64:
        """Time from each instant to the next [s], (n - 1,)."""
        return np.diff(self.day) * DAY_S + np.diff(self.second)

    def since(self, epoch: Epoch) -> F64:
        """SI seconds since an epoch, (n,)."""
        if self.relative:
            return self.second.copy()
        return self.since_instant(instants_of_time(epoch))

    def since_instant(self, first: FileInstants) -> F64:
        """SI seconds since one other instant, (n,)."""
        if self.relative != first.relative:
            raise InputError("must count from the same origin, got seconds since the scene's epoch and dates", "times")
        time_s: F64 = (self.day - first.day[0]) * DAY_S + (self.second - first.second[0])
        return time_s

    def dates(self, system: str, precision: int = 9) -> list[str]:
        """ISO 8601 dates in a time system, with that many digits of the second.

        Raises:
            InputError: The instants are relative to a scene's epoch, or the time system is none of TIME_SYSTEMS.
        """
        if self.relative:
            raise InputError("must be instants to be written as dates, got seconds since the scene's epoch", "times")
        check_time_system(system)
        shift_s = {"GPS": -_TAI_MINUS_GPS_S}.get(system, 0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # years far ahead, whose leap seconds nobody knows
            time: Any = to_time(FileInstants(self.day, self.second + shift_s), precision)
            scale = {"GPS": "tai"}.get(system, system.lower())
            return [str(text) for text in getattr(time, scale).isot]


def check_time_system(name: str) -> str:
    """The time system, in capitals; UT1 and others are refused, as they need tables from the network."""
    if name.upper() not in TIME_SYSTEMS:
        raise InputError(f"must be one of {', '.join(TIME_SYSTEMS)}", value=name)
    return name.upper()


def instants_of_time(time: Epoch) -> FileInstants:
    """Instants of an astropy Time, or of an Instant."""
    tai: Any = time.tai
    jd1, jd2 = np.atleast_1d(tai.jd1), np.atleast_1d(tai.jd2)
    day = np.floor(jd1 - _JD_OF_MJD_ZERO)
    return _carried(day, ((jd1 - _JD_OF_MJD_ZERO - day) + jd2) * DAY_S)


def to_time(instants: FileInstants, precision: int = 9) -> Time:
    """Instants as an astropy Time of scale TAI."""
    from astropy.time import Time

    return Time(instants.day, instants.second / DAY_S, format="mjd", scale="tai", precision=precision)


def later(first: FileInstants, seconds: F64) -> FileInstants:
    """Instants that many SI seconds after one instant."""
    return _carried(np.full_like(seconds, first.day[0]), first.second[0] + seconds)


def parse_dates(texts: Sequence[str], system: str) -> FileInstants:
    """Instants of calendar (2025-03-20T12:00:00.5) or day-of-year (2025-079T12:00:00.5) dates.

    Args:
        texts: The dates; a closing Z is allowed.
        system: One of TIME_SYSTEMS.

    Raises:
        InputError: A text is no such date; its row says which.
    """
    import erfa

    fields = np.empty((len(texts), 2))
    for row, text in enumerate(texts):
        fields[row] = _mjd_and_second(text, row)
    day, second = fields.T
    _check_leap_seconds(texts, day, second, system)
    if system == "UTC":
        second = second + _tai_minus_utc_s(day, second)
    elif system == "GPS":
        second = second + _TAI_MINUS_GPS_S
    elif system == "TT":
        second = second - _TT_MINUS_TAI_S
    elif system == "TDB":
        tdb_minus_tt_s: Any = erfa.dtdb(day + _JD_OF_MJD_ZERO, second / DAY_S, 0.0, 0.0, 0.0, 0.0)
        second = second - tdb_minus_tt_s - _TT_MINUS_TAI_S
    return _carried(day, second)


def _mjd_and_second(text: str, row: int) -> tuple[int, float]:
    """Modified Julian day and second of a date; the row is for messages."""
    match = _CALENDAR.fullmatch(text)
    if match:
        year, month, day = int(match[1]), int(match[2]), int(match[3])
        clock = match.groups()[3:]
    elif match := _DAY_OF_YEAR.fullmatch(text):
        year, month, day = int(match[1]), 1, int(match[2])
        clock = match.groups()[2:]
    elif match := _GREGORIAN.fullmatch(text):
        name = match[2].lower()
        if name not in _MONTHS:
            raise InputError("must have a month like Jan", value=text, row=row)
        year, month, day = int(match[3]), _MONTHS.index(name) + 1, int(match[1])
        clock = match.groups()[3:]
    else:
        rule = "must be a date like 2025-03-20T12:00:00.0 or 2025-079T12:00:00.0"
        raise InputError(rule, value=text[:40], row=row)
    if not FIRST_YEAR <= year < LAST_YEAR:
        raise InputError(f"must be in the years {FIRST_YEAR} to {LAST_YEAR - 1}", value=text, row=row)
    hour, minute, second = int(clock[0]), int(clock[1]), float(clock[2])
    try:
        first = datetime.date(year, month, 1 if match.re is _DAY_OF_YEAR else day)
    except ValueError:
        raise InputError("must be a day of the calendar", value=text, row=row) from None
    ordinal = first.toordinal() + (day - 1 if match.re is _DAY_OF_YEAR else 0)
    if match.re is _DAY_OF_YEAR and not (day >= 1 and datetime.date.fromordinal(ordinal).year == year):
        raise InputError("must be a day of the calendar", value=text, row=row)
    leap = hour == 23 and minute == 59  # whether such a second was, _check_leap_seconds says
    if hour > 23 or minute > 59 or not second < (61.0 if leap else 60.0):
        raise InputError("must be a time of the day", value=text, row=row)
    return ordinal - _MJD_ZERO, 3600.0 * hour + 60.0 * minute + second


def _check_leap_seconds(texts: Sequence[str], day: F64, second: F64, system: str) -> None:
    """Raise for a second 60 on a day that has none."""
    for row in np.flatnonzero(second >= DAY_S).tolist():
        ends = day[row : row + 1]
        zero = np.zeros(1)
        if system != "UTC" or _tai_minus_utc_s(ends + 1, zero)[0] - _tai_minus_utc_s(ends, zero)[0] < 0.5:
            raise InputError("must be a time of the day (no leap second then)", value=texts[row], row=row)


def _tai_minus_utc_s(day: F64, second: F64) -> F64:
    """TAI - UTC [s] of UTC days; before 1972 it drifts within them."""
    import erfa

    days, inverse = np.unique(day, return_inverse=True)
    calendar = [datetime.date.fromordinal(int(d) + _MJD_ZERO) for d in days]
    year, month, date = (np.array([getattr(c, part) for c in calendar], dtype=np.intc) for part in _DATE_PARTS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "dubious year": leap seconds not yet announced
        fraction = np.minimum(second / DAY_S, 1.0)
        offset_s: F64 = erfa.dat(year[inverse], month[inverse], date[inverse], fraction)
    return offset_s


_DATE_PARTS = ("year", "month", "day")


def _carried(day: F64, second: F64) -> FileInstants:
    """With whole days carried out of the seconds."""
    carry = np.floor(second / DAY_S)
    return FileInstants(day + carry, second - carry * DAY_S)
