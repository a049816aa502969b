"""Prints a Markdown table of a benchmark result: python benchmarks/report.py [RESULT.json]."""

from __future__ import annotations

import json
import sys
from pathlib import Path


def table(path: str) -> str:
    """Frames per second against resolution, with the paper's figure and the error of the point spread function."""
    data = json.loads(Path(path).read_text("utf-8"))
    machine = data["machine_info"]
    cases = sorted((b["extra_info"] for b in data["benchmarks"]), key=lambda c: (c["device"], c["psf"], c["n_pixel"]))
    lines = [
        f"{machine['cpu'].get('brand_raw', machine['processor'])}, {cases[0]['n_thread']} threads, "
        f"Python {machine['python_version']}, {data['datetime'][:10]}",
        "",
        "| pixels | PSF | device | frames/s | paper | ratio | worst PSF error per pixel |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {c['n_pixel']}^2 | {c['psf']} | {c['device']} | {c['fps']:,.0f} | {c['paper_fps']} "
        f"| {c['fps'] / c['paper_fps']:.1f} | {c['psf_error']:.1e} |"
        for c in cases
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(sys.argv[1] if len(sys.argv) > 1 else str(Path(__file__).parent / "results" / "fps.json")))
