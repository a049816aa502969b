"""A hundred million stars in a HATS folder: memory, time to the first frame, frames per second.

    python -m benchmarks.star_tiles FOLDER --json benchmarks/results/programs/star_tiles.json

Writes the folder if it is not there (2.2 GB, two minutes): synthetic stars, 2.5 million of a seed, in tiles of order 4.
Then a process of its own, of one thread, renders frames of `stss` with it, and the same frames with the stars of its
tiles as a catalog in memory, by turns.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import warpsim as ws
from benchmarks.programs import parser_of, write_or_print

ORDER = 4
STARS_OF_A_SEED = 2_500_000
ROUNDS = 15


def write_folder(folder: Path, n_star: int) -> None:
    """Write synthetic stars as a HATS folder."""
    import pyarrow as pa
    import pyarrow.parquet as pq
    from astropy import units as u
    from astropy_healpix import lonlat_to_healpix

    n_pixel = 12 * 4**ORDER
    parts: list[list[Any]] = [[] for _ in range(n_pixel)]
    for seed, first in enumerate(range(0, n_star, STARS_OF_A_SEED)):
        stars = ws.StarCatalog.synthetic(min(STARS_OF_A_SEED, n_star - first), sky="infrared", seed=seed)
        pixel = lonlat_to_healpix(stars.ra_deg * u.deg, stars.dec_deg * u.deg, 2**ORDER, order="nested")
        rows = np.argsort(pixel, kind="stable")
        start = np.searchsorted(pixel[rows], np.arange(n_pixel + 1))
        flux_jy, temperature_k = stars.flux_jy("A").astype(np.float32), stars.temperature_k.astype(np.float32)
        columns = [stars.ra_deg, stars.dec_deg, flux_jy, temperature_k, stars.luminosity.astype(np.int8)]
        for number in range(n_pixel):
            here = rows[start[number] : start[number + 1]]
            if len(here):
                parts[number].append([column[here] for column in columns])
    data = folder / "dataset" / f"Norder={ORDER}" / "Dir=0"
    data.mkdir(parents=True)
    names = ["ra_deg", "dec_deg", "flux_A_jy", "temperature_k", "luminosity"]
    info = ["Norder,Npix,num_rows"]
    for number, part in enumerate(parts):
        if part:
            table = pa.table({name: np.concatenate([one[k] for one in part]) for k, name in enumerate(names)})
            pq.write_table(table, data / f"Npix={number}.parquet", compression="zstd")
            info.append(f"{ORDER},{number},{len(table)}")
    (folder / "partition_info.csv").write_text("\n".join(info) + "\n")
    (folder / "hats.properties").write_text("hats_frame=equatorial\n")  # last: a folder without it is not complete


def measure(folder: Path) -> dict[str, Any]:
    """Render with the folder, and with what it has read as a catalog in memory."""

    def gigabytes() -> float:
        # Of this program alone: ru_maxrss begins with that of the process that started it.
        (line,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) / 1e6

    start = time.perf_counter()
    scene = ws.Scene.load("stss")
    tiled = ws.Renderer(scene.replace(sky={"catalog": str(folder)}), n_thread=1)
    sensor = tiled.sensors_with_access[0]

    def rendered(renderer: ws.Renderer, frames: range) -> Any:
        return renderer.render(frames, sensors=sensor, bands="A").counts.numpy()

    rendered(tiled, range(60, 61))
    found = {"n_star": len(tiled._skies.tiles), "first_frame_s": time.perf_counter() - start}
    found["first_frame_gb"] = gigabytes()
    before = time.perf_counter()
    rendered(tiled, range(160))
    found |= {"sweep_frames": 160, "sweep_s": time.perf_counter() - before, "sweep_gb": gigabytes()}
    stars = next(iter(tiled._pipelines.values())).scene.stars
    found |= {"n_tile": len(stars.tiles), "n_star_read": len(stars.index)}
    whole = ws.Renderer(scene, n_thread=1, catalog=tiled._skies.tiles.catalog(stars.tiles)[0])
    for name, frames in (("1", range(60, 61)), ("20", range(60, 80)), ("160", range(160))):
        same = np.array_equal(rendered(tiled, frames), rendered(whole, frames))
        times: dict[str, list[float]] = {"tiled": [], "whole": []}
        for _ in range(ROUNDS):
            for kind, renderer in (("tiled", tiled), ("whole", whole)):
                before = time.perf_counter()
                rendered(renderer, frames)
                times[kind].append((time.perf_counter() - before) / len(frames))
        median = {kind: statistics.median(values) for kind, values in times.items()}
        ratio = statistics.median(b / a for a, b in zip(times["tiled"], times["whole"], strict=True))
        found[f"calls_of_{name}"] = {
            "tiled_ms": 1e3 * median["tiled"], "in_memory_ms": 1e3 * median["whole"], "speed": ratio, "equal": same
        }  # fmt: skip
    return found


def main() -> None:
    """Write the folder unless it is there, measure, and print the result or write it."""
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--n-star", type=int, default=100_000_000)
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        print(json.dumps(measure(options.folder)))
        return
    if not (options.folder / "hats.properties").is_file():
        write_folder(options.folder, options.n_star)
    command = [sys.executable, "-m", "benchmarks.star_tiles", str(options.folder), "--child"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    found = json.loads(done.stdout.strip().splitlines()[-1])
    write_or_print("python -m benchmarks.star_tiles FOLDER", found, options.json)


if __name__ == "__main__":
    main()
