"""The Sun and the Earth's motion, and eclipses: the sunlit fraction of the Sun's disc past the Earth.

Positions are from ERFA's analytical ephemeris: no files, good to 11 km and 5 mm/s (1900-2100). They are geometric (no
light time, no aberration): the Sun's position 8 minutes ago differs by less than 0.01 arcsec of barycentric motion,
while annual aberration belongs to the camera stage.

In eclipses the Sun is a sphere of uniform brightness, the Earth the opaque WGS84 ellipsoid: penumbra and umbra are
cones about a finite Sun. Limb darkening is left out (it dims the last tenth of the disc's width), and so is the
atmosphere, whose refraction, haze and clouds shift and blur the shadow's edge by tens of kilometres: seconds in low
orbit.

Stretched along its pole the ellipsoid is a sphere, and straight lines stay straight. The Sun then is a slightly
elliptic disc; it is taken for the round one that reaches equally far towards the Earth's centre. The fraction is wrong
by 2e-5 at most, and exact for a spherical Earth.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arrays import F64
from warpsim.constants import ASTRONOMICAL_UNIT_M, DAY_S, EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING, SUN_RADIUS_M
from warpsim.instant import tdb_jd
from warpsim.orbit.intervals import Intervals, Scan, find_intervals, scan_times_s
from warpsim.orbit.track import PositionFunction

if TYPE_CHECKING:
    from warpsim.instant import Epoch


class EarthStates(NamedTuple):
    """States of the Earth, and of the Sun from it; GCRS (ICRS) axes, each of the shape of the times plus (3,)."""

    sun_m: F64
    """The Sun's geometric geocentric position [m]."""
    sun_velocity_m_s: F64
    """The Sun's geocentric velocity [m/s]."""
    velocity_m_s: F64
    """The Earth's barycentric velocity [m/s]; with a satellite's added, the observer's for stellar aberration."""
    barycentric_m: F64
    """The Earth's barycentric position [m], for an observer's parallax."""
    heliocentric_m: F64
    """The Earth's heliocentric position [m], for the deflection of starlight by the Sun."""


def earth_states(epoch: Epoch, time_s: ArrayLike) -> EarthStates:
    """Return the states of Earth and Sun at times [s since epoch], any shape."""
    import erfa

    heliocentric, barycentric = erfa.epv00(*tdb_jd(epoch, time_s))
    return EarthStates(
        -heliocentric["p"] * ASTRONOMICAL_UNIT_M,
        -heliocentric["v"] * (ASTRONOMICAL_UNIT_M / DAY_S),
        np.asarray(barycentric["v"] * (ASTRONOMICAL_UNIT_M / DAY_S)),
        np.asarray(barycentric["p"]) * ASTRONOMICAL_UNIT_M,
        np.asarray(heliocentric["p"]) * ASTRONOMICAL_UNIT_M,
    )


class Eclipse(NamedTuple):
    """One passage through the Earth's shadow; times in seconds, NaN where there is no umbra."""

    start_s: float
    """First loss of light, or the beginning of the time looked at."""
    umbra_start_s: float
    umbra_end_s: float
    end_s: float


def sunlit_fraction(position_m: ArrayLike, sun_m: ArrayLike, pole_icrs: ArrayLike | None = None) -> F64:
    """Return the fraction of the Sun's disc seen past the Earth, 0 in the umbra to 1 in full light.

    Positions are geocentric [m], (..., 3), below the ground as on it; the Sun's that of now, not 8 minutes ago. Without
    a pole the Earth is a sphere of the equatorial radius.
    """
    return np.clip(sunlit_depth(position_m, sun_m, pole_icrs), 0.0, 1.0)


def sunlit_depth(position_m: ArrayLike, sun_m: ArrayLike, pole_icrs: ArrayLike | None = None) -> F64:
    """Return sunlit_fraction, but going on beyond 0 and 1 by the angle from the shadow's edge in widths of the Sun.

    Other than the fraction itself it is nowhere flat, so that short eclipses show between the points of a scan.
    """
    sun_radius, earth_radius, apart = _discs(position_m, sun_m, pole_icrs)
    outside = (apart - (earth_radius + sun_radius)) / (2.0 * sun_radius)
    inside = (apart - (earth_radius - sun_radius)) / (2.0 * sun_radius)
    seen = 1.0 - covered_fraction(sun_radius, earth_radius, apart)
    depth = np.where(outside >= 0.0, 1.0 + outside, seen)
    # An Earth smaller than the Sun never covers all of it.
    return np.asarray(np.where((inside <= 0.0) & (earth_radius >= sun_radius), inside, depth))


def covered_fraction(sun_radius_rad: ArrayLike, earth_radius_rad: ArrayLike, apart_rad: ArrayLike) -> F64:
    """Return the fraction of one disc on the sky that another covers; angular radii and distance of the centres [rad].

    The common area of two caps of the unit sphere is two sectors less two spherical triangles. Angles come from
    half-angle formulae and the triangle from l'Huilier's, so nothing is lost at first and last contact: good to 1e-12
    of a Sun of 0.005 rad.
    """
    sun, earth, apart = (np.asarray(x, np.float64) for x in (sun_radius_rad, earth_radius_rad, apart_rad))
    half = 0.5 * (sun + earth + apart)
    less_sun = np.maximum(0.5 * (earth + apart - sun), 0.0)
    less_earth = np.maximum(0.5 * (sun + apart - earth), 0.0)
    less_apart = np.maximum(0.5 * (sun + earth - apart), 0.0)
    # Angles of the triangle (centre, centre, crossing of the rims), at the Sun's centre and at the Earth's.
    at_sun = 2.0 * np.arctan2(
        np.sqrt(np.sin(less_sun) * np.sin(less_apart)), np.sqrt(np.sin(half) * np.sin(less_earth))
    )
    at_earth = 2.0 * np.arctan2(
        np.sqrt(np.sin(less_earth) * np.sin(less_apart)), np.sqrt(np.sin(half) * np.sin(less_sun))
    )
    excess = 4.0 * np.arctan(
        np.sqrt(np.tan(half / 2) * np.tan(less_sun / 2) * np.tan(less_earth / 2) * np.tan(less_apart / 2))
    )
    sun_square, earth_square = np.sin(sun / 2) ** 2, np.sin(earth / 2) ** 2  # a quarter of a cap's area over pi
    common = 2.0 * (at_sun * sun_square + at_earth * earth_square) - excess
    part = common / (2.0 * np.pi * sun_square)
    whole = np.minimum(earth_square / sun_square, 1.0)  # one within the other
    nested = apart <= np.abs(earth - sun)
    fraction = np.where(nested, whole, np.where(less_apart > 0.0, part, 0.0 * part))
    return np.asarray(np.clip(fraction, 0.0, 1.0))


def _discs(position_m: ArrayLike, sun_m: ArrayLike, pole_icrs: ArrayLike | None) -> tuple[F64, F64, F64]:
    """Angular radii of Sun and Earth, and the angle between their centres [rad], in stretched axes."""
    position, sun = np.broadcast_arrays(np.asarray(position_m, np.float64), np.asarray(sun_m, np.float64))
    to_sun = sun - position
    distance_m = np.linalg.norm(to_sun, axis=-1)
    sine = SUN_RADIUS_M / distance_m
    sun_tangent = sine / np.sqrt((1.0 - sine) * (1.0 + sine))
    if pole_icrs is not None:
        pole = np.asarray(pole_icrs, np.float64)
        away = to_sun / distance_m[..., None]
        position, to_sun = _stretched(position, pole), _stretched(to_sun, pole)
        length_m = np.linalg.norm(to_sun, axis=-1)
        # Reach of the stretched disc towards the Earth's centre: the longest stretched radius, projected on that way.
        ahead = to_sun / length_m[..., None]
        across = -position + np.einsum("...i,...i->...", position, ahead)[..., None] * ahead
        across = across / np.maximum(np.linalg.norm(across, axis=-1), 1e-300)[..., None]
        reach = _stretched(across, pole)
        reach = reach - np.einsum("...i,...i->...", reach, away)[..., None] * away
        # With the Sun's centre behind the Earth's there is no such way, and none is needed.
        factor = np.where(np.any(across != 0.0, axis=-1), np.linalg.norm(reach, axis=-1), 1.0)
        sun_tangent = sun_tangent * factor * distance_m / length_m
    radius_ratio = np.minimum(EARTH_EQUATORIAL_RADIUS_M / np.maximum(np.linalg.norm(position, axis=-1), 1e-300), 1.0)
    apart = np.arctan2(
        np.linalg.norm(np.cross(to_sun, -position), axis=-1), -np.einsum("...i,...i->...", to_sun, position)
    )
    return np.arctan(sun_tangent), np.arcsin(radius_ratio), apart


def _stretched(vector: F64, pole: F64) -> F64:
    """Vectors in axes in which the ellipsoid about the pole is a sphere of the equatorial radius."""
    return np.asarray(vector + ((1.0 / (1.0 - EARTH_FLATTENING) - 1.0) * (vector @ pole))[..., None] * pole)


def eclipses(
    position_m: PositionFunction,
    sun_position_m: PositionFunction,
    pole_icrs: ArrayLike | None,
    duration_s: float,
    step_s: float = 10.0,
) -> list[Eclipse]:
    """Return the passages of one body through the Earth's shadow within [0, duration_s], ends good to 1 ms."""
    time_s = scan_times_s(duration_s, step_s)

    def depth(t: F64) -> F64:
        return sunlit_depth(position_m(t), sun_position_m(t), pole_icrs)

    scanned = depth(time_s)
    whole = Intervals.whole(1, time_s[0], time_s[-1])
    scan = Scan.uniform(1, time_s)
    shade = find_intervals(lambda _, t: 1.0 - depth(t), lambda point: 1.0 - scanned[point], scan, whole)
    umbra = find_intervals(lambda _, t: -depth(t), lambda point: -scanned[point], scan, shade)
    found = []
    for start_s, end_s in zip(shade.start_s, shade.end_s, strict=True):
        dark = (umbra.start_s >= start_s) & (umbra.end_s <= end_s)
        dark_s = (umbra.start_s[dark].min(), umbra.end_s[dark].max()) if dark.any() else (np.nan, np.nan)
        found.append(Eclipse(float(start_s), float(dark_s[0]), float(dark_s[1]), float(end_s)))
    return found
