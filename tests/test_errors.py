"""Errors of bad input: what they carry, how their texts are put together, and those of descriptions."""

import copy
import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from pydantic import model_validator

import warpsim as ws
from warpsim.config.model import config_model
from warpsim.errors import LONGEST_RULE, NO_VALUE, InputError


def test_place_rule_and_value():
    error = InputError("must be in (0, 120)", "fov_deg", -1.0)
    assert str(error) == "fov_deg: must be in (0, 120), got -1.0"
    assert (error.rule, error.field, error.value, error.row, error.place) == (
        "must be in (0, 120)", "fov_deg", -1.0, None, "fov_deg"
    )  # fmt: skip
    assert isinstance(error, ValueError) and ws.InputError is InputError
    assert InputError("give one of the two").value is NO_VALUE
    assert str(InputError("must be there", value=None)) == "must be there, got None"


def test_places_are_added_in_front():
    error = InputError("must be > 0", "speed_m_s[1]", 0)
    inner = error.within("release").within("groups[0]")
    assert str(inner) == "groups[0].release.speed_m_s[1]: must be > 0, got 0"
    assert str(inner.of(Path("/a/scene.toml"))) == "/a/scene.toml: groups[0].release.speed_m_s[1]: must be > 0, got 0"
    assert str(error.within("[2]").within("items")) == "items[2].speed_m_s[1]: must be > 0, got 0"
    assert str(error.of("x.csv").within("file")) == "file: x.csv: speed_m_s[1]: must be > 0, got 0"
    assert str(error) == "speed_m_s[1]: must be > 0, got 0"  # as it was
    assert error.within("") is error and error.of("") is error


def test_the_field_of_an_error_without_one_is_what_it_is_within():
    error = ws.InputError("must leave time").within("steps[2].start_s").within("pointing").of("sat11")
    assert (error.field, error.place) == ("steps[2].start_s", "sat11: pointing.steps[2].start_s")
    assert ws.InputError("must be > 0", "n_row").within("camera").field == "n_row"


def test_several_fields_stand_behind_a_colon():
    error = InputError("exactly one must be given", "file, time_s")
    assert str(error.within("attitude")) == "attitude: file, time_s: exactly one must be given"


@pytest.mark.parametrize(
    ("value", "form", "shown"),
    [
        ("up", "", "'up'"),
        ("a PNG image", "s", "a PNG image"),
        (np.float64(0.1), "g", "0.1"),
        (np.float32(0.5), "", "0.5"),
        (np.arange(3), "", "array([0, 1, 2])"),
        ("x" * 99, "", "'" + "x" * 56 + "..."),
    ],
)
def test_values(value, form, shown):
    assert str(InputError("must be so", "it", value, form)) == f"it: must be so, got {shown}"


def test_rows_become_lines_of_a_file():
    error = InputError("must be in [-90, 90]", "dec_deg", 95.0, "g", row=1, n_row=2)
    assert str(error) == "dec_deg: must be in [-90, 90], got 95 in row 1 (2 such rows)"
    assert error.row == 1
    in_file = error.at_row("line 3").of("x.csv")
    assert str(in_file) == "x.csv: line 3: dec_deg: must be in [-90, 90], got 95 (2 such rows)"
    assert in_file.row is None and in_file.field == "dec_deg"
    assert str(error.of("stars")) == f"stars: {error}"  # a row stays a row
    assert str(InputError("must be finite", "x", row=0, n_row=1)) == "x: must be finite in row 0"


def test_texts_are_one_printable_line():
    error = InputError("must be\nnumbers", "a\tb", "c\x00").of("odd\x1b[31m\udcff\x85name")
    assert str(error) == "odd?[31m? name: a b: must be numbers, got 'c\\x00'"
    assert str(error).isprintable()


def test_long_rules_are_cut_and_long_names_of_files_are_not():
    text = str(InputError("must have the column B", value="A, " * 1000, form="s").of("/deep" * 100))
    assert text.startswith("/deep" * 100 + ": must have") and text.endswith(" ...")
    assert len(text) == 500 + 2 + LONGEST_RULE + 4


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, lambda error: pickle.loads(pickle.dumps(error))])
def test_copies_can_be_told_of_more(duplicate):
    """Errors come from other processes, too."""
    for error in (InputError("is required", "file"), InputError("must be > 0", "x", -1, row=4).of("line")):
        assert str(duplicate(error).within("part")) == str(error.within("part"))
        assert duplicate(error).value is error.value or duplicate(error).value == error.value


def test_several_errors_are_one():
    errors = [InputError("must be > 0", "a", 0), InputError("is required", "b")]
    both = InputError.several(errors, more=3)
    assert str(both.of("Scene")) == "Scene: a: must be > 0, got 0; b: is required (and 3 more)"
    assert both.of("Scene").errors == tuple(errors)


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
