"""Effective PSF tables of Airy patterns: how far they reach, how fine they are, and how wrong.

The pupil's autocorrelation ends at the frequency 1 / lamF (see pattern.py), so the pixel fraction is band-limited. Far
out the rings average away over a pixel and it follows w / r^3. Rings wider than a pixel are cut at the table's reach,
where each pixel is within the error, but the sum over a field beyond it may be off by up to 2e-4 at a radius of
10 px. Report the flux left out of a stamp as one minus the sum of its fractions.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.optics.epsf_table import (
    N_MARGIN,
    POINTS,
    EpsfTable,
    check_size,
    envelope,
    lagrange_weights,
    pixel_wing,
    table_fraction,
)
from warpsim.optics.flow import FlowProfile, fractions_on_grid, pixel_fractions
from warpsim.optics.pattern import AiryPattern

MIN_REACH_PX = 1.0
WING_PART = 0.65
"""Part of the error that the wing may take at the reach, on sampled offsets."""
SAMPLE_MARGIN = 1.2
ROUNDING_MARGIN = 5e-8
"""Samples may miss the worst offset: see stated_error()."""
ROUNDING = 2.5e-8
"""Error that float32 fractions, weights and sums may add, per point of the interpolation."""
N_REFINE = 6


def airy_table(pattern: AiryPattern, pixel_aspect: float, error: float, n_point: int, real: type) -> EpsfTable:
    """Build the table of an Airy pattern, read with weights and sums of type `real`; its error is at most `error`."""
    flow, reach_px = _flow_and_reach_px(pattern, pixel_aspect, error)
    step_px = _step_px(pattern, pixel_aspect, error, n_point)
    for _ in range(N_REFINE):
        table = _table(flow, pattern, pixel_aspect, reach_px, step_px, n_point)
        inside, outside = _measured_errors(table, flow, real)
        worst = stated_error(max(inside, outside))
        if worst <= error:
            return replace(table, error=worst)
        if stated_error(outside) > error:
            reach_px = 0.5 * math.ceil(2.08 * reach_px[0]), 0.5 * math.ceil(2.08 * reach_px[1])
        if stated_error(inside) > error:
            step_px *= 0.95 * min(1.0, (0.75 * error / inside) ** (1.0 / n_point))
    raise InputError(f"{error:g} is too small for float32, reached {worst:.2g}", "error").of("airy table")


def stated_error(found: float) -> float:
    """Return the error that a table states, from the largest one found on samples."""
    return SAMPLE_MARGIN * found + ROUNDING_MARGIN


def goal_of_interpolation(error: float, n_point: int) -> float:
    """Return how wrong interpolation alone may be, so that a table keeps an error."""
    return max(0.75 * (error - ROUNDING_MARGIN) / SAMPLE_MARGIN - ROUNDING * n_point, 0.15 * error)


def airy_table_shapes(
    pattern: AiryPattern, pixel_aspect: float, error: float
) -> dict[int, tuple[tuple[int, int], tuple[int, int]]]:
    """Return shape and nodes per pixel of the tables of each order, without building them: a guess to choose by."""
    _, reach_px = _flow_and_reach_px(pattern, pixel_aspect, error)
    shapes = {}
    for n_point in POINTS:
        per_px = nodes_per_px(_step_px(pattern, pixel_aspect, error, n_point), pixel_aspect)
        shapes[n_point] = (_n_node(reach_px[0], per_px[0]), _n_node(reach_px[1], per_px[1])), per_px
    return shapes


# Kept from the guess of the shapes to the table itself.
@lru_cache(maxsize=8)
def _flow_and_reach_px(
    pattern: AiryPattern, pixel_aspect: float, error: float
) -> tuple[FlowProfile, tuple[float, float]]:
    """Return the flow of a table that keeps the error, and how far it reaches, as _measured_reach_px has it."""
    limit_px = _reach_limit_px(pattern, pixel_aspect, WING_PART * error)
    # As far out as tables and their tests ask for it.
    corner_px = math.sqrt(2.0) * (1.3 * limit_px + 2.0 * max(1.0, pixel_aspect))
    flow = pattern.flow(max(corner_px, 20.0 * pattern.scale_px + 2.0 * max(1.0, pixel_aspect)))
    return flow, _measured_reach_px(flow, pattern, pixel_aspect, limit_px, WING_PART * error)


def _reach_limit_px(pattern: AiryPattern, pixel_aspect: float, tolerance: float) -> float:
    """Return a distance from which the wing is within a tolerance for certain [px].

    Its error is what is left of the rings, the next terms of the means over pixel and blur (0.22 a^4 / r^7 at most,
    230 s^6 / r^9), and the blurred core.
    """
    small, large = min(1.0, pixel_aspect), max(1.0, pixel_aspect)
    smear = pattern.smear_px
    reach_px = MIN_REACH_PX
    while True:
        ripple_px3 = pattern.ripples_px3(reach_px, small)
        next_px3 = (
            pattern.wing_px3
            * (0.22 * large**4 + 10.0 * smear**2 * large**2 + 350.0 * smear**6 / reach_px**2)
            / reach_px**4
        )
        inner_px = reach_px - 0.5 * large
        core = math.exp(-0.5 * (inner_px / smear) ** 2) / (2.0 * math.pi * smear**2) if smear > 0.0 else 0.0
        if pixel_aspect * ((ripple_px3 + next_px3) / reach_px**3 + core) <= tolerance:
            return reach_px
        reach_px += 0.5


def _measured_reach_px(
    flow: FlowProfile, pattern: AiryPattern, pixel_aspect: float, limit_px: float, tolerance: float
) -> tuple[float, float]:
    """Return the distance along rows [pixel heights] and columns [px] from which the wing is within a tolerance.

    It is worst on the axes, where the pixel's edge follows a ring. Multiples of half a pixel.
    """
    wing = pixel_wing(pattern.wing_px3, pattern.smear_px, pixel_aspect)
    r_px = np.linspace(MIN_REACH_PX, limit_px + 1.0, 1201) + np.random.default_rng(7).uniform(0.0, 1e-3, 1201)
    reach = []
    for axis, height in ((0, pixel_aspect), (1, 1.0)):
        offset = [np.zeros_like(r_px), np.zeros_like(r_px)]
        offset[axis] = r_px / height
        exact = pixel_fractions(flow, offset[1], offset[0], pixel_aspect)
        x2 = (offset[1] / r_px) ** 2
        law = wing.px3 / r_px**3 * (1.0 + (wing.next_px2 + wing.aspect_px2 * x2 + wing.last_px4 / r_px**2) / r_px**2)
        wrong = np.flatnonzero(np.abs(exact - law) > tolerance)
        beyond_px = r_px[wrong[-1]] if len(wrong) else MIN_REACH_PX
        reach.append(max(0.5 * math.ceil(2.0 * beyond_px / height), MIN_REACH_PX))
    return reach[0], reach[1]


@lru_cache(maxsize=32)
def _step_px(pattern: AiryPattern, pixel_aspect: float, error: float, n_point: int) -> float:
    """Return the distance of nodes at which interpolation keeps the error, judged along the axes [px]."""
    flow, _ = _flow_and_reach_px(pattern, pixel_aspect, error)
    both = 2.0 if flow.scale_px > 0.3 else 1.0  # at a sharp pattern's edges one axis is smooth where the other is not
    goal = goal_of_interpolation(error, n_point) / both
    step_px = flow.scale_px / (2.0 * n_point)
    longest_px = min(0.5 * max(1.0, pixel_aspect), 0.7 * flow.scale_px)
    for _ in range(8):
        found = _line_error(flow, pixel_aspect, step_px, n_point)
        factor = min(4.0, (goal / max(found, 1e-300)) ** (1.0 / n_point))
        step_px = min(step_px * factor, longest_px)
        if 0.97 < factor < 1.03:
            break
    return step_px


def _line_error(flow: FlowProfile, pixel_aspect: float, step_px: float, n_point: int) -> float:
    """Return the largest error in the middle of cells near the centre of the source and where it crosses an edge."""
    half = n_point // 2
    n_cell = min(200, int(6.0 * flow.scale_px / step_px) + 2)
    u = np.array([0.5])
    weights = np.array([float(weight[0]) for weight in lagrange_weights(u, n_point)])
    worst = 0.0
    for first_px in (0.5 - n_cell * step_px, 0.0):
        offset_px: F64 = first_px + step_px * 0.5 * np.arange(-2.0 * half, 4.0 * n_cell + 2.0 * half)
        exact = pixel_fractions(flow, offset_px, np.zeros_like(offset_px), pixel_aspect)
        nodes, middles = exact[0::2], exact[1::2]
        windows = np.lib.stride_tricks.sliding_window_view(nodes, n_point)
        found = windows @ weights - middles[half - 1 : half - 1 + len(windows)]
        worst = max(worst, float(np.abs(found).max()))
    return worst


def nodes_per_px(step_px: float, pixel_aspect: float) -> tuple[int, int]:
    """Return the even nodes per pixel, along rows and columns, that lie no farther apart than a step."""
    return 2 * math.ceil(0.5 * pixel_aspect / step_px), 2 * math.ceil(0.5 / step_px)


def _n_node(reach_px: float, per_px: int) -> int:
    return round(reach_px * per_px) + 1 + 2 * N_MARGIN


def _table(
    flow: FlowProfile,
    pattern: AiryPattern,
    pixel_aspect: float,
    reach_px: tuple[float, float],
    step_px: float,
    n_point: int,
) -> EpsfTable:
    """Fill a table; its error is yet to be measured."""
    per_px = nodes_per_px(step_px, pixel_aspect)
    shape = _n_node(reach_px[0], per_px[0]), _n_node(reach_px[1], per_px[1])
    check_size(*shape, "airy table")
    stored = shape[0] - N_MARGIN, shape[1] - N_MARGIN
    half = fractions_on_grid(flow, per_px, stored, pixel_aspect)
    mirror = [np.abs(np.arange(-N_MARGIN, n)) for n in stored]
    fraction64 = half[np.ix_(*mirror)]
    fraction32 = fraction64.astype(np.float32)
    fraction32.flags.writeable = False
    wing = pixel_wing(pattern.wing_px3, pattern.smear_px, pixel_aspect)
    small, least_px = min(1.0, pixel_aspect), min(reach_px[0] * pixel_aspect, reach_px[1])
    next_px2 = max(wing.next_px2, 0.0) + max(wing.aspect_px2, 0.0) + wing.last_px4 / least_px**2
    ripple_px3 = pixel_aspect * pattern.ripples_px3(math.inf, small)
    far_px3 = 1.05 * (wing.px3 * (1.0 + next_px2 / least_px**2) + ripple_px3)
    return EpsfTable(
        fraction=fraction32,
        n_point=n_point,
        per_px=per_px,
        zero=(N_MARGIN, N_MARGIN),
        mirrored=True,
        reach_px=reach_px,
        pixel_aspect=pixel_aspect,
        wing=wing,
        envelope=envelope(
            fraction64, per_px, (N_MARGIN, N_MARGIN), pixel_aspect, least_px - 0.5, far_px3 / least_px**3
        ),
        tail_px3=far_px3,
        error=math.nan,
    )


def _measured_errors(table: EpsfTable, flow: FlowProfile, real: type) -> tuple[float, float]:
    """Return the largest errors inside and outside the table, on sampled offsets that float32 holds."""
    rng = np.random.default_rng(0)
    reach = np.array(table.reach_px)[:, None]  # rows, columns
    scale = np.array([1.0 / table.pixel_aspect, 1.0])[:, None] * flow.scale_px
    worst = []
    for offsets in (_inside(table, rng, reach, scale), _outside(rng, reach)):
        dy_px, dx_px = offsets.astype(np.float32)
        exact = pixel_fractions(flow, dx_px.astype(np.float64), dy_px.astype(np.float64), table.pixel_aspect)
        worst.append(float(np.max(np.abs(table_fraction(table, dx_px.astype(real), dy_px.astype(real)) - exact))))
    return worst[0], worst[1]


def _inside(table: EpsfTable, rng: np.random.Generator, reach: F64, scale: F64) -> F64:
    """Return offsets within a table: with the source near the pixel's edges and corners, near its centre, anywhere."""
    n = 1000
    sharp = np.minimum(scale, 1.0)
    corner = 0.5 + 1.5 * sharp * rng.uniform(-1.0, 1.0, (2, 2 * n))
    edge = 0.5 + 1.5 * sharp * rng.uniform(-1.0, 1.0, (2, n))
    across = np.stack([edge[0], rng.uniform(0.0, 0.6, n)]), np.stack([rng.uniform(0.0, 0.6, n), edge[1]])
    near = 2.0 * np.maximum(scale, 2.0 * sharp) * rng.uniform(0.0, 1.0, (2, n))
    offsets = np.abs(np.concatenate([corner, *across, near], axis=1))
    # Interpolation is worst in the middle of a cell.
    per_px = np.array(table.per_px)[:, None]
    middle = (np.floor(offsets * per_px) + 0.5) / per_px
    anywhere = reach * rng.uniform(0.0, 1.0, (2, n))
    return np.asarray(np.minimum(np.concatenate([offsets, middle, anywhere], axis=1), reach))


def _outside(rng: np.random.Generator, reach: F64) -> F64:
    """Return offsets beyond a table: along the axes, where the wing is worst, and along its border."""
    n = 400
    wide = reach * rng.uniform(1.0, 1.3, (2, n))
    beside = rng.uniform(0.0, 1.0, n)
    along = reach * rng.uniform(0.0, 1.2, (2, n))
    rows = np.concatenate([beside, wide[0], along[0], wide[0]])
    return np.stack([rows, np.concatenate([wide[1], beside, wide[1], along[1]])])
