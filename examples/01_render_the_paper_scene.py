"""What do the satellites see? The paper's scene as files, and some of its images side by side (the paper's Fig. 9).

    python examples/01_render_the_paper_scene.py

Renders the preset `stss` into a folder, as `warpsim render stss -o FOLDER` does, then reads the FITS cubes back.
With --quick: two sensors, one band, few frames.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from astropy.io import fits

import warpsim as ws

SENSORS = ["sat11", "sat27", "sat41", "sat47"]
BAND = "A"
TIMES_S = [320.0, 480.0, 640.0, 800.0, 960.0, 1200.0, 1400.0]
CEILING_NEI = 30.0  # drawn black
ZOOM_PX = 64  # the middle of the 128 x 128 pixels


def main(output: Path, quick: bool = False) -> None:
    """Render into the folder `output` without its suffix, and draw images of it to `output`."""
    scene = ws.Scene.load("stss")
    folder = output.with_suffix("")
    if quick:
        sensors, times_s = SENSORS[1:3], TIMES_S[1:4]
        frames = [round(time_s / scene.frames.interval_s) for time_s in times_s]
        report = ws.render_to_folder(scene, folder, frames=frames, sensors=sensors, bands=[BAND])
    else:
        sensors, times_s = SENSORS, TIMES_S
        report = ws.render_to_folder(scene, folder, progress=True)
    print(report.text())

    figure, grid = plt.subplots(
        len(sensors), len(times_s), figsize=(1.7 * len(times_s) + 1.2, 1.8 * len(sensors) + 0.6), layout="constrained"
    )
    for row, sensor in zip(grid, sensors, strict=True):
        with fits.open(folder / f"{sensor}_{BAND}.fits") as cube:
            counts, header, shown_s = cube[0].data, cube[0].header, cube["FRAMES"].data["TIME_S"]
        for axes, time_s in zip(row, times_s, strict=True):
            axes.set(xticks=[], yticks=[], facecolor="0.92", box_aspect=1)
            near = np.flatnonzero(np.abs(shown_s - time_s) < 1e-6)
            if not len(near):
                axes.text(0.5, 0.5, "no access", ha="center", va="center", color="grey", transform=axes.transAxes)
                continue
            cut = [slice((n - ZOOM_PX) // 2, (n + ZOOM_PX) // 2) for n in counts.shape[1:]]
            nei = (counts[near[0]][*cut] - header["OFFSET"]) / header["CNTNEI"]
            image = axes.imshow(nei, cmap="gray_r", vmin=0, vmax=CEILING_NEI, interpolation="nearest")
        row[0].set_ylabel(sensor)
    for axes, time_s in zip(grid[0], times_s, strict=True):
        axes.set_title(f"{time_s:g} s", fontsize=10)
    figure.suptitle(f"{scene.name}: the middle {ZOOM_PX} x {ZOOM_PX} pixels")
    figure.colorbar(image, ax=grid, shrink=0.7, label=f"signal, band {BAND} [NEI]")
    figure.savefig(output, dpi=150)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("01_render_the_paper_scene.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
