"""Rows of a table in time: the span that they hold for."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.errors import InputError

DATE_ROUNDING_S = 1e-6
"""Ends of a table may miss those of the scene by this much: files give dates with some digits only."""
END_SLACK_S = 1.0
"""The end rows hold this much longer: light that is seen at the start of a scene left its target before."""


class TimedRows:
    """Base of tables of attitudes and of temperatures, which add values to the times and name their subject."""

    time_s: F64
    """After the epoch, ascending [s], shape (n,)."""
    source: str = ""
    """File and object that messages name; empty for inline rows."""
    epoch: Any = None
    """What the times count from, where the rows have dates that messages give as well."""
    _of = "rows"

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time after the epoch [s]; a single row holds for all times."""
        if len(self.time_s) == 1:
            return -math.inf, math.inf
        return float(self.time_s[0]), float(self.time_s[-1])

    def check_span(self, start_s: float, end_s: float) -> None:
        """Make sure that the rows cover a span of time after the epoch [s].

        Raises:
            InputError: They do not.
        """
        first_s, last_s = self.span_s
        if first_s > start_s + DATE_ROUNDING_S or last_s < end_s - DATE_ROUNDING_S:
            got = _span(first_s, last_s) + self._dates(first_s, last_s)
            raise self._error(f"must cover the scene, {_span(start_s, end_s)}, got {got}")

    def _times_within(self, time_s: npt.ArrayLike) -> F64:
        """Times as an array, none of them more than a second outside the rows."""
        time = np.atleast_1d(np.asarray(time_s, dtype=np.float64))
        first_s, last_s = self.span_s
        outside = ~((time >= first_s - END_SLACK_S) & (time <= last_s + END_SLACK_S)) | np.isnan(time)
        if outside.any():
            span = _span(first_s, last_s) + self._dates(first_s, last_s)
            raise self._error(f"must be within the {self._of}, {span}, got {time[outside][0]:g}")
        return time

    def _dates(self, first_s: float, last_s: float) -> str:
        """The same span in UTC, of rows with dates."""
        if self.epoch is None or not math.isfinite(first_s):
            return ""
        from warpsim.exchange.instants import instants_of_time, later

        dates = later(instants_of_time(self.epoch), np.array([first_s, last_s])).dates("UTC", 3)
        return f" ({' to '.join(dates)} UTC)"

    def _error(self, rule: str) -> InputError:
        """The error about the times: of the rows' source, or of the field time_s."""
        return InputError(rule).of(self.source) if self.source else InputError(rule, "time_s")


def _span(first_s: float, last_s: float) -> str:
    """Times for messages, to the microsecond: dates of files carry the rounding of their digits."""
    return " to ".join(f"{round(time_s, 6) + 0.0:.9g}" for time_s in (first_s, last_s)) + " s"
