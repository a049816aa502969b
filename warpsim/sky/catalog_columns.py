"""Columns of a star catalog: from what a user has, arrays or a table, to checked numbers, and back to a table."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.errors import InputError
from warpsim.radiometry.bands import BANDS
from warpsim.sky.photometric_bands import photometric_bands
from warpsim.sky.space_motion import wrapped_deg
from warpsim.sky.star_columns import StarColumns
from warpsim.tables.columns import number_column

if TYPE_CHECKING:
    from astropy.table import Table

Array = NDArray[np.float64]

BAND_NAMES = tuple(BANDS)
"""The MSX bands, whose columns every table has."""

J2000_JYEAR = 2000.0

LARGEST_FLUX_JY = 1e15
"""A million times the Sun's at 10 um; more would overflow float32 images."""

LARGEST_PARALLAX_MAS = 1e5
"""A hundred times the nearest star's; every view would have to look that far beyond its field."""

FLUX_NONE, FLUX_MEASURED, FLUX_PREDICTED = 0, 1, 2
"""What a star's flux in a band is: unknown (NaN), measured, or predicted (by the catalog, or from the spectrum)."""

LUMINOSITY_UNKNOWN = -1
"""Where neither 0 (dwarf) nor 1 (giant) is known."""

_UNKNOWN = {"parallax_mas": math.nan, "temperature_k": math.nan, "luminosity": LUMINOSITY_UNKNOWN}
"""What stands for numbers that are not known; 0 for all others."""

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


def flux_column(band: str) -> str:
    """Name of the flux column of a band in a table."""
    return f"flux_{band}_jy"


def magnitude_column(band: str) -> str:
    """Name of a column of magnitudes in a band, against its zero_mag_jy."""
    return f"mag_{band}"


def flag_column(band: str) -> str:
    """Name of the column that says what the flux of a band is (FLUX_NONE, FLUX_MEASURED, FLUX_PREDICTED)."""
    return f"flux_{band}_flag"


def checked_columns(
    numbers: Mapping[str, ArrayLike | None],
    flux_jy: Mapping[str, ArrayLike],
    flux_flag: Mapping[str, ArrayLike] | None = None,
    id: ArrayLike | None = None,
    *,
    epoch_jyear: float = J2000_JYEAR,
    name: str = "stars",
    provenance: str = "",
) -> StarColumns:
    """Columns that break no rule, of stars that have finite coordinates.

    Args:
        numbers: Columns of NUMBER_UNITS, each (n,); ra_deg and dec_deg must be there, None stands for unknown.
        flux_jy: Flux density [Jy] by photometric band.
        flux_flag: What the fluxes are, by band; measured where left out.
        id: Names; "1", "2", ... if left out.
        epoch_jyear: Julian year of the coordinates.
        name: Name of the catalog, also for the warning about stars without finite coordinates.
        provenance: Source of the stars.

    Raises:
        InputError: Shapes that differ, values that are not numbers or out of range, or an unknown band.
    """
    epoch = _checked_epoch(epoch_jyear)
    columns = _vectors(numbers, flux_jy, flux_flag or {})
    n_star = len(columns["ra_deg"])
    names = np.arange(1, n_star + 1).astype(np.str_) if id is None else np.array(id).astype(np.str_)
    for key, values in {**columns, "id": names}.items():
        if values.shape != (n_star,):
            raise InputError(f"must have shape ({n_star},) like ra_deg", key, values.shape)

    placed = np.isfinite(columns["ra_deg"]) & np.isfinite(columns["dec_deg"])
    rows = np.flatnonzero(placed)
    if len(rows) < n_star:
        warn_left_out(name, n_star, "rows", np.flatnonzero(~placed).tolist())
        columns = {key: values[placed] for key, values in columns.items()}
        names = names[placed]
    _check_ranges(columns, rows)
    return StarColumns(
        ra_deg=wrapped_deg(columns["ra_deg"]),
        dec_deg=columns["dec_deg"],
        pm_ra_mas_yr=columns["pm_ra_mas_yr"],
        pm_dec_mas_yr=columns["pm_dec_mas_yr"],
        parallax_mas=columns["parallax_mas"],
        temperature_k=columns["temperature_k"],
        luminosity=columns["luminosity"].astype(np.int8),
        quality=columns["quality"].astype(np.int64),
        epoch_jyear=epoch,
        name=name,
        provenance=provenance,
        flux_jy={band: columns[flux_column(band)] for band in flux_jy},
        flux_flag=_checked_flags(columns, flux_jy, rows),
        id=names,
    )


def _vectors(
    numbers: Mapping[str, ArrayLike | None], flux_jy: Mapping[str, ArrayLike], flux_flag: Mapping[str, ArrayLike]
) -> dict[str, Array]:
    """Columns as vectors, those of flags only where given; unknown numbers are 0, or NaN where 0 is a value."""
    columns = {"ra_deg": _vector(numbers["ra_deg"], "ra_deg")}
    n_star = len(columns["ra_deg"])
    for key in NUMBER_UNITS:
        values = numbers.get(key)
        if key != "ra_deg":
            columns[key] = np.full(n_star, _UNKNOWN.get(key, 0.0)) if values is None else _vector(values, key)
    for what, bands in (("flux_jy", flux_jy), ("flux_flag", flux_flag)):
        for band in bands:
            check_flux_band(band, what)
    for band in flux_jy:
        columns[flux_column(band)] = _vector(flux_jy[band], flux_column(band))
        if band in flux_flag:
            columns[flag_column(band)] = _vector(flux_flag[band], flag_column(band))
    return columns


def check_flux_band(band: str, where: str) -> None:
    """Raise InputError unless a catalog may have fluxes in a band of that name."""
    if band not in photometric_bands():
        raise InputError(f"band must be one of {', '.join(photometric_bands())}", where, band)


def _check_ranges(columns: dict[str, Array], rows: NDArray[np.int64]) -> None:
    """Check the numbers of stars; unknown motions, classes and qualities become the value that stands for it."""
    _check_range(columns["dec_deg"], -90.0, 90.0, "dec_deg", rows)
    _check_range(columns["ra_deg"], -180.0, 360.0, "ra_deg", rows)
    for key in ("pm_ra_mas_yr", "pm_dec_mas_yr", "luminosity", "quality"):
        columns[key] = np.where(np.isnan(columns[key]), _UNKNOWN.get(key, 0.0), columns[key])
    for key in ("pm_ra_mas_yr", "pm_dec_mas_yr", "quality"):
        _check_range(columns[key], -1e9, 1e9, key, rows)
    _check_range(columns["luminosity"], -1.0, 1.0, "luminosity", rows)
    _check_whole(columns["luminosity"], "luminosity", rows)
    _check_range(columns["parallax_mas"], -LARGEST_PARALLAX_MAS, LARGEST_PARALLAX_MAS, "parallax_mas", rows)
    _check_range(columns["temperature_k"], 1.0, 1e9, "temperature_k", rows)
    for band in photometric_bands():
        if flux_column(band) in columns:
            _check_range(columns[flux_column(band)], 0.0, LARGEST_FLUX_JY, flux_column(band), rows)
    _check_whole(columns["quality"], "quality", rows)


def _checked_flags(
    columns: Mapping[str, Array], bands: Iterable[str], rows: NDArray[np.int64]
) -> dict[str, NDArray[np.uint8]]:
    """What the flux of each band is; one that is known is measured, unless it is said to be predicted."""
    flags = {}
    for band in bands:
        given = columns.get(flag_column(band), np.full(len(rows), float(FLUX_MEASURED)))
        _check_range(given, FLUX_NONE, FLUX_PREDICTED, flag_column(band), rows)
        _check_whole(given, flag_column(band), rows)
        kind = np.where(given == FLUX_PREDICTED, FLUX_PREDICTED, FLUX_MEASURED)
        flags[band] = np.where(np.isfinite(columns[flux_column(band)]), kind, FLUX_NONE).astype(np.uint8)
    return flags


def checked_limits(limit_jy: Mapping[str, ArrayLike], n_star: int) -> dict[str, Array]:
    """Upper limits by band [Jy], checked; NaN for none.

    Raises:
        InputError: An unknown band, another shape than (n_star,), a negative or infinite limit, or no numbers.
    """
    limits = {}
    for band, values in limit_jy.items():
        check_flux_band(band, "limit_jy")
        try:
            limits[band] = _vector(values, band)
            if limits[band].shape != (n_star,):
                raise InputError(f"must have shape ({n_star},)", band, limits[band].shape)
            _check_range(limits[band], 0.0, LARGEST_FLUX_JY, band, np.arange(n_star))
        except InputError as error:
            raise error.within("limit_jy") from None
    return limits


def warn_left_out(name: str, n_star: int, unit: str, places: list[int]) -> None:
    """Warn about stars without a finite place: how many, and where they stand (`unit` is rows or lines)."""
    shown = ", ".join(str(place) for place in places[:5]) + (", ..." if len(places) > 5 else "")
    text = f"{name}: left out {len(places)} of {n_star} stars without a finite place ({unit} {shown})"
    warnings.warn(text, stacklevel=2)


def columns_of_table(table: Table) -> dict[str, Any]:
    """Arguments of StarCatalog.from_arrays held by an astropy Table; units are converted, masked values are NaN.

    Raises:
        InputError: A column is missing, or has another kind of unit.
    """
    known = set(table.colnames)
    check_flux_columns(table.colnames)
    fluxes = brightness_columns(table.colnames)
    missing = [key for key in ("ra_deg", "dec_deg") if key not in known]
    if not fluxes:
        missing.append(f"flux_X_jy or mag_X with X one of {', '.join(photometric_bands())}")
    if missing:
        found = ", ".join(table.colnames) or "no columns"
        raise InputError(f"must have the column {' and '.join(missing)}", "table", found, "s")
    meta = {str(key).lower(): value for key, value in table.meta.items()}  # FITS turns keys to capitals
    columns: dict[str, Any] = {
        key: number_column(table, key, unit) for key, unit in NUMBER_UNITS.items() if key in known
    }
    flags = {band: flag_column(band) for band in fluxes if flag_column(band) in known}
    return columns | {
        "flux_jy": {
            band: number_column(table, name, "Jy")
            if name == flux_column(band)
            else flux_of_magnitude_jy(band, number_column(table, name, "mag"))
            for band, name in fluxes.items()
        },
        "flux_flag": {band: number_column(table, key, "") for band, key in flags.items()} or None,
        "id": np.asarray(table["id"]).astype(np.str_) if "id" in known else None,
        "epoch_jyear": meta.get("epoch_jyear", J2000_JYEAR),
        "provenance": str(meta.get("provenance", "")),
    }


def brightness_columns(names: Iterable[str]) -> dict[str, str]:
    """The column of fluxes or magnitudes of each band that a table has, by band.

    Args:
        names: Names of the table's columns, in warpsim's spelling.

    Raises:
        InputError: A band comes twice, as flux and as magnitude.
    """
    found = {}
    names = set(names)
    for band in photometric_bands():
        both = [name for name in (flux_column(band), magnitude_column(band)) if name in names]
        if len(both) == 2:
            raise InputError(f"must be one of {both[0]} and {both[1]}, got both", "columns")
        if both:
            found[band] = both[0]
    return found


def check_flux_columns(names: Iterable[str]) -> None:
    """Raise InputError for a column of fluxes by its name that is of no photometric band: flux_Z_jy."""
    known = {band.lower() for band in photometric_bands()}
    for name in names:
        flux = re.fullmatch(r"flux_([a-z0-9]+)_jy", name.lower())
        if flux and flux[1] not in known:
            raise InputError(f"must be of one of the bands {', '.join(photometric_bands())}", name)


def flux_of_magnitude_jy(band: str, magnitude: Array) -> Array:
    """Flux density [Jy] of magnitudes in a photometric band, against its zero_mag_jy; NaN in, NaN out."""
    return np.asarray(photometric_bands()[band].zero_mag_jy * 10.0 ** (-0.4 * magnitude))


def table_of(columns: StarColumns) -> Table:
    """Return columns as an astropy Table that columns_of_table() reads back; their names must be spelled out."""
    from astropy.table import Table

    table = Table(meta={"name": columns.name, "epoch_jyear": columns.epoch_jyear, "provenance": columns.provenance})

    def put(key: str, values: NDArray[Any]) -> None:
        table[key] = values
        table[key].unit = NUMBER_UNITS.get(key) or None

    for key in ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas"):
        put(key, getattr(columns, key))
    bands = sorted(columns.flux_jy, key=list(photometric_bands()).index)
    for band in bands:
        table[flux_column(band)] = columns.flux_jy[band]
        table[flux_column(band)].unit = "Jy"
    put("quality", columns.quality)
    table["id"] = columns.id
    put("temperature_k", columns.temperature_k)
    put("luminosity", columns.luminosity.astype(np.int16))  # VOTable has no shorter signed numbers
    for band in bands:
        table[flag_column(band)] = columns.flux_flag[band]
    return table


def _checked_epoch(epoch_jyear: Any) -> float:
    """A finite Julian year; InputError otherwise."""
    try:
        epoch = float(epoch_jyear)
    except (TypeError, ValueError):
        epoch = math.nan
    if not math.isfinite(epoch):
        raise InputError("must be a finite number", "epoch_jyear", epoch_jyear)
    return epoch


def _vector(values: Any, where: str) -> Array:
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


def _check_whole(values: Array, where: str, rows: NDArray[np.int64]) -> None:
    """Raise for the first value that is no whole number; NaN passes."""
    bad = np.flatnonzero(np.isfinite(values) & (values != np.floor(values)))
    if bad.size:
        raise InputError("must be whole numbers", where, values[bad[0]], "g", row=int(rows[bad[0]]))


def _check_range(values: Array, low: float, high: float, where: str, rows: NDArray[np.int64]) -> None:
    """Raise for the first value outside [low, high]; NaN passes. `rows` are the user's row numbers."""
    bad = np.flatnonzero((values < low) | (values > high))
    if bad.size:
        rule, first = f"must be in [{low:g}, {high:g}]", bad[0]
        raise InputError(rule, where, values[first], "g", row=int(rows[first]), n_row=bad.size)
