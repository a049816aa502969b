"""Pixel pairs read out: light in, counts out, by the steps (detector.py) that a detector has enabled.

    in NEI terms   dead -> gain -> non-linearity -> offset -> column -> hot -> noise, saturation, converter
    in electrons   light + background -> dead -> gain -> dark current -> hot -> shot noise -> well, non-linearity
                   -> read noise -> column -> converter

The deviates of a pair are the cosine and the sine of one angle (random_numbers.py); its first pixel takes the cosine.
"""

import functools

import warp as wp

from warpsim_kernels.canvas import N_PAIR
from warpsim_kernels.detector import (
    PixelScalars,
    ReadOutFeatures,
    bent,
    clipped,
    counts_of,
    counts_of_charge,
    detector_struct,
    photo_electrons,
    scaled,
    shifted,
    with_dark,
    with_hot,
    with_uneven_dark,
    without_dead,
)
from warpsim_kernels.poisson import poisson, poisson_of_normal
from warpsim_kernels.random_numbers import (
    column_of,
    hashed,
    normal_cosine,
    normal_radius,
    normal_sine,
    numbered,
    stream_key,
)

# Streams of random numbers, from 1 on; those of pointing errors (2, 10) and of artifacts (11 to 13) are beside them.
STREAM_NOISE = wp.constant(wp.uint32(1))
"""Noise of each frame, in electrons the shot noise."""
STREAM_READ_NOISE = wp.constant(wp.uint32(3))
STREAM_FEW = wp.constant(wp.uint32(4))
"""Uniforms of pixels with few electrons. They must not be those that the pixel's neighbour, which may have many
electrons, makes a normal deviate of."""
STREAM_COLUMN = wp.constant(wp.uint32(5))
"""Noise that the pixels of a column share."""
STREAM_GAIN = wp.constant(wp.uint32(6))
STREAM_OFFSET = wp.constant(wp.uint32(7))
STREAM_BAD = wp.constant(wp.uint32(8))
"""Properties that stay with a pixel: its gain, its offset, and whether it is bad."""


@wp.func
def mapped_functions():
    """Name the functions passed to tile_map, which Warp's hash of a kernel omits but for assignments. Never called."""
    _a, _b, _c, _d, _e, _f = numbered, column_of, hashed, normal_radius, normal_cosine, normal_sine
    _g, _h, _i, _j, _k = without_dead, with_hot, scaled, shifted, bent
    _l, _m, _n, _o = photo_electrons, with_dark, with_uneven_dark, clipped
    _p, _q, _r, _s = poisson, poisson_of_normal, counts_of, counts_of_charge


@functools.cache
def make_half_read_out(features: ReadOutFeatures, n_pair: int) -> wp.Function:
    """Function that makes counts of the light of the first, or of the second, pixels of pairs."""
    Floats = wp.tile(dtype=float, shape=(n_pair,))
    Words = wp.tile(dtype=wp.uint32, shape=(n_pair,))

    @wp.func
    def half_read_out(
        light: Floats,
        d: PixelScalars,
        noise: Floats,
        gain: Floats,
        offset: Floats,
        read_noise: Floats,
        column: Floats,
        bad_word: Words,
        few_word: Words,
    ):
        level = light
        if wp.static(features.electrons):
            level = wp.tile_map(photo_electrons, level, d.e_per_w_cm2, d.background_e, d.most)
        if wp.static(features.bad_pixels):
            level = wp.tile_map(without_dead, level, bad_word, d.dead_below)
        if wp.static(features.prnu):
            level = wp.tile_map(scaled, level, gain, d.prnu)
        if wp.static(features.electrons and features.dsnu):
            level = wp.tile_map(with_uneven_dark, level, offset, d.dark_e, d.dsnu)
        if wp.static(features.electrons and not features.dsnu):
            level = wp.tile_map(with_dark, level, d.dark_e)
        if wp.static(features.electrons and features.bad_pixels):
            level = wp.tile_map(with_hot, level, bad_word, d.hot_below, d.most)
        if wp.static(features.shot_noise and features.small_means):
            level = wp.tile_map(poisson, level, noise, few_word)
        if wp.static(features.shot_noise and not features.small_means):
            level = wp.tile_map(poisson_of_normal, level, noise)
        if wp.static(features.nonlinearity):
            level = wp.tile_map(bent, level, d.full_level, d.loss_per_level)
        if wp.static(features.electrons and not features.nonlinearity):
            level = wp.tile_map(clipped, level, d.full_level)
        if wp.static(features.dsnu and not features.electrons):
            level = wp.tile_map(shifted, level, offset, d.dsnu)
        if wp.static(features.read_noise):
            level = wp.tile_map(shifted, level, read_noise, d.read_noise_e)
        if wp.static(features.column_noise):
            level = wp.tile_map(shifted, level, column, d.column_noise)
        if wp.static(features.bad_pixels and not features.electrons):
            level = wp.tile_map(with_hot, level, bad_word, d.hot_below, d.most)
        if wp.static(features.electrons):
            return wp.tile_map(counts_of_charge, level, d.counts_per_e, d.zero_counts, d.most_counts)
        else:
            return wp.tile_map(
                counts_of, level, noise, d.counts_per_w_cm2, d.counts_per_nei, d.zero_counts, d.most_counts
            )

    return half_read_out


@wp.struct
class NoiseKeys:
    """Random keys of a block of strips; those that a detector does not need are not read."""

    noise: wp.vec4ui
    read_noise: wp.vec4ui
    column: wp.vec4ui
    few: wp.vec4ui
    gain: wp.vec4ui
    offset: wp.vec4ui
    bad: wp.vec4ui


@functools.cache
def make_noise_keys(features: ReadOutFeatures) -> wp.Function:
    """Function that makes the keys of a block: (frame, band, block, sensor_key) -> NoiseKeys."""

    @wp.func
    def noise_keys(frame: wp.uint32, band: wp.uint32, block: int, sensor_key: wp.vec2ui) -> NoiseKeys:
        keys = NoiseKeys()
        still = wp.uint32(0)  # the frame of what stays with a pixel
        keys.noise = stream_key(frame, band, STREAM_NOISE, block, sensor_key)
        if wp.static(features.read_noise):
            keys.read_noise = stream_key(frame, band, STREAM_READ_NOISE, block, sensor_key)
        if wp.static(features.column_noise):
            keys.column = stream_key(frame, band, STREAM_COLUMN, 0, sensor_key)
        if wp.static(features.small_means):
            keys.few = stream_key(frame, band, STREAM_FEW, block, sensor_key)
        if wp.static(features.prnu):
            keys.gain = stream_key(still, band, STREAM_GAIN, block, sensor_key)
        if wp.static(features.dsnu):
            keys.offset = stream_key(still, band, STREAM_OFFSET, block, sensor_key)
        if wp.static(features.bad_pixels):
            keys.bad = stream_key(still, band, STREAM_BAD, block, sensor_key)
        return keys

    return noise_keys


@functools.cache
def make_map_plane(features: ReadOutFeatures) -> wp.Function:
    """Function that finds where a sensor's maps of a band begin: (detector, sensor, n_band, band) -> int."""
    Arrays = detector_struct(features)

    @wp.func
    def map_plane(detector: Arrays, sensor: int, n_band: int, band: int) -> int:
        if wp.static(features.maps):
            return (detector.maps.by_sensor * sensor * n_band + band) * detector.maps.stride
        else:
            return 0

    return map_plane


@functools.cache
def make_counts_of_pairs(features: ReadOutFeatures, n_pair: int) -> wp.Function:
    """Function that reads out tiles of n_pair pixel pairs: counts of their first pixels, and of their second ones.

    (number, pixel, light, light, PixelScalars, NoiseKeys, detector, at): the numbers of the pairs within their
    block of strips, where their first pixels are in the image, N_PAIR before the second ones, the light of both, and
    where the first of the pixels is in the maps.
    """
    Floats = wp.tile(dtype=float, shape=(n_pair,))
    Words = wp.tile(dtype=wp.uint32, shape=(n_pair,))
    half_read_out = make_half_read_out(features, n_pair)
    Arrays = detector_struct(features)

    @wp.func
    def words_of(number: Words, key: wp.vec4ui):
        """Random words of the first and of the second pixels of pairs."""
        return wp.tile_map(hashed, number, key[0], key[1]), wp.tile_map(hashed, number, key[2], key[3])

    @wp.func
    def deviates_of(number: Words, key: wp.vec4ui):
        """Unit normal deviates, likewise."""
        word, angle = words_of(number, key)
        radius = wp.tile_map(normal_radius, word)
        return wp.tile_map(normal_cosine, radius, angle), wp.tile_map(normal_sine, radius, angle)

    @wp.func
    def column_deviates(pixel: Words, key: wp.vec4ui, n_col: int):
        """Unit normal deviates of the columns of pixels."""
        column = wp.tile_map(column_of, pixel, wp.uint32(n_col), wp.float64(1.0) / wp.float64(n_col))
        radius = wp.tile_map(normal_radius, wp.tile_map(hashed, column, key[0], key[1]))
        return wp.tile_map(normal_cosine, radius, wp.tile_map(hashed, column, key[2], key[3]))

    @wp.func
    def mapped(values: wp.array[float], at: int):
        """Values of a map at the first and at the second pixels of pairs."""
        return wp.tile_load(values, shape=n_pair, offset=at), wp.tile_load(values, shape=n_pair, offset=at + N_PAIR)

    @wp.func
    def counts_of_pairs(
        number: Words,
        pixel: Words,
        light_1: Floats,
        light_2: Floats,
        d: PixelScalars,
        keys: NoiseKeys,
        detector: Arrays,
        at: int,
    ):
        noise_1, noise_2 = deviates_of(number, keys.noise)
        # Disabled terms get another argument, which is not read.
        read_1 = noise_1
        read_2 = noise_2
        gain_1 = noise_1
        gain_2 = noise_2
        offset_1 = noise_1
        offset_2 = noise_2
        column_1 = noise_1
        column_2 = noise_2
        bad_1 = number
        bad_2 = number
        few_1 = number
        few_2 = number
        if wp.static(features.read_noise):
            read_1, read_2 = deviates_of(number, keys.read_noise)
        if wp.static(features.prnu and not features.maps):
            gain_1, gain_2 = deviates_of(number, keys.gain)
        if wp.static(features.dsnu and not features.maps):
            offset_1, offset_2 = deviates_of(number, keys.offset)
        if wp.static(features.bad_pixels and not features.maps):
            bad_1, bad_2 = words_of(number, keys.bad)
        if wp.static(features.maps):
            own = detector.maps
            gain_1, gain_2 = mapped(own.gain, at)
            offset_1, offset_2 = mapped(own.offset, at)
            bad_1 = wp.tile_load(own.bad, shape=n_pair, offset=at)
            bad_2 = wp.tile_load(own.bad, shape=n_pair, offset=at + N_PAIR)
        if wp.static(features.small_means):
            few_1, few_2 = words_of(number, keys.few)
        if wp.static(features.column_noise):
            column_1 = column_deviates(pixel, keys.column, detector.n_col)
            column_2 = column_deviates(wp.tile_map(numbered, pixel, wp.uint32(N_PAIR)), keys.column, detector.n_col)
        counts_1 = half_read_out(light_1, d, noise_1, gain_1, offset_1, read_1, column_1, bad_1, few_1)
        counts_2 = half_read_out(light_2, d, noise_2, gain_2, offset_2, read_2, column_2, bad_2, few_2)
        return counts_1, counts_2

    return counts_of_pairs
