"""Which cells of the star index a cone on the sky touches.

The index cuts the sky into 180 latitude bands of one degree. Bands below 60 degrees latitude hold 360 cells of one
degree of right ascension each; every band above is one cell. Cells are numbered row by row, so the cells of a band
between two columns are one run of stars.
"""

import warp as wp

N_BAND = wp.constant(180)
N_COLUMN = wp.constant(360)
POLAR_LATITUDE_DEG = wp.constant(60)

_HALF_PI = wp.constant(wp.float64(1.5707963267948966))
_DEGREE = wp.constant(wp.float64(0.017453292519943295))
_SLACK = wp.constant(wp.float64(1.0e-9))  # rad; covers rounding of angles at cell borders


@wp.struct
class ConeCover:
    """Latitude bands and right-ascension window that contain a cone."""

    first_band: int
    last_band: int
    first_column: int
    n_column: int  # columns from first_column on, wrapping at 360


@wp.func
def cone_cover(direction: wp.vec3d, radius_rad: wp.float64) -> ConeCover:
    """Cells that may hold stars within radius_rad of a unit direction; never too few."""
    radius = radius_rad + _SLACK
    latitude = wp.asin(wp.clamp(direction[2], wp.float64(-1.0), wp.float64(1.0)))
    south = wp.float64(90.0) + (latitude - radius) / _DEGREE
    north = wp.float64(90.0) + (latitude + radius) / _DEGREE
    cover = ConeCover()
    cover.first_band = wp.clamp(int(wp.floor(south)), 0, N_BAND - 1)
    cover.last_band = wp.clamp(int(wp.floor(north)), 0, N_BAND - 1)
    cover.first_column = 0
    cover.n_column = N_COLUMN
    if wp.abs(latitude) + radius < _HALF_PI:
        # No pole inside: the cone's widest half-width in right ascension.
        half_width = wp.asin(wp.min(wp.sin(radius) / wp.cos(latitude), wp.float64(1.0))) + _SLACK
        longitude = wp.atan2(direction[1], direction[0])
        west = (longitude - half_width) / _DEGREE
        east = (longitude + half_width) / _DEGREE
        first = int(wp.floor(west))
        cover.n_column = wp.min(int(wp.floor(east)) - first + 1, N_COLUMN)
        cover.first_column = ((first % N_COLUMN) + N_COLUMN) % N_COLUMN
    return cover


@wp.func
def is_polar(band: int) -> bool:
    """True for bands above 60 degrees latitude, which are one cell."""
    return band < 90 - POLAR_LATITUDE_DEG or band >= 90 + POLAR_LATITUDE_DEG


@wp.func
def run_begin(cell_start: wp.array[wp.int32], band: int, cover: ConeCover, part: int) -> int:
    """First star of a band's run; part 0 is the run up to column 359, part 1 what wraps to column 0."""
    if is_polar(band) or part == 1:
        return cell_start[band * N_COLUMN]
    return cell_start[band * N_COLUMN + cover.first_column]


@wp.func
def run_end(cell_start: wp.array[wp.int32], band: int, cover: ConeCover, part: int) -> int:
    """One past the last star of a band's run (see run_begin); part 1 is empty without a wrap."""
    beyond = cover.first_column + cover.n_column
    if is_polar(band):
        if part == 1:
            return cell_start[band * N_COLUMN]
        return cell_start[(band + 1) * N_COLUMN]
    if part == 0:
        return cell_start[band * N_COLUMN + wp.min(beyond, N_COLUMN)]
    return cell_start[band * N_COLUMN + wp.max(beyond - N_COLUMN, 0)]


@wp.func
def angle_between(a: wp.vec3d, b: wp.vec3d) -> wp.float64:
    """Angle between unit vectors [rad], accurate at 0 and at 180 degrees."""
    return wp.float64(2.0) * wp.atan2(wp.length(a - b), wp.length(a + b))


@wp.kernel(enable_backward=False)
def query_cone_kernel(
    # in
    cell_start: wp.array[wp.int32],  # (180 * 360 + 1,)
    star_direction: wp.array[wp.vec3d],  # (n_star,) in cell order
    cone_direction: wp.array[wp.vec3d],  # (n_cone,) unit
    cone_radius_rad: wp.array[wp.float64],  # (n_cone,)
    found_start: wp.array[wp.int64],  # (n_cone,) where each cone's list begins in `found`
    # out
    n_found: wp.array[wp.int32],  # (n_cone,)
    found: wp.array[wp.int32],  # stars in cell order; may be empty: then stars are only counted
):
    """Stars inside each cone, one thread per cone, in cell order."""
    cone = wp.tid()
    direction = cone_direction[cone]
    radius = cone_radius_rad[cone]
    cover = cone_cover(direction, radius)
    n = int(0)
    for band in range(cover.first_band, cover.last_band + 1):
        for part in range(2):
            for star in range(run_begin(cell_start, band, cover, part), run_end(cell_start, band, cover, part)):
                if angle_between(star_direction[star], direction) <= radius:
                    if found.shape[0] > 0:
                        found[int(found_start[cone]) + n] = star
                    n += 1
    n_found[cone] = n
