"""Steady errors of pointing: a constant bias, and a drift that begins anew from period to period.

Rates of a drift are counter-based: Philox4x32 keyed by the sensor, with counter (period, stream). So the error depends
on seed, sensor and time alone.
"""

import warp as wp

from warpsim_kernels.normal import normal_cosine, normal_radius, normal_sine
from warpsim_kernels.philox import philox4x32

STREAM_DRIFT = wp.constant(wp.uint32(10))
"""Last counter word; other numbers are those of jitter.py and streams.py."""


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
def drawn_pair(error: PointingError, period: wp.int64) -> wp.vec2d:
    """Two unit normal deviates of a period."""
    low = wp.uint32(period & wp.int64(0xFFFFFFFF))
    high = wp.uint32((period >> wp.int64(32)) & wp.int64(0xFFFFFFFF))
    words = philox4x32(wp.vec4ui(low, high, wp.uint32(0), STREAM_DRIFT), error.seed_low, error.seed_high)
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
