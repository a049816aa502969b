"""Three ways to cut the sky for star look-up (the paper's Fig. 6), and the costs of a view of the sky in each.

All three have zones of declination one degree high. They differ in how far from the equator a zone is also cut into
cells of one degree of right ascension. A view opens every cell that its cone may touch and reads all stars in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.arrays import F64, I64
from warpsim.directions import unit_vectors
from warpsim.errors import InputError
from warpsim.plot.figure import PALE
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.positions import position_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_SCHEME_DEG = 10  # cells of the drawn partitions; those of one degree would be too small to see
_SCHEME_VIEWS = ((-60.0, 10.0), (-60.0, 48.0), (-60.0, 72.0))  # longitude and latitude [deg] of the views drawn
_GLOBE_LATITUDE_DEG = 35.0  # from where the drawn spheres are seen


@dataclass(frozen=True)
class Partition:
    """A way to cut the sky: zones whose declinations lie within split_below_deg are cut into cells."""

    name: str
    split_below_deg: int
    colour: str

    def is_split(self, zone: ArrayLike, cell_deg: int = 1) -> NDArray[np.bool_]:
        """Return whether zones, counted from the south pole, are cut into cells."""
        south_deg = np.asarray(zone) * cell_deg - 90
        return np.asarray(np.minimum(np.abs(south_deg), np.abs(south_deg + cell_deg)) < self.split_below_deg)


MESH = Partition("mesh table", 90, "tab:orange")
LATITUDE = Partition("latitude table", 0, "tab:green")
COMPREHENSIVE = Partition("comprehensive table", 60, "tab:blue")
PARTITIONS = (MESH, LATITUDE, COMPREHENSIVE)
"""In the paper's order (a), (b), (c); `BandIndex` is the third, with the stars of a zone sorted by right ascension."""

SORTED = "sorted by right ascension"


@dataclass(frozen=True)
class Cover:
    """The zones and the window of columns that hold a cone, for many cones; arrays of shape (n,)."""

    first_zone: I64
    n_zone: I64
    first_column: I64
    n_column: I64
    """Columns from first_column on, wrapping at 360 degrees; all of them where the cone holds a pole."""
    west_deg: F64
    """West end of the window [deg], from 0 to 360."""
    width_deg: F64
    """Width of the window, to the east [deg], 360 at most."""


def cover_of(ra_deg: ArrayLike, dec_deg: ArrayLike, radius_deg: float, cell_deg: int = 1) -> Cover:
    """Return the zones and columns, of a size that divides 90 degrees, that cones touch.

    A cone of radius r at declination d reaches asin(sin r / cos d) to either side in right ascension, wherever its
    rim lies in declination: the window of columns is the same in all its zones.
    """
    ra, dec = (np.asarray(values, dtype=np.float64) for values in (ra_deg, dec_deg))
    first_zone, last_zone = (
        np.clip(np.floor((90 + edge_deg) / cell_deg), 0, 180 // cell_deg - 1).astype(np.int64)
        for edge_deg in (dec - radius_deg, dec + radius_deg)
    )
    holds_pole = np.abs(dec) + radius_deg >= 90
    ratio = np.sin(np.radians(radius_deg)) / np.cos(np.radians(np.where(holds_pole, 0, dec)))
    half_width_deg = np.degrees(np.arcsin(np.minimum(ratio, 1)))
    west_deg = np.where(holds_pole, 0.0, (ra - half_width_deg) % 360)
    width_deg = np.where(holds_pole, 360.0, 2 * half_width_deg)
    first_column, last_column = (
        np.floor(edge_deg / cell_deg).astype(np.int64) for edge_deg in (west_deg, west_deg + width_deg)
    )
    n_column = np.minimum(last_column + 1 - first_column, 360 // cell_deg)
    return Cover(first_zone, last_zone - first_zone + 1, first_column, n_column, west_deg, width_deg)


def star_table(catalog: StarCatalog) -> I64:
    """Return the stars in each cell of one degree by one degree, shape (180, 360)."""
    cell = 360 * _zone_of(catalog) + np.floor(catalog.ra_deg).astype(np.int64) % 360
    return np.bincount(cell, minlength=180 * 360).reshape(180, 360)


def view_costs(partition: Partition, stars: I64, cover: Cover) -> tuple[I64, I64]:
    """Return the cells opened and the stars read by each view, shape (n,) each, of a `star_table`."""
    # Running sums along two turns of each zone, so that a window may wrap.
    turns = np.concatenate([np.zeros((180, 1), dtype=np.int64), np.cumsum(np.tile(stars, 2), axis=1)], axis=1)
    n_cell = np.zeros(len(cover.first_zone), dtype=np.int64)
    n_read = np.zeros_like(n_cell)
    for step in range(int(cover.n_zone.max(initial=0))):
        touched = step < cover.n_zone
        zone = np.where(touched, cover.first_zone + step, 0)
        split = partition.is_split(zone)
        begin = np.where(split, cover.first_column, 0)
        end = begin + np.where(split, cover.n_column, 360)
        n_cell += np.where(touched, np.where(split, cover.n_column, 1), 0)
        n_read += np.where(touched, turns[zone, end] - turns[zone, begin], 0)
    return n_cell, n_read


def stars_in_window(catalog: StarCatalog, cover: Cover) -> I64:
    """Return the stars between the right ascensions of each view's window, in the zones that it touches, shape (n,).

    They are all that need to be read where the stars of a zone are sorted by right ascension. (`BandIndex` leaves runs
    of a few stars as the cells bound them, where looking for the ends of the window would take longer than reading.)
    """
    key = np.sort(360 * _zone_of(catalog) + catalog.ra_deg)
    east_deg = cover.west_deg + cover.width_deg
    n_read = np.zeros(len(cover.first_zone), dtype=np.int64)
    for step in range(int(cover.n_zone.max(initial=0))):
        begin, end, first, last = (
            np.searchsorted(key, 360.0 * (cover.first_zone + step) + edge_deg)
            for edge_deg in (cover.west_deg, np.minimum(east_deg, 360), 0, np.maximum(east_deg - 360, 0))
        )
        n_read += np.where(step < cover.n_zone, end - begin + last - first, 0)
    return n_read


def costs_by_latitude(
    catalog: StarCatalog, view_deg: float = 1.0, n_view: int = 400
) -> tuple[F64, dict[str, dict[str, F64]], F64]:
    """Return the mean cost of square views at each distance from the equator: n_view per degree, in both hemispheres.

    The half diagonal of a view is the radius of the cone that is looked up. Returned are distances from the equator
    [deg], (90,), the middles of whole degrees; for each partition's name, and "stars" for SORTED, the means "cells"
    opened and "stars" read, (90,); and the mean number of stars that lie in the cone itself.
    """
    radius_deg = view_deg / np.sqrt(2)
    stars = star_table(catalog)
    view = np.arange(90 * n_view)
    latitude = view // n_view
    # Steps of the golden section fill the right ascensions and the heights within a degree evenly.
    ra_deg = 360 * (view * (np.sqrt(5) - 1) / 2 % 1)
    dec_deg = (latitude + (view % n_view + 0.5) / n_view) * np.where(view % 2, 1, -1)
    cover = cover_of(ra_deg, dec_deg, radius_deg)
    costs: dict[str, dict[str, F64]] = {}
    for partition in PARTITIONS:
        cells, read = (np.bincount(latitude, values) / n_view for values in view_costs(partition, stars, cover))
        costs[partition.name] = {"cells": cells, "stars": read}
    costs[SORTED] = {"stars": np.bincount(latitude, stars_in_window(catalog, cover)) / n_view}
    area_deg2 = 2 * 360 * np.degrees(np.diff(np.sin(np.radians(np.arange(91)))))  # of a degree, both hemispheres
    density_deg2 = (stars[90:].sum(axis=1) + stars[89::-1].sum(axis=1)) / area_deg2
    cone_deg2 = 2 * np.pi * (1 - np.cos(np.radians(radius_deg))) * np.degrees(1) ** 2
    return np.arange(90, dtype=np.float64) + 0.5, costs, np.asarray(density_deg2 * cone_deg2)


def _zone_of(catalog: StarCatalog) -> I64:
    """Zones of one degree of declination that the stars are in, counted from the south pole, shape (n,)."""
    return np.clip(np.floor(catalog.dec_deg + 90), 0, 179).astype(np.int64)


def plot_sky_partition(catalog: StarCatalog | None = None, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
    """Draw three ways to cut the sky for look-up (the paper's Fig. 6), and what views of 1 x 1 degree cost in each.

    Above, the mesh, latitude and comprehensive tables as spheres, ten times too coarse, with the cells that views of
    10 x 10 degrees open. Below, measured with the real tables and the catalog: stars read and cells opened per view.
    The mesh reads few stars, but near a pole it opens hundreds of cells; the latitude table opens two or three, but
    reads all stars around the Earth's axis; the comprehensive table takes the mesh where cells are wide, and zones
    where they are narrow. The dotted line is what `BandIndex` makes of it: zones sorted by right ascension.

    Args:
        catalog: The stars that are read; the default catalog if left out.
        axes: Where to draw: three for the spheres, then one for stars and one for cells.

    Returns:
        The five axes.

    Raises:
        InputError: Not five axes.
    """
    if axes is None:
        from matplotlib import pyplot as plt

        axes = list(plt.figure(figsize=(11, 8.2), layout="constrained").subplot_mosaic(
            "AABBCC;DDDEEE", height_ratios=[1, 1.05]).values())  # fmt: skip
    if len(axes) != 5:
        raise InputError("must be 5", "axes", len(axes))
    for ax, partition, letter in zip(axes, PARTITIONS, "abc", strict=False):
        _draw_globe(ax, partition)
        ax.set_title(f"({letter}) {partition.name}", color=partition.colour)
    note = f"cells and views drawn {_SCHEME_DEG} times larger than they are"
    axes[1].text(0, -1.12, note, ha="center", va="top", fontsize=9)
    catalog = StarCatalog.default() if catalog is None else catalog
    latitude_deg, costs, n_inside = costs_by_latitude(catalog)
    for ax, quantity in zip(axes[3:], ("stars", "cells"), strict=True):
        for partition in PARTITIONS:
            dashed = "--" if partition is COMPREHENSIVE else "-"
            ax.step(latitude_deg, costs[partition.name][quantity], dashed, color=partition.colour, where="mid",
                    linewidth=2, label=partition.name)  # fmt: skip
        if len(catalog):
            ax.set_yscale("log")
        ax.set(xlim=(0, 90), xticks=range(0, 91, 15), xlabel="distance from the equator [deg]")
        ax.grid(alpha=0.3)
    stars, cells = axes[3:]
    stars.plot(latitude_deg, costs[SORTED]["stars"], ":", color="black", linewidth=2, label=f"(c), {SORTED}")
    stars.plot(latitude_deg, n_inside, color="0.3", linewidth=1, label="in the view's cone")
    stars.set(ylabel="stars read", title=f"stars read per view of 1 x 1 deg ({len(catalog):,} stars)")
    cells.set(ylabel="cells opened", title="cells of the table opened per view")
    stars.legend(fontsize=9)
    return axes


def _draw_globe(ax: Axes, partition: Partition) -> None:
    """A sphere seen from 35 degrees north with the partition's cells, coarsely, and those that a few views open."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb

    n_zone, n_column = 180 // _SCHEME_DEG, 360 // _SCHEME_DEG
    strips: list[F64] = []
    for ra_deg, dec_deg in _SCHEME_VIEWS:
        cover = cover_of([ra_deg], [dec_deg], _SCHEME_DEG / np.sqrt(2), _SCHEME_DEG)
        for zone in range(cover.first_zone[0], cover.first_zone[0] + cover.n_zone[0]):
            split = partition.is_split(zone, _SCHEME_DEG)
            first, n = (int(cover.first_column[0]), int(cover.n_column[0])) if split else (0, n_column)
            strips += _visible_strips(zone * _SCHEME_DEG - 90, first * _SCHEME_DEG, (first + n) * _SCHEME_DEG)
        x, y, _ = _orthographic(*_square(ra_deg, dec_deg, _SCHEME_DEG))
        ax.plot(x, y, color="black", linewidth=1.6, zorder=3)
    # Mixed with white: unlike a transparent colour, it does not show where strips overlap.
    paler = tuple(0.35 * part + 0.65 for part in to_rgb(partition.colour))
    ax.add_collection(PolyCollection(strips, facecolor=paler, edgecolor=paler, linewidth=0.5))

    along = np.linspace(-180, 180, 361)
    lines = [(along, np.full(361, zone * _SCHEME_DEG - 90.0)) for zone in range(1, n_zone)]
    edge_deg = min(partition.split_below_deg, 90)
    for column in range(n_column if edge_deg else 0):
        lines.append((np.full(181, column * float(_SCHEME_DEG)), np.linspace(-edge_deg, edge_deg, 181)))
    for ra, dec in lines:
        x, y, visible = _orthographic(ra, dec)
        ax.plot(np.where(visible, x, np.nan), np.where(visible, y, np.nan), color=PALE, linewidth=0.5)
    turn = np.radians(np.arange(361))
    ax.plot(np.cos(turn), np.sin(turn), color="black", linewidth=1)
    ax.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
    ax.set_axis_off()


def _visible_strips(south_deg: float, west_deg: int, east_deg: int) -> list[F64]:
    """The near side of a run of cells, in polygons one degree wide, shape (n, 2) each."""
    height = np.linspace(south_deg, south_deg + _SCHEME_DEG, 11)
    dec = np.concatenate([height, height[::-1]])
    strips = []
    for west in range(west_deg, east_deg):
        x, y, visible = _orthographic(np.repeat([west, west + 1.0], 11), dec)
        if visible.any():
            # Corners behind the limb are drawn on it.
            scale = np.where(visible, 1, 1 / np.maximum(np.hypot(x, y), 1e-9))
            strips.append(np.stack([x * scale, y * scale], axis=1))
    return strips


def _square(ra_deg: float, dec_deg: float, side_deg: float) -> tuple[F64, F64]:
    """Right ascensions and declinations [deg] of the closed outline of a square in the tangent plane of a point."""
    east, north = unit_vectors(ra_deg + 90, 0.0), unit_vectors(ra_deg, dec_deg + 90)
    half = np.radians(side_deg) / 2
    along, up = half * np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]])
    return position_of(*(unit_vectors(ra_deg, dec_deg) + np.outer(along, east) + np.outer(up, north)).T)


def _orthographic(ra_deg: F64, dec_deg: F64) -> tuple[F64, F64, NDArray[np.bool_]]:
    """Points on a sphere seen from far above longitude -90, and whether they are on the near side; shape (n,)."""
    right, behind, north = unit_vectors(ra_deg, dec_deg).T
    sine, cosine = np.sin(np.radians(_GLOBE_LATITUDE_DEG)), np.cos(np.radians(_GLOBE_LATITUDE_DEG))
    return right, north * cosine + behind * sine, north * sine - behind * cosine >= 0
