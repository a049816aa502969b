"""Maps of the sky as files and functions hold them: where their light is, and what is refused."""

import importlib
import shutil
import sys

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS

import warpsim as ws
from warpsim.background.map_units import radiance_scales
from warpsim.background.sky_map import sky_map_plates
from warpsim.scene.inputs import input_checksums

BAND = ws.bands()["A"]


def image_file(
    path, projection="TAN", system="RADEC", crval=(10, 20), shape=(64, 64), pixel_deg=0.1, data=None, **header
):
    """A FITS image of ones in MJy/sr about a direction."""
    first, second = {"RADEC": ("RA--", "DEC-"), "GAL": ("GLON", "GLAT")}[system]
    wcs = WCS(naxis=2)
    wcs.wcs.ctype = [f"{first}-{projection}", f"{second}-{projection}"]
    wcs.wcs.crval, wcs.wcs.cdelt = list(crval), [-pixel_deg, pixel_deg]
    wcs.wcs.crpix = [shape[1] / 2 + 0.5, shape[0] / 2 + 0.5]
    for name, value in {**wcs.to_header(), "BUNIT": "MJy/sr", **header}.items():
        header[name] = value
    fits.writeto(path, np.ones(shape) if data is None else data, fits.Header(header), overwrite=True)
    return str(path)


def looked_up(plates, lines):
    """Values of the first band on plates in MJy/sr, as the kernel does: bilinear between nodes, 0 off all plates."""
    found = np.zeros(len(lines))
    for plate in plates:
        x, y, z = plate.axes @ lines.T
        values, n = plate.radiance_w_cm2_sr[0], plate.radiance_w_cm2_sr.shape[-1]
        on = (z > 0) & (np.abs(x) <= z * plate.half_width) & (np.abs(y) <= z * plate.half_width)
        place = (np.stack([x[on], y[on]]) / z[on] / plate.half_width + 1) * (n - 1) / 2
        col, row = np.clip(place.astype(int), 0, n - 2)
        u, v = place - [col, row]
        upper, lower = ((1 - u) * values[r, col] + u * values[r, col + 1] for r in (row, row + 1))
        found[on] = (1 - v) * upper + v * lower
    return found / radiance_scales("MJy/sr", [BAND])[0]


def lines_of(n=4000, seed=5):
    lines = np.random.default_rng(seed).normal(size=(n, 3))
    return lines / np.linalg.norm(lines, axis=1, keepdims=True)


@pytest.mark.parametrize("system", ["RADEC", "GAL"])
@pytest.mark.parametrize(
    ("projection", "pixel_deg", "crval"),
    [("CAR", 1.0, (180, 0)), ("CAR", 1.0, (0, 0)), ("AIT", 0.9, (0, 0)), ("MOL", 0.9, (40, 0))],
)
def test_maps_of_the_whole_sky_are_there_in_all_directions(tmp_path, projection, pixel_deg, crval, system):
    path = image_file(tmp_path / "m.fits", projection, system, crval, (180, 360), pixel_deg)
    light = looked_up(sky_map_plates(path, [BAND]), lines_of())
    np.testing.assert_allclose(light, 1.0, rtol=1e-9)


def test_a_map_whose_columns_go_round_from_0_to_360_degrees_is_whole(tmp_path):
    columns = np.mgrid[:180, :360][1]
    path = image_file(
        tmp_path / "m.fits", "CAR", crval=(0, 0), shape=(180, 360), pixel_deg=1.0,
        data=2.0 + np.cos(np.radians(columns)), CRPIX1=1.0, CDELT1=1.0,
    )  # fmt: skip
    lines = lines_of()
    lines = lines[np.abs(lines[:, 2]) < 0.9]
    expected = 2.0 + lines[:, 0] / np.hypot(lines[:, 0], lines[:, 1])
    np.testing.assert_allclose(looked_up(sky_map_plates(path, [BAND]), lines), expected, rtol=0.01)


def test_pixels_off_the_sky_need_no_values(tmp_path):
    shape = (180, 360)
    path = image_file(tmp_path / "m.fits", "AIT", "GAL", (0, 0), shape, 0.9)
    wcs = WCS(fits.getheader(path))
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    data = np.where(np.isfinite(wcs.wcs_pix2world(columns.ravel(), rows.ravel(), 0)[0]).reshape(shape), 3.0, np.nan)
    assert 0.1 < np.isnan(data).mean() < 0.5
    with fits.open(path, mode="update") as hdus:
        hdus[0].data = data
    light = looked_up(sky_map_plates(path, [BAND]), lines_of())
    assert np.mean(np.abs(light - 3.0) < 1e-6) > 0.995


def test_a_strip_round_the_sky_is_a_strip(tmp_path):
    path = image_file(tmp_path / "m.fits", "CAR", crval=(0, 0), shape=(20, 360), pixel_deg=1.0)
    lines = lines_of()
    off_deg = np.abs(np.degrees(np.arcsin(lines[:, 2]))) - 10
    light = looked_up(sky_map_plates(path, [BAND]), lines)
    np.testing.assert_allclose(light[off_deg < -1], 1.0, rtol=1e-9)
    assert not light[off_deg > 1].any()


@pytest.mark.parametrize("projection", ["SIN", "ZEA", "STG"])
def test_a_hemisphere_whose_corners_are_off_the_sky(tmp_path, projection):
    path = image_file(tmp_path / "m.fits", projection, shape=(400, 400), pixel_deg=0.3)
    ra, dec = np.radians([10, 20])
    middle = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    lines = lines_of()
    cosine = lines @ middle
    light = looked_up(sky_map_plates(path, [BAND]), lines)
    np.testing.assert_allclose(light[cosine > np.cos(np.radians(55))], 1.0, rtol=1e-9)
    if projection == "SIN":
        assert not light[cosine < -0.05].any()


def test_a_small_map_is_on_one_plate_and_not_behind_it(tmp_path):
    plates = sky_map_plates(image_file(tmp_path / "m.fits"), [BAND])
    assert len(plates) == 1
    assert 0.0004 < looked_up(plates, lines_of(40_000)).mean() < 0.0018  # 41 of 41,253 square degrees


# --- detail ---


@pytest.mark.parametrize(("odd", "floor"), [(0, 0.99), (1, 0.99), (0.37, 0.56)])
def test_a_bright_pixel_keeps_its_peak_and_its_light(tmp_path, odd, floor):
    data = np.zeros((24, 25))
    data[11, 13] = 1.0
    crpix = 13 + odd
    path = image_file(tmp_path / "m.fits", shape=(24, 25), pixel_deg=0.25, data=data, CRPIX1=crpix, CRPIX2=12.5 + odd)
    (plate,) = sky_map_plates(path, [BAND])
    values = plate.radiance_w_cm2_sr[0] / radiance_scales("MJy/sr", [BAND])[0]
    assert floor < values.max() <= 1.0 + 1e-9
    assert values.sum() * plate.step_rad**2 == pytest.approx(np.radians(0.25) ** 2, rel=0.02)


def test_pixels_finer_than_the_largest_plate_are_averaged(tmp_path, monkeypatch):
    monkeypatch.setattr("warpsim.background.sky_plates.MOST_NODES", 65)
    data = np.zeros((512, 512))
    data[::2, ::2] = 4.0  # of mean 1
    (plate,) = sky_map_plates(image_file(tmp_path / "m.fits", shape=(512, 512), pixel_deg=0.001, data=data), [BAND])
    values = plate.radiance_w_cm2_sr[0] / radiance_scales("MJy/sr", [BAND])[0]
    assert values.shape == (65, 65)
    np.testing.assert_allclose(values[16:-16, 16:-16], 1.0, atol=0.2)  # six columns of eleven are lit
    assert values[16:-16, 16:-16].mean() == pytest.approx(1.0, rel=0.01)


# --- functions ---

MODULE = """
import sys
import numpy as np
number = 5
def glow(direction, band): return np.full(len(direction), LEVEL)
def raises(direction, band): return 1 / 0
def one_argument(direction): return np.ones(len(direction))
def text(direction, band): return ["a"] * len(direction)
def nothing(direction, band): return None
def nan(direction, band): return np.where(direction[:, 2] > 0.5, np.nan, 1.0)
def negative(direction, band): return -np.ones(len(direction))
def huge(direction, band): return np.full(len(direction), 1e39)
def shape(direction, band): return np.ones((3, 2))
def ragged(direction, band): return [[1.0], [1.0, 2.0]]
def complex_number(direction, band): return np.ones(len(direction), dtype=complex)
def leaves(direction, band): sys.exit(3)
def several_lines(direction, band): raise ValueError("one\\ntwo")
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Write a module under a name of its own; each call replaces what Python remembers of it."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(text, name="own_glow"):
        (tmp_path / f"{name}.py").write_text(text)
        sys.modules.pop(name, None)
        importlib.invalidate_caches()
        shutil.rmtree(tmp_path / "__pycache__", ignore_errors=True)
        return name

    return write


@pytest.mark.parametrize(
    ("function", "words"),
    [
        ("raises", r"fails in band A \(ZeroDivisionError: division by zero\), got 'python:own_glow:raises'"),
        ("one_argument", r"fails in band A \(TypeError: one_argument\(\) takes 1 positional argument but 2"),
        ("several_lines", r"fails in band A \(ValueError: one\)"),
        ("ragged", r"fails in band A \(ValueError: "),
        ("leaves", r"fails in band A \(SystemExit: 3\)"),
        ("text", r"must return plain numbers \[W/cm2/sr\], returned list of <U1"),
        ("nothing", r"must return plain numbers \[W/cm2/sr\], returned NoneType of object"),
        ("complex_number", r"must return plain numbers \[W/cm2/sr\], returned ndarray of complex128"),
        ("shape", r"must return 32,761 radiances of 0 or more for as many directions, returned shape \(3, 2\)"),
        ("nan", r"must return finite radiances of 0 or more that float32 holds, returned nan in direction \("),
        ("negative", r"must return finite radiances of 0 or more that float32 holds, returned -1 in direction \("),
        ("huge", r"must return finite radiances of 0 or more that float32 holds, returned 1e\+39 in direction \("),
        ("number", r"must be a function, but is of type int, got 'python:own_glow:number'"),
        ("none_such", r"cannot be imported \(AttributeError: module 'own_glow' has no attribute 'none_such'\)"),
    ],
)
def test_functions_that_are_no_maps_are_one_line(module, function, words):
    name = f"python:{module(MODULE)}:{function}"
    with pytest.raises(ws.InputError, match=rf"^background.sky_map: {words}") as caught:
        sky_map_plates(name, [BAND])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "name", "words"),
    [
        ("def f(:", "python:own_glow:f", r"cannot be imported \(SyntaxError: "),
        ("1 / 0", "python:own_glow:f", r"cannot be imported \(ZeroDivisionError: division by zero\)"),
        ("raise SystemExit(2)", "python:own_glow:f", r"cannot be imported \(SystemExit: 2\)"),
        ("", "python:.own_glow:f", r'must be of the form "python:module:function", with the whole name of a module'),
        ("", "python:no_such_one:f", r"cannot be imported \(ModuleNotFoundError: No module named 'no_such_one'\)"),
    ],
)
def test_modules_that_cannot_be_imported_are_one_line(module, text, name, words):
    module(text)
    with pytest.raises(ws.InputError, match=f"^background.sky_map: {words}") as caught:
        sky_map_plates(name, [BAND])
    assert "\n" not in str(caught.value)


def test_a_run_with_another_function_is_another_run(module, tmp_path):
    scene = ws.Scene.load("stss").replace(sky__catalog="none", camera={"n_row": 8, "n_col": 8, "fov_deg": 4.0})
    own = scene.replace(background__sky_map=f"python:{module(MODULE.replace('LEVEL', '1e-12'))}:glow")
    asked = {"frames": [60], "sensors": "sat11", "bands": ["A"]}
    ws.render_to_folder(own, tmp_path / "out", **asked)
    ws.render_to_folder(own, tmp_path / "out", **asked)  # the same: nothing to do
    before = input_checksums(own.scenario)
    module(MODULE.replace("LEVEL", "1e-12") + "\n# a remark")
    assert input_checksums(own.scenario) == before
    module(MODULE.replace("LEVEL", "2e-12"))
    assert input_checksums(own.scenario).keys() == before.keys()
    assert input_checksums(own.scenario) != before
    with pytest.raises(ws.InputError, match="inputs"):
        ws.render_to_folder(own, tmp_path / "out", **asked)
