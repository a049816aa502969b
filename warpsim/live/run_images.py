"""Images of a run, read and never written: of a finished one, or of one that another process still renders or left.

A sensor that is being rendered has its files below PARTS and a journal of how far they are whole; one that is
complete has them under their final names. The truth of both stands in parts of tables until the manifest comes.
"""

from __future__ import annotations

import glob
import os
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.files import read_json
from warpsim.live.shown_images import Mark, ShownImage, main_targets, marks_of
from warpsim.output.checkpoints import has_key, is_record
from warpsim.output.growing import whole_steps
from warpsim.output.output_folder import CHECKPOINTS, GROWING, MANIFEST, PARTS, RUN
from warpsim.output.plan import part_name
from warpsim.scene.scene import Scene

if TYPE_CHECKING:
    from astropy.table import Table


class _RunImages:
    """What images of runs have in common, finished or not.

    Args:
        folder: Of the run.
        record: What it says of itself.
        path: File with the record.
    """

    def __init__(self, folder: str | os.PathLike[str], record: dict[str, Any], path: Path) -> None:
        if "fits" not in record["formats"]:
            raise InputError("must have fits to be shown", "formats", " ".join(record["formats"])).of(folder)
        self.folder = Path(folder)
        self.scenario = Scene.from_dict(record["scene"], str(path)).scenario
        self._frames: dict[str, list[int]] = record["frames"]
        self._bands: dict[str, list[str]] = record["bands_of"]
        self.sensors = [name for name, numbers in self._frames.items() if numbers]
        self._marks: dict[tuple[int, str, str], list[Mark]] = {}

    def frames(self, sensor: str) -> Sequence[int]:
        """Numbers of the frames that a sensor has images of."""
        return self._frames.get(sensor, [])

    def at(self, frame: int, sensors: Sequence[str], band: str | None) -> list[ShownImage]:
        """Images of a frame in a band (None: the first of each sensor), of the sensors that have both."""
        shown = []
        for sensor in sensors:
            own = self._bands.get(sensor, [""])[0] if band is None else band
            if frame in self.frames(sensor) and own in self._bands[sensor]:
                counts = _plane(self._path(sensor, f"{sensor}_{own}.fits"), self._frames[sensor].index(frame))
                levels = self.scenario.instrument_of(sensor).levels[own]
                shown.append(ShownImage(sensor, own, counts, levels, self._marks_of(frame, sensor, own)))
        return shown

    def _path(self, sensor: str, name: str) -> Path:
        """Path of a file with images of a sensor."""
        return self.folder / name

    def _marks_of(self, frame: int, sensor: str, band: str) -> list[Mark]:
        """Targets with light in an image."""
        return self._marks.get((frame, sensor, band), [])


class FolderImages(_RunImages):
    """Images of a finished run, read back; nothing is rendered.

    Args:
        folder: As `warpsim render` left it, with FITS cubes and truth.

    Raises:
        InputError: It holds no complete run, or one in another format.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        from astropy.table import Table

        path = Path(folder) / MANIFEST
        manifest = read_json(path)
        if not is_record(manifest) or "scene" not in manifest or "frames" not in manifest:
            raise InputError("holds no complete run, which has a manifest with a scene").of(folder)
        super().__init__(folder, manifest, path)
        if "truth" in manifest["tables"]:
            self._marks = marks_of(Table.read(self.folder / "truth.fits"), main_targets(self.scenario))


def unfinished_run(folder: str | os.PathLike[str]) -> dict[str, Any] | None:
    """Return the record of the run, or the data set, that a folder holds without its manifest; None for others."""
    record = read_json(Path(folder) / PARTS / RUN)  # before the manifest: it goes when that has come
    if not is_record(record) or has_key(read_json(Path(folder) / MANIFEST), record["key"]):
        return None
    return dict(record)


class GrowingImages(_RunImages):
    """Images of an unfinished run, as far as they are whole; from its manifest on those of the finished one.

    Args:
        folder: As `warpsim render` fills it, with FITS cubes.

    Raises:
        InputError: It holds no unfinished run, or one in another format.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        record = unfinished_run(folder)
        if record is None or "scene" not in record or "frames" not in record:
            raise InputError("holds no unfinished run").of(folder)
        super().__init__(folder, record, Path(folder) / PARTS / RUN)
        self._key: str = record["key"]
        self._growing = self.folder / PARTS / GROWING / self._key[:16]
        self._journals = {name: _Journal(self._growing / name / "journal") for name in self.sensors}
        self._complete: set[str] = set()
        self._seen: list[tuple[int, ...] | None] = []
        self._tables: dict[str, tuple[str, Table]] = {}
        self._mains = main_targets(self.scenario)
        self._finished: FolderImages | None = None
        self._lock = threading.RLock()

    @property
    def is_finished(self) -> bool:
        """Whether the run is done."""
        with self._lock:
            return self._look() is not None

    @property
    def n_image(self) -> int:
        """Images that the run is going to have."""
        return sum(len(self._frames[sensor]) * len(self._bands[sensor]) for sensor in self.sensors)

    @property
    def n_image_there(self) -> int:
        """Images that are whole by now."""
        return sum(len(self.frames(sensor)) * len(self._bands[sensor]) for sensor in self.sensors)

    def frames(self, sensor: str) -> Sequence[int]:
        """Numbers of the frames that a sensor has whole images of by now.

        Raises:
            InputError: The folder does not hold this run any more.
        """
        with self._lock:
            finished = self._look()
            if finished is not None:
                return finished.frames(sensor)
            return self._frames[sensor][: self._n_whole(sensor)] if sensor in self._journals else []

    def newest(self, sensors: Sequence[str]) -> int | None:
        """Return the number of the frame that came last of some sensors; None where none of them has any."""
        with self._lock:
            there = {sensor: frames for sensor in sensors if (frames := self.frames(sensor))}
            growing = [sensor for sensor in there if self._journals[sensor].is_there]
            last = (growing or list(there))[-1:]
            return there[last[0]][-1] if last else None

    def at(self, frame: int, sensors: Sequence[str], band: str | None) -> list[ShownImage]:
        """Images of a frame in a band (None: the first of each sensor), of the sensors that have both.

        Raises:
            InputError: The folder does not hold this run any more.
            OSError: A file is gone or damaged.
        """
        with self._lock:
            try:
                return self._at(frame, sensors, band)
            except FileNotFoundError:  # the run has given it its final name, or joined it to others, just now
                return self._at(frame, sensors, band)

    def _at(self, frame: int, sensors: Sequence[str], band: str | None) -> list[ShownImage]:
        finished = self._look()
        return super().at(frame, sensors, band) if finished is None else finished.at(frame, sensors, band)

    def _look(self) -> FolderImages | None:
        """Return the images of the finished run once its manifest is there.

        Raises:
            InputError: The folder does not hold this run any more.
        """
        run, manifest = self.folder / PARTS / RUN, self.folder / MANIFEST
        seen = [_signature(run), _signature(manifest)]
        if self._finished is None and seen != self._seen:
            held = has_key(read_json(run), self._key)  # before the manifest: it goes when that has come
            if has_key(read_json(manifest), self._key):
                self._finished = FolderImages(self.folder)
            elif not held:
                raise InputError("does not hold this run any more").of(self.folder)
            self._seen = seen
        return self._finished

    def _n_whole(self, sensor: str) -> int:
        """Number of the frames of a sensor that are whole, in the order in which they are rendered."""
        journal = self._journals[sensor]
        journal.read_on()
        if journal.is_there:
            return journal.n_frame
        if sensor not in self._complete and has_key(
            read_json(self.folder / PARTS / CHECKPOINTS / f"{sensor}.json"), self._key
        ):
            self._complete.add(sensor)
        there = all((self.folder / f"{sensor}_{band}.fits").exists() for band in self._bands[sensor])
        return len(self._frames[sensor]) if sensor in self._complete and there else 0

    def _path(self, sensor: str, name: str) -> Path:
        """Path of a file that is still growing, or else the final one."""
        growing = self._growing / sensor / "files" / name
        return growing if growing.exists() else self.folder / name

    def _marks_of(self, frame: int, sensor: str, band: str) -> list[Mark]:
        """Targets with light in an image, from the part of the truth that has the frame."""
        index, parts = self._frames[sensor].index(frame), dict[int, Path]()
        for home in (self._growing / sensor / "files", self.folder):
            folder = (home / part_name(sensor, "truth", 0)).parent
            for path in folder.glob(f"{glob.escape(sensor)}.*.fits"):
                first = path.name.removeprefix(f"{sensor}.").removesuffix(".fits")
                if first.isdecimal() and int(first) <= index:
                    parts.setdefault(int(first), path)
        if not parts:
            raise FileNotFoundError(f"{self.folder}: the truth of {sensor} is missing")
        path = parts[max(parts)]
        if self._tables.get(sensor, ("",))[0] != path.name:
            from astropy.table import Table

            self._tables[sensor] = path.name, Table.read(path)
        table = self._tables[sensor][1]
        rows = table[np.asarray(table["frame"]) == frame]
        return marks_of(rows, self._mains).get((frame, sensor, band), [])


class _Journal:
    """The whole steps of a journal that another process writes, read as far as it goes."""

    def __init__(self, path: Path) -> None:
        self._path, self._n_byte = path, 0
        self.n_frame = 0
        """Frames that are whole."""
        self.is_there = False

    def read_on(self) -> None:
        """Read what was added since the last time; all again where the journal became shorter."""
        try:
            file = self._path.open("rb")
        except FileNotFoundError:
            self._n_byte = self.n_frame = 0
            self.is_there = False
            return
        with file:
            if file.seek(0, os.SEEK_END) < self._n_byte:
                self._n_byte = self.n_frame = 0
            file.seek(self._n_byte)
            added = file.read()
        self.is_there = True
        for length, step in whole_steps(added):
            self.n_frame += len(step["facts"]["frames"])
            self._n_byte += length


def _signature(path: Path) -> tuple[int, ...] | None:
    """Inode, size and time of a file, by which one that replaces it differs; None where there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def _plane(path: Path, index: int) -> npt.NDArray[np.uint16]:
    """Counts of one plane of a cube that may be unfinished, shape (row, column); read, as the file may be cut."""
    from astropy.io import fits

    with path.open("rb") as file:
        header = fits.Header.fromfile(file)
        shape = int(header["NAXIS2"]), int(header["NAXIS1"])
        n_pixel = shape[0] * shape[1]
        data = np.fromfile(file, ">i2", n_pixel, offset=2 * index * n_pixel)
    if len(data) < n_pixel:
        raise OSError(f"{path}: is shorter than its run says")
    return (data.astype(np.int32) + int(header["BZERO"])).astype(np.uint16).reshape(shape)
