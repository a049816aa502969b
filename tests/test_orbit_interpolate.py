"""Piecewise polynomials against scipy's, and against a true orbit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BarycentricInterpolator, KroghInterpolator

from warpsim.constants import EARTH_GM_M3_S2
from warpsim.errors import InputError
from warpsim.orbit.interpolate import interpolate, window_size
from warpsim.orbit.two_body import propagate_two_body

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


NODES_S = np.cumsum(np.random.default_rng(7).uniform(20.0, 60.0, 40))
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
    position, _ = orbit(NODES_S)
    times = np.linspace(NODES_S[0] - 5.0, NODES_S[-1] + 5.0, 301)
    value, rate = interpolate(NODES_S, position, None, "lagrange", degree, times)
    for t, start, r, v in zip(times, windows(NODES_S, degree + 1, times), value, rate, strict=True):
        rows = slice(start, start + degree + 1)
        middle = NODES_S[rows].mean()
        expected = BarycentricInterpolator(NODES_S[rows] - middle, position[rows] - position[start])
        assert np.abs(position[start] + expected(t - middle) - r).max() < EXACT_M
        assert np.abs(expected.derivative(t - middle) - v).max() < EXACT_M_S


@pytest.mark.parametrize("degree", [1, 3, 5, 7, 9])
def test_hermite_against_scipy(degree):
    position, velocity = orbit(NODES_S)
    size = (degree + 1) // 2
    times = np.linspace(NODES_S[0] - 5.0, NODES_S[-1] + 5.0, 301)
    value, rate = interpolate(NODES_S, position, velocity, "hermite", degree, times)
    for t, start, r, v in zip(times, windows(NODES_S, size, times), value, rate, strict=True):
        rows = np.repeat(np.arange(start, start + size), 2)
        data = position[rows] - position[start]
        data[1::2] = velocity[rows[1::2]]
        middle = NODES_S[start]
        expected = KroghInterpolator(NODES_S[rows] - middle, data)
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
    position, velocity = orbit(NODES_S)
    value, _ = interpolate(NODES_S, position, velocity, method, degree, NODES_S)
    assert np.abs(value - position).max() < EXACT_M
    before, _ = interpolate(NODES_S, position, velocity, method, degree, np.nextafter(NODES_S, -np.inf))
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
