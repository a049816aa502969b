"""Columns of a star catalog: their names, and arrays of a user's to checked numbers."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.arrays import F64
from warpsim.errors import InputError, errors_at, printable
from warpsim.radiometry.bands import BANDS
from warpsim.sky.photometric_bands import (
    FLUX_FILLED,
    FLUX_MEASURED,
    FLUX_NONE,
    FLUX_PREDICTED,
    check_flux_band,
    flag_column,
    flux_column,
    photometric_bands,
)
from warpsim.sky.positions import J2000_JYEAR, checked_jyear, wrapped_deg
from warpsim.sky.spectral_types import CLASS_UNKNOWN, of_spectral_types, warn_unknown_types
from warpsim.sky.stars import Stars
from warpsim.sky.stellar_templates import DWARF

BAND_NAMES = tuple(BANDS)
"""The MSX bands, whose columns every table has."""

LARGEST_FLUX_JY = 1e15
"""A million times the Sun's at 10 um; more would overflow float32 images."""

LARGEST_PARALLAX_MAS = 1e5
"""A hundred times the nearest star's; every view would have to look that far beyond its field."""

LUMINOSITY_UNKNOWN = -1
"""Where neither 0 (dwarf) nor 1 (giant) is known."""

NUMBER_UNITS = {
    "ra_deg": "deg",
    "dec_deg": "deg",
    "pm_ra_mas_yr": "mas / yr",
    "pm_dec_mas_yr": "mas / yr",
    "parallax_mas": "mas",
    "temperature_k": "K",
    "luminosity": "",
    "quality": "",
}
"""Columns of numbers other than fluxes, with their units, as to_table() names them."""

_RULES = {
    "dec_deg": (-90.0, 90.0, math.nan),
    "ra_deg": (-180.0, 360.0, math.nan),
    "pm_ra_mas_yr": (-1e9, 1e9, 0.0),
    "pm_dec_mas_yr": (-1e9, 1e9, 0.0),
    "parallax_mas": (-LARGEST_PARALLAX_MAS, LARGEST_PARALLAX_MAS, math.nan),
    "temperature_k": (1.0, 1e9, math.nan),
    "luminosity": (-1.0, 1.0, LUMINOSITY_UNKNOWN),
    "quality": (-1e9, 1e9, 0.0),
}
"""Smallest and largest value of each, and what stands for one that is not known."""

_WHOLE: Mapping[str, type] = {"luminosity": np.int8, "quality": np.int64}
"""Columns of whole numbers, and their types."""

COLOUR = "b_v_mag"
"""Column of B-V, which makes a flux in B of one in V."""


def checked_columns(
    *,
    flux_jy: Mapping[str, ArrayLike],
    flux_flag: Mapping[str, ArrayLike] | None = None,
    id: ArrayLike | None = None,
    spectral_type: ArrayLike | None = None,
    limit_jy: Mapping[str, ArrayLike] | None = None,
    epoch_jyear: float = J2000_JYEAR,
    name: str = "stars",
    provenance: str = "",
    file: str | None = None,
    line_of_row: NDArray[np.int64] | None = None,
    first_row: int = 0,
    filled: bool = False,
    **numbers: ArrayLike | None,
) -> Stars:
    """The stars of columns, of which those without finite coordinates are left out.

    Args:
        flux_jy: Flux density [Jy] by photometric band.
        flux_flag: Kinds of the fluxes, by band; measured where left out.
        id: Names; "1", "2", ... if left out.
        spectral_type: Spectral types, which give temperature and luminosity class where unknown.
        limit_jy: Upper limits of predicted fluxes by band [Jy]; NaN for none.
        epoch_jyear: Julian year of the coordinates.
        name: Name of the catalog.
        provenance: Source of the stars.
        file: For the warning about stars without finite coordinates; `name` if left out.
        line_of_row: Lines of the stars in that file, for the same.
        first_row: Row of the first of them in the file; where they have no names, that of row 0 is "1".
        filled: Whether unknown fluxes are to be predicted; so they are, too, where flags say that some were.
        numbers: Columns of NUMBER_UNITS, each (n,); ra_deg and dec_deg must be there, None stands for unknown.

    Raises:
        InputError: A column breaks a rule.
    """
    columns = _vectors(numbers, flux_jy, flux_flag or {})
    n_star = len(columns["ra_deg"])
    texts = _texts(columns, id, spectral_type, first_row)
    limits = checked_limits(limit_jy or {}, n_star)

    located = np.isfinite(columns["ra_deg"]) & np.isfinite(columns["dec_deg"])
    rows = np.flatnonzero(located)
    if len(rows) < n_star:
        _warn_left_out(file or name, located, line_of_row)
        columns = {key: values[located] for key, values in columns.items()}
        texts = {key: values[located] for key, values in texts.items()}
        limits = {band: values[located] for band, values in limits.items()}
    _check_ranges(columns, rows)
    type_k = _fill_from_type(columns, texts["spectral_type"], name) if "spectral_type" in texts else None
    given_jy, given_flag, were_filled = _given_fluxes(columns, flux_jy, rows)
    columns["ra_deg"] = wrapped_deg(columns["ra_deg"])
    of_type: dict[str, Any] = {
        key: columns[key].astype(_WHOLE.get(key, np.float64), copy=False) for key in NUMBER_UNITS
    }
    return Stars._made(
        **of_type,
        epoch_jyear=checked_jyear(epoch_jyear, "epoch_jyear"),
        name=printable(name),
        provenance=printable(provenance),
        flux_jy=given_jy,
        flux_flag=given_flag,
        id=_printable_ids(texts["id"]),
        filled=filled or were_filled,
        type_temperature_k=type_k,
        limit_jy=limits,
    )


def _texts(
    columns: Mapping[str, NDArray[Any]], id: ArrayLike | None, spectral_type: ArrayLike | None, first_row: int
) -> dict[str, NDArray[Any]]:
    """Names and, where given, spectral types; all columns are as long as the coordinates."""
    n_star = len(columns["ra_deg"])
    rows_named = np.arange(first_row + 1, first_row + n_star + 1, dtype=np.int64)
    texts: dict[str, NDArray[Any]] = {"id": rows_named if id is None else np.array(id).astype(np.str_)}
    if spectral_type is not None:
        texts["spectral_type"] = np.ma.filled(np.ma.asarray(spectral_type).astype(np.str_), "")
    for key, values in {**columns, **texts}.items():
        if values.shape != (n_star,):
            raise InputError(f"must have shape ({n_star},) like ra_deg", key, values.shape)
    return texts


def _printable_ids(ids: NDArray[Any]) -> NDArray[Any]:
    """Names of stars, of which those with control characters are changed: files and terminals obey these."""
    if ids.dtype.kind == "U" and ids.nbytes:
        letters = np.ascontiguousarray(ids).view(np.uint32).reshape(len(ids), -1)
        odd = (letters > 126) | ((letters < 32) & (letters > 0) & (letters != ord("\t")))
        for row in np.flatnonzero(odd.any(axis=1)).tolist():
            ids[row] = printable(str(ids[row]))
    return ids


def _fill_from_type(columns: dict[str, F64], spectral_type: NDArray[np.str_], name: str) -> F64:
    """Set unknown temperatures and classes by spectral types with a class; return the type_temperature_k of all."""
    type_k, luminosity = of_spectral_types(spectral_type)
    warn_unknown_types(name, spectral_type, type_k)
    by_type = np.isnan(columns["temperature_k"]) & (luminosity != CLASS_UNKNOWN)
    columns["temperature_k"] = np.where(by_type, type_k[:, DWARF], columns["temperature_k"])
    unknown = columns["luminosity"] == LUMINOSITY_UNKNOWN
    columns["luminosity"] = np.where(unknown, luminosity, columns["luminosity"])
    return type_k


def _vectors(
    numbers: Mapping[str, ArrayLike | None], flux_jy: Mapping[str, ArrayLike], flux_flag: Mapping[str, ArrayLike]
) -> dict[str, F64]:
    """Columns as vectors, those of flags only where given."""
    columns = {"ra_deg": _vector(numbers["ra_deg"], "ra_deg")}
    n_star = len(columns["ra_deg"])
    for key in NUMBER_UNITS:
        values = numbers.get(key)
        if key != "ra_deg":
            columns[key] = np.full(n_star, _RULES[key][2]) if values is None else _vector(values, key)
    for what, bands in (("flux_jy", flux_jy), ("flux_flag", flux_flag)):
        for band in bands:
            check_flux_band(band, what)
    for band in flux_jy:
        columns[flux_column(band)] = _vector(flux_jy[band], flux_column(band))
        if band in flux_flag:
            columns[flag_column(band)] = _vector(flux_flag[band], flag_column(band))
    return columns


def _check_ranges(columns: dict[str, F64], rows: NDArray[np.int64]) -> None:
    """Check the numbers of stars; those that are not known become the value that stands for it."""
    for key, (low, high, unknown) in _RULES.items():
        columns[key] = np.where(np.isnan(columns[key]), unknown, columns[key])
        _check_range(columns[key], low, high, key, rows, whole=key in _WHOLE)
    for band in photometric_bands():
        if flux_column(band) in columns:
            _check_range(columns[flux_column(band)], 0.0, LARGEST_FLUX_JY, flux_column(band), rows)


def _given_fluxes(
    columns: Mapping[str, F64], bands: Iterable[str], rows: NDArray[np.int64]
) -> tuple[dict[str, F64], dict[str, NDArray[np.uint8]], bool]:
    """Fluxes given and what they are, by band, and whether there were others, filled in from the spectrum.

    Those are left out, unless a star has no other: then they are its catalog's predictions.
    """
    flux_jy = {band: columns[flux_column(band)] for band in bands}
    flags = {}
    for band, values in flux_jy.items():
        flag = columns.get(flag_column(band), np.full(len(rows), float(FLUX_MEASURED)))
        _check_range(flag, FLUX_NONE, FLUX_FILLED, flag_column(band), rows, whole=True)
        kind = np.where((flag == FLUX_PREDICTED) | (flag == FLUX_FILLED), flag, FLUX_MEASURED)
        flags[band] = np.where(np.isfinite(values), kind, FLUX_NONE).astype(np.uint8)
    filled = {band: flag == FLUX_FILLED for band, flag in flags.items()}
    if not any(some.any() for some in filled.values()):
        return flux_jy, flags, False
    alone = ~np.any([(flag != FLUX_NONE) & (flag != FLUX_FILLED) for flag in flags.values()], axis=0)
    given_jy, given_flag = {}, {}
    for band, some in filled.items():
        if np.any(known := (flags[band] != FLUX_NONE) & (~some | alone)):
            given_jy[band] = np.where(known, flux_jy[band], np.nan)
            given_flag[band] = np.where(known, np.where(some, FLUX_PREDICTED, flags[band]), FLUX_NONE).astype(np.uint8)
    return given_jy, given_flag, True


def checked_limits(limit_jy: Mapping[str, ArrayLike], n_star: int) -> dict[str, F64]:
    """Upper limits by band [Jy], (n_star,) each, checked; NaN for none."""
    limits = {}
    for band, values in limit_jy.items():
        check_flux_band(band, "limit_jy")
        with errors_at("limit_jy"):
            limits[band] = _vector(values, band)
            if limits[band].shape != (n_star,):
                raise InputError(f"must have shape ({n_star},)", band, limits[band].shape)
            _check_range(limits[band], 0.0, LARGEST_FLUX_JY, band, np.arange(n_star))
    return limits


def _warn_left_out(where: str, located: NDArray[np.bool_], line_of_row: NDArray[np.int64] | None) -> None:
    """Warn about stars without a finite position: how many, and their rows or lines."""
    lost = np.flatnonzero(~located)
    unit, numbers = ("rows", lost) if line_of_row is None else ("lines", line_of_row[lost])
    shown = ", ".join(map(str, numbers[:5].tolist())) + (", ..." if len(lost) > 5 else "")
    text = f"{where}: left out {len(lost)} of {len(located)} stars without a finite position ({unit} {shown})"
    warnings.warn(text, stacklevel=3)


def _vector(values: Any, where: str) -> F64:
    """Copy to a float64 vector."""
    try:
        vector = np.array(values, dtype=np.float64)
        masked = np.ma.getmaskarray(values) if isinstance(values, np.ma.MaskedArray) else None
    except (TypeError, ValueError):
        raise InputError(f"must be numbers, got {type(values).__name__}", where) from None
    if masked is not None:
        vector[masked] = np.nan
    if vector.ndim != 1:
        raise InputError(f"must be a vector, got shape {vector.shape}", where)
    return vector


def _check_range(
    values: F64, low: float, high: float, where: str, rows: NDArray[np.int64], whole: bool = False
) -> None:
    """Raise for the first value outside [low, high], or no whole number; NaN passes. `rows` are the user's numbers."""
    bad = np.flatnonzero((values < low) | (values > high))
    if bad.size:
        rule, first = f"must be in [{low:g}, {high:g}]", bad[0]
        raise InputError(rule, where, values[first], "g", row=int(rows[first]), n_row=bad.size)
    bad = np.flatnonzero(np.isfinite(values) & (values != np.floor(values))) if whole else bad
    if bad.size:
        raise InputError("must be whole numbers", where, values[bad[0]], "g", row=int(rows[bad[0]]))
