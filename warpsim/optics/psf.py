"""Point spread functions, and the optics that lead to them.

Every function here is integrated over the pixel before it meets an image. The paper's Eq. 7 (Gaussian) and Eq. 8
(Airy radius R = 1.22 lambda L / D) in pixels of the camera.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from warpsim.describe import Number, Positive, closed_interval, part
from warpsim.optics.airy import FIRST_DARK_RING, MAX_OBSCURATION, RADIUS_RANGE_PX
from warpsim.optics.camera import Camera

GAUSSIAN_PER_LAMBDA_F = 0.42
"""Sigma of the Gaussian that resembles an Airy pattern's core, in units of lambda * F."""


@part
class PsfGaussian:
    """A Gaussian blur.

    Args:
        sigma_px: Standard deviation of each axis [px], up to 64.
    """

    sigma_px: Annotated[Number, closed_interval(1e-4, 64)]
    kind: Literal["gaussian"] = Field(default="gaussian", kw_only=True)


@part
class PsfAiry:
    """The diffraction pattern of a round pupil, of unit total flux.

    Args:
        radius_px: Radius of the first dark ring of the unobscured pupil, 1.22 lambda F / pitch [px], 0.02 to 50.
        obscuration: Diameter of the central obscuration over that of the pupil.
    """

    radius_px: Annotated[Number, closed_interval(*RADIUS_RANGE_PX)]
    obscuration: Annotated[Number, closed_interval(0, MAX_OBSCURATION)] = 0.0
    kind: Literal["airy"] = Field(default="airy", kw_only=True)


Psf = PsfGaussian | PsfAiry


@part
class Optics:
    """The telescope.

    Args:
        aperture_m: Pupil diameter [m].
        obscuration: Diameter of the central obscuration over that of the pupil; an Airy pattern only.
        psf: "airy", or "gaussian" with sigma = 0.42 lambda F.
        sigma_px: Sigma of the Gaussian in all bands, instead of 0.42 lambda F [px].
        stamp_cut_nei: Light left out of a source's stamp stays below this in every pixel [NEI].
    """

    aperture_m: Positive
    obscuration: Annotated[Number, closed_interval(0, MAX_OBSCURATION)] = 0.0
    psf: Literal["airy", "gaussian"] = "airy"
    sigma_px: Positive | None = None
    stamp_cut_nei: Positive = 0.1

    def psf_at(self, wavelength_um: float, camera: Camera) -> Psf:
        """The point spread function at one wavelength, in pixels of the camera."""
        lambda_f_px = wavelength_um * 1e-6 / self.aperture_m * camera.focal_px
        if self.psf == "airy":
            return PsfAiry(FIRST_DARK_RING * lambda_f_px, self.obscuration)
        return PsfGaussian(GAUSSIAN_PER_LAMBDA_F * lambda_f_px if self.sigma_px is None else self.sigma_px)
