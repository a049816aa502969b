"""The table of a file of any kind, with the line of each row where the file has lines.

Kinds are recognised by content; files of other well-known kinds are refused by name. Messages do not name the file: the
caller, who knows what it is for, puts its name before them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from warpsim.errors import InputError, errors_at
from warpsim.tables.by_astropy import ParquetFile, fits_tables, read_by_name, votable_tables
from warpsim.tables.columns import ColumnTable, read_part
from warpsim.tables.file_bytes import N_HEAD, known_kind, read_bytes, unpacked
from warpsim.tables.fixed_width import Layout, layout_from_readme, n_description, read_fixed_width, recognised
from warpsim.tables.text import decoded, delimited_tables, lines_of, names_columns, read_ecsv, read_ipac

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

_README_NAMES = ("ReadMe", "ReadMe.txt", "README", "readme.txt")
_DESCRIPTION, _N_DESCRIPTION = b" Description of file:", 200_000
_READERS: dict[str, Callable[[bytes], ColumnTable]] = {
    "parquet": lambda data: ParquetFile(data).whole(),
    "ecsv": read_ecsv,
    "ipac": read_ipac,
}


def read_table(
    path: Path,
    format: str | None = None,
    *,
    what: str = "a table",
    readme: Path | None = None,
    layouts: Sequence[Layout] = (),
    likely: Layout | None = None,
    data: bytes | None = None,
    table: str | int | None = None,
    wanted: Callable[[ColumnTable], bool] | None = None,
) -> ColumnTable:
    """Table of a file; of several that it holds, the one asked for, or the first that is wanted, with a warning.

    Args:
        path: File name; compressed ones (gzip, bzip2, xz) are unpacked.
        format: A key of KINDS, or any other of astropy's format names; None guesses by the content.
        what: What the file must be, for messages: "a table of stars".
        readme: ReadMe of a CDS file; one beside the file is found by itself.
        layouts: Byte layouts that a text without names of columns is compared with.
        likely: The layout to blame such a text by, where it follows none of them.
        data: Bytes of the file, where they have been read.
        table: Name or number, counted from 1, of the table to read.
        wanted: Whether a table of such columns, given without rows, is one to read.

    Raises:
        InputError: The file cannot be read, or is no table.
    """
    data = unpacked(read_bytes(path) if data is None else data)
    if not data.strip():
        raise InputError("must hold a table, got an empty file")
    data = data.removeprefix(b"\xef\xbb\xbf")
    if format is not None and format not in KINDS:
        return ColumnTable(read_by_name(path, format))
    foreign = "JSON" if data[:N_HEAD].lstrip().startswith((b"{", b"[{", b"[[")) else known_kind(data)
    if foreign is not None:
        raise InputError(f"must be {what}, got {foreign}")
    kind = KINDS[format] if format is not None else _kind_of(data, what)
    if kind == "fits":
        return read_part(fits_tables(data), "FITS file", table, wanted)
    if kind == "votable":
        return read_part(votable_tables(data, what), "VOTable", table, wanted)
    if kind != "parquet" and b"\x00" in data[:N_HEAD]:
        raise InputError("cannot be read as a table: it is binary, of no kind known")
    found = None
    if kind in _READERS:
        found = _READERS[kind](data)
    elif kind not in ("csv", "tsv"):
        found = _by_bytes(data, path, readme, layouts, likely, is_cds=kind == "cds")
    if found is not None:
        check_only_table(table)
        return found
    return read_part(delimited_tables(data, "\t" if kind == "tsv" else None), "text", table, wanted)


def check_only_table(table: str | int | None) -> None:
    """Raise where another table is asked for than the only one of a file."""
    if table not in (None, 1, "1"):
        raise InputError("must be left out, a file of this kind holds one", "table", table)


def _by_bytes(
    data: bytes, path: Path, readme: Path | None, layouts: Sequence[Layout], likely: Layout | None, is_cds: bool
) -> ColumnTable | None:
    """Table of a text whose bytes are described, or of a known layout; None of one with a line of names."""
    file_name = re.sub(r"\.(gz|bz2|xz)$", "", path.name)
    if readme is not None:
        return _read_by_readme(data, file_name, readme)
    n_line = n_description(data.decode("latin-1")) if _DESCRIPTION in data[:_N_DESCRIPTION] else None
    if n_line is not None:
        description = "\n".join(data.decode("latin-1").split("\n")[:n_line])
        return read_fixed_width(lines_of(data).after(n_line), layout_from_readme(description, file_name))
    beside = next((path.parent / name for name in _README_NAMES if (path.parent / name).is_file()), None)
    if is_cds:
        if beside is None:
            raise InputError("must come with its ReadMe: give readme=, or put the file ReadMe beside it")
        return _read_by_readme(data, file_name, beside)
    lines = lines_of(data, skip=(b"#",))
    layout = recognised(lines, layouts)
    if layout is None and beside is not None and file_name.lower().endswith(".dat") and _describes(beside):
        return _read_by_readme(data, file_name, beside)
    if layout is None and not names_columns(decoded(lines.text[0]) if len(lines) else ""):
        layout = likely  # which says what is wrong
    return None if layout is None else read_fixed_width(lines, layout)


def _describes(readme: Path) -> bool:
    """Return whether a file beside the data is a ReadMe of the CDS, not just any README."""
    try:
        return "description of file:" in readme.read_text("latin-1").lower()
    except OSError:
        return False


def _read_by_readme(data: bytes, file_name: str, readme: Path) -> ColumnTable:
    with errors_at("readme", str(readme)):
        layout = layout_from_readme(read_bytes(readme).decode("latin-1"), file_name)
    return read_fixed_width(lines_of(data), layout)


def _kind_of(data: bytes, what: str) -> str:
    """Kind of a file by its first bytes: a value of KINDS, or "text"; raise for XML other than a VOTable."""
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
