"""The sources of each frame, as the peers are given them, and what a peer is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

import warpsim as ws
from warpsim.speed.work import BAND, SpeedWork, speed_work

SIGMA_PX = 0.7
AIRY_RADIUS_PX = 1.5
"""Of the first dark ring, at every image size."""

PSFS = ("gaussian", "airy")

EXACT = {"optics__stamp_cut_nei": 1e-4, "optics__psf_error": 1e-6}
"""What images are compared with: the product at an accuracy that tests hold against quadrature."""

STAMPS = {
    "default": {"gaussian": {}, "airy": {}},
    "as the peers": {"gaussian": {"optics__stamp_cut_nei": 3e-4}, "airy": {"optics__stamp_cut_nei": 3e-3}},
}
"""Where the product's stamps end: by its default, or so far out that its worst pixel is about as good as a peer's."""


@dataclass(frozen=True)
class Detector:
    """Counts of a pixel: offset + gain * (light + unit noise), clipped; light in units of the noise."""

    offset: float
    gain: float
    largest: float


@dataclass(frozen=True)
class PeerWork:
    """One call of a SpeedWork, drawn as the peers draw it."""

    speed: SpeedWork
    x_px: list[np.ndarray]
    """Column of each source, frame by frame; whole numbers are centres of pixels."""
    y_px: list[np.ndarray]
    light_nei: list[np.ndarray]
    """Light of each source over the noise of a pixel."""
    detector: Detector

    @property
    def n_pixel(self) -> int:
        """Rows, and columns."""
        return self.speed.n_pixel

    @property
    def psf(self) -> str:
        """One of PSFS."""
        return self.speed.psf

    @property
    def n_source(self) -> int:
        """Sources of the fullest frame."""
        return max(map(len, self.x_px))

    def renderer(self, n_thread: int | None = None, **changes: Any) -> ws.Renderer:
        """The product, for this work, on the CPU; with changes to the scene."""
        return ws.Renderer(self.speed.scene.replace(**changes), "cpu", n_thread, self.speed.catalog)

    def signal_nei(self, frame: int, **changes: Any) -> np.ndarray:
        """Noiseless image by the product, (n_pixel, n_pixel)."""
        frames = self.renderer(1, **changes).render([frame], self.speed.sensors, [BAND], keep_signal=True)
        nei_w_cm2 = self.speed.scene.scenario.instrument.nei_w_cm2(BAND)
        return frames.signal_w_cm2.numpy()[0, 0, 0].astype(np.float64) / nei_w_cm2


class Peer(Protocol):
    """A program that draws the work, made for it and a number of threads; nothing of the making is timed."""

    n_thread: int
    """Threads it uses."""

    def image_nei(self, frame: int) -> np.ndarray:
        """Noiseless image in units of the noise, (n_pixel, n_pixel)."""

    def counts(self, frame: int) -> np.ndarray:
        """The image as it is read out, uint16, (n_pixel, n_pixel)."""


def peer_work(n_pixel: int, n_star: int, psf: str, stamps: str = "default", n_frame: int | None = None) -> PeerWork:
    """One sensor; a Gaussian of 0.7 px, or an Airy pattern of 1.5 px and one wavelength, at every image size.

    Args:
        n_pixel: Rows and columns.
        n_star: Stars in view, about.
        psf: One of PSFS.
        stamps: One of STAMPS.
        n_frame: Frames of a call; those of the SpeedWork when left out.
    """
    speed = speed_work(n_pixel, n_star, psf=psf, n_frame=n_frame)
    scene = speed.scene.replace(**STAMPS[stamps][psf])
    if psf == "airy":
        one = scene.replace(optics__n_interval=1)
        scale = one.scenario.instrument.psf(BAND).radii_px[0] / AIRY_RADIUS_PX
        scene = one.replace(optics__aperture_m=one.optics.aperture_m * scale)
    speed = SpeedWork(scene, speed.sensors, speed.catalog, speed.n_frame, n_star, psf)
    frames = ws.Renderer(scene, "cpu", catalog=speed.catalog).render(
        speed.frames(0), speed.sensors, [BAND], keep_stars=True
    )
    stars, truth, nei_w_cm2 = frames.stars, frames.truth, scene.scenario.instrument.nei_w_cm2(BAND)
    nei = scene.detector
    largest = min(2**nei.bits - 1, nei.offset_counts + nei.counts_per_nei * nei.dynamic_range)
    columns: dict[str, list[np.ndarray]] = {}
    for name in ("x_px", "y_px", "irradiance_w_cm2"):
        both = [_by_frame(truth, name, speed.n_frame), _by_frame(stars, name, speed.n_frame)]
        columns[name] = [np.concatenate(parts) for parts in zip(*both, strict=True)]
    light_nei = [light / nei_w_cm2 for light in columns["irradiance_w_cm2"]]
    return PeerWork(
        speed, columns["x_px"], columns["y_px"], light_nei, Detector(nei.offset_counts, nei.counts_per_nei, largest)
    )


def _by_frame(table: Any, name: str, n_frame: int) -> list[np.ndarray]:
    """A column cut into frames, whose rows follow each other."""
    ends = np.searchsorted(np.asarray(table["frame"]), np.arange(1, n_frame))
    return np.split(np.asarray(table[name], dtype=np.float64).ravel(), ends)
