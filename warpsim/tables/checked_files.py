"""FITS and NumPy's files (.npy) of others, opened once the sizes in their headers are known to be true.

astropy believes headers: a wrong digit asks for terabytes, or for a thousand million axes, and damaged tiles of a
compressed image overwrite the memory of the process. So headers are compared with the file before astropy sees them,
nothing is memory-mapped, and compressed images are unpacked by another process.
"""

from __future__ import annotations

import io
import math
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from warpsim.errors import InputError, one_line
from warpsim.tables.file_bytes import read_bytes, unpacked

BLOCK_BYTES, CARD_BYTES = 2880, 80
MOST_HEADER_BYTES = 16 * 2**20
MOST_UNPACKED_BYTES = 4 * 2**30
UNPACKING_S = 120.0
"""Time that another process may take to unpack compressed images."""

CUT_OFF = "ends early: the FITS data are cut off"

_BITPIX = (8, 16, 32, 64, -32, -64)


@contextmanager
def open_fits(source: str | Path | bytes) -> Iterator[Any]:
    """HDUs of a file, as astropy has them, without its warnings; compressed images are plain ones.

    Args:
        source: Name of a file, which may be packed by gzip, bzip2 or xz; or its bytes.

    Raises:
        InputError: It cannot be read, or is damaged.
    """
    from astropy.io import fits

    data = checked_fits(unpacked(read_bytes(Path(source))) if isinstance(source, str | Path) else source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of headers that are not quite FITS
        try:
            hdus = fits.open(io.BytesIO(data))
            hdus.readall()
        except Exception as error:  # astropy's own and those of the layers below
            raise InputError(f"cannot be read as FITS: {one_line(error)}") from None
        with hdus:
            yield hdus


def checked_fits(data: bytes) -> bytes:
    """The bytes of a FITS file whose headers are as long as they say; compressed images are unpacked.

    Raises:
        InputError: A header breaks a rule of FITS, or the file ends before its data do.
    """
    start, packed, n_hdu = 0, False, 0
    while start < len(data) and (not n_hdu or data.startswith(b"XTENSION", start)):
        try:
            end, cards = _header(data, start)
            size = _data_bytes(cards, not n_hdu)
        except InputError as error:
            raise error.of(f"FITS header {n_hdu}") if error.field else error from None
        if size > len(data) - end:
            raise InputError(CUT_OFF)
        packed = packed or cards.get("ZIMAGE") == "T"
        start, n_hdu = end + -(-size // BLOCK_BYTES) * BLOCK_BYTES, n_hdu + 1
    return _plain_images(data) if packed else data


def _header(data: bytes, start: int) -> tuple[int, dict[str, str]]:
    """End of a header's blocks, and its values as written, without strings."""
    cards: dict[str, str] = {}
    if not data.startswith((b"SIMPLE  =", b"XTENSION="), start):
        raise InputError("must be FITS, which begins with SIMPLE")
    for at in range(start, min(len(data), start + MOST_HEADER_BYTES), CARD_BYTES):
        card = data[at : at + CARD_BYTES]
        key = card[:8].rstrip()
        if key == b"END":
            return start + -(-(at + CARD_BYTES - start) // BLOCK_BYTES) * BLOCK_BYTES, cards
        if card[8:10] == b"= ":
            cards.setdefault(key.decode("latin-1"), card[10:].split(b"/")[0].strip().decode("latin-1"))
    raise InputError(CUT_OFF)


def _data_bytes(cards: dict[str, str], primary: bool) -> int:
    """Size of the data behind a header, which must be of those that FITS has."""
    if primary and cards.get("SIMPLE") != "T":
        raise InputError("must be T", "SIMPLE", cards.get("SIMPLE"))
    bits = _whole(cards, "BITPIX")
    if bits not in _BITPIX:
        raise InputError(f"must be one of {', '.join(map(str, _BITPIX))}", "BITPIX", bits)
    axes = [_whole(cards, f"NAXIS{k + 1}", 0, 2**48) for k in range(_whole(cards, "NAXIS", 0, 999))]
    n_parameter, n_group = (_whole(cards, key, 0, 2**48, unless) for key, unless in (("PCOUNT", 0), ("GCOUNT", 1)))
    _whole(cards, "TFIELDS", 0, 999, 0)
    if primary and cards.get("GROUPS") == "T":
        raise InputError("must not be random groups", "GROUPS")
    if cards.get("ZIMAGE") == "T":
        shape = [_whole(cards, f"ZNAXIS{k + 1}", 0, 2**48) for k in range(_whole(cards, "ZNAXIS", 0, 999))]
        if math.prod(shape) * 8 > MOST_UNPACKED_BYTES:
            rule = f"a compressed image must have at most {MOST_UNPACKED_BYTES // 8:,} pixels"
            raise InputError(rule, "ZNAXIS", shape)
    return abs(bits) // 8 * n_group * (n_parameter + math.prod(axes)) if axes else 0


def _whole(cards: dict[str, str], key: str, low: int = -64, high: int = 64, unless: int | None = None) -> int:
    """A whole number of a header; `unless` stands for one that is not given."""
    text = cards.get(key)
    if text is None and unless is not None:
        return unless
    if text is None or not text.removeprefix("-").isdecimal() or len(text) > 18 or not low <= int(text) <= high:
        raise InputError(f"must be a whole number from {low} to {high}", key, "nothing" if text is None else text, "s")
    return int(text)


def _plain_images(data: bytes) -> bytes:
    """A file whose compressed images are plain; unpacked by a process that damage may end."""
    script = Path(__file__).with_name("unpack_fits.py")
    command = [sys.executable, "-P", str(script), str(MOST_UNPACKED_BYTES + 2**30)]
    try:
        done = subprocess.run(command, input=data, capture_output=True, timeout=UNPACKING_S, check=False)
    except subprocess.TimeoutExpired:
        raise InputError(f"has compressed images that take more than {UNPACKING_S:g} s to unpack") from None
    except OSError as error:
        raise InputError(f"has compressed images, and no process can be started to unpack them: {error}") from None
    if done.returncode or not done.stdout:
        raise InputError("has compressed images that cannot be unpacked (damaged, or too large)")
    return done.stdout


def is_image(hdu: Any) -> bool:
    """Whether an HDU holds an image; astropy says so of damaged ones, too."""
    from astropy.io import fits

    return isinstance(hdu, fits.PrimaryHDU | fits.ImageHDU) and hdu.data is not None


def npy_array(data: bytes) -> NDArray[Any]:
    """The array in the bytes of a file of NumPy's, without objects.

    Raises:
        InputError: The header is damaged, or asks for more than the file holds.
    """
    stream = io.BytesIO(data)
    try:
        version = npy.read_magic(stream)
        read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, by_column, dtype = read_header(stream)
        size = math.prod(shape) * dtype.itemsize
        if dtype.hasobject or min(shape, default=0) < 0 or size > len(data) - stream.tell():
            raise ValueError(f"{len(data):,} bytes do not hold an array of shape {shape} of {dtype}")
        flat = np.frombuffer(data, dtype, math.prod(shape), stream.tell())
        return flat.reshape(shape, order="F" if by_column else "C").copy()
    except Exception as error:  # the header is parsed as Python's text, with all its kinds of errors
        raise InputError(f"cannot be read as a NumPy array: {one_line(error)}") from None
