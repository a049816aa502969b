"""Images that sources are drawn on, several neighbouring pixels of a row at a time, and flags of what has got light.

A vector of pixels is loaded, added to and stored whole, which the CPU compiler turns into a few wide instructions;
pixels of it that a stamp does not cover get 0 added. Where a vector would leave its row, its pixels are drawn one by
one: a thread touches no pixel of rows that others own.

For the read-out an image is cut into strips of neighbouring pixels, counted along its rows and over their ends. A strip
is what one tile takes, a block the strips that share random keys (random_numbers.py). Every strip has a flag that says
whether light was added to it; an image has flags for whole blocks.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

N_PAIR = 64
"""Pixel pairs of a strip, the width of a tile: at this width the CPU compiler keeps all of it in vector registers."""

STRIP_PIXELS = 2 * N_PAIR
STRIPS_PER_BLOCK = 16
PAIRS_PER_BLOCK = N_PAIR * STRIPS_PER_BLOCK

STRIP_SHIFT = wp.constant(STRIP_PIXELS.bit_length() - 1)
"""A pixel's number shifted by so many bits is that of its strip."""

_BLOCK_SHIFT = STRIP_SHIFT + STRIPS_PER_BLOCK.bit_length() - 1


def n_flag(n_pixel: int) -> int:
    """Flags of an image."""
    return -(-n_pixel // (STRIP_PIXELS * STRIPS_PER_BLOCK)) * STRIPS_PER_BLOCK


@wp.func
def flags_of_image(n_pixel: int) -> int:
    """Flags of an image, in a kernel."""
    return (((n_pixel - 1) >> _BLOCK_SHIFT) + 1) * STRIPS_PER_BLOCK


def mask_table(simd_width: int) -> tuple[float, ...]:
    """Return the floats that flat tables of Gaussians begin with: vectors of them are 1 in some elements, else 0."""
    return (0.0,) * simd_width + (1.0,) * simd_width + (0.0,) * simd_width


class CanvasFunctions(NamedTuple):
    """Functions that draw simd_width pixels of an image at a time."""

    PixelVector: Any
    """Vector of simd_width floats. Signal and tables come as arrays of such vectors that overlap: one begins at every
    float."""

    Images: Any
    """Struct: all images of a launch."""

    Canvas: Any
    """Struct: one of them."""

    canvas_of: Any
    """(images, image: int) -> canvas."""

    mask_between: Any
    """(tables, first: int, end: int) -> vector: 1 in the elements from first up to end, else 0; tables begin with
    mask_table."""

    add_light: Any
    """(canvas, row: int, vector: int, light, first: int, end: int): add to pixels of a row from the column `vector` on;
    light is 0 but in the elements from first up to end."""

    flag_strips: Any
    """(canvas, row: int, first: int, end: int): flag the strips of the columns of a row from first up to end."""


@functools.cache
def canvas_functions(simd_width: int) -> CanvasFunctions:
    """Return the functions that draw simd_width pixels at a time."""
    PixelVector = wp.types.vector(length=simd_width, dtype=wp.float32)

    class Images:
        pixels: wp.array[float]  # (n_image * n_row * n_col,)
        vectors: wp.array[PixelVector]  # the same, with a vector from every pixel on
        touched: wp.array[wp.uint8]  # (n_image * n_flag,) 1 for a strip that light was added to
        n_row: int
        n_col: int
        n_row_per_block: int  # rows that one thread owns

    class Canvas:
        pixels: wp.array[float]  # of all images, flat
        vectors: wp.array[PixelVector]  # the same, with a vector from every pixel on
        touched: wp.array[wp.uint8]  # flags of all images, flat: 1 for a strip that light was added to
        first: int  # index of the image's first pixel in pixels
        first_strip: int  # index of its first flag in touched
        n_row: int
        n_col: int

    images_type, canvas_type = wp.struct(Images), wp.struct(Canvas)

    @wp.func
    def canvas_of(images: images_type, image: int) -> canvas_type:
        canvas = canvas_type()
        canvas.pixels = images.pixels
        canvas.vectors = images.vectors
        canvas.touched = images.touched
        canvas.first = image * images.n_row * images.n_col
        canvas.first_strip = image * flags_of_image(images.n_row * images.n_col)
        canvas.n_row = images.n_row
        canvas.n_col = images.n_col
        return canvas

    @wp.func
    def mask_between(tables: wp.array[PixelVector], first: int, end: int) -> PixelVector:
        return wp.cw_mul(tables[wp.static(simd_width) - first], tables[wp.static(2 * simd_width) - end])

    @wp.func
    def add_light(canvas: canvas_type, row: int, vector: int, light: PixelVector, first: int, end: int):
        pixel = canvas.first + row * canvas.n_col + vector
        if vector >= 0 and vector + wp.static(simd_width) <= canvas.n_col:
            canvas.vectors[pixel] = canvas.vectors[pixel] + light
        else:
            for i in range(first, end):
                canvas.pixels[pixel + i] = canvas.pixels[pixel + i] + light[i]

    @wp.func
    def flag_strips(canvas: canvas_type, row: int, first: int, end: int):
        if first < end:
            begin = row * canvas.n_col
            strip = canvas.first_strip + ((begin + first) >> STRIP_SHIFT)
            last = canvas.first_strip + ((begin + end - 1) >> STRIP_SHIFT)
            canvas.touched[last] = wp.uint8(1)
            while strip < last:
                canvas.touched[strip] = wp.uint8(1)
                strip += 1

    return CanvasFunctions(PixelVector, images_type, canvas_type, canvas_of, mask_between, add_light, flag_strips)
