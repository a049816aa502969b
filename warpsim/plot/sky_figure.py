"""Figures of star catalogs (counts by magnitude, density over the sky) and of spectral bands over spectra."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.plot.figure import BLUE, GREEN, GREY, ORANGE, PURPLE, SERIES, VERMILION, literal, new_axes
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import BANDS, as_band, planck_w_m2_sr_um
from warpsim.radiometry.sun_and_earth import earth_spectrum, solar_spectrum
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.positions import position_of
from warpsim.sky.star_counts import irradiance_counts, magnitude_counts
from warpsim.sky.stellar_templates import GIANT, templates
from warpsim.sky.synthetic import GALACTIC_OF_ICRS

if TYPE_CHECKING:
    from matplotlib.axes import Axes


STARS_PER_PIXEL = 30
"""Of a density map, on average: scatter 18 %."""
PIXEL_DEG_RANGE = (1.0, 10.0)

FEW_STARS = 300
"""Drawn as points in a density map, where a count per square would not show them."""

_HALF_X, _HALF_Y = 2 * np.sqrt(2), np.sqrt(2)  # of Mollweide's map of a unit sphere

RANGE_UM = (0.3, 30.0)
DECADES = 4
"""Below its peak, to which a spectrum is drawn."""

GIANT_K = 4000.0
"""Temperature of the star that is drawn besides the Sun."""

_N_WAVELENGTH = 1200
_MOST_SURFACES = 3
_MOST_NAMES = 4  # of targets of one spectrum


def plot_star_counts(
    catalog: StarCatalog, bands: Sequence[Band | str] = ("B1", "B2", "A", "C", "D", "E"), ax: Axes | None = None
) -> Axes:
    """Draw the number of stars by band and whole magnitude (the paper's Fig. 5); m counts from m to below m + 1.

    If one of the bands has no zero point, stars are counted by decades of in-band irradiance, the brightest first.

    Args:
        catalog: The stars.
        bands: Bands or their names, drawn in this order.
        ax: Where to draw.

    Raises:
        InputError: A band is unknown, or none is given.
    """
    if not bands:
        raise InputError("must name at least one", "bands")
    from matplotlib import colormaps

    chosen = [as_band(band) for band in bands]
    by_magnitude = all(band.zero_mag_w_cm2 > 0.0 for band in chosen)
    if by_magnitude:
        counts = [magnitude_counts(catalog, band) for band in chosen]
    else:
        counts = [(-1 - steps[::-1], n[::-1]) for steps, n in (irradiance_counts(catalog, band) for band in chosen)]
    ax = ax or new_axes(8.5, 4.8)
    width = 0.86 / len(counts)
    for number, (band, (steps, n_star)) in enumerate(zip(chosen, counts, strict=True)):
        left = steps + 0.07 + number * width
        label = f"{band.name}, {band.isophotal_um:.2f} um" + ("" if len(n_star) else ": no fluxes")
        ax.bar(left, n_star, width, align="edge", color=colormaps["plasma"](_darkness(band, chosen)), label=label)
    drawn = [steps for steps, _ in counts if len(steps)]
    if drawn:
        first, last = int(min(s[0] for s in drawn)), int(max(s[-1] for s in drawn)) + 1
        ticks = range(first, last + 1, max(1, -(-(last - first) // 25)))
        ax.set(xlim=(first, last), xticks=ticks, yscale="log", ylim=(0.7, None))
        if not by_magnitude:
            ax.set_xticklabels([f"1e{-tick}" for tick in ticks])
    else:
        ax.text(0.5, 0.5, "no star has a flux", ha="center", transform=ax.transAxes)
        ax.set(xticks=[], yticks=[])
    group = "magnitude in the band" if by_magnitude else "in-band irradiance [W/cm2]"
    step_name = "whole magnitude" if by_magnitude else "decade"
    ax.set(xlabel=f"{group} (one group of bars per {step_name})", ylabel="number of stars")
    ax.set_title(f"{literal(catalog.name)}: {len(catalog):,} stars")
    ax.grid(axis="y", alpha=0.3)
    ax.set_axisbelow(True)
    ax.legend(loc="upper left", ncols=2 if len(counts) > 3 else 1, fontsize=9)
    return ax


def _darkness(band: Band, drawn: Sequence[Band]) -> float:
    """Position of a band in the colour map: short wavelengths are dark; MSX bands among themselves have one always."""
    all_msx = all(other.name in BANDS for other in drawn)
    order = sorted(BANDS.values() if all_msx else drawn, key=lambda other: other.isophotal_um)
    return 0.05 + 0.85 * [other.name for other in order].index(band.name) / max(1, len(order) - 1)


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
    image = ax.imshow(
        np.clip(density, *range_per_deg2), origin="lower", extent=extent, cmap="magma", norm=LogNorm(*range_per_deg2),
        interpolation="nearest",
    )  # fmt: skip
    limb = ax.add_patch(Ellipse((0, 0), 2 * _HALF_X, 2 * _HALF_Y, fill=False, edgecolor="black", linewidth=0.8))
    image.set_clip_path(limb)
    if len(catalog) <= FEW_STARS:
        ax.plot(*mollweide(*_longitude_latitude_deg(catalog, frame)), ".", color="white", markersize=4)
    _draw_graticule(ax)
    name = {"galactic": ("l", "b"), "equatorial": ("RA", "dec")}[frame]
    ax.set(xlim=(-2.95, 2.95), ylim=(-1.6, 1.5), aspect="equal")
    ax.set_axis_off()
    ax.text(0, -1.55, f"{frame} coordinates: {name[0]} along, {name[1]} up [deg]", ha="center", fontsize=9)
    ax.set_title(f"{literal(catalog.name)}: {len(catalog):,} stars")
    bar = ax.figure.colorbar(image, cax=ax.inset_axes((1.0, 0.12, 0.02, 0.76)), extend="both")
    bar.set_label("stars per square degree")
    return ax


def density_map(
    catalog: StarCatalog, frame: Literal["galactic", "equatorial"] = "galactic"
) -> tuple[F64, tuple[float, float, float, float]]:
    """Return stars per square degree in squares of Mollweide's plane, NaN outside the sky, and the map's extent."""
    side_deg = np.clip(np.sqrt(STARS_PER_PIXEL * 41_253 / max(1, len(catalog))), *PIXEL_DEG_RANGE)
    n_y = int(np.ceil(np.degrees(2 * _HALF_Y) / side_deg / 2)) * 2
    edges = [np.linspace(-half, half, n + 1) for half, n in ((_HALF_Y, n_y), (_HALF_X, 2 * n_y))]
    x, y = mollweide(*_longitude_latitude_deg(catalog, frame))
    count, _, _ = np.histogram2d(y, x, edges)
    # The fraction of each square within the sky, from 12 x 12 points in it: those on the limb are partly outside.
    fine = 12
    row, column = ((np.arange(n * fine) + 0.5) / (n * fine) * 2 - 1 for n in (n_y, 2 * n_y))
    inside = row[:, None] ** 2 + column[None, :] ** 2 <= 1
    covered = inside.reshape(n_y, fine, 2 * n_y, fine).mean(axis=(1, 3))
    area_deg2 = covered * (2 * _HALF_Y / n_y) ** 2 * np.degrees(1) ** 2
    density = np.full(count.shape, np.nan)
    np.divide(count, area_deg2, out=density, where=covered > 0)
    return density, (-_HALF_X, _HALF_X, -_HALF_Y, _HALF_Y)


def mollweide(longitude_deg: F64, latitude_deg: F64) -> tuple[F64, F64]:
    """Return x and y of a unit sphere on Mollweide's plane, (n,) each; longitude grows to the left, 180 is on the limb.

    x = -(2 sqrt 2 / pi) longitude cos t, y = sqrt 2 sin t, with 2 t + sin 2 t = pi sin(latitude).
    """
    # t by its inverse function's table: 2e-4 rad at worst, at the poles.
    table = np.linspace(-np.pi / 2, np.pi / 2, 20_001)
    t = np.interp(np.sin(np.radians(latitude_deg)), (2 * table + np.sin(2 * table)) / np.pi, table)
    longitude = np.radians((longitude_deg + 180) % 360 - 180)
    return -_HALF_X / np.pi * longitude * np.cos(t), _HALF_Y * np.sin(t)


def _draw_graticule(ax: Axes) -> None:
    """Meridians every 60 and parallels every 30 degrees, with their longitudes and latitudes."""
    line: dict[str, Any] = {"color": "white", "linewidth": 0.5, "alpha": 0.6}
    across, up = np.linspace(-179.999, 180 - 1e-9, 181), np.linspace(-90, 90, 181)
    for latitude in range(-60, 61, 30):
        x, y = mollweide(across, np.full(181, float(latitude)))
        ax.plot(x, y, **line)
        ax.text(x[-1] - 0.08, y[-1], f"{latitude}", ha="right", va="center", fontsize=8)
    for longitude in range(-120, 121, 60):
        x, y = mollweide(np.full(181, float(longitude)), up)
        ax.plot(x, y, **line)
        ax.text(x[75], y[75], f"{longitude % 360}", color="white", fontsize=8, ha="center")


def _longitude_latitude_deg(catalog: StarCatalog, frame: str) -> tuple[F64, F64]:
    """Longitudes and latitudes of the stars in a frame [deg], shape (n,) each."""
    if frame == "equatorial":
        return catalog.ra_deg, catalog.dec_deg
    return position_of(*(GALACTIC_OF_ICRS @ catalog.direction_icrs.T))


def plot_bands(scene: Scene | Scenario, ax: Axes | None = None) -> Axes:
    """Draw the responses of a scene's bands, over the spectra of what its sensors see.

    Responses count on the left axis, by energy or by photon as they were given. Spectra are powers per logarithm of
    wavelength, each relative to its largest in the figure, on the right axis: the Sun and a red giant, the Earth's mean
    emission and the sunlight that it reflects, and for up to three descriptions of targets their own emission at the
    first temperature and the sunlight that they reflect.

    Args:
        scene: The scene.
        ax: Where to draw.

    Raises:
        InputError: The scene has no scenario, or matplotlib is not installed.
    """
    scenario = scenario_of(scene)
    ax = ax or new_axes(10.0, 5.2)
    _draw_responses(ax, scenario.bands)
    spectra = ax.twinx()
    wavelength_um = np.geomspace(*RANGE_UM, _N_WAVELENGTH)
    for label, style, values in [*_background(wavelength_um), *_targets(scenario, wavelength_um)]:
        power = values * wavelength_um
        spectra.plot(wavelength_um, power / power.max(), label=label, linewidth=1.3, **style)
    spectra.set(yscale="log", ylim=(10.0**-DECADES, 20.0), ylabel="power per ln(wavelength) over peak (lines)")
    spectra.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=4, fontsize=8, frameon=False)
    ax.set_title(f"Bands of {literal(scenario.scene.name)}")
    return ax


def _draw_responses(ax: Axes, bands: dict[str, Band]) -> None:
    """Draw each response as an area with the band's name at its peak."""
    from matplotlib.ticker import ScalarFormatter

    for number, (name, band) in enumerate(bands.items()):
        colour = SERIES[number % len(SERIES)]
        edge_um = np.concatenate([band.wavelength_um[:1], band.wavelength_um, band.wavelength_um[-1:]])
        ax.fill_between(edge_um, np.pad(band.response, 1), color=colour, alpha=0.25, linewidth=0)
        ax.plot(edge_um, np.pad(band.response, 1), color=colour, linewidth=1.0)
        low_um, high_um = band.half_power_um
        middle = np.log(np.sqrt(low_um * high_um) / RANGE_UM[0]) / np.log(RANGE_UM[1] / RANGE_UM[0])
        above = (middle, 0.90 + 0.045 * (number % 2))
        ax.annotate(name, above, xycoords="axes fraction", ha="center", fontsize=9, color=colour)
    ax.set(xscale="log", xlim=RANGE_UM, ylim=(0.0, 1.3))
    ax.set(xlabel="wavelength [um]", ylabel="response over its peak (areas)")
    ax.set_xticks([0.3, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 30.0])
    ax.xaxis.set_major_formatter(ScalarFormatter())
    ax.minorticks_off()
    ax.grid(axis="x", alpha=0.3)


def _background(wavelength_um: F64) -> list[tuple[str, dict[str, Any], F64]]:
    """Label, style and spectrum per wavelength of the Sun, a star and the Earth."""
    sun, earth = solar_spectrum().at(wavelength_um), earth_spectrum()
    node = int(np.argmin(np.abs(templates().temperature_k - GIANT_K)))
    giant = np.interp(wavelength_um, templates().wavelength_um, templates().spectrum[GIANT, node])
    emitted = earth.radiance_w_m2_sr_um(wavelength_um)
    return [
        ("Sun", {"color": ORANGE}, sun),
        (f"giant, {templates().temperature_k[node]:.0f} K", {"color": VERMILION}, giant),
        ("Earth, emitted", {"color": BLUE}, emitted),
        ("Earth, reflected sunlight", {"color": BLUE, "linestyle": ":"}, sun * earth.albedo.at(wavelength_um)),
    ]


def _listed(names: list[str]) -> str:
    """The first names, and how many more there are."""
    more = len(names) - _MOST_NAMES
    return ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


def _targets(scenario: Scenario, wavelength_um: F64) -> list[tuple[str, dict[str, Any], F64]]:
    """Label, style and spectrum per wavelength of light from targets, emitted and reflected."""
    sun, lines = solar_spectrum().at(wavelength_um), []
    alike: dict[tuple[Any, int], dict[str, float]] = {}  # names and temperatures by what is drawn as one line
    for target, rows in zip(scenario.targets, scenario.temperatures, strict=True):
        kelvin = float(rows.temperature_k[0])
        surface = target.spec.surface if target.spec.surface.is_spectral else None  # gray ones have one spectrum
        alike.setdefault((surface, round(kelvin)), {}).setdefault(target.spec.name, kelvin)
    for number, ((surface, _), named) in enumerate(list(alike.items())[:_MOST_SURFACES]):
        kelvin, label = next(iter(named.values())), _listed(list(named))
        emissivity = np.ones_like(wavelength_um)
        if surface is not None:
            emissivity = surface.emissivity_curve.at(wavelength_um)
        colour = (GREEN, PURPLE, GREY)[number]
        emitted = emissivity * planck_w_m2_sr_um(wavelength_um, kelvin)
        lines.append((f"{label}, {kelvin:.0f} K", {"color": colour}, emitted))
        if surface is not None:
            reflected = (1.0 - emissivity) * sun
            lines.append((f"{label}, reflected", {"color": colour, "linestyle": ":"}, reflected))
    return lines
