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
from warpsim.plot import plot_range

SENSORS = ["sat11", "sat27", "sat41", "sat47"]
STEP_S = 2.0


def main(output: Path, quick: bool = False) -> None:
    """Draw range and elevation against time to `output`."""
    scene = ws.Scene.load("stss")
    time_s = np.arange(0.0, scene.duration_s, STEP_S * (10 if quick else 1))
    target_m = scene.position_m(scene.target_names[0], time_s)
    lowest_deg = scene.access_rules.min_elevation_deg
    elevation_margin_deg = scene.scenario.access_margins(time_s)["elevation_deg"]

    figure, (upper, lower) = plt.subplots(2, 1, figsize=(9, 8), sharex=True, layout="constrained")
    plot_range(scene, SENSORS, ax=upper)
    colours = {line.get_label(): line.get_color() for line in upper.get_lines()}
    for sensor in SENSORS:
        range_km = np.linalg.norm(target_m - scene.position_m(sensor, time_s), axis=1) / 1e3
        elevation_deg = elevation_margin_deg[scene.sensor_names.index(sensor)] + lowest_deg
        seen = scene.scenario.has_access(sensor, time_s)
        lower.plot(time_s, elevation_deg, color=colours[sensor], linewidth=0.8)
        lower.plot(time_s, np.where(seen, elevation_deg, np.nan), color=colours[sensor], linewidth=3)
        print(f"{sensor}: {range_km[seen].min():.0f} to {range_km[seen].max():.0f} km while it has access")
    lower.axhline(lowest_deg, color="grey", linestyle="--", linewidth=1)
    lower.text(0, lowest_deg + 0.5, "lowest allowed", color="grey", fontsize=9)
    lower.set(xlabel="time after the epoch [s]", ylabel="elevation of the line of sight [deg]")
    lower.grid(alpha=0.3)
    upper.set_xlabel("")
    figure.savefig(output, dpi=150)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("04_range_and_access.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
