"""The Earth's limb: in-band radiance of lines of sight that pass above the ground, by tangent height.

The table (made by `catalogs/build_earth_limb.py`) is that of LOWTRAN7's band models in the US Standard Atmosphere 1976,
in local thermodynamic equilibrium, and of single Rayleigh scattering. What it leaves out is in docs/physics.md.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from warpsim_catalogs import path

from warpsim.arrays import F64
from warpsim.radiometry.band import Band
from warpsim.radiometry.sun_and_earth import band_rule, sunlight_rule


class LimbProfile(NamedTuple):
    """The limb in a band, by tangent height."""

    height_km: F64
    """From the ground up in equal steps, shape (n,)."""
    emission_w_cm2_sr: F64
    """Emitted radiance, (n,)."""
    reflected_w_cm2_sr: F64
    """Radiance of scattered sunlight with the Sun at the zenith of the tangent point, 1 au away, (n,)."""


class LimbTable(NamedTuple):
    """Radiance by tangent height and wavelength; 0 outside the wavelengths."""

    height_km: F64
    emission_um: F64
    emission_w_m2_sr_um: F64
    """(n_height, n_emission)."""
    sunlight_um: F64
    reflectance: F64
    """Radiance times pi over sunlight, (n_height, n_sunlight)."""


@functools.cache
def limb_table() -> LimbTable:
    """Return the table that ships with warpsim."""
    with path("earth_limb_v1.npz").open("rb") as stored, np.load(stored) as file:
        logarithms = {name: file[f"milli_log_{name}"] / 1000.0 for name in ("emission", "reflectance")}
        return LimbTable(
            file["height_km"],
            file["emission_um"],
            10.0 ** logarithms["emission"],
            file["sunlight_um"],
            10.0 ** logarithms["reflectance"],
        )


def limb_profile(band: Band) -> LimbProfile:
    """Integrate the limb's light over a band's energy response; 0 at the top of the table and above it."""
    table = limb_table()
    node_um, weight_um = band_rule(band, table.emission_um, n_node=3)
    emission = _at(node_um, table.emission_um, table.emission_w_m2_sr_um) @ weight_um
    sun_um, sun_w_m2 = sunlight_rule(band, table.sunlight_um)
    reflected = _at(sun_um, table.sunlight_um, table.reflectance) @ sun_w_m2 / math.pi
    emission[-1] = reflected[-1] = 0.0
    return LimbProfile(table.height_km, emission * 1e-4, reflected * 1e-4)


def _at(wavelength_um: F64, nodes_um: F64, values: F64) -> F64:
    """Values by height at wavelengths: linear between nodes, 0 outside; (n_height, n)."""
    return np.array([np.interp(wavelength_um, nodes_um, row, left=0.0, right=0.0) for row in values])
