"""Maps of what stays with a detector's pixels from frame to frame: gains, offsets, and which are bad."""

import warp as wp

from warpsim_kernels.canvas import N_PAIR, STRIP_PIXELS, STRIPS_PER_BLOCK
from warpsim_kernels.detector import Detector, scaled, shifted, with_uneven_dark
from warpsim_kernels.pixel_pairs import STREAM_BAD, STREAM_GAIN, STREAM_OFFSET
from warpsim_kernels.random_numbers import hashed, normal_cosine, normal_radius, normal_sine, stream_key

DEAD = wp.constant(wp.uint8(1))
HOT = wp.constant(wp.uint8(2))


@wp.func
def pixel_word(number: wp.uint32, key: wp.vec4ui, first: bool) -> wp.uint32:
    """Random word of the first, or of the second, pixel of a pair."""
    return wp.where(first, hashed(number, key[0], key[1]), hashed(number, key[2], key[3]))


@wp.func
def pixel_deviate(number: wp.uint32, key: wp.vec4ui, first: bool) -> float:
    """Unit normal deviate of the first, or of the second, pixel of a pair."""
    radius, angle = normal_radius(hashed(number, key[0], key[1])), hashed(number, key[2], key[3])
    return wp.where(first, normal_cosine(radius, angle), normal_sine(radius, angle))


@wp.kernel(module="unique", enable_backward=False)
def detector_maps_kernel(
    # in
    detector: Detector,
    sensor: int,
    band_id: wp.array[wp.uint32],  # (n_band,)
    electrons: bool,
    # out
    gain: wp.array2d[float],  # (n_band, n_pixel) about 1
    offset: wp.array2d[float],  # (n_band, n_pixel) [W/cm2], or electrons of the dark current
    bad: wp.array2d[wp.uint8],  # (n_band, n_pixel) DEAD, HOT, or 0
):
    """Gains, offsets and bad pixels of a sensor, by the numbers that the read-out takes."""
    band, pixel = wp.tid()
    d, key = detector.pixels[band], detector.keys[sensor]
    strip = pixel // STRIP_PIXELS
    within = pixel - strip * STRIP_PIXELS
    block = strip // STRIPS_PER_BLOCK
    first = within < N_PAIR
    number = wp.uint32((strip - block * STRIPS_PER_BLOCK) * N_PAIR + within % N_PAIR)
    still, b = wp.uint32(0), band_id[band]
    gain[band, pixel] = scaled(1.0, pixel_deviate(number, stream_key(still, b, STREAM_GAIN, block, key), first), d.prnu)
    deviate = pixel_deviate(number, stream_key(still, b, STREAM_OFFSET, block, key), first)
    if electrons:
        offset[band, pixel] = with_uneven_dark(0.0, deviate, d.dark_e, d.dsnu)
    else:
        offset[band, pixel] = shifted(0.0, deviate, d.dsnu)
    word = pixel_word(number, stream_key(still, b, STREAM_BAD, block, key), first)
    found = wp.uint8(0)
    if word < d.dead_below:
        found = DEAD
    if ~word < d.hot_below:
        found = HOT
    bad[band, pixel] = found
