"""Point sources onto one image, without a scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.errors import InputError
from warpsim.launches import to_numpy
from warpsim.optics.psf import Psf
from warpsim.optics.psf_bank import PsfBank, paths_struct, stamp_rule
from warpsim.optics.tables import ERROR_RANGE, TableAccuracy
from warpsim.render.device import default_device
from warpsim.render.point_images import PointImages

F64 = npt.NDArray[np.float64]


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
    rule = stamp_rule([0.0], flux_error, where, 0.5 * flux_error)
    paths = None
    if movement_px is not None or brightness is not None:
        offset_px = wp.array(moves[None], dtype=wp.vec2, device=where)
        paths = paths_struct(offset_px, wp.array(changes[None, None], dtype=wp.float32, device=where), len(changes))
    accuracy = TableAccuracy(float(np.clip(0.5 * flux_error, *ERROR_RANGE)))
    bank = PsfBank([psf], where, accuracy=accuracy)
    return PointImages(bank, sources, rule, (int(shape[0]), int(shape[1])), paths), scale


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
