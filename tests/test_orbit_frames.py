"""Frames of orbit files against ERFA and astropy, quaternions against scipy."""

from __future__ import annotations

import erfa
import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import GCRS, ITRS, TEME, TETE, CartesianRepresentation, PrecessedGeocentric
from astropy.time import TimeDelta
from astropy.utils import iers
from exchange_samples import AEM
from scipy.spatial.transform import Rotation

import warpsim as ws
from warpsim.exchange.segments import FRAMES
from warpsim.instant import tt_jd, utc_time
from warpsim.orbit.earth import timescale
from warpsim.orbit.frames import (
    attitude_in_gcrs,
    eme2000_to_gcrs,
    frame_to_gcrs,
    spin_rad_s,
    states_to_gcrs,
)

PLACE_M = np.array([5.0e6, -3.0e6, 4.0e6])  # 7,071 km from the centre
FRAME_M = 1e-3  # measured: MOD 1e-5, TOD 1.6e-4, TEME 4.6e-4 m
BIAS_M = 1e-8
TURN_M = 1e-3  # Earth rotation with the same UT1, measured 6e-5 m
POLAR_MOTION_M = 20.0  # what docs/conventions.md states; 16.6 m in 1996, of the pole and UT1, none of rounding
TIMES_S = np.array([-600.0, 0.0, 86400.0])
DATES = ["2000-01-01T12:00:00", "2016-12-31T23:59:50", "2025-03-20T12:00:00"]


@pytest.fixture(autouse=True)
def no_downloads():
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("iers_degraded_accuracy", "ignore"):
        yield


def by_astropy(make, when):
    place = make(CartesianRepresentation(PLACE_M * u.m), when)
    return place.transform_to(GCRS(obstime=when)).cartesian.xyz.to_value(u.m)


@pytest.mark.parametrize("date", DATES)
@pytest.mark.parametrize(
    ("frame", "make", "tolerance_m"),
    [
        ("TEME", lambda c, t: TEME(c, obstime=t), FRAME_M),
        ("TOD", lambda c, t: TETE(c, obstime=t), FRAME_M),
        ("MOD", lambda c, t: PrecessedGeocentric(c, obstime=t, equinox=t), FRAME_M),
        ("ITRF", lambda c, t: ITRS(c, obstime=t), POLAR_MOTION_M),
    ],
)
def test_frames_against_astropy(date, frame, make, tolerance_m):
    epoch = utc_time(date)
    got = frame_to_gcrs(frame, epoch, TIMES_S) @ PLACE_M
    for row, time_s in enumerate(TIMES_S):
        expected = by_astropy(make, epoch + TimeDelta(time_s, format="sec"))
        assert np.linalg.norm(got[row] - expected) < tolerance_m


@pytest.mark.parametrize("year", range(1974, 2026))
def test_itrf_of_years_with_measured_ut1(year):
    """astropy has polar motion and UT1 of the IERS; later years are predicted."""
    for month in (1, 4, 7, 10):
        epoch = utc_time(f"{year}-{month:02d}-01T12:00:00")
        got = frame_to_gcrs("ITRF", epoch, [0.0])[0] @ PLACE_M
        assert np.linalg.norm(got - by_astropy(lambda c, t: ITRS(c, obstime=t), epoch)) < POLAR_MOTION_M


@pytest.mark.parametrize("date", DATES)
def test_itrf_against_erfa_with_the_same_ut1(date):
    """Without polar motion: what remains is the code's own error."""
    epoch = utc_time(date)
    got = frame_to_gcrs("ITRF", epoch, TIMES_S) @ PLACE_M
    whole, fraction = tt_jd(epoch, TIMES_S)
    for row, part in enumerate(fraction):
        ut1 = timescale().tt_jd(whole, part)
        matrix = erfa.c2t06a(whole, part, ut1.whole, ut1.ut1_fraction, 0.0, 0.0)
        assert np.linalg.norm(got[row] - matrix.T @ PLACE_M) < TURN_M


def test_eme2000_is_the_bias_of_the_iau():
    """P03's offsets of the J2000 pole and equinox: -16.6170, -6.8192 and -14.6 mas (Hilton et al. 2006)."""
    mas = np.radians(1e-3 / 3600.0)
    xi, eta, alpha = -16.6170 * mas, -6.8192 * mas, -14.6 * mas
    to_j2000 = np.array([[1.0, alpha, -xi], [-alpha, 1.0, -eta], [xi, eta, 1.0]])  # to first order
    np.testing.assert_allclose(eme2000_to_gcrs().T, to_j2000, rtol=0, atol=2e-12)  # 1e-5 m: the digits published
    moved_m = np.linalg.norm(eme2000_to_gcrs() @ PLACE_M - PLACE_M)
    assert 0.5 < moved_m < 1.0


@pytest.mark.parametrize("frame", FRAMES)
def test_velocity_is_the_derivative_of_the_position(frame):
    """Of a moving point, in axes that turn fast or slowly."""
    epoch, step_s = utc_time(DATES[2]), 0.1
    velocity = np.array([1000.0, -7000.0, 500.0])
    times = np.array([-step_s, 0.0, step_s])
    position = PLACE_M + times[:, None] * velocity
    r, v = states_to_gcrs(frame, epoch, times, position, np.tile(velocity, (3, 1)))
    difference = (r[2] - r[0]) / (2 * step_s)  # the next term of its series is 2e-7 m/s for the Earth's turning
    assert np.linalg.norm(difference - v[1]) < 1e-6
    if frame in ("TEME", "TOD", "MOD"):
        assert np.linalg.norm(frame_to_gcrs(frame, epoch, [0.0])[0] @ velocity - v[1]) > 1e-5


def test_spin_of_the_earth():
    """IERS: 7.2921150e-5 rad/s, about the frame's z axis but for the pole's motion in space."""
    spin = spin_rad_s("ITRF", utc_time(DATES[2]), 0.0)
    assert spin[2] == pytest.approx(7.292115e-5, rel=3e-8)
    assert np.linalg.norm(spin[:2]) < 3e-11


def test_states_of_several_objects_turn_alike():
    epoch = utc_time(DATES[2])
    position = np.random.default_rng(1).normal(size=(3, 4, 3)) * 7e6
    velocity = np.random.default_rng(2).normal(size=(3, 4, 3)) * 7e3
    r, v = states_to_gcrs("ITRF", epoch, TIMES_S, position, velocity)
    for column in range(4):
        one = states_to_gcrs("ITRF", epoch, TIMES_S, position[:, column], velocity[:, column])
        np.testing.assert_allclose(r[:, column], one[0], rtol=1e-15)
        np.testing.assert_allclose(v[:, column], one[1], rtol=1e-13)


def test_unknown_frame():
    with pytest.raises(ws.InputError, match=r"frame: must be one of GCRF, .* got 'RTN'"):
        frame_to_gcrs("RTN", utc_time(DATES[0]), [0.0])


def test_attitude_in_gcrs(tmp_path):
    """EME2000's bias goes on top, and signs are those of the shorter way."""
    (tmp_path / "a.aem").write_text(AEM.replace("0.0 0.0 0.0 1.0", "0.0 0.0 -0.05 -0.9987492177719089"))
    (segment,) = ws.read_attitude(tmp_path / "a.aem")
    time_s, quaternion = attitude_in_gcrs(segment, utc_time(DATES[2]))
    np.testing.assert_allclose(time_s, [0.0, 60.0], rtol=0, atol=2e-11)
    expected = Rotation.from_matrix(eme2000_to_gcrs()) * Rotation.from_quat(segment.quaternion)
    assert (Rotation.from_quat(quaternion) * expected.inv()).magnitude().max() < 1e-15
    assert quaternion[0] @ quaternion[1] > 0.0
