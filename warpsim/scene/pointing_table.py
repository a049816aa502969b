"""Tables of directions: rows of a scene or a file, by sensor, and their interpolation in time."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from warpsim.arrays import F64
from warpsim.directions import unit_vectors
from warpsim.errors import InputError, errors_at
from warpsim.scene.pointing import Slew, TablePointing
from warpsim.tables.columns import ColumnTable

_COLUMNS = ("time_s", "ra_deg", "dec_deg", "azimuth_deg", "elevation_deg", "roll_deg", "sensor")
_PAIRS = (("ra_deg", "dec_deg"), ("azimuth_deg", "elevation_deg"))

_OPPOSITE_RAD = 1e-6
"""Two directions that are this near to opposite have no great circle between them."""
_MOST_TURN_RAD = 0.5
"""Most that a camera turns between two breakpoints."""


@dataclass(frozen=True)
class _Rows:
    """Rows as given; every array is (n_row,)."""

    time_s: F64
    lon_deg: F64
    lat_deg: F64
    roll_deg: F64
    sensor: list[str]
    """"" for all sensors without individual rows."""
    local: bool
    where: list[str]
    """What errors call each row."""
    file: str | None = None
    """The file that they came from."""

    def at(self, row: int, error: InputError) -> InputError:
        """Return an error with the row, and the file, before its field path."""
        return error.within(self.where[row]) if self.file is None else error.of(self.where[row]).of(self.file)


@dataclass(frozen=True, eq=False)
class DirectionRows:
    """Rows of a table for one sensor, or for several that share them."""

    time_s: F64
    """Ascending, shape (n_row,)."""
    direction: F64
    """Unit vectors, shape (n_row, 3): ICRS, or (forward, right, zenith) of the satellite."""
    roll_rad: F64
    """Without jumps by a turn from row to row, shape (n_row,)."""
    local: bool
    """Whether directions are in the satellite's local frame."""

    @property
    def checksum(self) -> str:
        """SHA-256 of the rows, in hexadecimal."""
        parts = (self.time_s, self.direction, self.roll_rad)
        return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()

    def scan_breaks_s(self) -> list[float]:
        """Return the times at which a scan turns at another rate, and times half a radian apart."""
        times = self.time_s
        turn = angle_rad(self.direction[:-1], self.direction[1:]) + np.abs(np.diff(self.roll_rad))
        n_part = np.maximum(np.ceil(turn / _MOST_TURN_RAD), 1).astype(int)
        legs = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(times[:-1], times[1:], n_part, strict=True)]
        return [float(time) for time in np.concatenate([*legs, times[-1:]])]

    def scan_at(self, time_s: F64) -> tuple[F64, F64]:
        """Return direction, shape (n, 3), and roll [rad], shape (n,), of a scan; beyond its ends, those of the end."""
        times = self.time_s
        row = np.clip(np.searchsorted(times, time_s, side="right") - 1, 0, len(times) - 2)
        part = np.clip((time_s - times[row]) / (times[row + 1] - times[row]), 0.0, 1.0)
        roll = self.roll_rad[row]
        direction = great_circle(self.direction[row], self.direction[row + 1], part)
        return direction, roll + (self.roll_rad[row + 1] - roll) * part


def great_circle(start: F64, end: F64, part: F64) -> F64:
    """Return unit vectors a part of the way from start to end, (n, 3) each and (n,); not for opposite ones."""
    angle = angle_rad(start, end)
    near = angle < 1e-8  # the chord is as good
    safe = np.where(near, 1.0, angle)
    weights = [np.where(near, fraction, np.sin(fraction * safe)) for fraction in (1 - part, part)]
    vectors = start * weights[0][..., None] + end * weights[1][..., None]
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def angle_rad(start: F64, end: F64) -> F64:
    """Return the angle between vectors of shape (..., 3)."""
    across = np.linalg.norm(np.cross(start, end), axis=-1)
    return np.asarray(np.arctan2(across, np.sum(start * end, axis=-1)))


def direction_rows(pointing: TablePointing, sensors: Sequence[tuple[str, str]], known: set[str]) -> list[DirectionRows]:
    """Return the rows of each sensor; those without individual rows share theirs."""
    rows = _rows_of_file(pointing.file) if pointing.file is not None else _rows_of(pointing)
    scan = pointing.mode == "scan"
    for row, name in enumerate(rows.sensor):
        if name and name not in known:
            raise rows.at(row, InputError("must be a sensor of the scene", "sensor", name))
    made: dict[str, DirectionRows] = {}
    for name in dict.fromkeys(rows.sensor):
        mine = [row for row, sensor in enumerate(rows.sensor) if sensor == name]
        direction = unit_vectors(rows.lon_deg[mine], rows.lat_deg[mine])
        _check_rows(rows, direction, mine, scan)
        roll_rad = np.radians(np.unwrap(rows.roll_deg[mine], period=360.0))
        made[name] = DirectionRows(rows.time_s[mine], direction, roll_rad, rows.local)
    found = [made.get(sensor) or made.get(satellite) or made.get("") for sensor, satellite in sensors]
    for (sensor, _), own in zip(sensors, found, strict=True):
        if own is None:
            raise InputError(f"there are none for sensor {sensor}, and none for all sensors", "rows")
    return [own for own in found if own is not None]


def check_rate(rows: DirectionRows, slew: Slew) -> None:
    """Check that a scan keeps the largest rate of the camera."""
    step_s = np.diff(rows.time_s)
    turn_rad = np.hypot(angle_rad(rows.direction[:-1], rows.direction[1:]), np.diff(rows.roll_rad))
    rate_deg_s = np.degrees(turn_rad / step_s)
    row = int(np.argmax(rate_deg_s))
    if rate_deg_s[row] > slew.max_rate_deg_s * (1.0 + 1e-9):
        rule = f"a scan must turn at most at max_rate_deg_s ({slew.max_rate_deg_s:g}) to the next row"
        raise InputError(rule, f"rows[{row}]", float(rate_deg_s[row]), "g")


def _check_rows(rows: _Rows, direction: F64, mine: list[int], scan: bool) -> None:
    """Check the rows of one sensor."""
    if scan and len(mine) < 2:
        raise rows.at(mine[0], InputError("a scan needs at least two rows per sensor, got one"))
    for number, (before, after) in enumerate(itertools.pairwise(mine)):
        if rows.time_s[after] <= rows.time_s[before]:
            rule = f"must be above that of the sensor's row before ({rows.time_s[before]:g})"
            raise rows.at(after, InputError(rule, "time_s", rows.time_s[after], "g"))
        if scan and np.pi - angle_rad(direction[number], direction[number + 1]) < _OPPOSITE_RAD:
            raise rows.at(after, InputError("a scan has no way to the opposite of the row before"))


def _rows_of(pointing: TablePointing) -> _Rows:
    """Rows given in the scene."""
    rows = pointing.rows or ()
    local = rows[0].ra_deg is None
    where = [f"rows[{number}]" for number in range(len(rows))]
    for name, row in zip(where, rows, strict=True):
        if (row.ra_deg is None) != local:
            raise InputError(f"must give {' and '.join(_PAIRS[local])}, as the first row does", name)
    lon, lat = _PAIRS[local]
    time_s, lon_deg, lat_deg, roll_deg = (
        np.array([getattr(row, name) for row in rows], dtype=np.float64) for name in ("time_s", lon, lat, "roll_deg")
    )
    return _Rows(time_s, lon_deg, lat_deg, roll_deg, [row.sensor or "" for row in rows], local, where)


def _rows_of_file(file: str) -> _Rows:
    """Rows of a CSV or ECSV file."""
    from warpsim.tables.read_table import read_table

    suffix = Path(file).suffix.lower()
    if suffix not in (".csv", ".ecsv"):
        raise InputError("must end in .csv or .ecsv").of(file)
    with errors_at("", file):
        rows = _rows_of_table(read_table(Path(file), suffix[1:], what="a table of directions"))
    return replace(rows, file=file)


def _rows_of_table(table: ColumnTable) -> _Rows:
    """Rows of a file's table."""
    names = list(table.table.colnames)
    for name in names:
        if name not in _COLUMNS:
            raise InputError(f"must be one of {', '.join(_COLUMNS)}", f"column {name}")
    pairs = [pair for pair in _PAIRS if any(name in names for name in pair)]
    if len(pairs) != 1 or not all(name in names for name in pairs[0]):
        raise InputError("must hold ra_deg and dec_deg, or azimuth_deg and elevation_deg", "columns")
    if "time_s" not in names:
        raise InputError("must hold time_s", "columns")
    if not len(table):
        raise InputError("must hold at least one row")
    lon, lat = pairs[0]
    units = {"time_s": "s", lon: "deg", lat: "deg"} | ({"roll_deg": "deg"} if "roll_deg" in names else {})
    columns = {name: table.number(name, unit=unit) for name, unit in units.items()}
    where = [table.where(row) for row in range(len(table))]
    for name, values in columns.items():
        bad = ~np.isfinite(values) if name != lat else ~(np.abs(values) <= 90.0)
        if bad.any():
            row = int(np.argmax(bad))
            rule = "be in [-90, 90]" if name == lat else "be finite"
            raise InputError(f"must {rule}", f"column {name}", values[row], "g").of(where[row])
    roll = columns.get("roll_deg", np.zeros(len(table)))
    sensor = [str(name) for name in table.text("sensor")]
    return _Rows(columns["time_s"], columns[lon], columns[lat], roll, sensor, lon != "ra_deg", where)
