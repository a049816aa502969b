"""What lies behind stars and targets, and how much of it is in a pixel?

    python examples/13_what_lies_behind.py

Four cameras on one satellite of the paper's constellation: past the Earth's limb in band A, straight down at the day
side in the visible, along the ecliptic where zodiacal light is brightest in band E, and at the same field with
radiation hits and flickering pixels in its detector. Prints the level behind each in NEI, draws the images, and below
them a cut from top to bottom. With --quick: fewer pixels.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import warpsim as ws

DETECTOR = {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "bits": 16, "counts_per_nei": 20.0}
BRIGHT = {"kind": "nei", "nei_w_cm2": 1e-16, "sei_w_cm2": 1e-10, "bits": 16, "counts_per_nei": 0.05}
DAYLIGHT = BRIGHT | {"nei_w_cm2": 2e-13, "sei_w_cm2": 2e-7}
HARSH = DETECTOR | {
    "hits": {"rate_cm2_s": 60.0, "nei_per_um": 60.0, "integration_s": 0.1, "pixel_pitch_um": 60.0},
    "flicker": {"fraction": 2e-3, "nei": 400.0},
}
VIEWS = {  # title: band, field [deg], pointing, detector
    "past the limb": ("A", 3.0, {"azimuth_elevation_deg": [90.0, -36.4]}, BRIGHT),
    "straight down": ("G", 60.0, {"azimuth_elevation_deg": [0.0, -90.0]}, DAYLIGHT),
    "the ecliptic": ("E", 30.0, {"ra_dec_deg": [352.0, -4.0]}, DETECTOR),
    "hit by protons": ("E", 30.0, {"ra_dec_deg": [352.0, -4.0]}, HARSH),
}


def scene_of(band: str, fov_deg: float, pointing: dict, detector: dict, n_pixel: int) -> ws.Scene:
    """The paper's satellites with another camera, and all that lies behind."""
    return ws.Scene.load("stss").replace(
        camera={"n_row": n_pixel, "n_col": n_pixel, "fov_deg": fov_deg}, bands=[band], detector=detector,
        pointing={"kind": "fixed", **pointing}, background={"zodiacal": True, "earth": True},
        optics__psf="gaussian", optics__sigma_px=0.7,
    )  # fmt: skip


def satellite_above(scenario: ws.Scenario, ra_dec_deg: list[float] | None) -> str:
    """The satellite that is highest towards a direction, the Sun's when left out, at the epoch."""
    towards = scenario.position_m("sun", [0.0])[0]
    if ra_dec_deg is not None:
        ra, dec = np.radians(ra_dec_deg)
        towards = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    return max(scenario.sensor_names, key=lambda name: scenario.position_m(name, [0.0])[0] @ towards)


def main(output: Path, quick: bool = False) -> None:
    """Draw the four views to `output`."""
    figure, axes = plt.subplots(2, 4, figsize=(14, 6), height_ratios=[3, 1], layout="constrained")
    for (title, (band, fov_deg, pointing, detector)), (upper, lower) in zip(VIEWS.items(), axes.T, strict=True):
        scene = scene_of(band, fov_deg, pointing, detector, 96 if quick else 256)
        sensor = satellite_above(scene.scenario, pointing.get("ra_dec_deg"))
        frames = ws.Renderer(scene).render([0], sensors=[sensor], keep_signal=True)
        level = frames.instrument.levels[band]
        signal_nei = (frames.counts.numpy()[0, 0, 0] - level.blank_counts) / level.counts_per_nei
        behind_nei = np.median(frames.signal_w_cm2.numpy()[0, 0, 0], axis=1) / level.nei_w_cm2
        low, high = np.percentile(signal_nei, [1.0, 99.0])
        upper.imshow(signal_nei, cmap="gray", vmin=low, vmax=high)
        upper.set(title=f"{title}: {band}, {fov_deg:g} deg", xticks=[], yticks=[])
        lower.plot(behind_nei)
        lower.set(xlabel="row", ylabel="median of a row [NEI]", ylim=(0.0, None))
        print(f"{title:15} {behind_nei.min():10.3g} to {behind_nei.max():.3g} NEI, {len(frames.artifacts)} pixels hit")
    figure.savefig(output, dpi=75 if quick else 110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("13_what_lies_behind.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
