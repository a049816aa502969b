"""How do spin, precession and rolling show in the light curve of an unresolved target (the paper's Figs. 11 and 12)?

    python examples/03_signal_to_noise_over_time.py

Left: SNR of one target of each type over a whole access. Right: three seconds of it, sampled every hundredth.
SNR is the irradiance at the pupil over the NEI. With --quick: fewer samples.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt

import warpsim as ws

SENSOR, BAND = "sat47", "A"
TARGETS = {"center": "main cone", "sphere01": "sphere", "cylinder01": "cylinder", "cone01": "cone, 10 deg precession"}
LONG_STEP_S = 0.73  # no multiple of the periods (1, 1/3, 1/5 s): whole seconds would freeze the motion
SHORT_START_S, SHORT_STEP_S, SHORT_LENGTH_S = 700.0, 0.01, 3.0
BATCH = 500  # frames rendered at a time


def light_curves(scene: ws.Scene, start_s: float, step_s: float, count: int) -> dict[str, tuple]:
    """Times [s] and SNR of each target of TARGETS."""
    frames = {"start_s": start_s, "interval_s": step_s, "count": count}
    # snr does not depend on the number of pixels: a small image is enough.
    scene = scene.replace(frames=frames, camera__n_row=32, camera__n_col=32)
    renderer = ws.Renderer(scene)
    curves = {name: ([], []) for name in TARGETS}
    for first in range(0, count, BATCH):
        numbers = range(first, min(first + BATCH, count))
        truth = renderer.render(numbers, sensors=[SENSOR], bands=[BAND]).truth
        for name, (time_s, snr) in curves.items():
            rows = truth[truth["target"] == name]
            time_s.extend(rows["time_s"])
            snr.extend(rows["snr"])
    return curves


def main(output: Path, quick: bool = False) -> None:
    """Draw both panels to `output`."""
    scene = ws.Scene.load("stss")
    access = scene.access()
    start_s, end_s = access[access["sensor"] == SENSOR]["start_s", "end_s"][0]
    slower = 8 if quick else 1
    long_step_s, short_step_s = LONG_STEP_S * slower, SHORT_STEP_S * slower
    long = light_curves(scene, start_s, long_step_s, int((end_s - start_s) / long_step_s))
    short = light_curves(scene, SHORT_START_S, short_step_s, int(SHORT_LENGTH_S / short_step_s))

    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 5), sharey=True, layout="constrained")
    for name, label in TARGETS.items():
        left.plot(*long[name], ".", markersize=2.5, label=label)
        right.plot(*short[name], label=label)
        print(f"{name:10s} SNR {min(long[name][1]):6.2f} to {max(long[name][1]):6.2f}")
    left.set(ylabel=f"SNR, band {BAND}", title=f"{SENSOR}: whole access, every {long_step_s:g} s")
    right.set(title=f"{SENSOR}: micromotion, every {short_step_s:g} s")
    left.legend(markerscale=4)
    for axes in (left, right):
        axes.set_xlabel("time after the epoch [s]")
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
    figure.savefig(output, dpi=150)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("03_signal_to_noise_over_time.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
