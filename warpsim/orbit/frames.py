"""Rotations from the frames of orbit and attitude files to GCRS axes.

- GCRF is the same; EME2000 differs by the constant frame bias of IAU 2006 (`erfa.bp06`), 23 mas or 0.8 m in low orbit.
- ITRF turns with the Earth as in `warpsim.orbit.earth`: no polar motion and built-in delta T, at most 17 m
  from the IERS's (1974 to 2025), more for later dates.
- TEME is SGP4's: true equator of date, mean equinox in the sense of the sidereal time of 1982 (AIAA 2006-6753, appendix
  C, by skyfield, with IAU 2006 precession and IAU 2000A nutation). astropy's differs by less than 0.7 mm at 7,000 km
  until 2040 and by 3 mm in 2099, as it takes account of the TIO locator and of the IAU 2006 adjustments of nutation.
- TOD and MOD are the true and the mean equator and equinox of date by IAU 2006/2000A. Programs that use IAU 1976/1980
  differ by up to 0.09 arcsec, 3 m in low orbit (2000 to 2030).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.errors import InputError
from warpsim.exchange.segments import FRAMES, AttitudeSegment
from warpsim.orbit.earth import itrs_to_gcrs, skyfield_to_gcrs
from warpsim.quaternion import from_matrix, in_one_hemisphere, product, unit

if TYPE_CHECKING:
    from warpsim.instant import Epoch

F64 = NDArray[np.float64]


def frame_to_gcrs(frame: str, epoch: Epoch, time_s: ArrayLike) -> F64:
    """Return rotations from the axes of one of FRAMES to GCRS axes, (n_time, 3, 3)."""
    from skyfield import framelib, sgp4lib

    times = np.asarray(time_s, np.float64)
    if frame == "GCRF":
        return np.broadcast_to(np.eye(3), (len(times), 3, 3))
    if frame == "EME2000":
        return np.broadcast_to(eme2000_to_gcrs(), (len(times), 3, 3))
    if frame == "ITRF":
        return itrs_to_gcrs(epoch, times)
    if frame == "TEME":
        return skyfield_to_gcrs(sgp4lib.TEME.rotation_at, epoch, times)
    if frame == "TOD":
        return skyfield_to_gcrs(lambda t: t.M, epoch, times)
    if frame == "MOD":
        return skyfield_to_gcrs(framelib.mean_equator_and_equinox_of_date.rotation_at, epoch, times)
    raise InputError(f"must be one of {', '.join(FRAMES)}", "frame", frame)


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


def attitude_in_gcrs(segment: AttitudeSegment, epoch: Epoch) -> tuple[F64, F64]:
    """Return times [s since epoch] (n,) and unit quaternions (x, y, z, scalar) from body to GCRS axes (n, 4).

    Neighbours have signs as interpolation along the shorter way needs them.
    """
    time_s = segment.instants.since(epoch)
    quaternion = segment.quaternion
    if segment.frame != "GCRF":
        quaternion = product(from_matrix(frame_to_gcrs(segment.frame, epoch, time_s)), quaternion)
    return time_s, in_one_hemisphere(unit(quaternion))
