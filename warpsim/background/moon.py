"""The Moon as a source of stray light: where it is, and how bright."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arrays import F64
from warpsim.constants import ASTRONOMICAL_UNIT_M
from warpsim.instant import tdb_jd
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import band_radiance_w_m2_sr

if TYPE_CHECKING:
    from warpsim.instant import Epoch


MOON_RADIUS_M = 1_737_400.0

GEOMETRIC_ALBEDO, BOND_ALBEDO = 0.12, 0.11
"""Light at full Moon over that of a white disc (Allen), and the part of sunlight that is not absorbed."""

EMISSIVITY, NIGHT_K = 0.95, 95.0

SUBSOLAR_K = (1361.0 * (1 - BOND_ALBEDO) / (EMISSIVITY * 5.670374419e-8)) ** 0.25
"""In equilibrium with sunlight at 1 au: 390 K, as measured."""

_PHASE_MAG_PER_DEG = (0.026, 4.0e-9)
"""Fading with the phase angle: 0.026 a + 4e-9 a**4 magnitudes (Allen)."""

_N_ZONE = 24


def moon_position_m(epoch: Epoch, time_s: ArrayLike) -> F64:
    """Return geocentric positions of the Moon, GCRS axes [m], (n, 3): ERFA's moon98, good to 0.003 degrees."""
    import erfa

    return np.asarray(erfa.moon98(*tdb_jd(epoch, time_s))["p"]) * ASTRONOMICAL_UNIT_M


def moon_brightness_w_cm2(bands: list[Band], sun_w_cm2: F64, sun_au: float, phase_rad: F64) -> F64:
    """Return the in-band irradiance of the Moon times its squared distance in its radii: (n_band, n) [W/cm2].

    Ground glows at the fourth root of the cosine of the Sun's zenith angle, and at 95 K by night. Good to some 10 %.

    Args:
        bands: The bands.
        sun_w_cm2: In-band irradiance of the Sun at 1 au, (n_band,).
        sun_au: Distance of the Sun from the Moon [au].
        phase_rad: Angles at the Moon between the Sun and who sees it, (n,).
    """
    degrees = np.degrees(phase_rad)
    fading = 10 ** (-0.4 * (_PHASE_MAG_PER_DEG[0] * degrees + _PHASE_MAG_PER_DEG[1] * degrees**4))
    reflected = GEOMETRIC_ALBEDO * fading * sun_w_cm2[:, None] / sun_au**2
    return np.asarray(reflected + [_emitted_w_cm2_sr(band, phase_rad, SUBSOLAR_K / sun_au**0.5) for band in bands])


def _emitted_w_cm2_sr(band: Band, phase_rad: F64, subsolar_k: float) -> F64:
    """Radiant intensity of a Moon of radius 1 by phase angle, (n,): its zones as the observer along z sees them."""
    node, weight = np.polynomial.legendre.leggauss(_N_ZONE)
    cosine, turn = 0.5 * (node + 1), np.pi * (node + 1)
    mu, azimuth = np.meshgrid(cosine, turn, indexing="ij")
    area = np.outer(0.5 * weight, np.pi * weight) * mu
    x = np.sqrt(1 - mu**2) * np.cos(azimuth)
    sunward = np.maximum(mu * np.cos(phase_rad)[:, None, None] + x * np.sin(phase_rad)[:, None, None], 0.0)
    kelvin = np.linspace(NIGHT_K, subsolar_k, 200)
    known = np.array([float(band_radiance_w_m2_sr(k, band)) for k in kelvin])
    radiance = np.interp(np.maximum(subsolar_k * sunward**0.25, NIGHT_K), kelvin, known)
    return np.asarray(EMISSIVITY * 1e-4 * (radiance * area).sum(axis=(1, 2)))
