"""Results of benchmarks become tables with as many cells in a row as in the head, and a page with pictures."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.report import RESULTS, TOP, main, words_of, write_page
from benchmarks.tables import TABLES, plain_table, tables_of

COMMITTED = sorted(RESULTS.glob("*.json"))

SPEED = {"device": "cpu", "n_thread": 2, "n_pixel": 128, "n_star": 100, "psf": "airy"}
SAMPLES = {
    "fps": [{**SPEED, "n_sensor": n, "fps": 6070.0 * n, "paper_fps": 607, "psf_error": 1e-7} for n in (1, 20)],
    "stages": [{**SPEED, "n_pixel": n, "stage_us": {"aim": 1.0, "deposit": 9.0}, "whole_us": 12.0} for n in (128, 256)],
    "scaling": [
        *({"scaling": "pixels of an image", "x": x, "us_per_image": 2.0 + x} for x in (4, 16)),
        *({"scaling": "stars", "x": x, "us_per_image": 2.0, "gather_stars_us": 1.0} for x in (1000, 10_000)),
    ],
    "peers": [
        {
            **SPEED, "psf": psf, "peer": "Numba", "one_thread": False, "stamps": "default", "peer_threads": 2,
            "fps": 3e4, "peer_fps": 2e4, "ratio": 1.5, "ratio_quartiles": [1.4, 1.7], "n_pair": 9, "n_source": 140,
            "cores_of_others": 0.01, "error_nei": 0.1, "peer_error_nei": 0.2,
        }
        for psf in ("gaussian", "airy")
    ],
    "approximations": [
        {"setting": "optics.psf_error", "value": 1e-3, "us_per_image": 7.0, "error_nei": 1e-2, "n_pixel": 256},
        {"setting": "error of tracks [m]", "value": 1e-3, "scene_s": 0.1, "error_m": 9e-4, "n_node": 6000},
    ],
    "another": [{"first_s": 2.5, "cold": True}, {"first_s": 0.4}],
}  # fmt: skip


def check_tables(text):
    """Rows that follow each other have equally many cells."""
    blocks = re.findall(r"(?:^\|.*\|\n?)+", text, re.MULTILINE)
    assert blocks
    for block in blocks:
        rows = block.strip().split("\n")
        assert len(rows) > 2 and len({row.count("|") for row in rows}) == 1
        assert set(rows[1]) == {"|", "-"}


@pytest.fixture
def results(tmp_path):
    """A folder of made-up results."""
    head = {key: json.loads(COMMITTED[0].read_text())[key] for key in ("machine_info", "datetime")}
    folder = tmp_path / "results"
    folder.mkdir()
    for name, cases in SAMPLES.items():
        data = {**head, "benchmarks": [{"extra_info": case} for case in [*cases, {}]]}
        (folder / f"{name}.json").write_text(json.dumps(data))
    return folder


@pytest.mark.parametrize("path", COMMITTED, ids=lambda path: path.stem)
def test_committed_results_have_tables(path, capsys):
    main([str(path)])
    check_tables(capsys.readouterr().out)


@pytest.mark.ci
def test_page_has_a_section_and_a_picture_for_each_result(results, tmp_path):
    pytest.importorskip("matplotlib")
    page = tmp_path / "page.md"
    write_page(page, results)
    text = page.read_text()
    check_tables(text)
    titles = re.findall(r"^## (.*)", text, re.MULTILINE)
    assert titles == [words_of(name)[0] for name in ("fps", "peers", "stages", "scaling", "approximations", "another")]
    assert text.count("```console") == 5
    pictures = re.findall(r"!\[\w+\]\((.*)\)", text)
    assert [Path(name).stem for name in pictures] == ["peers", "stages", "scaling", "approximations"]
    assert all((tmp_path / name).stat().st_size > 5000 for name in pictures)


def test_figures_are_in_the_tables(results):
    text = "\n".join(tables_of(SAMPLES["peers"]))
    assert "| **1.50** (1.40 to 1.70) |" in text and "| 30,000 | 20,000 |" in text
    assert "| 128^2 | 20 | 100 | airy | cpu | 121,400 | 607 | 200.0 | 4,046 |" in "\n".join(tables_of(SAMPLES["fps"]))
    resident = {**SAMPLES["fps"][0], "device": "cuda:0", "resident": True}
    assert "| airy | cuda:0, resident |" in "\n".join(tables_of([resident]))
    assert "| 16 | 18.0 | 1e+03 |" in "\n".join(tables_of(SAMPLES["scaling"]))
    assert plain_table(SAMPLES["another"])[2:] == ["| 2.5 | True |", "| 0.4 | - |"]


def test_devices_have_tables_of_their_own():
    cases = [{"detector": "NEI", "ns_per_pixel": 1.5, "distance": None, "device": name} for name in ("cpu", "cuda:0")]
    lines = tables_of(cases)
    assert [line for line in lines if line.startswith("On ")] == ["On cpu:", "On cuda:0:"]
    assert lines.count("| NEI | 1.50 | - |") == 2 and len(lines) == 11
    assert not any(line.startswith("On ") for line in [*tables_of(cases[:1]), *tables_of(SAMPLES["fps"])])


def test_every_kind_of_table_has_a_result():
    kinds = [
        *SAMPLES.values(),
        *([b["extra_info"] for b in json.loads(p.read_text())["benchmarks"]] for p in COMMITTED),
    ]
    shown = {next((key for key in TABLES if any(key in case for case in cases)), None) for cases in kinds}
    assert shown == {*TABLES, None}


def test_every_benchmark_says_how_it_is_run():
    for path in sorted((TOP / "benchmarks").glob("test_*.py")):
        title, command, description = words_of(path.stem.removeprefix("test_"))
        assert title and description and f"benchmarks/{path.name}" in command


def test_report_runs_as_a_script(results):
    command = [sys.executable, str(TOP / "benchmarks" / "report.py"), str(results / "another.json")]
    done = subprocess.run(command, cwd=results, capture_output=True, text=True, check=True)
    assert "| first_s | cold |" in done.stdout
