"""Airy tables against direct quadrature of the diffraction pattern over the pixel."""

from __future__ import annotations

import dataclasses
from collections import OrderedDict

import mpmath
import numpy as np
import pytest
from conftest import slow
from psf_oracles import ORACLE_ATOL, converged_airy_fraction
from scipy import special

import warpsim as ws
from warpsim.errors import InputError
from warpsim.optics import tables
from warpsim.optics.bessel import jinc, scaled_i1_over_x
from warpsim.optics.epsf_table import ENVELOPE_PER_PX, POINTS, lagrange_weights, table_fraction
from warpsim.optics.flow import pixel_fractions
from warpsim.optics.pattern import FIRST_DARK_RING, AiryPattern
from warpsim.optics.tables import cheapest_points, epsf_table

FRACTION_ATOL = 1e-6
"""Asked for, per pixel and unit flux, and of the sum of a stamp (8e-7 at most). Tables are built for 6e-7: the error
that a table states is 1.2 times the largest found on sampled offsets, and 5e-8 for the rounding of other devices."""
CLOSURE_ATOL = 2e-6
"""Interpolation errors of the few bright pixels, and the rings cut at the reach."""
JINC_ATOL = 1e-13
WING_RTOL = 2e-3
"""The incomplete last ring of a thousand."""
ROUNDING_ATOL = 1e-7
"""Two float32 roundings of a fraction up to 1."""

I1_RTOL = 1e-13
TABLE_LINE = "Table of an Airy pattern, radius 0.01 to 50 px, against its stated error"
RADII_PX = [0.03, 0.185, 0.272, 0.478, 1.5, 4.0, 10.0]
ERRORS = [6e-7, 1e-5, 1e-3]
OBSCURATIONS = [0.0, 0.3]
all_patterns = [
    pytest.mark.parametrize("radius_px", RADII_PX),
    pytest.mark.parametrize("obscuration", OBSCURATIONS),
]


def every_pattern(test):
    for mark in all_patterns:
        test = mark(test)
    return test


def airy(radius_px: float, obscuration: float = 0.0, **accuracy):
    return epsf_table(ws.PsfAiry(radius_px, obscuration), **accuracy)


def reference(offsets_px: np.ndarray, radius_px: float, obscuration: float) -> np.ndarray:
    return np.array(
        [converged_airy_fraction(dx, dy, radius_px, obscuration) for dx, dy in offsets_px.astype(np.float64)]
    )


def assert_matches_reference(offsets_px: np.ndarray, radius_px: float, obscuration: float, record) -> None:
    """Compare at offsets that float32 holds exactly, in float32 as on the device and in float64."""
    table = airy(radius_px, obscuration)
    assert table.error <= FRACTION_ATOL
    offsets_px = offsets_px.astype(np.float32)
    expected = reference(offsets_px, radius_px, obscuration)
    for real in (np.float32, np.float64):
        dx_px, dy_px = offsets_px.T.astype(real)
        got = table_fraction(table, dx_px, dy_px)
        assert got.dtype == real
        np.testing.assert_allclose(got, expected, rtol=0, atol=table.error)
        record(TABLE_LINE, np.abs(got - expected).max(), table.error, "of the flux", "quadrature")


def test_jinc_matches_scipy():
    v = np.concatenate([np.geomspace(1e-9, 1.0, 1000), np.linspace(0.01, 60.0, 20_001), np.geomspace(60.0, 1e4, 5000)])
    np.testing.assert_allclose(jinc(v), 2.0 * special.j1(v) / v, rtol=0, atol=JINC_ATOL)
    assert jinc(np.zeros(1))[0] == pytest.approx(1.0, abs=1e-15)


def test_scaled_i1_matches_scipy():
    x = np.geomspace(1e-6, 1e5, 5000)
    np.testing.assert_allclose(scaled_i1_over_x(x) * x, special.i1e(x), rtol=I1_RTOL)
    assert scaled_i1_over_x(np.zeros(1))[0] == pytest.approx(0.5, rel=I1_RTOL)


@pytest.mark.parametrize("n_point", POINTS)
def test_lagrange_weights_reproduce_polynomials(n_point):
    t = np.linspace(0.0, 1.0, 11)
    weights = np.array(lagrange_weights(t, n_point))
    for power in range(n_point):
        nodes = np.arange(1.0 - n_point // 2, 1.0 + n_point // 2)
        np.testing.assert_allclose(nodes**power @ weights, t**power, atol=1e-11)


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
    assert converged_airy_fraction(dx_px, dy_px, radius_px, obscuration) == pytest.approx(
        float(expected), abs=ORACLE_ATOL
    )


@every_pattern
@pytest.mark.ci
def test_near_pixels_at_random_phases(radius_px, obscuration, record_accuracy):
    rng = np.random.default_rng(1)
    assert_matches_reference(rng.uniform(-2.5, 2.5, (120, 2)), radius_px, obscuration, record_accuracy)


@every_pattern
@pytest.mark.ci
def test_source_on_and_beside_edges_and_corners(radius_px, obscuration, record_accuracy):
    rng = np.random.default_rng(2)
    lamf_px = radius_px / FIRST_DARK_RING
    exact = np.array([[0.5, 0.0], [-0.5, 0.5], [0.5, 0.5], [1.5, -0.5], [0.0, 0.0], [1.0, 0.5], [1.0, 1.0], [2.0, 0.0]])
    width_px = min(2.0 * lamf_px, 0.5)
    corner = 0.5 + width_px * rng.uniform(-1.0, 1.0, (60, 2))
    edge = np.stack([0.5 + width_px * rng.uniform(-1.0, 1.0, 60), rng.uniform(-0.5, 0.5, 60)], axis=-1)
    offsets = np.concatenate([exact, corner, edge, edge[:, ::-1]])
    assert_matches_reference(offsets, radius_px, obscuration, record_accuracy)


@every_pattern
@pytest.mark.ci
def test_far_pixels_on_axes_and_diagonals(radius_px, obscuration, record_accuracy):
    rng = np.random.default_rng(3)
    reach_px = airy(radius_px, obscuration).reach_px[0]
    r_px = reach_px * rng.uniform(0.3, 1.3, 40)
    axis = np.stack([r_px, rng.uniform(-1.0, 1.0, 40)], axis=-1)
    diagonal = np.stack([r_px, -r_px], axis=-1)
    anywhere = reach_px * rng.uniform(-1.5, 1.5, (40, 2))
    distant = reach_px * np.array([[10.0, 0.0], [0.0, 100.0], [30.0, 30.0]])
    offsets = np.concatenate([axis, axis[:, ::-1], diagonal, anywhere, distant])
    assert_matches_reference(offsets, radius_px, obscuration, record_accuracy)


@every_pattern
@pytest.mark.ci
def test_both_sides_of_the_reach(radius_px, obscuration, record_accuracy):
    reach_px = np.float32(airy(radius_px, obscuration).reach_px[0])
    above, below = np.nextafter(reach_px, np.float32(1e9)), np.nextafter(reach_px, np.float32(0.0))
    across = np.array([below, reach_px, above])
    offsets_px = [(a, b) for a in across for b in (0.0, 0.25, *across)]
    offsets_px += [(reach_px + 0.1 * k, 0.0) for k in range(1, 11)]
    assert_matches_reference(np.array(offsets_px), radius_px, obscuration, record_accuracy)


@pytest.mark.parametrize("obscuration", [0.0, *(slow(one) for one in (0.02, 0.15, 0.6)), 0.3])
@pytest.mark.parametrize("radius_px", [0.03, 0.1, 0.35, 0.7, 1.22, 2.5, 7.0])
@pytest.mark.ci
def test_stated_error_holds_on_random_phases(radius_px, obscuration):
    """On many more offsets than those that the build measures it on, against its own quadrature of the edges."""
    table = airy(radius_px, obscuration)
    assert table.error <= FRACTION_ATOL
    assert worst_error(table, radius_px, obscuration) <= table.error


@pytest.mark.parametrize("n_point", POINTS)
@pytest.mark.parametrize("error", ERRORS)
@pytest.mark.parametrize("radius_px", [0.6, 1.5])
@pytest.mark.ci
def test_every_order_keeps_the_error_asked_for(radius_px, error, n_point):
    if n_point == 2 and error < 1e-6:
        with pytest.raises(InputError, match=r"needs a table of \d+ x \d+ nodes"):
            airy(radius_px, error=error, n_point=n_point)
        return
    table = airy(radius_px, error=error, n_point=n_point)
    assert table.n_point == n_point
    assert worst_error(table, radius_px, 0.0) <= table.error <= error


def worst_error(table, radius_px, obscuration):
    """Of the float32 twin, near edges and corners, in the middle, anywhere, and beyond the table."""
    pattern = AiryPattern((radius_px / FIRST_DARK_RING,), (1.0,), obscuration, 0.0)
    flow = pattern.flow(2.0 * table.reach_px[0] + 3.0)
    rng = np.random.default_rng(6)
    n = 3000 if radius_px < 0.2 else 20_000  # edges of sharp patterns take many nodes
    width = min(radius_px, 1.0)
    edges = 0.5 + rng.normal(0.0, width, (2, n))
    mixed = np.where(rng.random((2, n)) < 0.5, edges, rng.uniform(-0.7, 0.7, (2, n)))
    wide = table.reach_px[0] * rng.uniform(-1.3, 1.3, (2, n))
    near = rng.uniform(-2.5, 2.5, (2, n)) * max(1.0, radius_px)
    offsets = np.clip(np.concatenate([edges, mixed, wide, near], axis=1), *1.3 * table.reach_px[0] * np.array([-1, 1]))
    dx_px, dy_px = offsets.astype(np.float32)
    exact = pixel_fractions(flow, dx_px.astype(np.float64), dy_px.astype(np.float64), 1.0)
    return np.abs(table_fraction(table, dx_px, dy_px) - exact).max()


@pytest.mark.slow
@pytest.mark.parametrize("obscuration", OBSCURATIONS)
@pytest.mark.parametrize("radius_px", [0.01, 0.02, 50.0])
def test_ends_of_the_range(radius_px, obscuration, record_accuracy):
    table = airy(radius_px, obscuration)
    assert table.error <= FRACTION_ATOL
    assert table.n_byte < 32e6
    rng = np.random.default_rng(8)
    width = min(2.0 * radius_px, 0.5)
    corner = 0.5 + width * rng.uniform(-1.0, 1.0, (12, 2))
    edge = np.stack([0.5 + width * rng.uniform(-1.0, 1.0, 12), rng.uniform(-0.5, 0.5, 12)], axis=-1)
    far = table.reach_px[0] * rng.uniform(-1.5, 1.5, (12, 2))
    exact = np.array([[0.5, 0.0], [0.5, 0.5], [0.0, 0.0], [1.0, 0.5]])
    offsets = np.concatenate([exact, corner, edge, far]).astype(np.float32)
    expected = reference(offsets, radius_px, obscuration)
    got = table_fraction(table, *offsets.T)
    np.testing.assert_allclose(got, expected, rtol=0, atol=table.error)
    record_accuracy(TABLE_LINE, np.abs(got - expected).max(), table.error, "of the flux", "quadrature")


@pytest.mark.parametrize("obscuration", [0.0, 0.1, 0.3, 0.5])
def test_wing_is_the_mean_over_rings(obscuration):
    r_lamf = np.linspace(200.0, 1200.0, 200_001)
    v = np.pi * r_lamf
    amplitude = 2.0 * (special.j1(v) - obscuration * special.j1(obscuration * v)) / v
    irradiance = np.pi / (4.0 * (1.0 - obscuration**2)) * amplitude**2  # lamF = 1 px
    wing_px3 = airy(FIRST_DARK_RING, obscuration).wing.px3
    assert np.mean(irradiance * r_lamf**3) == pytest.approx(wing_px3, rel=WING_RTOL)


@pytest.mark.slow
@every_pattern
def test_flux_of_a_stamp(radius_px, obscuration):
    """Errors of neighbouring pixels do not add up to more than one pixel's tolerance."""
    table = airy(radius_px, obscuration)
    pixel = np.arange(-8, 9)
    dx_px, dy_px = np.meshgrid(pixel - 0.37, pixel + 0.21)
    expected = reference(np.stack([dx_px.ravel(), dy_px.ravel()], axis=-1), radius_px, obscuration).sum()
    assert table_fraction(table, dx_px, dy_px).sum() == pytest.approx(expected, abs=FRACTION_ATOL)


@pytest.mark.ci
@pytest.mark.parametrize("radius_px", [0.03, 0.185, 0.272, 0.478])
@pytest.mark.parametrize("obscuration", OBSCURATIONS)
def test_flux_of_the_whole_plane(radius_px, obscuration):
    """Where rings average away over a pixel, the table and the wing hold all the flux.

    Wider rings stay in phase over many pixels, so that cutting them at the reach moves the sum by up to 2e-4 at 10 px
    although each pixel is within FRACTION_ATOL; the stamp test above covers those radii.
    """
    table = airy(radius_px, obscuration)
    n_side = 300
    pixel = np.arange(-n_side, n_side + 1)
    dx_px, dy_px = np.meshgrid(pixel - 0.37, pixel + 0.21)
    # The w / r^3 law outside a square of half side L: 8 int_0^{pi/4} w cos(a) / L da.
    outside = table.wing.px3 * 4.0 * np.sqrt(2.0) / (n_side + 0.5)
    assert table_fraction(table, dx_px, dy_px).sum() + outside == pytest.approx(1.0, abs=CLOSURE_ATOL)


@pytest.mark.ci
@every_pattern
def test_what_lies_outside_a_disc(radius_px, obscuration):
    """No pixel that a disc leaves out holds more than the envelope says, and the envelope is not wasteful."""
    rng = np.random.default_rng(4)
    table = airy(radius_px, obscuration)
    radius = np.arange(len(table.envelope)) / ENVELOPE_PER_PX
    assert np.all(np.diff(table.envelope) <= 0.0)
    angle = rng.choice([0.0, 0.3, np.pi / 4.0], len(radius))
    # Pixels whose nearest point lies on the disc's rim or a little beyond.
    beyond = radius + rng.choice([0.0, 0.02, 0.3], len(radius))
    offsets = 0.5 + beyond[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    offsets[angle == 0.0, 1] = rng.uniform(0.0, 0.5, (angle == 0.0).sum())
    pick = np.unique(np.concatenate([np.arange(min(8, len(radius))), rng.integers(0, len(radius), 12)]))
    held = reference(offsets[pick], radius_px, obscuration)
    assert np.all(held <= table.envelope[pick])
    # Twice the largest fraction found on the rims is room for those between the radii and the angles tried here.
    rim = reference(np.stack([0.5 + radius[pick], np.zeros(len(pick))], axis=-1), radius_px, obscuration)
    assert np.all(table.envelope[pick] <= np.maximum(2.0 * rim, 4.0 * table.wing.px3 / (0.5 + radius[pick]) ** 3))
    far = table.reach_px[0] * rng.uniform(1.0, 3.0, (30, 2))
    assert np.all(reference(far, radius_px, obscuration) * np.hypot(*far.T) ** 3 <= table.tail_px3)
    assert table.tail_px3 < 6.0 * table.wing.px3


def test_symmetry():
    table = airy(0.185, 0.3)
    dx_px, dy_px = np.random.default_rng(5).uniform(0.0, 1.5 * table.reach_px[0], (2, 500))
    value = table_fraction(table, dx_px, dy_px)
    np.testing.assert_array_equal(table_fraction(table, -dx_px, dy_px), value)
    np.testing.assert_array_equal(table_fraction(table, dx_px, -dy_px), value)
    np.testing.assert_allclose(table_fraction(table, dy_px, dx_px), value, rtol=0, atol=ROUNDING_ATOL)
    np.testing.assert_allclose(table.fraction, table.fraction.T, rtol=0, atol=ROUNDING_ATOL)


def test_layout():
    table = airy(0.478)
    (q, per_col), (zero, zero_col), n = table.per_px, table.zero, table.fraction.shape[0]
    assert table.mirrored and per_col == q and zero_col == zero
    assert table.fraction.shape == (n, n)
    assert table.fraction.dtype == np.float32
    assert q % 2 == 0
    assert (2.0 * table.reach_px[0]).is_integer()
    assert n - zero > table.reach_px[0] * q + table.n_point // 2
    np.testing.assert_array_equal(table.fraction[:zero], table.fraction[2 * zero : zero : -1])
    row, col = zero + q // 2, zero + 2 * q
    assert table.fraction[row, col] == pytest.approx(converged_airy_fraction(2.0, 0.5, 0.478, 0.0), abs=1e-7)


def test_tables_are_shared_and_read_only():
    table = airy(0.478, 0.3)
    assert airy(0.478, 0.3) is table
    with pytest.raises(ValueError, match="read-only"):
        table.fraction[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        table.tail_px3 = 1.0


def test_the_store_of_tables_is_bounded(monkeypatch):
    monkeypatch.setattr(tables, "_STORE", OrderedDict())
    monkeypatch.setattr(tables, "STORE_BYTES", 10**6)
    for k in range(8):
        airy(0.5 + 0.01 * k, n_point=8)  # 0.4 MB each
    kept = sum(table.n_byte for table in tables._STORE.values())
    assert 5e5 < kept <= 1e6
    assert airy(0.57, n_point=8) is airy(0.57, n_point=8)


def test_cheapest_points():
    """Sharp patterns need many points, wide ones few, loose errors fewer."""
    assert cheapest_points([ws.PsfAiry(0.02)]) == 8
    assert cheapest_points([ws.PsfAiry(0.185, 0.3)]) == 6
    assert cheapest_points([ws.PsfAiry(50.0)]) == 2
    assert cheapest_points([ws.PsfAiry(0.185, 0.3)], error=1e-3) == 2
    assert cheapest_points([ws.PsfAiry(0.185, 0.3)], error=1e-4) == 4  # so many nodes that their reads count
    assert cheapest_points([ws.PsfAiry(0.02), ws.PsfAiry(50.0)]) >= 6  # one kernel for both


@pytest.mark.parametrize("radius_px", [0.0, 0.0009, 51.0, float("nan"), [], [0.1, 0.0], "wide"])
def test_radius_out_of_range(radius_px):
    with pytest.raises(InputError, match="radius_px"):
        ws.PsfAiry(radius_px)


@pytest.mark.parametrize("obscuration", [-0.1, 0.61, 1.0, float("nan")])
def test_obscuration_out_of_range(obscuration):
    with pytest.raises(InputError, match="obscuration"):
        ws.PsfAiry(1.0, obscuration)


@pytest.mark.parametrize(
    ("accuracy", "words"),
    [
        ({"error": 1e-8}, r"error: must be in \[6e-07, 0.01\]"),
        ({"error": 0.1}, "error: must be in"),
        ({"n_point": 3}, "n_point: must be one of 2, 4, 6, 8"),
        ({"pixel_aspect": 0.0}, "pixel_aspect: must be in"),
    ],
)
def test_accuracy_out_of_range(accuracy, words):
    with pytest.raises(InputError, match=words):
        airy(1.0, **accuracy)


# The wing's next order, from the blurred core, at 0.05 px from the nearest edge: measured 3.0e-4, 1.4e-4, 3.2e-5.
TIGHT_ATOL = {0.009: 4e-4, 0.004: 2e-4, 0.001: 5e-5}


@pytest.mark.slow
@pytest.mark.parametrize("radius_px", list(TIGHT_ATOL))
def test_tight_patterns_are_exact_away_from_edges(radius_px):
    offsets_px = np.random.default_rng(5).uniform(-3.0, 3.0, (3000, 2))
    edge_px = np.abs(np.abs(offsets_px) - 0.5).min(axis=1)
    offsets_px = offsets_px[edge_px > 0.05]
    sharp = AiryPattern((radius_px / FIRST_DARK_RING,), (1.0,), 0.0, 0.0).flow(8.0)
    exact = pixel_fractions(sharp, offsets_px[:, 0], offsets_px[:, 1], 1.0)
    found = table_fraction(airy(radius_px), offsets_px[:, 0], offsets_px[:, 1])
    np.testing.assert_allclose(found, exact, rtol=0, atol=TIGHT_ATOL[radius_px])
    outside = np.abs(offsets_px).max(axis=1) > 0.55
    wing = exact[outside].sum()
    assert found[outside].sum() == pytest.approx(wing, rel=0.01)  # where all light is the wing's
    assert found.min() >= 0.0


def test_no_pattern_is_tighter_than_geometry_allows():
    with pytest.raises(InputError, match=r"radius_px: must be in \[0.001, 50\], got 0.0005$"):
        ws.PsfAiry(0.0005)
