"""Philox counter-based random integers.

Salmon, Moraes, Dror, Shaw (2011), "Parallel random numbers: as easy as 1, 2, 3". Multipliers and Weyl constants are
those of the Random123 reference; tests check its published vectors.
"""

import warp as wp

_MULTIPLIER_A = wp.constant(wp.uint64(0xD2511F53))
_MULTIPLIER_B = wp.constant(wp.uint64(0xCD9E8D57))
_WEYL_A = wp.constant(wp.uint32(0x9E3779B9))
_WEYL_B = wp.constant(wp.uint32(0xBB67AE85))


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
        first = _MULTIPLIER_A * wp.uint64(x)
        second = _MULTIPLIER_B * wp.uint64(z)
        x = wp.uint32(second >> wp.uint64(32)) ^ y ^ k
        z = wp.uint32(first >> wp.uint64(32)) ^ w ^ m
        y = wp.uint32(second)
        w = wp.uint32(first)
        k = k + _WEYL_A
        m = m + _WEYL_B
    return wp.vec4ui(x, y, z, w)
