"""Lambert's problem and ballistic arcs against DOP853, Lambert's theorem in mpmath, and the paper's figures."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from astropy import units as u
from astropy.time import Time
from scipy.integrate import solve_ivp
from skyfield.api import load, wgs84

from warpsim.errors import InputError
from warpsim.instant import instant
from warpsim.orbit.arc import BallisticArc
from warpsim.orbit.two_body import lambert

MU, RADIUS, J2 = 3.986004418e14, 6378137.0, 1.0826266835e-3
START, END = (129.67, 40.86), (-118.40, 34.10)

END_POINT_M = 1e-3  # the arc's promise
FLIGHT_M = 1e-3
"""What tracks may err between their nodes; 1 m over the flight is asked for. It covers DOP853's rounding with forces by
differences, which another kernel of BLAS moves from 3e-6 to 2e-5 m."""
LAMBERT_M = 1e-4  # DOP853's own error at rtol 3e-14
NEAR_180_M = 1.0  # start velocity's rounding times the sensitivity of the end point near 180 degrees


def paper_arc(**changes):
    return BallisticArc(**{"start_lon_lat_deg": START, "end_lon_lat_deg": END, "duration_s": 1614.0,
                           "endpoint_altitude_km": 121.92, **changes})  # fmt: skip


def fly(r, v, time_s, force):
    run = solve_ivp(force, (0.0, time_s[-1]), np.concatenate([r, v]), "DOP853", t_eval=time_s, rtol=3e-14, atol=1e-9)
    return run.y[:3].T, run.y[3:].T


def two_body(t, y):
    return np.concatenate([y[3:], -MU * y[:3] / np.linalg.norm(y[:3]) ** 3])


def j2_about(pole):
    def potential(r):
        d = np.linalg.norm(r)
        return MU / d * (1 - J2 * (RADIUS / d) ** 2 * (1.5 * (r @ pole / d) ** 2 - 0.5))

    def force(t, y):
        # Gradient of the potential by complex-free high-order differences: an oracle without the closed formula.
        a, h = np.empty(3), 2e3
        for i in range(3):
            e = np.zeros(3)
            e[i] = h
            a[i] = (
                45 * (potential(y[:3] + e) - potential(y[:3] - e))
                - 9 * (potential(y[:3] + 2 * e) - potential(y[:3] - 2 * e))
                + (potential(y[:3] + 3 * e) - potential(y[:3] - 3 * e))
            ) / (60 * h)
        return np.concatenate([y[3:], a])

    return force


@pytest.mark.parametrize("angle_deg", [0.5, 60.0, 90.0, 150.0, 179.9])
@pytest.mark.parametrize("duration_s", [900.0, 3000.0, 20000.0])
def test_lambert_arrives(angle_deg, duration_s):
    turn = np.radians(angle_deg)
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    r1 = np.array([2.0, -2.0, 1.0]) / 3.0
    r2 = 8.2e6 * (np.cos(turn) * r1 + np.sin(turn) * np.cross(axis, r1))
    r1 = 7.0e6 * r1
    v1, v2 = lambert(r1, r2, duration_s)
    momentum = np.cross(r1, v1)
    assert momentum @ axis > 0.0
    np.testing.assert_allclose(np.cross(r2, v2), momentum, rtol=1e-10, atol=1e-10 * np.linalg.norm(momentum))
    assert v2 @ v2 / 2 - MU / 8.2e6 == pytest.approx(v1 @ v1 / 2 - MU / 7.0e6, abs=1e-9 * MU / 7e6)
    low = r1 @ v1 < 0 or np.linalg.norm(momentum) < 1e10
    if low:  # the conic dips deep: DOP853 cannot judge, and energy and momentum above already have
        return
    end, velocity = (x[-1] for x in fly(r1, v1, [0.0, duration_s], two_body))
    tolerance_m = NEAR_180_M if angle_deg > 179 else LAMBERT_M * max(1.0, duration_s / 2000.0) ** 2
    assert np.linalg.norm(end - r2) < tolerance_m
    assert np.linalg.norm(velocity - v2) < 1e-2 * tolerance_m


@pytest.mark.parametrize("angle_deg", [30.0, 90.0, 179.9, 179.9999])
def test_lambert_recovers_a_circular_orbit(angle_deg):
    """e = 0: the transfer along a circle has the circular velocity at both ends."""
    radius, turn = 7.5e6, np.radians(angle_deg)
    r2 = radius * np.array([np.cos(turn), np.sin(turn), 0.0])
    v1, v2 = lambert([radius, 0.0, 0.0], r2, turn * np.sqrt(radius**3 / MU))
    speed = np.sqrt(MU / radius)
    # Rounding of the half-angle's sine near 180 degrees, 1e-16 / 1e-6 of 7 km/s.
    np.testing.assert_allclose(v1, [0.0, speed, 0.0], atol=1e-5)
    np.testing.assert_allclose(v2, speed * np.array([-np.sin(turn), np.cos(turn), 0.0]), atol=1e-5)


def test_lambert_satisfies_lamberts_theorem():
    """Time of flight from the semi-major axis alone (Lagrange's form), in 30 digits."""
    r1, r2, duration_s = np.array([6.5e6, 0.0, 0.0]), np.array([0.4e6, 6.5e6, 0.0]), 1614.0
    v1, _ = lambert(r1, r2, duration_s)
    with mpmath.workdps(30):
        d1, d2, c = (mpmath.mpf(float(np.linalg.norm(x))) for x in (r1, r2, r2 - r1))
        a = 1 / (2 / d1 - mpmath.mpf(float(v1 @ v1)) / MU)
        s = (d1 + d2 + c) / 2
        alpha, beta = 2 * mpmath.asin(mpmath.sqrt(s / (2 * a))), 2 * mpmath.asin(mpmath.sqrt((s - c) / (2 * a)))
        rate, rest = mpmath.sqrt(MU / a**3), beta - mpmath.sin(beta)
        times = [(x - mpmath.sin(x) - rest) / rate for x in (alpha, 2 * mpmath.pi - alpha)]
    assert min(abs(float(t) - duration_s) for t in times) < 1e-8


@pytest.mark.parametrize(
    ("r2", "duration_s", "word"),
    [
        ([-9e6, 0, 0], 3000.0, "180 degrees"), ([9e6, 0, 0], 3000.0, "0 or 180"), ([0, 7e6, 0], 0.0, "duration_s"),
        ([0, 7e6, 0], np.nan, "duration_s"), ([0, np.nan, 0], 1.0, "finite"), ([0, 0, 0], 1.0, "apart"),
        ([0, 7e6, 0], 1e-260, "duration_s: is too short for a conic, got 1e-260"),
        ([2e6, 9e6, 1e6], 1e-30, "too short"), ([7e6, 1.0, 0], 1e-200, "too short"),
    ],
)  # fmt: skip
def test_lambert_names_what_is_degenerate(r2, duration_s, word):
    with pytest.raises(InputError, match=word):
        lambert([7e6, 0.0, 0.0], r2, duration_s)


@pytest.mark.parametrize("gravity", ["two_body", "j2"])
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"duration_s": 1e-30}, "^no arc between the end points in 1e-30 s: duration_s: is too short for a conic"),
        ({"duration_s": 1e-3}, r"^duration_s: 0.001 s gives a flight \d+ km below the ground$"),
        ({"duration_s": 1.0, "endpoint_altitude_km": 3000.0}, "^duration_s: 1 s gives a start speed of 1.24e.07 m/s"),
        ({"duration_s": 1e-3, "end_lon_lat_deg": (129.68, 40.87)}, "speed of 1.42e.06 m/s, must be at most 1e.06 m/s$"),
    ],
)
def test_arcs_that_no_body_flies_are_refused_before_they_are_integrated(gravity, changes, words, monkeypatch):
    monkeypatch.setattr(BallisticArc, "_shoot", None)
    with pytest.raises(InputError, match=words):
        paper_arc(gravity=gravity, **changes).start_velocity_m_s  # noqa: B018


def test_flights_longer_than_a_scene_are_refused():
    """They would be integrated for hours."""
    assert paper_arc(duration_s=31 * 86400.0).duration_s == 31 * 86400.0
    for duration_s in (31 * 86400.0 + 1.0, 6e11):
        with pytest.raises(InputError, match=r"duration_s: must be at most 2678400 \(31 days\)"):
            paper_arc(duration_s=duration_s)


def test_paper_flight_in_two_body_gravity():
    arc = paper_arc(gravity="two_body")
    assert arc.apogee_altitude_km == pytest.approx(825.37, abs=0.005)  # printed digits of the check figure
    assert arc.range_angle_deg == pytest.approx(86.46, abs=0.005)
    assert arc.start_speed_m_s == pytest.approx(7181.0, abs=0.5)


@pytest.mark.parametrize("gravity", ["two_body", "j2", "j4"])
@pytest.mark.parametrize("epoch", ["2000-01-01T12:00:00", "2025-03-20T12:00:00"])
def test_arc_passes_through_both_end_points(gravity, epoch, record_accuracy):
    arc = paper_arc(gravity=gravity, epoch_utc=epoch)
    ts = load.timescale(builtin=True)
    year, month, day = (int(x) for x in epoch[:10].split("-"))
    for (lon, lat), t_s in ((START, 0.0), (END, 1614.0)):
        place = wgs84.latlon(lat, lon, 121920.0).at(ts.utc(year, month, day, 12, 0, t_s)).position.m
        error_m = np.linalg.norm(arc.position_m(t_s) - place)
        assert error_m < END_POINT_M
        record_accuracy("End points of a ballistic arc", error_m, END_POINT_M, "m", "skyfield")


@pytest.mark.parametrize("gravity", ["two_body", "j2"])
def test_arc_flies_freely(gravity):
    arc = paper_arc(gravity=gravity, epoch_utc="2025-03-20T12:00:00")
    time_s = np.array([0.0, 500.0, 1614.0])
    position, velocity = arc.state(time_s)
    force = two_body if gravity == "two_body" else j2_about(arc.pole_icrs)
    expected_r, expected_v = fly(position[0], velocity[0], time_s, force)
    assert np.abs(position - expected_r).max() < FLIGHT_M
    assert np.abs(velocity - expected_v).max() < 1e-2 * FLIGHT_M
    samples = np.linalg.norm(arc.position_m(np.linspace(700.0, 900.0, 2001)), axis=1).max()
    assert arc.apogee_altitude_km == pytest.approx((samples - RADIUS) / 1e3, abs=1e-5)  # 0.1 s sampling of the top


def test_arc_about_the_pole_of_date_is_not_about_icrs_z():
    arc = paper_arc(epoch_utc="2025-03-20T12:00:00")
    start, velocity = (x[0] for x in arc.state(np.zeros(1)))
    about_z = fly(start, velocity, [0.0, 1614.0], j2_about(np.array([0.0, 0.0, 1.0])))[0][-1]
    # 0.14 degrees of the pole times J2's 0.02 m/s2 over the flight.
    assert 10.0 < np.linalg.norm(about_z - arc.position_m(1614.0)) < 200.0


def test_states_take_any_shape_and_order_and_go_on_outside_the_flight():
    arc = paper_arc()
    time_s = np.array([[1620.0, 5.0], [-20.0, 800.0]])
    position, velocity = arc.state(time_s)
    assert position.shape == velocity.shape == (2, 2, 3)
    for index in np.ndindex(2, 2):
        assert np.linalg.norm(arc.position_m(time_s[index]) - position[index]) < END_POINT_M
    assert arc.position_m(0.0).shape == (3,)


def test_arc_without_a_top_inside_reports_the_higher_end():
    steep = BallisticArc((0, 0), (0, 1), 12.0, 100.0, gravity="two_body")  # 9 km/s, nearly straight: no top inside
    ends_km = [(np.linalg.norm(p) - RADIUS) / 1e3 for p in steep.end_points_m]
    assert steep.apogee_altitude_km == pytest.approx(max(ends_km), abs=1e-6)


def test_an_arc_flies_from_the_epoch_asked_for():
    other = instant("2025-03-20T12:00:00")
    arc, stated = paper_arc(), paper_arc(epoch_utc="2025-03-20T12:00:00")
    assert arc.epoch_utc is None and arc.flight().epoch == instant("2000-01-01T12:00:00")
    time_s = np.array([0.0, 700.0])
    for epoch in (other, Time("2025-03-20T12:00:00", scale="utc")):
        for mine, theirs in zip(arc.states(epoch, time_s), stated.state(time_s), strict=True):
            assert np.array_equal(mine[:, 0], theirs)
    assert not np.array_equal(arc.state(time_s)[0], stated.state(time_s)[0])
    assert paper_arc(epoch_utc="2000-01-01T12:00:00").apogee_altitude_km == arc.apogee_altitude_km
    with pytest.raises(InputError, match=r"^epoch_utc: must be left out, or .* \(2025-06-01T00:00.*got '2025"):
        stated.states(instant("2025-06-01"), time_s)


def test_a_flight_is_solved_once_for_an_epoch():
    arc = paper_arc(epoch_utc="2025-03-20T12:00:00")
    flight = arc.flight()
    assert flight is arc.flight(instant("2025-03-20T12:00")) is paper_arc().flight(instant("2025-03-20T12:00:00"))
    assert np.array_equal(flight.start_velocity_m_s, arc.start_velocity_m_s)
    assert np.array_equal(flight.end_points_m, arc.end_points_m)
    assert (flight.start_speed_m_s, flight.range_angle_deg, flight.apogee_altitude_km) == (
        arc.start_speed_m_s, arc.range_angle_deg, arc.apogee_altitude_km
    )  # fmt: skip
    with pytest.raises(ValueError, match="read-only"):
        flight.start_velocity_m_s[0] = 0.0


def test_inputs_may_be_lists_quantities_and_times():
    plain = paper_arc(epoch_utc="2025-03-20T12:00:00")
    rich = BallisticArc(
        list(START) * u.deg, list(np.radians(END) * u.rad), 26.9 * u.min, 121920 * u.m,
        epoch_utc=Time("2025-03-20T12:00:00", scale="utc"),
    )  # fmt: skip
    assert rich.duration_s == pytest.approx(1614.0)
    assert rich.end_lon_lat_deg == pytest.approx(END)
    assert np.linalg.norm(rich.position_m(100.0) - plain.position_m(100.0)) < END_POINT_M
    assert plain == paper_arc(epoch_utc="2025-03-20T12:00:00") and plain != paper_arc()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"start_lon_lat_deg": (1, 91)}, r"start_lon_lat_deg\[1\]: must be in \[-90, 90\], got 91"),
        ({"end_lon_lat_deg": (float("nan"), 1)}, r"end_lon_lat_deg\[0\]: must be finite"),
        ({"start_lon_lat_deg": (1, 2, 3)}, "start_lon_lat_deg"),
        ({"start_lon_lat_deg": 5}, "start_lon_lat_deg"),
        ({"duration_s": 0}, "duration_s: must be > 0, got 0"),
        ({"duration_s": -5.0}, "duration_s: must be > 0"),
        ({"end_lon_lat_deg": (START[0] - 360, START[1])}, "end_lon_lat_deg: must differ from start_lon_lat_deg"),
        ({"gravity": "moon"}, "gravity: must be 'two_body', 'j2' or 'j4', got 'moon'"),
        ({"epoch_utc": "noon"}, "epoch_utc: must be an ISO 8601 UTC instant"),
        ({"endpoint_altitude_km": 5 * u.s}, "endpoint_altitude_km: must be convertible to km"),
        ({"apogee_km": 5}, "apogee_km: is not a known field"),
    ],
)
def test_errors_are_one_clear_line(changes, message):
    with pytest.raises(InputError, match=message) as caught:
        paper_arc(**changes)
    assert "\n" not in str(caught.value)


def test_impossible_arc_says_so():
    # A quarter of the way round in one second is a straight line through the Earth.
    with pytest.raises(InputError, match=r"^duration_s: 1 s gives a flight .* below the ground"):
        _ = BallisticArc((0, 0), (90, 0), 1.0, 100.0).start_velocity_m_s
    with pytest.raises(InputError, match=r"^no arc between the end points .* 180 degrees"):
        # Pole to pole, the Earth's turn changes nothing.
        _ = BallisticArc((0, 90), (0, -90), 3000.0, 100.0).start_velocity_m_s
