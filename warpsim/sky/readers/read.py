"""Files to columns of catalogs: which survey a table is from, and what is done to its stars."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from warpsim.errors import InputError, errors_at
from warpsim.sky.catalog_columns import checked_columns
from warpsim.sky.photometric_bands import check_flux_columns, flag_column
from warpsim.sky.positions import J2000_JYEAR, dec_range_deg
from warpsim.sky.readers import infrared, visible
from warpsim.sky.readers.layouts import LAYOUTS, likely_layout
from warpsim.sky.readers.own_table import (
    arrays_of_columns,
    check_columns,
    column_named,
    is_own,
    known_name,
    merge_columns,
    own_columns,
    set_sloan_apart,
)
from warpsim.sky.readers.read_options import (
    CatalogFile,
    FileNames,
    ReadOptions,
    catalog_files,
    chosen,
    folder_name,
    is_parquet,
)
from warpsim.sky.readers.survey import Survey
from warpsim.sky.stars import Stars, joined
from warpsim.tables.by_astropy import ParquetFile
from warpsim.tables.columns import ColumnTable, plain_name
from warpsim.tables.read_table import check_only_table, read_table

SURVEYS: Mapping[str, Survey] = {survey.name: survey for module in (infrared, visible) for survey in module.SURVEYS}
"""Surveys known, by the name that the argument `format` takes."""


class StarsOfFile(NamedTuple):
    """Content of a catalog file, and what is still to be done to its stars."""

    stars: Stars
    """Filled, unless a table flags its fluxes and says of none that it was filled in."""

    target_epoch_jyear: float
    """Julian year to move the stars to: J2000 for a survey, its own for a custom table."""

    is_own: bool = False
    """Whether they are from a custom table, in which columns may be other than their names say."""


def read_stars(path: FileNames, options: ReadOptions) -> StarsOfFile:
    """Read catalog files as StarCatalog.read() describes it; errors are one line and begin with the file's name."""
    options = options.checked()
    return read_files(catalog_files(path, options.region), replace(options, name=folder_name(path)))


def read_files(files: Sequence[CatalogFile], options: ReadOptions, first_row: int = 0) -> StarsOfFile:
    """Read the stars of files of one kind, as if they were one.

    Args:
        files: One or more.
        options: Checked.
        first_row: Row of the first star, by which stars without a name are called.
    """
    found: list[StarsOfFile] = []
    for file in files:
        first_row += file.n_before
        start_row = first_row
        with errors_at("", str(file.path)):
            for n_row, stars in _stars_of_file(file.path, options, first_row):
                first_row += n_row
                if stars is not None:
                    found.append(stars)
            if file.n_row not in (None, first_row - start_row):
                raise InputError(f"must hold {file.n_row:,} rows, as the folder says, got {first_row - start_row:,}")
        first_row += file.n_behind
    return found[0]._replace(stars=joined([one.stars for one in found]))


def _stars_of_file(file: Path, options: ReadOptions, first_row: int) -> Iterator[tuple[int, StarsOfFile | None]]:
    """Yield rows and stars of each part of a file; the first part has stars, if only none."""
    survey = SURVEYS.get(options.format or "")
    if is_parquet(file) and (survey or options.format in (None, "parquet")):
        check_only_table(options.table)
        yield from _stars_of_parquet(ParquetFile(file), options, str(file), first_row)
        return
    table = read_table(
        file,
        None if survey else options.format,
        what="a table of stars",
        readme=None if options.readme is None else Path(options.readme),
        layouts=LAYOUTS,
        likely=likely_layout(file.name, survey.name if survey else None),
        table=options.table,
        wanted=lambda one: _holds_stars(one, survey, options.columns),
    )
    yield len(table), _stars_of_table(table, options, str(file), first_row)


def _stars_of_parquet(
    file: ParquetFile, options: ReadOptions, where: str, first_row: int
) -> Iterator[tuple[int, StarsOfFile | None]]:
    """Yield rows and stars of each row group, of which only columns that are looked for are read."""
    header = file.header()
    none = _stars_of_table(header, options, where, first_row)
    yield 0, none
    within = {}
    if options.region and header.position is not None:
        within[header.position[1]] = dec_range_deg(options.region)
    end = 0
    for first, table in file.tables(header.found, within):
        # Of groups that are passed over, rows count all the same.
        yield first + len(table) - end, _stars_of_table(table, options, where, first_row + first)
        end = first + len(table)
    yield len(file) - end, None


def _stars_of_table(table: ColumnTable, options: ReadOptions, where: str, first_row: int) -> StarsOfFile:
    survey = SURVEYS.get(options.format or "")
    given = options.columns
    set_sloan_apart(table, (given or {}).values())
    if survey is None and given is not None:
        found = _own_stars(table, check_columns(given, table), where, options, first_row)
    elif survey is None and is_own(own := own_columns(table), table):
        found = _own_stars(table, own, where, options, first_row)
    else:
        found = _survey_stars(table, survey or _survey_of(table), where, options, first_row)
    return found._replace(stars=chosen(found.stars, options))


def _holds_stars(table: ColumnTable, survey: Survey | None, columns: Mapping[str, str] | None) -> bool:
    """Return whether a table has the columns of what a file is read for."""
    set_sloan_apart(table, (columns or {}).values())
    if survey is None and columns is not None:
        return all(table.find(str(column)) for column in columns.values())
    if survey is not None:
        return survey.fits(table) or columns is not None
    return is_own(own_columns(table), table) or any(one.fits(table) for one in SURVEYS.values())


def _survey_of(table: ColumnTable) -> Survey:
    """Return the survey whose columns a table has; of several, the one that asks for most."""
    if table.layout is not None:
        return SURVEYS[table.layout]
    fitting = [survey for survey in SURVEYS.values() if survey.fits(table)]
    if fitting:
        return max(fitting, key=lambda survey: len(survey.needs))
    for survey in SURVEYS.values():
        missing = [names for names in survey.needs if table.find(*names) is None]
        if table.find(*(survey.telling or survey.needs[0])) and 2 * len(missing) <= len(survey.needs):
            needed = ", ".join(" or ".join(names) for names in missing)
            rule = f"looks like {survey.name}, which must have the column {needed}"
            raise InputError(rule, value=table.names, form="s")
    named = "ra_deg, dec_deg and flux_A_jy or the like (argument columns, --columns on the command line)"
    rule = f"must have the columns {named}, or those of {', '.join(SURVEYS)}"
    raise InputError(rule, value=table.names, form="s")


def _own_stars(
    table: ColumnTable, columns: Mapping[str, str], where: str, options: ReadOptions, first_row: int
) -> StarsOfFile:
    """Stars of a custom table, at the table's epoch."""
    if table.open_end is not None:  # people write such files, archives do not
        warnings.warn(str(table.open_end.of(where)), stacklevel=4)
    epoch_jyear = options.epoch_jyear
    if epoch_jyear is not None and "epoch_jyear" in columns:
        raise InputError(f"must be left out where the column {columns['epoch_jyear']} has it", "epoch_jyear")
    meta = {str(key).lower(): value for key, value in table.table.meta.items()}
    check_flux_columns(name for name in table.table.colnames if name not in columns.values())
    with _located(table):
        arrays = arrays_of_columns(table, columns)
    if epoch_jyear is not None:
        arrays["epoch_jyear"] = epoch_jyear
    name = str(meta.get("name", options.name or Path(where).name))
    flagged = any(name in columns for name in map(flag_column, arrays["flux_jy"]))
    filled = not flagged or meta.get("filled") is True
    stars = _checked(table, arrays, where, name, first_row, filled, columns)
    return StarsOfFile(stars, stars.epoch_jyear, is_own=True)


def _survey_stars(table: ColumnTable, survey: Survey, where: str, options: ReadOptions, first_row: int) -> StarsOfFile:
    """Stars of a survey's table, to be moved to J2000."""
    if table.open_end is not None:
        raise table.open_end
    own = _renamed(table, options)
    for names in survey.needs:
        if table.find(*names) is None:
            rule = f"must have the column {' or '.join(names)} of {survey.name}"
            raise InputError(rule, value=table.names, form="s")
    with _located(table):
        arrays = survey.convert(table, options.epoch_jyear)
        merge_columns(arrays, table, own)
    notes = [f"{survey.title}, {survey.reference}", *arrays.pop("notes")]
    for name in options.columns or ():
        if known_name(name) is None and plain_name(name) not in table.asked:
            raise InputError(f"must be a column that the reader of {survey.name} looks for", "columns", name)
    if arrays["epoch_jyear"] != J2000_JYEAR:
        moves = {"pm_ra_mas_yr", "pm_dec_mas_yr"} <= arrays.keys()
        moved = "carried to J2000" if moves else "taken for those of J2000: there are no proper motions"
        notes.append(f"positions of {arrays['epoch_jyear']:g} {moved}")
    arrays["provenance"] = "; ".join(notes)
    name = f"{survey.name} ({options.name or Path(where).name})"
    return StarsOfFile(_checked(table, arrays, where, name, first_row, filled=True), J2000_JYEAR)


def _renamed(table: ColumnTable, options: ReadOptions) -> dict[str, str]:
    """Give columns the names that a survey has for them; return those that go by warpsim's names instead."""
    own: dict[str, str] = {}
    for given, column in (options.columns or {}).items():
        name = known_name(given)
        own_name = column_named(table, given, str(column))
        if name is not None:
            own[name] = own_name
        else:
            table.rename(own_name, given)
    if own.keys() & {"ra_deg", "dec_deg"} and options.epoch_jyear is None:
        raise InputError("must be given with columns of a position beside a survey", "epoch_jyear")
    return own


def _checked(
    table: ColumnTable,
    arrays: dict[str, Any],
    file: str,
    name: str,
    first_row: int,
    filled: bool,
    columns: Mapping[str, str] | None = None,
) -> Stars:
    """The stars of arrays; errors name the file's own column, which `columns` tells by warpsim's name for it."""
    of_file: dict[str, Any] = {"file": file, "line_of_row": table.line_of_row, "first_row": first_row}
    try:
        return checked_columns(**arrays, name=name, **of_file, filled=filled)
    except InputError as error:
        own_name = (columns or {}).get(error.field, error.field)
        raise table.located(error if own_name == error.field else error.of(f"column {own_name}")) from None


@contextmanager
def _located(table: ColumnTable) -> Iterator[None]:
    """Let errors say on which line of the file a row is."""
    try:
        yield
    except InputError as error:
        raise table.located(error) from None
