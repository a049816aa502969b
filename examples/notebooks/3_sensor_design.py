# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 3. A sensor design trade
#
# **Question.** A sensor covers one degree in band A, with exposures of 0.02 s. Which aperture, and how many pixels,
# does it take to find a sphere of 10 cm at 300 K from far away?
#
# "Find" means here that the pixel it falls on has an SNR of 5. More pixels mean less background in each, but also
# less of the target's light once they are smaller than the image of a point. A detector in electrons says what NEI
# follows, the point spread function says what share of the light a pixel gets, and one point of the answer is checked
# by rendering many images.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np
import warp as wp
from IPython.display import Markdown
from tqdm.auto import tqdm

import warpsim as ws

wp.config.log_level = wp.LOG_ERROR  # otherwise Warp tells of every kernel that it loads
SMALL = os.environ.get("WARPSIM_NOTEBOOKS") == "small"  # the tests set it
BAND, FIELD_DEG, EXPOSURE_S, ALTITUDE_KM = "A", 1.0, 0.02, 1600.0
SNR_WANTED = 5.0

detector = ws.ElectronDetector(
    exposure_s=EXPOSURE_S,
    transmission=0.7,
    quantum_efficiency=0.6,
    zodiacal_mjy_sr=20.0,
    optics_temperature_k=90.0,
    optics_emissivity=0.05,
    dark_e_s=1e5,
    read_noise_e=100.0,
    full_well_e=2e6,
    gain_e_per_count=31.0,
    bits=16,
)


def scene_at(range_km, aperture_m=0.4, n_pixel=512, n_frame=1):
    """Sensor and sphere on one circular orbit, so that their distance stays as it is."""
    ahead_deg = 2 * np.degrees(np.arcsin(range_km / 2 / (6378.137 + ALTITUDE_KM)))
    orbit = {"inclination_deg": 65.0, "altitude_km": ALTITUDE_KM, "gravity": "two_body"}
    return ws.Scene(
        name="trade",
        epoch_utc="2025-06-01T00:00:00",
        duration_s=7200.0,
        frames={"count": n_frame, "interval_s": 1.0, "start_s": 1.0},
        bands=[BAND],
        constellation=ws.ListedSatellites([{"name": "eye", "orbit": ws.KeplerOrbit(**orbit)}]),
        trajectory=ws.KeplerOrbit(mean_anomaly_deg=ahead_deg, **orbit),
        targets=[
            {
                "name": "ball",
                "shape": ws.Sphere(0.05),
                "surface": {"emissivity": 0.9},
                "temperature": {"start_k": 300.0},
            }
        ],
        camera=ws.Camera(n_row=n_pixel, n_col=n_pixel, fov_deg=FIELD_DEG),
        optics=ws.Optics(aperture_m=aperture_m),
        detector=detector,
        pointing=ws.TrackPointing(jitter=ws.Jitter(rms_urad=100.0, correlation_s=2.0)),
        sky={"catalog": "none"},
        seed=3,
    )


# %% [markdown]
# ## The light
#
# Irradiance falls with the square of the range, so one number stands for the sphere: its intensity [W/sr], irradiance
# times range squared. Nearly all of it is the sphere's own light, and hardly changes over an orbit.

# %%
orbit_s = np.arange(0.0, 7080.0, 60.0)
curve = ws.light_curves(scene_at(3000.0), orbit_s)
range_cm = 1e5 * curve.range_km[:, 0, 0]
intensities_w_sr = curve.irradiance_w_cm2[:, 0, 0, 0] * range_cm**2
intensity_w_sr = intensities_w_sr.mean()
own = curve.terms_w_cm2["emitted"].sum() / curve.irradiance_w_cm2.sum()
print(
    f"intensity {intensity_w_sr:.4f} W/sr, +- {100 * intensities_w_sr.std() / intensity_w_sr:.2f} % over an orbit; "
    f"{100 * own:.1f} % are its own light"
)

# %% [markdown]
# ## The share of the light that a pixel gets
#
# The image of a point is as wide as lambda / D, the pixel as wide as the field over their number: all that matters is
# the ratio of the two. The share is the mean over all places in a pixel, as the target falls where it will. One curve
# serves the whole trade.

# %%
N_PHASE, SPACING_PX = (4, 48) if SMALL else (8, 48)
grid_px = SPACING_PX * (np.arange(N_PHASE) + 0.5) + (np.arange(N_PHASE) + 0.5) / N_PHASE - 0.5
places_px = np.array([(x, y) for y in grid_px for x in grid_px])  # one place in the pixel after the other, far apart


def mean_share(aperture_m, n_pixel):
    """Mean share of a point's light in the pixel that it falls on."""
    psf = ws.Optics(aperture_m=aperture_m).psf_for(BAND, ws.Camera(n_row=n_pixel, n_col=n_pixel, fov_deg=FIELD_DEG))
    side = N_PHASE * SPACING_PX
    image = ws.deposit(places_px, np.ones(len(places_px)), psf, (side, side))
    column, row = np.rint(places_px).astype(int).T
    return image[row, column].mean()


def pixels_per_image(aperture_m, n_pixel):
    """Width of the image of a point, lambda / D, in pixels."""
    return ws.BANDS[BAND].isophotal_um * 1e-6 / aperture_m * n_pixel / np.radians(FIELD_DEG)


n_sample = np.unique(np.geomspace(16, 4096, 7 if SMALL else 25).astype(int))
ratio = pixels_per_image(0.4, n_sample)
share = np.array([mean_share(0.4, n_pixel) for n_pixel in tqdm(n_sample, desc="patterns", leave=False)])

figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
axes.semilogx(ratio, share, "o-", markersize=4)
axes.set(
    xlabel=r"width of the image of a point, $\lambda / D$ [px]",
    ylabel="mean share of the light\nin the pixel of the target",
    ylim=(0, 1),
)
axes.grid(alpha=0.3)
plt.show()

# %% [markdown]
# ## The trade
#
# For each design the detector tells its NEI, and the range follows: R = sqrt(intensity * share / (5 NEI)).

# %%
base = scene_at(3000.0)
apertures_m = np.linspace(0.1, 1.0, 7 if SMALL else 19)
n_pixels = np.unique(np.geomspace(64, 2048, 7 if SMALL else 41).astype(int))


def nei_of(aperture_m, n_pixel):
    """NEI of a design [W/cm2]."""
    design = base.replace(optics__aperture_m=aperture_m, camera__n_row=int(n_pixel), camera__n_col=int(n_pixel))
    return design.scenario.instrument.nei_w_cm2(BAND)


nei_w_cm2 = np.array([[nei_of(d, n) for d in apertures_m] for n in tqdm(n_pixels, desc="designs", leave=False)])


def detection_range_km(share, nei_w_cm2):
    """Range at which the pixel of the target has the SNR wanted [km]."""
    return np.sqrt(intensity_w_sr * share / (SNR_WANTED * nei_w_cm2)) / 1e5


def share_of(aperture_m, n_pixel):
    """Share by the curve above."""
    return np.interp(np.log(pixels_per_image(aperture_m, n_pixel)), np.log(ratio), share)


reach_km = detection_range_km(share_of(apertures_m, n_pixels[:, None]), nei_w_cm2)
best = reach_km.argmax(axis=0)

figure, (left, middle, right) = plt.subplots(1, 3, figsize=(14.5, 4.6), layout="constrained")
for aperture_m in (0.2, 0.4, 0.8):
    column = np.abs(apertures_m - aperture_m).argmin()
    left.loglog(n_pixels, nei_w_cm2[:, column], label=f"aperture {apertures_m[column]:.2g} m")
    middle.loglog(n_pixels, reach_km[:, column])
left.set(xlabel="pixels across one degree", ylabel="NEI of a pixel [W/cm$^2$]", title="noise")
left.legend(fontsize=9)
middle.set(xlabel="pixels across one degree", ylabel=f"range at SNR {SNR_WANTED:g} [km]", title="range")
middle.set_yticks([500, 1000, 2000, 5000], ["500", "1000", "2000", "5000"])
middle.minorticks_off()
lines = right.contour(apertures_m, n_pixels, reach_km, levels=12, cmap="viridis")
right.clabel(lines, fmt="%d km", fontsize=8)
right.plot(apertures_m, n_pixels[best], "k--", linewidth=1, label="best number of pixels")
right.set(yscale="log", xlabel="aperture [m]", ylabel="pixels across one degree", title=f"range at SNR {SNR_WANTED:g}")
right.legend(fontsize=9, loc="lower right")
for axes in (left, middle):
    axes.grid(alpha=0.3, which="both")
plt.show()

# %% [markdown]
# Few large pixels: the background's shot noise rules, and halving a pixel's width halves it. Many small ones: read
# noise rules, which is the same however small the pixel, while its share of the light falls. (The Earth hides what is
# farther than 9300 km from this orbit.)
#
# ## NEI alone
#
# Whatever the noise is made of: how much range does a better NEI bring, and what does sampling cost? The range goes
# with 1 / sqrt(NEI).

# %%
nei_axis = np.geomspace(1e-20, 1e-16, 60)
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
for n_pixel in (128, 512, 1024, 2048):
    axes.loglog(
        nei_axis,
        detection_range_km(share_of(0.4, n_pixel), nei_axis),
        label=f"{n_pixel} pixels, share {share_of(0.4, n_pixel):.2f}",
    )
axes.axvline(1e-18, color="0.5", linestyle=":", linewidth=1)
axes.text(1.08e-18, axes.get_ylim()[0] * 1.3, "the paper's sensor", color="0.4", fontsize=9)
axes.set(
    xlabel="NEI of a pixel [W/cm$^2$]", ylabel=f"range at SNR {SNR_WANTED:g} [km]", title="aperture 0.4 m, one degree"
)
axes.grid(alpha=0.3, which="both")
axes.legend(fontsize=9)
plt.show()

# %% [markdown]
# ## One point, rendered
#
# The design of 0.4 m at its best number of pixels, the sphere at the range that the trade promises: many images with
# jitter, so that the target falls all over the pixel. In each image (with seconds between them, and so slow that
# nothing moves within an exposure) the counts of the target's pixel, over the noise, are compared with the truth's
# `snr_peak`. Only the middle of the array is rendered: the pixels are the same.

# %%
column = np.abs(apertures_m - 0.4).argmin()
n_best, promised_km = int(n_pixels[best[column]]), reach_km[best[column], column]
N_IMAGE, SIDE_PX = (500 if SMALL else 7_000), 32
tested = scene_at(promised_km, apertures_m[column], n_best, N_IMAGE)
tested = tested.replace(
    camera={
        "n_row": SIDE_PX,
        "n_col": SIDE_PX,
        "fov_deg": 2 * np.degrees(np.arctan(SIDE_PX / 2 / tested.camera.focal_px)),
    }
)
frames = ws.Renderer(tested).render(range(N_IMAGE))
level = tested.scenario.instrument.levels[BAND]
column_px, row_px = (np.rint(frames.truth[name]).astype(int) for name in ("x_px", "y_px"))
there = np.arange(N_IMAGE), row_px, column_px
snr = (frames.counts.numpy()[:, 0, 0][there] - level.blank_counts) / level.counts_per_nei
expected = frames.truth["snr_peak"].data
noise = snr - expected
shot = np.sqrt(
    1 + level.e_per_w_cm2 * level.nei_w_cm2 * expected.mean() / level.noise_e**2
)  # the target's own shot noise

figure, (left, right) = plt.subplots(1, 2, figsize=(11, 3.8), layout="constrained")
left.imshow(frames.counts.numpy()[0, 0, 0], cmap="gray_r", interpolation="nearest")
left.set(xlabel="column [px]", ylabel="row [px]", title=f"one image, {promised_km:.0f} km")
bins = (
    np.arange(-13.5, 60, 2) + np.rint(level.blank_counts) - level.blank_counts
) / level.counts_per_nei  # two counts each
right.hist(snr, bins, density=True, color="0.8", label="pixel of the target")
right.hist(expected, bins, density=True, histtype="step", color="C0", label="snr_peak of truth")
right.axvline(SNR_WANTED, color="C3", linestyle="--", linewidth=1, label="promised")
right.set(xlabel="SNR", ylabel="images per unit of SNR (share)", title=f"{N_IMAGE} images")
right.legend(fontsize=9)
error_of_mean = noise.std() / np.sqrt(N_IMAGE)
print(
    f"mean SNR: measured {snr.mean():.3f} +- {error_of_mean:.3f}, "
    f"truth {expected.mean():.3f}, promised {SNR_WANTED:.3f}"
)
print(f"noise: measured {noise.std():.3f}, expected {shot:.3f} (1 without the target's own shot noise)")
plt.show()

# %% [markdown]
# ## Answer

# %%
gain = [reach_km[:, np.abs(apertures_m - d).argmin()].max() for d in (0.2, 0.4, 0.8)]
coarse_km = np.interp(128, n_pixels, reach_km[:, column])
Markdown(f"""
- With an aperture of {apertures_m[column]:.1f} m the sphere is found out to {promised_km:.0f} km, by {n_best} pixels
  across the degree; 128 pixels, as in the paper's sensor, reach {coarse_km:.0f} km. The best pixel is as wide as
  {1 / pixels_per_image(apertures_m[column], n_best):.1f} lambda / D.
- Doubling the aperture from 0.2 to 0.4 m multiplies the range by {gain[1] / gain[0]:.2f}, from 0.4 to 0.8 m by
  {gain[2] / gain[1]:.2f}, if the pixels follow: of half the width, they have as much background as before, and the same
  share of four times the light.
- A hundred times better NEI is ten times the range, all else left as it is.
- Rendered at that range, the pixel of the target has a mean SNR of {snr.mean():.2f} over {N_IMAGE} images, where the
  trade promised {SNR_WANTED:g}.
""")
