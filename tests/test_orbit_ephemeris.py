"""Motion along files of states against the orbits that the files were made from, and interpolation in tables."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from astropy.time import TimeDelta
from exchange_samples import CSV, EPHEMERIDES, damaged
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BarycentricInterpolator, KroghInterpolator

import warpsim as ws
from warpsim.constants import EARTH_GM_M3_S2
from warpsim.errors import InputError
from warpsim.instant import utc_time
from warpsim.orbit.earth import frame_to_gcrs, pole_of_date
from warpsim.orbit.ephemeris import EphemerisOrbit, EphemerisSatellites
from warpsim.orbit.gravity import propagate
from warpsim.orbit.track import interpolate, window_size
from warpsim.orbit.two_body import propagate_two_body

EPOCH = utc_time("2025-03-20T12:00:00")
POLE = pole_of_date(EPOCH)
ON_FILE_M, ON_FILE_M_S = 1e-5, 1e-6  # measured 9e-7 m, 3e-7 m/s: Hermite of degree 7 in steps of 60 s
TURNING_M, TURNING_M_S = 1e-4, 1e-5  # measured 2e-5 m, 3e-6 m/s: in axes that turn with the Earth paths curve more
BEYOND_M = 1e-4
NODES_S = np.arange(0.0, 3601.0, 60.0)


def flight(time_s, phase=0.0, altitude_m=600e3):
    """A J2 orbit in GCRS axes, (n, 3) each."""
    radius_m = 6_378_137.0 + altitude_m
    speed_m_s = np.sqrt(EARTH_GM_M3_S2 / radius_m)
    start = radius_m * np.array([[np.cos(phase), np.sin(phase), 0.0]])
    velocity = speed_m_s * np.array([[-0.6 * np.sin(phase), 0.6 * np.cos(phase), 0.8]])
    r, v = propagate(start, velocity, np.asarray(time_s, float), "j2", POLE)
    return r[:, 0], v[:, 0]


def in_frame(frame, time_s, r, v):
    """States of GCRS axes as another frame has them."""
    step_s = 0.1 if frame == "ITRF" else 10.0
    before, now, after = (frame_to_gcrs(frame, EPOCH, time_s + dt).swapaxes(1, 2) for dt in (-step_s, 0.0, step_s))
    rate = (after - before) / (2.0 * step_s)
    return np.einsum("tij,tj->ti", now, r), np.einsum("tij,tj->ti", now, v) + np.einsum("tij,tj->ti", rate, r)


def segment(time_s=NODES_S, name="sat", frame="GCRF", object_id="1", phase=0.0, **more):
    states = in_frame(frame, time_s, *flight(time_s, phase))
    return ws.EphemerisSegment.of_states(name, EPOCH, time_s, *states, frame=frame, object_id=object_id, **more)


@pytest.fixture
def oem(tmp_path):
    """Write segments, and return the path."""

    def do(*segments, name="x.oem"):
        ws.write_oem(tmp_path / name, segments, overwrite=True)
        return str(tmp_path / name)

    return do


def errors(motion, time_s, expected):
    r, v = motion.states(EPOCH, time_s)
    assert r.shape == v.shape == (len(time_s), len(motion.names), 3)
    return np.linalg.norm(r[:, 0] - expected[0], axis=1).max(), np.linalg.norm(v[:, 0] - expected[1], axis=1).max()


@pytest.mark.parametrize("frame", ["GCRF", "EME2000", "TEME", "TOD", "MOD", "ITRF"])
def test_orbit_of_any_frame(oem, frame):
    orbit = EphemerisOrbit(oem(segment(frame=frame)))
    assert orbit.names == ["sat"]
    assert orbit.span_s(EPOCH) == pytest.approx((0.0, 3600.0), abs=1e-9, rel=0)
    time_s = np.linspace(0.0, 3600.0, 777)
    error_m, error_m_s = errors(orbit, time_s, flight(time_s))
    assert error_m < (TURNING_M if frame == "ITRF" else ON_FILE_M)
    assert error_m_s < (TURNING_M_S if frame == "ITRF" else ON_FILE_M_S)


def test_another_epoch_is_another_clock(oem):
    orbit = EphemerisOrbit(oem(segment()))
    later = EPOCH + TimeDelta(600.0, format="sec")
    assert orbit.span_s(later) == pytest.approx((-600.0, 3000.0), abs=1e-9, rel=0)
    r, _ = orbit.states(later, np.array([100.0]))
    assert np.linalg.norm(r[0, 0] - flight([700.0])[0][0]) < ON_FILE_M


def test_stk_and_oem_are_the_same_motion(oem, tmp_path):
    ws.write_stk_ephemeris(tmp_path / "sat.e", segment(frame="ITRF"))
    time_s = np.linspace(0.0, 3600.0, 100)
    one = EphemerisOrbit(oem(segment(frame="ITRF"))).states(EPOCH, time_s)
    two = EphemerisOrbit(tmp_path / "sat.e").states(EPOCH, time_s)
    assert np.abs(one[0] - two[0]).max() < 1e-8
    assert np.abs(one[1] - two[1]).max() < 1e-9


def test_without_velocities(tmp_path):
    r, _ = flight(NODES_S)
    table = np.column_stack([NODES_S, r])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="time_s,x_m,y_m,z_m", comments="", fmt="%.9f")
    orbit = EphemerisOrbit(str(tmp_path / "a.csv"))
    time_s = np.linspace(600.0, 3000.0, 300)
    error_m, error_m_s = errors(orbit, time_s, flight(time_s))
    assert error_m < 2e-5  # Lagrange of degree 7, measured 5e-6
    assert error_m_s < 1e-6
    later = EPOCH + TimeDelta(1e5, format="sec")
    assert orbit.span_s(later) == (0.0, 3600.0)  # counts from the scene's epoch, whatever that is


def test_free_flight_beyond_the_ends(oem):
    for frame in ("GCRF", "ITRF"):
        orbit = EphemerisOrbit(oem(segment(frame=frame)))
        time_s = np.array([-60.0, -1.0, 0.0, 3600.0, 3601.0, 3660.0])
        error_m, error_m_s = errors(orbit, time_s, flight(time_s))
        assert error_m < (BEYOND_M if frame == "GCRF" else 1e-3)  # 60 s of the velocity's error at the end, 3e-6 m/s
        assert error_m_s < TURNING_M_S


@pytest.mark.parametrize("time_s", [-60.1, 3660.1, np.nan])
def test_a_time_far_outside_is_an_error(oem, time_s):
    orbit = EphemerisOrbit(oem(segment()))
    with pytest.raises(ws.InputError, match=r"x.oem: sat: time .* must be in the file's span, 0 s \(2025-03-20T12:00"):
        orbit.states(EPOCH, np.array([0.0, time_s]))


def test_useable_span_is_the_span(oem, tmp_path):
    path = oem(segment())
    stop = "STOP_TIME = 2025-03-20T13:00:00.000000000\n"
    text = (tmp_path / "x.oem").read_text()
    useable = "USEABLE_START_TIME = 2025-03-20T12:05:00\nUSEABLE_STOP_TIME = 2025-03-20T12:55:00\n"
    (tmp_path / "x.oem").write_text(text.replace(stop, useable + stop))
    orbit = EphemerisOrbit(path)
    assert orbit.span_s(EPOCH) == pytest.approx((300.0, 3300.0), abs=1e-9, rel=0)
    error_m, _ = errors(orbit, np.array([300.0, 305.0, 3299.0]), flight([300.0, 305.0, 3299.0]))
    assert error_m < 1e-6  # inside the table: no end effects
    with pytest.raises(ws.InputError, match="must be in the file's span, 300 s"):
        orbit.states(EPOCH, np.array([200.0]))


def test_maneuver_at_a_shared_end(oem):
    """Each side is interpolated on its own; at the instant itself the later one counts."""
    before, after = segment(NODES_S[:31]), segment(NODES_S[30:], phase=1.0)
    orbit = EphemerisOrbit(oem(after, before))  # in any order
    assert orbit.breaks_s(EPOCH) == pytest.approx([1800.0], abs=1e-9, rel=0)
    time_s = np.array([1790.0, 1799.999, 1800.0, 1810.0])
    r, _ = orbit.states(EPOCH, time_s)
    expected = np.concatenate([flight(time_s[:2])[0], flight(time_s[2:], phase=1.0)[0]])
    assert np.linalg.norm(r[:, 0] - expected, axis=1).max() < ON_FILE_M


def test_gap_and_overlap(oem):
    orbit = EphemerisOrbit(oem(segment(NODES_S[:20]), segment(NODES_S[30:])))
    orbit.states(EPOCH, np.array([NODES_S[19], NODES_S[30]]))
    message = (
        r"x.oem: sat: time 1500 s \(2025-03-20T12:25:00.000\) must not be in a gap between segments, 1140 s .*1800"
    )
    with pytest.raises(ws.InputError, match=message):
        orbit.states(EPOCH, np.array([0.0, 1500.0]))
    with pytest.raises(ws.InputError, match="sat: segments must not overlap, this one begins 60 s before the one"):
        EphemerisOrbit(oem(segment(NODES_S[:20]), segment(NODES_S[18:]))).names  # noqa: B018


def test_satellites_of_several_files(oem, tmp_path):
    one = oem(segment(name="SAT A"), segment(name="SAT/B", object_id="2", phase=0.5, frame="ITRF"), name="one.oem")
    two = oem(segment(name="SAT A", object_id="3", phase=1.0, frame="TEME"), name="two.oem")
    satellites = EphemerisSatellites([one, two])
    assert satellites.names == ["SAT_A", "SAT_B", "SAT_A_2"]
    assert satellites.span_s(EPOCH) == pytest.approx((0.0, 3600.0), abs=1e-9, rel=0)
    time_s = np.linspace(0.0, 3600.0, 97)
    r, v = satellites.states(EPOCH, time_s)
    assert r.shape == (97, 3, 3)
    for column, phase in enumerate((0.0, 0.5, 1.0)):
        expected = flight(time_s, phase)
        assert np.linalg.norm(r[:, column] - expected[0], axis=1).max() < TURNING_M
        assert np.linalg.norm(v[:, column] - expected[1], axis=1).max() < TURNING_M_S
    data = (tmp_path / "one.oem").read_bytes() + (tmp_path / "two.oem").read_bytes()
    assert satellites.checksum == hashlib.sha256(data).hexdigest()
    assert EphemerisOrbit(one).checksum == hashlib.sha256((tmp_path / "one.oem").read_bytes()).hexdigest()


def test_an_object_that_continues_in_another_file(oem):
    parts = oem(segment(NODES_S[:31]), name="a.oem"), oem(segment(NODES_S[30:]), name="b.oem")
    satellites = EphemerisSatellites(parts)
    assert satellites.names == ["sat"]
    assert satellites.breaks_s(EPOCH) == pytest.approx([1800.0], abs=1e-9, rel=0)
    time_s = np.linspace(0.0, 3600.0, 97)
    assert errors(satellites, time_s, flight(time_s))[0] < ON_FILE_M


def test_one_object_of_several(oem, tmp_path):
    path = oem(segment(), segment(name="b c", object_id="2", phase=1.0))
    with pytest.raises(ws.InputError, match=r"x.oem: object: must be given, the file holds sat, b_c"):
        EphemerisOrbit(path).states(EPOCH, np.zeros(1))
    for name in ("b c", "b_c", "2"):
        orbit = EphemerisOrbit(path, object=name)
        assert orbit.names == ["b_c"]
        assert np.linalg.norm(orbit.states(EPOCH, np.zeros(1))[0][0, 0] - flight([0.0], 1.0)[0][0]) < ON_FILE_M
    (tmp_path / "x.csv").write_text(CSV)
    assert EphemerisSatellites(tmp_path / "x.csv").names == ["one", "two"]


def test_frame_override(oem):
    path = oem(segment(frame="ITRF"))
    r, _ = EphemerisOrbit(path, frame="GCRF").states(EPOCH, NODES_S[:1])
    assert np.linalg.norm(r[0, 0] - in_frame("ITRF", NODES_S[:1], *flight(NODES_S[:1]))[0][0]) < ON_FILE_M
    with pytest.raises(ws.InputError, match=r"EphemerisOrbit: frame: must be 'GCRF', 'EME2000'"):
        EphemerisOrbit(path, frame="RTN")


def test_one_state_only(oem, tmp_path):
    """A minute of free flight to either side."""
    orbit = EphemerisOrbit(oem(segment(np.array([100.0]))))
    time_s = np.array([40.0, 100.0, 160.0])
    assert errors(orbit, time_s, flight(time_s))[0] < BEYOND_M
    (tmp_path / "p.csv").write_text("time_s,x_m,y_m,z_m\n0,7e6,0,0\n")
    with pytest.raises(ws.InputError, match="p: must have two positions or more in a segment without velocities"):
        EphemerisOrbit(str(tmp_path / "p.csv")).names  # noqa: B018


def test_wrong_descriptions(tmp_path):
    with pytest.raises(ws.InputError, match="EphemerisSatellites: files: must name at least one file"):
        EphemerisSatellites(())
    with pytest.raises(ws.InputError, match="EphemerisSatellites: files: must not repeat"):
        EphemerisSatellites(("a", "a"))
    with pytest.raises(ws.InputError, match=r"no.oem: cannot be read: No such file"):
        EphemerisOrbit(str(tmp_path / "no.oem")).span_s(EPOCH)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", EPHEMERIDES)
def test_damaged_files_move_or_are_refused_in_one_line(tmp_path, name):
    n_refused = 0
    for seed in range(60):
        (tmp_path / name).write_bytes(damaged(EPHEMERIDES[name], 10_000 + seed))
        satellites = EphemerisSatellites([tmp_path / name])
        try:
            first_s, last_s = satellites.span_s(EPOCH)
            r, v = satellites.states(EPOCH, np.linspace(first_s - 10.0, last_s, 5))
        except ws.InputError as error:
            assert "\n" not in str(error)  # noqa: PT017
            n_refused += 1
            continue
        assert np.isfinite(r).all()
        assert np.isfinite(v).all()
    assert 10 < n_refused < 60


def test_no_times(oem):
    r, v = EphemerisOrbit(oem(segment(frame="ITRF"))).states(EPOCH, np.array([]))
    assert r.shape == v.shape == (0, 1, 3)


EXACT_M = 5e-8  # rounding of 7e6 m through ten nodes, in both codes; measured 1e-8
EXACT_M_S = 2e-8  # the same over the steps; measured 3e-9

RADIUS_M = 6_878_137.0
SPEED_M_S = np.sqrt(EARTH_GM_M3_S2 / RADIUS_M)


def orbit(time_s):
    """A circular orbit at 500 km."""
    r, v = propagate_two_body(
        np.array([[RADIUS_M, 0.0, 0.0]]), SPEED_M_S * np.array([[0.0, 0.6, 0.8]]), np.asarray(time_s, float)
    )
    return r[:, 0], v[:, 0]


UNEVEN_S = np.cumsum(np.random.default_rng(7).uniform(20.0, 60.0, 40))
"""Uneven steps."""


def windows(nodes, size, times):
    """First node of the window of each time, by the rule in words: around the interval, inside the table."""
    starts = []
    for t in times:
        interval = max(0, min(sum(nodes <= t) - 1, len(nodes) - 2))
        starts.append(max(0, min(interval - (size - 1) // 2, len(nodes) - size)))
    return starts


@pytest.mark.parametrize("degree", [1, 2, 3, 5, 8, 9])
def test_lagrange_against_scipy(degree):
    position, _ = orbit(UNEVEN_S)
    times = np.linspace(UNEVEN_S[0] - 5.0, UNEVEN_S[-1] + 5.0, 301)
    value, rate = interpolate(UNEVEN_S, position, None, "lagrange", degree, times)
    for t, start, r, v in zip(times, windows(UNEVEN_S, degree + 1, times), value, rate, strict=True):
        rows = slice(start, start + degree + 1)
        middle = UNEVEN_S[rows].mean()
        expected = BarycentricInterpolator(UNEVEN_S[rows] - middle, position[rows] - position[start])
        assert np.abs(position[start] + expected(t - middle) - r).max() < EXACT_M
        assert np.abs(expected.derivative(t - middle) - v).max() < EXACT_M_S


@pytest.mark.parametrize("degree", [1, 3, 5, 7, 9])
def test_hermite_against_scipy(degree):
    position, velocity = orbit(UNEVEN_S)
    size = (degree + 1) // 2
    times = np.linspace(UNEVEN_S[0] - 5.0, UNEVEN_S[-1] + 5.0, 301)
    value, rate = interpolate(UNEVEN_S, position, velocity, "hermite", degree, times)
    for t, start, r, v in zip(times, windows(UNEVEN_S, size, times), value, rate, strict=True):
        rows = np.repeat(np.arange(start, start + size), 2)
        data = position[rows] - position[start]
        data[1::2] = velocity[rows[1::2]]
        middle = UNEVEN_S[start]
        expected = KroghInterpolator(UNEVEN_S[rows] - middle, data)
        assert np.abs(position[start] + expected(t - middle) - r).max() < EXACT_M
        assert np.abs(expected.derivative(t - middle) - v).max() < EXACT_M_S


@pytest.mark.parametrize(
    ("method", "degree", "inside_m", "ends_m", "ends_m_s"),
    [
        ("hermite", 3, 0.5, 0.5, 0.03),
        ("hermite", 7, 1e-7, 2e-6, 2e-7),  # measured 2e-8, 8e-7, 6e-8
        ("lagrange", 5, 6e-3, 0.03, 4e-3),
        ("lagrange", 7, 1e-5, 1.5e-4, 2e-5),
        ("lagrange", 9, 1e-7, 2e-6, 3e-7),
    ],
)
def test_error_on_a_true_orbit(method, degree, inside_m, ends_m, ends_m_s):
    """Steps of 60 s: what the documentation says."""
    nodes = np.arange(0.0, 7201.0, 60.0)
    times = np.linspace(0.0, 7200.0, 3001)
    r, v = interpolate(nodes, *orbit(nodes), method, degree, times)
    true_r, true_v = orbit(times)
    error_m, error_m_s = (np.linalg.norm(x, axis=1) for x in (r - true_r, v - true_v))
    inside = (times > 600.0) & (times < 6600.0)
    assert error_m[inside].max() < inside_m
    assert error_m.max() < ends_m
    assert error_m_s.max() < ends_m_s


@pytest.mark.parametrize(("method", "degree"), [("linear", 1), ("lagrange", 4), ("lagrange", 7), ("hermite", 7)])
def test_the_motion_passes_through_its_nodes_and_has_no_jumps(method, degree):
    position, velocity = orbit(UNEVEN_S)
    value, _ = interpolate(UNEVEN_S, position, velocity, method, degree, UNEVEN_S)
    assert np.abs(value - position).max() < EXACT_M
    before, _ = interpolate(UNEVEN_S, position, velocity, method, degree, np.nextafter(UNEVEN_S, -np.inf))
    assert np.abs(value - before).max() < 1e-6  # 1e-10 s at 7.6 km/s


def test_linear_is_linear():
    nodes, table = np.array([0.0, 1.0, 3.0]), np.array([[0.0], [2.0], [0.0]])
    value, rate = interpolate(nodes, table, None, "linear", 1, [0.25, 2.0, 3.5])
    np.testing.assert_allclose(value[:, 0], [0.5, 1.0, -0.5], rtol=1e-15)
    np.testing.assert_allclose(rate[:, 0], [2.0, -1.0, -1.0], rtol=1e-15)


def test_short_tables_lower_the_degree():
    assert [window_size("hermite", 7, n) for n in (1, 3, 4, 9)] == [1, 3, 4, 4]
    assert [window_size("lagrange", 7, n) for n in (1, 3, 9)] == [1, 3, 8]
    assert window_size("hermite", 8, 9) == 4
    position, velocity = orbit([5.0])
    value, rate = interpolate([5.0], position, velocity, "hermite", 7, [5.0, 6.0])
    np.testing.assert_array_equal(rate[0], velocity[0])
    np.testing.assert_allclose(value[1], position[0] + velocity[0], rtol=1e-15)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(1, 9),
    st.lists(st.floats(0.5, 2.0), min_size=10, max_size=20),
    st.integers(0, 2**32 - 1),
    st.sampled_from(["lagrange", "hermite"]),
)
def test_polynomials_come_back_exactly(degree, steps, seed, method):
    """A polynomial of the degree is its own interpolant, in value and in derivative."""
    if method == "hermite" and degree % 2 == 0:
        degree -= 1
    rng = np.random.default_rng(seed)
    nodes = np.cumsum(steps)
    true = np.polynomial.Polynomial(rng.normal(size=degree + 1), domain=[nodes[0], nodes[-1]])
    times = rng.uniform(nodes[0], nodes[-1], 20)
    value, rate = interpolate(nodes, true(nodes)[:, None], true.deriv()(nodes)[:, None], method, degree, times)
    scale = np.abs(true(nodes)).max() + 1.0
    np.testing.assert_allclose(value[:, 0], true(times), rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(rate[:, 0], true.deriv()(times), rtol=0, atol=1e-10 * scale)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"node_s": [0.0, 0.0, 1.0]}, "node_s: must ascend"),
        ({"value": np.zeros((2, 3))}, r"node_s, value: must have shapes \(n,\) and \(n, m\)"),
        ({"method": "spline"}, "method: must be 'linear', 'lagrange' or 'hermite', got 'spline'"),
        ({"degree": 0}, "degree: must be >= 1, got 0"),
        ({"rate": None}, r"rate: must have shape \(3, 3\) for 'hermite', got None"),
    ],
)
def test_wrong_tables(change, message):
    table = {"node_s": [0.0, 1.0, 2.0], "value": np.zeros((3, 3)), "rate": np.zeros((3, 3)), "method": "hermite",
             "degree": 3, "time_s": [0.5]}  # fmt: skip
    with pytest.raises(InputError, match=message):
        interpolate(**(table | change))
