"""Stars of the index that a cone on the sky may hold.

The index cuts the sky into 180 latitude bands of one degree. Bands below 60 degrees latitude hold 360 cells of one
degree of right ascension each; every band above is one cell. Stars are sorted by band, and by right ascension within
it, so the stars of a band between two right ascensions are one run. The cells say where it is to a degree, and a long
run is narrowed by bisection.
"""

import functools
from typing import Any

import warp as wp

N_BAND = wp.constant(180)
N_COLUMN = wp.constant(360)
POLAR_LATITUDE_DEG = wp.constant(60)

_HALF_PI = wp.constant(wp.float64(1.5707963267948966))
_DEGREE = wp.constant(wp.float64(0.017453292519943295))
_SLACK = wp.constant(wp.float64(1.0e-9))  # rad; covers rounding of angles at the borders of cells and windows
_UNSURE = wp.constant(wp.float64(1.0e-14))  # cosines this close cannot tell the sides of a cone's rim
_LONG_RUN = wp.constant(24)  # stars; bisection pays from here


@wp.struct
class ConeCover:
    """Latitude bands and right-ascension window that contain a cone."""

    first_band: int
    last_band: int
    west_deg: wp.float64  # in [0, 360)
    east_deg: wp.float64  # west_deg ... west_deg + 360: beyond 360 the window goes on at 0


@wp.func
def cone_cover(direction: wp.vec3d, radius_rad: wp.float64) -> ConeCover:
    """Bands and window that may hold stars within radius_rad of a unit direction; never too few."""
    turn = wp.float64(360.0)
    radius = radius_rad + _SLACK
    latitude = wp.asin(wp.clamp(direction[2], wp.float64(-1.0), wp.float64(1.0)))
    south = wp.float64(90.0) + (latitude - radius) / _DEGREE
    north = wp.float64(90.0) + (latitude + radius) / _DEGREE
    cover = ConeCover()
    cover.first_band = wp.clamp(int(wp.floor(south)), 0, N_BAND - 1)
    cover.last_band = wp.clamp(int(wp.floor(north)), 0, N_BAND - 1)
    cover.west_deg = wp.float64(0.0)
    cover.east_deg = turn
    if wp.abs(latitude) + radius < _HALF_PI:
        # No pole inside: the cone's widest half-width in right ascension.
        half_width = wp.asin(wp.min(wp.sin(radius) / wp.cos(latitude), wp.float64(1.0))) + _SLACK
        west = (wp.atan2(direction[1], direction[0]) - half_width) / _DEGREE
        west = west - turn * wp.floor(west / turn)
        if west >= turn:  # a tiny negative angle plus 360 rounds to 360
            west = wp.float64(0.0)
        cover.west_deg = west
        cover.east_deg = west + wp.min(wp.float64(2.0) * half_width / _DEGREE, turn)
    return cover


@wp.func
def is_polar(band: int) -> bool:
    """True for bands above 60 degrees latitude, which are one cell."""
    return band < 90 - POLAR_LATITUDE_DEG or band >= 90 + POLAR_LATITUDE_DEG


@wp.func
def compass(x: wp.float64, y: wp.float64) -> wp.float64:
    """A number in [0, 4] that grows with the right ascension of (x, y): cheap to get, and rounded alike everywhere."""
    total = wp.abs(x) + wp.abs(y)
    if total == wp.float64(0.0):
        return wp.float64(0.0)
    if y >= wp.float64(0.0):
        if x >= wp.float64(0.0):
            return y / total
        return wp.float64(1.0) - x / total
    if x < wp.float64(0.0):
        return wp.float64(2.0) - y / total
    return wp.float64(3.0) + x / total


@wp.func
def first_east_of(star_direction: wp.array[Any], begin: int, end: int, ra_deg: wp.float64) -> int:
    """First star of a run [begin, end) that does not lie west of a right ascension in [0, 360]; end if all do."""
    ra_rad = ra_deg * _DEGREE
    border = compass(wp.cos(ra_rad), wp.sin(ra_rad))
    low = begin
    high = end
    while low < high:
        middle = (low + high) // 2
        star = star_direction[middle]
        if compass(wp.float64(star[0]), wp.float64(star[1])) < border:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def run_of_stars(
    cell_start: wp.array[wp.int32], star_direction: wp.array[Any], band: int, cover: ConeCover, part: int
) -> wp.vec2i:
    """Stars [begin, end) of a band inside the window; part 0 lies below right ascension 360, part 1 goes on from 0.

    Runs may hold some stars outside the window, but the two parts have none in common.
    """
    turn = wp.float64(360.0)
    beyond = cover.east_deg - turn
    if part == 1 and beyond <= wp.float64(0.0):
        return wp.vec2i(0, 0)
    row = band * N_COLUMN
    first = cell_start[row]
    last = cell_start[row + N_COLUMN]
    begin = first
    end = last
    if not is_polar(band):
        begin = cell_start[row + int(wp.floor(cover.west_deg))]
        end = cell_start[row + wp.min(int(wp.ceil(cover.east_deg)), N_COLUMN)]
    if end - begin > _LONG_RUN and cover.west_deg > wp.float64(0.0):
        begin = first_east_of(star_direction, begin, end, cover.west_deg)
    if part == 0:
        if end - begin > _LONG_RUN and beyond < wp.float64(0.0):
            end = first_east_of(star_direction, begin, end, cover.east_deg)
        return wp.vec2i(begin, end)
    if not is_polar(band):
        last = cell_start[row + int(wp.ceil(beyond))]
    if last - first > _LONG_RUN:
        last = first_east_of(star_direction, first, last, beyond)
    return wp.vec2i(first, wp.min(last, begin))


@wp.func
def angle_between(a: wp.vec3d, b: wp.vec3d) -> wp.float64:
    """Angle between unit vectors [rad], accurate at 0 and at 180 degrees."""
    return wp.float64(2.0) * wp.atan2(wp.length(a - b), wp.length(a + b))


@functools.cache
def make_query_cone_kernel(direction_type: Any) -> wp.Kernel:
    """Kernel that lists the stars inside cones, for directions stored as wp.vec3d or wp.vec3f."""
    single = direction_type is not wp.vec3d

    @wp.kernel(module="unique", enable_backward=False)
    def query_cone_kernel(
        # in
        cell_start: wp.array[wp.int32],  # (180 * 360 + 1,)
        star_direction: wp.array[direction_type],  # (n_star,) in cell order
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
        rim = wp.cos(radius)
        cover = cone_cover(direction, radius)
        n = int(0)
        for band in range(cover.first_band, cover.last_band + 1):
            for part in range(2):
                run = run_of_stars(cell_start, star_direction, band, cover, part)
                for star in range(run[0], run[1]):
                    place = wp.vec3d(star_direction[star])
                    if wp.static(single):
                        place = wp.normalize(place)
                    above = wp.dot(place, direction) - rim
                    inside = above > wp.float64(0.0)
                    if wp.abs(above) < _UNSURE:
                        inside = angle_between(place, direction) <= radius
                    if inside:
                        if found.shape[0] > 0:
                            found[int(found_start[cone]) + n] = star
                        n += 1
        n_found[cone] = n

    return query_cone_kernel
