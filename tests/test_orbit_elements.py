"""Kepler elements and state vectors: Kepler's equation against mpmath, states against geometry and back again."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from astropy import units as u
from pydantic import TypeAdapter
from scipy.integrate import solve_ivp

from warpsim.errors import InputError
from warpsim.instant import utc_time
from warpsim.orbit.constellations import Orbit
from warpsim.orbit.elements import (
    KeplerOrbit,
    StateVector,
    eccentric_anomaly_rad,
    elements_to_state,
    mean_anomaly_of_true_rad,
    state_to_elements,
)

MU = 3.986004418e14
EARTH_M = 6378137.0
EPOCH = utc_time("2025-06-01T00:00:00")

KEPLER = 1e-15  # error of E times 1 - e cos E; measured 6.6e-16
GEOMETRY = 1e-14  # of the semi-major axis, and of the speed; measured 1.2e-15
STATE = 1e-9  # relative, the promised round trip
STATE_ROUND = 1e-13  # relative, for e <= 0.7; measured 1e-14
ELEMENT = 1e-9  # relative, of a and e where the orbit is far from a parabola
FLIGHT_M = 1e-3  # against DOP853 at 1e-12 over one revolution; measured 4.3e-4

ECCENTRICITIES = [0.0, 1e-17, 1e-16, 1e-12, 1e-8, 1e-4, 0.01, 0.3, 0.7, 0.95, 0.999]
INCLINATIONS = [0.0, 1e-14, 1e-8, 1e-3, 30.0, 90.0, 150.0, 179.9999, 180 - 1e-12, 180.0]


@pytest.mark.parametrize("eccentricity", [0.0, 1e-16, 1e-8, 0.01, 0.3, 0.7, 0.9, 0.99, 0.999, 0.999999])
def test_keplers_equation_is_solved(eccentricity):
    rng = np.random.default_rng(2)
    mean = np.concatenate([rng.uniform(-math.pi, math.pi, 30), [0.0, 1e-12, 1e-6, 1e-3, -1e-3, math.pi, -math.pi]])
    mpmath.mp.dps = 40
    for m, solved in zip(mean, eccentric_anomaly_rad(mean, eccentricity), strict=True):
        e, x = mpmath.mpf(eccentricity), mpmath.mpf(float(solved))
        for _ in range(8):  # Newton in 40 digits, from the answer
            x -= (x - e * mpmath.sin(x) - mpmath.mpf(float(m))) / (1 - e * mpmath.cos(x))
        assert abs(solved - x) * (1 - e * mpmath.cos(x)) <= KEPLER


def test_anomalies_keep_their_turn():
    assert eccentric_anomaly_rad(7.0, 0.0) == pytest.approx(7.0, abs=1e-15, rel=0)
    there = mean_anomaly_of_true_rad(np.array([-10.0, 0.0, 3.0, 10.0]), 0.3)
    turn = mean_anomaly_of_true_rad(np.array([-10.0, 0.0, 3.0, 10.0]) + 2 * math.pi, 0.3)
    assert turn - there == pytest.approx(2 * math.pi, abs=4e-15, rel=0)


def by_geometry(a, e, i, node, perigee, mean):
    """The state in 40 digits: an ellipse in its plane, turned by three rotations."""
    mpmath.mp.dps = 40
    mp = mpmath.mpf
    a, e, i, node, perigee, mean = (mp(float(x)) for x in (a, e, i, node, perigee, mean))
    i, node, perigee, mean = (x * mpmath.pi / 180 for x in (i, node, perigee, mean))
    anomaly = mpmath.findroot(lambda x: x - e * mpmath.sin(x) - mean, (mean - 1, mean + 1), solver="anderson")
    rate = mpmath.sqrt(mp(MU) / a**3) / (1 - e * mpmath.cos(anomaly))
    b = a * mpmath.sqrt(1 - e * e)
    place = mpmath.matrix([a * (mpmath.cos(anomaly) - e), b * mpmath.sin(anomaly), 0])
    course = mpmath.matrix([-a * rate * mpmath.sin(anomaly), b * rate * mpmath.cos(anomaly), 0])

    def about_z(x):
        c, s = mpmath.cos(x), mpmath.sin(x)
        return mpmath.matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]])

    c, s = mpmath.cos(i), mpmath.sin(i)
    turn = about_z(node) * mpmath.matrix([[1, 0, 0], [0, c, -s], [0, s, c]]) * about_z(perigee)
    return np.array([float(x) for x in turn * place]), np.array([float(x) for x in turn * course])


@pytest.mark.parametrize("eccentricity", [0.0, 0.01, 0.7, 0.95])
def test_states_are_ellipses_turned_by_the_angles(eccentricity):
    rng = np.random.default_rng(3)
    rows = np.column_stack([rng.uniform(6.6e6, 5e7, 8), np.full(8, eccentricity), rng.uniform(0, 180, 8),
                            rng.uniform(-360, 360, (3, 8)).T])  # fmt: skip
    rows[0, 2:] = 0.0
    position, velocity = elements_to_state(*rows.T)
    for row, r, v in zip(rows, position, velocity, strict=True):
        expected_m, expected_m_s = by_geometry(*row)
        assert np.linalg.norm(r - expected_m) < GEOMETRY * row[0]
        assert np.linalg.norm(v - expected_m_s) < GEOMETRY * np.linalg.norm(expected_m_s)


def many_orbits(n=20000):
    rng = np.random.default_rng(4)
    a, e, i = rng.uniform(6.6e6, 5e7, n), rng.choice(ECCENTRICITIES, n), rng.choice(INCLINATIONS, n)
    angles = rng.choice([0.0, 90.0, 180.0, 270.0], (3, n))
    free = rng.random((3, n)) < 0.8
    angles[free] = rng.uniform(0, 360, free.sum())
    return a, e, i, angles


def test_states_come_back_from_their_elements():
    """Also circular and equatorial ones, where single angles mean nothing but their sums do."""
    a, e, i, angles = many_orbits()
    position, velocity = elements_to_state(a, e, i, *angles)
    found = state_to_elements(position, velocity)
    again_m, again_m_s = elements_to_state(*found[:6])
    error = np.maximum(
        np.linalg.norm(again_m - position, axis=1) / np.linalg.norm(position, axis=1),
        np.linalg.norm(again_m_s - velocity, axis=1) / np.linalg.norm(velocity, axis=1),
    )
    assert error.max() < STATE and error[e <= 0.7].max() < STATE_ROUND
    assert np.abs(found.semi_major_axis_m / a - 1)[e < 0.99].max() < ELEMENT
    assert np.abs(found.eccentricity - e).max() < 1e-14
    assert np.abs(found.inclination_deg - i).max() < 1e-7
    for angle in (*found[3:],):
        assert np.all((angle >= 0) & (angle <= 360)) and np.isfinite(angle).all()


def test_elements_come_back_where_they_mean_something():
    rng = np.random.default_rng(5)
    n = 2000
    a, e, i = rng.uniform(6.6e6, 5e7, n), rng.uniform(0.01, 0.9, n), rng.uniform(1, 179, n)
    angles = rng.uniform(0, 360, (3, n))
    found = state_to_elements(*elements_to_state(a, e, i, *angles))
    for value, given in zip(
        (found.raan_deg, found.argument_of_perigee_deg, found.mean_anomaly_deg), angles, strict=True
    ):
        assert np.abs((value - given + 180) % 360 - 180).max() < 1e-8
    assert np.abs(found.inclination_deg - i).max() < 1e-10
    again = mean_anomaly_of_true_rad(np.radians(found.true_anomaly_deg), e)
    assert np.abs((np.degrees(again) - angles[2] + 180) % 360 - 180).max() < 1e-8


def test_conventions_of_circular_and_equatorial_orbits():
    r, v = 7e6, math.sqrt(MU / 7e6)
    found = state_to_elements([0.0, r, 0.0], [-v, 0.0, 0.0])
    assert found.raan_deg == 0 and found.inclination_deg == 0
    along_deg = found.argument_of_perigee_deg + found.mean_anomaly_deg
    assert along_deg % 360 == pytest.approx(90, abs=1e-12, rel=0)
    back = state_to_elements([0.0, r, 0.0], [v, 0.0, 0.0])
    assert back.inclination_deg == 180 and back.raan_deg == 0
    assert state_to_elements(np.ones((2, 3, 3)) * 5e6, [[[0, 0, 5e3]]]).eccentricity.shape == (2, 3)


@pytest.mark.parametrize(
    ("position", "velocity"),
    [
        ([7e6, 0, 0], [0, 12e3, 0]),
        ([7e6, 0, 0], [1e3, 0, 0]),
        ([0, 0, 0], [0, 7e3, 0]),
        ([math.nan, 0, 0], [0, 7e3, 0]),
        ([7e6, 0, 0], [0, math.sqrt(2 * MU / 7e6) * (1 + 1e-12), 0]),
    ],
    ids=["hyperbola", "straight down", "centre", "nan", "parabola"],
)
def test_open_orbits_have_no_elements(position, velocity):
    with pytest.raises(InputError, match=r"must be a closed orbit, state 1 is not"):
        state_to_elements([[7e6, 0, 0], position], [[0, 7e3, 0], velocity])


def test_wrong_elements_are_named():
    for changes, message in [
        ((0.0, 0.1, 0), "semi_major_axis_m: must be > 0, element 1"),
        ((7e6, 1.0, 0), r"eccentricity: must be in \[0, 1\), element 1"),
        ((7e6, -0.1, 0), r"eccentricity: must be in \[0, 1\)"),
        ((7e6, 0.1, math.inf), "angles: must be finite"),
    ]:
        with pytest.raises(InputError, match=message), np.errstate(invalid="ignore"):
            elements_to_state(*([good, bad] for good, bad in zip((7e6, 0.0, 1.0), changes, strict=True)), 0, 0, 0)
    with pytest.raises(InputError, match=r"must have shape \(\.\.\., 3\)"):
        state_to_elements([1.0, 2.0], [1.0, 2.0])


def test_circular_orbit_by_altitude():
    orbit = KeplerOrbit(inclination_deg=60.0, altitude_km=500.0, gravity="two_body")
    r, v = orbit.state()
    assert r[0] == pytest.approx([EARTH_M + 500e3, 0, 0], abs=1e-8)
    speed = math.sqrt(MU / (EARTH_M + 500e3))
    assert v[0] == pytest.approx([0, speed / 2, speed * math.sqrt(3) / 2], abs=1e-11)
    period_s = 2 * math.pi * math.sqrt((EARTH_M + 500e3) ** 3 / MU)
    there, back = orbit.states(EPOCH, [0.5 * period_s, period_s])[0][:, 0]
    assert np.linalg.norm(there + r[0]) < 1e-6 and np.linalg.norm(back - r[0]) < 1e-6


def test_sizes_and_anomalies_say_the_same():
    same = [
        KeplerOrbit(63.4, semi_major_axis_km=26600.0, eccentricity=0.7, argument_of_perigee_deg=270.0),
        KeplerOrbit(63.4, perigee_altitude_km=26600 * 0.3 - 6378.137, eccentricity=0.7, argument_of_perigee_deg=-90.0),
        KeplerOrbit(63.4 * u.deg, semi_major_axis_km=2.66e7 * u.m, eccentricity=0.7, argument_of_perigee_deg=270,
                    true_anomaly_deg=360),
    ]  # fmt: skip
    for orbit in same[1:]:
        assert orbit.state()[0][0] == pytest.approx(same[0].state()[0][0], abs=1e-6, rel=0)
    turned = KeplerOrbit(63.4, semi_major_axis_km=26600.0, eccentricity=0.7, true_anomaly_deg=120.0)
    assert state_to_elements(*turned.state()).true_anomaly_deg[0] == pytest.approx(120, abs=1e-11, rel=0)


def j2_flight(r, v, pole, time_s):
    """DOP853 with central force and J2, written from the potential."""
    j2 = 1.0826266835e-3

    def rates(_, y):
        p = y[:3]
        d, w = np.linalg.norm(p), pole @ p
        factor = 1.5 * j2 * MU * EARTH_M**2 / d**5
        return [*y[3:], *(-MU * p / d**3 + factor * ((5 * w * w / d**2 - 1) * p - 2 * w * pole))]

    y0 = [*r, *v]
    return solve_ivp(rates, (0, time_s), y0, "DOP853", rtol=1e-12, atol=1e-6, t_eval=[time_s]).y[:3, 0]


@pytest.mark.parametrize(
    "orbit",
    [
        KeplerOrbit(51.6, altitude_km=420.0, raan_deg=30.0, mean_anomaly_deg=77.0),
        StateVector([7e6, 0, 0], [0, 5e3, 5.9e3]),
        StateVector([7e6, 0, 0], [3e3, 5e3, 9.9e3]),
    ],
    ids=["elements", "state", "hyperbola"],
)
def test_flight_under_j2(orbit):
    from warpsim.orbit.earth import pole_of_date

    position, velocity = orbit.states(EPOCH, [5400.0, 0.0])
    assert position.shape == velocity.shape == (2, 1, 3)
    start_m, start_m_s = position[1, 0], velocity[1, 0]
    assert np.array_equal(start_m, orbit.state()[0][0]) and np.array_equal(start_m_s, orbit.state()[1][0])
    expected = j2_flight(start_m, start_m_s, pole_of_date(EPOCH), 5400.0)
    assert np.linalg.norm(position[0, 0] - expected) < FLIGHT_M


def test_a_state_may_hold_at_another_time():
    at_epoch = StateVector([7e6, 1e5, 0], [0, 5e3, 5.9e3], gravity="two_body")
    r, v = (x[0, 0] for x in at_epoch.states(EPOCH, [300.0]))
    later = StateVector(tuple(r), tuple(v), time_s=300.0, gravity="two_body")
    position, velocity = later.states(EPOCH, [0.0, 300.0])
    assert position[0, 0] == pytest.approx([7e6, 1e5, 0], abs=1e-6, rel=0)
    assert np.array_equal(position[1, 0], r) and velocity[0, 0] == pytest.approx([0, 5e3, 5.9e3], abs=1e-9, rel=0)


def test_quantities_and_arrays_are_taken():
    one = StateVector([7000, 0, 0] * u.km, [0, 7.5, 0] * u.km / u.s, time_s=1 * u.min)
    assert one == StateVector(np.array([7e6, 0, 0]), (0, 7500.0, 0), time_s=60.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: KeplerOrbit(60.0), r"^KeplerOrbit: altitude_km, perigee_altitude_km, semi_major_axis_km: exactly"),
        (lambda: KeplerOrbit(60.0, altitude_km=1.0, semi_major_axis_km=7e3), "exactly one must be given"),
        (lambda: KeplerOrbit(60.0, altitude_km=500.0, eccentricity=0.1), "altitude_km: is that of a circular orbit"),
        (lambda: KeplerOrbit(60.0, altitude_km=1.0, mean_anomaly_deg=1, true_anomaly_deg=1), "at most one may"),
        (lambda: KeplerOrbit(181.0, altitude_km=1.0), r"inclination_deg: must be in \[0, 180\], got 181"),
        (lambda: KeplerOrbit(60.0, perigee_altitude_km=500.0, eccentricity=1.0), r"must be in \[0, 0\.999\]"),
        (lambda: KeplerOrbit(60.0, semi_major_axis_km=1e10), "must give a semi-major axis in"),
        (lambda: KeplerOrbit(60.0, perigee_altitude_km=-7000.0), "must give a semi-major axis in"),
        (lambda: KeplerOrbit(60.0, semi_major_axis_km=7e3, eccentricity=0.1), r"^KeplerOrbit: orbit: must start above"),
        (lambda: StateVector((7000, 0, 0), (0, 7.5, 0)), r"position_m: must start above .* got 7 km$"),
        (lambda: StateVector((7e6, 0), (0, 7.5, 0)), "position_m"),
        (lambda: StateVector((7e6, 0, math.nan), (0, 7.5, 0)), r"position_m\[2\]: must be finite"),
        (lambda: KeplerOrbit(60.0, altitude_km=1.0, gravity="full"), "gravity: must be"),
    ],
)  # fmt: skip
def test_faults_are_one_clear_line(make, message):
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert len(str(caught.value).splitlines()) == 1


def test_an_orbit_through_the_ground_may_start_above_it():
    orbit = KeplerOrbit(60.0, semi_major_axis_km=7e3, eccentricity=0.1, true_anomaly_deg=180.0)
    assert np.linalg.norm(orbit.states(EPOCH, [0.0, 60.0])[0][0, 0]) == pytest.approx(7.7e6, abs=1e-6, rel=0)


@pytest.mark.parametrize(
    "orbit",
    [KeplerOrbit(60.0, altitude_km=500.0), StateVector((7e6, 0, 0), (0, 7e3, 1e3), time_s=4.0, gravity="two_body")],
)
def test_orbits_survive_plain_data(orbit):
    adapter = TypeAdapter(Orbit)
    assert adapter.validate_python(adapter.dump_python(orbit, mode="json")) == orbit
