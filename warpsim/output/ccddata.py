"""Images as astropy's CCDData: irradiance with its error, mask, WCS and keywords, as photutils and others take it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpsim.detector.detectors import ElectronDetector
from warpsim.detector.levels import ElectronLevels
from warpsim.output.fits_header import Views, image_cards
from warpsim.render.frameset import FrameSet

if TYPE_CHECKING:
    from astropy.nddata import CCDData

_FULL_SIGMA = 5.0
"""Noise by which a full pixel may read less than what it holds."""


def ccddata(frames: FrameSet, frame: int, sensor: str, band: str) -> CCDData:
    """Return one image as irradiance with all that belongs to it.

    Args:
        frames: Rendered frames.
        frame: One of `frames.frames`.
        sensor: One of `frames.sensors`.
        band: One of `frames.bands`.

    Returns:
        CCDData of (row, column): irradiance by the counts above blank sky [W/cm2], where the response is linear; its
        standard deviation, the NEI and, of a detector with shot noise, that of the light in the pixel; mask, True where
        the converter or the pixel is full; WCS of the apparent sky; the keywords of FITS images in `meta`.

    Raises:
        InputError: The image was not rendered.
    """
    import astropy.units as u
    from astropy.nddata import CCDData, StdDevUncertainty

    _, number = frames.image_numbers("ccddata", frame, sensor, band)
    instrument = frames.instrument
    detector, levels = instrument.sensor.detector, instrument.levels[band]
    counts = frames.counts[frames.frames.index(frame)][frames.sensors.index(sensor), number].astype(np.float64)
    light = (counts - levels.blank_counts) / levels.counts_per_nei * levels.nei_w_cm2
    variance = np.full(light.shape, levels.nei_w_cm2**2)
    if isinstance(detector, ElectronDetector) and isinstance(levels, ElectronLevels):
        if detector.shot_noise:
            variance += np.maximum(light, 0.0) / levels.e_per_w_cm2
    else:  # of electrons the converter's steps are part of the NEI
        variance += (levels.nei_w_cm2 / levels.counts_per_nei) ** 2 / 12.0
    # Read noise lies on top of a full well.
    full_nei = levels.sei_w_cm2 / levels.nei_w_cm2 - (_FULL_SIGMA if isinstance(levels, ElectronLevels) else 0.0)
    most = min(2.0**detector.bits - 1.0, levels.blank_counts + levels.counts_per_nei * full_nei)
    one = frames.one_frame(frames.frames.index(frame))
    cards = next(image_cards(frames.scene, band, Views.of(one, sensor)))
    meta = {name: value for name, value, _ in cards if name not in ("BUNIT",)}
    return CCDData(
        light,
        unit=u.W / u.cm**2,
        uncertainty=StdDevUncertainty(np.sqrt(variance)),
        mask=counts >= np.floor(most),
        wcs=frames.wcs(frame, sensor),
        meta=meta,
    )
