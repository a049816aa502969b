"""Detections drawn from truth: as a detector would report them, without pixels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.measure.image_rows import ImageRows
from warpsim.measure.pixel_psf import PixelPsf
from warpsim.measure.point_fit import LARGEST_SIGMA_PX, source_sigma
from warpsim.render.resolution import full_w_cm2
from warpsim.scene.instrument import Instrument
from warpsim.streams import uniforms

if TYPE_CHECKING:
    from astropy.table import Table

F64 = npt.NDArray[np.float64]

N_DRAW = 4
"""Numbers drawn for each target: of x, y and light, and whether it is detected."""


@dataclass(frozen=True)
class Draws:
    """What detections are drawn with."""

    threshold_sigma: float
    """Least light over its error that is detected."""
    probability: float | None = None
    """That a target is detected; None: where its light, as drawn, is above the threshold."""
    clutter_per_image: float = 0.0
    """Mean number of false detections."""
    draw_seed: int = 0


@dataclass(frozen=True)
class _Sources:
    """What an image shows as single points: targets, or several that merge."""

    target: npt.NDArray[np.int64]
    """Index of the brightest target, (n,)."""
    xy_px: F64
    """Where the light's centroid lies, (n, 2)."""
    irradiance_w_cm2: F64
    sigma: F64
    """Of x, y and irradiance, (n, 3)."""
    clump_id: npt.NDArray[np.int64]
    n_merged: npt.NDArray[np.int64]


_NUMBERS = ("irradiance_w_cm2", "clump_id", "x_px", "y_px", "x_sigma_px", "y_sigma_px", "irradiance_sigma_w_cm2")
"""Columns of the truth that sources are made of."""


def _merged_sources(rows: Mapping[str, npt.NDArray[Any]]) -> _Sources:
    """Return the sources of one image: each clump of the truth is one, at the centroid of its light.

    Errors are the brightest target's, with the clump's light for its own.
    """
    light, clump, *rest = (rows[name] for name in _NUMBERS)
    xy, sigma = np.stack(rest[:2], axis=1), np.stack(rest[2:], axis=1)
    lit = np.flatnonzero((light > 0.0) & np.isfinite(xy).all(axis=1) & (clump >= 0))
    lit = lit[np.lexsort((lit, -light[lit], clump[lit]))]  # of each clump the brightest first
    ids, first, count = np.unique(clump[lit], return_index=True, return_counts=True)
    if not len(ids):
        none = np.zeros(0, dtype=np.int64)
        return _Sources(none, np.zeros((0, 2)), np.zeros(0), np.zeros((0, 3)), none, none)
    total = np.add.reduceat(light[lit], first)
    centroid = np.add.reduceat(light[lit, None] * xy[lit], first) / total[:, None]
    brightest = lit[first]
    sigma = sigma[brightest]
    sigma[:, :2] = np.fmin(sigma[:, :2] * (light[brightest] / total)[:, None], LARGEST_SIGMA_PX)
    return _Sources(brightest, centroid, total, sigma, ids, count)


def draw_detections(truth: Table, n_target: int, instrument: Instrument, draws: Draws) -> Iterator[ImageRows]:
    """Draw the detections of each image of a truth table of one kind of sensor; n_target rows are of one image.

    The numbers of an image depend on its sensor, band and frame, and those of a target on its index, alone: not on what
    else is asked for.
    """
    camera = instrument.sensor.camera
    size = np.array([camera.n_col, camera.n_row])
    columns = {name: np.array(truth[name]) for name in ("frame", "sensor", "band", "target", *_NUMBERS)}
    faint, bound = {}, columns["irradiance_sigma_w_cm2"]
    behind = np.array(truth["background_w_cm2"]) if "background_w_cm2" in truth.colnames else np.zeros(len(truth))
    in_pixel, blind = behind.copy(), np.zeros(len(truth), dtype=bool)
    for band in np.unique(truth["band"]).tolist():  # bounds of a source as bright as the noise of a pixel
        own = columns["band"] == band
        in_pixel[own] += np.array(truth["snr_peak"])[own] * instrument.nei_w_cm2(band)
        full = in_pixel >= full_w_cm2(instrument, band)
        blind |= own & (behind >= full_w_cm2(instrument, band))
        columns["irradiance_w_cm2"][own & np.isinf(bound) & full] = 0.0  # all its pixels are: not seen
        faint[band] = source_sigma(PixelPsf(instrument.psf(band), camera.pixel_aspect), 1.0)
        # Of light within one pixel no position is known, and truth has no bound of its brightness either.
        bound[own & ~np.isfinite(bound)] = faint[band][2] * instrument.nei_w_cm2(band)
    for start in range(0, len(truth), n_target):
        rows = {name: values[start : start + n_target] for name, values in columns.items()}
        frame, sensor, band = int(rows["frame"][0]), str(rows["sensor"][0]), str(rows["band"][0])
        key = instrument.noise_key(instrument.index(sensor)) + draws.draw_seed
        sources = _merged_sources(rows)
        on_array = np.all((sources.xy_px >= -0.5) & (sources.xy_px < size - 0.5), axis=1)
        numbers = uniforms(key, f"detections {band}", frame, N_DRAW * n_target).reshape(-1, N_DRAW)[sources.target]
        measured, sigma, chosen = _drawn(sources, numbers, on_array, draws)
        clutter = _clutter(key, band, frame, draws, faint[band], instrument.nei_w_cm2(band), size)
        here = slice(start, start + n_target)
        if np.isfinite(behind[here]).any() and blind[here][np.isfinite(behind[here])].all():
            clutter = clutter[0][:0], clutter[1][:0]
        measured, sigma = (np.concatenate(pair) for pair in zip((measured, sigma), clutter, strict=True))
        names = rows["target"][sources.target[chosen]].tolist()
        none = np.zeros(len(measured) - len(chosen), dtype=np.int64)
        names += [""] * len(none)
        clump_id = np.concatenate([sources.clump_id[chosen], none - 1])
        n_merged = np.concatenate([sources.n_merged[chosen], none])
        poor = np.zeros(len(measured), dtype=bool)
        yield ImageRows(frame, sensor, band, measured[:, :2], measured[:, 2], sigma, names, clump_id, n_merged, poor)


def _drawn(
    sources: _Sources, numbers: F64, on_array: npt.NDArray[np.bool_], draws: Draws
) -> tuple[F64, F64, npt.NDArray[np.int64]]:
    """Position and light, (n, 3), and errors, (n, 3), of the sources that are detected, and which they are."""
    from scipy.special import ndtri

    deviates = ndtri(numbers[:, :3])
    measured = np.column_stack([sources.xy_px, sources.irradiance_w_cm2]) + sources.sigma * deviates
    if draws.probability is None:
        detected = measured[:, 2] >= draws.threshold_sigma * sources.sigma[:, 2]
    else:
        detected = numbers[:, 3] < draws.probability
    chosen = np.flatnonzero(detected & on_array)
    return measured[chosen], sources.sigma[chosen], chosen


def _clutter(
    key: int, band: str, frame: int, draws: Draws, faint: F64, nei_w_cm2: float, size: npt.NDArray[np.int64]
) -> tuple[F64, F64]:
    """Positions and light, and errors of false detections: even over the image, bright as noise above a threshold."""
    from scipy.special import ndtr, ndtri
    from scipy.stats import poisson

    if draws.clutter_per_image == 0.0:
        return np.zeros((0, 3)), np.zeros((0, 3))
    (first,) = uniforms(key, f"clutter {band}", frame, 1)
    count = int(poisson.ppf(first, draws.clutter_per_image))
    numbers = uniforms(key, f"clutter {band}", frame, 1 + 3 * count)[1:].reshape(-1, 3)
    snr = -ndtri(numbers[:, 2] * ndtr(-draws.threshold_sigma))
    light_sigma = faint[2] * nei_w_cm2
    light = snr * light_sigma
    across = np.fmin(np.outer(nei_w_cm2 / light, faint[:2]), LARGEST_SIGMA_PX)
    position = numbers[:, :2] * size - 0.5
    return np.column_stack([position, light]), np.column_stack([across, np.full(count, light_sigma)])
