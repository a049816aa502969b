"""Read-out: noiseless irradiance per pixel in, counts out.

A detector is a row of steps (pixel.py), of which a kernel holds those that a scene needs; what is off costs nothing.

    in NEI terms   dead -> gain -> non-linearity -> offset -> column -> hot -> noise, saturation, converter
    in electrons   light + background -> dead -> gain -> dark current -> hot -> shot noise -> well, non-linearity
                   -> read noise -> column -> converter

An image is cut into strips of neighbouring pixels, row after row, and blocks of strips, which share random keys
(streams.py). The deviates of a pixel pair are the cosine and the sine of one angle (normal.py). The first half of a
strip takes the cosines, the second half the sines.

Point sources leave most strips dark. The stage `deposit` flags those that it adds light to; only they are read, and
made dark again for the next image, so a sparse image's light stays in the cache.
"""

import functools

import warp as wp

from warpsim_kernels.detector import Detector, PixelScalars, ReadOutFeatures
from warpsim_kernels.normal import normal_cosine, normal_radius, normal_sine
from warpsim_kernels.pixel import (
    bent,
    counts_of,
    counts_of_charge,
    held,
    photo_electrons,
    scaled,
    shifted,
    with_dark,
    with_hot,
    with_uneven_dark,
    without_dead,
)
from warpsim_kernels.poisson import poisson, poisson_of_normal
from warpsim_kernels.streams import (
    STREAM_BAD,
    STREAM_COLUMN,
    STREAM_FEW,
    STREAM_GAIN,
    STREAM_NOISE,
    STREAM_OFFSET,
    STREAM_READ_NOISE,
    column_of,
    hashed,
    numbered,
    stream_key,
)
from warpsim_kernels.strips import N_PAIR, STRIP_PIXELS, STRIPS_PER_BLOCK, flags_of_image

Floats = wp.tile(dtype=float, shape=(N_PAIR,))
Words = wp.tile(dtype=wp.uint32, shape=(N_PAIR,))


@wp.func
def mapped_functions():
    """What is handed to tile_map, which Warp's hash of a kernel leaves out; assignments are in it. Never called."""
    _a, _b, _c, _d, _e, _f = numbered, column_of, hashed, normal_radius, normal_cosine, normal_sine
    _g, _h, _i, _j, _k = without_dead, with_hot, scaled, shifted, bent
    _l, _m, _n, _o = photo_electrons, with_dark, with_uneven_dark, held
    _p, _q, _r, _s = poisson, poisson_of_normal, counts_of, counts_of_charge


@wp.func
def words_of_strip(key: wp.vec4ui, first: wp.uint32):
    """Random words of the pixels of a strip, of its first half and of its second; pairs are numbered from `first`."""
    number = wp.tile_map(numbered, wp.tile_arange(N_PAIR, dtype=wp.uint32), first)
    return wp.tile_map(hashed, number, key[0], key[1]), wp.tile_map(hashed, number, key[2], key[3])


@wp.func
def deviates_of_strip(key: wp.vec4ui, first: wp.uint32):
    """Unit normal deviates of the pixels of a strip, likewise."""
    word, angle = words_of_strip(key, first)
    radius = wp.tile_map(normal_radius, word)
    return wp.tile_map(normal_cosine, radius, angle), wp.tile_map(normal_sine, radius, angle)


@wp.func
def column_deviates(key: wp.vec4ui, first_pixel: wp.uint32, n_col: int):
    """Unit normal deviates of the columns in which N_PAIR neighbouring pixels of an image lie."""
    place = wp.tile_map(numbered, wp.tile_arange(N_PAIR, dtype=wp.uint32), first_pixel)
    column = wp.tile_map(column_of, place, wp.uint32(n_col), wp.float64(1.0) / wp.float64(n_col))
    radius = wp.tile_map(normal_radius, wp.tile_map(hashed, column, key[0], key[1]))
    return wp.tile_map(normal_cosine, radius, wp.tile_map(hashed, column, key[2], key[3]))


@functools.cache
def make_half_read_out(features: ReadOutFeatures) -> wp.Function:
    """Function that makes counts of the light in half a strip."""

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
            level = wp.tile_map(held, level, d.full_level)
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


@functools.cache
def make_read_out_kernel(features: ReadOutFeatures, ragged: bool = False) -> wp.Kernel:
    """Kernel over the blocks of strips of all images.

    Arrays of whole strips are flat: only then the CPU compiler turns loads, arithmetic and stores into vector
    instructions. The pixels behind the last whole strip of an image take the ragged kernel, by the same steps.
    """
    half_read_out = make_half_read_out(features)
    Light = wp.array2d[float] if ragged else wp.array[float]
    Counts = wp.array2d[wp.uint16] if ragged else wp.array[wp.uint16]

    @wp.kernel(module="unique", enable_backward=False)
    def read_out_kernel(
        # in
        view_frame: wp.array[wp.uint32],  # (n_view,)
        view_sensor: wp.array[wp.uint32],  # (n_view,) index among the detector's keys
        band_id: wp.array[wp.uint32],  # (n_band,)
        detector: Detector,
        first_strip: int,  # of each image
        end_strip: int,
        dark_place: int,  # where signal_w_cm2 has a strip that is always dark; not read if ragged
        first_image: int,  # among the counts
        lit: wp.array[wp.uint8],  # (n_view * n_band * n_flag,) strips with light; not read if ragged
        # out
        counts: Counts,  # (n_image * n_pixel,), or (n_image, n_pixel)
        # in and out
        signal_w_cm2: Light,  # (n_view * n_band * n_pixel + STRIP_PIXELS,), or (n_view * n_band, n_pixel); made dark
    ):
        if wp.static(False):
            mapped_functions()
        item = wp.tid()
        first_block = first_strip // STRIPS_PER_BLOCK
        n_block = (end_strip - 1) // STRIPS_PER_BLOCK + 1 - first_block
        image = item // n_block
        block = first_block + item - image * n_block
        view = image // band_id.shape[0]
        band = image - view * band_id.shape[0]
        frame = view_frame[view]
        sensor_key = detector.keys[int(view_sensor[view])]
        number = band_id[band]
        d = detector.pixels[band]
        still = wp.uint32(0)  # the frame of what stays with a pixel
        key = stream_key(frame, number, STREAM_NOISE, block, sensor_key)
        # What is off is stood in for by what is there, and not read.
        read_key = key
        gain_key = key
        offset_key = key
        bad_key = key
        few_key = key
        column_key = key
        if wp.static(features.read_noise):
            read_key = stream_key(frame, number, STREAM_READ_NOISE, block, sensor_key)
        if wp.static(features.prnu):
            gain_key = stream_key(still, number, STREAM_GAIN, block, sensor_key)
        if wp.static(features.dsnu):
            offset_key = stream_key(still, number, STREAM_OFFSET, block, sensor_key)
        if wp.static(features.bad_pixels):
            bad_key = stream_key(still, number, STREAM_BAD, block, sensor_key)
        if wp.static(features.small_means):
            few_key = stream_key(frame, number, STREAM_FEW, block, sensor_key)
        if wp.static(features.column_noise):
            column_key = stream_key(frame, number, STREAM_COLUMN, 0, sensor_key)

        flag_place = image * flags_of_image(detector.n_pixel)
        for strip in range(
            wp.max(block * STRIPS_PER_BLOCK, first_strip), wp.min((block + 1) * STRIPS_PER_BLOCK, end_strip)
        ):
            first = wp.uint32((strip - block * STRIPS_PER_BLOCK) * N_PAIR)
            pixel = strip * STRIP_PIXELS
            noise_1, noise_2 = deviates_of_strip(key, first)
            read_1 = noise_1
            read_2 = noise_2
            gain_1 = noise_1
            gain_2 = noise_2
            offset_1 = noise_1
            offset_2 = noise_2
            column_1 = noise_1
            column_2 = noise_2
            bad_1 = wp.tile_zeros(shape=N_PAIR, dtype=wp.uint32)
            bad_2 = bad_1
            few_1 = bad_1
            few_2 = bad_1
            if wp.static(features.read_noise):
                read_1, read_2 = deviates_of_strip(read_key, first)
            if wp.static(features.prnu):
                gain_1, gain_2 = deviates_of_strip(gain_key, first)
            if wp.static(features.dsnu):
                offset_1, offset_2 = deviates_of_strip(offset_key, first)
            if wp.static(features.bad_pixels):
                bad_1, bad_2 = words_of_strip(bad_key, first)
            if wp.static(features.small_means):
                few_1, few_2 = words_of_strip(few_key, first)
            if wp.static(features.column_noise):
                column_1 = column_deviates(column_key, wp.uint32(pixel), detector.n_col)
                column_2 = column_deviates(column_key, wp.uint32(pixel + N_PAIR), detector.n_col)
            if wp.static(ragged):
                light = signal_w_cm2[image]
                light_1 = wp.tile_load(light, shape=N_PAIR, offset=pixel)
                light_2 = wp.tile_load(light, shape=N_PAIR, offset=pixel + N_PAIR)
            else:
                place = image * detector.n_pixel + pixel
                is_lit = lit[flag_place + strip] != wp.uint8(0)
                light_place = wp.where(is_lit, place, dark_place)
                light_1 = wp.tile_load(signal_w_cm2, shape=N_PAIR, offset=light_place, bounds_check=False)
                light_2 = wp.tile_load(signal_w_cm2, shape=N_PAIR, offset=light_place + N_PAIR, bounds_check=False)
            counts_1 = half_read_out(light_1, d, noise_1, gain_1, offset_1, read_1, column_1, bad_1, few_1)
            counts_2 = half_read_out(light_2, d, noise_2, gain_2, offset_2, read_2, column_2, bad_2, few_2)
            dark = wp.tile_zeros(shape=STRIP_PIXELS, dtype=float)
            if wp.static(ragged):
                read = counts[first_image + image]
                wp.tile_store(read, counts_1, offset=pixel)
                wp.tile_store(read, counts_2, offset=pixel + N_PAIR)
                wp.tile_store(light, dark, offset=pixel)
            else:
                counts_place = (first_image + image) * detector.n_pixel + pixel
                wp.tile_store(counts, counts_1, offset=counts_place, bounds_check=False)
                wp.tile_store(counts, counts_2, offset=counts_place + N_PAIR, bounds_check=False)
                if is_lit:
                    wp.tile_store(signal_w_cm2, dark, offset=place, bounds_check=False)

    return read_out_kernel
