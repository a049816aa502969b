"""Temperatures of targets: rows in time, linear in between, in float64."""

import warp as wp

from warpsim_kernels.attitude_table import row_before


@wp.struct
class TemperatureTables:
    """The rows of all targets, one table behind the other; a constant temperature is a table of one row."""

    time_s: wp.array[wp.float64]  # (n_row,) ascending within a table
    temperature_k: wp.array[wp.float64]  # (n_row,)


@wp.func
def temperature_k(tables: TemperatureTables, first: int, count: int, time_s: wp.float64) -> wp.float64:
    """Temperature from rows first to first + count - 1; the end rows hold beyond the table."""
    row = row_before(tables.time_s, first, count, time_s)
    kelvin = tables.temperature_k[row]
    if count > 1:
        start_s = tables.time_s[row]
        part = (time_s - start_s) / (tables.time_s[row + 1] - start_s)
        rise = tables.temperature_k[row + 1] - kelvin
        kelvin = kelvin + rise * wp.clamp(part, wp.float64(0.0), wp.float64(1.0))
    return kelvin
