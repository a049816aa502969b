"""Point sources in an image: background, significance, and passes from bright sources to faint ones."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.measure.pixel_psf import PixelPsf
from warpsim.measure.point_fit import LEAST_APART_PX, N_ROUGH_STEP, PointFit, PointFitter
from warpsim.render.frameset import FrameSet
from warpsim.render.likelihood import irradiance_image

Mask = npt.NDArray[np.bool_]

MOST_PASS = 6
_DYNAMIC_RANGE = 20.0
"""Sources fainter than the brightest one over it wait for the next pass, when the brighter ones are taken out."""
_MODEL_ERROR = 0.02
"""Part of the light of sources taken out that may be left over in a pixel."""
_CANDIDATE_SIGMA = 1.0
"""Candidates may lie that far below the threshold: the fit decides."""
_WING_SIGMA = 0.1
"""Light in a pixel, over its noise, that wings of sources are drawn down to."""
_CLIP_SIGMA, _N_CLIP = 3.0, 4
_MAD_SIGMA = 1.4826
_MORE_NOISE = 1.1
"""Measured noise over the detector's from which on the measured one counts: fixed patterns, say."""


@dataclass(frozen=True)
class SkyImage:
    """An image less its background, over the NEI."""

    light: F64
    ok: Mask
    nei_w_cm2: float
    _sky_variance: F64
    """Of pixels that hold the background alone, (n_row, n_col)."""
    _shot: float
    """Variance over light."""

    @classmethod
    def of(cls, frames: FrameSet, frame: int, sensor: str, band: str, background_px: int, what: str) -> SkyImage:
        """Return one image; InputError, as of `what`, if it was not rendered."""
        image, nei_w_cm2 = irradiance_image(frames, frame, sensor, band, what), frames.instrument.nei_w_cm2(band)
        ok, light_w_cm2 = ~image.is_full, image.light_w_cm2
        below = background_of(light_w_cm2, ok, background_px) if background_px else np.zeros_like(light_w_cm2)
        light, variance = (light_w_cm2 - below) / nei_w_cm2, image.variance(below) / nei_w_cm2**2
        measured = _clipped((light / np.sqrt(variance))[ok])[1]
        scale = measured if measured > _MORE_NOISE else 1.0
        return cls(light, ok, nei_w_cm2, variance * scale**2, image.shot_w_cm2 / nei_w_cm2)

    def variance(self, light: F64, window: tuple[slice, ...] = ()) -> F64:
        """Variance of pixels that hold a light above the background, of a window or of an array with a margin."""
        sky = self._sky_variance[window]
        margin = [((n - own) // 2,) * 2 for n, own in zip(light.shape, sky.shape, strict=True)]
        return np.asarray(np.pad(sky, margin, mode="edge") + np.maximum(light, 0.0) * self._shot)


def background_of(light: F64, ok: Mask, box_px: int) -> F64:
    """Return the background of an image: clipped medians of boxes, linear between their middles, (n_row, n_col)."""
    n_box = [max(1, round(n / box_px)) for n in light.shape]
    rows, columns = (np.linspace(0, n, k + 1).astype(int) for n, k in zip(light.shape, n_box, strict=True))
    median = np.zeros(n_box)
    for j in range(n_box[0]):
        for i in range(n_box[1]):
            box = slice(rows[j], rows[j + 1]), slice(columns[i], columns[i + 1])
            median[j, i] = _clipped(light[box][ok[box]])[0]
    hats = []
    for edges, n in ((rows, light.shape[0]), (columns, light.shape[1])):
        middle = 0.5 * (edges[:-1] + edges[1:] - 1)
        hats.append(np.stack([np.interp(np.arange(n), middle, row) for row in np.eye(len(middle))], axis=1))
    return np.asarray(hats[0] @ median @ hats[1].T)


def _clipped(values: F64) -> tuple[float, float]:
    """Median and standard deviation of values without outliers; 0 of none."""
    middle, sigma = 0.0, 0.0
    for _ in range(_N_CLIP):
        if not values.size:
            break
        middle = float(np.median(values))
        sigma = _MAD_SIGMA * float(np.median(np.abs(values - middle)))
        values = values[np.abs(values - middle) <= _CLIP_SIGMA * sigma]
    return middle, sigma


def find_points(
    light: F64, variance_of: Callable[[F64], F64], ok: Mask, psf: PixelPsf, threshold_sigma: float, method: str
) -> PointFit:
    """Find the sources of an image whose light is above a threshold.

    Each pass looks for sources in what those before leave over, and fits all of them together.

    Args:
        light: Light without background, (n_row, n_col).
        variance_of: Variance of pixels that hold a light.
        ok: Pixels that count.
        psf: Point spread function.
        threshold_sigma: Least fitted light over its error.
        method: One of FINDERS.
    """
    finder, nearest_px = FINDERS[method], max(LEAST_APART_PX, psf.fwhm_px)
    pixel, tried, state = np.zeros((0, 2), np.int64), np.zeros((0, 2), np.int64), np.zeros((0, 3))
    far, model = np.zeros_like(light), np.zeros_like(light)
    for _ in range(MOST_PASS if ok.any() else 0):
        sigma = np.sqrt(variance_of(model) + (_MODEL_ERROR * model) ** 2)
        found, strength = finder(light - model, sigma, ok, psf, threshold_sigma - _CANDIDATE_SIGMA)
        new = _far_from(found, state[:, :2], nearest_px) & _far_from(np.round(found), tried.astype(np.float64), 0.5)
        if not new.any():
            break
        bright = found[new & (strength >= strength[new].max() / _DYNAMIC_RANGE)]
        more = np.clip(np.round(bright), 0, np.array(light.shape[::-1]) - 1).astype(np.int64)
        pixel, tried = np.concatenate([pixel, more]), np.concatenate([tried, more])
        fitter = PointFitter(light - far, variance_of, ok, psf, pixel)
        state = fitter.fit(fitter.start(state), N_ROUGH_STEP)
        kept = state[:, 2] > (threshold_sigma - _CANDIDATE_SIGMA) * fitter.flux_sigma(state)
        pixel, state = pixel[kept], state[kept]
        near, model = (_drawn(state, psf, light.shape, variance_of, wings) for wings in (False, True))
        far = model - near
    fitter = PointFitter(light - far, variance_of, ok, psf, pixel)
    fit = fitter.result(fitter.fit(state))
    bright = np.flatnonzero(fit.flux >= threshold_sigma * fit.sigma[:, 2])
    bright = bright[np.lexsort((fit.xy_px[bright, 0], fit.xy_px[bright, 1]))]
    return fit.where(bright)


def _far_from(found: F64, known: F64, nearest_px: float) -> Mask:
    """Return which positions are farther than that from all known ones, (n,)."""
    distance = np.linalg.norm(found[:, None] - known, axis=2)
    return np.asarray(distance.min(axis=1, initial=np.inf) > nearest_px)


def _drawn(state: F64, psf: PixelPsf, shape: Any, variance_of: Callable[[F64], F64], wings: bool) -> F64:
    """Light of fitted sources, with their wings or within their windows."""
    image = np.zeros(shape)
    least = _WING_SIGMA * float(np.sqrt(variance_of(image).min()))
    for x, y, flux in state.tolist():
        reach = (psf.reach_px(flux, least),) * 2 if wings else psf.half_px
        column, row = round(x), round(y)
        rows = np.arange(max(row - reach[1], 0), min(row + reach[1] + 1, shape[0]))
        columns = np.arange(max(column - reach[0], 0), min(column + reach[0] + 1, shape[1]))
        image[np.ix_(rows, columns)] += flux * psf.fractions(*np.meshgrid(columns - x, rows - y))
    return image


def significance(light: F64, sigma: F64, ok: Mask, psf: PixelPsf) -> F64:
    """Return the light of a source in each pixel over its error, (n_row, n_col): the matched filter, best of phases."""
    from scipy.signal import fftconvolve

    weight = ok / sigma**2
    best = np.full(light.shape, -np.inf)
    for phase in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5)):
        kernel = psf.fractions(psf.window[0] - phase[0], psf.window[1] - phase[1])
        kernel = kernel.reshape(2 * psf.half_px[1] + 1, -1)[::-1, ::-1]
        own = fftconvolve(weight, kernel**2, mode="same")
        across = fftconvolve(weight * light, kernel, mode="same")
        np.maximum(best, across / np.sqrt(np.maximum(own, 1e-6 * own.max())), out=best)
    return best


def _by_matched_filter(light: F64, sigma: F64, ok: Mask, psf: PixelPsf, threshold: float) -> tuple[F64, F64]:
    """Local maxima of the significance, (n, 2), and their significance, (n,)."""
    from scipy.ndimage import maximum_filter

    value = significance(light, sigma, ok, psf)
    row, column = np.nonzero((value == maximum_filter(value, 3)) & (value >= threshold) & ok)
    return np.stack([column, row], axis=1).astype(np.float64), value[row, column]


def _by_sep(light: F64, sigma: F64, ok: Mask, psf: PixelPsf, threshold: float) -> tuple[F64, F64]:
    kernel = psf.fractions(*psf.window).reshape(2 * psf.half_px[1] + 1, -1)
    options = {"mask": ~ok, "minarea": 1, "filter_kernel": kernel, "deblend_cont": 1e-3}
    found = _library("sep").extract(np.ascontiguousarray(light), threshold, err=np.ascontiguousarray(sigma), **options)
    return np.stack([found["x"], found["y"]], axis=1), np.asarray(found["peak"], dtype=np.float64)


def _by_photutils(light: F64, sigma: F64, ok: Mask, psf: PixelPsf, threshold: float) -> tuple[F64, F64]:
    ranges = {"sharpness_range": (-np.inf, np.inf), "roundness_range": (-np.inf, np.inf)}
    finder = _library("photutils.detection").DAOStarFinder(threshold, psf.fwhm_px, **ranges)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that nothing was found
        found = finder(light / sigma, mask=~ok)
    if found is None:
        return np.zeros((0, 2)), np.zeros(0)
    return np.stack([found["x_centroid"], found["y_centroid"]], axis=1), np.asarray(found["peak"], dtype=np.float64)


FINDERS = {"matched_filter": _by_matched_filter, "sep": _by_sep, "photutils": _by_photutils}
"""How candidates are found: from light, its standard deviation and mask, above a threshold."""


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        package = name.split(".")[0]
        text = f"needs {package}, which the extra `detect` brings: pip install 'warpsim[detect]'"
        raise InputError(text, "method") from None
