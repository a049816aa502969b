"""Tests of floating-point arithmetic again, as other processors run them.

OpenBLAS, NumPy and the C library choose their code by what the processor can do, and so results differ in their last
bits (Warp's kernels' only where they call the C library). Here child processes run the tests that depend on it most
with the code of other processors: limits must hold there too, or they are no requirements but what one machine makes of
them.
"""

from __future__ import annotations

import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]

TESTS = (
    "access_scan", "apparent_camera", "apparent_stars", "attitude", "attitude_table", "bands", "catalog",
    "catalog_surveys", "colours", "distortion", "heat_balance", "orbit_access", "orbit_arc",
    "orbit_constellations", "orbit_earth_sun", "orbit_eclipse", "orbit_elements", "orbit_ephemeris", "orbit_frames",
    "orbit_interpolate", "orbit_propagation", "orbit_tle", "orbit_walker_group", "own_orbits", "paper", "pointing",
    "psf_table", "radiometry", "renderer", "scene_groups", "scene_tracks", "stellar_spectrum", "surface",
    "target_geometry", "temperature",
)  # fmt: skip
"""Where much is summed, solved or integrated: orbits, apparent places, optics, heat, magnitudes."""

WHICH = "not slow or accuracy"
"""Of them, with the long ones that record an error."""

NEEDS = {"Haswell": {"avx2", "fma"}, "Sandybridge": {"avx"}}
"""OpenBLAS's names of processors, and what its kernels for them need, in the words of /proc/cpuinfo."""

OLD_LIBM = "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"
"""Sines and exponentials of the GNU C library without fused multiplication and addition; others pass it over."""

PROBE = "import numpy as np; a = np.random.default_rng(0).normal(size=(99, 99)); print((a @ a).tobytes().hex())"


def flags() -> set[str]:
    """What this processor can do, in the words of /proc/cpuinfo."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((set(line.split(":")[1].split()) for line in lines if line.startswith("flags")), set())


def skip_unless_it_runs(core: str) -> None:
    """Skip a test whose arithmetic this machine cannot do."""
    if platform.machine() != "x86_64" or not Path("/proc/cpuinfo").exists():
        pytest.skip(f"OpenBLAS's kernels for {core} need Linux on x86-64, not {platform.system()} {platform.machine()}")
    if missing := NEEDS[core] - flags():
        pytest.skip(f"OpenBLAS's kernels for {core} need {', '.join(sorted(missing))}, which this processor lacks")
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    if "DYNAMIC_ARCH" not in blas.get("openblas configuration", ""):
        pytest.skip(f"NumPy's BLAS, {blas.get('name')}, does not let its kernels be chosen")


def as_on(core: str, environment: dict[str, str]) -> dict[str, str]:
    """Environment in which a child process computes as on another processor."""
    changed = {name: value for name, value in environment.items() if not name.startswith("PYTEST_")}
    changed["OPENBLAS_CORETYPE"] = core
    if core == "Sandybridge":
        extensions = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
        changed |= {"NPY_DISABLE_CPU_FEATURES": " ".join(extensions), "GLIBC_TUNABLES": OLD_LIBM}
    return changed


@pytest.mark.parametrize("core", NEEDS)
def test_limits_hold_with_the_arithmetic_of(core, checkout_environment):
    """Sandybridge stands for older ones: nothing has fused multiplication and addition, and NumPy its least code."""
    skip_unless_it_runs(core)
    names = [f"tests/test_{name}.py" for name in TESTS]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--tb=short", "-m", WHICH, *names]
    environment = as_on(core, checkout_environment)
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"with the arithmetic of {core}:\n{done.stdout[-8000:]}\n{done.stderr[-2000:]}"


def test_arithmetic_does_change(checkout_environment):
    """Or the test above would tell nothing."""
    seen = set()
    for core in NEEDS:
        skip_unless_it_runs(core)
        environment, command = as_on(core, checkout_environment), [sys.executable, "-c", PROBE]
        seen.add(subprocess.run(command, env=environment, capture_output=True, check=True).stdout)
    assert len(seen) == len(NEEDS)
