"""Parts of packets of CZML that several kinds of them have: dates, samples of motion, lines.

Cesium interpolates between samples of motion with Lagrange polynomials of degree 5. The time between samples is chosen
so that the polynomials stay within an error. Motion with a breakpoint (a release, a manoeuvre, a step of a camera) is
cut into pieces at it, which Cesium interpolates one by one; a breakpoint that nobody reports is found by its error, and
fenced in by short pieces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.instant import utc_dates
from warpsim.scene.scenario import Scenario

Span = tuple[float, float]
"""Start and end [s after the epoch]."""
Dates = Callable[[Sequence[float]], list[str]]
"""Times [s after the epoch] to dates in ISO 8601, UTC."""

MOST_SAMPLES = 2_000_000
"""Of all bodies together: some 100 MB of text."""

PositionFunction = Callable[[F64], F64]
"""Times [s after the epoch], shape (n,), to positions of one point or several [m], shape (n, 3 * n_point)."""

Piece = tuple[F64, F64]
"""Times [s after the epoch], shape (n,), n >= 6, and positions [m], shape (n, 3 * n_point)."""

DEGREE = 5
"""Degree of the interpolating polynomials, through six samples."""
ERROR_M = 0.1
"""Error of interpolation within which the time between samples is chosen."""
LONGEST_STEP_S = 300.0
SHORTEST_STEP_S = 15.0
"""Of smooth motion; where it does not do, the track is cut in half there."""
SHORTEST_PIECE_S = 0.02
DATE_S = 1e-6
"""Digits of the dates between which pieces count."""

_AIM = 0.8  # fraction of the error that samples are chosen for: a margin for times between the points measured
_CHECKS_PER_STEP = 8
_CHECKS_PER_PIECE = 128  # at least: unreported breakpoints are in short pieces
_FINER = 16  # so many times more densely, next to the largest error
_DECIMALS = 3  # of a position [m]


def czml_dates(epoch_utc: str, time_s: Sequence[float]) -> list[str]:
    """Return instants as ISO 8601 UTC, to the microsecond; those within a leap second become the second after it."""
    texts = [str(text) for text in utc_dates(epoch_utc, time_s)]
    midnights = [f"{np.datetime64(text[:10]) + 1}T00:00:00.000000" for text in texts]
    return [f"{midnight if ':60' in text else text}Z" for text, midnight in zip(texts, midnights, strict=True)]


def body_span_s(scenario: Scenario, name: str) -> Span:
    """Return when a body exists within the scene; the first is not before the last where that is never."""
    duration_s = scenario.scene.duration_s
    if name in scenario.satellite_names:
        return 0.0, duration_s
    target = scenario.targets[scenario.target_names.index(name)]
    return max(0.0, target.exists_s[0], target.release_s), min(duration_s, target.exists_s[1])


def position_property(pieces: list[Piece], dates: Dates) -> Any:
    """Return sampled positions; by intervals where there is more than one piece."""
    from czml3.properties import Position
    from czml3.types import IntervalValue, TimeIntervalCollection

    (epoch,) = dates([0.0])
    positions = [
        Position(
            epoch=epoch,
            cartesian=np.column_stack(piece).ravel().tolist(),
            referenceFrame="INERTIAL",
            interpolationAlgorithm="LAGRANGE",
            interpolationDegree=DEGREE,
        )
        for piece in pieces
    ]
    if len(positions) == 1:
        return positions[0]
    edges = dates([pieces[0][0][0], *(time_s[-1] for time_s, _ in pieces)])
    spans = zip(edges[:-1], edges[1:], positions, strict=True)
    return TimeIntervalCollection(values=[IntervalValue(start=a, end=b, value=value) for a, b, value in spans])


def polyline(
    references: list[str], shown_s: Sequence[Span], colour: list[int], width: float, dates: Dates, duration_s: float
) -> Any:
    """Return a straight line through the positions of other packets, shown within some spans of the scene."""
    from czml3.properties import Polyline
    from czml3.types import IntervalValue, TimeIntervalCollection

    spans = [(*dates([0.0, duration_s]), False), *((*dates(span_s), True) for span_s in shown_s)]
    shown = [IntervalValue(start=start, end=end, value=value) for start, end, value in spans]  # later ones win
    return Polyline(
        show=TimeIntervalCollection(values=shown),
        positions={"references": references},
        arcType="NONE",
        width=width,
        material=solid(colour),
    )


def solid(colour: list[int]) -> dict[str, Any]:
    """Return a material of one colour."""
    return {"solidColor": {"color": {"rgba": colour}}}


# --- samples of motion ---


def sampled_track(
    position_m: PositionFunction,
    span_s: tuple[float, float],
    breakpoints_s: Sequence[float] = (),
    step_s: float | None = None,
    largest_error_m: float = ERROR_M,
    may_jump: bool = False,
) -> tuple[list[Piece], float]:
    """Return samples of motion in a span of time [s after the epoch], and the error of interpolating between them [m].

    Samples come in pieces that follow one another, each evenly sampled, its ends included; one where the motion is
    smooth. The motion is cut at its breakpoints. The time between samples is chosen by their error if step_s is left
    out. A jump, where not even a piece of SHORTEST_PIECE_S can be interpolated, is an InputError unless it may be.
    """
    first_s, last_s = span_s
    inner = {round(time, 6) for time in breakpoints_s if first_s + 2 * DATE_S < time < last_s - 2 * DATE_S}
    spans = list(pairwise([first_s, *sorted(inner), last_s]))
    if step_s is not None:
        given = [_sampled_piece(position_m, *span, step_s) for span in spans]
        return [piece for piece, _ in given], max(error_m for _, error_m in given)
    pieces: list[Piece] = []
    largest_m = 0.0
    spans.reverse()  # the earliest is taken first
    while spans:
        first_s, last_s = spans.pop()
        longest_s = LONGEST_STEP_S
        piece, error_m = _sampled_piece(position_m, first_s, last_s, longest_s)
        while error_m > _AIM * largest_error_m and min(longest_s, last_s - first_s) / 2 >= SHORTEST_STEP_S:
            longest_s /= 2
            piece, error_m = _sampled_piece(position_m, first_s, last_s, longest_s)
        is_short = last_s - first_s < SHORTEST_PIECE_S
        if error_m <= _AIM * largest_error_m or (is_short and may_jump):
            pieces.append(piece)
            largest_m = max(largest_m, error_m)
            continue
        if is_short:
            raise InputError(
                f"jumps at {first_s:.3f} s: samples are {error_m:.3g} m off between them, more than "
                f"{largest_error_m:g}; give step_s to write them all the same"
            )
        middle_s = round(0.5 * (first_s + last_s), 6)  # as exact as a date
        spans += [(middle_s, last_s), (first_s, middle_s)]  # the earlier half comes next
    return pieces, largest_m


def _sampled_piece(position_m: PositionFunction, first_s: float, last_s: float, step_s: float) -> tuple[Piece, float]:
    """Even samples of a part of the motion, step_s apart at most, and the error of interpolating between them [m]."""
    n = max(DEGREE + 1, math.ceil((last_s - first_s) / step_s - 1e-9) + 1)
    time_s = np.linspace(first_s, last_s, n)
    before_s = np.nextafter(last_s, -np.inf)  # what begins at the end belongs to the next piece
    sampled_m = np.round(position_m(np.minimum(time_s, before_s)), _DECIMALS)

    def off_m(between_s: F64) -> F64:
        missed_m = interpolated(time_s, sampled_m, between_s) - position_m(np.minimum(between_s, before_s))
        return np.asarray(np.linalg.norm(missed_m.reshape(len(between_s), -1, 3), axis=2).max(axis=1))

    checks_s = np.linspace(first_s, last_s, max((n - 1) * _CHECKS_PER_STEP, _CHECKS_PER_PIECE) + 1)
    coarse_m = off_m(checks_s)
    worst = int(np.argmax(coarse_m))
    next_to = checks_s[max(worst - 1, 0)], checks_s[min(worst + 1, len(checks_s) - 1)]
    fine_m = off_m(np.linspace(*next_to, 2 * _FINER + 1))
    return (time_s, sampled_m), float(max(coarse_m.max(), fine_m.max()))


def interpolated(sample_s: F64, values: F64, time_s: F64) -> F64:
    """Return values at times as Cesium's SampledProperty gives them, shape (m, k).

    Lagrange's polynomial through six of the samples (n, k) at ascending times: three on either side of the time where
    there are as many, else the six at the end.
    """
    after = np.searchsorted(sample_s, time_s, side="right")
    first = np.clip(after - DEGREE // 2 - 1, 0, len(sample_s) - DEGREE - 1)
    rows = first[:, None] + np.arange(DEGREE + 1)
    nodes = sample_s[rows] - time_s[:, None]
    result = np.zeros((len(time_s), values.shape[1]))
    for j in range(DEGREE + 1):
        others = np.delete(nodes, j, axis=1)
        weight = np.prod(others / (others - nodes[:, j : j + 1]), axis=1)
        result += weight[:, None] * values[rows[:, j]]
    return result
