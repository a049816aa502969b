"""Bias and drift: against a NumPy twin, their statistics over sensors and periods, and how they stand in images."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from test_jitter import philox

import warpsim as ws

SMALL = {"n_row": 16, "n_col": 16, "fov_deg": 1.0}
URAD = 1e-6
TWIN_RAD = 1e-12
"""float32 deviates of the kernel, times 100 urad."""
SECOND_ORDER = 1e-7
"""Squares of 300 urad, between the two ways of writing a small rotation."""
N_SIGMA = 5.0


def erring(scene, **errors):
    frames = {"count": 162, "interval_s": 10.0}
    pointing = {"kind": "fixed", "ra_dec_deg": [40.0, 10.0], "up": "north", **errors}
    return scene.replace(pointing=pointing, camera=SMALL, sky__catalog="none", frames=frames)


def errors_rad(scene, frames, sensors, device="cpu"):
    """Angles about the camera's x and y axes, (frame, sensor, 2), from commanded and true axes."""
    rendered = ws.Renderer(scene, device=device).render(frames, sensors, ["A"])
    found = np.empty((len(rendered.frames), len(rendered.sensors), 2))
    for j, sensor in enumerate(rendered.sensors):
        commanded = scene.scenario.view_axes(sensor, rendered.time_s)
        seen = np.einsum("nij,nj->ni", commanded, rendered.axes_icrs[:, j, 2])
        found[:, j] = np.stack([-seen[:, 1], seen[:, 0]], axis=1)
    return rendered.time_s, found


@pytest.mark.ci
def test_a_given_bias_turns_every_camera(scene, device):
    one = erring(scene, bias={"urad": [120.0, -40.0]})
    _, found = errors_rad(one, [0, 70, 161], scene.sensor_names[::9], device)
    np.testing.assert_allclose(found, np.broadcast_to([120e-6, -40e-6], found.shape), rtol=0, atol=SECOND_ORDER)


@pytest.mark.ci
def test_a_given_drift_grows_from_period_to_period(scene, device):
    growing = erring(scene, drift={"urad_s": [0.2, -0.1]})
    time_s, found = errors_rad(growing, [0, 70, 161], ["sat11"], device)
    np.testing.assert_allclose(found[:, 0] / URAD, time_s[:, None] * [0.2, -0.1], rtol=0, atol=0.1)
    anew = erring(scene, drift={"urad_s": [2.0, -1.0], "reset_s": 130.0})
    time_s, found = errors_rad(anew, range(0, 162, 5), ["sat11"], device)
    np.testing.assert_allclose(found[:, 0] / URAD, (time_s % 130.0)[:, None] * [2.0, -1.0], rtol=0, atol=0.1)


def twin_rates(key, period):
    """Two unit normal deviates of a period of a sensor, from Philox in Python integers."""
    words = philox((period % 2**32, (period >> 32) % 2**32, 0, 10), (key % 2**32, key >> 32))
    radius = np.sqrt(-2 * np.log((words[0] | 1) / 2**32)) * (-1) ** (words[0] % 2)
    turn = 2 * np.pi * ((words[1] + 2**31) % 2**32 - 2**31) / 2**33
    return np.array([radius * np.cos(turn), radius * np.sin(turn)])


@pytest.mark.ci
def test_drawn_drifts_are_the_twins(scene, device):
    one = erring(scene, drift={"rms_urad_s": 3.0, "reset_s": 70.0})
    sensors = ["sat11", "sat36"]
    time_s, found = errors_rad(one, range(0, 162, 3), sensors, device)
    instrument = one.scenario.instrument
    for j, sensor in enumerate(sensors):
        key = instrument.pointing_key(instrument.index(sensor))
        for i, time in enumerate(time_s):
            expected = 3e-6 * twin_rates(key, int(time // 70.0)) * (time % 70.0)
            np.testing.assert_allclose(found[i, j], expected, rtol=1e-5, atol=SECOND_ORDER)


@pytest.mark.ci
def test_statistics_over_sensors_and_periods(scene):
    """Standard deviation, independence of axes and sensors, and normality of what is drawn."""
    many = erring(scene, bias={"rms_urad": 50.0}).replace(constellation__n_satellite=1120)
    _, found = errors_rad(many, [0], many.sensor_names)
    biases = found[0] / 50e-6
    n = biases.size
    assert abs(biases.mean()) < N_SIGMA / np.sqrt(n)
    assert abs(biases.var() - 1) < N_SIGMA * np.sqrt(2 / n)
    assert abs(np.mean(biases[:, 0] * biases[:, 1])) < N_SIGMA / np.sqrt(len(biases))
    assert stats.kstest(biases.ravel(), "norm").pvalue > 1e-4
    drifting = erring(scene, drift={"rms_urad_s": 10.0, "reset_s": 7.0})
    time_s, found = errors_rad(drifting, [k for k in range(162) if (k * 10) % 7], scene.sensor_names)
    rates = found / (time_s % 7.0)[:, None, None] / 10e-6
    own = [(int(time // 7.0), rates[i]) for i, time in enumerate(time_s)]
    values = np.array([value for _, value in dict(own).items()])
    n = values.size
    assert abs(values.mean()) < N_SIGMA / np.sqrt(n)
    assert abs(values.var() - 1) < N_SIGMA * np.sqrt(2 / n)
    assert abs(np.mean(values[1:] * values[:-1])) < N_SIGMA / np.sqrt(n)
    assert abs(np.mean(values[:, 1:] * values[:, :-1])) < N_SIGMA / np.sqrt(n)


@pytest.mark.ci
def test_errors_do_not_depend_on_other_sensors(scene):
    errors = {"bias": {"rms_urad": 50.0}, "drift": {"rms_urad_s": 3.0, "reset_s": 70.0}}
    one = erring(scene, **errors, jitter={"rms_urad": 20.0, "correlation_s": 2.0})
    _, alone = errors_rad(one.replace(sensors__0__on=["sat27"]), [33, 70], ["sat27"])
    _, found = errors_rad(one, [70, 33], ["sat11", "sat27"])
    np.testing.assert_array_equal(alone[::-1, 0], found[:, 1])
    assert np.abs(found[:, 0] - found[:, 1]).min() > 1e-6
    _, other = errors_rad(one.replace(seed=1), [70, 33], ["sat11", "sat27"])
    assert np.abs(found - other).min() > 1e-8
    _, same = errors_rad(one.replace(noise_seed=1), [70, 33], ["sat11", "sat27"])
    np.testing.assert_array_equal(found, same)


@pytest.mark.ci
def test_an_exposure_lies_in_one_period(scene):
    """A period ends in the middle of the exposures: they are drawn without the jump, along one line."""
    gaussian = {"aperture_m": 0.4, "psf": "gaussian", "sigma_px": 0.7}
    bright = {"optics": gaussian}
    bright |= {"targets__0__temperature": {"start_k": 350.0}, "detector__exposure_s": 1.0, "detector__streaks": True}
    drift = {"urad_s": [0.0, 2000.0], "reset_s": 10.0}
    one = scene.replace(pointing={"track": "main", "drift": drift}, camera={**SMALL, "fov_deg": 2.0}, **bright)
    rendered = ws.Renderer(one.replace(sky__catalog="none"), device="cpu").render([60, 61], ["sat11"], ["A"])
    main = rendered.truth[rendered.truth["target"] == "center"]
    per_px = np.radians(2.0) / 16
    np.testing.assert_allclose(main["x_px"], 7.5, rtol=0, atol=1e-3)
    np.testing.assert_allclose(main["dx_px"], -2000e-6 / per_px, rtol=2e-2)


@pytest.mark.ci
def test_errors_that_are_zero_are_not_in_the_kernel(scene):
    from warpsim.render.pointing_arrays import aim_features

    zero = erring(scene, bias={"rms_urad": 0.0}, drift={"urad_s": [0.0, 0.0]})
    assert not aim_features(zero.scenario.instrument).steady_errors
    assert aim_features(erring(scene, bias={"rms_urad": 1.0}).scenario.instrument).steady_errors
    np.testing.assert_array_equal(
        ws.Renderer(zero, device="cpu").render([5], ["sat11"]).counts.numpy(),
        ws.Renderer(erring(scene), device="cpu").render([5], ["sat11"]).counts.numpy(),
    )


@pytest.mark.parametrize(
    ("errors", "message"),
    [
        ({"bias": {}}, "pointing.bias: rms_urad, urad: exactly one must be given"),
        ({"bias": {"rms_urad": 1.0, "urad": [1.0, 2.0]}}, "pointing.bias: rms_urad, urad: exactly one must be given"),
        ({"bias": {"rms_urad": -1.0}}, r"Scene: pointing.bias.rms_urad: must be >= 0, got -1.0"),
        ({"drift": {"rms_urad_s": 1.0, "reset_s": 0.0}}, r"Scene: pointing.drift.reset_s: must be > 0, got 0.0"),
        ({"drift": {"urad_s": [1.0]}}, r"pointing.drift.urad_s"),
    ],
)
def test_bad_errors_of_pointing(scene, errors, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        erring(scene, **errors)
    assert "\n" not in str(caught.value)
