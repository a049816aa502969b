"""Instants of files: dates of several time systems as whole TAI days and seconds, exact to 2e-11 s.

Leap seconds are erfa's, as far as they are announced. TDB differs from TT by the series of `erfa.dtdb` (1.7 ms).
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.arrays import F64
from warpsim.constants import DAY_S
from warpsim.errors import InputError
from warpsim.instant import FIRST_YEAR, LAST_YEAR, years_ahead

if TYPE_CHECKING:
    from warpsim.instant import Epoch


TIME_SYSTEMS = ("UTC", "TAI", "TT", "TDB", "GPS")
"""Time systems of dates that are read and written; UT1 is not, as it needs tables from the network."""

TT_MINUS_TAI_S = 32.184
_TAI_AHEAD_S = {"GPS": 19.0, "TT": -TT_MINUS_TAI_S, "TDB": -TT_MINUS_TAI_S}  # of TDB, in the mean
_MJD_ZERO = datetime.date(1858, 11, 17).toordinal()
_JD_OF_MJD_ZERO = 2_400_000.5
MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_DATE = re.compile(
    r"(?:(?P<iso_year>\d{4})-(?:(?P<month>\d\d)-(?P<day>\d\d)|(?P<day_of_year>\d{3}))[T ]"
    r"|(?P<stk_day>\d{1,2}) +(?P<name>[A-Za-z]{3})[a-z]* +(?P<stk_year>\d{4}) +)"
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d):(?P<second>\d{1,2}(?:\.\d*)?)Z?",
    re.ASCII,
)


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
        return self.second.copy() if self.relative else self.since_instant(instants_of_time(epoch))

    def since_instant(self, first: FileInstants) -> F64:
        """SI seconds since one other instant, (n,)."""
        if self.relative != first.relative:
            raise InputError("must count from the same origin, got seconds since the scene's epoch and dates", "times")
        return np.asarray((self.day - first.day[0]) * DAY_S + (self.second - first.second[0]), np.float64)

    def dates(self, system: str, precision: int = 9) -> list[str]:
        """ISO 8601 dates in a time system, with that many digits of the second.

        Raises:
            InputError: The instants are relative to a scene's epoch, or the time system is none of TIME_SYSTEMS.
        """
        from astropy.time import Time

        if self.relative:
            raise InputError("must be instants to be written as dates, got seconds since the scene's epoch", "times")
        gps = check_time_system(system) == "GPS"
        second = self.second - _TAI_AHEAD_S["GPS"] if gps else self.second
        try:
            with years_ahead():
                time = Time(self.day, second / DAY_S, format="mjd", scale="tai", precision=precision)
                return [str(text) for text in getattr(time, "tai" if gps else system.lower()).isot]
        except ValueError:  # of ERFA
            raise InputError(f"must be dates that {system} has", "times") from None


def check_time_system(name: str) -> str:
    """The time system, in capitals."""
    if name.upper() not in TIME_SYSTEMS:
        raise InputError(f"must be one of {', '.join(TIME_SYSTEMS)}", value=name)
    return name.upper()


def instants_of_time(time: Epoch) -> FileInstants:
    """Instants of an astropy Time, or of an Instant."""
    tai: Any = time.tai
    jd1, jd2 = np.atleast_1d(tai.jd1), np.atleast_1d(tai.jd2)
    day = np.floor(jd1 - _JD_OF_MJD_ZERO)
    return _carried(day, ((jd1 - _JD_OF_MJD_ZERO - day) + jd2) * DAY_S)


def later(first: FileInstants, seconds: F64) -> FileInstants:
    """Instants that many SI seconds after one instant."""
    return _carried(np.full_like(seconds, first.day[0]), first.second[0] + seconds)


def parse_dates(texts: Sequence[str], system: str) -> FileInstants:
    """Instants of calendar (2025-03-20T12:00:00.5, 20 Mar 2025 12:00:00) or day-of-year (2025-079T12:00:00.5) dates.

    A closing Z is allowed. Errors know the row.
    """
    import erfa

    day, second = np.array([mjd_and_second(text, row) for row, text in enumerate(texts)], np.float64).reshape(-1, 2).T
    for row in np.flatnonzero(second >= DAY_S).tolist():
        if system != "UTC" or np.diff(_tai_minus_utc_s(day[row] + np.arange(2), np.zeros(2)))[0] < 0.5:
            raise InputError("must be a time of the day (no leap second then)", value=texts[row], row=row)
    if system == "UTC":
        second = second + _tai_minus_utc_s(day, second)
    elif system == "TDB":
        second = second - erfa.dtdb(day + _JD_OF_MJD_ZERO, second / DAY_S, 0.0, 0.0, 0.0, 0.0)
    return _carried(day, second + _TAI_AHEAD_S.get(system, 0.0))


def mjd_and_second(text: str, row: int | None = None, first_year: int = FIRST_YEAR) -> tuple[int, float]:
    """Modified Julian day and second of a date; whether there was a leap second on its day is not looked at."""
    match = _DATE.fullmatch(text)
    if match is None:
        rule = "must be a date like 2025-03-20T12:00:00.0 or 2025-079T12:00:00.0"
        raise InputError(rule, value=text[:40], row=row)
    year = int(match["iso_year"] or match["stk_year"])
    if not first_year <= year < LAST_YEAR:
        raise InputError(f"must be in the years {first_year} to {LAST_YEAR - 1}", value=text, row=row)
    if match["name"] and match["name"].title() not in MONTHS:
        raise InputError("must have a month like Jan", value=text, row=row)
    try:
        if match["day_of_year"]:
            date = datetime.date(year, 1, 1) + datetime.timedelta(days=int(match["day_of_year"]) - 1)
        elif match["name"]:
            date = datetime.date(year, MONTHS.index(match["name"].title()) + 1, int(match["stk_day"]))
        else:
            date = datetime.date(year, int(match["month"]), int(match["day"]))
    except ValueError:
        date = datetime.date.min
    if date.year != year:  # also day 0, or day 366 of a common year
        raise InputError("must be a day of the calendar", value=text, row=row)
    hour, minute, second = int(match["hour"]), int(match["minute"]), float(match["second"])
    longest_s = 61.0 if (hour, minute) == (23, 59) else 60.0  # a leap second
    if hour > 23 or minute > 59 or not second < longest_s:
        raise InputError("must be a time of the day", value=text, row=row)
    return date.toordinal() - _MJD_ZERO, 3600.0 * hour + 60.0 * minute + second


def _tai_minus_utc_s(day: F64, second: F64) -> F64:
    """TAI - UTC [s] of UTC days; before 1972 it drifts within them."""
    import erfa

    year, month, date, _ = erfa.jd2cal(_JD_OF_MJD_ZERO, day)
    with years_ahead():
        return np.asarray(erfa.dat(year, month, date, np.minimum(second / DAY_S, 1.0)), np.float64)


def _carried(day: F64, second: F64) -> FileInstants:
    """With whole days carried out of the seconds."""
    carry = np.floor(second / DAY_S)
    return FileInstants(day + carry, second - carry * DAY_S)
