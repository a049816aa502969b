"""Detections of one image, before directions are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ImageRows:
    """Detections of one image."""

    frame: int
    sensor: str
    band: str
    xy_px: F64
    """(n, 2)."""
    irradiance_w_cm2: F64
    """(n,)."""
    sigma: F64
    """Of x, y [px] and irradiance [W/cm2], (n, 3)."""
    target: list[str]
    """Name of the target, "" for none, (n,)."""
    clump_id: npt.NDArray[np.int64]
    """Clump of the truth, -1 for none, (n,)."""
    n_merged: npt.NDArray[np.int64]
    """Targets in the clump, 0 for none, (n,)."""
    poor_fit: npt.NDArray[np.bool_]
    """Of one source in pixels: it does not explain them, or two would as well, (n,)."""
