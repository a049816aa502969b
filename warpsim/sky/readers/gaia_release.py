"""Which Gaia release a table is from, by what it says of itself: its epoch hangs on it."""

from __future__ import annotations

import re

import numpy as np

from warpsim.errors import InputError
from warpsim.tables.columns import ColumnTable, plain_name

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

_OF_DR2_ALONE = (
    *("teff_val", "radius_val", "lum_val", "a_g_val", "e_bp_min_rp_val", "priam_flags", "flame_flags"),
    *("astrometric_pseudo_colour", "astrometric_weight_al", "astrometric_matched_observations", "matched_observations"),
    *("mean_varpi_factor_al", "frame_rotator_object_type"),
)
_OF_DR3_ALONE = (
    *(
        "ruwe",
        "pseudocolour",
        "nu_eff_used_in_astrometry",
        "astrometric_matched_transits",
        "phot_bp_n_blended_transits",
    ),
    *("ipd_frac_multi_peak", "in_qso_candidates", "teff_gspphot"),
)
"""Columns that one release has and the others do not; ruwe is a table of its own in DR2."""


def gaia_epoch(table: ColumnTable) -> tuple[float, str]:
    """Return the reference epoch of a table of Gaia [Julian year], and a note of what tells it.

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
    groups = {"DR2": _OF_DR2_ALONE, "DR3": _OF_DR3_ALONE}
    return {release for release, columns in groups.items() if not names.isdisjoint(map(plain_name, columns))}
