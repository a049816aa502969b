"""Angles and their cosines in float64, without calls and without branches: some times faster than the C library's.

The polynomials are those of fdlibm (Sun Microsystems, 1993: k_sin.c, k_cos.c, s_atan.c); errors are about one unit in
the last place. Turns are folded by quarters, which is exact.
"""

import warp as wp

_TWO_PI = wp.constant(wp.float64(6.283185307179586))
_PI = wp.constant(wp.float64(3.141592653589793))
_HALF_PI = wp.constant(wp.float64(1.5707963267948966))
_QUARTER_PI = wp.constant(wp.float64(0.7853981633974483))
_EIGHTH_TURN = wp.constant(wp.float64(0.41421356237309503))  # its half's tangent, tan(pi / 8)
_LEAST = wp.constant(wp.float64(1.0e-300))


@wp.func
def _sine_near_0(x: wp.float64, z: wp.float64) -> wp.float64:
    """Sine of |x| <= pi / 4, z = x^2."""
    high = wp.float64(2.75573137070700676789e-06) + z * (
        wp.float64(-2.50507602534068634195e-08) + z * wp.float64(1.58969099521155010221e-10)
    )
    low = wp.float64(8.33333333332248946124e-03) + z * (wp.float64(-1.98412698298579493134e-04) + z * high)
    return x + x * z * (wp.float64(-1.66666666666666324348e-01) + z * low)


@wp.func
def _cosine_near_0(z: wp.float64) -> wp.float64:
    """Cosine of |x| <= pi / 4, z = x^2."""
    high = wp.float64(-2.75573143513906633035e-07) + z * (
        wp.float64(2.08757232129817482790e-09) + z * wp.float64(-1.13596475577881948265e-11)
    )
    low = wp.float64(-1.38888888888741095749e-03) + z * (wp.float64(2.48015872894767294178e-05) + z * high)
    return wp.float64(1.0) - (wp.float64(0.5) * z - z * z * (wp.float64(4.16666666666666019037e-02) + z * low))


@wp.func
def cosine_sine(turns: wp.float64) -> wp.vec2d:
    """Cosine and sine of an angle in turns, up to 2^29 of them."""
    quarter = wp.floor(wp.float64(4.0) * turns + wp.float64(0.5))
    x = (turns - wp.float64(0.25) * quarter) * _TWO_PI
    z = x * x
    sine = _sine_near_0(x, z)
    cosine = _cosine_near_0(z)
    fold = int(quarter) & 3
    across = wp.where((fold & 1) == 0, cosine, sine)
    along = wp.where((fold & 1) == 0, sine, cosine)
    return wp.vec2d(
        wp.where(((fold + 1) & 2) == 0, across, -across),
        wp.where((fold & 2) == 0, along, -along),
    )


@wp.func
def angle_from_x(y: wp.float64, x: wp.float64) -> wp.float64:
    """atan2(y, x) for y >= 0: the angle from the x axis, in [0, pi]; 0 where both are 0."""
    across = wp.abs(x)
    low = wp.min(across, y)
    high = wp.max(across, y)
    beyond = low > _EIGHTH_TURN * high  # then from the bisector of the axes
    u = wp.where(beyond, low - high, low) / wp.max(wp.where(beyond, low + high, high), _LEAST)
    z = u * u
    w = z * z
    even = wp.float64(4.97687799461593236017e-02) + w * wp.float64(1.62858201153657823623e-02)
    even = wp.float64(9.09088713343650656196e-02) + w * (wp.float64(6.66107313738753120669e-02) + w * even)
    even = wp.float64(3.33333333333329318027e-01) + w * (wp.float64(1.42857142725034663711e-01) + w * even)
    odd = wp.float64(-5.83357013379057348645e-02) + w * wp.float64(-3.65315727442169155270e-02)
    odd = wp.float64(-1.11111104054623557880e-01) + w * (wp.float64(-7.69187620504482999495e-02) + w * odd)
    odd = wp.float64(-1.99999999998764832476e-01) + w * odd
    angle = u - u * (z * even + w * odd) + wp.where(beyond, _QUARTER_PI, wp.float64(0.0))
    angle = wp.where(y > across, _HALF_PI - angle, angle)
    return wp.where(x < wp.float64(0.0), _PI - angle, angle)
