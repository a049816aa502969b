"""FITS keywords of images: scene, detector, and each image's time and WCS.

Cubes, single images and the JSON text in other image files say it in the same words.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.detector.detectors import TERMS, Detector, ElectronDetector, detector_terms
from warpsim.detector.levels import ElectronLevels, Levels
from warpsim.instant import utc_dates, utc_mjd
from warpsim.optics.wcs import lens_keywords, tan_keywords
from warpsim.render.frameset import FrameSet
from warpsim.render.line_of_sight import sensor_states
from warpsim.scene.description import SceneDescription
from warpsim.scene.instrument import Instrument
from warpsim.scene.provenance import PROVENANCE, provenance

Card = tuple[str, Any, str]
"""Keyword, value, comment."""

_FLAG_WORDS = {
    "UPREPL": "pointing.up had to be replaced",
    "BOREPL": "the boresight had to be replaced",
    "SLEWING": "the camera slews or settles",
}


STATE_WORDS = {
    **{f"POS_{axis}": "[m] of the sensor, geocentric, GCRS axes" for axis in "XYZ"},
    **{f"VEL_{axis}": "[m/s] of the sensor, likewise" for axis in "XYZ"},
    **{f"QUAT_{axis}": "of the rotation from GCRS to camera axes" for axis in "XYZW"},
}
"""Keywords of the state of a view's sensor."""


def scene_cards(scene: SceneDescription, instrument: Instrument, sensor: str, band: str) -> list[Card]:
    """Return the keywords common to all images of a sensor and band, without the lens."""
    levels, response = instrument.levels[band], instrument.bands[band]
    low_um, high_um = response.half_power_um
    return [
        ("BUNIT", "adu", "counts"),
        ("TELESCOP", instrument.satellite_of(sensor), "satellite"),
        ("INSTRUME", instrument.sensor.name, "kind of sensor"),
        ("SENSOR", sensor, ""),
        ("FILTER", band, "spectral band"),
        ("WAVELNTH", response.isophotal_um, "[um] isophotal, or mean over the response"),
        ("WAVEMIN", low_um, "[um] lower half-power wavelength"),
        ("WAVEMAX", high_um, "[um] upper half-power wavelength"),
        ("RESPONSE", "photon" if response.per_photon else "energy", "response per energy, or per photon"),
        ("NEI", levels.nei_w_cm2, "[W/cm2] noise equivalent irradiance"),
        ("SEI", levels.sei_w_cm2, "[W/cm2] saturation equivalent irradiance"),
        ("OFFSET", levels.blank_counts, "[adu] blank sky"),
        ("CNTNEI", levels.counts_per_nei, "[adu] per NEI"),
        *_detector_cards(instrument.sensor.detector, levels),
        *provenance_cards(scene),
    ]


def provenance_cards(scene: SceneDescription) -> list[Card]:
    """Return the keywords of every FITS file: where it is from."""
    return [(name, value, PROVENANCE[name]) for name, value in provenance(scene).items()]


@dataclass(frozen=True)
class Views:
    """Times, axes and flags of images of one sensor."""

    instrument: Instrument
    sensor: str
    frames: list[int]
    axes_icrs: npt.NDArray[np.float64]
    """Camera axes as rows x, y, z, shape (frame, 3, 3)."""
    flags: dict[str, npt.NDArray[np.bool_]]
    """By keyword, shape (frame,): fallback axes; slews where the sensors make any."""

    @classmethod
    def of(cls, frames: FrameSet, sensor: str) -> Views:
        """Return the views of a sensor in a render call."""
        flags = {"UPREPL": frames.up_replaced, "BOREPL": frames.boresight_replaced}
        flags |= {"SLEWING": frames.slewing} if frames.instrument.slews else {}
        index = frames.sensors.index(sensor)
        own = {word: values[:, index] for word, values in flags.items()}
        return cls(frames.instrument, sensor, frames.frames, frames.axes_icrs[:, index], own)

    @classmethod
    def joined(cls, instrument: Instrument, sensor: str, parts: Sequence[dict[str, Any]]) -> Views:
        """Return the views of several `plain`, one after the other."""
        frames = [number for part in parts for number in part["frames"]]
        axes = np.concatenate([np.asarray(part["axes_icrs"], dtype=np.float64) for part in parts])
        flags = {
            word: np.concatenate([part["flags"][word] for part in parts]).astype(bool) for word in parts[0]["flags"]
        }
        return cls(instrument, sensor, frames, axes, flags)

    @property
    def plain(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        flags = {word: values.tolist() for word, values in self.flags.items()}
        return {"frames": self.frames, "axes_icrs": self.axes_icrs.tolist(), "flags": flags}

    @property
    def time_s(self) -> npt.NDArray[np.float64]:
        """Times after the epoch [s], middle of the exposure."""
        return self.instrument.frame_time_s(self.frames)

    @property
    def states(self) -> dict[str, npt.NDArray[np.float64]]:
        """Position, velocity and attitude of the sensor by keyword, shape (frame,)."""
        columns = sensor_states(self.instrument, self.sensor, self.time_s, self.axes_icrs).T
        return dict(zip(STATE_WORDS, columns, strict=True))


def image_cards(scene: SceneDescription, band: str, views: Views) -> Iterator[list[Card]]:
    """Yield all keywords of each image of a sensor in a band: the scene's, and its own time and sky."""
    camera, epoch = views.instrument.sensor.camera, scene.epoch_utc
    first = [
        *scene_cards(scene, views.instrument, views.sensor, band),
        ("MJDREF", float(utc_mjd(epoch, [0.0])[0]), "[d] of DATEREF"),
    ]
    last: list[Card] = [(name, value, "") for name, value in lens_keywords(camera).items()]
    time_s, states = views.time_s, views.states
    dates, days = utc_dates(epoch, time_s), utc_mjd(epoch, time_s)
    for i, number in enumerate(views.frames):
        tan = tan_keywords(views.axes_icrs[i], camera)
        yield [
            *first,
            ("FRAME", number, "frame number in the scene"),
            ("TIME_S", float(time_s[i]), "[s] after DATEREF, middle of the exposure"),
            ("DATE-OBS", str(dates[i]), "UTC, middle of the exposure"),
            ("MJD-OBS", float(days[i]), "[d] the same"),
            *((name, value, "") for name, value in tan.items()),
            *last,
            *((word, float(values[i]), STATE_WORDS[word]) for word, values in states.items()),
            *((word, bool(values[i]), _FLAG_WORDS[word]) for word, values in views.flags.items()),
        ]


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
        plain = isinstance(value, bool | float | int | str)
        cards.append((TERMS[name][0], value if plain else str(value), words if plain else words.partition(",")[0]))
    return cards
