"""Frames per second, measured the way the paper's Table 7 counts them."""

from __future__ import annotations

import statistics
import time
from typing import Any

from warpsim.render.renderer import Renderer
from warpsim.scene.scene import Scene

PAPER_FPS = {128: 607, 256: 305, 512: 88, 1024: 32}
"""The paper's Table 7: frames per second by pixels on a side."""


def speed_scene(n_pixel: int, psf: str = "airy") -> Scene:
    """Stss with n_pixel x n_pixel arrays and frames 10 ms apart, so that many frames lie within one access."""
    return Scene.load("stss").replace(
        camera__n_row=n_pixel,
        camera__n_col=n_pixel,
        optics__psf=psf,
        frames={"count": 100_000, "interval_s": 0.01, "start_s": 600.0},
    )


def frames_per_call(n_pixel: int) -> int:
    """Frames rendered at once: 16 Mpixel, but no more than 1024."""
    return min(1024, max(16, 2**24 // n_pixel**2))


def measure_fps(n_pixel: int, device: Any = None, psf: str = "airy", n_round: int = 7) -> float:
    """Median frames per second of one sensor and one band, counts in host memory.

    Args:
        n_pixel: Rows and columns.
        device: Warp device.
        psf: "airy" or "gaussian".
        n_round: Timed calls; each renders different frames.
    """
    renderer = Renderer(speed_scene(n_pixel, psf), device)
    sensor = renderer.sensors_with_access[0]
    n_frame = frames_per_call(n_pixel)
    seconds = []
    for number in range(n_round + 1):
        first = number * n_frame
        begin = time.perf_counter()
        renderer.render(range(first, first + n_frame), sensors=[sensor], bands=["A"]).counts.numpy()
        seconds.append(time.perf_counter() - begin)
    return n_frame / statistics.median(seconds[1:])  # the first call compiles
