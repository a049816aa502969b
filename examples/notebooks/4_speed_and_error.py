# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 4. Speed against error
#
# **Question.** Which settings make images faster, and what does each cost in accuracy?
#
# Where a source's stamp ends (`stamp_cut_nei`), how exact the tables of the point spread function are (`psf_error`),
# over how many wavelengths it is averaged (`n_interval`), and which function it is (`psf`): each is varied alone and
# all together. The error is that of the worst pixel of the noiseless images against the strictest setting, in units
# of the noise; the time is the processor time of an image on one thread, noise and counts included. Times are of the
# machine that ran this notebook, and move by a tenth or more with what else it does.

# %%
import itertools
import os
import time

import matplotlib.pyplot as plt
import numpy as np
import warp as wp
from IPython.display import Markdown
from tqdm.auto import tqdm

import warpsim as ws

wp.config.log_level = wp.LOG_ERROR  # otherwise Warp tells of every kernel that it loads
SMALL = os.environ.get("WARPSIM_NOTEBOOKS") == "small"  # the tests set it
SENSOR, BAND, N_PIXEL, FIELD_DEG = "sat41", "E", 256, 1.0
N_FRAME, N_ROUND = (8, 2) if SMALL else (200, 9)

scene = ws.Scene.load("stss").replace(
    camera={"n_row": N_PIXEL, "n_col": N_PIXEL, "fov_deg": FIELD_DEG},
    frames={"count": 2000, "interval_s": 0.01, "start_s": 800.0},
)

# %% [markdown]
# ## A crowded field
#
# The paper's thirty targets, and stars of our own: about a hundred in view, few of them bright, the brightest as
# bright as saturation. `ws.StarCatalog.from_arrays` takes places and flux densities; a `Renderer` takes the catalog
# in place of the scene's.

# %%
N_STAR, HALF_DEG = 1600, 2.0
random = np.random.default_rng(4)
right, down, ahead = scene.scenario.view_axes(SENSOR, scene.scenario.instrument.frame_time_s([0]))[0]
tangent = np.tan(np.radians(random.uniform(-HALF_DEG, HALF_DEG, (N_STAR, 2))))
direction = ahead + tangent[:, :1] * right + tangent[:, 1:] * down
ra_deg = np.degrees(np.arctan2(direction[:, 1], direction[:, 0]))
dec_deg = np.degrees(np.arcsin(direction[:, 2] / np.linalg.norm(direction, axis=1)))
brightness_nei = np.minimum(5 * random.uniform(size=N_STAR) ** (-1 / 1.1), scene.detector.dynamic_range)
flux_jy = brightness_nei * scene.scenario.instrument.nei_w_cm2(BAND) / ws.BANDS[BAND].w_cm2_per_jy
catalog = ws.StarCatalog.from_arrays(ra_deg, dec_deg, {BAND: flux_jy}, epoch_jyear=scene.epoch.jyear)

view = ws.Renderer(scene, catalog=catalog).render([0], [SENSOR], [BAND], keep_stars=True)
level = (view.counts.numpy()[0, 0, 0] - scene.detector.offset_counts) / scene.detector.counts_per_nei
figure, axes = plt.subplots(figsize=(5.6, 4.6), layout="constrained")
image = axes.imshow(np.arcsinh(level / 2), cmap="gray_r", vmin=0, vmax=np.arcsinh(300), interpolation="nearest")
axes.set(
    xlabel="column [px]",
    ylabel="row [px]",
    title=f"{len(view.stars)} stars, {len(scene.target_names)} targets, band {BAND}",
)
bar = figure.colorbar(image, ticks=np.arcsinh(np.array([0, 3, 10, 30, 100, 300, 600]) / 2))
bar.ax.set_yticklabels(["0", "3", "10", "30", "100", "300", "600"])
bar.set_label("signal [NEI], asinh scale")
plt.show()

# %% [markdown]
# ## Measuring
#
# Every setting gets a renderer of its own, on one thread. Errors come from noiseless images (`keep_signal`), by the
# worst pixel of some of them. Times are taken by turns, all settings one after the other in each round, and the
# median of the rounds counts; building the tables, which is done once, is timed apart.

# %%
STRICT = {"stamp_cut_nei": 1e-3, "psf_error": 6e-7, "n_interval": 16}
DEFAULT = {"stamp_cut_nei": 0.1, "psf_error": 6e-7, "n_interval": 6}
CHECKED = range(0, N_FRAME, max(1, N_FRAME // 4))


def renderer_of(setting):
    """A renderer with optics of the setting."""
    changes = {f"optics__{name}": value for name, value in setting.items()}
    return ws.Renderer(scene.replace(**changes), "cpu", n_thread=1, catalog=catalog)


def signal_nei(renderer):
    """Noiseless images of the frames that are checked."""
    signal = renderer.render(CHECKED, [SENSOR], [BAND], keep_signal=True).signal_w_cm2
    return signal.numpy()[:, 0, 0].astype(float) / scene.scenario.instrument.nei_w_cm2(BAND)


class Study:
    """Settings, their errors and their times."""

    def __init__(self):
        self.reference = signal_nei(renderer_of(STRICT))
        self.renderers, self.error_nei, self.build_s, self.us_per_image = {}, {}, {}, {}

    def add(self, name, setting):
        """Build a renderer, and compare its images with the strictest."""
        start_s = time.perf_counter()
        self.renderers[name] = renderer_of(setting)
        images = signal_nei(self.renderers[name])
        self.build_s[name] = time.perf_counter() - start_s
        self.error_nei[name] = np.abs(images - self.reference).max()

    def clock(self, n_round):
        """Time all settings by turns: processor time, which other programs disturb least."""
        spent_s = {name: [] for name in self.renderers}
        for _, (name, renderer) in itertools.product(
            tqdm(range(n_round), desc="rounds", leave=False), self.renderers.items()
        ):
            start_s = time.process_time()
            renderer.render(range(N_FRAME), [SENSOR], [BAND])
            spent_s[name].append(time.process_time() - start_s)
        self.us_per_image = {name: 1e6 * np.median(times) / N_FRAME for name, times in spent_s.items()}


# %% [markdown]
# ## One setting at a time
#
# The others stay at the strictest, so that what is seen is the setting alone.

# %%
SWEEPS = {
    "stamp_cut_nei": [3.0, 0.3, 0.03] if SMALL else [10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01, 0.003],
    "psf_error": [1e-2, 1e-4] if SMALL else [1e-2, 1e-3, 1e-4, 1e-5, 1e-6],
    "n_interval": [1, 4] if SMALL else [1, 2, 3, 4, 6, 8],
    "psf": ["gaussian"],
}
alone = Study()
cases = [(name, value) for name, values in SWEEPS.items() for value in values]
for name, value in tqdm(cases, desc="settings", leave=False):
    alone.add((name, value), STRICT | {name: value})
alone.clock(N_ROUND)

print("setting                 worst pixel [NEI]   us per image   first images [s]")
for case in cases:
    print(
        f"{case[0]:14} {case[1]!s:>9} {alone.error_nei[case]:15.2g} {alone.us_per_image[case]:14.0f}"
        f"{alone.build_s[case]:16.2f}"
    )

# %% [markdown]
# Where the errors are: a stamp that ends too early lacks the wings of bright sources, a coarse table is wrong near
# every source, one wavelength instead of sixteen has its dark rings where others have light, and a Gaussian has no
# wings at all.

# %%
worst = {"stamp_cut_nei": 1.0, "psf_error": 1e-3, "n_interval": 1, "psf": "gaussian"}
if SMALL:
    worst |= {"stamp_cut_nei": 0.3, "psf_error": 1e-4}
brightest = np.unravel_index(alone.reference[0].argmax(), alone.reference[0].shape)
rows, columns = (slice(max(0, i - 32), i + 33) for i in brightest)
figure, panels = plt.subplots(1, 4, figsize=(13.5, 3.6), layout="constrained")
for axes, case in zip(panels, worst.items(), strict=True):
    error = np.abs(signal_nei(alone.renderers[case])[0] - alone.reference[0])[rows, columns]
    shown = axes.imshow(np.log10(error + 1e-6), vmin=-4, vmax=1, cmap="magma", interpolation="nearest")
    axes.set(title=f"{case[0]} = {case[1]}", xticks=[], yticks=[])
    axes.set_xlabel("65 px about the brightest star")
figure.colorbar(shown, ax=panels, shrink=0.85, label="log10 of the error [NEI]")
plt.show()

# %% [markdown]
# ## All together
#
# Every combination of some values; those that no other beats in both respects are the Pareto front.

# %%
GRID = {"stamp_cut_nei": SWEEPS["stamp_cut_nei"][1:-1], "psf_error": [1e-2, 1e-4, 6e-7], "n_interval": [1, 2, 4, 6]}
if SMALL:
    GRID = {"stamp_cut_nei": [1.0, 0.1], "psf_error": [1e-3, 6e-7], "n_interval": [1, 6]}
together = Study()
for values in tqdm(list(itertools.product(*GRID.values())), desc="combinations", leave=False):
    together.add(values, dict(zip(GRID, values, strict=True)))
default = tuple(DEFAULT.values())
together.clock(N_ROUND)

error = np.array(list(together.error_nei.values()))
us = np.array([together.us_per_image[name] for name in together.error_nei])
beaten = [(error <= e) & (us <= t) & ((error < e) | (us < t)) for e, t in zip(error, us, strict=True)]
front = ~np.array(beaten).any(axis=1)
order = np.argsort(error[front])

figure, (left, right) = plt.subplots(1, 2, figsize=(12.5, 4.8), layout="constrained")
for (name, values), marker in zip(SWEEPS.items(), "osD*", strict=True):
    points = [(alone.error_nei[name, value], alone.us_per_image[name, value]) for value in values]
    left.plot(
        *zip(*points, strict=True),
        marker + "-",
        markersize=9 if marker == "*" else 5,
        label=name if name != "psf" else "psf = gaussian",
    )
    if name == "stamp_cut_nei":
        for value, (x, y) in zip(values, points, strict=True):
            left.annotate(f"{value:g}", (x, y), xytext=(4, 5), textcoords="offset points", fontsize=8)
left.set(
    xscale="log",
    xlabel="error of the worst pixel [NEI]",
    ylabel="processor time per image [us]",
    title="one at a time, the others at their strictest",
    ylim=(0, None),
)
left.legend(fontsize=9)
colours = {cut: f"C{number}" for number, cut in enumerate(GRID["stamp_cut_nei"])}
for cut, colour in colours.items():
    chosen = [number for number, name in enumerate(together.error_nei) if name[0] == cut]
    right.plot(error[chosen], us[chosen], ".", color=colour, markersize=9, label=f"stamp_cut_nei = {cut:g}")
right.plot(error[front][order], us[front][order], "k-", linewidth=0.9, drawstyle="steps-post", label="Pareto front")
if default in together.error_nei:
    right.plot(
        together.error_nei[default],
        together.us_per_image[default],
        "o",
        markersize=13,
        markerfacecolor="none",
        markeredgecolor="k",
        label="default",
    )
right.set(
    xscale="log",
    xlabel="error of the worst pixel [NEI]",
    ylabel="processor time per image [us]",
    title="all together",
    ylim=(0, None),
)
right.legend(fontsize=8)
for axes in (left, right):
    axes.grid(alpha=0.3, which="both")
plt.show()

# %% [markdown]
# On the left, the settings that do not shorten stamps lie high, as their stamps are the strictest. There a table that
# reaches less far shows, too: beyond it the mean over the rings takes its place, which costs less.
#
# ## Answer

# %%
cuts = GRID["stamp_cut_nei"]
same = [(cut, 6e-7, 6) for cut in cuts]
fastest = min(together.us_per_image, key=together.us_per_image.get)
one = together.error_nei[cuts[-1], 6e-7, 1]
at_default = {value: [] for value in GRID["psf_error"]}
for (cut, psf_error, _), us in together.us_per_image.items():
    if cut == DEFAULT["stamp_cut_nei"]:
        at_default[psf_error].append(us)
means = ", ".join(f"{np.mean(times):.0f} us at {psf_error:g}" for psf_error, times in at_default.items())
Markdown(f"""
- By default an image of {N_PIXEL} x {N_PIXEL} pixels takes {together.us_per_image[default]:.0f} us on one thread, and
  its worst pixel is {together.error_nei[default]:.2f} NEI off, a part of the noise.
- The setting that matters for speed is where stamps end. From `stamp_cut_nei` = {cuts[-1]:g} to {cuts[0]:g} an image
  goes from {together.us_per_image[same[-1]]:.0f} to {together.us_per_image[same[0]]:.0f} us, and the error from
  {together.error_nei[same[-1]]:.2g} to {together.error_nei[same[0]]:.2g} NEI.
- A looser `psf_error` saves less, and most where the pattern is narrow against a pixel: at the default cut images take
  {means}, on the mean over `n_interval`, which only changes what is built once.
- One wavelength instead of six errs by {one:.1f} NEI at the brightest star; a Gaussian by
  {alone.error_nei["psf", "gaussian"]:.0f} NEI.
- The fastest combination takes {together.us_per_image[fastest]:.0f} us at {together.error_nei[fastest]:.2g} NEI.
""")
