"""MSX: the Infrared Astrometric Catalog (V/98), and the Point Source Catalog, versions 1.2 (V/107) and 2.3 (V/114)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.sky.catalog_columns import BAND_NAMES, FLUX_PREDICTED
from warpsim.sky.readers.angles import Pair, place_deg
from warpsim.sky.readers.photometry import FAIR, UNCERTAIN, UNKNOWN, band_flux_jy
from warpsim.sky.readers.survey import Survey, SurveyStars
from warpsim.tables.columns import ColumnTable, plain_name

Array = NDArray[np.float64]

_MAS_PER_TIME_S = 15_000.0  # a second of right ascension is 15 arcsec
_CENTURY_YR = 100.0

_NONE, _LIMIT, _EXCELLENT = 0, 1, 4
"""Flux quality of the Point Source Catalog: none, upper limit, and from fair (2) to excellent."""

_PSC_EPOCH_JYEAR = 1996.6
"""Middle of the cryogenic observations, May 1996 to February 1997; there are no proper motions."""

_PSC_PLACES: tuple[Pair, ...] = (("RAJ2000", "DEJ2000"), ("RAdeg", "DEdeg"), ("ra", "dec"))


def _convert_irac(table: ColumnTable) -> SurveyStars:
    ra_deg, dec_deg, _ = place_deg(table)
    # Per century, and in right ascension the rate of the angle itself, in seconds of time.
    pm_ra = _rate(table, "pmRA", "0.01 s / yr") / _CENTURY_YR * _MAS_PER_TIME_S * np.cos(np.radians(dec_deg))
    pm_dec = _rate(table, "pmDE", "0.01 arcsec / yr") / _CENTURY_YR * 1000.0
    flux_jy = {band: table.number(f"FSIII{band}", unit="Jy", null=(0.0,)) for band in BAND_NAMES}
    known = np.any([np.isfinite(values) for values in flux_jy.values()], axis=0)
    visible_jy = band_flux_jy("V", table.number("Vmag", unit="mag"))
    return SurveyStars(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        flux_jy=flux_jy | {"V": visible_jy},
        flux_flag={band: np.full(len(table), FLUX_PREDICTED) for band in BAND_NAMES},
        pm_ra_mas_yr=pm_ra,
        pm_dec_mas_yr=pm_dec,
        quality=np.where(known, FAIR, np.where(np.isnan(visible_jy), UNKNOWN, UNCERTAIN)),
        notes=(
            "infrared fluxes are the catalog's predictions",
            "pmRA times 150 cos(dec), pmDE times 10: per century to mas/yr",
        ),
    )


def _convert_psc(table: ColumnTable) -> SurveyStars:
    ra_deg, dec_deg, _ = place_deg(table, *_PSC_PLACES)
    flux_jy, limit_jy, best = {}, {}, np.zeros(len(table))
    for band in BAND_NAMES:
        if table.find(band) is None:
            continue
        # Without its quality a flux may be a limit: a table with the flux must have the quality.
        quality = table.needed(f"q_{band}")
        bad = np.flatnonzero((quality < _NONE) | (quality > _EXCELLENT))
        if bad.size:
            raise InputError("must be in [0, 4]", f"q_{band}", quality[bad[0]], "g", row=int(bad[0]))
        given = table.number(band, unit="Jy", null=(0.0,))
        flux_jy[band] = np.where(quality > _LIMIT, given, np.nan)
        # Some releases mark limits by a minus sign.
        limit_jy[band] = np.where(quality == _LIMIT, np.abs(given), np.nan)
        best = np.fmax(best, np.where(np.isnan(flux_jy[band]), 0.0, quality))
    return SurveyStars(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        flux_jy=flux_jy,
        limit_jy=limit_jy,
        quality=best.astype(np.int64),
        id=table.text(*_PSC_NAMES) if table.find(*_PSC_NAMES) else None,
        epoch_jyear=_PSC_EPOCH_JYEAR,
        notes=("quality is that of the best band", "fluxes of quality 1 are upper limits"),
    )


def _rate(table: ColumnTable, name: str, unit: str) -> Array:
    """A proper motion in the catalog's own unit, per century; NaN where there is none.

    Archives spell that unit in ways astropy does not know: such a spelling is taken for it.
    """
    own_name = table.find(name)
    if own_name is None:
        return table.number(name)
    from astropy.units import UnrecognizedUnit

    stated = table.table[own_name].unit
    if isinstance(stated, UnrecognizedUnit):
        if plain_name(str(stated)) not in _PER_CENTURY:
            raise InputError(f"must be in {unit} or the like", own_name, str(stated), "s")
        unit = ""
    return table.number(name, unit=unit)


_PER_CENTURY = ("sha", "arcsecha", "s100yr", "arcsec100yr", "scy", "arcseccy", "scentury", "arcseccentury")
"""Units of the catalog as archives spell them, without case and punctuation; ha is the CDS's hundred years."""

_PSC_NAMES = ("MSX6C", "MSX5C", "MSX6C_ID", "MSX5C_ID", "name")

SURVEYS = (
    Survey(
        name="msx-irac",
        title="MSX Infrared Astrometric Catalog, version 4.2.1",
        reference="V/98 (Egan and Price 1996, AJ 112, 2862)",
        needs=(("FSIIIA",),),
        convert=_convert_irac,
    ),
    Survey(
        name="msx-psc",
        title="MSX Point Source Catalog, version 2.3",
        reference="V/114 (Egan et al. 2003, AFRL-VS-TR-2003-1589)",
        needs=(("A",), ("q_A",)),
        convert=_convert_psc,
    ),
    Survey(
        name="msx-psc-v1",
        title="MSX Point Source Catalog, version 1.2",
        reference="V/107 (Egan et al. 1999, AFRL-VS-TR-1999-1522)",
        needs=(("A",), ("q_A",), ("MSX5C", "MSX5C_ID")),
        convert=_convert_psc,
    ),
)
