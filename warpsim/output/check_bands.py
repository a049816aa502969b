"""Reports about the spectral bands of a kind of sensor: response, zero point, photons, stars above the noise."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warpsim.constants import PLANCK_J_S, SPEED_OF_LIGHT_M_S
from warpsim.detector.detectors import ElectronDetector
from warpsim.radiometry.band import Band
from warpsim.radiometry.by_band import in_band
from warpsim.scene.band_descriptions import BandDescription
from warpsim.scene.description import SceneDescription
from warpsim.scene.instrument import Instrument
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.star_counts import complete_to

LEVELS_NEI = (1, 10, 100, 1000)
"""Irradiances above which stars are counted [NEI]."""

SPHERE_DEG2 = 360.0**2 / math.pi
"""Area of the sky [deg2]."""


def band_lines(instrument: Instrument, catalog: StarCatalog, scene: SceneDescription) -> list[str]:
    """Return some lines for each band: what it is, and how many stars are brighter than its noise.

    Args:
        instrument: The kind of sensor.
        catalog: Stars of its sky.
        scene: What both are in.
    """
    lines = []
    for name, band in instrument.bands.items():
        low_um, high_um = band.half_power_um
        response = "photon" if band.per_photon else "energy"
        lines.append(
            f"  band       {name}: {low_um:.4g} to {high_um:.4g} um at half power, response by {response}, mean photon "
            f"{mean_photon_j(band):.3g} J, {_electron_j(band):.3g} J an electron; {_zero_point(band)}"
        )
        lines += _peak_lines(instrument, band, scene.band.get(name))
        if len(catalog):
            in_nei = catalog.irradiance_w_cm2(band, scene.sky.physics) / instrument.nei_w_cm2(name)
            counts = ", ".join(f"{np.count_nonzero(in_nei >= level):,} above {level} NEI" for level in LEVELS_NEI)
            per_deg2 = np.count_nonzero(in_nei >= 1.0) / SPHERE_DEG2
            lines.append(f"             stars {counts}; {per_deg2:.3g} per deg2 above the noise{_complete(in_nei)}")
    return lines


def _peak_lines(instrument: Instrument, band: Band, description: BandDescription | None) -> list[str]:
    """Peak of a response that is scaled to 1, with a note where a detector in electrons is not given it."""
    if description is None or (description.peak == 1.0 and description.files is None):
        return []
    peak, detector = description.peak, instrument.sensor.detector
    what = "its response" if description.files is None else "the product of its files"
    lines = [f"             {what} peaks at {peak:.3g}, and is scaled to 1"]
    efficiency = in_band(detector.quantum_efficiency, band.name) if isinstance(detector, ElectronDetector) else None
    if band.per_photon and peak < 1.0 == efficiency:
        text = f"detector.quantum_efficiency is 1 in band {band.name}, whose response peaks at {peak:.3g}"
        lines.append(f"  note       {text}: give it the peak")
    return lines


def _complete(in_nei: NDArray[np.float64]) -> str:
    """Return the words that say how faint a catalog goes, and what goes further where that is above the noise."""
    faintest = complete_to(in_nei)
    if math.isnan(faintest):
        return ""
    more = ": more in sky.catalog union, synthetic, or a file" if faintest > 1.0 else ""
    return f"; complete to {faintest:.2g} NEI{more}"


def mean_photon_j(band: Band) -> float:
    """Return the mean energy of the photons that a band detects of a spectrum flat in wavelength [J]."""
    node_um, weight_um = band.quadrature_um
    mean_um = float(np.sum(weight_um * node_um) / np.sum(weight_um))
    return PLANCK_J_S * SPEED_OF_LIGHT_M_S / (mean_um * 1e-6)


def _electron_j(band: Band) -> float:
    """Return the in-band energy for each electron at peak quantum efficiency, the same in every spectrum [J]."""
    return PLANCK_J_S * SPEED_OF_LIGHT_M_S / (band.photon_um * 1e-6)


def _zero_point(band: Band) -> str:
    if math.isnan(band.zero_mag_w_cm2):
        return f"AB magnitude 0 is {band.ab_zero_mag_w_cm2:.4g} W/cm2"
    return f"magnitude 0 is {band.zero_mag_w_cm2:.4g} W/cm2, {band.zero_mag_jy:.4g} Jy"
