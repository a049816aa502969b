"""A stream as its consumer has it: an iterator, whose sensors can be pointed meanwhile."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from warpsim.render.frameset import FrameSet
from warpsim.render.stream import Handed, Stream, StreamStats
from warpsim.scene.pointing_commands import AppliedCommand


class FrameStream(Iterator[FrameSet]):
    """Frames in real time: an iterator of FrameSets of one frame each, whose sensors can be pointed meanwhile."""

    def __init__(self, stream: Stream) -> None:
        self._stream, self._frames = stream, stream.frames()

    def __next__(self) -> FrameSet:
        return next(self._frames)

    def send(self, command: Any) -> list[AppliedCommand]:
        """Point sensors: the next frame that is not rendered yet is the first that follows; from any thread.

        Working out a slew takes some 4 ms a sensor, while frames are rendered. The camera begins to turn at the time of
        that frame, from where it points then, with the `slew` of its `pointing`; without one it points there at once.
        While it still slews, the command waits until it has settled; a later command takes its place: the last one of
        those with the same `start_s` counts. The steps that `pointing` has for later times are given up. Frames are
        those of a scene whose `pointing` is this schedule. Those rendered ahead come as they are: `n_ahead` says how
        many.

        Args:
            command: A dict of `sensor`, the name of a sensor, a kind or a pattern of names, and the fields of a
                PointingStep but `start_s`: `track`, `ra_dec_deg` or `azimuth_elevation_deg`, `offset_px`, `roll_deg`.

        Returns:
            What was done, a row for each sensor: sensor, frame, start_s and settled_s (after the epoch) [s], and the
            step of a schedule that repeats it.

        Raises:
            InputError: A field is unknown, or its value not valid; the sensor is not rendered, the target not there;
                the slew is not possible within its limits or before the scene's end; no frame is left to render, or
                frames are not in the order of time.
        """
        return self._stream.send(command)

    @property
    def stats(self) -> StreamStats:
        """Statistics, so far."""
        return self._stream.stats

    @property
    def latest(self) -> Handed:
        """The frame handed over last: its number in the stream, when it was due, whether it was late."""
        return self._stream.latest

    def close(self) -> None:
        """End the stream; so do the end of a loop over it, and an exception there."""
        self._frames.close()
