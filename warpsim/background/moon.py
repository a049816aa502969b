"""The Moon as a source of stray light: where it is, and how bright."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.constants import ASTRONOMICAL_UNIT_M
from warpsim.instant import tdb_jd
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import band_radiance_w_m2_sr

if TYPE_CHECKING:
    from warpsim.instant import Epoch

Array = NDArray[np.float64]

MOON_RADIUS_M = 1_737_400.0

GEOMETRIC_ALBEDO, BOND_ALBEDO = 0.12, 0.11
"""Light at full Moon over that of a white disc (Allen), and the part of sunlight that is not absorbed."""

EMISSIVITY, NIGHT_K = 0.95, 95.0

SUBSOLAR_K = (1361.0 * (1 - BOND_ALBEDO) / (EMISSIVITY * 5.670374419e-8)) ** 0.25
"""In equilibrium with sunlight at 1 au: 390 K, as measured."""

_PHASE_MAG_PER_DEG = (0.026, 4.0e-9)
"""Fading with the phase angle: 0.026 a + 4e-9 a**4 magnitudes (Allen)."""

_N_ZONE = 24


def moon_position_m(epoch: Epoch, time_s: ArrayLike) -> Array:
    """Return geocentric positions of the Moon, GCRS axes [m], (n, 3): ERFA's moon98, good to 0.003 degrees."""
    import erfa

    return np.asarray(erfa.moon98(*tdb_jd(epoch, time_s))["p"]) * ASTRONOMICAL_UNIT_M


def moon_irradiance_w_cm2(bands: list[Band], sun_w_cm2: Array, moon_m: Array, sun_m: Array) -> Array:
    """Return the in-band irradiance of the Moon at the Earth, reflected and emitted: (n_band, n) [W/cm2].

    Ground glows at the fourth root of the cosine of the Sun's zenith angle, and at 95 K by night. Good to some 10 %.

    Args:
        bands: The bands.
        sun_w_cm2: In-band irradiance of the Sun at 1 au, (n_band,).
        moon_m: Geocentric positions of the Moon, (n, 3).
        sun_m: Geocentric positions of the Sun, (n, 3).
    """
    distance_m = np.linalg.norm(moon_m, axis=1)
    from_moon = sun_m - moon_m
    cosine = -np.einsum("ni,ni->n", from_moon, moon_m) / (np.linalg.norm(from_moon, axis=1) * distance_m)
    phase_rad = np.arccos(np.clip(cosine, -1.0, 1.0))
    degrees = np.degrees(phase_rad)
    fading = 10 ** (-0.4 * (_PHASE_MAG_PER_DEG[0] * degrees + _PHASE_MAG_PER_DEG[1] * degrees**4))
    disc = (MOON_RADIUS_M / distance_m) ** 2
    strength = (ASTRONOMICAL_UNIT_M / np.linalg.norm(from_moon, axis=1)) ** 2
    reflected = GEOMETRIC_ALBEDO * fading * disc * strength * sun_w_cm2[:, None]
    angles, subsolar_k = np.linspace(0.0, math.pi, 19), SUBSOLAR_K * float(strength.mean()) ** 0.25
    emitted = np.array([np.interp(phase_rad, angles, _emitted_w_cm2_sr(band, angles, subsolar_k)) for band in bands])
    return np.asarray(reflected + emitted * disc)


def _emitted_w_cm2_sr(band: Band, phase_rad: Array, subsolar_k: float) -> Array:
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
