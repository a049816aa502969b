"""Slews: the path of a camera from one step to the next, its limits, its ends, and that nobody sees meanwhile."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import warpsim as ws
from warpsim.scene.slews import between, rotation_vectors

TWIN_RAD = 1e-9
"""Kernel against host, as for all pointing."""
ROOM = 1.02
"""The turn may be so much slower than the limits allow, and is measured at instants."""

SLEW = {"max_rate_deg_s": 1.0, "max_acceleration_deg_s2": 0.1, "settle_s": 5.0}
FAR = [{"start_s": 0.0, "track": "main"}, {"start_s": 700.0, "ra_dec_deg": [187.0, -57.0]}]
STARS = [{"start_s": 0.0, "ra_dec_deg": [10.0, 20.0]}, {"start_s": 700.0, "ra_dec_deg": [50.0, 40.0]}]
SMALL = {"n_row": 16, "n_col": 16, "fov_deg": 1.0}


def slewing(scene, steps=FAR, slew=SLEW, **others):
    pointing = {"kind": "schedule", "steps": steps, "slew": slew, "up": "north", **others}
    return scene.replace(pointing=pointing, camera=SMALL, sky__catalog="none")


def rates_deg_s(scene, sensor, time_s):
    """Rates of the camera against the stars about ICRS axes [deg/s], between times."""
    axes = scene.scenario.view_axes(sensor, time_s)
    turns = Rotation.from_matrix(np.swapaxes(axes[1:], 1, 2)) * Rotation.from_matrix(axes[:-1])
    return np.degrees(turns.as_rotvec()) / np.diff(time_s)[:, None]


def turn_of(scene, sensor, step=1):
    instrument = scene.scenario.instrument
    return instrument.turns(instrument.index(sensor))[step]


@pytest.mark.parametrize("steps", [FAR, STARS], ids=["from-a-target", "between-stars"])
@pytest.mark.parametrize(("rate", "acceleration"), [(1.0, 0.1), (3.0, 0.02), (0.5, 5.0)])
def test_rate_and_acceleration_stay_within_their_limits(scene, steps, rate, acceleration):
    limits = {"max_rate_deg_s": rate, "max_acceleration_deg_s2": acceleration}
    turning = slewing(scene.replace(sensors__0__on=["sat11"]), steps, {**SLEW, **limits})
    turn = turn_of(turning, "sat11")
    assert turn.duration_s > 0
    times = 700.0 + np.linspace(0, turn.duration_s, 4001)
    rates = rates_deg_s(turning, "sat11", times)
    assert np.linalg.norm(rates, axis=1).max() < rate * ROOM
    few = 40
    changes = np.linalg.norm(rates[few:] - rates[:-few], axis=1) / (few * (times[1] - times[0]))
    assert changes.max() < acceleration * ROOM
    # It is no slower than one limit or the other asks for.
    assert np.linalg.norm(rates, axis=1).max() > rate / 1.1 or changes.max() > acceleration / 1.1


def test_a_turn_between_stars_takes_the_shortest_time(scene):
    """Closed form for a rotation from rest to rest."""
    turning = slewing(scene, STARS)
    axes = turning.scenario.view_axes("sat11", [699.0, 1000.0])
    angle = np.degrees(np.linalg.norm(rotation_vectors(axes[:1], axes[1:])))
    rate, acceleration = SLEW["max_rate_deg_s"], SLEW["max_acceleration_deg_s2"]
    expected_s = angle / rate + rate / acceleration
    assert turn_of(turning, "sat11").duration_s == pytest.approx(expected_s, rel=1e-9, abs=0)
    # Half way in angle at half time, about one axis.
    middle = turning.scenario.view_axes("sat11", [700.0 + expected_s / 2])
    np.testing.assert_allclose(middle, between(axes[:1], axes[1:], np.array([0.5])), rtol=0, atol=1e-12)


def test_angle_and_rate_are_continuous(scene):
    turning = slewing(scene)
    turn = turn_of(turning, "sat11")
    h = 1e-3
    for edge_s in (700.0, 700.0 + turn.duration_s):
        rates = rates_deg_s(turning, "sat11", edge_s + h * np.arange(-3, 4))
        assert np.abs(np.diff(rates, axis=0)).max() < 3 * h * SLEW["max_acceleration_deg_s2"] * ROOM
    jumping = slewing(scene, slew=None)
    assert np.linalg.norm(rates_deg_s(jumping, "sat11", np.array([700.0 - h, 700.0]))) > 1e3


@pytest.mark.ci
def test_kernel_follows_the_hosts_path(scene, device):
    turning = slewing(scene).replace(frames={"count": 200, "interval_s": 1.0, "start_s": 660.0})
    frames = ws.Renderer(turning, device=device).render(range(0, 200, 3), ["sat11", "sat27"], ["A"])
    for j, sensor in enumerate(frames.sensors):
        expected = turning.scenario.view_axes(sensor, frames.time_s)
        np.testing.assert_allclose(frames.axes_icrs[:, j], expected, rtol=0, atol=TWIN_RAD)
        turn = turn_of(turning, sensor)
        moving = (frames.time_s >= 700.0) & (frames.time_s < 700.0 + turn.total_s)
        np.testing.assert_array_equal(frames.slewing[:, j], moving)
        assert 5 < moving.sum() < 60


@pytest.mark.ci
def test_the_first_step_holds_before_its_start(scene, device):
    """An exposure about the first frame begins before the epoch: no turn is made there, by host or kernel."""
    turning = slewing(scene, STARS).replace(detector__exposure_s=0.2, sky__catalog="default")
    instrument = turning.scenario.instrument
    axes = instrument.commanded_axes(instrument.index("sat11"), np.array([-0.1, 0.0, 0.1])).axes
    assert np.ptp(axes, axis=0).max() < TWIN_RAD
    frames = ws.Renderer(turning, device=device).render([0], sensors=["sat11"], bands=["A"], keep_stars=True)
    assert not frames.slewing.any()
    stars = frames.stars
    assert len(stars) > 0 and np.hypot(stars["dx_px"], stars["dy_px"]).max() < 1e-6


@pytest.mark.ci
def test_nobody_has_access_while_the_camera_turns(scene):
    turning = slewing(scene).replace(frames={"count": 200, "interval_s": 1.0, "start_s": 660.0})
    still = slewing(scene, slew=None)
    total_s = turn_of(turning, "sat11").total_s
    times = np.arange(660.0, 860.0)
    settled = (times < 700.0) | (times >= 700.0 + total_s)
    one, other = (scene.scenario.has_access("sat11", times) for scene in (turning, still))
    np.testing.assert_array_equal(one, other & settled)
    assert (one != other).sum() > 5
    table = turning.access(sensors=["sat11"])
    inner = (table["start_s"] < 700.0 + total_s) & (table["end_s"] > 700.0)
    assert not inner.any()
    truth = ws.Renderer(turning, device="cpu").render([30, 50, 150], ["sat11"], ["A"]).truth
    seen = truth["access"].reshape(3, -1)
    assert seen[0].all() and not seen[1].any()


def test_tables_slew_from_row_to_row(scene):
    names = ("ra_deg", "dec_deg")
    rows = [{"time_s": step["start_s"], **dict(zip(names, step["ra_dec_deg"], strict=True))} for step in STARS]
    table = {"kind": "table", "mode": "stare", "rows": rows, "slew": SLEW, "up": "north"}
    tabled, planned = scene.replace(pointing=table), slewing(scene, STARS)
    times = np.linspace(690.0, 800.0, 50)
    axes = [one.scenario.view_axes("sat11", times) for one in (tabled, planned)]
    np.testing.assert_allclose(*axes, rtol=0, atol=1e-12)
    rows = [*rows, {**rows[1], "time_s": 1614.0}]
    quick = {**table, "mode": "scan", "rows": rows, "slew": {**SLEW, "max_rate_deg_s": 0.01}}
    with pytest.raises(ws.InputError, match=r"rows\[0\]: a scan must turn at most at max_rate_deg_s \(0.01\)"):
        scene.replace(pointing=quick).scenario  # noqa: B018


@pytest.mark.ci
def test_images_are_those_of_the_turning_camera(scene):
    """A target of the step before leaves the image along the path."""
    near = [{"start_s": 0.0, "track": "main"}, {"start_s": 700.0, "track": "main", "offset_px": [6.0, 0.0]}]
    gentle = {"max_rate_deg_s": 0.1, "max_acceleration_deg_s2": 0.002}
    only = scene.replace(sensors__0__on=["sat11"])
    turning = slewing(only, near, gentle, roll_deg=10.0)
    turning = turning.replace(frames={"count": 60, "interval_s": 1.0, "start_s": 695.0})
    frames = ws.Renderer(turning, device="cpu").render(range(60), ["sat11"], ["A"])
    main = frames.truth[frames.truth["target"] == "center"]
    np.testing.assert_allclose(main["y_px"], 7.5, rtol=0, atol=1e-3)
    x = np.asarray(main["x_px"])
    np.testing.assert_allclose(x[:6], 7.5, rtol=0, atol=1e-3)
    assert x[-1] == pytest.approx(13.5, rel=0, abs=1e-3) and (np.diff(x[5:]) > -1e-9).all()


@pytest.mark.parametrize(
    ("steps", "slew", "message"),
    [
        (
            [*FAR, {"start_s": 710.0, "track": "main"}],
            SLEW,
            r"^sat11: pointing.steps\[2\].start_s: must leave time for the slew that begins at 700 s, which takes .* s",
        ),
        (FAR, {**SLEW, "max_rate_deg_s": 0.0}, r"pointing.slew.max_rate_deg_s: must be > 0"),
        (FAR, {**SLEW, "max_rate_deg_s": 1e-3}, r"^sat11: pointing.steps\[1\].start_s: .*faster than max_rate_deg_s"),
        (FAR[::-1], SLEW, r"pointing.steps\[1\].start_s: must be above that of the step before \(700\), got 0"),
        ([{"start_s": 5.0, "track": "main"}], SLEW, r"pointing: the steps of sat11 cover from 5 s on"),
        ([{"start_s": 0.0}], SLEW, r"pointing.steps\[0\]: track, ra_dec_deg, .*: exactly one must be given"),
        ([{"start_s": 0.0, "track": "nobody"}], SLEW, r"pointing.steps\[0\].track: must be 'main'.* got 'nobody'"),
    ],
)  # fmt: skip
def test_slews_that_cannot_be_made_are_one_line(scene, steps, slew, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        slewing(scene, steps, slew).scenario  # noqa: B018
    assert "\n" not in str(caught.value)


FUSED_RTOL = 2e-7
"""A GPU's compiler fuses multiplications and additions of two kernels as it likes."""


@pytest.mark.ci
def test_slews_of_others_do_not_change_an_exposure(scene, device):
    """A camera without a slew keeps the law of the exposure's middle, whether others of its kind slew or not."""
    steps = [{"start_s": 0.0, "track": "main"}, {"start_s": 700.05, "track": "main", "offset_px": [3.0, 2.0]}]
    jumping = {"kind": "schedule", "steps": steps, "up": "north"}
    signals = []
    for slew in (None, SLEW):
        entries = [{**jumping, "on": "sat1?"}, {**jumping, **({"slew": slew} if slew else {})}]
        mixed = scene.replace(
            pointing=entries, camera=SMALL, sky__catalog="none", detector__exposure_s=0.4, frames__start_s=0.0
        ).replace(frames={"count": 800, "interval_s": 1.0})
        frames = ws.Renderer(mixed, device=device).render([700], ["sat11"], ["A"], keep_signal=True)
        signals.append(frames.signal_w_cm2.numpy())
        truth = frames.truth[frames.truth["target"] == "center"]
        assert abs(truth["dx_px"][0]) < 0.5
    np.testing.assert_allclose(*signals, rtol=FUSED_RTOL if device.startswith("cuda") else 0.0)


@pytest.mark.parametrize("back_deg", [180.0, 179.9, -179.9])
@pytest.mark.ci
def test_half_a_turn_goes_one_way_round(scene, device, back_deg):
    """From ahead to behind: rounding must not choose the way anew at each instant."""
    steps = [{"start_s": 0.0, "azimuth_elevation_deg": [0.0, -22.0]},
             {"start_s": 700.0, "azimuth_elevation_deg": [back_deg, -22.0]}]  # fmt: skip
    turning = slewing(scene, steps, up="zenith")
    limits = SLEW["max_rate_deg_s"], SLEW["max_acceleration_deg_s2"]
    for sensor in ("sat11", "sat27"):
        turn = turn_of(turning, sensor)
        assert turn.duration_s == pytest.approx(abs(back_deg) / limits[0] + limits[0] / limits[1], rel=0.1)
        rates = rates_deg_s(turning, sensor, 700.0 + np.linspace(0, turn.duration_s, 2001))
        assert np.linalg.norm(rates, axis=1).max() < limits[0] * ROOM
    fast = turning.replace(frames={"count": 2500, "interval_s": 0.1, "start_s": 695.0})
    frames = ws.Renderer(fast, device=device).render(range(0, 2500, 11), ["sat11", "sat27"], ["A"])
    for j, sensor in enumerate(frames.sensors):
        expected = fast.scenario.view_axes(sensor, frames.time_s)
        np.testing.assert_allclose(frames.axes_icrs[:, j], expected, rtol=0, atol=TWIN_RAD)


def test_slews_do_not_begin_before_the_scene():
    steps = [{"start_s": -100.0, "track": "main"}, {"start_s": -1.0, "azimuth_elevation_deg": [0.0, -20.0]}]
    with pytest.raises(ws.InputError, match=r"steps\[1\].start_s: must be >= 0 where cameras slew to it, got -1$"):
        ws.SchedulePointing(steps=steps, slew=ws.Slew(max_rate_deg_s=1.0, max_acceleration_deg_s2=0.1))
    assert len(ws.SchedulePointing(steps=steps).steps) == 2
