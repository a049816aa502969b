"""Scenes: validation, files and their paths, derived tracks."""

import json
import shutil
from pathlib import Path

import astropy.units as u
import numpy as np
import pytest
from astropy.time import Time
from element_sets import iss
from hypothesis import given, settings
from hypothesis import strategies as st

import warpsim as ws
from warpsim.files import absolute_path
from warpsim.orbit.constellations import NamedOrbit
from warpsim.scene.environment import Sky
from warpsim.scene.scene_files import named_files, to_toml

TRACK_M = 1e-3
"""Interpolation between nodes."""


def test_presets():
    assert ws.presets() == ["stss", "two_cameras", "visible_to_lwir"]


def test_stss_is_the_papers_scene(scene):
    """Tables 3 to 6."""
    walker = scene.constellation
    assert (walker.n_satellite, walker.n_plane, walker.phasing) == (28, 4, 2)
    assert (walker.altitude_km, walker.inclination_deg) == (1598.0, 78.0)
    assert (scene.camera.n_row, scene.camera.n_col, scene.camera.fov_deg) == (128, 128, 1.0)
    assert scene.optics.aperture_m == 0.4
    assert (scene.detector.nei_w_cm2, scene.detector.sei_w_cm2) == (1e-18, 3e-15)
    assert scene.detector.dynamic_range == pytest.approx(3000)
    rules = scene.access_rules
    assert (rules.max_range_km, rules.min_elevation_deg) == (6000.0, -32.0)
    assert (rules.min_grazing_altitude_km, rules.min_solar_exclusion_deg) == (250.0, 60.0)
    assert len(scene.target_names) == 30
    assert scene.target_names[0] == "center"
    assert scene.duration_s == scene.trajectory.duration_s == 1614.0
    main, sphere, cylinder, cone = scene.targets
    assert main.shape == cone.shape == ws.Cone(0.25, 1.0)
    assert sphere.shape == ws.Sphere(0.5)
    assert cylinder.shape == ws.Cylinder(0.25, 1.0)
    assert [spec.surface.reflectance for spec in scene.targets] == [0.9, 0.95, 0.9, 0.85]
    assert main.attitude.precession_rev_s == 1.0
    assert (cone.attitude.precession_rev_s, cone.attitude.precession_angle_deg) == (5.0, 10.0)
    assert {(t.temperature.start_k, t.temperature.end_k) for t in scene.targets} == {(350.0, 328.0)}
    # Blank sky at least five sigma above count 0; 3,000 NEI within 14 bits.
    assert scene.detector.offset_counts >= 5 * scene.detector.counts_per_nei
    assert scene.detector.offset_counts + 3000 * scene.detector.counts_per_nei < 2**14


@pytest.mark.parametrize("ending", ["toml", "json"])
def test_saved_scenes_load_back_equal(scene, tmp_path, ending):
    path = tmp_path / f"scene.{ending}"
    changed = scene.replace(seed=2**63 - 1, detector__nei_w_cm2=1.1e-18, description='quotes " and \\ and ü')
    changed.save(path)
    assert ws.Scene.load(path) == changed
    assert sorted(tmp_path.iterdir()) == [path]


def test_epoch_may_be_a_toml_date_time(scene, tmp_path):
    path = tmp_path / "scene.toml"
    scene.save(path)
    text = path.read_text()
    for bare in ("2025-01-01T14:00:00Z", "2025-01-01T14:00:00"):
        path.write_text(text.replace('"2025-01-01T14:00:00"', bare))
        assert ws.Scene.load(path).epoch == scene.epoch


plain = st.recursive(
    st.one_of(
        st.booleans(),
        st.integers(-(2**63), 2**63 - 1),
        st.floats(allow_nan=False),
        st.text(st.characters(blacklist_categories=["Cs"])),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.from_regex(r"\A[a-z_]{1,6}\Z"), inner, max_size=3)
    ),
    max_leaves=8,
)


@settings(max_examples=150, deadline=None)
@given(st.dictionaries(st.from_regex(r"\A[a-z_]{1,6}\Z"), plain, max_size=4))
@pytest.mark.ci
def test_toml_text_reads_back_equal(data):
    import tomllib

    assert tomllib.loads(to_toml(data)) == data


def test_scenes_do_not_change(scene):
    with pytest.raises(AttributeError):
        scene.seed = 3
    with pytest.raises(AttributeError):
        scene.camera.n_row = 3
    other = scene.replace(camera__n_row=64)
    assert (scene.camera.n_row, other.camera.n_row) == (128, 64)
    assert scene.replace(bands__1="D").bands == ("A", "D", "E")
    assert json.dumps(scene.to_dict())


def test_quantities_are_converted_once(scene):
    assert ws.Camera(128, 128, fov_deg=60 * u.arcmin) == scene.camera
    assert ws.Sphere(50 * u.cm) == ws.Sphere(0.5)
    assert ws.Walker(28, 4, 2, 1.598e6 * u.m, 78 * u.deg).altitude_km == pytest.approx(1598)
    with pytest.raises(ws.InputError, match=r"Sphere: radius_m: must be convertible to m, got <Quantity 1. s>"):
        ws.Sphere(1 * u.s)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ws.Camera(128, 128), "Camera: give either fov_deg, or focal_length_m and pixel_pitch_m"),
        (lambda: ws.Camera(128, 128, fov_deg=1, pixel_pitch_m=1e-5), "Camera: give either"),
        (
            lambda: ws.Camera(128, 128, focal_length_m=1.2, pixel_pitch_m=15),
            r"Camera: pixel_pitch_m: gives a field of view of 180 deg, which must be in \[1e-6, 120\); are these um\?",
        ),
        (lambda: ws.Camera(2, 2, focal_length_m=1e3, pixel_pitch_m=1e-6), "pixel_pitch_m: gives a field of view of 1"),
        (lambda: ws.Camera(2**16, 2**16, fov_deg=1), r"n_row \* n_col: must be below 2\*\*29"),
        (lambda: ws.Camera(0, 128, fov_deg=1), "Camera: n_row: must be >= 1, got 0"),
        (lambda: ws.PsfGaussian(0.0), "PsfGaussian: sigma_px: must be in"),
        (lambda: ws.NeiDetector(1e-18, 3e-15, bits=20), "NeiDetector: bits: must be in"),
        (lambda: ws.NeiDetector(1e-18), "NeiDetector: sei_w_cm2: is required"),
        (lambda: ws.Cone(1.0), "Cone: height_m: is required"),
        (lambda: ws.Cone(1.0, 2.0, colour=3), "Cone: colour: is not a known field"),
    ],
)
def test_parts_say_what_is_wrong(make, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


ARC = {
    "kind": "ballistic_arc",
    "start_lon_lat_deg": [129.67, 40.86],
    "end_lon_lat_deg": [-118.4, 34.1],
    "duration_s": 900.0,
    "endpoint_altitude_km": 121.92,
}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frames__count": 163}, "frames: the last frame must be within duration_s"),
        ({"bands": ["A", "A"]}, "bands: must not repeat"),
        ({"bands": []}, "bands: must name at least one"),
        ({"targets": []}, "targets: must hold at least the main target"),
        (
            {"duration_s": 1e9, "trajectory__duration_s": 1e9},
            "trajectory.duration_s: must be at most 2678400",
        ),
        (
            {"duration_s": 2.6e6, "trajectory__duration_s": 2.6e6, "constellation__n_satellite": 28_000},
            "duration_s: 2.6e\\+06 s are too long for 28030 sat",
        ),
        ({"bands": 3}, "bands: must be a list, got 3"),
        ({"name": "群"}, "name: must be printable ASCII text, got"),
        ({"targets__1__name": "a/b"}, r"targets\[1\].name: must be letters"),
        ({"targets__1__count": 10**11}, r"targets\[1\].count: must be in"),
        ({"constellation__n_satellite": 4 * 10**12}, "constellation.n_satellite: must be in"),
        ({"targets__1__temperature__start_k": 1e300}, r"targets\[1\].temperature.start_k: must be in"),
        ({"targets__1__shape__radius_m": 1e100}, r"targets\[1\].shape.radius_m: must be in"),
        ({"targets__0__attitude__axis": [0, 0, 0]}, r"targets\[0\].attitude.axis: must not be the zero vector"),
        ({"camera__fov_deg": 5e-324}, "camera.fov_deg: must be 0, or at least 1e-60 in size"),
        ({"camera__n_row": 20000, "camera__n_col": 20000}, r"camera: n_row \* n_col \* number of bands"),
        ({"epoch_utc": "0001-01-01"}, "epoch_utc: must be"),
        ({"epoch_utc": "J2000"}, "epoch_utc: must be an ISO 8601"),
        ({"seed": -1}, r"seed: must be in"),
        ({"camera__n_colour": 3}, "camera.n_colour: is not a known field"),
        ({"nothing__at_all": 3}, "nothing.at_all: is not a field of a part"),
        ({"optics__aperture_m": 100.0}, "optics: in band A: PsfAiry: radius_px"),
        ({"release__speed_m_s": [5, 2]}, "release.speed_m_s: must be"),
        ({"bands__5": "A"}, "bands.5: must name an item by its number, 0 to 2, got 5"),
    ],
)
def test_scenes_say_what_is_wrong(scene, changes, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        scene.replace(**changes)
    assert "\n" not in str(caught.value)


def test_a_flight_begins_with_the_scene(scene):
    with pytest.raises(ws.InputError, match=r"^trajectory.epoch_utc: must be left out, or be when the flight starts"):
        _ = scene.replace(trajectory__epoch_utc="2000-01-01T00:00:00").scenario


def test_satellites_fly_as_long_as_the_scene(scene):
    rocket = scene.replace(constellation={"kind": "listed", "satellites": [{"name": "rocket", "orbit": ARC}]})
    message = r"^constellation.satellites\[0\].orbit.duration_s: must be at least .*1614.*, got 900$"
    with pytest.raises(ws.InputError, match=message):
        _ = rocket.scenario


def test_emissivity_and_reflectance_must_agree(scene):
    data = scene.to_dict()
    data["groups"][0]["targets"][0]["surface"] = {"reflectance": 0.9, "emissivity": 0.2}
    with pytest.raises(ws.InputError, match=r"targets\[0\]\.surface: emissivity \+ reflectance: must be 1"):
        ws.Scene.from_dict(data)
    data["groups"][0]["targets"][0]["surface"] = {"emissivity": 0.1}
    assert ws.Scene.from_dict(data).groups[0].targets[0].surface.emissivity_in("A") == 0.1


def test_epoch_and_positions(scene):
    assert scene.epoch == Time("2025-01-01T14:00:00", scale="utc")
    times = np.array([0.0, 3.7, 800.0, 1614.0])
    flown_m, _ = scene.groups[0].trajectory.flight(scene.epoch).state(times)
    np.testing.assert_allclose(scene.position_m("center", times), flown_m, rtol=0, atol=TRACK_M)
    radius = np.linalg.norm(scene.position_m("sat11", times), axis=1)
    # Circular at the epoch; J2 then moves the radius by some kilometres.
    assert radius[0] == pytest.approx(6378137 + 1598e3, abs=TRACK_M)
    assert np.all(np.abs(radius - radius[0]) < 10e3)
    assert np.linalg.norm(scene.position_m("sun", [0.0])[0]) == pytest.approx(1.471e11, rel=1e-3)  # January
    with pytest.raises(ws.InputError, match="must be a sensor, a target or 'sun'"):
        scene.position_m("moon", [0.0])
    with pytest.raises(ws.InputError, match="sat11: time_s"):
        scene.position_m("sat11", [1e5])


def test_the_group_leaves_at_2_to_5_m_s(scene):
    first, later = (np.stack([scene.position_m(name, [t])[0] for name in scene.target_names]) for t in (0.0, 10.0))
    assert np.abs(first - first[0]).max() < TRACK_M
    speed = np.linalg.norm((later - later[0])[1:], axis=1) / 10
    assert speed.min() > 1.99
    assert speed.max() < 5.01
    assert speed.std() > 0.3


def test_a_flight_below_ground_is_said_with_the_files_name(scene, tmp_path):
    path = tmp_path / "low.toml"
    scene.replace(frames__count=2, duration_s=900.0, trajectory__duration_s=900.0).save(path)
    with pytest.raises(ws.InputError, match=r"^trajectory.duration_s: 900 s gives a flight .* below"):
        _ = ws.Scene.load(path).scenario


def test_tracks_are_interpolated_to_a_millimetre(scene):
    assert scene.scenario.tracks.error_m < TRACK_M
    assert scene.scenario.tracks.step_s > 5


def test_access_table(scene):
    table = scene.access()
    assert table.colnames == ["sensor", "target", "start_s", "end_s", "duration_s"]
    assert len(set(table["sensor"])) == 10
    for row in table:
        middle = (row["start_s"] + row["end_s"]) / 2
        assert scene.scenario.has_access(row["sensor"], [middle])[0]
        number = scene.sensor_names.index(row["sensor"])
        for edge, outward in ((row["start_s"], -1), (row["end_s"], 1)):
            inside = [margin[number, 0] for margin in scene.access_margins([edge]).values()]
            outside = [margin[number, 0] for margin in scene.access_margins([edge + outward * 2e-3]).values()]
            assert min(inside) > -1e-6
            assert min(outside) < 0


def test_import_is_light(checkout_environment):
    """`import warpsim` loads NumPy and Warp at the most; the rest comes with first use."""
    import subprocess
    import sys

    heavy = "pydantic", "astropy.coordinates", "OpenImageIO", "matplotlib", "skyfield", "scipy"
    code = f"import sys, warpsim; print([m for m in {heavy!r} if m in sys.modules])"
    command = [sys.executable, "-c", code]
    out = subprocess.run(command, capture_output=True, text=True, check=True, env=checkout_environment)
    assert out.stdout.strip() == "[]"


def test_every_public_name_exists():
    for name in ws.__all__:
        assert getattr(ws, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        ws.nonsense  # noqa: B018


def test_moved_names_are_said(scene):
    with pytest.raises(AttributeError, match=r"no attribute 'has_access'; scene.scenario.has_access is it$"):
        _ = scene.has_access


TLE = "\n".join([*iss("25152.00000000"), ""])
SCAN = "time_s,ra_deg,dec_deg\n0,0,0\n2000,10,0\n"
ATTITUDE = "time_s,qx,qy,qz,qw\n0,0,0,0,1\n2000,0,0,0.6,0.8\n"
STATES = "name,time_s,x_km,y_km,z_km\na,-60,7000,0,0\na,2000,7000,1,0\nb,-60,7000,2,0\nb,2000,7000,3,0\n"
STARS = "ra_deg,dec_deg,flux_A_jy\n1,2,3\n"


@pytest.fixture
def folder(tmp_path):
    home = tmp_path / "home"
    (home / "data").mkdir(parents=True)
    for name, text in {
        "a.tle": TLE, "states.csv": STATES, "turn.csv": ATTITUDE, "scan.csv": SCAN, "default": STARS,
    }.items():  # fmt: skip
        (home / "data" / name).write_text(text)
    return home


def with_files(scene, path_of):
    """A scene in which every field that names a file does."""
    parts = [
        ws.TleSatellites(file=path_of("a.tle")),
        ws.EphemerisSatellites([path_of("states.csv")]),
        ws.ListedSatellites([NamedOrbit("c", ws.EphemerisOrbit(path_of("states.csv"), object="a"))]),
        ws.ListedSatellites([NamedOrbit("d", ws.TleOrbit(file=path_of("a.tle")))]),
    ]
    return scene.replace(
        constellation=ws.MixedConstellation(parts),
        targets__1__attitude=ws.AttitudeTable(file=path_of("turn.csv")),
        pointing=ws.TablePointing(mode="scan", file=path_of("scan.csv")),
        sky=Sky(catalog=path_of("default")),
    )


@pytest.mark.parametrize("kind", [str, Path])
def test_paths_count_from_the_directory_that_they_were_given_in(scene, folder, tmp_path, monkeypatch, kind):
    monkeypatch.chdir(folder)
    made = with_files(scene, lambda name: kind(f"data/../data/{name}") if kind is str else Path("data") / name)
    names = ["a.tle", "states.csv", "turn.csv", "scan.csv"]
    assert sorted(named_files(made.to_dict())) == sorted(str(folder / "data" / name) for name in names)
    assert made.sky.catalog == str(folder / "data" / "default")
    monkeypatch.chdir("/")
    assert made.sensor_names == ["norad25544", "a", "b", "c", "d"]
    # Below the scene's folder, beside it, and somewhere else: by absolute and by relative names.
    for path in (folder / "s.toml", folder / "data" / "s.json", tmp_path / "home" / ".." / "s.toml"):
        made.save(path)
        assert str(tmp_path) not in path.read_text()
        assert ws.Scene.load(path) == made
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    for name in ("s.toml", "../other/s.toml"):
        made.save(name)
        assert str(folder / "data" / "a.tle") in Path("s.toml").read_text()
        assert ws.Scene.load(name) == ws.Scene.load("../other/s.toml") == made


@pytest.mark.parametrize("name", ["s.toml", "data/s.json"])
def test_a_folder_can_travel(scene, folder, tmp_path, monkeypatch, name):
    """A catalog called as a built-in one is still a file."""
    monkeypatch.chdir("/")
    with_files(scene, lambda file: folder / "data" / file).save(folder / name)
    shutil.move(folder, tmp_path / "away")
    moved = ws.Scene.load(tmp_path / "away" / name)
    assert moved.sensor_names == ["norad25544", "a", "b", "c", "d"]
    assert moved.sky.catalog == str(tmp_path / "away" / "data" / "default")
    assert moved == with_files(scene, lambda file: tmp_path / "away" / "data" / file)


def test_parent_of_a_symbolic_link_is_what_the_system_says(tmp_path, monkeypatch):
    (tmp_path / "far" / "deep").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "far" / "deep")
    (tmp_path / "far" / "a.tle").write_text(TLE)
    monkeypatch.chdir(tmp_path)
    assert absolute_path("./x//y/../a.tle") == str(tmp_path / "x" / "a.tle")
    assert Path(absolute_path("link/./../a.tle")).samefile("far/a.tle")
    assert ws.TleSatellites(file="link/../a.tle").names == ["norad25544"]


@pytest.mark.parametrize("value", [3, "", "a\0b", b"a.tle", True, ["a"], "\ud800"])
def test_what_is_no_path(value):
    for make in (ws.TleOrbit, ws.EphemerisOrbit, ws.AttitudeTable):
        with pytest.raises(ws.InputError, match=r"^\w+: file: must be the path of a file, got ") as caught:
            make(file=value)
        assert "\n" not in str(caught.value)
    with pytest.raises(ws.InputError, match=r"^Sky: catalog: must be one of default, .*, or the path of a file, got "):
        Sky(catalog=value)


def test_one_file_twice(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ws.InputError, match="files: must not repeat"):
        ws.EphemerisSatellites(["a.oem", "./b/../a.oem"])
