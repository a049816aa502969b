"""Spots: point sources as one thread at a time draws their pixels, from what is found out about them once."""

import functools
from typing import Any, NamedTuple

import warp as wp

from warpsim_kernels.deposit_gaussian import EdgePlace, EdgeTable, GaussianTables, Lanes, edge_place
from warpsim_kernels.deposit_table import pattern_tables
from warpsim_kernels.psf import gaussian_reach_px, table_reach_px, table_wing
from warpsim_kernels.psf_cells import TableLayout
from warpsim_kernels.stamps import Stamp, StampRule, Window, stamp_around, stamp_cut


class SpotFunctions(NamedTuple):
    """How the sources of one family of point spread functions are drawn."""

    Tables: Any
    """Struct: the functions of all bands."""

    Spot: Any
    """Struct: a source in one band. Its field `stamp` says which pixels it is drawn on."""

    spot_of: Any
    """(tables, band, xy_px, irradiance, rule: StampRule, window: Window) -> spot; it has no rows if it does not touch
    the window."""

    row_of: Any
    """(tables, band, spot, row) -> what the pixels of the spot in a row have in common."""

    light_at: Any
    """(tables, band, spot, what row_of returned, column) -> light of a pixel of that row."""

    n_block: int
    """Blocks of 256 threads that a multiprocessor of CUDA may hold at a time without spilled registers."""


@functools.cache
def gaussian_spots() -> SpotFunctions:
    """Spots of Gaussians."""

    @wp.struct
    class GaussianSpot:
        stamp: Stamp
        strength: float
        across: EdgePlace
        down: EdgePlace

    @wp.func
    def spot_of(
        tables: GaussianTables, band: int, xy_px: wp.vec2d, irradiance: float, rule: StampRule, window: Window
    ) -> GaussianSpot:
        psf = tables.psfs[band]
        sigma = psf.sigma_px
        spot = GaussianSpot()
        spot.stamp = stamp_around(
            xy_px, gaussian_reach_px(sigma, stamp_cut(irradiance, band, rule)), sigma[0] / sigma[1], window
        )
        spot.strength = irradiance
        spot.across = edge_place(psf.columns, xy_px[0])
        spot.down = edge_place(psf.rows, xy_px[1])
        return spot

    @wp.func
    def axis_share(shares: wp.array[Lanes], table: EdgeTable, place: EdgePlace, pixel: int) -> float:
        at = place.start + pixel
        here = shares[at][0]
        after = shares[at + table.n_pixel][0]
        step = after - here
        bend = step - (here - shares[at - table.n_pixel][0])
        twist = (shares[at + 2 * table.n_pixel][0] - after) - step - bend
        u = place.u
        return here + u * (step + (0.5 * (u - 1.0)) * (bend + ((u + 1.0) * wp.static(1.0 / 3.0)) * twist))

    @wp.func
    def row_of(tables: GaussianTables, band: int, spot: GaussianSpot, row: int) -> float:
        return axis_share(tables.shares, tables.psfs[band].rows, spot.down, row)

    @wp.func
    def light_at(tables: GaussianTables, band: int, spot: GaussianSpot, in_row: float, column: int) -> float:
        return in_row * (spot.strength * axis_share(tables.shares, tables.psfs[band].columns, spot.across, column))

    return SpotFunctions(GaussianTables, GaussianSpot, spot_of, row_of, light_at, n_block=3)


@functools.cache
def table_spots(layout: TableLayout) -> SpotFunctions:
    """Spots of tabulated patterns, by tables of a layout."""
    read, Tables = layout.functions(), pattern_tables(layout)
    Place, Row = read.Place, read.Row
    place_in, row_in, share = read.place_in, read.row_in, read.share

    class TableSpot:
        stamp: Stamp
        strength: float
        place: Place

    Spot = wp.struct(TableSpot)

    @wp.func
    def spot_of(tables: Tables, band: int, xy_px: wp.vec2d, irradiance: float, rule: StampRule, window: Window) -> Spot:
        psf = tables.psfs[band]
        spot = Spot()
        reach_px = table_reach_px(tables.table, psf, stamp_cut(irradiance, band, rule))
        spot.stamp = stamp_around(xy_px, reach_px, psf.pixel_aspect, window)
        spot.strength = irradiance
        spot.place = place_in(wp.float64(spot.stamp.column) - xy_px[0], wp.float64(spot.stamp.row) - xy_px[1], psf)
        return spot

    @wp.func
    def row_of(tables: Tables, band: int, spot: Spot, row: int) -> Row:
        return row_in(spot.place, row - spot.stamp.row, tables.psfs[band])

    @wp.func
    def light_at(tables: Tables, band: int, spot: Spot, in_row: Row, column: int) -> float:
        psf = tables.psfs[band]
        step = column - spot.stamp.column
        if in_row.first >= 0 and step >= spot.place.first_step and step < spot.place.end_step:
            return spot.strength * share(tables.table, psf, spot.place, in_row, step + psf.zero_pixel)
        return spot.strength * table_wing(psf, spot.place.dx_px + float(step), in_row.distance_px)

    return SpotFunctions(Tables, Spot, spot_of, row_of, light_at, n_block=2)
