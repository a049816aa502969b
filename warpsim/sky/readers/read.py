"""Files to columns of catalogs: which survey a table is from, and what is done to its stars."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from warpsim.errors import InputError
from warpsim.sky.catalog_columns import NUMBER_UNITS, StarColumns, checked_columns
from warpsim.sky.photometric_bands import check_flux_columns, flag_column
from warpsim.sky.readers import infrared, near_infrared, visible
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
from warpsim.sky.readers.survey import Survey
from warpsim.sky.space_motion import J2000_JYEAR, checked_jyear
from warpsim.tables.columns import ColumnTable, plain_name
from warpsim.tables.read_table import read_table

T = TypeVar("T")

SURVEYS: Mapping[str, Survey] = {
    survey.name: survey for module in (infrared, near_infrared, visible) for survey in module.SURVEYS
}
"""Surveys known, by the name that the argument `format` takes."""


class StarsOfFile(NamedTuple):
    """Content of a catalog file, and what is still to be done to its stars."""

    columns: StarColumns
    """Filled, unless a table flags its fluxes and says of none that it was filled in."""

    target_epoch_jyear: float
    """Julian year to move the stars to: J2000 for a survey, its own for a custom table."""

    is_own: bool = False
    """Whether they are from a custom table, in which columns may be other than their names say."""


@dataclass(frozen=True)
class ReadOptions:
    """How to read a catalog file, as StarCatalog.read() describes it; all of it may be left out."""

    format: str | None = None
    columns: Mapping[str, str] | None = None
    table: str | int | None = None
    epoch_jyear: float | None = None
    readme: str | PathLike[str] | None = None

    def checked(self) -> ReadOptions:
        """Return the options, the epoch as a number.

        Raises:
            InputError: One is of another type.
        """
        if not isinstance(self.format, str | None):
            raise InputError("must be a name", "format", self.format)
        if not isinstance(self.readme, str | PathLike | None):
            raise InputError("must be a file name", "readme", self.readme)
        if not isinstance(self.columns, Mapping | None):
            kind = type(self.columns).__name__
            raise InputError(f"must be a mapping such as {{'ra_deg': 'RAJ2000'}}, got {kind}", "columns")
        if not isinstance(self.table, str | int | None) or isinstance(self.table, bool):
            raise InputError("must be a name or a number", "table", self.table)
        if self.epoch_jyear is None:
            return self
        try:
            return replace(self, epoch_jyear=checked_jyear(self.epoch_jyear))
        except InputError as error:
            raise InputError(error.rule, "epoch_jyear", self.epoch_jyear) from None


def read_stars(path: str | PathLike[str], options: ReadOptions = ReadOptions()) -> StarsOfFile:
    """Read a catalog file as StarCatalog.read() describes it; errors are one line and begin with the file's name."""
    try:
        where = fspath(path)
    except TypeError:
        where = None
    if not isinstance(where, str) or "\0" in where:
        raise InputError(f"must be a file name, got {type(path).__name__}", "path")
    options = options.checked()
    survey = SURVEYS.get(options.format) if options.format is not None else None
    try:
        table = read_table(
            Path(where),
            None if survey else options.format,
            what="a table of stars",
            readme=None if options.readme is None else Path(options.readme),
            layouts=LAYOUTS,
            likely=likely_layout(Path(where).name, survey.name if survey else None),
            table=options.table,
            wanted=lambda one: _holds_stars(one, survey, options.columns),
        )
        set_sloan_apart(table, () if options.columns is None else options.columns.values())
        if survey is None and options.columns is not None:
            return _own_stars(table, check_columns(options.columns, table), where, options.epoch_jyear)
        own = own_columns(table)
        if survey is None and is_own(own, table):
            return _own_stars(table, own, where, options.epoch_jyear)
        return _survey_stars(table, survey or _survey_of(table), where, options)
    except InputError as error:
        raise error.of(where) from None


def _holds_stars(table: ColumnTable, survey: Survey | None, columns: Mapping[str, str] | None) -> bool:
    """Return whether a table has the columns of what a file is read for."""
    set_sloan_apart(table, () if columns is None else columns.values())
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
        if survey.telling and table.find(*survey.telling) and 2 * len(missing) <= len(survey.needs):
            needed = ", ".join(" or ".join(names) for names in missing)
            rule = f"looks like {survey.name}, which must have the column {needed}"
            raise InputError(rule, value=table.names, form="s")
    named = "ra_deg, dec_deg and flux_A_jy or the like (argument columns, --columns on the command line)"
    rule = f"must have the columns {named}, or those of {', '.join(SURVEYS)}"
    raise InputError(rule, value=table.names, form="s")


def _own_stars(table: ColumnTable, columns: Mapping[str, str], where: str, epoch_jyear: float | None) -> StarsOfFile:
    """Stars of a custom table, at the table's epoch."""
    if table.open_end is not None:  # people write such files, archives do not
        warnings.warn(str(table.open_end.of(where)), stacklevel=4)
    if epoch_jyear is not None and "epoch_jyear" in columns:
        raise InputError(f"must be left out where the column {columns['epoch_jyear']} has it", "epoch_jyear")
    meta = {str(key).lower(): value for key, value in table.table.meta.items()}
    check_flux_columns(name for name in table.table.colnames if name not in columns.values())
    arrays = _rows_read(table, lambda: arrays_of_columns(table, columns))
    if epoch_jyear is not None:
        arrays["epoch_jyear"] = epoch_jyear
    checked = _checked(table, arrays, where, str(meta.get("name", Path(where).name)), columns)
    flagged = any(name in columns for name in map(flag_column, arrays["flux_jy"]))
    filled = checked.filled or not flagged or meta.get("filled") is True
    return StarsOfFile(replace(checked, filled=filled), checked.epoch_jyear, is_own=True)


def _survey_stars(table: ColumnTable, survey: Survey, where: str, options: ReadOptions) -> StarsOfFile:
    """Stars of a survey's table, to be moved to J2000."""
    if table.open_end is not None:
        raise table.open_end
    own = _renamed(table, options)
    for names in survey.needs:
        if table.find(*names) is None:
            rule = f"must have the column {' or '.join(names)} of {survey.name}"
            raise InputError(rule, value=table.names, form="s")
    stars = _rows_read(table, lambda: survey.convert(table, options.epoch_jyear))
    arrays = vars(stars)
    notes = list(arrays.pop("notes"))
    if own:
        _rows_read(table, lambda: merge_columns(arrays, table, own))
    for name in options.columns or ():
        if known_name(name) is None and plain_name(name) not in table.asked:
            raise InputError(f"must be a column that the reader of {survey.name} looks for", "columns", name)
    if stars.epoch_jyear != J2000_JYEAR:
        moves = stars.pm_ra_mas_yr is not None and stars.pm_dec_mas_yr is not None
        moved = "carried to J2000" if moves else "taken for those of J2000: there are no proper motions"
        notes.append(f"positions of {stars.epoch_jyear:g} {moved}")
    arrays["provenance"] = "; ".join([f"{survey.title}, {survey.reference}", *notes])
    checked = _checked(table, arrays, where, f"{survey.name} ({Path(where).name})")
    return StarsOfFile(replace(checked, filled=True), J2000_JYEAR)


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
    table: ColumnTable, arrays: dict[str, Any], file: str, name: str, columns: Mapping[str, str] | None = None
) -> StarColumns:
    """Columns of the stars; errors name the file's own column, which `columns` tells by warpsim's name for it."""
    numbers = {key: arrays.pop(key, None) for key in NUMBER_UNITS}
    try:
        return checked_columns(numbers, **arrays, name=name, file=file, line_of_row=table.line_of_row)
    except InputError as error:
        own_name = (columns or {}).get(error.field, error.field)
        raise table.located(error if own_name == error.field else error.of(f"column {own_name}")) from None


def _rows_read(table: ColumnTable, read: Callable[[], T]) -> T:
    """Result of `read`, whose errors say on which line of the file a row is."""
    try:
        return read()
    except InputError as error:
        raise table.located(error) from None
