"""Scenes as CZML, the format of Cesium: bodies with their paths and names, and lines of sight during access.

Positions are in the frame that CZML calls INERTIAL, the ICRF: its axes are those of GCRS, so the scene's numbers go in
as they are. Cesium turns them to the ground by its own Earth orientation. It interpolates with Lagrange polynomials of
degree 5; the time between samples is chosen for each body so that the polynomials stay within ERROR_M of its track.
A track with a bend (a release, a manoeuvre) is cut into intervals at it, which Cesium interpolates one by one; a bend
that the scene does not tell of is found by its error, and fenced in by short intervals.
"""

from __future__ import annotations

import importlib.util
import math
import os
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.files import check_new_file, whole_file
from warpsim.instant import years_ahead
from warpsim.scene.bends import bends_s

if TYPE_CHECKING:
    from warpsim.scene.scene import Scene

F64 = NDArray[np.float64]

Piece = tuple[F64, F64]
"""Times [s after the epoch], shape (n,), n >= 6, and positions [m], shape (n, 3)."""

DEGREE = 5
"""Of the interpolating polynomials, through six samples."""
ERROR_M = 0.1
"""What the interpolation may be off where the time between samples is chosen."""
AIM = 0.8
"""Share of ERROR_M to which samples are chosen: room for what lies between the places where it is measured."""
LONGEST_STEP_S = 300.0
SHORTEST_STEP_S = 15.0
"""Of smooth motion; where it does not do, the track is cut in half there."""
SHORTEST_PIECE_S = 0.02
MOST_SAMPLES = 2_000_000
"""Of all bodies together: some 100 MB of text."""

_CHECKS_PER_STEP = 8
_CHECKS_PER_PIECE = 128  # at least: bends that nobody tells of are in short pieces
_FINER = 16  # so many times more densely, next to the worst place
_DATE_S = 1e-6  # digits of the dates between which pieces count
_DECIMALS = 3  # of a position [m]
_SATELLITE, _TARGET, _MAIN, _SIGHT = [86, 180, 233, 255], [230, 159, 0, 255], [213, 94, 0, 255], [0, 158, 115, 220]
_DOCUMENT = "document"
_LABEL_OFFSET_PX = [8.0, -8.0]


def write_czml(
    scene: Scene, path: str | os.PathLike[str], step_s: float | None = None, overwrite: bool = False
) -> float:
    """Write a scene as CZML, whole or not at all.

    Every satellite and target is a packet with sampled positions, a point, a name and a path, available during the
    scene; every satellite that ever has access is joined to the main target by a line that shows while it has.

    Args:
        scene: The scene.
        path: File to write, .czml.
        step_s: Time between samples [s]; if left out, the longest of 300, 150, ... s that keeps each body within 0.1 m.
        overwrite: Whether an existing file is replaced.

    Returns:
        How far the positions, interpolated as Cesium does, are from the scene's at most [m], measured at eight places
        or more from one sample to the next, before and after every bend, and densely about the worst place.

    Raises:
        InputError: The path cannot be written, the step is bad, a body jumps, or the package czml3 (the extra `czml`)
            is not installed.
    """
    path = Path(path)
    check_new_file(path, (".czml",), overwrite)
    if importlib.util.find_spec("czml3") is None:
        raise InputError("needs czml3, which the extra `czml` brings: pip install 'warpsim[czml]'", "czml")
    if step_s is not None and not (math.isfinite(step_s) and step_s > 0):
        raise InputError("must be > 0", "step_s", step_s, "g")
    names = [*scene.sensor_names, *scene.target_names]
    if _DOCUMENT in names:
        raise InputError("is the name of the first packet of a CZML file, so no body may have it").of(_DOCUMENT)
    if step_s is not None and len(names) * scene.duration_s / step_s > MOST_SAMPLES:
        raise InputError(
            f"{step_s:g} s give more than {MOST_SAMPLES} positions for {len(names)} bodies over {scene.duration_s:g} s",
            "step_s",
        )
    bends = bends_s(scene)
    samples = {name: sampled_track(scene, name, step_s, bends[name]) for name in names}
    document = _document(scene, {name: pieces for name, (pieces, _) in samples.items()})
    with whole_file(path) as partial:
        document.save(partial, indent=None)
    return max(error_m for _, error_m in samples.values())


def sampled_track(
    scene: Scene, name: str, step_s: float | None = None, bends: Sequence[float] = ()
) -> tuple[list[Piece], float]:
    """Samples of a body's track from the epoch to the scene's end, and the error of interpolating between them [m].

    Args:
        scene: The scene.
        name: Of a sensor or target.
        step_s: Time between samples [s]; chosen by their error if left out.
        bends: Times at which the track bends [s after the epoch], ascending; it is cut there.

    Returns:
        Pieces that follow one another, evenly sampled, their ends included; one where the track is smooth; and the
        largest error.

    Raises:
        InputError: The body jumps: not even a piece of 0.02 s can be interpolated.
    """
    inner = {round(time, 6) for time in bends if 2 * _DATE_S < time < scene.duration_s - 2 * _DATE_S}
    edges = [0.0, *sorted(inner), scene.duration_s]
    spans = list(pairwise(edges))
    if step_s is not None:
        given = [_sampled_piece(scene, name, *span, step_s) for span in spans]
        return [piece for piece, _ in given], max(error_m for _, error_m in given)
    pieces: list[Piece] = []
    largest_m = 0.0
    spans.reverse()  # the earliest is taken first
    while spans:
        first_s, last_s = spans.pop()
        wanted_s = LONGEST_STEP_S
        piece, error_m = _sampled_piece(scene, name, first_s, last_s, wanted_s)
        while error_m > AIM * ERROR_M and min(wanted_s, last_s - first_s) / 2 >= SHORTEST_STEP_S:
            wanted_s /= 2
            piece, error_m = _sampled_piece(scene, name, first_s, last_s, wanted_s)
        if error_m <= AIM * ERROR_M:
            pieces.append(piece)
            largest_m = max(largest_m, error_m)
            continue
        if last_s - first_s < SHORTEST_PIECE_S:
            raise InputError(
                f"jumps at {first_s:.3f} s: samples are {error_m:.3g} m off between them, more than {ERROR_M:g}; give "
                "step_s to write them all the same",
                name,
            )
        middle_s = round(0.5 * (first_s + last_s), 6)  # as exact as a date
        spans += [(middle_s, last_s), (first_s, middle_s)]  # the earlier half comes next
    return pieces, largest_m


def _sampled_piece(scene: Scene, name: str, first_s: float, last_s: float, step_s: float) -> tuple[Piece, float]:
    """Even samples of a part of a track, step_s apart at most, and the error of interpolating between them [m]."""
    n = max(DEGREE + 1, math.ceil((last_s - first_s) / step_s - 1e-9) + 1)
    time_s = np.linspace(first_s, last_s, n)
    position_m = np.round(scene.position_m(name, time_s), _DECIMALS)

    def off_m(between_s: F64) -> F64:
        missed_m = interpolated(time_s, position_m, between_s) - scene.position_m(name, between_s)
        return np.asarray(np.linalg.norm(missed_m, axis=1))

    checks_s = np.linspace(first_s, last_s, max((n - 1) * _CHECKS_PER_STEP, _CHECKS_PER_PIECE) + 1)
    coarse_m = off_m(checks_s)
    worst = int(np.argmax(coarse_m))
    next_to = checks_s[max(worst - 1, 0)], checks_s[min(worst + 1, len(checks_s) - 1)]
    fine_m = off_m(np.linspace(*next_to, 2 * _FINER + 1))
    return (time_s, position_m), float(max(coarse_m.max(), fine_m.max()))


def interpolated(sample_s: F64, values: F64, time_s: F64) -> F64:
    """Values at times as Cesium's SampledProperty gives them, shape (m, k).

    Lagrange's polynomial through six samples, three on either side of the time where there are as many, else the six
    at the end.

    Args:
        sample_s: Times of the samples, ascending, shape (n,), n >= 6.
        values: Samples, shape (n, k).
        time_s: Times within them, shape (m,).
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


def _document(scene: Scene, samples: dict[str, list[Piece]]) -> Any:
    """The document: clock, satellites, targets, lines of sight."""
    from czml3 import CZML_VERSION, Document, Packet
    from czml3.enums import ClockRanges, ClockSteps
    from czml3.properties import Clock
    from czml3.types import IntervalValue

    start, end = _utc(scene, [0.0, scene.duration_s])
    clock = Clock(
        currentTime=start, multiplier=10, range=ClockRanges.LOOP_STOP, step=ClockSteps.SYSTEM_CLOCK_MULTIPLIER
    )
    text = scene.description or "A scene of warpsim."
    packets = [
        Packet(id=_DOCUMENT, name=scene.name, version=CZML_VERSION, description=text,
               clock=IntervalValue(start=start, end=end, value=clock))
    ]  # fmt: skip
    mains = {group.names[0] for group in scene.groups_of_targets}
    for name, pieces in samples.items():
        is_sensor = name in scene.sensor_names
        colour = _SATELLITE if is_sensor else _MAIN if name in mains else _TARGET
        is_named = is_sensor or name in mains  # thirty names on one spot hide one another
        packets.append(_body(scene, name, pieces, colour, is_named, (start, end)))
    return Document(packets=[*packets, *_sights(scene, (start, end))])


def _position(scene: Scene, pieces: list[Piece], epoch: str) -> Any:
    """Sampled positions; by intervals where there is more than one piece."""
    from czml3.enums import InterpolationAlgorithms, ReferenceFrames
    from czml3.properties import Position
    from czml3.types import IntervalValue, TimeIntervalCollection

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
    edges = _utc(scene, [pieces[0][0][0], *(time_s[-1] for time_s, _ in pieces)])
    spans = zip(edges[:-1], edges[1:], positions, strict=True)
    return TimeIntervalCollection(values=[IntervalValue(start=a, end=b, value=value) for a, b, value in spans])


def _body(
    scene: Scene, name: str, pieces: list[Piece], colour: list[int], is_named: bool, span: tuple[str, str]
) -> Any:
    from czml3 import Packet
    from czml3.enums import HorizontalOrigins
    from czml3.properties import Color, Label, Path, Point
    from czml3.types import Cartesian2Value, TimeInterval

    spec = dict(zip(scene.target_names, scene.target_specs, strict=True)).get(name)
    return Packet(
        id=name,
        name=name,
        description="satellite" if spec is None else f"target, {spec.shape.kind}",
        availability=TimeInterval(start=span[0], end=span[1]),
        position=_position(scene, pieces, span[0]),
        point=Point(color=Color(rgba=colour), pixelSize=8 if is_named else 4, outlineWidth=0),
        label=Label(
            text=name, font="12px sans-serif", fillColor=Color(rgba=colour), horizontalOrigin=HorizontalOrigins.LEFT,
            pixelOffset=Cartesian2Value(values=_LABEL_OFFSET_PX), show=is_named,
        ),
        path=Path(
            material=_solid([*colour[:3], 140]), width=1 if spec is None else 2, show=is_named,
            leadTime=scene.duration_s, trailTime=scene.duration_s, resolution=60,
        ),
    )  # fmt: skip


def _sights(scene: Scene, span: tuple[str, str]) -> list[Any]:
    """A line from each satellite with access to the main target, shown while it has access."""
    from czml3 import Packet
    from czml3.enums import ArcTypes
    from czml3.properties import Polyline, PositionList
    from czml3.types import IntervalValue, TimeIntervalCollection

    main, table = scene.target_names[0], scene.access()
    packets = []
    for name in scene.sensor_names:
        rows = table[table["sensor"] == name]
        if not len(rows):
            continue
        shown = [IntervalValue(start=span[0], end=span[1], value=False)]  # later intervals take precedence
        for row in rows:
            first, last = _utc(scene, [float(row["start_s"]), float(row["end_s"])])
            shown.append(IntervalValue(start=first, end=last, value=True))
        packets.append(
            Packet(
                id=f"access/{name}/{main}",
                name=f"{name} sees {main}",
                polyline=Polyline(
                    show=TimeIntervalCollection(values=shown),
                    positions=PositionList(references=[f"{name}#position", f"{main}#position"]),
                    arcType=ArcTypes.NONE,
                    width=1.5,
                    material=_solid(_SIGHT),
                ),
            )
        )
    return packets


def _solid(colour: list[int]) -> Any:
    from czml3.properties import Color, PolylineMaterial, SolidColorMaterial

    return PolylineMaterial(solidColor=SolidColorMaterial(color=Color(rgba=colour)))


def _utc(scene: Scene, time_s: Sequence[float]) -> list[str]:
    """Instants as ISO 8601 UTC, to the microsecond; those within a leap second become the second after it."""
    from astropy import units as u
    from astropy.time import Time

    texts = []
    with years_ahead():
        instants = (scene.epoch.tai + np.asarray(time_s) * u.s).utc
        instants.precision = 6
        for text, instant in zip(instants.isot, instants, strict=True):
            if ":60" in text:
                text = Time(
                    math.floor(instant.jd1 + instant.jd2 + 0.5) + 0.5, format="jd", scale="utc", precision=6
                ).isot
            texts.append(f"{text}Z")
    return texts
