"""Earth orientation, the WGS84 ellipsoid, and rotations from the frames of orbit and attitude files to GCRS axes.

Orientation comes from skyfield with its built-in tables: IAU 2006 precession, IAU 2000A nutation, sidereal time with
the built-in delta T. Polar motion (0.3 arcsec, up to 10 m on the ground) is left out, and for dates past the tables
the predicted delta T may be off by tenths of a second (0.1 s turns the ground by 46 m at the equator). Nothing is
downloaded. Frames of files:

- GCRF is the same; EME2000 differs by the constant frame bias of IAU 2006 (`erfa.bp06`), 23 mas or 0.8 m in low orbit.
- ITRF turns with the Earth as above: no polar motion and built-in delta T, at most 17 m from the IERS's (1974 to 2025),
  more for later dates.
- TEME is SGP4's: true equator of date, mean equinox in the sense of the sidereal time of 1982 (AIAA 2006-6753, appendix
  C, by skyfield, with IAU 2006 precession and IAU 2000A nutation). astropy's differs by less than 0.7 mm at 7,000 km
  until 2040 and by 3 mm in 2099, as it takes account of the TIO locator and of the IAU 2006 adjustments of nutation.
- TOD and MOD are the true and the mean equator and equinox of date by IAU 2006/2000A. Programs that use IAU 1976/1980
  differ by up to 0.09 arcsec, 3 m in low orbit (2000 to 2030).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arrays import F64
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING
from warpsim.errors import InputError
from warpsim.exchange.geodetic import geodetic_to_itrs_m
from warpsim.exchange.segments import FRAMES, AttitudeSegment
from warpsim.instant import tt_jd
from warpsim.quaternion import conjugate, from_matrix, in_one_hemisphere, product, rotated, unit

if TYPE_CHECKING:
    from warpsim.instant import Epoch


EARTH_POLAR_RADIUS_M = EARTH_EQUATORIAL_RADIUS_M * (1.0 - EARTH_FLATTENING)
_ECCENTRICITY_SQUARED = EARTH_FLATTENING * (2.0 - EARTH_FLATTENING)

_STRETCH = 1.0 / (1.0 - EARTH_FLATTENING)
"""Along the pole, it makes the ellipsoid a sphere of the equatorial radius."""

# The nutation series holds 1,365 terms per time in memory.
_TIMES_PER_CHUNK = 2048


@functools.cache
def timescale() -> Any:
    """Return skyfield's time scales with its built-in tables, as `skyfield.api.load.timescale(builtin=True)` does.

    They are put together here, as `skyfield.api` imports a lot that is not needed, for a tenth of a second.
    """
    from skyfield.functions import load_bundled_npy
    from skyfield.timelib import Timescale

    try:
        tables = load_bundled_npy("iers.npz")
        day = tables["tt_jd_minus_arange"] + np.arange(len(tables["tt_jd_minus_arange"]))
        delta_t = day, (tables["delta_t_1e7"] / 1e7).round(7)
        return Timescale(delta_t, tables["leap_dates"], tables["leap_offsets"])
    except (KeyError, OSError, TypeError):  # another version of skyfield keeps them otherwise
        from skyfield.api import load

        return load.timescale(builtin=True)


def itrs_to_gcrs(epoch: Epoch, time_s: ArrayLike) -> F64:
    """Return rotations from Earth-fixed (ITRS) to GCRS axes at times of any shape, with (3, 3) added."""
    from skyfield.framelib import itrs

    return _skyfield_to_gcrs(itrs.rotation_at, epoch, time_s)


def _skyfield_to_gcrs(rotation_at: Callable[[Any], Any], epoch: Epoch, time_s: ArrayLike) -> F64:
    """Return rotations from one of skyfield's frames to GCRS axes at times of any shape, with (3, 3) added.

    `rotation_at` leads from skyfield's Time, an array of n, to rotations from GCRS to the frame, (3, 3, n).
    """
    whole, fraction = tt_jd(epoch, time_s)
    flat = fraction.ravel()
    rotation = np.empty((flat.size, 3, 3))
    for start in range(0, flat.size, _TIMES_PER_CHUNK):
        part = flat[start : start + _TIMES_PER_CHUNK]
        matrix = rotation_at(timescale().tt_jd(np.full_like(part, whole), part))
        rotation[start : start + len(part)] = np.transpose(matrix, (2, 1, 0))
    return rotation.reshape(*fraction.shape, 3, 3)


def pole_of_date(epoch: Epoch) -> F64:
    """Return the unit vector of the true celestial pole at the epoch in GCRS axes, shape (3,)."""
    whole, fraction = tt_jd(epoch, 0.0)
    return np.array(timescale().tt_jd(whole, float(fraction)).M[2], np.float64)


def geodetic_to_gcrs_m(
    lon_deg: ArrayLike, lat_deg: ArrayLike, altitude_m: ArrayLike, epoch: Epoch, time_s: ArrayLike
) -> F64:
    """Return GCRS positions [m] of WGS84 points that turn with the Earth, of the broadcast shape plus (3,)."""
    lat = np.asarray(lat_deg, np.float64)
    if not np.all(np.abs(lat) <= 90.0):
        raise InputError("must be in [-90, 90]", "lat_deg", lat[~(np.abs(lat) <= 90.0)].flat[0], "g")
    fixed = geodetic_to_itrs_m(lon_deg, lat, altitude_m)
    position: F64 = np.einsum("...ij,...j->...i", itrs_to_gcrs(epoch, time_s), fixed)
    return position


def gcrs_to_geodetic(position_m: ArrayLike, epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64, F64]:
    """Return east longitude [deg] (-180 to 180), WGS84 latitude [deg] and height [m] of GCRS positions, shape (...)."""
    position = np.asarray(position_m, np.float64)
    fixed = np.einsum("...ji,...j->...i", itrs_to_gcrs(epoch, time_s), position)
    height, cosine, sine = meridian_altitude_m(np.hypot(fixed[..., 0], fixed[..., 1]), fixed[..., 2])
    longitude = np.degrees(np.arctan2(fixed[..., 1], fixed[..., 0]))
    return longitude, np.degrees(np.arctan2(sine, cosine)), height


def geocentric_radius_m(latitude_sine: ArrayLike) -> F64:
    """Return the distance from the Earth's centre to the WGS84 ellipsoid [m] by the sine of the geocentric latitude."""
    stretch = _ECCENTRICITY_SQUARED / (1.0 - _ECCENTRICITY_SQUARED)
    return np.asarray(EARTH_EQUATORIAL_RADIUS_M / np.sqrt(1.0 + stretch * np.square(latitude_sine)))


def geodetic_altitude_m(position_m: ArrayLike, pole_icrs: ArrayLike) -> F64:
    """Return heights above the WGS84 ellipsoid about a pole [m]; negative inside, exact to 1e-7 m from -100 km up."""
    position, pole = np.asarray(position_m, np.float64), np.asarray(pole_icrs, np.float64)
    along = position @ pole
    across = np.linalg.norm(position - along[..., None] * pole, axis=-1)
    return meridian_altitude_m(across, along)[0]


def meridian_altitude_m(across_m: F64, along_m: F64) -> tuple[F64, F64, F64]:
    """Return height [m] and the cosine and sine of geodetic latitude of points in a meridian plane.

    Two rounds of Bowring's formula in the reduced latitude (B. R. Bowring, Survey Review 23, 1976), from the surface to
    any height. Far inside the Earth the height stays negative and finite, but is no longer the distance.
    """
    a, b = EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M
    outer, inner = (a * a - b * b) / b, (a * a - b * b) / a
    sine, cosine = a * along_m, b * across_m
    for _ in range(2):
        scale = 1.0 / np.maximum(np.hypot(sine, cosine), 1e-300)
        sine, cosine = sine * scale, cosine * scale  # of the reduced latitude
        up = along_m + outer * (sine * sine * sine)
        out = np.maximum(across_m - inner * (cosine * cosine * cosine), 0.0)
        sine, cosine = b * up, a * out  # reduced latitude of the improved geodetic one
    scale = 1.0 / np.maximum(np.hypot(up, out), 1e-300)
    sine, cosine = up * scale, out * scale
    height = across_m * cosine + along_m * sine - a * np.sqrt(1.0 - _ECCENTRICITY_SQUARED * (sine * sine))
    return height, cosine, sine


def grazing_altitude_m(start_m: ArrayLike, end_m: ArrayLike, pole_icrs: ArrayLike, *, beyond: bool = False) -> F64:
    """Return the lowest WGS84 altitude on segments [m], or on rays `beyond` their ends.

    Height above an ellipsoid is convex along a straight line, so it has one minimum: found by Newton's method on its
    slope (geodetic normal times direction) from the point nearest the centre in stretched axes, where the ellipsoid is
    a sphere. Error below 1e-6 m for lines above the surface. For lines that pass through the Earth the sign is right.
    """
    # All that matters is the meridian half-plane: distance from the axis squared is a quadratic along the segment.
    a_up, path_up, square, mixed, path_square = _along(start_m, end_m, pole_icrs)
    a_square, path_out_square, mixed = square - a_up**2, path_square - path_up**2, mixed - a_up * path_up
    last = np.inf if beyond else 1.0
    stretch = _STRETCH**2
    s = -(mixed + stretch * a_up * path_up) / np.maximum(path_out_square + stretch * path_up**2, 1e-30)
    s = np.clip(s, 0.0, last)
    lowest: F64 | float = np.inf
    for _ in range(4):
        across = np.sqrt(np.maximum(a_square + s * (2.0 * mixed + s * path_out_square), 1.0))
        height, cosine, sine = meridian_altitude_m(across, a_up + s * path_up)
        lowest = np.minimum(lowest, height)
        slope = cosine * (mixed + s * path_out_square) / across + sine * path_up
        # A shell of radius rho + h curves the height; rho within 0.7 %, so each round gains two digits or more.
        curvature = (path_square - slope**2) / np.maximum(EARTH_EQUATORIAL_RADIUS_M + height, 1e6)
        least = 1e-30 + 1e-9 * path_square / EARTH_EQUATORIAL_RADIUS_M
        s = np.clip(s - slope / np.maximum(curvature, least), 0.0, last)
    return np.asarray(lowest)


def earth_clearance_m(start_m: ArrayLike, end_m: ArrayLike, pole_icrs: ArrayLike, *, beyond: bool = False) -> F64:
    """Return a length whose sign is that of grazing_altitude_m, and which is within 0.4 % of it near the ground [m].

    Lowest height above the sphere that the ellipsoid becomes in axes stretched along the pole: several times cheaper.
    """
    a_up, path_up, square, mixed, path_square = _along(start_m, end_m, pole_icrs)
    more = _STRETCH**2 - 1.0
    a_square, path_square = square + more * a_up**2, path_square + more * path_up**2
    mixed = mixed + more * a_up * path_up
    s = np.clip(-mixed / np.maximum(path_square, 1e-30), 0.0, np.inf if beyond else 1.0)
    radius_m = np.sqrt(np.maximum(a_square + s * (2.0 * mixed + s * path_square), 0.0))
    return np.asarray(radius_m - EARTH_EQUATORIAL_RADIUS_M)


def _along(start_m: ArrayLike, end_m: ArrayLike, pole_icrs: ArrayLike) -> tuple[F64, F64, F64, F64, F64]:
    """Parts of a start and of the path from it along the pole, and the products start², start·path and path²."""
    start, end, pole = (np.asarray(x, np.float64) for x in (start_m, end_m, pole_icrs))
    path = end - start
    products = (np.einsum("...i,...i->...", *pair) for pair in ((start, start), (start, path), (path, path)))
    return start @ pole, path @ pole, *products


def frame_to_gcrs(frame: str, epoch: Epoch, time_s: ArrayLike) -> F64:
    """Return rotations from the axes of one of FRAMES to GCRS axes, (n_time, 3, 3)."""
    from skyfield import framelib, sgp4lib

    times = np.asarray(time_s, np.float64)
    if frame in ("GCRF", "EME2000"):
        return np.broadcast_to(np.eye(3) if frame == "GCRF" else eme2000_to_gcrs(), (len(times), 3, 3))
    rotations: dict[str, Callable[[Any], Any]] = {
        "ITRF": framelib.itrs.rotation_at,
        "TEME": sgp4lib.TEME.rotation_at,
        "TOD": lambda t: t.M,
        "MOD": framelib.mean_equator_and_equinox_of_date.rotation_at,
    }
    if frame not in rotations:
        raise InputError(f"must be one of {', '.join(FRAMES)}", "frame", frame)
    return _skyfield_to_gcrs(rotations[frame], epoch, times)


def states_to_gcrs(frame: str, epoch: Epoch, time_s: F64, position_m: F64, velocity_m_s: F64) -> tuple[F64, F64]:
    """Return states in GCRS axes, of the shapes given: positions and velocities (n_time, 3) or (n_time, n_object, 3).

    Velocities are relative to the frame's axes, which turn: by the Earth's rotation in ITRF, by precession and nutation
    (5e-5 m/s in low orbit) in TEME, TOD and MOD. The turning is that of the middle of the times.
    """
    if frame == "GCRF" or len(time_s) == 0:
        return position_m, velocity_m_s
    rotation = frame_to_gcrs(frame, epoch, time_s)
    if frame != "EME2000":
        middle_s = 0.5 * (float(time_s.min()) + float(time_s.max()))
        velocity_m_s = velocity_m_s + np.cross(spin_rad_s(frame, epoch, middle_s), position_m)
    return np.einsum("tij,t...j->t...i", rotation, position_m), np.einsum("tij,t...j->t...i", rotation, velocity_m_s)


def spin_rad_s(frame: str, epoch: Epoch, time_s: float) -> F64:
    """Return the angular velocity of a frame's axes relative to GCRS, in those axes [rad/s], (3,).

    From rotations two seconds apart: rounding is 1e-14 rad/s, 1e-7 m/s in low orbit.
    """
    before, after = frame_to_gcrs(frame, epoch, np.array([time_s - 1.0, time_s + 1.0]))
    turn = before.T @ after
    sine = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    size = float(np.linalg.norm(sine))
    spin: F64 = 0.5 * sine * (np.arcsin(size) / size if size > 0.0 else 1.0)
    return spin


def eme2000_to_gcrs() -> F64:
    """Return the rotation from the mean equator and equinox of J2000 to GCRS axes, (3, 3)."""
    import erfa

    bias, _, _ = erfa.bp06(2_451_545.0, 0.0)  # the bias does not depend on the date
    return np.asarray(bias, np.float64).T


def attitude_in_gcrs(segment: AttitudeSegment, epoch: Epoch) -> tuple[F64, F64, F64 | None]:
    """Return times [s since epoch] (n,), unit quaternions (x, y, z, scalar) from body to GCRS axes (n, 4), and rates.

    Rates are the body's angular velocities relative to GCRS in its own axes [rad/s], (n, 3); None where there are none.

    Neighbours have signs as interpolation along the shorter way needs them.
    """
    time_s = segment.instants.since(epoch)
    quaternion, rate_rad_s = segment.quaternion, segment.rate_rad_s
    if rate_rad_s is not None and segment.frame not in ("GCRF", "EME2000"):
        spin = spin_rad_s(segment.frame, epoch, 0.5 * float(time_s[0] + time_s[-1]))
        rate_rad_s = rate_rad_s + rotated(conjugate(quaternion), spin)
    if segment.frame != "GCRF":
        quaternion = product(from_matrix(frame_to_gcrs(segment.frame, epoch, time_s)), quaternion)
    return time_s, in_one_hemisphere(unit(quaternion)), rate_rad_s
