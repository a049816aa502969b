"""The camera: how directions become pixel coordinates.

Conventions: zero-based pixels with the centre on the integer, x = column, y = row. Camera axes: z = boresight into the
scene, x = right (columns grow), y = down (rows grow). The projection is gnomonic (TAN).
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from pydantic import field_validator, model_validator

from warpsim.describe import Count, Number, Positive, open_interval, part, part_error, rule_error
from warpsim.errors import InputError


@part
class Camera:
    """A pinhole camera with square pixels.

    Give the field of view, or focal length and pixel pitch.

    Args:
        n_row: Rows of the array.
        n_col: Columns of the array.
        fov_deg: Full field of view across the columns [deg].
        focal_length_m: Focal length [m].
        pixel_pitch_m: Distance between pixel centres [m].

    Raises:
        InputError: A value breaks its rule, or the field of view is given both ways or not at all.
    """

    n_row: Count
    n_col: Count
    fov_deg: Annotated[Number, open_interval(0, 120)] | None = None
    focal_length_m: Positive | None = None
    pixel_pitch_m: Positive | None = None

    @field_validator("fov_deg")
    @classmethod
    def _not_a_point(cls, value: float | None) -> float | None:
        if value is not None and value < 1e-6:
            raise rule_error("must be at least 1e-6")
        return value

    @model_validator(mode="after")
    def _one_way(self) -> Camera:
        by_lens = self.focal_length_m is not None and self.pixel_pitch_m is not None
        lens_given = self.focal_length_m is not None or self.pixel_pitch_m is not None
        if (self.fov_deg is None) == (not lens_given) or (lens_given and not by_lens):
            raise part_error("give either fov_deg, or focal_length_m and pixel_pitch_m")
        if self.n_row * self.n_col >= 2**29:
            raise part_error(f"n_row * n_col: must be below 2**29, got {self.n_row * self.n_col}")
        return self

    @property
    def focal_px(self) -> float:
        """Focal length in pixels: (n_col / 2) / tan(fov / 2)."""
        if self.fov_deg is not None:
            return 0.5 * self.n_col / math.tan(math.radians(self.fov_deg) / 2)
        assert self.focal_length_m is not None and self.pixel_pitch_m is not None  # by the validator
        return self.focal_length_m / self.pixel_pitch_m

    @property
    def centre_px(self) -> tuple[float, float]:
        """Where the boresight falls: (x, y) [px]."""
        return (self.n_col - 1) / 2, (self.n_row - 1) / 2

    def half_diagonal_rad(self, margin_px: float = 0.0) -> float:
        """Angle from the boresight to the far corner of the array, grown by margin_px on each side [rad]."""
        corner_px = math.hypot(self.n_col / 2 + margin_px, self.n_row / 2 + margin_px)
        return math.atan2(corner_px, self.focal_px)

    def frame_margin_deg(self, direction: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """How far directions are within the frame: angle from the nearest edge [deg], negative outside.

        The edges lie on great circles, and the frame is where a direction is on the inner side of all four: outside,
        the margin is that of the circle farthest away, and it is negative behind the camera too.

        Args:
            direction: Vectors in camera axes (x right, y down, z boresight), not 0, shape (..., 3).
        """
        x, y, z = np.moveaxis(np.asarray(direction, dtype=np.float64), -1, 0)
        length = np.maximum(np.sqrt(x * x + y * y + z * z), 1e-300)
        sines = []
        for across, n_pixel in ((x, self.n_col), (y, self.n_row)):
            half = math.atan2(n_pixel / 2, self.focal_px)
            sines.append((z * math.sin(half) - np.abs(across) * math.cos(half)) / length)
        margin_deg: npt.NDArray[np.float64] = np.degrees(np.arcsin(np.clip(np.minimum(*sines), -1.0, 1.0)))
        return margin_deg

    def project(
        self, direction_icrs: npt.ArrayLike, axes_icrs: npt.ArrayLike
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
        """Pixel coordinates of directions.

        Args:
            direction_icrs: Unit vectors, shape (n, 3).
            axes_icrs: Camera axes as rows x, y, z (unit vectors, ICRS axes), shape (3, 3).

        Returns:
            xy_px, shape (n, 2), NaN behind the camera; in_front, shape (n,), True where the direction has a positive
            component along the boresight.
        """
        direction = _finite_array("direction_icrs", direction_icrs, (None, 3))
        axes = _finite_array("axes_icrs", axes_icrs, (3, 3))
        seen = direction @ axes.T
        in_front = seen[:, 2] > 0
        scale = np.full(len(seen), np.nan)
        np.divide(self.focal_px, seen[:, 2], out=scale, where=in_front)
        return np.asarray(self.centre_px) + seen[:, :2] * scale[:, None], in_front


def _finite_array(name: str, value: Any, shape: tuple[int | None, ...]) -> npt.NDArray[np.float64]:
    array = np.asarray(value, dtype=np.float64)
    fits = array.ndim == len(shape) and all(want in (None, have) for want, have in zip(shape, array.shape, strict=True))
    if not fits:
        wanted = "(" + ", ".join("n" if n is None else str(n) for n in shape) + ")"
        raise InputError(f"{name}: must have shape {wanted}, got {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name}: must be finite, got {np.count_nonzero(~np.isfinite(array))} NaN or infinite values")
    return array
