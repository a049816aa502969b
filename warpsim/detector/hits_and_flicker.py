"""Charge that is not light: radiation hits and flickering pixels of a detector."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import model_validator

from warpsim.config.fields import Count, Number, Positive, closed_interval
from warpsim.config.model import config_model, exactly_one
from warpsim.errors import InputError

LONGEST_TANGENT = 30.0
"""Of the angle between a track and the normal; one hit in 900 is flatter and taken to be so steep."""

MOST_HITS = 1e6
"""Mean hits of an image, at most."""


@config_model
class RadiationHits:
    """Particles that cross a detector and leave tracks of charge, new in every image.

    They come evenly from all sides. A track crosses the sensitive layer in a straight line; its mean charge is in
    proportion to its length, and is scattered as Moyal's form of Landau's distribution says.

    Args:
        rate_cm2_s: Hits of an area of the detector in a time [1/cm2/s].
        thickness_um: Of the sensitive layer; a track is that over the cosine of its angle long [um].
        e_per_um: Mean charge by length of track, of a detector in electrons [e/um].
        nei_per_um: The same of a detector in NEI terms [NEI/um].
        landau_width: Scale of the distribution of charge over its mean; at most 0.19, so that no charge is negative.
        integration_s: Time in which an image collects hits, the detector's exposure when left out [s].
        pixel_pitch_um: Width of a pixel, the camera's when left out [um].
    """

    rate_cm2_s: Positive
    thickness_um: Annotated[Positive, closed_interval(1e-3, 1e5)] = 10.0
    e_per_um: Positive | None = None
    nei_per_um: Positive | None = None
    landau_width: Annotated[Number, closed_interval(0, 0.19)] = 0.1
    integration_s: Positive | None = None
    pixel_pitch_um: Positive | None = None

    @model_validator(mode="after")
    def _one_charge(self) -> RadiationHits:
        exactly_one(self, "e_per_um", "nei_per_um")
        return self

    def __str__(self) -> str:
        charge = f"{self.e_per_um:g} e" if self.e_per_um is not None else f"{self.nei_per_um:g} NEI"
        return f"{self.rate_cm2_s:g}/cm2/s, {charge}/um"


@config_model
class Flicker:
    """Pixels whose dark signal is higher in some frames than in others (random telegraph noise).

    Which they are, and by how much (exponentially distributed), stays with the detector. Whether one is on is drawn
    anew for each of its dwells, which do not begin together.

    Args:
        fraction: Of the pixels.
        e_s: Mean further dark current of one that is on, of a detector in electrons [e/s].
        nei: Mean further signal, of a detector in NEI terms [NEI].
        duty: Fraction of the dwells in which a pixel is on.
        dwell_frames: Frames of a dwell, by their numbers.
    """

    fraction: Annotated[Positive, closed_interval(0, 0.5)]
    e_s: Positive | None = None
    nei: Positive | None = None
    duty: Annotated[Positive, closed_interval(1e-6, 1)] = 0.5
    dwell_frames: Count = 1

    @model_validator(mode="after")
    def _one_level(self) -> Flicker:
        exactly_one(self, "e_s", "nei")
        return self

    def __str__(self) -> str:
        level = f"{self.e_s:g} e/s" if self.e_s is not None else f"{self.nei:g} NEI"
        return f"{self.fraction:g} of the pixels, {level}, duty {self.duty:g}"


def check_artifacts(detector: Any) -> None:
    """Check that hits and flicker of a detector are in its own unit, and have a time; InputError otherwise."""
    unit, other = ("e", "nei") if detector.kind == "electron" else ("nei", "e")
    wrong = {"hits": {"e": "e_per_um", "nei": "nei_per_um"}, "flicker": {"e": "e_s", "nei": "nei"}}
    for name, fields in wrong.items():
        part = getattr(detector, name)
        if part is not None and getattr(part, fields[unit]) is None:
            kind = "in electrons" if unit == "e" else "in NEI terms"
            raise InputError(f"must be given for a detector {kind}, not {fields[other]}", f"{name}.{fields[unit]}")
    if detector.hits is not None and detector.hits.integration_s is None and detector.exposure_s == 0.0:
        raise InputError("must be given where exposure_s is 0", "hits.integration_s")


@dataclass(frozen=True)
class HitArea:
    """The area through which particles that reach an array enter, in pixels, and how many in an image."""

    size_um: tuple[float, float]
    """Width and height of a pixel."""
    margin_px: tuple[float, float]
    """How far outside the array a track may begin, in widths and in heights of a pixel."""
    mean: float
    """Hits of an image, margin included."""


def hit_area(detector: Any, camera: Any) -> HitArea:
    """Return where particles enter that reach a camera's array, and how many do in an image.

    Raises:
        InputError: The width of pixels is not known, or there would be too many.
    """
    own, pitch_um = detector.hits, detector.hits.pixel_pitch_um
    if pitch_um is None and camera.pixel_pitch_m is not None:
        pitch_um = 1e6 * camera.pixel_pitch_m
    if pitch_um is None:
        raise InputError("must be given where the camera has no pixel_pitch_m", "detector.hits.pixel_pitch_um")
    size_um = pitch_um, pitch_um * camera.pixel_aspect
    margin = LONGEST_TANGENT * own.thickness_um / size_um[0], LONGEST_TANGENT * own.thickness_um / size_um[1]
    across, down = camera.n_col + 2 * margin[0], camera.n_row + 2 * margin[1]
    area_cm2 = 1e-8 * across * size_um[0] * down * size_um[1]
    mean = own.rate_cm2_s * area_cm2 * (detector.exposure_s if own.integration_s is None else own.integration_s)
    if mean > MOST_HITS:
        rule = f"must give at most {MOST_HITS:g} hits in an image, gives {mean:.3g}"
        raise InputError(rule, "detector.hits.rate_cm2_s", own.rate_cm2_s, "g")
    return HitArea(size_um, margin, mean)


def has_artifacts(detector: Any) -> bool:
    """Return whether a detector has hits or flickering pixels."""
    return detector.hits is not None or detector.flicker is not None
