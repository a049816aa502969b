"""Warnings of stars whose colours say nothing of their spectra."""

from __future__ import annotations

import warnings

import numpy as np

from warpsim.sky.star_photometry import StarPhotometry
from warpsim.sky.stellar_templates import UNKNOWN_TEMPERATURE_K, colour

BEYOND_MAG = 0.5
"""Distance from the colours of the templates from which a colour is doubted [mag]: most stars are closer."""


def warn_colours(name: str, photometry: StarPhotometry) -> None:
    """Warn about stars of unknown temperature, and about colours far beyond those of stars.

    Args:
        name: Name of the catalog's file.
        photometry: Its stars.
    """
    n_star = len(photometry.temperature_k)
    unknown = np.isnan(photometry.temperature_k) & np.any(
        [np.isfinite(flux_jy) for flux_jy in photometry.given_jy.values()], axis=0
    )
    n_beyond, example = 0, ""
    for bands, rows, colour_mag in photometry.telling_colours():
        unknown[rows] = False
        of_templates = colour(*bands, photometry.spectrum_luminosity[rows], photometry.spectrum_temperature_k[rows])
        beyond = np.flatnonzero(np.abs(colour_mag - of_templates) > BEYOND_MAG)
        if len(beyond) and not n_beyond:
            example = f"{'-'.join(bands)} {colour_mag[beyond[0]]:.2f}"
        n_beyond += len(beyond)
    if n_unknown := np.count_nonzero(unknown):
        rule = f"have no colour, type or temperature: their spectra are a K giant's of {UNKNOWN_TEMPERATURE_K:g} K"
        warnings.warn(f"{name}: {n_unknown} of {n_star} stars {rule}", stacklevel=2)
    if n_beyond:
        rule = f"have colours more than {BEYOND_MAG:g} mag beyond those of known spectra ({example})"
        warnings.warn(f"{name}: {n_beyond} of {n_star} stars {rule}", stacklevel=2)
