"""Star catalogs: places, motions and fluxes, and the table that ships with warpsim."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.errors import InputError
from warpsim.sky.bands import BANDS, Band, as_band

if TYPE_CHECKING:
    from astropy.table import Table

Array = NDArray[np.float64]

BAND_NAMES = tuple(BANDS)
J2000_JYEAR = 2000.0
_MAS_RAD = math.pi / 180.0 / 3.6e6

LARGEST_FLUX_JY = 1e15
"""A million times the Sun's at 10 um; more would overflow float32 images."""


@dataclass(frozen=True, eq=False, repr=False)
class StarCatalog:
    """Stars with place, motion and flux in the MSX bands; immutable, all arrays float64 and read-only.

    Make one with `default`, `from_arrays`, `from_table` or `read`. A catalog may be empty.
    """

    direction_icrs: Array
    """Unit vectors at epoch_jyear, ICRS axes, shape (n, 3)."""

    ra_deg: Array
    """Right ascension [deg], ICRS at epoch_jyear, in [0, 360), shape (n,)."""

    dec_deg: Array
    """Declination [deg], ICRS at epoch_jyear, shape (n,)."""

    pm_ra_mas_yr: Array
    """Proper motion in right ascension, cos(dec) included [mas/yr], at epoch_jyear, shape (n,)."""

    pm_dec_mas_yr: Array
    """Proper motion in declination [mas/yr], at epoch_jyear, shape (n,)."""

    parallax_mas: Array
    """Parallax [mas], shape (n,); NaN where unknown."""

    quality: NDArray[np.int64]
    """0 unknown, 1 uncertain (1-2 mag), 2 fair (predicted, 0.15 mag), 3 good, 4 excellent (measured), shape (n,)."""

    epoch_jyear: float
    """Julian year of the places (2000.0 is J2000)."""

    name: str
    provenance: str

    _flux_jy: Mapping[str, Array]
    _id: NDArray[np.str_] | NDArray[np.int64]
    """Identifiers; of the default catalog: HIP numbers, 0 for none, spelled out when `id` is asked for."""

    _origin: StarCatalog | None
    """The catalog as it was made; every at_epoch() starts there, so that no error builds up."""

    @staticmethod
    def default() -> StarCatalog:
        """Return the catalog that ships with warpsim: 177,860 stars down to magnitude 6.76 at 8.3 um (0.116 Jy).

        Fluxes are predicted from visible colours (scatter 0.15 mag; variables 1-2 mag). Made once, then shared.
        """
        from warpsim.sky.default_catalog import load_default_catalog

        return load_default_catalog()

    @classmethod
    def from_arrays(
        cls,
        ra_deg: ArrayLike,
        dec_deg: ArrayLike,
        flux_jy: Mapping[str, ArrayLike],
        *,
        pm_ra_mas_yr: ArrayLike | None = None,
        pm_dec_mas_yr: ArrayLike | None = None,
        parallax_mas: ArrayLike | None = None,
        quality: ArrayLike | None = None,
        id: ArrayLike | None = None,
        epoch_jyear: float = J2000_JYEAR,
        name: str = "stars",
        provenance: str = "",
    ) -> StarCatalog:
        """Make a catalog from plain arrays, all of shape (n,); they are copied.

        Rows whose place is not finite are left out, with a warning that counts and names them.

        Args:
            ra_deg: Right ascension [deg], ICRS, from -180 to 360.
            dec_deg: Declination [deg], ICRS, from -90 to 90.
            flux_jy: Flux density [Jy] by band name (B1, B2, A, C, D, E); NaN where unknown, like bands left out.
            pm_ra_mas_yr: Proper motion in right ascension, cos(dec) included [mas/yr]; 0 if left out or NaN.
            pm_dec_mas_yr: Proper motion in declination [mas/yr]; 0 if left out or NaN.
            parallax_mas: Parallax [mas]; NaN if left out. Kept for the user, not used for places.
            quality: 0 unknown, 1 uncertain, 2 fair, 3 good, 4 excellent; 0 if left out.
            id: Names; "1", "2", ... in the order given if left out.
            epoch_jyear: Julian year of the places.
            name: Name of the catalog.
            provenance: Where it is from.

        Raises:
            InputError: Shapes that differ, values that are not numbers, places out of range, negative or infinite
                flux, or an unknown band.
        """
        ra, dec = _vector(ra_deg, "ra_deg"), _vector(dec_deg, "dec_deg")
        n_star = len(ra)
        nothing, zero = np.full(n_star, np.nan), np.zeros(n_star)
        columns = {
            "ra_deg": ra,
            "dec_deg": dec,
            "pm_ra_mas_yr": zero if pm_ra_mas_yr is None else _vector(pm_ra_mas_yr, "pm_ra_mas_yr"),
            "pm_dec_mas_yr": zero if pm_dec_mas_yr is None else _vector(pm_dec_mas_yr, "pm_dec_mas_yr"),
            "parallax_mas": nothing if parallax_mas is None else _vector(parallax_mas, "parallax_mas"),
            "quality": zero if quality is None else _vector(quality, "quality"),
        }
        for band in flux_jy:
            if band not in BANDS:
                raise InputError(f"flux_jy: band must be one of {', '.join(BAND_NAMES)}, got {band!r}")
        for band in BAND_NAMES:
            key = f"flux_{band}_jy"
            columns[key] = _vector(flux_jy[band], key) if band in flux_jy else nothing
        names = np.arange(1, n_star + 1).astype(np.str_) if id is None else np.array(id).astype(np.str_)
        for key, values in {**columns, "id": names}.items():
            if values.shape != (n_star,):
                raise InputError(f"{key} must have shape ({n_star},) like ra_deg, got {values.shape}")
        try:
            epoch = float(epoch_jyear)
        except (TypeError, ValueError):
            epoch = math.nan
        if not math.isfinite(epoch):
            raise InputError(f"epoch_jyear must be a finite number, got {epoch_jyear!r}")

        placed = np.isfinite(ra) & np.isfinite(dec)
        if not placed.all():
            rows = np.flatnonzero(~placed)
            shown = ", ".join(str(row) for row in rows[:5]) + (", ..." if len(rows) > 5 else "")
            text = f"{name}: left out {len(rows)} of {n_star} stars without a finite place (rows {shown})"
            warnings.warn(text, stacklevel=2)
            columns = {key: values[placed] for key, values in columns.items()}
            names = names[placed]
        rows = np.flatnonzero(placed)
        _check_range(columns["dec_deg"], -90.0, 90.0, "dec_deg", rows)
        _check_range(columns["ra_deg"], -180.0, 360.0, "ra_deg", rows)
        for key in ("pm_ra_mas_yr", "pm_dec_mas_yr", "quality"):
            columns[key] = np.where(np.isnan(columns[key]), 0.0, columns[key])
            _check_range(columns[key], -1e9, 1e9, key, rows)
        _check_range(columns["parallax_mas"], -1e9, 1e9, "parallax_mas", rows)
        for band in BAND_NAMES:
            _check_range(columns[f"flux_{band}_jy"], 0.0, LARGEST_FLUX_JY, f"flux_{band}_jy", rows)
        return make_catalog(
            ra_deg=columns["ra_deg"] % 360.0,
            dec_deg=columns["dec_deg"],
            pm_ra_mas_yr=columns["pm_ra_mas_yr"],
            pm_dec_mas_yr=columns["pm_dec_mas_yr"],
            parallax_mas=columns["parallax_mas"],
            quality=columns["quality"].astype(np.int64),
            epoch_jyear=epoch,
            name=name,
            provenance=provenance,
            flux_jy={band: columns[f"flux_{band}_jy"] for band in BAND_NAMES},
            id=names,
        )

    @classmethod
    def from_table(cls, table: Table, name: str | None = None) -> StarCatalog:
        """Make a catalog from an astropy Table, as to_table() returns it.

        Columns: ra_deg, dec_deg and at least one of flux_A_jy ... flux_E_jy must be there; pm_ra_mas_yr (cos(dec)
        included), pm_dec_mas_yr, parallax_mas, quality and id may. A column with a unit is converted from it; one
        without is taken to be in the unit of its name. Masked values count as NaN. The epoch is meta["epoch_jyear"],
        or 2000.0.

        Args:
            table: Stars, one a row; no rows are legal.
            name: Name of the catalog; meta["name"] if left out.

        Raises:
            InputError: A column is missing, has another kind of unit, or breaks a rule of from_arrays.
        """
        columns = set(table.colnames)
        fluxes = [f"flux_{band}_jy" for band in BAND_NAMES]
        missing = [key for key in ("ra_deg", "dec_deg") if key not in columns]
        if not columns.intersection(fluxes):
            missing.append("one of " + ", ".join(fluxes))
        if missing:
            found = ", ".join(table.colnames) or "no columns"
            raise InputError(f"table: must have the column {' and '.join(missing)}, got {found}")
        meta = {str(key).lower(): value for key, value in table.meta.items()}  # FITS turns keys to capitals
        units = {"ra_deg": "deg", "dec_deg": "deg", "parallax_mas": "mas", "quality": ""}
        units |= dict.fromkeys(("pm_ra_mas_yr", "pm_dec_mas_yr"), "mas / yr")
        optional = {key: _table_column(table, key, unit) for key, unit in units.items() if key in columns}
        return cls.from_arrays(
            ra_deg=optional.pop("ra_deg"),
            dec_deg=optional.pop("dec_deg"),
            flux_jy={
                band: _table_column(table, key, "Jy")
                for band, key in zip(BAND_NAMES, fluxes, strict=True)
                if key in columns
            },
            id=np.asarray(table["id"]).astype(np.str_) if "id" in columns else None,
            epoch_jyear=meta.get("epoch_jyear", J2000_JYEAR),
            name=name or str(meta.get("name", "stars")),
            provenance=str(meta.get("provenance", "")),
            **optional,
        )

    @classmethod
    def read(cls, path: str | PathLike[str], format: str | None = None) -> StarCatalog:
        """Read a catalog file: anything astropy's Table.read reads, with the column names of from_table().

        Args:
            path: File name.
            format: astropy's name of the format ("fits", "votable", "ascii.ecsv", "ascii.csv", ...); None guesses.

        Raises:
            InputError: The file is missing or cannot be read, or its content breaks a rule of from_table.
        """
        from astropy.table import Table  # slow to import, and only readers need it

        where = fspath(path)
        try:
            table = Table.read(where, format=format)
        except FileNotFoundError:
            raise InputError(f"{where}: no such file") from None
        except Exception as error:  # astropy's readers raise dozens of types for a file they cannot read
            reason = str(error).strip().splitlines() or [type(error).__name__]
            raise InputError(f"{where}: cannot be read as a table: {reason[0]}") from None
        try:
            return cls.from_table(table, name=str(table.meta.get("name", where)))
        except InputError as error:
            raise InputError(f"{where}: {error}") from None

    def to_table(self) -> Table:
        """Return an astropy Table that from_table() reads back: places at epoch_jyear, which is in its meta.

        Formats that keep no meta (CSV, VOTable) lose the epoch: write those from a catalog at 2000.0.
        """
        from astropy.table import Table

        table = Table(meta={"name": self.name, "epoch_jyear": self.epoch_jyear, "provenance": self.provenance})
        for key, unit in (
            ("ra_deg", "deg"),
            ("dec_deg", "deg"),
            ("pm_ra_mas_yr", "mas / yr"),
            ("pm_dec_mas_yr", "mas / yr"),
            ("parallax_mas", "mas"),
        ):
            table[key] = getattr(self, key)
            table[key].unit = unit
        for band in BAND_NAMES:
            table[f"flux_{band}_jy"] = self._flux_jy[band]
            table[f"flux_{band}_jy"].unit = "Jy"
        table["quality"] = self.quality
        table["id"] = self.id
        return table

    def __len__(self) -> int:
        return len(self.ra_deg)

    def __repr__(self) -> str:
        return f"StarCatalog({self.name!r}, {len(self)} stars, epoch {self.epoch_jyear})"

    @functools.cached_property
    def id(self) -> NDArray[np.str_]:
        """Names of the stars, shape (n,); of the default catalog: "HIP 71683", or "HGI 123" for row 123."""
        if self._id.dtype.kind == "U":
            return self._id.astype(np.str_)
        names = [f"HIP {hip}" if hip else f"HGI {row}" for row, hip in enumerate(self._id.tolist())]
        return _frozen(np.array(names, dtype=np.str_))

    def flux_jy(self, band: Band | str) -> Array:
        """Flux density [Jy], shape (n,); NaN where the catalog has none.

        Raises:
            InputError: The band is not one of the MSX bands.
        """
        return self._flux_jy[_msx_band(band).name]

    def irradiance_w_cm2(self, band: Band | str) -> Array:
        """In-band irradiance above the atmosphere [W/cm2], shape (n,): the flux density times the band's w_cm2_per_jy.

        A star without a flux gives 0: it is there, and adds no light.

        Raises:
            InputError: The band is not one of the MSX bands.
        """
        irradiance_w_cm2 = self.flux_jy(band) * _msx_band(band).w_cm2_per_jy
        return np.where(np.isnan(irradiance_w_cm2), 0.0, irradiance_w_cm2)

    def magnitude(self, band: Band | str) -> Array:
        """Magnitude against the band's zero_mag_jy, shape (n,); NaN where there is no flux, inf where it is 0.

        Raises:
            InputError: The band is not one of the MSX bands.
        """
        with np.errstate(divide="ignore"):
            return np.asarray(-2.5 * np.log10(self.flux_jy(band) / _msx_band(band).zero_mag_jy))

    def at_epoch(self, jyear: float) -> StarCatalog:
        """Return the catalog with its stars moved to another epoch.

        Rigorous space motion for stars at constant velocity without radial part: u(t) = normalize(u0 + t (mu_ra p +
        mu_dec q)), p east and q north (ESA 1997, SP-1200 vol. 1, eq. 1.2.16 without parallax and light time). Proper
        motions are carried along. Every call starts from the catalog as it was made, so a chain of calls adds no error.

        Args:
            jyear: Julian year, such as 2030.5, or an astropy Time.

        Raises:
            InputError: The year is not a finite number.
        """
        try:
            epoch_jyear = float(getattr(jyear, "jyear", jyear))
        except (TypeError, ValueError):
            raise InputError(f"jyear must be a number, got {jyear!r}") from None
        if not math.isfinite(epoch_jyear):
            raise InputError(f"jyear must be finite, got {epoch_jyear}")
        origin = self._origin or self
        if epoch_jyear == self.epoch_jyear:
            return self
        if epoch_jyear == origin.epoch_jyear:
            return origin
        east, north = _tangent(origin.ra_deg, origin.dec_deg)
        rate = _MAS_RAD * (origin.pm_ra_mas_yr[:, None] * east + origin.pm_dec_mas_yr[:, None] * north)
        place = origin.direction_icrs + (epoch_jyear - origin.epoch_jyear) * rate
        distance = np.linalg.norm(place, axis=1)[:, None]
        x, y, z = (place / distance).T
        ra_deg, dec_deg = np.degrees(np.arctan2(y, x)) % 360.0, np.degrees(np.arctan2(z, np.hypot(x, y)))
        east, north = _tangent(ra_deg, dec_deg)
        return make_catalog(
            ra_deg=ra_deg,
            dec_deg=dec_deg,
            pm_ra_mas_yr=np.sum(rate * east, axis=1) / distance[:, 0] / _MAS_RAD,
            pm_dec_mas_yr=np.sum(rate * north, axis=1) / distance[:, 0] / _MAS_RAD,
            parallax_mas=origin.parallax_mas / distance[:, 0],
            quality=origin.quality,
            epoch_jyear=epoch_jyear,
            name=self.name,
            provenance=self.provenance,
            flux_jy=origin._flux_jy,
            id=origin._id,
            origin=origin,
        )


def _frozen(values: NDArray[Any]) -> NDArray[Any]:
    values.setflags(write=False)
    return values


def make_catalog(
    *,
    ra_deg: Array,
    dec_deg: Array,
    pm_ra_mas_yr: Array,
    pm_dec_mas_yr: Array,
    parallax_mas: Array,
    quality: NDArray[np.int64],
    epoch_jyear: float,
    name: str,
    provenance: str,
    flux_jy: Mapping[str, Array],
    id: NDArray[Any],
    origin: StarCatalog | None = None,
) -> StarCatalog:
    """Make a catalog from checked columns, adding the directions; every array becomes read-only."""
    ra_rad, dec_rad = np.radians(ra_deg), np.radians(dec_deg)
    cos_dec = np.cos(dec_rad)
    direction = np.stack([cos_dec * np.cos(ra_rad), cos_dec * np.sin(ra_rad), np.sin(dec_rad)], axis=-1)
    return StarCatalog(
        direction_icrs=_frozen(direction),
        ra_deg=_frozen(ra_deg),
        dec_deg=_frozen(dec_deg),
        pm_ra_mas_yr=_frozen(pm_ra_mas_yr),
        pm_dec_mas_yr=_frozen(pm_dec_mas_yr),
        parallax_mas=_frozen(parallax_mas),
        quality=_frozen(quality),
        epoch_jyear=epoch_jyear,
        name=name,
        provenance=provenance,
        _flux_jy={band: _frozen(values) for band, values in flux_jy.items()},
        _id=_frozen(id),
        _origin=origin,
    )


def _tangent(ra_deg: Array, dec_deg: Array) -> tuple[Array, Array]:
    """Unit vectors to the east and north of each star, shape (n, 3); at a pole they follow the right ascension."""
    ra_rad, dec_rad = np.radians(ra_deg), np.radians(dec_deg)
    sin_ra, cos_ra, sin_dec, cos_dec = np.sin(ra_rad), np.cos(ra_rad), np.sin(dec_rad), np.cos(dec_rad)
    east = np.stack([-sin_ra, cos_ra, np.zeros_like(ra_rad)], axis=-1)
    north = np.stack([-sin_dec * cos_ra, -sin_dec * sin_ra, cos_dec], axis=-1)
    return east, north


def _vector(values: ArrayLike, where: str) -> Array:
    """Copy to a float64 vector."""
    try:
        vector = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{where} must be numbers, got {type(values).__name__}") from None
    if vector.ndim != 1:
        raise InputError(f"{where} must be a vector, got shape {vector.shape}")
    return vector


def _check_range(values: Array, low: float, high: float, where: str, rows: NDArray[np.int64]) -> None:
    """Raise for the first value outside [low, high]; NaN passes. `rows` are the user's row numbers."""
    bad = np.flatnonzero((values < low) | (values > high))
    if bad.size:
        rule = "finite and >= 0" if low == 0.0 else f"in [{low:g}, {high:g}]"
        raise InputError(f"{where} must be {rule}, got {values[bad[0]]:g} in row {rows[bad[0]]} ({bad.size} such rows)")


def _msx_band(band: Band | str) -> Band:
    """Return the MSX band meant; catalogs hold no flux in any other."""
    msx_band = as_band(band)
    if msx_band.name not in BANDS:
        raise InputError(f"band: a catalog has fluxes in {', '.join(BAND_NAMES)} only, got {msx_band.name!r}")
    return BANDS[msx_band.name]


def _table_column(table: Table, key: str, unit: str) -> Array:
    """Return a numeric column in a unit, NaN where masked."""
    column: Any = table[key]
    try:
        values = np.array(getattr(column, "unmasked", column), dtype=np.float64)
        if column.unit is not None and unit:
            from astropy.units import Unit

            values = values * Unit(column.unit).to(unit)
    except (TypeError, ValueError):  # UnitConversionError is a TypeError
        text = f"numbers in {unit}" if unit else "numbers"
        raise InputError(f"{key} must be {text}, got {column.dtype} in {column.unit or 'no unit'}") from None
    mask = getattr(column, "mask", None)
    return values if mask is None else np.where(np.asarray(mask), np.nan, values)
