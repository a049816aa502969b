"""Philox counter-based random integers.

Salmon, Moraes, Dror, Shaw (2011), "Parallel random numbers: as easy as 1, 2, 3". Multipliers and Weyl constants are
those of the Random123 reference; tests check its published vectors.
"""

import warp as wp

_MULTIPLIER_2X32 = wp.constant(wp.uint64(0xD256D193))
_MULTIPLIER_4X32_A = wp.constant(wp.uint64(0xD2511F53))
_MULTIPLIER_4X32_B = wp.constant(wp.uint64(0xCD9E8D57))
_WEYL_A = wp.constant(wp.uint32(0x9E3779B9))
_WEYL_B = wp.constant(wp.uint32(0xBB67AE85))


@wp.func
def philox2x32_word(counter_low: wp.uint32, counter_high: wp.uint32, key: wp.uint32) -> wp.uint64:
    """Philox2x32-10: 64 random bits, the first output word in the upper half.

    Branch-free on scalars so that `wp.tile_map` over it becomes vector instructions on the CPU.
    """
    x = counter_low
    y = counter_high
    k = key
    for _ in range(10):
        product = _MULTIPLIER_2X32 * wp.uint64(x)
        x = wp.uint32(product >> wp.uint64(32)) ^ k ^ y
        y = wp.uint32(product)
        k = k + _WEYL_A
    return (wp.uint64(x) << wp.uint64(32)) | wp.uint64(y)


@wp.func
def upper_word(word: wp.uint64) -> wp.uint32:
    """The first output word of philox2x32_word."""
    return wp.uint32(word >> wp.uint64(32))


@wp.func
def lower_word(word: wp.uint64) -> wp.uint32:
    """The second output word of philox2x32_word."""
    return wp.uint32(word)


@wp.func
def philox4x32(counter: wp.vec4ui, key_low: wp.uint32, key_high: wp.uint32) -> wp.vec4ui:
    """Philox4x32-10: four random words for a 128-bit counter and a 64-bit key."""
    x = counter[0]
    y = counter[1]
    z = counter[2]
    w = counter[3]
    k = key_low
    m = key_high
    for _ in range(10):
        first = _MULTIPLIER_4X32_A * wp.uint64(x)
        second = _MULTIPLIER_4X32_B * wp.uint64(z)
        x = wp.uint32(second >> wp.uint64(32)) ^ y ^ k
        z = wp.uint32(first >> wp.uint64(32)) ^ w ^ m
        y = wp.uint32(second)
        w = wp.uint32(first)
        k = k + _WEYL_A
        m = m + _WEYL_B
    return wp.vec4ui(x, y, z, w)
