"""What streaks look like, in float64 and by other means than the kernels'."""

import numpy as np
from psf_oracles import FIRST_DARK_RING, annulus_transfer
from scipy import special

LATTICE_SUM = 9.033621683100950  # of 1 / r^3 over a square lattice without its origin


def legendre(coefficients, t):
    """Series at times t, shape (n_t, ...)."""
    return np.moveaxis(np.polynomial.legendre.legval(t, np.asarray(coefficients, dtype=np.float64)), -1, 0)


def fine_times(n_panel, order=10):
    """Gauss-Legendre panels over [-1, 1]: times, and weights of sum 1."""
    node, weight = np.polynomial.legendre.leggauss(order)
    start = 2 * np.arange(n_panel)[:, None] / n_panel - 1
    return (start + (node + 1) / n_panel).ravel(), np.tile(weight / (2 * n_panel), n_panel)


def even_times(n=10_000):
    """Evenly spaced samples: times and weights."""
    return (2 * np.arange(n) + 1) / n - 1, np.full(n, 1 / n)


def axis_fractions(position_px, n_pixel, sigma_px):
    """Fractions of n_pixel columns (or rows) of a unit Gaussian at each position, shape (n, n_pixel)."""
    edge = (np.arange(n_pixel + 1) - 0.5 - np.asarray(position_px)[:, None]) / sigma_px
    left, right = edge[:, :-1], edge[:, 1:]
    # Differences of the smaller tail keep their leading digits.
    return np.where(left > 0, special.ndtr(-left) - special.ndtr(-right), special.ndtr(right) - special.ndtr(left))


def gaussian_streak(xy_px, movement_px, brightness, sigma_px, shape, times, aspect=1.0):
    """Image of a unit source: a sum over times of rows times columns; aspect is a pixel's height over its width."""
    t, weight = times
    image = np.zeros(shape)
    for part in np.array_split(np.arange(len(t)), max(1, len(t) // 5000)):
        position = np.asarray(xy_px) + legendre(movement_px, t[part])
        rows = axis_fractions(position[:, 1], shape[0], sigma_px / aspect)
        rows *= (weight[part] * legendre(brightness, t[part]))[:, None]
        image += rows.T @ axis_fractions(position[:, 0], shape[1], sigma_px)
    return image


def airy_streak(xy_px, movement_px, brightness, radius_px, obscuration, shape, times, period_px=40.0):
    """Image of a unit source by its Fourier series: pupil's autocorrelation, pixel, and the path's own transform.

    The pattern is band-limited, so the series of a field that repeats every period_px is finite. What the neighbouring
    fields shed, w / r^3 each, is nearly constant and taken away.
    """
    t, weight = times
    lamf_px = radius_px / FIRST_DARK_RING
    n = int(period_px / lamf_px)
    number = np.arange(-n, n + 1)
    transfer = annulus_transfer(lamf_px * np.hypot(number, number[:, None]) / period_px, obscuration)
    transfer *= np.sinc(number / period_px) * np.sinc(number / period_px)[:, None]
    position = np.asarray(xy_px) + legendre(movement_px, t)
    waves = [np.exp(-2j * np.pi / period_px * np.outer(position[:, axis], number)) for axis in (0, 1)]
    field = transfer * (waves[1].T @ (waves[0] * (weight * legendre(brightness, t))[:, None]))
    pixels = [np.exp(2j * np.pi / period_px * np.outer(np.arange(size), number)) for size in shape]
    wing_px3 = lamf_px / np.pi**3 / (1 - obscuration)
    return (pixels[0] @ field @ pixels[1].T).real / period_px**2 - LATTICE_SUM * wing_px3 / period_px**3
