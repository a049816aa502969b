"""The command line: help, reports, and one clear line with exit code 2 for every kind of bad input."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import printed, refused, run

import warpsim as ws
from warpsim.cli import main
from warpsim.output.star_catalogs import catalog_report

LONG = "x" * 300  # letters, more than a name may have


def test_access_prints_the_intervals(capsys):
    out = printed(capsys, "access", "stss")
    assert "10 of 28 sensors have access, " in out
    assert re.search(r"^ *sat11 +center +243\.303 +1421\.856 +1178\.55[234]$", out, re.MULTILINE)
    total_s = sum(float(row.split()[4]) for row in out.splitlines()[3:-1] if row.split()[0].startswith("sat"))
    assert float(out.splitlines()[-1].split()[-4]) == pytest.approx(total_s, abs=0.06)


def test_access_of_some_sensors_to_another_target(capsys):
    other = ws.Scene.load("stss").target_names[3]
    out = printed(capsys, "access", "stss", "--target", other, "--sensors", "sat11,sat12", "--step", "30")
    assert out.startswith(f"stss: access to {other}, ")
    assert " of 2 sensors have access" in out
    assert set(re.findall(r"^ *(sat\d+) ", out, re.MULTILINE)) <= {"sat11", "sat12"}


@pytest.mark.parametrize("form", ["csv", "ecsv"])
def test_access_as_a_file_to_read(capsys, form):
    from astropy.table import Table

    out = printed(capsys, "access", "stss", "--format", form)
    table, expected = Table.read(out, format=f"ascii.{form}"), ws.Scene.load("stss").access()
    assert table.colnames == expected.colnames and list(table["sensor"]) == list(expected["sensor"])
    assert max(abs(table["end_s"] - expected["end_s"])) < 0.00051
    if form == "ecsv":
        assert table["start_s"].unit == "s"
        assert table.meta["rules"] == expected.meta["rules"] and table.meta["target"] == "center"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--target", "sat11"], "target: must be a target of the scene (center, sphere01,"),
        (["--sensors", "sat99"], "sensors: must be sensors of the scene (sat11, sat12,"),
        (["--format", "pdf"], "--format: must be table, csv or ecsv, got 'pdf'"),
        (["--step", "0"], "--step: must be > 0, got '0'"),
        (["--step", "often"], "--step: must be a number, got 'often'"),
    ],
)
def test_bad_options_of_access(capsys, arguments, message):
    assert message in refused(capsys, "access", "stss", *arguments)


def test_check_reports_a_valid_scene(capsys):
    out = printed(capsys, "check", "stss")
    assert "stss: valid. 28 sensors, 30 targets, bands A C E" in out
    assert "10 of 28 sensors, 587 views" in out


def test_check_explains_an_empty_run(capsys, tmp_path):
    path = tmp_path / "blind.toml"
    ws.Scene.load("stss").replace(access_rules__max_range_km=10.0).save(path)
    out = printed(capsys, "check", path)
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
    out = printed(capsys, "check", path)
    assert "faster than escape speed" in out
    assert "dips below its end points" in out


def test_a_catalog_path_counts_from_the_scene_file(capsys, tmp_path, monkeypatch):
    path = tmp_path / "deep" / "mine.toml"
    path.parent.mkdir()
    ws.Scene.load("stss").save(path)
    path.write_text(path.read_text().replace('catalog = "default"', 'catalog = "stars.csv"'))
    (path.parent / "stars.csv").write_text("ra_deg,dec_deg,flux_A_jy\n10.0,20.0,5.0\n11.0,20.0,\n")
    monkeypatch.chdir("/")
    out = printed(capsys, "check", path)
    assert "2 stars, with light in band A 1, C 1, E 1" in out  # C and E are filled from A
    (path.parent / "stars.csv").unlink()
    assert f"sky.catalog: {path.parent / 'stars.csv'}: " in refused(capsys, "check", path)


@pytest.mark.ci
def test_render_reports_what_where_and_how_fast(capsys, tmp_path):
    out = printed(capsys, "render", "stss", "-o", tmp_path / "o", "--frames", "60:62", "--sensors", "sat11")
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
    "unknown band": ('"C"', '"Z"', "bands[1]: must be a shipped band (B1, "),
    "misspelt field": ("aperture_m = 0.4", "apertur_m = 0.4", "optics.apertur_m: is not a known field (did you mean"),
    "missing field": ("duration_s = 1614.0\n", "", "duration_s: is required"),
    "unknown shape": ('kind = "sphere"', 'kind = "cube"', "targets[1].shape.kind: must be one of"),
    "negative radius": ("{ radius_m = 0.5,", "{ radius_m = -0.5,", "targets[1].shape.radius_m: must be > 0, got -0.5"),
    "reflectance above 1": ("reflectance = 0.9 ", "reflectance = 1.9 ", "must be in [0, 1], got 1.9"),
    "SEI below NEI": ("sei_w_cm2 = 3e-15", "sei_w_cm2 = 3e-19", "detector.sei_w_cm2: must be above nei_w_cm2"),
    "half a pixel": ("n_row = 128", "n_row = 128.5", "camera.n_row: must be a whole number, got 128.5"),
    "bad epoch": ('epoch_utc = "2025-01-01T14:00:00"', 'epoch_utc = "yesterday"', "epoch_utc: must be an ISO 8601"),
    "too long": ("duration_s = 1614.0\naccess", "duration_s = 2e9\naccess", "duration_s: "),
    "flight into the ground": (
        "duration_s = 1614.0\nendpoint",
        "duration_s = 1000.0\nendpoint",
        "trajectory.duration_s: 1000 s gives a flight",
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
        ("stsss", "stsss: must be a preset (stss, two_cameras, visible_to_lwir) or a .toml or .json file"),
        (tmp_path, "must be a preset"),
    ):
        assert message in refused(capsys, "render", name, "-o", tmp_path / "out")
    missing = bad_scene(tmp_path, 'catalog = "default"', 'catalog = "/nowhere/stars.fits"')
    assert "/nowhere/stars.fits" in refused(capsys, "render", missing, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.ci
def test_output_that_cannot_be_written(capsys, tmp_path):
    """A path through a file can never be a folder, not even for root."""
    (tmp_path / "file").write_text("")
    before = sorted(tmp_path.iterdir())
    for folder in (tmp_path / "file", tmp_path / "file" / "deep" / "out"):
        assert f"{folder}: cannot be written" in refused(capsys, "render", "stss", "-o", folder)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--frames", "5:x"], "--frames: must be A:B"),
        (["--frames", "1:2:3:4"], "--frames: must be A:B"),
        (["--frames", "9999"], "frames: frame 9999 is at 99990 s"),
        (["--frames", "170:9999"], "frames: must name at least one; the scene has 0 to 161"),
        (["--frames", "5:5"], "frames: must name at least one"),
        (["--frames", "0:3"], "no sensor has access"),
        (["--sensors", "sat99"], "sensors: must be sensors of the scene"),
        (["--bands", "A,Q"], "bands: must be among A, C, E, got 'Q'"),
        (["--device", "cuda:7"], "device: must be "),
    ],
)
def test_bad_options(capsys, tmp_path, arguments, message):
    assert message in refused(capsys, "render", "stss", "-o", tmp_path / "out", *arguments)
    assert not (tmp_path / "out").exists()


@pytest.mark.ci
def test_render_writes_the_stars_when_asked(capsys, tmp_path):
    from astropy.table import Table

    for flags, expected in (([], False), (["--stars"], True)):
        out = tmp_path / f"with{expected}"
        code, _, err = run(capsys, "render", "stss", "-o", out, "--frames", "60", "--sensors", "sat11", *flags)
        assert (code, (out / "stars.fits").exists()) == (0, expected), err
    assert "catalog_row" in Table.read(tmp_path / "withTrue" / "stars.fits").colnames


# --- warpsim catalog ---

STARS_CSV = """ra_deg,dec_deg,flux_A_jy,flux_E_jy,pm_ra_mas_yr,pm_dec_mas_yr,parallax_mas,quality,id
10.0,20.0,58.49,0.1,3000,-4000,250,4,Runner
11.0,20.0,5.849,,0,0,,2,Stander
11.0,21.0,,0.0,0,0,,,Dark
,21.0,1.0,,0,0,,,Nowhere
"""


@pytest.fixture
def stars_csv(tmp_path):
    path = tmp_path / "stars.csv"
    path.write_text(STARS_CSV)
    return path


def words(line):
    return line.replace(",", "").split()


def rows_after(out, first_word):
    """The table under the line that begins with a word: rows as lists of words, by their first."""
    lines = out.splitlines()
    start = next(i for i, line in enumerate(lines) if line.split()[:1] == [first_word])
    rows = []
    for line in lines[start + 1 :]:
        if not line.strip():
            break
        rows.append(words(line))
    return words(lines[start]), rows


def test_catalog_tells_what_the_default_holds(capsys):
    code, out, err = run(capsys, "catalog", "default")
    assert (code, err) == (0, "")
    sky = ws.StarCatalog.default()
    assert out.startswith("hip-gaia-ir v2: 177,860 stars, positions at J2000.0\n")
    assert "CC BY-SA 3.0 IGO" in " ".join(out.split())
    assert "4.31 per deg2 over the whole sky" in out
    assert "the fastest HIP 87937, 10.3" in out  # Barnard's star
    _, bands = rows_after(out, "band")
    assert {row[0] for row in bands} == {*ws.BANDS, "G", "Hp"}
    measured = {"G": sky.flux_flag("G") == 1, "Hp": sky.flux_flag("Hp") == 1}
    assert (measured["G"] ^ measured["Hp"]).all()
    for row in bands:
        flux = sky.flux_jy(row[0])
        n_measured = int(measured[row[0]].sum()) if row[0] in measured else 0
        assert row[2:5] == [str(n_measured), str(177_860 - n_measured), "0"]
        assert [float(row[5]), float(row[7])] == pytest.approx([flux.min(), flux.max()], rel=5e-4)
    header, magnitudes = rows_after(out, "magnitude")
    assert set(header[1:]) >= set(ws.BANDS)
    counts = {int(row[0]): [int(word) for word in row[3:]] for row in magnitudes}
    expected = np.histogram(np.round(sky.magnitude("A"), 6), np.arange(-10, 11))[0]
    assert [counts.get(m, [0] * len(header))[header.index("A") - 1] for m in range(-10, 10)] == expected.tolist()


def test_catalog_tells_densities_by_galactic_latitude(capsys):
    """Counted by astropy's galactic coordinates."""
    from astropy import units as u
    from astropy.coordinates import SkyCoord

    _, out, _ = run(capsys, "catalog", "default")
    text = " ".join(out.split())
    sky = ws.StarCatalog.default()
    latitude = np.abs(SkyCoord(sky.ra_deg * u.deg, sky.dec_deg * u.deg).galactic.b.deg)
    for low, high in ((0, 2), (2, 6), (6, 15), (15, 30), (30, 60), (60, 90)):
        area = 4 * np.pi * np.degrees(1) ** 2 * (np.sin(np.radians(high)) - np.sin(np.radians(low)))
        shown = float(text.split(f" {low}-{high}: ")[1].split()[0].rstrip(","))
        inside = np.count_nonzero((latitude >= low) & (latitude < high))
        assert shown == pytest.approx(inside / area, rel=6e-3)  # three digits


def test_catalog_of_a_file(capsys, stars_csv):
    code, out, err = run(capsys, "catalog", stars_csv, "--no-fill")
    assert (code, err) == (0, "")
    assert "3 stars, positions at J2000.0" in out
    assert "left out 1 of 4 stars without a finite position (lines 5)" in " ".join(out.split())
    assert "1 star with proper motion, the fastest Runner, 5.000 arcsec/yr; 1 with parallax" in " ".join(out.split())
    assert "0 (unknown) 1, 2 (fair) 1, 4 (excellent) 1" in out
    _, bands = rows_after(out, "band")
    by_band = {row[0]: row[2:] for row in bands}
    assert by_band["A"] == ["2", "0", "1", "5.849", "to", "58.49", "0.00", "to", "2.50"]
    assert by_band["C"] == ["0", "0", "3"]
    assert by_band["E"][:3] == ["2", "0", "1"] and by_band["E"][-4:] == ["1", "of", "flux", "0"]
    header, magnitudes = rows_after(out, "magnitude")
    assert header == ["magnitude", "A", "E"]
    assert magnitudes == [["0", "to", "1", "1", "0"], ["2", "to", "3", "1", "0"], ["4", "to", "5", "0", "1"]]


def test_catalog_fills_bands_unless_told_not_to(capsys, stars_csv):
    for flags, expected in (([], ["0", "3", "0"]), (["--no-fill"], ["0", "0", "3"])):
        _, out, _ = run(capsys, "catalog", stars_csv, *flags)
        assert next(row[2:5] for row in rows_after(out, "band")[1] if row[0] == "C") == expected


def test_catalog_of_a_small_field_gives_the_field(capsys, tmp_path):
    """Stars on a circle of half a degree: 100 of them in pi / 4 deg2."""
    turn = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    path = tmp_path / "field.csv"
    lines = [f"{150 + 0.5 * np.cos(t):.9f},{0.5 * np.sin(t):.9f},1.0" for t in turn]
    path.write_text("\n".join(["ra_deg,dec_deg,flux_A_jy", *lines, ""]))
    _, out, _ = run(capsys, "catalog", path)
    assert "all within 0.5 deg of (150.000, " in out
    assert ": 127 per deg2" in out


def test_catalog_takes_columns_by_other_names(capsys, tmp_path):
    path = tmp_path / "own.csv"
    path.write_text("RAJ2000,DEJ2000,F8\n10.0,20.0,5.849\n")
    out = printed(capsys, "catalog", path, "--columns", "ra_deg=RAJ2000, dec_deg=DEJ2000,flux_A_jy=F8")
    assert next(row for row in rows_after(out, "band")[1] if row[0] == "A")[2] == "1"


@pytest.mark.parametrize("suffix", [".fits", ".ecsv", ".vot", ".csv"])
def test_catalog_converts(capsys, tmp_path, stars_csv, suffix):
    out_path = tmp_path / f"out{suffix}"
    out = printed(capsys, "catalog", stars_csv, "-o", out_path)
    assert out.endswith(f"3 stars at J2000.0 in {out_path}\n")
    with pytest.warns(UserWarning, match="left out 1 of 4"):
        before = ws.StarCatalog.read(stars_csv)
    after = ws.StarCatalog.read(out_path)
    for key in ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas", "quality", "temperature_k"):
        np.testing.assert_array_equal(getattr(after, key), getattr(before, key), err_msg=key)
    for band in ws.BANDS:
        np.testing.assert_array_equal(after.flux_jy(band), before.flux_jy(band))
        np.testing.assert_array_equal(after.flux_flag(band), before.flux_flag(band))
    assert after.id.tolist() == ["Runner", "Stander", "Dark"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["stars.csv", out_path.name])


@pytest.mark.parametrize(
    ("suffix", "epoch_jyear"), [(".fits", 2016.0), (".ecsv", 2016.0), (".vot", 2000.0), (".csv", 2000.0)]
)
def test_files_without_an_epoch_are_written_at_j2000(tmp_path, suffix, epoch_jyear):
    from warpsim.output.star_catalogs import write_catalog

    catalog = ws.StarCatalog.from_arrays(
        [10.0], [20.0], {"A": [1.0]}, pm_ra_mas_yr=[5000.0], pm_dec_mas_yr=[0.0], epoch_jyear=2016.0
    )
    written = write_catalog(catalog, tmp_path / f"out{suffix}")
    again = ws.StarCatalog.read(tmp_path / f"out{suffix}")
    assert written.epoch_jyear == again.epoch_jyear == epoch_jyear
    assert again.ra_deg[0] == written.ra_deg[0]
    shift_arcsec = (10.0 - again.ra_deg[0]) * np.cos(np.radians(20.0)) * 3600
    assert shift_arcsec == pytest.approx(5.0 * (2016.0 - epoch_jyear), abs=1e-3)


def test_catalog_does_not_replace_files_unless_told(capsys, tmp_path, stars_csv):
    for option, name in (("-o", "out.ecsv"), ("--plot", "out.png")):
        path = tmp_path / name
        path.write_text("precious")
        assert f"{path}: is there already" in refused(capsys, "catalog", stars_csv, option, path)
        assert path.read_text() == "precious"
        assert run(capsys, "catalog", stars_csv, option, path, "--overwrite")[0] == 0
        assert path.read_bytes() != b"precious"


def test_catalog_draws(capsys, tmp_path, stars_csv):
    image = pytest.importorskip("matplotlib.image")
    out = printed(capsys, "catalog", stars_csv, "--plot", tmp_path / "counts.png")
    assert "counts.png" in out
    picture = image.imread(tmp_path / "counts.png")
    assert min(picture.shape[:2]) > 400 and len(np.unique(picture[..., 0])) > 20


def test_catalog_makes_synthetic_stars(capsys):
    out = printed(capsys, "catalog", "synthetic", "--n-star", 5000)
    assert ": 5,000 stars" in out
    assert run(capsys, "catalog", "synthetic", "--n-star", 5000, "--seed", 0)[1] == out
    assert run(capsys, "catalog", "synthetic", "--n-star", 5000, "--seed", 1)[1] != out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.fits"], "none.fits: cannot be read"),
        (["."], "bad.csv: line 3: flux_A_jy: "),  # a folder: all its files
        (["broken.fits"], "broken.fits: "),
        (["stars.csv", "--format", "frob"], "stars.csv: "),
        (["stars.csv", "--columns", "ra_deg"], "--columns: must be NAME=COLUMN,NAME=COLUMN,..., got 'ra_deg'"),
        (["stars.csv", "--columns", ""], "--columns: must be NAME=COLUMN"),
        (["stars.csv", "--columns", "ra_deg=RAX"], "stars.csv: columns: ra_deg: must be a column of the file"),
        (["stars.csv", "--readme", "nowhere"], "nowhere"),
        (["bad.csv"], "bad.csv: line 3: flux_A_jy: must be in [0, 1e+15], got -5"),
        (["words.csv"], "words.csv: line 2: dec_deg: must be"),
        (["default", "--no-fill"], "--no-fill: is for files only, got 'default'"),
        (["union", "--format", "fits"], "--format: is for files only, got 'union'"),
        (["stars.csv", "--n-star", "5"], "--n-star: is for synthetic only, got 'stars.csv'"),
        (["default", "--seed", "5"], "--seed: is for synthetic only, got 'default'"),
        (["synthetic"], "--n-star, --limit-jy: exactly one must be given with synthetic"),
        (["synthetic", "--n-star", "many"], "--n-star: must be a whole number, got 'many'"),
        (["synthetic", "--n-star", "-5"], "n_star: must be a whole number from 1"),
        (["synthetic", "--n-star", "5", "--seed", "x"], "--seed: must be a whole number, got 'x'"),
        (["default", "-o", "out.txt"], "out.txt: must end in one of .fits, "),
        (["default", "-o", "nowhere/out.fits"], "nowhere/out.fits: cannot be written: nowhere is not a folder"),
        (["default", "-o", "folder.fits"], "folder.fits: cannot be written: is a folder"),
        (["default", "--plot", LONG + ".png"], ": cannot be written: File name too long"),
        (["default", "--plot", "out.jpg"], "out.jpg: must end in one of .png"),
    ],
)
def test_bad_catalog_commands(capsys, tmp_path, monkeypatch, stars_csv, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.fits").mkdir()
    (tmp_path / "broken.fits").write_bytes(b"SIMPLE  =                    T" + b"?" * 5000)
    (tmp_path / "bad.csv").write_text("ra_deg,dec_deg,flux_A_jy\n1,2,3\n1,2,-5\n")
    (tmp_path / "words.csv").write_text("ra_deg,dec_deg,flux_A_jy\n1,north,3\n")
    before = sorted(tmp_path.rglob("*"))
    assert message in refused(capsys, "catalog", *arguments)
    assert sorted(tmp_path.rglob("*")) == before


def test_plot_without_matplotlib_says_what_to_install(capsys, tmp_path, monkeypatch):
    import importlib.util

    find_spec = importlib.util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "matplotlib" else find_spec(name))
    assert "pip install 'warpsim[plot]'" in refused(capsys, "catalog", "default", "--plot", tmp_path / "a.png")


@pytest.mark.parametrize("n_star", [0, 1])
def test_reports_of_the_smallest_catalogs(n_star):
    catalog = ws.StarCatalog.from_arrays([10.0] * n_star, [20.0] * n_star, {"A": [np.nan] * n_star}, name="tiny")
    text = catalog_report(catalog, ["twice", "twice", "two\nlines"])
    assert text.startswith(f"tiny: {n_star} star{'' if n_star else 's'}, positions at J2000.0\n")
    assert text.count("twice") == 1 and "two lines" in text
    assert ("no star has a flux" in text) == (n_star == 1)
    assert not {"nan", "inf", "-inf"} & set(text.split())


def test_reports_show_a_few_of_many_warnings():
    text = catalog_report(ws.StarCatalog.from_arrays([], [], {}), [f"warning {n}" for n in range(30)])
    assert "warning 7" in text and "warning 8" not in text and "22 more" in text


def test_unknown_command_and_version(capsys):
    with pytest.raises(SystemExit) as caught:
        main(["paint"])
    assert caught.value.code == 2
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert ws.__version__ in capsys.readouterr().out


# --- pictures and CZML of scenes ---


@pytest.mark.ci
def test_access_draws_beside_the_table(capsys, tmp_path):
    image = pytest.importorskip("matplotlib.image")
    _, table, _ = run(capsys, "access", "stss")
    for name in ("chart.png", "chart.pdf", "chart.svg"):
        out = printed(capsys, "access", "stss", "--plot", tmp_path / name)
        assert out == f"{table}figure in {tmp_path / name}\n"
    assert min(image.imread(tmp_path / "chart.png").shape[:2]) > 800
    assert (tmp_path / "chart.pdf").read_bytes()[:4] == b"%PDF"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["chart.pdf", "chart.png", "chart.svg"]


@pytest.mark.ci
def test_plot_draws_every_picture(capsys, tmp_path):
    image = pytest.importorskip("matplotlib.image")
    folder = tmp_path / "new" / "pictures"
    out = printed(capsys, "plot", "stss", "-o", folder, "--time", "1300")
    assert out.startswith(f"9 figures of stss in {folder}: scene.png, ground_tracks.png, group.png")
    views = {"view_sat11", "view_sat12", "view_sat27"}
    names = {"scene", "ground_tracks", "group", "attitudes", "bands", "access", *views}
    assert {path.name for path in folder.iterdir()} == {f"{name}.png" for name in names}
    for path in folder.iterdir():
        assert len(np.unique(image.imread(path)[..., :3])) > 20
    assert "scene.png: is there already" in refused(capsys, "plot", "stss", "-o", folder)


@pytest.mark.slow
def test_plot_draws_named_sensors_and_every_group(capsys, tmp_path, scene):
    pytest.importorskip("matplotlib")
    (first,) = scene.to_dict()["groups"]
    targets = [{**target, "name": f"other_{target['name']}"} for target in first["targets"][:2]]
    scene.replace(groups=[first, {**first, "name": "second", "targets": targets}]).save(tmp_path / "two.toml")
    code, _, _ = run(capsys, "plot", tmp_path / "two.toml", "-o", tmp_path / "o", "--sensors", "sat13,sat11")
    assert code == 0
    names = {path.stem for path in (tmp_path / "o").iterdir()}
    assert names >= {"group_main", "group_second", "view_sat13", "view_sat11"}
    assert len([name for name in names if name.startswith("view")]) == 2
    code, _, err = run(capsys, "plot", "stss", "-o", tmp_path / "p", "--sensors", "sat99")
    assert code == 2 and not (tmp_path / "p").exists()
    assert "sensors: must be sensors of the scene (sat11" in err


@pytest.mark.ci
def test_plot_without_access_has_no_views(capsys, tmp_path):
    pytest.importorskip("matplotlib")
    path = tmp_path / "blind.toml"
    ws.Scene.load("stss").replace(access_rules__max_range_km=10.0).save(path)
    out = printed(capsys, "plot", path, "-o", tmp_path / "o")
    assert "6 figures" in out


@pytest.mark.ci
def test_czml_reports_what_it_wrote(capsys, tmp_path):
    pytest.importorskip("czml3")
    path = tmp_path / "stss.czml"
    out = printed(capsys, "czml", "stss", "-o", path)
    assert out.startswith(f"58 bodies in {path} (0.") and "positions within 0.0" in out
    out = printed(capsys, "czml", "stss", "-o", path, "--step", "10", "--overwrite")
    assert out.startswith(f"58 bodies in {path} (0.")
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.ci
def test_czml_takes_targets_and_a_page(capsys, tmp_path):
    pytest.importorskip("czml3")
    path, page = tmp_path / "stss.czml", tmp_path / "stss.html"
    more = ("--attitudes", "sphere01, cylinder01", "--curves", "all", "--html", page, "--cesium", "https://example.org")
    out = printed(capsys, "czml", "stss", "-o", path, *more)
    assert f"page in {page}: serve it" in out
    packets = {packet["id"]: packet for packet in json.loads(path.read_text("utf-8"))}
    assert {name for name, packet in packets.items() if "orientation" in packet} == {"sphere01", "cylinder01"}
    assert sum("properties" in packet for packet in packets.values()) == 30
    assert 'src="https://example.org/Cesium.js"' in page.read_text("utf-8")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["access", "stss", "--plot", "a.jpg"], "a.jpg: must end in one of .png, .pdf, .svg"),
        (["access", "stss", "--plot", "missing/a.png"], "missing is not a folder"),
        (["access", "stss", "--plot", "old.png"], "old.png: is there already"),
        (["access", "stss", "--plot", LONG + ".png"], ": cannot be written: File name too long"),
        (["czml", "stss", "-o", LONG + ".czml"], ": cannot be written: File name too long"),
        (["plot", "stss", "-o", "out", "--time", "noon"], "--time: must be a number, got 'noon'"),
        (["plot", "stss", "-o", "out", "--time", "2000"], "time_s: must be in the scene, 0 to 1614 s, got 2000"),
        (["plot", "stss", "-o", "old.png"], "old.png: cannot be written"),
        (["czml", "stss", "-o", "a.json"], "a.json: must end in .czml"),
        (["czml", "stss", "-o", "a.czml", "--step", "-1"], "step_s: must be > 0, got -1"),
        (["czml", "stss", "-o", "a.czml", "--step", "x"], "--step: must be a number, got 'x'"),
        (["czml", "nowhere", "-o", "a.czml"], "nowhere"),
        (["czml", "stss", "-o", "a.czml", "--attitudes", "x,y"], "attitudes: must be among center, "),
        (["czml", "stss", "-o", "a.czml", "--curves", ","], "curves: must name at least one"),
        (["czml", "stss", "-o", "a.czml", "--html", "a.png"], "a.png: must end in .html"),
        (["czml", "stss", "-o", "a.czml", "--html", "a.html", "--cesium", "."], "cesium: must be a URL"),
        (["czml", "stss", "-o", "a.czml", "--cesium", "https://x"], "cesium: serves the page alone"),
    ],
)
def test_bad_input_of_pictures_and_czml(capsys, tmp_path, monkeypatch, arguments, message):
    pytest.importorskip("matplotlib")
    pytest.importorskip("czml3")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.png").write_text("mine")
    assert message in refused(capsys, *arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["old.png"]
    assert (tmp_path / "old.png").read_text() == "mine"


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="a folder that takes no files, from root neither")
@pytest.mark.parametrize(
    "arguments", [["access", "stss", "--plot"], ["catalog", "default", "--plot"], ["plot", "stss", "-o"]]
)
def test_folders_that_take_no_files_are_found_before_the_work(capsys, arguments):
    pytest.importorskip("matplotlib")
    assert "/proc/x.png: cannot be written: " in refused(capsys, *arguments, "/proc/x.png")


@pytest.mark.parametrize(
    ("module", "arguments"),
    [
        ("matplotlib", ["access", "stss", "--plot", "a.png"]),
        ("matplotlib", ["plot", "stss", "-o", "out"]),
        ("czml3", ["czml", "stss", "-o", "a.czml"]),
    ],
)
def test_missing_packages_are_named_with_their_extra(capsys, tmp_path, monkeypatch, module, arguments):
    from importlib.util import find_spec

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == module else find_spec(name))
    assert f"pip install 'warpsim[{'czml' if module == 'czml3' else 'plot'}]'" in refused(capsys, *arguments)
    assert list(tmp_path.iterdir()) == []


def test_the_package_is_the_command(checkout_environment):
    done = subprocess.run(
        [sys.executable, "-m", "warpsim", "--version"], env=checkout_environment, capture_output=True, text=True
    )
    assert done.returncode == 0 and done.stdout.strip() == f"warpsim {ws.__version__}"


def test_render_says_which_named_sensors_it_leaves_out(capsys, tmp_path):
    out = printed(
        capsys, "render", "stss", "-o", tmp_path / "o", "--frames", "60:61", "--sensors", "sat11,sat13", "--bands", "A"
    )
    assert out.endswith("left out, as they have no access in these frames: sat13\n")


def test_check_warns_of_targets_that_are_never_deployed(capsys, tmp_path):
    first = ws.Scene.load("stss").to_dict()["groups"][0]
    ws.Scene.load("stss").replace(groups=[{**first, "exists_s": [0.0, 100.0], "release": {"time_s": 300.0}}]).save(
        tmp_path / "late.toml"
    )
    out = printed(capsys, "check", tmp_path / "late.toml")
    assert "warning    sphere is never deployed: released at 300 s, absent from 100 s" in out
