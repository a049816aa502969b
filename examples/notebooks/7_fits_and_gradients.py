# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 7. What light curves and images say about their causes
#
# **Question.** How well do light curves tell how a body turns, and images where sources are and where the camera looks;
# and do fits reach what theory allows?
#
# Derivatives of what warpsim computes give both: the Cramer-Rao bound, and the steps of a fit.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown
from scipy.optimize import least_squares

import warpsim as ws

SMALL = os.environ.get("WARPSIM_NOTEBOOKS") == "small"  # the tests set it
N_FIT, N_PAIR, N_IMAGE = (12, 10, 12) if SMALL else (200, 150, 200)
rng = np.random.default_rng(1)
scene = ws.Scene.load("stss")

# %% [markdown]
# ## The cone's precession from two light curves
#
# The paper's main target, a cone, precesses once a second with an angle of 3 degrees. Two satellites watch it for
# twelve seconds in two bands. Its light curve as a function of rate, phase and angle:

# %%
names = ["precession_rev_s", "precession_phase_rev", "precession_angle_deg"]
times = np.arange(600.0, 612.0, 0.02)
curve = ws.LightCurve(scene, "center", names, times, sensors=["sat11", "sat47"], bands=["A", "C"], phase_time_s=606.0)
print(curve, ", ".join(f"{name} {value:.4g}" for name, value in zip(names, curve.values, strict=True)))
measured = curve.sample(np.repeat(curve.values[None], N_FIT, axis=0), key=7)  # with the detector's noise

figure, panels = plt.subplots(2, 1, figsize=(9, 5), sharex=True, layout="constrained")
for panel, sensor, band in zip(panels, (0, 1), (0, 0), strict=True):
    panel.plot(times, 1e18 * measured[0, :, sensor, band], ".", markersize=3, color="0.7", label="measured")
    panel.plot(times, 1e18 * curve(curve.values)[:, sensor, band], color="C3", label="true")
    panel.set(ylabel=f"{curve.sensors[sensor]}, {curve.bands[band]} [1e-18 W/cm2]", xlim=(600, 604))
panels[0].legend(loc="upper right")
panels[1].set_xlabel("time [s]")
plt.show()

# %% [markdown]
# Without knowing anything, a scan over rates finds the basin of the best fit, and Levenberg and Marquardt's method ends
# in it. Then the same for many draws of the noise, from beside the truth:

# %%
found = ws.fit(
    [(curve, measured[0], None)],
    start={"center.precession_rev_s": 0.5, "center.precession_angle_deg": 6.0},
    scan={"center.precession_rev_s": (0.2, 3.0)},
)
print({name: f"{value:.5f} +- {found.sigma[name]:.5f}" for name, value in zip(found.names, found.values, strict=True)})
print(f"chi-square per degree of freedom {found.chi_square / found.n_freedom:.3f}")

bound = np.array(list(curve.fisher(curve.values).sigma.values()))
start = {f"center.{name}": value for name, value in zip(names, curve.values + 2 * bound, strict=True)}
sigma = curve.sigma_w_cm2(curve(curve.values))
fits = np.array([ws.fit([(curve, one, sigma)], start=start).values for one in measured])
scatter = fits.std(axis=0) / bound

figure, panels = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
for panel, (a, b) in zip(panels, ((0, 1), (0, 2)), strict=True):
    panel.plot(*((fits - curve.values) / bound)[:, [a, b]].T, ".", markersize=4)
    turn = np.linspace(0, 2 * np.pi, 100)
    covariance = curve.fisher(curve.values).covariance[np.ix_([a, b], [a, b])]
    circle = np.linalg.cholesky(covariance) @ np.array([np.cos(turn), np.sin(turn)]) / bound[[a, b], None]
    panel.plot(*(2 * circle), color="C3", label="2 sigma, Cramer-Rao")
    panel.set(xlabel=f"error of {names[a]} [sigma]", ylabel=f"error of {names[b]} [sigma]")
panels[0].legend()
plt.show()

# %% [markdown]
# ## How close may two sources be?
#
# Pairs of equal sources, 100 times a pixel's noise each, fitted to noisy images with the derivatives of the image by
# their positions and light (`ws.deposit_jacobian`). The bound is what theory allows.

# %%
psf, shape, light = ws.PsfGaussian(0.8), (16, 16), 100.0
separations = [2.0, 1.2, 0.8] if SMALL else [3.0, 2.0, 1.5, 1.2, 1.0, 0.8, 0.6]


def drawn(values):
    """Pixels of two sources: x and y of each, and both lights."""
    return ws.deposit(values[:4].reshape(2, 2), values[4:], psf, shape).ravel()


def slopes(values):
    """Their derivatives."""
    stamps = ws.deposit_jacobian(values[:4].reshape(2, 2), values[4:], psf, shape)
    return stamps.matrix(by=("x", "y", "light")).toarray()[:, [0, 2, 1, 3, 4, 5]]  # x1, y1, x2, y2, two lights


rows = []
for apart_px in separations:
    errors, bounds = [], []
    for _ in range(N_PAIR):
        middle, angle = 7.5 + rng.uniform(-0.5, 0.5, 2), rng.uniform(0, 2 * np.pi)
        half = 0.5 * apart_px * np.array([np.cos(angle), np.sin(angle)])
        true = np.array([*(middle - half), *(middle + half), light, light])
        image = drawn(true) + rng.normal(size=shape).ravel()
        fit = least_squares(lambda values, image=image: drawn(values) - image, true, slopes, x_scale="jac")
        covariance = np.linalg.inv(slopes(true).T @ slopes(true))
        along = np.array([*-half, *half, 0, 0]) / np.linalg.norm(half)
        errors.append(np.linalg.norm(fit.x[2:4] - fit.x[:2]) - apart_px)
        bounds.append((np.sqrt(along @ covariance @ along), np.sqrt(covariance[4, 4]) / light))
    rows.append((apart_px, np.sqrt(np.mean(np.square(errors))), *np.median(bounds, axis=0)))
pairs = np.array(rows)

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
axes.loglog(pairs[:, 0], pairs[:, 1], "o", label="rms error of the fits")
axes.loglog(pairs[:, 0], pairs[:, 2], color="C3", label="Cramer-Rao bound")
axes.loglog(pairs[:, 0], pairs[:, 3], "--", color="0.5", label="bound of the light, relative")
axes.set(xlabel="separation [px]", ylabel="error of the separation [px]")
axes.legend()
plt.show()

# %% [markdown]
# ## Where does the camera look?
#
# A camera that points past its direction by tens of microradians sees 29 stars of the catalog. Scenes rendered with a
# guess of the bias give the likelihood of the counts and its gradient (`ws.log_likelihood`), and the information of an
# image (`ws.fisher`) turns the gradient into a step.

# %%
stars = scene.replace(
    groups=[], optics__psf="gaussian", optics__sigma_px=0.8, camera__fov_deg=2.0,
    pointing={"kind": "fixed", "ra_dec_deg": [285.0, 2.0]},
)  # fmt: skip
renderer = ws.Renderer(stars)
true_urad = np.array([60.0, -40.0])


def rendered(bias_urad, **changes):
    """Frame 0 of sat11 with a bias of the pointing."""
    biased = stars.replace(pointing__bias={"urad": tuple(bias_urad)}, **changes)
    return renderer.with_scene(biased).render([0], ["sat11"], ["A"], keep_signal=True, keep_stars=True)


biases = []
for seed in range(N_IMAGE):
    counts = rendered(true_urad, noise_seed=seed).counts.numpy()
    bias_urad = np.zeros(2)
    for _ in range(4):
        guess = rendered(bias_urad)
        gradient = ws.log_likelihood(guess, counts, ["boresight_rad"]).gradient["boresight_rad"][0, 0]
        x_rad, y_rad = np.linalg.solve(ws.fisher(guess, wrt=["boresight_rad"]).information, gradient)
        bias_urad = bias_urad + 1e6 * np.array([-y_rad, x_rad])  # a bias is about the camera's axes x and y
    biases.append(bias_urad)
biases = np.array(biases)
camera_bound = 1e6 * ws.fisher(rendered(true_urad), wrt=["boresight_rad"]).sigma[::-1]
camera_scatter = biases.std(axis=0) / camera_bound
pixel_urad = 1e6 * np.radians(stars.camera.fov_deg / stars.camera.n_col)
print(f"{biases.mean(axis=0).round(2)} urad on average, bound {camera_bound.round(2)}, a pixel is {pixel_urad:.0f}")

# %% [markdown]
# ## Answer

# %%
reaches = pairs[pairs[:, 1] < 1.15 * pairs[:, 2], 0].min()
Markdown(f"""
- The cone turns at a rate known to {bound[0]:.1e} rev/s after {times[-1] - times[0]:.0f} s, its phase to
  {bound[1]:.1e} turns and its angle to {bound[2]:.3f} degrees; fits scatter as {scatter.min():.2f} to
  {scatter.max():.2f} of these bounds over {N_FIT} draws.
- Pairs are fitted at their bound down to {reaches:.1f} px. Closer ones have light that is not known well enough for a
  bound, which is local, to hold.
- {len(guess.stars)} stars tell where the camera looks to {camera_bound.max():.1f} microradians,
  {camera_bound.max() / pixel_urad:.3f} pixels; fits scatter as {camera_scatter.min():.2f} to
  {camera_scatter.max():.2f} of the bounds over {N_IMAGE} draws.
""")
