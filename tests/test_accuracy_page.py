"""The accuracy report: made from the data that tests recorded, complete, and of tests that there are."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from accuracy_records import KEY, Records, record

from benchmarks import accuracy

TOP = Path(__file__).parents[1]
DATA = json.loads(accuracy.DATA.read_text())
NAMES = [name for names in accuracy.LINES.values() for name in names]


def test_the_page_is_made_from_the_data():
    assert accuracy.PAGE.read_text() == accuracy.page(DATA)


def test_every_line_is_there_once():
    assert len(set(NAMES)) == len(NAMES)
    measured = {line["name"] for line in DATA["lines"]}
    assert set(NAMES) - measured <= set(accuracy.NEEDS_A_GPU)
    assert measured <= set(NAMES)


def test_every_line_is_recorded_by_a_test_that_is_there():
    """Also one that the data lack: its name stands in a test."""
    texts = {path.name: path.read_text() for path in (TOP / "tests").glob("test_*.py") if path != Path(__file__)}
    for name in NAMES:
        assert any(f'"{name}"' in text for text in texts.values()), name
    for line in DATA["lines"]:
        assert line["tests"]
        for test in line["tests"]:
            file, function = test.split("::")
            assert re.search(rf"def {function}\(.*record_accuracy", texts[Path(file).name]), test


def test_no_line_is_beyond_its_limit():
    assert [line["name"] for line in DATA["lines"] if not 0 <= line["measured"] <= line["limit"]] == []


def test_numbers_of_the_page():
    shown = {1.1e-7: "1.1e-7", 2e-7: "2e-7", 0: "0", 5: "5", 0.0021: "2.1e-3", 0.021: "0.021", 876.4: "876", 2.04: "2"}
    assert {value: accuracy.number(value) for value in shown} == shown
    assert accuracy.number(12_238_042) == "1.2e7"
    line = {
        "name": "n",
        "oracle": "o",
        "measured": 1e-7,
        "limit": 2e-7,
        "unit": "px",
        "n_case": 3,
        "tests": ["tests/test_a.py::b"],
    }
    assert accuracy.row(line) == "| n | o | 1e-7 px | 2e-7 | 2 | 3 | [a](../tests/test_a.py) |"
    assert "| 0 px | 0 | equal |" in accuracy.row({**line, "measured": 0.0, "limit": 0.0})


@pytest.mark.parametrize(("measured", "limit"), [(2.0, 1.0), (float("nan"), 1.0), (1, 0), (-1.0, 1.0)])
def test_what_is_beyond_its_limit_fails(measured, limit):
    item = SimpleNamespace(user_properties=[])
    with pytest.raises(AssertionError, match="px, allowed"):
        record(item, "line", measured, limit, "px", "oracle")
    assert item.user_properties == []


def test_the_worst_of_several_cases_is_kept():
    records = Records(Path("unused"))
    for test, measured, limit in (("t::a", 1e-3, 1.0), ("t::b", 1e-4, 1e-3), ("t::a", 2e-3, 1.0)):
        item = SimpleNamespace(user_properties=[])
        record(item, "line", measured, limit, "px", "oracle")
        report = SimpleNamespace(when="call", passed=True, nodeid=f"{test}[1]", user_properties=item.user_properties)
        records.pytest_runtest_logreport(report)
    (line,) = json.loads(records.text())["lines"]
    assert (line["measured"], line["limit"], line["n_case"], line["tests"]) == (1e-4, 1e-3, 3, ["t::a", "t::b"])
    other = SimpleNamespace(user_properties=[])
    record(other, "line", 0.1, 1.0, "m", "oracle")
    with pytest.raises(AssertionError, match="differ in unit"):
        records.add("t::c", dict(other.user_properties)[KEY])


@pytest.mark.slow
def test_workers_send_what_they_record(tmp_path):
    """Through pytest-xdist; -m accuracy runs just the tests that record."""
    pytest.importorskip("xdist")
    path = tmp_path / "accuracy.json"
    command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "-m", "accuracy", f"--accuracy={path}"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    subprocess.run([*command, "tests/test_paper.py"], cwd=TOP, env=environment, check=True, capture_output=True)
    lines = json.loads(path.read_text())["lines"]
    assert {line["name"]: line["n_case"] for line in lines} == {
        "The paper's Table 2, 37 values": 37, "The paper's Table 2, five values": 5
    }  # fmt: skip
