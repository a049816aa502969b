"""What do a visible, a mid-wave and a long-wave infrared camera see of the same targets?

    python examples/12_visible_to_lwir.py

Each of 24 satellites (preset `visible_to_lwir`) carries three cameras whose bands the scene describes itself. Finds the
satellite that sees the sunlit group best, renders all three cameras at that time, and draws their bands over the
spectra of Sun, Earth and targets, the images, and the counts of stars per square degree. A white cone is brightest in
sunlight, bare metal reflects the Earth, and black balloons show in their own warmth. With --quick: a smaller figure.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import warpsim as ws

KINDS = ("visible", "mwir", "lwir")
COLOURS = {"white": "#009E73", "metal": "#CC79A7", "black": "#D55E00"}
SIDE_DEG = 0.12  # of what is drawn of each image
SPHERE_DEG2 = 360.0**2 / np.pi


def best_view(scenario: ws.Scenario) -> tuple[int, str]:
    """Frame and satellite with the brightest visible light of the white cone."""
    time_s = scenario.instruments["visible"].frame_time_s(range(scenario.scene.frames.count))
    curves = ws.light_curves(scenario, time_s, "visible", targets=["white"])
    seen = np.stack([scenario.has_access(name, time_s) for name in curves.sensors], axis=1)
    frame, sensor = np.unravel_index(np.where(seen, curves.snr[:, :, 0, 0], 0.0).argmax(), seen.shape)
    return int(frame), curves.sensors[sensor].split(".")[0]


def draw_image(axes, frames: ws.FrameSet, kind: str) -> None:
    """Draw the middle of an image in NEI, with the targets."""
    level = frames.instrument.levels[frames.bands[0]]
    signal_nei = (frames.counts.numpy()[0, 0, 0].astype(np.float64) - level.blank_counts) / level.counts_per_nei
    rows = frames.truth[frames.truth["access"] & frames.truth["in_fov"]]
    camera = frames.instrument.sensor.camera
    half_px = 0.5 * SIDE_DEG / camera.fov_deg * camera.n_col
    x_px, y_px = rows["x_px"].mean(), rows["y_px"].mean()
    axes.imshow(np.arcsinh(signal_nei), cmap="gray_r", vmin=-1.0, vmax=np.arcsinh(rows["snr_peak"].max()))
    for name, colour in COLOURS.items():
        some = rows[[target.startswith(name) for target in rows["target"]]]
        axes.scatter(some["x_px"], some["y_px"], s=60, facecolors="none", edgecolors=colour, label=name, linewidths=0.9)
        print(f"  {kind:8} {name:6} SNR {some['snr'].min():.3g} to {some['snr'].max():.3g}")
    axes.set(xlim=(x_px - half_px, x_px + half_px), ylim=(y_px + half_px, y_px - half_px), xticks=[], yticks=[])
    axes.set_title(f"{frames.sensors[0]}, {frames.bands[0]}: {2 * half_px:.0f} px", fontsize=10)


def main(output: Path, quick: bool = False) -> None:
    """Draw bands, images and star counts to `output`."""
    scenario = ws.Scenario(ws.Scene.load("visible_to_lwir"))
    renderer = ws.Renderer(scenario)
    frame, satellite = best_view(scenario)
    print(f"frame {frame}, {satellite}")
    figure = plt.figure(figsize=(12, 9), layout="constrained")
    grid = figure.add_gridspec(2, 3, height_ratios=[1.1, 1])
    ws.plot.plot_bands(scenario, figure.add_subplot(grid[0, :2]))
    counts = figure.add_subplot(grid[0, 2])
    for column, kind in enumerate(KINDS):
        frames = renderer.render([frame], [f"{satellite}.{kind}"])
        draw_image(axes := figure.add_subplot(grid[1, column]), frames, kind)
        (name, band), catalog = next(iter(scenario.instruments[kind].bands.items())), renderer.catalog_of(kind)
        in_nei = np.sort(catalog.irradiance_w_cm2(band) / scenario.instruments[kind].nei_w_cm2(name))[::-1]
        counts.loglog(in_nei, np.arange(1, len(in_nei) + 1) / SPHERE_DEG2, label=f"{name}, {len(catalog):,} stars")
    axes.legend(fontsize=8)
    counts.set(xlabel="irradiance [NEI]", ylabel="brighter stars per square degree", xlim=(0.3, 1e5))
    counts.legend(fontsize=8)
    figure.savefig(output, dpi=50 if quick else 110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("12_visible_to_lwir.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
