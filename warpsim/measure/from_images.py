"""Detections measured in images: sources that stand out, fitted, and matched with the truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from warpsim.measure.finding import background_of, find_points, noise_scale
from warpsim.measure.image_rows import ImageRows
from warpsim.measure.pixel_psf import PixelPsf
from warpsim.render.frameset import FrameSet
from warpsim.render.likelihood import IrradianceImage, irradiance_image

if TYPE_CHECKING:
    from astropy.table import Table

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Search:
    """How sources are found."""

    method: str
    threshold_sigma: float
    background_px: int
    """Side of the boxes of the background; 0: none is taken out."""
    match_px: float
    """How far from a target a detection may be that is called by its name."""


@dataclass(frozen=True)
class SkyImage:
    """An image less its background, over the NEI."""

    light: F64
    ok: npt.NDArray[np.bool_]
    nei_w_cm2: float
    _image: IrradianceImage
    _background_w_cm2: F64
    _scale: float = 1.0

    @classmethod
    def of(cls, frames: FrameSet, frame: int, sensor: str, band: str, background_px: int, what: str) -> SkyImage:
        """Return one image; InputError, as of `what`, if it was not rendered."""
        image, nei_w_cm2 = irradiance_image(frames, frame, sensor, band, what), frames.instrument.nei_w_cm2(band)
        ok = ~image.is_full
        light = image.light_w_cm2
        below = background_of(light, ok, background_px) if background_px else np.zeros_like(light)
        plain = cls((light - below) / nei_w_cm2, ok, nei_w_cm2, image, below)
        scale = noise_scale(plain.light, np.sqrt(plain.variance(np.zeros_like(light))), ok)
        return cls(plain.light, ok, nei_w_cm2, image, below, scale)

    def variance(self, light: F64) -> F64:
        """Variance of pixels that hold a light above the background; of an array that may have a margin."""
        margin = [((n - own) // 2,) * 2 for n, own in zip(light.shape, self.light.shape, strict=True)]
        return self._variance(light, np.pad(self._background_w_cm2, margin, mode="edge"))

    def variance_within(self, light: F64, window: tuple[slice, slice]) -> F64:
        """Variance of the pixels of a window that hold a light above the background."""
        return self._variance(light, self._background_w_cm2[window])

    def _variance(self, light: F64, background_w_cm2: F64) -> F64:
        sky = self._image.variance(background_w_cm2) / self.nei_w_cm2**2 * self._scale**2
        return np.asarray(sky + np.maximum(light, 0.0) * (self._image.shot_w_cm2 / self.nei_w_cm2))


def find_detections(
    frames: FrameSet, images: Sequence[tuple[int, str, str]], truth: Table, search: Search
) -> Iterator[ImageRows]:
    """Find the sources of images, each by frame, sensor and band; truth has the rows of these in their order."""
    instrument = frames.instrument
    camera, n_target = instrument.sensor.camera, len(frames.scenario.target_names)
    psfs = {band: PixelPsf(instrument.psf(band), camera.pixel_aspect) for _, _, band in images}
    for number, (frame, sensor, band) in enumerate(images):
        image = SkyImage.of(frames, frame, sensor, band, search.background_px, "detections")
        fit = find_points(image.light, image.variance, image.ok, psfs[band], search.threshold_sigma, search.method)
        rows = truth[number * n_target : (number + 1) * n_target]
        row = _nearest(fit.xy_px, rows, search.match_px)
        clump = np.asarray(rows["clump_id"])
        clump_id = np.where(row >= 0, clump[row], -1)
        names = np.where(row >= 0, np.asarray(rows["target"])[row], "").tolist()
        yield ImageRows(
            frame, sensor, band, fit.xy_px, fit.flux * image.nei_w_cm2,
            fit.sigma * np.array([1.0, 1.0, image.nei_w_cm2]), names, clump_id,
            np.where(clump_id >= 0, (clump_id[:, None] == clump).sum(axis=1), 0), fit.is_poor,
        )  # fmt: skip


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
