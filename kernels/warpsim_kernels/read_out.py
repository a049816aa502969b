"""Read-out: noiseless irradiance per pixel in, counts out.

An image is cut into strips of neighbouring pixels, row after row, and blocks of strips, which share random keys
(random_numbers.py). Pixels of the first half of a strip make pairs with those of the second (pixel_pairs.py).

Point sources touch few strips. The stage `deposit` flags those that it adds light to; only they are read, and
set back to 0 for the next image, so a sparse image's light stays in the cache.
"""

import functools

import warp as wp

from warpsim_kernels.canvas import N_PAIR, STRIP_PIXELS, STRIPS_PER_BLOCK, flags_of_image
from warpsim_kernels.detector import ReadOutFeatures, detector_struct
from warpsim_kernels.pixel_pairs import make_counts_of_pairs, make_map_plane, make_noise_keys, mapped_functions
from warpsim_kernels.random_numbers import numbered


@functools.cache
def make_read_out_kernel(features: ReadOutFeatures, ragged: bool = False) -> wp.Kernel:
    """Kernel over the blocks of strips of all images.

    Arrays of whole strips are flat: only then the CPU compiler turns loads, arithmetic and stores into vector
    instructions. The pixels behind the last whole strip of an image take the ragged kernel, by the same steps.
    """
    noise_keys, map_plane = make_noise_keys(features), make_map_plane(features)
    counts_of_pairs, Arrays = make_counts_of_pairs(features, N_PAIR), detector_struct(features)
    Light = wp.array2d[float] if ragged else wp.array[float]
    Counts = wp.array2d[wp.uint16] if ragged else wp.array[wp.uint16]

    @wp.kernel(module="unique", enable_backward=False)
    def read_out_kernel(
        # in
        view_frame: wp.array[wp.uint32],  # (n_view,)
        view_sensor: wp.array[wp.uint32],  # (n_view,) index among the detector's keys
        band_id: wp.array[wp.uint32],  # (n_band,)
        detector: Arrays,
        first_strip: int,  # of each image
        end_strip: int,
        zero_offset: int,  # offset in signal_w_cm2 of a strip that is always 0; not read if ragged
        first_image: int,  # among the counts
        touched: wp.array[wp.uint8],  # (n_view * n_band * n_flag,) 1 for a strip with light; not read if ragged
        # out
        counts: Counts,  # (n_image * n_pixel,), or (n_image, n_pixel)
        # in and out
        signal_w_cm2: Light,  # (n_view * n_band * n_pixel + STRIP_PIXELS,), or (n_view * n_band, n_pixel); set to 0
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
        d = detector.pixels[band]
        keys = noise_keys(frame, band_id[band], block, sensor_key)
        plane = map_plane(detector, int(view_sensor[view]), band_id.shape[0], band)
        flag_offset = image * flags_of_image(detector.n_pixel)
        for strip in range(
            wp.max(block * STRIPS_PER_BLOCK, first_strip), wp.min((block + 1) * STRIPS_PER_BLOCK, end_strip)
        ):
            first = wp.uint32((strip - block * STRIPS_PER_BLOCK) * N_PAIR)
            pixel = strip * STRIP_PIXELS
            step = wp.tile_arange(N_PAIR, dtype=wp.uint32)
            pairs = wp.tile_map(numbered, step, first)
            pixels = wp.tile_map(numbered, step, wp.uint32(pixel))
            if wp.static(ragged):
                light = signal_w_cm2[image]
                light_1 = wp.tile_load(light, shape=N_PAIR, offset=pixel)
                light_2 = wp.tile_load(light, shape=N_PAIR, offset=pixel + N_PAIR)
            else:
                pixel_offset = image * detector.n_pixel + pixel
                is_touched = touched[flag_offset + strip] != wp.uint8(0)
                light_offset = wp.where(is_touched, pixel_offset, zero_offset)
                light_1 = wp.tile_load(signal_w_cm2, shape=N_PAIR, offset=light_offset, bounds_check=False)
                light_2 = wp.tile_load(signal_w_cm2, shape=N_PAIR, offset=light_offset + N_PAIR, bounds_check=False)
            counts_1, counts_2 = counts_of_pairs(pairs, pixels, light_1, light_2, d, keys, detector, plane + pixel)
            zeros = wp.tile_zeros(shape=STRIP_PIXELS, dtype=float)
            if wp.static(ragged):
                read = counts[first_image + image]
                wp.tile_store(read, counts_1, offset=pixel)
                wp.tile_store(read, counts_2, offset=pixel + N_PAIR)
                wp.tile_store(light, zeros, offset=pixel)
            else:
                counts_offset = (first_image + image) * detector.n_pixel + pixel
                wp.tile_store(counts, counts_1, offset=counts_offset, bounds_check=False)
                wp.tile_store(counts, counts_2, offset=counts_offset + N_PAIR, bounds_check=False)
                if is_touched:
                    wp.tile_store(signal_w_cm2, zeros, offset=pixel_offset, bounds_check=False)

    return read_out_kernel
