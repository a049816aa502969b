"""Gradients of frames: by sources, by the camera, by targets' positions; against scenes rendered again.

And what they are for: merged pairs fitted, and boresights calibrated, to their Cramer-Rao bounds.
"""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

import warpsim as ws
from benchmarks.image_gradients import merged_pairs
from warpsim.render import frameset
from warpsim.render.gradients import camera_slopes
from warpsim.render.likelihood import irradiance_image
from warpsim.render.point_images import sources_of_views

BASE = {"optics__psf": "gaussian", "optics__sigma_px": 0.8, "sky__catalog": "default", "optics__stamp_cut_nei": 1e-4}
SENSORS = ["sat11", "sat27"]
LENS = {"camera__distortion": {"k1": -0.3, "k2": 0.1, "p1": 0.01, "p2": -0.02}}


def rendered(frames=(60,), **changes):
    scene = ws.Scene.load("stss").replace(**(BASE | changes))
    return ws.Renderer(scene, device="cpu").render(list(frames), SENSORS, ["A", "C"], keep_signal=True, keep_stars=True)


@pytest.fixture(scope="module")
def frames():
    return rendered((60, 61))


@pytest.fixture(scope="module")
def cotangent(frames):
    return np.random.default_rng(1).normal(size=frames.counts.shape) * 1e18


def test_sources_drawn_again_are_the_image(frames):
    drawn = frames.point_images("test", True).draw().numpy()
    signal = frames.signal_w_cm2.numpy().reshape(drawn.shape)
    np.testing.assert_array_equal(drawn, signal)


CUT = 1e-5
"""Of the largest pixel's derivative: light outside of stamps, which frames cut at 1e-4 NEI and deposits at 1e-9."""


@pytest.mark.ci
def test_gradients_by_sources_are_those_of_deposit(frames, cotangent):
    """Of one image after the other, by the sources' own list in the truth."""
    found = ws.gradients(frames, cotangent, ["x_px", "y_px", "irradiance_w_cm2"])
    truth = frames.truth
    for f, s, b in np.ndindex(2, 2, 2):
        rows = truth[(truth["frame"] == (60, 61)[f]) & (truth["sensor"] == SENSORS[s]) & (truth["band"] == "AC"[b])]
        lit = np.flatnonzero(rows["irradiance_w_cm2"] > 0)[:5]
        for i in lit:
            xy_px = [[rows["x_px"][i], rows["y_px"][i]]]
            one = ws.deposit_jacobian(xy_px, [1.0], ws.PsfGaussian(0.8), frames.counts.shape[3:], flux_error=1e-9)
            whole = one.matrix(by=["light"]).T @ cotangent[f, s, b].ravel()
            assert abs(found["irradiance_w_cm2"][f, s, b, i] - whole[0]) < CUT * abs(cotangent).max()
    assert found["x_px"].shape == (2, 2, len(frames.scene.target_names))
    assert found["irradiance_w_cm2"].shape == (2, 2, 2, len(frames.scene.target_names))


TURNED = 1e-9
"""Of the largest slope: rounding of positions, some 1e-13 px, over the oracle's steps of 3e-5 rad."""
SIDEWAYS_PX = 1e-6
"""Of a shift by 7e-3 px: the lens bends it, by the second order of a turn by 1e-6 rad."""


@pytest.mark.parametrize("lens", [{}, LENS], ids=["pinhole", "lens"])
def test_camera_slopes_are_those_of_turned_axes(lens):
    """Rotations by SciPy of the camera's axes, projected by the camera."""
    camera = ws.Scene.load("stss").replace(**lens).scenario.instrument.sensor.camera
    rng = np.random.default_rng(2)
    xy = rng.uniform(-5, [camera.n_col + 4, camera.n_row + 4], (30, 2))
    axes = Rotation.random(random_state=3).as_matrix()
    sky = camera.direction(xy, axes)
    slopes = camera_slopes(camera, xy)
    x, y, z = axes
    h = 3e-5
    for number, vector in enumerate((y, -x, z)):  # z towards x is about y, z towards y about -x

        def seen(angle, vector=vector):
            return camera.project(sky, axes @ Rotation.from_rotvec(angle * vector).as_matrix().T)[0]

        expected = (8 * (seen(h) - seen(-h)) - (seen(2 * h) - seen(-2 * h))) / (12 * h)
        np.testing.assert_allclose(slopes[:, :, number], expected, atol=TURNED * np.abs(expected).max())
        moved = camera.project(z[None] + 1e-6 * np.cross(vector, z), axes)[0] - camera.centre_px
        if number < 2:
            assert moved[0, number] > 0 and abs(moved[0, 1 - number]) < SIDEWAYS_PX
    assert (slopes[:, 0, 0] < 0).all() and (slopes[:, 1, 1] < 0).all()  # the sky moves the other way


RENDERED = 1e-3
"""Of the largest slope: float32 pixels differenced over 4e-3 px, stamps that end elsewhere, cells of Airy tables."""
ROLL_ARM = 0.05
"""Slopes by roll over those by the boresight: sources lie so far from the image's middle, in focal lengths."""


@pytest.mark.ci
@pytest.mark.parametrize(
    "changes", [{}, LENS, {"optics__psf": "airy", "optics__sigma_px": None}], ids=["plain", "lens", "airy"]
)
def test_gradients_by_the_camera_are_those_of_scenes_rendered_again(changes):
    """Boresights moved by a bias of the pointing, and cameras rolled."""
    frames = rendered(**changes)
    rng = np.random.default_rng(1)
    cotangent = rng.normal(size=frames.counts.shape).astype(np.float32) * np.float32(1e18)
    found = ws.gradients(frames, cotangent, ["boresight_rad", "roll_rad"])
    assert found["boresight_rad"].shape == (1, 2, 2) and found["roll_rad"].shape == (1, 2)
    images = frames.point_images("test", True)
    camera = frames.instrument.sensor.camera
    n_band = len(frames.bands)

    def value(turn, size, view):
        vector = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])[turn] * size
        seen = camera.direction(images.xy_px[view]) @ Rotation.from_rotvec(vector).as_matrix()
        xy = images.xy_px.copy()
        there = (np.abs(xy[view]) < 1e6).all(axis=1)
        xy[view, there] = camera.project(seen, np.eye(3))[0][there]
        moved = replace(
            images, sources=[images.sources[0], wp.array(xy, dtype=wp.vec2d, device="cpu"), images.sources[2]]
        )
        image = moved.draw().numpy().astype(np.float64).reshape(2, n_band, -1)
        return (image[view] * cotangent.reshape(2, n_band, -1)[view]).sum()

    step = 2e-3 / camera.focal_px
    for view in range(2):
        for turn in range(3):
            h = step * (50.0 if turn == 2 else 1.0)
            slope = (value(turn, h, view) - value(turn, -h, view)) / (2 * h)
            mine = found["boresight_rad"][0, view, turn] if turn < 2 else found["roll_rad"][0, view]
            scale = max(np.abs(found["boresight_rad"][0, view])) * (ROLL_ARM if turn == 2 else 1.0)
            assert abs(slope - mine) < RENDERED * max(abs(mine), scale)


POSITION = 1e-8
"""Of the largest slope: the oracle's differences over 400 m, at ranges from 1e6 m, have errors of second order."""
SAME_SUM = 1e-12
"""The same products in another order: rounding."""


def test_gradients_by_position_and_range(frames, cotangent):
    """Five-point differences of `project` and of 1 / range^2, target by target."""
    found = ws.gradients(frames, cotangent, ["x_px", "y_px", "irradiance_w_cm2", "target_position_m", "range_m"])
    position, away = frames.target_position_m, frames.target_vector_m
    light = frames.target_light.irradiance_w_cm2
    n_seen = 0
    for view, (f, s) in enumerate(np.ndindex(2, 2)):
        for target in np.flatnonzero(light[view].any(axis=0))[:6]:
            range_m = np.linalg.norm(away[view, target])
            unit = away[view, target] / range_m
            by_range = (-2 * light[view, :, target] / range_m * found["irradiance_w_cm2"][f, s, :, target]).sum()
            assert abs(found["range_m"][f, s, target] - by_range) <= SAME_SUM * abs(by_range)
            expected = by_range * unit
            for axis in range(3):
                h = 200.0 * np.eye(3)[axis]
                up, down = (frames.project((60, 61)[f], SENSORS[s], position[view, target] + d)[0][0] for d in (h, -h))
                slope = (up - down) / 400.0
                expected[axis] += slope @ [found["x_px"][f, s, target], found["y_px"][f, s, target]]
            mine = found["target_position_m"][f, s, target]
            np.testing.assert_allclose(mine, expected, rtol=0, atol=POSITION * np.abs(expected).max())
            n_seen += 1
    assert n_seen > 8


@pytest.mark.ci
def test_streaks_have_gradients_by_their_paths():
    detector = {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "exposure_s": 0.5}
    frames = rendered(sky__catalog="none", detector=detector)
    cotangent = np.random.default_rng(1).normal(size=frames.counts.shape) * 1e18
    found = ws.gradients(frames, cotangent, ["path_px", "x_px", "y_px", "irradiance_w_cm2"])
    n_path = frames.truth["dx_px"].size and found["path_px"].shape[3]
    assert n_path >= 3
    for axis, name in enumerate(("x_px", "y_px")):  # the coefficient of degree 0 shifts the whole path
        atol = SAME_SUM * np.abs(found[name]).max()
        np.testing.assert_allclose(found["path_px"][..., 0, axis], found[name], rtol=0, atol=atol)
    assert np.abs(found["path_px"][..., 1, :]).max() > 0


def test_sources_are_found_once(frames, cotangent, monkeypatch):
    """However many parameters are asked for, sources are laid out and sent to the device once."""
    calls = []
    monkeypatch.setattr(frameset, "sources_of_views", lambda *given: calls.append(1) or sources_of_views(*given))
    found = ws.gradients(frames, cotangent, ["x_px", "boresight_rad", "roll_rad", "sigma_px", "range_m"])
    assert len(calls) == 1
    np.testing.assert_array_equal(found["roll_rad"], ws.gradients(frames, cotangent, "roll_rad")["roll_rad"])


def test_bad_requests_are_refused(frames, cotangent):
    for wrt, text in (("z_px", "wrt: must be of x_px"), ([], "wrt: must name"), (["x_px", "x_px"], "none twice")):
        with pytest.raises(ws.InputError, match=text):
            ws.gradients(frames, cotangent, wrt)
    with pytest.raises(ws.InputError, match="cotangent: must have shape"):
        ws.gradients(frames, cotangent[0], "x_px")
    bare = ws.Renderer(frames.scenario, device="cpu").render([60], SENSORS)
    with pytest.raises(ws.InputError, match="gradients: render with keep_stars=True"):
        ws.gradients(bare, np.zeros(bare.counts.shape), "boresight_rad")
    assert not ws.gradients(bare, np.zeros(bare.counts.shape), "x_px")["x_px"].any()
    airy = ws.Renderer(ws.Scene.load("stss"), device="cpu").render([60], SENSORS[0], "A")
    with pytest.raises(ws.InputError, match="only Gaussian point spread functions have one"):
        ws.gradients(airy, np.zeros(airy.counts.shape), "sigma_px")


BIASED = 1e-4
"""Of the largest change: float32 images differenced over some 1e-2 px, and stamps that end elsewhere."""
SMALL_ANGLE = 1e-9
"""Chords over angles of 3e-6 rad, less 1, with rounding of axes, 1e-16, over that."""


@pytest.mark.ci
def test_a_bias_of_the_pointing_is_a_turn_of_the_boresight():
    """The scene rendered again with cameras that a bias of 3 urad has turned: all of the renderer's own."""
    changes = {"optics__psf": "gaussian", "optics__sigma_px": 1.5, "optics__stamp_cut_nei": 1e-4}
    step = 3.0
    frames, *turned = (
        rendered(**changes, **({"pointing__bias": {"urad": urad}} if urad else {}))
        for urad in (None, (step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step))
    )
    smooth = np.indices(frames.counts.shape[3:]).sum(axis=0) % 17 - 8.0
    cotangent = np.broadcast_to(smooth, frames.counts.shape).astype(np.float32) * np.float32(1e18)
    found = ws.gradients(frames, cotangent, "boresight_rad")["boresight_rad"][0]

    def value(some):
        return (some.signal_w_cm2.numpy().astype(np.float64) * cotangent).sum(axis=(2, 3, 4))[0]

    axes = frames.axes_icrs[0]
    for up, down in (turned[:2], turned[2:]):
        # What the bias turned, seen in the axes without: towards larger x and y, twice the step apart.
        moved = np.einsum("sij,sj->si", axes, up.axes_icrs[0, :, 2] - down.axes_icrs[0, :, 2])[:, :2]
        assert np.allclose(np.linalg.norm(moved, axis=1), 2e-6 * step, rtol=SMALL_ANGLE, atol=0)
        change = value(up) - value(down)
        atol = BIASED * np.abs(found).max() * 2e-6 * step
        np.testing.assert_allclose(change, (found * moved).sum(axis=1), rtol=0, atol=atol)


def test_views_and_bands_at_once_are_bit_for_bit_those_alone(frames, cotangent):
    together = ws.gradients(frames, cotangent, ["x_px", "y_px", "irradiance_w_cm2"])
    renderer = ws.Renderer(frames.scenario, device="cpu", n_thread=1)
    for f, s in np.ndindex(2, 2):
        one = renderer.render([60 + f], SENSORS[s], ["A", "C"])
        found = ws.gradients(one, cotangent[f : f + 1, s : s + 1], ["x_px", "y_px", "irradiance_w_cm2"])
        for name, values in found.items():
            np.testing.assert_array_equal(values[0, 0], together[name][f, s])
        band = renderer.render([60 + f], SENSORS[s], "C")
        light = ws.gradients(band, cotangent[f : f + 1, s : s + 1, 1:], "irradiance_w_cm2")["irradiance_w_cm2"]
        np.testing.assert_array_equal(light[0, 0, 0], together["irradiance_w_cm2"][f, s, 1])


EXPOSED = {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "exposure_s": 0.5}
STRAIGHT = 2e-4
"""Of the brightest pixel: the bend of stars' paths, of which only the ends are kept, below 1e-3 px."""


@pytest.mark.ci
@pytest.mark.parametrize(
    "detector", [EXPOSED, EXPOSED | {"exposure_s": 0.005, "line_time_s": 1e-4}], ids=["streaks", "rows"]
)
def test_moving_sources_drawn_again_are_the_image(detector):
    still = rendered(sky__catalog="none", detector=detector)
    signal = still.signal_w_cm2.numpy()
    np.testing.assert_array_equal(still.point_images("test", True).draw().numpy().reshape(signal.shape), signal)
    stars = rendered(detector=detector)
    signal = stars.signal_w_cm2.numpy()
    drawn = stars.point_images("test", True).draw().numpy().reshape(signal.shape)
    assert len(stars.stars) > 5
    assert np.abs(drawn - signal).max() < STRAIGHT * signal.max()


CHAINED = 1e-3
"""Of a slope: light in float32, rounded by 6e-8 of it, over steps that change it by some 1e-4."""


@pytest.mark.ci
def test_images_follow_the_parameters_of_a_target():
    """Light by parameters, chained with images by light, against scenes rendered again."""
    names, steps = ["temperature_start_k", "scale", "precession_angle_deg"], np.array([0.5, 0.002, 0.02])
    scene = ws.Scene.load("stss").replace(optics__stamp_cut_nei=1e-4)
    renderer = ws.Renderer(scene, "cpu")
    asked = (range(100, 103), ["sat27", "sat47"], ["A", "C"])
    seen = renderer.render(*asked, keep_signal=True)
    cotangent = seen.signal_w_cm2.numpy()
    by_light = ws.gradients(seen, cotangent, "irradiance_w_cm2")["irradiance_w_cm2"][..., 0]
    curve = ws.LightCurve(scene, "center", names, seen.time_s, seen.sensors, seen.bands, "cpu")
    found = np.einsum("tsb,tsbp->p", by_light, curve.jacobian(curve.values))

    def value(kelvin, scale, angle_deg):
        other = scene.replace(
            targets__0__temperature__start_k=kelvin, targets__0__attitude__precession_angle_deg=angle_deg,
            targets__0__shape={"kind": "cone", "radius_m": 0.25 * scale, "height_m": scale},
        )  # fmt: skip
        again = renderer.with_scene(other).render(*asked, keep_signal=True)
        return (again.signal_w_cm2.numpy().astype(np.float64) * cotangent).sum()

    for number, step in enumerate(np.diag(steps)):
        up, down = (value(*(curve.values + side * step).tolist()) for side in (1, -1))
        assert found[number] == pytest.approx((up - down) / (2 * step[number]), rel=CHAINED)


@pytest.mark.slow
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
