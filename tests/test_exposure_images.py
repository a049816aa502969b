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


def image(scene, device, frames=(0,)):
    """Mean noiseless signal [W/cm2] of frames, float64, and what was rendered."""
    rendered = ws.Renderer(scene, device).render(list(frames), [SENSOR], keep_signal=True, keep_stars=True)
    return rendered.signal_w_cm2.numpy().astype(np.float64).mean(axis=0)[0, 0], rendered


def compare(scene, device, atol):
    """The streaked frame against the mean of instants, in shares of the brightest source; both, and the shares."""
    streaked, one = image(scene, device)
    mean, many = image(instants(scene), device, range(N_INSTANT))
    brightest = max(one.stars["irradiance_w_cm2"].max(initial=0.0), one.truth["irradiance_w_cm2"].max())
    assert np.abs(streaked - mean).max() <= atol * brightest
    still, _ = image(scene.replace(detector__streaks=False), device)
    assert np.abs(still - mean).max() > 20 * atol * brightest  # it does move
    return one, many


def towards_main(scene):
    """Equatorial direction of the main target from the sensor in the middle of the exposure."""
    seen = scene.view_axes(SENSOR, [MIDDLE_S])[0, 2]
    return float(np.degrees(np.arctan2(seen[1], seen[0]))), float(np.degrees(np.arcsin(seen[2])))


def test_stars_streak_while_the_camera_tracks(scene, device):
    one, many = compare(exposed(scene), device, STAR_ATOL)
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


def test_targets_streak_through_a_still_camera(scene, device):
    still = exposed(scene, pointing={"kind": "fixed", "ra_dec_deg": towards_main(scene)}, sky__catalog="none")
    one, many = compare(still, device, TARGET_ATOL)
    main = one.truth[0]
    assert np.hypot(main["dx_px"], main["dy_px"]) > 3
    ends = many.truth[(many.truth["target"] == "center")]
    expected = np.array([ends["x_px"][-1] - ends["x_px"][0], ends["y_px"][-1] - ends["y_px"][0]]) / (1 - 1 / N_INSTANT)
    np.testing.assert_allclose([main["dx_px"], main["dy_px"]], expected, rtol=0, atol=PLACE_ATOL_PX)


def test_brightness_follows_the_spin_along_a_streak(scene, device):
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
        lighting={"sun": False, "earth": False, "albedo": False, "quadrature_error": 1e-4},
        pointing={"kind": "fixed", "ra_dec_deg": towards_main(scene)},
        sky__catalog="none",
    )
    compare(still, device, TARGET_ATOL)


def test_jitter_moves_light_within_the_exposure(scene, device):
    shaken = exposed(scene, pointing={"track": "main", "jitter": {"rms_urad": 60.0, "correlation_s": 0.4}})
    compare(shaken, device, 1e-3)


@pytest.mark.parametrize("mode", ["scan", "stare"])
def test_tables_of_directions(scene, device, mode):
    ra_deg, dec_deg = towards_main(scene)
    rows = [
        {"time_s": MIDDLE_S - 100.0, "ra_deg": ra_deg - 20.0, "dec_deg": dec_deg},
        {"time_s": MIDDLE_S + (100.0 if mode == "scan" else 0.0), "ra_deg": ra_deg + 20.0, "dec_deg": dec_deg},
        {"time_s": MIDDLE_S + 400.0, "ra_deg": ra_deg, "dec_deg": dec_deg},
    ]
    table = exposed(scene, pointing={"kind": "table", "mode": mode, "rows": rows})
    if mode == "scan":
        one, _ = compare(table, device, STAR_ATOL)
        assert np.hypot(one.stars["dx_px"], one.stars["dy_px"]).min() > 10
    else:  # the step in the middle of the exposure is not in the image: the row of the middle holds
        _, one = image(table, device)
        assert np.hypot(one.stars["dx_px"], one.stars["dy_px"]).max(initial=0.0) < 1.5
        axes = scene.replace(pointing={"kind": "table", "mode": mode, "rows": rows}).view_axes(SENSOR, [MIDDLE_S])
        np.testing.assert_allclose(one.axes_icrs[0, 0], axes[0], atol=1e-12)


def test_no_star_is_lost_that_only_passes_the_frame(scene, device):
    """A scan of 20 px across a narrow frame: most of its stars are outside it in the middle of the exposure."""
    ra_deg, dec_deg = towards_main(scene)
    rows = [
        {"time_s": MIDDLE_S - 100.0, "ra_deg": ra_deg - 80.0, "dec_deg": dec_deg},
        {"time_s": MIDDLE_S + 100.0, "ra_deg": ra_deg + 80.0, "dec_deg": dec_deg},
    ]
    narrow = {"n_row": 48, "n_col": 16, "fov_deg": 0.12}
    wide = exposed(scene, pointing={"kind": "table", "mode": "scan", "rows": rows}).replace(camera=narrow)
    one, _ = compare(wide, device, STAR_ATOL)
    assert (~one.stars["in_fov"]).any()


def test_a_frame_with_streaks_is_the_same_in_any_batch(scene, device):
    moving = exposed(scene).replace(frames={"count": 9, "interval_s": 1.0, "start_s": MIDDLE_S})
    together = ws.Renderer(moving, device).render(range(9), [SENSOR, "sat11"])
    alone = ws.Renderer(moving, device, n_thread=1).render([7], ["sat11"])
    np.testing.assert_array_equal(together.counts.numpy()[7, 1], alone.counts.numpy()[0, 0])
