"""Unit normal deviates from two random words of 32 bits: Box and Muller (1958) with short polynomials.

Everything is branch-free scalar arithmetic, because that is what `wp.tile_map` turns into vector instructions on the
CPU; library calls (log, cos) would stop it. The deviate's absolute error against float64 is below 2e-6. Thirty-two
bits feed the radius, so the largest deviate is 6.76 (a Gaussian exceeds it once in 7e10 draws).
"""

import warp as wp

_LN2 = wp.constant(0.6931471805599453)
_UNIT_32 = wp.constant(2.3283064365386963e-10)  # 2**-32
_SQRT_HALF_BITS = wp.constant(wp.uint32(0x3F3504F3))  # float32 bits of sqrt(1/2)
_ONE_MINUS_SQRT_HALF_BITS = wp.constant(wp.uint32(0x004AFB0D))  # bits of 1.0 minus the line above
_MANTISSA_BITS = wp.constant(wp.uint32(0x007FFFFF))
_LOW_31_BITS = wp.constant(wp.uint32(0x7FFFFFFF))


@wp.func
def normal_radius(word: wp.uint32) -> float:
    """sqrt(-2 ln u) with u in (0, 1) from 32 random bits.

    u = 2**e * m with m in [sqrt(1/2), sqrt(2)), found by shifting the float's bits; ln m = 2 artanh((m - 1)/(m + 1)).
    Where e = 0, m - 1 is taken from the complement 1 - u, which keeps the digits that float32 loses next to 1.
    """
    u = (float(word) + 0.5) * _UNIT_32
    bits = wp.cast(u, wp.uint32) + _ONE_MINUS_SQRT_HALF_BITS
    e = float(wp.int32(bits >> wp.uint32(23)) - 127)
    m = wp.cast((bits & _MANTISSA_BITS) + _SQRT_HALF_BITS, wp.float32)
    s = wp.where(e == 0.0, (float(~word) + 0.5) * -_UNIT_32, m - 1.0) / (m + 1.0)
    s2 = s * s
    ln_u = e * _LN2 + s * (2.0 + s2 * (0.66666816 + s2 * (0.39974788 + s2 * 0.29925896)))
    return wp.sqrt(wp.max(-2.0 * ln_u, 0.0))


@wp.func
def _quarter_turn(word: wp.uint32) -> float:
    """Turns in (-1/4, 1/4) from the low 31 bits."""
    return (float(wp.int32(word & _LOW_31_BITS)) + 0.5) * _UNIT_32 - 0.25


@wp.func
def _half_turn_sign(word: wp.uint32) -> float:
    """-1 adds half a turn: bit 31 of the word."""
    return 1.0 - 2.0 * float(wp.int32(word >> wp.uint32(31)))


@wp.func
def normal_cosine(word: wp.uint32) -> float:
    """cos(2 pi t), t a uniform fraction of a turn from 32 random bits."""
    t = _quarter_turn(word)
    t2 = t * t
    series = 60.14395329 - 24.98183633 * t2
    return _half_turn_sign(word) * (1.0 + t2 * (-19.73920855 + t2 * (64.93934656 + t2 * (-85.45356831 + t2 * series))))


@wp.func
def normal_sine(word: wp.uint32) -> float:
    """sin(2 pi t) of the same angle as normal_cosine."""
    t = _quarter_turn(word)
    t2 = t * t
    series = 42.00980618 - 14.39413545 * t2
    return _half_turn_sign(word) * t * (
        6.28318531 + t2 * (-41.34170212 + t2 * (81.60522621 + t2 * (-76.70428138 + t2 * series)))
    )
