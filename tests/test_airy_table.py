"""The Airy table against direct quadrature of the diffraction pattern over the pixel."""

from __future__ import annotations

import dataclasses

import mpmath
import numpy as np
import pytest
from scipy import special

from warpsim.errors import InputError
from warpsim.optics.airy import FIRST_DARK_RING, build_airy_table, lagrange_weights, share
from warpsim.optics.bessel import jinc

SHARE_ATOL = 1e-6
"""Per pixel and unit flux: interpolation 2.5e-7, float32 rounding 2e-7, ripples beyond the reach 5e-7."""
ERROR_GOAL = 6e-7
"""What the build measures on its own samples; below SHARE_ATOL, because samples can miss the worst offset."""
ORACLE_ATOL = 1e-11
CLOSURE_ATOL = 2e-6
"""Interpolation errors of the few bright pixels, and the rings cut at the reach."""
JINC_ATOL = 1e-13
WING_RTOL = 2e-3
"""The incomplete last ring of a thousand."""
ROUNDING_ATOL = 1e-7
"""Two float32 roundings of a share up to 1."""

RADII_PX = [0.03, 0.185, 0.272, 0.478, 1.5, 4.0, 10.0]
OBSCURATIONS = [0.0, 0.3]
all_patterns = [
    pytest.mark.parametrize("radius_px", RADII_PX),
    pytest.mark.parametrize("obscuration", OBSCURATIONS),
]


def every_pattern(test):
    for mark in all_patterns:
        test = mark(test)
    return test


def airy_share_reference(dx_px: float, dy_px: float, radius_px: float, obscuration: float, order: int) -> float:
    """Share of one pixel by a tensor Gauss-Legendre rule of the given order on the diffraction pattern."""
    lamf_px = radius_px / FIRST_DARK_RING
    node, weight = np.polynomial.legendre.leggauss(order)
    r_px = np.hypot(dx_px + 0.5 * node, (dy_px + 0.5 * node)[:, None])
    v = np.maximum(np.pi * r_px / lamf_px, 1e-12)
    amplitude = 2.0 * special.j1(v) / v
    if obscuration > 0.0:
        amplitude -= obscuration * 2.0 * special.j1(obscuration * v) / v
    irradiance = np.pi / (4.0 * lamf_px**2 * (1.0 - obscuration**2)) * amplitude**2
    return float(0.25 * weight @ irradiance @ weight)


def converged_share(dx_px: float, dy_px: float, radius_px: float, obscuration: float) -> float:
    """Raise the order until two rules agree."""
    order = 24 + int(2.0 / radius_px)
    coarse = airy_share_reference(dx_px, dy_px, radius_px, obscuration, order)
    while True:
        order += 16
        fine = airy_share_reference(dx_px, dy_px, radius_px, obscuration, order)
        if abs(fine - coarse) < ORACLE_ATOL:
            return fine
        coarse = fine


def reference(offsets_px: np.ndarray, radius_px: float, obscuration: float) -> np.ndarray:
    return np.array([converged_share(dx, dy, radius_px, obscuration) for dx, dy in offsets_px.astype(np.float64)])


def assert_matches_reference(offsets_px: np.ndarray, radius_px: float, obscuration: float) -> None:
    """Compare at offsets that float32 holds exactly, in float32 as on the device and in float64."""
    table = build_airy_table(radius_px, obscuration)
    offsets_px = offsets_px.astype(np.float32)
    expected = reference(offsets_px, radius_px, obscuration)
    for real in (np.float32, np.float64):
        dx_px, dy_px = offsets_px.T.astype(real)
        got = share(table, dx_px, dy_px)
        assert got.dtype == real
        np.testing.assert_allclose(got, expected, rtol=0, atol=SHARE_ATOL)


def test_jinc_matches_scipy():
    v = np.concatenate([np.geomspace(1e-9, 1.0, 1000), np.linspace(0.01, 60.0, 20_001), np.geomspace(60.0, 1e4, 5000)])
    np.testing.assert_allclose(jinc(v), 2.0 * special.j1(v) / v, rtol=0, atol=JINC_ATOL)
    assert jinc(0.0) == pytest.approx(1.0, abs=1e-15)


def test_lagrange_weights_reproduce_quintics():
    t = np.linspace(0.0, 1.0, 11)
    weights = np.array(lagrange_weights(t))
    for power in range(6):
        np.testing.assert_allclose(np.arange(-2.0, 4.0) ** power @ weights, t**power, atol=1e-13)


@pytest.mark.parametrize(("dx_px", "dy_px", "obscuration"), [(0.3, 0.8, 0.0), (2.0, 0.4, 0.3)])
def test_reference_matches_mpmath(dx_px, dy_px, obscuration):
    radius_px = 1.5
    lamf = mpmath.mpf(radius_px) * mpmath.pi / mpmath.besseljzero(1, 1)

    def irradiance(x, y):
        v = mpmath.pi * mpmath.hypot(x, y) / lamf
        amplitude = 2 * (mpmath.besselj(1, v) - obscuration * mpmath.besselj(1, obscuration * v)) / v
        return mpmath.pi / (4 * lamf**2 * (1 - mpmath.mpf(obscuration) ** 2)) * amplitude**2

    box = ([dx_px - 0.5, dx_px + 0.5], [dy_px - 0.5, dy_px + 0.5])
    expected = mpmath.quad(irradiance, *box, method="gauss-legendre", maxdegree=4)
    assert converged_share(dx_px, dy_px, radius_px, obscuration) == pytest.approx(float(expected), abs=ORACLE_ATOL)


@every_pattern
def test_near_pixels_at_random_phases(radius_px, obscuration):
    rng = np.random.default_rng(1)
    assert_matches_reference(rng.uniform(-2.5, 2.5, (120, 2)), radius_px, obscuration)


@every_pattern
def test_source_on_and_beside_edges_and_corners(radius_px, obscuration):
    rng = np.random.default_rng(2)
    lamf_px = radius_px / FIRST_DARK_RING
    exact = np.array([[0.5, 0.0], [-0.5, 0.5], [0.5, 0.5], [1.5, -0.5], [0.0, 0.0], [1.0, 0.5], [1.0, 1.0], [2.0, 0.0]])
    width_px = min(2.0 * lamf_px, 0.5)
    corner = 0.5 + width_px * rng.uniform(-1.0, 1.0, (60, 2))
    edge = np.stack([0.5 + width_px * rng.uniform(-1.0, 1.0, 60), rng.uniform(-0.5, 0.5, 60)], axis=-1)
    assert_matches_reference(np.concatenate([exact, corner, edge, edge[:, ::-1]]), radius_px, obscuration)


@every_pattern
def test_far_pixels_on_axes_and_diagonals(radius_px, obscuration):
    rng = np.random.default_rng(3)
    reach_px = build_airy_table(radius_px, obscuration).reach_px
    r_px = reach_px * rng.uniform(0.3, 1.3, 40)
    axis = np.stack([r_px, rng.uniform(-1.0, 1.0, 40)], axis=-1)
    diagonal = np.stack([r_px, -r_px], axis=-1)
    anywhere = reach_px * rng.uniform(-1.5, 1.5, (40, 2))
    distant = reach_px * np.array([[10.0, 0.0], [0.0, 100.0], [30.0, 30.0]])
    assert_matches_reference(np.concatenate([axis, axis[:, ::-1], diagonal, anywhere, distant]), radius_px, obscuration)


@every_pattern
def test_both_sides_of_the_reach(radius_px, obscuration):
    reach_px = np.float32(build_airy_table(radius_px, obscuration).reach_px)
    above, below = np.nextafter(reach_px, np.float32(1e9)), np.nextafter(reach_px, np.float32(0.0))
    across = np.array([below, reach_px, above])
    offsets_px = [(a, b) for a in across for b in (0.0, 0.25, *across)]
    offsets_px += [(reach_px + 0.1 * k, 0.0) for k in range(1, 11)]
    assert_matches_reference(np.array(offsets_px), radius_px, obscuration)


@pytest.mark.parametrize("obscuration", [0.0, 0.02, 0.15, 0.3, 0.5])
@pytest.mark.parametrize("radius_px", [0.03, 0.1, 0.35, 0.7, 1.22, 2.5, 7.0])
def test_measured_error_meets_the_goal_between_the_named_cases(radius_px, obscuration):
    assert build_airy_table(radius_px, obscuration).error < ERROR_GOAL


@pytest.mark.parametrize("radius_px", [0.02, 50.0])
def test_measured_error_meets_the_goal_at_the_ends_of_the_range(radius_px):
    assert build_airy_table(radius_px, 0.0).error < ERROR_GOAL


@pytest.mark.parametrize("obscuration", [0.0, 0.1, 0.3, 0.5])
def test_wing_is_the_mean_over_rings(obscuration):
    r_lamf = np.linspace(200.0, 1200.0, 200_001)
    v = np.pi * r_lamf
    amplitude = 2.0 * (special.j1(v) - obscuration * special.j1(obscuration * v)) / v
    irradiance = np.pi / (4.0 * (1.0 - obscuration**2)) * amplitude**2  # lamF = 1 px
    wing_px3 = build_airy_table(FIRST_DARK_RING, obscuration).wing_px3
    assert np.mean(irradiance * r_lamf**3) == pytest.approx(wing_px3, rel=WING_RTOL)


@every_pattern
def test_flux_of_a_stamp(radius_px, obscuration):
    """Errors of neighbouring pixels do not add up to more than one pixel's tolerance."""
    table = build_airy_table(radius_px, obscuration)
    pixel = np.arange(-8, 9)
    dx_px, dy_px = np.meshgrid(pixel - 0.37, pixel + 0.21)
    expected = reference(np.stack([dx_px.ravel(), dy_px.ravel()], axis=-1), radius_px, obscuration).sum()
    assert share(table, dx_px, dy_px).sum() == pytest.approx(expected, abs=SHARE_ATOL)


@pytest.mark.parametrize("radius_px", [0.03, 0.185, 0.272, 0.478])
@pytest.mark.parametrize("obscuration", OBSCURATIONS)
def test_flux_of_the_whole_plane(radius_px, obscuration):
    """Where rings average away over a pixel, the table and the wing hold all the flux.

    Wider rings stay in phase over many pixels, so that cutting them at the reach moves the sum by up to 2e-4 at 10 px
    although each pixel is within SHARE_ATOL; the stamp test above covers those radii.
    """
    table = build_airy_table(radius_px, obscuration)
    n_side = 300
    pixel = np.arange(-n_side, n_side + 1)
    dx_px, dy_px = np.meshgrid(pixel - 0.37, pixel + 0.21)
    # The w / r^3 law outside a square of half side L: 8 int_0^{pi/4} w cos(a) / L da.
    outside = table.wing_px3 * 4.0 * np.sqrt(2.0) / (n_side + 0.5)
    assert share(table, dx_px, dy_px).sum() + outside == pytest.approx(1.0, abs=CLOSURE_ATOL)


@every_pattern
def test_tail_bound_holds_and_is_not_wasteful(radius_px, obscuration):
    rng = np.random.default_rng(4)
    table = build_airy_table(radius_px, obscuration)
    r_px = np.concatenate([[1.0], np.geomspace(1.0, 2.0 * table.reach_px, 119)])
    angle = np.where(rng.random(120) < 0.5, 0.0, rng.uniform(0.0, np.pi / 4.0, 120))
    offsets_px = r_px[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    assert np.all(reference(offsets_px, radius_px, obscuration) * r_px**3 <= table.tail_bound_px3)
    assert table.tail_bound_px3 < 4.5 * table.wing_px3


def test_symmetry():
    table = build_airy_table(0.185, 0.3)
    dx_px, dy_px = np.random.default_rng(5).uniform(0.0, 1.5 * table.reach_px, (2, 500))
    value = share(table, dx_px, dy_px)
    np.testing.assert_array_equal(share(table, -dx_px, dy_px), value)
    np.testing.assert_array_equal(share(table, dx_px, -dy_px), value)
    np.testing.assert_allclose(share(table, dy_px, dx_px), value, rtol=0, atol=ROUNDING_ATOL)
    np.testing.assert_allclose(table.share, table.share.T, rtol=0, atol=ROUNDING_ATOL)


def test_layout():
    table = build_airy_table(0.478)
    q, n = table.nodes_per_px, table.share.shape[0]
    assert table.share.shape == (n, n)
    assert table.share.dtype == np.float32
    assert q % 2 == 0
    assert n == round(table.reach_px * q) + 7
    assert (2.0 * table.reach_px).is_integer()
    np.testing.assert_array_equal(table.share[:3], table.share[6:3:-1])
    row, col = 3 + q // 2, 3 + 2 * q
    assert table.share[row, col] == pytest.approx(converged_share(2.0, 0.5, 0.478, 0.0), abs=1e-7)


def test_tables_are_shared_and_read_only():
    table = build_airy_table(0.478, 0.3)
    assert build_airy_table(0.478, 0.3) is table
    with pytest.raises(ValueError, match="read-only"):
        table.share[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        table.reach_px = 1.0


@pytest.mark.parametrize(("radius_px", "obscuration"), [(0.0, 0.0), (0.019, 0.0), (51.0, 0.0), (float("nan"), 0.0)])
def test_radius_out_of_range(radius_px, obscuration):
    with pytest.raises(InputError, match="radius_px"):
        build_airy_table(radius_px, obscuration)


@pytest.mark.parametrize("obscuration", [-0.1, 0.61, 1.0, float("nan")])
def test_obscuration_out_of_range(obscuration):
    with pytest.raises(InputError, match="obscuration"):
        build_airy_table(1.0, obscuration)
