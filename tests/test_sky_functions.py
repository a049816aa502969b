"""Functions of the user's as maps of the sky, and what check says of maps: errors in one line, resumed runs."""

import importlib
import shutil
import sys

import numpy as np
import pytest
from sky_map_files import image_file

import warpsim as ws
from warpsim.background.fits_map import radiance_scales
from warpsim.background.user_maps import sky_map_plates
from warpsim.output.check import scene_report
from warpsim.scene.inputs import input_checksums

BAND = ws.bands()["A"]

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
