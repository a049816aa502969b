"""Errors of pointing: jitter against its process, bias and drift, and what they do to scenes."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp
from read_outs import philox, sensor_key
from scipy import integrate, linalg, stats
from warpsim_kernels import pixel_pairs
from warpsim_kernels.pointing_errors import (
    N_STEP,
    STEPS_PER_CORRELATION,
    STREAM_DRIFT,
    STREAM_JITTER,
    Jitter,
    jitter_rad,
    turned_axes,
)

import warpsim as ws
from warpsim.render.pointing_arrays import jitter_struct

RMS_URAD, CORRELATION_S = 5.0, 0.05
RMS_RAD = RMS_URAD * 1e-6
SEED = 2024
N_DRAW = 100_000

TWIN_RMS = 1e-6
"""Device against twin, in rms: float32 deviates, each good to 2e-6, averaged over some tens of shocks."""
COVARIANCE = 1e-4
"""Model against the closed form, in rms^2: cubic between nodes (measured: 3.7e-5), 8 correlation times (2e-6)."""
SIGMA_GATE = 5.0
TURN_ATOL = 4e-15
"""Float64 rounding of unit vectors."""


@wp.kernel(enable_backward=False)
def jitter_kernel(
    jitter: wp.array[Jitter], sensor: wp.array[wp.int32], time_s: wp.array[wp.float64], out: wp.array[wp.vec2d]
):
    i = wp.tid()
    out[i] = jitter_rad(jitter[sensor[i]], time_s[i])


@wp.kernel(enable_backward=False)
def turned_kernel(axes: wp.array[wp.mat33d], angle: wp.array[wp.vec2d], out: wp.array[wp.mat33d]):
    i = wp.tid()
    out[i] = turned_axes(axes[i], angle[i])


def angles(sensor, time_s, device="cpu", seed=SEED, correlation_s=CORRELATION_S):
    """Angles about x and y [rms], shape (n, 2)."""
    sensor, time_s = np.broadcast_arrays(sensor, time_s)
    known, row = np.unique(sensor.ravel(), return_inverse=True)
    structs = [jitter_struct(ws.Jitter(RMS_URAD, correlation_s), sensor_key(seed, one)) for one in known]
    struct = wp.array(structs, dtype=Jitter, device=device)
    out = wp.empty(time_s.size, dtype=wp.vec2d, device=device)
    rows = wp.array(row.astype(np.int32), dtype=wp.int32, device=device)
    times = wp.array(time_s.ravel().astype(float), dtype=wp.float64, device=device)
    wp.launch(jitter_kernel, time_s.size, inputs=[struct, rows, times], outputs=[out], device=device)
    return out.numpy().reshape(*time_s.shape, 2) / RMS_RAD


def deviates(step, key):
    """Two unit normal deviates for each of the axes x and y: rows are deviates, columns axes."""
    step %= 2**64
    words = philox((step % 2**32, step >> 32, 0, 2), (key % 2**32, key >> 32))
    rows = []
    for radius_word, turn_word in (words[:2], words[2:]):
        radius = math.sqrt(-2 * math.log((radius_word | 1) / 2**32)) * (-1) ** (radius_word % 2)
        turn = 2 * math.pi * ((turn_word + 2**31) % 2**32 - 2**31) / 2**33
        rows.append((radius * math.cos(turn), radius * math.sin(turn)))
    return np.array(rows)


FLOW = np.array([[0.0, 1.0], [-4.0, -4.0]])
"""d/du of (angle, d angle/du), u = time / correlation time: the critically damped oscillator."""
STEP = 1.0 / STEPS_PER_CORRELATION


def shock_root():
    """Cholesky root of a step's shock: white noise of density 32, carried to the step's end, by quadrature."""

    def density(u):
        end = linalg.expm(FLOW * u)[:, 1]
        return 32.0 * np.outer(end, end).ravel()

    return np.linalg.cholesky(integrate.quad_vec(density, 0.0, STEP, epsabs=1e-15)[0].reshape(2, 2))


ROOT = shock_root()
DECAYS = np.array([linalg.expm(FLOW * (STEP * back)) for back in range(N_STEP)])


def weights(u):
    """What the angle at u correlation times is made of: the first node's number, and weights (n_shock, 2) of deviates.

    Shock number i is that of step node - N_STEP + i.
    """
    node = math.floor(u / STEP)
    part = u / STEP - node
    rest = 1 - part
    at_node = np.zeros((2, 2, N_STEP + 1, 2))  # (this node or the next, angle or rate, shock, deviate)
    for which in range(2):
        for back in range(N_STEP):
            at_node[which, :, N_STEP - 1 - back + which] = DECAYS[back] @ ROOT
    (a0, v0), (a1, v1) = at_node
    rise = part * part * (3 - 2 * part)
    slopes = STEP * (v0 * part * rest * rest - v1 * part * part * rest)
    return node, a0 * (1 - rise) + a1 * rise + slopes


def twin(key, time_s, correlation_s=CORRELATION_S):
    """Angles about x and y [rms] at one time."""
    node, weight = weights(time_s / correlation_s)
    return sum(w @ deviates(node - N_STEP + i, key) for i, w in enumerate(weight))


@pytest.mark.parametrize("time_s", [0.0, 0.0123, 1.0, 1e-9, 0.2 * (1 - 1e-12), 7.0 / 3, 86_400.7, -0.31])
@pytest.mark.parametrize(("sensor", "seed"), [(0, SEED), (27, 2**63 - 1)])
def test_kernel_matches_twin(device, sensor, seed, time_s):
    expected = twin(sensor_key(seed, sensor), time_s)
    np.testing.assert_allclose(angles(sensor, time_s, device, seed), expected, rtol=0, atol=TWIN_RMS)


def test_step_numbers_beyond_32_bits(device):
    """A millisecond of correlation, a year into the scene: step numbers need the counter's second word."""
    time_s = 3.1557e7 + 0.123
    assert time_s / 1e-4 * STEPS_PER_CORRELATION > 2**32
    node, weight = weights(time_s / 1e-4)
    expected = sum(w @ deviates(node - N_STEP + i, sensor_key(SEED, 3)) for i, w in enumerate(weight))
    # Seconds have 4e-9 s of rounding here, 6e-4 of a step: the angle's slope is about 2 rms per correlation time.
    np.testing.assert_allclose(angles(3, time_s, device, SEED, 1e-4), expected, rtol=0, atol=1e-3)


def autocorrelation(u):
    return (1 + 2 * np.abs(u)) * np.exp(-2 * np.abs(u))


def test_covariance_of_the_construction():
    """Exactly, from its weights: at any phase between nodes and any lag, the closed form; variance 1."""
    worst = 0.0
    for phase in np.linspace(0, 1, 11):
        node_a, a = weights((3 * N_STEP + phase) * STEP)
        for lag in np.linspace(0, 9, 73):
            node_b, b = weights((3 * N_STEP + phase) * STEP + lag)
            shift = node_b - node_a
            overlap = np.sum(a[shift:] * b[: len(b) - shift]) if shift < len(b) else 0.0
            worst = max(worst, abs(overlap - autocorrelation(lag)))
    assert 1e-6 < worst < COVARIANCE  # there is something to measure
    assert integrate.quad(autocorrelation, 0, np.inf)[0] == pytest.approx(1.0, rel=0, abs=1e-12)


@pytest.fixture(scope="module")
def draws():
    """Angles at lags 0, 0.1 ... of N_DRAW independent times and sensors: (n_lag, n_draw, 2)."""
    sensor = np.arange(N_DRAW) % 40
    time_s = (np.arange(N_DRAW) // 40) * 10.37 * CORRELATION_S
    return np.stack([angles(sensor, time_s + lag * CORRELATION_S) for lag in LAGS])


LAGS = (0.0, 0.1, 0.5, 1.0, 2.0, 4.0)


@pytest.mark.ci
def test_mean_and_rms(draws):
    n = draws[0].size
    assert abs(draws[0].mean()) < SIGMA_GATE / math.sqrt(n)
    assert abs(draws[0].var() - 1) < SIGMA_GATE * math.sqrt(2 / n) + COVARIANCE


@pytest.mark.parametrize("lag", range(1, len(LAGS)), ids=lambda lag: f"{LAGS[lag]}T")
@pytest.mark.ci
def test_autocorrelation(draws, lag):
    expected = autocorrelation(LAGS[lag])
    measured = np.mean(draws[0] * draws[lag])
    assert abs(measured - expected) < SIGMA_GATE * math.sqrt((1 + expected**2) / draws[0].size) + COVARIANCE


@pytest.mark.ci
def test_normality(draws):
    assert stats.kstest(draws[0].ravel(), "norm").pvalue > 1e-4
    beyond = np.count_nonzero(np.abs(draws[0]) > 3)
    expected = draws[0].size * 2 * stats.norm.sf(3)
    assert abs(beyond - expected) < SIGMA_GATE * math.sqrt(expected)


def test_axes_sensors_and_seeds_are_independent():
    times = np.arange(10_000) * 9.1 * CORRELATION_S
    a, b, other = angles(0, times), angles(1, times), angles(0, times, seed=SEED + 1)
    gate = SIGMA_GATE / math.sqrt(len(times))
    for first, second in ((a[:, 0], a[:, 1]), (a[:, 0], b[:, 0]), (a[:, 1], b[:, 0]), (a[:, 0], other[:, 0])):
        assert abs(np.mean(first * second)) < gate
    # The rate of one axis against the other: a quarter turn between them would show here.
    late = angles(0, times + 0.4 * CORRELATION_S)
    assert abs(np.mean(late[:, 0] * a[:, 1])) < gate


def test_angle_and_rate_are_continuous(device):
    """At nodes, where one cubic ends and the next begins, and where the oldest shock leaves the sum."""
    step_s = CORRELATION_S * STEP
    nodes_s = np.arange(5, 200) * step_s
    h = 1e-3 * step_s
    values = {k: angles(2, nodes_s + k * h, device) for k in (-2, -1, -1e-6, 1e-6, 1, 2)}
    assert np.abs(values[1e-6] - values[-1e-6]).max() < 1e-8
    before = (values[-1e-6] * 3 - 4 * values[-1] + values[-2]) / 2  # second-order one-sided differences
    after = (-values[1e-6] * 3 + 4 * values[1] - values[2]) / 2
    # Third differences within a cubic: the shocks' jump of its third derivative times h^3.
    np.testing.assert_allclose(before / h, after / h, rtol=0, atol=1e-4 * np.abs(after / h).max())


def test_streams_differ():
    """The read-out's noise and jitter share the key; the last counter word keeps them apart."""
    numbers = [int(value) for name, value in vars(pixel_pairs).items() if name.startswith("STREAM_")]
    numbers += [int(STREAM_JITTER), int(STREAM_DRIFT)]
    assert len(set(numbers)) == len(numbers) == 9


def test_turned_axes_are_rotations_about_x_and_y(device):
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(5)
    axes = Rotation.random(300, random_state=rng).as_matrix()
    angle = rng.normal(size=(300, 2)) * np.logspace(-9, 0.3, 300)[:, None]
    angle[0] = 0.0
    inputs = [wp.array(axes, dtype=wp.mat33d, device=device), wp.array(angle, dtype=wp.vec2d, device=device)]
    out = wp.empty(300, dtype=wp.mat33d, device=device)
    wp.launch(turned_kernel, 300, inputs=inputs, outputs=[out], device=device)
    vectors = np.einsum("nk,nkj->nj", angle, axes[:, :2])
    expected = np.einsum("nij,nkj->nki", Rotation.from_rotvec(vectors).as_matrix(), axes)
    np.testing.assert_allclose(out.numpy(), expected, rtol=0, atol=TURN_ATOL)
    np.testing.assert_array_equal(out.numpy()[0], axes[0])


SHAKEN = {"rms_urad": 200.0, "correlation_s": 3.0}


@pytest.fixture(scope="module")
def shaken(scene):
    return scene.replace(pointing__jitter=SHAKEN, camera__n_row=32, camera__n_col=32)


@pytest.mark.ci
def test_images_are_shaken_by_the_twins_angles(shaken):
    frames = ws.Renderer(shaken, device="cpu").render([60, 61], ["sat27", "sat11"], ["A"])
    for i, time_s in enumerate(frames.time_s):
        for j, sensor in enumerate(frames.sensors):
            commanded = shaken.scenario.view_axes(sensor, [time_s])[0]
            instrument = shaken.scenario.instrument
            a, b = twin(instrument.pointing_key(instrument.index(sensor)), time_s, 3.0) * 200e-6
            boresight = frames.axes_icrs[i, j, 2]
            # The rest is of second order in the angle.
            np.testing.assert_allclose(commanded @ boresight, [b, -a, 1.0], rtol=0, atol=0.51 * (a * a + b * b))
            assert np.hypot(a, b) > 1e-6
            # The tracked target stands on the other side: it moves against the boresight.
            row = frames.truth[(frames.truth["frame"] == frames.frames[i]) & (frames.truth["sensor"] == sensor)][0]
            focal = shaken.camera.focal_px
            assert row["x_px"] - 15.5 == pytest.approx(-b * focal, rel=0, abs=1e-4)
            assert row["y_px"] - 15.5 == pytest.approx(a * focal, rel=0, abs=1e-4)


@pytest.mark.ci
def test_jitter_is_the_same_alone_in_any_batch_and_order(shaken):
    renderer = ws.Renderer(shaken, device="cpu")
    batch = renderer.render([70, 60, 80], ["sat11", "sat27"], ["A", "C"])
    for i, frame in enumerate(batch.frames):
        alone = ws.Renderer(shaken, device="cpu", n_thread=1).render([frame], ["sat27"], ["A"])
        np.testing.assert_array_equal(alone.axes_icrs[0, 0], batch.axes_icrs[i, 1])
        np.testing.assert_array_equal(alone.counts.numpy()[0, 0, 0], batch.counts.numpy()[i, 1, 0])


@pytest.mark.ci
def test_no_jitter_and_none_of_zero_rms_are_one(scene):
    small = scene.replace(camera__n_row=16, camera__n_col=16)
    still = ws.Renderer(small, device="cpu").render([60], ["sat11"])
    zero = small.replace(pointing__jitter={"rms_urad": 0.0, "correlation_s": 1.0})
    frames = ws.Renderer(zero, device="cpu").render([60], ["sat11"])
    np.testing.assert_array_equal(frames.axes_icrs, still.axes_icrs)
    np.testing.assert_array_equal(frames.counts.numpy(), still.counts.numpy())


def test_units_and_rules():
    import astropy.units as u

    assert ws.Jitter(1 * u.arcsec, 20 * u.ms).rms_urad == pytest.approx(np.radians(1 / 3600) * 1e6, rel=1e-12)
    for bad, text in (((-1.0, 0.1), "rms_urad"), ((1.0, 0.0), "correlation_s"), ((np.nan, 1.0), "rms_urad")):
        with pytest.raises(ws.InputError, match=text):
            ws.Jitter(*bad)


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
