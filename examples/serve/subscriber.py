"""Receives the packets of `warpsim serve`, over ZeroMQ or from a ring of shared memory; needs nothing of warpsim.

    python examples/serve/subscriber.py tcp://127.0.0.1:5555 --topic frame/sat11
    python examples/serve/subscriber.py /dev/shm/NAME --count 100

Prints a line per packet; `--out FILE` takes the packets as they are. ZeroMQ needs pyzmq.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import mmap
import struct
import sys
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HEADER = struct.Struct("<8sIIQQdqqIIIIIIII8sQII3d3d4d32s64s24sII")  # struct warpsim_packet of warpsim_packet.h
RING = struct.Struct("<8sIIQQQQQQQ")  # struct warpsim_ring
LATE, SLEWING = 1, 2
NAP_S = 1e-4


def fields_of(packet: bytes) -> dict[str, Any]:
    """Fields of a packet's header by name; raises ValueError if it, or the counts behind it, were damaged."""
    values = HEADER.unpack_from(packet)
    if zlib.crc32(packet[: HEADER.size - 4]) != values[-1] or zlib.crc32(packet[HEADER.size :]) != values[18]:
        raise ValueError("a packet is damaged")
    names = "magic version header_bytes sequence frame time_s due_unix_ns sent_unix_ns loop flags sensor band"
    names += " n_sensor n_band n_row n_col dtype payload_bytes"
    fields = dict(zip(names.split(), values, strict=False))
    fields |= {"position_m": values[20:23], "velocity_m_s": values[23:26], "quaternion": values[26:30]}
    texts = zip(("utc", "sensor_name", "band_name"), values[30:33], strict=True)
    return fields | {name: text.rstrip(b"\0").decode() for name, text in texts}


def from_socket(address: str, topic: str, timeout_s: float) -> Iterator[bytes]:
    """Packets that a server publishes, until none comes for some time; its description goes to the error stream."""
    import zmq

    socket = zmq.Context.instance().socket(zmq.SUB)
    socket.connect(address)
    socket.subscribe(topic)
    socket.subscribe("scene")
    described = False
    while socket.poll(int(1000 * timeout_s)):
        name, content = socket.recv_multipart()
        if name != b"scene":
            yield content
        elif not described:
            described = True
            describe(content)


def from_ring(path: str, timeout_s: float) -> Iterator[bytes]:
    """Packets of a ring, until its server ends or nothing comes for some time."""
    with Path(path).open("rb") as file:
        memory = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    magic, version, _, first_slot, n_slot, slot_bytes, packet_bytes, text_bytes, _, _ = RING.unpack_from(memory)
    if magic.rstrip(b"\0") != b"WSRING" or version != 1:
        raise ValueError(f"{path}: is no ring of version 1")
    describe(bytes(memory[128 : 128 + text_bytes]))
    words = memory.cast("Q")  # eight bytes are read at once

    def written() -> int:
        return words[8]

    number, since_s = max(0, written() - n_slot // 2), time.monotonic()
    while True:
        if number == written():
            closed = RING.unpack_from(memory)[2]
            if (closed and number == written()) or time.monotonic() - since_s > timeout_s:
                return
            time.sleep(NAP_S)
            continue
        start = first_slot + (number % n_slot) * slot_bytes
        guard = words[start // 8]
        packet = bytes(memory[start + 64 : start + 64 + packet_bytes])
        if guard == words[start // 8] == 2 * number + 2:
            number, since_s = number + 1, time.monotonic()
            yield packet
        else:
            ahead = max(number, written() - n_slot // 2)
            print(f"overtaken: {ahead - number} packets are lost", file=sys.stderr)
            number = ahead


def describe(text: bytes) -> None:
    """Print what the packets are of."""
    about = json.loads(text)
    sensors, bands = (", ".join(item["name"] for item in about[part]) for part in ("sensors", "bands"))
    print(f"{about['scene']} at {about['rate_hz']:g} Hz: {sensors}; bands {bands}", file=sys.stderr)


def main() -> None:
    """Receive, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", help="tcp://HOST:PORT, ipc://PATH, or the path of a ring")
    parser.add_argument("--topic", default="frame/", help="frame/SENSOR/BAND, or the beginning of it")
    parser.add_argument("--count", type=int, help="packets to receive; all when left out")
    parser.add_argument("--timeout", type=float, default=5.0, help="end when nothing came for so long [s]")
    parser.add_argument("--out", type=Path, help="file to write packets to")
    options = parser.parse_args()
    is_socket = "://" in options.source
    packets = (
        from_socket(options.source, options.topic, options.timeout)
        if is_socket
        else from_ring(options.source, options.timeout)
    )
    with options.out.open("wb") if options.out else contextlib.nullcontext() as out:
        for number, packet in enumerate(packets, start=1):
            fields = fields_of(packet)
            late_ms = (time.time_ns() - fields["due_unix_ns"]) / 1e6
            where = f"{fields['sensor_name']} in {fields['band_name']}"
            print(
                f"{fields['sequence']}: frame {fields['frame']}, {fields['utc']}, {where}, {late_ms:.2f} ms after due"
            )
            if out:
                out.write(packet)
            if number == options.count:
                break


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):  # Ctrl-C ends it
        main()
