"""Heat balance of a body in orbit: power absorbed from the Sun and the Earth, power emitted, and their equilibrium.

    absorbed = a_sun E_sun (sunlit A_sun + albedo max(0, cos zenith) S w) + e_ir M_earth S w,   w = (1 - cos rho) / 2
    emitted  = e_ir sigma T^4 S

E_sun: 1361 W/m2 at 1 au. sunlit: fraction of the Sun's disc seen past the Earth. A_sun: projected area towards the Sun.
S: whole surface. rho: angular radius of the Earth; w is the mean view factor of a body that turns in all directions,
exact for a sphere (max(0, n . l) over all n is 1/4, times the solid angle over pi). The Earth
radiates the same everywhere. Its sunlit face is taken to shine as the point below the target does, with the Sun's
zenith angle there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from warpsim.arrays import F64
from warpsim.constants import (
    ASTRONOMICAL_UNIT_M,
    EARTH_EQUATORIAL_RADIUS_M,
    EARTH_FLATTENING,
    SOLAR_CONSTANT_W_M2,
    STEFAN_BOLTZMANN_W_M2_K4,
)
from warpsim.errors import InputError
from warpsim.orbit.sun import sunlit_fraction
from warpsim.radiometry.band import Band
from warpsim.target.surface import Graybody
from warpsim.target.temperature import HeatBalance

_ALL = Band.top_hat("all", 0.2, 100.0)
_ROOM_K = 300.0


@dataclass(frozen=True)
class LumpedNode:
    """A lumped-capacitance node: a body of one temperature."""

    capacity_j_k: float
    surface_m2: float
    solar_absorptance: float
    infrared_emissivity: float
    earth_w_m2: float
    albedo: float

    @property
    def emitted_w_k4(self) -> float:
        """Power radiated at 1 K; it grows with the fourth power of temperature."""
        return self.infrared_emissivity * STEFAN_BOLTZMANN_W_M2_K4 * self.surface_m2

    def absorbed_w(self, position_m: F64, sun_m: F64, pole_icrs: F64, area_m2: F64) -> F64:
        """Absorbed power [W]: positions geocentric [m], (..., 3), projected area towards the Sun [m2], (...)."""
        to_sun = sun_m - position_m
        distance_m = np.linalg.norm(to_sun, axis=-1)
        radius_m = np.maximum(np.linalg.norm(position_m, axis=-1), 1.0)
        cosine = np.einsum("...i,...i->...", to_sun, position_m) / (distance_m * radius_m)
        sun_w_m2 = SOLAR_CONSTANT_W_M2 * (ASTRONOMICAL_UNIT_M / distance_m) ** 2
        earth_m2 = self.surface_m2 * mean_view_factor(position_m, pole_icrs)
        sunlit = sunlit_fraction(position_m, sun_m, pole_icrs)
        by_sun = sun_w_m2 * (sunlit * area_m2 + self.albedo * np.maximum(cosine, 0.0) * earth_m2)
        by_earth = self.infrared_emissivity * self.earth_w_m2 * earth_m2
        return np.asarray(self.solar_absorptance * by_sun + by_earth)

    def equilibrium_k(self, absorbed_w: F64) -> F64:
        """Equilibrium temperatures [K]; an InputError where nothing is emitted or absorbed."""
        if self.emitted_w_k4 == 0:
            raise InputError("must be a temperature where infrared_emissivity is 0, got 'equilibrium'", "start_k")
        if not np.all(absorbed_w > 0):
            raise InputError("must be a temperature where nothing is absorbed, got 'equilibrium'", "start_k")
        return np.asarray((absorbed_w / self.emitted_w_k4) ** 0.25)


def mean_view_factor(position_m: F64, pole_icrs: F64) -> F64:
    """Mean over all directions of a surface element's view factor to the Earth, (...) from (..., 3)."""
    square = np.sum(position_m**2, axis=-1)
    sine_square = np.minimum((position_m @ pole_icrs) ** 2 / np.maximum(square, 1e-300), 1.0)
    polar = 1.0 / (1.0 - EARTH_FLATTENING) ** 2
    ground_square = EARTH_EQUATORIAL_RADIUS_M**2 / (1.0 + (polar - 1.0) * sine_square)
    ratio = np.minimum(ground_square / np.maximum(square, 1e-300), 1.0)
    # (1 - sqrt(1 - x)) / 2 without cancellation far away
    return np.asarray(0.5 * ratio / (1.0 + np.sqrt(1.0 - ratio)))


def surface_coefficients(surface: Graybody, bands: Sequence[str]) -> tuple[float, float]:
    """Return the solar absorptance and infrared emissivity of a surface, for a heat balance that leaves them out.

    By wavelength: means over all sunlight, and over the emission of a blackbody of 300 K. Otherwise both are the mean
    emissivity over the bands.
    """
    if surface.is_spectral:
        return 1.0 - surface.reflectance_in(_ALL, "sun"), surface.emissivity_in(_ALL, _ROOM_K)
    mean = float(np.mean([surface.emissivity_in(band) for band in bands]))
    return mean, mean


def lumped_node(model: HeatBalance, surface_m2: float, coefficients: tuple[float, float]) -> LumpedNode:
    """Return the node of a described body; its surface_coefficients() stand for those that are left out."""
    absorptance, emissivity = coefficients
    return LumpedNode(
        model.mass_kg * model.heat_capacity_j_kg_k,
        surface_m2,
        absorptance if model.solar_absorptance is None else model.solar_absorptance,
        emissivity if model.infrared_emissivity is None else model.infrared_emissivity,
        model.earth_w_m2,
        model.albedo,
    )
