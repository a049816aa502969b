"""Checksums of a scene's input files as they were read; their content may have changed since."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path
from typing import Any

from warpsim.background.user_maps import function_checksum
from warpsim.config.fields import FUNCTION
from warpsim.detector.pixel_maps import SENSOR_FIELD
from warpsim.scene.instrument import Instrument
from warpsim.scene.pointing import BodyPointing, TablePointing
from warpsim.scene.scenario import Scenario


def input_checksums(scenario: Scenario) -> dict[str, str]:
    """Return the SHA-256 of each input file as the scenario has read it, by path; without the star catalog.

    A function of the user's is an input too, by its name: that of what it returns.

    Raises:
        InputError: The function cannot be called.
    """
    found: dict[str, str] = {}
    scene = scenario.scene

    def walk(part: Any) -> None:
        if isinstance(part, tuple):
            for item in part:
                walk(item)
        if not dataclasses.is_dataclass(part) or isinstance(part, TablePointing):
            return
        paths = [path for path in (getattr(part, "file", None), *(getattr(part, "files", None) or ())) if path]
        if paths:
            found[", ".join(paths)] = part.checksum  # type: ignore[union-attr]
        for field in dataclasses.fields(part):
            walk(getattr(part, field.name))

    walk((scene.constellation, scene.groups))
    images = [instrument.background.image for instrument in scenario.instruments.values()]
    for path in dict.fromkeys((scene.background.sky_map, *images)):
        if path is not None and path.startswith(FUNCTION):
            found[path] = function_checksum(path, list(scenario.bands.values()))
        elif path is not None and Path(path).is_file():
            found[path] = hashlib.sha256(Path(path).read_bytes()).hexdigest()
    for name in scenario.bands:
        found |= scene.band[name].checksums if name in scene.band else {}
    for instrument in scenario.instruments.values():
        found |= instrument.sensor.optics.file_checksums | _table_checksums(instrument)
        if (file := instrument.sensor.detector.maps_file) is not None:
            paths = dict.fromkeys(file.replace(SENSOR_FIELD, name) for name in instrument.names)
            found |= {
                path: hashlib.sha256(Path(path).read_bytes()).hexdigest() for path in paths if Path(path).is_file()
            }
    return found


def _table_checksums(instrument: Instrument) -> dict[str, str]:
    """Checksums of the rows of directions that were read from files, by path."""
    found: dict[str, str] = {}
    for entry, pointing in enumerate(instrument.sensor.pointing):
        if isinstance(pointing, BodyPointing):
            bodies = [own.attitude for own in instrument.program.sensors if own.entry == entry and own.attitude]
            content = b"".join(one.time_s.tobytes() + one.quaternion.tobytes() for one in dict.fromkeys(bodies))
            found[pointing.file] = hashlib.sha256(content).hexdigest()
        if isinstance(pointing, TablePointing) and pointing.file is not None:
            tables = [own.table for own in instrument.program.sensors if own.entry == entry and own.table is not None]
            rows = "".join(table.checksum for table in dict.fromkeys(tables))
            found[pointing.file] = hashlib.sha256(rows.encode()).hexdigest()
    return found
