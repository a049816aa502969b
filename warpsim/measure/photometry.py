"""Photometry: light of a target as measured in images, where truth says that it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from warpsim.arguments import above_zero, chosen_names, whole_number
from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.measure.finding import SkyImage
from warpsim.measure.pixel_psf import PixelPsf
from warpsim.render.frameset import FrameSet

if TYPE_CHECKING:
    from astropy.table import Table

Method = Literal["psf", "aperture"]

BLENDED_SIGMA = 0.3
"""Light of other targets, over the error of what is measured, from which on it is called blended."""


def photometry(
    frames: FrameSet,
    target: str,
    sensors: str | Sequence[str] | None = None,
    bands: str | Sequence[str] | None = None,
    *,
    method: Method = "psf",
    radius_px: float = 3.0,
    background_px: int = 32,
) -> Table:
    """Return a light curve of a target as images give it, one row per image that the target is in.

    Light is the sum of a p over that of a f: p the pixels less the background, f the part of the target's light that
    each holds, as it is drawn, streaks included. With "psf" a = f / variance, which has the least error; with
    "aperture" a is 1 within a radius. Positions are those of the truth; what `detections` finds has positions and light
    of its own. Light of stars is not distinguished from the target's.

    Columns: frame, time_s, sensor, band, target, x_px, y_px, irradiance_w_cm2 and irradiance_sigma_w_cm2 as measured,
    snr, their ratio; truth_w_cm2, what was drawn; others_w_cm2, what other targets add to the measured light; blended,
    that this is more than 0.3 sigma; full_px, pixels left out as they are full. Where all are, light is NaN.

    Args:
        frames: Rendered frames.
        target: Name of the target.
        sensors: Some of those of the frames; all when left out.
        bands: Some of those of the frames; all when left out.
        method: "psf" or "aperture".
        radius_px: Of the aperture, in widths of a pixel; at least half a pixel's diagonal.
        background_px: Side of the boxes whose medians are the background; 0 for none.

    Raises:
        InputError: An unknown name or method, or a number out of range.
    """
    if method not in get_args(Method):
        raise InputError(f"must be one of {', '.join(get_args(Method))}", "method", method)
    radius, box_px = above_zero("radius_px", radius_px), whole_number("background_px", background_px, 0)
    least_px = 0.5 * math.hypot(1.0, frames.instrument.sensor.camera.pixel_aspect)
    if method == "aperture" and radius < least_px:
        raise InputError(f"must be at least {least_px:.3f}, to hold the centre of a pixel", "radius_px", radius_px)
    names = frames.scenario.target_names
    number = names.index(chosen_names("target", [target], names)[0])
    sensor_list = chosen_names("sensors", sensors, frames.sensors)
    band_list = chosen_names("bands", bands, frames.bands)
    truth = frames.truth
    seen = (truth["target"] == target) & truth["in_fov"] & ~truth["occulted"] & (truth["irradiance_w_cm2"] > 0.0)
    seen &= np.isin(truth["sensor"], sensor_list) & np.isin(truth["band"], band_list)
    rows, camera = truth[seen], frames.instrument.sensor.camera
    psfs = {band: PixelPsf(frames.instrument.psf(band), camera.pixel_aspect) for band in band_list}
    measured = np.zeros((len(rows), 4))
    for index, row in enumerate(rows):
        band, own = str(row["band"]), float(row["irradiance_w_cm2"])
        reach_px = psfs[band].half_px if method == "psf" else (radius, radius / camera.pixel_aspect)
        window = _window(row, reach_px, (camera.n_row, camera.n_col))
        image = SkyImage.of(frames, int(row["frame"]), str(row["sensor"]), band, box_px, "photometry")
        planes = _planes(frames, row, window) / image.nei_w_cm2
        variance = image.variance(planes.sum(axis=0), window)
        fraction, ok = planes[number] * (image.nei_w_cm2 / own), image.ok[window]
        if method == "aperture":
            down, across = np.ogrid[window]
            away2 = (across - row["x_px"]) ** 2 + (camera.pixel_aspect * (down - row["y_px"])) ** 2
            factor = ok * (away2 <= radius**2)
        else:
            factor = ok * fraction / variance
        total = np.sum(factor * fraction)
        others = np.delete(planes, number, axis=0).sum(axis=0)
        sums = [np.sum(factor * image.light[window]), np.sqrt(np.sum(factor**2 * variance)), np.sum(factor * others)]
        measured[index] = *(np.array(sums) * (image.nei_w_cm2 / total) if total > 0.0 else [np.nan] * 3), np.sum(~ok)
    return _table(rows, measured)


def _window(row: Any, reach_px: Sequence[float], shape: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns about a target of a row of the truth, its movement included."""
    parts = []
    for axis, size in ((1, shape[0]), (0, shape[1])):
        middle, moved = (float(row[f"{letter}{'xy'[axis]}_px"]) for letter in ("", "d"))
        reach = reach_px[axis] + 0.5 * abs(moved)
        parts.append(slice(max(0, math.floor(middle - reach)), min(size, math.ceil(middle + reach) + 1)))
    return parts[0], parts[1]


def _planes(frames: FrameSet, row: Any, window: tuple[slice, slice]) -> F64:
    """Light of each target in a window of an image, as drawn [W/cm2], (n_target, n_row, n_col)."""
    view, band = frames.image_numbers("photometry", int(row["frame"]), str(row["sensor"]), str(row["band"]))
    n_target = len(frames.scenario.target_names)
    origin = np.tile([window[1].start, window[0].start], (n_target, 1))
    shape = tuple(part.stop - part.start for part in window)
    drawn = frames.target_light.planes(band, np.full(n_target, view), np.arange(n_target), origin, shape)
    return np.asarray(drawn, dtype=np.float64)


def _table(rows: Table, measured: F64) -> Table:
    """Rows of the truth with what was measured."""
    table = rows["frame", "time_s", "sensor", "band", "target", "x_px", "y_px"]
    light, sigma, others, full = measured.T
    table["irradiance_w_cm2"], table["irradiance_sigma_w_cm2"] = light, sigma
    table["snr"] = light / sigma
    table["truth_w_cm2"], table["others_w_cm2"] = np.asarray(rows["irradiance_w_cm2"]), others
    table["blended"] = ~(others <= BLENDED_SIGMA * sigma)
    table["full_px"] = full.astype(np.int64)
    for name in table.colnames:
        if name.endswith("_w_cm2"):
            table[name].unit = "W / cm2"
    return table
