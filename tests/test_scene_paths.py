"""Paths of files in scenes: absolute once made, relative in a folder that can travel."""

import shutil
from pathlib import Path

import pytest
from element_sets import iss

import warpsim as ws
from warpsim.files import absolute_path
from warpsim.orbit.constellations import NamedOrbit
from warpsim.scene.environment import Sky
from warpsim.scene.scene_files import named_files

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
