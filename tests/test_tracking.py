"""From images to a track in Stone Soup, by a program that knows files alone: errors are those of the pixels."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from astropy.table import Table

import warpsim as ws

pytest.importorskip("stonesoup")

SCRIPT = Path(__file__).parents[1] / "examples" / "tracking" / "track.py"
SENSORS = ["sat11", "sat12", "sat27"]
FRAMES = range(50, 66)
N_START = 4  # scans of the program's first state
N_DRAW = 40

WITHIN = 0.2
"""Asked for. Draws of N_DRAW tracks scatter by 0.06; bounds take the error of a pixel to be the same in x and y."""


@pytest.fixture(scope="module")
def renderer():
    """The preset with pixels of 7 arcsec, in which the main target stands alone, and half the noise."""
    camera = {"n_row": 128, "n_col": 128, "fov_deg": 0.25}
    return ws.Renderer(ws.Scene.load("stss").replace(camera=camera, detector__nei_w_cm2=5e-19))


def tracks_of(tables, folder):
    """Tracks by Stone Soup of tables of detections, in a process that cannot import warpsim."""
    paths = [folder / f"{number}.csv" for number in range(len(tables))]
    for table, path in zip(tables, paths, strict=True):
        table.write(path)
    code = (
        "import runpy, sys; sys.modules['warpsim'] = None; del sys.argv[0]; runpy.run_path(sys.argv[0], {}, '__main__')"
    )
    outside = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run([sys.executable, "-c", code, SCRIPT, *paths], check=True, cwd=folder, env=outside)
    return [Table.read(path.with_suffix(".track.csv"), format="ascii.csv") for path in paths]


def errors_m(track, scene, time_s):
    """Distance of the track from the main target along x, y and z, and the track's own errors, (n, 3) each."""
    there = scene.position_m(scene.target_names[0], time_s)
    states = [np.stack([track[f"{axis}{end}"] for axis in "xyz"], axis=1) for end in ("_m", "_sigma")]
    return states[0] - there, states[1]


def bounds_m(frames, found):
    """Cramer-Rao bound of the position at each time, of all lines until then: root of its trace, (n,)."""
    main = found[found["target"] == frames.scene.target_names[0]]
    pixel_rad = np.radians(frames.scene.camera.fov_deg / frames.scene.camera.n_col)
    lines = [frames.line_of_sight(row["frame"], row["sensor"], [row["x_px"], row["y_px"]]) for row in main]
    sigma = pixel_rad * np.sqrt(np.asarray(main["x_sigma_px"]) * np.asarray(main["y_sigma_px"]))
    bounds = []
    for time_s in frames.time_s[N_START - 1 :]:
        until = np.flatnonzero(np.asarray(main["time_s"]) <= time_s)
        state = ws.triangulate([lines[row] for row in until], sigma[until], motion="free_flight", time_s=time_s)
        bounds.append(np.sqrt(np.trace(state.covariance[:3, :3])))
    return np.array(bounds)


@pytest.mark.slow
def test_images_of_three_satellites_become_a_track(renderer, tmp_path):
    frames = renderer.render(FRAMES, sensors=SENSORS, bands=["A"], keep_stars=True)
    found = ws.detections(frames)
    main = frames.truth[frames.truth["target"] == frames.scene.target_names[0]]
    score = ws.evaluate.detections(found[found["target"] == frames.scene.target_names[0]], main)
    assert score.precision == score.recall == 1.0
    assert 0.6 < score.chi_square < 1.5  # of 96 numbers
    (track,) = tracks_of([found], tmp_path)
    off_m, sigma_m = errors_m(track, frames.scene, frames.time_s[N_START - 1 :])
    assert np.abs(off_m / sigma_m).max() < 4.0
    np.testing.assert_allclose(np.linalg.norm(sigma_m, axis=1), bounds_m(frames, found), rtol=WITHIN)
    assert np.linalg.norm(off_m[-1]) < 10.0  # a pixel is 100 m
    score = ws.evaluate.tracks(track, main, cutoff_m=100.0)
    np.testing.assert_allclose(score.position_m, np.linalg.norm(off_m, axis=1).mean(), atol=0.01)


@pytest.mark.slow
def test_errors_are_the_cramer_rao_bound(renderer, tmp_path):
    frames = renderer.render(FRAMES, sensors=SENSORS, bands=["A"])
    tables = [ws.detections(frames, method="truth", seed=seed) for seed in range(N_DRAW)]
    off_m, sigma_m = zip(
        *(errors_m(track, frames.scene, frames.time_s[N_START - 1 :]) for track in tracks_of(tables, tmp_path)),
        strict=True,
    )
    bound = bounds_m(frames, tables[0])
    assert abs(np.sqrt((np.square(off_m).sum(axis=2) / bound**2).mean()) - 1.0) < WITHIN
    stated = np.sqrt(np.square(sigma_m).sum(axis=2))
    np.testing.assert_allclose(stated / bound, 1.0, atol=WITHIN)
