"""Patterns averaged over wavelengths, blurred by jitter and diffusion, on pixels of any shape; tables on the device."""

from __future__ import annotations

import numpy as np
import pytest
from drawing import draw_each
from psf_oracles import FIRST_DARK_RING, converged_airy_fraction, fractions_by_spectrum

import warpsim as ws
from warpsim.errors import InputError
from warpsim.optics.epsf_table import POINTS, table_fraction
from warpsim.optics.tables import TableAccuracy, epsf_table

CLOSURE_ATOL = 1e-5
"""Interpolation errors of the few bright pixels, and what the wing leaves out summed over the plane: terms of the
blur beyond s^4, each below the table's error, of the same sign: 5.6e-6 on every processor."""
DEVICE_ATOL = 1e-6
"""What devices may differ by. Rounding, 2.4e-7: they may fuse multiplications with additions, and float32 positions
differ from float64 ones."""
SPECTRUM_ATOL = 1e-9
"""Of the Fourier integral, for lamF above 0.1 px and offsets below 4 px."""

BLURS = {
    # radius, obscuration, smear, aspect
    "a-little": (0.478, 0.0, 0.02, 1.0),
    "as-wide-as-the-core": (0.478, 0.3, 0.2, 1.0),
    "wider-than-the-core": (0.3, 0.3, 1.0, 1.0),
    "far-wider": (0.02, 0.3, 0.6, 1.0),
    "tall-pixels": (0.478, 0.3, 0.1, 1.7),
    "flat-pixels": (0.8, 0.0, 0.3, 0.5),
    "tall-and-sharp": (0.25, 0.3, 0.0, 1.7),
    "wide": (6.0, 0.3, 2.0, 1.2),
}


def offsets_to_try(aspect, scale_px, n=30):
    """dx [px] and dy [pixel heights]: exact places, edges and corners, the core, and farther out."""
    rng = np.random.default_rng(1)
    exact = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [0.5, 0.5], [1.0, -0.5]])
    edges = rng.choice([-0.5, 0.5], (n, 2)) + scale_px * rng.normal(0.0, 0.5, (n, 2)) / [1.0, aspect]
    near = scale_px * rng.uniform(-2.0, 2.0, (n, 2))
    return np.concatenate([exact, edges, near, rng.uniform(-3.5, 3.5, (n, 2))]).astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize("blur", BLURS.values(), ids=BLURS)
def test_blurred_patterns_on_any_pixel(blur, record_accuracy):
    radius_px, obscuration, smear_px, aspect = blur
    table = epsf_table(ws.PsfAiry(radius_px, obscuration, smear_px), aspect)
    offsets = offsets_to_try(aspect, min(max(radius_px, smear_px), 1.5))
    expected = fractions_by_spectrum(offsets.astype(float), [radius_px], [1.0], obscuration, smear_px, aspect)
    np.testing.assert_allclose(table_fraction(table, *offsets.T), expected, rtol=0, atol=table.error)
    error = np.abs(table_fraction(table, *offsets.T) - expected).max()
    record_accuracy(
        "Blurred pattern on any pixel, against its stated error", error, table.error, "of the flux", "Fourier integrals"
    )


def test_the_spectrum_is_an_oracle():
    """The Fourier integral agrees with direct quadrature in space, on pixels that are not square."""
    offsets = np.array([[0.0, 0.0], [0.5, 0.3], [1.2, -0.5], [3.0, 2.0]])
    got = fractions_by_spectrum(offsets, [0.478], [1.0], 0.3, 0.0, 1.7)
    expected = [converged_airy_fraction(dx, dy, 0.478, 0.3, 1.7) for dx, dy in offsets]
    np.testing.assert_allclose(got, expected, rtol=0, atol=SPECTRUM_ATOL)


@pytest.mark.slow
@pytest.mark.parametrize("aspect", [0.4, 1.6])
@pytest.mark.parametrize("radius_px", [0.05, 0.3, 2.0])
def test_sharp_patterns_on_pixels_that_are_not_square(radius_px, aspect):
    table = epsf_table(ws.PsfAiry(radius_px, 0.2), aspect)
    offsets = offsets_to_try(aspect, min(radius_px, 1.0), n=15)
    far = np.random.default_rng(2).uniform(-1.4, 1.4, (20, 2)) * table.reach_px[::-1]
    axes = np.array([[1.05 * table.reach_px[1], 0.0], [0.0, 1.05 * table.reach_px[0]]])
    offsets = np.concatenate([offsets, far, axes]).astype(np.float32)
    expected = [converged_airy_fraction(dx, dy, radius_px, 0.2, aspect) for dx, dy in offsets.astype(float)]
    np.testing.assert_allclose(table_fraction(table, *offsets.T), expected, rtol=0, atol=table.error)


@pytest.mark.parametrize("obscuration", [0.0, 0.3])
@pytest.mark.parametrize("radii_px", [(0.14, 0.185, 0.22), (1.0, 1.5), (9.0, 10.0, 12.0)])
@pytest.mark.ci
def test_sum_over_wavelengths(radii_px, obscuration):
    weights = np.arange(1.0, len(radii_px) + 1)
    table = epsf_table(ws.PsfAiry(radii_px, obscuration, weights=tuple(weights)))
    rng = np.random.default_rng(3)
    offsets = np.concatenate([offsets_to_try(1.0, 0.3, n=8), 1.3 * table.reach_px[0] * rng.uniform(-1, 1, (12, 2))])
    offsets = offsets.astype(np.float32)
    parts = [[converged_airy_fraction(dx, dy, r, obscuration) for dx, dy in offsets.astype(float)] for r in radii_px]
    expected = weights @ parts / weights.sum()
    np.testing.assert_allclose(table_fraction(table, *offsets.T), expected, rtol=0, atol=table.error)


@pytest.mark.parametrize("blur", [BLURS[name] for name in ("wider-than-the-core", "far-wider", "flat-pixels")])
def test_flux_of_the_whole_plane(blur):
    radius_px, obscuration, smear_px, aspect = blur
    table = epsf_table(ws.PsfAiry(radius_px, obscuration, smear_px), aspect)
    n_col, n_row = 300, round(300 / aspect)
    dx, dy = np.meshgrid(np.arange(-n_col, n_col + 1) - 0.37, np.arange(-n_row, n_row + 1) + 0.21)
    # The w / r^3 law outside a square of half side L: 8 int_0^{pi/4} w cos(a) / L da.
    outside = table.wing.px3 / aspect * 4.0 * np.sqrt(2.0) / (n_col + 0.5)
    assert table_fraction(table, dx, dy).sum() + outside == pytest.approx(1.0, abs=CLOSURE_ATOL)


def test_a_blur_far_wider_than_the_rings_makes_a_gaussian_with_wings():
    """The core tends to the Gaussian; the wing stays that of the pupil."""
    table = epsf_table(ws.PsfAiry(0.012, 0.0, 3.0))
    gauss = ws.deposit([(20.0, 20.0)], [1.0], ws.PsfGaussian(3.0), (41, 41), device="cpu", flux_error=1e-9)
    dx, dy = np.meshgrid(np.arange(-20.0, 21.0), np.arange(-20.0, 21.0))
    assert np.abs(table_fraction(table, dx, dy) - gauss).max() < 2e-3 * gauss.max()
    assert table.wing.px3 == pytest.approx(0.012 / FIRST_DARK_RING / np.pi**3, rel=1e-12)


@pytest.mark.parametrize(("aspect", "rel"), [(0.7, 3e-4), (1.0, 1e-4), (1.4, 3e-4)])
def test_wings_of_blurs(aspect, rel):
    """The law beyond the table is w / r^3 averaged over blur and pixel, by quadrature.

    It leaves out (230 s^6 + 57 s^4) / r^6 + 0.14 / r^4, 4.2e-5 here, and what blur and the pixel's shape do together,
    1.4e-4; of which twice is allowed.
    """
    smear_px = 1.0
    table = epsf_table(ws.PsfAiry(0.02, 0.0, smear_px), aspect)
    node, weight = np.polynomial.hermite_e.hermegauss(40)
    inside, part = np.polynomial.legendre.leggauss(6)
    x = smear_px * node[:, None, None, None] + 0.5 * inside[:, None]
    y = smear_px * node[:, None, None] + 0.5 * aspect * inside
    law = weight[:, None, None, None] * weight[:, None, None] * part[:, None] * part / 4 / (2 * np.pi)
    for angle in (0.0, 0.5, np.pi / 2):
        dx, dy = 14.0 * np.cos(angle), 14.0 * np.sin(angle)
        expected = table.wing.px3 * np.sum(law / np.hypot(dx + x, dy + y) ** 3)
        assert max(table.reach_px[1], table.reach_px[0] * aspect) < 9.9
        assert table_fraction(table, dx, dy / aspect) == pytest.approx(expected, rel=rel)


@pytest.mark.slow
@pytest.mark.parametrize("smear_px", [0.0, 0.003, 0.1, 5.0, 50.0])
@pytest.mark.parametrize("radius_px", [0.01, 0.3, 50.0])
def test_stated_errors_over_the_range_of_blurs(radius_px, smear_px):
    table = epsf_table(ws.PsfAiry(radius_px, 0.3, smear_px))
    assert table.error <= 6e-7
    assert table.n_byte < 32e6


@pytest.mark.parametrize("n_point", POINTS)
@pytest.mark.parametrize("aspect", [1.0, 1.6])
@pytest.mark.ci
def test_device_and_twin_agree(device, n_point, aspect):
    """Images of single sources, inside the table and on its wing, at every order."""
    psf, accuracy = ws.PsfAiry((0.5, 0.7), 0.3, 0.1), TableAccuracy(1e-4, n_point)
    table = epsf_table(psf, aspect, accuracy.error, n_point)
    assert max(table.reach_px) < 16
    rng = np.random.default_rng(5)
    xy = np.concatenate([[[20.0, 12.0], [20.5, 12.5], [-0.5, -0.5], [44.3, 30.2]], rng.uniform(0, [40, 30], (16, 2))])
    found = draw_each(xy, psf, (30, 40), device, 1e-9, aspect, accuracy)
    dx = np.arange(40) - xy[:, 0, None, None]
    dy = np.arange(30)[:, None] - xy[:, 1, None, None]
    np.testing.assert_allclose(found, table_fraction(table, dx, dy), rtol=0, atol=DEVICE_ATOL)


@pytest.mark.ci
def test_stamps_leave_out_what_the_rule_allows(device):
    """Pixels that a blurred, stretched pattern's stamp leaves out hold no more than the cut."""
    psf, aspect, cut = ws.PsfAiry(0.4, 0.3, 1.0), 0.6, 1e-4
    images = [draw_each([[30.3, 50.6]], psf, (101, 61), device, allowed, aspect)[0] for allowed in (cut, 1e-9)]
    left_out = images[0] == 0
    assert left_out.any() and images[1][left_out].max() <= cut
    np.testing.assert_array_equal(images[0][~left_out], images[1][~left_out])


CAMERA = ws.Camera(n_row=128, n_col=128, fov_deg=1.0)


def test_optics_average_over_the_band():
    band = ws.BANDS["A"]
    psf = ws.Optics(aperture_m=0.4, obscuration=0.2).psf_for("A", CAMERA)
    wavelength_um, weight_um = band.intervals(6)
    np.testing.assert_allclose(
        psf.radii_px, FIRST_DARK_RING * wavelength_um * 1e-6 / 0.4 * CAMERA.focal_px, rtol=1e-14, atol=0
    )
    np.testing.assert_allclose(psf.parts, weight_um / weight_um.sum(), rtol=1e-14, atol=0)
    assert psf.obscuration == 0.2 and psf.smear_px == 0.0


def test_one_interval_is_the_isophotal_wavelength():
    psf = ws.Optics(aperture_m=0.4, n_interval=1).psf_for(ws.BANDS["E"], CAMERA)
    assert psf.radius_px == pytest.approx(FIRST_DARK_RING * 21.34e-6 / 0.4 * CAMERA.focal_px, rel=1e-14)


@pytest.mark.parametrize("kind", ["airy", "gaussian"])
def test_blurs_add_in_quadrature(kind):
    optics = ws.Optics(aperture_m=0.4, psf=kind, smear_urad=40.0, sigma_px=0.3 if kind == "gaussian" else None)
    smear_px = np.hypot(40e-6 * CAMERA.focal_px, 0.25)
    psf = optics.psf_for("A", CAMERA, diffusion_px=0.25)
    if kind == "airy":
        assert psf.smear_px == pytest.approx(smear_px, rel=1e-14)
    else:
        assert psf.sigma_px == pytest.approx(np.hypot(0.3, smear_px), rel=1e-14)


def test_a_scene_has_all_of_it():
    scene = ws.Scene.load("stss").replace(optics__smear_urad=10.0, detector__diffusion_px=0.2)
    assert scene.scenario.instrument.psf("A") == scene.optics.psf_for("A", scene.camera, 0.2)
    assert scene.scenario.instrument.psf("A").smear_px > 0.2
    assert ws.Scene.from_dict(scene.to_dict()) == scene


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"n_interval": 0}, r"n_interval: must be"),
        ({"n_interval": 33}, r"n_interval: must be in \[1, 32\]"),
        ({"smear_urad": -1.0}, "smear_urad: must be >= 0"),
        ({"psf_error": 1e-9}, r"psf_error: must be in \[6e-07, 0.01\]"),
        ({"psf_points": 4}, "psf_points: is not a known field"),
    ],
)
def test_bad_optics(fields, words):
    with pytest.raises(InputError, match=words):
        ws.Optics(aperture_m=0.4, **fields)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"radius_px": 1.0, "smear_px": -0.1}, r"smear_px: must be in \[0, 50\]"),
        ({"radius_px": (1.0, 2.0), "weights": (1.0,)}, r"weights: must be as many as radius_px \(2\), got 1"),
        ({"radius_px": (1.0, 2.0), "weights": (1.0, 0.0)}, "weights: must be > 0"),
        ({"radius_px": [1.0] * 33}, "radius_px: must hold 1 to 32 numbers"),
    ],
)
def test_bad_patterns(arguments, words):
    with pytest.raises(InputError, match=words):
        ws.PsfAiry(**arguments)
