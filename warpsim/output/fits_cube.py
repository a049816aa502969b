"""FITS cubes: one per sensor and band, with a table of each frame's time and WCS.

Primary HDU: counts, axes (frame, row, column) in NumPy order, row 0 the top row of the image. Extension FRAMES: one
row per plane with FRAME (number), TIME_S (after the epoch), DATE_OBS (UTC), the TAN keywords CRVAL1 ... CD2_2 of
the plane's apparent sky, UP_REPLACED, BORESIGHT_REPLACED, and SLEWING where cameras slew; its header has the axis types
and the SIP polynomials of a distorted camera. `read_cube(path).wcs(plane)` makes an astropy WCS of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.optics.wcs import lens_keywords, tan_keywords, wcs_from_keywords
from warpsim.output.dates import utc_dates
from warpsim.output.fits_header import scene_cards, view_flags
from warpsim.render.frameset import FrameSet
from warpsim.scene.scenario import Scenario

if TYPE_CHECKING:
    from astropy.table import Table
    from astropy.wcs import WCS

_FLAG_COLUMNS = {"UPREPL": "UP_REPLACED", "BOREPL": "BORESIGHT_REPLACED", "SLEWING": "SLEWING"}
"""Columns of flags of views, by keyword."""

_WCS_KEYS = ("CRVAL1", "CRVAL2", "CRPIX1", "CRPIX2", "CD1_1", "CD1_2", "CD2_1", "CD2_2", "LONPOLE")


@dataclass(frozen=True, repr=False)
class Cube:
    """A cube as read from a file."""

    counts: npt.NDArray[np.uint16]
    """Shape (n_frame, n_row, n_col)."""
    frames: Table
    """One row per plane."""
    header: Any
    """Primary header."""

    def __repr__(self) -> str:
        n_frame, n_row, n_col = self.counts.shape
        size = f"{n_frame} frames, {n_row} x {n_col} pixels"
        return f"Cube({self.header['SENSOR']}, band {self.header['FILTER']}: {size})"

    def wcs(self, plane: int) -> WCS:
        """WCS of one plane, for zero-based pixel coordinates with astropy's pixel functions."""
        row = self.frames[plane]
        return wcs_from_keywords({key: float(row[key]) for key in _WCS_KEYS}, self.frames.meta)


class CubeWriter:
    """Writer of the planes of one sensor and band as they are rendered.

    Args:
        path: Name to write to (a temporary one; see files.whole_file).
        scenario: The scene.
        sensor: Sensor name.
        band: Band name.
        n_frame: Planes that will come.
    """

    def __init__(self, path: Path, scenario: Scenario, sensor: str, band: str, n_frame: int) -> None:
        from astropy.io import fits

        self._path = path
        self._epoch_utc = scenario.scene.epoch_utc
        self._camera = scenario.instrument_of(sensor).sensor.camera
        self._rows: list[dict[str, Any]] = []
        path.unlink(missing_ok=True)  # StreamingHDU appends to what is there
        self._stream = fits.StreamingHDU(str(path), _header(scenario, sensor, band, n_frame))

    def add(self, frames: FrameSet, sensor: int, band: int) -> None:
        """Append all frames of a render call, for one index along the sensor and band axes."""
        counts = frames.counts.numpy()[:, sensor, band]
        self._stream.write((counts.astype(np.int32) - 32768).astype(np.int16))
        flags = {_FLAG_COLUMNS[word]: values[:, sensor] for word, values in view_flags(frames).items()}
        for position, number in enumerate(frames.frames):
            keywords = tan_keywords(frames.axes_icrs[position, sensor], self._camera)
            row = {"FRAME": number, "TIME_S": float(frames.time_s[position]), **keywords}
            self._rows.append(row | {name: bool(values[position]) for name, values in flags.items()})

    def close(self) -> None:
        """Finish the file with the table of frames."""
        from astropy.io import fits
        from astropy.table import Table

        self._stream.close()
        table = Table(rows=self._rows)
        table.add_column(utc_dates(self._epoch_utc, table["TIME_S"]), index=2, name="DATE_OBS")
        table["TIME_S"].unit = "s"
        for name in _WCS_KEYS[:2]:
            table[name].unit = "deg"
        for name in _WCS_KEYS[4:8]:
            table[name].unit = "deg / pix"
        extension = fits.table_to_hdu(table)
        extension.name = "FRAMES"
        extension.header.update(lens_keywords(self._camera))
        extension.header["TIMESYS"] = "UTC"
        with fits.open(self._path, mode="append", memmap=False) as file:
            file.append(extension)

    def abandon(self) -> None:
        """Close the stream of a file that will not be finished."""
        self._stream.close()


def read_cube(path: str | Path) -> Cube:
    """Read a cube written by warpsim.

    Raises:
        InputError: The file is missing or is not such a cube.
    """
    from astropy.io import fits
    from astropy.table import Table

    try:
        with fits.open(path, memmap=False) as file:
            counts = np.asarray(file[0].data, dtype=np.uint16)
            return Cube(counts, Table.read(file["FRAMES"]), file[0].header)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"is not a warpsim FITS cube: {error}").of(path) from None


def _header(scenario: Scenario, sensor: str, band: str, n_frame: int) -> Any:
    from astropy.io import fits

    instrument = scenario.instrument_of(sensor)
    camera = instrument.sensor.camera
    cards = [
        ("SIMPLE", True, "conforms to FITS"),
        ("BITPIX", 16, "16-bit integers"),
        ("NAXIS", 3, ""),
        ("NAXIS1", camera.n_col, "columns"),
        ("NAXIS2", camera.n_row, "rows, first row on top"),
        ("NAXIS3", n_frame, "frames"),
        ("EXTEND", True, ""),
        ("BSCALE", 1, ""),
        ("BZERO", 32768, "unsigned 16-bit"),
        *scene_cards(scenario.scene, instrument, sensor, band),
    ]
    return fits.Header([fits.Card(*card) for card in cards])
