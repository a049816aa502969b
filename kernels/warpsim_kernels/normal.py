"""Unit normal deviates, two at a time, from two random words of 32 bits: Box and Muller (1958), short polynomials.

Everything is branch-free scalar arithmetic, because that is what `wp.tile_map` turns into vector instructions on the
CPU; library calls (log, cos) would stop it. A deviate's absolute error against float64 is below 2e-6. Thirty-one bits
feed the radius and one the sign of both deviates; the largest deviate is 6.66 (a Gaussian exceeds it once in 4e10).
"""

import warp as wp

from warpsim_kernels.fused import fma

_UNIT_32 = wp.constant(2.3283064365386963e-10)  # 2**-32
_UNIT_33 = wp.constant(1.1641532182693481e-10)  # 2**-33
_ONE = wp.constant(wp.uint32(1))
# Added to the bits of w = 2**e m, m from sqrt(1/2) to sqrt(2): the exponent's field is then that of e - 32.
_TO_EXPONENT = wp.constant(wp.uint32((0x3F800000 - 0x3F3504F3 - (159 << 23)) % 2**32))
_EXPONENT_FIELD = wp.constant(wp.uint32(0xFF800000))
_MINUS_TWO_LN2_PER_FIELD = wp.constant(-2.0 * 0.6931471805599453 / 2**23)


@wp.func
def normal_radius(word: wp.uint32) -> float:
    """sqrt(-2 ln u) with u in (0, 1) from the upper 31 random bits; the lowest bit gives its sign.

    u = 2**e m with m in [sqrt(1/2), sqrt(2)), found by adding to the float's bits; -2 ln m is a polynomial (4e-7).
    Where e = 0, m - 1 is taken from the complement 1 - u, which keeps the digits that float32 loses next to 1.
    """
    odd = word | _ONE  # u times 2**32
    bits = wp.cast(float(odd), wp.uint32)
    field = (bits + _TO_EXPONENT) & _EXPONENT_FIELD  # e times 2**23
    f = fma(wp.cast(bits - field, wp.float32), _UNIT_32, -1.0)
    f = wp.where(field == wp.uint32(0), float(wp.uint32(0) - odd) * -_UNIT_32, f)
    series = fma(-0.236544457, f, 0.378038386)
    series = fma(series, f, -0.412094443)
    series = fma(series, f, 0.497626927)
    series = fma(series, f, -0.666065907)
    series = fma(series, f, 1.0000393)
    series = fma(series, f, -2.0000065)
    radius = wp.sqrt(fma(float(wp.int32(field)), _MINUS_TWO_LN2_PER_FIELD, f * series))
    return wp.cast(wp.cast(radius, wp.uint32) ^ (word << wp.uint32(31)), wp.float32)


@wp.func
def normal_cosine(radius: float, word: wp.uint32) -> float:
    """Radius cos(2 pi t), t in [-1/4, 1/4) from 32 random bits; the other half of the turn is the radius's sign."""
    t = float(wp.int32(word)) * _UNIT_33
    t2 = t * t
    series = fma(56.2423782, t2, -85.24033)
    series = fma(series, t2, 64.9345906)
    series = fma(series, t2, -19.7391714)
    return radius * fma(series, t2, 0.999999953)


@wp.func
def normal_sine(radius: float, word: wp.uint32) -> float:
    """Radius sin(2 pi t) of the same angle as normal_cosine."""
    t = float(wp.int32(word)) * _UNIT_33
    t2 = t * t
    series = fma(39.536705, t2, -76.5497821)
    series = fma(series, t2, 81.6010041)
    series = fma(series, t2, -41.341655)
    return radius * (t * fma(series, t2, 6.28318516))
