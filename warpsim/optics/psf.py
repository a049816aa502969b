"""Point spread functions. Every one is integrated over the pixel before it meets an image.

The paper's Eq. 7 (Gaussian) and Eq. 8 (Airy radius R = 1.22 lambda L / D), in pixels of the camera: lengths count in
pixel widths, those of columns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, PlainSerializer, PlainValidator, ValidationInfo, model_validator

from warpsim.config.fields import Number, closed_interval, number_within, rule_error
from warpsim.config.model import config_model
from warpsim.errors import InputError
from warpsim.optics.pattern import FIRST_DARK_RING as FIRST_DARK_RING

RADIUS_RANGE_PX = (1e-3, 50.0)
TIGHT_RADIUS_PX = 0.01
"""Patterns of a smaller radius are drawn with a blurred core."""
TIGHT_BLUR_PX = 0.008
"""Standard deviation of that blur: as wide as the core of a pattern of TIGHT_RADIUS_PX."""
SIGMA_RANGE_PX = (1e-4, 64.0)
MAX_OBSCURATION = 0.6
MAX_SMEAR_PX = 50.0
MAX_IMAGE_SIDE = 2048
"""Samples along each side of a user's image."""
MAX_OVERSAMPLE = 256.0
MAX_N_WAVELENGTH = 32

Smear = Annotated[Number, closed_interval(0, MAX_SMEAR_PX)]


@config_model
class PsfGaussian:
    """A Gaussian blur.

    Args:
        sigma_px: Standard deviation of each axis [px], up to 64.
    """

    sigma_px: Annotated[Number, closed_interval(*SIGMA_RANGE_PX)]
    kind: Literal["gaussian"] = Field(default="gaussian", kw_only=True)


def _radii(value: Any, info: ValidationInfo) -> float | tuple[float, ...]:
    if isinstance(value, list | tuple | np.ndarray) and np.ndim(value) == 1:
        if not 1 <= len(value) <= MAX_N_WAVELENGTH:
            raise rule_error(f"must hold 1 to {MAX_N_WAVELENGTH} numbers")
        return tuple(number_within(item, info, *RADIUS_RANGE_PX) for item in value)
    return number_within(value, info, *RADIUS_RANGE_PX)


def _weights(value: Any, info: ValidationInfo) -> tuple[float, ...] | None:
    if value is None:
        return None
    if not isinstance(value, list | tuple | np.ndarray):
        raise rule_error("must be a list")
    return tuple(number_within(item, info, 0.0, math.inf, open_low=True) for item in value)


AS_LIST = PlainSerializer(lambda value: list(value) if isinstance(value, tuple) else value)


@config_model
class PsfAiry:
    """The diffraction pattern of a round pupil, of unit total flux: of one wavelength, or a sum over several.

    A pattern far tighter than a pixel, with a radius below 0.01 px, is drawn with its core blurred by 0.008 px; its
    wings, which alone reach pixels that the source is not in or next to, stay as they are. Light of a source within
    some 0.03 px of a pixel's edge is then split as if the source lay up to 0.01 px elsewhere.

    Args:
        radius_px: Radius of the first dark ring of the unobscured pupil, 1.22 lambda F / pitch [px], 0.001 to 50; a
            list for light of several wavelengths.
        obscuration: Diameter of the central obscuration over that of the pupil.
        smear_px: Standard deviation of each axis of a Gaussian blur on top [px].
        weights: Parts of the light at each of the radii, of any sum; equal ones when left out.
    """

    radius_px: Annotated[float | tuple[float, ...], PlainValidator(_radii), AS_LIST]
    obscuration: Annotated[Number, closed_interval(0, MAX_OBSCURATION)] = 0.0
    smear_px: Smear = 0.0
    weights: Annotated[tuple[float, ...] | None, PlainValidator(_weights), AS_LIST] = None
    kind: Literal["airy"] = Field(default="airy", kw_only=True)

    @model_validator(mode="after")
    def _as_many(self) -> PsfAiry:
        if self.weights is not None and len(self.weights) != len(self.radii_px):
            raise InputError(f"must be as many as radius_px ({len(self.radii_px)})", "weights", len(self.weights))
        return self

    @property
    def radii_px(self) -> tuple[float, ...]:
        """Radius of each wavelength [px]."""
        return self.radius_px if isinstance(self.radius_px, tuple) else (self.radius_px,)

    @property
    def blur_px(self) -> float:
        """Standard deviation of each axis of the Gaussian blur that the pattern is drawn with [px]."""
        tight = min(self.radii_px) < TIGHT_RADIUS_PX
        return math.hypot(self.smear_px, TIGHT_BLUR_PX) if tight else self.smear_px

    @property
    def parts(self) -> tuple[float, ...]:
        """Part of the light at each radius; their sum is 1."""
        weights = self.weights or (1.0,) * len(self.radii_px)
        total = sum(weights)
        return tuple(weight / total for weight in weights)


@dataclass(frozen=True, eq=False)
class PsfTable:
    """A pattern given as an image, of any form; zero beyond the image.

    The samples are values of the irradiance at points, not means over areas: oversample of them per pixel width, along
    columns as along rows. The centre of the array, between its middle samples where their number is even, is where a
    source's light belongs; the array's rows and columns run as those of the camera. Between the samples goes a cubic
    spline, which is integrated exactly over each pixel.

    Args:
        image: Samples, of positive sum, shape (n_row, n_col), up to 2048 each; scaled to unit sum.
        oversample: Samples per pixel width, 1 to 256, not necessarily whole.
        smear_px: Standard deviation of each axis of a Gaussian blur on top [px].

    Raises:
        InputError: A value breaks its rule.
    """

    image: npt.NDArray[np.float64]
    oversample: float
    smear_px: float = 0.0
    kind: str = "table"

    def __post_init__(self) -> None:
        if np.ndim(self.image) != 2 or np.asarray(self.image).dtype.kind not in "fiub":
            rule = "must be an array of numbers of two axes"
            array = np.asarray(self.image)
            raise InputError(rule, "image", f"shape {array.shape} of {array.dtype}", "s").of("PsfTable")
        try:
            image = checked_samples(self.image)
        except InputError as error:
            raise error.within("image").of("PsfTable") from None
        for name, low, high in (("oversample", 1.0, MAX_OVERSAMPLE), ("smear_px", 0.0, MAX_SMEAR_PX)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not low <= value <= high:
                raise InputError(f"must be in [{low:g}, {high:g}]", name, value).of("PsfTable")
            object.__setattr__(self, name, float(value))
        image /= image.sum()
        image.setflags(write=False)
        object.__setattr__(self, "image", image)  # the dataclass is frozen for everybody else

    def _key(self) -> tuple[object, ...]:
        return self.image.shape, self.image.tobytes(), self.oversample, self.smear_px

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PsfTable) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())


def checked_samples(image: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Return samples of a pattern, shape (n_row, n_col), in float64 with a largest of 1; InputError for bad ones."""
    samples = np.array(image, dtype=np.float64)
    if not 1 <= min(samples.shape) <= max(samples.shape) <= MAX_IMAGE_SIDE:
        raise InputError(f"sides must be 1 to {MAX_IMAGE_SIDE}", value=samples.shape)
    if n_bad := np.count_nonzero(~np.isfinite(samples)):
        raise InputError(f"must be finite, got {n_bad} bad values")
    if n_bad := np.count_nonzero(samples < 0.0):
        raise InputError(f"must hold no negative samples, clip them at 0, got {n_bad}")
    samples /= samples.max() or 1.0  # sums of huge or tiny numbers
    if not samples.sum() > 0.0:
        raise InputError("must have a positive sum")
    return samples


Psf = PsfGaussian | PsfAiry | PsfTable


def check_one_family(psfs: Sequence[Psf]) -> None:
    """See that the point spread functions of all bands can share kernels."""
    if len({isinstance(psf, PsfGaussian) for psf in psfs}) > 1:
        raise InputError(f"must be of one family in all bands, got {', '.join(psf.kind for psf in psfs)}", "psf")
