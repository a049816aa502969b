"""The infrared spectrum of a star of known colour temperature: its light per interval of a band, and in other bands.

The shape is Engelke's continuum (1992, AJ 104, 1248), made for giants between 2 and 60 um: Planck's law at the
brightness temperature

    T_b = 0.738 T (1 + 79450 / (lambda T))^0.182,   lambda in um, T in K.

It is the continuum only. The fundamental band of SiO at 8 um and those of CO at 4.3 to 5 um take 1-5 % (late M giants
more), and dust around a star adds what no photosphere has. Only the shape is used, never the level: that comes from
the catalog's fluxes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import BANDS, RADIATION_1_W_M2_SR, RADIATION_2_M_K, as_band
from warpsim.radiometry.quadrature import composite_rule, gauss_rule
from warpsim.sky.colours import CLASS_TEMPERATURE_K, UNKNOWN_COLOUR_CLASS

Array = NDArray[np.float64]

VALID_UM = (2.0, 60.0)
"""Wavelengths for which the continuum was made [um]."""

TEMPERATURE_RANGE_K = (1000.0, 100_000.0)
"""Colour temperatures outside are taken for the nearer end [K]: below there is no photosphere, above no change."""

UNKNOWN_TEMPERATURE_K = float(CLASS_TEMPERATURE_K[UNKNOWN_COLOUR_CLASS])
"""Of stars without a colour temperature [K]: that of the class they are taken for elsewhere, K giants."""

_N_NODE = 8
"""Quadrature nodes per part of a user's band between two wavelengths of the catalog: 1e-9 over 2 to 60 um."""

_GRID_K = np.geomspace(*TEMPERATURE_RANGE_K, 1025)
"""Temperatures between which the light per flux density is interpolated, linear in ln T [K]: error below 1e-6."""

_CHUNK_ELEMENTS = 2_000_000
"""Temperatures times wavelengths evaluated at once, to bound memory (16 MB per temporary)."""

_W_CM2_UM_PER_JY_UM2 = 1e-26 * SPEED_OF_LIGHT_M_S * 1e12 * 1e-10
"""Times F [Jy] / lambda^2 [um2]: flux density per wavelength [W/cm2/um]."""


def engelke_temperature_k(wavelength_um: ArrayLike, temperature_k: ArrayLike) -> Any:
    """Brightness temperature of a star's continuum [K], Engelke (1992).

    Args:
        wavelength_um: Wavelength [um], > 0; broadcast against temperature_k.
        temperature_k: Effective or colour temperature [K], > 0.
    """
    wavelength, temperature = np.asarray(wavelength_um), np.asarray(temperature_k)
    return 0.738 * temperature * (1.0 + 79450.0 / (wavelength * temperature)) ** 0.182


def star_radiance_w_m2_sr_um(wavelength_um: ArrayLike, temperature_k: ArrayLike) -> Any:
    """Spectral radiance of a star's surface [W/m2/sr/um]: Planck's law at engelke_temperature_k().

    Args:
        wavelength_um: Wavelength [um], > 0; broadcast against temperature_k.
        temperature_k: Colour temperature [K]; NaN stands for UNKNOWN_TEMPERATURE_K, and values outside
            TEMPERATURE_RANGE_K for its nearer end.
    """
    wavelength_m = np.asarray(wavelength_um, dtype=np.float64) * 1e-6
    brightness_k = engelke_temperature_k(wavelength_um, known_temperature_k(temperature_k))
    return RADIATION_1_W_M2_SR / wavelength_m**5 / np.expm1(RADIATION_2_M_K / (wavelength_m * brightness_k)) * 1e-6


def known_temperature_k(temperature_k: ArrayLike) -> Array:
    """Colour temperatures inside TEMPERATURE_RANGE_K, UNKNOWN_TEMPERATURE_K where NaN."""
    temperature = np.asarray(temperature_k, dtype=np.float64)
    return np.clip(np.where(np.isnan(temperature), UNKNOWN_TEMPERATURE_K, temperature), *TEMPERATURE_RANGE_K)


def interval_shares(band: Band | str, n_interval: int, temperature_k: ArrayLike) -> tuple[Array, Array]:
    """Share of a star's light in a band that falls to each spectral interval of Band.intervals().

    Share k is w_k S(lambda_k, T) / sum over j of w_j S(lambda_j, T), S the continuum. For a smooth f of wavelength, an
    optic's transmission or blur, the sum of share times f is f's mean over the star's light in the band.

    Args:
        band: A Band within VALID_UM, or the name of one in BANDS.
        n_interval: How many intervals, 1 to 32.
        temperature_k: Colour temperature [K], shape (n_star,), as star_radiance_w_m2_sr_um() takes it.

    Returns:
        Wavelengths of the intervals [um], shape (n_interval,), and shares, shape (n_star, n_interval), of sum 1.

    Raises:
        InputError: Unknown band, a band outside VALID_UM, or n_interval out of range.
    """
    band = _band_of_stars(band)
    wavelength_um, weight_um = band.intervals(n_interval)
    # Catalogs often hold a handful of temperatures.
    temperature, star = np.unique(known_temperature_k(temperature_k), return_inverse=True)
    shares = np.empty((len(temperature), n_interval))
    step = _CHUNK_ELEMENTS // n_interval
    for start in range(0, len(temperature), step):
        chunk = slice(start, start + step)
        light = weight_um * star_radiance_w_m2_sr_um(wavelength_um, temperature[chunk, None])
        shares[chunk] = light / light.sum(axis=1, keepdims=True)
    return wavelength_um, shares[star]


def band_irradiance_w_cm2(band: Band | str, flux_jy: Mapping[str, Array], temperature_k: ArrayLike) -> Array:
    """In-band irradiance of stars in any band, from their flux densities in the MSX bands [W/cm2], shape (n_star,).

    The spectrum is the star's continuum times a factor that meets the flux densities given. Each of them is the mean
    over its band by frequency (so MSX defines it; in band A it lies 5 % from the flux density at the isophotal
    wavelength), and its factor is put to that band's isophotal wavelength. Between those wavelengths the factor is
    linear in ln(wavelength), beyond the outermost it is constant; a star whose flux is known in one band only keeps its
    continuum's shape. A star without any flux gives 0.

    Args:
        band: A Band within VALID_UM, or the name of one in BANDS.
        flux_jy: Flux density [Jy] by MSX band, shape (n_star,) each, NaN where unknown.
        temperature_k: Colour temperature [K], shape (n_star,), as star_radiance_w_m2_sr_um() takes it.

    Raises:
        InputError: Unknown band, or a band outside VALID_UM.
    """
    band = _band_of_stars(band)
    names = sorted(flux_jy, key=lambda name: BANDS[name].isophotal_um)
    ln_knot = np.log([BANDS[name].isophotal_um for name in names])
    node_um, weight_um = _rule_between(band, np.exp(ln_knot))
    light = weight_um * star_radiance_w_m2_sr_um(node_um, _GRID_K[:, None])
    mean = np.stack([_mean_over_frequency(BANDS[name]) for name in names], axis=1)

    ln_temperature = np.log(known_temperature_k(temperature_k))
    flux = np.stack([flux_jy[name] for name in names], axis=1)
    irradiance_w_cm2 = np.zeros(len(flux))
    # Stars with fluxes in the same bands are alike but for the temperature; there are few kinds.
    kinds, kind = np.unique(np.isfinite(flux) @ (1 << np.arange(len(names))), return_inverse=True)
    for number, code in enumerate(kinds.tolist()):
        rows = np.flatnonzero(kind == number)
        known = [k for k in range(len(names)) if code >> k & 1]
        for column, k in enumerate(known):
            # The part of the factor that flux k makes: 1 at its own wavelength, 0 at the other known ones.
            hat = np.interp(np.log(node_um), ln_knot[known], np.eye(len(known))[column])
            w_cm2_per_jy = _W_CM2_UM_PER_JY_UM2 * (light @ hat) / mean[:, k]
            irradiance_w_cm2[rows] += flux[rows, k] * np.interp(ln_temperature[rows], np.log(_GRID_K), w_cm2_per_jy)
    return irradiance_w_cm2


def _mean_over_frequency(band: Band) -> Array:
    """Mean of lambda^2 S over a band by frequency, for the temperatures of _GRID_K [W/m2/sr/um um2].

    The integral of R S_nu over nu is that of R S over lambda, and d nu goes like d lambda / lambda^2.
    """
    wavelength_um, weight_um = band.intervals(_N_NODE)
    return np.asarray(star_radiance_w_m2_sr_um(wavelength_um, _GRID_K[:, None]) @ weight_um) / np.sum(
        weight_um / wavelength_um**2
    )


def _band_of_stars(band: Band | str) -> Band:
    """The band meant, if the continuum holds all over it."""
    band = as_band(band)
    lit = np.flatnonzero(band.response > 0.0)
    low_um = float(band.wavelength_um[max(lit[0] - 1, 0)])
    high_um = float(band.wavelength_um[min(lit[-1] + 1, len(band.response) - 1)])
    if low_um < VALID_UM[0] or high_um > VALID_UM[1]:
        raise InputError(
            f"must lie within {VALID_UM[0]:g} to {VALID_UM[1]:g} um, where the spectrum of stars is known, got "
            f"{low_um:g} to {high_um:g} um",
        ).of(f"band {band.name}")
    return band


def _rule_between(band: Band, knot_um: Array) -> tuple[Array, Array]:
    """Gauss rule over a band, cut at the knots, where the integrand has kinks: nodes and weights [um], (m,) each."""
    inside = knot_um[(knot_um > band.wavelength_um[0]) & (knot_um < band.wavelength_um[-1])]
    edge_um = np.unique(np.concatenate([band.wavelength_um, inside]))
    response = np.interp(edge_um, band.wavelength_um, band.response)
    cuts = np.concatenate([[0], np.searchsorted(edge_um, np.sort(inside)), [len(edge_um) - 1]])
    nodes, weights = [], []
    for first, last in itertools.pairwise(cuts):
        piece = slice(first, last + 1)
        if response[piece].max() > 0.0:
            node_um, weight_um = gauss_rule(*composite_rule(edge_um[piece], response[piece], _N_NODE + 1), _N_NODE)
            nodes.append(node_um)
            weights.append(weight_um)
    return np.concatenate(nodes), np.concatenate(weights)
