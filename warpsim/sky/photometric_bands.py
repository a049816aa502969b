"""Bands in which a star may have a flux, those that ship with warpsim and have a zero point, and their columns."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType

import numpy as np

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import BANDS, bands, name_among

FLUX_NONE, FLUX_MEASURED, FLUX_PREDICTED, FLUX_FILLED = 0, 1, 2, 3
"""What a star's flux in a band is: unknown (NaN), measured, predicted by the catalog, or filled in from the spectrum.

The first three are given, and the spectrum meets them. What was filled in follows from them, and is left out and
predicted anew when a table is read."""


@functools.cache
def photometric_bands() -> Mapping[str, Band]:
    """The bands by name, those of MSX first."""
    known = {name: band for name, band in bands().items() if band.w_cm2_per_jy > 0.0}
    return MappingProxyType({**BANDS, **known})


@functools.lru_cache(maxsize=64)
def photometric_name(band: Band) -> str | None:
    """Name of the photometric band that a band is, whatever its own; None for any other."""
    return name_among(band, photometric_bands())


def flux_band(band: Band | str) -> Band:
    """Return the photometric band of that name, or that a Band is, whatever its own name; raise if there is none."""
    known = photometric_bands()
    name = photometric_name(band) if isinstance(band, Band) else band
    if not isinstance(name, str) or name not in known:
        given = band.name if isinstance(band, Band) else band
        raise InputError(f"must be one of {', '.join(known)}, in which catalogs have fluxes", "band", given)
    return known[name]


def check_flux_band(band: str, where: str = "") -> None:
    """Raise InputError unless a catalog may have fluxes in a band of that name."""
    if band not in photometric_bands():
        raise InputError(f"band must be one of {', '.join(photometric_bands())}", where, band)


def flux_column(band: str) -> str:
    """Name of the flux column of a band in a table."""
    return f"flux_{band}_jy"


def magnitude_column(band: str) -> str:
    """Name of a column of magnitudes in a band, against its zero_mag_jy."""
    return f"mag_{band}"


def flag_column(band: str) -> str:
    """Name of the column that says what the flux of a band is (FLUX_NONE to FLUX_FILLED)."""
    return f"flux_{band}_flag"


def limit_column(band: str) -> str:
    """Name of the column of upper limits of the flux predicted in a band; NaN for none."""
    return f"flux_{band}_limit_jy"


def brightness_columns(names: Iterable[str]) -> dict[str, str]:
    """The column of fluxes or magnitudes of each band that a table has, by band; not both of one band."""
    found = {}
    names = set(names)
    for band in photometric_bands():
        both = [name for name in (flux_column(band), magnitude_column(band)) if name in names]
        if len(both) == 2:
            raise InputError(f"must be one of {both[0]} and {both[1]}, got both", "columns")
        if both:
            found[band] = both[0]
    return found


def sloan_g(names: Iterable[str]) -> list[str]:
    """Return those of some columns that hold Sloan's or Pan-STARRS' g, and not Gaia's G.

    The case tells them, and a neighbour of the same case: gmag beside rmag or imag is Sloan's, Gmag never is.
    """
    known = set(names)

    def neighbour(name: str, letter: str) -> str:
        return re.sub(r"(?<![A-Za-z])[gG]", letter.upper() if name.isupper() else letter, name, count=1)

    return [
        name
        for name in known
        if re.fullmatch(r"g|g_?mag|mag_g|flux_g(_jy)?|G_?MAG|MAG_G|FLUX_G(_JY)?", name)
        and known & {neighbour(name, "r"), neighbour(name, "i")}
    ]


def check_flux_columns(names: Iterable[str]) -> None:
    """Raise InputError for a column of fluxes by its name that is of no photometric band: flux_Z_jy."""
    known = {band.lower() for band in photometric_bands()}
    for name in names:
        flux = re.fullmatch(r"flux_([a-z0-9]+)_jy", name.lower())
        if flux and flux[1] not in known:
            raise InputError(f"must be of one of the bands {', '.join(photometric_bands())}", name)


def flux_of_magnitude_jy(band: str, magnitude: F64) -> F64:
    """Flux density [Jy] of magnitudes in a photometric band, against its zero_mag_jy; NaN in, NaN out."""
    return np.asarray(photometric_bands()[band].zero_mag_jy * 10.0 ** (-0.4 * magnitude))


def flux_of_colour_jy(v_flux_jy: F64, b_v_mag: F64) -> F64:
    """Flux density in B [Jy] of stars with a flux density in V [Jy] and B-V [mag]; NaN in, NaN out."""
    bands = photometric_bands()
    return np.asarray(v_flux_jy * bands["B"].zero_mag_jy / bands["V"].zero_mag_jy * 10.0 ** (-0.4 * b_v_mag))
