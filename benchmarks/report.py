"""Shows benchmark results: one as Markdown tables, or all as a page with pictures.

python benchmarks/report.py RESULT.json [--plot PICTURE.png]   prints the tables of one result
python -m benchmarks.report                                    writes docs/benchmarks.md and its pictures
"""

from __future__ import annotations

import argparse
import ast
import json
import sys
from pathlib import Path
from typing import Any

TOP = Path(__file__).parents[1]
if __package__ in (None, ""):  # run as a script
    sys.path.insert(0, str(TOP))

from benchmarks.pictures import picture_of  # noqa: E402
from benchmarks.tables import Case, cases_of, tables_of  # noqa: E402

RESULTS = TOP / "benchmarks" / "results"
ORDER = (
    "fps", "peers", "peer_sdasim", "stages", "machine_code", "savings", "scaling", "approximations", "first_frame",
    "deposit", "read_out", "datasets", "signatures", "star_query", "star_places", "orbits", "access",
)  # fmt: skip
"""Of the sections; others come behind."""

HEAD = """\
# Benchmarks

Written by `python -m benchmarks.report` from the files in [benchmarks/results](../benchmarks/results): each section
has the command that measured its figures, and the machine. Where the time of an image goes is in
[performance.md](performance.md).
"""


def report(path: Path) -> str:
    """Machine, or compiler, and date, then the tables of a result of one of the benchmarks here."""
    data = json.loads(path.read_text("utf-8"))
    cases = cases_of(data)
    return "\n".join([f"{made_by(data, cases)}, {data['datetime'][:10]}", "", *tables_of(cases)])


def made_by(data: dict[str, Any], cases: list[Case]) -> str:
    """Origin of figures: the compiler of those that nothing was run for, the machine of others."""
    if "compiler" in data:
        return str(data["compiler"])
    machine = data["machine_info"]
    threads = {c["n_thread"] for c in cases if "n_thread" in c}
    count = f"{threads.pop()} threads, " if len(threads) == 1 and threads != {1} else ""
    cpu = machine["cpu"].get("brand_raw", machine["processor"])
    flags = machine["cpu"].get("flags", [])
    simd = "AVX-512, " if "avx512f" in flags else "AVX2, " if "avx2" in flags else ""
    return f"{cpu}, {simd}{count}Python {machine['python_version']}"


def words_of(name: str) -> tuple[str, str, str]:
    """Title, command and description of a benchmark: the parts of its module's docstring."""
    paths = [TOP / "benchmarks" / f"{stem}.py" for stem in (f"test_{name}", name)]
    path = next((path for path in paths if path.exists()), None)
    if path is None:
        return name, "", ""
    parts = (ast.get_docstring(ast.parse(path.read_text("utf-8"))) or name).split("\n\n")
    commands = [part for part in parts if part.startswith("    ")]
    return parts[0].rstrip("."), "\n\n".join(commands), "\n\n".join(p for p in parts[1:] if p not in commands)


def section(path: Path, picture_folder: Path) -> str:
    """A benchmark's part of the page; its picture is drawn."""
    title, command, description = words_of(path.stem)
    lines = [f"## {title.replace(chr(10), ' ')}", "", description, ""]
    if command:
        lines += ["```console", *(line.strip() for line in command.splitlines()), "```", ""]
    lines += [report(path), ""]
    draw = picture_of(cases_of(json.loads(path.read_text("utf-8"))))
    if draw is not None:
        picture = picture_folder / f"{path.stem}.png"
        draw(picture)
        lines += [f"![{path.stem}]({picture_folder.name}/{picture.name})", ""]
    return "\n".join(lines)


def write_page(page: Path, results: Path = RESULTS) -> None:
    """Write the page, with pictures in the folder of its name beside it."""
    folder = page.with_suffix("")
    folder.mkdir(exist_ok=True)
    place = {name: number for number, name in enumerate(ORDER)}
    paths = sorted(results.glob("*.json"), key=lambda path: (place.get(path.stem, len(place)), path.stem))
    page.write_text("\n".join([HEAD, *(section(path, folder) for path in paths)]).rstrip() + "\n", "utf-8")


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("result", type=Path, nargs="?", help="print the tables of this one")
    parser.add_argument("--plot", type=Path, metavar="PNG", help="also draw a result that has a picture")
    parser.add_argument("--page", type=Path, default=TOP / "docs" / "benchmarks.md", help="where the page is written")
    options = parser.parse_args(arguments)
    if options.result is None:
        write_page(options.page)
        print(f"written: {options.page}")
        return
    if not options.result.is_file():
        parser.error(f"{options.result}: no such file")
    print(report(options.result))
    if options.plot:
        draw: Any = picture_of(cases_of(json.loads(options.result.read_text("utf-8"))))
        if draw is None:
            parser.error(f"--plot: {options.result.name} has no picture")
        draw(options.plot)


if __name__ == "__main__":
    main()
