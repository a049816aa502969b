"""Build `warpsim_catalogs/coastlines_v1.npy` from Natural Earth's land, 1:110 million, as world-atlas holds it.

    npm pack world-atlas@2.0.2 && tar xf world-atlas-2.0.2.tgz
    python catalogs/build_coastlines.py package/land-110m.json

Natural Earth is in the public domain. The file is TopoJSON: arcs of whole numbers, each point as the difference from
the one before.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

OUTPUT = Path(__file__).parent / "warpsim_catalogs" / "coastlines_v1.npy"

PER_DEG = 100
"""Units of the file in a degree: its coordinates are good to 0.005 deg, 0.6 km."""

BREAK = 32767
"""Longitude and latitude between two lines."""


def main(source: Path) -> None:
    """Write the lines, without the cuts of the polygons at 180 degrees and at the pole."""
    topology = json.loads(source.read_text())
    scale, shift = (np.array(topology["transform"][name]) for name in ("scale", "translate"))
    lines = []
    for arc in topology["arcs"]:
        degrees = np.cumsum(arc, axis=0) * scale + shift
        on_cut = (np.abs(degrees[:, 0]) > 179.99) | (degrees[:, 1] < -89.99)
        keep = ~(on_cut[1:] & on_cut[:-1]) & (np.abs(np.diff(degrees[:, 0])) < 180)
        for part in np.split(np.arange(len(degrees)), np.flatnonzero(~keep) + 1):
            if len(part) > 1:
                lines += [np.rint(degrees[part] * PER_DEG), [[BREAK, BREAK]]]
    np.save(OUTPUT, np.concatenate(lines[:-1]).astype(np.int16))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
