"""Star index: cells and latitude bands (the paper's 360 x 180 table), built on the host, queried on the device.

Below 60 degrees latitude the sky is cut into cells of one degree by one degree; above, each one-degree latitude band
is a single cell. Stars are stored sorted by cell, and by right ascension within a band, so that a cone on the sky is a
handful of runs of stars.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.band_index import N_BAND, N_COLUMN, POLAR_LATITUDE_DEG, make_query_cone_kernel

from warpsim.errors import InputError
from warpsim.launches import to_numpy
from warpsim.sky.catalog import StarCatalog


class BandIndex:
    """Index over the directions of a star catalog.

    Args:
        catalog: The stars; directions at the catalog's epoch are indexed.
        device: Where queries run; the CPU when left out.
        dtype: float64, or float32 to halve the memory: directions are then rounded by up to 0.01 arcsec, and queries
            are exact for the rounded ones.

    Attributes:
        catalog: The catalog.
        cell_start: First star of each cell in cell order, shape (180 * 360 + 1,), int32.
        star_row: Catalog row of each star in cell order, shape (n_star,), int64.
        direction_icrs: Directions in cell order, shape (n_star, 3), of that dtype.

    Raises:
        InputError: dtype is neither.
    """

    def __init__(self, catalog: StarCatalog, device: Any = None, dtype: npt.DTypeLike = np.float64) -> None:
        if np.dtype(dtype) not in (np.float64, np.float32):
            raise InputError("must be float64 or float32", "dtype", str(np.dtype(dtype)), "s")
        self.catalog = catalog
        stored = np.asarray(catalog.direction_icrs).reshape(-1, 3).astype(dtype, copy=False)
        direction = stored.astype(np.float64, copy=False)
        if stored.dtype == np.float32:  # no longer of unit length; queries make it so, and cells must agree with them
            direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        cell = cell_of(direction)
        # Of 16 bits, as NumPy sorts such keys by their digits, in a fraction of the time.
        self.star_row = np.lexsort((compass(direction), cell.astype(np.uint16))).astype(np.int64)
        self.direction_icrs = stored[self.star_row]
        counts = np.bincount(cell, minlength=N_BAND * N_COLUMN)
        self.cell_start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        self.device = wp.get_device("cpu" if device is None else device)
        self.cell_start_array = wp.array(self.cell_start, dtype=wp.int32, device=self.device)
        vector = wp.vec3d if stored.dtype == np.float64 else wp.vec3f
        self.direction_array = wp.array(self.direction_icrs, dtype=vector, device=self.device)
        self._vector = vector

    @cached_property
    def _query_kernel(self) -> wp.Kernel:
        """Made when asked for: images need it not, and making a kernel takes ten milliseconds."""
        return make_query_cone_kernel(self._vector)

    def __len__(self) -> int:
        return len(self.star_row)

    def query(self, direction_icrs: npt.ArrayLike, radius_rad: float) -> npt.NDArray[np.int64]:
        """Rows of the catalog whose direction lies within a cone, exactly.

        Args:
            direction_icrs: Axis of the cone, shape (3,); need not be of unit length.
            radius_rad: Half-angle [rad], 0 to pi; stars on the border belong to the cone.

        Returns:
            Sorted row numbers.

        Raises:
            InputError: A zero or non-finite direction, or a radius outside 0 to pi.
        """
        start, rows = self.query_many(np.reshape(direction_icrs, (1, -1)), np.ravel(radius_rad))
        return np.asarray(rows[start[0] : start[1]])

    def query_many(
        self, direction_icrs: npt.ArrayLike, radius_rad: npt.ArrayLike
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Query many cones at once.

        Args:
            direction_icrs: Axes of the cones, shape (n, 3).
            radius_rad: Half-angles [rad], shape (n,).

        Returns:
            start, shape (n + 1,), and rows: those of cone i are rows[start[i]:start[i + 1]], sorted.
        """
        axis, radius = _checked_cones(direction_icrs, radius_rad)
        n = len(axis)
        cones = wp.array(axis, dtype=wp.vec3d, device=self.device)
        radii = wp.array(radius, dtype=wp.float64, device=self.device)
        n_found = wp.zeros(n, dtype=wp.int32, device=self.device)
        start = np.zeros(n + 1, dtype=np.int64)
        found = wp.empty(0, dtype=wp.int32, device=self.device)
        # First pass counts, second pass writes each list where it belongs: the order never depends on the device.
        for _ in range(2):
            begin = wp.array(start[:-1], dtype=wp.int64, device=self.device)
            inputs = [self.cell_start_array, self.direction_array, cones, radii, begin]
            wp.launch(self._query_kernel, dim=n, inputs=inputs, outputs=[n_found, found], device=self.device)
            start[1:] = np.cumsum(to_numpy(n_found))
            if start[-1] == 0:
                break
            if found.shape[0] == 0:
                found = wp.empty(int(start[-1]), dtype=wp.int32, device=self.device)
        rows = self.star_row[to_numpy(found)]
        # One sort of cone and row in one number: three times as fast as sorting by two keys.
        list_start = np.repeat(np.arange(n, dtype=np.int64) * len(self), np.diff(start))
        key = np.sort(list_start + rows)
        return start, key - list_start


def cell_of(direction: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Cell number of unit vectors, shape (n,): 360 * latitude band + column; polar bands use column 0."""
    latitude_deg = np.degrees(np.arcsin(np.clip(direction[:, 2], -1, 1)))
    longitude_deg = np.degrees(np.arctan2(direction[:, 1], direction[:, 0]))
    band = np.clip(np.floor(latitude_deg + 90), 0, N_BAND - 1).astype(np.int64)
    column = np.floor(longitude_deg).astype(np.int64) % N_COLUMN
    polar = (band < 90 - POLAR_LATITUDE_DEG) | (band >= 90 + POLAR_LATITUDE_DEG)
    return np.asarray(band * N_COLUMN + np.where(polar, 0, column), dtype=np.int64)


def compass(direction: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """A number in [0, 4] that grows with right ascension, shape (n,); the kernels' `compass`, bit for bit."""
    x, y = direction[:, 0], direction[:, 1]
    total = np.abs(x) + np.abs(y)
    total[total == 0] = 1.0
    return np.select(
        [(y >= 0) & (x >= 0), y >= 0, x < 0], [y / total, 1.0 - x / total, 2.0 - y / total], 3.0 + x / total
    )


def _checked_cones(
    direction_icrs: npt.ArrayLike, radius_rad: npt.ArrayLike
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    axis = np.asarray(direction_icrs, dtype=np.float64)
    radius = np.asarray(radius_rad, dtype=np.float64)
    if axis.ndim != 2 or axis.shape[1] != 3:
        raise InputError("must have shape (3,) or (n, 3)", "direction_icrs", np.shape(direction_icrs))
    if radius.shape != (len(axis),):
        raise InputError(f"must have shape ({len(axis)},)", "radius_rad", radius.shape)
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    if not (np.isfinite(length).all() and (length > 0).all()):
        raise InputError("must be finite and not zero", "direction_icrs")
    if not ((radius >= 0) & (radius <= np.pi)).all():
        raise InputError("must be in [0, pi]", "radius_rad", radius[~((radius >= 0) & (radius <= np.pi))][0])
    # A unit vector stays as it is: dividing by a length of 1 - 1e-16 would move it off a star in the same direction.
    length[np.abs(length - 1) < 1e-15] = 1
    return axis / length, radius
