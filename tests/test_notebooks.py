"""The rendered notebooks are those of their sources, whole and clean. (`.ci/run` executes them, with nbmake.)"""

import base64
import re
from pathlib import Path

import pytest

jupytext = pytest.importorskip("jupytext")
import nbformat  # noqa: E402

FOLDER = Path(__file__).parents[1] / "examples" / "notebooks"
SOURCES = sorted(FOLDER.glob("[0-9]*.py"))
LARGEST_BYTES = 1_500_000  # a notebook is looked at on the web
SMALLEST_SIDE_PX = 300
OF_THE_MACHINE = re.compile(r"(?<![\w.])/(?:home|root|tmp|usr|opt|work|mnt|var|Users)/|0x[0-9a-f]{6,}")

pytestmark = pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)


def cells_of(notebook):
    return [(cell.cell_type, cell.source) for cell in notebook.cells]


def rendered(source):
    return nbformat.read(source.with_suffix(".ipynb"), as_version=4)


def outputs_of(notebook):
    return [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]


def text_of(output):
    """What a reader sees of an output as letters."""
    data = output.get("data", {})
    return "".join([output.get("text", ""), *(value for kind, value in data.items() if kind.startswith("text/"))])


def test_every_notebook_is_there(source):
    names = {path.stem for path in FOLDER.glob("*.ipynb")}
    assert len(SOURCES) == 7 and names == {path.stem for path in SOURCES}


def test_rendered_cells_are_those_of_the_source(source):
    notebook = rendered(source)
    nbformat.validate(notebook)
    assert cells_of(notebook) == cells_of(jupytext.read(source, fmt="py:percent"))


def test_all_cells_were_executed_in_order(source):
    counts = [cell.execution_count for cell in rendered(source).cells if cell.cell_type == "code"]
    assert counts == list(range(1, len(counts) + 1))


def test_outputs_are_clean(source):
    """No error, no warning, nothing of the machine."""
    for output in outputs_of(rendered(source)):
        text = text_of(output)
        assert output.output_type != "error" and output.get("name") != "stderr", text
        assert not OF_THE_MACHINE.search(text), text
        assert "Warning" not in text, text


def test_question_answer_and_pictures(source):
    notebook = rendered(source)
    assert "**Question.**" in notebook.cells[0].source
    headings = [cell.source for cell in notebook.cells if cell.cell_type == "markdown" and "## Answer" in cell.source]
    assert len(headings) == 1
    assert re.search(r"\d", text_of(notebook.cells[-1].outputs[-1]))
    pictures = [output.data["image/png"] for output in outputs_of(notebook) if "image/png" in output.get("data", {})]
    assert len(pictures) >= 3
    for picture in pictures:  # width and height stand behind the header of the first chunk
        head = base64.b64decode(picture)[16:24]
        assert min(int.from_bytes(head[:4], "big"), int.from_bytes(head[4:], "big")) >= SMALLEST_SIDE_PX
    assert source.with_suffix(".ipynb").stat().st_size < LARGEST_BYTES


def test_source_can_be_small(source):
    assert 'os.environ.get("WARPSIM_NOTEBOOKS") == "small"' in source.read_text()


def test_words_name_no_progress_that_is_lost(source):
    """Widgets live with their kernel only; their states would differ from one rendering to the next."""
    notebook = rendered(source)
    assert not any("widget" in kind for output in outputs_of(notebook) for kind in output.get("data", {}))
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
