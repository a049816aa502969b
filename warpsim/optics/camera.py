"""The camera: how directions become pixel coordinates.

Conventions: zero-based pixels with the centre on the integer, x = column, y = row. Camera axes: z = boresight into the
scene, x = right (columns grow), y = down (rows grow). The projection is gnomonic (TAN), after the lens distortion where
there is one.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from pydantic import field_validator, model_validator

from warpsim.arrays import F64
from warpsim.config.fields import Count, Number, Positive, closed_interval, open_interval, rule_error
from warpsim.config.model import config_model
from warpsim.errors import InputError
from warpsim.optics.distortion import Distortion, checked_radius, distorted, undistorted

_BORDER_STEPS = 256
_BULGE = 1e-3
"""More than a distorted border can reach beyond its points so many steps apart, relative to its size."""


@config_model
class Camera:
    """A pinhole camera, with a lens distortion or without.

    Give the field of view, or focal length and pixel pitch.

    Args:
        n_row: Rows of the array.
        n_col: Columns of the array.
        fov_deg: Full field of view across the columns, before distortion [deg].
        focal_length_m: Focal length [m].
        pixel_pitch_m: Distance between the centres of neighbouring columns, the width of a pixel [m].
        pixel_aspect: Height of a pixel over its width.
        distortion: Of the lens; none when left out.

    Raises:
        InputError: A value breaks its rule, the field of view is given both ways or not at all, or the distortion is
            not one-to-one over the array.
    """

    n_row: Count
    n_col: Count
    fov_deg: Annotated[Number, open_interval(0, 120)] | None = None
    focal_length_m: Positive | None = None
    pixel_pitch_m: Positive | None = None
    pixel_aspect: Annotated[Number, closed_interval(0.1, 10)] = 1.0
    distortion: Distortion | None = None

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
            raise InputError("give either fov_deg, or focal_length_m and pixel_pitch_m")
        if by_lens:
            width_deg = 2.0 * math.degrees(math.atan(0.5 * self.n_col / self.focal_px))
            if not 1e-6 <= width_deg < 120.0:
                hint = "; are these um?" if width_deg >= 120.0 else ""
                rule = f"gives a field of view of {width_deg:.3g} deg, which must be in [1e-6, 120){hint}"
                raise InputError(rule, "pixel_pitch_m", self.pixel_pitch_m, "g")
        if self.n_row * self.n_col >= 2**29:
            raise InputError("must be below 2**29", value=self.n_row * self.n_col).of("n_row * n_col")
        if self.lens is not None:
            _, wrong = checked_radius(self.lens, *self._half_size)
            if wrong:
                rule = f"must be one-to-one until it fills the array and a tenth beyond, {wrong}"
                raise InputError(rule, "distortion")
        return self

    @property
    def focal_px(self) -> float:
        """Focal length in widths of a pixel: (n_col / 2) / tan(fov / 2)."""
        if self.fov_deg is not None:
            return 0.5 * self.n_col / math.tan(math.radians(self.fov_deg) / 2)
        assert self.focal_length_m is not None and self.pixel_pitch_m is not None  # by the validator
        return self.focal_length_m / self.pixel_pitch_m

    @property
    def focal_row_px(self) -> float:
        """Focal length in heights of a pixel."""
        return self.focal_px / self.pixel_aspect

    @property
    def centre_px(self) -> tuple[float, float]:
        """Position of the boresight on the array: (x, y) [px]."""
        return (self.n_col - 1) / 2, (self.n_row - 1) / 2

    @property
    def lens(self) -> Distortion | None:
        """The distortion, None where it changes nothing."""
        return None if self.distortion is None or self.distortion.is_off else self.distortion

    @property
    def distortion_radius(self) -> float:
        """Tangent of the angle from the boresight out to which the distortion's formula holds; infinite without one.

        Beyond, the distortion goes on in proportion along each ray.
        """
        return math.inf if self.lens is None else checked_radius(self.lens, *self._half_size)[0]

    @property
    def field_deg(self) -> tuple[float, float]:
        """Field of view across the columns and across the rows, through the centre, distortion included [deg]."""
        (x, y), half_x, half_y = self.centre_px, self.n_col / 2, self.n_row / 2
        left, right, top, bottom = self.direction([[x - half_x, y], [x + half_x, y], [x, y - half_y], [x, y + half_y]])
        across, down = (math.atan2(np.linalg.norm(np.cross(a, b)), a @ b) for a, b in ((left, right), (top, bottom)))
        return math.degrees(across), math.degrees(down)

    @property
    def sample_points(self) -> F64:
        """Unit directions, in camera axes, of the array's corners, the middles of its edges and its centre, (9, 3)."""
        x, y = self.centre_px
        steps = (-0.5, 0.0, 0.5)
        return self.direction([[x + i * self.n_col, y + j * self.n_row] for i in steps for j in steps])

    @property
    def _focal(self) -> F64:
        return np.array([self.focal_px, self.focal_row_px])

    @property
    def _half_size(self) -> tuple[float, float]:
        """Half the array on the tangent plane, (x, y)."""
        return self.n_col / 2 / self.focal_px, self.n_row / 2 / self.focal_row_px

    def half_diagonal_rad(self, margin_px: float = 0.0) -> float:
        """Largest angle from the boresight on the array, grown by margin_px on each side [rad].

        With a distortion it may be up to 1e-3 of itself too large, never too small.
        """
        if self.lens is None:
            half = np.array([self.n_col / 2 + margin_px, self.n_row / 2 + margin_px]) / self._focal
            return math.atan(math.hypot(*half))
        border = _border(self.n_col / 2 + margin_px, self.n_row / 2 + margin_px) + self.centre_px
        return math.atan((1 + _BULGE) * float(np.linalg.norm(self._tangent(border), axis=1).max()))

    def frame_margin_deg(self, direction: npt.ArrayLike) -> F64:
        """Angle of directions from the nearest edge of the frame [deg], positive within, negative outside.

        The edges lie on great circles, and the frame is where a direction is on the inner side of all four: outside,
        the margin is that of the circle farthest away, and it is negative behind the camera too. With a distortion it
        is the angle that a pinhole would see between the same positions of the image.

        Args:
            direction: Vectors in camera axes (x right, y down, z boresight), not 0, shape (..., 3).
        """
        x, y, z = np.moveaxis(self._through_lens(np.asarray(direction, dtype=np.float64)), -1, 0)
        length = np.maximum(np.sqrt(x * x + y * y + z * z), 1e-300)
        sines = []
        for across, half_size in zip((x, y), self._half_size, strict=True):
            half = math.atan(half_size)
            sines.append((z * math.sin(half) - np.abs(across) * math.cos(half)) / length)
        margin_deg: F64 = np.degrees(np.arcsin(np.clip(np.minimum(*sines), -1.0, 1.0)))
        return margin_deg

    def project(self, direction_icrs: npt.ArrayLike, axes_icrs: npt.ArrayLike) -> tuple[F64, npt.NDArray[np.bool_]]:
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
        seen = self._through_lens(direction @ axes.T)
        in_front = seen[:, 2] > 0
        tangent = np.full((len(seen), 2), np.nan)
        np.divide(seen[:, :2], seen[:, 2:], out=tangent, where=in_front[:, None])
        return np.asarray(self.centre_px) + tangent * self._focal, in_front

    def direction(self, xy_px: npt.ArrayLike, axes_icrs: npt.ArrayLike | None = None) -> F64:
        """Directions of pixel coordinates, on the array or beside it: the inverse of project.

        Args:
            xy_px: Pixel coordinates, shape (n, 2).
            axes_icrs: Camera axes as rows x, y, z (unit vectors, ICRS axes), shape (3, 3); those of the camera itself
                when left out.

        Returns:
            Unit vectors, shape (n, 3).
        """
        xy = _finite_array("xy_px", xy_px, (None, 2))
        axes = np.eye(3) if axes_icrs is None else _finite_array("axes_icrs", axes_icrs, (3, 3))
        seen = np.concatenate([self._tangent(xy), np.ones((len(xy), 1))], axis=1)
        return np.asarray(seen / np.linalg.norm(seen, axis=1, keepdims=True) @ axes)

    def _through_lens(self, seen: F64) -> F64:
        """Vectors in camera axes, as a pinhole would have to see them."""
        return seen if self.lens is None else distorted(self.lens, self.distortion_radius, seen)

    def _tangent(self, xy_px: F64) -> F64:
        """Tangent-plane coordinates of what is seen at positions of the image, shape (n, 2)."""
        position = (xy_px - self.centre_px) / self._focal
        return position if self.lens is None else undistorted(self.lens, self.distortion_radius, position)


def _border(half_x: float, half_y: float) -> F64:
    """Points of a rectangle about 0, its corners among them, shape (n, 2)."""
    along = np.linspace(-1.0, 1.0, _BORDER_STEPS + 1)
    side = np.ones_like(along)
    points = [np.stack(pair, axis=-1) for sign in (-side, side) for pair in ((along, sign), (sign, along))]
    return np.asarray(np.concatenate(points) * [half_x, half_y])


def _finite_array(name: str, value: Any, shape: tuple[int | None, ...]) -> npt.NDArray[np.float64]:
    array = np.asarray(value, dtype=np.float64)
    fits = array.ndim == len(shape) and all(
        length in (None, have) for length, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        expected = "(" + ", ".join("n" if n is None else str(n) for n in shape) + ")"
        raise InputError(f"must have shape {expected}", name, array.shape)
    if not np.isfinite(array).all():
        raise InputError(f"must be finite, got {np.count_nonzero(~np.isfinite(array))} NaN or infinite values", name)
    return array
