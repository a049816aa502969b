"""The spectral bands that ship with warpsim, made when first asked for.

Their nodes and facts are two data files of warpsim_catalogs, `responses_v1.csv` and `responses_v1.toml`. The recipe is
in catalogs/README.md, the table of the bands with sources and errors in docs/reference/bands.md.
"""

from __future__ import annotations

import csv
import functools
import tomllib
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from warpsim_catalogs import path

from warpsim.radiometry.band import Band

if TYPE_CHECKING:
    from astropy.table import Table

Array = NDArray[np.float64]

_FILE = "responses_v1"


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


_COLUMNS = (
    *("name", "title", "isophotal_um", "lower_um", "upper_um", "per_photon"),
    *("zero_mag_jy", "zero_mag_w_cm2", "w_cm2_per_jy", "flux", "nominal_um", "vega_jy"),
    *("condensing_error", "source", "zero_point_source", "licence"),
)


@functools.cache
def _facts() -> dict[str, dict[str, Any]]:
    """Facts of every shipped band, by name."""
    with path(f"{_FILE}.toml").open("rb") as lines:
        return tomllib.load(lines)


@functools.cache
def _nodes() -> dict[str, tuple[Array, Array]]:
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


_BAND_FIELDS = ("isophotal_um", "zero_mag_jy", "zero_mag_w_cm2", "w_cm2_per_jy", "per_photon")
