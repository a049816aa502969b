"""A ring of packets in shared memory: one process writes, any number reads, and none waits for another.

A file in /dev/shm: a header with the number of packets written so far, then slots. Packet k is in slot k % n_slot,
whose guard is 2 k + 1 while it is written and 2 k + 2 afterwards: a reader whose guard is 2 k + 2 before and after it
has copied the packet has packet k, else it was overtaken. Nothing that readers do reaches the writer. The layout is
that of `struct warpsim_ring` in `examples/serve/warpsim_packet.h`.
"""

from __future__ import annotations

import contextlib
import fcntl
import mmap
import os
import threading
from pathlib import Path

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.files import partial_path

FOLDER = Path("/dev/shm")
PAGE, LINE = 4096, 64
"""Slots begin at pages, guards and packets at lines of the cache."""

RING = np.dtype(
    [
        ("magic", "S8"),
        ("version", "<u4"),
        ("closed", "<u4"),
        ("first_slot", "<u8"),
        ("n_slot", "<u8"),
        ("slot_bytes", "<u8"),
        ("packet_bytes", "<u8"),
        ("text_bytes", "<u8"),
        ("pid", "<u8"),
        ("written", "<u8"),
    ]
)
"""Header of a ring; the description of the scene, JSON in UTF-8, is at byte 128."""
TEXT_AT = 128


class RingWriter:
    """The writing end of a ring.

    Args:
        name: Name of the file in /dev/shm, or the path of a file elsewhere.
        n_slot: Packets that it holds.
        packet_bytes: Size of each.
        text: Description of the scene.

    Raises:
        InputError: Another server writes the ring, a file of another kind has the name, or it cannot be made.
    """

    def __init__(self, name: str, n_slot: int, packet_bytes: int, text: bytes) -> None:
        self.path = FOLDER / name if "/" not in name else Path(name)
        slot_bytes = -(-(LINE + packet_bytes) // PAGE) * PAGE
        first_slot = -(-(TEXT_AT + len(text)) // PAGE) * PAGE
        self._file = _locked_file(self.path)
        try:
            os.posix_fallocate(self._file, 0, first_slot + n_slot * slot_bytes)  # a full /dev/shm is found here
            self._memory = mmap.mmap(self._file, first_slot + n_slot * slot_bytes)
        except OSError as error:
            raise self._given_up(error) from None
        self._header = np.frombuffer(self._memory, RING, 1)
        slots = np.frombuffer(self._memory, np.uint8, n_slot * slot_bytes, first_slot).reshape(n_slot, slot_bytes)
        self._packets = slots[:, LINE : LINE + packet_bytes]
        self._guards = slots[:, :8].view("<u8")[:, 0]  # numbers of eight bytes, which are written at once
        self._written = self._header["written"]
        self._memory[TEXT_AT : TEXT_AT + len(text)] = text
        fields = {"version": 1, "first_slot": first_slot, "n_slot": n_slot, "slot_bytes": slot_bytes}
        fields |= {"packet_bytes": packet_bytes, "text_bytes": len(text), "pid": os.getpid()}
        for field, value in fields.items():
            self._header[field] = value
        self._fence = threading.Lock()
        with self._fence:
            self._header["magic"] = b"WSRING"
        try:
            partial_path(self.path).replace(self.path)  # last: from now on the ring can be read
        except OSError as error:  # the ring left behind may be another user's
            raise self._given_up(error) from None

    def _given_up(self, error: OSError) -> InputError:
        """Remove what was begun, and return what to say."""
        partial_path(self.path).unlink()
        os.close(self._file)
        return InputError(f"cannot be made: {error.strerror}", "ring", str(self.path))

    def write(self, packet: npt.NDArray[np.uint8]) -> None:
        """Write a packet in the place of the oldest one."""
        number = int(self._written[0])
        slot = number % len(self._guards)
        self._guards[slot] = 2 * number + 1
        with self._fence:  # other processors see what was written before, before what follows
            self._packets[slot] = packet
        with self._fence:
            self._guards[slot] = 2 * number + 2
        self._written[0] = number + 1

    def close(self) -> None:
        """Tell readers that nothing follows, and remove the name; what they have mapped stays."""
        self._header["closed"] = 1
        with contextlib.suppress(FileNotFoundError):
            self.path.unlink()
        os.close(self._file)  # the memory goes with the arrays that show it


def _locked_file(path: Path) -> int:
    """The empty file of a ring under its partial name, locked as long as it is open; one left behind is taken over."""
    try:
        _check_free(path)
        partial = partial_path(path)
        made = os.open(partial, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
        with contextlib.ExitStack() as undo:
            undo.callback(os.close, made)
            fcntl.flock(made, fcntl.LOCK_EX | fcntl.LOCK_NB)
            undo.callback(partial.unlink)
            _check_free(path)  # whoever had the partial name until now may have the ring
            os.ftruncate(made, 0)
            undo.pop_all()
        return made
    except BlockingIOError:
        raise InputError("must be a ring that no other server writes", "ring", str(path)) from None
    except OSError as error:
        raise InputError(f"cannot be made: {error.strerror}", "ring", str(path)) from None


def _check_free(path: Path) -> None:
    """Check that a path is free, or that of a ring that no server writes any more."""
    if not path.exists():
        return
    if not path.is_file():
        raise InputError("must be a name that no other file has", "ring", str(path))
    with path.open("rb") as old:
        if old.read(8).rstrip(b"\0") != b"WSRING":
            raise InputError("must be a name that no other file has", "ring", str(path))
        fcntl.flock(old, fcntl.LOCK_EX | fcntl.LOCK_NB)
