"""Spectra of stars by luminosity class and temperature, 0.28 to 45 um, and their light in any band.

A template is a relative spectral irradiance, linear between the nodes of one wavelength grid. It holds at one of the
temperatures of one grid; a star between two of them has the mixture

    S(lambda) = (1 - w) S_k(lambda) + w S_k+1(lambda),   w = ln(T / T_k) / ln(T_k+1 / T_k)

so that every integral over its spectrum is the same mixture of two numbers, exactly. All templates have the same light
over all wavelengths. Their shapes are those of Pickles (1998, PASP 110, 863) to 2.3 um and Engelke's continuum (1992,
AJ 104, 1248) beyond, bent to the mean colours of measured stars; `catalogs/build_stellar_templates.py` makes them and
catalogs/README.md has their errors.

Temperatures are those of the mean star of a colour (`colour_temperature_k`): a star's template has the star's colour.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import as_band

Classes = NDArray[np.int64]

DWARF, GIANT = 0, 1
"""Luminosity classes: V (and IV of blue stars), and III to I. They part at BP-RP = 0.95; bluer ones are alike."""

UNKNOWN_TEMPERATURE_K = 4850.0
"""Stars without a colour are taken for K giants, the most numerous in the infrared."""

GIANT_BP_RP_MAG = 0.95
GIANT_ABSOLUTE_G_MAG = 3.8
"""Redder and brighter stars are giants: the main sequence lies 2 mag below, the giants' branch mostly above."""

GIANT_REDUCED_MOTION_MAG = 8.5
"""Without a parallax: reduced proper motion G + 5 log10(pm ["/yr]) + 5 below which a red star is a giant. It is the
absolute magnitude plus 4 for stars of 30 km/s; those of dwarfs as red begin at 6."""

_FILE = "stellar_templates_v1.npz"
_N_GAUSS = 3
"""Gauss points between two nodes of response and template: exact for a factor that is a quadratic there."""

_PAIRS = {"BP-RP": ("BP", "RP"), "V-K": ("V", "Ks"), "J-K": ("J", "Ks")}


@dataclass(frozen=True)
class _Templates:
    wavelength_um: F64
    """Of the nodes, (m,), increasing."""

    temperature_k: F64
    """(n_t,), increasing."""

    spectrum: F64
    """Spectral irradiance per wavelength, relative, (n_class, n_t, m), of integral 1 over wavelength."""

    v_i_mag: F64
    """Mean V-I as Hipparcos lists it [mag], (n_class, n_t)."""

    b_v_mag: F64
    """Mean B-V as Hipparcos lists it [mag], (n_class, n_t)."""


@functools.lru_cache(maxsize=1)
def templates() -> _Templates:
    """Return the templates that ship with warpsim; arrays are read-only."""
    from warpsim_catalogs import path

    with path(_FILE).open("rb") as stream, np.load(stream, allow_pickle=False) as columns:
        numbers = {key: columns[key].astype(np.float64) for key in columns.files}
    for values in numbers.values():
        values.setflags(write=False)
    return _Templates(**numbers)


def mixture(temperature_k: ArrayLike) -> tuple[NDArray[np.int64], F64]:
    """Lower template k and weight w of the next one for temperatures [K], of their shape.

    NaN stands for UNKNOWN_TEMPERATURE_K, and temperatures beyond the templates' for the nearest of them.
    """
    grid_k = templates().temperature_k
    given_k = np.asarray(temperature_k, dtype=np.float64)
    clipped_k = np.clip(np.where(np.isnan(given_k), UNKNOWN_TEMPERATURE_K, given_k), grid_k[0], grid_k[-1])
    ln_grid = np.log(grid_k)
    lower = np.clip(np.searchsorted(grid_k, clipped_k, side="right") - 1, 0, len(grid_k) - 2)
    return lower, (np.log(clipped_k) - ln_grid[lower]) / (ln_grid[lower + 1] - ln_grid[lower])


def mixed(values: F64, luminosity: ArrayLike, temperature_k: ArrayLike) -> F64:
    """Values of stars, (n_star, ...), from those of the templates: any linear function of them, (n_class, n_t, ...).

    Any luminosity but DWARF is taken for GIANT; temperatures are as mixture() takes them.
    """
    lower, weight = mixture(temperature_k)
    of_class = np.where(np.asarray(luminosity) == DWARF, DWARF, GIANT)
    weight = weight.reshape(weight.shape + (1,) * (values.ndim - 2))
    return np.asarray((1.0 - weight) * values[of_class, lower] + weight * values[of_class, lower + 1])


def band_nodes(band: Band | str) -> tuple[F64, F64, F64]:
    """Quadrature over a band: wavelengths and weights times energy response [um] (m,), templates (n_class, n_t, m).

    The nodes are Gauss points between any two neighbours among the nodes of response and templates: exact for the light
    of a template, also times a factor that is a quadratic of wavelength between them.
    """
    band = as_band(band)
    check_reach(band)
    grid_um = templates().wavelength_um
    low_um, high_um = band.lit_um
    edge_um = np.union1d(band.wavelength_um, grid_um)
    edge_um = edge_um[(edge_um >= low_um) & (edge_um <= high_um)]
    abscissa, weight = np.polynomial.legendre.leggauss(_N_GAUSS)
    half_um = np.diff(edge_um)[:, None] / 2.0
    node_um = (edge_um[:-1, None] + half_um * (1.0 + abscissa)).ravel()
    weight_um = (half_um * weight).ravel() * band.energy_response(node_um)
    right = np.searchsorted(grid_um, node_um)
    part = (node_um - grid_um[right - 1]) / (grid_um[right] - grid_um[right - 1])
    spectrum = templates().spectrum
    return node_um, weight_um, (1.0 - part) * spectrum[..., right - 1] + part * spectrum[..., right]


def check_reach(band: Band) -> None:
    """Raise InputError for a band whose response reaches beyond the templates."""
    grid_um = templates().wavelength_um
    low_um, high_um = band.lit_um
    if low_um < grid_um[0] or high_um > grid_um[-1]:
        rule = f"must lie within {grid_um[0]:g} to {grid_um[-1]:g} um, where the spectrum of stars is known"
        raise InputError(f"{rule}, got {low_um:g} to {high_um:g} um").of(f"band {band.name}")


def band_light(band: Band | str) -> F64:
    """Integral of energy response times template over wavelength, relative, (n_class, n_t); read-only."""
    return _band_light(as_band(band))


@functools.lru_cache(maxsize=64)
def _band_light(band: Band) -> F64:
    _, weight_um, spectrum = band_nodes(band)
    light = spectrum @ weight_um
    light.setflags(write=False)
    return np.asarray(light)


def magnitude_light(band: Band | str) -> F64:
    """Light of the templates in a band with a zero point over that of magnitude 0, relative, (n_class, n_t)."""
    band = as_band(band)
    return band_light(band) / band.zero_mag_w_cm2


def colour(band: Band | str, other: Band | str, luminosity: ArrayLike, temperature_k: ArrayLike) -> F64:
    """Magnitude in a band minus that in another one of stars [mag], (n_star,), by the bands' zero points."""
    ratio = mixed(magnitude_light(band), luminosity, temperature_k) / mixed(
        magnitude_light(other), luminosity, temperature_k
    )
    return np.asarray(-2.5 * np.log10(ratio))


def colour_temperature_k(colour_mag: ArrayLike, kind: str | tuple[str, str], luminosity: ArrayLike = GIANT) -> F64:
    """Temperature [K] of the template that has a colour, (n_star,); NaN in, NaN out.

    Colours between two bands are met exactly; "V-I" and "B-V", as Hipparcos lists them, on average. A colour beyond
    those of the templates is taken for the nearest. Where two temperatures have it, the hotter one is meant (J-K of
    dwarfs below 3,900 K, B-V of giants below 3,700 K): better use another colour of such stars.

    `kind` is "BP-RP", "V-I", "V-K", "J-K" (K is 2MASS Ks) or "B-V", or a pair of names of bands with zero points.
    """
    given = np.asarray(colour_mag, dtype=np.float64)
    of_class = np.broadcast_to(np.where(np.asarray(luminosity) == DWARF, DWARF, GIANT), given.shape)
    ln_k = np.log(templates().temperature_k)
    pair = _PAIRS.get(kind) if isinstance(kind, str) else kind
    result = np.full(given.shape, np.nan)
    for number in (DWARF, GIANT):
        rows = (of_class == number) & ~np.isnan(given)
        if pair is not None:
            blue, red = (magnitude_light(name)[number] for name in pair)
            index, weight = _at_ratio(10.0 ** (-0.4 * given[rows]), blue, red)
        else:
            listed = templates().v_i_mag if kind == "V-I" else templates().b_v_mag
            index, weight = _at_ratio(-given[rows], -listed[number], np.ones(len(ln_k)))
        result[rows] = np.exp(ln_k[index] + weight * (ln_k[index + 1] - ln_k[index]))
    return result


def luminosity_class(
    g_mag: ArrayLike, bp_rp_mag: ArrayLike, parallax_mas: ArrayLike = np.nan, pm_mas_yr: ArrayLike = np.nan
) -> Classes:
    """DWARF or GIANT, by colour and absolute magnitude; without a parallax, by reduced proper motion.

    A red star of which neither is known is taken for a giant: among stars as bright as a catalog of the sky goes they
    outnumber dwarfs. V stands for G and V-I for BP-RP where those are unknown; without a colour the brightness alone
    decides. Parallaxes <= 0 and motions of 0 are unknown, like NaN.
    """
    magnitude, bp_rp, parallax, motion = (
        np.asarray(values, dtype=np.float64) for values in (g_mag, bp_rp_mag, parallax_mas, pm_mas_yr)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        by_parallax = magnitude + 5.0 * np.log10(parallax / 100.0) < GIANT_ABSOLUTE_G_MAG
        by_motion = ~(magnitude + 5.0 * np.log10(motion / 1000.0) + 5.0 > GIANT_REDUCED_MOTION_MAG)
        bright = np.where(parallax > 0.0, by_parallax, by_motion)
        return np.where(bright & ~(bp_rp < GIANT_BP_RP_MAG), GIANT, DWARF).astype(np.int64)


def _at_ratio(ratio: F64, blue: F64, red: F64) -> tuple[NDArray[np.int64], F64]:
    """Template, and weight of the next one, whose mixture has a ratio of blue to red; the hotter one of two.

    Ratios beyond those of the templates are taken for the nearest.
    """
    rising = blue / red
    first = len(rising) - 1
    while first > 0 and rising[first - 1] < rising[first]:
        first -= 1
    clipped = np.clip(ratio, rising[first], rising[-1])
    index = np.searchsorted(rising[first:], clipped, side="right") - 1 + first
    index = np.minimum(index, len(rising) - 2)
    excess, next_excess = blue[index] - clipped * red[index], blue[index + 1] - clipped * red[index + 1]
    return index, excess / (excess - next_excess)
