"""How many stars does an infrared sensor meet, where, and how are they found (the paper's Figs. 5 and 6)?

    python examples/06_star_catalog.py

Draws star counts by band and magnitude, and the density over the sky of the default catalog beside that of the true
infrared sky, made up to the same flux limit: the default catalog was picked in visible light, which dust dims in the
galactic plane. A second picture, NAME_partition.png, shows three ways to cut the sky and what a view costs in each.
With --quick: a brighter limit for the synthetic sky.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import warpsim as ws
from warpsim.plot import plot_sky_density, plot_sky_partition, plot_star_counts
from warpsim.plot.partition_figure import costs_by_latitude

LIMIT_JY, DENSITY_PER_DEG2 = 0.116, (1.0, 150.0)  # of the default catalog in band A; ends of the maps' colour scale
QUICK_LIMIT_JY, QUICK_DENSITY_PER_DEG2 = 2.0, (0.1, 15.0)
LATITUDES_DEG = [0, 45, 60, 75, 89]


def main(output: Path, quick: bool = False) -> None:
    """Draw counts and maps to `output`, and the partition beside it."""
    default = ws.StarCatalog.default()
    limit_jy, density_per_deg2 = (QUICK_LIMIT_JY, QUICK_DENSITY_PER_DEG2) if quick else (LIMIT_JY, DENSITY_PER_DEG2)
    visible = ws.StarCatalog.from_table(default.to_table()[default.flux_jy("A") >= limit_jy])
    infrared = ws.StarCatalog.synthetic(limit_jy=limit_jy, sky="infrared")
    print(f"above {limit_jy:g} Jy in band A: {len(visible):,} stars picked in visible light, {len(infrared):,} in all")

    figure = plt.figure(figsize=(12, 7.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=[1.2, 1])
    plot_star_counts(default, ax=figure.add_subplot(grid[0, :]))
    for column, catalog in enumerate((visible, infrared)):
        ax = figure.add_subplot(grid[1, column])
        plot_sky_density(catalog, ax=ax, range_per_deg2=density_per_deg2)
        ax.set_title(f"{catalog.name}: {len(catalog):,} stars above {limit_jy:g} Jy in band A", fontsize=10)
    figure.savefig(output, dpi=150)

    axes = plot_sky_partition(default)
    axes[0].figure.savefig(output.with_stem(output.stem + "_partition"), dpi=150)
    latitude_deg, costs, _ = costs_by_latitude(default)
    print(f"stars read (cells opened) by a view of 1 x 1 deg:\n{'latitude':>24}", end="")
    rows = [int(np.argmin(np.abs(latitude_deg - value - 0.5))) for value in LATITUDES_DEG]
    print("".join(f"{f'{value}-{value + 1} deg':>14}" for value in LATITUDES_DEG))
    for name, cost in costs.items():
        cells = [f" ({cost['cells'][row]:.0f})" if "cells" in cost else "" for row in rows]
        print(f"{name:>24}" + "".join(f"{cost['stars'][row]:>8.0f}{n:6}" for row, n in zip(rows, cells, strict=True)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("06_star_catalog.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
