"""Images of point sources in PyTorch (extra `torch`), differentiable by their sources."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import warp as wp

from warpsim.arguments import optional_module
from warpsim.errors import InputError
from warpsim.optics.psf import Psf
from warpsim.render.deposit import PointDrawing, checked_lists, point_drawing

if TYPE_CHECKING:
    from torch import Tensor


def render(
    xy_px: Tensor, flux: Tensor, psf: Psf | Sequence[Psf], shape: tuple[int, int], flux_error: float = 1e-6
) -> Tensor:
    """Draw point sources, as `ws.deposit` does, on the device of the tensors; gradients flow to positions and flux.

    Memory is shared, not copied, where positions are float64, flux float32, and both contiguous. Gradients are those of
    `ws.deposit_gradient`, in the types of the tensors; there are none of second order.

    Args:
        xy_px: Positions [px], shape (n_view, n, 2); the same in all bands.
        flux: Flux in any unit, shape (n_view, n_band, n).
        psf: Point spread function of each band, all of one family; one serves for one band.
        shape: (n_row, n_col).
        flux_error: As in `ws.deposit`.

    Returns:
        Images, float32, shape (n_view, n_band, n_row, n_col).

    Raises:
        InputError: PyTorch is not installed, a value breaks its rule, tensors are on different devices.
    """
    torch = optional_module("torch", "PyTorch")
    for name, value in (("xy_px", xy_px), ("flux", flux)):
        if not isinstance(value, torch.Tensor):
            raise InputError(f"must be a tensor, got {type(value).__name__}", name)
    if xy_px.device != flux.device:
        raise InputError(f"must be on the device of xy_px, {xy_px.device}", "flux", str(flux.device), "s")
    drawing = point_drawing(psf, shape, wp.device_from_torch(xy_px.device), flux_error)
    checked_lists(xy_px.shape, flux.shape, drawing.n_band)
    return _function().apply(xy_px, flux, drawing)


@functools.cache
def _function() -> Any:
    """The autograd function."""
    torch = optional_module("torch", "PyTorch")

    def sources(xy_px: Any, flux: Any, drawing: PointDrawing) -> Any:
        xy = wp.from_torch(xy_px.detach().to(torch.float64).contiguous(), dtype=wp.vec2d)
        return drawing.images(xy, wp.from_torch(flux.detach().to(torch.float32).contiguous()))

    class Render(torch.autograd.Function):  # type: ignore[misc, name-defined]
        @staticmethod
        def forward(ctx: Any, xy_px: Any, flux: Any, drawing: PointDrawing) -> Any:
            ctx.save_for_backward(xy_px, flux)
            ctx.drawing = drawing
            with _on_stream_of(xy_px):
                return wp.to_torch(sources(xy_px, flux, drawing).draw(), requires_grad=False)

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
        def backward(ctx: Any, cotangent: Any) -> tuple[Any, Any, None]:
            xy_px, flux = ctx.saved_tensors
            with _on_stream_of(xy_px):
                values = wp.from_torch(cotangent.to(torch.float32).contiguous())
                found = wp.to_torch(sources(xy_px, flux, ctx.drawing).gather(values)[0], requires_grad=False)
            by_xy = found[..., 1:3].sum(dim=1)
            return by_xy.to(xy_px.dtype), found[..., 0].to(flux.dtype), None

    return Render


def _on_stream_of(tensor: Any) -> Any:
    """Launch on PyTorch's current stream, so that neither waits for the other; on the CPU there are none."""
    if tensor.device.type != "cuda":
        return wp.ScopedDevice("cpu")
    return wp.ScopedStream(wp.stream_from_torch(tensor.device))
