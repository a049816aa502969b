"""Curves over wavelength in a band, and the light of the Sun and the Earth by their spectra.

The Earth's spectrum (made by `catalogs/build_earth_spectrum.py`; sources in catalogs/README.md) is a mean over the
globe and the year, clouds included, as a Lambert sphere that looks alike from everywhere. Its exitance is 240 W/m2
and its mean albedo in sunlight 0.29, as CERES measures them. A single scene differs by far more: clear desert at noon
has 320 K in the windows, a storm's top 200 K.
"""

from __future__ import annotations

import functools
import math
from importlib.resources.abc import Traversable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from warpsim_catalogs import path

from warpsim.arrays import F64
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import band_radiance_w_m2_sr, of_band, planck_w_m2_sr_um
from warpsim.radiometry.curve_nodes import piecewise_rule

_NODES_PER_PIECE = 10
_MAX_PIECE_LOG_WIDTH = 0.02
_TEMPERATURE_RTOL = 1e-13

N_EXACT = 3
"""Gauss nodes per piece: exact for a product of up to five linear factors, as of a response per photon (two: response
and wavelength), a spectrum and a reflectance."""


class Curve(NamedTuple):
    """Values over wavelength, linear between nodes and constant beyond the ends."""

    wavelength_um: F64
    """Nodes [um], shape (n,), increasing; read-only."""

    value: F64
    """Values there, shape (n,); read-only."""

    def at(self, wavelength_um: ArrayLike) -> F64:
        """Values at wavelengths [um] of any shape."""
        return np.asarray(np.interp(np.asarray(wavelength_um, dtype=np.float64), self.wavelength_um, self.value))


def read_curves(file: Traversable) -> tuple[Curve, ...]:
    """Curves of a shipped CSV file: a line of names, then wavelengths [um] and the values of each curve."""
    with file.open(encoding="ascii") as text:
        wavelength_um, *columns = np.loadtxt(text, delimiter=",", skiprows=1, unpack=True)
    for array in (wavelength_um, *columns):
        array.setflags(write=False)
    return tuple(Curve(wavelength_um, values) for values in columns)


def band_rule(band: Band, *splits_um: F64, n_node: int = N_EXACT, max_log_width: float = math.inf) -> tuple[F64, F64]:
    """Return the Gauss-Legendre rule over a band: sum(weight_um * f(wavelength_um)) integrates energy response times f.

    Exact where f is a polynomial of degree 2 n_node - 3 in each piece, between neighbours among the nodes of the band
    and the wavelengths given. Pieces wider than max_log_width in ln(wavelength) are cut into equal parts.
    """
    first_um, last_um = band.lit_um
    edge_um = np.unique(np.concatenate([band.wavelength_um, *splits_um]))
    edge_um = edge_um[(edge_um >= first_um) & (edge_um <= last_um)]
    node_um, weight_um = piecewise_rule(edge_um, n_node, max_log_width)
    weight_um = weight_um * band.energy_response(node_um)
    used = weight_um > 0.0
    return node_um[used], weight_um[used]


@functools.cache
def solar_spectrum() -> Curve:
    """Spectral irradiance of the Sun at 1 au [W/m2/um] from 0.2 to 100 um: ASTM E-490-00a.

    It is scaled by 0.9963 to the solar constant of 1361 W/m2 (IAU 2015 resolution B3) from the standard's 1366.1, and
    condensed: integrals over 2 % of a wavelength and more are within 1e-3 of those of the full table.
    """
    (spectrum,) = read_curves(path("solar_spectrum_v1.csv"))
    return spectrum


def sunlight_rule(band: Band, *splits_um: F64) -> tuple[F64, F64]:
    """Quadrature of sunlight over a band: wavelengths [um] and irradiance at 1 au that each stands for [W/m2]."""
    spectrum = solar_spectrum()
    node_um, weight_um = band_rule(band, spectrum.wavelength_um, *splits_um)
    known = (node_um >= spectrum.wavelength_um[0]) & (node_um <= spectrum.wavelength_um[-1])
    return node_um[known], weight_um[known] * spectrum.at(node_um[known])


@of_band
def sun_irradiance_w_m2(band: Band) -> float:
    """In-band irradiance of the Sun at 1 au [W/m2]: the integral of energy response times solar_spectrum().

    Args:
        band: A Band, or the name of a shipped one.

    Raises:
        InputError: An unknown band.
    """
    return float(sunlight_rule(band)[1].sum())


class EarthSpectrum(NamedTuple):
    """The Earth by wavelength, from 0.25 to 100 um; linear between nodes and constant beyond."""

    brightness_temperature_k: Curve
    albedo: Curve
    """Fraction of sunlight that is reflected, as by a Lambertian surface."""

    def radiance_w_m2_sr_um(self, wavelength_um: ArrayLike) -> F64:
        """Spectral radiance of the Earth's emission [W/m2/sr/um] at wavelengths [um] of any shape."""
        return planck_w_m2_sr_um(wavelength_um, self.brightness_temperature_k.at(wavelength_um))


@functools.cache
def earth_spectrum() -> EarthSpectrum:
    """Return the Earth's mean spectrum."""
    return EarthSpectrum(*read_curves(path("earth_spectrum_v1.csv")))


def earth_rule(band: Band, *splits_um: F64) -> tuple[F64, F64]:
    """Quadrature of the Earth's emission over a band: wavelengths [um] and the radiance of each [W/m2/sr]."""
    spectrum = earth_spectrum()
    own_um = spectrum.brightness_temperature_k.wavelength_um
    node_um, weight_um = band_rule(
        band, own_um, *splits_um, n_node=_NODES_PER_PIECE, max_log_width=_MAX_PIECE_LOG_WIDTH
    )
    return node_um, weight_um * spectrum.radiance_w_m2_sr_um(node_um)


def earthshine_rule(band: Band, *splits_um: F64) -> tuple[F64, F64]:
    """Quadrature of sunlight that the Earth reflects: wavelengths [um] and sunlight times albedo [W/m2]."""
    albedo = earth_spectrum().albedo
    node_um, irradiance_w_m2 = sunlight_rule(band, albedo.wavelength_um, *splits_um)
    return node_um, irradiance_w_m2 * albedo.at(node_um)


@of_band
def earth_brightness_temperature_k(band: Band) -> float:
    """Temperature of the blackbody that has the Earth's mean radiance in a band [K].

    By the secant method in ln(radiance) against 1 / T, which is nearly a straight line.

    Args:
        band: A Band, or the name of a shipped one.

    Raises:
        InputError: An unknown band.
    """
    target = math.log(earth_rule(band)[1].sum())
    x = [1 / 240.0, 1 / 290.0]
    y = [math.log(band_radiance_w_m2_sr(1 / inverse, band)) - target for inverse in x]
    while y[1] != 0.0 and abs(x[1] / x[0] - 1) > _TEMPERATURE_RTOL and y[1] != y[0]:
        inverse = x[1] - y[1] * (x[1] - x[0]) / (y[1] - y[0])
        x, y = [x[1], inverse], [y[1], math.log(band_radiance_w_m2_sr(1 / inverse, band)) - target]
    return 1 / x[1]


@of_band
def earth_albedo(band: Band) -> float:
    """Albedo of the Earth in a band: the mean weighted with sunlight and energy response.

    Args:
        band: A Band, or the name of a shipped one.

    Raises:
        InputError: An unknown band.
    """
    sunlight = sunlight_rule(band, earth_spectrum().albedo.wavelength_um)[1].sum()
    if sunlight == 0.0:  # beyond the solar spectrum
        return float(earth_spectrum().albedo.at(band.isophotal_um))
    return float(earthshine_rule(band)[1].sum() / sunlight)
