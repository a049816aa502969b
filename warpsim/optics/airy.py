"""The share of a point source's flux that a pixel collects under an Airy pattern, as a table with an analytic wing.

Airy, G. B. (1835), "On the diffraction of an object-glass with circular aperture"; annular pupil: Mahajan, V. N.,
"Optical Imaging and Aberrations II", chapter 3. The paper's Eq. 8 gives the dark-ring radius R = 1.22 lambda L / D.

At a focal ratio F and a pixel pitch p, lamF = lambda F / p [px], v = pi r / lamF and, for the linear obscuration eps,

    f(r) = pi / (4 lamF^2 (1 - eps^2)) * [jinc(v) - eps^2 jinc(eps v)]^2,     jinc(v) = 2 J1(v) / v,

is the irradiance [1/px2] of unit flux. A pixel centred (dx, dy) from the source collects P(dx, dy), the integral of f
over that pixel. The pupil's autocorrelation ends at the frequency 1 / lamF, so P is band-limited: a grid of 14 nodes
per lamF and 6-point Lagrange interpolation reproduce it to about 3e-7. Far out the rings average away over a pixel
and P follows w / r^3. Each pixel is within 1e-6 of the flux; rings wider than a pixel are cut at the table's reach, so
the sum over a field beyond it may be off by up to 2e-4 at a radius of 10 px. Report the flux left out of a stamp as one
minus the sum of its shares.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.errors import InputError
from warpsim.optics.bessel import jinc

FIRST_DARK_RING = 1.2196698912665045
"""First zero of J1 over pi: radius of the first dark ring of the unobscured pupil [lamF]."""

RADIUS_RANGE_PX = (0.02, 50.0)
MAX_OBSCURATION = 0.6

N_MARGIN = 3
"""Nodes stored beyond zero and beyond the reach, for the ends of the 6-point interpolation."""

NODES_PER_LAMF = 14.0
"""Interpolation error about 2.5e-7 at the smallest radii, falling as the sixth power; float32 adds about 1.2e-7."""
WING_TOLERANCE = 3.0e-7
"""Root-sum-square of what the wing leaves out at the reach; ripples in phase may reach 1.5 times as much."""
MIN_REACH_PX = 2.0

ENVELOPE_STEP_PX = 0.25
"""Step of the radius in AiryTable.envelope; the kernels' own."""

RADIAL_STEP_LAMF = 0.01
"""Step of the radial table; cubic Hermite interpolation on it is good to 4e-9 of the peak."""

Floats = NDArray[np.floating]
Float64s = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class AiryTable:
    """Pixel share of a unit-flux Airy pattern on a uniform grid of pixel offsets, and its wing."""

    share: NDArray[np.float32]
    """Flux share at |dx| = (col - 3) / nodes_per_px, |dy| = (row - 3) / nodes_per_px [px], shape (n, n); read-only."""

    nodes_per_px: int
    """Nodes per pixel along each axis; even."""

    reach_px: float
    """Largest |dx| or |dy| that the table serves [px]; a multiple of half a pixel, so exact in float32."""

    wing_px3: float
    """Wing coefficient w [px3]: P ~ w / r^3 * (1 + 3 / (8 r^2)) where |dx| or |dy| exceeds reach_px."""

    tail_bound_px3: float
    """Coefficient b [px3] with P(dx, dy) <= b / r^3 for every pixel at r >= 1 px."""

    envelope: NDArray[np.float32]
    """Largest share of a pixel that a disc of radius k ENVELOPE_STEP_PX about the source does not touch."""

    error: float
    """Largest absolute error of `share` found on sampled offsets against edge quadrature, per unit flux."""

    radius_px: float
    """First dark ring of the unobscured pupil [px]."""

    obscuration: float
    """Linear central obscuration."""


@lru_cache(maxsize=16)
def build_airy_table(radius_px: float, obscuration: float = 0.0) -> AiryTable:
    """Build the pixel-share table of an Airy pattern; equal arguments return the same table.

    Args:
        radius_px: Radius of the first dark ring of the unobscured pupil, 1.22 lambda F / pitch [px].
        obscuration: Diameter of the central obscuration over that of the pupil.

    Returns:
        The table, with its error measured on sampled offsets.

    Raises:
        InputError: If an argument is out of range.
    """
    low_px, high_px = RADIUS_RANGE_PX
    if not low_px <= radius_px <= high_px:
        raise InputError(f"airy table: radius_px: must be in [{low_px}, {high_px}], got {radius_px}")
    if not 0.0 <= obscuration <= MAX_OBSCURATION:
        raise InputError(f"airy table: obscuration: must be in [0, {MAX_OBSCURATION}], got {obscuration}")

    pattern = _Pattern(radius_px / FIRST_DARK_RING, obscuration)
    # Even, so that the pixel edge is on a node.
    nodes_per_px = 2 * int(np.ceil(0.5 * NODES_PER_LAMF / pattern.lamf_px))
    reach_px = _reach_px(pattern)
    flow = _flow_profile(pattern, max_radius_px=np.sqrt(2.0) * (1.3 * reach_px + 2.0))
    share64 = _share_at_nodes(flow, nodes_per_px, reach_px)
    share32 = share64.astype(np.float32)
    share32.flags.writeable = False
    table = AiryTable(
        share=share32,
        nodes_per_px=nodes_per_px,
        reach_px=reach_px,
        wing_px3=pattern.wing_px3,
        tail_bound_px3=_tail_bound_px3(pattern, share64, nodes_per_px),
        envelope=_envelope(pattern, share64, nodes_per_px, reach_px),
        error=float("nan"),
        radius_px=radius_px,
        obscuration=obscuration,
    )
    return replace(table, error=_measured_error(table, flow))


def share(table: AiryTable, dx_px: ArrayLike, dy_px: ArrayLike) -> Floats:
    """Return the flux share of pixels: the readable twin of the device kernel, in the precision of the offsets.

    The kernel counts nodes from offset zero in float64; here they count from the pixel's edge, which is as good in
    float32. Six-point interpolation inside the table and the wing outside are the same.

    Args:
        table: The pattern.
        dx_px: Pixel centre minus source along columns [px].
        dy_px: Pixel centre minus source along rows [px]; same shape and dtype as dx_px.

    Returns:
        Shares of the unit flux; float32 if both offsets are float32, else float64.
    """
    x_px, y_px = np.abs(np.asarray(dx_px)), np.abs(np.asarray(dy_px))
    real = np.float32 if x_px.dtype == y_px.dtype == np.float32 else np.float64
    x_px, y_px = np.broadcast_arrays(x_px.astype(real), y_px.astype(real))
    inside = np.maximum(x_px, y_px) <= table.reach_px
    value = np.empty(x_px.shape, dtype=real)
    value[inside] = _interpolated(table, x_px[inside], y_px[inside])
    value[~inside] = _wing(table, x_px[~inside], y_px[~inside])
    return value


def _interpolated(table: AiryTable, dx_px: Floats, dy_px: Floats) -> Floats:
    col, weight_x = _cell_and_weights(dx_px, table.nodes_per_px)
    row, weight_y = _cell_and_weights(dy_px, table.nodes_per_px)
    total = np.zeros_like(dx_px)
    for i in range(6):
        line = np.zeros_like(dx_px)
        for j in range(6):
            line += weight_x[j] * table.share[row + i, col + j]
        total += weight_y[i] * line
    return total


def _cell_and_weights(offset_px: Floats, nodes_per_px: int) -> tuple[NDArray[np.int64], list[Floats]]:
    """Return the first of the six stored nodes around |offset| and the Lagrange weights of all six.

    P is steepest where the source crosses the pixel's edge. Counting nodes from the edge keeps float32 exact there:
    |offset| - 0.5 has no rounding near 0.5, whereas |offset| * nodes_per_px would lose 1e-8 px, which is 5e-7 of the
    flux at the smallest radius.
    """
    from_edge = (offset_px - offset_px.dtype.type(0.5)) * offset_px.dtype.type(nodes_per_px)
    cell = np.floor(from_edge)
    first = cell.astype(np.int64) + (nodes_per_px // 2 + N_MARGIN - 2)
    return first, lagrange_weights(from_edge - cell)


def lagrange_weights(t: Floats) -> list[Floats]:
    """Return the weights of the nodes -2, -1, 0, 1, 2, 3 for the value at t in [0, 1]."""
    below = t * t - 1.0  # (t - 1)(t + 1)
    beyond = t * t - 4.0  # (t - 2)(t + 2)
    return [
        t * below * (t - 2.0) * (t - 3.0) * (-1.0 / 120.0),
        t * (t - 1.0) * beyond * (t - 3.0) * (1.0 / 24.0),
        below * beyond * (t - 3.0) * (-1.0 / 12.0),
        t * (t + 1.0) * beyond * (t - 3.0) * (1.0 / 12.0),
        t * below * (t + 2.0) * (t - 3.0) * (-1.0 / 24.0),
        t * below * beyond * (1.0 / 120.0),
    ]


def _wing(table: AiryTable, dx_px: Floats, dy_px: Floats) -> Floats:
    """Ring-averaged r^-3 law averaged over the pixel: r^-3 + (1/24) laplacian(r^-3) = r^-3 (1 + 3 / (8 r^2))."""
    inv_r2 = 1.0 / (dx_px * dx_px + dy_px * dy_px)
    return dx_px.dtype.type(table.wing_px3) * inv_r2 * np.sqrt(inv_r2) * (1.0 + 0.375 * inv_r2)


@dataclass(frozen=True, slots=True)
class _Pattern:
    """An Airy pattern of unit flux."""

    lamf_px: float
    obscuration: float

    def irradiance_per_px2(self, r_px: Float64s) -> Float64s:
        """Return f(r) [1/px2]."""
        eps = self.obscuration
        v = np.pi / self.lamf_px * r_px
        amplitude = jinc(v) - eps**2 * jinc(eps * v) if eps > 0.0 else jinc(v)
        return np.pi / (4.0 * self.lamf_px**2 * (1.0 - eps**2)) * amplitude**2

    @property
    def wing_px3(self) -> float:
        """Coefficient of the ring-averaged f(r) ~ w / r^3 [px3].

        The amplitude is (2/v) [J1(v) - eps J1(eps v)]. The mean of J1(v)^2 is 1 / (pi v), that of eps^2 J1(eps v)^2 is
        eps / (pi v), and the cross term averages to zero; so w = lamF / pi^3 * (1 + eps) / (1 - eps^2).
        """
        return self.lamf_px / np.pi**3 / (1.0 - self.obscuration)

    def ripples(self) -> list[tuple[float, float]]:
        """Return (amplitude [px3], frequency [1/px]) of each term a / r^3 * cos(2 pi g r + const) left out of the wing.

        With J1(v) ~ sqrt(2 / (pi v)) cos(v - 3 pi / 4) the squares ripple as often as 2 v and 2 eps v, with the
        amplitude of their means; the cross term splits into (1 + eps) v and (1 - eps) v.
        """
        eps = self.obscuration
        unit_px3 = self.lamf_px / np.pi**3 / (1.0 - eps**2)
        frequency = 1.0 / self.lamf_px
        cross_px3 = 2.0 * np.sqrt(eps) * unit_px3
        return [
            (unit_px3, frequency),
            (eps * unit_px3, eps * frequency),
            (cross_px3, 0.5 * (1.0 - eps) * frequency),
            (cross_px3, 0.5 * (1.0 + eps) * frequency),
        ]


def _ripples_px3(pattern: _Pattern, r_px: float) -> list[float]:
    """Return r^3 times the amplitude of each ripple that survives the average over a pixel at distance r.

    Integrating across the pixel divides by pi g. Along the pixel's edge the rings stay in phase over sqrt(r / g), which
    helps near the source only. These are the amplitudes on the axes, the worst case.
    """
    return [
        amplitude_px3 * min(1.0, 1.0 / (np.pi * frequency)) * min(1.0, 1.2 * np.sqrt(r_px / frequency))
        for amplitude_px3, frequency in pattern.ripples()
        if amplitude_px3 > 0.0
    ]


def _wing_error(pattern: _Pattern, reach_px: float) -> float:
    """Return the error of the wing at the border of the table: its ripples and the next term of the r^-3 average.

    That term is (0.137 - 0.082 cos(4 angle)) w / r^7, at most 0.08 w / reach^7 on the border of the square.
    """
    ripple_px3 = float(np.linalg.norm(_ripples_px3(pattern, reach_px)))
    return ripple_px3 / reach_px**3 + 0.08 * pattern.wing_px3 / reach_px**7


def _reach_px(pattern: _Pattern) -> float:
    """Return the distance from which the wing is within WING_TOLERANCE [px], a multiple of half a pixel."""
    reach_px = MIN_REACH_PX
    while _wing_error(pattern, reach_px) > WING_TOLERANCE:
        reach_px += 0.5
    return reach_px


@dataclass(frozen=True, slots=True)
class _FlowProfile:
    """g(r) = E(r) / (2 pi r^2), where E is the encircled energy: cubic pieces on a uniform grid of r.

    The vector g(r) (x, y) has the divergence f, so Gauss' theorem turns the integral of f over a rectangle into line
    integrals of g along its edges.
    """

    pieces: Float64s
    """Coefficients of t^0 ... t^3 in each cell, shape (n_cell, 4)."""
    step_px: float

    def __call__(self, r_px: Float64s) -> Float64s:
        position = r_px * (1.0 / self.step_px)
        cell = position.astype(np.int64)
        t = position - cell
        c = self.pieces[cell]
        return ((c[..., 3] * t + c[..., 2]) * t + c[..., 1]) * t + c[..., 0]


def _flow_profile(pattern: _Pattern, max_radius_px: float) -> _FlowProfile:
    step_px = RADIAL_STEP_LAMF * pattern.lamf_px
    n_cell = int(max_radius_px / step_px) + 2
    r_px = step_px * np.arange(n_cell + 1, dtype=np.float64)
    node, weight = np.polynomial.legendre.leggauss(3)
    inner_px = (r_px[:-1, None] + 0.5 * step_px * (1.0 + node)).astype(np.float64)
    # Summing E from the centre keeps its relative accuracy, which 1 - J0^2 - J1^2 loses near r = 0.
    ring = np.pi * step_px * (pattern.irradiance_per_px2(inner_px) * inner_px) @ weight
    encircled = np.concatenate([[0.0], np.cumsum(ring)])
    irradiance = pattern.irradiance_per_px2(r_px)

    value = np.empty_like(r_px)
    value[0] = 0.5 * irradiance[0]
    value[1:] = encircled[1:] / (2.0 * np.pi * r_px[1:] ** 2)
    rise = np.zeros_like(r_px)  # step * dg/dr, from d(r^2 g)/dr = r f
    rise[1:] = step_px * (irradiance[1:] - 2.0 * value[1:]) / r_px[1:]
    jump = np.diff(value)
    pieces = np.stack(
        [value[:-1], rise[:-1], 3.0 * jump - 2.0 * rise[:-1] - rise[1:], rise[:-1] + rise[1:] - 2.0 * jump], axis=-1
    )
    return _FlowProfile(pieces, step_px)


def _share_at_nodes(flow: _FlowProfile, nodes_per_px: int, reach_px: float) -> Float64s:
    """Return P on the nodes, with the margins, shape (n, n)."""
    n_last = round(reach_px * nodes_per_px) + N_MARGIN
    half = nodes_per_px // 2
    corner = _quadrant_flux(flow, 1.0 / nodes_per_px, n_last + half)
    # The flux over [0, x] x [0, y] is odd in x and in y, which supplies the nodes left of the source.
    node = np.arange(n_last + 1)
    low, sign = np.abs(node - half), np.sign(node - half).astype(np.float64)
    strip = corner[node + half] - sign[:, None] * corner[low]
    quadrant = strip[:, node + half] - sign * strip[:, low]
    mirror = np.abs(np.arange(-N_MARGIN, n_last + 1))
    return np.asarray(quadrant[np.ix_(mirror, mirror)], dtype=np.float64)


def _quadrant_flux(flow: _FlowProfile, step_px: float, n_cell: int) -> Float64s:
    """Return the flux over [0, i step] x [0, j step] for i, j = 0 ... n_cell, shape (n_cell + 1, n_cell + 1).

    By Gauss' theorem it is x int_0^y g dy' + y int_0^x g dx': the edges through the source carry no flow.
    """
    n_extra = len(CELL_RULE)
    g = _flow_on_grid(flow, step_px, n_cell + n_extra)
    # Cell j reads the nodes j + 1 - n_extra ... j + n_extra; g is even.
    padded = np.concatenate([g[: n_cell + 1, n_extra - 1 : 0 : -1], g[: n_cell + 1]], axis=1)
    cell = np.zeros((n_cell + 1, n_cell))
    for k, weight in enumerate(CELL_RULE):
        left, right = n_extra - 1 - k, n_extra + k
        cell += weight * (padded[:, left : left + n_cell] + padded[:, right : right + n_cell])
    edge = np.zeros((n_cell + 1, n_cell + 1))
    np.cumsum(cell, axis=1, out=edge[:, 1:])
    edge *= (step_px * step_px * np.arange(n_cell + 1))[:, None]
    return edge + edge.T


def _flow_on_grid(flow: _FlowProfile, step_px: float, n_last: int) -> Float64s:
    """Return g at (i step, j step) for i, j = 0 ... n_last; evaluated for j <= i + block and mirrored."""
    g = np.empty((n_last + 1, n_last + 1))
    square = np.arange(n_last + 1, dtype=np.float64) ** 2
    block = 32
    for start in range(0, n_last + 1, block):
        stop = min(start + block, n_last + 1)
        g[start:stop, :stop] = flow(step_px * np.sqrt(square[start:stop, None] + square[:stop]))
        g[:start, start:stop] = g[start:stop, :start].T
    return g


def _cell_rule(n_pair: int) -> Float64s:
    """Return the weights of the node pairs (-k, 1 + k) of the rule on [0, 1] exact to degree 2 n_pair - 1."""
    offset = np.arange(n_pair) + 0.5  # distance of the nodes from the middle of the cell
    power = 2 * np.arange(n_pair)
    moments = 0.5**power / (power + 1.0)
    return np.linalg.solve(2.0 * offset ** power[:, None], moments)


CELL_RULE = _cell_rule(5)
"""Ten nodes: the same samples of g serve every cell, and the rule's error stays below 1e-8 at 14 nodes per lamF."""


def _tail_bound_px3(pattern: _Pattern, share64: Float64s, nodes_per_px: int) -> float:
    """Return b with P <= b / r^3 for r >= 1: the largest P r^3 on the nodes, or the wing with every ripple in phase."""
    axis_px = np.arange(share64.shape[0] - N_MARGIN) / nodes_per_px
    inner = share64[N_MARGIN:, N_MARGIN:]
    r2 = axis_px[:, None] ** 2 + axis_px**2
    near = float(np.max(np.where(r2 >= 1.0, inner * r2 * np.sqrt(r2), 0.0)))
    far = 1.1 * pattern.wing_px3 + sum(_ripples_px3(pattern, np.inf))
    return 1.02 * max(near, far)  # 2 %: what a maximum between the nodes may add


def _envelope(pattern: _Pattern, share64: Float64s, nodes_per_px: int, reach_px: float) -> NDArray[np.float32]:
    """Return the largest share of a pixel that a disc of radius k ENVELOPE_STEP_PX about the source does not touch."""
    # From the source to the pixel's nearest point; one cell more, for what lies between the nodes.
    beyond_px = np.maximum(np.arange(share64.shape[0] - N_MARGIN) / nodes_per_px - 0.5, 0.0)
    radius_px = np.hypot(beyond_px[:, None], beyond_px) + 1.0 / nodes_per_px
    n_radius = int((reach_px - 0.5) / ENVELOPE_STEP_PX) + 1
    largest = np.zeros(n_radius)
    number = np.minimum((radius_px / ENVELOPE_STEP_PX).astype(np.int64), n_radius - 1)
    np.maximum.at(largest, number.ravel(), share64[N_MARGIN:, N_MARGIN:].ravel())
    outward = np.maximum.accumulate(largest[::-1])[::-1]
    far = (1.1 * pattern.wing_px3 + sum(_ripples_px3(pattern, np.inf))) / reach_px**3
    return np.maximum(1.02 * outward, far).astype(np.float32)


def _measured_error(table: AiryTable, flow: _FlowProfile) -> float:
    """Return the largest error of the float32 scheme on offsets where it is hardest."""
    rng = np.random.default_rng(0)
    lamf_px, reach_px = table.radius_px / FIRST_DARK_RING, table.reach_px
    n = 300
    near_edge = np.minimum(0.5 + 2.0 * lamf_px * rng.uniform(-1.0, 1.0, (2, n)), reach_px)
    across_edge = np.stack([near_edge[0], rng.uniform(0.0, 0.6, n)])
    anywhere = rng.uniform(0.0, reach_px, (2, n))
    on_axis = np.stack([rng.uniform(1.0, 1.2, n) * reach_px, rng.uniform(0.0, 1.0, n)])
    outside = np.stack([rng.uniform(1.0, 1.2, n) * reach_px, rng.uniform(0.0, 1.2 * reach_px, n)])
    dx_px, dy_px = np.concatenate([near_edge, across_edge, anywhere, on_axis, outside], axis=1).astype(np.float32)
    exact = _share_by_edges(flow, dx_px.astype(np.float64), dy_px.astype(np.float64), lamf_px)
    return float(np.max(np.abs(share(table, dx_px, dy_px) - exact)))


def _share_by_edges(flow: _FlowProfile, dx_px: Float64s, dy_px: Float64s, lamf_px: float) -> Float64s:
    """Return P at any offsets by Gauss-Legendre quadrature of the outward flow along the four edges."""
    # g oscillates 1 / lamF times per pixel at most; Gauss-Legendre converges beyond pi / 2 nodes for each.
    node, weight = np.polynomial.legendre.leggauss(20 + int(1.8 / lamf_px))
    total = np.zeros_like(dx_px)
    for across_px, along_px in ((dx_px, dy_px), (dy_px, dx_px)):
        for side in (-0.5, 0.5):
            normal_px = across_px + side
            r_px = np.hypot(normal_px[:, None], along_px[:, None] + 0.5 * node)
            total += np.sign(side) * normal_px * (flow(r_px) @ (0.5 * weight))
    return total
