"""Which random words belong to what: every draw of a read-out is a pure function of seed, place and purpose.

Philox4x32 keyed by the seed, with counter (frame, sensor, band, stream), yields a key; Philox2x32 with that key and a
number (of the pixel pair, of the column) yields 64 bits. Any frame is therefore the same alone, in any batch, on any
worker. What stays with a pixel from frame to frame has a stream of its own, in which the frame is always 0.
"""

import warp as wp

from warpsim_kernels.philox import philox4x32

STREAM_READ_NOISE = wp.constant(wp.uint32(1))
"""Noise of each frame; 2 is that of the jitter (jitter.py), which has the same key."""
STREAM_PATTERN = wp.constant(wp.uint32(3))
"""What stays with a pixel: its gain, its offset, and whether it is bad."""
STREAM_COLUMN = wp.constant(wp.uint32(4))
"""Noise that the pixels of a column share."""
STREAM_TEMPLATE = wp.constant(wp.uint32(5))
"""Deviates that are made once and used again."""

OFFSET_PAIRS = wp.constant(wp.uint32(0x40000000))
BAD_PAIRS = wp.constant(wp.uint32(0x80000000))
"""Added to the number of a pixel pair, which is below 2**28, for further words with the key of the pattern."""


UNIFORM_PAIRS = wp.constant(wp.uint32(0x40000000))
"""Added likewise, for further words with the key of the noise: uniforms of pixels with few electrons. They must not be
those that the pixel's neighbour, which may have many electrons, makes a normal deviate of."""


@wp.func
def image_key(
    frame: wp.uint32, sensor: wp.uint32, band: wp.uint32, stream: wp.uint32, seed_low: wp.uint32, seed_high: wp.uint32
) -> wp.vec4ui:
    """Random words that belong to one image and one stream."""
    return philox4x32(wp.vec4ui(frame, sensor, band, stream), seed_low, seed_high)


@wp.func
def numbered(lane: wp.uint32, first: wp.uint32) -> wp.uint32:
    """Number of a lane of a tile."""
    return lane + first


@wp.func
def column_of(pixel: wp.uint32, n_col: wp.uint32, per_col: wp.float64) -> wp.uint32:
    """Column of a pixel of an image; in float64, as whole numbers are not divided in vector instructions."""
    row = wp.uint32(wp.floor((wp.float64(pixel) + wp.float64(0.5)) * per_col))
    return pixel - row * n_col


@wp.func
def template_place(word: wp.uint32, n_deviate: int, pixel: int) -> int:
    """Where in the template a pixel of an image finds its deviate; the image starts at a random place."""
    start = (wp.uint64(word) * wp.uint64(n_deviate)) >> wp.uint64(32)
    return int((start + wp.uint64(pixel)) % wp.uint64(n_deviate))


@wp.func
def sign_of(word: wp.uint32) -> float:
    """-1 or 1 by a random word."""
    return 1.0 - 2.0 * float(wp.int32(word & wp.uint32(1)))
