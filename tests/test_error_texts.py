"""Errors of descriptions: one line, whose place is a field's."""

import json

import numpy as np
import pytest
from pydantic import model_validator

import warpsim as ws
from warpsim.config.model import config_model

WALKER = {
    "kind": "walker", "n_satellite": 4, "n_plane": 2, "phasing": 1, "altitude_km": 1400.0, "inclination_deg": 65.0
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"constellation": "x"}, r"^Scene: constellation: must be a table of fields, got 'x'$"),
        ({"camera": 3}, r"^Scene: camera: must be a table of fields, got 3$"),
        ({"name": 3}, r"^Scene: name: must be text, got 3$"),
        ({"trajectory__start_lon_lat_deg": "x"}, r"^Scene: trajectory.start_lon_lat_deg: must be a list, got 'x'$"),
        ({"trajectory__start_lon_lat_deg": [1, 2, 3]}, r"start_lon_lat_deg: must hold at most 2, got \[1, 2, 3\]$"),
        (
            {"targets__0__attitude": {"axis": "up"}},
            r"^Scene: targets\[0\].attitude.axis: must be 'velocity', 'random' or three numbers, got 'up'$",
        ),
        ({"targets__0__attitude": {"axis": [1, 2]}}, r"attitude.axis: must be .* or three numbers, got \[1, 2\]$"),
        ({"targets__0__attitude": {"axis": 5}}, r"attitude.axis: must be .* or three numbers, got 5$"),
        ({"targets__0__attitude": {"axis": [1, "a", 2]}}, r"^Scene: .*attitude.axis\[1\]: must be a number, got 'a'$"),
        (
            {"pointing": {"kind": "fixed", "ra_dec_deg": [0, 0], "track": "main"}},
            r"^Scene: pointing.track: is not a known field here \(other parts have it\)$",
        ),
        ({"optics__apertur_m": 1.0}, r"apertur_m: is not a known field \(did you mean aperture_m\?\)$"),
        (
            {"constellation": {"kind": "tle", "file": "nope.tle"}},
            r"^constellation: /.*/nope.tle: cannot be read",
        ),
        ({"constellation": {"kind": "tle", "lines": ["x"]}}, r"^Scene: constellation.lines: must hold element sets"),
    ],
)
def test_places_are_fields(scene, changes, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        _ = scene.replace(**changes).scenario
    assert "\n" not in str(caught.value)


def test_a_files_name_is_no_field():
    """Paths of fields join with a dot, names of files with a colon."""

    @config_model
    class Inner:
        depth_m: float = 1.0

        @model_validator(mode="after")
        def _check(self):
            if self.depth_m > 0:
                raise ws.InputError("cannot be read").of("nope.tle")
            raise ws.InputError("must be above 0", "depth_m")

    @config_model
    class Outer:
        inner: Inner

    with pytest.raises(ws.InputError, match=r"^Outer: inner: nope.tle: cannot be read$"):
        Outer(inner={})
    with pytest.raises(ws.InputError, match=r"^Outer: inner.depth_m: must be above 0$"):
        Outer(inner={"depth_m": -1.0})


def test_axes_may_be_arrays():
    assert ws.Attitude(axis=np.array([1.0, 2.0, 3.0])) == ws.Attitude(axis=[1, 2, 3])


def nested(depth, part=None):
    for _ in range(depth):
        part = {"kind": "mixed", "parts": [part or WALKER]}
    return part


@pytest.mark.parametrize("depth", [21, 40, 400, 5000])
def test_mixtures_nested_too_deeply(scene, depth):
    for make in (
        lambda: scene.replace(constellation=nested(depth)),
        lambda: ws.MixedConstellation([nested(depth - 1)]),
    ):
        with pytest.raises(ws.InputError, match="is nested too deeply") as caught:
            make()
        assert len(str(caught.value)) < 300
    mixture = ws.Walker(4, 2, 1, 1400.0, 65.0)
    for _ in range(20):
        mixture = ws.MixedConstellation([mixture])
    with pytest.raises(
        ws.InputError, match="parts: is nested too deeply, at most 20 mixtures may lie within each other"
    ):
        ws.MixedConstellation([mixture])


def test_mixtures_nested_deeply_enough(scene, tmp_path):
    deep = scene.replace(constellation=nested(20))
    deep.save(tmp_path / "deep.toml")
    assert ws.Scene.load(tmp_path / "deep.toml") == deep


@pytest.mark.parametrize("depth", [100, 5000, 100_000])
@pytest.mark.parametrize("ending", ["json", "toml"])
def test_files_nested_too_deeply(tmp_path, depth, ending):
    path = tmp_path / f"deep.{ending}"
    path.write_text(
        '{"a": ' + "[" * depth + "]" * depth + "}" if ending == "json" else "a = " + "[" * depth + "]" * depth
    )
    with pytest.raises(ws.InputError, match=rf"^{path}: is nested too deeply") as caught:
        ws.Scene.load(path)
    assert "\n" not in str(caught.value)


def test_four_hundred_mixtures_in_a_file(scene, tmp_path):
    data = {**scene.to_dict(), "constellation": nested(400)}
    (tmp_path / "deep.json").write_text(json.dumps(data))
    with pytest.raises(ws.InputError, match=r"deep.json: is nested too deeply"):
        ws.Scene.load(tmp_path / "deep.json")


@pytest.mark.parametrize("name", ["sun", "moon"])
def test_only_sensors_and_targets_are_eclipsed(scene, name):
    for ask in (lambda: scene.scenario.eclipses(name), lambda: scene.scenario.sunlit_fraction(name, [0.0])):
        with pytest.raises(ws.InputError, match=rf"^name: must be a sensor or a target \(center, .*\), got '{name}'$"):
            ask()
