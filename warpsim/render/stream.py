"""Frames in real time: a thread renders ahead into a ring, the consumer takes each frame when it is due.

Frame k of a stream is due k / rate_hz after the first one was ready, and its time is over when the next one is due. A
frame whose time is over is dropped where another comes instead: before it is rendered, or when a later one is ready as
well. So frames keep coming, whoever is slow, renderer or consumer.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from warpsim.errors import InputError
from warpsim.render.frameset import FrameSet
from warpsim.render.pointing_arrays import CommandedPointing
from warpsim.scene.pointing_commands import AppliedCommand

GROUP_S = 0.005
"""Frames of a fast stream are rendered together, as many as are due within this time: calls cost some 0.2 ms each."""

GROUP_BYTES, GROUP_BYTES_CUDA = 8 * 2**20, 256 * 2**20
"""They fill this much memory at most, on the CPU and on CUDA; those of a stream without rate do."""

USUAL_AHEAD = 4
"""Frames rendered ahead, where they are rendered one by one."""

MOST_LATENCIES = 100_000
"""Latest frames that the percentiles are of."""

IDLE_S = 0.05
"""While no frame is ready, `idle` is called so often."""


def _sleep(wait_s: float) -> bool:
    """Wait for so long [s]."""
    time.sleep(wait_s)
    return True


@dataclass(frozen=True)
class StreamStats:
    """Statistics of a stream, so far."""

    n_frame: int
    """Frames handed over."""
    n_dropped: int
    """Frames whose time was over before they could be handed over."""
    n_late: int
    """Frames handed over although their time was over: the best there was."""
    latency_p50_s: float
    """Half of the latencies are below: from when a frame was due to when it was handed over; in a stream without rate,
    how long the consumer waited for it. Of the latest 100,000 frames; NaN before the first."""
    latency_p99_s: float
    """99 of 100 latencies are below."""
    latency_max_s: float
    """Largest latency."""
    duration_s: float
    """From the first frame handed over to the last."""

    @property
    def rate_hz(self) -> float:
        """Frames per second handed over; NaN before the second."""
        return (self.n_frame - 1) / self.duration_s if self.duration_s > 0 else math.nan


@dataclass(frozen=True)
class Pace:
    """Times at which frames of a stream are due."""

    rate_hz: float | None
    """None: at once."""
    start_s: float
    """Time of the clock at which the first frame is due; infinite until it is ready."""

    def due_s(self, index: int) -> float:
        """Time at which a frame is due."""
        return self.start_s + index / self.rate_hz if self.rate_hz else -math.inf

    def over(self, index: int, now_s: float) -> bool:
        """Return whether a frame's time is over."""
        return self.rate_hz is not None and now_s > self.due_s(index + 1)


class Handed(NamedTuple):
    """A frame of a stream as it was handed over."""

    number: int
    """Frames of the stream before it, those that were dropped included."""
    due_s: float
    """When it was due, by `time.perf_counter`; -inf in a stream without rate."""
    is_late: bool
    """Whether its time was over."""
    prepared: Any = None
    """What `prepare` has made of it."""


class Stream:
    """A running stream. One thread renders, another one takes.

    Args:
        render: Renders some frames; with the pointing's instrument as `instrument`, where there is a pointing.
        frames: Frame numbers.
        rate_hz: Frames per second; None: as fast as possible.
        drop: Whether frames whose time is over may be dropped.
        n_ahead: Frames that wait in the ring at most.
        n_together: Frames rendered in one call at most.
        clock: The time [s].
        loop: Whether the first frame follows the last one.
        pointing: Pointing of the sensors, which may be commanded.
        prepare: Function of a frame that is called ahead, by the thread that renders.
        idle: Waits for so long at most [s] while no frame is due, by the thread that takes; False ends the stream.
    """

    def __init__(
        self,
        render: Callable[..., FrameSet],
        frames: Sequence[int],
        rate_hz: float | None,
        drop: bool,
        n_ahead: int,
        n_together: int,
        clock: Callable[[], float] = time.perf_counter,
        loop: bool = False,
        pointing: CommandedPointing | None = None,
        prepare: Callable[[FrameSet], Any] | None = None,
        idle: Callable[[float], bool] | None = None,
    ) -> None:
        self._render, self._frames, self._pointing = render, frames, pointing
        self._prepare, self._idle = prepare or (lambda _: None), idle or _sleep
        self._n_frame_in_all = math.inf if loop and frames else len(frames)
        self._drop, self._n_ahead, self._n_together = drop, n_ahead, min(n_together, n_ahead)
        self._clock = clock
        self._pace = Pace(rate_hz, math.inf)
        self._ring: deque[tuple[int, FrameSet, Any]] = deque()  # index in the stream, frame, what was made of it
        self._choosing = threading.Lock()  # no command comes between the choice of frames and that of their pointing
        self._next = self._lap = 0  # index of the frame to be rendered next, and passes through the frames before it
        self.latest = Handed(-1, math.nan, False)
        """The frame handed over last."""
        self._commanded = 0  # index among the frames of the latest command: the next one comes no earlier
        self._changed = threading.Condition()  # guards all below, and the ring
        self._closed = self._finished = False
        self._error: BaseException | None = None
        self._n_frame = self._n_dropped = self._n_late = 0
        self._latency_s: deque[float] = deque(maxlen=MOST_LATENCIES)
        self._max_s = math.nan
        self._first_s = self._last_s = 0.0
        # As a daemon it cannot keep a program alive that ends in the middle of a stream.
        self._thread = threading.Thread(target=self._produce, name="warpsim-stream", daemon=True)

    @property
    def stats(self) -> StreamStats:
        """Statistics, so far."""
        with self._changed:
            latency_s = np.array(self._latency_s) if self._latency_s else np.array([math.nan])
            p50, p99 = np.percentile(latency_s, [50, 99])
            return StreamStats(
                self._n_frame,
                self._n_dropped,
                self._n_late,
                float(p50),
                float(p99),
                self._max_s,
                self._last_s - self._first_s,
            )

    def send(self, command: Any) -> list[AppliedCommand]:
        """Point sensors from the next frame on that is not rendered yet; InputError where that cannot be."""
        if self._pointing is None or not is_ascending(self._frames):
            raise InputError("takes pointing commands only if its frames are in the order of time", "stream")
        checked, pointing, ahead = self._pointing.checked(command), self._pointing, 0
        while True:  # slews take milliseconds to work out, and frames are rendered meanwhile
            with self._choosing:
                if self._closed or self._next >= self._n_frame_in_all:
                    raise InputError("has no frame left to render", "stream")
                self._enter_lap(self._next)
                first, before = self._next % len(self._frames), pointing.instrument
                frame = min(max(first + ahead, self._commanded), len(self._frames) - 1)
                index = self._next - first + frame
            after, applied = pointing.planned(checked, before, self._frames[frame])
            with self._choosing:
                if self._next <= index and pointing.instrument is before:
                    pointing.instrument, self._commanded = after, frame
                    return applied
                ahead = max(2 * ahead, self._next - index)

    def _enter_lap(self, index: int) -> None:
        """Let every pass through the frames begin with the scene's pointing."""
        if self._pointing is not None and index // len(self._frames) != self._lap:
            self._pointing.restart()
            self._commanded = 0
        self._lap = index // len(self._frames)

    def frames(self) -> Generator[FrameSet, None, None]:
        """The frames, each when it is due; closing the iterator, or an exception, ends the thread."""
        self._thread.start()
        try:
            while (frame := self._take()) is not None:
                yield frame
        finally:
            with self._changed:
                self._closed = True
                self._changed.notify_all()
            if threading.current_thread() is not self._thread:  # where the garbage collector may run this
                self._thread.join()
            self._ring.clear()

    def _take(self) -> FrameSet | None:
        """The next frame, when it is due; None at the end."""
        asked_s = self._clock()
        while not self._is_ready():
            if not self._idle(0.0):
                return None
        with self._changed:
            if not self._ring:
                if self._error is not None:
                    raise self._error
                return None
            if math.isinf(self._pace.start_s):
                self._pace = Pace(self._pace.rate_hz, self._clock())
            while self._drop and len(self._ring) > 1 and self._pace.over(self._ring[0][0], self._clock()):
                self._ring.popleft()
                self._n_dropped += 1
            index, frame, prepared = self._ring.popleft()
            self._changed.notify_all()
        due_s = self._pace.due_s(index)
        while (wait_s := due_s - self._clock()) > 0:
            if not self._idle(wait_s):
                return None
        self._note(index, self._clock(), asked_s if self._pace.rate_hz is None else due_s, prepared)
        return frame

    def _is_ready(self) -> bool:
        """Return whether a frame is ready, or none will be, before long."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._ring) or self._finished, IDLE_S)

    def _note(self, index: int, now_s: float, since_s: float, prepared: Any) -> None:
        """Count a frame that is handed over now."""
        with self._changed:
            self._first_s, self._last_s = (self._first_s if self._n_frame else now_s), now_s
            is_late = self._pace.over(index, now_s)
            self.latest = Handed(index, self._pace.due_s(index), is_late, prepared)
            self._n_frame += 1
            self._n_late += is_late
            self._latency_s.append(now_s - since_s)
            self._max_s = now_s - since_s if math.isnan(self._max_s) else max(self._max_s, now_s - since_s)

    def _produce(self) -> None:
        """Render ahead until all is done or the consumer has gone."""
        index, n_frame = 0, len(self._frames)
        try:
            while index < self._n_frame_in_all:
                with self._changed:
                    self._changed.wait_for(lambda: self._closed or self._room() > 0)
                    if self._closed:
                        return
                with self._choosing:
                    with self._changed:
                        index = self._next_index(index)
                        first = index % n_frame
                        some = self._frames[first : first + self._room()]
                    self._enter_lap(index)
                    self._next = index + len(some)
                    pointing = self._pointing
                    render = self._render if pointing is None else partial(self._render, instrument=pointing.instrument)
                frames = render(some)
                ready = [frames.one_frame(number) for number in range(len(some))]
                made = [(index + number, frame, self._prepare(frame)) for number, frame in enumerate(ready)]
                with self._changed:
                    self._ring += made
                    self._changed.notify_all()
                del frames, ready, made  # its memory is to return once the consumer has let go
                index += len(some)
        except BaseException as error:
            self._error = error  # for the consumer to see
        finally:
            with self._changed:
                self._finished = True
                self._changed.notify_all()

    def _room(self) -> int:
        """Frames to render now; none until a whole group has room."""
        return self._n_together if self._n_ahead - len(self._ring) >= self._n_together else 0

    def _next_index(self, index: int) -> int:
        """The first frame from an index on whose time is not over; the last one at the latest."""
        now_s, first = self._clock(), index
        while self._drop and index < self._n_frame_in_all - 1 and self._pace.over(index, now_s):
            index += 1
        self._n_dropped += index - first
        return index


def is_ascending(frames: Sequence[int]) -> bool:
    """Return whether frame numbers are in the order of time."""
    if isinstance(frames, range):
        return frames.step > 0
    return all(before < after for before, after in pairwise(frames))


def stream_sizes(
    rate_hz: float | None,
    n_view: int,
    frame_bytes: int,
    n_pipeline: int,
    n_ahead: int | None,
    group_bytes: int = GROUP_BYTES,
) -> tuple[int, int]:
    """Frames rendered ahead, and in one call.

    Args:
        rate_hz: Frames per second; None: as fast as possible.
        n_view: Views of a frame.
        frame_bytes: Of the images of a frame.
        n_pipeline: Threads and devices that render at a time; each is to have a view.
        n_ahead: Frames rendered ahead at most, if that was asked for.
        group_bytes: Memory of the frames of one call at most.
    """
    fitting = max(1, group_bytes // frame_bytes)
    together = fitting if rate_hz is None else min(math.ceil(rate_hz * GROUP_S), fitting)
    together = max(1, together, -(-n_pipeline // n_view))
    if n_ahead is None:
        return max(USUAL_AHEAD, 2 * together), together
    return n_ahead, max(1, min(together, n_ahead // 2))
