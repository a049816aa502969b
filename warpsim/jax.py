"""Images of point sources in JAX (extra `jax`), differentiable by their sources."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from warpsim.arguments import optional_module
from warpsim.launches import to_numpy
from warpsim.optics.psf import Psf
from warpsim.render.deposit import PointDrawing, checked_lists, point_drawing
from warpsim.render.point_images import PointImages

if TYPE_CHECKING:
    from jax import Array


def render(
    xy_px: Array, flux: Array, psf: Psf | Sequence[Psf], shape: tuple[int, int], flux_error: float = 1e-6
) -> Array:
    """Draw point sources, as `ws.deposit` does; gradients flow to positions and flux (reverse mode).

    Memory is shared, not copied, where positions are float64 (`jax_enable_x64`) and flux is float32. Within `jax.jit`,
    and under `jax.vmap`, the host draws: as a callback, which copies between GPU and host.

    Args:
        xy_px: Positions [px], shape (n_view, n, 2); the same in all bands. float32 is good to 3e-5 px at 1024 px.
        flux: Flux in any unit, shape (n_view, n_band, n).
        psf: Point spread function of each band, all of one family; one serves for one band.
        shape: (n_row, n_col).
        flux_error: As in `ws.deposit`.

    Returns:
        Images, float32, shape (n_view, n_band, n_row, n_col).

    Raises:
        InputError: JAX is not installed, or a value breaks its rule.
    """
    jax = optional_module("jax", "JAX")
    wp.init()
    xy, light = jax.numpy.asarray(xy_px), jax.numpy.asarray(flux)
    device = "cpu"
    if not isinstance(xy, jax.core.Tracer) and next(iter(xy.devices())).platform == "gpu":
        device = str(wp.device_from_jax(next(iter(xy.devices()))))
    drawing = point_drawing(psf, shape, device, flux_error)
    checked_lists(xy.shape, light.shape, drawing.n_band)
    return _function(drawing)(xy, light)


@functools.lru_cache(maxsize=64)
def _function(drawing: PointDrawing) -> Any:
    """The function with its own derivative."""
    jax = optional_module("jax", "JAX")

    def call(function: Any, result: Any, *arrays: Any) -> Any:
        """Call a function of Warp arrays: now, or, of what is traced, when it runs."""
        if not any(isinstance(array, jax.core.Tracer) for array in arrays):
            found = function(*(wp.from_dlpack(array) for array in arrays))
            return jax.dlpack.from_dlpack(_cast(found, wp.dtype_from_numpy(result.dtype)))

        def on_host(*values: Any) -> Any:
            here = [wp.array(np.ascontiguousarray(value), device="cpu", copy=False) for value in values]
            return to_numpy(function(*here)).astype(result.dtype)

        return jax.pure_callback(on_host, result, *arrays, vmap_method="sequential")

    def images(xy: wp.array, light: wp.array) -> PointImages:
        positions = _cast(xy, wp.float64)
        return drawing.images(_view(positions, wp.vec2d, xy.shape[:2]), _cast(light, wp.float32))

    def draw(xy: wp.array, light: wp.array) -> wp.array:
        return images(xy, light).draw()

    def gather(xy: wp.array, light: wp.array, cotangent: wp.array) -> wp.array:
        found = images(xy, light).gather(_cast(cotangent, wp.float32))[0]
        return _view(found, wp.float64, (*found.shape, 4))

    @jax.custom_vjp  # type: ignore[untyped-decorator]
    def drawn(xy: Any, light: Any) -> Any:
        result = jax.ShapeDtypeStruct((*light.shape[:2], *drawing.shape), np.float32)
        return call(draw, result, xy, light)

    def backward(saved: Any, cotangent: Any) -> Any:
        xy, light = saved
        result = jax.ShapeDtypeStruct((*light.shape, 4), jax.dtypes.canonicalize_dtype(np.float64))
        found = call(gather, result, xy, light, cotangent)
        return found[..., 1:3].sum(axis=1).astype(xy.dtype), found[..., 0].astype(light.dtype)

    drawn.defvjp(lambda xy, light: (drawn(xy, light), (xy, light)), backward)
    return drawn


def _cast(array: wp.array, dtype: Any) -> wp.array:
    """An array in another type; itself where it has that already."""
    if array.dtype == dtype:
        return array
    other = wp.empty(array.shape, dtype=dtype, device=array.device)
    wp.utils.array_cast(in_array=array, out_array=other)
    return other


def _view(array: wp.array, dtype: Any, shape: Sequence[int]) -> wp.array:
    """The same memory with another type and shape."""
    keep = {"device": array.device, "deleter": lambda address, size: array.ptr}
    return wp.array(ptr=array.ptr, dtype=dtype, shape=tuple(shape), **keep)
