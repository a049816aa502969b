"""Images that sources are drawn on, several neighbouring pixels of a row at a time, and flags of what has got light.

A vector of pixels is loaded, added to and stored whole, which the CPU compiler turns into a few wide instructions;
pixels of it that a stamp does not cover get 0 added. Where a vector would leave its row, its pixels are drawn one by
one: a thread touches no pixel of rows that others own.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from warpsim_kernels.strips import STRIP_SHIFT, flags_of_image


def lane_mask(n_lane: int) -> tuple[float, ...]:
    """What flat arrays of tables begin with: vectors of n_lane from it are 1 in some lanes, and 0 in the others."""
    return (0.0,) * n_lane + (1.0,) * n_lane + (0.0,) * n_lane


class CanvasFunctions(NamedTuple):
    """How n_lane pixels of an image are drawn at a time."""

    Lanes: Any
    """Vector of n_lane floats. Signal and tables come as arrays of such vectors that overlap: one begins at every
    float."""

    Images: Any
    """Struct: all images of a launch."""

    Canvas: Any
    """Struct: one of them."""

    canvas_of: Any
    """(images, image: int) -> canvas."""

    lanes_between: Any
    """(tables, first: int, end: int) -> 1 in the lanes from the first up to the end, else 0; tables begin with
    lane_mask."""

    add_light: Any
    """(canvas, row: int, vector: int, light, first: int, end: int): add to pixels of a row from the column `vector` on;
    light is 0 but in the lanes from first up to end."""

    flag_strips: Any
    """(canvas, row: int, first: int, end: int): flag the strips of the columns of a row from first up to end."""


@functools.cache
def canvas_functions(n_lane: int) -> CanvasFunctions:
    """The functions that draw n_lane pixels at a time."""
    Lanes = wp.types.vector(length=n_lane, dtype=wp.float32)

    class Images:
        pixels: wp.array[float]  # (n_image * n_row * n_col,)
        lanes: wp.array[Lanes]  # the same, with a vector from every pixel on
        lit: wp.array[wp.uint8]  # (n_image * n_flag,) 1 for a strip that light was added to
        n_row: int
        n_col: int
        n_row_per_block: int  # rows that one thread owns

    class Canvas:
        pixels: wp.array[float]  # of all images, flat
        lanes: wp.array[Lanes]  # the same, with a vector from every pixel on
        lit: wp.array[wp.uint8]  # flags of all images, flat: 1 for a strip that light was added to
        first: int  # where the image begins in pixels
        first_strip: int  # where it begins in lit
        n_row: int
        n_col: int

    images_type, canvas_type = wp.struct(Images), wp.struct(Canvas)

    @wp.func
    def canvas_of(images: images_type, image: int) -> canvas_type:
        canvas = canvas_type()
        canvas.pixels = images.pixels
        canvas.lanes = images.lanes
        canvas.lit = images.lit
        canvas.first = image * images.n_row * images.n_col
        canvas.first_strip = image * flags_of_image(images.n_row * images.n_col)
        canvas.n_row = images.n_row
        canvas.n_col = images.n_col
        return canvas

    @wp.func
    def lanes_between(tables: wp.array[Lanes], first: int, end: int) -> Lanes:
        return wp.cw_mul(tables[wp.static(n_lane) - first], tables[wp.static(2 * n_lane) - end])

    @wp.func
    def add_light(canvas: canvas_type, row: int, vector: int, light: Lanes, first: int, end: int):
        pixel = canvas.first + row * canvas.n_col + vector
        if vector >= 0 and vector + wp.static(n_lane) <= canvas.n_col:
            canvas.lanes[pixel] = canvas.lanes[pixel] + light
        else:
            for lane in range(first, end):
                canvas.pixels[pixel + lane] = canvas.pixels[pixel + lane] + light[lane]

    @wp.func
    def flag_strips(canvas: canvas_type, row: int, first: int, end: int):
        if first < end:
            begin = row * canvas.n_col
            strip = canvas.first_strip + ((begin + first) >> STRIP_SHIFT)
            last = canvas.first_strip + ((begin + end - 1) >> STRIP_SHIFT)
            canvas.lit[last] = wp.uint8(1)
            while strip < last:
                canvas.lit[strip] = wp.uint8(1)
                strip += 1

    return CanvasFunctions(Lanes, images_type, canvas_type, canvas_of, lanes_between, add_light, flag_strips)
