"""Errors of pointing: a constant bias, a drift that begins anew from period to period, and jitter.

Jitter is a smooth random motion about two axes, known at any time without a history. Each axis follows the critically
damped oscillator driven by white noise (a Matern process of order 3/2),

    angle'' + (4 / T) angle' + (4 / T^2) angle = white noise,

whose response to a shock is h(u) = u exp(-2u), u = lag / T, and whose autocorrelation is (1 + 2u) exp(-2u), with the
integral T over positive lags. Between nodes a step apart (T / 16) angle and rate move by a constant matrix and one
random shock of known covariance, exactly; the state at a node is the sum of the decayed shocks of the N_STEP steps
before it. Between nodes the angle is the cubic Hermite polynomial, so it has a continuous rate.

Rates of drift and shocks are counter-based: Philox4x32 keyed by the sensor, with counter (period or step, stream). So
errors depend on seed, sensor and time alone.
"""

import warp as wp

from warpsim_kernels.random_numbers import normal_cosine, normal_radius, normal_sine, philox4x32

STREAM_DRIFT = wp.constant(wp.uint32(10))
"""Last counter word; other numbers are those of the read-out (pixel_pairs.py), which has the same key."""


@wp.struct
class PointingError:
    """Pointing error of a sensor about the camera's x and y axes."""

    bias_rad: wp.vec2d
    drift_rad_s: wp.vec2d  # the same in every period
    drift_rms_rad_s: wp.float64  # of what is drawn for each period
    reset_s: wp.float64  # period; 0: from the epoch on
    seed_low: wp.uint32
    seed_high: wp.uint32


@wp.func
def counter_words(number: wp.int64, stream: wp.uint32, seed_low: wp.uint32, seed_high: wp.uint32) -> wp.vec4ui:
    """Random words of a period or step."""
    low = wp.uint32(number & wp.int64(0xFFFFFFFF))
    high = wp.uint32((number >> wp.int64(32)) & wp.int64(0xFFFFFFFF))
    return philox4x32(wp.vec4ui(low, high, wp.uint32(0), stream), seed_low, seed_high)


@wp.func
def drawn_pair(error: PointingError, period: wp.int64) -> wp.vec2d:
    """Two unit normal deviates of a period."""
    words = counter_words(period, STREAM_DRIFT, error.seed_low, error.seed_high)
    radius = normal_radius(words[0])
    return wp.vec2d(wp.float64(normal_cosine(radius, words[1])), wp.float64(normal_sine(radius, words[1])))


@wp.func
def steady_error_rad(error: PointingError, time_s: wp.float64, middle_s: wp.float64) -> wp.vec2d:
    """Angles about the camera's x and y axes [rad]; in the drift period of the exposure's middle."""
    since_s = time_s
    period = wp.int64(0)
    if error.reset_s > wp.float64(0.0):
        period = wp.int64(wp.floor(middle_s / error.reset_s))
        since_s = time_s - wp.float64(period) * error.reset_s
    rate = error.drift_rad_s
    if error.drift_rms_rad_s > wp.float64(0.0):
        rate += drawn_pair(error, period) * error.drift_rms_rad_s
    return error.bias_rad + rate * since_s


STEPS_PER_CORRELATION = 16
"""Nodes per correlation time: the cubic between them lowers the variance by up to 4e-5."""

N_STEP = 128
"""Shocks summed, over 8 correlation times: what is left out is 2e-6 of the variance, at lags of 8 correlation times."""

STREAM_JITTER = wp.constant(wp.uint32(2))
"""Last counter word of the shocks."""


@wp.struct
class Jitter:
    """The process; a state is (angle [rad], change of angle per step [rad])."""

    step_s: wp.float64  # between nodes
    decay: wp.mat22d  # what a step makes of a state
    spread: wp.mat22d  # what makes a shock of two unit normal deviates
    forgotten: wp.mat22d  # decay to the power N_STEP: what is left of the shock that leaves the sum
    seed_low: wp.uint32
    seed_high: wp.uint32


@wp.func
def jitter_shock(jitter: Jitter, step: wp.int64) -> wp.mat22d:
    """Noise of the state in one step; columns are the axes."""
    words = counter_words(step, STREAM_JITTER, jitter.seed_low, jitter.seed_high)
    a = normal_radius(words[0])
    b = normal_radius(words[2])
    deviates = wp.mat22d(
        wp.float64(normal_cosine(a, words[1])),
        wp.float64(normal_sine(a, words[1])),
        wp.float64(normal_cosine(b, words[3])),
        wp.float64(normal_sine(b, words[3])),
    )
    return jitter.spread * deviates


@wp.func
def jitter_rad(jitter: Jitter, time_s: wp.float64) -> wp.vec2d:
    """Angles about the camera's x and y axes at any time [rad]."""
    phase = time_s / jitter.step_s
    node = wp.int64(wp.floor(phase))
    oldest = node - wp.int64(wp.static(N_STEP))
    first = jitter_shock(jitter, oldest)
    before = first
    for i in range(1, wp.static(N_STEP)):
        before = jitter.decay * before + jitter_shock(jitter, oldest + wp.int64(i))
    # The next node's own sum: without the shock that is N_STEP steps old by then, so that the motion has no jumps.
    after = jitter.decay * before + jitter_shock(jitter, node) - jitter.forgotten * first

    u = phase - wp.float64(node)
    one = wp.float64(1.0)
    w = one - u
    rise = u * u * (wp.float64(3.0) - wp.float64(2.0) * u)
    return wp.vec2d(
        before[0, 0] + (after[0, 0] - before[0, 0]) * rise + before[1, 0] * (u * w * w) - after[1, 0] * (u * u * w),
        before[0, 1] + (after[0, 1] - before[0, 1]) * rise + before[1, 1] * (u * w * w) - after[1, 1] * (u * u * w),
    )


@wp.func
def turned_axes(axes: wp.mat33d, about_xy_rad: wp.vec2d) -> wp.mat33d:
    """Camera axes (rows) after a rotation by the vector a x + b y: the boresight moves by b towards x and -a towards y.

    Rodrigues' rotation formula, transposed because the rows are turned.
    """
    a = about_xy_rad[0]
    b = about_xy_rad[1]
    one = wp.float64(1.0)
    square = a * a + b * b
    s = one - square / wp.float64(6.0)  # sin(angle) / angle
    c = wp.float64(0.5) - square / wp.float64(24.0)  # (1 - cos(angle)) / angle^2
    if square > wp.float64(1.0e-8):
        angle = wp.sqrt(square)
        half = wp.sin(wp.float64(0.5) * angle) / angle
        s = wp.sin(angle) / angle
        c = wp.float64(2.0) * half * half
    turn = wp.mat33d(
        one - c * b * b,
        c * a * b,
        -s * b,
        c * a * b,
        one - c * a * a,
        s * a,
        s * b,
        -s * a,
        one - c * square,
    )
    return turn * axes
