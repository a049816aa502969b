"""Bands in which a star may have a flux: those that ship with warpsim and have a zero point."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from types import MappingProxyType

from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import BANDS, bands, name_among


@functools.cache
def photometric_bands() -> Mapping[str, Band]:
    """The bands by name, those of MSX first."""
    known = {name: band for name, band in bands().items() if band.w_cm2_per_jy > 0.0}
    return MappingProxyType({**BANDS, **known})


@functools.lru_cache(maxsize=64)
def photometric_name(band: Band) -> str | None:
    """Name of the photometric band that a band is, whatever its own; None for any other."""
    return name_among(band, photometric_bands())
