"""Spectral bands: the six of the MSX satellite's SPIRIT III radiometer, custom bands, and Planck radiance in them.

Zero points follow the MSX absolute calibration (Egan et al. 2003, MSX6 Explanatory Guide). The responses
(`msx_responses.csv`) are piecewise-linear nodes of the published relative spectral responses, energy based and with
peak 1; in-band integrals of blackbodies of 200-5800 K agree with the full curves to 0.3 %.
"""

from __future__ import annotations

import csv
import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.constants import BOLTZMANN_J_K, PLANCK_J_S, SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError
from warpsim.radiometry.quadrature import composite_rule, gauss_rule

Array = NDArray[np.float64]

RADIATION_1_W_M2_SR = 2.0 * PLANCK_J_S * SPEED_OF_LIGHT_M_S**2
"""2 h c^2 [W m2 / sr]: L = RADIATION_1 / lambda^5 / (exp(RADIATION_2 / (lambda T)) - 1)."""

RADIATION_2_M_K = PLANCK_J_S * SPEED_OF_LIGHT_M_S / BOLTZMANN_J_K

# 12 nodes on pieces no wider than 2 % of their wavelength: exact to rounding above 50 K, 1e-8 at 3 K and 4 um, where
# the exponential falls by 10 decades within one piece.
_NODES_PER_PIECE = 12
_MAX_PIECE_LOG_WIDTH = 0.02
LARGEST_N_INTERVAL = 32
"""Spectral intervals of a band: far beyond what any smooth spectrum needs."""

_CHUNK_ELEMENTS = 2_000_000
"""Temperatures times nodes evaluated at once, to bound memory (16 MB per temporary)."""


@dataclass(frozen=True, eq=False)
class Band:
    """A spectral band: relative response against wavelength, linear between its nodes and zero outside.

    `Band(name, wavelength_um, response)` is enough; the wavelengths and the half-power points then follow from the
    response, and the zero points are NaN (not known). The response is scaled to peak 1. Two bands are
    equal when all their numbers are.

    Raises:
        InputError: Fewer than two nodes, shapes that differ, wavelengths not positive and increasing, values that are
            not finite, negative response, or no response at all.
    """

    name: str

    wavelength_um: Array
    """Nodes [um], shape (n,), increasing."""

    response: Array
    """Energy response relative to the peak, shape (n,)."""

    isophotal_um: float = math.nan
    """Isophotal wavelength [um]; if not given, the mean wavelength weighted by the response."""

    half_power_um: tuple[float, float] = (math.nan, math.nan)
    """Lower and upper half-power wavelength [um]; if not given, the outermost crossings of half the peak."""

    zero_mag_jy: float = math.nan
    """Flux density of a star of magnitude 0 [Jy]; of an MSX band, the mean over it by frequency."""

    zero_mag_w_cm2: float = math.nan
    """In-band irradiance of a star of magnitude 0 [W/cm2]."""

    w_cm2_per_jy: float = math.nan
    """In-band irradiance per flux density, for a stellar spectrum [W/cm2 per Jy]."""

    _quadrature_um: tuple[Array, Array] = field(init=False, repr=False)
    """Quadrature nodes [um] and weights [um] (response included), shape (m,) each."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError("must be a text that is not empty", "name", self.name).of("band")
        try:
            wavelength_um, response = _checked_response(self.wavelength_um, self.response)
        except InputError as error:
            raise error.of(f"band {self.name}") from None
        response /= response.max()

        def put(attribute: str, value: Any) -> None:
            object.__setattr__(self, attribute, value)  # the dataclass is frozen for everybody else

        put("wavelength_um", _frozen(wavelength_um))
        put("response", _frozen(response))
        rule = composite_rule(wavelength_um, response, _NODES_PER_PIECE, _MAX_PIECE_LOG_WIDTH)
        put("_quadrature_um", (_frozen(rule[0]), _frozen(rule[1])))
        if math.isnan(self.isophotal_um):
            node_um, weight_um = self._quadrature_um
            put("isophotal_um", float(np.sum(weight_um * node_um) / np.sum(weight_um)))
        if math.isnan(self.half_power_um[0]):
            put("half_power_um", _half_power(wavelength_um, response))

    @property
    def peak_um(self) -> float:
        """Wavelength of the peak response [um]; the middle of a flat one."""
        at_peak = self.wavelength_um[self.response >= self.response.max() * (1 - 1e-9)]
        return float(0.5 * (at_peak[0] + at_peak[-1]))

    def intervals(self, n: int) -> tuple[Array, Array]:
        """Split the band into n spectral intervals, each of one wavelength and one weight.

        They are the Gauss quadrature with the response as weight function: sum(weight_um * f(wavelength_um)) is the
        integral of response times f, exact for polynomials f of degree 2n - 1, and close for smooth spectra (a table
        of errors is in docs/physics.md). The one interval of n = 1 sits at the mean wavelength weighted by the
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

    def _key(self) -> tuple[object, ...]:
        numbers = (self.isophotal_um, *self.half_power_um, self.zero_mag_jy, self.zero_mag_w_cm2, self.w_cm2_per_jy)
        return self.name, self.wavelength_um.tobytes(), self.response.tobytes(), np.array(numbers).tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Band) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())


def _frozen(values: Array) -> Array:
    values.setflags(write=False)
    return values


@functools.lru_cache(maxsize=64)
def _intervals(band: Band, n: int) -> tuple[Array, Array]:
    """Gauss rule of n nodes for a band's response, relative to its first wavelength while at work.

    Differences of wavelengths keep their digits, however narrow the band. n + 1 nodes per linear piece are exact for
    every polynomial that the rule has to integrate.
    """
    first_um = band.wavelength_um[0]
    offset_um, weight_um = gauss_rule(*composite_rule(band.wavelength_um - first_um, band.response, n + 1), n)
    return _frozen(first_um + offset_um), _frozen(weight_um)


def _checked_response(wavelength: ArrayLike, response: ArrayLike) -> tuple[Array, Array]:
    """Nodes of a response curve [um], and its values there, as given; copies."""
    wavelength_um, values = _nodes(wavelength, "wavelength_um"), _nodes(response, "response")
    if wavelength_um.shape != values.shape:
        got = f"{len(values)} and {len(wavelength_um)} nodes"
        raise InputError("must be as long as wavelength_um", "response", got, "s")
    if wavelength_um[0] <= 0.0:
        raise InputError("must be > 0", "wavelength_um", wavelength_um[0], "g")
    falls = np.flatnonzero(np.diff(wavelength_um) <= 0.0)
    if falls.size:
        k = int(falls[0])
        raise InputError(f"must increase, got {wavelength_um[k]:g} then {wavelength_um[k + 1]:g}", "wavelength_um")
    if values.min() < 0.0:
        raise InputError("must be >= 0", "response", values.min(), "g")
    if values.max() == 0.0:
        raise InputError("must be > 0 somewhere, got 0 everywhere", "response")
    return wavelength_um, values


def _nodes(values: ArrayLike, where: str) -> Array:
    """Copy to a float64 vector of at least two finite values."""
    try:
        vector = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"must be numbers, got {type(values).__name__}", where) from None
    if vector.ndim != 1 or vector.size < 2:
        raise InputError(f"must be a vector of at least 2 nodes, got shape {vector.shape}", where)
    if not np.isfinite(vector).all():
        node = int(np.flatnonzero(~np.isfinite(vector))[0])
        raise InputError(f"must be finite, got {vector[node]} at node {node}", where)
    return vector


def _half_power(wavelength_um: Array, response: Array) -> tuple[float, float]:
    """Return the outermost wavelengths at which the response is half its peak, or the ends if it stays above."""
    above = np.flatnonzero(response >= 0.5)
    low, high = int(above[0]), int(above[-1])
    low_um, high_um = float(wavelength_um[low]), float(wavelength_um[high])
    if low > 0:
        low_um = float(np.interp(0.5, response[low - 1 : low + 1], wavelength_um[low - 1 : low + 1]))
    if high < len(response) - 1:
        falling = slice(high + 1, high - 1 if high else None, -1)
        high_um = float(np.interp(0.5, response[falling], wavelength_um[falling]))
    return low_um, high_um


_MSX_ZERO_POINTS = {
    # isophotal um, half power um, zero magnitude Jy, zero magnitude W/cm2, W/cm2 per Jy
    "B1": (4.29, (4.22, 4.36), 194.6, 3.30e-16, 1.70e-18),
    "B2": (4.35, (4.24, 4.45), 188.8, 5.4e-16, 2.87e-18),
    "A": (8.28, (6.8, 10.8), 58.49, 8.196e-16, 1.401e-17),
    "C": (12.13, (11.1, 13.2), 26.51, 9.26e-17, 3.493e-18),
    "D": (14.65, (13.5, 15.9), 18.29, 5.69e-17, 3.109e-18),
    "E": (21.34, (18.2, 25.1), 8.80, 3.55e-17, 4.04e-18),
}


def _msx_bands() -> dict[str, Band]:
    """Join the shipped responses and the zero points."""
    nodes: dict[str, list[tuple[float, float]]] = {}
    text = files("warpsim.radiometry").joinpath("msx_responses.csv").read_text(encoding="ascii")
    for row in csv.DictReader(text.splitlines()):
        nodes.setdefault(row["band"], []).append((float(row["wavelength_um"]), float(row["response"])))
    bands = {}
    for name, zero_points in _MSX_ZERO_POINTS.items():
        wavelength_um, response = np.array(nodes[name]).T
        bands[name] = Band(name, wavelength_um, response, *zero_points)
    return bands


BANDS: Mapping[str, Band] = MappingProxyType(_msx_bands())
"""The MSX bands B1, B2, A, C, D, E by name."""


def as_band(band: Band | str) -> Band:
    """Return a band as it is, or the MSX band of that name.

    Raises:
        InputError: There is no band of that name.
    """
    if isinstance(band, Band):
        return band
    if not isinstance(band, str) or band not in BANDS:
        raise InputError(f"must be one of {', '.join(BANDS)} or a Band", "band", band)
    return BANDS[band]


def band_radiance_w_m2_sr(temperature_k: ArrayLike, band: Band | str) -> Any:
    """Radiance of a blackbody in a band: the integral of response times Planck's law over wavelength.

    Relative error below 1e-12 from 50 to 6000 K in the MSX bands. Values below the smallest double (a few K at short
    wavelengths) are 0.

    Args:
        temperature_k: Temperature [K], any shape, > 0 and finite.
        band: A Band, or the name of one in BANDS.

    Returns:
        Radiance [W/m2/sr], float64, shape of temperature_k (a float for a single number).

    Raises:
        InputError: A temperature that is not finite and > 0, or an unknown band.
    """
    node_um, weight_um = as_band(band)._quadrature_um
    try:
        temperature = np.asarray(temperature_k, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"must be numbers, got {type(temperature_k).__name__}", "temperature_k") from None
    bad = ~(np.isfinite(temperature) & (temperature > 0.0))
    if bad.any():
        raise InputError("must be finite and > 0", "temperature_k", temperature[bad][0], "g")
    node_m = node_um * 1e-6
    scale = weight_um * 1e-6 * RADIATION_1_W_M2_SR / node_m**5
    exponent_k = RADIATION_2_M_K / node_m
    flat = temperature.ravel()
    radiance = np.empty_like(flat)
    step = max(1, _CHUNK_ELEMENTS // len(node_m))
    for start in range(0, len(flat), step):
        # exp(-x) / (1 - exp(-x)) rather than 1 / (exp(x) - 1): it underflows to 0 where the other overflows.
        x = exponent_k / flat[start : start + step, None]
        with np.errstate(under="ignore"):
            radiance[start : start + step] = (np.exp(-x) / -np.expm1(-x)) @ scale
    return radiance.reshape(temperature.shape) if temperature.ndim else float(radiance[0])
