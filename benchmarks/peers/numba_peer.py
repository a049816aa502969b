"""Numba, tuned: what a good engineer would write who knows where the sources are.

Sources are sorted by bands of rows, and bands are drawn in parallel, each by one thread: no atomics. A Gaussian is two
looks into a table of 1,024 phases, an Airy pattern one of 32 x 32 phases, bilinear. Everything is float32.
"""

from __future__ import annotations

import numpy as np
from numba import config, njit, prange, set_num_threads
from numpy import float32

from benchmarks.peers.numba_noise import read_out
from benchmarks.peers.tables import AIRY_HALF_PX, GAUSSIAN_HALF_PX, airy_table, gaussian_table
from benchmarks.peers.work import PeerWork

BAND_ROWS = 16
SIDE = 2 * GAUSSIAN_HALF_PX + 1


class NumbaPeer:
    """Sources, then noise, each by all threads."""

    def __init__(self, work: PeerWork, n_thread: int | None = None) -> None:
        self._work = work
        self.n_thread = n_thread or config.NUMBA_NUM_THREADS
        set_num_threads(self.n_thread)  # of all peers in the process
        n, n_pixel = work.n_source, work.n_pixel
        self._image = np.zeros((n_pixel, n_pixel), np.float32)
        self._column, self._row = np.empty(n, np.int64), np.empty(n, np.int64)
        self._across, self._down = np.empty((n, SIDE), np.float32), np.empty((n, SIDE), np.float32)
        self._table = gaussian_table() if work.psf == "gaussian" else airy_table()
        self._n_band = -(-n_pixel // BAND_ROWS)

    def image_nei(self, frame: int) -> np.ndarray:
        """Noiseless image in units of the noise; the same array every time."""
        work = self._work
        x_px, y_px, light = work.x_px[frame], work.y_px[frame], work.light_nei[frame]
        column, row = self._column[: len(x_px)], self._row[: len(x_px)]
        if work.psf == "gaussian":
            weigh(x_px, y_px, light, self._table, column, row, self._across, self._down)
            start, order = sort_by_band(row, work.n_pixel, self._n_band)
            draw_gaussians(self._image, column, row, self._across, self._down, start, order)
        else:
            column[:], row[:] = np.rint(x_px), np.rint(y_px)
            start, order = sort_by_band(row, work.n_pixel, self._n_band)
            draw_patterns(self._image, x_px, y_px, light, column, row, self._table, start, order)
        return self._image

    def counts(self, frame: int) -> np.ndarray:
        """A new array every time."""
        image, detector = self.image_nei(frame), self._work.detector
        counts = np.empty(image.shape, np.uint16)
        read_out(image, frame, detector.offset + 0.5, detector.gain, detector.largest, counts)
        return counts


@njit
def sort_by_band(row, n_pixel, n_band):
    """First source of each band of rows in the order of sources, and that order."""
    start = np.zeros(n_band + 1, np.int64)
    for source in range(row.size):
        start[min(max(row[source], 0), n_pixel - 1) // BAND_ROWS + 1] += 1
    for band in range(n_band):
        start[band + 1] += start[band]
    order, free = np.empty(row.size, np.int64), start[:-1].copy()
    for source in range(row.size):
        band = min(max(row[source], 0), n_pixel - 1) // BAND_ROWS
        order[free[band]] = source
        free[band] += 1
    return start, order


@njit(parallel=True, fastmath=True)
def weigh(x_px, y_px, light, table, column, row, across, down):
    """Nearest pixel of each source, and its fractions along both axes."""
    n_phase = table.shape[0] - 1
    for source in prange(x_px.size):
        i, j = int(np.rint(x_px[source])), int(np.rint(y_px[source]))
        column[source], row[source] = i, j
        x, y = (x_px[source] - i + 0.5) * n_phase, (y_px[source] - j + 0.5) * n_phase
        a, b = min(int(x), n_phase - 1), min(int(y), n_phase - 1)
        s, t, strength = float32(x - a), float32(y - b), float32(light[source])
        for k in range(SIDE):
            across[source, k] = table[a, k] + s * (table[a + 1, k] - table[a, k])
            down[source, k] = strength * (table[b, k] + t * (table[b + 1, k] - table[b, k]))


@njit(parallel=True, fastmath=True)
def draw_gaussians(image, column, row, across, down, start, order):
    """Each band takes the sources of its own rows and of the bands beside it."""
    n_pixel, n_band = image.shape[0], start.size - 1
    for band in prange(n_band):
        first, end = band * BAND_ROWS, min((band + 1) * BAND_ROWS, n_pixel)
        image[first:end] = float32(0)
        for near in range(max(band - 1, 0), min(band + 2, n_band)):
            for number in range(start[near], start[near + 1]):
                source = order[number]
                left, top = column[source] - GAUSSIAN_HALF_PX, row[source] - GAUSSIAN_HALF_PX
                whole = left >= 0 and left + SIDE <= n_pixel
                for r in range(max(top, first), min(top + SIDE, end)):
                    strength = down[source, r - top]
                    if whole:
                        for k in range(SIDE):
                            image[r, left + k] += strength * across[source, k]
                    else:
                        for k in range(max(0, -left), min(SIDE, n_pixel - left)):
                            image[r, left + k] += strength * across[source, k]


@njit(parallel=True, fastmath=True)
def draw_patterns(image, x_px, y_px, light, column, row, table, start, order):
    """Each band takes the sources whose stamps of 31 x 31 pixels reach it."""
    n_pixel, n_band = image.shape[0], start.size - 1
    n_phase, side = table.shape[0] - 1, table.shape[2]
    reach = (AIRY_HALF_PX + BAND_ROWS - 1) // BAND_ROWS
    for band in prange(n_band):
        first, end = band * BAND_ROWS, min((band + 1) * BAND_ROWS, n_pixel)
        image[first:end] = float32(0)
        for near in range(max(band - reach, 0), min(band + reach + 1, n_band)):
            for number in range(start[near], start[near + 1]):
                source = order[number]
                left, top = column[source] - AIRY_HALF_PX, row[source] - AIRY_HALF_PX
                top_seen, end_seen = max(top, first), min(top + side, end)
                if top_seen >= end_seen:
                    continue
                x, y = (x_px[source] - column[source] + 0.5) * n_phase, (y_px[source] - row[source] + 0.5) * n_phase
                a, b = min(int(x), n_phase - 1), min(int(y), n_phase - 1)
                s, t, strength = float32(x - a), float32(y - b), float32(light[source])
                w00 = strength * (float32(1) - t) * (float32(1) - s)
                w01 = strength * (float32(1) - t) * s
                w10 = strength * t * (float32(1) - s)
                w11 = strength * t * s
                k_first, k_end = max(0, -left), min(side, n_pixel - left)
                for r in range(top_seen, end_seen):
                    m = r - top
                    t00, t01 = table[b, a, m], table[b, a + 1, m]
                    t10, t11 = table[b + 1, a, m], table[b + 1, a + 1, m]
                    for k in range(k_first, k_end):
                        image[r, left + k] += w00 * t00[k] + w01 * t01[k] + w10 * t10[k] + w11 * t11[k]
