"""Two-body and J2 propagation, and tracks, against scipy's DOP853, mpmath and closed forms."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from warpsim.constants import EARTH_J2, EARTH_J3, EARTH_J4
from warpsim.errors import InputError
from warpsim.orbit import gravity, node_steps, sampling
from warpsim.orbit.elements import StateVector
from warpsim.orbit.gravity import propagate
from warpsim.orbit.node_steps import TRACK_ERROR_M, make_tracks
from warpsim.orbit.sampling import node_grid, sample_tracks
from warpsim.orbit.track import Track
from warpsim.orbit.two_body import stumpff

MU, RADIUS, J2 = 3.986004418e14, 6378137.0, 1.0826266835e-3
POLE = np.array([0.0024, -0.00003, 1.0]) / np.linalg.norm([0.0024, -0.00003, 1.0])  # not the z axis, on purpose

J2_FLIGHT_M = 1e-5  # a hundredth of what tracks may err between their nodes; rounding, ours and DOP853's, is 1.2e-6
J2_DAY_M = 1e-2  # the same over a day, of which an eccentric orbit makes the most, 1.7e-3
END_M = 2e-4  # rounding after a perigee; measured 4e-5
KEPLER_M = 1e-5  # rounding of the closed form and DOP853's own error over a flight
HERMITE_M = 1e-3
"""Interpolation bound asked for. Steps are chosen to reach 0.8 of it, and the largest error comes to that: it follows
from the step, of which rounding changes nothing that shows."""
OFF_MIDDLE = 1.02
"""Worst error between nodes over the error at midpoints, which is measured: 1 for a short step, and no rounding counts,
1e-9 m of 1e-4."""


def j2_force(t, y, mu=MU):
    """Gradient of the potential in pole axes, written out in Cartesian components."""
    east = np.cross([0.0, 1.0, 0.0], POLE)
    east /= np.linalg.norm(east)
    frame = np.stack([east, np.cross(POLE, east), POLE])
    x, yy, z = frame @ y[:3]
    r = np.sqrt(x * x + yy * yy + z * z)
    k = 1.5 * J2 * mu * RADIUS**2 / r**5
    a = np.array(
        [
            -mu * x / r**3 - k * x * (1 - 5 * z * z / r**2),
            -mu * yy / r**3 - k * yy * (1 - 5 * z * z / r**2),
            -mu * z / r**3 - k * z * (3 - 5 * z * z / r**2),
        ]
    )
    return np.concatenate([y[3:], frame.T @ a])


def two_body_force(t, y):
    return np.concatenate([y[3:], -MU * y[:3] / np.linalg.norm(y[:3]) ** 3])


def integrate(force, r, v, time_s):
    run = solve_ivp(force, (0.0, time_s[-1]), np.concatenate([r, v]), "DOP853", t_eval=time_s, rtol=3e-14, atol=1e-9)
    return run.y[:3].T, run.y[3:].T


def circular(radius_m, inclination=1.36):
    speed = np.sqrt(MU / radius_m)
    return np.array([radius_m, 0.0, 0.0]), speed * np.array([0.0, np.cos(inclination), np.sin(inclination)])


STATES = {
    "walker-1598-km": circular(RADIUS + 1.598e6),
    "low-orbit": circular(RADIUS + 3.0e5),
    "arc": (np.array([-3.2e6, 3.6e6, 4.3e6]), np.array([-3200.0, 3000.0, 5600.0])),
    "eccentric": (np.array([7.0e6, 0.0, 1.0e6]), np.array([500.0, 8500.0, 3000.0])),
}


@pytest.mark.parametrize("name", STATES)
@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["after", "before"])
def test_j2_matches_dop853_over_a_flight(name, sign, record_accuracy):
    r, v = STATES[name]
    v = sign * v if name == "arc" else v  # back in time, the arc would fall to the Earth's centre
    time_s = sign * np.array([0.0, 3.7, 400.0, 401.3, 1614.0])
    position, velocity = propagate(r[None], v[None], time_s, "j2", POLE)
    expected_r, expected_v = integrate(j2_force, r, v, time_s)
    assert np.abs(position[:, 0] - expected_r).max() < J2_FLIGHT_M
    error_m = np.abs(position[:, 0] - expected_r).max()
    record_accuracy("Orbit with J2 over 1614 s", error_m, J2_FLIGHT_M, "m", "DOP853, same forces")
    assert np.abs(velocity[:, 0] - expected_v).max() < 1e-2 * J2_FLIGHT_M


@pytest.mark.slow
@pytest.mark.parametrize("name", ["walker-1598-km", "low-orbit", "eccentric"])
def test_j2_matches_dop853_over_a_day(name, record_accuracy):
    r, v = STATES[name]
    position, _ = propagate(r[None], v[None], np.array([86400.0]), "j2", POLE)
    error_m = np.linalg.norm(position[0, 0] - integrate(j2_force, r, v, np.array([86400.0]))[0][0])
    assert error_m < J2_DAY_M
    record_accuracy("Orbit with J2 over a day", error_m, J2_DAY_M, "m", "DOP853, same forces")


def from_perigee(eccentricity, radius_m=7.0e6):
    r, v = circular(radius_m, 1.1)
    return r, v * np.sqrt(1.0 + eccentricity)


END_TIMES = {  # state, length of the longest flight
    "low-orbit": (STATES["low-orbit"], 6000.0),
    "molniya": (from_perigee(0.74), 43000.0),
    "e-0.9": (from_perigee(0.9), 60000.0),
    "hyperbolic": (from_perigee(1.5), 40000.0),
    "falling": ((np.array([1.0e5, 0.0, 9.2e6]), np.array([50.0, 20.0, -500.0])), 900.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", END_TIMES)
@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["after", "before"])
def test_every_end_time_has_its_state(name, sign):
    """Times asked for alone, one after the other: where segments end must not matter."""
    (r, v), longest_s = END_TIMES[name]
    if name == "falling":
        v = sign * v
    elif name != "low-orbit":  # the perigee in the middle
        r, v = (x[0, 0] for x in propagate(r[None], v[None], [-0.5 * sign * longest_s], "two_body", POLE))
    time_s = sign * np.unique(np.random.default_rng(5).uniform(0.01 * longest_s, longest_s, 250).round(1))
    states = {
        "oracle": np.stack(integrate(j2_force, r, v, time_s)),
        "together": np.stack(propagate(r[None], v[None], time_s, "j2", POLE))[:, :, 0],
        "alone": np.stack([propagate(r[None], v[None], [t], "j2", POLE) for t in time_s], axis=1)[:, :, 0, 0],
    }
    for name in ("oracle", "together"):
        off_m, off_m_s = np.abs(states["alone"] - states[name]).max(axis=(1, 2))
        assert off_m < END_M
        assert off_m_s < END_M / 100.0


def potential(position, zonal):
    """mu/r (1 - sum J_n (R/r)^n P_n(sin latitude)) with numpy's own Legendre series; takes complex numbers."""
    r = np.sqrt(position @ position)
    series = [0.0, 0.0, *(j * (RADIUS / r) ** n for n, j in zonal)]
    return MU / r * (1.0 - np.polynomial.legendre.legval(position @ POLE / r, series))


def j4_force(t, y):
    """Gradient by complex steps: no digits are lost, and no formula is shared."""
    gradient = [potential(y[:3] + 1e-20j * axis, J2_TO_J4).imag / 1e-20 for axis in np.eye(3)]
    return np.concatenate([y[3:], gradient])


J2_TO_J4 = [(2, J2), (3, -2.5326564853e-6), (4, -1.6196215914e-6)]


def test_harmonics_are_those_of_egm96():
    """From the normalised coefficients of the model: J_n = -sqrt(2n + 1) C_n0."""
    normalised = {2: -0.484165371736e-3, 3: 0.957254173792e-6, 4: 0.539873863789e-6}
    for (n, coefficient), value in zip(normalised.items(), (EARTH_J2, EARTH_J3, EARTH_J4), strict=True):
        assert value == pytest.approx(-np.sqrt(2 * n + 1) * coefficient, rel=2e-10, abs=0)


@pytest.mark.parametrize("name", ["walker-1598-km", "low-orbit", "eccentric"])
@pytest.mark.parametrize("duration_s", [-1614.0, 1614.0, 20000.0])
def test_j4_matches_dop853(name, duration_s, record_accuracy):
    r, v = STATES[name]
    position, velocity = propagate(r[None], v[None], np.array([duration_s]), "j4", POLE)
    expected_r, expected_v = integrate(j4_force, r, v, np.array([duration_s]))
    bound_m = J2_FLIGHT_M if abs(duration_s) < 2e3 else J2_DAY_M
    error_m = np.linalg.norm(position[0, 0] - expected_r)
    assert error_m < bound_m
    if bound_m == J2_FLIGHT_M:
        record_accuracy("Orbit with J2 to J4 over 1614 s", error_m, bound_m, "m", "DOP853, same forces")
    assert np.linalg.norm(velocity[0, 0] - expected_v) < 1e-2 * bound_m


def test_j3_and_j4_matter_little():
    r, v = STATES["walker-1598-km"]
    ends = [propagate(r[None], v[None], np.array([86400.0]), g, POLE)[0][0, 0] for g in ("j2", "j4")]
    assert 10.0 < np.linalg.norm(ends[0] - ends[1]) < 2e3


def test_many_paths_are_followed_as_each_alone():
    """Orbits of very different size share segments; nobody's path may suffer."""
    r, v = (np.stack(x) for x in zip(*STATES.values(), strict=True))
    far, slow = circular(4.2164e7, 0.1)
    r, v = np.vstack([np.tile(r, (100, 1)), far]), np.vstack([np.tile(v, (100, 1)), slow])
    time_s = np.array([0.0, 500.0, 1614.0])
    position, _ = propagate(r, v, time_s, "j2", POLE)
    for i in (0, 2, 3, 400):
        alone, _ = propagate(r[i : i + 1], v[i : i + 1], time_s, "j2", POLE)
        assert np.abs(position[:, i] - alone[:, 0]).max() < J2_FLIGHT_M


@pytest.mark.parametrize("name", STATES)
def test_two_body_matches_dop853(name):
    r, v = STATES[name]
    time_s = np.array([0.0, 100.0, 1614.0])
    position, velocity = propagate(r[None], v[None], time_s, "two_body", POLE)
    expected_r, expected_v = integrate(two_body_force, r, v, time_s)
    assert np.abs(position[:, 0] - expected_r).max() < KEPLER_M
    assert np.abs(velocity[:, 0] - expected_v).max() < 1e-2 * KEPLER_M


def test_circular_orbit_thirty_years_away_is_still_a_turn_of_a_circle():
    r, v = circular(8.0e6)
    time_s = np.array([-30.0, 30.0]) * 365.25 * 86400.0
    position, _ = propagate(r[None], v[None], time_s, "two_body", POLE)
    for t, p in zip(time_s, position[:, 0], strict=True):
        with mpmath.workdps(40):
            angle = mpmath.sqrt(mpmath.mpf(MU) / mpmath.mpf(8.0e6) ** 3) * mpmath.mpf(t)
            expected = float(mpmath.cos(angle)) * r + float(mpmath.sin(angle)) * v * np.sqrt(8.0e6**3 / MU)
        # 0.8 million radians in float64: the rounding of the mean motion alone is 1e-16 * 8e5 * 8e6 m.
        assert np.linalg.norm(p - expected) < 0.05


@pytest.mark.parametrize("speed", [1.5, np.sqrt(2.0), 1.41421, 0.8], ids=["hyperbola", "parabola", "near", "ellipse"])
def test_two_body_conserves_energy_and_momentum_and_comes_back(speed):
    r = np.array([8.0e6, 1.0e6, -2.0e6])
    u = np.cross(r, [0.1, 0.3, 1.0])
    v = speed * np.sqrt(MU / np.linalg.norm(r)) * u / np.linalg.norm(u)
    position, velocity = (x[0] for x in propagate(r[None], v[None], np.array([1500.0]), "two_body", POLE))
    np.testing.assert_allclose(np.cross(position[0], velocity[0]), np.cross(r, v), rtol=1e-11, atol=1e-2)
    energy = velocity[0] @ velocity[0] / 2 - MU / np.linalg.norm(position[0])
    assert energy == pytest.approx(v @ v / 2 - MU / np.linalg.norm(r), abs=1e-12 * MU / 8e6 * 100)
    back, _ = propagate(position, velocity, np.array([-1500.0]), "two_body", POLE)
    assert np.linalg.norm(back[0, 0] - r) < KEPLER_M


def test_j2_and_two_body_differ_by_kilometres_after_the_flight():
    r, v = STATES["walker-1598-km"]
    ends = [propagate(r[None], v[None], np.array([1614.0]), g, POLE)[0][0, 0] for g in ("two_body", "j2")]
    assert 1e3 < np.linalg.norm(ends[0] - ends[1]) < 1e4


def test_output_times_do_not_change_the_path():
    r, v = STATES["low-orbit"]
    dense = np.linspace(-100.0, 1614.0, 3001)
    position, _ = propagate(r[None], v[None], dense, "j2", POLE)
    shuffled = np.random.default_rng(1).permutation(len(dense))
    again, _ = propagate(r[None], v[None], dense[shuffled], "j2", POLE)
    assert np.array_equal(again, position[shuffled])
    alone, _ = propagate(r[None], v[None], dense[2000:2001], "j2", POLE)
    assert np.linalg.norm(alone[0] - position[2000]) < J2_FLIGHT_M


@pytest.mark.parametrize("z", [-400.0, -1.5, -1.0, -1e-3, 0.0, 1e-8, 0.999, 1.0, 1.001, 9.0, 39.4])
def test_stumpff_against_mpmath(z):
    with mpmath.workdps(40):
        m = mpmath.mpf(z)
        c = mpmath.nsum(lambda k: (-m) ** k / mpmath.factorial(2 * k + 2), [0, 120], method="direct")
        s = mpmath.nsum(lambda k: (-m) ** k / mpmath.factorial(2 * k + 3), [0, 120], method="direct")
    got = stumpff(z)
    assert float(got[0]) == pytest.approx(float(c), rel=1e-13, abs=1e-17)
    assert float(got[1]) == pytest.approx(float(s), rel=1e-13)


def test_picard_refuses_what_is_not_finite(monkeypatch):
    pull = gravity.zonal_acceleration_m_s2

    def pull_with_a_hole(x, zonal):
        return np.where(x[..., :1, :] < 6.6e6, np.nan, pull(x, zonal))

    r, v = (x[:, None] for x in STATES["low-orbit"])
    for bad in ((r + np.nan, v), (r, v + np.nan)):
        with pytest.raises(InputError, match="falls through it at"):
            gravity._integrate(*bad, np.array([50.0]), (), 0.0)
    monkeypatch.setattr(gravity, "zonal_acceleration_m_s2", pull_with_a_hole)
    with pytest.raises(InputError, match="falls through it at") as caught:
        gravity._integrate(r, v, np.array([5000.0]), (), 0.0)
    assert 100.0 < float(str(caught.value).split()[-2]) < 150.0  # where x = 6600 km


def test_falls_are_told_in_the_time_of_the_epoch():
    from astropy.time import Time

    epoch = Time("2025-03-20T12:00:00", scale="utc")
    place = (0.0, 7.0e6, 0.0)
    for time_s in (0.0, -100.0, 250.0):
        vector = StateVector(position_m=place, velocity_m_s=(0.0, 0.0, 0.0), time_s=time_s)
        with pytest.raises(InputError, match="must stay above half the Earth's radius, but falls through") as caught:
            vector.states(epoch, [5000.0])
        # From rest, the line of a radial fall: t = sqrt(r^3 / 2 mu) (acos(sqrt x) + sqrt(x (1 - x))).
        x = 0.5 * RADIUS / 7.0e6
        fall_s = np.sqrt(7.0e6**3 / (2 * MU)) * (np.arccos(np.sqrt(x)) + np.sqrt(x * (1 - x)))
        told_s = float(str(caught.value).split()[-2])
        assert abs(told_s - time_s - fall_s) < 0.1 * fall_s  # the next node of a segment


def test_bad_input_is_named():
    r, v = (x[None] for x in STATES["arc"])
    for args, word in [
        ((r[0], v, [0.0], "j2", POLE), "position_m"),
        ((r * np.nan, v, [0.0], "j2", POLE), "position_m: must be finite"),
        ((r, v, [np.inf], "j2", POLE), "time_s"),
        ((r / 1e3, v, [0.0], "j2", POLE), "metres"),
        ((r, v, [0.0], "moon", POLE), "gravity"),
        ((r, 0 * v, [900.0], "j2", POLE), "falls"),
    ]:
        with pytest.raises(InputError, match=word):
            propagate(*args)


def two_orbits(time_s):
    r, v = (np.stack(x) for x in zip(STATES["walker-1598-km"], STATES["eccentric"], strict=True))
    return propagate(r, v, time_s, "two_body", POLE)


def chosen_step_s(state, duration_s, names, error_m=TRACK_ERROR_M):
    sampler = node_steps._Sampler(names, state, None, duration_s, error_m, np.array(sampling.ALWAYS_S))
    return sampler.choose(np.arange(len(names)), 3600.0, node_steps.SHORTEST_STEP_S)[0]


def test_tracks_stay_within_the_bound_and_know_their_error(record_accuracy):
    step_s = chosen_step_s(two_orbits, 1614.0, ["a", "b"], HERMITE_M)
    assert 5.0 < step_s < 30.0
    start_s, n_node = node_grid(1614.0, step_s)
    tracks = sample_tracks(["a", "b"], two_orbits, start_s, step_s, n_node)
    time_s = np.random.default_rng(0).uniform(-step_s, 1614.0 + step_s, 4000)
    position, velocity = two_orbits(time_s)
    for i, track in enumerate(tracks):
        got_r, got_v = track.state(time_s)
        worst = np.linalg.norm(got_r - position[:, i], axis=1).max()
        assert worst <= OFF_MIDDLE * track.error_m + 1e-8
        assert track.error_m < HERMITE_M
        record_accuracy("Orbit between its nodes", worst, HERMITE_M, "m", "the propagator")
        assert np.abs(got_v - velocity[:, i]).max() < 10.0 * HERMITE_M / step_s
    assert max(t.error_m for t in tracks) > 0.3 * HERMITE_M  # no finer than needed


def test_track_reproduces_a_cubic_exactly():
    time_s = -2.0 + 0.5 * np.arange(9)
    coefficients = np.array([[1.0, -2.0, 3.0], [0.5, 4.0, 1.0], [2.0, 0.1, -3.0], [0.3, -0.2, 0.7]])
    nodes = np.stack([time_s**k for k in range(4)], 1)
    rates = np.stack([k * time_s ** max(k - 1, 0) for k in range(4)], 1)
    track = Track("cubic", -2.0, 0.5, nodes @ coefficients, rates @ coefficients)
    t = np.array([[-2.0, -1.9], [0.0, 2.0]])
    position, velocity = track.state(t)
    np.testing.assert_allclose(position, sum(t[..., None] ** k * coefficients[k] for k in range(4)), atol=1e-13)
    np.testing.assert_allclose(
        velocity, sum(k * t[..., None] ** max(k - 1, 0) * coefficients[k] for k in range(1, 4)), atol=1e-13
    )
    assert np.array_equal(track.position_at_m(-2.0), track.position_m[0])


@pytest.mark.parametrize("bad", [-2.1, 2.0001, np.nan, [0.0, 3.0]])
def test_track_refuses_times_outside_its_span(bad):
    track = Track("sat11", -2.0, 0.5, np.ones((9, 3)), np.zeros((9, 3)))
    with pytest.raises(InputError, match=r"sat11: time_s: must be in the track's span \[-2, 2\] s, got"):
        track.state(bad)


def test_track_and_grid_check_their_arguments():
    with pytest.raises(InputError, match="node 1 must be finite"):
        Track("x", 0.0, 1.0, np.array([[0.0] * 3, [np.nan] * 3]), np.zeros((2, 3)))
    with pytest.raises(InputError, match="shape"):
        Track("x", 0.0, 1.0, np.zeros((1, 3)), np.zeros((1, 3)))
    with pytest.raises(InputError, match="step_s"):
        node_grid(10.0, 0.0)


@pytest.mark.parametrize(("duration_s", "step_s"), [(1614.0, 16.0), (1614.0, 0.1), (0.0, 5.0), (10.0, 10.0)])
def test_node_grid_covers_a_step_on_either_side(duration_s, step_s):
    start_s, n_node = node_grid(duration_s, step_s)
    n_before = round(-start_s / step_s)
    assert start_s == -n_before * step_s  # so that time 0 is a node
    assert max(step_s, 2.0) <= n_before * step_s + 1e-9 < max(step_s, 2.0) + step_s
    end_s = start_s + (n_node - 1) * step_s
    assert duration_s + step_s <= end_s + 1e-6 < duration_s + 2 * step_s + 1e-5


@pytest.mark.ci
def test_a_jump_of_velocity_shortens_the_step_until_it_hardly_shows():
    """A manoeuvre of 2 m/s at 700.3 s: the one interval that holds it is off by some tenth of step times jump."""

    def manoeuvre(time_s):
        r, v = (x[:, :1].copy() for x in two_orbits(time_s))
        after = np.maximum(time_s - 700.3, 0.0)
        r[:, 0, 2] += 2.0 * after
        v[:, 0, 2] += np.where(after > 0, 2.0, 0.0)
        return r, v

    (track,) = make_tracks(["ship"], manoeuvre, 1614.0)
    assert track.error_m < 0.01  # the best that steps of 10 ms give
    time_s = np.concatenate([np.linspace(0, 1614, 2001), np.linspace(700.0, 700.6, 2001)])
    missed = np.linalg.norm(track.position_at_m(time_s) - manoeuvre(time_s)[0][:, 0], axis=1)
    assert missed.max() < 1.2 * track.error_m + 1e-8
    away = np.abs(time_s - 700.3) > track.step_s
    assert missed[away].max() < HERMITE_M
    assert abs(track.error_at_s - 700.3) < track.step_s


def test_motion_of_few_digits_is_taken_with_its_error_told():
    """Positions rounded to 10 m, as in some tables: no step makes them smooth."""

    def rounded(time_s):
        r, v = (x[:, :1] for x in two_orbits(time_s))
        return np.round(r, -1), v

    with pytest.raises(InputError, match=r"ship: the motion must be smooth, but near \S+ s it is \S+ m off b"):
        make_tracks(["ship"], rounded, 300.0)

    def fine(time_s):
        r, v = (x[:, :1] for x in two_orbits(time_s))
        return np.round(r, 2), v

    (track,) = make_tracks(["ship"], fine, 300.0)
    assert HERMITE_M < track.error_m < 0.03 and track.step_s > 1.0


@pytest.mark.parametrize("n_node", [3, 4, 40])
def test_velocities_that_are_not_derivatives_are_replaced(n_node):
    """SGP4's are off by centimetres a second, which shows between nodes but not half-way."""

    def skewed(time_s):
        r, v = (x[:, :1] for x in two_orbits(time_s))
        return r, v + 0.02

    step_s = 10.0
    (track,) = sample_tracks(["sat"], skewed, -step_s, step_s, n_node)
    time_s = np.linspace(-step_s, (n_node - 2) * step_s, 1001)
    missed = np.linalg.norm(track.position_at_m(time_s) - skewed(time_s)[0][:, 0], axis=1)
    assert missed.max() < HERMITE_M


def test_steps_are_chosen_with_the_velocities_that_the_track_takes(monkeypatch):
    """Wrong by 2 cm/s, velocities are replaced; steps must be as long as those of right ones, in few trials."""
    n_asked = []

    def skewed(time_s):
        n_asked.append(len(time_s))
        r, v = (x[:, 1:] for x in two_orbits(time_s))
        return r, v + 0.02 * np.sin(1e-3 * time_s)[:, None, None]

    for duration_s in (400.0, 5000.0):  # all intervals are tried, or those at some places
        right_s = chosen_step_s(lambda t: tuple(x[:, 1:] for x in two_orbits(t)), duration_s, ["sat"])
        n_asked.clear()
        assert chosen_step_s(skewed, duration_s, ["sat"]) == pytest.approx(right_s, rel=0.1, abs=0)
        (track,) = make_tracks(["sat"], skewed, duration_s)
        assert 0.3 * HERMITE_M < track.error_m < HERMITE_M
        assert sum(n_asked) < 40 * duration_s / right_s + 10_000
        time_s = np.random.default_rng(2).uniform(0.0, duration_s, 3000)
        missed = np.linalg.norm(track.position_at_m(time_s) - two_orbits(time_s)[0][:, 1], axis=1)
        assert missed.max() < OFF_MIDDLE * track.error_m + 1e-8


def test_states_that_are_not_finite_are_refused():
    def holed(time_s):
        r, v = (x.copy() for x in two_orbits(time_s))
        r[(time_s > 690.0) & (time_s < 730.0), 1] = np.nan
        return r, v

    for make in (
        lambda: chosen_step_s(holed, 1614.0, ["a", "b"]),
        lambda: make_tracks(["a", "b"], holed, 1614.0),
        lambda: sample_tracks(["a", "b"], holed, -10.0, 10.0, 164),
    ):
        with pytest.raises(InputError, match=r"^b: the state must be finite, but is not at (69|70|71|72)\d"):
            make()
    with pytest.raises(InputError, match=r"^object 1: the state must be finite"):
        sample_tracks(["a"], holed, -10.0, 10.0, 164)


def test_trials_stay_within_the_scene():
    """Where a propagator has no more to tell, as behind a re-entry, only the room of the grid is asked for."""
    asked_s = []

    def noted(time_s):
        asked_s.append(time_s)
        return two_orbits(time_s)

    for duration_s in (3.0, 100.0, 1614.0, 20000.0):
        asked_s.clear()
        step_s = chosen_step_s(noted, duration_s, ["a", "b"])
        assert step_s <= duration_s
        assert duration_s / step_s == pytest.approx(round(duration_s / step_s), rel=1e-12, abs=0)
        times = np.concatenate(asked_s)
        assert times.min() >= 0.0
        assert times.max() <= duration_s * (1 + 1e-15)


def test_tracks_made_in_pieces_are_the_same(monkeypatch):
    whole = sample_tracks(["a", "b"], two_orbits, -10.0, 10.0, 40)
    for n_pair in (1, 7, 60, 158, 1000):
        monkeypatch.setattr(sampling, "PAIRS_PER_PIECE", n_pair)
        pieces = sample_tracks(["a", "b"], two_orbits, -10.0, 10.0, 40)
        for one, other in zip(whole, pieces, strict=True):
            assert np.abs(one.position_m - other.position_m).max() < 1e-7
            assert np.abs(one.velocity_m_s - other.velocity_m_s).max() < 1e-10
            assert one.error_m == pytest.approx(other.error_m, abs=1e-7, rel=0)


def test_scenes_too_long_for_the_memory_are_told_so(monkeypatch):
    """Smooth motion, but nodes 133 s apart at best."""
    monkeypatch.setattr(node_steps, "MOST_NODES", 300)
    with pytest.raises(InputError, match=r"^duration_s: 20000 s are too long for 2 .* 133 s apart, b is \S+ m off"):
        make_tracks(["a", "b"], two_orbits, 20000.0)


def test_single_velocities_that_are_wrong_count_in_the_error():
    def skewed(time_s):
        r, v = (x[:, :1].copy() for x in two_orbits(time_s))
        v[np.abs(time_s - 100.0) < 1.0] += 0.02
        return r, v

    (track,) = sample_tracks(["sat"], skewed, -10.0, 10.0, 40)
    time_s = np.linspace(0, 300, 3001)
    missed = np.linalg.norm(track.position_at_m(time_s) - skewed(time_s)[0][:, 0], axis=1)
    assert 0.01 < missed.max() <= OFF_MIDDLE * track.error_m
