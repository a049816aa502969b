"""FITS keywords of images: scene, detector, and each image's time and WCS.

Cubes, single images and the JSON text in other image files say it in the same words.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.detector.detectors import Detector, ElectronDetector, detector_terms
from warpsim.detector.levels import ElectronLevels, Levels
from warpsim.optics.wcs import lens_keywords, tan_keywords
from warpsim.output.dates import utc_dates, utc_mjd
from warpsim.render.frameset import FrameSet
from warpsim.scene.description import SceneDescription
from warpsim.scene.instrument import Instrument
from warpsim.version import __version__

Card = tuple[str, Any, str]
"""Keyword, value, comment."""

_FLAG_WORDS = {
    "UPREPL": "pointing.up had to be replaced",
    "BOREPL": "the boresight had to be replaced",
    "SLEWING": "the camera slews or settles",
}


def scene_cards(scene: SceneDescription, instrument: Instrument, sensor: str, band: str) -> list[Card]:
    """Return the keywords common to all images of a sensor and band, without the lens."""
    levels, response = instrument.levels[band], instrument.bands[band]
    low_um, high_um = response.half_power_um
    return [
        ("BUNIT", "adu", "counts"),
        ("SCENE", scene.name, ""),
        ("TELESCOP", instrument.satellite_of(sensor), "satellite"),
        ("INSTRUME", instrument.sensor.name, "kind of sensor"),
        ("SENSOR", sensor, ""),
        ("FILTER", band, "spectral band"),
        ("WAVELNTH", response.isophotal_um, "[um] isophotal, or mean over the response"),
        ("WAVEMIN", low_um, "[um] lower half-power wavelength"),
        ("WAVEMAX", high_um, "[um] upper half-power wavelength"),
        ("RESPONSE", "photon" if response.per_photon else "energy", "response per energy, or per photon"),
        ("TIMESYS", "UTC", ""),
        ("DATEREF", scene.epoch_utc, "instant of TIME_S = 0"),
        ("NEI", levels.nei_w_cm2, "[W/cm2] noise equivalent irradiance"),
        ("SEI", levels.sei_w_cm2, "[W/cm2] saturation equivalent irradiance"),
        ("OFFSET", levels.blank_counts, "[adu] blank sky"),
        ("CNTNEI", levels.counts_per_nei, "[adu] per NEI"),
        *_detector_cards(instrument.sensor.detector, levels),
        ("SEED", scene.seed, "of the world"),
        ("NOISSEED", instrument.noise_seed, "of the noise"),
        ("CREATOR", f"warpsim {__version__}", ""),
    ]


def image_cards(frames: FrameSet, sensor: str, band: str) -> Iterator[list[Card]]:
    """Yield all keywords of each image of a sensor and band, frame by frame: the scene's, and its own time and sky."""
    scene, instrument, index = frames.scene, frames.instrument, frames.sensors.index(sensor)
    camera, epoch = instrument.sensor.camera, scene.epoch_utc
    first = [
        *scene_cards(scene, instrument, sensor, band),
        ("MJDREF", float(utc_mjd(epoch, [0.0])[0]), "[d] of DATEREF"),
    ]
    last: list[Card] = [(name, value, "") for name, value in lens_keywords(camera).items()]
    dates, days = utc_dates(epoch, frames.time_s), utc_mjd(epoch, frames.time_s)
    flags = {word: values[:, index] for word, values in view_flags(frames).items()}
    for i, number in enumerate(frames.frames):
        tan = tan_keywords(frames.axes_icrs[i, index], camera)
        yield [
            *first,
            ("FRAME", number, "frame number in the scene"),
            ("TIME_S", float(frames.time_s[i]), "[s] after DATEREF, middle of the exposure"),
            ("DATE-OBS", str(dates[i]), "UTC, middle of the exposure"),
            ("MJD-OBS", float(days[i]), "[d] the same"),
            *((name, value, "") for name, value in tan.items()),
            *last,
            *((word, bool(values[i]), _FLAG_WORDS[word]) for word, values in flags.items()),
        ]


def view_flags(frames: FrameSet) -> dict[str, npt.NDArray[np.bool_]]:
    """Return flags of views by keyword, each (frame, sensor): fallback axes; slews where the sensors make any."""
    flags = {"UPREPL": frames.up_replaced, "BOREPL": frames.boresight_replaced}
    return flags | ({"SLEWING": frames.slewing} if frames.instrument.slews else {})


def _detector_cards(detector: Detector, levels: Levels) -> list[Card]:
    """Further keywords of the detector: its chain in electrons, and the enabled terms."""
    cards: list[Card] = [("DETECTOR", detector.kind, "kind of detector")]
    if isinstance(detector, ElectronDetector) and isinstance(levels, ElectronLevels):
        cards += [
            ("EXPTIME", detector.exposure_s, "[s] exposure"),
            ("GAIN", detector.gain_e_per_count, "[electron/adu]"),
            ("FULLWELL", detector.full_well_e, "[electron] that a pixel holds"),
            ("BACKGR", levels.background_e, "[electron] mean of the background"),
            ("DARK", levels.dark_e, "[electron] mean of the dark current"),
            ("RDNOISE", detector.read_noise_e, "[electron] rms of reading"),
            ("EPERIRR", levels.e_per_w_cm2, "[electron cm2/W] per irradiance"),
        ]
    elif detector.exposure_s > 0:
        cards.append(("EXPTIME", detector.exposure_s, "[s] exposure"))
    for name, words in detector_terms(detector).items():
        value = getattr(detector, name)
        cards.append((_TERM_KEYWORDS[name], value, words))
    return cards


_TERM_KEYWORDS = {
    "prnu": "PRNU",
    "dsnu": "DSNU",
    "dsnu_nei": "DSNU",
    "column_noise_e": "COLNOISE",
    "column_noise_nei": "COLNOISE",
    "dead_fraction": "DEADFRAC",
    "hot_fraction": "HOTFRAC",
    "nonlinearity": "NONLIN",
    "shot_noise": "SHOT",
}
"""FITS keywords of detector terms; the unit stands in the comment."""
