"""A function of the user's as a map of the sky."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.background.sky_plates import SkyPlate, sky_cube
from warpsim.config.fields import FUNCTION
from warpsim.errors import InputError
from warpsim.radiometry.band import Band

Array = NDArray[np.float64]

FUNCTION_NODES = 181
"""Nodes along an edge of the cube that a function is looked up on: 0.6 degrees apart."""


def function_plates(name: str, bands: list[Band]) -> list[SkyPlate]:
    """The faces of a cube, filled by a function of the user's."""
    try:
        module, attribute = name.removeprefix(FUNCTION).split(":")
        function: Any = importlib.import_module(module)
        for part in attribute.split("."):
            function = getattr(function, part)
    except (ImportError, AttributeError) as error:
        raise InputError(f"cannot be imported ({error})", "background.sky_map", name) from None

    def radiance_of(direction: Array) -> Array:
        found = []
        for band in bands:
            values = np.asarray(function(direction, band), dtype=np.float64)
            if values.shape != (len(direction),) or not np.isfinite(values).all() or (values < 0.0).any():
                rule = f"must return {len(direction):,} radiances of 0 or more for as many directions, got shape"
                raise InputError(f"{rule} {values.shape}", "background.sky_map", name)
            found.append(values)
        return np.stack(found)

    return sky_cube(radiance_of, FUNCTION_NODES)
