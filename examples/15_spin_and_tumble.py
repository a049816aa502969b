"""How do spin and free tumbling show in the light of a target?

    python examples/15_spin_and_tumble.py

Two bodies on the paper's arc, seen by one satellite in band A: a cylinder that spins about its axis every 20 s, plain
and with a dark half, and a box that tumbles freely about its unstable axis. Draws their light over two minutes; a plain
cylinder's spin does not show, a painted one's does, and the box turns over again and again. With --quick: fewer times.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import warpsim as ws

SENSOR, BAND = "sat31", "A"
SPIN_S = 20.0
CYLINDER = {
    "shape": ws.Cylinder(radius_m=0.25, height_m=1.0), "temperature": {"start_k": 300.0},
    "attitude": {"spin_rev_s": 1 / SPIN_S, "precession_angle_deg": 70.0, "axis": [1.0, 0.0, 0.0], "spin_phase_rev": 0.0,
                 "precession_phase_rev": 0.0},
}  # fmt: skip
DARK_HALF = [{"azimuth_deg": [0.0, 180.0], "surface": {"emissivity": 0.1}}]
SIDES_M = np.array([1.0, 0.6, 0.2])
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) - 0.5
FACES = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
         [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
BOX = {
    "shape": ws.Mesh(vertices_m=CORNERS * SIDES_M, faces=FACES), "temperature": {"start_k": 300.0},
    "attitude": {"kind": "torque_free", "moments": (SIDES_M**2).sum() - SIDES_M**2, "rates_deg_s": [0.3, 20.0, 0.3],
                 "quaternion": [0.0, 0.0, 0.0, 1.0]},
}  # fmt: skip


def main(output: Path, quick: bool = False) -> None:
    """Draw the light of all to `output`."""
    bodies = {
        "cylinder": CYLINDER | {"surface": {"emissivity": 0.9}},
        "painted cylinder": CYLINDER | {"surface": {"emissivity": 0.9}, "patches": DARK_HALF},
        "box": BOX | {"surface": {"emissivity": 0.9}},
    }
    targets = [{"name": name.replace(" ", "_"), **body} for name, body in bodies.items()]
    scene = ws.Scene.load("stss").replace(targets=targets, sky__catalog="none")
    curves = ws.light_curves(scene, np.linspace(700.0, 820.0, 241 if quick else 1201), sensors=SENSOR, bands=BAND)
    figure, axes = plt.subplots(2, 1, figsize=(10, 7), sharex=True, layout="constrained")
    for k, (name, axis) in enumerate(zip(bodies, (axes[0], axes[0], axes[1]), strict=True)):
        light = curves.irradiance_w_cm2[:, 0, 0, k]
        axis.plot(curves.time_s, light, label=name)
        print(f"{name:17} {light.min():.3g} to {light.max():.3g} W/cm2")
    for axis in axes:
        axis.set(ylabel=f"band {BAND} [W/cm2]", ylim=(0.0, None))
        axis.legend(loc="upper right")
    axes[1].set_xlabel("time [s]")
    figure.savefig(output, dpi=75 if quick else 110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("15_spin_and_tumble.png"))
    parser.add_argument("--quick", action="store_true", help="fewer times")
    options = parser.parse_args()
    main(options.output, options.quick)
