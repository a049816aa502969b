"""Stars: their positions, motions and names, and the light that follows from their fluxes."""

from __future__ import annotations

import functools
import hashlib
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.directions import unit_vectors
from warpsim.radiometry.band import Band
from warpsim.radiometry.magnitudes import Physics
from warpsim.sky.catalog_columns import StarColumns
from warpsim.sky.star_photometry import StarPhotometry

Array = NDArray[np.float64]

_CHUNK_NAMES = 1 << 16
"""Names spelled out at once for the checksum: memory is bounded."""


@dataclass(frozen=True, eq=False, repr=False)
class Stars:
    """Stars with positions, motions and light; immutable, all arrays read-only."""

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
    """Colour temperature as given, or of the spectral type [K], shape (n,); NaN where neither does (see
    `spectrum_temperature_k`)."""

    luminosity: NDArray[np.int8]
    """Luminosity class, shape (n,): 0 dwarf, 1 giant, -1 unknown."""

    quality: NDArray[np.int64]
    """Of the infrared flux, shape (n,): 0 unknown, 1 uncertain (1-2 mag), 2 fair (predicted, 0.15 mag), 3 good, 4
    excellent (measured)."""

    epoch_jyear: float
    """Julian year of the positions (2000.0 is J2000)."""

    name: str
    provenance: str

    _photometry: StarPhotometry
    _id: NDArray[np.str_] | NDArray[np.int64]
    """Identifiers; whole numbers are spelled out by _spell_id when `id` is asked for."""

    _spell_id: tuple[str, str]
    """Prefix of a whole number in _id, and prefix of the row where that number is 0, or -1 - row: ("HIP ", "HGI ")."""

    _origin: Self | None
    """The catalog as it was made; every at_epoch() starts there, so that no error builds up."""

    @classmethod
    def _of_columns(cls, columns: StarColumns) -> Self:
        """The stars of columns; every array becomes read-only."""
        photometry = StarPhotometry(
            given_jy={band: frozen(values) for band, values in columns.flux_jy.items()},
            given_flag={band: frozen(values) for band, values in columns.flux_flag.items()},
            temperature_k=frozen(columns.temperature_k),
            luminosity=frozen(columns.luminosity),
            parallax_mas=columns.parallax_mas,
            pm_mas_yr=np.hypot(columns.pm_ra_mas_yr, columns.pm_dec_mas_yr),
            filled=columns.filled,
            limit_jy=columns.limit_jy,
        )
        if columns.type_temperature_k is not None:
            photometry = photometry.with_types(columns.type_temperature_k)
        return cls(
            ra_deg=frozen(columns.ra_deg),
            dec_deg=frozen(columns.dec_deg),
            pm_ra_mas_yr=frozen(columns.pm_ra_mas_yr),
            pm_dec_mas_yr=frozen(columns.pm_dec_mas_yr),
            parallax_mas=frozen(columns.parallax_mas),
            temperature_k=photometry.temperature_k,
            luminosity=photometry.luminosity,
            quality=frozen(columns.quality),
            epoch_jyear=columns.epoch_jyear,
            name=columns.name,
            provenance=columns.provenance,
            _photometry=photometry,
            _id=frozen(columns.id),
            _spell_id=columns.spell_id,
            _origin=None,
        )

    def _rows(self, rows: NDArray[np.int64]) -> Self:
        """The stars in some rows, with the names that they have here."""
        photometry = self._photometry.rows(rows)
        numbers = ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas", "quality")
        arrays: dict[str, Any] = {key: frozen(getattr(self, key)[rows]) for key in numbers}
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
            _id=frozen(names),
            _origin=origin,
        )

    def __len__(self) -> int:
        return len(self.ra_deg)

    def __repr__(self) -> str:
        n_star = f"{len(self)} star{'' if len(self) == 1 else 's'}"
        return f"{type(self).__name__}({self.name!r}, {n_star}, epoch {self.epoch_jyear})"

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
        """Colour temperature of the spectrum [K], shape (n,): as given, or from a colour; 4850 without one."""
        return self._photometry.spectrum_temperature_k

    @functools.cached_property
    def direction_icrs(self) -> Array:
        """Unit vectors at epoch_jyear, ICRS axes, shape (n, 3)."""
        return frozen(unit_vectors(self.ra_deg, self.dec_deg))

    @functools.cached_property
    def id(self) -> NDArray[np.str_]:
        """Names of all stars, shape (n,); of the default catalog: "HIP 71683", or "HGI 123" for row 123."""
        return frozen(self.id_of(np.arange(len(self))))

    def id_of(self, rows: ArrayLike) -> NDArray[np.str_]:
        """Names of the stars in some rows, of the shape of rows; negative ones count from the end."""
        chosen = np.asarray(rows, dtype=np.int64)
        ids = np.asarray(self._id[chosen])
        if self._id.dtype.kind == "U":
            return np.asarray(ids, dtype=np.str_)
        named, unnamed = self._spell_id
        of_row = np.where(chosen < 0, chosen + len(self), chosen)
        names = [
            f"{named}{number}" if number > 0 else f"{unnamed}{-1 - number if number else row}"
            for row, number in np.stack([of_row.ravel(), ids.ravel()], axis=1).tolist()
        ]
        return np.array(names, dtype=np.str_).reshape(chosen.shape)

    @functools.cached_property
    def checksum(self) -> str:
        """SHA-256 of the stars as they were made (positions, motions, light, names), in hexadecimal."""
        origin = self if self._origin is None else self._origin
        light = origin._photometry
        digest = hashlib.sha256(f"{origin.epoch_jyear}".encode())

        def add(what: str, values: Array) -> None:
            digest.update(what.encode())
            digest.update(np.where(np.isnan(values), np.nan, values).tobytes())

        for name in ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas", "temperature_k"):
            add(name, getattr(origin, name))
        digest.update(np.ascontiguousarray(origin.luminosity).tobytes())
        for what, values_by_band in (("flux", light.given_jy), ("limit", light.limit_jy)):
            for band in sorted(values_by_band):
                if np.isfinite(values_by_band[band]).any():
                    add(f"{what} {band}", values_by_band[band])
        for start in range(0, len(origin), _CHUNK_NAMES):
            names = origin.id_of(np.arange(start, min(start + _CHUNK_NAMES, len(origin))))
            digest.update("\n".join(["", *names.tolist()]).encode())
        return digest.hexdigest()

    def flux_jy(self, band: Band | str) -> Array:
        """Flux density [Jy], shape (n,), as given, or predicted if the catalog is filled; NaN where there is none.

        Raises:
            InputError: The band is not a photometric one that ships with warpsim.
        """
        return self._photometry.flux_jy(band)

    def flux_flag(self, band: Band | str) -> NDArray[np.uint8]:
        """What the flux in a band is, shape (n,): 0 unknown, 1 measured, 2 predicted by the catalog, 3 filled in.

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


def frozen(values: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only and return it."""
    values.setflags(write=False)
    return values
