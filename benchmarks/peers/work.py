"""The sources of each frame, as the peers are given them, and what a peer is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

import warpsim as ws
from warpsim.speed.work import BAND, SpeedWork, speed_work

SIGMA_PX = 0.7
AIRY_RADIUS_PX = 1.5
"""Of the first dark ring, at every image size."""

PSFS = ("gaussian", "airy")

EXACT = {"optics__stamp_cut_nei": 1e-4, "optics__psf_error": 1e-6}
"""Reference for images: the product at an accuracy that tests hold against quadrature."""

STAMPS = ("default", "as exact")
"""Size of the product's stamps: its default, or that with which its worst pixel is as good as the peer's."""

CUTS_NEI = tuple(float(f"{0.2 * 10 ** (-0.125 * step):.2g}") for step in range(24))
"""Values of optics.stamp_cut_nei that are tried for it, 0.2 to 2.7e-4."""

LIST_CUT_NEI = 3e-3
"""With which sources outside the frame are listed, for the peers too."""


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

    def as_exact(self, peer_error_nei: float) -> PeerWork:
        """Return the work with the product's largest stamp cut that errs by no more than a peer.

        Args:
            peer_error_nei: Error of the peer's worst pixel in the first frame [noise].
        """
        exact = self.signal_nei(0, **EXACT)
        for cut_nei in CUTS_NEI:
            if np.abs(self.signal_nei(0, optics__stamp_cut_nei=cut_nei) - exact).max() <= peer_error_nei:
                break
        speed = replace(self.speed, scene=self.speed.scene.replace(optics__stamp_cut_nei=cut_nei))
        return replace(self, speed=speed)

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


def peer_work(n_pixel: int, n_star: int, psf: str, n_frame: int | None = None) -> PeerWork:
    """One sensor; a Gaussian of 0.7 px, or an Airy pattern of 1.5 px and one wavelength, at every image size.

    Args:
        n_pixel: Rows and columns.
        n_star: Stars in view, about.
        psf: One of PSFS.
        n_frame: Frames of a call; those of the SpeedWork when left out.
    """
    speed = speed_work(n_pixel, n_star, psf=psf, n_frame=n_frame)
    scene = speed.scene
    if psf == "airy":
        one = scene.replace(optics__n_interval=1)
        scale = one.scenario.instrument.psf(BAND).radii_px[0] / AIRY_RADIUS_PX
        scene = one.replace(optics__aperture_m=one.optics.aperture_m * scale)
    speed = SpeedWork(scene, speed.sensors, speed.catalog, speed.n_frame, n_star, psf)
    listed = scene.replace(optics__stamp_cut_nei=LIST_CUT_NEI)
    frames = ws.Renderer(listed, "cpu", catalog=speed.catalog).render(
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
