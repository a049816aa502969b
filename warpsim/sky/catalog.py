"""Star catalogs: places, motions and fluxes."""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.directions import unit_vectors
from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import as_band
from warpsim.radiometry.magnitudes import Physics
from warpsim.sky.catalog_columns import (
    BAND_NAMES,
    J2000_JYEAR,
    checked_columns,
    checked_limits,
    columns_of_table,
    table_of,
)
from warpsim.sky.space_motion import paper_motion, rigorous_motion
from warpsim.sky.star_columns import StarColumns
from warpsim.sky.star_photometry import StarPhotometry

if TYPE_CHECKING:
    from astropy.table import Table

Array = NDArray[np.float64]

DEFAULT_N_STAR = 177_860
"""Stars of the default catalog, as many as the paper's has."""

INFRARED_UM = 2.5
"""Stars for bands below are chosen by brightness in the band, not at 8.3 um."""

LONGEST_MOTION_YR = 1e5
"""Beyond, a straight line is no model of a star's way, even in jest."""


@dataclass(frozen=True, eq=False, repr=False)
class StarCatalog:
    """Stars with place, motion and fluxes in photometric bands; immutable, all arrays read-only.

    The light of a star in any band from 0.3 to 30 um follows from a template spectrum of its temperature and luminosity
    class that meets its fluxes.

    Make one with `default`, `from_arrays`, `from_table`, `read`, `union` or `synthetic`. A catalog may be empty.
    """

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

    temperature_k: Array
    """Colour temperature as given [K], shape (n,); NaN where it was not (see `spectrum_temperature_k`)."""

    luminosity: NDArray[np.int8]
    """Luminosity class, shape (n,): 0 dwarf, 1 giant, -1 unknown."""

    quality: NDArray[np.int64]
    """Of the infrared flux, shape (n,): 0 unknown, 1 uncertain (1-2 mag), 2 fair (predicted, 0.15 mag), 3 good, 4
    excellent (measured)."""

    epoch_jyear: float
    """Julian year of the places (2000.0 is J2000)."""

    name: str
    provenance: str

    _photometry: StarPhotometry
    _id: NDArray[np.str_] | NDArray[np.int64]
    """Identifiers; whole numbers are spelled out by _spell_id when `id` is asked for."""

    _spell_id: tuple[str, str]
    """Prefix of a whole number in _id, and prefix of the row where that number is 0, or -1 - row: ("HIP ", "HGI ")."""

    _origin: StarCatalog | None
    """The catalog as it was made; every at_epoch() starts there, so that no error builds up."""

    @staticmethod
    def default(*bands: Band | str) -> StarCatalog:
        """Return the catalog that ships with warpsim: 177,860 stars down to magnitude 6.70 at 8.3 um (0.122 Jy).

        Fluxes are predicted from visible colours (scatter 0.15 mag; variables 1-2 mag). Made once, then shared.

        Args:
            bands: What the stars are for. For one whose half-power points lie up to 2.5 um they are the embedded stars
                brightest in it; for any other, or none, those brightest at 8.3 um; for several those of any of them.

        Raises:
            InputError: A band is unknown, or beyond 0.3 to 30 um.
        """
        known = [as_band(band) for band in bands]
        visible = tuple(band for band in known if band.half_power_um[1] <= INFRARED_UM)
        return _default_in(visible, len(visible) < len(known)) if visible else _default()

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
        temperature_k: ArrayLike | None = None,
        luminosity: ArrayLike | None = None,
        quality: ArrayLike | None = None,
        id: ArrayLike | None = None,
        flux_flag: Mapping[str, ArrayLike] | None = None,
        epoch_jyear: float = J2000_JYEAR,
        name: str = "stars",
        provenance: str = "",
    ) -> StarCatalog:
        """Make a catalog from plain arrays, all of shape (n,); they are copied.

        Rows whose place is not finite are left out, with a warning that counts and names them.

        Args:
            ra_deg: Right ascension [deg], ICRS, from -180 to 360.
            dec_deg: Declination [deg], ICRS, from -90 to 90.
            flux_jy: Flux density [Jy] by name of a photometric band (A, V, G, Ks, W1, ...); NaN where unknown.
            pm_ra_mas_yr: Proper motion in right ascension, cos(dec) included [mas/yr]; 0 if left out or NaN.
            pm_dec_mas_yr: Proper motion in declination [mas/yr]; 0 if left out or NaN.
            parallax_mas: Parallax [mas]; NaN if left out.
            temperature_k: Colour temperature [K]; NaN if left out. Where it is, the fluxes tell it if they can.
            luminosity: 0 dwarf, 1 giant, -1 unknown; -1 if left out or NaN.
            quality: 0 unknown, 1 uncertain, 2 fair, 3 good, 4 excellent; 0 if left out.
            id: Names; "1", "2", ... in the order given if left out.
            flux_flag: By band, 1 for a measured and 2 for a predicted flux; measured if left out.
            epoch_jyear: Julian year of the places.
            name: Name of the catalog.
            provenance: Where it is from.

        Raises:
            InputError: Shapes that differ, values that are not numbers, places out of range, negative or infinite
                flux, or an unknown band.
        """
        numbers = {
            "ra_deg": ra_deg,
            "dec_deg": dec_deg,
            "pm_ra_mas_yr": pm_ra_mas_yr,
            "pm_dec_mas_yr": pm_dec_mas_yr,
            "parallax_mas": parallax_mas,
            "temperature_k": temperature_k,
            "luminosity": luminosity,
            "quality": quality,
        }
        return _made(
            checked_columns(numbers, flux_jy, flux_flag, id, epoch_jyear=epoch_jyear, name=name, provenance=provenance)
        )

    @classmethod
    def from_table(cls, table: Table, name: str | None = None) -> StarCatalog:
        """Make a catalog from an astropy Table, as to_table() returns it.

        Columns: ra_deg, dec_deg and at least one flux or magnitude, such as flux_A_jy or mag_V, must be there, with the
        name of a photometric band between; pm_ra_mas_yr (cos(dec) included), pm_dec_mas_yr, parallax_mas,
        temperature_k, luminosity, quality, id and flags of the fluxes (flux_A_flag) may. A column with a unit is
        converted from it; one without is taken to be in the unit of its name. Masked values count as NaN. The epoch is
        meta["epoch_jyear"], or 2000.0.

        Args:
            table: Stars, one a row; no rows are legal.
            name: Name of the catalog; meta["name"] if left out.

        Raises:
            InputError: A column is missing, has another kind of unit, is of an unknown band, or breaks a rule of
                from_arrays; or a band has both flux and magnitude.
        """
        columns = columns_of_table(table)
        meta = {str(key).lower(): value for key, value in table.meta.items()}
        return cls.from_arrays(**columns, name=name or str(meta.get("name", "stars")))

    @classmethod
    def read(
        cls,
        path: str | PathLike[str],
        format: str | None = None,
        *,
        columns: Mapping[str, str] | None = None,
        readme: str | PathLike[str] | None = None,
        fill: bool = True,
    ) -> StarCatalog:
        """Read a catalog file: a survey as its archive gives it, or a table of one's own.

        The surveys and layouts known are in `warpsim.sky.readers`; they are recognised by their columns. Places are
        carried to J2000 where the catalog has proper motions. Rows without a place are left out, with a warning that
        counts and names them.

        Args:
            path: File name.
            format: Name of a survey ("msx-irac", "iras-psc", ...) or astropy's name of a file format ("fits",
                "votable", "ascii.ecsv", "ascii.csv", ...); None guesses.
            columns: For a table of one's own: which of its columns holds what, such as {"ra_deg": "RAJ2000",
                "flux_A_jy": "F8"}, by the column names of from_table().
            readme: ReadMe of a CDS file; a file ReadMe beside it is found by itself.
            fill: Whether flux_jy() of bands without a flux is predicted from the spectrum (flux_flag tells them apart).
                A table with flux_A_flag ... columns, such as to_table() writes, is taken as it is.

        Raises:
            InputError: The file is missing, cannot be read, or its content breaks a rule; the text names file, line
                and column.
        """
        from warpsim.sky.readers.read import read_stars

        stars = read_stars(path, format, columns=columns, readme=readme)
        catalog = _made(stars.columns)
        if fill and stars.may_be_filled:
            catalog = catalog.filled(stars.limit_jy)
        return catalog.at_epoch(stars.target_epoch_jyear)

    @staticmethod
    def union() -> StarCatalog:
        """Return all 490,000 stars that the default catalog was cut from, down to magnitude 10 in the visible.

        Needs the extra `catalogs`. Complete to magnitude 6.5 at 8.3 um; fluxes are predicted as in default().

        Raises:
            InputError: The extra's packages are not installed, or not of the version known.
        """
        return _union()

    @staticmethod
    def synthetic(
        n_star: int | None = None, *, limit_jy: float | None = None, sky: str = "astrometric", seed: int = 0
    ) -> StarCatalog:
        """Return made-up stars with the true sky's density over galactic latitude and magnitude, the same for a seed.

        Args:
            n_star: How many, over the whole sky; follows from limit_jy if left out.
            limit_jy: Flux density of the faintest at 8.3 um [Jy]; follows from n_star if left out.
            sky: "astrometric", like the visible-selected default catalog, or "infrared", ten times denser in the
                galactic plane.
            seed: Of the random numbers.

        Raises:
            InputError: Neither or both of n_star and limit_jy, or a value out of range.
        """
        from warpsim.sky.synthetic import synthetic_columns

        return _made(synthetic_columns(n_star, limit_jy, sky, seed)).filled()

    def filled(self, limit_jy: Mapping[str, Array] | None = None) -> StarCatalog:
        """Return the catalog with unknown fluxes predicted from the spectrum; their flux_flag is 2.

        Predictions follow from the fluxes given alone; a star without any stays without.

        Args:
            limit_jy: Upper limits by band [Jy], NaN for none, shape (n,): a prediction is no larger.

        Raises:
            InputError: Limits of an unknown band, of another shape, negative or no numbers.
        """
        limits = checked_limits(limit_jy or {}, len(self))
        photometry = replace(self._photometry, filled=True, limit_jy=limits)
        origin = None if self._origin is None else replace(self._origin, _photometry=photometry)
        return replace(self, _photometry=photometry, _origin=origin)

    def to_table(self) -> Table:
        """Return an astropy Table that from_table() reads back: places at epoch_jyear, which is in its meta.

        The MSX bands have columns always, with predictions if the catalog is filled; others where fluxes were given.
        Formats that keep no meta (CSV, VOTable) lose the epoch: write those from a catalog at 2000.0.
        """
        given = self._photometry
        columns = StarColumns(
            ra_deg=self.ra_deg,
            dec_deg=self.dec_deg,
            pm_ra_mas_yr=self.pm_ra_mas_yr,
            pm_dec_mas_yr=self.pm_dec_mas_yr,
            parallax_mas=self.parallax_mas,
            temperature_k=self.temperature_k,
            luminosity=self.luminosity,
            quality=self.quality,
            epoch_jyear=self.epoch_jyear,
            name=self.name,
            provenance=self.provenance,
            flux_jy={**given.given_jy, **{band: self.flux_jy(band) for band in BAND_NAMES}},
            flux_flag={**given.given_flag, **{band: self.flux_flag(band) for band in BAND_NAMES}},
            id=self.id,
        )
        return table_of(columns)

    @property
    def bands(self) -> tuple[str, ...]:
        """Names of the photometric bands in which fluxes were given."""
        return tuple(self._photometry.given_jy)

    @property
    def spectrum_luminosity(self) -> NDArray[np.int64]:
        """Luminosity class of the spectrum, shape (n,): as given, or from colour and parallax; 1 where unknown."""
        return self._photometry.spectrum_luminosity

    @property
    def spectrum_temperature_k(self) -> Array:
        """Colour temperature of the spectrum [K], shape (n,): as given, or from the fluxes; NaN for a K giant's."""
        return self._photometry.spectrum_temperature_k

    @functools.cached_property
    def direction_icrs(self) -> Array:
        """Unit vectors at epoch_jyear, ICRS axes, shape (n, 3)."""
        return _frozen(unit_vectors(self.ra_deg, self.dec_deg))

    def _rows(self, rows: NDArray[np.int64]) -> StarCatalog:
        """The stars in some rows, with the names that they have here."""
        photometry = self._photometry.rows(rows)
        numbers = ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas", "quality")
        arrays: dict[str, Any] = {key: _frozen(getattr(self, key)[rows]) for key in numbers}
        names = self._id[rows]
        if self._id.dtype.kind != "U":
            names = np.where(names == 0, -1 - rows, names)
        origin = None if self._origin is None else self._origin._rows(rows)
        return replace(
            self,
            **arrays,
            temperature_k=photometry.temperature_k,
            luminosity=photometry.luminosity,
            _photometry=photometry,
            _id=_frozen(names),
            _origin=origin,
        )

    def __len__(self) -> int:
        return len(self.ra_deg)

    def __repr__(self) -> str:
        return f"StarCatalog({self.name!r}, {len(self)} star{'' if len(self) == 1 else 's'}, epoch {self.epoch_jyear})"

    @functools.cached_property
    def id(self) -> NDArray[np.str_]:
        """Names of all stars, shape (n,); of the default catalog: "HIP 71683", or "HGI 123" for row 123."""
        return _frozen(self.id_of(np.arange(len(self))))

    def id_of(self, rows: NDArray[np.int64]) -> NDArray[np.str_]:
        """Names of the stars in some rows, of the shape of rows."""
        if self._id.dtype.kind == "U":
            return self._id[rows].astype(np.str_)
        named, unnamed = self._spell_id
        pairs = zip(rows.tolist(), self._id[rows].tolist(), strict=True)
        return np.array(
            [
                f"{named}{number}" if number > 0 else f"{unnamed}{-1 - number if number else row}"
                for row, number in pairs
            ],
            dtype=np.str_,
        )

    @functools.cached_property
    def checksum(self) -> str:
        """SHA-256 of the stars as the catalog was made (places, motions, light, names), in hexadecimal."""
        origin = self._origin or self
        light = origin._photometry
        bands = f"{list(light.given_jy)} {list(light.limit_jy)}"
        digest = hashlib.sha256(f"{origin.epoch_jyear} {origin._spell_id} {bands}".encode())
        for values in (
            origin.ra_deg,
            origin.dec_deg,
            origin.pm_ra_mas_yr,
            origin.pm_dec_mas_yr,
            origin.parallax_mas,
            origin.temperature_k,
            origin.luminosity,
            *light.given_jy.values(),
            *light.limit_jy.values(),
            origin._id,
        ):
            digest.update(np.ascontiguousarray(values).tobytes())
        return digest.hexdigest()

    def flux_jy(self, band: Band | str) -> Array:
        """Flux density [Jy], shape (n,), as given, or predicted if the catalog is filled; NaN where there is none.

        Raises:
            InputError: The band is not a photometric one that ships with warpsim.
        """
        return self._photometry.flux_jy(band)

    def flux_flag(self, band: Band | str) -> NDArray[np.uint8]:
        """What the flux in a band is, shape (n,): 0 unknown, 1 measured, 2 predicted.

        Raises:
            InputError: The band is not a photometric one that ships with warpsim.
        """
        return self._photometry.flux_flag(band)

    def irradiance_w_cm2(self, band: Band | str, physics: Physics = "physical") -> Array:
        """In-band irradiance above the atmosphere [W/cm2], shape (n,).

        In a photometric band in which the star has a flux: the flux density times the band's w_cm2_per_jy (in those of
        IRAS on the scale of the other surveys), or with physics "paper" the paper's irradiance of the magnitude. In any
        other band: the integral of energy response
        times spectrum; the spectrum is the template of the star's temperature and luminosity class times a smooth
        factor that meets the fluxes given (`warpsim.sky.stellar_spectrum`). A star without a flux gives 0: it is there,
        and adds no light.

        Args:
            band: Name of a band, or a Band; its half-power points must lie within 0.3 to 30 um.
            physics: "physical" or "paper"; the paper knows the MSX bands only.

        Raises:
            InputError: Unknown band or physics, a band beyond 0.3 to 30 um, or one that is not MSX's with "paper".
        """
        return self._photometry.irradiance_w_cm2(band, physics)

    def magnitude(self, band: Band | str) -> Array:
        """Magnitude, shape (n,); NaN where there is no flux, inf where it is 0.

        In a photometric band that of flux_jy() against the band's zero_mag_jy (Eq. 4); in any other that of the
        irradiance against the band's zero_mag_w_cm2.

        Raises:
            InputError: The band is unknown or has no zero point.
        """
        return self._photometry.magnitude(band)

    def at_epoch(self, jyear: float, physics: Physics = "physical") -> StarCatalog:
        """Return the catalog with its stars moved to another epoch; fluxes and names stay.

        Every call starts from the catalog as it was made, so a chain of calls adds no error.

        Args:
            jyear: Julian year, such as 2030.5, or an astropy Time.
            physics: "physical": rigorous space motion of constant velocity (proper motions and parallaxes are carried
                along). "paper": right ascension and declination linear in time, Eq. 5 of the paper, which errs for fast
                stars near a pole.

        Raises:
            InputError: The year is not a finite number, or physics is neither word.
        """
        epoch_jyear = _checked_jyear(jyear)
        if physics not in ("physical", "paper"):
            raise InputError('must be "physical" or "paper"', "physics", physics)
        origin = self._origin or self
        if epoch_jyear == origin.epoch_jyear:
            return origin
        start = (origin.ra_deg, origin.dec_deg, origin.pm_ra_mas_yr, origin.pm_dec_mas_yr)
        years = epoch_jyear - origin.epoch_jyear
        if not (np.any(origin.pm_ra_mas_yr) or np.any(origin.pm_dec_mas_yr)):
            return replace(origin, epoch_jyear=epoch_jyear, _origin=origin)
        if physics == "paper":
            ra_deg, dec_deg = paper_motion(*start, years)
            pm_ra, pm_dec, parallax_mas = origin.pm_ra_mas_yr, origin.pm_dec_mas_yr, origin.parallax_mas
        else:
            ra_deg, dec_deg, pm_ra, pm_dec, distance = rigorous_motion(*start, years)
            parallax_mas = origin.parallax_mas / distance
        moved = {
            "ra_deg": ra_deg,
            "dec_deg": dec_deg,
            "pm_ra_mas_yr": pm_ra,
            "pm_dec_mas_yr": pm_dec,
            "parallax_mas": parallax_mas,
        }
        arrays: dict[str, Any] = {key: _frozen(values) for key, values in moved.items()}
        return replace(origin, **arrays, epoch_jyear=epoch_jyear, _origin=origin)


def _checked_jyear(jyear: Any) -> float:
    try:
        epoch_jyear = float(getattr(jyear, "jyear", jyear))
    except (TypeError, ValueError):
        raise InputError("must be a number", "jyear", jyear) from None
    if not math.isfinite(epoch_jyear):
        raise InputError("must be finite", "jyear", epoch_jyear)
    if abs(epoch_jyear - J2000_JYEAR) > LONGEST_MOTION_YR:
        raise InputError(f"must be within {LONGEST_MOTION_YR:,.0f} years of 2000", "jyear", epoch_jyear, "g")
    return epoch_jyear


@functools.cache
def _embedded() -> tuple[StarCatalog, NDArray[np.int64]]:
    """All embedded stars, and the rows of those for the infrared."""
    from warpsim.sky.default_catalog import default_columns

    columns, infrared = default_columns()
    return _made(columns).filled(), infrared


@functools.cache
def _default() -> StarCatalog:
    embedded, infrared = _embedded()
    return embedded._rows(infrared)


@functools.lru_cache(maxsize=4)
def _default_in(bands: tuple[Band, ...], infrared: bool) -> StarCatalog:
    """The embedded stars brightest in any of some bands, or also at 8.3 um, in the order of the embedded table."""
    embedded, brightest = _embedded()
    chosen = np.zeros(len(embedded), dtype=bool)
    chosen[brightest] = infrared
    for band in bands:
        chosen[np.argpartition(-embedded.irradiance_w_cm2(band), DEFAULT_N_STAR)[:DEFAULT_N_STAR]] = True
    return embedded._rows(np.flatnonzero(chosen))


@functools.cache
def _union() -> StarCatalog:
    from warpsim.sky.union_catalog import union_columns

    return _made(union_columns()).filled()


def _made(columns: StarColumns) -> StarCatalog:
    """The catalog of columns; every array becomes read-only."""
    photometry = StarPhotometry(
        given_jy={band: _frozen(values) for band, values in columns.flux_jy.items()},
        given_flag={band: _frozen(values) for band, values in columns.flux_flag.items()},
        temperature_k=_frozen(columns.temperature_k),
        luminosity=_frozen(columns.luminosity),
        parallax_mas=columns.parallax_mas,
        pm_mas_yr=np.hypot(columns.pm_ra_mas_yr, columns.pm_dec_mas_yr),
    )
    return StarCatalog(
        ra_deg=_frozen(columns.ra_deg),
        dec_deg=_frozen(columns.dec_deg),
        pm_ra_mas_yr=_frozen(columns.pm_ra_mas_yr),
        pm_dec_mas_yr=_frozen(columns.pm_dec_mas_yr),
        parallax_mas=_frozen(columns.parallax_mas),
        temperature_k=photometry.temperature_k,
        luminosity=photometry.luminosity,
        quality=_frozen(columns.quality),
        epoch_jyear=columns.epoch_jyear,
        name=columns.name,
        provenance=columns.provenance,
        _photometry=photometry,
        _id=_frozen(columns.id),
        _spell_id=columns.spell_id,
        _origin=None,
    )


def _frozen(values: NDArray[Any]) -> NDArray[Any]:
    values.setflags(write=False)
    return values
