"""How do spin, precession and rolling show in the light curve of an unresolved target (the paper's Figs. 11 and 12)?

    python examples/03_signal_to_noise_over_time.py

Left: SNR of one target of each type over a whole access. Middle: three seconds of it, sampled every hundredth. Right:
what the cylinder's light is made of. SNR is the irradiance at the pupil over the NEI. With --quick: fewer samples.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import warpsim as ws

SENSOR, BAND = "sat47", "A"
TARGETS = {
    "center": "cone 1, 3 deg at 1/s",
    "sphere01": "sphere",
    "cylinder01": "cylinder",
    "cone01": "cone 2, 10 deg at 5/s",
}
LONG_STEP_S = 0.73  # no multiple of the periods (1, 1/3, 1/5 s): whole seconds would freeze the motion
SHORT_START_S, SHORT_STEP_S, SHORT_LENGTH_S = 700.0, 0.01, 3.0


def main(output: Path, quick: bool = False) -> None:
    """Draw three panels to `output`, and print by how much micromotion changes each target's light."""
    scene = ws.Scene.load("stss")
    access = scene.access()
    start_s, end_s = access[access["sensor"] == SENSOR]["start_s", "end_s"][0]
    slower = 8 if quick else 1
    wanted = {"sensors": [SENSOR], "targets": list(TARGETS), "bands": [BAND]}
    long = ws.light_curves(scene, np.arange(start_s, end_s, LONG_STEP_S * slower), **wanted)
    short_s = SHORT_START_S + np.arange(0.0, SHORT_LENGTH_S, SHORT_STEP_S * slower)
    short = ws.light_curves(scene, short_s, **wanted)

    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(15, 5), layout="constrained")
    for number, (name, label) in enumerate(TARGETS.items()):
        left.plot(long.time_s, long.snr[:, 0, 0, number], ".", markersize=2.5, label=label)
        middle.plot(short.time_s, short.snr[:, 0, 0, number], label=label)
        curve = short.snr[:, 0, 0, number]
        swing = 100 * np.ptp(curve) / curve.mean()
        print(f"{name:10s} SNR {curve.mean():6.2f}, micromotion {swing:5.1f} % peak to peak")
    terms = {name: values[:, 0, 0, 2] / scene.detector.nei_w_cm2 for name, values in short.terms_w_cm2.items()}
    kept = {name: values for name, values in terms.items() if values.any()}
    right.stackplot(short.time_s, list(kept.values()), labels=list(kept))

    left.set(ylabel=f"SNR, band {BAND}", title=f"{SENSOR}: whole access, every {LONG_STEP_S * slower:g} s")
    middle.set(title=f"micromotion, every {SHORT_STEP_S * slower:g} s", ylabel="SNR")
    right.set(title=f"{list(TARGETS)[2]}: terms of its light", ylabel="SNR")
    for axes in (left, middle, right):
        axes.set_xlabel("time after the epoch [s]")
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
    left.legend(markerscale=4)
    right.legend()
    figure.savefig(output, dpi=150)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("03_signal_to_noise_over_time.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
