# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 5. Your own constellation, targets and catalog
#
# **Question.** I have satellites of my own (a pattern, and some element sets), shapes of my own and a star list of my
# own: when do they see my targets, and how bright are these?
#
# Everything that a scene consists of is made here from files and numbers such as one has them, checked, rendered, and
# written as one TOML file.

# %%
import contextlib
import io
import os
import tempfile
from pathlib import Path

import astropy.units as u
import matplotlib.pyplot as plt
import numpy as np
import warp as wp
from IPython.display import Markdown

import warpsim as ws
from warpsim.cli import main

wp.config.log_level = wp.LOG_ERROR  # otherwise Warp tells of every kernel that it loads
SMALL = os.environ.get("WARPSIM_NOTEBOOKS") == "small"  # the tests set it
kept = tempfile.TemporaryDirectory()  # the files of this notebook; they go when it ends
folder = Path(kept.name)

# %% [markdown]
# ## Satellites
#
# A Walker pattern of our own, and a satellite by its two-line elements. Several constellations make one; names must
# differ, for which patterns have a prefix.

# %%
(folder / "stations.tle").write_text("""\
ISS (ZARYA)
1 25544U 98067A   25152.00000000  .00001764  00000-0  38792-4 0  9996
2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482
""")
constellation = ws.MixedConstellation(
    [
        ws.Walker(n_satellite=12, n_plane=3, phasing=1, altitude_km=1200.0, inclination_deg=70.0, prefix="eye"),
        ws.TleSatellites(file=str(folder / "stations.tle")),
    ]
)
print(constellation.names)

# %% [markdown]
# ## Targets
#
# A bus on a circular orbit releases three kinds of things after ten minutes: an adapter ring (a frustum), a box by
# its corners and triangles (a mesh; a file will do as well), and some spheres. The bus warms and cools by a heat
# balance, the others have temperatures of their own.

# %%
x_m, y_m, z_m = 0.6, 0.4, 1.0
corners_m = [[x, y, z] for x in (-x_m / 2, x_m / 2) for y in (-y_m / 2, y_m / 2) for z in (-z_m / 2, z_m / 2)]
triangles = [
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
]  # fmt: skip
box = ws.Mesh(vertices_m=corners_m, faces=triangles)
white, black = {"reflectance": 0.7}, {"emissivity": 0.9}
released = {"time_s": 600.0, "speed_m_s": [0.5, 2.0]}
targets = [
    {
        "name": "bus",
        "shape": ws.Cylinder(radius_m=0.8, height_m=2.5),
        "surface": {"reflectance": 0.3},
        "temperature": ws.HeatBalance(
            start_k="equilibrium", mass_kg=300.0, heat_capacity_j_kg_k=900.0, solar_absorptance=0.4
        ),
        "attitude": ws.Attitude(rolling_rev_s=0.02, axis="random"),
    },
    {
        "name": "ring",
        "shape": ws.Frustum(radius_m=0.6, top_radius_m=0.4, height_m=0.3),
        "surface": white,
        "temperature": {"start_k": 290.0, "end_k": 250.0},
        "attitude": ws.Attitude(spin_rev_s=0.5, precession_rev_s=0.1, precession_angle_deg=20.0),
        "release": released,
    },
    {"name": "box", "count": 2, "shape": box, "surface": black, "temperature": {"start_k": 300.0}, "release": released,
     "attitude": ws.Attitude(rolling_rev_s=0.2, axis="random")},
    {"name": "ball", "count": 4, "shape": ws.Sphere(0.3), "surface": white, "temperature": {"start_k": 280.0},
     "release": released},
]  # fmt: skip
print(f"the box is convex: {box.convex}, {box.surface.area_m2.sum():.2f} m2 in {len(box.surface.area_m2)} flat facets")

# %% [markdown]
# ## A star list
#
# A table as somebody else wrote it: other names, other units, sexagesimal places. `ws.StarCatalog.read` takes a
# mapping; scenes take the file that `ws.write_catalog` makes of it. Bands without a flux are filled in by the star's
# colour.

# %%
(folder / "mine.csv").write_text("""\
name,RA,DE,F8,m21
first,10:30:00,-00:30:00,1500.,
second,11:00:00,45:15:00,,2.25
third,18:36:56,38:47:01,49300.,-0.02
""")
columns = {"id": "name", "ra_deg": "RA", "dec_deg": "DE", "flux_A_jy": "F8 [mJy]", "mag_E": "m21"}
mine = ws.StarCatalog.read(folder / "mine.csv", columns=columns)
for name, ra_deg, dec_deg, flux, flag in zip(
    mine.id, mine.ra_deg, mine.dec_deg, mine.flux_jy("A"), mine.flux_flag("A"), strict=True
):
    print(
        f"{name:7} {ra_deg:9.4f} {dec_deg:9.4f} deg, band A {flux:7.3f} Jy, "
        f"{('unknown', 'measured', 'predicted', 'filled in')[flag]}"
    )

# %% [markdown]
# Three stars make a dull sky. So that the figures have something to show, synthetic stars join them.

# %%
synthetic = ws.StarCatalog.synthetic(limit_jy=0.2, sky="infrared", seed=5)
BANDS = ["A", "E"]


def joined(name):
    """A column of both catalogs, one after the other."""
    return np.concatenate([np.asarray(getattr(catalog, name)) for catalog in (mine, synthetic)])


flux_jy = {band: np.concatenate([mine.flux_jy(band), synthetic.flux_jy(band)]) for band in BANDS}
stars = ws.StarCatalog.from_arrays(
    joined("ra_deg"), joined("dec_deg"), flux_jy, temperature_k=joined("temperature_k"), name="mine and others"
)
ws.write_catalog(stars, folder / "stars.fits")
print(f"{len(stars)} stars")

# %% [markdown]
# ## The scene
#
# Sensors follow the bus, shaken by jitter. They may look where the line of sight grazes no lower than 100 km and the
# Sun is 40 degrees away, out to 8000 km. Numbers may be astropy quantities.

# %%
DURATION_S = 1800.0 if SMALL else 6000.0
scene = ws.Scene(
    name="mine",
    epoch_utc="2025-06-01T00:00:00",
    duration_s=DURATION_S,
    frames={"count": int(DURATION_S // 10), "interval_s": 10.0},
    bands=BANDS,
    seed=11,
    constellation=constellation,
    trajectory=ws.KeplerOrbit(55.0, altitude_km=550.0, raan_deg=205.0, mean_anomaly_deg=130.0),
    targets=targets,
    camera=ws.Camera(n_row=128, n_col=128, fov_deg=20 * u.arcmin),
    optics=ws.Optics(aperture_m=30 * u.cm, obscuration=0.25),
    detector=ws.NeiDetector(nei_w_cm2={"A": 1e-18, "E": 3e-18}, sei_w_cm2=3e-15, exposure_s=0.1),
    pointing=ws.TrackPointing(jitter=ws.Jitter(rms_urad=20.0, correlation_s=0.5)),
    access_rules=ws.AccessConstraints(max_range_km=8000.0, min_grazing_altitude_km=100.0, min_solar_exclusion_deg=40.0),
    sky={"catalog": str(folder / "stars.fits")},
)
scene.save(folder / "mine.toml")
assert ws.Scene.load(folder / "mine.toml") == scene

# %% [markdown]
# `warpsim check mine.toml` says what the scene would give; a mistake would be one line. Here is the same from Python
# (without the name of the folder).

# %%
with contextlib.redirect_stdout(io.StringIO()) as said:
    main(["check", str(folder / "mine.toml")])
print(said.getvalue().replace(f"{folder}{os.sep}", ""))
try:
    scene.replace(camera__fov_deg=-1.0)
except ws.InputError as error:
    print("a mistake:", error)

# %% [markdown]
# The file, in part (long lines are cut). Paths below its folder are relative: the folder can be moved, or sent to
# someone.

# %%
text = (folder / "mine.toml").read_text()
print("\n".join(line[:110] for line in text.splitlines()[:32]))

# %% [markdown]
# ## When, and how bright

# %%
access = scene.access()
figure, (tracks, intervals) = plt.subplots(2, 1, figsize=(10, 9.5), height_ratios=[1.4, 1], layout="constrained")
ws.plot.plot_ground_tracks(scene, ax=tracks)
ws.plot.plot_access(scene, ax=intervals, access=access)
plt.show()

# %%
longest = access[access["duration_s"].argmax()]
SENSOR = longest["sensor"]
shown = ["bus", "ring", "box01", "ball01"]
whole_s = np.arange(longest["start_s"], longest["end_s"], 20.3 if SMALL else 3.03)
minute_s = np.arange(0.0, 60.0, 0.2) + longest["end_s"] - 200.0
curve, minute = (ws.light_curves(scene, times, [SENSOR], shown, BANDS) for times in (whole_s, minute_s))
figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.2), sharey=True, layout="constrained")
for number, name in enumerate(shown):
    left.semilogy(
        whole_s, np.where(curve.not_deployed[:, 0, number], np.nan, curve.snr[:, 0, 0, number]), ".", markersize=2.5
    )
    right.semilogy(minute_s, minute.snr[:, 0, 0, number], label=name)
left.set(xlabel="time after the epoch [s]", ylabel="SNR, band A", title=f"{SENSOR}: a whole access, every 3 s")
right.set(xlabel="time after the epoch [s]", title="a minute of it")
right.legend(fontsize=9, ncols=2)
for axes in (left, right):
    axes.grid(alpha=0.3, which="both")
bus_k = scene.scenario.temperature_k("bus", curve.time_s)
print(f"the bus has {bus_k.min():.0f} to {bus_k.max():.0f} K meanwhile")
plt.show()

# %% [markdown]
# ## Images
#
# The group at three times of that access, with truth: targets in blue, stars in red. Until 600 s after the epoch all
# is in the bus, not yet deployed.

# %%
frame_numbers = np.linspace(longest["start_s"] / 10 + 1, longest["end_s"] / 10 - 1, 4).astype(int)[1:].tolist()
frames = ws.Renderer(scene).render(frame_numbers, [SENSOR], BANDS, keep_stars=True)
figure, panels = plt.subplots(1, 3, figsize=(13.5, 4.6), layout="constrained")
for i, axes in enumerate(panels):
    level = (frames.counts.numpy()[i, 0, 0] - scene.detector.offset_counts) / scene.detector.counts_per_nei
    image = axes.imshow(level, cmap="gray_r", vmin=0, vmax=20, interpolation="nearest")
    truth = frames.truth[
        (frames.truth["frame"] == frames.frames[i]) & (frames.truth["band"] == "A") & ~frames.truth["not_deployed"]
    ]
    seen = frames.stars[
        (frames.stars["frame"] == frames.frames[i]) & (frames.stars["snr"][:, 0] > 5) & frames.stars["in_fov"]
    ]
    axes.scatter(truth["x_px"], truth["y_px"], s=60, facecolors="none", edgecolors="C0", linewidths=0.9)
    axes.scatter(seen["x_px"], seen["y_px"], s=60, marker="s", facecolors="none", edgecolors="C3", linewidths=0.9)
    axes.set(xlim=(-0.5, 127.5), ylim=(127.5, -0.5), xlabel="column [px]")
    axes.set_title(f"{SENSOR}, {frames.time_s[i]:.0f} s, {truth['range_km'][0]:.0f} km", fontsize=10)
panels[0].set_ylabel("row [px]")
figure.colorbar(image, ax=panels, shrink=0.8, label="signal, band A [NEI]", ticks=range(0, 21, 5))
plt.show()

# %% [markdown]
# ## Answer

# %%
by_band = {band: curve.snr[:, 0, panel].max(axis=0) for panel, band in enumerate(BANDS)}
seeing = list(dict.fromkeys(access["sensor"]))
Markdown(f"""
- {len(seeing)} of {len(scene.sensor_names)} satellites see the bus in {scene.duration_s:.0f} s ({", ".join(seeing)}),
  {access["duration_s"].sum() / 60:.0f} minutes in all; the longest access is that of {SENSOR},
  {longest["duration_s"] / 60:.1f} minutes from {longest["start_s"]:.0f} s on.
- In it the bus reaches SNR {by_band["A"][0]:.0f} in band A and {by_band["E"][0]:.0f} in band E; a ball of 60 cm reaches
  {by_band["A"][3]:.0f} and {by_band["E"][3]:.0f}.
- All of it is one TOML file of {len(text.splitlines())} lines beside `stations.tle` and `stars.fits`;
  `warpsim render mine.toml -o out` makes the data.
""")
