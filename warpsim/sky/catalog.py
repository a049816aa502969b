"""Star catalogs: made from arrays, tables, files and what ships with warpsim; moved to another epoch."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.magnitudes import Physics
from warpsim.sky.catalog_columns import checked_columns, checked_limits
from warpsim.sky.positions import J2000_JYEAR, checked_jyear, paper_motion, rigorous_motion
from warpsim.sky.readers.own_table import stars_of_table, table_of
from warpsim.sky.star_photometry import warn_colours
from warpsim.sky.stars import MOVED, Stars, joined

if TYPE_CHECKING:
    from astropy.table import Table

    from warpsim.sky.readers.read import StarsOfFile
    from warpsim.sky.readers.read_options import FileNames


class StarCatalog(Stars):
    """Stars with position, motion and fluxes in photometric bands; immutable, all arrays read-only.

    The light of a star in any band from 0.3 to 30 um follows from a template spectrum of its temperature and luminosity
    class that meets its fluxes.

    Make one with `default`, `from_arrays`, `from_table`, `read`, `union` or `synthetic`. A catalog may be empty.
    """

    @staticmethod
    def default(*bands: Band | str) -> StarCatalog:
        """Return the catalog that ships with warpsim: 177,860 stars down to magnitude 6.70 at 8.3 um (0.122 Jy).

        Fluxes are predicted from visible colours (scatter 0.15 mag; variables 1-2 mag). Made once, then shared.

        The stars of a band depend on the bands asked for with it: those chosen for the others are there as well, below
        the band's own limit. With V and A they add 2.5 % to the starlight of the sky in V, and 1.2 % in A.

        Args:
            bands: What the stars are for, in any order. For one whose half-power points lie up to 2.5 um they are the
                embedded stars brightest in it; for any other, or none, those brightest at 8.3 um; for several those of
                any of them.

        Raises:
            InputError: A band is unknown, or beyond 0.3 to 30 um.
        """
        from warpsim.sky.default_catalog import visible_bands

        visible, infrared = visible_bands(bands)
        return _default_in(visible, infrared) if visible else _default()

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
        spectral_type: ArrayLike | None = None,
        flux_flag: Mapping[str, ArrayLike] | None = None,
        epoch_jyear: float = J2000_JYEAR,
        name: str = "stars",
        provenance: str = "",
    ) -> StarCatalog:
        """Make a catalog from plain arrays, all of shape (n,); they are copied.

        Rows whose position is not finite are left out, with a warning that counts and names them.

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
            spectral_type: Such as "K3III" or "M2.5V": tell temperature and luminosity class where these are unknown;
                without a class ("K2") a temperature where no colour gives one either, that of the star's class.
                Types that are not understood tell nothing, with a warning that counts them.
            flux_flag: By band, 1 for a measured flux, 2 for one that the catalog predicts, 3 for one filled in from the
                spectrum, which is left out and predicted anew; measured if left out.
            epoch_jyear: Julian year of the positions.
            name: Name of the catalog.
            provenance: Where it is from.

        Raises:
            InputError: Shapes that differ, values that are not numbers, positions out of range, negative or infinite
                flux, or an unknown band.
        """
        stars = checked_columns(
            ra_deg=ra_deg,
            dec_deg=dec_deg,
            pm_ra_mas_yr=pm_ra_mas_yr,
            pm_dec_mas_yr=pm_dec_mas_yr,
            parallax_mas=parallax_mas,
            temperature_k=temperature_k,
            luminosity=luminosity,
            quality=quality,
            flux_jy=flux_jy,
            flux_flag=flux_flag,
            id=id,
            spectral_type=spectral_type,
            epoch_jyear=epoch_jyear,
            name=name,
            provenance=provenance,
        )
        return cls._of(stars)

    @classmethod
    def from_table(cls, table: Table, name: str | None = None) -> StarCatalog:
        """Make a catalog from an astropy Table, as to_table() returns it.

        Columns: ra_deg, dec_deg and at least one flux or magnitude, such as flux_A_jy or mag_V, must be there, with the
        name of a photometric band between; pm_ra_mas_yr (cos(dec) included), pm_dec_mas_yr, parallax_mas,
        temperature_k, luminosity, spectral_type, quality, id, flags of the fluxes (flux_A_flag) and upper limits of
        predicted ones (flux_A_limit_jy) may. A column with a unit is converted from it; one without is taken to be in
        the unit of its name. Masked values count as NaN. The epoch is meta["epoch_jyear"], or 2000.0.

        Fluxes flagged 3, filled in from the spectrum, are left out and predicted anew, so that the catalog is the same.

        Args:
            table: Stars, one a row; no rows are legal.
            name: Name of the catalog; meta["name"] if left out.

        Raises:
            InputError: A column is missing, has another kind of unit, is of an unknown band, or breaks a rule of
                from_arrays; or a band has both flux and magnitude.
        """
        return cls._of(stars_of_table(table, name))

    @classmethod
    def read(
        cls,
        path: FileNames,
        format: str | None = None,
        *,
        columns: Mapping[str, str] | None = None,
        table: str | int | None = None,
        epoch_jyear: float | None = None,
        region: ArrayLike | None = None,
        limit: Mapping[str, float] | None = None,
        readme: str | PathLike[str] | None = None,
        fill: bool = True,
    ) -> StarCatalog:
        """Read a catalog file: a survey as its archive gives it, or a table of one's own.

        The surveys and layouts known are in `warpsim.sky.readers`; they are recognised by their columns. Places are
        carried to J2000 where the catalog has proper motions. Rows without a position are left out, with a warning that
        counts and names them; stars of a custom table without colour, type or temperature are counted if filled.

        Args:
            path: File name, or a list of them; a folder, whose files are read in the order of their names, or a HATS
                folder. Of Parquet files only columns that are used are read.
            format: Name of a survey ("msx-irac", "iras-psc", ...) or astropy's name of a file format ("fits",
                "votable", "ascii.ecsv", "ascii.csv", ...); None guesses.
            columns: Which column of the file holds what, such as {"ra_deg": "RAJ2000", "flux_A_jy": "F8"}, by the
                column names of from_table(). With the format of a survey: by the survey's names for its own columns
                ({"Gmag": "G_corrected"}), and by those of from_table() for what goes before the survey's.
            table: Which of several tables in the file, by name or number, counted from 1; the first that holds stars
                if left out, with a warning.
            epoch_jyear: Julian year of the positions, where the file does not tell it, or tells it wrong.
            region: Stars wanted: those in a cone (ra_deg, dec_deg, radius_deg), or in any of several, by positions as
                they stand in the file. Of Parquet files row groups elsewhere are not read, nor partitions of HATS.
            limit: Stars wanted: those not fainter than a magnitude, in any of some bands of the file, {"W3": 8.0}.
            readme: ReadMe of a CDS file; a file ReadMe beside it is found by itself.
            fill: Whether flux_jy() of bands without a flux is predicted from the spectrum, with flux_flag 3.
                A table that flags its fluxes (flux_A_flag ...) and none of them as filled in is taken as it is.

        Raises:
            InputError: The file is missing, cannot be read, or its content breaks a rule; the text names file, line
                and column.
        """
        from warpsim.sky.readers.read import read_stars
        from warpsim.sky.readers.read_options import ReadOptions

        stars = read_stars(path, ReadOptions(format, columns, table, epoch_jyear, readme, region, limit))
        catalog = cls._of_files([stars])
        if not fill:
            return catalog._lit(filled=False)
        if stars.is_own:
            warn_colours(str(path), catalog._photometry)
        return catalog

    @classmethod
    def _of_files(cls, parts: Sequence[StarsOfFile]) -> StarCatalog:
        """The stars of some files, one behind the other, at the epoch that readers move them to."""
        return cls._of(joined([part.stars for part in parts])).at_epoch(parts[0].target_epoch_jyear)

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
        """Return synthetic stars with the true sky's density over galactic latitude and magnitude, the same for a seed.

        Args:
            n_star: How many, over the whole sky; follows from limit_jy if left out.
            limit_jy: Flux density of the faintest at 8.3 um [Jy]; follows from n_star if left out.
            sky: "astrometric", like the visible-selected default catalog, or "infrared", ten times denser in the
                galactic plane.
            seed: Of the random numbers.

        Raises:
            InputError: Neither or both of n_star and limit_jy, or a value out of range.
        """
        from warpsim.sky.synthetic import synthetic_stars

        return StarCatalog._of(synthetic_stars(n_star, limit_jy, sky, seed))

    def filled(self, limit_jy: Mapping[str, F64] | None = None) -> StarCatalog:
        """Return the catalog with unknown fluxes predicted from the spectrum; their flux_flag is 3.

        Predictions follow from the fluxes given alone; a star without any stays without.

        Args:
            limit_jy: Upper limits by band [Jy], NaN for none, shape (n,): a prediction is no larger; those that the
                catalog has if left out.

        Raises:
            InputError: Limits of an unknown band, of another shape, negative or no numbers.
        """
        limits = self._photometry.limit_jy if limit_jy is None else checked_limits(limit_jy, len(self))
        return self._lit(filled=True, limit_jy=limits)

    def _lit(self, **light: Any) -> StarCatalog:
        """The catalog with some fields of its photometry changed, at every epoch."""
        photometry = replace(self._photometry, **light)
        origin = None if self._origin is None else replace(self._origin, _photometry=photometry)
        return replace(self, _photometry=photometry, _origin=origin)

    def to_table(self) -> Table:
        """Return an astropy Table that from_table() reads back: positions at epoch_jyear, which is in its meta.

        The MSX bands have columns always, filled in from the spectrum (flag 3) if the catalog is filled; others where
        fluxes were given.
        Formats that keep no meta (CSV, VOTable) lose the epoch: write those from a catalog at 2000.0.
        """
        return table_of(self, self._photometry)

    def at_epoch(self, jyear: float, physics: Physics = "physical") -> Self:
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
        epoch_jyear = checked_jyear(jyear)
        if physics not in ("physical", "paper"):
            raise InputError('must be "physical" or "paper"', "physics", physics)
        origin = self if self._origin is None else self._origin
        if epoch_jyear == origin.epoch_jyear:
            return origin
        moved: dict[str, Any] = {}
        start = (origin.ra_deg, origin.dec_deg, origin.pm_ra_mas_yr, origin.pm_dec_mas_yr)
        if np.any(origin.pm_ra_mas_yr) or np.any(origin.pm_dec_mas_yr):
            years = epoch_jyear - origin.epoch_jyear
            if physics == "paper":
                moved = dict(zip(MOVED[:2], paper_motion(*start, years), strict=True))
            else:
                *numbers, distance = rigorous_motion(*start, years)
                moved = dict(zip(MOVED, (*numbers, origin.parallax_mas / distance), strict=True))
        return replace(origin, **moved, epoch_jyear=epoch_jyear, _origin=origin)


@functools.cache
def _embedded() -> tuple[StarCatalog, NDArray[np.int64]]:
    """All embedded stars, and the rows of those for the infrared."""
    from warpsim.sky.default_catalog import embedded_stars

    stars, infrared = embedded_stars()
    return StarCatalog._of(stars), infrared


@functools.cache
def _default() -> StarCatalog:
    embedded, infrared = _embedded()
    return embedded._rows(infrared)


@functools.lru_cache(maxsize=4)
def _default_in(bands: frozenset[Band], infrared: bool) -> StarCatalog:
    """The embedded stars brightest in any of some bands, or also at 8.3 um, in the order of the embedded table."""
    from warpsim.sky.default_catalog import brightest_rows

    embedded, brightest = _embedded()
    return embedded._rows(brightest_rows(embedded, bands, brightest if infrared else brightest[:0]))


@functools.cache
def _union() -> StarCatalog:
    from warpsim.sky.hip_gaia import union_catalog

    return StarCatalog._of(union_catalog())
