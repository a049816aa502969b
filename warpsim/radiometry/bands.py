"""The bands known by name, and Planck radiance in a band.

Zero points of the MSX bands follow the MSX absolute calibration (Egan et al. 2003, MSX6 Explanatory Guide). Their
responses are piecewise-linear nodes of the published relative spectral responses, energy based and with peak 1; in-band
integrals of blackbodies of 200-5800 K agree with the full curves to 0.3 %. docs/reference/bands.md lists all bands.
"""

from __future__ import annotations

import csv
import functools
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from warpsim_catalogs import path

from warpsim.arguments import plain_array
from warpsim.arrays import F64
from warpsim.constants import BOLTZMANN_J_K, PLANCK_J_S, SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError
from warpsim.radiometry.band import Band

if TYPE_CHECKING:
    from astropy.table import Table


_FILE = "responses_v1"
_COLUMNS = (
    *("name", "title", "isophotal_um", "lower_um", "upper_um", "per_photon"),
    *("zero_mag_jy", "zero_mag_w_cm2", "w_cm2_per_jy", "flux", "nominal_um", "vega_jy"),
    *("condensing_error", "source", "zero_point_source", "licence"),
)
_BAND_FIELDS = ("isophotal_um", "zero_mag_jy", "zero_mag_w_cm2", "w_cm2_per_jy", "per_photon")

RADIATION_1_W_M2_SR = 2.0 * PLANCK_J_S * SPEED_OF_LIGHT_M_S**2
"""2 h c^2 [W m2 / sr]: L = RADIATION_1 / lambda^5 / (exp(RADIATION_2 / (lambda T)) - 1)."""

RADIATION_2_M_K = PLANCK_J_S * SPEED_OF_LIGHT_M_S / BOLTZMANN_J_K

_CHUNK_ELEMENTS = 2_000_000
"""Temperatures times nodes evaluated at once, to bound memory (16 MB per temporary)."""


class ShippedBands(Mapping[str, Band]):
    """Shipped bands by name; a band is made, and the data files are read, on first access. Immutable."""

    def __init__(self, *names: str) -> None:
        """Take the bands of these names, in this order, or all of them."""
        self._names = names

    def __getitem__(self, name: str) -> Band:
        if name not in self:
            raise KeyError(f"no band of name {name!r}; there are {', '.join(self)}")
        return _band(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names or _facts())

    def __len__(self) -> int:
        return len(self._names or _facts())

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in (self._names or _facts())

    def __repr__(self) -> str:
        """List the bands: name, half-power wavelengths, title."""
        lines = [f"{len(self)} bands, by name, half power and title:"]
        for name, band in self.items():
            low_um, high_um = band.half_power_um
            lines.append(f"  {name:6} {low_um:6.3g} - {high_um:5.3g} um  {_facts()[name]['title']}")
        return "\n".join(lines)

    def to_table(self) -> Table:
        """Return the facts of the bands as an astropy Table, one band a row.

        Columns: name, title; isophotal_um, lower_um, upper_um (at half power) [um]; per_photon (whether the curve is by
        photon); zero_mag_jy [Jy], zero_mag_w_cm2 [W/cm2] and w_cm2_per_jy, NaN where there is no zero point; flux, how
        the survey quotes flux densities: "mean" over the band by frequency, or "nominal", that of nu F_nu = constant at
        nominal_um [um]; vega_jy, the zero point by Vega's spectrum [Jy]; condensing_error, the largest relative error
        of an in-band integral by the nodes; source, zero_point_source, licence.
        """
        from astropy.table import Table

        rows = []
        for name, band in self.items():
            facts = _facts()[name]
            zero_point = (band.zero_mag_jy, band.zero_mag_w_cm2, band.w_cm2_per_jy)
            wavelengths = (band.isophotal_um, *band.half_power_um)
            quoted = (facts.get("flux", ""), facts.get("nominal_um", np.nan), facts.get("vega_jy", np.nan))
            error = facts["condensing_error"]
            texts = (facts["source"], facts.get("zero_point_source", ""), facts["licence"])
            rows.append((name, facts["title"], *wavelengths, band.per_photon, *zero_point, *quoted, error, *texts))
        units = {"isophotal_um": "um", "lower_um": "um", "upper_um": "um", "nominal_um": "um"}
        units |= {"zero_mag_jy": "Jy", "vega_jy": "Jy", "zero_mag_w_cm2": "W / cm2", "w_cm2_per_jy": "W / (cm2 Jy)"}
        return Table(rows=rows, names=_COLUMNS, units=units)


@functools.cache
def _facts() -> dict[str, dict[str, Any]]:
    """Facts of every shipped band, by name."""
    with path(f"{_FILE}.toml").open("rb") as lines:
        return tomllib.load(lines)


@functools.cache
def _nodes() -> dict[str, tuple[F64, F64]]:
    """Wavelengths [um] and responses of every shipped band, by name."""
    nodes: dict[str, list[tuple[float, float]]] = {}
    text = path(f"{_FILE}.csv").read_text(encoding="ascii")
    for row in csv.DictReader(text.splitlines()):
        nodes.setdefault(row["band"], []).append((float(row["wavelength_um"]), float(row["response"])))
    return {
        name: (table[:, 0], table[:, 1]) for name, table in ((name, np.array(rows)) for name, rows in nodes.items())
    }


@functools.cache
def _band(name: str) -> Band:
    """Join the response and the zero point of a band."""
    facts = _facts()[name]
    given = {key: facts[key] for key in _BAND_FIELDS if key in facts}
    if "nominal_um" in facts:
        given.setdefault("isophotal_um", facts["nominal_um"])
    if "half_power_um" in facts:
        given["half_power_um"] = tuple(facts["half_power_um"])
    return Band(name, *_nodes()[name], **given)


BANDS: Mapping[str, Band] = ShippedBands("B1", "B2", "A", "C", "D", "E")
"""The MSX bands B1, B2, A, C, D, E by name."""

SHIPPED = ShippedBands()
"""All bands that ship with warpsim, by name."""


def bands() -> ShippedBands:
    """Return all bands that ship with warpsim, by name: MSX, WISE, IRAC, AKARI, IRAS, Gaia, 2MASS and so on.

    It is a read-only mapping that lists itself when shown, and `to_table()` makes an astropy Table of it.
    """
    return SHIPPED


def as_band(band: Band | str) -> Band:
    """Return a band as it is, or the shipped band of that name.

    Raises:
        InputError: There is no band of that name.
    """
    if isinstance(band, Band):
        return band
    if band not in SHIPPED:
        raise InputError(f"must be one of {', '.join(SHIPPED)} or a Band", "band", band)
    return SHIPPED[band]


def of_band(number: Callable[[Band], float]) -> Callable[[Band | str], float]:
    """Make a function of a band take the name of a shipped one too, and find each number once."""
    known = functools.lru_cache(maxsize=256)(number)

    @functools.wraps(number)
    def found(band: Band | str) -> float:
        return known(as_band(band))

    return found


def name_among(band: Band, known: Mapping[str, Band]) -> str | None:
    """Return the name that a band has among known ones, whatever its own; None where it is none of them."""
    alike = (name for name, one in known.items() if one.isophotal_um == band.isophotal_um)
    return next((name for name in alike if replace(band, name=name) == known[name]), None)


def planck_w_m2_sr_um(wavelength_um: ArrayLike, temperature_k: ArrayLike) -> NDArray[np.float64]:
    """Spectral radiance of a blackbody [W/m2/sr/um]; wavelengths [um] and temperatures [K] broadcast."""
    metres = np.asarray(wavelength_um, dtype=np.float64) * 1e-6
    # exp(-x) / (1 - exp(-x)) rather than 1 / (exp(x) - 1): it underflows to 0 where the other overflows.
    x = RADIATION_2_M_K / (metres * np.asarray(temperature_k))
    with np.errstate(under="ignore"):
        return np.asarray(RADIATION_1_W_M2_SR * 1e-6 / metres**5 * (np.exp(-x) / -np.expm1(-x)))


def band_radiance_w_m2_sr(temperature_k: ArrayLike, band: Band | str) -> Any:
    """Radiance of a blackbody in a band: the integral of response times Planck's law over wavelength.

    Relative error below 1e-12 from 50 to 6000 K in the MSX bands. Values below the smallest double (a few K at short
    wavelengths) are 0.

    Args:
        temperature_k: Temperature [K], any shape, > 0 and finite.
        band: A Band, or the name of a shipped one.

    Returns:
        Radiance [W/m2/sr], float64, shape of temperature_k (a float for a single number).

    Raises:
        InputError: A temperature that is not finite and > 0, or an unknown band.
    """
    node_um, weight_um = as_band(band).quadrature_um
    temperature = plain_array(temperature_k, "K", "temperature_k")
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
