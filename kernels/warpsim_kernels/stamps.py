"""Stamps: the pixels that a point source is drawn on, those that a disc about it touches.

The disc's radius, a source's reach, follows from its brightness: a pixel that the disc does not touch holds less of
the source's light than the rule lets go. Discs, since the wings of a bright source are round.
"""

import warp as wp

FAR_PX = wp.constant(1.0e7)
"""No reach is longer: with pixel numbers of 1e9 it stays well within 32 bits."""

ROUND_FROM_PX = wp.constant(4.0)
"""Discs of a shorter reach keep the corners of their square: drawing them is cheaper than finding each row's ends."""


@wp.struct
class StampRule:
    """Part of a source that may be left out of its stamp, per pixel: the larger of the two limits."""

    cut_w_cm2: wp.array[float]  # (n_band,) absolute
    cut_fraction: float  # relative to the source's irradiance
    streak_error: float  # the same for the error of a streak's quadrature in time; the larger of it and the stamp's cut


@wp.func
def stamp_cut(irradiance_w_cm2: float, band: int, rule: StampRule) -> float:
    """Largest fraction of a source that a pixel outside its stamp may hold; 1 for a source without light."""
    strength = wp.abs(irradiance_w_cm2)
    cut_w_cm2 = rule.cut_w_cm2[band]
    if strength * rule.cut_fraction >= cut_w_cm2:
        return rule.cut_fraction
    if strength <= cut_w_cm2:
        return 1.0
    return cut_w_cm2 / strength


@wp.func
def nearest_pixel(position_px: wp.float64) -> int:
    """The pixel that holds a coordinate; a point on an edge belongs to the pixel after it."""
    return int(wp.floor(position_px + wp.float64(0.5)))


@wp.struct
class Window:
    """A rectangle of pixels; the ends are one past the last."""

    first_column: int
    end_column: int
    first_row: int
    end_row: int


@wp.func
def whole_image(n_row: int, n_col: int) -> Window:
    """All pixels of an image."""
    window = Window()
    window.first_column = 0
    window.end_column = n_col
    window.first_row = 0
    window.end_row = n_row
    return window


@wp.func
def block_window(n_row: int, n_col: int, block: int, n_row_per_block: int) -> Window:
    """The rows of an image that the thread of a block owns."""
    window = whole_image(n_row, n_col)
    window.first_row = block * n_row_per_block
    window.end_row = wp.min(window.first_row + n_row_per_block, n_row)
    return window


@wp.func
def whole_plane() -> Window:
    """All pixels that a stamp may reach."""
    window = Window()
    window.first_column = -2000000000
    window.end_column = 2000000000
    window.first_row = -2000000000
    window.end_row = 2000000000
    return window


@wp.func
def part_near(window: Window, one_px: wp.vec2d, other_px: wp.vec2d, margin_px: wp.vec2d) -> Window:
    """The part of a window within a box about two points, with a margin."""
    low = wp.min(one_px, other_px) - margin_px
    high = wp.max(one_px, other_px) + margin_px
    part = Window()
    part.first_column = clamped(low[0], window.first_column, window.end_column)
    part.end_column = clamped(high[0], part.first_column, window.end_column)
    part.first_row = clamped(low[1], window.first_row, window.end_row)
    part.end_row = clamped(high[1], part.first_row, window.end_row)
    return part


@wp.func
def clamped(position_px: wp.float64, lowest: int, highest: int) -> int:
    """The first whole number after a coordinate, within bounds."""
    return int(wp.ceil(wp.clamp(position_px, wp.float64(lowest), wp.float64(highest))))


@wp.func
def touches(window: Window, xy_px: wp.vec2d, reach_px: wp.vec2d) -> bool:
    """Return whether a box of half-widths reach_px about a point meets the window; false for a point that is NaN."""
    half = wp.float64(0.5)
    return (
        xy_px[0] + reach_px[0] >= wp.float64(window.first_column) - half
        and xy_px[0] - reach_px[0] <= wp.float64(window.end_column) - half
        and xy_px[1] + reach_px[1] >= wp.float64(window.first_row) - half
        and xy_px[1] - reach_px[1] <= wp.float64(window.end_row) - half
    )


@wp.struct
class Stamp:
    """The pixels within a window that a disc about a source touches."""

    column: int  # of the pixel that holds the source
    row: int
    dx_px: float  # that pixel's centre minus the source, in [-1/2, 1/2]
    dy_px: float  # in pixel heights
    reach_px: float  # radius of the disc, in pixel widths
    aspect: float  # height of a pixel over its width
    window: Window  # rows: those of the stamp; columns: those that may be drawn on


@wp.func
def stamp_around(xy_px: wp.vec2d, reach_px: float, aspect: float, window: Window) -> Stamp:
    """The stamp of a source; it has no rows where the disc lies outside the window."""
    stamp = Stamp()
    stamp.window = window
    reach_row_px = reach_px / aspect
    # A row more: which rows a disc touches follows from the same rounding below, whatever the window.
    if touches(window, xy_px, wp.vec2d(wp.float64(reach_px + 1.0), wp.float64(reach_row_px + 1.0))):
        stamp.column = nearest_pixel(xy_px[0])
        stamp.row = nearest_pixel(xy_px[1])
        stamp.dx_px = float(wp.float64(stamp.column) - xy_px[0])
        stamp.dy_px = float(wp.float64(stamp.row) - xy_px[1])
        stamp.reach_px = reach_px
        stamp.aspect = aspect
        stamp.window.first_row = wp.max(stamp.row - int(reach_row_px + 0.5 + stamp.dy_px), window.first_row)
        stamp.window.end_row = wp.min(stamp.row + int(reach_row_px + 0.5 - stamp.dy_px) + 1, window.end_row)
    else:
        stamp.window.end_row = window.first_row
    return stamp


@wp.func
def columns_of_row(stamp: Stamp, row: int) -> wp.vec2i:
    """First column, and one past the last, that the stamp has in one of its rows."""
    across = stamp.reach_px + 0.5
    if stamp.reach_px > ROUND_FROM_PX:
        down = wp.max(wp.abs(float(row - stamp.row) + stamp.dy_px) - 0.5, 0.0) * stamp.aspect
        across = wp.sqrt(wp.max(stamp.reach_px * stamp.reach_px - down * down, 0.0)) + 0.5
    first = stamp.column - int(across + stamp.dx_px)
    end = stamp.column + int(across - stamp.dx_px) + 1
    return wp.vec2i(wp.max(first, stamp.window.first_column), wp.min(end, stamp.window.end_column))
