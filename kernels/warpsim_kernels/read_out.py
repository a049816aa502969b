"""Read-out: noiseless irradiance per pixel in, counts out.

A detector is a row of steps (pixel.py), of which a kernel holds those that a scene needs; what is off costs nothing.

    in NEI terms   dead -> gain -> non-linearity -> offset -> column -> hot -> noise, saturation, converter
    in electrons   light + background -> dead -> gain -> dark current -> hot -> shot noise -> well, non-linearity
                   -> read noise -> column -> converter

The deviates of a pixel pair are the cosine and the sine of one random word (streams.py, normal.py), or come from a
template.
"""

import functools

import warp as wp

from warpsim_kernels.detector import Detector, PixelScalars, ReadOutFeatures
from warpsim_kernels.normal import normal_cosine, normal_radius, normal_sine
from warpsim_kernels.philox import lower_word, philox2x32_word, upper_word
from warpsim_kernels.pixel import (
    bent,
    counts_of,
    counts_of_charge,
    held,
    photo_electrons,
    product,
    scaled,
    shifted,
    with_dark,
    with_hot,
    with_uneven_dark,
    without_dead,
)
from warpsim_kernels.poisson import poisson, poisson_of_normal
from warpsim_kernels.streams import (
    BAD_PAIRS,
    OFFSET_PAIRS,
    STREAM_COLUMN,
    STREAM_PATTERN,
    STREAM_READ_NOISE,
    STREAM_TEMPLATE,
    UNIFORM_PAIRS,
    column_of,
    image_key,
    numbered,
    sign_of,
    template_place,
)

TILE_WIDTH = 64
"""Pixel pairs per tile. A tile covers twice as many pixels: the first half takes cosines, the second half sines."""


@wp.func
def mapped_functions():
    """What is handed to tile_map, which Warp's hash of a kernel leaves out; assignments are in it. Never called."""
    _a, _b, _c, _d, _e = philox2x32_word, upper_word, lower_word, numbered, column_of
    _f, _g, _h, _i = normal_radius, normal_cosine, normal_sine, product
    _j, _k, _l, _m, _n = without_dead, with_hot, scaled, shifted, bent
    _o, _p, _q, _r = photo_electrons, with_dark, with_uneven_dark, held
    _s, _t, _u, _v = poisson, poisson_of_normal, counts_of, counts_of_charge


@functools.cache
def make_half_read_out(features: ReadOutFeatures, width: int) -> wp.Function:
    """Function that reads out `width` neighbouring pixels of one image, all of which take cosines, or all sines."""
    floats = wp.tile(dtype=float, shape=(width,))
    words = wp.tile(dtype=wp.uint32, shape=(width,))

    @wp.func
    def half_read_out(
        # in
        signal_w_cm2: wp.array[float],
        d: PixelScalars,
        n_col: int,
        start: int,  # in signal and counts
        first_pixel: wp.uint32,  # in the image
        word: words,
        radius: floats,
        direction: floats,
        gain_radius: floats,
        gain_direction: floats,
        offset_radius: floats,
        offset_direction: floats,
        bad_word: words,
        read_radius: floats,
        read_direction: floats,
        column_key: wp.vec4ui,
        # out
        counts: wp.array[wp.uint16],
    ):
        level = wp.tile_load(signal_w_cm2, shape=wp.static(width), offset=start, bounds_check=False)
        if wp.static(features.electrons):
            level = wp.tile_map(photo_electrons, level, d.e_per_w_cm2, d.background_e, d.most)
        if wp.static(features.bad_pixels):
            level = wp.tile_map(without_dead, level, bad_word, d.dead_below)
        if wp.static(features.prnu):
            level = wp.tile_map(scaled, level, gain_radius, gain_direction, d.prnu)
        if wp.static(features.electrons and features.dsnu):
            level = wp.tile_map(with_uneven_dark, level, offset_radius, offset_direction, d.dark_e, d.dsnu)
        if wp.static(features.electrons and not features.dsnu):
            level = wp.tile_map(with_dark, level, d.dark_e)
        if wp.static(features.electrons and features.bad_pixels):
            level = wp.tile_map(with_hot, level, bad_word, d.hot_below, d.most)
        if wp.static(features.shot_noise and features.small_means):
            level = wp.tile_map(poisson, level, wp.tile_map(product, radius, direction), word)
        if wp.static(features.shot_noise and not features.small_means):
            level = wp.tile_map(poisson_of_normal, level, wp.tile_map(product, radius, direction))
        if wp.static(features.nonlinearity):
            level = wp.tile_map(bent, level, d.full_level, d.loss_per_level)
        if wp.static(features.electrons and not features.nonlinearity):
            level = wp.tile_map(held, level, d.full_level)
        if wp.static(features.dsnu and not features.electrons):
            level = wp.tile_map(shifted, level, offset_radius, offset_direction, d.dsnu)
        if wp.static(features.read_noise):
            level = wp.tile_map(shifted, level, read_radius, read_direction, d.read_noise_e)
        if wp.static(features.column_noise):
            place = wp.tile_map(numbered, wp.tile_arange(wp.static(width), dtype=wp.uint32), first_pixel)
            per_col = wp.float64(1.0) / wp.float64(n_col)
            column = wp.tile_map(column_of, place, wp.uint32(n_col), per_col)
            column_word = wp.tile_map(philox2x32_word, column, column_key[1], column_key[0])
            column_radius = wp.tile_map(normal_radius, wp.tile_map(upper_word, column_word))
            column_direction = wp.tile_map(normal_cosine, wp.tile_map(lower_word, column_word))
            level = wp.tile_map(shifted, level, column_radius, column_direction, d.column_noise)
        if wp.static(features.bad_pixels and not features.electrons):
            level = wp.tile_map(with_hot, level, bad_word, d.hot_below, d.most)
        if wp.static(features.electrons):
            read = wp.tile_map(counts_of_charge, level, d.counts_per_e, d.offset_counts, d.max_counts)
            wp.tile_store(counts, read, offset=start, bounds_check=False)
        else:
            read = wp.tile_map(
                counts_of, level, radius, direction, d.per_nei, d.ceiling_nei, d.counts_per_nei, d.offset_counts,
                d.max_counts,
            )
            wp.tile_store(counts, read, offset=start, bounds_check=False)

    return half_read_out


@functools.cache
def make_read_out_tile_kernel(features: ReadOutFeatures, tile_width: int = TILE_WIDTH) -> wp.Kernel:
    """Kernel over all whole tiles of 2 * tile_width pixels of all images.

    Launch and arrays are flat: only then the CPU compiler turns loads, arithmetic and stores into vector
    instructions, which nearly halves the time.
    """
    half_read_out = make_half_read_out(features, tile_width)

    @wp.kernel(module="unique", enable_backward=False)
    def read_out_tile_kernel(
        # in
        signal_w_cm2: wp.array[float],  # (n_view * n_band * n_pixel,)
        view_frame: wp.array[wp.uint32],  # (n_view,)
        view_sensor: wp.array[wp.uint32],  # (n_view,)
        band_id: wp.array[wp.uint32],  # (n_band,)
        detector: Detector,
        n_tile: int,  # whole tiles per image
        # out
        counts: wp.array[wp.uint16],  # (n_view * n_band * n_pixel,)
    ):
        if wp.static(False):
            mapped_functions()
        item = wp.tid()
        image = item // n_tile
        tile = item - image * n_tile
        view = image // band_id.shape[0]
        band = image - view * band_id.shape[0]
        frame = view_frame[view]
        sensor = view_sensor[view]
        band_number = band_id[band]
        d = detector.pixels[band]
        key = image_key(frame, sensor, band_number, STREAM_READ_NOISE, d.seed_low, d.seed_high)
        first = wp.uint32(tile * wp.static(tile_width))
        lane = wp.tile_arange(wp.static(tile_width), dtype=wp.uint32)
        start = image * detector.n_pixel + tile * wp.static(2 * tile_width)
        pixel = wp.uint32(tile * wp.static(2 * tile_width))

        if wp.static(features.template):
            place = template_place(key[0], detector.n_deviate, tile * wp.static(2 * tile_width))
            upper = lane
            lower = lane
            radius = wp.tile_load(detector.deviates, shape=wp.static(tile_width), offset=place, bounds_check=False)
            second_radius = wp.tile_load(
                detector.deviates, shape=wp.static(tile_width), offset=place + wp.static(tile_width), bounds_check=False
            )
            cosine = wp.tile_full(shape=wp.static(tile_width), value=sign_of(key[1]), dtype=float)
            sine = cosine
        else:
            word = wp.tile_map(philox2x32_word, wp.tile_map(numbered, lane, first), key[1], key[0])
            upper = wp.tile_map(upper_word, word)
            lower = wp.tile_map(lower_word, word)
            radius = wp.tile_map(normal_radius, upper)
            second_radius = radius
            cosine = wp.tile_map(normal_cosine, lower)
            sine = wp.tile_map(normal_sine, lower)
        # What is off is stood in for by what is there, and not read.
        read_radius = radius
        read_cosine = cosine
        read_sine = sine
        gain_radius = radius
        gain_cosine = cosine
        gain_sine = sine
        offset_radius = radius
        offset_cosine = cosine
        offset_sine = sine
        bad_upper = upper
        bad_lower = lower
        if wp.static(features.read_noise):
            read_word = wp.tile_map(philox2x32_word, wp.tile_map(numbered, lane, first), key[3], key[2])
            read_radius = wp.tile_map(normal_radius, wp.tile_map(upper_word, read_word))
            read_cosine = wp.tile_map(normal_cosine, wp.tile_map(lower_word, read_word))
            read_sine = wp.tile_map(normal_sine, wp.tile_map(lower_word, read_word))
        pattern = key
        if wp.static(features.pattern):
            pattern = image_key(wp.uint32(0), sensor, band_number, STREAM_PATTERN, d.seed_low, d.seed_high)
        if wp.static(features.prnu):
            gain_word = wp.tile_map(philox2x32_word, wp.tile_map(numbered, lane, first), pattern[1], pattern[0])
            gain_radius = wp.tile_map(normal_radius, wp.tile_map(upper_word, gain_word))
            gain_cosine = wp.tile_map(normal_cosine, wp.tile_map(lower_word, gain_word))
            gain_sine = wp.tile_map(normal_sine, wp.tile_map(lower_word, gain_word))
        if wp.static(features.dsnu):
            offset_word = wp.tile_map(
                philox2x32_word, wp.tile_map(numbered, lane, first + OFFSET_PAIRS), pattern[1], pattern[0]
            )
            offset_radius = wp.tile_map(normal_radius, wp.tile_map(upper_word, offset_word))
            offset_cosine = wp.tile_map(normal_cosine, wp.tile_map(lower_word, offset_word))
            offset_sine = wp.tile_map(normal_sine, wp.tile_map(lower_word, offset_word))
        if wp.static(features.bad_pixels):
            bad_word = wp.tile_map(
                philox2x32_word, wp.tile_map(numbered, lane, first + BAD_PAIRS), pattern[1], pattern[0]
            )
            bad_upper = wp.tile_map(upper_word, bad_word)
            bad_lower = wp.tile_map(lower_word, bad_word)
        if wp.static(features.small_means):
            few_word = wp.tile_map(
                philox2x32_word, wp.tile_map(numbered, lane, first + UNIFORM_PAIRS), key[1], key[0]
            )
            upper = wp.tile_map(upper_word, few_word)
            lower = wp.tile_map(lower_word, few_word)
        column_key = key
        if wp.static(features.column_noise):
            column_key = image_key(frame, sensor, band_number, STREAM_COLUMN, d.seed_low, d.seed_high)
        half_read_out(
            signal_w_cm2, d, detector.n_col, start, pixel, upper, radius, cosine, gain_radius, gain_cosine,
            offset_radius, offset_cosine, bad_upper, read_radius, read_cosine, column_key, counts,
        )
        start = start + wp.static(tile_width)
        pixel = pixel + wp.uint32(wp.static(tile_width))
        half_read_out(
            signal_w_cm2, d, detector.n_col, start, pixel, lower, second_radius, sine, gain_radius, gain_sine,
            offset_radius, offset_sine, bad_lower, read_radius, read_sine, column_key, counts,
        )

    return read_out_tile_kernel


@wp.func
def direction_of(word: wp.uint64, second: wp.bool) -> float:
    """Cosine of a pixel pair's word, or sine for its second pixel."""
    if second:
        return normal_sine(lower_word(word))
    return normal_cosine(lower_word(word))


@wp.func
def half_of(word: wp.uint64, second: wp.bool) -> wp.uint32:
    """Upper half of a pixel pair's word, or the lower one for its second pixel."""
    if second:
        return lower_word(word)
    return upper_word(word)


@functools.cache
def make_read_out_rest_kernel(features: ReadOutFeatures) -> wp.Kernel:
    """Kernel over the pixels behind the last whole tile of each image, one thread each, by the same steps."""

    @wp.kernel(module="unique", enable_backward=False)
    def read_out_rest_kernel(
        # in
        signal_w_cm2: wp.array[float],  # (n_view * n_band * n_pixel,)
        view_frame: wp.array[wp.uint32],  # (n_view,)
        view_sensor: wp.array[wp.uint32],  # (n_view,)
        band_id: wp.array[wp.uint32],  # (n_band,)
        detector: Detector,
        n_done: int,  # pixels of each image that whole tiles have covered
        # out
        counts: wp.array[wp.uint16],  # (n_view * n_band * n_pixel,)
    ):
        view, band, rest = wp.tid()
        number = n_done + rest
        tile = number // wp.static(2 * TILE_WIDTH)
        lane = number % wp.static(2 * TILE_WIDTH)
        second = lane >= wp.static(TILE_WIDTH)
        pair = wp.uint32(tile * wp.static(TILE_WIDTH) + lane % wp.static(TILE_WIDTH))
        index = (view * band_id.shape[0] + band) * detector.n_pixel + number
        frame = view_frame[view]
        sensor = view_sensor[view]
        band_number = band_id[band]
        d = detector.pixels[band]
        key = image_key(frame, sensor, band_number, STREAM_READ_NOISE, d.seed_low, d.seed_high)
        pattern = key
        if wp.static(features.pattern):
            pattern = image_key(wp.uint32(0), sensor, band_number, STREAM_PATTERN, d.seed_low, d.seed_high)

        word = philox2x32_word(pair, key[1], key[0])
        radius = normal_radius(upper_word(word))
        direction = direction_of(word, second)
        if wp.static(features.template):
            radius = detector.deviates[template_place(key[0], detector.n_deviate, number - lane) + lane]
            direction = sign_of(key[1])
        level = signal_w_cm2[index]
        if wp.static(features.electrons):
            level = photo_electrons(level, d.e_per_w_cm2, d.background_e, d.most)
        bad_word = wp.uint32(0)
        if wp.static(features.bad_pixels):
            bad_word = half_of(philox2x32_word(pair + BAD_PAIRS, pattern[1], pattern[0]), second)
            level = without_dead(level, bad_word, d.dead_below)
        if wp.static(features.prnu):
            gain_word = philox2x32_word(pair, pattern[1], pattern[0])
            level = scaled(level, normal_radius(upper_word(gain_word)), direction_of(gain_word, second), d.prnu)
        offset_word = wp.uint64(0)
        if wp.static(features.dsnu):
            offset_word = philox2x32_word(pair + OFFSET_PAIRS, pattern[1], pattern[0])
        offset_radius = normal_radius(upper_word(offset_word))
        offset_direction = direction_of(offset_word, second)
        if wp.static(features.electrons and features.dsnu):
            level = with_uneven_dark(level, offset_radius, offset_direction, d.dark_e, d.dsnu)
        if wp.static(features.electrons and not features.dsnu):
            level = with_dark(level, d.dark_e)
        if wp.static(features.electrons and features.bad_pixels):
            level = with_hot(level, bad_word, d.hot_below, d.most)
        if wp.static(features.shot_noise and features.small_means):
            few_word = philox2x32_word(pair + UNIFORM_PAIRS, key[1], key[0])
            level = poisson(level, product(radius, direction), half_of(few_word, second))
        if wp.static(features.shot_noise and not features.small_means):
            level = poisson_of_normal(level, product(radius, direction))
        if wp.static(features.nonlinearity):
            level = bent(level, d.full_level, d.loss_per_level)
        if wp.static(features.electrons and not features.nonlinearity):
            level = held(level, d.full_level)
        if wp.static(features.dsnu and not features.electrons):
            level = shifted(level, offset_radius, offset_direction, d.dsnu)
        if wp.static(features.read_noise):
            read_word = philox2x32_word(pair, key[3], key[2])
            read_direction = direction_of(read_word, second)
            level = shifted(level, normal_radius(upper_word(read_word)), read_direction, d.read_noise_e)
        if wp.static(features.column_noise):
            column_key = image_key(frame, sensor, band_number, STREAM_COLUMN, d.seed_low, d.seed_high)
            column = wp.uint32(number % detector.n_col)
            column_word = philox2x32_word(column, column_key[1], column_key[0])
            column_direction = normal_cosine(lower_word(column_word))
            level = shifted(level, normal_radius(upper_word(column_word)), column_direction, d.column_noise)
        if wp.static(features.bad_pixels and not features.electrons):
            level = with_hot(level, bad_word, d.hot_below, d.most)
        if wp.static(features.electrons):
            counts[index] = counts_of_charge(level, d.counts_per_e, d.offset_counts, d.max_counts)
        else:
            counts[index] = counts_of(
                level, radius, direction, d.per_nei, d.ceiling_nei, d.counts_per_nei, d.offset_counts, d.max_counts
            )

    return read_out_rest_kernel


@wp.kernel(enable_backward=False)
def fill_template_kernel(
    # in
    n_deviate: int,
    seed_low: wp.uint32,
    seed_high: wp.uint32,
    # out
    deviates: wp.array[float],  # (n_deviate + 2 * TILE_WIDTH,)
):
    """The template's unit normal deviates; its first ones stand again at its end."""
    place = wp.tid()
    number = wp.uint32(place % n_deviate)
    key = image_key(wp.uint32(0), wp.uint32(0), wp.uint32(0), STREAM_TEMPLATE, seed_low, seed_high)
    word = philox2x32_word(number >> wp.uint32(1), key[1], key[0])
    deviates[place] = normal_radius(upper_word(word)) * direction_of(word, (number & wp.uint32(1)) == wp.uint32(1))
