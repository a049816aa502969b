"""Deposit and read-out at once, for blocks of threads: light never leaves the memory that a block shares.

A block takes a run of neighbouring pixels of one image. Its threads look at a source each; those whose stamps touch the
run are listed, in the order of the source list. Each thread then owns pixels, and adds the light of all that is listed
to them in that order; so no two threads add to one pixel, and the sums are those of the stage `deposit`. The counts are
those of the stage `read_out`: both read pixel pairs by the same functions (pixel_pairs.py).
"""

import functools

import warp as wp

from warpsim_kernels.canvas import N_PAIR, PAIRS_PER_BLOCK
from warpsim_kernels.detector import Detector, ReadOutFeatures
from warpsim_kernels.pixel_pairs import NoiseKeys, make_counts_of_pairs, make_noise_keys, mapped_functions
from warpsim_kernels.shared_memory import address_function, element_functions, store, wait_for_block
from warpsim_kernels.spots import SpotFunctions
from warpsim_kernels.stamps import columns_of_row

RUN_PIXELS = 8192
"""Pixels of a run; 32 KiB of light."""

BLOCK_PIXELS = 2 * PAIRS_PER_BLOCK
"""Pixels that share random keys."""

LEAST_THREADS = 512
"""Threads of a multiprocessor for which the compiler keeps registers, whole blocks of them."""

BLOCK_SIZES = (64, 128, 256, 512, 1024)
"""Threads that a block may have: whole strips, and powers of two."""

BLOCKS_PER_RUN = RUN_PIXELS // BLOCK_PIXELS

PAIR_MASK = wp.constant(wp.uint32(N_PAIR - 1))

COLUMN_THREADS = 16
"""Threads that draw a row of a stamp together, each every sixteenth column of the image."""


SharedLight = wp.tile(dtype=float, shape=(RUN_PIXELS,), storage="shared")


@wp.struct
class Run:
    """Neighbouring pixels of an image, row after row and over their ends."""

    first_pixel: int
    n_pixel: int
    first_row: int  # the rows that hold them
    end_row: int
    n_col: int


@wp.func
def run_of(number: int, n_pixel: int, n_col: int) -> Run:
    """A run of an image by its number."""
    run = Run()
    run.first_pixel = number * RUN_PIXELS
    run.n_pixel = wp.min(n_pixel - run.first_pixel, RUN_PIXELS)
    run.first_row = run.first_pixel // n_col
    run.end_row = (run.first_pixel + run.n_pixel - 1) // n_col + 1
    run.n_col = n_col
    return run


@functools.cache
def make_deposit_read_out_kernel(drawing: SpotFunctions, features: ReadOutFeatures, n_thread: int) -> wp.Kernel:
    """Kernel over the runs of all images, for blocks of n_thread threads: 64, 128, 256, 512 or 1024.

    Raises:
        ValueError: Another number of threads.
    """
    if n_thread not in BLOCK_SIZES:
        raise ValueError(f"n_thread: must be one of {BLOCK_SIZES}, got {n_thread}")
    Tables, Spot, row_of, light_at = drawing.Tables, drawing.Spot, drawing.row_of, drawing.light_at
    n_row, bounds = n_thread // COLUMN_THREADS, (n_thread, LEAST_THREADS // n_thread)
    noise_keys = make_noise_keys(features)
    counts_of_pairs = make_counts_of_pairs(features, n_thread)
    light_at_pixel, add_to_pixel = element_functions(RUN_PIXELS)
    list_address = address_function(int, n_thread)
    keys_address = address_function(NoiseKeys, BLOCKS_PER_RUN)

    @wp.func
    def add_spot(light: SharedLight, tables: Tables, band: int, spot: Spot, run: Run, thread: int):
        """Add the light of a spot to those pixels of the run that a thread owns."""
        own = thread // COLUMN_THREADS
        first_row = wp.max(spot.stamp.window.first_row, run.first_row)
        end_row = wp.min(spot.stamp.window.end_row, run.end_row)
        row = first_row + ((own - first_row) & wp.static(n_row - 1))
        while row < end_row:
            columns = columns_of_row(spot.stamp, row)
            before = row * run.n_col - run.first_pixel  # index of the row's first pixel in the run
            first = wp.max(columns[0], -before)
            end = wp.min(columns[1], RUN_PIXELS - before)
            column = first + ((thread - first) & wp.static(COLUMN_THREADS - 1))
            in_row = row_of(tables, band, spot, row)
            while column < end:
                add_to_pixel(light, before + column, light_at(tables, band, spot, in_row, column))
                column += COLUMN_THREADS
            row += wp.static(n_row)

    @wp.func
    def add_sources(
        light: SharedLight,
        listed: wp.array[int],
        n_source: int,
        spots: wp.array3d[Spot],
        tables: Tables,
        view: int,
        band: int,
        run: Run,
        thread: int,
    ):
        """Add the light of all sources, n_thread of them at a time."""
        for first_slot in range(0, n_source, n_thread):
            slot = first_slot + thread
            hit = int(0)
            if slot < n_source:
                window = spots[view, band, slot].stamp.window
                if window.first_row < run.end_row and window.end_row > run.first_row:
                    hit = 1
            ranks = wp.tile_scan_inclusive(wp.tile(hit))
            if hit == 1:
                listed[wp.untile(ranks) - 1] = slot
            n_listed = wp.tile_extract(ranks, wp.static(n_thread - 1))
            wait_for_block()
            for k in range(n_listed):
                add_spot(light, tables, band, spots[view, band, listed[k]], run, thread)
            wait_for_block()

    @wp.func
    def read_out_run(
        light: SharedLight,
        keys: wp.array[NoiseKeys],
        detector: Detector,
        image: int,
        band: int,
        run: Run,
        thread: int,
        counts: wp.array[wp.uint16],
    ):
        """Counts of the run's pixels."""
        d = detector.pixels[band]
        first_count = wp.uint64(image) * wp.uint64(detector.n_pixel) + wp.uint64(run.first_pixel)
        own = wp.uint32(thread)
        for block in range((run.n_pixel + wp.static(BLOCK_PIXELS - 1)) // BLOCK_PIXELS):
            key = keys[block]
            for step in range(wp.static(PAIRS_PER_BLOCK // n_thread)):
                # Threads are whole strips: a step further is twice as many pixels further.
                at = wp.uint32(block * BLOCK_PIXELS + 2 * n_thread * step) + own + (own & ~PAIR_MASK)
                if at < wp.uint32(run.n_pixel):
                    counts_1, counts_2 = counts_of_pairs(
                        wp.tile(own + wp.uint32(n_thread * step)),
                        wp.tile(wp.uint32(run.first_pixel) + at),
                        wp.tile(light_at_pixel(light, at)),
                        wp.tile(light_at_pixel(light, at + wp.uint32(N_PAIR))),
                        d,
                        key,
                        detector,
                        0,
                    )
                    store(counts, first_count + wp.uint64(at), wp.untile(counts_1))
                    store(counts, first_count + wp.uint64(at) + wp.uint64(N_PAIR), wp.untile(counts_2))

    @wp.kernel(module="unique", enable_backward=False, grid_stride=False, launch_bounds=bounds)
    def deposit_read_out_kernel(
        # in
        view_frame: wp.array[wp.uint32],  # (n_view,)
        view_sensor: wp.array[wp.uint32],  # (n_view,) index among the detector's keys
        band_id: wp.array[wp.uint32],  # (n_band,)
        detector: Detector,
        n_source: wp.array[wp.int32],  # (n_view,)
        spots: wp.array3d[Spot],  # (n_view, n_band, n_slot)
        tables: Tables,
        # out
        counts: wp.array[wp.uint16],  # (n_image * n_pixel,)
    ):
        if wp.static(False):
            mapped_functions()
        item, thread = wp.tid()
        n_run = (detector.n_pixel + wp.static(RUN_PIXELS - 1)) // RUN_PIXELS
        image = item // n_run
        number = item - image * n_run
        view = image // band_id.shape[0]
        band = image - view * band_id.shape[0]
        run = run_of(number, detector.n_pixel, detector.n_col)
        light = wp.tile_zeros(shape=wp.static(RUN_PIXELS), dtype=float, storage="shared")
        list_tile = wp.tile_empty(shape=wp.static(n_thread), dtype=int, storage="shared")
        listed = wp.array(ptr=list_address(list_tile), shape=(n_thread,), dtype=int)
        keys_tile = wp.tile_empty(shape=wp.static(BLOCKS_PER_RUN), dtype=NoiseKeys, storage="shared")
        keys = wp.array(ptr=keys_address(keys_tile), shape=(BLOCKS_PER_RUN,), dtype=NoiseKeys)

        sensor_key = detector.keys[int(view_sensor[view])]
        for block in range(thread, BLOCKS_PER_RUN, n_thread):
            keys[block] = noise_keys(view_frame[view], band_id[band], number * BLOCKS_PER_RUN + block, sensor_key)
        wait_for_block()
        add_sources(light, listed, n_source[view], spots, tables, view, band, run, thread)
        read_out_run(light, keys, detector, image, band, run, thread, counts)

    return deposit_read_out_kernel
