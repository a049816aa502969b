"""Stars moved to another epoch, rigorously or as in the paper."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from warpsim.errors import InputError
from warpsim.radiometry.magnitudes import Physics
from warpsim.sky.catalog_columns import J2000_JYEAR
from warpsim.sky.space_motion import paper_motion, rigorous_motion
from warpsim.sky.stars import Stars, frozen

LONGEST_MOTION_YR = 1e5
"""Beyond, a straight line is no model of a star's way, even in jest."""


def moved(stars: Stars, epoch_jyear: float, physics: Physics) -> dict[str, Any]:
    """Return the columns of stars that differ at another epoch; none if no star moves."""
    if not (np.any(stars.pm_ra_mas_yr) or np.any(stars.pm_dec_mas_yr)):
        return {}
    start = (stars.ra_deg, stars.dec_deg, stars.pm_ra_mas_yr, stars.pm_dec_mas_yr)
    years = epoch_jyear - stars.epoch_jyear
    if physics == "paper":
        ra_deg, dec_deg = paper_motion(*start, years)
        return {"ra_deg": frozen(ra_deg), "dec_deg": frozen(dec_deg)}
    ra_deg, dec_deg, pm_ra_mas_yr, pm_dec_mas_yr, distance = rigorous_motion(*start, years)
    columns = {
        "ra_deg": ra_deg,
        "dec_deg": dec_deg,
        "pm_ra_mas_yr": pm_ra_mas_yr,
        "pm_dec_mas_yr": pm_dec_mas_yr,
        "parallax_mas": stars.parallax_mas / distance,
    }
    return {key: frozen(values) for key, values in columns.items()}


def checked_jyear(jyear: Any) -> float:
    """A Julian year of a number or an astropy Time; InputError unless it is finite and near enough to 2000."""
    try:
        epoch_jyear = float(getattr(jyear, "jyear", jyear))
    except (TypeError, ValueError):
        raise InputError("must be a number", "jyear", jyear) from None
    if not math.isfinite(epoch_jyear):
        raise InputError("must be finite", "jyear", epoch_jyear)
    if abs(epoch_jyear - J2000_JYEAR) > LONGEST_MOTION_YR:
        raise InputError(f"must be within {LONGEST_MOTION_YR:,.0f} years of 2000", "jyear", epoch_jyear, "g")
    return epoch_jyear
