"""The wheel: three import packages, with their data, and nothing else at the top level."""

import zipfile
from pathlib import Path

import pytest

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
        "warpsim/radiometry/msx_responses.csv",
        "warpsim_catalogs/hip_gaia_ir_v1.npz",
        "warpsim_catalogs/LICENSE-hip-gaia-ir.md",
        "warpsim_kernels/deposit_table.py",
    ],
)
def test_data_travels(wheel, name):
    assert name in wheel.namelist()


def test_metadata(wheel):
    name = next(name for name in wheel.namelist() if name.endswith("dist-info/METADATA"))
    metadata = wheel.read(name).decode()
    assert "License-Expression: Apache-2.0 AND CC-BY-SA-3.0-IGO" in metadata
    assert "Requires-Python: >=3.11" in metadata
    core = [line for line in metadata.splitlines() if line.startswith("Requires-Dist:") and "extra ==" not in line]
    packages = {line.split()[1].split(">")[0].lower() for line in core}
    assert packages == {"numpy", "warp-lang", "astropy", "skyfield", "sgp4", "openimageio", "pydantic"}


def test_imports_run_one_way():
    """Rooms import only rooms to the right: plot, dataset -> output -> render -> scene -> parts; kernels only Warp."""
    rank = {"cli": 6, "dataset": 5, "plot": 5, "output": 4, "labels": 3, "render": 2, "scene": 1}
    rank |= dict.fromkeys(("sky", "target", "orbit", "optics", "detector", "exchange"), 0)
    for path in (ROOT / "warpsim").rglob("*.py"):
        here = path.relative_to(ROOT / "warpsim").parts[0].removesuffix(".py")
        if here not in rank:
            continue
        for line in path.read_text().splitlines():
            words = line.split()
            if len(words) > 1 and words[0] in ("from", "import") and words[1].startswith("warpsim."):
                there = words[1].split(".")[1]
                assert rank.get(there, 0) <= rank[here], f"{path}: {line}"
    for path in (ROOT / "kernels" / "warpsim_kernels").glob("*.py"):
        for line in path.read_text().splitlines():
            words = line.split()
            if len(words) > 1 and words[0] in ("from", "import") and not line.startswith(" "):
                known = ("warp", "functools", "math", "typing", "warpsim_kernels")
                assert words[1].split(".")[0] in known, f"{path}: {line}"
