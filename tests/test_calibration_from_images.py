"""What gradients are for: merged pairs fitted, and boresights calibrated, to their Cramer-Rao bounds."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

import warpsim as ws
from benchmarks.image_gradients import merged_pairs
from warpsim.render.gradients import camera_slopes
from warpsim.render.likelihood import irradiance_image


@pytest.mark.ci
def test_merged_pairs_are_fitted_to_the_bound_until_their_light_is_unknown():
    """The bound is local: it holds while it leaves the light of either source known to a few tens of percent."""
    n_draw = 100
    rows = merged_pairs([2.0, 1.3, 0.4], n_draw)
    gate = 5 / np.sqrt(2 * n_draw)
    for row in rows[:2]:
        assert row["light_bound"] < 0.2 and row["kept"] == 1.0
        assert abs(row["rms_px"] / row["bound_px"] - 1) < gate
    assert rows[2]["light_bound"] > 1 and rows[2]["rms_px"] > 2 * rows[2]["bound_px"]


WITHIN = 0.10
"""Of the bound, for 200 draws: their own standard deviation is 5 %."""


@pytest.mark.slow
def test_boresights_are_calibrated_from_stars_to_the_bound(record_accuracy):
    """200 draws of the renderer's noise; boresight and roll fitted from 1 px off by Gauss-Newton steps."""
    scene = ws.Scene.load("stss").replace(
        groups=[], optics__psf="gaussian", optics__sigma_px=0.8, camera__fov_deg=2.0,
        pointing={"kind": "fixed", "ra_dec_deg": [285.0, 2.0]},
    )  # fmt: skip
    renderer = ws.Renderer(scene, device="cpu")
    asked = ([0], ["sat11"], ["A"])
    frames = renderer.render(*asked, keep_signal=True, keep_stars=True)
    assert len(frames.stars) == 29
    camera, nei = frames.instrument.sensor.camera, frames.instrument.nei_w_cm2("A")
    bound = ws.fisher(frames, wrt=["boresight_rad", "roll_rad"]).sigma
    images = frames.point_images("test", True)
    seen = camera.direction(images.xy_px[0])
    turns = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])

    def model(values):
        """The image by a camera that is turned, and its derivatives."""
        xy = camera.project(seen @ Rotation.from_rotvec(values @ turns).as_matrix(), np.eye(3))[0]
        moved = replace(images, sources=[images.sources[0], wp.array(xy[None], dtype=wp.vec2d), images.sources[2]])
        stamps, slopes = moved.jacobian(), camera_slopes(camera, xy)
        by_x, by_y = stamps.matrix(0, 0, ["x"]), stamps.matrix(0, 0, ["y"])
        return moved.draw().numpy().ravel().astype(float), by_x @ slopes[:, 0] + by_y @ slopes[:, 1]

    found = []
    for seed in range(200):
        drawn = renderer.with_scene(scene.replace(noise_seed=seed)).render(*asked)
        light = irradiance_image(drawn, 0, "sat11", "A", "test").light_w_cm2.ravel()
        values = np.array([1.0, -0.7, 0.0]) / camera.focal_px
        for _ in range(4):
            image, columns = model(values)
            values = values + np.linalg.lstsq(columns / nei, (light - image) / nei, rcond=None)[0]
        found.append(values)
    found = np.array(found)
    off = np.abs(found.std(axis=0) / bound - 1).max()
    record_accuracy("Boresights fitted to stars over their bounds", off, WITHIN, "relative", "200 draws of noise")
    assert np.abs(found.mean(axis=0) / bound).max() < 5 / np.sqrt(200)
    assert bound[0] * camera.focal_px < 0.1
