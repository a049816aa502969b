"""Random numbers of kernels: every draw is a pure function of a key and a counter.

Words are of Philox (Salmon, Moraes, Dror, Shaw 2011, "Parallel random numbers: as easy as 1, 2, 3"; multipliers and
Weyl constants are those of the Random123 reference; tests check its published vectors).

A read-out has two levels. Philox4x32 keyed by the sensor's own 64 bits, with counter (frame, band, stream and block of
pixels), yields four keys; a short hash with two of them turns the number of a pixel pair within the block into 32 bits.
Any frame is therefore the same alone, in any batch, on any worker. What stays with a pixel from frame to frame has
streams of its own, in which the frame is always 0.

The hash multiplies the number by one key and adds the other, which makes any two words of a block independent, and
then mixes so that more of them are; it is a bijection of 32 bits. A block asks it for a thousand words only and has
keys of its own, so that words of an image may repeat. Tests count both in 1e9 draws.

Normal deviates come two at a time from two words: Box and Muller (1958), short polynomials. Everything is branch-free
scalar arithmetic, because that is what `wp.tile_map` turns into vector instructions on the CPU; library calls (log,
cos) would stop it. A deviate's absolute error against float64 is below 2e-6. Thirty-one bits feed the radius and one
the sign of both deviates; the largest deviate is 6.66 (a Gaussian exceeds it once in 4e10).
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


_UNIT_32 = wp.constant(2.3283064365386963e-10)  # 2**-32
_UNIT_33 = wp.constant(1.1641532182693481e-10)  # 2**-33
_ONE = wp.constant(wp.uint32(1))
# Added to the bits of w = 2**e m, m from sqrt(1/2) to sqrt(2): the exponent's field is then that of e - 32.
_TO_EXPONENT = wp.constant(wp.uint32((0x3F800000 - 0x3F3504F3 - (159 << 23)) % 2**32))
_EXPONENT_FIELD = wp.constant(wp.uint32(0xFF800000))
_MINUS_TWO_LN2_PER_FIELD = wp.constant(-2.0 * 0.6931471805599453 / 2**23)


@wp.func_native(
    snippet="""
#if defined(__CUDA_ARCH__)
    return fmaf(a, b, c);
#elif defined(__FMA__) || defined(__ARM_FEATURE_FMA)
    return __builtin_fmaf(a, b, c);
#else
    return (float)((double)a * (double)b + (double)c);
#endif
    """
)
def fma(a: float, b: float, c: float) -> float:
    """Multiply and add, rounded once; processors without the instruction round the sum twice.

    Written out, since compilers fuse as they like: so a number comes out with the same bits on every processor, in
    every kernel, vectorised or not, and on CUDA, and costs half the instructions.
    """


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
