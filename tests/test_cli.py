"""The command line: help, reports, and one clear line with exit code 2 for every kind of bad input."""

import pytest

import warpsim as ws
from warpsim.cli import main


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def test_access_prints_the_intervals(capsys):
    code, out, _ = run(capsys, "access", "stss")
    assert code == 0
    assert "10 of 28 sensors have access" in out
    assert "sat11  243.303 1421.856" in out


def test_check_reports_a_valid_scene(capsys):
    code, out, _ = run(capsys, "check", "stss")
    assert code == 0
    assert "stss: valid. 28 sensors, 30 targets, bands A C E" in out
    assert "10 of 28 sensors, 587 views" in out


def test_check_explains_an_empty_run(capsys, tmp_path):
    path = tmp_path / "blind.toml"
    ws.Scene.load("stss").replace(access_rules__max_range_km=10.0).save(path)
    code, out, _ = run(capsys, "check", path)
    assert code == 0
    assert "nothing would be rendered" in out
    assert "too far 100%" in out


def test_check_doubts_an_impossible_flight(capsys, tmp_path):
    path = tmp_path / "fast.toml"
    ws.Scene.load("stss").replace(
        frames={"count": 2, "interval_s": 1.0},
        duration_s=150.0,
        trajectory__duration_s=150.0,
        trajectory__end_lon_lat_deg=[150.0, 42.0],
    ).save(path)
    code, out, _ = run(capsys, "check", path)
    assert code == 0
    assert "faster than escape speed" in out
    assert "dips below its end points" in out


def test_a_catalog_path_counts_from_the_scene_file(capsys, tmp_path, monkeypatch):
    path = tmp_path / "deep" / "mine.toml"
    path.parent.mkdir()
    ws.Scene.load("stss").save(path)
    path.write_text(path.read_text().replace('catalog = "default"', 'catalog = "stars.csv"'))
    (path.parent / "stars.csv").write_text("ra_deg,dec_deg,flux_A_jy\n10.0,20.0,5.0\n11.0,20.0,\n")
    monkeypatch.chdir("/")
    code, out, _ = run(capsys, "check", path)
    assert code == 0
    assert "2 stars, with light in band A 1, C 0, E 0" in out
    (path.parent / "stars.csv").unlink()
    code, _, err = run(capsys, "check", path)
    assert (code, err.count("\n")) == (2, 1)
    assert f"sky.catalog: {path.parent / 'stars.csv'}: " in err


def test_render_reports_what_where_and_how_fast(capsys, tmp_path):
    code, out, _ = run(capsys, "render", "stss", "-o", tmp_path / "o", "--frames", "60:62", "--sensors", "sat11")
    assert code == 0
    assert "6 images (1 sensor, bands A C E)" in out
    assert "images per second" in out


def bad_scene(tmp_path, old, new):
    """A scene file with one line of the preset changed."""
    path = tmp_path / "bad.toml"
    ws.Scene.load("stss").save(path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


BAD_SCENES = {
    "negative FOV": ("fov_deg = 1.0", "fov_deg = -1.0", "camera.fov_deg: must be in (0, 120), got -1.0"),
    "NaN": ("fov_deg = 1.0", "fov_deg = nan", "camera.fov_deg: must be finite, got nan"),
    "infinity": ("aperture_m = 0.4", "aperture_m = inf", "optics.aperture_m: must be finite, got inf"),
    "text": ("aperture_m = 0.4", 'aperture_m = "big"', "optics.aperture_m: must be a number, got 'big'"),
    "unknown band": ('"C"', '"Z"', "bands[1]: must be one of B1, B2, A, C, D, E, got 'Z'"),
    "misspelt field": ("aperture_m = 0.4", "apertur_m = 0.4", "optics.apertur_m: is not a known field (did you mean"),
    "missing field": ("duration_s = 1614.0\n", "", "duration_s: is required"),
    "unknown shape": ('kind = "sphere"', 'kind = "cube"', "targets[1].shape.kind: must be one of"),
    "negative radius": ("{ radius_m = 0.5,", "{ radius_m = -0.5,", "targets[1].shape.radius_m: must be > 0, got -0.5"),
    "reflectance above 1": ("reflectance = 0.9 ", "reflectance = 1.9 ", "must be in [0, 1], got 1.9"),
    "SEI below NEI": ("sei_w_cm2 = 3e-15", "sei_w_cm2 = 3e-19", "detector.sei_w_cm2: must be above nei_w_cm2"),
    "half a pixel": ("n_row = 128", "n_row = 128.5", "camera.n_row: must be a whole number, got 128.5"),
    "bad epoch": ('epoch_utc = "2025-01-01T14:00:00"', 'epoch_utc = "yesterday"', "epoch_utc: must be an ISO 8601"),
    "too long": ("duration_s = 1614.0\nbands", "duration_s = 2e9\nbands", "duration_s: must be at most trajectory.dur"),
    "flight shorter than the scene": (
        "duration_s = 1614.0\nendpoint", "duration_s = 1000.0\nendpoint", "duration_s: must be at most traj",
    ),
    "bad phasing": ("phasing = 2", "phasing = 4", "constellation.phasing"),
    "not TOML": ("duration_s = 1614.0", "duration_s = = 1", "is not valid TOML"),
}


@pytest.mark.parametrize("case", BAD_SCENES)
def test_bad_scene_files(capsys, tmp_path, case):
    old, new, message = BAD_SCENES[case]
    path, out_folder = bad_scene(tmp_path, old, new), tmp_path / "out"
    for arguments in (("check", path), ("render", path, "-o", out_folder), ("access", path)):
        code, out, err = run(capsys, *arguments)
        assert code == 2
        assert out == ""
        assert err.count("\n") == 1, err
        assert err.startswith(f"warpsim: {path}: ")
        assert message in err
    assert not out_folder.exists()


def test_missing_and_wrong_files(capsys, tmp_path):
    for name, message in (
        (tmp_path / "none.toml", "none.toml: cannot be read: No such file"),
        ("stsss", "stsss: must be a preset (stss) or a .toml or .json file"),
        (tmp_path, "must be a preset"),
    ):
        code, _, err = run(capsys, "render", name, "-o", tmp_path / "out")
        assert (code, err.count("\n")) == (2, 1)
        assert message in err
    missing = bad_scene(tmp_path, 'catalog = "default"', 'catalog = "/nowhere/stars.fits"')
    code, _, err = run(capsys, "render", missing, "-o", tmp_path / "out")
    assert (code, err.count("\n")) == (2, 1)
    assert "/nowhere/stars.fits" in err
    assert not (tmp_path / "out").exists()


def test_output_that_cannot_be_written(capsys, tmp_path):
    """A path through a file can never be a folder, not even for root."""
    (tmp_path / "file").write_text("")
    before = sorted(tmp_path.iterdir())
    for folder in (tmp_path / "file", tmp_path / "file" / "deep" / "out"):
        code, out, err = run(capsys, "render", "stss", "-o", folder)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert f"{folder}: cannot be written" in err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--frames", "5:x"], "--frames: must be A:B"),
        (["--frames", "1:2:3:4"], "--frames: must be A:B"),
        (["--frames", "9999"], "frames: frame 9999 is at 99990 s"),
        (["--frames", "170:9999"], "frames: must name at least one"),
        (["--frames", "5:5"], "frames: must name at least one"),
        (["--frames", "0:3"], "no sensor has access"),
        (["--sensors", "sat99"], "sensors: must be among"),
        (["--bands", "A,Q"], "bands: must be among A, C, E, got 'Q'"),
        (["--device", "cuda:7"], "device: must be one of"),
    ],
)
def test_bad_options(capsys, tmp_path, arguments, message):
    code, _, err = run(capsys, "render", "stss", "-o", tmp_path / "out", *arguments)
    assert (code, err.count("\n")) == (2, 1)
    assert message in err
    assert not (tmp_path / "out").exists()


def test_unknown_command_and_version(capsys):
    with pytest.raises(SystemExit) as caught:
        main(["paint"])
    assert caught.value.code == 2
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert ws.__version__ in capsys.readouterr().out
