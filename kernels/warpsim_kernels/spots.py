"""Spots: point sources as one thread at a time draws their pixels, from what is found out about them once."""

import functools
from typing import Any, NamedTuple

import warp as wp

from warpsim_kernels.deposit_gaussian import EdgeOffset, EdgeTable, GaussianTables, PixelVector, edge_offset
from warpsim_kernels.deposit_table import pattern_tables
from warpsim_kernels.psf import gaussian_reach_px, table_reach_px, table_wing
from warpsim_kernels.psf_cells import layout_functions
from warpsim_kernels.records import Sources
from warpsim_kernels.stamps import Stamp, StampRule, Window, stamp_around, stamp_cut, whole_image
from warpsim_kernels.table_layout import TableLayout


class SpotFunctions(NamedTuple):
    """Functions that draw the sources of one family of point spread functions."""

    Tables: Any
    """Struct: the functions of all bands."""

    Spot: Any
    """Struct: a source in one band. Its field `stamp` holds the pixels that it is drawn on."""

    spot_of: Any
    """(tables, band, xy_px, irradiance, rule: StampRule, image: Window) -> spot; it has no rows if it does not touch
    the image."""

    row_of: Any
    """(tables, band, spot, row) -> what the pixels of the spot in a row have in common."""

    light_at: Any
    """(tables, band, spot, what row_of returned, column) -> light of a pixel of that row."""


@wp.func_native(snippet="return reinterpret_cast<const float*>(fractions.data)[i];")
def load_fraction(fractions: wp.array[PixelVector], i: int) -> float:
    """The first float of vector i, from 0 on, of overlapping ones."""


@functools.cache
def gaussian_spots() -> SpotFunctions:
    """Spots of Gaussians."""

    @wp.struct
    class GaussianSpot:
        stamp: Stamp
        strength: float
        across: EdgeOffset
        down: EdgeOffset

    @wp.func
    def spot_of(
        tables: GaussianTables, band: int, xy_px: wp.vec2d, irradiance: float, rule: StampRule, image: Window
    ) -> GaussianSpot:
        psf = tables.psfs[band]
        sigma = psf.sigma_px
        spot = GaussianSpot()
        spot.stamp = stamp_around(
            xy_px, gaussian_reach_px(sigma, stamp_cut(irradiance, band, rule)), sigma[0] / sigma[1], image
        )
        spot.strength = irradiance
        spot.across = edge_offset(psf.columns, xy_px[0])
        spot.down = edge_offset(psf.rows, xy_px[1])
        return spot

    @wp.func
    def axis_fraction(fractions: wp.array[PixelVector], table: EdgeTable, offset: EdgeOffset, pixel: int) -> float:
        at = offset.start + pixel
        here = load_fraction(fractions, at)
        after = load_fraction(fractions, at + table.n_pixel)
        step = after - here
        bend = step - (here - load_fraction(fractions, at - table.n_pixel))
        twist = (load_fraction(fractions, at + 2 * table.n_pixel) - after) - step - bend
        u = offset.u
        return here + u * (step + (0.5 * (u - 1.0)) * (bend + ((u + 1.0) * wp.static(1.0 / 3.0)) * twist))

    @wp.func
    def row_of(tables: GaussianTables, band: int, spot: GaussianSpot, row: int) -> float:
        return axis_fraction(tables.fractions, tables.psfs[band].rows, spot.down, row)

    @wp.func
    def light_at(tables: GaussianTables, band: int, spot: GaussianSpot, in_row: float, column: int) -> float:
        return in_row * (
            spot.strength * axis_fraction(tables.fractions, tables.psfs[band].columns, spot.across, column)
        )

    return SpotFunctions(GaussianTables, GaussianSpot, spot_of, row_of, light_at)


@functools.cache
def table_spots(layout: TableLayout) -> SpotFunctions:
    """Spots of tabulated patterns, by tables of a layout."""
    read, Tables = layout_functions(layout), pattern_tables(layout)
    Offset, Row = read.Offset, read.Row
    offset_in, row_in, fraction = read.offset_in, read.row_in, read.fraction

    class TableSpot:
        stamp: Stamp
        strength: float
        offset: Offset

    Spot = wp.struct(TableSpot)

    @wp.func
    def spot_of(tables: Tables, band: int, xy_px: wp.vec2d, irradiance: float, rule: StampRule, image: Window) -> Spot:
        psf = tables.psfs[band]
        spot = Spot()
        reach_px = table_reach_px(tables.table, psf, stamp_cut(irradiance, band, rule))
        spot.stamp = stamp_around(xy_px, reach_px, psf.pixel_aspect, image)
        spot.strength = irradiance
        spot.offset = offset_in(wp.float64(spot.stamp.column) - xy_px[0], wp.float64(spot.stamp.row) - xy_px[1], psf)
        return spot

    @wp.func
    def row_of(tables: Tables, band: int, spot: Spot, row: int) -> Row:
        return row_in(spot.offset, row - spot.stamp.row, tables.psfs[band])

    @wp.func
    def light_at(tables: Tables, band: int, spot: Spot, in_row: Row, column: int) -> float:
        psf = tables.psfs[band]
        step = column - spot.stamp.column
        if in_row.first >= 0 and step >= spot.offset.first_step and step < spot.offset.end_step:
            return spot.strength * fraction(tables.table, psf, spot.offset, in_row, step + psf.zero_pixel)
        return spot.strength * table_wing(psf, spot.offset.dx_px + float(step), in_row.distance_px)

    return SpotFunctions(Tables, Spot, spot_of, row_of, light_at)


@functools.cache
def make_find_spots_kernel(spots: SpotFunctions) -> wp.Kernel:
    """Kernel that finds the spots of all sources."""
    Tables, Spot, spot_of = spots.Tables, spots.Spot, spots.spot_of

    @wp.kernel(module="unique", enable_backward=False)
    def find_spots_kernel(
        # in
        sources: Sources,  # n_source, xy_px, irradiance_w_cm2
        tables: Tables,
        rule: StampRule,
        n_row: int,
        n_col: int,
        # out
        found: wp.array3d[Spot],  # (n_view, n_band, n_slot); no rows for a source without light
    ):
        view, band, slot = wp.tid()
        if slot < sources.n_source[view]:
            irradiance = sources.irradiance_w_cm2[view, band, slot]
            image = whole_image(n_row, n_col)
            if irradiance == 0.0:
                image.end_row = 0
            found[view, band, slot] = spot_of(tables, band, sources.xy_px[view, slot], irradiance, rule, image)

    return find_spots_kernel
