"""What does a scenario look like, from outside, from a satellite, and within the group (the paper's Fig. 7)?

    python examples/07_scenario_pictures.py

Four panels: the whole scene with the lines of sight at one instant; what one of the satellites sees then; the group
about its main target, radial, along-track and cross-track; and how targets of each kind are turned. Also writes the
scene beside the picture for Cesium, NAME.czml, where the package czml3 is installed.
With --quick: without stars.
"""

import argparse
import importlib.util
from pathlib import Path

import matplotlib.pyplot as plt

import warpsim as ws
from warpsim.plot import plot_attitudes, plot_group, plot_satellite_view, plot_scene

TIME_S = 600.0
SENSOR = "sat11"


def main(output: Path, quick: bool = False) -> None:
    """Draw the four panels to `output`."""
    scene = ws.Scene.load("stss")
    if quick:
        scene = scene.replace(sky__catalog="none")
    seeing = [name for name in scene.sensor_names if scene.scenario.has_access(name, TIME_S)[0]]
    print(f"at {TIME_S:g} s {', '.join(seeing)} have access to {scene.target_names[0]}")

    figure = plt.figure(figsize=(16, 15), layout="constrained")
    quarters = figure.add_gridspec(2, 2, height_ratios=[1.1, 1])
    plot_scene(scene, TIME_S, ax=figure.add_subplot(quarters[0, 0]))
    plot_satellite_view(scene, SENSOR, TIME_S, ax=figure.add_subplot(quarters[0, 1]))
    sides = quarters[1, 0].subgridspec(2, 2)
    plot_group(scene, TIME_S, axes=[figure.add_subplot(sides[row, column]) for row in (0, 1) for column in (0, 1)])
    plot_attitudes(scene, TIME_S, ax=figure.add_subplot(quarters[1, 1]))
    figure.savefig(output, dpi=70 if quick else 120)

    if importlib.util.find_spec("czml3") is not None:
        error_m = ws.write_czml(scene, output.with_suffix(".czml"), overwrite=True)
        print(f"{output.with_suffix('.czml')}: positions within {error_m * 1e3:.0f} mm where Cesium interpolates")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("07_scenario_pictures.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
