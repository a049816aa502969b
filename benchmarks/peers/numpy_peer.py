"""Plain NumPy: all stamps at once, added up with bincount."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from benchmarks.peers.tables import AIRY_HALF_PX, GAUSSIAN_HALF_PX, airy_table
from benchmarks.peers.work import SIGMA_PX, PeerWork

N_PHASE = 32
SOURCES_AT_ONCE = 2000
"""So that stamps of 31 x 31 pixels stay within 8 MB."""


class NumpyPeer:
    """Gaussians by error functions at pixel edges, Airy patterns by a table of 32 x 32 phases, bilinear."""

    n_thread = 1

    def __init__(self, work: PeerWork, n_thread: int | None = None) -> None:
        self._work = work
        self._rng = np.random.default_rng(5)
        self._stamps = self._gaussian if work.psf == "gaussian" else self._airy
        self._half_px = GAUSSIAN_HALF_PX if work.psf == "gaussian" else AIRY_HALF_PX

    def image_nei(self, frame: int) -> np.ndarray:
        """Noiseless image in units of the noise."""
        work = self._work
        image = np.zeros((work.n_pixel, work.n_pixel), np.float32)
        for first in range(0, len(work.x_px[frame]), SOURCES_AT_ONCE):
            part = slice(first, first + SOURCES_AT_ONCE)
            x_px, y_px, light = work.x_px[frame][part], work.y_px[frame][part], work.light_nei[frame][part]
            column, row = np.rint(x_px).astype(np.int64), np.rint(y_px).astype(np.int64)
            image += self._added_up(column, row, self._stamps(x_px - column, y_px - row, light))
        return image

    def counts(self, frame: int) -> np.ndarray:
        """Noise of the generator, then clipped."""
        image, detector = self.image_nei(frame), self._work.detector
        image += self._rng.standard_normal(image.shape, dtype=np.float32)
        image *= np.float32(detector.gain)
        image += np.float32(detector.offset + 0.5)
        np.clip(image, 0, detector.largest, out=image)
        return image.astype(np.uint16)

    def _gaussian(self, dx: np.ndarray, dy: np.ndarray, light: np.ndarray) -> np.ndarray:
        edges = np.arange(-GAUSSIAN_HALF_PX, GAUSSIAN_HALF_PX + 2) - 0.5
        across = np.diff(ndtr((edges - dx[:, None]) / SIGMA_PX), axis=1)
        down = np.diff(ndtr((edges - dy[:, None]) / SIGMA_PX), axis=1) * light[:, None]
        return down[:, :, None] * across[:, None, :]

    def _airy(self, dx: np.ndarray, dy: np.ndarray, light: np.ndarray) -> np.ndarray:
        table = airy_table(N_PHASE)
        x, y = (dx + 0.5) * N_PHASE, (dy + 0.5) * N_PHASE
        i, j = np.minimum(x.astype(np.int64), N_PHASE - 1), np.minimum(y.astype(np.int64), N_PHASE - 1)
        s, t = (x - i).astype(np.float32), (y - j).astype(np.float32)
        light = light.astype(np.float32)
        stamps = table[j, i] * ((1 - t) * (1 - s) * light)[:, None, None]
        stamps += table[j, i + 1] * ((1 - t) * s * light)[:, None, None]
        stamps += table[j + 1, i] * (t * (1 - s) * light)[:, None, None]
        stamps += table[j + 1, i + 1] * (t * s * light)[:, None, None]
        return stamps

    def _added_up(self, column: np.ndarray, row: np.ndarray, stamps: np.ndarray) -> np.ndarray:
        """Stamps about pixels, some of which lie beyond the edge, on one image with a border."""
        half, n_pixel = self._half_px, self._work.n_pixel
        inside = (abs(column - n_pixel // 2) <= n_pixel // 2 + half) & (abs(row - n_pixel // 2) <= n_pixel // 2 + half)
        column, row, stamps = column[inside], row[inside], stamps[inside]
        border = 2 * half
        side = n_pixel + 2 * border
        pixels = np.arange(2 * half + 1)
        offset = (pixels[:, None] * side + pixels).ravel()
        index = ((row - half + border) * side + column - half + border)[:, None] + offset
        image = np.bincount(index.ravel(), stamps.reshape(-1), minlength=side * side).reshape(side, side)
        return image[border : border + n_pixel, border : border + n_pixel].astype(np.float32)
