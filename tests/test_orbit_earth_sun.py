"""Earth orientation, frames of orbit files, the ellipsoid and the Sun against astropy, skyfield, ERFA and almanacs."""

from __future__ import annotations

import erfa
import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import (
    GCRS,
    ITRS,
    TEME,
    TETE,
    CartesianRepresentation,
    EarthLocation,
    PrecessedGeocentric,
    get_body_barycentric_posvel,
    solar_system_ephemeris,
)
from astropy.time import Time, TimeDelta
from astropy.utils import iers
from exchange_samples import AEM
from scipy.spatial.transform import Rotation
from skyfield.api import load, wgs84

import warpsim as ws
from warpsim.errors import InputError
from warpsim.exchange.segments import FRAMES
from warpsim.instant import tdb_jd, tt_jd, utc_time
from warpsim.orbit.earth import (
    attitude_in_gcrs,
    eme2000_to_gcrs,
    frame_to_gcrs,
    geodetic_altitude_m,
    geodetic_to_gcrs_m,
    geodetic_to_itrs_m,
    itrs_to_gcrs,
    pole_of_date,
    spin_rad_s,
    states_to_gcrs,
    timescale,
)
from warpsim.orbit.sun import earth_states

EPOCH = "2025-03-20T12:00:00"
POLAR_MOTION_M = 30.0  # polar motion (0.3 arcsec, 10 m) and the built-in delta T (tens of ms, 20 m)
SKYFIELD_M = 1e-3  # same tables: rounding of time only
TURN_ATOL = 1e-13  # of a rotation times its inverse, 1e-6 m on the ground; measured 6e-15
EPV_M, EPV_M_S = 2.0e4, 0.02  # the analytical ephemeris against itself in another frame or time argument
ALMANAC_RAD = np.radians(0.02)  # error of the Astronomical Almanac's low-precision Sun


@pytest.fixture(autouse=True)
def no_downloads():
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("iers_degraded_accuracy", "ignore"):
        yield


@pytest.mark.parametrize("date", [EPOCH, "2024-01-01T00:00:00", "2000-01-01T12:00:00"])
@pytest.mark.parametrize("place", [(129.67, 40.86, 121920.0), (-118.40, 34.10, 0.0), (10.0, -90.0, 5e5)])
def test_geodetic_to_gcrs_against_astropy(date, place):
    epoch, time_s = utc_time(date), np.array([-600.0, 0.0, 1614.0])
    got = geodetic_to_gcrs_m(*place, epoch, time_s)
    for t, p in zip(time_s, got, strict=True):
        when = epoch + TimeDelta(t, format="sec")
        expected = EarthLocation.from_geodetic(*place).get_gcrs_posvel(when)[0].xyz.to_value("m")
        assert np.linalg.norm(p - expected) < POLAR_MOTION_M


def test_geodetic_to_gcrs_against_skyfield():
    epoch, time_s = utc_time(EPOCH), np.array([0.0, 1614.0])
    ts = load.timescale(builtin=True)
    got = geodetic_to_gcrs_m([129.67, -118.4], [40.86, 34.1], 121920.0, epoch, time_s)
    for k, (lon, lat) in enumerate([(129.67, 40.86), (-118.4, 34.1)]):
        t = ts.utc(2025, 3, 20, 12, 0, time_s[k])
        expected = wgs84.latlon(lat, lon, 121920.0).at(t).position.m
        assert np.linalg.norm(got[k] - expected) < SKYFIELD_M


def test_rotations_are_rotations_for_any_shape():
    rotation = itrs_to_gcrs(utc_time(EPOCH), np.linspace(0.0, 86400.0, 2500).reshape(50, 50))
    assert rotation.shape == (50, 50, 3, 3)
    np.testing.assert_allclose(np.swapaxes(rotation, -1, -2) @ rotation, np.broadcast_to(np.eye(3), rotation.shape),
                               atol=TURN_ATOL)  # fmt: skip
    assert itrs_to_gcrs(utc_time(EPOCH), 0.0).shape == (3, 3)


def test_pole_against_erfa():
    epoch = utc_time(EPOCH)
    expected = erfa.pnm06a(epoch.tt.jd1, epoch.tt.jd2)[2]
    # Skyfield and ERFA differ in their IAU 2000A/2006 adjustments by a few milliarcsec.
    assert np.degrees(np.linalg.norm(pole_of_date(epoch) - expected)) * 3600 < 0.01
    assert 0.1 < np.degrees(np.arccos(pole_of_date(epoch)[2])) < 0.2  # a quarter century of precession


def test_geodetic_altitude_against_erfa():
    rng = np.random.default_rng(3)
    lon, lat = rng.uniform(-180, 180, 4000), np.degrees(np.arcsin(rng.uniform(-1, 1, 4000)))
    lat[:5] = [90.0, -90.0, 0.0, 89.9999999, 1e-9]
    altitude = rng.choice([-1e5, -4e2, 0.0, 1.2e5, 8e5, 1.6e6, 3.6e7, 4e8], 4000)
    position = erfa.gd2gc(1, np.radians(lon), np.radians(lat), altitude)
    np.testing.assert_allclose(geodetic_to_itrs_m(lon, lat, altitude), position, rtol=0, atol=1e-6)
    got = geodetic_altitude_m(position, [0.0, 0.0, 1.0])
    assert np.abs(got - altitude)[altitude < 1e7].max() < 1e-7  # Bowring's second round, and rounding
    assert np.abs(got - altitude).max() < 1e-6  # rounding of 4e8 m


def test_geodetic_altitude_turns_with_the_pole_and_is_negative_at_the_centre():
    pole = pole_of_date(utc_time(EPOCH))
    assert geodetic_altitude_m(7e6 * pole, pole) == pytest.approx(7e6 - 6356752.314245, abs=1e-6)
    inside = geodetic_altitude_m(np.array([[0, 0, 0], [1e3, 0, 1e3], [0, 0, 1e4], [4e4, 0, 0]], float), pole)
    assert np.all(inside < -6e6)


def test_bad_latitude_and_epoch_are_named():
    with pytest.raises(InputError, match=r"lat_deg: must be in \[-90, 90\], got 91"):
        geodetic_to_gcrs_m(0.0, 91.0, 0.0, utc_time(EPOCH), 0.0)
    for text in ("yesterday", "", "2025-13-01"):
        with pytest.raises(InputError, match="epoch_utc"):
            utc_time(text)
    assert utc_time("2025-03-20T12:00:00Z") == Time(EPOCH, scale="utc")


@pytest.mark.parametrize("date", [EPOCH, "2024-07-04T03:00:00", "2016-12-31T23:59:50"])  # the last: a leap second
def test_sun_and_earth_against_astropy(date):
    epoch, time_s = utc_time(date), np.array([-86400.0, 0.0, 20.0, 1614.0])
    when = epoch.tai + TimeDelta(time_s, format="sec")
    with solar_system_ephemeris.set("builtin"):
        sun, _ = get_body_barycentric_posvel("sun", when)
        earth, velocity = get_body_barycentric_posvel("earth", when)
    expected = (sun - earth).xyz.to_value("m").T
    assert np.abs(earth_states(epoch, time_s).sun_m - expected).max() < EPV_M
    assert np.abs(earth_states(epoch, time_s).velocity_m_s - velocity.xyz.to_value("m/s").T).max() < EPV_M_S


def test_sun_against_the_almanac():
    epoch = utc_time(EPOCH)
    direction = earth_states(epoch, 0.0).sun_m
    distance_m = np.linalg.norm(direction)
    n = epoch.tt.jd - 2451545.0  # Astronomical Almanac, page C5: low-precision formulae, equinox of date
    anomaly = np.radians(357.528 + 0.9856003 * n)
    longitude = np.radians(280.460 + 0.9856474 * n + 1.915 * np.sin(anomaly) + 0.020 * np.sin(2 * anomaly))
    longitude -= np.radians(1.3969713 * n / 36525.0)  # precession back to J2000
    longitude += np.radians(20.5 / 3600)  # aberration is in the formula, not in ours
    tilt = np.radians(23.4393)
    expected = [np.cos(longitude), np.sin(longitude) * np.cos(tilt), np.sin(longitude) * np.sin(tilt)]
    assert np.linalg.norm(direction / distance_m - expected) < ALMANAC_RAD
    # 1.4e-4 is the formula's next term, left out here.
    assert distance_m == pytest.approx(1.49597870700e11 * (1.00014 - 0.01671 * np.cos(anomaly)), rel=3e-4)


def test_earth_velocity_is_the_derivative_of_its_place():
    epoch = utc_time(EPOCH)
    rate = -(earth_states(epoch, 50.0).sun_m - earth_states(epoch, -50.0).sun_m) / 100.0
    # The Sun itself moves about the barycentre by up to 16 m/s; a thousandth of the Earth's own speed.
    assert np.linalg.norm(rate - earth_states(epoch, 0.0).velocity_m_s) < 30.0


def test_tdb_against_astropy():
    epoch = utc_time(EPOCH)
    whole, fraction = tdb_jd(epoch, np.array([0.0, 1e6]))
    expected = (epoch.tai + TimeDelta([0.0, 1e6], format="sec")).tdb
    # Their UT1 stand-in moves the observer terms by 2 microseconds at most.
    assert np.abs((whole - expected.jd1) + (fraction - expected.jd2)).max() * 86400 < 3e-6


def test_gcrs_axes_are_astropys():
    """A distant fixed point has the same direction in our axes and in astropy's GCRS (no transposed matrices)."""
    epoch = utc_time(EPOCH)
    fixed = EarthLocation.from_geodetic(0.0, 0.0, 0.0)
    itrs = fixed.get_itrs(epoch)
    gcrs = itrs.transform_to(GCRS(obstime=epoch)).represent_as(CartesianRepresentation).xyz.to_value("m")
    assert np.linalg.norm(itrs_to_gcrs(epoch, 0.0)[:, 0] * 6378137.0 - gcrs) < POLAR_MOTION_M


def test_time_scales_are_skyfields_own():
    ours, theirs = timescale(), load.timescale(builtin=True)
    for year in (1950.0, 1975.3, 2017.0, 2025.2, 2090.0):
        one, other = ours.J(year), theirs.J(year)
        assert (one.tt, one.ut1, one.delta_t) == (other.tt, other.ut1, other.delta_t)
        assert np.array_equal(one.M, other.M)


PLACE_M = np.array([5.0e6, -3.0e6, 4.0e6])  # 7,071 km from the centre
FRAME_M = 1e-3  # measured: MOD 1e-5, TOD 1.6e-4, TEME 4.6e-4 m
BIAS_M = 1e-8
TURN_M = 1e-3  # Earth rotation with the same UT1, measured 6e-5 m
POLE_AND_UT1_M = 20.0  # what docs/conventions.md states; 16.6 m in 1996, of the pole and UT1, none of rounding
TIMES_S = np.array([-600.0, 0.0, 86400.0])
DATES = ["2000-01-01T12:00:00", "2016-12-31T23:59:50", "2025-03-20T12:00:00"]


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
        ("ITRF", lambda c, t: ITRS(c, obstime=t), POLE_AND_UT1_M),
    ],
)
def test_frames_against_astropy(date, frame, make, tolerance_m):
    epoch = utc_time(date)
    got = frame_to_gcrs(frame, epoch, TIMES_S) @ PLACE_M
    for row, time_s in enumerate(TIMES_S):
        expected = by_astropy(make, epoch + TimeDelta(time_s, format="sec"))
        assert np.linalg.norm(got[row] - expected) < tolerance_m


@pytest.mark.ci
@pytest.mark.parametrize("year", range(1974, 2026))
def test_itrf_of_years_with_measured_ut1(year):
    """astropy has polar motion and UT1 of the IERS; later years are predicted."""
    for month in (1, 4, 7, 10):
        epoch = utc_time(f"{year}-{month:02d}-01T12:00:00")
        got = frame_to_gcrs("ITRF", epoch, [0.0])[0] @ PLACE_M
        assert np.linalg.norm(got - by_astropy(lambda c, t: ITRS(c, obstime=t), epoch)) < POLE_AND_UT1_M


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
    time_s, quaternion, _ = attitude_in_gcrs(segment, utc_time(DATES[2]))
    np.testing.assert_allclose(time_s, [0.0, 60.0], rtol=0, atol=2e-11)
    expected = Rotation.from_matrix(eme2000_to_gcrs()) * Rotation.from_quat(segment.quaternion)
    assert (Rotation.from_quat(quaternion) * expected.inv()).magnitude().max() < 1e-15
    assert quaternion[0] @ quaternion[1] > 0.0
