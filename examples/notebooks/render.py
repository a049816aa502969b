"""Execute the notebooks at full size, and write them with their pictures beside their sources.

    python examples/notebooks/render.py [SOURCE.py ...]

A source is a Python file in jupytext's percent format. All of them if none is named; needs the extra `notebooks`. What
depends on the machine or the moment is left out: times of execution, progress bars, random names of cells.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

import jupytext
import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).parent
KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}
NO_GPU = "Warp CUDA warning: Could not find or load the NVIDIA CUDA driver"  # by Warp's native part; true, and harmless
WIDGET = "application/vnd.jupyter.widget-view+json"  # a progress bar, of which nothing is left without its kernel


def read_source(path: Path) -> nbformat.NotebookNode:
    """The cells of a source as a notebook without outputs, with names that do not change from time to time."""
    notebook = jupytext.read(path, fmt="py:percent")
    for number, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{number:02d}"
        cell["metadata"] = {}
    notebook.metadata = nbformat.from_dict({"kernelspec": KERNEL, "language_info": {"name": "python"}})
    return notebook


def execute(path: Path) -> nbformat.NotebookNode:
    """The notebook of a source with its outputs.

    Raises:
        RuntimeError: A cell writes to the error stream.
        CellExecutionError: A cell fails.
    """
    notebook = read_source(path)
    client = NotebookClient(
        notebook,
        timeout=600,
        kernel_name="python3",
        record_timing=False,
        store_widget_state=False,
        resources={"metadata": {"path": str(HERE)}},
    )
    client.execute()
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell["outputs"] = [output for output in cell.outputs if is_kept(output)]
    return notebook


def is_kept(output: Any) -> bool:
    """Whether an output is of the notebook, not of the machine.

    Raises:
        RuntimeError: It is a warning or an error.
    """
    if output.get("name") == "stderr":
        unknown = [line for line in output.text.splitlines() if line.strip() and not line.startswith(NO_GPU)]
        if unknown:
            raise RuntimeError(f"on the error stream: {unknown[0]}")
        return False
    return WIDGET not in output.get("data", {})


def main(names: list[str]) -> None:
    """Render the sources named, or all."""
    os.environ.pop("WARPSIM_NOTEBOOKS", None)  # full size
    for path in map(Path, names) if names else sorted(HERE.glob("[0-9]*.py")):
        start_s = time.perf_counter()
        notebook = execute(path)
        target = path.with_suffix(".ipynb")
        nbformat.write(notebook, target)
        print(f"{target.name}: {target.stat().st_size / 1e3:.0f} kB after {time.perf_counter() - start_s:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1:])
