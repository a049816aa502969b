"""The examples run in their quick mode, and draw something."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import slow

pytest.importorskip("matplotlib")

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("[0-9]*.py"))
SMALLEST_SIDE_PX = 400
FEWEST_GREYS = 20


@pytest.fixture(autouse=True)
def in_temporary_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    yield
    from matplotlib import pyplot as plt

    plt.close("all")


def test_examples_are_found():
    assert len(EXAMPLES) >= 5


@pytest.mark.parametrize(
    "script",
    [slow(path) if path.stem == "12_visible_to_lwir" else path for path in EXAMPLES],
    ids=lambda path: path.stem,
)
@pytest.mark.ci
def test_quick_mode_draws_a_picture(script, monkeypatch, tmp_path):
    from matplotlib import image

    monkeypatch.setattr(sys, "argv", [str(script), "--quick"])
    runpy.run_path(str(script), run_name="__main__")
    picture = image.imread(tmp_path / f"{script.stem}.png")
    assert min(picture.shape[:2]) >= SMALLEST_SIDE_PX
    assert len(np.unique(picture[..., :3])) >= FEWEST_GREYS


@pytest.mark.parametrize("script", EXAMPLES, ids=lambda path: path.stem)
def test_docstring_gives_the_command(script):
    docstring = script.read_text().split('"""')[1]
    assert f"python examples/{script.name}" in docstring
    assert docstring.splitlines()[0].endswith("?") or "?" in docstring.split("\n\n")[0]
