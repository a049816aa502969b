"""Pictures of star catalogs: counts by magnitude, density over the sky, and how the sky is cut for look-up.

Every function draws on axes that are given to it, or else on a new pyplot figure, and returns the axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.plot.figure import new_axes
from warpsim.plot.partition import PARTITIONS, SORTED, Partition, costs_by_latitude, cover_of, is_split
from warpsim.radiometry.bands import BANDS
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.space_motion import place_of
from warpsim.sky.synthetic import GALACTIC_OF_ICRS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

STARS_PER_PIXEL = 30
"""Of a density map, on average: scatter 18 %."""
PIXEL_DEG_RANGE = (1.0, 10.0)

FEW_STARS = 300
"""Drawn as points in a density map, where a count per square would not show them."""

_BY_WAVELENGTH = ("B1", "B2", "A", "C", "D", "E")
_SCHEME_DEG = 10  # cells of the drawn partitions; those of one degree would be too small to see
_SCHEME_VIEWS = ((-60.0, 10.0), (-60.0, 48.0), (-60.0, 72.0))  # longitude and latitude [deg] of the views drawn
_GLOBE_LATITUDE_DEG = 35.0  # from where the drawn spheres are seen
_PARTITION_COLOURS = ("tab:orange", "tab:green", "tab:blue")
_FAINT = "0.6"


def plot_star_counts(
    catalog: StarCatalog, bands: Sequence[str] = ("B1", "B2", "A", "C", "D", "E"), ax: Axes | None = None
) -> Axes:
    """Draw the number of stars by band and whole magnitude (the paper's Fig. 5); m counts from m to below m + 1.

    Args:
        catalog: The stars.
        bands: Names of MSX bands, drawn in this order.
        ax: Where to draw.

    Raises:
        InputError: A band is unknown, or none is given.
    """
    if not bands:
        raise InputError("must name at least one", "bands")
    counts = {band: magnitude_counts(catalog, band) for band in bands}
    ax = ax or new_axes(8.5, 4.8)
    width = 0.86 / len(counts)
    for number, (band, (magnitudes, n_star)) in enumerate(counts.items()):
        left = magnitudes + 0.07 + number * width
        label = f"{band}, {BANDS[band].isophotal_um:.2f} um" + ("" if len(n_star) else ": no fluxes")
        # A band has its colour whatever it is drawn with; short wavelengths are dark.
        colour = _colour_map("plasma")(0.05 + 0.85 * _BY_WAVELENGTH.index(band) / (len(_BY_WAVELENGTH) - 1))
        ax.bar(left, n_star, width, align="edge", color=colour, label=label)
    drawn = [magnitudes for magnitudes, _ in counts.values() if len(magnitudes)]
    if drawn:
        first, last = min(m[0] for m in drawn), max(m[-1] for m in drawn) + 1
        step = max(1, -(-(last - first) // 25))
        ax.set(xlim=(first, last), xticks=range(first, last + 1, step), yscale="log", ylim=(0.7, None))
    else:
        ax.text(0.5, 0.5, "no star has a flux", ha="center", transform=ax.transAxes)
        ax.set(xticks=[], yticks=[])
    ax.set(xlabel="magnitude in the band (one group of bars per whole magnitude)", ylabel="number of stars")
    ax.set_title(f"{catalog.name}: {len(catalog):,} stars")
    ax.grid(axis="y", alpha=0.3)
    ax.set_axisbelow(True)
    ax.legend(loc="upper left", ncols=2 if len(counts) > 3 else 1, fontsize=9)
    return ax


def magnitude_counts(catalog: StarCatalog, band: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Whole magnitudes, without gaps, and the number of stars from each to below the next; stars without light no.

    Raises:
        InputError: The band is unknown.
    """
    magnitude = catalog.magnitude(band)
    # 1e-9 mag: a magnitude of 3 exactly belongs to 3, whatever the rounding of its flux.
    whole = np.floor(magnitude[np.isfinite(magnitude)] + 1e-9).astype(np.int64)
    if not len(whole):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    return np.arange(whole.min(), whole.max() + 1), np.bincount(whole - whole.min())


def plot_sky_density(
    catalog: StarCatalog,
    frame: Literal["galactic", "equatorial"] = "galactic",
    ax: Axes | None = None,
    range_per_deg2: tuple[float, float] | None = None,
) -> Axes:
    """Draw the number of stars per square degree over the whole sky.

    Mollweide's projection keeps areas: stars are counted in equal squares of the drawn plane, large enough to hold
    about 30 on average; up to 300 stars are drawn as points as well. Longitude grows to the left, as the sky is seen
    from inside.

    Args:
        catalog: The stars.
        frame: Which equator lies across the middle; the centre is longitude 0.
        ax: Where to draw; the coordinates are Mollweide's, a unit sphere's.
        range_per_deg2: Densities at the two ends of the colour scale; from the map if left out.

    Raises:
        InputError: The frame is neither word, or the range not two growing positive numbers.
    """
    if frame not in ("galactic", "equatorial"):
        raise InputError('must be "galactic" or "equatorial"', "frame", frame)
    if range_per_deg2 is not None and not 0 < range_per_deg2[0] < range_per_deg2[1]:
        raise InputError("must be two growing positive numbers", "range_per_deg2", range_per_deg2)
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Ellipse

    density, extent = density_map(catalog, frame)
    ax = ax or new_axes(8.5, 4.6)
    seen = density[density > 0]
    if range_per_deg2 is None:
        low, high = np.percentile(seen, [1, 99.8]) if len(seen) else (0.1, 1.0)
        range_per_deg2 = (low, max(high, 1.01 * low))
    low, high = range_per_deg2
    image = ax.imshow(
        np.clip(density, low, high), origin="lower", extent=extent, cmap="magma", norm=LogNorm(low, high),
        interpolation="nearest",
    )  # fmt: skip
    image.set_clip_path(Ellipse((0, 0), 4 * np.sqrt(2), 2 * np.sqrt(2), transform=ax.transData))
    if len(catalog) <= FEW_STARS:
        ax.plot(*mollweide(*_longitude_latitude_deg(catalog, frame)), ".", color="white", markersize=4)
    _draw_graticule(ax)
    name = {"galactic": ("l", "b"), "equatorial": ("RA", "dec")}[frame]
    ax.set(xlim=(-2.95, 2.95), ylim=(-1.6, 1.5), aspect="equal")
    ax.set_axis_off()
    ax.text(0, -1.55, f"{frame} coordinates: {name[0]} along, {name[1]} up [deg]", ha="center", fontsize=9)
    ax.set_title(f"{catalog.name}: {len(catalog):,} stars")
    bar = ax.figure.colorbar(image, cax=ax.inset_axes((1.0, 0.12, 0.02, 0.76)), extend="both")
    bar.set_label("stars per square degree")
    return ax


def density_map(
    catalog: StarCatalog, frame: Literal["galactic", "equatorial"] = "galactic"
) -> tuple[Array, tuple[float, float, float, float]]:
    """Stars per square degree in squares of Mollweide's plane, NaN outside the sky, and the extent of the map."""
    side_deg = np.clip(np.sqrt(STARS_PER_PIXEL * 41_253 / max(1, len(catalog))), *PIXEL_DEG_RANGE)
    n_y = int(np.ceil(np.degrees(2 * np.sqrt(2)) / side_deg / 2)) * 2
    half_y, half_x = np.sqrt(2), 2 * np.sqrt(2)
    edges = [np.linspace(-half, half, n + 1) for half, n in ((half_y, n_y), (half_x, 2 * n_y))]
    x, y = mollweide(*_longitude_latitude_deg(catalog, frame))
    count, _, _ = np.histogram2d(y, x, edges)
    # The sky's share of each square, from 12 x 12 points in it: those on the limb are partly outside.
    fine = 12
    row, column = ((np.arange(n * fine) + 0.5) / (n * fine) * 2 - 1 for n in (n_y, 2 * n_y))
    inside = row[:, None] ** 2 + column[None, :] ** 2 <= 1
    share = inside.reshape(n_y, fine, 2 * n_y, fine).mean(axis=(1, 3))
    area_deg2 = share * (2 * half_y / n_y) ** 2 * np.degrees(1) ** 2
    density = np.full(count.shape, np.nan)
    np.divide(count, area_deg2, out=density, where=share > 0)
    return density, (-half_x, half_x, -half_y, half_y)


def mollweide(longitude_deg: Array, latitude_deg: Array) -> tuple[Array, Array]:
    """Mollweide's plane x and y of a unit sphere, shape (n,) each; longitude grows to the left, 180 is on the limb.

    x = -(2 sqrt 2 / pi) longitude cos t, y = sqrt 2 sin t, with 2 t + sin 2 t = pi sin(latitude).
    """
    # t by its inverse function's table: 2e-4 rad at worst, at the poles.
    table = np.linspace(-np.pi / 2, np.pi / 2, 20_001)
    t = np.interp(np.sin(np.radians(latitude_deg)), (2 * table + np.sin(2 * table)) / np.pi, table)
    longitude = np.radians((longitude_deg + 180) % 360 - 180)
    return -2 * np.sqrt(2) / np.pi * longitude * np.cos(t), np.sqrt(2) * np.sin(t)


def plot_sky_partition(catalog: StarCatalog | None = None, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
    """Draw three ways to cut the sky for look-up (the paper's Fig. 6), and what views of 1 x 1 degree cost in each.

    Above, the mesh, latitude and comprehensive tables as spheres, ten times too coarse, with the cells that views of
    10 x 10 degrees open. Below, measured with the real tables and the catalog: stars read and cells opened per view.
    The mesh reads few stars, but near a pole it opens hundreds of cells; the latitude table opens two or three, but
    reads all stars around the Earth's axis; the comprehensive table takes the mesh where cells are wide, and bands
    where they are narrow. The dotted line is what `BandIndex` makes of it: bands sorted by right ascension.

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

    n_band, n_column = 180 // _SCHEME_DEG, 360 // _SCHEME_DEG
    strips: list[Array] = []
    for ra_deg, dec_deg in _SCHEME_VIEWS:
        cover = cover_of([ra_deg], [dec_deg], _SCHEME_DEG / np.sqrt(2), _SCHEME_DEG)
        for band in range(cover.first_band[0], cover.first_band[0] + cover.n_band[0]):
            split = bool(is_split(partition, np.array(band), _SCHEME_DEG))
            first, n = (int(cover.first_column[0]), int(cover.n_column[0])) if split else (0, n_column)
            strips += _visible_strips(band * _SCHEME_DEG - 90, first * _SCHEME_DEG, (first + n) * _SCHEME_DEG)
        corners = _SCHEME_DEG / 2 * np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]])
        x, y, _ = _orthographic(*_beside(ra_deg, dec_deg, *corners))
        ax.plot(x, y, color="black", linewidth=1.6, zorder=3)
    ax.add_collection(PolyCollection(strips, facecolor=_paler(colour), edgecolor=_paler(colour), linewidth=0.5))

    along = np.linspace(-180, 180, 361)
    lines = [(along, np.full(361, band * _SCHEME_DEG - 90.0)) for band in range(1, n_band)]
    cut = [band for band in range(n_band) if is_split(partition, np.array(band), _SCHEME_DEG)]
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
    """The near side of a run of cells, in outlines one degree wide, shape (n, 2) each."""
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
    """Places at small offsets along the tangent plane of a place [deg]."""
    ra, dec = np.radians([ra_deg, dec_deg])
    centre = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    east = np.array([-np.sin(ra), np.cos(ra), 0])
    north = np.cross(centre, east)
    x, y, z = centre[:, None] + np.outer(east, np.radians(east_deg)) + np.outer(north, np.radians(north_deg))
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))


def _orthographic(ra_deg: Array, dec_deg: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Places on a sphere seen from far above longitude -90, and whether they are on the near side; shape (n,)."""
    ra, dec = np.radians(ra_deg), np.radians(dec_deg)
    tilt = np.radians(_GLOBE_LATITUDE_DEG)
    right, towards = np.cos(dec) * np.cos(ra), -np.cos(dec) * np.sin(ra)
    up = np.sin(dec) * np.cos(tilt) - towards * np.sin(tilt)
    return right, up, np.sin(dec) * np.sin(tilt) + towards * np.cos(tilt) >= 0


def _draw_graticule(ax: Axes) -> None:
    """Limb, meridians every 60 and parallels every 30 degrees, with their longitudes and latitudes."""
    line: dict[str, Any] = {"color": "white", "linewidth": 0.5, "alpha": 0.6}
    across = np.linspace(-179.999, 180, 181)
    up = np.linspace(-90, 90, 181)
    for latitude in range(-60, 61, 30):
        ax.plot(*mollweide(across, np.full(181, float(latitude))), **line)
        x, y = mollweide(np.array([180.0 - 1e-9]), np.array([float(latitude)]))
        ax.text(x[0] - 0.08, y[0], f"{latitude}", ha="right", va="center", fontsize=8)
    for longitude in range(-120, 121, 60):
        x, y = mollweide(np.full(181, float(longitude)), up)
        ax.plot(x, y, **line)
        ax.text(x[75], y[75], f"{longitude % 360}", color="white", fontsize=8, ha="center")
    limb = np.linspace(0, 2 * np.pi, 361)
    ax.plot(2 * np.sqrt(2) * np.cos(limb), np.sqrt(2) * np.sin(limb), color="black", linewidth=0.8)


def _longitude_latitude_deg(catalog: StarCatalog, frame: str) -> tuple[Array, Array]:
    """Places of the stars in a frame [deg], shape (n,) each."""
    if frame == "equatorial":
        return catalog.ra_deg, catalog.dec_deg
    return place_of(catalog.direction_icrs @ GALACTIC_OF_ICRS.T)


def _paler(colour: str) -> tuple[float, ...]:
    """A colour mixed with white: unlike a transparent one, it does not show where strips overlap."""
    from matplotlib.colors import to_rgb

    return tuple(0.35 * part + 0.65 for part in to_rgb(colour))


def _colour_map(name: str) -> Any:
    from matplotlib import colormaps

    return colormaps[name]
