"""The wheel: three import packages, with their data, and nothing else at the top level."""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import warpsim as ws

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    builder = pytest.importorskip("hatchling.builders.wheel").WheelBuilder(str(ROOT))
    path = next(iter(builder.build(directory=str(tmp_path_factory.mktemp("wheel")), versions=["standard"])))
    with zipfile.ZipFile(path) as file:
        yield file


def test_top_level_names(wheel):
    names = {name.split("/")[0] for name in wheel.namelist()}
    packages = {name for name in names if not name.endswith(".dist-info")}
    assert packages == {"warpsim", "warpsim_kernels", "warpsim_catalogs"}


@pytest.mark.parametrize(
    "name",
    [
        "warpsim/py.typed",
        "warpsim/scene/presets/stss.toml",
        "warpsim_catalogs/hip_gaia_ir_v2.npz",
        "warpsim_catalogs/stellar_templates_v1.npz",
        "warpsim_catalogs/solar_spectrum_v1.csv",
        "warpsim_catalogs/earth_spectrum_v1.csv",
        "warpsim_catalogs/LICENSE-hip-gaia-ir.md",
        "warpsim_catalogs/responses_v1.csv",
        "warpsim_catalogs/responses_v1.toml",
        "warpsim_catalogs/LICENSE-responses.md",
        "warpsim_kernels/deposit_table.py",
    ],
)
def test_data_travels(wheel, name):
    assert name in wheel.namelist()


def test_bill_of_materials(wheel):
    """Every data file of the wheel, with the checksum that it has, a licence and a source."""
    name = next(name for name in wheel.namelist() if name.endswith("dist-info/sboms/sbom.cdx.json"))
    listed = {item["name"]: item for item in json.loads(wheel.read(name))["components"]}
    shipped = [name for name in wheel.namelist() if re.match(r"warpsim_catalogs/[^/]*\.(csv|npy|npz|toml)$", name)]
    assert {f"warpsim_catalogs/{name}" for name in listed} == set(shipped)
    for path in shipped:
        item = listed[path.split("/")[1]]
        assert item["hashes"][0]["content"] == hashlib.sha256(wheel.read(path)).hexdigest()
        assert item["licenses"] and item["properties"]


def test_one_version():
    cited = re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), re.M)
    assert cited and cited[1] == ws.__version__


def test_metadata(wheel):
    name = next(name for name in wheel.namelist() if name.endswith("dist-info/METADATA"))
    metadata = wheel.read(name).decode()
    assert "License-Expression: Apache-2.0 AND CC-BY-SA-3.0-IGO" in metadata
    assert "Requires-Python: >=3.11" in metadata
    core = [line for line in metadata.splitlines() if line.startswith("Requires-Dist:") and "extra ==" not in line]
    packages = {line.split()[1].split(">")[0].lower() for line in core}
    assert packages == {"numpy", "warp-lang", "astropy", "skyfield", "sgp4", "openimageio", "pydantic", "scipy"}


def test_kernels_import_only_warp():
    for path in (ROOT / "kernels" / "warpsim_kernels").glob("*.py"):
        for line in path.read_text().splitlines():
            words = line.split()
            if len(words) > 1 and words[0] in ("from", "import") and not line.startswith(" "):
                known = ("warp", "functools", "math", "typing", "warpsim_kernels")
                assert words[1].split(".")[0] in known, f"{path}: {line}"


def test_no_module_imports_the_whole_package():
    """It imports all others, so that whoever imports it is in a circle."""
    for path in (ROOT / "warpsim").rglob("*.py"):
        if path.parent != ROOT / "warpsim" or path.name != "__init__.py":
            for line in path.read_text().splitlines():
                assert not re.match(r"\s*(import warpsim( |$)|from warpsim import )", line), f"{path}: {line}"


def linted(folder):
    """Exit code and report of the contracts on imports, for a copy of the sources."""
    pytest.importorskip("importlinter")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(folder / "kernels")])}
    command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command; lint_imports_command()"]
    done = subprocess.run(
        [*command, "--no-cache"], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout


@pytest.fixture
def sources(tmp_path):
    for name in ("warpsim", "kernels"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def test_imports_run_one_way(sources):
    code, report = linted(sources)
    assert code == 0, report


@pytest.mark.parametrize(
    ("path", "planted", "broken"),
    [
        ("optics/camera.py", "if TYPE_CHECKING:\n    from warpsim.scene.sensors import Sensor", "Imports run one way"),
        ("orbit/walker.py", "def late():\n    from warpsim.orbit.constellations import ListedSatellites", "No circles"),
        ("render/truth.py", "from warpsim.render.frameset import FrameSet", "No circles"),
    ],
)
@pytest.mark.ci
def test_a_planted_circle_is_found(sources, path, planted, broken):
    """Whether it is for type checkers, in a function, or plain."""
    module = sources / "warpsim" / path
    module.write_text(f"from typing import TYPE_CHECKING\n{planted}\n{module.read_text()}")
    code, report = linted(sources)
    assert code == 1
    assert f"{broken}" in report.split("Broken contracts")[1]
