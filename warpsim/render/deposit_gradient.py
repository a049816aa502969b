"""Derivatives of images of point sources, without a scene: of what `deposit` draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.errors import InputError
from warpsim.optics.psf import Psf
from warpsim.optics.psf_bank import PsfBank, stamp_rule
from warpsim.optics.tables import ERROR_RANGE, TableAccuracy
from warpsim.render.deposit import check_image, point_images
from warpsim.render.point_images import F64, JacobianStamps, PointImages


@dataclass(frozen=True)
class DepositGradient:
    """Gradient of a number by the sources of an image."""

    xy_px: F64
    """Per pixel, (n, 2)."""
    flux: F64
    """Per unit of flux, (n,)."""
    sigma_px: float
    """By the width of a Gaussian, per pixel; 0 for other patterns."""
    movement_px: F64
    """By the coefficients of paths, per pixel, (n, n_coefficient, 2)."""


def deposit_gradient(
    xy_px: npt.ArrayLike,
    flux: npt.ArrayLike,
    psf: Psf,
    shape: tuple[int, int],
    cotangent: npt.ArrayLike,
    device: Any = None,
    flux_error: float = 1e-6,
    movement_px: npt.ArrayLike | None = None,
    brightness: npt.ArrayLike | None = None,
) -> DepositGradient:
    """Return the gradient of a number by the sources of the image that `deposit` draws with the same arguments.

    It is that of the image as drawn, by the derivative of the same interpolation in the same tables, in float64. One
    sided where a source stands on an edge between two cells of a table, and where a pixel joins or leaves its stamp.

    Args:
        xy_px: As in `deposit`.
        flux: As in `deposit`; a source of 0 has a gradient, too.
        psf: As in `deposit`.
        shape: As in `deposit`.
        cotangent: Derivatives of the number by the pixels, shape (n_row, n_col); taken as float32.
        device: As in `deposit`.
        flux_error: As in `deposit`.
        movement_px: As in `deposit`.
        brightness: As in `deposit`.

    Raises:
        InputError: As in `deposit`; a cotangent of another shape, or that is not finite.
    """
    images, scale = point_images(xy_px, flux, psf, shape, device, flux_error, movement_px, brightness)
    found = images.gathered(checked_cotangent(cotangent, images.shape)[None, None], with_sigma=True)
    by_xy, by_path = scale * found.by_xy[0, 0], scale * found.by_path[0, 0]
    return DepositGradient(by_xy, found.by_light[0, 0].copy(), scale * float(found.by_sigma.sum()), by_path)


def deposit_jacobian(
    xy_px: npt.ArrayLike,
    flux: npt.ArrayLike,
    psf: Psf,
    shape: tuple[int, int],
    device: Any = None,
    flux_error: float = 1e-6,
    movement_px: npt.ArrayLike | None = None,
    brightness: npt.ArrayLike | None = None,
) -> JacobianStamps:
    """Return the derivatives of the image that `deposit` draws with the same arguments, source by source.

    Each source has a window of pixels with the derivatives by its flux, x and y, and by the sigma of a Gaussian:
    `matrix()` makes the sparse matrix of least squares of them. With movement, x and y are those of the whole path.

    Args:
        xy_px: As in `deposit`.
        flux: As in `deposit`.
        psf: As in `deposit`.
        shape: As in `deposit`.
        device: As in `deposit`.
        flux_error: As in `deposit`.
        movement_px: As in `deposit`.
        brightness: As in `deposit`.

    Raises:
        InputError: As in `deposit`; the windows would take more than 4 GB.
    """
    images, scale = point_images(xy_px, flux, psf, shape, device, flux_error, movement_px, brightness)
    stamps = images.jacobian()
    return replace(stamps, values=stamps.values * np.array([1.0, scale, scale, scale]))


def checked_cotangent(cotangent: npt.ArrayLike, shape: tuple[int, ...]) -> npt.NDArray[np.float32]:
    """Return a cotangent as float32; InputError if it is not of a shape, or not finite in it."""
    try:
        values = np.asarray(cotangent, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("must be an array of numbers", "cotangent") from None
    if values.shape != shape:
        raise InputError(f"must have shape {shape}", "cotangent", values.shape)
    largest = np.abs(values).max(initial=0.0)
    if not largest <= np.finfo(np.float32).max:
        raise InputError("must be finite, and below 3.4e38", "cotangent")
    return values.astype(np.float32)


@dataclass(frozen=True, eq=False)
class PointDrawing:
    """How many views and bands of sources are drawn at once, from arrays that are on a device already."""

    bank: PsfBank
    rule: Any
    shape: tuple[int, int]
    n_band: int

    def images(self, xy_px: wp.array, light: wp.array) -> PointImages:
        """Return sources as images: xy_px (n_view, n) vec2d, light (n_view, n_band, n) float32."""
        n_source = wp.full(xy_px.shape[0], xy_px.shape[1], dtype=wp.int32, device=xy_px.device)
        return PointImages(self.bank, [n_source, xy_px, light], self.rule, self.shape)


def point_drawing(psf: Psf | Sequence[Psf], shape: tuple[int, int], device: Any, flux_error: float) -> PointDrawing:
    """Return how sources are drawn, by one point spread function for each band.

    Raises:
        InputError: As in `deposit`; no functions, or some of different families.
    """
    psfs = tuple(psf) if isinstance(psf, Sequence) else (psf,)
    if not psfs:
        raise InputError("must be one for each band", "psf", psf)
    for one in psfs:
        check_image(one, shape, flux_error)
    return _drawing(psfs, (int(shape[0]), int(shape[1])), str(wp.get_device(device)), float(flux_error))


@lru_cache(maxsize=16)
def _drawing(psfs: tuple[Psf, ...], shape: tuple[int, int], device: str, flux_error: float) -> PointDrawing:
    accuracy = TableAccuracy(float(np.clip(0.5 * flux_error, *ERROR_RANGE)))
    bank = PsfBank(psfs, wp.get_device(device), accuracy=accuracy)
    rule = stamp_rule([0.0] * len(psfs), flux_error, device, 0.5 * flux_error)
    return PointDrawing(bank, rule, shape, len(psfs))


def checked_lists(xy_shape: Sequence[int], light_shape: Sequence[int], n_band: int) -> None:
    """See that the sources of views have the shapes (n_view, n, 2) and (n_view, n_band, n); InputError otherwise."""
    if len(xy_shape) != 3 or xy_shape[2] != 2:
        raise InputError("must have shape (n_view, n, 2)", "xy_px", tuple(xy_shape))
    expected = (xy_shape[0], n_band, xy_shape[1])
    if tuple(light_shape) != expected:
        raise InputError(f"must have shape {expected}: views, bands, sources", "flux", tuple(light_shape))
