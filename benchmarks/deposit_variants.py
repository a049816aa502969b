"""Other ways to draw than the product's, for comparison: error functions, one thread per source, and other sums.

The product gathers: a thread owns pixels and adds sources in list order, in float32. Here each source has a thread of
its own and scatters its stamp, by float32 atomics (the order of additions varies from run to run on CUDA) or as whole
numbers of a quantum (any order gives the same sum); and there is the gather in float64.
"""

import functools
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.psf import (
    TABLE_SIMD_WIDTH,
    TablePsf,
    gaussian_pixel_fraction,
    gaussian_reach_px,
    table_functions,
    table_reach_px,
    table_wing,
)
from warpsim_kernels.stamps import (
    Stamp,
    StampRule,
    block_window,
    columns_of_row,
    stamp_around,
    stamp_cut,
    whole_image,
)

import warpsim as ws
from warpsim.optics.table_upload import overlapping, upload_tables
from warpsim.optics.tables import epsf_table

QUANTUM = 2.0**-40
"""Of fixed-point sums, where the brightest source has the irradiance 1: 8e6 of them fit, and 1e-12 of one shows."""


@functools.cache
def make_add_stamp(n_point: int, sum_type: Any, scatters: bool) -> wp.Function:
    """The function that adds a stamp to an image of sums: float32, float64, or int64 in units of QUANTUM."""
    read = table_functions(n_point)
    nodes_type, offset_in, row_in, pixel_fractions = read.Nodes, read.offset_in, read.row_in, read.fractions
    vector_type = wp.types.vector(length=TABLE_SIMD_WIDTH, dtype=wp.float32)
    fixed_point = sum_type is wp.int64

    @wp.func
    def add_stamp(
        image: wp.array2d[sum_type],
        position_px: wp.vec2d,
        strength: float,
        psf: TablePsf,
        nodes: wp.array[nodes_type],
        stamp: Stamp,
    ):
        offset = offset_in(wp.float64(stamp.column) - position_px[0], wp.float64(stamp.row) - position_px[1], psf)
        fractions = vector_type()
        for row in range(stamp.window.first_row, stamp.window.end_row):
            in_row = row_in(offset, row - stamp.row, psf)
            columns = columns_of_row(stamp, row)
            served = wp.int32(-1)
            for column in range(columns[0], columns[1]):
                step = column - stamp.column
                fraction = wp.float32(0.0)
                if in_row.first < 0 or step < offset.first_step or step >= offset.end_step:
                    fraction = table_wing(psf, offset.dx_px + float(step), in_row.distance_px)
                else:
                    block = (psf.zero_pixel + step) // TABLE_SIMD_WIDTH
                    if block != served:
                        fractions = pixel_fractions(nodes, psf, offset, in_row, block)
                        served = block
                    fraction = fractions[psf.zero_pixel + step - block * TABLE_SIMD_WIDTH]
                if wp.static(fixed_point):
                    light = wp.float64(strength) * wp.float64(fraction)
                    wp.atomic_add(image, row, column, wp.int64(wp.round(light * wp.static(wp.float64(1.0 / QUANTUM)))))
                elif wp.static(scatters):
                    wp.atomic_add(image, row, column, strength * fraction)
                else:
                    image[row, column] += sum_type(strength) * sum_type(fraction)

    return add_stamp


@functools.cache
def make_scatter_kernel(n_point: int, fixed_point: bool) -> wp.Kernel:
    """Kernel with one thread per source; sums are float32, or int64 in units of QUANTUM."""
    nodes_type = table_functions(n_point).Nodes
    sum_type = wp.int64 if fixed_point else wp.float32
    add_stamp = make_add_stamp(n_point, sum_type, True)

    @wp.kernel(module="unique", enable_backward=False)
    def scatter_kernel(
        # in
        xy_px: wp.array[wp.vec2d],  # (n_source,)
        irradiance: wp.array[float],  # (n_source,)
        psfs: wp.array[TablePsf],  # (1,)
        table: wp.array[float],
        nodes: wp.array[nodes_type],
        rule: StampRule,
        # out (accumulated)
        image: wp.array2d[sum_type],  # (n_row, n_col)
    ):
        source = wp.tid()
        reach_px = table_reach_px(table, psfs[0], stamp_cut(irradiance[source], 0, rule))
        window = whole_image(image.shape[0], image.shape[1])
        stamp = stamp_around(xy_px[source], reach_px, psfs[0].pixel_aspect, window)
        add_stamp(image, xy_px[source], irradiance[source], psfs[0], nodes, stamp)

    return scatter_kernel


@functools.cache
def make_gather_kernel(n_point: int, real: Any) -> wp.Kernel:
    """The product's gather for one image, pixel by pixel, with sums of a type."""
    nodes_type = table_functions(n_point).Nodes
    add_stamp = make_add_stamp(n_point, real, False)

    @wp.kernel(module="unique", enable_backward=False)
    def gather_kernel(
        # in
        xy_px: wp.array[wp.vec2d],  # (n_source,)
        irradiance: wp.array[float],  # (n_source,)
        psfs: wp.array[TablePsf],  # (1,)
        table: wp.array[float],
        nodes: wp.array[nodes_type],
        rule: StampRule,
        n_row_per_block: int,
        # out (accumulated)
        image: wp.array2d[real],  # (n_row, n_col)
    ):
        window = block_window(image.shape[0], image.shape[1], wp.tid(), n_row_per_block)
        for source in range(xy_px.shape[0]):
            reach_px = table_reach_px(table, psfs[0], stamp_cut(irradiance[source], 0, rule))
            stamp = stamp_around(xy_px[source], reach_px, psfs[0].pixel_aspect, window)
            if stamp.window.first_row < stamp.window.end_row:
                add_stamp(image, xy_px[source], irradiance[source], psfs[0], nodes, stamp)

    return gather_kernel


VARIANTS = ("gather float32", "gather float64", "scatter float32", "scatter fixed point")


class Variant:
    """One way to draw sources on one image.

    Args:
        name: One of VARIANTS; "gather float32" sums as the product does, pixel by pixel.
        psf: An Airy pattern.
        shape: (n_row, n_col).
        device: Where it is drawn.
        n_row_per_block: Rows that a gathering thread owns.
    """

    def __init__(self, name: str, psf: ws.PsfAiry, shape: tuple[int, int], device: Any, n_row_per_block: int) -> None:
        table = epsf_table(psf)
        self._psf, self._table = upload_tables([table], device)
        self._nodes = overlapping(self._table, table.n_point * TABLE_SIMD_WIDTH)
        self._gathers, self._fixed = name.startswith("gather"), name.endswith("fixed point")
        real = wp.float64 if name.endswith("float64") else wp.float32
        if self._gathers:
            self._kernel = make_gather_kernel(table.n_point, real)
        else:
            self._kernel = make_scatter_kernel(table.n_point, self._fixed)
        self._n_row_per_block = n_row_per_block
        self.image = wp.zeros(shape, dtype=wp.int64 if self._fixed else real, device=device)

    def draw(self, xy_px: wp.array, irradiance: wp.array, rule: Any) -> None:
        """Overwrite the image; the brightest irradiance is 1 at most."""
        self.image.zero_()
        inputs = [xy_px, irradiance, self._psf, self._table, self._nodes, rule]
        n_block = -(-self.image.shape[0] // self._n_row_per_block)
        if self._gathers:
            wp.launch(self._kernel, n_block, [*inputs, self._n_row_per_block], [self.image], device=self.image.device)
        else:
            wp.launch(self._kernel, len(xy_px), inputs, [self.image], device=self.image.device)

    def values(self) -> np.ndarray:
        """The image in units of irradiance, float64."""
        return np.asarray(self.image.numpy(), dtype=np.float64) * (QUANTUM if self._fixed else 1.0)


ManyFractions = wp.types.vector(length=32, dtype=wp.float32)


@wp.kernel(enable_backward=False)
def error_function_kernel(
    # in
    xy_px: wp.array[wp.vec2d],  # (n_source,)
    irradiance: wp.array[float],  # (n_source,)
    sigma_px: float,
    rule: StampRule,
    # out (accumulated)
    image: wp.array2d[float],  # (n_row, n_col)
):
    """Gaussians by error functions at the edges of pixels, pixel by pixel."""
    fractions = ManyFractions()
    sigma = wp.vec2(sigma_px, sigma_px)
    window = whole_image(image.shape[0], image.shape[1])
    for source in range(xy_px.shape[0]):
        position_px = xy_px[source]
        reach_px = gaussian_reach_px(sigma, stamp_cut(irradiance[source], 0, rule))
        stamp = stamp_around(position_px, reach_px, 1.0, window)
        columns = columns_of_row(stamp, stamp.row)
        for column in range(columns[0], columns[1]):
            fractions[column - columns[0]] = gaussian_pixel_fraction(wp.float64(column) - position_px[0], sigma_px)
        for row in range(stamp.window.first_row, stamp.window.end_row):
            light = irradiance[source] * gaussian_pixel_fraction(wp.float64(row) - position_px[1], sigma_px)
            for column in range(columns[0], columns[1]):
                image[row, column] = image[row, column] + light * fractions[column - columns[0]]


def draw_by_error_functions(xy_px: wp.array, irradiance: wp.array, sigma_px: float, rule: Any, image: wp.array) -> None:
    """Overwrite an image with Gaussians; stamps are 32 pixels wide at most."""
    image.zero_()
    wp.launch(error_function_kernel, 1, [xy_px, irradiance, sigma_px, rule], [image], device=image.device)
