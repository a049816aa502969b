"""A page that follows what a server of frames sends (`warpsim serve`)."""

from __future__ import annotations

import threading
import time
import zlib
from typing import Any

import numpy as np

from warpsim.errors import InputError, one_line
from warpsim.live.shown_images import RenderedImages, ShownImage, main_targets, marks_of
from warpsim.live.view import View
from warpsim.serving.packet import HEADER, MAGIC
from warpsim.serving.sockets import zmq_library

_POLL_MS = 100
_SILENT_S = 3.0
_SILENT = "the server sends nothing"
_NAME_BYTES = HEADER["sensor_name"].itemsize


class Follower:
    """A thread that offers a page the frames that a server publishes over ZeroMQ; a context.

    Counts are those that were sent; boxes and names are those of the page's own scene, which is to be the server's.

    Args:
        page: The page.
        address: Of the server: tcp://HOST:PORT, ipc://PATH.

    Raises:
        InputError: pyzmq (the extra `serve`) is missing, or no such address.
    """

    def __init__(self, page: View, address: str) -> None:
        zmq = zmq_library("follow")
        self._page, self._stop = page, threading.Event()
        self._mains = main_targets(page.scenario)
        self._socket: Any = zmq.Context.instance().socket(zmq.SUB)
        try:
            self._socket.connect(address)
        except zmq.ZMQError as error:
            self._socket.close(0)
            rule = f"must be an address such as tcp://HOST:PORT ({one_line(error.strerror)})"
            raise InputError(rule, "follow", address) from None
        self._socket.subscribe("frame/")
        self._thread = threading.Thread(target=self._receive, name="warpsim view follows", daemon=True)
        self._thread.start()

    def _receive(self) -> None:
        frame, images = -1, dict[tuple[str, str], Any]()
        last_s = time.monotonic()
        while not self._stop.is_set():
            if not self._socket.poll(_POLL_MS):
                self._page.note("source", _SILENT if time.monotonic() - last_s > _SILENT_S else "")
                continue
            found = _image_of(self._socket.recv_multipart())
            if found is None:
                continue
            last_s, (header, name, counts) = time.monotonic(), found
            if header["frame"] != frame:
                frame, images = int(header["frame"]), {}
            images[name] = counts
            if len(images) == header["n_sensor"] * header["n_band"]:
                self._offer(frame, images)

    def _offer(self, frame: int, images: dict[tuple[str, str], Any]) -> None:
        """Offer a frame that is complete; names of packets are cut to the room that they have there."""
        source, scenario = self._page.images, self._page.scenario
        whole = {name[:_NAME_BYTES]: name for name in scenario.sensor_names}
        images = {(whole[sensor], band): counts for (sensor, band), counts in images.items() if sensor in whole}
        if not images:
            return
        bands = list(dict.fromkeys(band for _, band in images))

        def shown(band: str | None) -> list[ShownImage]:
            own = band if band in bands else bands[0]
            sensors = [sensor for sensor, of in images if of == own]
            marks = {}
            if isinstance(source, RenderedImages) and sensors:
                marks = marks_of(source.renderer.truth([frame], sensors, own), self._mains)
            return [
                ShownImage(
                    sensor, own, images[sensor, own], scenario.instrument_of(sensor).levels[own],
                    marks.get((frame, sensor, own), []),
                )
                for sensor in sensors
            ]  # fmt: skip

        self._page.offer_images(frame, shown)

    def __enter__(self) -> Follower:
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the server."""
        self._stop.set()
        self._thread.join()
        self._socket.close(0)


def _image_of(message: list[bytes]) -> tuple[Any, tuple[str, str], Any] | None:
    """Header, names of sensor and band, and counts of a packet; None for what is none, or damaged."""
    if len(message) != 2 or len(message[1]) < HEADER.itemsize:
        return None
    header, payload = np.frombuffer(message[1], HEADER, 1)[0], message[1][HEADER.itemsize :]
    whole = zlib.crc32(message[1][: HEADER.itemsize - 4]) == header["header_crc32"]
    if header["magic"] != MAGIC or not whole or zlib.crc32(payload) != header["payload_crc32"]:
        return None
    shape = int(header["n_row"]), int(header["n_col"])
    if 2 * shape[0] * shape[1] != len(payload):
        return None
    name = tuple(header[key].decode(errors="replace") for key in ("sensor_name", "band_name"))
    return header, (name[0], name[1]), np.frombuffer(payload, "<u2").reshape(shape)
