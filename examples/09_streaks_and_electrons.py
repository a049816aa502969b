"""What does a camera that counts electrons see while it stares, and while it scans?

    python examples/09_streaks_and_electrons.py

Left: half a second of staring at the paper's targets; they move through a still camera, and their light pulses as they
tumble. Middle: the camera scans, and everything is drawn out. Right: the same scan by a poor detector, with uneven
gains, bad pixels and column noise. The NEI is what background, dark current and read-out imply. With --quick: smaller.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import warpsim as ws

SENSOR, BAND = "sat27", "A"
TIME_S, EXPOSURE_S = 800.0, 0.5
SCAN_DEG_S = 0.3
GOOD = {
    "kind": "electron",
    "exposure_s": EXPOSURE_S,
    "transmission": 0.7,
    "quantum_efficiency": 0.6,
    "background_w_cm2_sr": 2e-8,
    "dark_e_s": 2e3,
    "read_noise_e": 60.0,
    "full_well_e": 4e6,
    "gain_e_per_count": 250.0,
}
POOR = GOOD | {"prnu": 0.003, "column_noise_e": 1500.0, "dead_fraction": 0.003, "hot_fraction": 0.001}


def main(output: Path, quick: bool = False) -> None:
    """Draw three frames to `output`, and print what the detector's electrons mean as irradiance."""
    scene = ws.Scene.load("stss").replace(
        frames={"count": 1, "interval_s": 10.0, "start_s": TIME_S},
        camera={"n_row": 64, "n_col": 64, "fov_deg": 0.2} if quick else {"n_row": 160, "n_col": 160, "fov_deg": 0.5},
        detector=GOOD,
    )
    levels = scene.scenario.instrument.levels[BAND]
    print(f"blank sky: {levels.background_e:.0f} e of light, {levels.dark_e:.0f} e dark, noise {levels.noise_e:.0f} e")
    print(f"implied NEI {levels.nei_w_cm2:.2e} W/cm2, SEI {levels.sei_w_cm2:.2e} W/cm2")
    seen = scene.scenario.view_axes(SENSOR, [TIME_S])[0, 2]
    ra_deg, dec_deg = np.degrees(np.arctan2(seen[1], seen[0])), np.degrees(np.arcsin(seen[2]))
    stare = scene.replace(pointing={"kind": "fixed", "ra_dec_deg": (ra_deg, dec_deg)})
    rows = [
        {"time_s": TIME_S + after_s, "ra_deg": ra_deg, "dec_deg": dec_deg + SCAN_DEG_S * after_s}
        for after_s in (-EXPOSURE_S, EXPOSURE_S)
    ]
    scan = scene.replace(pointing={"kind": "table", "mode": "scan", "rows": rows})
    poor = scan.replace(detector=POOR)
    titles = {"staring": stare, f"scanning at {SCAN_DEG_S:g} deg/s": scan, "a poor detector": poor}

    figure, panels = plt.subplots(1, 3, figsize=(15, 5), layout="constrained")
    for axes, (title, view) in zip(panels, titles.items(), strict=True):
        frames = ws.Renderer(view).render([0], [SENSOR], [BAND])
        counts = frames.counts.numpy()[0, 0, 0]
        low, high = np.percentile(counts, (1, 99.7))
        axes.imshow(counts, cmap="gray", vmin=low, vmax=high, interpolation="nearest")
        streak_px = np.hypot(frames.truth["dx_px"], frames.truth["dy_px"])
        axes.set(title=f"{title}: targets move {streak_px[0]:.0f} px")
        axes.set(xlabel="column", ylabel="row")
    figure.savefig(output, dpi=120)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("09_streaks_and_electrons.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
