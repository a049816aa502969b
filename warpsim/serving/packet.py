"""Packets: the images of frames behind a header of fixed layout, one packet for each sensor and band of a frame.

The layout is that of `struct warpsim_packet` in `examples/serve/warpsim_packet.h`, little endian; `docs/howto/serve.md`
has it as a table. All packets of a server have the same size.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.instant import utc_dates, years_ahead
from warpsim.optics.wcs import lens_keywords
from warpsim.render.frameset import FrameSet
from warpsim.render.request import Request
from warpsim.scene.scenario import Scenario
from warpsim.version import __version__

MAGIC, VERSION = b"WARPSIM", 1
LATE, SLEWING = 1, 2
"""Bits of a header's flags."""

HEADER = np.dtype(
    [
        ("magic", "S8"),
        ("version", "<u4"),
        ("header_bytes", "<u4"),
        ("sequence", "<u8"),
        ("frame", "<u8"),
        ("time_s", "<f8"),
        ("due_unix_ns", "<i8"),
        ("sent_unix_ns", "<i8"),
        ("loop", "<u4"),
        ("flags", "<u4"),
        ("sensor", "<u4"),
        ("band", "<u4"),
        ("n_sensor", "<u4"),
        ("n_band", "<u4"),
        ("n_row", "<u4"),
        ("n_col", "<u4"),
        ("dtype", "S8"),
        ("payload_bytes", "<u8"),
        ("payload_crc32", "<u4"),
        ("reserved", "<u4"),
        ("position_m", "<f8", 3),
        ("velocity_m_s", "<f8", 3),
        ("quaternion", "<f8", 4),
        ("utc", "S32"),
        ("sensor_name", "S64"),
        ("band_name", "S24"),
        ("more_reserved", "<u4"),
        ("header_crc32", "<u4"),
    ]
)
"""Header of a packet; `header_crc32` is of all bytes before it."""

assert HEADER.itemsize == 320 and not HEADER.isalignedstruct

DATES_AT_ONCE = 256
"""Dates are worked out for so many frames together: one takes half a millisecond, all of them two."""


class PacketMaker:
    """Packets of the frames of a server.

    Args:
        scenario: What the frames are of.
        request: Kind and names of the sensors, bands, and frame numbers in the order in which they come.
    """

    def __init__(self, scenario: Scenario, request: Request) -> None:
        self._scenario, self._instrument, self._frames = scenario, request.instrument, request.frames
        self.sensors, self.bands = request.sensors, request.bands
        camera = request.instrument.sensor.camera
        self.n_image = len(self.sensors) * len(self.bands)
        self.packet_bytes = HEADER.itemsize + 2 * camera.n_row * camera.n_col
        self.topics = [f"frame/{sensor}/{band}".encode() for sensor in self.sensors for band in self.bands]
        """Topic of each image of a frame: sensor by sensor, band by band."""
        self._utc: dict[int, str] = {}
        self._blank = self._without_frame()

    def _without_frame(self) -> npt.NDArray[Any]:
        """Headers of the images of any frame, (n_image,)."""
        camera, n_band = self._instrument.sensor.camera, len(self.bands)
        headers = np.zeros(self.n_image, dtype=HEADER)
        fields = {"magic": MAGIC, "version": VERSION, "header_bytes": HEADER.itemsize, "dtype": b"<u2"}
        fields |= {"payload_bytes": self.packet_bytes - HEADER.itemsize, "n_row": camera.n_row, "n_col": camera.n_col}
        fields |= {"n_sensor": len(self.sensors), "n_band": n_band}
        for name, value in fields.items():
            headers[name] = value
        headers["sensor"] = np.repeat(np.arange(len(self.sensors)), n_band)
        headers["band"] = np.tile(np.arange(n_band), len(self.sensors))
        headers["sensor_name"] = np.repeat([_fitting(name, 64) for name in self.sensors], n_band)
        headers["band_name"] = np.tile([_fitting(name, 24) for name in self.bands], len(self.sensors))
        return headers

    def packets(self, frame: FrameSet) -> npt.NDArray[np.uint8]:
        """Return the packets of a frame, shape (n_image, packet_bytes); `send_off` completes them."""
        from scipy.spatial.transform import Rotation

        packets = np.empty((self.n_image, self.packet_bytes), dtype=np.uint8)
        counts = np.ascontiguousarray(frame.counts.numpy()[0]).reshape(self.n_image, -1)
        packets[:, HEADER.itemsize :] = counts.astype("<u2", copy=False).view(np.uint8)
        headers, n_band = headers_of(packets), len(self.bands)
        headers[:] = self._blank
        time_s = frame.time_s
        states = [self._instrument.state(name, time_s) for name in self.sensors]
        headers["frame"], headers["time_s"], headers["utc"] = frame.frames[0], time_s[0], self._date(frame.frames[0])
        headers["position_m"] = np.repeat([position[0] for position, _ in states], n_band, axis=0)
        headers["velocity_m_s"] = np.repeat([velocity[0] for _, velocity in states], n_band, axis=0)
        rotation = Rotation.from_matrix(frame.axes_icrs[0]).as_quat(canonical=True)
        headers["quaternion"] = np.repeat(rotation, n_band, axis=0)
        headers["flags"] = np.where(np.repeat(frame.slewing[0], n_band), SLEWING, 0)
        headers["payload_crc32"] = [zlib.crc32(packet[HEADER.itemsize :].data) for packet in packets]
        return packets

    def _date(self, number: int) -> str:
        """UTC of a frame."""
        if number not in self._utc:
            first = self._frames.index(number)
            some = list(self._frames[first : first + DATES_AT_ONCE])
            with years_ahead():
                dates = utc_dates(self._scenario.scene.epoch_utc, self._instrument.frame_time_s(some))
            self._utc = dict(zip(some, map(str, dates), strict=True))
        return self._utc[number]

    def description(self) -> dict[str, Any]:
        """Return what packets do not say, as JSON can hold it: scene, sensors, bands, camera."""
        scene, instrument = self._scenario.scene, self._instrument
        camera, levels = instrument.sensor.camera, instrument.levels
        return {
            "warpsim": __version__,
            "packet_version": VERSION,
            "packet_bytes": self.packet_bytes,
            "scene": scene.name,
            "epoch_utc": scene.epoch_utc,
            "seed": scene.seed,
            "noise_seed": instrument.noise_seed,
            "kind": instrument.sensor.name,
            "n_frame": len(self._frames),
            "interval_s": instrument.frames.interval_s,
            "sensors": [{"name": name, "satellite": instrument.satellite_of(name)} for name in self.sensors],
            "bands": [
                {
                    "name": name,
                    "half_power_um": list(instrument.bands[name].half_power_um),
                    "nei_w_cm2": levels[name].nei_w_cm2,
                    "sei_w_cm2": levels[name].sei_w_cm2,
                    "offset_counts": levels[name].blank_counts,
                    "counts_per_nei": levels[name].counts_per_nei,
                }
                for name in self.bands
            ],
            "camera": {
                "n_row": camera.n_row,
                "n_col": camera.n_col,
                "focal_px": [camera.focal_px, camera.focal_row_px],
                "centre_px": [float(value) for value in camera.centre_px],
                "wcs": lens_keywords(camera),
            },
        }


def send_off(
    packets: npt.NDArray[np.uint8], sequence: int, loop: int, due_unix_ns: int, sent_unix_ns: int, is_late: bool
) -> None:
    """Complete the headers of the packets of a frame, the first of which is the packet `sequence` of its server."""
    headers = headers_of(packets)
    headers["sequence"] = sequence + np.arange(len(packets))
    headers["loop"], headers["due_unix_ns"], headers["sent_unix_ns"] = loop, due_unix_ns, sent_unix_ns
    if is_late:
        headers["flags"] |= LATE
    checked = HEADER.itemsize - 4
    headers["header_crc32"] = [zlib.crc32(packet[:checked].data) for packet in packets]


def headers_of(packets: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
    """Return the headers of packets, shape (n, packet_bytes), as records in the same memory, (n,)."""
    return np.asarray(packets[:, : HEADER.itemsize].view(HEADER)[:, 0])


def _fitting(name: str, n_byte: int) -> bytes:
    """UTF-8 of a name, cut so that a zero byte follows."""
    return name.encode()[: n_byte - 1].decode(errors="ignore").encode()
