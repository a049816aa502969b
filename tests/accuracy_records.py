"""Errors that tests measure, beside their limits: kept with the tests' reports, merged, and written as JSON.

A test that stands for a line of docs/accuracy.md takes the fixture `record_accuracy` (conftest.py), and with it the
marker `accuracy`. `python -m pytest -n auto -m accuracy --accuracy=docs/accuracy.json` runs these tests and writes
what they measured.
"""

from __future__ import annotations

import json
import math
import platform
from importlib import metadata
from pathlib import Path

import pytest

KEY = "accuracy"
PACKAGES = ("numpy", "warp-lang", "astropy", "scipy", "mpmath", "galsim", "photutils")


def record(test: pytest.Item, name: str, measured: float, limit: float, unit: str, oracle: str) -> None:
    """Keep an error with a test's report; one that is beyond its limit, or no number, fails the test.

    Args:
        test: The test that measured it.
        name: Line of docs/accuracy.md; several tests, and several cases of one, may record the same.
        measured: Largest error seen, >= 0, in the unit; 0 with limit 0 where all must be equal.
        limit: What the test allows.
        unit: Of both, as it is printed behind the numbers; may be empty.
        oracle: What it was compared with.
    """
    measured, limit = float(measured), float(limit)
    assert 0 <= measured <= limit, f"{name}: {measured:.3g} {unit}, allowed {limit:g}"
    case = {"name": name, "oracle": oracle, "measured": measured, "limit": limit, "unit": unit}
    test.user_properties.append((KEY, case))


def worse(case: dict, other: dict) -> dict:
    """The one of two cases that is nearer to its limit."""
    share = [c["measured"] / c["limit"] if c["limit"] else 0.0 for c in (case, other)]
    return other if share[1] > share[0] else case


class Records:
    """Cases of all tests of a run: on one process, or sent by pytest-xdist's workers with their reports."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines: dict[str, dict] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Merge what a test recorded; hook of pytest."""
        if report.when != "call" or not report.passed:
            return
        test = report.nodeid.split("[")[0]
        for key, case in report.user_properties:
            if key == KEY:
                self.add(test, case)

    def add(self, test: str, case: dict) -> None:
        """Merge one case: its line shows the worst."""
        line = self.lines.setdefault(case["name"], {**case, "n_case": 0, "tests": []})
        same = ("unit", "oracle")
        assert all(line[key] == case[key] for key in same), f"{case['name']}: records differ in {' or '.join(same)}"
        line.update(worse({key: line[key] for key in ("measured", "limit")}, case))
        line["n_case"] += 1
        line["tests"] = sorted({*line["tests"], test})

    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        """Write the file where all tests passed; hook of pytest."""
        if exitstatus == 0:
            self.path.write_text(self.text(), "utf-8")

    def text(self) -> str:
        """JSON: what the figures were measured with, and the lines by name."""
        versions = {name: metadata.version(name) for name in PACKAGES if _is_installed(name)}
        head = {"python": platform.python_version(), "machine": platform.machine(), "packages": versions}
        lines = [dict(sorted(self.lines[name].items())) for name in sorted(self.lines)]
        assert all(math.isfinite(line["measured"]) for line in lines)
        return json.dumps({**head, "lines": lines}, indent=1) + "\n"


def _is_installed(name: str) -> bool:
    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return False
    return True
