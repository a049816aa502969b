"""Slow, obvious integrals of point spread functions over pixels, which share no code with the package."""

import itertools

import numpy as np
from scipy import special

FIRST_DARK_RING = special.jn_zeros(1, 1)[0] / np.pi
"""Radius of the first dark ring of a round pupil, in lambda * F."""

ORACLE_ATOL = 1e-11


def airy_fraction(dx_px, dy_px, radius_px, obscuration, order, aspect=1.0):
    """Fraction of one pixel by a tensor Gauss-Legendre rule of the given order on the diffraction pattern."""
    lamf_px = radius_px / FIRST_DARK_RING
    node, weight = np.polynomial.legendre.leggauss(order)
    r_px = np.hypot(dx_px + 0.5 * node, aspect * (dy_px + 0.5 * node)[:, None])
    v = np.maximum(np.pi * r_px / lamf_px, 1e-12)
    amplitude = 2.0 * special.j1(v) / v
    if obscuration > 0.0:
        amplitude -= obscuration * 2.0 * special.j1(obscuration * v) / v
    irradiance = np.pi / (4.0 * lamf_px**2 * (1.0 - obscuration**2)) * amplitude**2
    return float(0.25 * aspect * weight @ irradiance @ weight)


def converged_airy_fraction(dx_px, dy_px, radius_px, obscuration, aspect=1.0):
    """Raise the order until two rules agree."""
    order = 24 + int(2.0 * max(1.0, aspect) / radius_px)
    coarse = airy_fraction(dx_px, dy_px, radius_px, obscuration, order, aspect)
    while True:
        order += 16
        fine = airy_fraction(dx_px, dy_px, radius_px, obscuration, order, aspect)
        if abs(fine - coarse) < ORACLE_ATOL:
            return fine
        coarse = fine


def disk_transfer(x):
    """Modulation transfer function of a round pupil, x in units of its cut-off."""
    x = np.minimum(x, 1.0)
    return 2.0 / np.pi * (np.arccos(x) - x * np.sqrt(1.0 - x * x))


def annulus_transfer(x, eps):
    """Modulation transfer function of an annular pupil (O'Neill 1956), x in units of its cut-off."""
    if eps == 0.0:
        return disk_transfer(x)
    inner = eps**2 * disk_transfer(x / eps)
    cosine = np.clip((1.0 + eps**2 - 4.0 * x**2) / (2.0 * eps), -1.0, 1.0)
    phi = np.arccos(cosine)
    cross = -2.0 * eps**2 + 2.0 * eps / np.pi * np.sin(phi) + (1.0 + eps**2) / np.pi * phi
    cross -= 2.0 * (1.0 - eps**2) / np.pi * np.arctan((1.0 + eps) / (1.0 - eps) * np.tan(0.5 * phi))
    cross = np.where(x <= 0.5 * (1.0 - eps), -2.0 * eps**2, np.where(x >= 0.5 * (1.0 + eps), 0.0, cross))
    return (disk_transfer(x) + inner + cross) / (1.0 - eps**2)


def fractions_by_spectrum(offsets_px, radii_px, weights, obscuration, smear_px, aspect, n_node=280, n_angle=220):
    """Fractions at offsets (dx [px], dy [pixel heights]) by the Fourier integral over the frequency plane."""
    node, gauss = np.polynomial.legendre.leggauss(n_node)
    turn, turn_gauss = np.polynomial.legendre.leggauss(n_angle)
    angle, angle_weight = 0.25 * np.pi * (1.0 + turn), 0.25 * np.pi * turn_gauss
    total = np.zeros(len(offsets_px))
    for radius_px, weight in zip(radii_px, weights, strict=True):
        lamf_px = radius_px / FIRST_DARK_RING
        end = min(1.0, 1.3 * lamf_px / smear_px) if smear_px else 1.0
        kinks = (0.0, obscuration, 0.5 * (1 - obscuration), 0.5 * (1 + obscuration), end)
        edges = sorted({x for x in kinks if x <= end})
        for low, high in itertools.pairwise(edges):
            x = low + 0.5 * (high - low) * (1.0 + node)
            nu = x / lamf_px
            radial = 0.5 * (high - low) / lamf_px * gauss * nu * annulus_transfer(x, obscuration)
            radial = radial * np.exp(-2.0 * (np.pi * smear_px * nu) ** 2)
            nu_x, nu_y = nu[:, None] * np.cos(angle), aspect * nu[:, None] * np.sin(angle)
            plane = 4.0 * aspect * radial[:, None] * angle_weight * np.sinc(nu_x) * np.sinc(nu_y)
            for k, (dx, dy) in enumerate(offsets_px):
                total[k] += weight * np.sum(plane * np.cos(2 * np.pi * nu_x * dx) * np.cos(2 * np.pi * nu_y * dy))
    return total / np.sum(weights)
