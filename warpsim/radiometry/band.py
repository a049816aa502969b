"""A spectral band: relative response against wavelength, by energy or by photon, and quadratures over it."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arguments import plain_array, plain_number
from warpsim.arrays import F64
from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError, errors_at
from warpsim.radiometry.curve_nodes import (
    checked_curve,
    gauss_rule,
    half_power_um,
    photon_um,
    product_of_curves,
    response_rule,
)

# 12 nodes on pieces no wider than 2 % of their wavelength: exact to rounding above 50 K, 1e-8 at 3 K and 4 um, where
# the exponential falls by 10 decades within one piece.
_NODES_PER_PIECE = 12
_MAX_PIECE_LOG_WIDTH = 0.02

_UNITS = {"isophotal_um": "um", "zero_mag_jy": "Jy", "zero_mag_w_cm2": "W / cm2", "w_cm2_per_jy": "W / (cm2 Jy)"}

LARGEST_N_INTERVAL = 32
"""Spectral intervals of a band: far beyond what any smooth spectrum needs."""

AB_ZERO_JY = 3631.0
"""Flux density of AB magnitude 0 at all wavelengths [Jy] (Oke and Gunn 1983)."""

_W_CM2_UM_PER_JY = 1e-26 * SPEED_OF_LIGHT_M_S * 1e6 * 1e-4
"""Irradiance per wavelength of 1 Jy, times the wavelength squared [W um/cm2]: F_lambda = F_nu c / lambda^2."""


@dataclass(frozen=True, eq=False)
class Band:
    """A spectral band: relative response against wavelength, linear between its nodes and zero outside.

    `Band(name, wavelength_um, response)` is enough; the wavelengths and the half-power points then follow from the
    response, and the zero points are NaN (not known). The response is scaled to peak 1. Two bands are equal when all
    their numbers are.

    Of a zero point one number is enough, zero_mag_jy or zero_mag_w_cm2: their ratio is w_cm2_per_jy. If that is not
    given either, the flux density is the mean over the energy response by frequency, as most surveys quote it, so that
    `zero_mag_jy=3631` makes AB magnitudes.

    In-band irradiance is the integral of the energy response times the spectral irradiance. The energy response has
    peak 1: it is the response given, or with `per_photon` the response given times wavelength over `photon_um`. So a
    detector that counts photons collects in every spectrum the same number of electrons per in-band energy, its peak
    quantum efficiency times `photon_um` / (h c).

    Raises:
        InputError: Fewer than two nodes, shapes that differ, wavelengths not positive and increasing, values that are
            not finite, negative response, or no response at all; wavelengths outside the nodes, zero points not > 0.
    """

    name: str

    wavelength_um: F64
    """Nodes [um], shape (n,), increasing."""

    response: F64
    """Response relative to the peak, shape (n,): by energy (as amperes per watt), or by photon (as a quantum
    efficiency) with `per_photon`."""

    isophotal_um: float = math.nan
    """Isophotal wavelength [um]; if not given, the mean wavelength weighted by the energy response."""

    half_power_um: tuple[float, float] = (math.nan, math.nan)
    """Lower and upper half-power wavelength [um]; if not given, the outermost crossings of half the peak."""

    zero_mag_jy: float = math.nan
    """Flux density of a star of magnitude 0 [Jy]; of an MSX band, the mean over it by frequency."""

    zero_mag_w_cm2: float = math.nan
    """In-band irradiance of a star of magnitude 0 [W/cm2]."""

    w_cm2_per_jy: float = math.nan
    """In-band irradiance per flux density [W/cm2 per Jy], NaN without a zero point; if not given with one, that of the
    mean flux density by frequency."""

    per_photon: bool = False
    """Whether `response` is that per photon; per energy otherwise."""

    photon_um: float = field(init=False, repr=False)
    """Wavelength whose photons have the energy that the detector's electrons cost at peak quantum efficiency [um]: the
    ratio of photon response (peak 1) times wavelength to energy response (peak 1), the same at all wavelengths."""

    quadrature_um: tuple[F64, F64] = field(init=False, repr=False)
    """Quadrature nodes [um] and weights [um] (energy response included), shape (m,) each."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError("must be a text that is not empty", "name", self.name).of("band")
        with errors_at("", f"band {self.name}"):
            wavelength_um, response = checked_curve(self.wavelength_um, self.response, "response")
            if response.max() == 0.0:
                raise InputError("must be > 0 somewhere, got 0 everywhere", "response")
            if not isinstance(self.per_photon, bool):
                raise InputError("must be true or false", "per_photon", self.per_photon)
            numbers = {name: plain_number(getattr(self, name), unit, name) for name, unit in _UNITS.items()}
            edges_um = _edges_um(self.half_power_um)
            response /= response.max()
            self._put(wavelength_um=_frozen(wavelength_um), response=_frozen(response), **numbers)
            self._put(photon_um=photon_um(wavelength_um, response, self.per_photon))
            node_um, weight_um = response_rule(wavelength_um, response, _NODES_PER_PIECE, _MAX_PIECE_LOG_WIDTH)
            weight_um = self._by_energy(node_um, weight_um)
            self._put(quadrature_um=(_frozen(node_um), _frozen(weight_um)))
            if math.isnan(self.isophotal_um):
                self._put(isophotal_um=float(np.sum(weight_um * node_um) / np.sum(weight_um)))
            given = not math.isnan(edges_um[0])
            self._put(half_power_um=edges_um if given else half_power_um(wavelength_um, response))
            self._check_wavelengths()
            self._put(**complete_zero_point(numbers, self.flat_w_cm2_per_jy))

    def _put(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)  # the dataclass is frozen for everybody else

    def _check_wavelengths(self) -> None:
        first_um, last_um = (float(end) for end in self.wavelength_um[[0, -1]])
        low_um, high_um = self.half_power_um
        if not first_um <= self.isophotal_um <= last_um:
            raise InputError(f"must be in [{first_um:g}, {last_um:g}]", "isophotal_um", self.isophotal_um)
        if not first_um <= low_um <= high_um <= last_um:
            raise InputError(f"must rise in [{first_um:g}, {last_um:g}]", "half_power_um", self.half_power_um)

    @classmethod
    def top_hat(
        cls,
        name: str,
        lower_um: float,
        upper_um: float,
        *,
        per_photon: bool = False,
        zero_mag_jy: float = math.nan,
        zero_mag_w_cm2: float = math.nan,
    ) -> Band:
        """Return the band of response 1 between two wavelengths and 0 outside.

        Args:
            name: Of the band.
            lower_um: Lower edge [um], > 0.
            upper_um: Upper edge [um].
            per_photon: Whether the response is flat per photon, as of a constant quantum efficiency; per energy
                otherwise.
            zero_mag_jy: Flux density of a star of magnitude 0 [Jy]; 3631 for AB magnitudes.
            zero_mag_w_cm2: Its in-band irradiance [W/cm2]; each follows from the other.

        Raises:
            InputError: The edges are not finite, positive and increasing, or a zero point is not > 0.
        """
        edges_um: Any = [plain_number(lower_um, "um", "lower_um"), plain_number(upper_um, "um", "upper_um")]
        zero: Any = {"zero_mag_jy": zero_mag_jy, "zero_mag_w_cm2": zero_mag_w_cm2}
        return cls(name, edges_um, np.ones(2), per_photon=per_photon, **zero)

    @classmethod
    def from_curves(
        cls,
        name: str,
        *curves: tuple[ArrayLike, ArrayLike],
        per_photon: bool = True,
        zero_mag_jy: float = math.nan,
        zero_mag_w_cm2: float = math.nan,
    ) -> tuple[Band, float]:
        """Return the band of a product of curves, such as filter, telescope and quantum efficiency, and its peak.

        Args:
            name: Of the band.
            curves: Pairs of wavelengths [um], increasing, and values there, linear between them and 0 outside.
            per_photon: Whether the product is a response per photon, as with a quantum efficiency among the curves;
                per energy, as with a responsivity, otherwise.
            zero_mag_jy: Flux density of a star of magnitude 0 [Jy]; 3631 for AB magnitudes.
            zero_mag_w_cm2: Its in-band irradiance [W/cm2]; each follows from the other.

        Returns:
            The band, scaled to peak 1 and within 1e-6 of the product, of the fewest nodes that keep it there; and the
            largest value of the product, which is the peak of quantum efficiency times transmission.

        Raises:
            InputError: No curve, one that breaks a rule of Band, curves that do not overlap, or a product that is zero
                everywhere.
        """
        with errors_at("", f"band {name}"):
            wavelength_um, values = product_of_curves(curves)
        zero: Any = {"zero_mag_jy": zero_mag_jy, "zero_mag_w_cm2": zero_mag_w_cm2}
        return cls(name, wavelength_um, values, per_photon=per_photon, **zero), float(values.max())

    def __repr__(self) -> str:
        low_um, high_um = self.half_power_um
        kind = "photon" if self.per_photon else "energy"
        return f"Band({self.name!r}, {low_um:.4g} to {high_um:.4g} um, {len(self.response)} nodes by {kind})"

    @property
    def lit_um(self) -> tuple[float, float]:
        """First and last wavelength [um] next to which the response is above 0."""
        lit = np.flatnonzero(self.response > 0.0)
        low, high = max(lit[0] - 1, 0), min(lit[-1] + 1, len(self.response) - 1)
        return float(self.wavelength_um[low]), float(self.wavelength_um[high])

    @property
    def flat_w_cm2_per_jy(self) -> float:
        """In-band irradiance per flux density of a spectrum flat in frequency [W/cm2 per Jy]."""
        node_um, weight_um = self.quadrature_um
        return float(np.sum(weight_um * _W_CM2_UM_PER_JY / node_um**2))

    @property
    def ab_zero_mag_w_cm2(self) -> float:
        """In-band irradiance of AB magnitude 0 [W/cm2]: 3631 Jy at all wavelengths."""
        return AB_ZERO_JY * self.flat_w_cm2_per_jy

    def energy_response(self, wavelength_um: ArrayLike) -> F64:
        """Response by energy, of peak 1, at wavelengths [um] of any shape."""
        at_um = np.asarray(wavelength_um, dtype=np.float64)
        response = np.interp(at_um, self.wavelength_um, self.response, left=0.0, right=0.0)
        return self._by_energy(at_um, response)

    def intervals(self, n: int) -> tuple[F64, F64]:
        """Split the band into n spectral intervals, each of one wavelength and one weight.

        They are the Gauss quadrature with the energy response as weight function: sum(weight_um * f(wavelength_um)) is
        the integral of response times f, exact for polynomials f of degree 2n - 1, and close for smooth spectra (a
        table of errors is in docs/physics.md). The one interval of n = 1 sits at the mean wavelength weighted by the
        response. Where a response has a gap, an interval may fall into it.

        Args:
            n: How many, 1 to 32; the paper's sensor has 6.

        Returns:
            Wavelengths [um], increasing and inside the band, and weights [um], > 0, shape (n,) each; read-only.

        Raises:
            InputError: n is not a whole number from 1 to 32.
        """
        if isinstance(n, bool) or not isinstance(n, int | np.integer) or not 1 <= n <= LARGEST_N_INTERVAL:
            raise InputError(f"must be a whole number from 1 to {LARGEST_N_INTERVAL}", "n", n).of(f"band {self.name}")
        return _intervals(self, int(n))

    def _by_energy(self, wavelength_um: F64, values: F64) -> F64:
        """Values proportional to the given response, as those of the energy response."""
        return values * (wavelength_um / self.photon_um) if self.per_photon else values

    def _key(self) -> tuple[object, ...]:
        numbers = (self.isophotal_um, *self.half_power_um, self.zero_mag_jy, self.zero_mag_w_cm2, self.w_cm2_per_jy)
        nodes = (self.wavelength_um.tobytes(), self.response.tobytes(), self.per_photon)
        return self.name, nodes, np.array(numbers).tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Band) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())


def _edges_um(values: Any) -> tuple[float, float]:
    """Half-power wavelengths as given [um], both NaN or none."""
    edges_um = plain_array(values, "um", "half_power_um")
    if edges_um.shape != (2,):
        raise InputError("must be two numbers", "half_power_um", values)
    low_um, high_um = edges_um.tolist()
    if math.isnan(low_um) != math.isnan(high_um):
        raise InputError("must be two numbers, or left out", "half_power_um", values)
    return low_um, high_um


def _frozen(values: F64) -> F64:
    values.setflags(write=False)
    return values


@functools.lru_cache(maxsize=64)
def _intervals(band: Band, n: int) -> tuple[F64, F64]:
    """Gauss rule of n nodes for a band's response."""
    # Differences of wavelengths keep their digits, however narrow the band. n + 1 nodes per linear piece are exact for
    # every polynomial that the rule has to integrate, one more where the response is per photon.
    first_um = band.wavelength_um[0]
    offset_um, weight_um = response_rule(band.wavelength_um - first_um, band.response, n + 1 + band.per_photon)
    node_um, weight_um = gauss_rule(offset_um, band._by_energy(first_um + offset_um, weight_um), n)
    return _frozen(first_um + node_um), _frozen(weight_um)


ZERO_POINT = ("zero_mag_jy", "zero_mag_w_cm2", "w_cm2_per_jy")
"""Flux density and in-band irradiance of magnitude 0 [Jy] and [W/cm2], and their ratio [W/cm2 per Jy]."""

ZERO_POINT_RTOL = 0.01
"""How far given numbers may contradict each other: published ones are rounded, those of MSX by 0.4 %."""


def complete_zero_point(given: Mapping[str, float], flat_w_cm2_per_jy: float) -> dict[str, float]:
    """Return the numbers of a zero point, those that are NaN from the others and the ratio of a flat spectrum."""
    for name in ZERO_POINT:
        if not (math.isnan(given[name]) or 0.0 < given[name] < math.inf):
            raise InputError("must be > 0 and finite, or NaN", name, given[name])
    jy, w_cm2, per_jy = (given[name] for name in ZERO_POINT)
    if math.isnan(jy) and math.isnan(w_cm2):
        return {name: given[name] for name in ZERO_POINT}
    if math.isnan(per_jy):
        per_jy = flat_w_cm2_per_jy if math.isnan(jy) or math.isnan(w_cm2) else w_cm2 / jy
    jy, w_cm2 = (w_cm2 / per_jy if math.isnan(jy) else jy), (jy * per_jy if math.isnan(w_cm2) else w_cm2)
    if abs(w_cm2 / (jy * per_jy) - 1.0) > ZERO_POINT_RTOL:
        rule = f"must be zero_mag_jy times w_cm2_per_jy, {jy * per_jy:.4g}, within 1 %; leave out one of them"
        raise InputError(rule, "zero_mag_w_cm2", w_cm2)
    return dict(zip(ZERO_POINT, (jy, w_cm2, per_jy), strict=True))
