"""GalSim: one drawImage per source on a small stamp, its pixels integrated by GalSim's own Fourier transforms."""

from __future__ import annotations

import galsim
import numpy as np

from benchmarks.peers.tables import AIRY_HALF_PX, GAUSSIAN_HALF_PX
from benchmarks.peers.work import AIRY_RADIUS_PX, SIGMA_PX, PeerWork


class GalsimPeer:
    """The pattern is convolved with the pixel once; each source is that profile with its light, at its position."""

    n_thread = 1

    def __init__(self, work: PeerWork, n_thread: int | None = None) -> None:
        self._work = work
        if work.psf == "gaussian":
            self._half_px, pattern = GAUSSIAN_HALF_PX, galsim.Gaussian(sigma=SIGMA_PX)
        else:
            self._half_px, pattern = AIRY_HALF_PX, galsim.Airy(lam_over_diam=AIRY_RADIUS_PX / 1.2196698912665045)
        self._profile = galsim.Convolve(pattern, galsim.Pixel(1.0))
        self._noise = galsim.GaussianNoise(galsim.BaseDeviate(5), sigma=1.0)

    def image_nei(self, frame: int) -> np.ndarray:
        """Noiseless image in units of the noise."""
        return self._image(frame).array

    def counts(self, frame: int) -> np.ndarray:
        """GalSim's noise, then clipped."""
        image, detector = self._image(frame), self._work.detector
        image.addNoise(self._noise)
        counts = image.array * np.float32(detector.gain) + np.float32(detector.offset + 0.5)
        return np.clip(counts, 0, detector.largest).astype(np.uint16)

    def _image(self, frame: int) -> galsim.Image:
        work, half = self._work, self._half_px
        image = galsim.ImageF(work.n_pixel, work.n_pixel, xmin=0, ymin=0, scale=1.0)
        for x, y, light in zip(work.x_px[frame], work.y_px[frame], work.light_nei[frame], strict=True):
            column, row = round(x), round(y)
            stamp = galsim.BoundsI(column - half, column + half, row - half, row + half) & image.bounds
            if stamp.isDefined():
                source = self._profile.withFlux(light)
                centre = galsim.PositionD(x, y)
                source.drawImage(image[stamp], method="no_pixel", center=centre, add_to_image=True)
        return image
