"""A function of the user's as a map of the sky."""

from __future__ import annotations

import hashlib
import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.background.map_units import LARGEST
from warpsim.background.sky_plates import SkyPlate, sky_cube
from warpsim.config.fields import FUNCTION
from warpsim.errors import InputError, one_line
from warpsim.radiometry.band import Band

Array = NDArray[np.float64]

FUNCTION_NODES = 181
"""Nodes along an edge of the cube that a function is looked up on: 0.6 degrees apart."""


def function_plates(name: str, bands: list[Band]) -> list[SkyPlate]:
    """The faces of a cube, filled by a function of the user's.

    Raises:
        InputError: No such function, or what it does or returns is not what a map needs.
    """
    function = _imported(name)

    def radiance_of(direction: Array) -> Array:
        return np.stack([_asked(function, name, direction, band) for band in bands])

    return sky_cube(radiance_of, FUNCTION_NODES)


def function_checksum(name: str, bands: list[Band]) -> str:
    """SHA-256 of a function's radiances on its plates, as images hold them: it changes with whatever changes these."""
    found = hashlib.sha256()
    for plate in function_plates(name, bands):
        found.update(plate.radiance_w_cm2_sr.astype("<f4").tobytes())
    return found.hexdigest()


def _imported(name: str) -> Callable[..., Any]:
    module, _, attribute = name.removeprefix(FUNCTION).partition(":")
    if ":" in attribute or not all((*module.split("."), *attribute.split("."))):
        raise _error('must be of the form "python:module:function", with the whole name of a module', name)
    try:
        found: Any = importlib.import_module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
    except (Exception, SystemExit) as error:  # a module of the user's may do anything
        raise _error(f"cannot be imported ({_said(error)})", name) from None
    if not callable(found):
        raise _error(f"must be a function, but is of type {type(found).__name__}", name)
    return found  # type: ignore[no-any-return]


def _asked(function: Callable[..., Any], name: str, direction: Array, band: Band) -> Array:
    """A function's radiances in directions, (n,)."""
    try:
        returned = function(direction.copy(), band)
        found = np.asarray(returned)
    except (Exception, SystemExit) as error:  # as above
        raise _error(f"fails in band {band.name} ({_said(error)})", name) from None
    if found.dtype.kind not in "fiu" or hasattr(returned, "unit"):
        kind = type(returned).__name__ if found.dtype.kind in "fiu" else f"{type(returned).__name__} of {found.dtype}"
        raise _error(f"must return plain numbers [W/cm2/sr], returned {kind}", name)
    if found.shape != (len(direction),):
        rule = f"must return {len(direction):,} radiances of 0 or more for as many directions"
        raise _error(f"{rule}, returned shape {found.shape}", name)
    values = found.astype(np.float64)
    if (bad := ~((values >= 0.0) & (values <= LARGEST))).any():
        where = ", ".join(f"{x:.4f}" for x in direction[bad.argmax()])
        rule = f"must return finite radiances of 0 or more that float32 holds, returned {values[bad][0]:g}"
        raise _error(f"{rule} in direction ({where}), band {band.name}", name)
    return values


def _error(rule: str, name: str) -> InputError:
    return InputError(rule, "background.sky_map", name)


def _said(error: BaseException) -> str:
    return f"{type(error).__name__}: {one_line(ValueError(*error.args))}"
