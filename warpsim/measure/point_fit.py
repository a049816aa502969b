"""Fits of point sources to an image: positions and light of all at once, with their covariance."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.measure.pixel_psf import GRID_PX, N_GRID, PixelPsf

N_STEP, N_ROUGH_STEP = 30, 8
"""Steps of a fit at most, and of one that others follow."""

LEAST_APART_PX = 1.1
"""Sources that are nearer than that, or than the blur is wide, are one."""

LARGEST_SIGMA_PX = 12.0**-0.5
"""Error of a position of which no more is known than its pixel."""

_SETTLED_PX = 1e-4
_STUCK = 1e3
"""Damping of sources that go nowhere any more."""
_LEAST_INFORMATION = 1e-6
"""Of a position that light does not depend on [1/px2]: nothing is known of it within a window."""
_GRID_STEP_PX = 2.0 * GRID_PX / (N_GRID - 1)
_POOR_SIGMA = 5.0
"""Chi-square of a window beyond its expectation from which on a fit is poor, by a neighbour, say."""
_NEAR_PX, _EDGE_PX = 3.0, 0.25
"""Where images are narrower than a pixel, a source that is this near another, and this far from its pixel's centre, may
be two: light of two neighbouring pixels is like that of one source between them."""
_WIDER = 1.1
"""Errors over those of a parabola from which on the likelihood is taken as no parabola."""


class PointFit(NamedTuple):
    """Fitted sources of an image."""

    xy_px: F64
    """(n, 2)."""
    flux: F64
    """In the image's unit, (n,)."""
    sigma: F64
    """Standard deviations of x, y and flux by the Fisher information of all sources together, (n, 3)."""
    is_poor: npt.NDArray[np.bool_]
    """Fits that one source does not explain, or two would as well: no more is known than the pixel, (n,)."""

    def where(self, chosen: npt.NDArray[np.int64]) -> PointFit:
        """Return some of the sources."""
        return PointFit(self.xy_px[chosen], self.flux[chosen], self.sigma[chosen], self.is_poor[chosen])


class PointFitter:
    """Fits sources by maximum likelihood, each within a pixel of where it was found.

    Weights follow the model, so that shot noise does not pull the fit. A state has x, y and flux of sources, (n, 3).

    Args:
        image: Light without background, (n_row, n_col).
        variance_of: Variance of pixels that hold a light; of an array with a margin around the image.
        ok: Pixels that count, (n_row, n_col).
        psf: Point spread function.
        pixel: Column and row that each source was found in, (n, 2).
    """

    def __init__(
        self,
        image: F64,
        variance_of: Callable[[F64], F64],
        ok: npt.NDArray[np.bool_],
        psf: PixelPsf,
        pixel: npt.NDArray[np.int64],
    ) -> None:
        half_x, half_y = psf.half_px
        margin = ((half_y, half_y), (half_x, half_x))
        self._psf, self._variance_of, self._pixel = psf, variance_of, pixel
        self._image, self._ok = np.pad(image, margin), np.pad(ok, margin)
        self._column, self._row = pixel[:, :1] + psf.window[0], pixel[:, 1:] + psf.window[1]
        self._flat = ((self._row + half_y) * self._image.shape[1] + self._column + half_x).astype(np.int64)

    def start(self, state: F64) -> F64:
        """Return a state for all sources, where the first have one: the likeliest position of a grid for each other."""
        n = len(state)
        at = self._psf.fractions(self._column[:n] - state[:, :1], self._row[:n] - state[:, 1:2])
        light = np.zeros(self._flat.shape)
        light[:n] = at * state[:, 2:]
        model = self._summed(light)
        flat = self._flat[n:]
        gain, flux, _ = self._on_grid(self._weight(model)[flat], (self._image.ravel() - model)[flat])
        best = np.argmax(gain, axis=1)
        flux = np.take_along_axis(flux, best[:, None], axis=1)
        return np.concatenate([state, np.concatenate([self._pixel[n:] + self._psf.grid[0][best], flux], axis=1)])

    def fit(self, state: F64, n_step: int = N_STEP) -> F64:
        """Return the likeliest state from a start (Levenberg and Marquardt, each source damped for itself)."""
        if not len(state):
            return state
        damping = np.full(len(state), 1e-3)
        residual, weight, slopes = self._linear(state)
        for _ in range(n_step):
            trial = state + self._step(slopes, weight, residual, damping)
            trial[:, :2] = np.clip(trial[:, :2], self._pixel - GRID_PX, self._pixel + GRID_PX)
            tried = self._residual(trial)
            better = (weight * tried**2)[self._flat].sum(axis=1) <= (weight * residual**2)[self._flat].sum(axis=1)
            moved_px = np.abs(trial - state)[better | (damping < _STUCK), :2].max(initial=0.0)
            damping = np.where(better, np.maximum(damping / 5.0, 1e-9), damping * 10.0)
            state = np.where(better[:, None], trial, state)
            residual, weight, slopes = self._linear(state)
            if moved_px < _SETTLED_PX:
                break
        return state

    def flux_sigma(self, state: F64) -> F64:
        """Return the error of each source's flux where all else is known, (n,)."""
        _, weight, slopes = self._linear(state)
        return np.asarray(1.0 / np.sqrt(np.maximum((weight[self._flat] * slopes[:, 2] ** 2).sum(axis=1), 1e-300)))

    def result(self, state: F64) -> PointFit:
        """Return a fitted state with its errors; those of positions are at most that of a pixel.

        Where pixels are wide the likelihood is flat between a pixel's edges, and no parabola: means over the grid then
        take the place of the likeliest position. Errors of a poor fit, or of one that may be of two sources, are those
        of a pixel.
        """
        if not len(state):
            return PointFit(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 3)), np.zeros(0, dtype=bool))
        residual, weight, slopes = self._linear(state)
        information = self._information(slopes, weight).toarray()
        sigma = np.sqrt(np.diag(np.linalg.inv(information))).reshape(-1, 3)
        light = residual[self._flat] + slopes[:, 2] * state[:, 2:]  # of each source alone
        mean, spread = self._averaged(weight[self._flat], light)
        wide = spread[:, :2] > np.maximum(_WIDER * sigma[:, :2], 2.0 * _GRID_STEP_PX)
        wide = np.concatenate([wide, wide.any(axis=1, keepdims=True)], axis=1)
        state, sigma = np.where(wide, mean, state), np.where(wide, np.maximum(spread, sigma), sigma)
        ok = weight[self._flat] > 0.0
        misfit = (weight * residual**2)[self._flat].sum(axis=1) / np.maximum(ok.sum(axis=1), 1)
        is_poor = misfit > 1.0 + _POOR_SIGMA * np.sqrt(2.0 / np.maximum(ok.sum(axis=1), 1))
        is_poor |= self._may_be_two(state[:, :2])
        sigma[:, :2] = np.where(is_poor[:, None], LARGEST_SIGMA_PX, np.minimum(sigma[:, :2], LARGEST_SIGMA_PX))
        return PointFit(state[:, :2], state[:, 2], sigma, is_poor)

    def _may_be_two(self, xy_px: F64) -> npt.NDArray[np.bool_]:
        """Whether the light of two pixels that a position is between may be of two sources, (n,)."""
        if self._psf.fwhm_px >= LEAST_APART_PX:
            return np.zeros(len(xy_px), dtype=bool)
        distance = np.linalg.norm(xy_px[:, None] - xy_px, axis=2)
        is_near = np.sum(distance <= _NEAR_PX, axis=1) > 1
        return np.asarray(is_near & (np.abs(xy_px - np.round(xy_px)).max(axis=1) > _EDGE_PX))

    def _averaged(self, weight: F64, light: F64) -> tuple[F64, F64]:
        """Mean and standard deviation of x, y and flux over the grid, by likelihood, (n, 3) each."""
        gain, flux, own = self._on_grid(weight, light)
        gain = gain - np.log(own)
        part = np.exp(0.5 * (gain - gain.max(axis=1, keepdims=True)))
        part /= part.sum(axis=1, keepdims=True)
        at = self._psf.grid[0]
        away, mean_flux = part @ at, (part * flux).sum(axis=1, keepdims=True)
        xy_variance = part @ at**2 - away**2
        flux_variance = (part * ((flux - mean_flux) ** 2 + 1.0 / own)).sum(axis=1, keepdims=True)
        spread = np.sqrt(np.maximum(np.concatenate([xy_variance, flux_variance], axis=1), 0.0))
        return np.concatenate([self._pixel + away, mean_flux], axis=1), spread

    def _on_grid(self, weight: F64, light: F64) -> tuple[F64, F64, F64]:
        """Twice the log likelihood, the flux and its information at each position of the grid, (n, m) each."""
        shape = self._psf.grid[1]
        across, own = (weight * light) @ shape.T, np.maximum(weight @ (shape**2).T, 1e-300)
        return np.maximum(across, 0.0) ** 2 / own, across / own, own

    def _weight(self, model: F64) -> F64:
        return np.asarray(self._ok.ravel() / self._variance_of(model.reshape(self._image.shape)).ravel())

    def _residual(self, state: F64) -> F64:
        at = self._psf.fractions(self._column - state[:, :1], self._row - state[:, 1:2])
        return self._image.ravel() - self._summed(at * state[:, 2:])

    def _linear(self, state: F64) -> tuple[F64, F64, F64]:
        """Image less model, weights, both flat, and derivatives of each source in its window, (n, 3, pixel)."""
        at, by_x, by_y = self._psf.with_slopes(self._column - state[:, :1], self._row - state[:, 1:2])
        flux = state[:, 2:]
        model = self._summed(at * flux)
        return self._image.ravel() - model, self._weight(model), np.stack([by_x * flux, by_y * flux, at], axis=1)

    def _summed(self, light: F64) -> F64:
        """Light of all windows on the image, flat."""
        return np.bincount(self._flat.ravel(), light.ravel(), minlength=self._image.size).astype(np.float64)

    def _information(self, slopes: F64, weight: F64, damping: F64 | float = 0.0) -> Any:
        """Fisher information of all sources, sparse, (3 n, 3 n); its diagonal grown by a damping of each."""
        from scipy.sparse import csc_array, diags_array

        weighted = slopes * np.sqrt(weight)[self._flat][:, None]
        row, n_pixel = np.broadcast_to(self._flat[:, None], slopes.shape), slopes.shape[2]
        ends = np.arange(0, slopes.size + 1, n_pixel)
        jacobian = csc_array((weighted.ravel(), row.ravel(), ends), shape=(self._image.size, len(ends) - 1))
        information = jacobian.T @ jacobian
        diagonal = information.diagonal().reshape(-1, 3)
        more = diagonal * (1e-9 + np.broadcast_to(damping, len(diagonal))[:, None])
        more += np.where(diagonal > 0.0, [_LEAST_INFORMATION, _LEAST_INFORMATION, 0.0], 1.0)
        return (information + diags_array(more.ravel())).tocsc()

    def _step(self, slopes: F64, weight: F64, residual: F64, damping: F64) -> F64:
        """The next step of all sources, (n, 3)."""
        from scipy.sparse.linalg import spsolve

        pull = np.einsum("nap,np->na", slopes, (weight * residual)[self._flat])
        return np.asarray(spsolve(self._information(slopes, weight, damping), pull.ravel())).reshape(-1, 3)


def source_sigma(psf: PixelPsf, flux: float, offset_px: tuple[float, float] = (0.0, 0.0)) -> F64:
    """Return the Cramer-Rao bounds of x, y and flux of one source in noise of unit variance, (3,).

    Args:
        psf: Point spread function.
        flux: Light of the source over the noise of a pixel.
        offset_px: Where it is from the middle of its pixel.
    """
    at, by_x, by_y = psf.with_slopes(psf.window[0] - offset_px[0], psf.window[1] - offset_px[1])
    slopes = np.stack([by_x * flux, by_y * flux, at])
    information = slopes @ slopes.T + np.diag([_LEAST_INFORMATION, _LEAST_INFORMATION, 0.0])
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information))))
