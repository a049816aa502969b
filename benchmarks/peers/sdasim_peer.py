"""sdasim: a scene simulator on PyTorch that adds a sampled Gaussian for each source, on the CPU here.

Its own functions, with its own defaults: a Gaussian is taken at the centres of pixels, not integrated over them, within
3 sigma, and each source is scaled so that its pixels have all its light. It has no Airy pattern.
"""

from __future__ import annotations

import numpy as np
import sdasim
import torch

from benchmarks.peers.work import SIGMA_PX, PeerWork


class SdasimPeer:
    """All sources at once by one scatter, then noise and conversion, image by image.

    Raises:
        ValueError: Work with another pattern than a Gaussian.
    """

    def __init__(self, work: PeerWork, n_thread: int | None = None) -> None:
        if work.psf != "gaussian":
            raise ValueError(f"sdasim draws Gaussians, not {work.psf}")
        if n_thread is not None:
            torch.set_num_threads(n_thread)  # of all that uses PyTorch in the process
        self.n_thread = torch.get_num_threads()
        self._work = work
        self._row_column = [
            torch.tensor(np.stack([y, x], axis=1), dtype=torch.float32)
            for x, y in zip(work.x_px, work.y_px, strict=True)
        ]
        self._light = [torch.tensor(light, dtype=torch.float32) for light in work.light_nei]

    def image_nei(self, frame: int) -> np.ndarray:
        """Noiseless image in units of the noise."""
        with torch.inference_mode():
            return np.asarray(self._image(frame).numpy())

    def counts(self, frame: int) -> np.ndarray:
        """Noise and converter of sdasim; the converter floors."""
        detector = self._work.detector
        with torch.inference_mode():
            image = sdasim.gaussian_noise(self._image(frame), 1.0)
            counts = sdasim.analog_to_digital(
                image,
                gain=1.0 / detector.gain,
                fwc=(detector.largest + 0.5) / detector.gain,
                bias=(detector.offset + 0.5) / detector.gain,
                dtype="uint16",
            )
            return counts.numpy().astype(np.uint16)

    def _image(self, frame: int) -> torch.Tensor:
        n_pixel = self._work.n_pixel
        return sdasim.splat_gaussians(n_pixel, n_pixel, self._row_column[frame], self._light[frame], SIGMA_PX)
