"""Tables of directions: rows of a scene or a file, sorted by sensor, and what they say at a time."""

from __future__ import annotations

import hashlib
import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from warpsim.directions import unit_vectors
from warpsim.errors import InputError
from warpsim.scene.pointing import TablePointing

if TYPE_CHECKING:
    from warpsim.tables.file_table import FileTable

F64 = npt.NDArray[np.float64]

_COLUMNS = ("time_s", "ra_deg", "dec_deg", "azimuth_deg", "elevation_deg", "roll_deg", "sensor")
_PAIRS = (("ra_deg", "dec_deg"), ("azimuth_deg", "elevation_deg"))

_OPPOSITE_RAD = 1e-6
"""Two directions that are this near to opposite have no great circle between them."""
_MOST_TURN_RAD = 0.5
"""Most that a camera turns between two breaks."""


@dataclass(frozen=True)
class _Rows:
    """Rows as given; every array is (n_row,)."""

    time_s: F64
    lon_deg: F64
    lat_deg: F64
    roll_deg: F64
    sensor: list[str]
    """"" for all sensors without rows of their own."""
    local: bool
    places: list[str]
    """What errors call each row."""


@dataclass(frozen=True, eq=False)
class Sights:
    """Rows of a table of directions, those of a sensor together and by time."""

    time_s: F64
    """Shape (n_row,)."""
    direction: F64
    """Unit vectors, shape (n_row, 3): ICRS, or (forward, right, zenith) of the satellite."""
    roll_rad: F64
    """Without jumps by a turn from row to row, shape (n_row,)."""
    first: npt.NDArray[np.int32]
    """First row of each sensor, shape (n_sensor,)."""
    count: npt.NDArray[np.int32]
    """Rows of each sensor, shape (n_sensor,)."""
    local: bool
    """Whether directions are in the satellite's local frame."""
    scan: bool
    """Whether the camera moves from row to row."""

    @property
    def checksum(self) -> str:
        """SHA-256 of the rows, in hexadecimal."""
        parts = (self.time_s, self.direction, self.roll_rad, self.first, self.count)
        return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()

    def check_times(self, sensor_names: list[str], time_s: F64) -> None:
        """See that the rows of all these sensors (the first ones of the scene, in order) cover the times.

        Raises:
            InputError: They do not: sensor, time and span.
        """
        for number, name in enumerate(sensor_names):
            self.check_sensor(number, name, time_s)

    def check_sensor(self, number: int, name: str, time_s: F64) -> None:
        """See that the rows of one sensor cover the times.

        Raises:
            InputError: They do not: sensor, time and span.
        """
        if not time_s.size:
            return
        first, count = int(self.first[number]), int(self.count[number])
        start, end = float(self.time_s[first]), float(self.time_s[first + count - 1])
        low, high = float(time_s.min()), float(time_s.max())
        if low < start or (self.scan and high > end):
            span = f"[{start:g}, {end:g}] s" if self.scan else f"from {start:g} s on"
            outside = low if low < start else high
            raise InputError(f"the rows of {name} cover {span}, not the frame at {outside:g} s", "pointing")

    def breaks_s(self, sensor: int) -> list[float]:
        """Times at which a sensor's camera jumps, or turns at another rate; and in a scan, half a radian apart."""
        rows = slice(int(self.first[sensor]), int(self.first[sensor]) + int(self.count[sensor]))
        times = self.time_s[rows]
        if not self.scan:
            return [float(time) for time in times]
        turn = _angle(self.direction[rows][:-1], self.direction[rows][1:]) + np.abs(np.diff(self.roll_rad[rows]))
        n_part = np.maximum(np.ceil(turn / _MOST_TURN_RAD), 1).astype(int)
        legs = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(times[:-1], times[1:], n_part, strict=True)]
        return [float(time) for time in np.concatenate([*legs, times[-1:]])]

    def at(self, sensor: int, time_s: F64) -> tuple[F64, F64]:
        """Direction, shape (n, 3), and roll [rad], shape (n,), of a sensor at times within its rows."""
        first, count = int(self.first[sensor]), int(self.count[sensor])
        times = self.time_s[first : first + count]
        row = np.clip(np.searchsorted(times, time_s, side="right") - 1, 0, count - 1)
        if not self.scan:
            return self.direction[first + row], self.roll_rad[first + row]
        row = np.minimum(row, count - 2)
        part = np.clip((time_s - times[row]) / (times[row + 1] - times[row]), 0.0, 1.0)
        start, end = self.direction[first + row], self.direction[first + row + 1]
        roll = self.roll_rad[first + row]
        return great_circle(start, end, part), roll + (self.roll_rad[first + row + 1] - roll) * part


def great_circle(start: F64, end: F64, part: F64) -> F64:
    """Unit vectors a part of the way from start to end, (n, 3) each and (n,); not for opposite ones."""
    angle = _angle(start, end)
    near = angle < 1e-8  # the chord is as good
    safe = np.where(near, 1.0, angle)
    weights = [np.where(near, share, np.sin(share * safe)) for share in (1 - part, part)]
    vectors = start * weights[0][..., None] + end * weights[1][..., None]
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def make_sights(pointing: TablePointing, sensor_names: list[str]) -> Sights:
    """Sort a table's rows by sensor and time.

    Raises:
        InputError: The file cannot be read, or a row breaks a rule: unknown or missing sensors, times that do not
            grow, one row or opposite directions in a scan.
    """
    rows = _rows_of_file(pointing.file) if pointing.file is not None else _rows_of(pointing)
    scan = pointing.mode == "scan"
    for name, place in zip(rows.sensor, rows.places, strict=True):
        if name and name not in sensor_names:
            raise InputError("must be a sensor of the scene", "sensor", name).of(place)
    groups: dict[str, tuple[int, int]] = {}
    order: list[int] = []
    for name in dict.fromkeys(rows.sensor):
        mine = [row for row, sensor in enumerate(rows.sensor) if sensor == name]
        groups[name] = len(order), len(mine)
        order += mine
    direction = unit_vectors(rows.lon_deg, rows.lat_deg)
    for first, count in groups.values():
        _check_group(rows, direction, order[first : first + count], scan)
    missing = [name for name in sensor_names if name not in groups and "" not in groups]
    if missing:
        raise InputError(f"there are none for sensor {missing[0]}, and none for all sensors", "rows")
    spans = np.array([groups.get(name) or groups[""] for name in sensor_names], dtype=np.int32)
    roll = rows.roll_deg[order]
    for first, count in groups.values():
        roll[first : first + count] = np.unwrap(roll[first : first + count], period=360.0)
    return Sights(rows.time_s[order], direction[order], np.radians(roll), spans[:, 0], spans[:, 1], rows.local, scan)


def _check_group(rows: _Rows, direction: F64, mine: list[int], scan: bool) -> None:
    """Rules for the rows of one sensor."""
    if scan and len(mine) < 2:
        raise InputError("a scan needs at least two rows per sensor, got one").of(rows.places[mine[0]])
    for before, after in itertools.pairwise(mine):
        if rows.time_s[after] <= rows.time_s[before]:
            raise InputError(
                f"must be above that of the sensor's row before ({rows.time_s[before]:g})",
                "time_s",
                rows.time_s[after],
                "g",
            ).of(rows.places[after])
        if scan and np.pi - _angle(direction[before], direction[after]) < _OPPOSITE_RAD:
            raise InputError("a scan has no way to the opposite of the row before").of(rows.places[after])


def _angle(start: F64, end: F64) -> F64:
    across = np.linalg.norm(np.cross(start, end), axis=-1)
    return np.asarray(np.arctan2(across, np.sum(start * end, axis=-1)))


def _rows_of(pointing: TablePointing) -> _Rows:
    """Rows that stand in the scene."""
    rows = pointing.rows or ()
    local = rows[0].ra_deg is None
    places = [f"rows[{number}]" for number in range(len(rows))]
    for place, row in zip(places, rows, strict=True):
        if (row.ra_deg is None) != local:
            raise InputError(f"must give {' and '.join(_PAIRS[local])}, as the first row does").of(place)
    lon, lat = _PAIRS[local]
    time_s, lon_deg, lat_deg, roll_deg = (
        np.array([getattr(row, name) for row in rows], dtype=np.float64) for name in ("time_s", lon, lat, "roll_deg")
    )
    return _Rows(time_s, lon_deg, lat_deg, roll_deg, [row.sensor or "" for row in rows], local, places)


def _rows_of_file(file: str) -> _Rows:
    """Rows of a CSV or ECSV file."""
    from warpsim.tables.read import read_table

    suffix = Path(file).suffix.lower()
    if suffix not in (".csv", ".ecsv"):
        raise InputError("must end in .csv or .ecsv").of(file)
    try:
        rows = _rows_of_table(read_table(Path(file), suffix[1:], what="a table of directions"))
    except InputError as error:
        raise error.of(file) from None
    return replace(rows, places=[f"{file}: {place}" for place in rows.places])


def _rows_of_table(table: FileTable) -> _Rows:
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
    places = [table.where(row) for row in range(len(table))]
    for name, values in columns.items():
        bad = ~np.isfinite(values) if name != lat else ~(np.abs(values) <= 90.0)
        if bad.any():
            row = int(np.argmax(bad))
            rule = "be in [-90, 90]" if name == lat else "be finite"
            raise InputError(f"must {rule}", f"column {name}", values[row], "g").of(places[row])
    roll = columns.get("roll_deg", np.zeros(len(table)))
    sensor = [str(name) for name in table.text("sensor")]
    return _Rows(columns["time_s"], columns[lon], columns[lat], roll, sensor, lon != "ra_deg", places)
