"""Random words of a read-out: every draw is a pure function of sensor, frame, band, pixel and purpose.

Two levels. Philox4x32 keyed by the sensor's own 64 bits, with counter (frame, band, stream and block of pixels), yields
four keys; a short hash with two of them turns the number of a pixel pair within the block into 32 bits. Any frame is
therefore the same alone, in any batch, on any worker. What stays with a pixel from frame to frame has streams of its
own, in which the frame is always 0.

The hash multiplies the number by one key and adds the other, which makes any two words of a block independent, and
then mixes so that more of them are; it is a bijection of 32 bits. A block asks it for a thousand words only and has
keys of its own, so that words of an image may repeat. Tests count both in 1e9 draws.
"""

import warp as wp

from warpsim_kernels.philox import philox4x32

STREAM_NOISE = wp.constant(wp.uint32(1))
"""Noise of each frame, in electrons the shot noise; pointing errors have theirs in jitter.py and pointing_errors.py."""
STREAM_READ_NOISE = wp.constant(wp.uint32(3))
STREAM_FEW = wp.constant(wp.uint32(4))
"""Uniforms of pixels with few electrons. They must not be those that the pixel's neighbour, which may have many
electrons, makes a normal deviate of."""
STREAM_COLUMN = wp.constant(wp.uint32(5))
"""Noise that the pixels of a column share."""
STREAM_GAIN = wp.constant(wp.uint32(6))
STREAM_OFFSET = wp.constant(wp.uint32(7))
STREAM_BAD = wp.constant(wp.uint32(8))
"""Properties that stay with a pixel: its gain, its offset, and whether it is bad."""

# The two-round hash with the least bias that Wellons (2018, "Prospecting for hash functions") lists.
_FIRST_MULTIPLIER = wp.constant(wp.uint32(0x21F0AAAD))
_SECOND_MULTIPLIER = wp.constant(wp.uint32(0xD35A2D97))
_STREAM_BITS = wp.constant(wp.uint32(8))


@wp.func
def stream_key(
    frame: wp.uint32,
    band: wp.uint32,
    stream: wp.uint32,
    block: int,
    sensor_key: wp.vec2ui,
) -> wp.vec4ui:
    """Random words that belong to one image, one stream and one block of pixels."""
    purpose = stream | (wp.uint32(block) << _STREAM_BITS)
    return philox4x32(wp.vec4ui(frame, wp.uint32(0), band, purpose), sensor_key[0], sensor_key[1])


@wp.func
def hashed(number: wp.uint32, key: wp.uint32, second_key: wp.uint32) -> wp.uint32:
    """32 random bits for a number: branch-free arithmetic with two keys."""
    x = number * (key | wp.uint32(1)) + second_key
    x = (x ^ (x >> wp.uint32(16))) * _FIRST_MULTIPLIER
    x = (x ^ (x >> wp.uint32(15))) * _SECOND_MULTIPLIER
    return x ^ (x >> wp.uint32(15))


@wp.func
def numbered(element: wp.uint32, first: wp.uint32) -> wp.uint32:
    """Number of an element of a tile."""
    return element + first


@wp.func
def column_of(pixel: wp.uint32, n_col: wp.uint32, per_col: wp.float64) -> wp.uint32:
    """Column of a pixel of an image; in float64, as whole numbers are not divided in vector instructions."""
    row = wp.uint32(wp.floor((wp.float64(pixel) + wp.float64(0.5)) * per_col))
    return pixel - row * n_col
