"""Streaks through the whole chain: an exposure against the mean of many instants of the same scene."""

from __future__ import annotations

import numpy as np
import pytest

import warpsim as ws

EXPOSURE_S = 0.5
MIDDLE_S = 800.0
N_INSTANT = 1000
SENSOR = "sat27"

STAR_ATOL = 1e-5
"""Of a star's light per pixel: the line for streaks. Means of 1000 instants are good to 1e-6 of it."""
TARGET_ATOL = 1e-3
"""Of a star's light per pixel: the line for streaks; means of 1000 instants are good to 1e-6 of it."""
PLACE_ATOL_PX = 2e-3
"""The error that the paths are chosen by, at both ends."""


NO_STARS = ws.StarCatalog.from_arrays([], [], {})


DARK = {
    "lighting": {"sun": False, "earth": False, "albedo": False},
    "targets": [
        {
            "name": "center",
            "shape": {"kind": "sphere", "radius_m": 0.1},
            "surface": {"reflectance": 1.0},
            "temperature": {"start_k": 300.0, "end_k": 300.0},
        }
    ],
}
"""A target that gives no light, so that only stars are compared."""


BRIGHT = {
    "lighting": {"sun": False, "earth": False, "albedo": False},
    "targets": [
        {
            "name": "center",
            "shape": {"kind": "sphere", "radius_m": 3.0},
            "surface": {"reflectance": 0.1},
            "temperature": {"start_k": 400.0, "end_k": 400.0},
        }
    ],
}


def exposed(scene, **changes):
    """One frame of half a second; changes are those of Scene.replace."""
    return scene.replace(
        frames={"count": 1, "interval_s": 10.0, "start_s": MIDDLE_S},
        detector__exposure_s=EXPOSURE_S,
        optics={"aperture_m": 0.4, "psf": "gaussian", "sigma_px": 0.9, "stamp_cut_nei": 1e-6},
        camera={"n_row": 48, "n_col": 64, "fov_deg": 0.5},
        bands=["A"],
        **changes,
    )


def instants(scene):
    """The same exposure as instants one after the other: midpoints of N_INSTANT parts."""
    step_s = EXPOSURE_S / N_INSTANT
    frames = {"count": N_INSTANT, "interval_s": step_s, "start_s": MIDDLE_S - 0.5 * EXPOSURE_S + 0.5 * step_s}
    return scene.replace(frames=frames, detector__exposure_s=0.0)


@pytest.fixture(scope="module")
def field(scene):
    """30,000 stars within 10 degrees of what is looked at: a hundred in a square degree."""
    rng = np.random.default_rng(5)
    boresight = scene.scenario.view_axes(SENSOR, [MIDDLE_S])[0]
    radius, angle = np.radians(10.0) * np.sqrt(rng.random(30_000)), 2 * np.pi * rng.random(30_000)
    place = np.stack([np.tan(radius) * np.cos(angle), np.tan(radius) * np.sin(angle), np.ones(30_000)], axis=1)
    x, y, z = (place @ boresight).T
    ra_deg, dec_deg = np.degrees(np.arctan2(y, x)) % 360, np.degrees(np.arctan2(z, np.hypot(x, y)))
    return ws.StarCatalog.from_arrays(ra_deg, dec_deg, {"A": 10 ** rng.uniform(-1, 1, 30_000)})


def image(scene, device, catalog, frames=(0,)):
    """Mean noiseless signal [W/cm2] of frames, float64, and what was rendered."""
    renderer = ws.Renderer(scene, device, catalog=catalog)
    rendered = renderer.render(list(frames), [SENSOR], keep_signal=True, keep_stars=True)
    return rendered.signal_w_cm2.numpy().astype(np.float64).mean(axis=0)[0, 0], rendered


def compare(scene, device, catalog, atol):
    """The streaked frame against the mean of instants, in shares of the brightest source; both, and the shares."""
    streaked, one = image(scene, device, catalog)
    mean, many = image(instants(scene), device, catalog, range(N_INSTANT))
    brightest = max(one.stars["irradiance_w_cm2"].max(initial=0.0), one.truth["irradiance_w_cm2"].max())
    assert np.abs(streaked - mean).max() <= atol * brightest
    still, _ = image(scene.replace(detector__streaks=False), device, catalog)
    assert np.abs(still - mean).max() > 20 * atol * brightest  # it does move
    return one, many


def towards_main(scene):
    """Equatorial direction of the main target from the sensor in the middle of the exposure."""
    seen = scene.scenario.view_axes(SENSOR, [MIDDLE_S])[0, 2]
    return float(np.degrees(np.arctan2(seen[1], seen[0]))), float(np.degrees(np.arcsin(seen[2])))


@pytest.mark.ci
def test_stars_streak_while_the_camera_tracks(scene, device, field):
    one, many = compare(exposed(scene, **DARK), device, field, STAR_ATOL)
    assert len(one.stars) >= 3
    assert np.hypot(one.stars["dx_px"], one.stars["dy_px"]).min() > 2
    # Ends of the paths: the places of the first and last instant, half a step inside.
    inner = 1 - 1 / N_INSTANT
    for frame, side in ((0, -0.5), (N_INSTANT - 1, 0.5)):
        there = many.stars[many.stars["frame"] == frame]
        for star in one.stars:
            (row,) = there[there["id"] == star["id"]] or [None]
            if row is not None:
                moved = np.array([star["dx_px"], star["dy_px"]]) * side * inner
                place = np.array([star["x_px"], star["y_px"]]) + moved
                bend_px = 0.02  # the path is curved: its middle is off the chord
                np.testing.assert_allclose([row["x_px"], row["y_px"]], place, atol=bend_px)


@pytest.mark.ci
def test_targets_streak_through_a_still_camera(scene, device, field):
    still = exposed(scene, pointing={"kind": "fixed", "ra_dec_deg": towards_main(scene)})
    one, many = compare(still, device, NO_STARS, TARGET_ATOL)
    main = one.truth[0]
    assert np.hypot(main["dx_px"], main["dy_px"]) > 3
    ends = many.truth[(many.truth["target"] == "center")]
    expected = np.array([ends["x_px"][-1] - ends["x_px"][0], ends["y_px"][-1] - ends["y_px"][0]]) / (1 - 1 / N_INSTANT)
    np.testing.assert_allclose([main["dx_px"], main["dy_px"]], expected, rtol=0, atol=PLACE_ATOL_PX)


@pytest.mark.slow
def test_brightness_follows_the_spin_along_a_streak(scene, device, field):
    """A plate that flashes five times: the streak is a row of spots, and the light still the mean of the instants."""
    flash = {
        "name": "plate",
        "shape": {"kind": "plate", "length_m": 1.0, "width_m": 1.0},
        "surface": {"reflectance": 0.1},
        "temperature": {"start_k": 300.0, "end_k": 300.0},
        "attitude": {"rolling_rev_s": 5.0},
    }
    still = exposed(
        scene,
        targets=[flash],
        lighting={"sun": False, "earth": False, "albedo": False, "quadrature_error": 1e-3},
        pointing={"kind": "fixed", "ra_dec_deg": towards_main(scene)},
    )
    compare(still, device, NO_STARS, TARGET_ATOL)


@pytest.mark.ci
def test_jitter_moves_light_within_the_exposure(scene, device, field):
    shaken = exposed(scene, pointing={"track": "main", "jitter": {"rms_urad": 60.0, "correlation_s": 0.4}}, **DARK)
    compare(shaken, device, field, 1e-3)


@pytest.mark.parametrize("mode", ["scan", "stare"])
@pytest.mark.ci
def test_tables_of_directions(scene, device, field, mode):
    ra_deg, dec_deg = towards_main(scene)
    rows = [
        {"time_s": MIDDLE_S - 100.0, "ra_deg": ra_deg - 20.0, "dec_deg": dec_deg},
        {"time_s": MIDDLE_S + (100.0 if mode == "scan" else 0.0), "ra_deg": ra_deg + 20.0, "dec_deg": dec_deg},
        {"time_s": MIDDLE_S + 400.0, "ra_deg": ra_deg, "dec_deg": dec_deg},
    ]
    table = exposed(scene, pointing={"kind": "table", "mode": mode, "rows": rows}, **DARK)
    if mode == "scan":
        one, _ = compare(table, device, field, STAR_ATOL)
        assert np.hypot(one.stars["dx_px"], one.stars["dy_px"]).min() > 10
    else:  # the step in the middle of the exposure is not in the image: the row of the middle holds
        _, one = image(table, device, field)
        assert np.hypot(one.stars["dx_px"], one.stars["dy_px"]).max(initial=0.0) < 1.5
        axes = table.scenario.view_axes(SENSOR, [MIDDLE_S])
        np.testing.assert_allclose(one.axes_icrs[0, 0], axes[0], atol=1e-12)


@pytest.mark.ci
def test_no_star_is_lost_that_only_passes_the_frame(scene, device, field):
    """A scan of 20 px across a narrow frame: most of its stars are outside it in the middle of the exposure."""
    ra_deg, dec_deg = towards_main(scene)
    rows = [
        {"time_s": MIDDLE_S - 100.0, "ra_deg": ra_deg - 80.0, "dec_deg": dec_deg},
        {"time_s": MIDDLE_S + 100.0, "ra_deg": ra_deg + 80.0, "dec_deg": dec_deg},
    ]
    narrow = {"n_row": 48, "n_col": 16, "fov_deg": 0.12}
    wide = exposed(scene, pointing={"kind": "table", "mode": "scan", "rows": rows}, **DARK).replace(camera=narrow)
    one, _ = compare(wide, device, field, STAR_ATOL)
    assert (~one.stars["in_fov"]).any()


@pytest.mark.ci
def test_a_frame_with_streaks_is_the_same_in_any_batch(scene, device, field):
    moving = exposed(scene).replace(frames={"count": 9, "interval_s": 1.0, "start_s": MIDDLE_S})
    together = ws.Renderer(moving, device).render(range(9), [SENSOR, "sat11"])
    alone = ws.Renderer(moving, device, n_thread=1).render([7], ["sat11"])
    np.testing.assert_array_equal(together.counts.numpy()[7, 1], alone.counts.numpy()[0, 0])


@pytest.mark.ci
def test_truth_counts_the_light_of_a_streak(scene, device):
    """snr_peak is of the pixel of the middle, left_out_w_cm2 of all that the stamps hold."""
    still = exposed(scene, pointing={"kind": "fixed", "ra_dec_deg": towards_main(scene)}, camera__n_row=96, **BRIGHT)
    signal, one = image(still, device, NO_STARS)
    main = one.truth[0]
    nei = still.scenario.instrument.nei_w_cm2("A")
    own = signal[round(float(main["y_px"])), round(float(main["x_px"]))]
    assert main["snr_peak"] == pytest.approx(own / nei, rel=1e-5)
    assert main["snr_peak"] < 0.2 * main["snr"]
    held = main["irradiance_w_cm2"] - main["left_out_w_cm2"]
    assert signal.sum() == pytest.approx(held, rel=2e-6)


@pytest.mark.ci
def test_light_grows_along_the_streak_of_a_target_that_comes_near(scene, device):
    """A pass at 20 km and 5 km/s: the range changes by a few percent from one end of the streak to the other."""
    passing = scene.replace(
        duration_s=200.0,
        frames={"count": 1, "interval_s": 10.0, "start_s": 88.0},
        constellation={"kind": "listed", "satellites": [_free("watcher", [7e6, 0.0, 0.0], [0.0, 7546.0, 0.0])]},
        trajectory={"kind": "state_vector", "position_m": [7.02e6, 0.0, -5000.0 * 87.3], "gravity": "two_body",
                    "velocity_m_s": [0.0, 7546.0, 5000.0]},
        targets=[{"name": "ball", "shape": {"kind": "sphere", "radius_m": 0.5}, "surface": {"emissivity": 0.9},
                  "temperature": {"start_k": 300.0}}],
        access_rules={}, bands=["A"], sky__catalog="none",
        camera={"n_row": 200, "n_col": 200, "fov_deg": 40.0},
        optics={"aperture_m": 0.4, "psf": "gaussian", "sigma_px": 0.7},
        pointing={"kind": "fixed", "azimuth_elevation_deg": (0.0, 90.0)},
        detector__exposure_s=EXPOSURE_S,
    )  # fmt: skip
    fine = {"count": N_INSTANT, "interval_s": EXPOSURE_S / N_INSTANT, "start_s": 88.0 - 0.4995 * EXPOSURE_S}
    images = [
        ws.Renderer(view, device).render(range(view.frames.count), ["watcher"], keep_signal=True).signal_w_cm2.numpy()
        for view in (passing, passing.replace(frames=fine, detector__exposure_s=0.0))
    ]
    streaked, mean = (image.astype(np.float64).mean(axis=0)[0, 0].sum(axis=1) for image in images)
    along = np.flatnonzero(mean > 0.9 * mean.max())
    ratio = streaked[along] / mean[along]
    assert len(along) > 20
    assert np.ptp(mean[along]) > 0.03 * mean.max()  # it does change
    assert np.ptp(ratio) < 2e-3
    assert ratio.mean() == pytest.approx(1.0, abs=2e-3)  # the mean is that at the range of the middle


def _free(name, position_m, velocity_m_s):
    orbit = {"kind": "state_vector", "position_m": position_m, "velocity_m_s": velocity_m_s, "gravity": "two_body"}
    return {"name": name, "orbit": orbit}


@pytest.mark.ci
def test_instants_are_chosen_by_short_slews_too():
    """A long scene follows sources as finely as a short one whose every frame is looked at; without the slew less."""
    slew = {"max_rate_deg_s": 5.0, "max_acceleration_deg_s2": 40.0, "settle_s": 0.1}
    main, other = {"start_s": 0.0, "track": "main"}, {"start_s": 650.01, "track": "main", "offset_px": [30, -5]}

    def n_path(start_s, count, *steps):
        frames = {"count": count, "interval_s": 0.1, "start_s": start_s}
        pointing = {"kind": "schedule", "steps": [main, *steps], "slew": slew}
        scene = ws.Scene.load("stss").replace(frames=frames, pointing=pointing, sky__catalog="none", bands=["A"])
        renderer = ws.Renderer(scene.replace(detector__exposure_s=0.1), device="cpu")
        return renderer.streaks(renderer.scenario.instrument, ["A"]).n_path

    assert n_path(600.0, 997, other) == n_path(649.0, 23, other) > n_path(600.0, 997)
