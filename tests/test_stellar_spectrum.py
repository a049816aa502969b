"""Light of stars in any band: the spectrum through their fluxes, against its definition integrated by scipy."""

from __future__ import annotations

import functools
import itertools
import math
import tracemalloc

import numpy as np
import pytest

from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.sky import stellar_spectrum
from warpsim.sky.photometric_bands import photometric_bands
from warpsim.sky.stellar_spectrum import N_CORRECTION, SAME_WAVELENGTH, band_irradiance_w_cm2
from warpsim.sky.stellar_templates import templates

BANDS = photometric_bands()

ORACLE_RTOL = 1e-6  # asked for; 1e-13 measured: both integrate the same smooth pieces
PASS_RTOL = 0.01  # asked for: 99 of 100 stars meet their fluxes
SUM_RTOL = 1e-13  # rounding of sums in another order
MAX_PEAK_BYTES = 150  # per star, of tables and temporaries

OWN = Band("own", [3.5, 4.0, 9.0, 14.0], [0.0, 1.0, 0.7, 0.2])
PHOTON = Band("photon", [0.4, 0.45, 0.7, 0.9], [0.0, 0.6, 1.0, 0.0], per_photon=True)


# --- the definition, one star at a time ---


def response_at(band, um):
    response = float(np.interp(um, band.wavelength_um, band.response, left=0.0, right=0.0))
    return response * um / band.photon_um if band.per_photon else response


def integral(function, band, cuts_um=()):
    """Integral of energy response times function over a band, piece by piece between all kinks."""
    quad = pytest.importorskip("scipy.integrate").quad
    low_um, high_um = band.wavelength_um[[0, -1]]
    kinks = (*band.wavelength_um, *templates().wavelength_um, *cuts_um)
    edges = sorted({float(kink) for kink in kinks if low_um <= kink <= high_um})
    return sum(
        quad(lambda um: response_at(band, um) * function(um), a, b, epsabs=0, epsrel=1e-9)[0]
        for a, b in itertools.pairwise(edges)
        if response_at(band, a) + response_at(band, (a + b) / 2) + response_at(band, b) > 0
    )


def template_at(um, temperature_k, luminosity):
    """The mixture of the two neighbouring templates, linear in ln T and, between its nodes, in wavelength."""
    grid_k, grid_um = templates().temperature_k, templates().wavelength_um
    row = int(np.clip(np.searchsorted(grid_k, temperature_k) - 1, 0, len(grid_k) - 2))
    part = math.log(temperature_k / grid_k[row]) / math.log(grid_k[row + 1] / grid_k[row])
    low, high = templates().spectrum[luminosity, row : row + 2]
    return (1.0 - part) * np.interp(um, grid_um, low) + part * np.interp(um, grid_um, high)


@functools.cache
def light_by_knot(band, temperature_k, luminosity, knots_um):
    """Light of a template in a band with a factor that is 1 at one knot and 0 at the others, for each knot."""
    return np.array([
        integral(
            lambda um, hat=hat: template_at(um, temperature_k, luminosity)
            * np.interp(math.log(um), np.log(knots_um), hat),
            band,
            knots_um,
        )
        for hat in np.eye(len(knots_um))
    ])  # fmt: skip


def expected_w_cm2(band, flux_jy, temperature_k, luminosity):
    """The definition for one star: the integral of energy response, template and factor."""
    known = {name: flux for name, flux in flux_jy.items() if math.isfinite(flux)}
    if {"BP", "RP"} <= known.keys():
        known.pop("G", None)
    names = sorted(known, key=lambda name: BANDS[name].isophotal_um)
    groups = []
    for name in names:
        if groups and BANDS[name].isophotal_um <= SAME_WAVELENGTH * BANDS[groups[-1][0]].isophotal_um:
            groups[-1].append(name)
        else:
            groups.append([name])
    knots_um = tuple(BANDS[group[0]].isophotal_um for group in groups)
    wanted, mixing = [], []
    for group in groups:
        by_knot = [light_by_knot(BANDS[name], temperature_k, luminosity, knots_um) for name in group]
        lights = [known[name] * BANDS[name].w_cm2_per_jy for name in group]
        wanted.append(np.mean([light / np.sum(parts) for light, parts in zip(lights, by_knot, strict=True)]))
        mixing.append(np.mean([parts / np.sum(parts) for parts in by_knot], axis=0))
    wanted, mixing = np.array(wanted), np.array(mixing)
    factor = wanted
    for _ in range(N_CORRECTION):
        found = mixing @ factor
        factor = factor * np.where(found > 0, wanted / np.where(found > 0, found, 1), 1)

    def spectrum(um):
        return template_at(um, temperature_k, luminosity) * np.interp(math.log(um), np.log(knots_um), factor)

    return integral(spectrum, band, knots_um)


def light(band, stars):
    """Irradiance of stars given as (fluxes, temperature, luminosity), in one call."""
    names = sorted({name for fluxes, _, _ in stars for name in fluxes})
    flux_jy = {name: np.array([fluxes.get(name, math.nan) for fluxes, _, _ in stars]) for name in names}
    temperature_k = np.array([float(kelvin) for _, kelvin, _ in stars])
    return band_irradiance_w_cm2(band, flux_jy, temperature_k, np.array([c for *_, c in stars], dtype=np.int8))


def magnitudes(**mags):
    return {name: BANDS[name].zero_mag_jy * 10 ** (-0.4 * magnitude) for name, magnitude in mags.items()}


GRID_K = [float(kelvin) for kelvin in templates().temperature_k]
STARS = [
    (magnitudes(BP=8.0, RP=7.0, G=7.6, A=5.0), GRID_K[len(GRID_K) // 3], 1),
    (magnitudes(V=4.1, Ks=1.2, W3=1.3, E=1.0), 4321.0, 1),
    (magnitudes(B=9.0, V=8.4, J=7.1), 5900.0, 0),
    (magnitudes(A=3.0), 3333.0, 1),
    (magnitudes(V=3.0) | {"E": 0.0}, 9000.0, 0),
]


@pytest.mark.parametrize(
    "band",
    [
        *(BANDS[name] for name in ("V", "BP", "G", "J", "Ks", "W1", "W2", "W3", "W4", "S9W", "IRAS12", "A", "B1", "D")),
        OWN,
        PHOTON,
        Band("narrow", [8.0, 8.001], [1.0, 1.0]),
        Band("gap", [4.0, 4.3, 4.4, 9.0, 10.0], [0.0, 1.0, 0.0, 0.0, 1.0]),
        Band("most", [0.31, 29.0], [1.0, 1.0]),
    ],
    ids=lambda band: band.name,
)
@pytest.mark.ci
def test_light_in_a_band_follows_the_definition(band, record_accuracy):
    # Sure to look past the exact conversion of a catalog: a band of another name and the same response.
    twin = Band("twin", band.wavelength_um, band.response, per_photon=band.per_photon)
    found = light(twin, STARS)
    expected = np.array([expected_w_cm2(twin, *star) for star in STARS])
    worst = float(np.max(np.abs(found / expected - 1.0)))
    record_accuracy("Irradiance of stars, 19 bands", worst, ORACLE_RTOL, "of it", "scipy")


def test_a_flux_alone_gives_the_templates_shape():
    """Ratios of two bands are those of the template, whatever the flux."""
    row, luminosity = len(GRID_K) // 2, 0
    spectrum = templates().spectrum[luminosity, row]
    for flux in (1e-6, 1.0, 1e6):
        near, far = (light(BANDS[name], [({"A": flux}, GRID_K[row], luminosity)])[0] for name in ("J", "W4"))
        expected = [
            integral(lambda um: np.interp(um, templates().wavelength_um, spectrum), BANDS[name]) for name in ("J", "W4")
        ]
        assert near / far == pytest.approx(expected[0] / expected[1], rel=ORACLE_RTOL)


KINDS = [
    ("BP", "RP"),
    ("BP", "RP", "A"),
    ("B", "V", "Ic"),
    ("V", "J", "H", "Ks", "W1", "W2", "W3", "W4"),
    ("J", "Ks"),
    ("B2", "A", "C", "D", "E"),
    ("V", "S9W", "L18W"),
]


@pytest.mark.parametrize("names", KINDS, ids="-".join)
def test_the_spectrum_meets_the_fluxes(names):
    """Stars whose colours are off their template's by 0.2 mag in each band, as reddened and dusty ones are."""
    random = np.random.default_rng(3)
    n_star = 400
    kelvin = 10 ** random.uniform(np.log10(2800.0), np.log10(12_000.0), n_star)
    giant = random.integers(0, 2, n_star).astype(np.int8)
    template = {
        name: band_irradiance_w_cm2(BANDS[name], {"A": np.ones(n_star)}, kelvin, giant) / BANDS[name].w_cm2_per_jy
        for name in names
    }
    slope = random.normal(0.0, 0.3, n_star)  # mag per e-fold of wavelength
    flux_jy = {
        name: values * 10 ** (-0.4 * (slope * np.log(BANDS[name].isophotal_um) + random.normal(0.0, 0.02, n_star)))
        for name, values in template.items()
    }
    for name in names:
        band = BANDS[name]
        twin = Band("twin", band.wavelength_um, band.response, per_photon=band.per_photon)
        ratio = band_irradiance_w_cm2(twin, flux_jy, kelvin, giant) / (flux_jy[name] * band.w_cm2_per_jy)
        assert np.quantile(np.abs(ratio - 1.0), 0.99) < PASS_RTOL, name


def test_light_is_never_negative_and_scales():
    random = np.random.default_rng(4)
    names = ("B", "V", "BP", "RP", "Ks", "W1", "A", "C", "W3", "E")
    flux_jy = {name: BANDS[name].zero_mag_jy * 10 ** random.uniform(-2, 2, 500) for name in names}
    kelvin, giant = np.full(500, 4000.0), np.ones(500, dtype=np.int8)
    for band in (OWN, PHOTON, BANDS["J"]):
        found = band_irradiance_w_cm2(band, flux_jy, kelvin, giant)
        assert (found > 0.0).all()
        brighter = band_irradiance_w_cm2(band, {name: 10 * flux for name, flux in flux_jy.items()}, kelvin, giant)
        np.testing.assert_allclose(brighter, 10 * found, rtol=SUM_RTOL)


def test_anchors_at_one_wavelength_are_averaged():
    """C at 12.1 um and IRAS12 within 10 % of it: the spectrum goes through the middle of the two."""
    band = Band.top_hat("at-12", 12.1, 12.3)
    alone = light(band, [(magnitudes(C=5.0), 5000.0, 1), (magnitudes(C=5.0, IRAS12=5.0), 5000.0, 1)])
    # 20 % more in one of them is 10 % more in the mean.
    brighter = magnitudes(C=5.0 - 2.5 * math.log10(1.2), IRAS12=5.0)
    found = light(band, [(brighter, 5000.0, 1)])[0]
    assert found / alone[1] - 1.0 == pytest.approx(0.2 * alone[0] / alone[1] / 2, rel=1e-9)


def test_g_adds_nothing_to_bp_and_rp():
    both = light(OWN, [(magnitudes(BP=8, RP=7, G=g), 5000.0, 1) for g in (5.0, 9.0)])
    assert both[0] == both[1]
    alone = light(OWN, [(magnitudes(RP=7, G=g), 5000.0, 1) for g in (5.0, 9.0)])
    assert alone[0] != alone[1]


def test_unknown_stars_are_k_giants():
    star = magnitudes(A=5.0, W1=5.0)
    values = light(PHOTON, [(star, math.nan, -1), (star, 4850.0, 1), (star, 4850.0, 0), (star, 1.0, 1), (star, 1e9, 1)])
    assert values[0] == values[1] != values[2]
    ends = light(PHOTON, [(star, GRID_K[0], 1), (star, GRID_K[-1], 1)])
    np.testing.assert_array_equal(values[3:], ends)


def test_stars_without_light_and_without_fluxes():
    values = light(
        OWN, [({"A": 0.0}, 4000.0, 1), ({"A": 0.0, "V": 0.0}, 4000.0, 1), ({}, 4000.0, 1), ({"A": math.nan}, 1e4, 0)]
    )
    np.testing.assert_array_equal(values, [0.0, 0.0, np.nan, np.nan])
    assert band_irradiance_w_cm2(OWN, {}, np.zeros(0), np.zeros(0, dtype=np.int8)).shape == (0,)


def random_stars(n_star):
    random = np.random.default_rng(5)
    flux_jy = {}
    for name in ("V", "BP", "G", "RP", "J", "Ks", "W1", "A", "W3"):
        values = BANDS[name].zero_mag_jy * 10 ** random.uniform(-4, -2, n_star)
        flux_jy[name] = np.where(random.random(n_star) < 0.4, np.nan, values)
    return flux_jy, random.uniform(2500, 9000, n_star), random.integers(-1, 2, n_star).astype(np.int8)


def test_work_in_chunks_equals_work_one_by_one(monkeypatch):
    flux_jy, kelvin, luminosity = random_stars(60)
    whole = band_irradiance_w_cm2(OWN, flux_jy, kelvin, luminosity)
    assert np.isfinite(whole).sum() > 50
    for row in range(60):
        one = {name: values[row : row + 1] for name, values in flux_jy.items()}
        found = band_irradiance_w_cm2(OWN, one, kelvin[row : row + 1], luminosity[row : row + 1])
        np.testing.assert_allclose(found, whole[row], rtol=SUM_RTOL)
    monkeypatch.setattr(stellar_spectrum, "_CHUNK_STARS", 7)
    np.testing.assert_allclose(band_irradiance_w_cm2(OWN, flux_jy, kelvin, luminosity), whole, rtol=SUM_RTOL)


def test_memory_is_bounded():
    n_star = 1_000_000
    flux_jy = {name: np.ones(n_star) for name in ("BP", "RP", "A")}
    kelvin, luminosity = np.full(n_star, 4000.0), np.ones(n_star, dtype=np.int8)
    band_irradiance_w_cm2(OWN, {name: values[:1] for name, values in flux_jy.items()}, kelvin[:1], luminosity[:1])
    tracemalloc.start()
    band_irradiance_w_cm2(OWN, flux_jy, kelvin, luminosity)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak / n_star < MAX_PEAK_BYTES


@pytest.mark.parametrize("edges_um", [(0.29, 0.4), (20.0, 31.0)])
def test_a_band_beyond_the_spectra_is_an_error(edges_um):
    with pytest.raises(InputError) as error:
        light(Band.top_hat("far", *edges_um), [({"A": 1.0}, 4000.0, 1)])
    rule = "must lie within 0.3 to 30 um, where the spectra of stars are known"
    assert str(error.value) == f"band far: half_power_um: {rule}, got {edges_um[0]:g} to {edges_um[1]:g} um"


def test_a_response_beyond_the_templates_is_an_error():
    last_um = float(templates().wavelength_um[-1])
    band = Band("leak", [10.0, 11.0, 12.0, 20.0, 1.5 * last_um], [0.0, 1.0, 0.01, 0.01, 0.001])
    with pytest.raises(
        InputError, match=r"^band leak: must lie within 0.28 to 45 um, where the spectrum of stars is known"
    ):
        light(band, [({"A": 1.0}, 4000.0, 1)])
    padded = Band("padded", [0.01, 3.0, 4.0, 5.0, 1000.0], [0.0, 0.0, 1.0, 0.0, 0.0])
    trimmed = Band("trimmed", [3.0, 4.0, 5.0], [0.0, 1.0, 0.0])
    star = [(magnitudes(V=3.0, A=2.0), 4000.0, 1)]
    assert light(padded, star) == pytest.approx(light(trimmed, star), rel=1e-12)
