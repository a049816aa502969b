"""Poisson deviates at every mean, branch-free, so that `wp.tile_map` turns them into vector instructions on the CPU.

Both ways invert the distribution function: the count is the number of whole k >= 1 with P(X >= k) above a uniform.

- From SMALLEST_EXPANDED_MEAN up, by an asymptotic expansion: with the continuous distribution function Q(x, m), the
  regularised incomplete gamma function, x solves Q(x, m) = Phi(w) for a unit normal deviate w, and the count is
  floor(x). Expanding the Cornish-Fisher series of the gamma distribution gives

      x = m + sqrt(m) w + (2 + w^2) / 6 - (2 w + w^3) / (72 sqrt(m)) + ...

  (Giles 2016, "Algorithm 955: approximation of the inverse Poisson cumulative distribution function", eq. 6, to 1 / m;
  the two terms behind it come from two more terms of Goldberg and Levine 1946). The total variation distance from the
  Poisson distribution is below 1e-5 at the smallest mean, and falls like m^-5/2.
- Below it, by adding up probabilities in float64: all of the first N_SEARCHED counts, so that nothing branches. What
  is left beyond them has a probability of less than 2^-33, which the 32 bits of the uniform do not reach.
"""

import math

import warp as wp

SMALLEST_EXPANDED_MEAN = wp.constant(12.0)
"""Means from here on take the expansion, smaller ones the sum."""

N_SEARCHED = 40
"""Counts that the sum goes through: P(X > 40) at a mean of 12 is below 2^-33."""

_LOG2_E = wp.constant(wp.float64(1.4426950408889634))
_LN_2 = wp.constant(wp.float64(0.6931471805599453))
_UNIT_32 = wp.constant(wp.float64(2.3283064365386963e-10))  # 2**-32


@wp.func
def poisson_of_normal(mean: float, w: float) -> float:
    """The Poisson count at a unit normal deviate w; for means from SMALLEST_EXPANDED_MEAN up.

    The mean is split into its whole part and the rest, and only the rest meets the deviate: counts keep their units
    beyond 1e7, where float32 numbers that are added up do not keep halves.
    """
    m = wp.max(mean, SMALLEST_EXPANDED_MEAN)
    whole = wp.floor(m)
    root = wp.sqrt(m)
    r = 1.0 / root
    w2 = w * w
    first = w * (-0.027777778 + w2 * -0.013888889)
    second = -0.019753086 + w2 * (0.008641975 + w2 * 0.0037037037)
    third = w * (0.017258230 + w2 * (-0.0035236626 + w2 * -0.0013310185))
    fourth = -0.00062708211 + w2 * (-0.012710661 + w2 * (0.0016534392 + w2 * 0.00055849500))
    shift = root * w + (0.33333333 + w2 * 0.16666667) + r * (first + r * (second + r * (third + r * fourth)))
    return wp.max(whole + wp.floor((m - whole) + shift), 0.0)


@wp.func
def exp_of_minus(x: wp.float64) -> wp.float64:
    """exp(-x) for 0 <= x <= 700, relative error 1e-12: a power of two by its bits, the rest by Taylor's series."""
    n = wp.floor(x * _LOG2_E + wp.float64(0.5))
    y = n * _LN_2 - x  # -x + n ln 2
    series = wp.float64(wp.static(1.0 / math.factorial(10)))
    for k in range(10):
        series = series * y + wp.float64(wp.static(1.0 / math.factorial(9 - k)))
    bits = (wp.int64(1023) - wp.int64(n)) << wp.int64(52)
    return wp.cast(bits, wp.float64) * series


@wp.func
def searched_poisson(mean: float, word: wp.uint32) -> float:
    """The Poisson count at a uniform from 32 random bits; for means below SMALLEST_EXPANDED_MEAN."""
    m = wp.float64(wp.clamp(mean, 0.0, SMALLEST_EXPANDED_MEAN))
    uniform = (wp.float64(word) + wp.float64(0.5)) * _UNIT_32
    term = exp_of_minus(m)
    beyond = wp.float64(1.0) - term  # P(X >= k)
    count = float(0.0)
    for i in range(wp.static(N_SEARCHED // 8)):
        for j in range(8):
            count = count + wp.where(beyond > uniform, 1.0, 0.0)
            term = term * (m * wp.float64(wp.static(1.0 / (8 * i + j + 1))))
            beyond = beyond - term
    return count


@wp.func
def poisson(mean: float, w: float, word: wp.uint32) -> float:
    """The Poisson count at any mean; of the two random numbers the mean says which one is used."""
    return wp.where(mean < SMALLEST_EXPANDED_MEAN, searched_poisson(mean, word), poisson_of_normal(mean, w))
