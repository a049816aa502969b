"""What packets of targets have in CZML besides positions: attitudes, with solids, and curves of their light.

Attitudes are rotations from body to Earth-fixed axes, sampled so that slerp follows them: Cesium turns linearly between
two samples, along the shorter way, and takes rotations below 0.16 degrees from one to the next for none. So samples are
as far apart as the error allows, and the error is not smaller than that.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.instant import Epoch
from warpsim.orbit.earth import itrs_to_gcrs
from warpsim.output.czml_parts import MOST_SAMPLES, Dates, Span, body_span_s, solid
from warpsim.output.czml_views import within
from warpsim.quaternion import conjugate, from_matrix, in_one_hemisphere, product, rotation_between_rad, slerp
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.scene.target_histories import AnyAttitude
from warpsim.target.areas import top_radius_m
from warpsim.target.attitude import BodyMotion
from warpsim.target.torque_free import TorqueFreeMotion

QuaternionAt = Callable[[F64], F64]
"""Times [s after the epoch], (n,), to unit quaternions, scalar last, (n, 4)."""

ERROR_RAD = math.radians(0.2)
"""Error of the rotation between samples within which they are chosen."""
LONGEST_STEP_S = 300.0
SHORTEST_STEP_S = 1e-5
LONGEST_TURN_RAD = 1.5
"""From one sample to the next at least as many: half a turn could be either way round."""

_AIM = 0.8  # fraction of the error that samples are chosen for: a margin for times between those looked at
_PARTS = np.array([0.25, 0.5, 0.75])  # of a step: where its error is looked at
_MOST_CUT = 16  # parts that a step is cut into at a time
_TIME_DECIMALS, _DECIMALS = 6, 7
_PLATE_M = 1e-3  # thickness of a plate as drawn

MOST_FRAMES = 1000
"""Frames of a sensor during access that curves have; of more, every second, third, ..."""

_LIGHT_DIGITS = 6


# --- attitudes ---


def orientations(
    scenario: Scenario, dates: Dates, names: Sequence[str], colours: Mapping[str, list[int]]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the names of targets, and the fields of their packets: orientation, and a solid of their shape.

    Raises:
        InputError: They would take more than MOST_SAMPLES samples.
    """
    if not names:
        return
    from czml3.properties import Orientation

    (epoch,) = dates([0.0])
    earth = earth_rotation(scenario.epoch, scenario.scene.duration_s)
    room = MOST_SAMPLES
    for name in names:
        number = scenario.target_names.index(name)
        attitude, span_s = scenario.attitudes[number], body_span_s(scenario, name)
        at = functools.partial(_earth_fixed, attitude, earth)
        try:
            time_s, quaternion = sampled_attitude(at, _edges_s(attitude, span_s, room), room)
        except InputError as error:
            raise error.of(name) from None
        room -= len(time_s)
        orientation = Orientation(
            epoch=epoch,
            unitQuaternion=np.column_stack([time_s, np.round(quaternion, _DECIMALS)]).ravel().tolist(),
            interpolationAlgorithm="LINEAR",
            interpolationDegree=1,
        )
        yield name, {"orientation": orientation, **_solid_of(scenario.targets[number].spec.shape, colours[name])}


def earth_rotation(epoch: Epoch, duration_s: float) -> QuaternionAt:
    """Return the rotation from Earth-fixed (ITRS) to GCRS axes as a function of time within a scene.

    Slerp between exact ones: the Earth turns about an axis that hardly moves, so the error is below 1e-10 rad.
    """
    node_s = np.linspace(0.0, duration_s, max(2, math.ceil(duration_s / LONGEST_STEP_S) + 1))
    nodes = in_one_hemisphere(from_matrix(itrs_to_gcrs(epoch, node_s)))

    def at(time_s: F64) -> F64:
        row = np.clip(np.searchsorted(node_s, time_s, side="right") - 1, 0, len(node_s) - 2)
        part = (time_s - node_s[row]) / (node_s[row + 1] - node_s[row])
        return slerp(nodes[row], nodes[row + 1], part)

    return at


def _earth_fixed(attitude: AnyAttitude, earth: QuaternionAt, time_s: F64) -> F64:
    return product(conjugate(earth(time_s)), attitude.at(time_s))


def _edges_s(attitude: AnyAttitude, span_s: Span, room: int) -> F64:
    """Times of a span between which the body turns less than half a turn, those at which its rate jumps among them."""
    first_s, last_s = np.round(span_s, _TIME_DECIMALS)
    rate_rad_s, breaks_s = 0.0, np.zeros(0)
    if isinstance(attitude, BodyMotion):
        own = attitude.attitude
        rate_rad_s = 2 * math.pi * (abs(own.spin_rev_s) + abs(own.precession_rev_s) + abs(own.rolling_rev_s))
    elif isinstance(attitude, TorqueFreeMotion):
        nutation = attitude.nutation
        fastest = 2.0 * float(np.linalg.norm(nutation.step, axis=1).max()) * len(nutation.step) * nutation.rate_rev_s
        rate_rad_s = 2 * math.pi * abs(nutation.precession_rev_s) + 1.2 * fastest  # between nodes it may be more
    else:
        breaks_s = np.round(attitude.breaks_s(), _TIME_DECIMALS)
    n_turn = (last_s - first_s) * max(rate_rad_s / LONGEST_TURN_RAD, 1.0 / LONGEST_STEP_S)
    _check_room(n_turn, room)  # it may be infinite
    n_step = max(1, math.ceil(n_turn))
    inner_s = breaks_s[(breaks_s > first_s) & (breaks_s < last_s)]
    even_s = np.round(np.linspace(first_s, last_s, n_step + 1), _TIME_DECIMALS)
    return np.unique(np.concatenate([even_s, inner_s]))


def _check_room(n_sample: float, room: int) -> None:
    if n_sample > room:
        rule = f"turns so fast, or so long, that attitudes take more than {MOST_SAMPLES} samples: choose fewer targets"
        raise InputError(f"{rule}, or a shorter scene")


def sampled_attitude(at: QuaternionAt, edges_s: F64, room: int = MOST_SAMPLES) -> tuple[F64, F64]:
    """Return times (n,), the given ones among them, and quaternions (n, 4) of one hemisphere from one to the next.

    Steps are cut, by the square root of their error, until slerp along them is within ERROR_RAD of the rotation.

    Args:
        at: The rotation; by less than half a turn from one of the times to the next.
        edges_s: Ascending times, n >= 2.
        room: Most samples.

    Raises:
        InputError: They would be more.
    """
    time_s, turned = edges_s, at(edges_s)
    is_open = np.ones(len(time_s) - 1, bool)
    while is_open.any():
        first = np.flatnonzero(is_open)
        off_rad = _off_rad(at, time_s, turned, first)
        step_s = time_s[first + 1] - time_s[first]
        bad = (off_rad > _AIM * ERROR_RAD) & (step_s > _MOST_CUT * SHORTEST_STEP_S)
        n_part = np.ones(len(is_open), np.int64)
        n_part[first[bad]] = np.minimum(np.ceil(np.sqrt(off_rad[bad] / (_AIM * ERROR_RAD))), _MOST_CUT)
        _check_room(int(n_part.sum()) + 1, room)
        row = np.repeat(np.arange(len(n_part)), n_part)
        number = np.arange(len(row)) - np.repeat(np.cumsum(n_part) - n_part, n_part)
        new = number > 0
        new_s = time_s[row] + np.diff(time_s)[row] * number / n_part[row]
        before = turned[row]
        time_s = np.append(np.round(new_s, _TIME_DECIMALS), time_s[-1])
        turned = np.append(before, turned[-1:], axis=0)
        turned[:-1][new] = at(time_s[:-1][new])
        is_open = (n_part > 1)[row]
    return time_s, in_one_hemisphere(turned)


def _off_rad(at: QuaternionAt, time_s: F64, turned: F64, first: NDArray[np.int64]) -> F64:
    """How far slerp is off on the steps that begin at some of the samples [rad], shape of `first`."""
    start, end = turned[first], turned[first + 1]
    end = np.where(np.sum(start * end, axis=1, keepdims=True) < 0.0, -end, end)
    between_s = time_s[first, None] + _PARTS * (time_s[first + 1] - time_s[first])[:, None]
    true = at(between_s.ravel()).reshape(len(first), len(_PARTS), 4)
    guessed = slerp(start[:, None], end[:, None], np.broadcast_to(_PARTS, between_s.shape))
    return np.asarray(rotation_between_rad(guessed, true).max(axis=1))


def _solid_of(shape: Any, colour: list[int]) -> dict[str, Any]:
    """The field of a packet that draws a shape in its body's axes; none of a mesh."""
    style = {"material": solid(colour), "outline": True, "outlineColor": {"rgba": [40, 40, 40, 255]}}
    if shape.kind == "mesh":
        return {}
    if shape.kind == "sphere":
        return {"ellipsoid": {"radii": {"cartesian": {"values": [shape.radius_m] * 3}}, **style}}
    if shape.kind == "plate":
        return {"box": {"dimensions": {"cartesian": {"values": [shape.width_m, shape.length_m, _PLATE_M]}}, **style}}
    radii_m = {"topRadius": top_radius_m(shape), "bottomRadius": shape.radius_m}
    return {"cylinder": {"length": shape.height_m, **radii_m, **style}}


# --- curves of light ---


def light_properties(scenario: Scenario, dates: Dates, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return properties "irradiance_w_cm2/SENSOR/BAND" of targets by name: samples at the sensor's frames [W/cm2].

    They are there while the sensor has access and the target exists, an interval for each access, linear within it.

    Raises:
        InputError: They would be more than MOST_SAMPLES samples.
    """
    from warpsim.render.light_curves import light_curves  # Warp is not imported for the rest

    found: dict[str, dict[str, Any]] = {name: {} for name in names}
    views = list(_views(scenario))
    n_sample = sum(len(time_s) * len(instrument.bands) for instrument, _, time_s in views) * len(names)
    if n_sample > MOST_SAMPLES:
        raise InputError(f"take {n_sample} samples, more than {MOST_SAMPLES}: choose fewer targets", "curves")
    for instrument, index, time_s in views:
        sensor = instrument.names[index]
        curves = light_curves(scenario, time_s, [sensor], list(names))
        for number, name in enumerate(names):
            for band, own in zip(curves.bands, curves.irradiance_w_cm2[:, 0, :, number].T, strict=True):
                pieces = _pieces(scenario, instrument, index, name, time_s, own, dates)
                if pieces:
                    found[name][f"irradiance_w_cm2/{sensor}/{band}"] = pieces[0] if len(pieces) == 1 else pieces
    return found


def _views(scenario: Scenario) -> Iterator[tuple[Instrument, int, F64]]:
    """Sensors with a frame during access, as kind and index, with the times of these frames, MOST_FRAMES at most."""
    for instrument in scenario.instruments.values():
        all_s = instrument.frame_time_s(np.arange(instrument.frames.count))
        for index in range(len(instrument.names)):
            seen_s = all_s[instrument.has_access(index, all_s)]
            if len(seen_s):
                yield instrument, index, seen_s[:: -(-len(seen_s) // MOST_FRAMES)]


def _pieces(
    scenario: Scenario, instrument: Instrument, index: int, name: str, time_s: F64, light_w_cm2: F64, dates: Dates
) -> list[dict[str, Any]]:
    """A curve as sampled numbers, in an interval for each access with a frame."""
    (epoch,) = dates([0.0])
    pieces = []
    for span_s in within(instrument.access, index, body_span_s(scenario, name)):
        chosen = (time_s >= span_s[0]) & (time_s <= span_s[1])
        if chosen.any():
            numbers = np.column_stack([time_s[chosen], light_w_cm2[chosen]]).tolist()
            numbers = [value for time, light in numbers for value in (time, float(f"{light:.{_LIGHT_DIGITS}g}"))]
            start, end = dates(span_s)
            pieces.append({"interval": f"{start}/{end}", "epoch": epoch, "number": numbers})
    return pieces
