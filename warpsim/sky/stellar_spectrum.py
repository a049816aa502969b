"""Light of stars in any band: a template spectrum times a smooth factor that meets the fluxes measured.

A star has a colour temperature T, a luminosity class, and irradiances in some bands, its anchors. Its spectrum is the
template of T and class times a factor of wavelength. The factor is linear in ln(wavelength) between the isophotal
wavelengths of the anchors and constant beyond them. Its values there follow from the condition that the spectrum has
the anchors' irradiances: a broad band sees the factor change across it, so that the values are not simply measured
irradiance over template irradiance.

Linear, and not linear in its logarithm: then a flux of 0 is a flux like others, the light in a band is a sum over
anchors of numbers known in advance, and in stars left out of the fit the error is no larger (docs/physics.md).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64, I64
from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.sky.photometric_bands import photometric_bands
from warpsim.sky.stellar_templates import DWARF, GIANT, band_nodes, check_reach, mixture

VALID_UM = (0.3, 30.0)
"""Half-power points of bands in which the light of stars is known [um]."""

SURVEY_SCALE = {"IRAS12": 1.024, "IRAS25": 1.06}
"""Absolute scale of a survey over that of the other infrared ones, on which the templates rest (Cohen et al. 1992, AJ
104, 1650); 1 where left out."""

SAME_WAVELENGTH = 1.1
"""Anchors whose wavelengths are closer than this ratio make one: their factors would differ by noise alone, which a
line through both would carry far beyond them."""

N_CORRECTION = 4
"""Rounds of the correction of the factor: each leaves about a third of the difference between the irradiances measured
and those of the spectrum."""

LEAST_CORRECTION = 0.6
"""Least ratio of the factor at a knot to the mean wanted there. Next to a band that is brighter by magnitudes a linear
factor takes all of an anchor's light from its edge on that side, and leaves none at the other; one linear in its
logarithm, which very red stars have rather, stays above 0.7 at a ratio of 100."""

_CHUNK_STARS = 1 << 14
"""Stars worked on at once: their numbers stay in the processor's cache, and memory is bounded."""


@dataclass(frozen=True)
class BandTables:
    """What the light of stars with the same anchors follows from."""

    light: F64
    """Integrals of energy response times template times hat: in the band and in each anchor, by knot of the factor,
    shape (n_class, n_temperature, 1 + n_anchor, n_knot). The factor is the sum of its values at the knots times hats,
    which are 1 at their own knot and 0 at the others; hats add up to 1."""

    knot: tuple[int, ...]
    """Knot of each anchor."""

    part: tuple[float, ...]
    """Weight of each anchor in the mean over those of its knot."""


def band_irradiance_w_cm2(
    band: Band, flux_jy: Mapping[str, F64], temperature_k: F64, luminosity: NDArray[np.integer]
) -> F64:
    """In-band irradiance of stars [W/cm2], shape (n_star,), from their fluxes in photometric bands; NaN without any.

    Unknown fluxes are NaN; temperatures are as mixture() takes them, and any luminosity but DWARF is a giant's.
    """
    check_band(band)
    known_bands = photometric_bands()
    names = sorted(flux_jy, key=lambda name: known_bands[name].isophotal_um)
    light = np.full(len(temperature_k), np.nan)
    for start in range(0, len(light), _CHUNK_STARS):
        rows = slice(start, start + _CHUNK_STARS)
        fluxes = {name: flux_jy[name][rows] for name in names}
        for anchors, stars in _kinds(fluxes):
            tables = band_tables(band, tuple(known_bands[name] for name in anchors))
            irradiance = [fluxes[name][stars] * calibration_w_cm2_per_jy(name) for name in anchors]
            of_class = np.where(luminosity[rows][stars] == DWARF, DWARF, GIANT)
            light[rows][stars] = _light(tables, irradiance, temperature_k[rows][stars], of_class)
    return light


def check_band(band: Band) -> None:
    """Raise InputError unless the light of stars is known in a band, within its half-power points and without."""
    low_um, high_um = band.half_power_um
    if low_um < VALID_UM[0] or high_um > VALID_UM[1]:
        rule = f"must lie within {VALID_UM[0]:g} to {VALID_UM[1]:g} um, where the spectra of stars are known, got "
        raise InputError(f"{rule}{low_um:g} to {high_um:g} um", "half_power_um").of(f"band {band.name}")
    check_reach(band)


def calibration_w_cm2_per_jy(name: str) -> float:
    """Irradiance per flux density of a photometric band on the common scale of the surveys [W/cm2 per Jy]."""
    return photometric_bands()[name].w_cm2_per_jy / SURVEY_SCALE.get(name, 1.0)


def _kinds(values: Mapping[str, F64]) -> list[tuple[tuple[str, ...], I64]]:
    """Stars with the same anchors: names of the bands, in order of wavelength, and the rows of the stars."""
    if not values:
        return []
    known = np.stack([np.isfinite(column) for column in values.values()])
    names = list(values)
    if {"G", "BP", "RP"} <= values.keys():  # the two halves say all that the whole says, and more
        known[names.index("G")] &= ~(known[names.index("BP")] & known[names.index("RP")])
    codes, kind = np.unique((1 << np.arange(len(names))) @ known, return_inverse=True)
    by_kind = np.argsort(kind, kind="stable")
    ends = np.searchsorted(kind[by_kind], np.arange(len(codes) + 1))
    kinds = []
    for number, code in enumerate(codes.tolist()):
        anchors = tuple(name for k, name in enumerate(names) if code >> k & 1)
        if anchors:
            kinds.append((anchors, by_kind[ends[number] : ends[number + 1]]))
    return kinds


def _light(tables: BandTables, irradiance_w_cm2: Sequence[F64], temperature_k: F64, luminosity: I64) -> F64:
    """Irradiance in the band [W/cm2], shape (n,), from those in the anchors, each (n,)."""
    n_knot, anchors = tables.light.shape[-1], range(len(irradiance_w_cm2))
    by_knot = _mixed_columns(tables.light, temperature_k, luminosity)
    wanted: list[F64] = [np.zeros(len(temperature_k)) for _ in range(n_knot)]
    mixing: dict[tuple[int, int], F64] = {}
    for anchor, knot, part in ((anchor, tables.knot[anchor], tables.part[anchor]) for anchor in anchors):
        of_knots = {k: by_knot[anchor + 1, k] for k in range(n_knot) if (anchor + 1, k) in by_knot}
        scale = part / sum(of_knots.values())
        wanted[knot] = wanted[knot] + irradiance_w_cm2[anchor] * scale
        for k, light in of_knots.items():
            added = light * scale
            mixing[knot, k] = mixing[knot, k] + added if (knot, k) in mixing else added
    factor = _factor(wanted, mixing)
    return np.asarray(sum(by_knot[0, k] * factor[k] for k in range(n_knot) if (0, k) in by_knot))


def _mixed_columns(values: F64, temperature_k: F64, luminosity: I64) -> dict[tuple[int, int], F64]:
    """Numbers of stars mixed from those of the templates, by their last two indices; those that are 0 are left out.

    What mixed() does, a column at a time: ten times faster for so few numbers a star.
    """
    lower, weight = mixture(temperature_k)
    row = luminosity * values.shape[1] + lower
    step = np.diff(values, axis=1, append=values[:, -1:])
    return {
        (i, k): np.take(values[:, :, i, k], row) + weight * np.take(step[:, :, i, k], row)
        for i, k in np.ndindex(values.shape[2:])
        if values[:, :, i, k].any()
    }


def _factor(wanted: list[F64], mixing: Mapping[tuple[int, int], F64]) -> list[F64]:
    """Factor at its knots whose means over the anchors are those wanted; never negative.

    Each round multiplies it by wanted over found mean, from the wanted means on (as Richardson and Lucy's deconvolution
    does): what the anchors cannot tell apart, and noise would blow up, is left alone. None falls below LEAST_CORRECTION
    of the wanted mean. `wanted` is the mean of
    irradiance over template irradiance of the anchors of each knot; `mixing` the weight of the factor at knot k in the
    mean of knot j's anchors, by (j, k), of sum 1.
    """
    factor = wanted
    for _ in range(N_CORRECTION if len(wanted) > 1 else 0):
        found = [np.zeros_like(wanted[0]) for _ in wanted]
        for (j, k), weight in mixing.items():
            found[j] += weight * factor[k]
        factor = [
            np.fmax(
                one * np.divide(to_find, mean, out=np.ones_like(mean), where=mean > 0.0), LEAST_CORRECTION * to_find
            )
            for one, to_find, mean in zip(factor, wanted, found, strict=True)
        ]
    return factor


@functools.lru_cache(maxsize=256)
def band_tables(band: Band, anchors: tuple[Band, ...]) -> BandTables:
    """Tables of a band and of the anchors, which are in order of wavelength."""
    knots_um, knot = _knots(anchors)
    part = 1.0 / np.bincount(knot)[knot]
    light = np.stack([_light_by_knot(one, knots_um) for one in (band, *anchors)], axis=-2)
    return BandTables(light, tuple(knot.tolist()), tuple(part.tolist()))


def _knots(anchors: Sequence[Band]) -> tuple[F64, I64]:
    """Wavelengths of the factor's knots [um], and the knot of each anchor: one begins where the last is far enough."""
    knots_um: list[float] = []
    knot = []
    for anchor in anchors:
        if not knots_um or anchor.isophotal_um > SAME_WAVELENGTH * knots_um[-1]:
            knots_um.append(anchor.isophotal_um)
        knot.append(len(knots_um) - 1)
    return np.array(knots_um), np.array(knot)


def _light_by_knot(band: Band, knots_um: F64) -> F64:
    """Integrals of energy response times template times hat, shape (n_class, n_temperature, n_knot)."""
    node_um, light = _template_light(band)
    hats = [np.interp(np.log(node_um), np.log(knots_um), hat) for hat in np.eye(len(knots_um))]
    return light @ np.stack(hats, axis=1)


@functools.lru_cache(maxsize=64)
def _template_light(band: Band) -> tuple[F64, F64]:
    """Quadrature nodes over a band [um], (m,), and weight times energy response times template, (..., m)."""
    # Nodes wherever a factor may have a knot: quadratures end their pieces at the nodes.
    knots_um = [anchor.isophotal_um for anchor in photometric_bands().values()]
    inside = [um for um in knots_um if band.wavelength_um[0] < um < band.wavelength_um[-1]]
    edge_um = np.union1d(band.wavelength_um, inside)
    response = np.interp(edge_um, band.wavelength_um, band.response)
    node_um, weight_um, spectra = band_nodes(Band(band.name, edge_um, response, per_photon=band.per_photon))
    return node_um, weight_um * spectra
