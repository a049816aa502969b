"""Point sources onto one image, without a scene, and derivatives of such images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.launches import to_numpy
from warpsim.optics.psf import Psf
from warpsim.optics.psf_bank import PsfBank, paths_struct, stamp_rule
from warpsim.optics.tables import ERROR_RANGE, TableAccuracy
from warpsim.render.device import default_device
from warpsim.render.point_images import JacobianStamps, PointImages


def deposit(
    xy_px: npt.ArrayLike,
    flux: npt.ArrayLike,
    psf: Psf,
    shape: tuple[int, int],
    device: Any = None,
    flux_error: float = 1e-6,
    movement_px: npt.ArrayLike | None = None,
    brightness: npt.ArrayLike | None = None,
) -> npt.NDArray[np.float32]:
    """Draw point sources, integrated over each pixel, and over the exposure where they move.

    Args:
        xy_px: Positions (x = column, y = row; pixel centres on integers) [px], shape (n, 2). Sources outside the image
            add what their stamps spill into it.
        flux: Flux of each source in any unit, shape (n,).
        psf: PsfGaussian, PsfAiry or PsfTable.
        shape: (n_row, n_col).
        device: Warp device; CUDA where present when left out.
        flux_error: No pixel is off by more than this fraction of a source's flux, truncation included; below 2e-7
            float32 rounding decides, and below 6e-7 the table of an Airy pattern or an image. What falls outside the
            frame is absent; nothing is renormalised.
        movement_px: How each source moves about its position during the exposure: coefficients of the Legendre
            polynomials P_0, P_1 ... in t, which runs from -1 to 1 [px], shape (n, n_coefficient, 2). A source that
            crosses d pixels evenly has the coefficients 0 and d / 2. Followed within flux_error.
        brightness: Brightness during the exposure over its mean, coefficients of the same polynomials, shape
            (n, n_coefficient); the first is 1.

    Returns:
        Image in the unit of flux, shape (n_row, n_col), float32.

    Raises:
        InputError: Wrong shapes, values that are not finite, an impossible shape or error bound.
    """
    images, scale = point_images(xy_px, flux, psf, shape, device, flux_error, movement_px, brightness)
    image = to_numpy(images.draw())[0, 0]
    if scale == 1.0:
        return np.asarray(image)
    scaled = image * np.float64(scale)
    if np.abs(scaled).max(initial=0.0) > np.finfo(np.float32).max:
        raise InputError(f"must leave pixels below 3.4e38, got up to {scale:.3g}", "flux")
    return np.asarray(scaled.astype(np.float32))


def point_images(
    xy_px: npt.ArrayLike,
    flux: npt.ArrayLike,
    psf: Psf,
    shape: tuple[int, int],
    device: Any = None,
    flux_error: float = 1e-6,
    movement_px: npt.ArrayLike | None = None,
    brightness: npt.ArrayLike | None = None,
) -> tuple[PointImages, float]:
    """Return the sources of `deposit` on a device, their flux over a scale, and the scale."""
    xy, strength, moves, changes = _checked_sources(xy_px, flux, movement_px, brightness)
    check_image(psf, shape, flux_error)
    # Far away sources cannot touch the image; bringing them near keeps pixel numbers within 32 bits.
    reach = np.abs(moves).sum(axis=(0, 1)).max(initial=0.0)
    xy = np.clip(xy, -1e6 - reach, 1e6 + max(shape) + reach)
    # The unit may be anything: scaled to a largest value of 1, float32 neither overflows nor loses faint sources.
    scale = float(np.abs(strength).max(initial=0.0)) or 1.0
    where = default_device(device)
    sources = [
        wp.array([len(xy)], dtype=wp.int32, device=where),
        wp.array(xy[None], dtype=wp.vec2d, device=where),
        wp.array((strength / scale).astype(np.float32)[None, None], dtype=wp.float32, device=where),
    ]
    paths = None
    if movement_px is not None or brightness is not None:
        offset_px = wp.array(moves[None], dtype=wp.vec2, device=where)
        paths = paths_struct(offset_px, wp.array(changes[None, None], dtype=wp.float32, device=where), len(changes))
    bank, rule = _bank_and_rule([psf], where, flux_error)
    return PointImages(bank, sources, rule, (int(shape[0]), int(shape[1])), paths), scale


def _bank_and_rule(psfs: Sequence[Psf], device: wp.Device, flux_error: float) -> tuple[PsfBank, Any]:
    """Functions in tables, and the rule of their stamps, that are good to a fraction of a source's flux."""
    accuracy = TableAccuracy(float(np.clip(0.5 * flux_error, *ERROR_RANGE)))
    rule = stamp_rule([0.0] * len(psfs), flux_error, device, 0.5 * flux_error)
    return PsfBank(psfs, device, accuracy=accuracy), rule


def _checked_sources(
    xy_px: npt.ArrayLike, flux: npt.ArrayLike, movement_px: npt.ArrayLike | None, brightness: npt.ArrayLike | None
) -> tuple[F64, F64, F64, F64]:
    """Arguments of `deposit` that describe the sources, as arrays."""
    xy, strength = _numbers("xy_px", xy_px), _numbers("flux", flux)
    if xy.size == 0:
        xy = xy.reshape(-1, 2)
    if xy.ndim != 2 or xy.shape[1] != 2:
        raise InputError("must have shape (n, 2)", "xy_px", np.shape(xy_px))
    if strength.shape != (len(xy),):
        raise InputError(f"must have shape ({len(xy)},) like xy_px", "flux", np.shape(flux))
    moves = _coefficients("movement_px", movement_px, (len(xy), None, 2))
    changes = _coefficients("brightness", brightness, (len(xy), None))
    for name, values in (("xy_px", xy), ("flux", strength), ("movement_px", moves), ("brightness", changes)):
        if not np.isfinite(values).all():
            raise InputError(f"must be finite, got {np.count_nonzero(~np.isfinite(values))} bad values", name)
    if changes.size and not (changes[:, 0] == 1.0).all():
        raise InputError("the first coefficient, the mean, must be 1", "brightness")
    return xy, strength, moves, changes


def check_image(psf: Psf, shape: tuple[int, int], flux_error: float) -> None:
    """Check the arguments of `deposit` that describe the image."""
    if not isinstance(psf, Psf):
        raise InputError("must be a PsfGaussian, PsfAiry or PsfTable", "psf", psf)
    whole = isinstance(shape, tuple | list) and all(type(n) is int or isinstance(n, np.integer) for n in shape)
    if not whole or len(shape) != 2 or min(shape) < 1 or shape[0] * shape[1] >= 2**29:
        raise InputError("must be (n_row, n_col) of at least 1, and below 2**29 pixels", "shape", shape)
    if isinstance(flux_error, bool) or not isinstance(flux_error, int | float) or not 1e-9 <= flux_error < 1:
        raise InputError("must be in [1e-9, 1)", "flux_error", flux_error)


def _numbers(name: str, values: npt.ArrayLike) -> F64:
    """Values as an array of float64."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("must be an array of numbers", name, values, ".60") from None


def _coefficients(name: str, values: npt.ArrayLike | None, shape: tuple[int | None, ...]) -> F64:
    """Coefficients as an array of the shape, none where values is None."""
    if values is None:
        return np.zeros([0 if n is None else n for n in shape])
    array = _numbers(name, values)
    if array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
        expected = ", ".join("n_coefficient" if n is None else str(n) for n in shape)
        raise InputError(f"must have shape ({expected})", name, array.shape)
    return array


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

    A source with a flux of 0 has a gradient, too; `cotangent` are the derivatives of the number by the pixels, shape
    (n_row, n_col), taken as float32.

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
    return PointDrawing(*_bank_and_rule(psfs, wp.get_device(device), flux_error), shape, len(psfs))


def checked_lists(xy_shape: Sequence[int], light_shape: Sequence[int], n_band: int) -> None:
    """See that the sources of views have the shapes (n_view, n, 2) and (n_view, n_band, n); InputError otherwise."""
    if len(xy_shape) != 3 or xy_shape[2] != 2:
        raise InputError("must have shape (n_view, n, 2)", "xy_px", tuple(xy_shape))
    expected = (xy_shape[0], n_band, xy_shape[1])
    if tuple(light_shape) != expected:
        raise InputError(f"must have shape {expected}: views, bands, sources", "flux", tuple(light_shape))
