"""Detector in NEI terms: noiseless irradiance per pixel in, counts out.

counts = ADC(offset + gain * min(signal / NEI + z, SEI / NEI)), z a fresh unit normal deviate per pixel.

Noise of one image: Philox4x32 keyed by the seed, with counter (frame, sensor, band, stream), yields the image's key;
Philox2x32 with that key and the number of the pixel pair yields 64 bits, which Box-Muller turns into two deviates. Any
frame is therefore the same alone, in any batch, on any worker.
"""

import functools

import warp as wp

from warpsim_kernels.normal import normal_cosine, normal_radius, normal_sine
from warpsim_kernels.philox import lower_word, philox2x32_word, philox4x32, upper_word

TILE_WIDTH = 64
"""Pixel pairs per tile. A tile covers twice as many pixels: the first half takes cosines, the second half sines."""

STREAM_READ_NOISE = wp.constant(wp.uint32(1))


@wp.struct
class NeiReadOut:
    """Scalars of the NEI detector."""

    per_nei: float  # 1 / NEI [cm2/W]
    ceiling_nei: float  # SEI / NEI
    counts_per_nei: float
    offset_counts: float
    max_counts: float
    seed_low: wp.uint32
    seed_high: wp.uint32


@wp.func
def counts_of(
    signal_w_cm2: float,
    radius: float,
    direction: float,
    per_nei: float,
    ceiling_nei: float,
    counts_per_nei: float,
    offset_counts: float,
    max_counts: float,
) -> wp.uint16:
    """Counts of one pixel; the deviate is radius * direction (Box-Muller).

    The detector comes as scalars: with the struct the CPU compiler does not vectorise.
    """
    level = wp.min(signal_w_cm2 * per_nei + radius * direction, ceiling_nei)
    counts = wp.min(wp.max(level * counts_per_nei + offset_counts + 0.5, 0.0), max_counts)
    return wp.uint16(wp.int32(counts))


@wp.func
def _plus(a: wp.uint32, b: wp.uint32) -> wp.uint32:
    return a + b


@wp.func
def image_key(frame: wp.uint32, sensor: wp.uint32, band: wp.uint32, detector: NeiReadOut) -> wp.vec4ui:
    """Random words that belong to one image and one stream."""
    return philox4x32(wp.vec4ui(frame, sensor, band, STREAM_READ_NOISE), detector.seed_low, detector.seed_high)


@functools.cache
def make_read_out_tile_kernel(tile_width: int) -> wp.Kernel:
    """Kernel over all whole tiles of 2 * tile_width pixels of all images.

    Launch and arrays are flat: only then the CPU compiler turns loads, arithmetic and stores into vector
    instructions, which nearly halves the time.
    """

    @wp.kernel(module="unique", enable_backward=False)
    def read_out_tile_kernel(
        # in
        signal_w_cm2: wp.array[float],  # (n_view * n_band * n_pixel,)
        view_frame: wp.array[wp.uint32],  # (n_view,)
        view_sensor: wp.array[wp.uint32],  # (n_view,)
        band_id: wp.array[wp.uint32],  # (n_band,)
        n_pixel: int,
        n_tile: int,  # whole tiles per image
        detector: NeiReadOut,
        # out
        counts: wp.array[wp.uint16],  # (n_view * n_band * n_pixel,)
    ):
        item = wp.tid()
        image = item // n_tile
        tile = item - image * n_tile
        view = image // band_id.shape[0]
        band = image - view * band_id.shape[0]
        key = image_key(view_frame[view], view_sensor[view], band_id[band], detector)
        first_pair = wp.uint32(tile * wp.static(tile_width))
        pair = wp.tile_map(_plus, wp.tile_arange(wp.static(tile_width), dtype=wp.uint32), first_pair)
        word = wp.tile_map(philox2x32_word, pair, key[1], key[0])
        radius = wp.tile_map(normal_radius, wp.tile_map(upper_word, word))
        turn = wp.tile_map(lower_word, word)
        cosine = wp.tile_map(normal_cosine, turn)
        sine = wp.tile_map(normal_sine, turn)

        a = image * n_pixel + tile * wp.static(2 * tile_width)
        signal_a = wp.tile_load(signal_w_cm2, shape=wp.static(tile_width), offset=a, bounds_check=False)
        counts_a = wp.tile_map(
            counts_of, signal_a, radius, cosine, detector.per_nei, detector.ceiling_nei, detector.counts_per_nei,
            detector.offset_counts, detector.max_counts,
        )
        wp.tile_store(counts, counts_a, offset=a, bounds_check=False)

        b = a + wp.static(tile_width)
        signal_b = wp.tile_load(signal_w_cm2, shape=wp.static(tile_width), offset=b, bounds_check=False)
        counts_b = wp.tile_map(
            counts_of, signal_b, radius, sine, detector.per_nei, detector.ceiling_nei, detector.counts_per_nei,
            detector.offset_counts, detector.max_counts,
        )
        wp.tile_store(counts, counts_b, offset=b, bounds_check=False)

    return read_out_tile_kernel


@wp.kernel(enable_backward=False)
def read_out_rest_kernel(
    # in
    signal_w_cm2: wp.array[float],  # (n_view * n_band * n_pixel,)
    view_frame: wp.array[wp.uint32],  # (n_view,)
    view_sensor: wp.array[wp.uint32],  # (n_view,)
    band_id: wp.array[wp.uint32],  # (n_band,)
    n_pixel: int,
    n_done: int,  # pixels of each image that whole tiles have covered
    detector: NeiReadOut,
    # out
    counts: wp.array[wp.uint16],  # (n_view * n_band * n_pixel,)
):
    """The pixels behind the last whole tile of each image, one thread each, by the same rule."""
    view, band, rest = wp.tid()
    pixel = n_done + rest
    tile = pixel // wp.static(2 * TILE_WIDTH)
    lane = pixel % wp.static(2 * TILE_WIDTH)
    key = image_key(view_frame[view], view_sensor[view], band_id[band], detector)
    pair = wp.uint32(tile * wp.static(TILE_WIDTH) + lane % wp.static(TILE_WIDTH))
    word = philox2x32_word(pair, key[1], key[0])
    direction = normal_cosine(lower_word(word))
    if lane >= wp.static(TILE_WIDTH):
        direction = normal_sine(lower_word(word))
    index = (view * band_id.shape[0] + band) * n_pixel + pixel
    counts[index] = counts_of(
        signal_w_cm2[index], normal_radius(upper_word(word)), direction, detector.per_nei, detector.ceiling_nei,
        detector.counts_per_nei, detector.offset_counts, detector.max_counts,
    )
