# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 6. From pixels to a track in space
#
# **Question.** Three satellites watch a target in free flight. How well can a filter know where it is, and is what is
# left of error that of the pixels?
#
# Images become detections, detections are scored against truth, and a program that knows nothing of warpsim reads them
# from a file: an unscented Kalman filter in Stone Soup. Its errors stand beside the Cramer-Rao bound.

# %%
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import warp as wp
from astropy.table import Table
from IPython.display import Markdown

import warpsim as ws

wp.config.log_level = wp.LOG_ERROR  # otherwise Warp tells of every kernel that it loads
SMALL = os.environ.get("WARPSIM_NOTEBOOKS") == "small"  # the tests set it
SENSORS, FRAMES = ["sat11", "sat12", "sat27"], range(50, 66)
N_DRAW = 4 if SMALL else 40

scene = ws.Scene.load("stss").replace(
    camera={"n_row": 128, "n_col": 128, "fov_deg": 0.25},  # 7 arcsec a pixel: finer than the paper's 28
    detector__nei_w_cm2=5e-19,  # quieter than the paper's 1e-18
)
main = scene.target_names[0]
frames = ws.Renderer(scene).render(FRAMES, sensors=SENSORS, bands=["A"], keep_stars=True)
found = ws.detections(frames)
print(f"{len(found)} detections in {len(FRAMES) * len(SENSORS)} images, {frames.time_s[-1] - frames.time_s[0]:.0f} s")

# %%
figure, panels = plt.subplots(1, 3, figsize=(13, 4.6), layout="constrained")
for number, (axes, sensor) in enumerate(zip(panels, SENSORS, strict=True)):
    axes.imshow(frames.counts.numpy()[-1, number, 0], cmap="gray_r", vmin=80, vmax=180)
    here = found[(found["frame"] == FRAMES[-1]) & (found["sensor"] == sensor)]
    is_main = here["target"] == main
    axes.plot(here["x_px"], here["y_px"], "o", markerfacecolor="none", color="C0", markersize=8)
    axes.plot(here["x_px"][is_main], here["y_px"][is_main], "o", markerfacecolor="none", color="C3", markersize=12)
    row = frames.truth[(frames.truth["sensor"] == sensor) & (frames.truth["target"] == main)][-1]
    pixel_m = 1e3 * row["range_km"] * np.radians(scene.camera.fov_deg / scene.camera.n_col)
    axes.set(xlim=(24, 103), ylim=(103, 24), title=f"{sensor}: {row['range_km']:.0f} km, a pixel is {pixel_m:.0f} m")
plt.show()

# %% [markdown]
# ## Scores of the detections
#
# A detection is right within 1 px of a target. Targets that merge with others at this point spread function may share
# one: `recall` counts them as seen, `recall_resolved` as missed. Detections of stars are neither right nor false. Pairs
# 1 to 2 px apart can be told apart by truth's measure, and are often found as one, in between: where a fit is poor, or
# two sources would do as well, the error stated is that of a pixel (`poor_fit`).

# %%
score = ws.evaluate.detections(found, frames.truth, radius_px=1.0, ignore=frames.stars)
curve = score.curve()
near = score.by("neighbour_px", [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 100.0])
is_far = (score.truth["outcome"] == "found") & (score.truth["neighbour_px"] > 3.0)
far = score.truth[is_far]
far_snr = np.asarray(found["snr"])[far["found_row"]]
far_px = np.hypot(far["error_x_px"], far["error_y_px"])
stated_px = np.hypot(found["x_sigma_px"], found["y_sigma_px"])[far["found_row"]]

figure, (left, middle, right) = plt.subplots(1, 3, figsize=(14, 4.2), layout="constrained")
for name, label in (("recall", "recall"), ("recall_resolved", "merged as missed"), ("precision", "precision")):
    left.plot(curve["snr"], curve[name], label=label)
left.set(xscale="log", xlabel="threshold of SNR", ylim=(0, 1.05), title="all targets")
left.legend()
middle.plot(near["low"], near["recall"], "o-", label="recall")
middle.plot(near["low"], near["recall_resolved"], "s-", label="merged as missed")
middle.set(xlabel="nearest other target, from [px]", ylim=(0, 1.05), title="by distance")
middle.legend()
right.plot(far_snr, far_px, ".", color="0.75", markersize=4)
order = np.argsort(far_snr)
for part in np.array_split(order, 8):
    right.plot(np.median(far_snr[part]), np.sqrt(np.mean(far_px[part] ** 2)), "o", color="C0")
right.plot(far_snr[order], stated_px[order], "_", color="C3", markersize=3)
right.set(xscale="log", yscale="log", xlabel="SNR", ylabel="error of position [px]", ylim=(1e-3, 1))
right.set_title("3 px and more from others; red: Cramer-Rao")
for axes in (left, middle, right):
    axes.grid(alpha=0.3)
plt.show()
print(score)
print(near["low", "high", "n_truth", "n_found", "n_merged", "n_missed", "rms_px", "chi_square"])

# %% [markdown]
# ## A filter that reads a file
#
# `examples/tracking/track.py` imports Stone Soup, NumPy and SciPy. It takes the first state from what stands in the
# middle of the first images, and then, scan by scan, the detection nearest to its prediction. Its models are free
# flight with J2, and the direction of where the body was when its light left. Here it runs where warpsim cannot be
# imported at all.


# %%
def tracks_of(tables):
    """Tracks of tables of detections, in the order of time."""
    code = (
        "import runpy, sys; sys.modules['warpsim'] = None; del sys.argv[0]; runpy.run_path(sys.argv[0], {}, '__main__')"
    )
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{number}.csv" for number in range(len(tables))]
        for table, path in zip(tables, paths, strict=True):
            table.write(path)
        subprocess.run([sys.executable, "-c", code, "../tracking/track.py", *paths], check=True, capture_output=True)
        return [Table.read(path.with_suffix(".track.csv"), format="ascii.csv") for path in paths]


def errors_m(track):
    """Distance from the target, and the filter's own error, at each time of a track [m]."""
    there = scene.position_m(main, frames.time_s[-len(track) :])
    off = np.stack([track[f"{axis}_m"] for axis in "xyz"], axis=1) - there
    return np.linalg.norm(off, axis=1), np.sqrt(sum(np.asarray(track[f"{axis}_sigma"]) ** 2 for axis in "xyz"))


(track,) = tracks_of([found])
off_m, sigma_m = errors_m(track)
print(f"{len(track)} states; at the end {off_m[-1]:.1f} m off, by its own error {sigma_m[-1]:.1f} m")

# %% [markdown]
# ## What limits it
#
# No unbiased estimate from these lines of sight can be better than the Cramer-Rao bound. It follows from the errors of
# the positions in the images, those from the light in each pixel and its noise, and from where the satellites are:
# `ws.triangulate` gives it as the covariance of a fit in free flight. For the filter's error itself, detections are
# drawn many times from truth with these errors, without images, and the filter runs on each.

# %%
drawn = [ws.detections(frames, method="truth", seed=seed) for seed in range(N_DRAW)]
squares = np.array([errors_m(one)[0] ** 2 for one in tracks_of(drawn)])
rms_m = np.sqrt(squares.mean(axis=0))

seen = drawn[0][drawn[0]["target"] == main]
lines = [frames.line_of_sight(row["frame"], row["sensor"], [row["x_px"], row["y_px"]]) for row in seen]
pixel_rad = np.radians(scene.camera.fov_deg / scene.camera.n_col)
sigma_px = np.sqrt(np.asarray(seen["x_sigma_px"]) * np.asarray(seen["y_sigma_px"]))
time_s = frames.time_s[-len(track) :]
bound_m = []
for end_s in time_s:
    until = np.flatnonzero(np.asarray(seen["time_s"]) <= end_s)
    state = ws.triangulate([lines[row] for row in until], pixel_rad * sigma_px[until], "free_flight", time_s=end_s)
    bound_m.append(np.sqrt(np.trace(state.covariance[:3, :3])))
bound_m = np.array(bound_m)
pooled = np.sqrt((squares / bound_m**2).mean())

figure, axes = plt.subplots(figsize=(8, 4.4), layout="constrained")
axes.plot(time_s, np.sqrt(squares.T), color="0.85", linewidth=0.8)
axes.plot(time_s, rms_m, color="C0", label=f"rms of {N_DRAW} draws")
axes.plot(time_s, bound_m, "--", color="C3", label="Cramer-Rao bound")
axes.plot(time_s, sigma_m, ":", color="k", label="the filter's own error, images")
axes.plot(time_s, off_m, "o-", color="C2", markersize=4, label="track of the images")
axes.set(xlabel="time [s]", ylabel="error of position [m]", ylim=(0, 14))
axes.legend()
axes.grid(alpha=0.3)
plt.show()

# %% [markdown]
# ## Scores of the track
#
# OSPA, GOSPA and SIAP by Stone Soup's metrics, against the truth at the times of the frames.

# %%
track_score = ws.evaluate.tracks(track, frames.truth[frames.truth["target"] == main], cutoff_m=100.0)
print(track_score)

# %% [markdown]
# ## Answer

# %%
last = frames.truth[(frames.truth["target"] == main) & (frames.truth["frame"] == FRAMES[-1])]
pixels_m = 1e3 * np.asarray(last["range_km"]) * pixel_rad
Markdown(f"""
- The track of the images is {off_m[-1]:.1f} m off after {time_s[-1] - frames.time_s[0]:.0f} s, where a pixel is
  {pixels_m.min():.0f} to {pixels_m.max():.0f} m. A position in an image is good to {np.median(sigma_px):.3f} px, and
  {len(seen)} of them are combined.
- The error is that of the pixels: over {N_DRAW} draws the filter's is {pooled:.2f} of the Cramer-Rao bound, and what it
  says of itself {np.median(sigma_m / bound_m):.2f}.
- Of {score.by("sensor")["n_truth"].sum()} targets in the images {100 * score.recall:.0f} % are seen,
  {100 * score.recall_resolved:.0f} % by a detection of their own. Where no other is within 3 px, errors of position are
  {np.sqrt(np.mean(far["chi_square"])):.2f} of what detections say; closer pairs are found as one.
""")
