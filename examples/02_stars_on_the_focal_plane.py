"""Where do the catalog's stars fall on the image, and does astropy agree?

    python examples/02_stars_on_the_focal_plane.py

Renders one image with a wide field, lists the stars in it (`keep_stars`), and finds every star's pixel a second way:
catalog place at the epoch -> aberration by the sensor's velocity -> astropy.wcs. With --quick: a quarter of the field.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import warpsim as ws

SENSOR, FRAME, BAND = "sat12", 141, "A"
FOV_DEG = 4.0
N_PIXEL = 512
FAINTEST_NEI = 10.0  # stars that get a circle
AGREEMENT_PX = 1e-6


def main(output: Path, quick: bool = False) -> None:
    """Draw the image with circles around its stars to `output`."""
    part = 0.5 if quick else 1.0
    n_pixel, fov_deg = int(N_PIXEL * part), FOV_DEG * part
    scene = ws.Scene.load("stss").replace(camera__n_row=n_pixel, camera__n_col=n_pixel, camera__fov_deg=fov_deg)
    frames = ws.Renderer(scene).render([FRAME], sensors=[SENSOR], bands=[BAND], keep_stars=True)
    stars = frames.stars[frames.stars["in_fov"]]
    wcs = frames.wcs(FRAME, SENSOR)

    catalog = ws.StarCatalog.default().at_epoch(scene.epoch.jyear)
    directions = catalog.direction_icrs[stars["catalog_row"]]
    x, y, z = ws.apparent_direction(directions, frames.velocity_m_s[0, 0]).T
    ra_deg, dec_deg = np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))
    x_px, y_px = wcs.all_world2pix(ra_deg, dec_deg, 0)  # 0: pixel centres of the first row and column at 0
    worst_px = np.hypot(x_px - stars["x_px"], y_px - stars["y_px"]).max()
    print(f"{len(stars)} stars in the field, warpsim and astropy.wcs agree to {worst_px:.1e} px")
    if not worst_px < AGREEMENT_PX:
        raise SystemExit(f"positions differ by {worst_px:g} px, more than {AGREEMENT_PX:g}")

    detector = scene.detector
    nei = (frames.counts[0, 0, 0].astype(float) - detector.offset_counts) / detector.counts_per_nei
    figure = plt.figure(figsize=(8, 7.2), layout="constrained")
    axes = figure.add_subplot(projection=wcs)
    image = axes.imshow(nei, cmap="gray_r", vmin=0, vmax=20, origin="lower", interpolation="nearest")
    axes.invert_yaxis()  # row 0 on top, which WCSAxes leaves to us
    bright = stars[stars["snr"][:, 0] > FAINTEST_NEI]
    axes.scatter(bright["x_px"], bright["y_px"], s=90, facecolors="none", edgecolors="tab:red", linewidths=0.8)
    targets = frames.truth[frames.truth["in_fov"]]
    axes.scatter(targets["x_px"].mean(), targets["y_px"].mean(), s=900, marker="s", facecolors="none", edgecolors="C0")
    axes.coords.grid(color="grey", alpha=0.4, linestyle=":")
    axes.set(xlabel="right ascension (apparent, ICRS axes)", ylabel="declination")
    when = f"{SENSOR}, {frames.time_s[0]:g} s, band {BAND}"
    axes.set_title(f"{when}: stars above {FAINTEST_NEI:g} NEI (red), targets (blue)")
    figure.colorbar(image, shrink=0.8, label="signal [NEI]")
    figure.savefig(output, dpi=150)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("02_stars_on_the_focal_plane.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
