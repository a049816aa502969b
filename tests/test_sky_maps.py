"""Maps of the sky in files and functions of the user: where their light is, what is refused, what check says."""

import importlib
import shutil
import sys

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS
from sky_map_files import image_file

import warpsim as ws
from warpsim.background.fits_map import radiance_scales
from warpsim.background.user_maps import sky_map_plates
from warpsim.output.check import scene_report
from warpsim.scene.provenance import input_checksums

BAND = ws.bands()["A"]


def looked_up(plates, lines):
    """Values of the first band on plates in MJy/sr, as the kernel does: bilinear between nodes, 0 off all plates."""
    found = np.zeros(len(lines))
    for plate in plates:
        x, y, z = plate.axes @ lines.T
        values, n = plate.radiance_w_cm2_sr[0], plate.radiance_w_cm2_sr.shape[-1]
        on = (z > 0) & (np.abs(x) <= z * plate.half_width) & (np.abs(y) <= z * plate.half_width)
        position = (np.stack([x[on], y[on]]) / z[on] / plate.half_width + 1) * (n - 1) / 2
        col, row = np.clip(position.astype(int), 0, n - 2)
        u, v = position - [col, row]
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
    path = image_file(tmp_path / "m.fits", projection, shape=(150, 150), pixel_deg=0.8)
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


# --- files that are no maps, and those that are in another form ---


def healpix_file(path, columns=None, n_side=8, drop=(), **header):
    """A table of HEALPix pixels, of ones in MJy/sr."""
    columns = columns or [fits.Column("I", "E", unit="MJy/sr", array=np.ones(12 * n_side**2))]
    table = fits.BinTableHDU.from_columns(columns)
    own = {"PIXTYPE": "HEALPIX", "NSIDE": n_side, "ORDERING": "RING", "COORDSYS": "C"} | header
    for name, value in own.items():
        if name not in drop:
            table.header[name] = value
    table.writeto(path, overwrite=True)
    return str(path)


def refused(path, words):
    with pytest.raises(ws.InputError, match=f"^background.sky_map: [^ ]*: {words}") as caught:
        sky_map_plates(str(path), [BAND])
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


ONES = np.ones((64, 64))
ONE_BELOW = np.where(np.arange(64) == 7, -1e-9, ONES)


@pytest.mark.parametrize(
    ("data", "header", "words"),
    [
        (-ONES, {}, r"must hold no negative values and 4,095 more; clip them at 0, got -1 in row 0, column 0"),
        (ONE_BELOW, {}, r"must hold no negative values and 63 more; clip them at 0, got -1e-09 in row 0, column 7"),
        (np.full((64, 64), np.nan), {}, "must hold a finite value, and has none"),
        (np.full((64, 64), 1e43), {"BUNIT": "W/m2/sr"}, r"must hold radiances up to 3.4e\+38 W/cm2/sr"),
        (np.ones((2, 64, 64)), {}, r"NAXIS: an image must be one plane of longitude and latitude; .*\(2, 64, 64\)"),
        (ONES, {"BUNIT": "Jy/beam"}, "unit: its unit .* surface brightness"),
        (ONES, {"CTYPE1": "X", "CTYPE2": "Y"}, "CTYPE1: an image must have a celestial WCS, got 'X'"),
    ],
)
def test_images_that_are_no_maps_are_one_line(tmp_path, data, header, words):
    refused(image_file(tmp_path / "m.fits", data=data, **header), words)


def test_an_image_of_one_plane_and_more_axes_is_a_map(tmp_path):
    path = image_file(tmp_path / "m.fits", data=np.ones((1, 1, 64, 64)))
    assert len(sky_map_plates(path, [BAND])) == 1


def test_the_map_may_be_in_an_extension_and_its_unit_in_the_first_header(tmp_path):
    with fits.open(image_file(tmp_path / "m.fits", data=3.0 * ONES)) as hdus:
        data, header = hdus[0].data, hdus[0].header
        del header["BUNIT"]
        for first in (fits.PrimaryHDU(), fits.PrimaryHDU(np.ones((4, 4)))):
            first.header["BUNIT"] = "MJy/sr"
            for kind in (fits.ImageHDU, fits.CompImageHDU):
                fits.HDUList([first, kind(data, header)]).writeto(tmp_path / "own.fits", overwrite=True)
                (plate,) = sky_map_plates(str(tmp_path / "own.fits"), [BAND])
                scale = radiance_scales("MJy/sr", [BAND])[0]
                assert plate.radiance_w_cm2_sr.max() == pytest.approx(3.0 * scale, rel=1e-3)


@pytest.mark.parametrize("content", [b"", b"hello", b"SIMPLE  =                    T"])
def test_files_that_are_damaged_are_one_line(tmp_path, content):
    (tmp_path / "m.fits").write_bytes(content)
    refused(tmp_path / "m.fits", "")


def test_a_file_that_ends_early_is_one_line(tmp_path):
    whole = (tmp_path / "m.fits", image_file(tmp_path / "m.fits"))[0].read_bytes()
    (tmp_path / "m.fits").write_bytes(whole[:9000])
    refused(tmp_path / "m.fits", "ends early: the FITS data are cut off")


def column(name="I", unit="MJy/sr", kind="E", array=None):
    return fits.Column(name, kind, unit=unit, array=np.ones(768) if array is None else array)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"drop": ["COORDSYS"]}, "COORDSYS: must be one of G, GALACTIC, .* and is missing"),
        ({"COORDSYS": "X"}, "COORDSYS: must be one of G, GALACTIC, .*, got 'X'"),
        ({"drop": ["ORDERING"]}, "ORDERING: must be one of RING, NESTED, NEST, and is missing"),
        ({"ORDERING": "NUNIQ"}, "ORDERING: must be one of RING, NESTED, NEST, got 'NUNIQ'"),
        ({"drop": ["NSIDE"]}, "NSIDE: must be a power of 2, and is missing"),
        ({"NSIDE": 0}, "NSIDE: must be a power of 2, got"),
        ({"NSIDE": "abc"}, "NSIDE: must be a power of 2, got"),
        ({"NSIDE": 7}, "NSIDE: must be a power of 2, got 7"),
        ({"NSIDE": 16}, "I: must hold 3,072 HEALPix pixels for this NSIDE, got 768"),
        ({"INDXSCHM": "EXPLICIT"}, "columns: must have a column PIXEL where INDXSCHM is EXPLICIT"),
        ({"columns": [column(unit="K_CMB")]}, "I.unit: its unit .* surface brightness"),
        ({"columns": [column(unit=None)]}, "I.unit: its unit .* surface brightness"),
        ({"columns": [column(array=-np.ones(768))]}, "I: must hold no negative values .* got -1 in pixel 0"),
        ({"columns": [column(kind="C")]}, "I: must hold real numbers, got "),
        (
            {"columns": [column("PIXEL", None, "J", np.full(768, 900)), column()]},
            "PIXEL: must be from 0 to 767 for this NSIDE, got 900",
        ),
        ({"columns": [column("PIXEL", None, "J", np.full(768, 9)), column()]}, "PIXEL: must name each pixel once"),
    ],
)
def test_tables_that_are_no_maps_are_one_line(tmp_path, change, words):
    pytest.importorskip("astropy_healpix")
    refused(healpix_file(tmp_path / "m.fits", **change), words)


@pytest.mark.parametrize("unit", ["MJy/sr", None])
def test_a_table_of_some_pixels_lies_where_their_numbers_say(tmp_path, unit):
    healpix = pytest.importorskip("astropy_healpix")
    lines = lines_of()
    grid = healpix.HEALPix(8, "ring", frame="icrs")
    north = np.arange(grid.npix // 2 - 16)[::-1]  # above the equator, in any order
    columns = [column("PIXEL", None, "J", north), column("I", unit, array=np.ones(len(north)))]
    path = healpix_file(tmp_path / "m.fits", columns, INDXSCHM="EXPLICIT", BUNIT="MJy/sr")
    light = looked_up(sky_map_plates(path, [BAND]), lines)
    np.testing.assert_allclose(light[lines[:, 2] > 0.25], 1.0, rtol=1e-9)
    assert not light[lines[:, 2] < -0.25].any()


@pytest.mark.parametrize("ordering", ["RING", "NESTED"])
def test_healpix_pixels_finer_than_the_largest_cube_are_averaged(tmp_path, monkeypatch, ordering):
    healpix = pytest.importorskip("astropy_healpix")
    monkeypatch.setattr("warpsim.background.fits_map._MOST_NSIDE", 16)
    grid = healpix.HEALPix(64, ordering.lower(), frame="icrs")
    position = np.arange(grid.npix) if ordering == "NESTED" else grid.ring_to_nested(np.arange(grid.npix))
    columns = [column(array=np.where(position % 4 == 0, 4.0, 0.0))]  # of mean 1
    path = healpix_file(tmp_path / "m.fits", columns, 64, ORDERING=ordering)
    np.testing.assert_allclose(looked_up(sky_map_plates(path, [BAND]), lines_of()), 1.0, rtol=1e-9)


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


@pytest.mark.ci
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


def test_check_says_the_size_of_the_map_in_each_band(module, tmp_path):
    scene = ws.Scene.load("stss").replace(sky__catalog="none")
    instrument = next(iter(scene.scenario.instruments.values()))
    camera = instrument.sensor.camera
    nei = instrument.nei_w_cm2("A") * camera.focal_px * camera.focal_row_px
    data = np.ones((64, 64))
    data[3, 5], data[9, 9] = 50.0, np.nan
    path = image_file(tmp_path / "m.fits", data=data)
    ends = [f"{times * radiance_scales('MJy/sr', [BAND])[0] / nei:.2g}" for times in (1, 50)]
    report = scene_report(scene.replace(background__sky_map=path).scenario)
    assert f"  background map {path}, median to maximum: A {ends[0]} to {ends[1]}, " in report
    name = f"python:{module(MODULE.replace('LEVEL', '1e-9'))}:glow"
    report = scene_report(scene.replace(background__sky_map=name).scenario)
    assert f"  background map {name}, median to maximum: A {1e-9 / nei:.2g} to {1e-9 / nei:.2g}, " in report


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("no-such.fits", "must be a file that exists"),
        ("broken.fits", "must be FITS, which begins with SIMPLE"),
        ("python:own_glow:raises", "fails in band A"),
    ],
)
def test_check_tries_the_map(module, tmp_path, monkeypatch, name, words):
    module(MODULE)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.fits").write_bytes(b"SIMPLE")
    own = ws.Scene.load("stss").replace(sky__catalog="none", background__sky_map=name)
    with pytest.raises(ws.InputError, match=f"^background.sky_map: .*{words}"):
        scene_report(own.scenario)
