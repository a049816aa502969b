"""Strips of an image for the read-out: neighbouring pixels, counted along its rows and over their ends.

A strip is what one tile takes, a block the strips that share random keys (streams.py). Every strip has a flag that says
whether light was added to it; an image has flags for whole blocks.
"""

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
