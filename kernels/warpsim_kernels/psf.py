"""Shares of a point source's light that single pixels collect, and how wide a stamp has to be.

A pixel integrates the point spread function over its area; sampling at the pixel centre would be wrong by factors
where the blur is smaller than a pixel.
"""

import warp as wp

MAX_HALF_WIDTH_PX = wp.constant(511)
"""Widest stamp: 511 pixels to each side of the source's own pixel."""

NODE_MARGIN = wp.constant(3)
"""Table nodes before offset zero, so that six-point interpolation never leaves the table."""

_SQRT_HALF = wp.constant(0.7071067811865476)

vec6 = wp.types.vector(length=6, dtype=wp.float32)


@wp.func
def gaussian_pixel_share(offset_px: wp.float64, sigma_px: float) -> float:
    """Part of a unit one-dimensional Gaussian inside the pixel whose centre is offset_px from the source.

    Both edges are measured from the source in float64 first; on the far side the complementary error function keeps
    the tail's leading digits (the paper's Eq. 7, integrated over the pixel).
    """
    centre = wp.abs(offset_px)
    scale = _SQRT_HALF / sigma_px
    near = float(centre - wp.float64(0.5)) * scale
    far = float(centre + wp.float64(0.5)) * scale
    if near > 0.5:
        return 0.5 * (wp.erfc(near) - wp.erfc(far))
    return 0.5 * (wp.erf(far) - wp.erf(near))


@wp.func
def gaussian_half_width_px(sigma_px: float, cut: float) -> int:
    """Stamp half-width beyond which no pixel holds more than the fraction `cut` of the flux.

    A pixel left out begins at least half_width from the source, so it holds less than exp(-half_width^2/2 sigma^2)/2.
    """
    if cut >= 0.5:
        return 0
    return wp.min(int(wp.ceil(sigma_px * wp.sqrt(-2.0 * wp.log(2.0 * cut)))), MAX_HALF_WIDTH_PX)


@wp.struct
class TablePsf:
    """A radial point spread function as a table of pixel shares over (|dy|, |dx|), with a power law beyond it."""

    start: int  # where the table begins in the flat array of all bands
    n_node: int  # nodes per axis
    nodes_per_px: int
    reach_px: float  # offsets up to here lie inside the table
    wing_px3: float  # share = wing / r^3 * (1 + 3 / (8 r^2)) beyond
    tail_px3: float  # share <= tail / r^3 for r >= 1


@wp.func
def table_half_width_px(psf: TablePsf, cut: float) -> int:
    """Stamp half-width beyond which no pixel holds more than the fraction `cut` of the flux."""
    if cut >= 1.0:
        return 0
    # The centre of a pixel left out is at least half_width + 1/2 from the source.
    reach = wp.pow(psf.tail_px3 / cut, wp.static(1.0 / 3.0)) - 0.5
    return wp.clamp(int(wp.ceil(wp.min(reach, 1.0e6))), 1, MAX_HALF_WIDTH_PX)


@wp.func
def six_point_weights(u: float) -> vec6:
    """Lagrange weights of nodes -2 ... 3 at the point u in [0, 1]."""
    a = u + 2.0
    b = u + 1.0
    d = u - 1.0
    e = u - 2.0
    g = u - 3.0
    deg = d * e * g
    abu = a * b * u
    return vec6(
        b * u * deg * wp.static(-1.0 / 120.0),
        a * u * deg * wp.static(1.0 / 24.0),
        a * b * deg * wp.static(-1.0 / 12.0),
        abu * e * g * wp.static(1.0 / 12.0),
        abu * d * g * wp.static(-1.0 / 24.0),
        abu * d * e * wp.static(1.0 / 120.0),
    )


@wp.struct
class TableAxis:
    """Interpolation along one axis of the table."""

    distance_px: wp.float64
    first: int  # first of the six nodes
    weights: vec6


@wp.func
def table_axis(offset_px: wp.float64, psf: TablePsf) -> TableAxis:
    """Nodes and weights for a pixel offset along one axis."""
    axis = TableAxis()
    axis.distance_px = wp.abs(offset_px)
    position = axis.distance_px * wp.float64(psf.nodes_per_px)
    node = wp.min(int(position), psf.n_node - 2 * NODE_MARGIN - 1)
    axis.first = node + NODE_MARGIN - 2
    axis.weights = six_point_weights(float(position - wp.float64(node)))
    return axis


@wp.func
def table_pixel_share(table: wp.array[float], psf: TablePsf, row: TableAxis, column: TableAxis) -> float:
    """Share of the pixel at the offsets that row and column were made for."""
    if wp.max(row.distance_px, column.distance_px) > wp.float64(psf.reach_px):
        inverse2 = 1.0 / float(row.distance_px * row.distance_px + column.distance_px * column.distance_px)
        return psf.wing_px3 * inverse2 * wp.sqrt(inverse2) * (1.0 + 0.375 * inverse2)
    share = float(0.0)
    for j in range(6):
        begin = psf.start + (row.first + j) * psf.n_node + column.first
        line = float(0.0)
        for i in range(6):
            line += column.weights[i] * table[begin + i]
        share += row.weights[j] * line
    return share
