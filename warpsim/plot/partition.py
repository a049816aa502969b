"""Three ways to cut the sky for star look-up (the paper's Fig. 6), and the costs of a view of the sky in each.

All three have zones of declination one degree high. They differ in how far from the equator a zone is also cut into
cells of one degree of right ascension. A view opens every cell that its cone may touch and reads all stars in them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.sky.catalog import StarCatalog

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Partition:
    """A way to cut the sky."""

    name: str
    split_below_deg: int
    """Zones whose declinations lie within this are cut into cells; the others are one cell each."""


MESH = Partition("mesh table", 90)
LATITUDE = Partition("latitude table", 0)
COMPREHENSIVE = Partition("comprehensive table", 60)
PARTITIONS = (MESH, LATITUDE, COMPREHENSIVE)
"""In the paper's order (a), (b), (c); `BandIndex` is the third, with the stars of a zone sorted by right ascension."""

SORTED = "sorted by right ascension"


@dataclass(frozen=True)
class Cover:
    """The zones and the window of columns that hold a cone, for many cones; arrays of shape (n,)."""

    first_zone: NDArray[np.int64]
    n_zone: NDArray[np.int64]
    first_column: NDArray[np.int64]
    n_column: NDArray[np.int64]
    """Columns from first_column on, wrapping at 360 degrees; all of them where the cone holds a pole."""

    west_deg: Array
    """West end of the window [deg], from 0 to 360."""

    width_deg: Array
    """Width of the window, to the east [deg], 360 at most."""


def cover_of(ra_deg: ArrayLike, dec_deg: ArrayLike, radius_deg: float, cell_deg: int = 1) -> Cover:
    """Return the zones and columns that cones touch.

    A cone of radius r at declination d reaches asin(sin r / cos d) to either side in right ascension, wherever its
    rim lies in declination: the window of columns is the same in all its zones.

    Args:
        ra_deg: Right ascension of the axes [deg], shape (n,).
        dec_deg: Declination [deg], shape (n,).
        radius_deg: Half-angle of the cones [deg], below 90.
        cell_deg: Height of a zone, and width of a cell [deg]; divides 90.
    """
    ra, dec = (np.asarray(values, dtype=np.float64) for values in (ra_deg, dec_deg))
    n_zone, n_column = 180 // cell_deg, 360 // cell_deg
    first_zone = np.clip(np.floor((90 + dec - radius_deg) / cell_deg), 0, n_zone - 1).astype(np.int64)
    last_zone = np.clip(np.floor((90 + dec + radius_deg) / cell_deg), 0, n_zone - 1).astype(np.int64)
    holds_pole = np.abs(dec) + radius_deg >= 90
    ratio = np.sin(np.radians(radius_deg)) / np.cos(np.radians(np.where(holds_pole, 0, dec)))
    half_width_deg = np.degrees(np.arcsin(np.minimum(ratio, 1)))
    west_deg = np.where(holds_pole, 0.0, (ra - half_width_deg) % 360)
    width_deg = np.where(holds_pole, 360.0, 2 * half_width_deg)
    first_column = np.floor(west_deg / cell_deg).astype(np.int64)
    beyond_column = np.floor((west_deg + width_deg) / cell_deg).astype(np.int64) + 1
    return Cover(
        first_zone=first_zone,
        n_zone=last_zone - first_zone + 1,
        first_column=first_column,
        n_column=np.minimum(beyond_column - first_column, n_column),
        west_deg=west_deg,
        width_deg=width_deg,
    )


def is_split(partition: Partition, zone: NDArray[np.int64], cell_deg: int = 1) -> NDArray[np.bool_]:
    """Return whether zones, counted from the south pole, are cut into cells."""
    lowest_deg = np.minimum(np.abs(zone * cell_deg - 90), np.abs((zone + 1) * cell_deg - 90))
    return np.asarray(lowest_deg < partition.split_below_deg)


def star_table(catalog: StarCatalog) -> NDArray[np.int64]:
    """Return the stars in each cell of one degree by one degree, shape (180, 360)."""
    cell = 360 * _zone_of(catalog) + np.floor(catalog.ra_deg).astype(np.int64) % 360
    return np.bincount(cell, minlength=180 * 360).reshape(180, 360)


def view_costs(
    partition: Partition, stars: NDArray[np.int64], cover: Cover
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the cells opened and the stars read by each view, shape (n,) each.

    Args:
        partition: How the sky is cut, with cells of one degree.
        stars: Stars in each cell of one degree by one degree, shape (180, 360).
        cover: What the views touch.
    """
    # Running sums along two turns of each zone, so that a window may wrap.
    turns = np.concatenate([np.zeros((180, 1), dtype=np.int64), np.cumsum(np.tile(stars, 2), axis=1)], axis=1)
    n_cell = np.zeros(len(cover.first_zone), dtype=np.int64)
    n_read = np.zeros_like(n_cell)
    for step in range(int(cover.n_zone.max(initial=0))):
        touched = step < cover.n_zone
        zone = np.where(touched, cover.first_zone + step, 0)
        split = is_split(partition, zone)
        begin = np.where(split, cover.first_column, 0)
        end = begin + np.where(split, cover.n_column, 360)
        n_cell += np.where(touched, np.where(split, cover.n_column, 1), 0)
        n_read += np.where(touched, turns[zone, end] - turns[zone, begin], 0)
    return n_cell, n_read


def stars_in_window(catalog: StarCatalog, cover: Cover) -> NDArray[np.int64]:
    """Return the stars between the right ascensions of each view's window, in the zones that it touches, shape (n,).

    They are all that need to be read where the stars of a zone are sorted by right ascension. (`BandIndex` leaves runs
    of a few stars as the cells bound them, where looking for the ends of the window would take longer than reading.)
    """
    key = np.sort(360 * _zone_of(catalog) + catalog.ra_deg)
    n_read = np.zeros(len(cover.first_zone), dtype=np.int64)
    for step in range(int(cover.n_zone.max(initial=0))):
        zone_deg = 360.0 * (cover.first_zone + step)
        east_deg = cover.west_deg + cover.width_deg
        begin, end, first, last = (
            np.searchsorted(key, zone_deg + edge_deg)
            for edge_deg in (cover.west_deg, np.minimum(east_deg, 360), 0, np.maximum(east_deg - 360, 0))
        )
        n_read += np.where(step < cover.n_zone, end - begin + last - first, 0)
    return n_read


def costs_by_latitude(
    catalog: StarCatalog, view_deg: float = 1.0, n_view: int = 400
) -> tuple[Array, dict[str, dict[str, Array]], Array]:
    """Return the mean cost of square views at each distance from the equator.

    Args:
        catalog: The stars.
        view_deg: Side of the view [deg]; its half diagonal is the radius of the cone that is looked up.
        n_view: Views per degree of declination, spread evenly over right ascension, and over both hemispheres.

    Returns:
        Distances from the equator [deg], shape (90,), the middles of whole degrees; for each partition's name, and
        "stars" for SORTED, the means "cells" opened and "stars" read, shape (90,); and the mean number of stars that
        lie in the cone itself.
    """
    radius_deg = view_deg / np.sqrt(2)
    stars = star_table(catalog)
    view = np.arange(90 * n_view)
    latitude = view // n_view
    # Steps of the golden section fill the right ascensions and the heights within a degree evenly.
    golden = (np.sqrt(5) - 1) / 2
    ra_deg = 360 * (view * golden % 1)
    dec_deg = (latitude + (view % n_view + 0.5) / n_view) * np.where(view % 2, 1, -1)
    cover = cover_of(ra_deg, dec_deg, radius_deg)
    costs: dict[str, dict[str, Array]] = {}
    for partition in PARTITIONS:
        cells, read = (np.bincount(latitude, values) / n_view for values in view_costs(partition, stars, cover))
        costs[partition.name] = {"cells": cells, "stars": read}
    costs[SORTED] = {"stars": np.bincount(latitude, stars_in_window(catalog, cover)) / n_view}
    edges = np.sin(np.radians(np.arange(91)))
    area_deg2 = 2 * 360 * np.degrees(np.diff(edges))  # of a degree of declination, both hemispheres
    density_deg2 = (stars[90:].sum(axis=1) + stars[89::-1].sum(axis=1)) / area_deg2
    cone_deg2 = 2 * np.pi * (1 - np.cos(np.radians(radius_deg))) * np.degrees(1) ** 2
    return np.arange(90, dtype=np.float64) + 0.5, costs, np.asarray(density_deg2 * cone_deg2)


def _zone_of(catalog: StarCatalog) -> NDArray[np.int64]:
    """Zones of one degree of declination that the stars are in, counted from the south pole, shape (n,)."""
    return np.clip(np.floor(catalog.dec_deg + 90), 0, 179).astype(np.int64)
