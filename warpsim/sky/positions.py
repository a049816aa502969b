"""Positions of stars: at another epoch, by rigorous motion or the paper's linear one, and within regions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64
from warpsim.directions import unit_vectors
from warpsim.errors import InputError

J2000_JYEAR = 2000.0

Cone = tuple[float, float, float]
"""Right ascension, declination and radius [deg]."""

LONGEST_MOTION_YR = 1e5
"""Beyond, a straight line models no motion of a star."""

_MAS_RAD = math.pi / 180.0 / 3.6e6


def position_of(x: F64, y: F64, z: F64) -> tuple[F64, F64]:
    """Right ascension in [0, 360) and declination [deg] of vectors of any length by components, shape (n,) each."""
    return wrapped_deg(np.degrees(np.arctan2(y, x))), np.degrees(np.arctan2(z, np.hypot(x, y)))


def wrapped_deg(angle_deg: F64) -> F64:
    """Angles in [0, 360) [deg]; a tiny negative one, whose remainder rounds to 360, is 0."""
    wrapped = angle_deg % 360.0
    return np.where(wrapped == 360.0, 0.0, wrapped)


def rigorous_motion(
    ra_deg: F64, dec_deg: F64, pm_ra_mas_yr: F64, pm_dec_mas_yr: F64, years: float
) -> tuple[F64, F64, F64, F64, F64]:
    """Move stars at constant velocity in space, without radial part.

    u(t) = normalize(u0 + t (mu_ra p + mu_dec q)), p east and q north (ESA 1997, SP-1200 vol. 1, eq. 1.2.16 without
    parallax and light time). Radial velocities are left out: perspective moves Barnard's star, the worst, by 0.6 mas
    times the square of the years.

    Returns:
        Right ascension and declination [deg], their proper motions [mas/yr] at the new epoch (cos(dec) included), and
        the distance there relative to the one before, shape (n,) each.
    """
    # By components, as NumPy is slow along short axes.
    position, east, north = _axes(ra_deg, dec_deg)
    rate = [_MAS_RAD * (pm_ra_mas_yr * e + pm_dec_mas_yr * n) for e, n in zip(east, north, strict=True)]
    x, y, z = (p + years * r for p, r in zip(position, rate, strict=True))
    distance = np.sqrt(x * x + y * y + z * z)
    ra_deg, dec_deg = position_of(x, y, z)
    _, east, north = _axes(ra_deg, dec_deg)
    pm_ra = (rate[0] * east[0] + rate[1] * east[1]) / distance / _MAS_RAD
    pm_dec = (rate[0] * north[0] + rate[1] * north[1] + rate[2] * north[2]) / distance / _MAS_RAD
    return ra_deg, dec_deg, pm_ra, pm_dec, distance


def paper_motion(ra_deg: F64, dec_deg: F64, pm_ra_mas_yr: F64, pm_dec_mas_yr: F64, years: float) -> tuple[F64, F64]:
    """Move right ascension and declination linearly in time: Eq. 5 of the paper.

    alpha = alpha0 + mu_alpha t, delta = delta0 + mu_delta t, with mu_alpha the rate of the angle itself: the proper
    motion without cos(dec). A fast star close to a pole goes astray: Eq. 5 winds it round the pole on a spiral. A
    declination beyond 90 degrees is read as a way over the pole.
    """
    rate = np.divide(pm_ra_mas_yr, np.cos(np.radians(dec_deg)), out=np.zeros_like(ra_deg), where=np.abs(dec_deg) < 90.0)
    ra_deg = ra_deg + rate * years / 3.6e6
    dec_deg = dec_deg + pm_dec_mas_yr * years / 3.6e6
    over = np.abs(dec_deg) > 90.0
    ra_over, dec_over = position_of(*unit_vectors(ra_deg[over], dec_deg[over]).T)
    ra_deg = wrapped_deg(ra_deg)
    ra_deg[over], dec_deg[over] = ra_over, dec_over
    return ra_deg, dec_deg


_Components = tuple[F64, F64, F64]


def _axes(ra_deg: F64, dec_deg: F64) -> tuple[_Components, _Components, _Components]:
    """Unit vectors to each star, and to its east and north, by components (n,) each.

    At a pole east and north follow the right ascension.
    """
    ra_rad, dec_rad = np.radians(ra_deg), np.radians(dec_deg)
    sin_ra, cos_ra, sin_dec, cos_dec = np.sin(ra_rad), np.cos(ra_rad), np.sin(dec_rad), np.cos(dec_rad)
    position = cos_dec * cos_ra, cos_dec * sin_ra, sin_dec
    return position, (-sin_ra, cos_ra, np.zeros_like(ra_rad)), (-sin_dec * cos_ra, -sin_dec * sin_ra, cos_dec)


def checked_jyear(jyear: Any, where: str = "jyear") -> float:
    """A Julian year of a number or an astropy Time; InputError unless it is finite and near enough to 2000."""
    try:
        epoch_jyear = float(getattr(jyear, "jyear", jyear))
    except (TypeError, ValueError):
        epoch_jyear = math.nan
    if not math.isfinite(epoch_jyear):
        raise InputError("must be a finite number", where, jyear)
    if abs(epoch_jyear - J2000_JYEAR) > LONGEST_MOTION_YR:
        raise InputError(f"must be within {LONGEST_MOTION_YR:,.0f} years of 2000", where, epoch_jyear, "g")
    return epoch_jyear


def checked_region(region: Any) -> tuple[Cone, ...]:
    """One cone or several, (ra_deg, dec_deg, radius_deg), as a tuple of cones."""
    rule = "must be (ra_deg, dec_deg, radius_deg) with -90 <= dec_deg <= 90 and 0 < radius_deg <= 180, or several"
    try:
        cones = np.array(() if region is None else region, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(rule, value=region) from None
    cones = cones.reshape(-1, 3) if cones.size in (0, 3) else cones
    if cones.ndim != 2 or cones.shape[1] != 3 or not np.isfinite(cones).all():
        raise InputError(rule, value=region)
    if (np.abs(cones[:, 1]) > 90.0).any() or (cones[:, 2] <= 0.0).any() or (cones[:, 2] > 180.0).any():
        raise InputError(rule, value=region)
    return tuple((float(ra), float(dec), float(radius)) for ra, dec, radius in cones.tolist())


def dec_range_deg(region: Sequence[Cone]) -> tuple[float, float]:
    """Smallest and largest declination in any of some cones [deg], by a hair more."""
    return min(dec - radius for _, dec, radius in region) - 1e-9, max(dec + radius for _, dec, radius in region) + 1e-9


def within_cones(ra_deg: F64, dec_deg: F64, region: Sequence[Cone]) -> NDArray[np.bool_]:
    """Return whether each position lies in any of some cones, their edges included, shape (n,)."""
    inside = np.zeros(len(ra_deg), dtype=np.bool_)
    direction = unit_vectors(ra_deg, dec_deg)
    for ra, dec, radius in region:
        axis = unit_vectors(np.array([ra]), np.array([dec]))[0]
        # By the chord: a cosine says nothing of arc seconds.
        inside |= np.linalg.norm(direction - axis, axis=1) <= 2.0 * np.sin(0.5 * np.radians(radius)) * (1.0 + 1e-15)
    return inside
