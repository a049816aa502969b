"""Earth-fixed columns of tables of truth and measurements."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpsim.arguments import chosen_names
from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError
from warpsim.instant import Epoch
from warpsim.orbit.earth import gcrs_to_geodetic, itrs_to_gcrs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from astropy.table import Table

BODIES = ("sensor", "target")


def earth_fixed(table: Table, epoch: Epoch, bodies: str | Sequence[str] | None = None) -> Table:
    """Return a copy of a table of states with Earth-fixed ones beside them.

    Of each body, besides `sensor_x_m` and their like: sensor_itrs_x_m, sensor_itrs_y_m and sensor_itrs_z_m (ITRS),
    sensor_lon_deg, sensor_lat_deg and sensor_height_m (geodetic, WGS84). Of targets they are those of the time when
    the light left, `range_km` / c before `time_s`. Without tables of the Earth's rotation from the network (UT1 is
    taken as warpsim does everywhere).

    Args:
        table: Truth, or any table with time_s and the columns of states.
        epoch: From which time_s counts: `scene.epoch`.
        bodies: "sensor", "target" or both; those that the table has when left out.

    Raises:
        InputError: A column is missing.
    """
    found = table.copy()
    known = [body for body in BODIES if f"{body}_x_m" in table.colnames]
    chosen = known if bodies is None else chosen_names("bodies", bodies, list(BODIES))
    for body in chosen or BODIES:
        names = [f"{body}_{axis}_m" for axis in "xyz"]
        required = ["time_s", *names, *(["range_km"] if body == "target" else [])]
        if missing := [name for name in required if name not in table.colnames]:
            raise InputError(f"must have {', '.join(missing)}", "table")
        position_m = np.column_stack([np.asarray(table[name], dtype=np.float64) for name in names])
        time_s = np.asarray(table["time_s"], dtype=np.float64)
        if body == "target":
            time_s = time_s - 1e3 * np.asarray(table["range_km"], dtype=np.float64) / SPEED_OF_LIGHT_M_S
        there = np.isfinite(time_s) & np.isfinite(position_m).all(axis=1)
        columns = np.full((6, len(table)), np.nan)
        columns[:3, there] = np.einsum("nji,nj->in", itrs_to_gcrs(epoch, time_s[there]), position_m[there])
        columns[3:, there] = gcrs_to_geodetic(position_m[there], epoch, time_s[there])
        new = [f"{body}_itrs_{axis}_m" for axis in "xyz"]
        new += [f"{body}_lon_deg", f"{body}_lat_deg", f"{body}_height_m"]
        for name, values, unit in zip(new, columns, ("m", "m", "m", "deg", "deg", "m"), strict=True):
            found[name] = values
            found[name].unit = unit
    return found
