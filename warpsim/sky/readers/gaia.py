"""Gaia DR2 and DR3, as the Gaia archive and VizieR (I/345, I/355) name their columns: G, BP and RP."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.sky.readers.angles import Pair, epoch_of_place, place_deg
from warpsim.sky.readers.photometry import (
    FAIR,
    band_flux_jy,
    count_note,
    predicted_quality,
    real_colours,
    real_magnitudes,
    star_names,
)
from warpsim.sky.readers.survey import Survey, SurveyStars
from warpsim.sky.visible_photometry import gaia_bp_rp_mag
from warpsim.sky.visible_stars import by_gaia
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]

EPOCH_JYEAR = 2016.0
"""Of DR3 and EDR3."""

DR2_EPOCH_JYEAR = 2015.5

SATURATED_G_MAG = 3.5
"""Gaia's magnitudes of brighter stars are saturated."""

_G, _BP, _RP = ("phot_g_mean_mag", "Gmag"), ("phot_bp_mean_mag", "BPmag"), ("phot_rp_mean_mag", "RPmag")
_BP_RP = ("bp_rp", "BP-RP")
_PLACES: tuple[Pair, ...] = (("ra", "dec"), ("RA_ICRS", "DE_ICRS"), ("RAJ2000", "DEJ2000"))


def _convert(table: ColumnTable) -> SurveyStars:
    ra_deg, dec_deg, ra_name = place_deg(table, *_PLACES)
    g_mag = table.needed(*_G, unit="mag")
    bp_mag, rp_mag = (real_magnitudes(table.number(*names, unit="mag")) for names in (_BP, _RP))
    from_colour = np.isnan(bp_mag) | np.isnan(rp_mag)
    by_colour = gaia_bp_rp_mag(real_magnitudes(g_mag), real_colours(table.number(*_BP_RP, unit="mag")))
    magnitudes = {
        "G": real_magnitudes(g_mag),
        "BP": np.where(from_colour, by_colour[0], bp_mag),
        "RP": np.where(from_colour, by_colour[1], rp_mag),
    }
    colour = magnitudes["BP"] - magnitudes["RP"]
    has_colour, has_flux = ~np.isnan(colour), np.any(~np.isnan(list(magnitudes.values())), axis=0)
    parallax_mas = table.number("parallax", "Plx", unit="mas")
    motion = table.number("pmra", unit="mas / yr"), table.number("pmdec", "pmDE", unit="mas / yr")
    seen = by_gaia(magnitudes["G"], colour, parallax_mas, np.hypot(*motion), np.nan)
    doubtful = (g_mag <= SATURATED_G_MAG) | (seen.quality != FAIR)
    return SurveyStars(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        flux_jy={band: band_flux_jy(band, values) for band, values in magnitudes.items()},
        pm_ra_mas_yr=motion[0],
        pm_dec_mas_yr=motion[1],
        parallax_mas=parallax_mas,
        temperature_k=seen.temperature_k,
        luminosity=seen.luminosity,
        quality=predicted_quality(has_flux, has_colour, doubtful),
        id=star_names(table, "Gaia ", "designation", "DR3Name", "DR2Name", "source_id", "Source"),
        epoch_jyear=epoch_of_place(ra_name, _epoch_jyear(table)),
        notes=(
            *_assumed_epoch(table),
            *count_note(has_flux & from_colour & has_colour, "have no BP or RP: from G and BP-RP"),
            *count_note(has_flux & ~has_colour, "have no BP-RP, so no colour"),
            *count_note(~has_flux, "have no G, BP or RP, so no flux"),
        ),
    )


def _epoch_jyear(table: ColumnTable) -> float:
    """Reference epoch: the table's own, else that of the release it says it is from, else that of DR3."""
    name = table.find("ref_epoch", "Epoch")
    if name is not None:
        epochs = np.unique(table.number(name))
        epochs = epochs[~np.isnan(epochs)]
        if len(epochs) > 1:
            raise InputError(f"must be the same in all rows, got {epochs[0]:g} and {epochs[-1]:g}", name)
        if len(epochs) == 1:
            return float(epochs[0])
    names = table.text("designation", "DR2Name")
    described = " ".join(str(value) for value in table.table.meta.values())
    from_dr2 = (len(names) > 0 and names[0].startswith("Gaia DR2")) or "I/345" in described or "I_345" in described
    return DR2_EPOCH_JYEAR if from_dr2 else EPOCH_JYEAR


def _assumed_epoch(table: ColumnTable) -> tuple[str, ...]:
    """A note where nothing but the newest release's habit says the epoch."""
    stated = table.find("ref_epoch", "Epoch", "designation", "DR3Name", "DR2Name") or table.table.meta
    return () if stated else (f"reference epoch {EPOCH_JYEAR:g} assumed, that of DR3",)


SURVEYS = (
    Survey(
        name="gaia",
        title="Gaia",
        reference="Gaia Collaboration: DR2 I/345, DR3 I/355 (2023, A&A 674, A1)",
        needs=(_G, (*_BP_RP, *_BP)),
        convert=_convert,
    ),
)
