"""Streams: frames in order, each when it is due, the same bits as render; and they end however the consumer ends."""

import contextlib
import gc
import itertools
import math
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from conftest import slow

import warpsim as ws
from warpsim.render.stream import Pace, Stream, stream_sizes

EARLY_S = 0.002
"""Clocks and sleeping are good to far less than this."""


class Fake:
    """Stands for a FrameSet: the numbers rendered."""

    def __init__(self, frames):
        self.frames = frames

    def one_frame(self, index):
        return Fake(self.frames[index : index + 1])


def fake_stream(n, rate_hz=None, drop=True, n_ahead=4, n_together=1, cost_s=0.0, calls=None):
    """A stream whose frames take some time each to render."""

    def render(frames):
        time.sleep(cost_s * len(frames))
        if calls is not None:
            calls.append(list(frames))
        return Fake(frames)

    return Stream(render, range(n), rate_hz, drop, n_ahead, n_together)


def numbers(stream, work_s=0.0):
    """The frames in the order that they come; the consumer works on each for some time."""
    got = []
    for frame in stream.frames():
        got.append(frame.frames[0])
        time.sleep(work_s)
    return got


def stream_threads():
    return [thread for thread in threading.enumerate() if thread.name == "warpsim-stream"]


def test_frames_come_in_order_and_not_before_they_are_due():
    stream = fake_stream(20, rate_hz=100.0, drop=False)
    times = [(frame.frames[0], stream.latest.due_s, time.perf_counter()) for frame in stream.frames()]
    assert [number for number, _, _ in times] == list(range(20))
    for number, due_s, at_s in times:
        assert due_s == pytest.approx(times[0][1] + number / 100.0, abs=1e-9) and at_s >= due_s
    stats = stream.stats
    assert (stats.n_frame, stats.n_dropped) == (20, 0)
    assert 0 <= stats.latency_p50_s <= stats.latency_p99_s <= stats.latency_max_s
    assert stats.duration_s >= 19 / 100.0 - stats.latency_max_s - EARLY_S  # the first one may be late
    assert stats.rate_hz == pytest.approx(19 / stats.duration_s)


@pytest.mark.parametrize(("cost_s", "work_s"), [(0.02, 0.0), (0.0, 0.02)], ids=["slow-renderer", "slow-consumer"])
def test_frames_are_dropped_where_somebody_is_slow(cost_s, work_s):
    """Four times too slow: some come, in order, the others are counted."""
    stream = fake_stream(60, rate_hz=200.0, cost_s=cost_s)
    got = numbers(stream, work_s)
    assert got == sorted(set(got))
    stats = stream.stats
    assert stats.n_frame == len(got)
    assert stats.n_frame + stats.n_dropped == 60
    assert stats.n_dropped > 20
    assert stats.n_frame >= 2 and got[-1] == 59  # they keep coming, few if the machine does other work
    assert 0 <= stats.n_late <= stats.n_frame


@pytest.mark.parametrize(("cost_s", "work_s"), [(0.01, 0.0), (0.0, 0.01)], ids=["slow-renderer", "slow-consumer"])
def test_no_frame_is_dropped_where_none_may_be(cost_s, work_s):
    stream = fake_stream(30, rate_hz=500.0, drop=False, cost_s=cost_s)
    assert numbers(stream, work_s) == list(range(30))
    stats = stream.stats
    assert (stats.n_frame, stats.n_dropped) == (30, 0)
    assert stats.n_late > 10  # five times too slow
    assert stats.latency_max_s > 0.1


def test_without_rate_nothing_is_dropped_or_late():
    calls = []
    stream = fake_stream(25, n_ahead=8, n_together=4, calls=calls)
    assert numbers(stream, 0.001) == list(range(25))
    assert (stream.stats.n_frame, stream.stats.n_dropped, stream.stats.n_late) == (25, 0, 0)
    assert stream.stats.latency_p50_s >= 0
    assert list(itertools.chain(*calls)) == list(range(25))
    assert max(map(len, calls)) == 4


def test_the_ring_is_bounded():
    calls = []
    stream = fake_stream(50, n_ahead=6, n_together=2, calls=calls)
    frames = stream.frames()
    next(frames)
    time.sleep(0.05)
    assert sum(map(len, calls)) <= 8  # one is handed over, and six wait, at most
    frames.close()


def test_what_is_prepared_ahead_comes_with_its_frame():
    threads = []

    def prepare(frame):
        threads.append(threading.current_thread().name)
        return -frame.frames[0]

    stream = Stream(Fake, range(9), None, True, 4, 3, prepare=prepare)
    got = [(frame.frames[0], stream.latest.number, stream.latest.prepared) for frame in stream.frames()]
    assert got == [(number, number, -number) for number in range(9)]
    assert threads == ["warpsim-stream"] * 9


@pytest.mark.parametrize("cost_s", [0.0, 0.01], ids=["in-time", "dropping"])
def test_a_loop_has_no_end(cost_s):
    """Frames begin anew, whether or not the last ones of a pass are dropped; no call reaches beyond a pass."""
    calls = []

    def render(frames):
        time.sleep(cost_s)
        calls.append(list(frames))
        return Fake(frames)

    stream = Stream(render, range(7), 500.0, cost_s > 0, 4, 2, loop=True)
    frames = stream.frames()
    for frame, _ in zip(frames, range(25), strict=False):
        assert frame.frames[0] == stream.latest.number % 7
    frames.close()
    assert stream.latest.number >= 24 and (stream.stats.n_dropped > 0) == (cost_s > 0)
    assert all(call == list(range(call[0], call[-1] + 1)) for call in calls)


def test_stats_before_the_first_frame():
    stats = fake_stream(3).stats
    assert (stats.n_frame, stats.n_dropped, stats.n_late, stats.duration_s) == (0, 0, 0, 0.0)
    assert math.isnan(stats.latency_p50_s) and math.isnan(stats.latency_max_s) and math.isnan(stats.rate_hz)


def test_pace():
    pace = Pace(10.0, 100.0)
    assert pace.due_s(5) == pytest.approx(100.5)
    assert not pace.over(5, 100.6)
    assert pace.over(5, 100.601)
    assert not Pace(10.0, math.inf).over(0, 1e9)  # the clock has not started
    assert not Pace(None, 0.0).over(0, 1e9)


@pytest.mark.parametrize(
    ("rate_hz", "n_view", "frame_bytes", "n_pipeline", "n_ahead", "expected"),
    [
        (30.0, 20, 655_360, 2, None, (4, 1)),
        (30.0, 1, 32_768, 2, None, (4, 2)),  # two threads, one view a frame
        (10_000.0, 1, 32_768, 2, None, (100, 50)),
        (None, 1, 2**21, 2, None, (8, 4)),
        (None, 20, 2**25, 2, None, (4, 1)),
        (30.0, 20, 655_360, 2, 1, (1, 1)),
        (None, 1, 32_768, 2, 6, (6, 3)),
    ],
)
def test_sizes_follow_rate_and_memory(rate_hz, n_view, frame_bytes, n_pipeline, n_ahead, expected):
    assert stream_sizes(rate_hz, n_view, frame_bytes, n_pipeline, n_ahead) == expected


def test_an_error_of_the_renderer_comes_after_the_frames_before_it():
    def render(frames):
        if 3 in frames:
            raise ZeroDivisionError("three")
        return Fake(frames)

    frames = Stream(render, range(9), None, True, 4, 1).frames()
    assert [next(frames).frames[0] for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ZeroDivisionError, match="three"):
        next(frames)
    assert not stream_threads()


@pytest.mark.ci
def test_leaving_early_ends_the_thread():
    for _ in range(3):
        for frame in fake_stream(1000, rate_hz=1000.0).frames():
            if frame.frames[0] >= 3:
                break
        gc.collect()
        assert not stream_threads()

    def fail():
        for _ in fake_stream(1000).frames():
            raise KeyError("consumer")

    with pytest.raises(KeyError, match="consumer"):
        fail()
    gc.collect()
    assert not stream_threads()
    never_started = fake_stream(10).frames()
    del never_started
    assert not stream_threads()


@pytest.fixture(scope="module")
def moving():
    """300 frames, a 30th of a second apart."""
    return ws.Scene.load("stss").replace(frames={"count": 300, "interval_s": 1 / 30, "start_s": 600.0})


@pytest.fixture(scope="module")
def renderer(moving):
    return ws.Renderer(moving, device="cpu")


@pytest.mark.ci
@pytest.mark.parametrize("n_frame", [75, slow(300)])
def test_twenty_sensors_at_30_hz(moving, renderer, n_frame):
    """The paper's case. How late frames are depends on what else the machine does, so that is told, not asserted."""
    sensors, seen = moving.sensor_names[:20], []
    sample = range(0, n_frame, 37)
    expected = renderer.render(sample, sensors, ["A"])
    for frames in renderer.stream(range(n_frame), sensors, ["A"], rate_hz=30.0, drop=False):
        assert frames.counts.shape == (1, 20, 1, 128, 128)
        seen += frames.frames
        if frames.frames[0] in sample:
            index = sample.index(frames.frames[0])
            np.testing.assert_array_equal(frames.counts.numpy()[0], expected.counts.numpy()[index])
            np.testing.assert_array_equal(frames.axes_icrs[0], expected.axes_icrs[index])
    assert seen == list(range(n_frame))
    stats = renderer.stats
    assert (stats.n_frame, stats.n_dropped) == (n_frame, 0)
    assert stats.duration_s > (n_frame - 1) / 30 - stats.latency_max_s - EARLY_S
    assert 0 <= stats.latency_p50_s <= stats.latency_p99_s <= stats.latency_max_s
    print(stats)


def test_a_stream_as_fast_as_possible_equals_render(renderer):
    whole = renderer.render(range(40, 60), ["sat11", "sat27"], keep_signal=True, keep_stars=True)
    counts, signal_w_cm2, stars = whole.counts.numpy(), whole.signal_w_cm2.numpy(), whole.stars
    chosen = {"sensors": ["sat11", "sat27"], "keep_signal": True, "keep_stars": True}
    for k, frames in enumerate(renderer.stream(range(40, 60), **chosen)):
        assert frames.frames == [40 + k]
        assert frames.bands == whole.bands
        np.testing.assert_array_equal(frames.counts.numpy()[0], counts[k])
        np.testing.assert_array_equal(frames.signal_w_cm2.numpy()[0], signal_w_cm2[k])
        if k % 7 == 0:
            rows = whole.truth["frame"] == 40 + k
            np.testing.assert_array_equal(frames.truth["x_px"], whole.truth["x_px"][rows])
            np.testing.assert_array_equal(frames.truth["snr_peak"], whole.truth["snr_peak"][rows])
            np.testing.assert_array_equal(frames.stars["x_px"], stars["x_px"][stars["frame"] == 40 + k])
    assert renderer.stats.n_frame == 20


def test_held_frames_of_a_stream_stay(renderer):
    expected = renderer.render(range(30), ["sat11"], ["A"]).counts.numpy().copy()
    held = [frames.counts for frames in renderer.stream(range(30), ["sat11"], ["A"], n_ahead=2)]
    np.testing.assert_array_equal(np.concatenate(held), expected)


def test_render_works_beside_a_stream(renderer):
    expected = renderer.render([5], ["sat11"], ["A"]).counts.numpy().copy()
    for frames in renderer.stream(range(20), ["sat11"], ["A"]):
        np.testing.assert_array_equal(renderer.render([5], ["sat11"], ["A"]).counts.numpy(), expected)
        assert len(frames.frames) == 1


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"rate_hz": 0}, "rate_hz: must be a number of at least 1e-06, got 0"),
        ({"rate_hz": math.nan}, "rate_hz: must be a number of at least 1e-06, got nan"),
        ({"rate_hz": "30"}, "rate_hz: must be a number of at least 1e-06, got '30'"),
        ({"n_ahead": 0}, "n_ahead: must be a whole number >= 1, got 0"),
        ({"sensors": ["sat99"]}, "sensors: must be sensors of the scene .* got 'sat99'"),
        ({"frames": [-1]}, "frames: must be whole numbers .* got -1"),
    ],
)
def test_bad_requests_are_told_at_the_call(renderer, arguments, text):
    with pytest.raises(ws.InputError, match=text):
        renderer.stream(**arguments)


def test_a_new_renderer_has_no_stats(moving):
    assert ws.Renderer(moving, device="cpu").stats is None


PROGRAM = """
import signal, sys, time
import warpsim as ws
signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever the test was started with
renderer = ws.Renderer(ws.Scene.load("stss").replace(sky__catalog="none"), device="cpu")
frames = renderer.stream(range(160), ["sat11"], ["A"], rate_hz=10.0)
next(frames)
print("started", flush=True)
if sys.argv[1] == "interrupt":
    for _ in frames:
        pass
if sys.argv[1] == "work":
    next(frames)
    time.sleep(60)
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", ["interrupt", "work", "end"])
def test_a_program_ends_in_the_middle_of_a_stream(how, tmp_path, checkout_environment):
    """By Ctrl-C while it waits for a frame or works on one, or because it is through."""
    script = tmp_path / "program.py"
    script.write_text(PROGRAM)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    child = subprocess.Popen([sys.executable, str(script), how], env=checkout_environment, **pipes)
    try:
        while (line := child.stdout.readline()) and "started" not in line:
            pass
        errors, patience_s = "", 10.0
        while child.poll() is None and patience_s < 60.0:
            if how != "end":
                time.sleep(0.35)  # not when a frame is handed over
                child.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):  # Python swallows what meets the end of an array
                errors = child.communicate(timeout=patience_s)[1]
            patience_s *= 2
    finally:
        child.kill()
    assert child.returncode == (0 if how == "end" else -signal.SIGINT), errors
    assert ("KeyboardInterrupt" in errors) == (how != "end")
