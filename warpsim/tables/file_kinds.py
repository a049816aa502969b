"""Kinds of files that hold tables, recognised by their content; files of other well-known kinds are refused by name."""

from __future__ import annotations

import gzip
import re
import zlib
from pathlib import Path

from warpsim.errors import InputError

KINDS = {
    "fits": "fits",
    "votable": "votable",
    "parquet": "parquet",
    "ecsv": "ecsv",
    "ascii.ecsv": "ecsv",
    "ipac": "ipac",
    "ascii.ipac": "ipac",
    "csv": "csv",
    "ascii.csv": "csv",
    "tsv": "tsv",
    "ascii.tab": "tsv",
    "cds": "cds",
    "ascii.cds": "cds",
    "ascii.mrt": "cds",
}
"""Kinds of files read here, by the names that users give them; those of astropy are among them."""

N_HEAD = 4096
"""Bytes that identify the kind."""

_FOREIGN = (
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"GIF8", "a GIF image"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"BZh", "a bzip2 archive: unpack it first"),
    (b"\xfd7zXZ", "an xz archive: unpack it first"),
    (b"\x89HDF", "an HDF5 file"),
)


def read_bytes(path: Path) -> bytes:
    """Content of a file, unpacked where it is gzip, without a byte order mark.

    Raises:
        InputError: The file cannot be read or unpacked, or is empty.
    """
    try:
        data = path.read_bytes()
    except IsADirectoryError:
        raise InputError("must be a file, got a folder") from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})") from None
    return unpacked(data)


def unpacked(data: bytes) -> bytes:
    """Return a file's bytes unpacked where they are gzip, without a byte order mark.

    Raises:
        InputError: They cannot be unpacked, or there are none.
    """
    if data[:2] == b"\x1f\x8b":
        try:
            data = gzip.decompress(data)
        except EOFError:
            raise InputError("ends early: the gzip data are cut off") from None
        except (OSError, zlib.error) as error:
            raise InputError(f"cannot be unpacked ({error})") from None
    if not data.strip():
        raise InputError("must hold a table, got an empty file")
    return data.removeprefix(b"\xef\xbb\xbf")


def check_foreign(data: bytes, what: str) -> None:
    """Raise for files of well-known other kinds; `what` says what it must be, as in "a table of stars"."""
    for magic, found in _FOREIGN:
        if data.startswith(magic):
            raise InputError(f"must be {what}, got {found}")
    head = data[:N_HEAD].lstrip().lower()
    if head.startswith((b"<!doctype html", b"<html")):
        title = re.search(rb"<title>(.*?)</title>", data[:N_HEAD], re.IGNORECASE | re.DOTALL)
        said = f" titled {' '.join(title[1].decode('latin-1').split())!r}" if title else ""
        raise InputError(f"must be {what}, got a web page{said}")
    if head.startswith((b"{", b"[{", b"[[")):
        raise InputError(f"must be {what}, got JSON")


def kind_of(data: bytes, what: str) -> str:
    """Kind of a file by its first bytes: a value of KINDS, or "text".

    Raises:
        InputError: It is XML other than a VOTable; `what` says what it must be.
    """
    head = data[:N_HEAD]
    if head.startswith((b"SIMPLE ", b"XTENSION")):
        return "fits"
    if head.startswith(b"PAR1"):
        return "parquet"
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    if text.startswith(b"<"):
        if b"VOTABLE" in head.upper():
            return "votable"
        raise InputError(f"must be {what}, got XML that is no VOTable")
    if re.match(rb"#\s*%ECSV", text):
        return "ecsv"
    first = next((line for line in data.split(b"\n", 400) if not line.startswith(b"\\")), b"")
    if first.startswith(b"|") and first.rstrip().endswith(b"|"):
        return "ipac"
    return "text"
