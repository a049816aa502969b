"""Stage deposit: point sources onto pixels.

Stars and targets go through the same kernel. One thread owns a block of rows of one image and adds, in the order of
the source list, every source whose stamp reaches them. No two threads touch a pixel and the order of additions never
changes, so images are bit-identical on any thread count; the CPU uses one block per image, CUDA a block per few rows.
"""

import functools

import warp as wp

from warpsim_kernels.psf import (
    TablePsf,
    gaussian_half_width_px,
    gaussian_pixel_share,
    table_functions,
    table_half_width_px,
)


@wp.struct
class StampRule:
    """How much of a source may be left out of its stamp, per pixel: the larger of the two limits."""

    cut_w_cm2: float  # absolute
    cut_share: float  # relative to the source's irradiance


@wp.func
def stamp_cut(irradiance_w_cm2: float, rule: StampRule) -> float:
    """Largest share of a source that a pixel outside its stamp may hold; 1 for a source without light."""
    strength = wp.abs(irradiance_w_cm2)
    if strength * rule.cut_share >= rule.cut_w_cm2:
        return rule.cut_share
    if strength <= rule.cut_w_cm2:
        return 1.0
    return rule.cut_w_cm2 / strength


@wp.func
def nearest_pixel(position_px: wp.float64) -> int:
    """The pixel that holds a coordinate; a point on an edge belongs to the pixel after it."""
    return int(wp.floor(position_px + wp.float64(0.5)))


@wp.struct
class Stamp:
    """Pixels of a stamp that lie on the image, within the rows that a thread owns; the ends are one past the last."""

    first_column: int
    end_column: int
    first_row: int
    end_row: int


@wp.func
def stamp_on_image(xy_px: wp.vec2d, half_width_px: int, n_col: int, first_row: int, end_row: int) -> Stamp:
    """The stamp around a source, cut to the image and to the rows first_row ... end_row - 1."""
    stamp = Stamp()
    column = nearest_pixel(xy_px[0])
    row = nearest_pixel(xy_px[1])
    stamp.first_column = wp.max(column - half_width_px, 0)
    stamp.end_column = wp.min(column + half_width_px + 1, n_col)
    stamp.first_row = wp.max(row - half_width_px, first_row)
    stamp.end_row = wp.min(row + half_width_px + 1, end_row)
    return stamp


@functools.cache
def make_deposit_gaussian_kernel(max_width_px: int) -> wp.Kernel:
    """Kernel for Gaussian stamps of at most max_width_px columns.

    The Gaussian separates: a stamp of n x n pixels costs 2 n error-function differences.
    """
    columns_type = wp.types.vector(length=max_width_px, dtype=wp.float32)

    @wp.kernel(module="unique", enable_backward=False)
    def deposit_gaussian_kernel(
        # in
        n_source: wp.array[wp.int32],  # (n_view,)
        source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot)
        source_irradiance_w_cm2: wp.array3d[float],  # (n_view, n_band, n_slot)
        sigma_px: wp.array[float],  # (n_band,)
        rule: StampRule,
        n_row_per_block: int,
        # out (accumulated)
        signal_w_cm2: wp.array4d[float],  # (n_view, n_band, n_row, n_col)
    ):
        view, band, block = wp.tid()
        n_col = signal_w_cm2.shape[3]
        first_row = block * n_row_per_block
        end_row = wp.min(first_row + n_row_per_block, signal_w_cm2.shape[2])
        column_share = columns_type()
        for source in range(n_source[view]):
            irradiance = source_irradiance_w_cm2[view, band, source]
            half = gaussian_half_width_px(sigma_px[band], stamp_cut(irradiance, rule))
            half = wp.min(half, wp.static((max_width_px - 1) // 2))
            xy_px = source_xy_px[view, source]
            stamp = stamp_on_image(xy_px, half, n_col, first_row, end_row)
            if irradiance != 0.0 and stamp.first_row < stamp.end_row:
                for column in range(stamp.first_column, stamp.end_column):
                    share = gaussian_pixel_share(wp.float64(column) - xy_px[0], sigma_px[band])
                    column_share[column - stamp.first_column] = share
                for row in range(stamp.first_row, stamp.end_row):
                    strength = irradiance * gaussian_pixel_share(wp.float64(row) - xy_px[1], sigma_px[band])
                    for column in range(stamp.first_column, stamp.end_column):
                        signal_w_cm2[view, band, row, column] += strength * column_share[column - stamp.first_column]

    return deposit_gaussian_kernel


@functools.cache
def make_deposit_table_kernel(n_point: int) -> wp.Kernel:
    """Kernel for stamps of tabulated point spread functions, interpolated with n_point nodes per axis."""
    column_axis = table_functions(n_point).column_axis
    row_axis = table_functions(n_point).row_axis
    table_pixel_share = table_functions(n_point).share

    @wp.kernel(module="unique", enable_backward=False)
    def deposit_table_kernel(
        # in
        n_source: wp.array[wp.int32],  # (n_view,)
        source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot)
        source_irradiance_w_cm2: wp.array3d[float],  # (n_view, n_band, n_slot)
        psf: wp.array[TablePsf],  # (n_band,)
        table: wp.array[float],  # pixel shares of all bands, flat
        rule: StampRule,
        n_row_per_block: int,
        # out (accumulated)
        signal_w_cm2: wp.array4d[float],  # (n_view, n_band, n_row, n_col)
    ):
        view, band, block = wp.tid()
        n_col = signal_w_cm2.shape[3]
        first_row = block * n_row_per_block
        end_row = wp.min(first_row + n_row_per_block, signal_w_cm2.shape[2])
        shape = psf[band]
        for source in range(n_source[view]):
            irradiance = source_irradiance_w_cm2[view, band, source]
            half = table_half_width_px(table, shape, stamp_cut(irradiance, rule))
            xy_px = source_xy_px[view, source]
            stamp = stamp_on_image(xy_px, half, n_col, first_row, end_row)
            if irradiance != 0.0:
                for row in range(stamp.first_row, stamp.end_row):
                    down = row_axis(wp.float64(row) - xy_px[1], shape)
                    for column in range(stamp.first_column, stamp.end_column):
                        across = column_axis(wp.float64(column) - xy_px[0], shape)
                        share = table_pixel_share(table, shape, down, across)
                        signal_w_cm2[view, band, row, column] += irradiance * share

    return deposit_table_kernel


@wp.kernel(enable_backward=False)
def size_gaussian_stamps_kernel(
    # in
    irradiance_w_cm2: wp.array2d[float],  # (n_band, n_source)
    sigma_px: wp.array[float],  # (n_band,)
    rule: StampRule,
    # out
    half_width_px: wp.array2d[wp.int32],  # (n_band, n_source)
):
    """Half-widths of Gaussian stamps."""
    band, source = wp.tid()
    cut = stamp_cut(irradiance_w_cm2[band, source], rule)
    half_width_px[band, source] = gaussian_half_width_px(sigma_px[band], cut)


@wp.kernel(enable_backward=False)
def size_table_stamps_kernel(
    # in
    irradiance_w_cm2: wp.array2d[float],  # (n_band, n_source)
    psf: wp.array[TablePsf],  # (n_band,)
    table: wp.array[float],  # pixel shares of all bands, flat
    rule: StampRule,
    # out
    half_width_px: wp.array2d[wp.int32],  # (n_band, n_source)
):
    """Half-widths of tabulated stamps."""
    band, source = wp.tid()
    cut = stamp_cut(irradiance_w_cm2[band, source], rule)
    half_width_px[band, source] = table_half_width_px(table, psf[band], cut)


@wp.kernel(enable_backward=False)
def gaussian_stamp_kernel(
    # in
    source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot)
    source_irradiance_w_cm2: wp.array3d[float],  # (n_view, n_band, n_slot)
    sigma_px: wp.array[float],  # (n_band,)
    rule: StampRule,
    # out
    peak_share: wp.array3d[float],  # (n_view, n_band, n_source) share of the source's own pixel
    stamp_share: wp.array3d[float],  # (n_view, n_band, n_source) share inside the whole stamp
):
    """What the Gaussian stamps of the first n_source sources hold."""
    view, band, source = wp.tid()
    sigma = sigma_px[band]
    half = gaussian_half_width_px(sigma, stamp_cut(source_irradiance_w_cm2[view, band, source], rule))
    x = source_xy_px[view, source][0]
    y = source_xy_px[view, source][1]
    dx = wp.float64(nearest_pixel(x)) - x
    dy = wp.float64(nearest_pixel(y)) - y
    across = float(0.0)
    down = float(0.0)
    for step in range(-half, half + 1):
        across += gaussian_pixel_share(wp.float64(step) + dx, sigma)
        down += gaussian_pixel_share(wp.float64(step) + dy, sigma)
    peak_share[view, band, source] = gaussian_pixel_share(dx, sigma) * gaussian_pixel_share(dy, sigma)
    stamp_share[view, band, source] = across * down


@functools.cache
def make_table_stamp_kernel(n_point: int) -> wp.Kernel:
    """Kernel for what the tabulated stamps of the first n_source sources hold."""
    column_axis = table_functions(n_point).column_axis
    row_axis = table_functions(n_point).row_axis
    table_pixel_share = table_functions(n_point).share

    @wp.kernel(module="unique", enable_backward=False)
    def table_stamp_kernel(
        # in
        source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot)
        source_irradiance_w_cm2: wp.array3d[float],  # (n_view, n_band, n_slot)
        psf: wp.array[TablePsf],  # (n_band,)
        table: wp.array[float],  # pixel shares of all bands, flat
        rule: StampRule,
        # out
        peak_share: wp.array3d[float],  # (n_view, n_band, n_source) share of the source's own pixel
        stamp_share: wp.array3d[float],  # (n_view, n_band, n_source) share inside the whole stamp
    ):
        view, band, source = wp.tid()
        shape = psf[band]
        half = table_half_width_px(table, shape, stamp_cut(source_irradiance_w_cm2[view, band, source], rule))
        x = source_xy_px[view, source][0]
        y = source_xy_px[view, source][1]
        dx = wp.float64(nearest_pixel(x)) - x
        dy = wp.float64(nearest_pixel(y)) - y
        total = wp.float64(0.0)
        for row in range(-half, half + 1):
            down = row_axis(wp.float64(row) + dy, shape)
            for column in range(-half, half + 1):
                across = column_axis(wp.float64(column) + dx, shape)
                total += wp.float64(table_pixel_share(table, shape, down, across))
        peak_share[view, band, source] = table_pixel_share(table, shape, row_axis(dy, shape), column_axis(dx, shape))
        stamp_share[view, band, source] = float(total)

    return table_stamp_kernel
