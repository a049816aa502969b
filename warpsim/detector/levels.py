"""What a pixel's noise and saturation mean as irradiance, band by band, for every kind of detector."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warpsim.constants import PLANCK_J_S, SPEED_OF_LIGHT_M_S
from warpsim.detector.detectors import ElectronDetector, NeiDetector
from warpsim.errors import InputError
from warpsim.radiometry.bands import as_band, band_radiance_w_m2_sr
from warpsim.radiometry.by_band import in_band

if TYPE_CHECKING:
    from warpsim.optics.camera import Camera
    from warpsim.optics.telescope import Optics
    from warpsim.radiometry.band import Band

_W_CM2_PER_W_M2 = 1e-4
_JY_W_M2_HZ = 1e-26


@dataclass(frozen=True)
class Levels:
    """A detector in one band."""

    nei_w_cm2: float
    """Irradiance in a pixel that equals one standard deviation of its noise on blank sky [W/cm2]."""
    sei_w_cm2: float
    """Irradiance at which a pixel saturates [W/cm2]."""
    blank_counts: float
    """Mean counts of blank sky."""
    counts_per_nei: float
    """Counts per NEI, of a small signal."""


@dataclass(frozen=True)
class ElectronLevels(Levels):
    """A detector in electrons in one band."""

    e_per_w_cm2: float
    """Electrons per irradiance of a pixel [e cm2/W]."""
    background_e: float
    """Mean electrons by the background [e]."""
    dark_e: float
    """Mean electrons by the dark current [e]."""
    noise_e: float
    """Standard deviation of a pixel on blank sky, as electrons before the non-linearity [e]."""


def levels(detector: NeiDetector | ElectronDetector, optics: Optics, camera: Camera, band: Band | str) -> Levels:
    """What a detector's noise and saturation are in a band.

    Raises:
        InputError: Unknown band, a table lacks it, or background and dark current alone saturate a pixel.
    """
    if isinstance(detector, ElectronDetector):
        found: Levels = electron_levels(detector, optics, camera, band)
    else:
        band = as_band(band)
        nei, sei = (_given(detector, name, band) for name in ("nei_w_cm2", "sei_w_cm2"))
        found = Levels(nei, sei, detector.offset_counts, detector.counts_per_nei)
    _check_float32(found)
    return found


_SMALLEST, _LARGEST = 1e-35, 1e30
"""Of irradiances that float32 images hold and multiply."""


def _check_float32(found: Levels) -> None:
    """Check that images can hold the levels; InputError otherwise."""
    for name, value in (("NEI", found.nei_w_cm2), ("SEI", found.sei_w_cm2)):
        if not _SMALLEST <= value <= _LARGEST:
            rule = f"its {name} must be from {_SMALLEST:g} to {_LARGEST:g} W/cm2, as images are of float32"
            raise InputError(rule, "detector", value, "g")
    for name, value in (("offset_counts", found.blank_counts), ("counts_per_nei", found.counts_per_nei)):
        if value > _LARGEST:
            raise InputError(f"its {name} must be at most {_LARGEST:g}", "detector", value, "g")


def electron_levels(detector: ElectronDetector, optics: Optics, camera: Camera, band: Band | str) -> ElectronLevels:
    """What a detector in electrons collects and how well it reads it.

    Photons count by the band's photon response, of which `quantum_efficiency` is the peak: in every spectrum the
    electrons are in-band energy times that peak times `Band.photon_um` / (h c).

    Raises:
        InputError: Unknown band, a table lacks it, or background and dark current alone saturate a pixel.
    """
    band = as_band(band)
    area_cm2 = 1e4 * math.pi / 4 * optics.aperture_m**2 * (1 - optics.obscuration**2)
    photon_j = PLANCK_J_S * SPEED_OF_LIGHT_M_S / (band.photon_um * 1e-6)
    transmission = _given(detector, "transmission", band)
    e_per_j = _given(detector, "quantum_efficiency", band) / photon_j
    e_per_w_cm2 = area_cm2 * transmission * e_per_j * detector.exposure_s
    sky, own = _sky_w_cm2_sr(detector, band), 0.0  # radiances, of the optics themselves too
    if detector.optics_temperature_k is not None:
        radiance_w_m2_sr = float(band_radiance_w_m2_sr(detector.optics_temperature_k, band))
        own = detector.optics_emissivity * radiance_w_m2_sr * _W_CM2_PER_W_M2
    # Lengths are in pixels: one of them is the solid angle 1 / (focal length in columns * focal length in rows).
    pixel_sr = 1 / (camera.focal_px * camera.focal_row_px)
    background_e = (sky + own / transmission) * pixel_sr * e_per_w_cm2
    dark_e = detector.dark_e_s * detector.exposure_s

    blank_e = background_e + dark_e
    converter_end_e = (float(2**detector.bits) - 1 - detector.offset_counts) * detector.gain_e_per_count
    full_e = min(detector.full_well_e, _charge_e(detector, converter_end_e))
    if blank_e >= full_e:
        raise InputError(
            f"background and dark current must not saturate a pixel in band {band.name}, got {blank_e:.3g} electrons "
            f"where {full_e:.3g} do",
            "detector",
        )
    slope = 1 - 2 * detector.nonlinearity * blank_e / detector.full_well_e
    shot2_e2 = blank_e if detector.shot_noise else 0.0
    after2_e2 = detector.read_noise_e**2 + detector.column_noise_e**2 + detector.gain_e_per_count**2 / 12
    noise_e = math.sqrt(shot2_e2 + after2_e2 / slope**2)
    read_e = blank_e * (1 - detector.nonlinearity * blank_e / detector.full_well_e)
    return ElectronLevels(
        nei_w_cm2=noise_e / e_per_w_cm2,
        sei_w_cm2=(full_e - blank_e) / e_per_w_cm2,
        blank_counts=detector.offset_counts + read_e / detector.gain_e_per_count,
        counts_per_nei=noise_e * slope / detector.gain_e_per_count,
        e_per_w_cm2=e_per_w_cm2,
        background_e=background_e,
        dark_e=dark_e,
        noise_e=noise_e,
    )


def noise_variance(detector: NeiDetector | ElectronDetector, levels: Levels) -> tuple[float, float]:
    """Return the variance of a pixel's noise on blank sky, and what it grows by over the light in the pixel.

    Returns:
        Variance, rounding to counts included [W2/cm4]; the irradiance of one electron, 0 without shot noise [W/cm2].
    """
    if isinstance(detector, ElectronDetector) and isinstance(levels, ElectronLevels):
        return levels.nei_w_cm2**2, 1.0 / levels.e_per_w_cm2 if detector.shot_noise else 0.0
    # Of electrons the converter's steps are part of the NEI.
    return levels.nei_w_cm2**2 * (1.0 + 1.0 / (12.0 * levels.counts_per_nei**2)), 0.0


def _given(detector: NeiDetector | ElectronDetector, name: str, band: Band) -> float:
    given: float | Mapping[str, float] = getattr(detector, name)
    value = in_band(given, band.name)
    if value is None:
        raise InputError(f"must name every band of the scene, got none for {band.name}", f"detector.{name}")
    return float(value)


def _sky_w_cm2_sr(detector: ElectronDetector, band: Band) -> float:
    """Radiance of the sky in a band [W/cm2/sr]."""
    node_um, weight_um = band.quadrature_um
    width_hz = float(np.sum(weight_um * SPEED_OF_LIGHT_M_S / node_um**2)) * 1e6  # of the response over frequency
    zodiacal_w_m2_sr = _given(detector, "zodiacal_mjy_sr", band) * 1e6 * _JY_W_M2_HZ * width_hz
    return _given(detector, "background_w_cm2_sr", band) + zodiacal_w_m2_sr * _W_CM2_PER_W_M2


def _charge_e(detector: ElectronDetector, read_e: float) -> float:
    """Charge that is read as read_e electrons: the non-linearity undone; infinite where none is [e]."""
    if detector.nonlinearity == 0.0:
        return read_e
    square = 1 - 4 * detector.nonlinearity * read_e / detector.full_well_e
    if square < 0:
        return math.inf
    return detector.full_well_e / (2 * detector.nonlinearity) * (1 - math.sqrt(square))
