"""Movement and change of brightness of point sources during an exposure.

Over the exposure, time runs as t in [-1, 1]. Position and brightness are series of Legendre polynomials in t; a source
that stands still at constant light has none of them.
"""

import warp as wp


@wp.struct
class Paths:
    """Movement and change of brightness of a chunk's sources over the exposure; empty arrays where nothing moves."""

    offset_px: wp.array3d[wp.vec2]  # (n_view, n_slot, n_path) position minus the source's xy_px: coefficients
    brightness: wp.array4d[float]  # (n_view, n_band, n_target, n_profile) over the mean (first is 1); stars: constant
    n_target: int  # slots before stars begin
