"""Surveys in the visible: Hipparcos (1997, and its new reduction of 2007) and Gaia (DR2 and DR3, told apart)."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.sky.readers.survey import (
    FAIR,
    Pair,
    Position,
    Survey,
    angle_deg,
    band_flux_jy,
    count_note,
    position_deg,
    predicted_quality,
    real_colours,
    real_magnitudes,
)
from warpsim.sky.stellar_templates import GIANT, colour, colour_temperature_k
from warpsim.sky.visible_stars import (
    SAME_TEMPERATURE,
    VisibleStars,
    by_gaia,
    by_hipparcos,
    gaia_bp_rp_mag,
    hipparcos_v_mag,
)
from warpsim.tables.columns import ColumnTable, plain_name

HIPPARCOS_EPOCH_JYEAR = 1991.25
COOL_GIANT_K = 4000.0
REDDEST_B_MINUS_V_MAG = 1.45
"""Beyond, B-V says nothing of a star's temperature."""

_HIPPARCOS_POSITIONS: tuple[Pair, ...] = (
    ("RA_ICRS", "DE_ICRS"),
    ("RAdeg", "DEdeg"),
    ("RArad", "DErad"),
    ("RAhms", "DEdms"),
    ("ra", "dec"),
    ("RAJ2000", "DEJ2000"),
)

EPOCH_JYEAR = {"DR1": 2015.0, "DR2": 2015.5, "DR3": 2016.0}
"""Reference epochs of the releases (Lindegren et al. 2016, A&A 595, A4; 2018, A&A 616, A2; 2021, A&A 649, A2); that of
EDR3 is DR3's."""

_NAMED = {
    "DR1": r"I[/_]337(?!\d)|gaia[ _]?dr1",
    "DR2": r"I[/_]345(?!\d)|gaia[ _]?dr2|gaia2(?![a-z0-9])",
    "DR3": r"I[/_]35[05](?!\d)|gaia[ _]?e?dr3",
}
"""What archives call the releases in the headers of their files: CDS numbers, names of tables and of sources."""

_EPOCH_OF_FRAME = re.compile(
    r"\bH_(?P<a>20\d\d\.\d+)|<(?:\w+:)?COOSYS\b[^>]*?\bepoch\s*=\s*[\"']J?(?P<b>20\d\d(?:\.\d+)?)"
    r"|\bEp(?:och)?\s*=\s*J?(?P<c>20\d\d\.\d+)",
    re.IGNORECASE,
)
"""The epoch in a frame's name at VizieR (H_2015.500), in a VOTable's COOSYS, in a column's description."""

_ALONE = {
    "DR2": "teff_val radius_val lum_val a_g_val e_bp_min_rp_val priam_flags flame_flags astrometric_pseudo_colour "
    "astrometric_weight_al astrometric_matched_observations matched_observations mean_varpi_factor_al "
    "frame_rotator_object_type",
    "DR3": "ruwe pseudocolour nu_eff_used_in_astrometry astrometric_matched_transits phot_bp_n_blended_transits "
    "ipd_frac_multi_peak in_qso_candidates teff_gspphot",
}
"""Columns that one release has and the others do not; ruwe is a table of its own in DR2."""


def gaia_epoch(table: ColumnTable) -> tuple[float, str]:
    """Return the reference epoch of a table of Gaia [Julian year], and a note of what shows it.

    That is, in this order: its column of it, the names of its sources, the frame of its header, the release that the
    header names, and columns that one release alone has. Otherwise it is taken to be of DR3.

    Raises:
        InputError: The epochs of rows differ.
    """
    column = _epoch_of_column(table)
    if column is not None:
        return column, ""
    names = table.text("designation", "DR3Name", "DR2Name")
    for release, found in (
        (_one(_releases_in(" ".join(names[:1]))), "its names"),
        (_one(_releases_of_frames(table.header)), "the frame in its header"),
        (_one(_releases_in(table.header)), "its header"),
        (_one(_releases_of_columns(table)), "its columns"),
    ):
        if release:
            return EPOCH_JYEAR[release], f"of {release} by {found}"
    return EPOCH_JYEAR["DR3"], f"reference epoch {EPOCH_JYEAR['DR3']:g} assumed, that of DR3"


def _epoch_of_column(table: ColumnTable) -> float | None:
    name = table.find("ref_epoch", "Epoch")
    if name is None:
        return None
    epochs = np.unique(table.number(name))
    epochs = epochs[~np.isnan(epochs)]
    if len(epochs) > 1:
        raise InputError(f"must be the same in all rows, got {epochs[0]:g} and {epochs[-1]:g}", name)
    return float(epochs[0]) if len(epochs) else None


def _one(releases: set[str]) -> str | None:
    """The release, where only one is spoken of."""
    return next(iter(releases)) if len(releases) == 1 else None


def _releases_in(text: str) -> set[str]:
    return {release for release, pattern in _NAMED.items() if re.search(pattern, text, re.IGNORECASE)}


def _releases_of_frames(text: str) -> set[str]:
    years = {float(next(filter(None, match.groups()))) for match in _EPOCH_OF_FRAME.finditer(text)}
    return {release for release, epoch in EPOCH_JYEAR.items() if epoch in years}


def _releases_of_columns(table: ColumnTable) -> set[str]:
    names = {plain_name(name) for name in table.all_names}
    return {release for release, alone in _ALONE.items() if not names.isdisjoint(map(plain_name, alone.split()))}


def _position_1997(table: ColumnTable) -> Position:
    ra_deg, dec_deg, ra_name = position_deg(table, *_HIPPARCOS_POSITIONS)
    # 263 stars without a solution have a rough position only, in sexagesimal text, and no motion that would move it.
    unsolved = np.isnan(ra_deg)
    ra_deg = np.where(unsolved, angle_deg(table, "RAhms", hours=True), ra_deg)
    dec_deg = np.where(unsolved, angle_deg(table, "DEdms"), dec_deg)
    return ra_deg, dec_deg, ra_name


def _position_2007(table: ColumnTable) -> Position:
    """Position by RArad and DErad: VizieR exports degrees under these names, and CSV loses the unit."""
    in_degrees = np.any(np.abs(table.number("DErad")) > math.pi / 2.0) or np.any(
        np.abs(table.number("RArad")) > 2.0 * math.pi
    )
    return position_deg(table, *_HIPPARCOS_POSITIONS, radians=not in_degrees)


def _hipparcos_1997(table: ColumnTable) -> dict[str, Any]:
    b_minus_v, v_minus_i = table.number("B-V", unit="mag"), table.number("V-I", unit="mag")
    return _hipparcos(table, table.number("Vmag", unit="mag"), b_minus_v, v_minus_i)


def _hipparcos_2007(table: ColumnTable) -> dict[str, Any]:
    b_minus_v, v_minus_i = (table.number(name, unit="mag", null=(0.0,)) for name in ("B-V", "V-I"))
    v_mag = hipparcos_v_mag(table.number("Hpmag", unit="mag"), v_minus_i, b_minus_v)  # V is not in the table
    return _hipparcos(table, v_mag, b_minus_v, v_minus_i)


def _hipparcos(table: ColumnTable, v_mag: F64, b_minus_v: F64, v_minus_i: F64) -> dict[str, Any]:
    """Hp and V, and B and Ic by the colours."""
    b_minus_v, v_minus_i = real_colours(b_minus_v), real_colours(v_minus_i)
    hp_mag = real_magnitudes(table.number("Hpmag", unit="mag"))
    parallax_mas = table.number("Plx", unit="mas")
    motion = table.number("pmRA", unit="mas / yr"), table.number("pmDE", unit="mas / yr")
    # Hp and V differ by 0.14 mag at most: either tells whether a star is near.
    known_mag = np.where(np.isnan(hp_mag), v_mag, hp_mag)
    seen = by_hipparcos(known_mag, v_minus_i, b_minus_v, parallax_mas, np.hypot(*motion))
    by_v_i = colour_temperature_k(v_minus_i, "V-I", seen.luminosity)
    by_b_v = colour_temperature_k(b_minus_v, "B-V", seen.luminosity)
    guessed = (seen.temperature_k != by_v_i) & ~np.isnan(by_v_i)  # V-I of faint red dwarfs
    # V-I as listed is bluer than V-Ic by 0.03 to 0.1 mag, of M giants more: the template that has it on average tells
    # V-Ic.
    v_minus_ic = np.where(np.isnan(by_v_i) | guessed, np.nan, colour("V", "Ic", seen.luminosity, by_v_i))
    magnitudes = {"Hp": hp_mag, "V": real_magnitudes(v_mag), "B": v_mag + b_minus_v, "Ic": v_mag - v_minus_ic}
    has_b_v, has_v_i = ~np.isnan(b_minus_v), ~np.isnan(v_minus_i)
    has_flux = np.any(~np.isnan(list(magnitudes.values())), axis=0)
    # B-V of cool giants says nothing.
    cool_giant = (seen.luminosity == GIANT) & (by_v_i < COOL_GIANT_K)
    differ = (np.abs(by_b_v / by_v_i - 1.0) > SAME_TEMPERATURE) & ~cool_giant
    doubtful = guessed | differ | (~has_v_i & (b_minus_v > REDDEST_B_MINUS_V_MAG))
    return {
        **_light(magnitudes, motion, parallax_mas, seen),
        "quality": predicted_quality(has_flux, has_b_v | has_v_i, doubtful),
        "notes": (
            *count_note(guessed, "have a guessed V-I: temperature from the absolute magnitude"),
            *count_note(has_flux & has_b_v & ~has_v_i, "have B-V as their only colour"),
            *count_note(has_flux & ~has_b_v & ~has_v_i, "have no colour"),
            *count_note(~has_flux, "have no magnitude, so no flux"),
        ),
    }


def _light(
    magnitudes: Mapping[str, F64], motion: tuple[F64, F64], parallax_mas: F64, seen: VisibleStars
) -> dict[str, Any]:
    return {
        "flux_jy": {band: band_flux_jy(band, values) for band, values in magnitudes.items()},
        "pm_ra_mas_yr": motion[0],
        "pm_dec_mas_yr": motion[1],
        "parallax_mas": parallax_mas,
        "temperature_k": seen.temperature_k,
        "luminosity": seen.luminosity,
    }


SATURATED_G_MAG = 3.5
"""Gaia's magnitudes of brighter stars are saturated."""

_G, _BP, _RP = ("phot_g_mean_mag", "Gmag"), ("phot_bp_mean_mag", "BPmag"), ("phot_rp_mean_mag", "RPmag")
_BP_RP = ("bp_rp", "BP-RP")
_GAIA_POSITIONS: tuple[Pair, ...] = (("ra", "dec"), ("RA_ICRS", "DE_ICRS"), ("RAJ2000", "DEJ2000"))


def _gaia(table: ColumnTable) -> dict[str, Any]:
    g_mag = table.needed(*_G, unit="mag")
    bp_mag, rp_mag = (real_magnitudes(table.number(*names, unit="mag")) for names in (_BP, _RP))
    from_colour = np.isnan(bp_mag) | np.isnan(rp_mag)
    by_colour = gaia_bp_rp_mag(real_magnitudes(g_mag), real_colours(table.number(*_BP_RP, unit="mag")))
    magnitudes = {
        "G": real_magnitudes(g_mag),
        "BP": np.where(from_colour, by_colour[0], bp_mag),
        "RP": np.where(from_colour, by_colour[1], rp_mag),
    }
    bp_rp_mag = magnitudes["BP"] - magnitudes["RP"]
    has_colour, has_flux = ~np.isnan(bp_rp_mag), np.any(~np.isnan(list(magnitudes.values())), axis=0)
    parallax_mas = table.number("parallax", "Plx", unit="mas")
    motion = table.number("pmra", unit="mas / yr"), table.number("pmdec", "pmDE", unit="mas / yr")
    seen = by_gaia(magnitudes["G"], bp_rp_mag, parallax_mas, np.hypot(*motion), np.nan)
    doubtful = (g_mag <= SATURATED_G_MAG) | (seen.quality != FAIR)
    return {
        **_light(magnitudes, motion, parallax_mas, seen),
        "quality": predicted_quality(has_flux, has_colour, doubtful),
        "notes": (
            *count_note(has_flux & from_colour & has_colour, "have no BP or RP: from G and BP-RP"),
            *count_note(has_flux & ~has_colour, "have no BP-RP, so no colour"),
            *count_note(~has_flux, "have no G, BP or RP, so no flux"),
        ),
    }


SURVEYS = (
    Survey(
        name="hipparcos",
        title="Hipparcos catalogue",
        reference="I/239 (ESA 1997, SP-1200)",
        needs=(("HIP",), ("Vmag",), ("Hpmag", "RAICRS", "RAhms")),  # VizieR leaves Hp out unless asked for it
        light=_hipparcos_1997,
        epoch_jyear=HIPPARCOS_EPOCH_JYEAR,
        position=_position_1997,
        id_columns=("HIP",),
        id_prefix="HIP ",
        telling=("Hpmag",),
    ),
    Survey(
        name="hipparcos-2",
        title="Hipparcos, the new reduction",
        reference="I/311 (van Leeuwen 2007, A&A 474, 653)",
        needs=(("HIP",), ("Hpmag",), ("RArad", "e_RArad", "Sn")),
        light=_hipparcos_2007,
        epoch_jyear=HIPPARCOS_EPOCH_JYEAR,
        position=_position_2007,
        id_columns=("HIP",),
        id_prefix="HIP ",
        telling=("RArad",),
    ),
    Survey(
        name="gaia",
        title="Gaia",
        reference="Gaia Collaboration: DR2 I/345, DR3 I/355 (2023, A&A 674, A1)",
        needs=(_G, (*_BP_RP, *_BP)),
        light=_gaia,
        epoch_jyear=gaia_epoch,
        position=lambda table: position_deg(table, *_GAIA_POSITIONS),
        id_columns=("designation", "DR3Name", "DR2Name", "source_id", "Source"),
        id_prefix="Gaia ",
        telling=("phot_g_mean_mag", "phot_bp_mean_mag", "BPmag"),
    ),
)
