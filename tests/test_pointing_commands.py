"""Pointing commands: frames after a command are those of a scene whose schedule has that step, bit for bit."""

import threading

import numpy as np
import pytest

import warpsim as ws

SLEW = {"max_rate_deg_s": 5.0, "max_acceleration_deg_s2": 10.0, "settle_s": 0.1}
MAIN = {"start_s": 0.0, "track": "main"}
SENSORS, N_FRAME = ["sat11", "sat27"], 40
PIXELS_ROUNDED = 100
"""Of 1.3 million: how finely an exposure is followed is judged once, by the pointing of the scene (21 were seen)."""
STRAIGHT_RAD = 1e-9
"""Axes are float64; directions of a fixed law are known to 1e-15."""


def scene_of(pointing, **changes):
    frames = {"count": 60, "interval_s": 1 / 30, "start_s": 600.0}
    return ws.Scene.load("stss").replace(frames=frames, pointing=pointing, sky__catalog="none", **changes)


def schedule(*steps, **fields):
    return {"kind": "schedule", "steps": [MAIN, *steps], "slew": SLEW, **fields}


def run(renderer, commands, n_frame=N_FRAME):
    """Counts, axes and slewing of a stream, and what was done: commands by the frame at whose arrival they are sent."""
    frames, applied = [], []
    stream = renderer.stream(range(n_frame), SENSORS, ["A"], n_ahead=2)
    for frame in stream:
        frames.append(frame)
        if frame.frames[0] in commands:
            applied += stream.send(commands[frame.frames[0]])
            assert frame.frames[0] < applied[-1].frame <= frame.frames[0] + 5  # n_ahead, and those being rendered
    return frames, applied


def assert_same(frames, scene, n_frame=N_FRAME, most_different=0):
    expected = ws.Renderer(scene, device="cpu").render(range(n_frame), SENSORS, ["A"])
    for name in ("axes_icrs", "slewing"):
        got = np.concatenate([getattr(frame, name) for frame in frames])
        np.testing.assert_array_equal(got, getattr(expected, name), err_msg=name)
    counts = np.concatenate([frame.counts.numpy() for frame in frames]).astype(int)
    different = np.abs(counts - expected.counts.numpy())
    assert different.sum() <= most_different and different.max() <= 1
    rows = expected.truth["frame"] == n_frame - 1
    for name in ("access", "x_px", "y_px", "irradiance_w_cm2"):
        np.testing.assert_array_equal(frames[-1].truth[name], expected.truth[name][rows])


@pytest.mark.ci
@pytest.mark.parametrize(
    ("exposure_s", "most_different"),
    [(0.0, 0), (0.02, PIXELS_ROUNDED)],
    ids=["instants", "exposure"],
)
def test_commands_replay_as_a_schedule(exposure_s, most_different):
    change = {"detector__exposure_s": exposure_s}
    commands = {
        3: {"sensor": "sat11", "track": "sphere01", "offset_px": [20, -5], "roll_deg": 3.0},
        25: {"sensor": "sat11", "ra_dec_deg": [100.0, 40.0]},
    }
    frames, applied = run(ws.Renderer(scene_of(schedule(), **change), device="cpu"), commands)
    assert [row.sensor for row in applied] == ["sat11", "sat11"]
    steps = [row.step for row in applied]
    assert [row.step.start_s for row in applied] == [row.start_s for row in applied]
    assert_same(frames, scene_of([schedule(*steps, on=["sat11"]), schedule()], **change), N_FRAME, most_different)
    slewing, begun = np.concatenate([frame.slewing for frame in frames]), applied[0].frame
    assert not slewing[:begun].any() and slewing[begun].tolist() == [True, False] and not slewing[:, 1].any()


def towards(ra_deg, dec_deg):
    ra, dec = np.radians([ra_deg, dec_deg])
    return np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])


def test_a_camera_keeps_its_limits_and_gets_there():
    scene = scene_of(schedule())
    x, y, z = scene.scenario.view_axes("sat11", 600.0)[0, 2]
    ra_dec_deg = [float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arcsin(z))) + 2.0]
    frames, (row,) = run(ws.Renderer(scene, device="cpu"), {3: {"sensor": "sat11", "ra_dec_deg": ra_dec_deg}}, 50)
    axes = np.concatenate([frame.axes_icrs for frame in frames])[:, 0]
    turns = np.einsum("nij,nkj->nik", axes[1:], axes[:-1])
    rate_deg_s = np.degrees(np.arccos(np.clip((np.trace(turns, axis1=1, axis2=2) - 1) / 2, -1, 1))) * 30
    settled = int(np.ceil((row.settled_s - 600.0) * 30))
    assert 2.0 < rate_deg_s[row.frame :].max() <= SLEW["max_rate_deg_s"] * 1.01
    assert settled < 50 and np.abs(axes[settled:, 2] - towards(*ra_dec_deg)).max() < STRAIGHT_RAD


@pytest.mark.ci
def test_without_limits_the_camera_jumps():
    """At the next frame; the command takes the place of later steps of the scene."""
    later = {"start_s": 600.5, "track": "sphere02"}
    scene = scene_of(schedule(later, slew=None))
    frames, (row,) = run(
        ws.Renderer(scene, device="cpu"), {3: {"sensor": "sat11", "azimuth_elevation_deg": [0, 10]}}, 20
    )
    assert row.start_s == row.settled_s == 600.0 + row.frame / 30
    same = schedule(row.step, slew=None, on=["sat11"])
    assert_same(frames, scene_of([same, schedule(later, slew=None)]), 20)


def test_a_command_waits_until_the_camera_is_settled_and_the_latest_counts():
    slew = SLEW | {"settle_s": 0.6}
    renderer = ws.Renderer(scene_of(schedule(slew=slew)), device="cpu")
    commands = {
        3: {"sensor": "sat11", "track": "sphere01", "offset_px": [40, 0]},
        9: {"sensor": "sat11", "track": "sphere02"},
        10: {"sensor": "sat11", "track": "sphere03"},
    }
    frames, (first, second, third) = run(renderer, commands)
    assert second.start_s == third.start_s == first.settled_s > 600.0 + third.frame / 30
    assert third.step.track == "sphere03"
    same = schedule(first.step, third.step, on=["sat11"], slew=slew)
    assert_same(frames, scene_of([same, schedule(slew=slew)]))


@pytest.mark.parametrize("slew", [SLEW, None], ids=["slews", "jumps"])
def test_a_command_at_the_time_of_the_first_step_takes_its_place(slew):
    """So that it can be replayed; the camera is settled there from the beginning."""
    first = {"kind": "schedule", "steps": [{"start_s": 600.0, "track": "main"}], "slew": slew}
    scene = scene_of(first)
    assert scene.scenario.instrument.frame_time_s([0])[0] == 600.0
    stream = ws.Renderer(scene, device="cpu").stream(range(5), SENSORS, ["A"], n_ahead=1)
    stream.send({"sensor": "sat11", "track": "sphere02"})
    (row,) = stream.send({"sensor": "sat11", "track": "sphere01", "offset_px": [20, -5]})
    assert (row.frame, row.start_s, row.settled_s) == (0, 600.0, 600.0)
    same = first | {"steps": [row.step], "on": ["sat11"]}
    assert_same(list(stream), scene_of([same, first]), 5)


def test_many_commands_leave_no_trace():
    """Steps that are over are forgotten, which no frame shows."""
    commands = {
        number: {"sensor": "sat?[17]", "track": "main", "offset_px": [number % 3, 0]}
        for number in range(2, N_FRAME - 3)
    }
    scene = scene_of({"kind": "track"})
    frames, applied = run(ws.Renderer(scene, device="cpu"), commands)
    assert len(frames[-1].instrument.program.sensors[0].steps) == 9
    assert len(frames[-1].instrument.program.laws) <= 2 * 9 + 1
    steps = {row.start_s: row.step for row in applied if row.sensor == "sat11"}  # the last before a frame counts
    steps = steps.values()
    assert_same(frames, scene_of([schedule(*steps, on=SENSORS, slew=None), {"kind": "track"}]))


def test_a_camera_that_scans_can_be_called_away():
    rows = [{"time_s": 0.0, "ra_deg": 10.0, "dec_deg": 0.0}, {"time_s": 1400.0, "ra_deg": 60.0, "dec_deg": 20.0}]
    scene = scene_of({"kind": "table", "mode": "scan", "rows": rows, "slew": SLEW})
    frames, (row,) = run(ws.Renderer(scene, device="cpu"), {3: {"sensor": "sat11", "ra_dec_deg": [33.0, 9.0]}}, 50)
    plain = ws.Renderer(scene, device="cpu").render(range(50), SENSORS, ["A"]).axes_icrs
    got = np.concatenate([frame.axes_icrs for frame in frames])
    np.testing.assert_array_equal(got[:, 1], plain[:, 1])
    np.testing.assert_array_equal(got[: row.frame + 1, 0], plain[: row.frame + 1, 0])
    end = int(np.ceil((row.settled_s - 600.0) * 30))
    assert end < 50 and np.abs(got[end:, 0, 2] - towards(33.0, 9.0)).max() < STRAIGHT_RAD


def test_every_pass_of_a_loop_begins_with_the_scene_s_pointing():
    renderer = ws.Renderer(scene_of({"kind": "track"}), device="cpu")
    plain = renderer.render(range(6), ["sat11"], ["A"]).axes_icrs[:, 0]
    stream, same, commanded = renderer.stream(range(6), ["sat11"], ["A"], n_ahead=1, loop=True), [], []
    for number, frame in zip(range(30), stream, strict=False):
        assert frame.frames == [number % 6] and stream.latest.number == number
        same.append(np.array_equal(frame.axes_icrs[0, 0], plain[number % 6]))
        if number in (1, 14):
            (row,) = stream.send({"sensor": "sat11", "ra_dec_deg": [10.0, 20.0]})
            first = next(later for later in range(number + 1, number + 6) if later % 6 == row.frame)
            commanded += range(first, first - first % 6 + 6)
    stream.close()
    assert [number for number in range(30) if not same[number]] == commanded


def test_commands_from_another_thread_disturb_nobody():
    renderer = ws.Renderer(scene_of({"kind": "track"}), device="cpu")
    stream, errors = renderer.stream(range(60), SENSORS, ["A"], rate_hz=60.0, drop=False), []

    def command():
        try:
            for number in range(20):
                stream.send({"sensor": SENSORS[number % 2], "track": f"sphere0{number % 2 + 1}"})
        except Exception as error:
            errors.append(error)

    thread, plain = threading.Thread(target=command), renderer.render([5], SENSORS, ["A"]).counts.numpy().copy()
    seen = []
    for frame in stream:
        if not seen:
            thread.start()
        seen += frame.frames
        np.testing.assert_array_equal(renderer.render([5], SENSORS, ["A"]).counts.numpy(), plain)
    thread.join()
    assert seen == list(range(60)) and not [error for error in errors if "no frame left" not in str(error)]


@pytest.mark.parametrize(
    ("command", "text"),
    [
        ("left", "command: must be a table of fields, such as .* got 'left'"),
        ({"track": "main"}, "command.sensor: must name a sensor that is rendered, got None"),
        ({"sensor": "sat99", "track": "main"}, "command.sensors: must be sensors of the scene .* got 'sat99'"),
        ({"sensor": "sat12", "track": "main"}, "command.sensor: must name a sensor that is rendered, got 'sat12'"),
        ({"sensor": "sat11"}, "command: track, ra_dec_deg, azimuth_elevation_deg: exactly one must be given"),
        ({"sensor": "sat11", "track": "moon"}, "command.track: must be 'main', 'group' or a target's name, got 'moon'"),
        ({"sensor": "sat11", "ra_dec_deg": [0, 91]}, r"command.ra_dec_deg\[1\]: must be in \[-90, 90\], got 91"),
        ({"sensor": "sat11", "track": "main", "when": 1}, "command.when: "),
        ({"sensor": "sat11", "track": "main", "start_s": 1}, "command.start_s: must be left out"),
    ],
)
def test_bad_commands_are_one_line_and_change_nothing(command, text):
    renderer = ws.Renderer(scene_of({"kind": "track"}), device="cpu")
    stream = renderer.stream(range(4), SENSORS, ["A"])
    next(stream)
    with pytest.raises(ws.InputError, match=f"^{text}") as refused:
        stream.send(command)
    assert "\n" not in str(refused.value)
    assert [frame.frames[0] for frame in stream] == [1, 2, 3]


def test_commands_that_come_too_late_or_in_no_order():
    renderer = ws.Renderer(scene_of({"kind": "track"}), device="cpu")
    stream, command = renderer.stream(range(3), SENSORS, ["A"]), {"sensor": "sat11", "track": "sphere01"}
    list(stream)
    with pytest.raises(ws.InputError, match="stream: has no frame left to render"):
        stream.send(command)
    with pytest.raises(ws.InputError, match="stream: takes pointing commands only if its frames are in the order of"):
        renderer.stream([3, 2], SENSORS, ["A"]).send(command)
    slow = scene_of(schedule(slew=SLEW | {"max_rate_deg_s": 1e-3, "max_acceleration_deg_s2": 1e-3}))
    stream = ws.Renderer(slow, device="cpu").stream(range(9), SENSORS, ["A"], n_ahead=1)
    next(stream)
    with pytest.raises(ws.InputError, match="command: sat11: the tracked direction turns faster than max_rate_deg_s"):
        stream.send({"sensor": "sat11", "track": "sphere01"})
    assert len(list(stream)) == 8
