"""Calls of astropy's readers: warnings are dropped, and what they raise becomes an error of one line."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from warpsim.errors import InputError, one_line

if TYPE_CHECKING:
    from astropy.table import Table


def quietly(read: Callable[[], Any], what: str, locate: Callable[[], None] | None = None) -> Table:
    """Result of a reader of astropy's, without its warnings; what it raises becomes an InputError.

    Args:
        read: Reads the table.
        what: Kind of file, for the error.
        locate: Looks for the cell that is to blame, and raises if there is one.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return read()
    except Exception as error:  # readers of foreign formats raise many kinds for a broken file
        if locate is not None:
            locate()
        raise InputError(f"cannot be read as a table: {what}: {one_line(error)}") from None


def cds_unit(text: str) -> Any:
    """Unit as the CDS spells it; one that astropy does not know is kept, and converts to nothing."""
    from astropy.units import Unit

    return Unit(text.strip(), format="cds", parse_strict="silent")
