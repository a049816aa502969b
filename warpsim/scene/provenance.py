"""Provenance of files: scene, epoch and time scale, seeds, version, and checksums of input files."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from warpsim.background.user_maps import function_checksum
from warpsim.config.fields import FUNCTION
from warpsim.config.model import parts_with_files
from warpsim.detector.pixel_maps import SENSOR_FIELD
from warpsim.files import sha256_of
from warpsim.scene.description import SceneDescription
from warpsim.scene.instrument import Instrument
from warpsim.scene.pointing import BodyPointing, TablePointing
from warpsim.scene.scenario import Scenario
from warpsim.version import __version__

PROVENANCE = {
    "SCENE": "name of the scene",
    "TIMESYS": "time scale of dates",
    "DATEREF": "epoch: instant of TIME_S = 0",
    "SEED": "of the world",
    "NOISSEED": "of the noise",
    "CREATOR": "program and version",
}
"""Words of provenance, as FITS keywords, and what they say."""


def provenance(scene: SceneDescription) -> dict[str, Any]:
    """Return the words of PROVENANCE for a scene: of headers, metadata of tables, attributes and JSON alike.

    Args:
        scene: The scene, or that of one sequence of a data set.
    """
    noise_seed = scene.seed if scene.noise_seed is None else scene.noise_seed
    values = (scene.name, "UTC", scene.epoch_utc, scene.seed, noise_seed, f"warpsim {__version__}")
    return dict(zip(PROVENANCE, values, strict=True))


def input_checksums(scenario: Scenario) -> dict[str, str]:
    """Return the SHA-256 of each input file as the scenario has read it, by path; not of star catalogs.

    A user-defined function is an input too, by its name: the checksum is that of what it returns.

    Raises:
        InputError: The function cannot be called.
    """
    scene = scenario.scene
    found: dict[str, str] = {
        ", ".join(paths): part.checksum for part, paths in parts_with_files((scene.constellation, scene.groups))
    }
    images = [instrument.background.image for instrument in scenario.instruments.values()]
    for path in dict.fromkeys((scene.background.sky_map, *images)):
        if path is not None and path.startswith(FUNCTION):
            found[path] = function_checksum(path, list(scenario.bands.values()))
        elif path is not None and Path(path).is_file():
            found[path] = sha256_of(Path(path))
    for name in scenario.bands:
        found |= scene.band[name].checksums if name in scene.band else {}
    for instrument in scenario.instruments.values():
        found |= instrument.sensor.optics.file_checksums | _table_checksums(instrument)
        if (file := instrument.sensor.detector.maps_file) is not None:
            paths = dict.fromkeys(file.replace(SENSOR_FIELD, name) for name in instrument.names)
            found |= {path: sha256_of(Path(path)) for path in paths if Path(path).is_file()}
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
