"""Tables of several sensors joined to one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from astropy.table import Table


def joined_tables(parts: Sequence[Table]) -> Table:
    """Return the rows of tables, one behind the other.

    The metadata are those that all have alike: what differs from part to part, as a seed, is no word of the whole.
    Columns with a value per band have those of all tables, in the order of BANDS in the metadata, NaN for bands that a
    sensor does not have.
    """
    from astropy.table import vstack

    if len(parts) == 1:
        return parts[0]
    bands = list(dict.fromkeys(band for part in parts for band in _bands(part)))
    table = vstack([_spread(part, bands) for part in parts], metadata_conflicts="silent")
    alike = [name for name in parts[0].meta if all(part.meta.get(name) == parts[0].meta[name] for part in parts)]
    table.meta = {name: parts[0].meta[name] for name in alike}
    if bands:
        table.meta["BANDS"] = ",".join(bands)
        table.meta["CATALOG"] = ", ".join(dict.fromkeys(str(part.meta["CATALOG"]) for part in parts))
    return table


def _bands(table: Table) -> list[str]:
    return str(table.meta["BANDS"]).split(",") if "BANDS" in table.meta else []


def _spread(table: Table, bands: list[str]) -> Table:
    own = _bands(table)
    if own == bands:
        return table
    spread, numbers = table.copy(), [bands.index(band) for band in own]
    for name in table.colnames:
        if table[name].ndim == 2:
            values = np.full((len(table), len(bands)), np.nan)
            values[:, numbers] = table[name]
            spread[name] = values
            spread[name].unit = table[name].unit
    return spread
