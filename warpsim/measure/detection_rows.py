"""Detections of images before their directions are known: drawn from truth, or found in pixels and fitted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.measure.finding import SkyImage, find_points
from warpsim.measure.pixel_psf import PixelPsf
from warpsim.measure.point_fit import LARGEST_SIGMA_PX, source_sigma
from warpsim.render.frameset import FrameSet
from warpsim.render.resolution import full_w_cm2
from warpsim.scene.instrument import Instrument
from warpsim.streams import uniforms

if TYPE_CHECKING:
    from astropy.table import Table

Rows = npt.NDArray[Any]

ROW = np.dtype(
    [
        ("image", np.int64),
        ("xy_px", np.float64, 2),
        ("irradiance_w_cm2", np.float64),
        ("sigma", np.float64, 3),
        ("target", np.int64),
        ("clump_id", np.int64),
        ("n_merged", np.int64),
        ("poor_fit", np.bool_),
    ]
)
"""A detection: number of its image among those asked for; errors of x, y [px] and irradiance [W/cm2]; index of its
target, clump of the truth, -1 for none; targets in the clump, 0 for none; whether one source does not explain the
pixels, or two would as well."""

N_DRAW = 4
"""Numbers drawn for each target: of x, y and light, and whether it is detected."""

_NUMBERS = ("irradiance_w_cm2", "clump_id", "x_px", "y_px", "x_sigma_px", "y_sigma_px", "irradiance_sigma_w_cm2")
"""Columns of the truth that sources are made of."""


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
class Search:
    """How sources are found."""

    method: str
    threshold_sigma: float
    background_px: int
    """Side of the boxes of the background; 0: none is taken out."""
    match_px: float
    """How far from a target a detection may be that is called by its name."""


def draw_detections(truth: Table, n_target: int, instrument: Instrument, draws: Draws) -> Iterator[Rows]:
    """Draw the detections of each image of a truth table of one kind of sensor; n_target rows are of one image.

    The numbers of an image depend on its sensor, band and frame, and those of a target on its index, alone: not on what
    else is asked for.
    """
    camera = instrument.sensor.camera
    size = np.array([camera.n_col, camera.n_row])
    columns = {name: np.array(truth[name]) for name in ("frame", "sensor", "band", *_NUMBERS)}
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
    for number, start in enumerate(range(0, len(truth), n_target)):
        here = slice(start, start + n_target)
        rows = {name: values[here] for name, values in columns.items()}
        frame, sensor, band = int(rows["frame"][0]), str(rows["sensor"][0]), str(rows["band"][0])
        key = instrument.noise_key(instrument.index(sensor)) + draws.draw_seed
        sources = _merged_sources(rows)
        numbers = uniforms(key, f"detections {band}", frame, N_DRAW * n_target).reshape(-1, N_DRAW)[sources["target"]]
        found = _drawn(sources, numbers, size, draws)
        known = np.isfinite(behind[here])
        if not known.any() or not blind[here][known].all():
            clutter = _clutter(key, band, frame, draws, faint[band], instrument.nei_w_cm2(band), size)
            found = np.concatenate([found, clutter])
        found["image"] = number
        yield found


def _merged_sources(rows: Mapping[str, npt.NDArray[Any]]) -> Rows:
    """Return the sources of one image: each clump of the truth is one, at the centroid of its light.

    Errors are the brightest target's, with the clump's light for its own.
    """
    light, clump, *rest = (rows[name] for name in _NUMBERS)
    xy, sigma = np.stack(rest[:2], axis=1), np.stack(rest[2:], axis=1)
    lit = np.flatnonzero((light > 0.0) & np.isfinite(xy).all(axis=1) & (clump >= 0))
    lit = lit[np.lexsort((lit, -light[lit], clump[lit]))]  # of each clump the brightest first
    ids, first, count = np.unique(clump[lit], return_index=True, return_counts=True)
    total, brightest = np.add.reduceat(light[lit], first), lit[first]
    sources = np.zeros(len(ids), ROW)
    sources["target"], sources["clump_id"], sources["n_merged"] = brightest, ids, count
    sources["xy_px"] = np.add.reduceat(light[lit, None] * xy[lit], first) / total[:, None]
    sources["irradiance_w_cm2"] = total
    sources["sigma"] = sigma[brightest]
    across = sources["sigma"][:, :2] * (light[brightest] / total)[:, None]
    sources["sigma"][:, :2] = np.fmin(across, LARGEST_SIGMA_PX)
    return sources


def _drawn(sources: Rows, numbers: F64, size: npt.NDArray[np.int64], draws: Draws) -> Rows:
    """The sources that are detected, with positions and light as drawn by their numbers, (n, N_DRAW)."""
    from scipy.special import ndtri

    errors = sources["sigma"] * ndtri(numbers[:, :3])
    drawn = sources.copy()
    drawn["xy_px"] += errors[:, :2]
    drawn["irradiance_w_cm2"] += errors[:, 2]
    if draws.probability is None:
        detected = drawn["irradiance_w_cm2"] >= draws.threshold_sigma * sources["sigma"][:, 2]
    else:
        detected = numbers[:, 3] < draws.probability
    on_array = np.all((sources["xy_px"] >= -0.5) & (sources["xy_px"] < size - 0.5), axis=1)
    return np.asarray(drawn[detected & on_array])


def _clutter(
    key: int, band: str, frame: int, draws: Draws, faint: F64, nei_w_cm2: float, size: npt.NDArray[np.int64]
) -> Rows:
    """False detections: even over the image, bright as noise above a threshold."""
    from scipy.special import ndtr, ndtri
    from scipy.stats import poisson

    if draws.clutter_per_image == 0.0:
        return np.zeros(0, ROW)
    (first,) = uniforms(key, f"clutter {band}", frame, 1)
    count = int(poisson.ppf(first, draws.clutter_per_image))
    numbers = uniforms(key, f"clutter {band}", frame, 1 + 3 * count)[1:].reshape(-1, 3)
    snr = -ndtri(numbers[:, 2] * ndtr(-draws.threshold_sigma))
    clutter = np.zeros(count, ROW)
    clutter["xy_px"] = numbers[:, :2] * size - 0.5
    clutter["sigma"][:, 2] = faint[2] * nei_w_cm2
    clutter["irradiance_w_cm2"] = light = snr * (faint[2] * nei_w_cm2)
    clutter["sigma"][:, :2] = np.fmin(np.outer(nei_w_cm2 / light, faint[:2]), LARGEST_SIGMA_PX)
    clutter["target"] = clutter["clump_id"] = -1
    return clutter


def find_detections(
    frames: FrameSet, images: Sequence[tuple[int, str, str]], truth: Table, search: Search
) -> Iterator[Rows]:
    """Find the sources of images, each by frame, sensor and band; truth has the rows of these in their order."""
    instrument = frames.instrument
    camera, n_target = instrument.sensor.camera, len(frames.scenario.target_names)
    psfs = {band: PixelPsf(instrument.psf(band), camera.pixel_aspect) for _, _, band in images}
    for number, (frame, sensor, band) in enumerate(images):
        image = SkyImage.of(frames, frame, sensor, band, search.background_px, "detections")
        fit = find_points(image.light, image.variance, image.ok, psfs[band], search.threshold_sigma, search.method)
        rows = truth[number * n_target : (number + 1) * n_target]
        target, clump = _nearest(fit.xy_px, rows, search.match_px), np.asarray(rows["clump_id"])
        found = np.zeros(len(target), ROW)
        found["image"], found["target"] = number, target
        found["xy_px"], found["irradiance_w_cm2"] = fit.xy_px, fit.flux * image.nei_w_cm2
        found["sigma"] = fit.sigma * np.array([1.0, 1.0, image.nei_w_cm2])
        found["clump_id"] = clump_id = np.where(target >= 0, clump[target], -1)
        found["n_merged"] = np.where(clump_id >= 0, (clump_id[:, None] == clump).sum(axis=1), 0)
        found["poor_fit"] = fit.is_poor
        yield found


def _nearest(xy_px: F64, rows: Table, most_px: float) -> npt.NDArray[np.int64]:
    """Row of the truth of each detection, -1 for none: nearest pairs first, no target twice.

    Only targets count whose light is above its error: fainter ones are not what was detected.
    """
    there = np.stack([rows["x_px"], rows["y_px"]], axis=1).astype(np.float64)
    bound = np.asarray(rows["irradiance_sigma_w_cm2"])
    seen = np.where(np.isfinite(bound), np.asarray(rows["irradiance_w_cm2"]) > bound, np.asarray(rows["snr"]) > 1.0)
    distance = np.linalg.norm(xy_px[:, None] - there, axis=2)
    distance[:, ~seen] = np.inf
    found = np.full(len(xy_px), -1, dtype=np.int64)
    pairs = np.argwhere(distance <= most_px)
    taken = np.zeros(len(there), dtype=bool)
    for one, row in pairs[np.argsort(distance[tuple(pairs.T)], kind="stable")].tolist():
        if found[one] < 0 and not taken[row]:
            found[one], taken[row] = row, True
    return found
