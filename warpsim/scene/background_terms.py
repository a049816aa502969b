"""What lies behind stars and targets, as a scene describes it."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, model_validator

from warpsim.config.fields import (
    FileName,
    Number,
    Positive,
    Switch,
    as_tuple,
    closed_interval,
    file_or_function,
)
from warpsim.config.model import config_model
from warpsim.errors import InputError

Ratio = Annotated[Positive, closed_interval(0, 1e30)]
"""Radiance per irradiance [1/sr]; far larger ones would overflow float32 radiances."""

Angle = Annotated[Number, closed_interval(0, 180)]
"""Off the boresight [deg]."""


@config_model
class StrayLight:
    """Light of the Sun, the Moon and the Earth that optics scatter evenly over the image.

    The ratio is that of the radiance that the image shows to the irradiance of the source on a plane across its light.
    A point source transmittance (irradiance of the focal plane over that of the source) over pi / 4 times transmission
    over the squared focal ratio is this ratio.

    Args:
        angle_deg: Angles between source and boresight, increasing, from 0 to 180 [deg].
        ratio_sr: Radiance per irradiance at these angles, log-linear between them and constant beyond [1/sr].
        sun: Whether sunlight is scattered.
        moon: Whether moonlight is.
        earth: Whether the light of the Earth's disc is, by night and by day.
    """

    angle_deg: Annotated[tuple[Angle, ...], BeforeValidator(as_tuple)]
    ratio_sr: Annotated[tuple[Ratio, ...], BeforeValidator(as_tuple)]
    sun: Switch = True
    moon: Switch = True
    earth: Switch = True

    @model_validator(mode="after")
    def _a_curve(self) -> StrayLight:
        if len(self.angle_deg) < 2 or any(a >= b for a, b in zip(self.angle_deg, self.angle_deg[1:], strict=False)):
            raise InputError("must hold two angles or more that increase", "angle_deg", self.angle_deg)
        if len(self.ratio_sr) != len(self.angle_deg):
            raise InputError(
                f"must hold {len(self.angle_deg)} numbers, as angle_deg does", "ratio_sr", len(self.ratio_sr)
            )
        return self


@config_model
class Background:
    """What lies behind stars and targets; nothing when left out.

    Electron detectors count its electrons with their shot noise. A detector described by its NEI takes it as an offset:
    its noise is given.

    Args:
        zodiacal: Whether interplanetary dust glows (Kelsall et al. 1998).
        earth: Whether the Earth's disc and limb glow, and reflect sunlight.
        sky_map: FITS image with celestial WCS, or FITS table of HEALPix pixels, of surface brightness, for all bands.
            Or a function of a Python module, also as "python:module:function", from directions (n, 3) in ICRS and a
            `ws.Band` to radiances (n,) [W/cm2/sr].
        image: FITS or NPY file of the irradiance that every pixel gets besides [W/cm2], (n_row, n_col), or a plane for
            each band of the sensor, (n_band, n_row, n_col); "{kind}" in it stands for the name of the kind of sensor.
        stray_light: How the optics scatter the Sun, the Moon and the Earth.
    """

    zodiacal: Switch = False
    earth: Switch = False
    sky_map: Annotated[str, BeforeValidator(file_or_function)] | None = None
    image: FileName | None = None
    stray_light: StrayLight | None = None

    @property
    def summary(self) -> str:
        """What there is, in words: "zodiacal light, Earth"."""
        words = {
            "zodiacal light": self.zodiacal,
            "Earth": self.earth,
            "map of the sky": self.sky_map is not None,
            "image of the user's": self.image is not None,
            "stray light": self.stray_light is not None,
        }
        return ", ".join(word for word, on in words.items() if on) or "nothing, a black sky"

    @property
    def is_on(self) -> bool:
        """Whether there is any."""
        return self != Background()
