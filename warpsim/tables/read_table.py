"""The table of a file of any kind, with the line of each row where the file has lines.

Messages do not name the file: the caller, who knows what it is for, puts its name before them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.tables.by_astropy import (
    read_by_name,
    read_ecsv,
    read_fits,
    read_ipac,
    read_parquet,
    read_votable,
)
from warpsim.tables.cds_readme import layout_from_readme, split_self_described
from warpsim.tables.cells import decoded
from warpsim.tables.delimited import names_columns, read_delimited
from warpsim.tables.file_kinds import KINDS, N_HEAD, check_foreign, kind_of, read_bytes, unpacked
from warpsim.tables.file_table import FileTable
from warpsim.tables.fixed_width import Layout, read_fixed_width, recognised
from warpsim.tables.lines import lines_after, lines_of, open_end

if TYPE_CHECKING:
    from astropy.table import Table

_README_NAMES = ("ReadMe", "ReadMe.txt", "README", "readme.txt")
_DESCRIPTION, _N_DESCRIPTION = b" Description of file:", 200_000
_BINARY_KINDS: dict[str, Callable[[bytes], Table]] = {"fits": read_fits, "parquet": read_parquet}
_TEXT_KINDS: dict[str, Callable[[bytes], tuple[Table, NDArray[np.int64]]]] = {
    "ecsv": read_ecsv,
    "ipac": read_ipac,
    "csv": read_delimited,
    "tsv": functools.partial(read_delimited, delimiter="\t"),
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
) -> FileTable:
    """Table of a file.

    Args:
        path: File name; ".gz" is unpacked.
        format: A key of KINDS, or any other of astropy's format names; None guesses by the content.
        what: What the file must be, for messages: "a table of stars".
        readme: ReadMe of a CDS file; one beside the file is found by itself.
        layouts: Byte layouts that a text without names of columns is compared with.
        likely: The layout to blame such a text by, where it follows none of them.
        data: Bytes of the file, where they have been read.

    Raises:
        InputError: The file cannot be read, or is no table.
    """
    data = read_bytes(path) if data is None else unpacked(data)
    if format is not None and format not in KINDS:
        return FileTable(read_by_name(path, format))
    check_foreign(data, what)
    kind = KINDS[format] if format is not None else kind_of(data, what)
    if kind == "votable":
        return FileTable(read_votable(data, what))
    if kind in _BINARY_KINDS:
        return FileTable(_BINARY_KINDS[kind](data))
    if b"\x00" in data[:N_HEAD]:
        raise InputError("cannot be read as a table: it is binary, of no kind known")
    if kind in _TEXT_KINDS:
        text_table = FileTable(*_TEXT_KINDS[kind](data))
        text_table.open_end = open_end(lines_of(data, skip=(b"#",)))
        return text_table
    described = _read_described(data, path, kind, readme)
    return described or _read_plain(data, path, layouts, likely)


def _read_described(data: bytes, path: Path, kind: str, readme: Path | None) -> FileTable | None:
    """Table of a text whose bytes the CDS describes: in a ReadMe, or in its first lines; None without a description."""
    file_name = path.name.removesuffix(".gz")
    if readme is not None:
        return _read_by_readme(data, file_name, readme)
    n_description = split_self_described(data.decode("latin-1")) if _DESCRIPTION in data[:_N_DESCRIPTION] else None
    if n_description is not None:
        lines = lines_after(lines_of(data), n_description)
        layout = layout_from_readme("\n".join(data.decode("latin-1").split("\n")[:n_description]), file_name)
        return FileTable(read_fixed_width(lines, layout), lines.number)
    if kind == "cds":
        beside = _readme_beside(path)
        if beside is None:
            raise InputError("must come with its ReadMe: give readme=, or put the file ReadMe beside it")
        return _read_by_readme(data, file_name, beside)
    return None


def _read_plain(data: bytes, path: Path, layouts: Sequence[Layout], likely: Layout | None) -> FileTable:
    """Table of a text that follows a known layout, has a ReadMe beside it, or a line of names."""
    file_name, beside = path.name.removesuffix(".gz"), _readme_beside(path)
    lines = lines_of(data, skip=(b"#",))
    layout = recognised(lines, layouts)
    if layout is None and beside is not None and file_name.lower().endswith(".dat") and _describes(beside):
        return _read_by_readme(data, file_name, beside)
    if layout is None and not names_columns(decoded(lines.text[0]) if len(lines) else ""):
        layout = likely  # which says what is wrong
    if layout is not None:
        return FileTable(read_fixed_width(lines, layout), lines.number, layout.name)
    table = FileTable(*read_delimited(data))
    table.open_end = open_end(lines)
    return table


def _readme_beside(path: Path) -> Path | None:
    return next((path.parent / name for name in _README_NAMES if (path.parent / name).is_file()), None)


def _describes(readme: Path) -> bool:
    """Return whether a file beside the data is a ReadMe of the CDS, not just any README."""
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
