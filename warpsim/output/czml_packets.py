"""Packets of CZML: bodies, lines of sight and fields of view."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.output.czml_samples import DEGREE, Piece
from warpsim.output.czml_views import FieldOfView, LineOfSight

F64 = NDArray[np.float64]

Dates = Callable[[Sequence[float]], list[str]]
"""Times [s after the epoch] to dates in ISO 8601, UTC."""

SATELLITE, TARGET, MAIN = [86, 180, 233, 255], [230, 159, 0, 255], [213, 94, 0, 255]
_ACCESS, _FIELD = [0, 158, 115, 220], [240, 228, 66, 150]
_LABEL_OFFSET_PX = [8.0, -8.0]
_FIELD_EDGES = (1, 2, 3, 4, 1, 0, 2, 3, 0, 4)  # corners, 0 the sensor: all edges of the pyramid in one line


@dataclass(frozen=True)
class CzmlBody:
    """A satellite or target that is drawn."""

    name: str
    description: str
    pieces: list[Piece]
    span_s: tuple[float, float]
    """From when to when it is there [s after the epoch]."""
    colour: list[int]
    is_named: bool
    """Whether its name and path show: thirty names at one point hide one another."""
    path_width: int


def body_packet(body: CzmlBody, dates: Dates, duration_s: float) -> Any:
    """Return the packet of a body: positions, point, name and path.

    Args:
        body: The body.
        dates: Writes times.
        duration_s: Length of the scene [s].
    """
    from czml3 import Packet
    from czml3.enums import HorizontalOrigins
    from czml3.properties import Color, Label, Path, Point
    from czml3.types import Cartesian2Value, TimeInterval

    first, last = dates(body.span_s)
    return Packet(
        id=body.name,
        name=body.name,
        description=body.description,
        availability=TimeInterval(start=first, end=last),
        position=_position(body.pieces, dates),
        point=Point(color=Color(rgba=body.colour), pixelSize=8 if body.is_named else 4, outlineWidth=0),
        label=Label(
            text=body.name, font="12px sans-serif", fillColor=Color(rgba=body.colour), show=body.is_named,
            horizontalOrigin=HorizontalOrigins.LEFT, pixelOffset=Cartesian2Value(values=_LABEL_OFFSET_PX),
        ),
        path=Path(
            material=_solid([*body.colour[:3], 140]), width=body.path_width, show=body.is_named,
            leadTime=duration_s, trailTime=duration_s, resolution=60,
        ),
    )  # fmt: skip


def line_packet(line: LineOfSight, dates: Dates, duration_s: float) -> Any:
    """Return the packet of a line of sight, which shows during access."""
    from czml3 import Packet

    return Packet(
        id=f"access/{line.sensor}/{line.target}",
        name=f"{line.sensor} sees {line.target}",
        polyline=_polyline(
            [f"{line.satellite}#position", f"{line.target}#position"], _shown(line.shown_s, dates, duration_s), _ACCESS
        ),
    )


def field_packets(field: FieldOfView, dates: Dates, duration_s: float) -> list[Any]:
    """Return the packets of a field of view: the pyramid's edges, and a packet for the position of each corner."""
    from czml3 import Packet
    from czml3.types import TimeInterval

    first, last = dates(field.span_s)
    name = f"field/{field.sensor}"
    corners = [
        Packet(
            id=f"{name}/{number + 1}",
            name=f"corner {number + 1} of the field of view of {field.sensor}",
            parent=name,
            availability=TimeInterval(start=first, end=last),
            position=_position([(time_s, m[:, 3 * number : 3 * number + 3]) for time_s, m in field.corners], dates),
        )
        for number in range(4)
    ]
    points = [f"{field.satellite}#position", *(f"{name}/{number + 1}#position" for number in range(4))]
    edges = _polyline(
        [points[number] for number in _FIELD_EDGES], _shown(field.shown_s, dates, duration_s), _FIELD, width=1.0
    )
    return [Packet(id=name, name=f"field of view of {field.sensor}", polyline=edges), *corners]


def _position(pieces: list[Piece], dates: Dates) -> Any:
    """Sampled positions; by intervals where there is more than one piece."""
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


def _shown(spans_s: Sequence[tuple[float, float]], dates: Dates, duration_s: float) -> Any:
    """True within some spans of the scene, False elsewhere."""
    from czml3.types import IntervalValue, TimeIntervalCollection

    first, last = dates([0.0, duration_s])
    values = [IntervalValue(start=first, end=last, value=False)]  # later intervals take precedence
    for span_s in spans_s:
        start, end = dates(span_s)
        values.append(IntervalValue(start=start, end=end, value=True))
    return TimeIntervalCollection(values=values)


def _polyline(references: list[str], show: Any, colour: list[int], width: float = 1.5) -> Any:
    """A straight line through the positions of other packets."""
    from czml3.enums import ArcTypes
    from czml3.properties import Polyline, PositionList

    return Polyline(
        show=show,
        positions=PositionList(references=references),
        arcType=ArcTypes.NONE,
        width=width,
        material=_solid(colour),
    )


def _solid(colour: list[int]) -> Any:
    from czml3.properties import Color, PolylineMaterial, SolidColorMaterial

    return PolylineMaterial(solidColor=SolidColorMaterial(color=Color(rgba=colour)))
