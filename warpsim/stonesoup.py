"""Readers for Stone Soup (extra `stonesoup`): detections, ground truth and images, as its trackers take them.

Times are naive datetimes of UTC, to the microsecond; states are x, vx, y, vy, z, vz, geocentric in GCRS axes [m, m/s].
"""

from __future__ import annotations

import importlib
import itertools
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from warpsim.arguments import chosen_names
from warpsim.errors import InputError
from warpsim.instant import utc_dates
from warpsim.measure.paths import POSITION, VELOCITY, truth_states
from warpsim.measure.rows import check_stonesoup, column, dates, has_column, naive_utc, numbers
from warpsim.render.frameset import FrameSet

if TYPE_CHECKING:
    from stonesoup.reader.base import DetectionReader, FrameReader, GroundTruthReader

Scan = Literal["time", "sensor", "image"]
Images = Iterator[tuple[datetime, npt.NDArray[np.uint16]]]

_SCAN_COLUMNS = {"time": (), "sensor": ("sensor",), "image": ("sensor", "band")}
_METADATA = ("frame", "sensor", "band", "snr", "irradiance_w_cm2", "target", "clump_id")
_MOST_DEC_DEG = 89.999


def detections(
    found: Any,
    scan: Scan = "time",
    mapping: Sequence[int] = POSITION,
    velocity_mapping: Sequence[int] | None = VELOCITY,
    ndim_state: int = 6,
) -> DetectionReader:
    """Make a reader of detections: times, and sets of `Detection` with a measurement model each.

    A measurement is elevation and bearing [rad], that is declination and right ascension, as seen from the sensor: the
    model has the sensor's position as `translation_offset` and the covariance of both angles. The time is that at
    which the light came in, and so is a state's; the model takes the body back to where its light left, range / c
    earlier. Without velocity_mapping it does not, and tracks are late by the light time: 50 m at 7 km/s and 2000 km.

    Args:
        found: Table with the columns of `ws.detections`: date_obs, sensor, band, ra_deg, dec_deg, ra_cosdec_sigma_deg,
            dec_sigma_deg, ra_dec_corr, sensor_x_m, sensor_y_m, sensor_z_m. Metadata of a detection are frame, sensor,
            band, snr, irradiance_w_cm2, target and clump_id, where there are such columns.
        scan: What one step of the reader holds: all detections of a time, those of one sensor, or of one image. For
            associators that give a track one detection of each scan, a scan must not see a target twice. Rows of an
            image that are read one after the other (`line_time_s`) have times, and so scans, of their own.
        mapping: Rows of the position in the tracker's state vector.
        velocity_mapping: Rows of the velocity; None where the light time is not to be modelled.
        ndim_state: Length of the state vector.

    Raises:
        InputError: Stone Soup is not installed, a column is missing, or a value is out of range.
    """
    readers = _readers()
    if scan not in get_args(Scan):
        raise InputError(f"must be one of {', '.join(get_args(Scan))}", "scan", scan)
    angles_deg = numbers(found, ("dec_deg", "ra_deg"), "found")
    if (wrong := np.flatnonzero(np.abs(angles_deg[:, 0]) > _MOST_DEC_DEG)).size:
        rule = f"must be within {_MOST_DEC_DEG} of 0: right ascension has no error at a pole"
        raise InputError(rule, "found.dec_deg", float(angles_deg[wrong[0], 0]), row=int(wrong[0]), n_row=wrong.size)
    values = {
        "angles_rad": np.radians(angles_deg),
        "covar_rad2": _covariances_rad2(found, angles_deg[:, 0]),
        "sensor_m": numbers(found, ("sensor_x_m", "sensor_y_m", "sensor_z_m"), "found"),
    }
    known = [name for name in _METADATA if has_column(found, name)]
    columns = [column(found, name, "found").tolist() for name in known]
    metadata = [dict(zip(known, row, strict=True)) for row in zip(*columns, strict=True)] or [{}] * len(angles_deg)
    model = {"mapping": tuple(mapping), "velocity_mapping": velocity_mapping, "ndim_state": ndim_state}
    times, names = dates(found, "date_obs", "found").tolist(), _SCAN_COLUMNS[scan]
    keys = list(zip(times, *(column(found, name, "found").tolist() for name in names), strict=True))
    order = sorted(range(len(keys)), key=keys.__getitem__)
    scans = [(key[0], list(rows)) for key, rows in itertools.groupby(order, key=keys.__getitem__)]
    reader: DetectionReader = readers.TableDetectionReader(scans, values, metadata, model)
    return reader


def ground_truth(truth: Any, at: Literal["frame", "emission"] = "frame") -> GroundTruthReader:
    """Make a reader of ground truth: times, and sets of each `GroundTruthPath` with a new state.

    Truth says where targets were when their light left. States at the time of the frame, when the light came in, are
    free fall onwards from there, micrometres off after milliseconds; they are what tracks of `detections` are compared
    with. States at emission are those of the truth, at times that differ from sensor to sensor.

    Args:
        truth: `FrameSet.truth`, or a table like it: target, date_obs, range_km, target_x_m ... target_vz_m_s. Paths
            are named by the target; several rows of a target and time give one state. Metadata are target and class.
        at: "frame" or "emission".

    Raises:
        InputError: Stone Soup is not installed, a column is missing, or no target is anywhere.
    """
    readers = _readers()
    states = truth_states(truth, at)
    names = [name for name in ("target", "class") if has_column(truth, name)]
    columns = [column(truth, name, "truth")[states.row].tolist() for name in names]
    metadata = [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
    reader: GroundTruthReader = readers.TableGroundTruthReader(states, metadata)
    return reader


def frames(
    source: FrameSet | str | Path, sensor: str | None = None, bands: str | Sequence[str] | None = None
) -> FrameReader:
    """Make a reader of the images of one sensor: times, and sets of one `ImageFrame`.

    Pixels are counts, uint16, (row, column, band). Images of files are read as they are asked for.

    Args:
        source: Rendered frames; a FITS cube of a run; or a run's folder, with FITS cubes of the sensor.
        sensor: The sensor; the only one of rendered frames when left out, and that of the cube.
        bands: Bands along the last axis; all of rendered frames when left out, and that of the cube.

    Raises:
        InputError: Stone Soup is not installed, an image was not rendered, or a file is missing or no such cube.
    """
    readers = _readers()
    images = _rendered(source, sensor, bands) if isinstance(source, FrameSet) else _stored(source, sensor, bands)
    reader: FrameReader = readers.ImageReader(images)
    return reader


def _rendered(source: FrameSet, sensor: str | None, bands: str | Sequence[str] | None) -> Callable[[], Images]:
    """Images of rendered frames."""
    if sensor is None and len(source.sensors) > 1:
        raise InputError(f"must be one of {', '.join(source.sensors)}", "sensor", sensor)
    view = source.sensors.index(chosen_names("sensor", sensor, source.sensors)[0])
    planes = [source.bands.index(band) for band in chosen_names("bands", bands, source.bands)]
    when = naive_utc(utc_dates(source.scene.epoch_utc, source.time_s).astype("datetime64[us]"))

    def images() -> Images:
        for number, time in enumerate(when):
            counts = np.asarray(source.one_frame(number).counts)[0, view]
            yield time, np.stack([counts[plane] for plane in planes], axis=-1)

    return images


def _stored(source: str | Path, sensor: str | None, bands: str | Sequence[str] | None) -> Callable[[], Images]:
    """Images of FITS cubes of one sensor."""
    from astropy.io import fits
    from astropy.table import Table

    paths = [Path(source)]
    if paths[0].is_dir():
        if sensor is None or bands is None:
            raise InputError("must be given for a folder", "sensor, bands")
        paths = [Path(source) / f"{sensor}_{band}.fits" for band in ([bands] if isinstance(bands, str) else bands)]
    elif sensor is not None or bands is not None:
        raise InputError("are those of the cube", "sensor, bands")
    when = []
    for path in paths:
        try:
            with fits.open(path) as file:
                when.append(naive_utc(dates(Table.read(file["FRAMES"]), "DATE_OBS", "FRAMES")))
        except (OSError, KeyError) as error:
            raise InputError(f"is not a warpsim FITS cube: {error}").of(path) from None
    if any(times != when[0] for times in when):
        raise InputError("must be of the same frames", ", ".join(map(str, paths)))

    def images() -> Images:
        for number, time in enumerate(when[0]):
            planes = []
            for path in paths:
                with fits.open(path) as file:
                    planes.append(np.asarray(file[0].section[number], dtype=np.uint16))
            yield time, np.stack(planes, axis=-1)

    return images


def _covariances_rad2(found: Any, dec_deg: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Covariances of elevation and bearing, (n, 2, 2): right ascension itself, not times cos(dec)."""
    sigma_deg = numbers(found, ("dec_sigma_deg", "ra_cosdec_sigma_deg"), "found")
    if not (sigma_deg > 0.0).all():
        row = int(np.flatnonzero((sigma_deg <= 0.0).any(axis=1))[0])
        raise InputError("must be above 0", "found.dec_sigma_deg, ra_cosdec_sigma_deg", row=row)
    elevation = np.radians(sigma_deg[:, 0])
    bearing = np.radians(sigma_deg[:, 1]) / np.cos(np.radians(dec_deg))
    correlation = numbers(found, ("ra_dec_corr",), "found")[:, 0]
    if (wrong := np.flatnonzero(np.abs(correlation) >= 1.0)).size:
        first = int(wrong[0])
        raise InputError("must be between -1 and 1", "found.ra_dec_corr", float(correlation[first]), row=first)
    both = correlation * elevation * bearing
    return np.stack([elevation**2, both, both, bearing**2], axis=1).reshape(-1, 2, 2)


def _readers() -> Any:
    """The module of classes that are Stone Soup's."""
    check_stonesoup()
    return importlib.import_module("warpsim.measure.stonesoup_readers")
