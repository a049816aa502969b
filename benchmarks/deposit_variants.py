"""Other ways to add up the light of sources, to compare with the product's: same stamps, other sums.

The product gathers: a thread owns rows of an image and adds sources in the order of their list, in float32. Here each
thread owns a source and scatters its stamp: by float32 atomics, whose order (and last bits) is the hardware's on a GPU;
by atomics on whole numbers, which any order leaves alike; by float64 atomics, whose order shows far less.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.psf import gaussian_pixel_share
from warpsim_kernels.stamps import nearest_pixel

HALF_WIDTH_PX = wp.constant(3)
WIDTH_PX = 7
Columns = wp.types.vector(length=WIDTH_PX, dtype=wp.float32)
FIXED_POINT_SCALE = 2.0**40
"""Units of a fixed-point sum in a unit of light: 9e-13 of it each, and room for 8 million."""


@functools.cache
def make_scatter_kernel(dtype: Any, scale: float) -> wp.Kernel:
    """Kernel that adds Gaussian stamps of 7 x 7 pixels by atomics, one thread per source."""

    @wp.kernel(module="unique", enable_backward=False)
    def scatter_kernel(
        # in
        xy_px: wp.array[wp.vec2d],  # (n_source,)
        strength: wp.array[float],  # (n_source,)
        sigma_px: float,
        # out (accumulated)
        image: wp.array2d[dtype],  # (n_row, n_col)
    ):
        source = wp.tid()
        place = xy_px[source]
        first_column = nearest_pixel(place[0]) - HALF_WIDTH_PX
        first_row = nearest_pixel(place[1]) - HALF_WIDTH_PX
        share = Columns()
        for i in range(wp.static(WIDTH_PX)):
            share[i] = gaussian_pixel_share(wp.float64(first_column + i) - place[0], sigma_px)
        for j in range(wp.static(WIDTH_PX)):
            y = first_row + j
            line = strength[source] * gaussian_pixel_share(wp.float64(y) - place[1], sigma_px)
            if y >= 0 and y < image.shape[0]:
                for i in range(wp.static(WIDTH_PX)):
                    x = first_column + i
                    if x >= 0 and x < image.shape[1]:
                        if wp.static(scale == 1.0):
                            wp.atomic_add(image, y, x, dtype(line * share[i]))
                        else:
                            units = wp.float64(line * share[i]) * wp.float64(wp.static(scale)) + wp.float64(0.5)
                            wp.atomic_add(image, y, x, dtype(wp.floor(units)))

    return scatter_kernel


VARIANTS: dict[str, tuple[Any, float]] = {
    "scattered, float32 atomics": (wp.float32, 1.0),
    "scattered, float64 atomics": (wp.float64, 1.0),
    "scattered, 64-bit fixed point": (wp.int64, FIXED_POINT_SCALE),
}


class Scatter:
    """Sources ready to be scattered."""

    def __init__(self, name: str, xy_px: Any, strength: Any, sigma_px: float, n_pixel: int, device: Any) -> None:
        dtype, self.scale = VARIANTS[name]
        self.kernel = make_scatter_kernel(dtype, self.scale)
        self.image = wp.zeros((n_pixel, n_pixel), dtype=dtype, device=device)
        self.inputs = [
            wp.array(xy_px, dtype=wp.vec2d, device=device),
            wp.array(strength, dtype=wp.float32, device=device),
            sigma_px,
        ]

    def draw(self) -> None:
        """Draw all sources into a new image."""
        self.image.zero_()
        wp.launch(self.kernel, self.inputs[0].shape[0], self.inputs, [self.image], device=self.image.device)

    def image_f64(self) -> Any:
        """The image in units of light."""
        return self.image.numpy().astype(np.float64) / self.scale
