"""Content of a file, unpacked, and what it is where it is of a kind known by its first bytes."""

from __future__ import annotations

import importlib
import io
import re
import zlib
from pathlib import Path

from warpsim.errors import InputError, one_line

_PACKED = {b"\x1f\x8b": "gzip", b"BZh": "bz2", b"\xfd7zXZ\x00": "lzma"}
"""First bytes of compressed files, and the modules that read them."""

_KINDS = {
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"GIF8": "a GIF image",
    b"%PDF": "a PDF document",
    b"PK\x03\x04": "a ZIP archive",
    b"7z\xbc\xaf": "a 7z archive",
    b"\x28\xb5\x2f\xfd": "zstandard, which is not read",
    b"\x89HDF": "an HDF5 file",
    b"CDF\x01": "a NetCDF file",
    b"CDF\x02": "a NetCDF file",
}
N_HEAD = 4096
"""Bytes that tell what a file is."""


def read_bytes(path: Path) -> bytes:
    """Content of a file as it is."""
    try:
        return path.read_bytes()
    except IsADirectoryError:
        raise InputError("must be a file, got a folder") from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or one_line(error)}") from None
    except ValueError:
        raise InputError("cannot be read: is no name of a file") from None


def unpacked(data: bytes, most: int | None = None) -> bytes:
    """Content, unpacked where it is compressed by gzip, bzip2 or xz: then at most so many bytes.

    Raises:
        InputError: It is damaged, or longer.
    """
    name = next((name for start, name in _PACKED.items() if data.startswith(start)), None)
    if name is None:
        return data
    module = importlib.import_module(name)
    try:
        with module.open(io.BytesIO(data)) as stream:
            plain: bytes = stream.read(-1 if most is None else most + 1)
    except EOFError:
        raise InputError(f"ends early: the {name} data are cut off") from None
    except (OSError, ValueError, zlib.error, getattr(module, "LZMAError", OSError)) as error:
        raise InputError(f"cannot be unpacked: damaged {name} data ({one_line(error)})") from None
    if most is not None and len(plain) > most:
        raise InputError(f"must hold at most {most} bytes once it is no longer compressed")
    return plain


def known_kind(data: bytes) -> str | None:
    """What a file is of those that hold neither text nor tables, as in "a PNG image"; None where it is none of them."""
    if re.match(rb"\s*<(!doctype\s+html|html)\b", data[:N_HEAD], re.IGNORECASE):
        title = re.search(rb"<title>(.*?)</title>", data[:N_HEAD], re.IGNORECASE | re.DOTALL)
        said = f"titled {' '.join(title[1].decode('latin-1').split())!r}" if title else "(a download that failed?)"
        return f"a web page {said}"
    return next((kind for start, kind in _KINDS.items() if data.startswith(start)), None)
