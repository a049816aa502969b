"""The server: takes the frames of a stream when they are due, and sends their packets."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Sequence
from typing import Any, Literal

from warpsim.arguments import whole_number
from warpsim.errors import InputError
from warpsim.render.renderer import Renderer
from warpsim.render.request import checked_rate, checked_request
from warpsim.render.stream import StreamStats
from warpsim.scene.pointing_commands import AppliedCommand
from warpsim.serving.packet import PacketMaker, send_off
from warpsim.serving.ring import RingWriter
from warpsim.serving.sockets import POLL_MS, CommandSocket, Publisher

NS = 10**9
RING_S, RING_BYTES, LEAST_RING_FRAMES = 1.0, 64 * 2**20, 8
"""A ring holds the frames of so long, if they take no more memory, but some; unless something else was asked for."""


class FrameServer:
    """Serves frames to other processes in real time, over ZeroMQ, a ring of shared memory, or both.

    Every image of a frame, of one sensor in one band, is a packet. `run` sends them; use it in a `with` statement, or
    `close` it, so that addresses and the ring are free again.

    Args:
        renderer: Renders the frames.
        frames: Frame numbers; all of the scene when left out.
        sensors: As in `Renderer.render`: of one kind.
        bands: As there.
        rate_hz: Frames per second; the pace of the scene, 1 / interval_s, when left out.
        address: Where to publish packets: "tcp://0.0.0.0:5555", "ipc:///tmp/frames". Needs the extra `serve`.
        ring: Name of a file in /dev/shm to write packets to, or a path.
        control: Where pointing commands are taken: another such address.
        late: "drop": a frame whose time is over gives way to the next one where there is one; "send": every frame is
            sent. What is sent late says so.
        loop: Begin anew after the last frame, without end.
        wait_for: Subscriptions to wait for before the first frame.
        n_ahead: Frames rendered ahead at most, as in `Renderer.stream`.
        ring_frames: Frames that the ring holds; those of a second, within 64 MiB, but at least 8, when left out.

    Raises:
        InputError: As in `Renderer.stream`; neither address nor ring is given; an address is in use, or the ring.
    """

    def __init__(
        self,
        renderer: Renderer,
        frames: Iterable[int] | None = None,
        sensors: str | Sequence[str] | None = None,
        bands: str | Sequence[str] | None = None,
        *,
        rate_hz: float | None = None,
        address: str | None = None,
        ring: str | None = None,
        control: str | None = None,
        late: Literal["drop", "send"] = "drop",
        loop: bool = False,
        wait_for: int = 0,
        n_ahead: int | None = None,
        ring_frames: int | None = None,
    ) -> None:
        if late not in ("drop", "send"):
            raise InputError("must be 'drop' or 'send'", "late", late)
        if address is None and ring is None:
            raise InputError("one of them must be given: where packets go", "address, ring")
        if whole_number("wait_for", wait_for, 0) and address is None:
            raise InputError("is for subscriptions, which need an address", "wait_for", wait_for)
        request = checked_request(renderer.scenario, frames, sensors, bands, (False, False))
        if not request.frames:
            raise InputError("must hold at least one", "frames")
        rate_hz = checked_rate(rate_hz) or 1.0 / request.instrument.frames.interval_s
        self._maker = PacketMaker(renderer.scenario, request)
        self._n_frame, self._wait_for, self._sequence = len(request.frames), wait_for, 0
        options: dict[str, Any] = {"n_ahead": n_ahead, "loop": loop, "prepare": self._maker.packets, "idle": self._idle}
        asked = request.frames, request.sensors, request.bands
        self._stream = renderer.stream(*asked, rate_hz, late == "drop", **options)
        if ring_frames is None:
            fitting = min(RING_S * rate_hz, RING_BYTES / (self._maker.packet_bytes * self._maker.n_image))
            ring_frames = max(LEAST_RING_FRAMES, int(fitting))
        whole_number("ring_frames", ring_frames, 2)
        about = {"rate_hz": rate_hz, "late": late, "loop": loop, "ring_frames": ring_frames}
        text = json.dumps(self._maker.description() | about).encode()
        self._ended = False
        self._publisher: Publisher | None = None
        self._ring: RingWriter | None = None
        self._control: CommandSocket | None = None
        try:
            if address is not None:
                self._publisher = Publisher(address, self._maker.topics, self._maker.packet_bytes, text)
            if ring is not None:
                self._ring = RingWriter(ring, ring_frames * self._maker.n_image, self._maker.packet_bytes, text)
            if control is not None:
                self._control = CommandSocket(control, self.send)
        except BaseException:
            self.close()
            raise

    @property
    def address(self) -> str | None:
        """Where packets are published, with the port that was chosen."""
        return None if self._publisher is None else self._publisher.address

    @property
    def ring(self) -> str | None:
        """Path of the ring."""
        return None if self._ring is None else str(self._ring.path)

    @property
    def control(self) -> str | None:
        """Where commands are taken."""
        return None if self._control is None else self._control.address

    @property
    def stats(self) -> StreamStats:
        """Statistics so far: frames sent, dropped and late, and how long after they were due sending began."""
        return self._stream.stats

    @property
    def n_packet(self) -> int:
        """Packets sent so far."""
        return self._sequence

    def send(self, command: Any) -> list[AppliedCommand]:
        """Point sensors, as `FrameStream.send` does; from any thread."""
        return self._stream.send(command)

    def run(self) -> StreamStats:
        """Send all frames, each when it is due, until `stop` is called; return the statistics."""
        while self._publisher is not None and self._publisher.n_subscription < self._wait_for and not self._ended:
            self._publisher.attend(POLL_MS)
        for _ in self._stream:
            if self._ended:
                break
            handed = self._stream.latest
            now_ns, packets = time.time_ns(), handed.prepared
            due_ns = now_ns - int(NS * (time.perf_counter() - handed.due_s))
            send_off(packets, self._sequence, handed.number // self._n_frame, due_ns, now_ns, handed.is_late)
            if self._ring is not None:
                for packet in packets:
                    self._ring.write(packet)
            if self._publisher is not None:
                self._publisher.send(packets)
            self._sequence += len(packets)
        return self.stats

    def _idle(self, wait_s: float) -> bool:
        """Attend to subscribers for so long at most; return whether the server goes on."""
        polled_ms = min(int(1000 * wait_s), POLL_MS)  # whole ones: the rest of a wait is slept, to be in time
        if self._publisher is not None:
            self._publisher.attend(polled_ms)
        elif polled_ms:
            time.sleep(polled_ms / 1000)
        if not polled_ms:
            time.sleep(wait_s)
        return not self._ended

    def stop(self) -> None:
        """Let `run` end before its next frame, within 50 ms but for a frame being rendered; from any thread."""
        self._ended = True

    def close(self) -> None:
        """End the stream, the sockets and the ring."""
        self._stream.close()
        for part in (self._control, self._publisher, self._ring):
            if part is not None:
                part.close()
        self._publisher = self._ring = self._control = None

    def __enter__(self) -> FrameServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def serve(renderer: Renderer, **options: Any) -> StreamStats:
    """Serve frames to other processes in real time until the scene ends, or Ctrl-C does it.

    Args:
        renderer: Renders the frames.
        options: Those of a `FrameServer`.

    Returns:
        Statistics: frames sent, dropped and late, and how long after they were due sending began.

    Raises:
        InputError: As in `FrameServer`.
    """
    with FrameServer(renderer, **options) as server:
        try:
            return server.run()
        except KeyboardInterrupt:
            return server.stats
