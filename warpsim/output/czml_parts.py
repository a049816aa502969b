"""Parts of packets of CZML that several kinds of them have: dates, sampled positions, lines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from warpsim.instant import utc_dates
from warpsim.output.czml_samples import DEGREE, Piece
from warpsim.scene.scenario import Scenario

Span = tuple[float, float]
"""Start and end [s after the epoch]."""
Dates = Callable[[Sequence[float]], list[str]]
"""Times [s after the epoch] to dates in ISO 8601, UTC."""

MOST_SAMPLES = 2_000_000
"""Of all bodies together: some 100 MB of text."""


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
    from czml3.enums import InterpolationAlgorithms, ReferenceFrames
    from czml3.properties import Position
    from czml3.types import IntervalValue, TimeIntervalCollection

    (epoch,) = dates([0.0])
    positions = [
        Position(
            epoch=epoch,
            cartesian=np.column_stack(piece).ravel().tolist(),
            referenceFrame=ReferenceFrames.INERTIAL,
            interpolationAlgorithm=InterpolationAlgorithms.LAGRANGE,
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
    from czml3.enums import ArcTypes
    from czml3.properties import Polyline, PositionList
    from czml3.types import IntervalValue, TimeIntervalCollection

    spans = [(*dates([0.0, duration_s]), False), *((*dates(span_s), True) for span_s in shown_s)]
    shown = [IntervalValue(start=start, end=end, value=value) for start, end, value in spans]  # later ones win
    return Polyline(
        show=TimeIntervalCollection(values=shown),
        positions=PositionList(references=references),
        arcType=ArcTypes.NONE,
        width=width,
        material=solid(colour),
    )


def solid(colour: list[int]) -> Any:
    """Return a material of one colour."""
    from czml3.properties import Color, PolylineMaterial, SolidColorMaterial

    return PolylineMaterial(solidColor=SolidColorMaterial(color=Color(rgba=colour)))
