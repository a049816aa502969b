"""Point spread functions given as images: their spline integrated exactly, their tables, files and scenes."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from astropy.io import fits
from scipy import interpolate, special

import warpsim as ws
from warpsim.errors import InputError
from warpsim.optics.epsf_table import POINTS, table_fraction
from warpsim.optics.image_table import spline_of
from warpsim.optics.tables import epsf_table
from warpsim.scene.scene_files import named_files

SPLINE_ATOL = 1e-12
"""Of integrals over pixels against those of scipy's spline; the ends of a cut-off pattern decay by 0.27 per sample."""
GAUSS_ATOL = 5e-6
"""Half of what a streak may err by: a cubic spline through five samples per sigma is 2.4e-6 off."""
COARSE_ATOL = 2e-4
"""The same with three samples per sigma, two units of light: 5e-5."""
SHIFT_ATOL = 1e-6
"""Two tables of the same pattern."""


def gauss_image(shape, oversample, sigma_px, centre_px=(0.0, 0.0)):
    """Point samples of a Gaussian of two widths (x, y) about centre_px (x, y) from the middle of the array."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    x = (x - (shape[1] - 1) / 2) / oversample - centre_px[0]
    y = (y - (shape[0] - 1) / 2) / oversample - centre_px[1]
    return np.exp(-0.5 * ((x / sigma_px[0]) ** 2 + (y / sigma_px[1]) ** 2))


def gauss_fractions(dx, dy, sigma_px, centre_px, aspect=1.0):
    def part(low, high, sigma, centre):
        return special.ndtr((high - centre) / sigma) - special.ndtr((low - centre) / sigma)

    across = part(dx - 0.5, dx + 0.5, sigma_px[0], centre_px[0])
    return across * part(aspect * (dy - 0.5), aspect * (dy + 0.5), sigma_px[1], centre_px[1])


@pytest.mark.parametrize("oversample", [1.0, 3.0, 4.7])
@pytest.mark.parametrize("shape", [(12, 15), (1, 9), (5, 5)])
def test_spline_is_integrated_exactly(shape, oversample):
    """Random samples, against scipy's spline through the same samples and zeros about them."""
    image = np.random.default_rng(1).uniform(-0.2, 1.0, shape)
    pad = 30
    padded = np.pad(image / image.sum(), pad)
    n_row, n_col = padded.shape
    spline = interpolate.RectBivariateSpline(
        np.arange(n_row) - (n_row - 1) / 2, np.arange(n_col) - (n_col - 1) / 2, padded, kx=3, ky=3, s=0
    )
    pattern = spline_of(image, oversample, 0.0, 1.0)
    offsets = np.random.default_rng(2).uniform(-2.0, 2.0, (30, 2))
    # Ends of the image swing out by 1e-7 of an end sample beyond what is kept.
    half = np.array([-0.5, 0.5])
    expected = [spline.integral(*(oversample * (dy + half)), *(oversample * (dx + half))) for dx, dy in offsets]
    np.testing.assert_allclose(pattern.fractions(*offsets.T), expected, rtol=0, atol=3e-7)
    grid = pattern.fractions_on_grid(offsets[:, 0], offsets[:, 1])
    np.testing.assert_allclose(np.diag(grid), pattern.fractions(*offsets.T), rtol=0, atol=SPLINE_ATOL)


@pytest.mark.parametrize("aspect", [1.0, 0.6, 1.5])
@pytest.mark.parametrize("smear_px", [0.0, 0.05, 0.7])
@pytest.mark.parametrize("shape", [(71, 80), (70, 81)])
@pytest.mark.ci
def test_a_gaussian_image_is_a_gaussian(shape, smear_px, aspect, record_accuracy):
    """Off the middle, of two widths, blurred, on any pixel; arrays of odd and even sides."""
    sigma, centre = np.array([0.7, 0.62]), (0.31, -0.17)
    image = gauss_image(shape, 8.0, sigma, centre)
    table = epsf_table(ws.PsfTable(image, 8.0, smear_px), aspect)
    dx, dy = np.random.default_rng(3).uniform(-4.0, 4.0, (2, 2000))
    expected = gauss_fractions(dx, dy, np.hypot(sigma, smear_px), centre, aspect)
    np.testing.assert_allclose(table_fraction(table, dx, dy), expected, rtol=0, atol=GAUSS_ATOL)
    error = np.abs(table_fraction(table, dx, dy) - expected).max()
    record_accuracy("Image of a Gaussian as point spread function", error, GAUSS_ATOL, "of the flux", "error functions")


@pytest.mark.parametrize("n_point", POINTS)
def test_stated_error_holds_at_every_order(n_point):
    error = 1e-3 if n_point == 2 else 1e-6
    image = gauss_image((41, 47), 5.0, (0.8, 0.5), (0.4, 0.3)) + 0.3 * gauss_image((41, 47), 5.0, (0.4, 0.9), (-2, 1))
    psf = ws.PsfTable(image, 5.0)
    table = epsf_table(psf, 1.0, error, n_point)
    offsets = np.random.default_rng(4).uniform(-6.0, 6.0, (2, 30_000)).astype(np.float32)
    offsets[:, :15_000] *= 0.4
    exact = spline_of(psf.image, 5.0, 0.0, 1.0).fractions(*offsets.astype(np.float64))
    assert np.abs(table_fraction(table, *offsets) - exact).max() <= table.error <= error


def test_images_follow_the_pattern(device):
    """A pattern that lies to the right of and above the middle draws a source's light there."""
    psf = ws.PsfTable(gauss_image((61, 61), 6.0, (0.5, 0.5), (2.0, -1.0)), 6.0)
    image = ws.deposit([(10.0, 10.0)], [2.0], psf, (21, 21), device=device)
    assert np.unravel_index(image.argmax(), image.shape) == (9, 12)
    dx, dy = np.meshgrid(np.arange(21.0) - 10.0, np.arange(21.0) - 10.0)
    expected = 2.0 * gauss_fractions(dx, dy, (0.5, 0.5), (2.0, -1.0))
    np.testing.assert_allclose(image, expected, rtol=0, atol=COARSE_ATOL)
    assert image.sum() == pytest.approx(2.0, abs=2e-6)


def test_sources_on_corners_and_half_outside(device):
    psf = ws.PsfTable(gauss_image((64, 64), 8.0, (0.8, 0.6)), 8.0)
    for xy in [(7.5, 5.5), (-0.5, -0.5), (15.5, 11.5), (-1.3, 4.2), (8.0, 11.9)]:
        image = ws.deposit([xy], [1.0], psf, (12, 16), device=device)
        dx, dy = np.meshgrid(np.arange(16.0) - xy[0], np.arange(12.0) - xy[1])
        np.testing.assert_allclose(image, gauss_fractions(dx, dy, (0.8, 0.6), (0, 0)), rtol=0, atol=GAUSS_ATOL)


def test_light_stays_within_the_image(device):
    """Nothing is drawn beyond the pattern and the pixel, however bright the source."""
    psf = ws.PsfTable(np.ones((8, 8)), 4.0)
    image = ws.deposit([(30.0, 30.0)], [1.0], psf, (61, 61), device=device, flux_error=1e-9)
    assert np.all(image[:, :24] == 0) and np.all(image[37:] == 0)
    assert image.sum() == pytest.approx(1.0, abs=2e-6)


def test_scale_of_the_image_does_not_matter():
    image = gauss_image((31, 31), 4.0, (0.8, 0.8))
    assert ws.PsfTable(1e300 * image, 4) == ws.PsfTable(1e300 * image, 4.0)
    np.testing.assert_allclose(ws.PsfTable(1e-300 * image, 4).image, ws.PsfTable(image, 4).image, rtol=1e-12, atol=0)
    assert ws.PsfTable(image, 4).image.sum() == pytest.approx(1.0, abs=1e-14)


def test_one_sample_is_a_spline():
    table = epsf_table(ws.PsfTable([[3.0]], 1.0))
    assert table_fraction(table, np.zeros(1), np.zeros(1))[0] == pytest.approx(0.68, abs=0.1)
    dx, dy = np.meshgrid(np.arange(-20.0, 21.0) + 0.3, np.arange(-20.0, 21.0))
    assert table_fraction(table, dx, dy).sum() == pytest.approx(1.0, abs=2e-6)


def test_a_psf_does_not_change():
    image = np.ones((4, 4))
    psf = ws.PsfTable(image, 2.0)
    image[0, 0] = 5.0
    assert psf.image[0, 0] == 1 / 16
    with pytest.raises(ValueError, match="read-only"):
        psf.image[0, 0] = 1.0
    assert psf == ws.PsfTable(np.ones((4, 4)), 2) and hash(psf) == hash(ws.PsfTable(np.ones((4, 4)), 2))
    assert psf != ws.PsfTable(np.ones((4, 4)), 2, smear_px=0.1)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((np.ones(4), 2), r"image: must be an array of numbers of two axes, got shape \(4,\)"),
        ((np.array([["a"]]), 2), "image: must be an array of numbers of two axes"),
        ((np.zeros((0, 3)), 2), r"image: sides must be 1 to 2048, got \(0, 3\)"),
        ((np.ones((1, 2049)), 2), "image: sides must be 1 to 2048"),
        ((np.array([[1.0, np.nan]]), 2), "image: must be finite, got 1 bad values"),
        ((-np.ones((2, 2)), 2), "image: must have a positive sum"),
        ((np.zeros((2, 2)), 2), "image: must have a positive sum"),
        ((np.ones((2, 2)), 0.9), r"oversample: must be in \[1, 256\], got 0.9"),
        ((np.ones((2, 2)), float("nan")), "oversample: must be in"),
        ((np.ones((2, 2)), "2"), "oversample: must be in"),
        ((np.ones((2, 2)), 2, -1.0), r"smear_px: must be in \[0, 50\]"),
    ],
)
def test_bad_images(arguments, words):
    with pytest.raises(InputError, match=words) as error:
        ws.PsfTable(*arguments)
    assert str(error.value).startswith("PsfTable: ") and "\n" not in str(error.value)


def test_an_image_too_rough_for_a_table_says_so():
    spike = np.zeros((1500, 1500))
    spike[750, 750] = 1.0
    with pytest.raises(InputError, match="needs more than 12000000 nodes"):
        epsf_table(ws.PsfTable(spike, 2.0))


def write_npy(path, image):
    np.save(path, image)


def write_fits(path, image):
    empty = fits.PrimaryHDU()
    fits.HDUList([empty, fits.ImageHDU(image.astype(">f4"))]).writeto(path)


@pytest.mark.parametrize("write", [write_npy, write_fits])
def test_scene_with_a_file(tmp_path, write):
    image = gauss_image((41, 41), 5.0, (0.6, 0.6)).astype(np.float32)
    path = tmp_path / ("psf.npy" if write is write_npy else "psf.fits")
    write(path, image)
    scene = ws.Scene.load("stss").replace(
        optics__psf="table", optics__psf_file=str(path), optics__psf_oversample=5, camera__n_row=32, camera__n_col=32
    )
    assert named_files(scene.to_dict()) == [str(path)]
    np.testing.assert_array_equal(scene.scenario.instrument.psf("A").image, ws.PsfTable(image, 5).image)
    scene.save(tmp_path / "scene.toml")
    assert 'psf_file = "psf.' in (tmp_path / "scene.toml").read_text()
    again = ws.Scene.load(tmp_path / "scene.toml")
    assert again == scene
    from warpsim.scene.inputs import input_checksums

    assert input_checksums(again.scenario)[str(path)] == hashlib.sha256(path.read_bytes()).hexdigest()
    frames = ws.Renderer(again, "cpu").render([60])
    assert frames.counts.numpy().std() > 0


def test_a_file_for_each_band(tmp_path):
    for name, sigma in (("a", 0.5), ("c", 0.9)):
        np.save(tmp_path / f"{name}.npy", gauss_image((41, 41), 5.0, (sigma, sigma)))
    files = {"A": str(tmp_path / "a.npy"), "C": str(tmp_path / "c.npy")}
    base = ws.Scene.load("stss")
    scene = base.replace(optics__psf="table", optics__psf_file=files, optics__psf_oversample=5.0, bands=["C", "A"])
    assert named_files(scene.to_dict()) == list(files.values())
    assert scene.scenario.instrument.psf("C").image[20, 20] < scene.scenario.instrument.psf("A").image[20, 20]
    scene.save(tmp_path / "scene.json")
    assert ws.Scene.load(tmp_path / "scene.json") == scene
    with pytest.raises(InputError, match=r"optics.psf_file: must name a file for every band, got none for E"):
        scene.replace(bands=["A", "E"])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"psf": "table"}, "psf_file: is required with psf = 'table'"),
        ({"psf": "table", "psf_file": "x.npy"}, "psf_oversample: is required with psf = 'table'"),
        ({"psf_file": "x.npy"}, "psf_file: belongs to psf = 'table', got psf = 'airy'"),
        ({"psf_oversample": 3.0}, "psf_oversample: belongs to psf = 'table'"),
        ({"psf": "table", "psf_file": {}, "psf_oversample": 3.0}, "psf_file: must be the path of a file, or a table"),
        ({"psf": "table", "psf_file": {"Z!": "a.npy"}, "psf_oversample": 3.0}, "psf_file: must be the path"),
        (
            {"psf": "table", "psf_file": {"A": 3}, "psf_oversample": 3.0},
            "psf_file: A: must be the path of a file, got 3",
        ),
        ({"psf": "table", "psf_file": 3, "psf_oversample": 3.0}, "psf_file: must be the path of a file, or a table"),
        ({"psf": "table", "psf_file": "a.npy", "psf_oversample": 0.5}, r"psf_oversample: must be in \[1, 256\]"),
    ],
)
def test_bad_fields(changes, words):
    with pytest.raises(InputError, match=words):
        ws.Optics(aperture_m=0.4, **changes)


def test_bad_files(tmp_path):
    def psf_of(name, content):
        (tmp_path / name).write_bytes(content)
        optics = ws.Optics(aperture_m=0.4, psf="table", psf_file=str(tmp_path / name), psf_oversample=2.0)
        return optics.psf_for("A", ws.Camera(n_row=8, n_col=8, fov_deg=1.0))

    with pytest.raises(InputError, match=r"text.npy: must be a FITS image or a NumPy array"):
        psf_of("text.npy", b"nothing of the kind")
    with pytest.raises(InputError, match=r"short.npy: cannot be read as a NumPy array"):
        psf_of("short.npy", b"\x93NUMPY\x01\x00")
    with pytest.raises(InputError, match=r"empty.fits: must hold data"):
        psf_of("empty.fits", b"")
    with pytest.raises(InputError, match=r"broken.fits: "):
        psf_of("broken.fits", b"SIMPLE  =                    T" + b" " * 2850 + b"x" * 100)
    np.save(tmp_path / "cube.npy", np.ones((2, 3, 4)))
    with pytest.raises(InputError, match=r"cube.npy: must hold an array of numbers of two axes, got shape \(2, 3, 4\)"):
        psf_of("cube.npy", (tmp_path / "cube.npy").read_bytes())
    objects = tmp_path / "objects.npy"
    np.save(objects, np.array([[{}]], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match=r"objects.npy: cannot be read as a NumPy array"):
        psf_of("objects.npy", objects.read_bytes())
    with pytest.raises(InputError, match=r"gone.npy: cannot be read"):
        ws.Optics(aperture_m=0.4, psf="table", psf_file=str(tmp_path / "gone.npy"), psf_oversample=2.0).file_checksums  # noqa: B018


def test_a_missing_file_is_found_before_any_work(tmp_path):
    scene = ws.Scene.load("stss").replace(
        optics__psf="table", optics__psf_file=str(tmp_path / "gone.npy"), optics__psf_oversample=2.0
    )
    scene.save(tmp_path / "scene.toml")
    with pytest.raises(InputError, match=r"^optics.psf_file: .*gone.npy: cannot be read"):
        ws.Renderer(ws.Scene.load(tmp_path / "scene.toml"))


@pytest.mark.parametrize("smear_px", [1e-6, 1e-3, 0.0137, 0.02])
def test_a_blur_far_below_a_sample_loses_no_light(smear_px):
    profile = np.exp(-0.5 * ((np.arange(41) - 20) / 5.0) ** 2)
    image = np.outer(profile, profile)
    still, blurred = (
        ws.deposit([[20.3, 19.8]], [1.0], ws.PsfTable(image, 5, smear), (41, 41)) for smear in (0.0, smear_px)
    )
    assert blurred.sum() == pytest.approx(still.sum(), abs=2e-6)
    np.testing.assert_allclose(blurred, still, rtol=0, atol=2e-6 + smear_px**2)


def test_a_file_that_has_changed_is_read_again(tmp_path, scene):
    """As when somebody tunes a pattern in a notebook."""
    path = tmp_path / "psf.npy"
    optics = {"aperture_m": 0.4, "psf": "table", "psf_file": str(path), "psf_oversample": 3.0}
    found = []
    for width in (3, 5):
        np.save(path, np.ones((width, width)))
        tuned = scene.replace(optics=optics)
        found.append((tuned.scenario.instrument.psf("A").image.shape, tuned.optics.file_checksums[str(path)]))
        assert found[-1][1] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert [shape for shape, _ in found] == [(3, 3), (5, 5)]
