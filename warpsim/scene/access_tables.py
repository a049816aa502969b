"""Tables of access and of eclipses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from warpsim.orbit.access_constraints import AccessConstraints

if TYPE_CHECKING:
    from astropy.table import Table


def access_table(rows: Iterable[tuple[str, str, float, float]], meta: Mapping[str, Any]) -> Table:
    """Return intervals of access as a table.

    Args:
        rows: Sensor, what its access counts by, first and last time after the epoch [s].
        meta: What the table says of itself.
    """
    whole = [(sensor, target, start_s, end_s, end_s - start_s) for sensor, target, start_s, end_s in rows]
    return _table_of_times(whole, ("sensor", "target", "start_s", "end_s", "duration_s"), meta)


def enabled_constraints(rules: AccessConstraints) -> dict[str, Any]:
    """Return the enabled constraints."""
    return {name: value for name, value in asdict(rules).items() if value is not None and value is not False}


def eclipse_table(eclipses: Sequence[Any], meta: Mapping[str, Any]) -> Table:
    """Return passages through the Earth's shadow as a table."""
    rows = [(*eclipse, eclipse.end_s - eclipse.start_s) for eclipse in eclipses]
    return _table_of_times(rows, ("start_s", "umbra_start_s", "umbra_end_s", "end_s", "duration_s"), meta)


def _table_of_times(rows: Sequence[tuple[Any, ...]], names: Sequence[str], meta: Mapping[str, Any]) -> Table:
    """Table whose time columns carry the unit."""
    from astropy.table import Table

    table = Table(rows=rows or None, names=names, dtype=[float if name.endswith("_s") else str for name in names])
    table.meta.update(meta)
    for name in names:
        if name.endswith("_s"):
            table[name].unit = "s"
            table[name].info.format = ".3f"
    return table
