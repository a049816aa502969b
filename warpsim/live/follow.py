"""A page that follows what a server of frames sends (`warpsim serve`)."""

from __future__ import annotations

import threading
import zlib
from typing import Any

import numpy as np

from warpsim.errors import InputError, one_line
from warpsim.live.shown_images import RenderedImages, ShownImage, marks_of
from warpsim.live.view import View
from warpsim.serving.packet import HEADER, MAGIC
from warpsim.serving.sockets import zmq_library

_POLL_MS = 100


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
        zmq = zmq_library()
        self._page, self._stop = page, threading.Event()
        self._socket: Any = zmq.Context.instance().socket(zmq.SUB)
        try:
            self._socket.connect(address)
        except zmq.ZMQError as error:
            self._socket.close(0)
            raise InputError(f"cannot be reached: {one_line(error)}", "follow", address) from None
        self._socket.subscribe("frame/")
        self._thread = threading.Thread(target=self._receive, name="warpsim view follows", daemon=True)
        self._thread.start()

    def _receive(self) -> None:
        frame, images = -1, dict[tuple[str, str], np.ndarray[Any, np.dtype[np.uint16]]]()
        while not self._stop.is_set():
            if not self._socket.poll(_POLL_MS):
                continue
            packet = self._socket.recv_multipart()[1]
            header = np.frombuffer(packet, HEADER, 1)[0]
            counts = packet[HEADER.itemsize :]
            if header["magic"] != MAGIC or zlib.crc32(counts) != header["payload_crc32"]:
                continue
            if header["frame"] != frame:
                frame, images = int(header["frame"]), {}
            names = header["sensor_name"].decode(), header["band_name"].decode()
            images[names] = np.frombuffer(counts, "<u2").reshape(header["n_row"], header["n_col"])
            if len(images) == header["n_sensor"] * header["n_band"]:
                self._offer(frame, images)

    def _offer(self, frame: int, images: dict[tuple[str, str], Any]) -> None:
        """Offer a frame that is complete."""
        source, scenario = self._page.images, self._page.scenario
        bands = list(dict.fromkeys(band for _, band in images))

        def shown(band: str | None) -> list[ShownImage]:
            own = band if band in bands else bands[0]
            sensors = [sensor for sensor, of in images if of == own and sensor in scenario.sensor_names]
            marks = {}
            if isinstance(source, RenderedImages) and sensors:
                marks = marks_of(source.renderer.truth([frame], sensors, own))
            return [
                ShownImage(
                    sensor, own, images[sensor, own], scenario.instrument_of(sensor).levels[own],
                    marks.get((frame, sensor, own), []),
                )
                for sensor in sensors
            ]  # fmt: skip

        self._page.offer_images(frame, shown)

    def close(self) -> None:
        """Leave the server."""
        self._stop.set()
        self._thread.join()
        self._socket.close(0)

    def __enter__(self) -> Follower:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
