"""ZeroMQ sockets of a server: packets for any number of subscribers, and commands from whoever points sensors."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError, one_line

SCENE_TOPIC = b"scene"
SCENE_EVERY_S = 1.0
"""The description of the scene is sent so often, and to whoever subscribes."""

QUEUE_BYTES = 64 * 2**20
"""Packets that wait for one slow subscriber take no more memory; the next ones are lost to it."""
LEAST_QUEUED_FRAMES = 4
LINGER_MS = 1000
"""Packets that are under way at the end have so long to go."""
END_S = 5.0
"""The library has so long to end when nothing is under way any more."""
POLL_MS = 50
REPLIED = ("sensor", "frame", "start_s", "settled_s")
"""Fields of a command that was carried out, in the reply."""


def zmq_library(where: str = "address") -> Any:
    """The library of the sockets, an extra."""
    try:
        import zmq
    except ModuleNotFoundError:
        raise InputError("sockets need the extra serve: pip install 'warpsim[serve]'", where) from None
    return zmq


def _bound(kind: str, address: str, field: str, **options: int) -> tuple[Any, str]:
    """A socket of a context of its own, and the address that it has been given."""
    zmq = zmq_library()
    socket = zmq.Context().socket(getattr(zmq, kind))
    for name, value in options.items():
        socket.setsockopt(getattr(zmq, name), value)
    try:
        socket.bind(address)
        return socket, socket.getsockopt_string(zmq.LAST_ENDPOINT)
    except (zmq.ZMQError, TypeError) as error:
        _close(socket, 0)
        raise InputError(f"cannot be bound: {one_line(error)}", field, address) from None


def _close(socket: Any, linger_ms: int) -> None:
    """Close a socket and its context, on a thread of its own that is left behind where the library does not end.

    `zmq_ctx_term` waits forever where it loses count of a subscriber that is killed or stopped while packets are under
    way to it (libzmq issue 2586).
    """
    socket.close(linger_ms)
    ending = threading.Thread(target=socket.context.term, name="warpsim-sockets-end", daemon=True)
    ending.start()
    ending.join(linger_ms / 1000 + END_S)


class Publisher:
    """Sends packets, each under its topic, to all that have subscribed to it; a slow one holds up nobody.

    Args:
        address: Such as "tcp://*:5555" or "ipc:///tmp/frames"; "tcp://127.0.0.1:*" takes a free port.
        topics: Topics of the packets of a frame.
        packet_bytes: Size of a packet.
        text: Description of the scene.

    Raises:
        InputError: The address cannot be bound, or the library is missing.
    """

    def __init__(self, address: str, topics: Sequence[bytes], packet_bytes: int, text: bytes) -> None:
        self._topics, self._text, self._text_due_s = topics, text, 0.0
        queued = max(QUEUE_BYTES // packet_bytes, LEAST_QUEUED_FRAMES * len(topics))
        self._socket, self.address = _bound("XPUB", address, "address", XPUB_VERBOSE=1, SNDHWM=queued)
        self.n_subscription = 0
        """Subscriptions that have come so far."""

    def attend(self, timeout_ms: int = 0) -> None:
        """Take note of new subscriptions, and send the description of the scene if it is due."""
        while self._socket.poll(timeout_ms):
            message, timeout_ms = self._socket.recv(), 0
            if message[:1] == b"\1":
                self.n_subscription += 1
                self._text_due_s = 0.0
        if time.perf_counter() >= self._text_due_s:
            self._socket.send_multipart([SCENE_TOPIC, self._text])
            self._text_due_s = time.perf_counter() + SCENE_EVERY_S

    def send(self, packets: npt.NDArray[np.uint8]) -> None:
        """Send the packets of a frame; large ones without a copy, so that they must stay as they are."""
        for topic, packet in zip(self._topics, packets, strict=True):
            self._socket.send_multipart([topic, packet.data], copy=False)
        self.attend()

    def close(self) -> None:
        """Send what is under way, for a second at most, and end."""
        _close(self._socket, LINGER_MS)


class CommandSocket:
    """Answers requests, one JSON text each, on a thread of its own.

    `{"sensor": ...}` points sensors; the reply is `{"applied": [...]}`, or `{"error": "one line"}`.

    Args:
        address: As of a Publisher.
        send: Carries out a command; what it returns are rows of the reply.

    Raises:
        InputError: The address cannot be bound, or the library is missing.
    """

    def __init__(self, address: str, send: Callable[[Any], Sequence[Any]]) -> None:
        self._socket, self.address = _bound("REP", address, "control")
        self._send, self._ended = send, False
        self._thread = threading.Thread(target=self._answer, name="warpsim-commands", daemon=True)
        self._thread.start()

    def _answer(self) -> None:
        while not self._ended:
            if self._socket.poll(POLL_MS):
                request = b"".join(self._socket.recv_multipart())
                self._socket.send(json.dumps(self._reply(request)).encode())
        _close(self._socket, LINGER_MS)

    def _reply(self, request: bytes) -> dict[str, Any]:
        try:
            command = json.loads(request)
        except (ValueError, RecursionError) as error:
            return {"error": f"command: must be JSON: {one_line(error)}"}
        try:
            return {"applied": [{name: getattr(row, name) for name in REPLIED} for row in self._send(command)]}
        except InputError as error:
            return {"error": str(error)}
        except Exception as error:  # the thread goes on, whatever happens
            return {"error": f"command: failed: {type(error).__name__}: {one_line(error)}"}

    def close(self) -> None:
        """End the thread."""
        self._ended = True
        self._thread.join()
