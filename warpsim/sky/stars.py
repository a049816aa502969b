"""Stars: their positions, motions and names, and the light that follows from their fluxes."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.arrays import F64
from warpsim.directions import unit_vectors
from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.magnitudes import Physics
from warpsim.sky.star_photometry import StarPhotometry, frozen

MOVED = ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas")
"""Numbers that change with the epoch."""

_CHUNK_NAMES = 1 << 16
"""Names spelled out at once for the checksum: memory is bounded."""


@dataclass(frozen=True, eq=False, repr=False)
class Stars:
    """Stars with positions, motions and light; immutable, all arrays read-only."""

    ra_deg: F64
    """Right ascension [deg], ICRS at epoch_jyear, in [0, 360), shape (n,)."""

    dec_deg: F64
    """Declination [deg], ICRS at epoch_jyear, shape (n,)."""

    pm_ra_mas_yr: F64
    """Proper motion in right ascension, cos(dec) included [mas/yr], at epoch_jyear, shape (n,)."""

    pm_dec_mas_yr: F64
    """Proper motion in declination [mas/yr], at epoch_jyear, shape (n,)."""

    parallax_mas: F64
    """Parallax [mas], shape (n,); NaN where unknown."""

    temperature_k: F64
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

    _spell_id: tuple[str, str] = ("", "")
    """Prefix of a whole number in _id, and prefix of the row where that number is 0, or -1 - row: ("HIP ", "HGI ")."""

    _origin: Self | None = None
    """The catalog as it was made; every at_epoch() starts there, so that no error builds up."""

    def __post_init__(self) -> None:
        for one in fields(self):
            if isinstance(values := getattr(self, one.name), np.ndarray):
                frozen(values)

    @classmethod
    def _made(
        cls,
        *,
        flux_jy: Mapping[str, F64],
        flux_flag: Mapping[str, NDArray[np.uint8]],
        id: NDArray[Any],
        spell_id: tuple[str, str] = ("", ""),
        filled: bool = False,
        type_temperature_k: F64 | None = None,
        limit_jy: Mapping[str, F64] | None = None,
        **columns: Any,
    ) -> Self:
        """The stars of columns that break no rule, by the names of the fields; every array becomes read-only.

        Args:
            flux_jy: Flux density [Jy] by photometric band, those that the catalog has; NaN where unknown.
            flux_flag: What the fluxes are, for the same bands: 0 unknown, 1 measured, 2 predicted by the catalog.
            id: Names, or whole numbers that spell_id spells out.
            spell_id: As _spell_id.
            filled: Whether the other fluxes are to be predicted from the spectrum.
            type_temperature_k: Temperatures of a dwarf and of a giant of the star's spectral type [K], (n, 2), NaN
                without a type: for stars whose temperature neither temperature_k nor a colour gives.
            limit_jy: Upper limits of predicted fluxes by band [Jy], NaN for none.
            columns: The other fields.
        """
        photometry = StarPhotometry(
            given_jy=flux_jy,
            given_flag=flux_flag,
            temperature_k=columns.pop("temperature_k"),
            luminosity=columns["luminosity"],
            parallax_mas=columns["parallax_mas"],
            pm_mas_yr=np.hypot(columns["pm_ra_mas_yr"], columns["pm_dec_mas_yr"]),
            filled=filled,
            limit_jy=limit_jy or {},
        )
        if type_temperature_k is not None:
            photometry = photometry.with_types(type_temperature_k)
        return cls(
            **columns, temperature_k=photometry.temperature_k, _photometry=photometry, _id=id, _spell_id=spell_id
        )

    @classmethod
    def _of(cls, stars: Stars) -> Self:
        """The same stars as an object of this class."""
        return cls(**{one.name: getattr(stars, one.name) for one in fields(stars)})

    def _rows(self, rows: NDArray[np.int64]) -> Self:
        """The stars in some rows, with the names that they have here."""
        photometry = self._photometry.rows(rows)
        arrays: dict[str, Any] = {key: getattr(self, key)[rows] for key in (*MOVED, "quality")}
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
            _id=names,
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
    def spectrum_temperature_k(self) -> F64:
        """Colour temperature of the spectrum [K], shape (n,): as given, or from a colour; 4850 without one."""
        return self._photometry.spectrum_temperature_k

    @functools.cached_property
    def direction_icrs(self) -> F64:
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
        if self._origin is not None:
            return self._origin.checksum
        light = self._photometry
        digest = hashlib.sha256(f"{self.epoch_jyear}".encode())

        def add(what: str, values: F64) -> None:
            digest.update(what.encode())
            digest.update(np.where(np.isnan(values), np.nan, values).tobytes())

        for name in (*MOVED, "temperature_k"):
            add(name, getattr(self, name))
        digest.update(np.ascontiguousarray(self.luminosity).tobytes())
        for what, values_by_band in (("flux", light.given_jy), ("limit", light.limit_jy)):
            for band in sorted(values_by_band):
                if np.isfinite(values_by_band[band]).any():
                    add(f"{what} {band}", values_by_band[band])
        for start in range(0, len(self), _CHUNK_NAMES):
            names = self.id_of(np.arange(start, min(start + _CHUNK_NAMES, len(self))))
            digest.update("\n".join(["", *names.tolist()]).encode())
        return digest.hexdigest()

    def flux_jy(self, band: Band | str) -> F64:
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

    def irradiance_w_cm2(self, band: Band | str, physics: Physics = "physical") -> F64:
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

    def magnitude(self, band: Band | str) -> F64:
        """Magnitude, shape (n,); NaN where there is no flux, inf where it is 0.

        In a photometric band that of flux_jy() against the band's zero_mag_jy (Eq. 4); in any other that of the
        irradiance against the band's zero_mag_w_cm2.

        Raises:
            InputError: The band is unknown or has no zero point.
        """
        return self._photometry.magnitude(band)


def joined(parts: Sequence[Stars]) -> Stars:
    """All stars of several parts of a catalog, one behind the other; bands are those of any of them.

    Raises:
        InputError: Their epochs differ.
    """
    first = parts[0]
    if len(parts) == 1:
        return first
    for part in parts:
        if part.epoch_jyear != first.epoch_jyear:
            rule = (
                f"must be of one epoch, got {first.epoch_jyear:g} ({first.name}) and {part.epoch_jyear:g} ({part.name})"
            )
            raise InputError(rule, "epoch_jyear")
    lights = [part._photometry for part in parts]

    def by_band(name: str, unknown: Any) -> dict[str, NDArray[Any]]:
        bands = dict.fromkeys(band for light in lights for band in getattr(light, name))
        none = [np.broadcast_to(unknown, len(part)) for part in parts]
        columns = [getattr(light, name) for light in lights]
        return {
            band: np.concatenate([one.get(band, empty) for one, empty in zip(columns, none, strict=True)])
            for band in bands
        }

    names = (*MOVED, "temperature_k", "luminosity", "quality")
    columns: dict[str, Any] = {key: np.concatenate([getattr(part, key) for part in parts]) for key in names}
    return first._made(
        **columns,
        epoch_jyear=first.epoch_jyear,
        name=first.name,
        provenance=first.provenance,
        flux_jy=by_band("given_jy", np.nan),
        flux_flag=by_band("given_flag", np.uint8(0)),
        limit_jy=by_band("limit_jy", np.nan),
        id=np.concatenate([part._id for part in parts]),
        filled=all(light.filled for light in lights),
    )
