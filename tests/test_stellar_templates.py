"""Stellar templates: what they are, their light in bands against independent integration, and colours and classes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import as_band
from warpsim.sky import stellar_templates
from warpsim.sky.stellar_templates import (
    DWARF,
    GIANT,
    UNKNOWN_TEMPERATURE_K,
    band_light,
    band_nodes,
    colour,
    colour_temperature_k,
    luminosity_class,
    mixed,
    mixture,
    templates,
)

LIGHT_RTOL = 1e-9  # against adaptive quadrature, which stops at 1e-11
MIXED_RTOL = 1e-12  # sums of the same numbers in another order
COLOUR_ATOL_MAG = 1e-9  # a colour there and back

BANDS = ("B", "V", "G", "BP", "RP", "J", "Ks", "W1", "W2", "A", "E", "W4", "IRAC2", "S9W")
OWN = Band("own", [0.31, 0.3333, 0.71, 0.9], [0.0, 0.4, 1.0, 0.3], per_photon=True)


def integral(band, spectrum):
    """The light of a spectrum (n,) in a band by adaptive quadrature between all nodes, sharing no code with warpsim."""
    integrate = pytest.importorskip("scipy.integrate")
    optimize = pytest.importorskip("scipy.optimize")
    grid_um = templates().wavelength_um

    def by_energy(um):
        return np.interp(um, band.wavelength_um, band.response) * (um if band.per_photon else 1.0)

    brightest = int(np.argmax(by_energy(band.wavelength_um)))
    around = band.wavelength_um[max(brightest - 1, 0)], band.wavelength_um[min(brightest + 1, len(band.response) - 1)]
    found = optimize.minimize_scalar(lambda um: -by_energy(um), bounds=around, method="bounded")
    peak = max(-found.fun, by_energy(band.wavelength_um).max())
    edges = np.union1d(band.wavelength_um, grid_um)
    edges = edges[(edges >= band.wavelength_um[0]) & (edges <= band.wavelength_um[-1])]
    return (
        sum(
            integrate.quad(lambda um: by_energy(um) * np.interp(um, grid_um, spectrum), a, b, epsabs=0, epsrel=1e-11)[0]
            for a, b in itertools.pairwise(edges)
        )
        / peak
    )


def test_templates_are_spectra():
    wavelength_um, temperature_k, spectrum = templates().wavelength_um, templates().temperature_k, templates().spectrum
    assert spectrum.shape == (2, len(temperature_k), len(wavelength_um))
    assert (wavelength_um[0], wavelength_um[-1]) == (0.28, 45.0)
    assert (temperature_k[0], temperature_k[-1]) == (2300.0, 35000.0)
    assert (np.diff(wavelength_um) > 0).all()
    assert (np.diff(temperature_k) > 0).all()
    assert (spectrum > 0.0).all()
    np.testing.assert_allclose(np.trapezoid(spectrum, wavelength_um), 1.0, rtol=2e-5)  # rounded to 5 digits
    for values in (wavelength_um, temperature_k, spectrum, band_light("V")):
        assert not values.flags.writeable


@pytest.mark.parametrize("name", [*BANDS, "own"])
def test_band_light_is_the_integral(name, record_accuracy):
    band = OWN if name == "own" else as_band(name)
    light = band_light(band)
    for luminosity, row in ((DWARF, 0), (DWARF, 30), (GIANT, 5), (GIANT, 20), (DWARF, 50)):
        expected = integral(band, templates().spectrum[luminosity, row])
        error = abs(light[luminosity, row] / expected - 1.0)
        record_accuracy("Light of stellar templates in bands", error, LIGHT_RTOL, "of it", "scipy")


def test_nodes_integrate_factors_of_wavelength():
    band = as_band("W2")
    node_um, weight_um, spectrum = band_nodes(band)
    assert spectrum.shape == (2, len(templates().temperature_k), len(node_um))
    fine_um = np.union1d(np.linspace(3.88, 5.55, 400_001), templates().wavelength_um)
    fine_um = fine_um[(fine_um >= 3.88) & (fine_um <= 5.55)]
    factor = 1.0 + 0.3 * np.log(fine_um / 4.0)
    values = (
        band.energy_response(fine_um)
        * factor
        * np.interp(fine_um, templates().wavelength_um, templates().spectrum[0, 10])
    )
    found = (weight_um * (1.0 + 0.3 * np.log(node_um / 4.0)) * spectrum[0, 10]).sum()
    assert found == pytest.approx(np.trapezoid(values, fine_um), rel=1e-8)  # the trapezoids' own error


def test_a_star_is_a_mixture_of_two_templates():
    temperature_k = np.array([2300.0, 3333.0, 5772.0, 12_345.0, 35_000.0])
    luminosity = np.array([DWARF, GIANT, DWARF, GIANT, DWARF])
    lower, weight = mixture(temperature_k)
    assert ((weight >= 0.0) & (weight <= 1.0)).all()
    low_k, high_k = templates().temperature_k[lower], templates().temperature_k[lower + 1]
    np.testing.assert_allclose(low_k ** (1 - weight) * high_k**weight, temperature_k, rtol=1e-13)
    spectra = mixed(templates().spectrum, luminosity, temperature_k)
    _, weight_um, _ = band_nodes("A")
    node_um = band_nodes("A")[0]
    by_spectrum = [np.interp(node_um, templates().wavelength_um, spectrum) @ weight_um for spectrum in spectra]
    np.testing.assert_allclose(mixed(band_light("A"), luminosity, temperature_k), by_spectrum, rtol=MIXED_RTOL)


def test_unknown_and_extreme_stars():
    given = mixed(templates().spectrum, [GIANT, DWARF, GIANT], [UNKNOWN_TEMPERATURE_K, 2300.0, 35_000.0])
    np.testing.assert_array_equal(mixed(templates().spectrum, [-1, DWARF, GIANT], [np.nan, 500.0, 1e6]), given)


# --- colours ---


@pytest.mark.parametrize("luminosity", [DWARF, GIANT])
@pytest.mark.parametrize(
    ("kind", "bands", "coolest_k"),
    [("BP-RP", ("BP", "RP"), 2300.0), ("V-K", ("V", "Ks"), 2300.0), ("J-K", ("J", "Ks"), 4200.0)],
)
def test_a_star_has_the_colour_it_is_given_by(kind, bands, coolest_k, luminosity):
    temperature_k = np.geomspace(max(coolest_k, 2300.0), 34_000.0, 97)
    value = colour(*bands, np.full(97, luminosity), temperature_k)
    found_k = colour_temperature_k(value, kind, luminosity)
    assert np.abs(colour(*bands, np.full(97, luminosity), found_k) - value).max() < COLOUR_ATOL_MAG
    np.testing.assert_allclose(found_k, temperature_k, rtol=1e-6)


@pytest.mark.parametrize("kind", ["BP-RP", "V-I", "V-K", "J-K", "B-V"])
@pytest.mark.parametrize("luminosity", [DWARF, GIANT])
def test_temperatures_fall_with_colour_and_end_at_the_templates(kind, luminosity):
    value = np.linspace(-1.0, 12.0, 400)
    found_k = colour_temperature_k(value, kind, luminosity)
    assert (np.diff(found_k) <= 1e-9).all()
    assert found_k[0] == pytest.approx(35_000.0)
    assert np.isnan(colour_temperature_k(np.array([np.nan]), kind, luminosity)).all()


@pytest.mark.parametrize(
    ("kind", "value_mag", "luminosity", "temperature_k"),
    [  # The Sun's colours are those of solar twins (Ramirez et al. 2012, Casagrande et al. 2018)
        ("BP-RP", 0.82, DWARF, 5772),
        ("V-K", 1.56, DWARF, 5772),
        ("B-V", 0.653, DWARF, 5772),
        ("V-I", 0.702, DWARF, 5772),
        ("J-K", 0.36, DWARF, 5772),
        ("BP-RP", 2.83, DWARF, 3240),  # Barnard's star
        ("V-I", 1.23, GIANT, 4290),  # Arcturus
        ("V-K", 3.67, GIANT, 3910),  # Aldebaran
        ("B-V", 0.0, DWARF, 9600),  # Vega
    ],
)
def test_temperatures_of_well_known_stars(kind, value_mag, luminosity, temperature_k):
    assert float(colour_temperature_k(value_mag, kind, luminosity)) == pytest.approx(temperature_k, rel=0.04)


def test_luminosity_classes():
    # Barnard's star, Aldebaran, the Sun at 10 pc, Sirius, Betelgeuse, a K giant at 1 kpc with no sure parallax.
    g_mag = np.array([8.2, 0.0, 4.67, -1.5, 0.0, 9.5])
    bp_rp_mag = np.array([2.83, 1.9, 0.82, 0.0, 2.5, 1.3])
    parallax_mas = np.array([547.0, 49.0, 100.0, 379.0, 6.5, -0.4])
    pm_mas_yr = np.array([10393.0, 199.0, 0.0, 1339.0, 30.0, 12.0])
    expected = [DWARF, GIANT, DWARF, DWARF, GIANT, GIANT]
    assert luminosity_class(g_mag, bp_rp_mag, parallax_mas, pm_mas_yr).tolist() == expected
    # Without parallax the proper motion tells, and without either a red star is a giant.
    assert luminosity_class(g_mag, bp_rp_mag, np.nan, pm_mas_yr).tolist() == expected
    assert luminosity_class(g_mag, bp_rp_mag).tolist() == [GIANT, GIANT, DWARF, DWARF, GIANT, GIANT]
    assert luminosity_class(5.0, np.nan) == GIANT


# --- what a physicist would look at ---


def test_classes_part_where_molecules_form():
    cool, hot = np.array([4000.0]), np.array([7000.0])
    for bands in (("V", "Ks"), ("G", "W3"), ("W1", "W2")):
        assert colour(*bands, [DWARF], hot) == colour(*bands, [GIANT], hot)
    # CO takes light of giants at 4.6 um, that of dwarfs is left alone; J-K of M dwarfs stays where it is from M0 to M6.
    assert colour("W1", "W2", [GIANT], cool)[0] < -0.07 < -0.05 < colour("W1", "W2", [DWARF], cool)[0]
    dwarfs_k = np.linspace(2850.0, 4000.0, 50)
    assert np.abs(colour("J", "Ks", np.full(50, DWARF), dwarfs_k) - 0.87).max() < 0.08
    assert colour("J", "Ks", [GIANT], [3400.0])[0] > 1.1


def test_the_infrared_tail_is_that_of_a_photosphere():
    """Between 12 and 30 um a star of 5,772 K falls as Planck's law of a few thousand kelvin, within 5 %."""
    um = np.array([12.0, 16.0, 20.0, 25.0, 30.0])
    spectrum = mixed(templates().spectrum, [DWARF], [5772.0])[0]
    planck = um**-5.0 / np.expm1(14387.77 / (um * 5000.0))
    ratio = np.interp(um, templates().wavelength_um, spectrum) / planck
    assert np.ptp(ratio) / ratio.mean() < 0.05


def test_bands_beyond_the_templates_are_errors():
    with pytest.raises(InputError) as error:
        band_light(Band.top_hat("far", 40.0, 60.0))
    assert str(error.value) == (
        "band far: must lie within 0.28 to 45 um, where the spectrum of stars is known, got 40 to 60 um"
    )
    with pytest.raises(InputError, match="must be one of"):
        band_light("none")


def test_nothing_is_read_before_it_is_asked_for():
    import subprocess
    import sys

    code = "import warpsim, warpsim.sky.stellar_templates as t; print(t.templates.cache_info().currsize)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "0\n"
    assert stellar_templates.templates() is stellar_templates.templates()
