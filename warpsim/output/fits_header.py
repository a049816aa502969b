"""FITS keywords of images: what is known of the scene, the detector, and each image's time and sky.

Cubes, single images and the JSON text in other image files say it in the same words.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.detector.electron import ElectronDetector
from warpsim.detector.levels import ElectronLevels, Levels
from warpsim.detector.terms import detector_terms
from warpsim.instant import years_ahead
from warpsim.optics.wcs import lens_keywords, tan_keywords
from warpsim.render.frameset import FrameSet
from warpsim.scene.scene import Scene

Card = tuple[str, Any, str]
"""Keyword, value, comment."""


def scene_cards(scene: Scene, sensor: str, band: str) -> list[Card]:
    """What all images of a sensor and band share, without their lens."""
    import warpsim

    levels = scene.levels[band]
    return [
        ("BUNIT", "adu", "counts"),
        ("SCENE", scene.name, ""),
        ("TELESCOP", sensor, "satellite"),
        ("SENSOR", sensor, ""),
        ("FILTER", band, "spectral band"),
        ("TIMESYS", "UTC", ""),
        ("DATEREF", scene.epoch_utc, "instant of TIME_S = 0"),
        ("NEI", levels.nei_w_cm2, "[W/cm2] noise equivalent irradiance"),
        ("SEI", levels.sei_w_cm2, "[W/cm2] saturation equivalent irradiance"),
        ("OFFSET", levels.blank_counts, "[adu] blank sky"),
        ("CNTNEI", levels.counts_per_nei, "[adu] per NEI"),
        *_detector_cards(scene, levels),
        ("SEED", scene.seed, "of the noise"),
        ("CREATOR", f"warpsim {warpsim.__version__}", ""),
    ]


@dataclass(frozen=True)
class UtcDates:
    """Instants of UTC."""

    isot: list[str]
    """ISO 8601, to microseconds."""
    mjd: list[float]
    """Modified Julian dates of UTC, good to a microsecond."""


def utc_dates(scene: Scene, time_s: npt.ArrayLike) -> UtcDates:
    """The instants of times after the scene's epoch [s], shape (n,)."""
    from astropy.time import TimeDelta

    # TAI seconds: UTC days may hold a leap second.
    with years_ahead():
        times = (scene.epoch.tai + TimeDelta(np.asarray(time_s, dtype=np.float64), format="sec")).utc
        times.precision = 6
        return UtcDates([str(text) for text in times.isot], [float(day) for day in times.mjd])


def image_cards(frames: FrameSet, sensor: str, band: str) -> Iterator[list[Card]]:
    """All keywords of each image of a sensor and band, frame by frame: the scene's, and its own time and sky."""
    scene, place = frames.scene, frames.sensors.index(sensor)
    first = [*scene_cards(scene, sensor, band), ("MJDREF", utc_dates(scene, [0.0]).mjd[0], "[d] of DATEREF")]
    last: list[Card] = [(name, value, "") for name, value in lens_keywords(scene.camera).items()]
    dates = utc_dates(scene, frames.time_s)
    up, boresight = frames.up_replaced[:, place], frames.boresight_replaced[:, place]
    for i, number in enumerate(frames.frames):
        tan = tan_keywords(frames.axes_icrs[i, place], scene.camera)
        yield [
            *first,
            ("FRAME", number, "frame number in the scene"),
            ("TIME_S", float(frames.time_s[i]), "[s] after DATEREF, middle of the exposure"),
            ("DATE-OBS", dates.isot[i], "UTC, middle of the exposure"),
            ("MJD-OBS", dates.mjd[i], "[d] the same"),
            *((name, value, "") for name, value in tan.items()),
            *last,
            ("UPREPL", bool(up[i]), "pointing.up had to be replaced"),
            ("BOREPL", bool(boresight[i]), "the boresight had to be replaced"),
        ]


def _detector_cards(scene: Scene, levels: Levels) -> list[tuple[str, Any, str]]:
    """What is known of the detector besides: its chain in electrons, and the terms that are on."""
    detector = scene.detector
    cards: list[tuple[str, Any, str]] = [("DETECTOR", detector.kind, "kind of detector")]
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
    "noise": "NOISE",
    "shot_noise": "SHOT",
}
"""FITS keywords of detector terms; the unit stands in the comment."""
