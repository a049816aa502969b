"""Benchmarks run on the devices asked for."""

import subprocess
import sys

import pytest

from benchmarks.report import TOP

ON_THE_HOST = {"test_access", "test_orbits", "test_peers", "test_peer_sdasim"}
"""What runs no kernel, and the comparison with programs that run on the CPU."""


def collected(*options):
    """Exit code, identifiers and messages of pytest, which only collects."""
    command = [sys.executable, "-m", "pytest", "-q", "--collect-only", "-p", "no:cacheprovider", *options]
    done = subprocess.run(command, cwd=TOP, capture_output=True, text=True)
    return done.returncode, [line for line in done.stdout.splitlines() if "::" in line], done.stdout + done.stderr


@pytest.mark.ci
def test_every_benchmark_of_kernels_takes_the_device():
    pytest.importorskip("pytest_benchmark")
    code, names, text = collected("benchmarks", "--device", "cpu")
    assert code == 0, text
    modules = {name.partition(".py::")[0].rpartition("/")[2] for name in names}
    assert modules == {path.stem for path in (TOP / "benchmarks").glob("test_*.py")}
    without = {name.partition("[")[0] for name in names if "cpu" not in name}
    assert {name.partition(".py::")[0].rpartition("/")[2] for name in without} - ON_THE_HOST <= {
        "test_approximations",  # the nodes of tracks, on the host
        "test_star_query",  # other methods than the index
    }


@pytest.mark.ci
def test_a_device_that_is_not_there_is_named():
    code, names, text = collected("benchmarks/test_read_out.py", "--device", "tpu")
    assert code == 4 and not names
    assert "--device: device: must be one of cpu" in text
