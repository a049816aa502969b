"""Errors of bad input: what they carry, and how their texts are put together."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest

import warpsim as ws
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
