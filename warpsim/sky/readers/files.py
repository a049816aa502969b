"""Catalog files to tables: which kind of file it is, told by its content, and where in it each row stands.

What is wrong with a file is said in one line without its name; `read_catalog` puts the name in front.
"""

from __future__ import annotations

import functools
import gzip
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.sky.readers.by_astropy import (
    read_by_name,
    read_ecsv,
    read_fits,
    read_ipac,
    read_parquet,
    read_votable,
)
from warpsim.sky.readers.cds_readme import layout_from_readme, split_self_described
from warpsim.sky.readers.delimited import decoded, names_columns, open_end, read_delimited
from warpsim.sky.readers.file_table import FileTable
from warpsim.sky.readers.fixed_width import Lines, lines_of, read_fixed_width, recognised
from warpsim.sky.readers.layouts import FILE_NAMES, LAYOUTS, layout_of

if TYPE_CHECKING:
    from astropy.table import Table

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
"""Kinds of files read here, by the names that the argument `format` takes for them."""

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
_README_NAMES = ("ReadMe", "ReadMe.txt", "README", "readme.txt")
_N_HEAD = 4096
_DESCRIPTION, _N_DESCRIPTION = b" Description of file:", 200_000
_BINARY_KINDS: dict[str, Callable[[bytes], Table]] = {
    "fits": read_fits,
    "votable": read_votable,
    "parquet": read_parquet,
}
_TEXT_KINDS: dict[str, Callable[[bytes], tuple[Table, NDArray[np.int64]]]] = {
    "ecsv": read_ecsv,
    "ipac": read_ipac,
    "csv": read_delimited,
    "tsv": functools.partial(read_delimited, delimiter="\t"),
}


def read_file(path: Path, format: str | None, readme: Path | None, survey: str | None) -> FileTable:
    """Table of a file.

    Args:
        path: File name; ".gz" is unpacked.
        format: A key of KINDS, or any other of astropy's format names; None tells by the content.
        readme: ReadMe of a CDS file; one beside the file is found by itself.
        survey: Name of the survey whose byte layout a text without columns follows; None recognises it.

    Raises:
        InputError: The file cannot be read, or is no table.
    """
    data = _bytes_of(path)
    if format is not None and format not in KINDS:
        return FileTable(read_by_name(path, format))
    _check_foreign(data)
    kind = KINDS[format] if format is not None else _kind_of(data)
    if kind in _BINARY_KINDS:
        return FileTable(_BINARY_KINDS[kind](data))
    if b"\x00" in data[:_N_HEAD]:
        raise InputError("cannot be read as a table: it is binary, of no kind known")
    if kind in _TEXT_KINDS:
        text_table = FileTable(*_TEXT_KINDS[kind](data))
        text_table.open_end = open_end(lines_of(data, skip=(b"#",)))
        return text_table
    return _read_bytes_of_lines(data, path, kind, readme, survey)


def _bytes_of(path: Path) -> bytes:
    """Content of a file, unpacked."""
    try:
        data = path.read_bytes()
    except IsADirectoryError:
        raise InputError("must be a file, got a folder") from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})") from None
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


def _check_foreign(data: bytes) -> None:
    """Raise for files of well-known other kinds."""
    for magic, what in _FOREIGN:
        if data.startswith(magic):
            raise InputError("must be a table of stars", value=what)
    head = data[:_N_HEAD].lstrip().lower()
    if head.startswith((b"<!doctype html", b"<html")):
        title = re.search(rb"<title>(.*?)</title>", data[:_N_HEAD], re.IGNORECASE | re.DOTALL)
        said = f" titled {' '.join(title[1].decode('latin-1').split())!r}" if title else ""
        raise InputError(f"must be a table of stars, got a web page{said}")
    if head.startswith((b"{", b"[{", b"[[")):
        raise InputError("must be a table of stars, got JSON")


def _kind_of(data: bytes) -> str:
    """Kind of a file by its first bytes: a value of KINDS, or "text"."""
    head = data[:_N_HEAD]
    if head.startswith((b"SIMPLE ", b"XTENSION")):
        return "fits"
    if head.startswith(b"PAR1"):
        return "parquet"
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    if text.startswith(b"<"):
        if b"VOTABLE" in head.upper():
            return "votable"
        raise InputError("must be a table of stars, got XML that is no VOTable")
    if re.match(rb"#\s*%ECSV", text):
        return "ecsv"
    first = next((line for line in data.split(b"\n", 400) if not line.startswith(b"\\")), b"")
    if first.startswith(b"|") and first.rstrip().endswith(b"|"):
        return "ipac"
    return "text"


def _read_bytes_of_lines(data: bytes, path: Path, kind: str, readme: Path | None, survey: str | None) -> FileTable:
    """Text whose kind only its lines tell: described by the CDS, in a known layout, or with a line of names."""
    file_name = path.name.removesuffix(".gz")
    if readme is not None:
        return _read_by_readme(data, file_name, readme)
    n_description = split_self_described(data.decode("latin-1")) if _DESCRIPTION in data[:_N_DESCRIPTION] else None
    if n_description is not None:
        lines = _after(lines_of(data), n_description)
        described = layout_from_readme("\n".join(data.decode("latin-1").split("\n")[:n_description]), file_name)
        return FileTable(read_fixed_width(lines, described), lines.number)
    beside = next((path.parent / name for name in _README_NAMES if (path.parent / name).is_file()), None)
    if kind == "cds":
        if beside is None:
            raise InputError("must come with its ReadMe: give readme=, or put the file ReadMe beside it")
        return _read_by_readme(data, file_name, beside)

    lines = lines_of(data, skip=(b"#",))
    layout = recognised(lines, LAYOUTS)
    if layout is None and beside is not None and file_name.lower().endswith(".dat") and _describes(beside):
        return _read_by_readme(data, file_name, beside)
    if layout is None and not names_columns(decoded(lines.text[0]) if len(lines) else ""):
        # The lines follow no layout: take that of the survey named, or of the file's name, to say what is wrong.
        layout = layout_of(survey or FILE_NAMES.get(file_name.lower(), ""))
    if layout is not None:
        return FileTable(read_fixed_width(lines, layout), lines.number, layout.survey)
    table = FileTable(*read_delimited(data))
    table.open_end = open_end(lines)
    return table


def _describes(readme: Path) -> bool:
    """Whether a file beside the data is a ReadMe of the CDS, not just any README."""
    try:
        return "description of file:" in readme.read_text("latin-1").lower()
    except OSError:
        return False


def _read_by_readme(data: bytes, file_name: str, readme: Path) -> FileTable:
    try:
        text = readme.read_text("latin-1")
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})").of(readme).within("readme") from None
    try:
        layout = layout_from_readme(text, file_name)
    except InputError as error:
        raise error.of(readme).within("readme") from None
    lines = lines_of(data)
    return FileTable(read_fixed_width(lines, layout), lines.number)


def _after(lines: Lines, n_line: int) -> Lines:
    """Lines behind the first n_line of the file."""
    first = int((lines.number <= n_line).sum())
    return Lines(lines.text[first:], lines.number[first:], lines.ends_with_break)
