"""How far is the main target from each satellite, and when may it be observed (the paper's Fig. 8)?

    python examples/04_range_and_access.py

Geometry only, nothing is rendered. Thin lines: range; thick: access, that is all rules of `[access_rules]` hold.
Below: the elevation of the line of sight, whose rule ends most accesses (but range ends that of sat41, and the Sun
that of sat47).
With --quick: fewer points.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import warpsim as ws

SENSORS = ["sat11", "sat27", "sat41", "sat47"]
STEP_S = 2.0


def main(output: Path, quick: bool = False) -> None:
    """Draw range and elevation against time to `output`."""
    scene = ws.Scene.load("stss")
    time_s = np.arange(0.0, scene.duration_s, STEP_S * (10 if quick else 1))
    target_m = scene.position_m(scene.target_names[0], time_s)
    lowest_deg, farthest_km = scene.access_rules.min_elevation_deg, scene.access_rules.max_range_km
    elevation_margin_deg = scene.access_margins(time_s)["elevation_deg"]

    figure, (upper, lower) = plt.subplots(2, 1, figsize=(9, 8), sharex=True, layout="constrained")
    for number, sensor in enumerate(SENSORS):
        colour = f"C{number}"
        range_km = np.linalg.norm(target_m - scene.position_m(sensor, time_s), axis=1) / 1e3
        elevation_deg = elevation_margin_deg[scene.sensor_names.index(sensor)] + lowest_deg
        seen = scene.has_access(sensor, time_s)
        for axes, values in ((upper, range_km), (lower, elevation_deg)):
            axes.plot(time_s, values, color=colour, linewidth=0.8)
            axes.plot(time_s, np.where(seen, values, np.nan), color=colour, linewidth=3.5, label=sensor)
        print(f"{sensor}: {range_km[seen].min():.0f} to {range_km[seen].max():.0f} km while it has access")
    upper.axhline(farthest_km, color="grey", linestyle="--", linewidth=1, label="farthest allowed")
    lower.axhline(lowest_deg, color="grey", linestyle="--", linewidth=1)
    upper.set(ylabel="range to the main target [km]", ylim=(0, None), title="stss: thick lines mark access")
    lower.set(xlabel="time after the epoch [s]", ylabel="elevation of the line of sight [deg]")
    upper.legend(ncols=5, fontsize=9)
    lower.text(0, lowest_deg + 0.5, "lowest allowed", color="grey", fontsize=9)
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    figure.savefig(output, dpi=150)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("04_range_and_access.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
