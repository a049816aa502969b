"""The Airy pattern: its radial form, its sum over wavelengths, its blur, and what is left of it far out.

Airy, G. B. (1835), "On the diffraction of an object-glass with circular aperture"; annular pupil: Mahajan, V. N.,
"Optical Imaging and Aberrations II", chapter 3. The paper's Eq. 8 gives the dark-ring radius R = 1.22 lambda L / D.

At a focal ratio F and a pixel pitch p, lamF = lambda F / p [px], v = pi r / lamF and, for the linear obscuration eps,

    f(r) = pi / (4 lamF^2 (1 - eps^2)) * [jinc(v) - eps^2 jinc(eps v)]^2,     jinc(v) = 2 J1(v) / v,

is the irradiance [1/px2] of unit flux.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from warpsim.arrays import F64
from warpsim.optics.bessel import jinc
from warpsim.optics.flow import BLUR_REACH, STEP, FlowProfile, blurred, chunks, profile_from_values

FIRST_DARK_RING = 1.2196698912665045
"""First zero of J1 over pi: radius of the first dark ring of the unobscured pupil [lamF]."""

SPECTRAL_FROM = 16.0
"""A blur of more than this many lamF is taken of the spectrum, where the rings' scale does not matter any more."""


@dataclass(frozen=True, slots=True)
class AiryPattern:
    """A sum of Airy patterns, of unit flux together, blurred by a Gaussian."""

    lamf_px: tuple[float, ...]
    weight: tuple[float, ...]
    obscuration: float
    smear_px: float

    @property
    def scale_px(self) -> float:
        """Finest scale [px]: f holds next to nothing of more than 1 / scale_px periods per pixel width."""
        return max(min(self.lamf_px), 0.9 * self.smear_px)

    @property
    def wing_px3(self) -> float:
        """Coefficient of the ring-averaged f(r) ~ w / r^3 [px3].

        The amplitude is (2/v) [J1(v) - eps J1(eps v)]. The mean of J1(v)^2 is 1 / (pi v), that of eps^2 J1(eps v)^2 is
        eps / (pi v), and the cross term averages to zero; so w = lamF / pi^3 * (1 + eps) / (1 - eps^2).
        """
        mean_px = sum(w * lamf for w, lamf in zip(self.weight, self.lamf_px, strict=True))
        return mean_px / math.pi**3 / (1.0 - self.obscuration)

    def ripples_px3(self, r_px: float, pixel_px: float) -> float:
        """Return r^3 times what the wing leaves out of the mean over a pixel at distance r, an upper bound.

        With J1(v) ~ sqrt(2 / (pi v)) cos(v - 3 pi / 4) the squares ripple as often as 2 v and 2 eps v, with the
        amplitude of their means; the cross term splits into (1 + eps) v and (1 - eps) v. A ripple of frequency g [1/px]
        loses a factor pi g pixel_px across the pixel and exp(-2 pi^2 s^2 g^2) to the blur. Along the pixel's edge the
        rings stay in phase over sqrt(r / g), which helps near the source only.
        """
        total_px3 = 0.0
        for weight, lamf in zip(self.weight, self.lamf_px, strict=True):
            left = [
                amplitude
                * min(1.0, 1.0 / (math.pi * frequency * pixel_px))
                * min(1.0, 1.2 * math.sqrt(r_px / frequency) / pixel_px)
                * math.exp(-2.0 * (math.pi * self.smear_px * frequency) ** 2)
                for amplitude, frequency in _ripples(lamf, self.obscuration)
                if amplitude > 0.0
            ]
            total_px3 += weight * sum(left)
        return total_px3

    def flow(self, max_radius_px: float) -> FlowProfile:
        """Return the profile of the pattern's flow up to a radius [px]."""
        if self.smear_px == 0.0:
            return self._sharp_flow(max_radius_px)
        if self.smear_px > SPECTRAL_FROM * min(self.lamf_px):
            return self._spectral_flow(max_radius_px)
        sharp = self._sharp_flow(max_radius_px + BLUR_REACH * self.smear_px + 10.0 * STEP * self.scale_px)
        return blurred(sharp, self.smear_px, max_radius_px)

    def _sharp_flow(self, max_radius_px: float) -> FlowProfile:
        """Return the profile without the blur."""
        lamf_px = min(self.lamf_px)
        step_px = STEP * lamf_px
        r_px: F64 = step_px * np.arange(int(max_radius_px / step_px) + 6, dtype=np.float64)
        unit = _unit_flow(self.obscuration, 2 ** math.ceil(math.log2(max(r_px[-1] / lamf_px, 16.0))))
        value = np.zeros_like(r_px)
        for weight, lamf in zip(self.weight, self.lamf_px, strict=True):
            value += weight / lamf**2 * unit(r_px / lamf)
        return profile_from_values(value, step_px, lamf_px)

    def _spectral_flow(self, max_radius_px: float) -> FlowProfile:
        """Return g(r) = pi int T(n) exp(-2 pi^2 s^2 n^2) n jinc(2 pi n r) dn; T is the pupil's transfer function."""
        step_px = STEP * self.scale_px
        r_px: F64 = step_px * np.arange(int(max_radius_px / step_px) + 6, dtype=np.float64)
        highest = BLUR_REACH / (2.0 * math.pi * self.smear_px)
        node, gauss = np.polynomial.legendre.leggauss(64 + int(2.2 * 2.0 * highest * r_px[-1]))
        frequency = 0.5 * highest * (1.0 + node)
        transfer = sum(
            weight * annular_transfer(lamf * frequency, self.obscuration)
            for weight, lamf in zip(self.weight, self.lamf_px, strict=True)
        )
        blur = np.exp(-2.0 * (np.pi * self.smear_px * frequency) ** 2)
        weights = 0.5 * highest * gauss * np.pi * transfer * blur * frequency
        value = np.empty_like(r_px)
        for here in chunks(len(r_px), len(node)):
            value[here] = jinc(2.0 * np.pi * frequency * r_px[here, None]) @ weights
        return profile_from_values(value, step_px, self.scale_px)


def _ripples(lamf_px: float, eps: float) -> list[tuple[float, float]]:
    """Return (amplitude [px3], frequency [1/px]) of each term a / r^3 * cos(2 pi g r + const) of one wavelength."""
    unit_px3 = lamf_px / math.pi**3 / (1.0 - eps**2)
    frequency = 1.0 / lamf_px
    cross_px3 = 2.0 * math.sqrt(eps) * unit_px3
    return [
        (unit_px3, frequency),
        (eps * unit_px3, eps * frequency),
        (cross_px3, 0.5 * (1.0 - eps) * frequency),
        (cross_px3, 0.5 * (1.0 + eps) * frequency),
    ]


@lru_cache(maxsize=4)
def _unit_flow(obscuration: float, max_radius_lamf: float) -> FlowProfile:
    """Return the profile of the pattern with lamF = 1; all wavelengths and cameras share it."""
    n_cell = int(max_radius_lamf / STEP) + 5
    r = STEP * np.arange(n_cell + 1, dtype=np.float64)
    node, weight = np.polynomial.legendre.leggauss(3)
    # Summing E from the centre keeps its relative accuracy, which 1 - J0^2 - J1^2 loses near r = 0.
    ring = np.zeros(n_cell)
    for t, w in zip(node, weight, strict=True):
        inner = r[:-1] + 0.5 * STEP * (1.0 + t)
        ring += w * np.pi * STEP * irradiance_per_lamf2(inner, obscuration) * inner
    value = np.empty_like(r)
    value[0] = 0.5 * irradiance_per_lamf2(np.zeros(1), obscuration)[0]
    value[1:] = np.cumsum(ring) / (2.0 * np.pi * r[1:] ** 2)
    return profile_from_values(value, STEP, 1.0)


def irradiance_per_lamf2(r_lamf: F64, obscuration: float) -> F64:
    """Return f(r) of unit flux at lamF = 1."""
    v = np.pi * r_lamf
    amplitude = jinc(v) - obscuration**2 * jinc(obscuration * v) if obscuration > 0.0 else jinc(v)
    return np.pi / (4.0 * (1.0 - obscuration**2)) * amplitude**2


def annular_transfer(frequency: F64, obscuration: float) -> F64:
    """Return the modulation transfer function of the annular pupil; frequency in units of the cut-off 1 / lamF."""
    whole = _disk_overlap(frequency, 1.0)
    if obscuration == 0.0:
        return whole
    hole = _disk_overlap(frequency, obscuration, obscuration)
    return (whole + hole - 2.0 * _disk_overlap(frequency, 1.0, obscuration)) / (1.0 - obscuration**2)


def _disk_overlap(half_distance: F64, a: float, b: float | None = None) -> F64:
    """Return the area over pi that disks of radii a >= b share at a distance."""
    b = a if b is None else b
    d = 2.0 * np.maximum(half_distance, 1e-300)
    from_a = np.arccos(np.clip((d * d + a * a - b * b) / (2.0 * d * a), -1.0, 1.0))
    from_b = np.arccos(np.clip((d * d + b * b - a * a) / (2.0 * d * b), -1.0, 1.0))
    kite = np.maximum((a + b - d) * (d + a - b) * (d - a + b) * (d + a + b), 0.0)
    return np.asarray((a * a * from_a + b * b * from_b - 0.5 * np.sqrt(kite)) / np.pi)
