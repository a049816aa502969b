"""Figure of three ways to cut the sky for star look-up (the paper's Fig. 6), and what a view costs in each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.plot.partition import PARTITIONS, SORTED, Partition, costs_by_latitude, cover_of, is_split
from warpsim.sky.catalog import StarCatalog

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

_SCHEME_DEG = 10  # cells of the drawn partitions; those of one degree would be too small to see
_SCHEME_VIEWS = ((-60.0, 10.0), (-60.0, 48.0), (-60.0, 72.0))  # longitude and latitude [deg] of the views drawn
_GLOBE_LATITUDE_DEG = 35.0  # from where the drawn spheres are seen
_PARTITION_COLOURS = ("tab:orange", "tab:green", "tab:blue")
_FAINT = "0.6"


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

        figure = plt.figure(figsize=(11, 8.2), layout="constrained")
        grid = figure.add_gridspec(2, 6, height_ratios=[1, 1.05])
        spans = [grid[0, k : k + 2] for k in (0, 2, 4)] + [grid[1, k : k + 3] for k in (0, 3)]
        axes = [figure.add_subplot(span) for span in spans]
    if len(axes) != 5:
        raise InputError("must be 5", "axes", len(axes))
    for ax, partition, letter, colour in zip(axes, PARTITIONS, "abc", _PARTITION_COLOURS, strict=False):
        _draw_globe(ax, partition, colour)
        ax.set_title(f"({letter}) {partition.name}", color=colour)
    note = f"cells and views drawn {_SCHEME_DEG} times larger than they are"
    axes[1].text(0, -1.12, note, ha="center", va="top", fontsize=9)
    catalog = StarCatalog.default() if catalog is None else catalog
    latitude_deg, costs, n_inside = costs_by_latitude(catalog)
    for ax, quantity in zip(axes[3:], ("stars", "cells"), strict=True):
        for partition, colour in zip(PARTITIONS, _PARTITION_COLOURS, strict=True):
            dashed = "--" if partition is PARTITIONS[2] else "-"
            ax.step(latitude_deg, costs[partition.name][quantity], dashed, color=colour, where="mid", linewidth=2,
                    label=partition.name)  # fmt: skip
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


def _draw_globe(ax: Axes, partition: Partition, colour: str) -> None:
    """A sphere seen from 35 degrees north with the partition's cells, coarsely, and those that a few views open."""
    from matplotlib.collections import PolyCollection

    n_zone, n_column = 180 // _SCHEME_DEG, 360 // _SCHEME_DEG
    strips: list[Array] = []
    for ra_deg, dec_deg in _SCHEME_VIEWS:
        cover = cover_of([ra_deg], [dec_deg], _SCHEME_DEG / np.sqrt(2), _SCHEME_DEG)
        for zone in range(cover.first_zone[0], cover.first_zone[0] + cover.n_zone[0]):
            split = bool(is_split(partition, np.array(zone), _SCHEME_DEG))
            first, n = (int(cover.first_column[0]), int(cover.n_column[0])) if split else (0, n_column)
            strips += _visible_strips(zone * _SCHEME_DEG - 90, first * _SCHEME_DEG, (first + n) * _SCHEME_DEG)
        corners = _SCHEME_DEG / 2 * np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]])
        x, y, _ = _orthographic(*_beside(ra_deg, dec_deg, *corners))
        ax.plot(x, y, color="black", linewidth=1.6, zorder=3)
    ax.add_collection(PolyCollection(strips, facecolor=_paler(colour), edgecolor=_paler(colour), linewidth=0.5))

    along = np.linspace(-180, 180, 361)
    lines = [(along, np.full(361, zone * _SCHEME_DEG - 90.0)) for zone in range(1, n_zone)]
    cut = [zone for zone in range(n_zone) if is_split(partition, np.array(zone), _SCHEME_DEG)]
    for column in range(n_column if cut else 0):
        height = np.linspace(cut[0] * _SCHEME_DEG - 90, (cut[-1] + 1) * _SCHEME_DEG - 90, 181)
        lines.append((np.full(181, column * float(_SCHEME_DEG)), height))
    for ra, dec in lines:
        x, y, visible = _orthographic(ra, dec)
        ax.plot(np.where(visible, x, np.nan), np.where(visible, y, np.nan), color=_FAINT, linewidth=0.5)
    turn = np.radians(np.arange(361))
    ax.plot(np.cos(turn), np.sin(turn), color="black", linewidth=1)
    ax.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
    ax.set_axis_off()


def _visible_strips(south_deg: float, west_deg: int, east_deg: int) -> list[Array]:
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


def _beside(ra_deg: float, dec_deg: float, east_deg: Array, north_deg: Array) -> tuple[Array, Array]:
    """Points at small offsets along the tangent plane of a point of the sky [deg]."""
    ra, dec = np.radians([ra_deg, dec_deg])
    centre = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    east = np.array([-np.sin(ra), np.cos(ra), 0])
    north = np.cross(centre, east)
    x, y, z = centre[:, None] + np.outer(east, np.radians(east_deg)) + np.outer(north, np.radians(north_deg))
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))


def _orthographic(ra_deg: Array, dec_deg: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Points on a sphere seen from far above longitude -90, and whether they are on the near side; shape (n,)."""
    ra, dec = np.radians(ra_deg), np.radians(dec_deg)
    tilt = np.radians(_GLOBE_LATITUDE_DEG)
    right, towards = np.cos(dec) * np.cos(ra), -np.cos(dec) * np.sin(ra)
    up = np.sin(dec) * np.cos(tilt) - towards * np.sin(tilt)
    return right, up, np.sin(dec) * np.sin(tilt) + towards * np.cos(tilt) >= 0


def _paler(colour: str) -> tuple[float, ...]:
    """A colour mixed with white: unlike a transparent one, it does not show where strips overlap."""
    from matplotlib.colors import to_rgb

    return tuple(0.35 * part + 0.65 for part in to_rgb(colour))
