"""Zodiacal light: the interplanetary dust of Kelsall et al. (1998, ApJ 508, 44), as seen from near the Earth.

Dust is a smooth cloud, three bands of asteroidal debris, a ring about the Earth's orbit and a feature that trails the
Earth. It glows as a graybody of 286 K / r**0.467 and, below 4.9 um, scatters sunlight. Emissivities, albedos and
phase functions are known at the ten wavelengths of DIRBE and linear in the logarithm of the wavelength between them,
which no measurement supports: between 4.9, 12 and 25 um silicate features of 10 % are left out. The model fits DIRBE's
sky to about 2 %, between solar elongations of 64 and 124 degrees; nearer to the Sun it is an extrapolation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arrays import F64
from warpsim.directions import unit_vectors
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import planck_w_m2_sr_um
from warpsim.radiometry.sun_and_earth import band_rule, solar_spectrum, sunlight_rule

OUTER_RADIUS_AU = 5.2
"""Where the dust ends, as seen from the Sun."""

_WAVELENGTHS_UM = np.array([1.25, 2.2, 3.5, 4.9, 12.0, 25.0, 60.0, 100.0, 140.0, 240.0])
_CLOUD = np.array([1.0, 1.0, 1.65989, 0.997409, 0.957669, 1.0, 0.733388, 0.647899, 0.676942, 0.519121])
_BANDS = np.array([1.0, 1.0, 1.65989, 0.359265, 1.01279, 1.0, 1.25392, 1.51670, 1.13172, 1.39961])
_RING = np.array([1.0, 1.0, 1.65989, 1.06751, 1.06088, 1.0, 0.872664, 1.09853, 1.15158, 0.857638])
"""Emissivities at the wavelengths."""
_ALBEDO = np.array([0.204119, 0.255211, 0.210437, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
_PHASES = np.array([[-0.9421, 0.1214, -0.1648], [-0.5267, 0.1872, -0.5983], [-0.4312, 0.1715, -0.6333]])
"""Coefficients of the phase functions at the first three wavelengths, at angles in radians."""
_SUN_W_M2_UM = np.array([449.08, 76.248, 15.734])
"""Sunlight at 1 au with which the albedos were found [W/m2/um]: what was measured is the product of both."""

_TEMPERATURE_K, _TEMPERATURE_POWER = 286.0, 0.466863
_RADII_AU = np.geomspace(0.005, 6.0, 600)

_PIECES_AU = np.array([0.0, 0.04, 0.12, 0.3, 0.6, 1.0, 1.5, 2.2, 3.2, 4.4, 6.3])
_NODES_PER_PIECE = 12


class Plane(NamedTuple):
    """Where a component lies: symmetry plane and centre."""

    inclination_deg: float
    node_deg: float
    centre_au: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def within(self, position_au: F64) -> tuple[F64, F64, F64]:
        """Position from the centre, its length, and the height above the plane."""
        tilt, node = math.radians(self.inclination_deg), math.radians(self.node_deg)
        pole = np.array([math.sin(node) * math.sin(tilt), -math.cos(node) * math.sin(tilt), math.cos(tilt)])
        own = position_au - np.array(self.centre_au)
        return own, np.linalg.norm(own, axis=-1), own @ pole


_CLOUD_PLANE = Plane(2.03352, 77.6580, (0.0118878, 0.00547651, -0.00215309))
_BAND_PLANES = (Plane(0.564383, 80.0), Plane(1.2, 30.3475), Plane(0.8, 80.0))
_BAND_SHAPES = ((5.58903e-10, 8.78505, 0.1, 1.5), (1.98776e-9, 1.99170, 0.9, 0.941219), (1.43698e-10, 15.0, 0.05, 1.5))
"""Density at 1 au [1/au], half-width [deg], weight of its edge, inner radius [au] of each band."""
_RING_PLANE = Plane(0.487072, 22.2790)


def cloud_density(position_au: F64) -> F64:
    """Smooth cloud [1/au] (Kelsall et al. 1998, Eqs. 6 and 7)."""
    _, radius_au, height_au = _CLOUD_PLANE.within(position_au)
    slope, mu = np.abs(height_au / radius_au), 0.188732
    fan = np.where(slope < mu, slope**2 / (2 * mu), slope - mu / 2)
    return np.asarray(1.13444e-7 * radius_au**-1.33707 * np.exp(-4.14150 * fan**0.942062))


def bands_density(position_au: F64) -> F64:
    """The three dust bands together [1/au] (Eq. 8, as the authors' program has it: the edge's weight is divided)."""
    total = np.zeros(position_au.shape[:-1])
    for plane, (density, width_deg, edge, inner_au) in zip(_BAND_PLANES, _BAND_SHAPES, strict=True):
        _, radius_au, height_au = plane.within(position_au)
        slope = np.abs(height_au / radius_au) / math.radians(width_deg)
        with np.errstate(under="ignore", over="ignore"):
            shape = np.exp(-(slope**6)) * (1 + slope**4 / edge) * -np.expm1(-((radius_au / inner_au) ** 20))
        total += 3 * density / radius_au * shape
    return total


def ring_density(position_au: F64, earth_au: F64) -> F64:
    """Circumsolar ring with the feature that trails the Earth [1/au] (Eq. 9, with the program's exponents)."""
    own, radius_au, height_au = _RING_PLANE.within(position_au)
    behind = np.arctan2(own[..., 1], own[..., 0]) - math.atan2(earth_au[1], earth_au[0]) - math.radians(-10.0)
    behind = (behind + math.pi) % (2 * math.pi) - math.pi
    with np.errstate(under="ignore"):
        ring = 1.82605e-8 * np.exp(-(((radius_au - 1.02819) / 0.025) ** 2) - np.abs(height_au) / 0.0540680)
        feature = 2.00943e-8 * np.exp(
            -(((radius_au - 1.05792) / 0.102873) ** 2)
            - np.abs(height_au) / 0.0914430
            - (behind / math.radians(12.1152)) ** 2
        )
    return np.asarray(ring + feature)


class BandLight(NamedTuple):
    """What dust of unit density sends per length of a line of sight in a band [W/m2/sr]."""

    emission: F64
    """Of cloud, bands and ring at `_RADII_AU` from the Sun, shape (3, n)."""
    sunlight: F64
    """Scattered at 1 au, by each phase function, shape (3,)."""


def _hats(wavelength_um: F64) -> F64:
    """Weights of DIRBE's wavelengths at wavelengths, linear in the logarithm and constant outside: (10, n)."""
    nodes = np.log(_WAVELENGTHS_UM)
    return np.array([np.interp(np.log(wavelength_um), nodes, hat) for hat in np.eye(len(nodes))])


def band_light(band: Band) -> BandLight:
    """Integrate the dust's emission and scattering over a band's energy response."""
    node_um, weight_um = band_rule(band, _WAVELENGTHS_UM, n_node=4, max_log_width=0.02)
    glow = planck_w_m2_sr_um(node_um[:, None], _TEMPERATURE_K * _RADII_AU**-_TEMPERATURE_POWER) * weight_um[:, None]
    hats = _hats(node_um)
    absorbing = 1.0 - _ALBEDO @ hats
    emission = [(absorbing * (emissivity @ hats)) @ glow for emissivity in (_CLOUD, _BANDS, _RING)]
    sun_um, sun_w_m2 = sunlight_rule(band, _WAVELENGTHS_UM)
    n = len(_PHASES)
    about_um = _WAVELENGTHS_UM[:n, None] * np.linspace(0.99, 1.01, 201)
    as_fitted = _ALBEDO[:n] * _SUN_W_M2_UM / solar_spectrum().at(about_um).mean(axis=1)
    return BandLight(np.array(emission), as_fitted * (_hats(sun_um)[:n] @ sun_w_m2))


def phase_functions(angle_rad: F64) -> F64:
    """Light scattered by an angle, per sr, by each phase function; integrals over the sphere are 1: (3, ...)."""
    c0, c1, c2 = _PHASES.T.reshape(3, 3, *[1] * angle_rad.ndim)
    norm = 2 * math.pi * (2 * c0 + math.pi * c1 + (np.exp(c2 * math.pi) + 1) / (c2**2 + 1))
    return np.asarray((c0 + c1 * angle_rad + np.exp(c2 * angle_rad)) / norm)


def zodiacal_radiance_w_cm2_sr(direction: ArrayLike, earth_au: ArrayLike, lights: list[BandLight]) -> F64:
    """Radiance of the zodiacal light in bands [W/cm2/sr].

    Args:
        direction: Unit vectors of lines of sight in the ecliptic frame of J2000, shape (n, 3).
        earth_au: Heliocentric position of the Earth, where the observer is, in that frame [au], shape (3,).
        lights: Bands, made by `band_light`.

    Returns:
        Shape (n_band, n).
    """
    lines, earth = np.asarray(direction, dtype=np.float64), np.asarray(earth_au, dtype=np.float64)
    node, weight = np.polynomial.legendre.leggauss(_NODES_PER_PIECE)
    half_au = np.diff(_PIECES_AU)[:, None] / 2
    part = ((_PIECES_AU[:-1, None] + half_au + half_au * node) / _PIECES_AU[-1]).ravel()
    weights = (half_au * weight / _PIECES_AU[-1]).ravel()
    along = lines @ earth
    last_au = np.sqrt(along**2 + OUTER_RADIUS_AU**2 - earth @ earth) - along
    distance_au = last_au[:, None] * part
    position_au = earth + distance_au[..., None] * lines[:, None]
    radius_au = np.linalg.norm(position_au, axis=-1)
    densities = [cloud_density(position_au), bands_density(position_au), ring_density(position_au, earth)]
    # The angle by which sunlight is turned: between the way out from the Sun and that to the observer.
    cosine = -np.einsum("nk,nsk->ns", lines, position_au) / radius_au
    phases = phase_functions(np.arccos(np.clip(cosine, -1.0, 1.0)))
    scatterers = sum(densities) / radius_au**2
    result = np.empty((len(lights), len(lines)))
    for row, light in zip(result, lights, strict=True):
        source = np.einsum("k,kns->ns", light.sunlight, phases) * scatterers
        for density, glow in zip(densities, light.emission, strict=True):
            source = source + density * np.interp(radius_au, _RADII_AU, glow)
        row[:] = source @ weights * last_au * 1e-4
    return result


_OBLIQUITY_RAD = math.radians(84381.406 / 3600)
"""Of the ecliptic of J2000 (IAU 2006)."""

ECLIPTIC_AXES = np.array(
    [
        [1.0, 0.0, 0.0],
        [0.0, math.cos(_OBLIQUITY_RAD), math.sin(_OBLIQUITY_RAD)],
        [0.0, -math.sin(_OBLIQUITY_RAD), math.cos(_OBLIQUITY_RAD)],
    ]
)
"""Axes of the ecliptic of J2000 as rows of ICRS vectors; the last is its pole."""

_LATITUDES_DEG = np.concatenate(
    [np.arange(-90, -30, 6), np.arange(-30, -12, 2), np.arange(-12, 12), np.arange(12, 30, 2), np.arange(30, 91, 6)]
)
_LONGITUDES_DEG = np.concatenate([np.arange(0, 30, 1.5), np.arange(30, 330, 5), np.arange(330, 361, 1.5)])
"""Of the model's nodes, longitudes from the Sun's: close where the light changes fast."""


def zodiacal_map(bands: list[Band], earth_au: F64) -> Callable[[F64], F64]:
    """Return the zodiacal light of the sky in bands as a function of ICRS directions: cubic splines between nodes.

    Args:
        bands: The bands.
        earth_au: Heliocentric position of the Earth, ICRS axes [au], shape (3,).

    Returns:
        Function from unit vectors (n, 3) to radiances (n_band, n) [W/cm2/sr].
    """
    from scipy.interpolate import RectBivariateSpline

    earth = ECLIPTIC_AXES @ earth_au
    sun_deg = math.degrees(math.atan2(-earth[1], -earth[0]))
    nodes = unit_vectors(*np.meshgrid(_LONGITUDES_DEG + sun_deg, _LATITUDES_DEG))
    light = zodiacal_radiance_w_cm2_sr(nodes.reshape(-1, 3), earth, [band_light(band) for band in bands])
    splines = [
        RectBivariateSpline(_LATITUDES_DEG, _LONGITUDES_DEG, np.log(each.reshape(nodes.shape[:2]))) for each in light
    ]

    def radiance_of(direction: F64) -> F64:
        own = direction @ ECLIPTIC_AXES.T
        longitude_deg = (np.degrees(np.arctan2(own[:, 1], own[:, 0])) - sun_deg) % 360
        latitude_deg = np.degrees(np.arcsin(np.clip(own[:, 2], -1.0, 1.0)))
        return np.array([np.exp(spline.ev(latitude_deg, longitude_deg)) for spline in splines])

    return radiance_of
