"""Spectral types as an input: their temperatures and luminosity classes, and how columns of them are read."""

from __future__ import annotations

import numpy as np
import pytest
from astropy.table import MaskedColumn, Table

from warpsim.sky.catalog import StarCatalog
from warpsim.sky.photometric_bands import photometric_bands
from warpsim.sky.spectral_types import of_spectral_types
from warpsim.sky.stellar_templates import DWARF, GIANT


def found_of(*types):
    """Temperatures of dwarfs, and classes."""
    temperature_k, luminosity = of_spectral_types(np.array(types, dtype=np.str_))
    return temperature_k[:, DWARF].tolist(), luminosity.tolist()


@pytest.mark.parametrize(
    ("text", "temperature_k", "luminosity"),
    [  # Mamajek's scale of dwarfs; Pickles' giants on the scale of the templates
        ("G2V", 5770, DWARF),
        ("G2 V", 5770, DWARF),
        (" G2V ", 5770, DWARF),
        ("M2.5V", 3470, DWARF),
        ("M4.5Ve", 3110, DWARF),
        ("A1Vm", 9300, DWARF),
        ("B8/9V", 12300, DWARF),
        ("dM3", 3430, DWARF),
        ("sdF8", 6180, DWARF),
        ("G8IV", 5480, DWARF),
        ("K0IV", 4870, GIANT),
        ("K3III", 4510, GIANT),
        ("K0III-IV", 4870, GIANT),
        ("K1.5III", 4660, GIANT),
        ("gK5", 4030, GIANT),
        ("M1-2Ia-Iab", 3850, GIANT),
        ("B0.5Iab", 29000, GIANT),
        ("F8:Ib-II", 6180, GIANT),
        ("G5III+G0V", 5080, GIANT),
        ("M9III", 2960, GIANT),
        ("K3iii", 4510, GIANT),
        ("M2iab", 3770, GIANT),
        ("G2 v", 5770, DWARF),
        ("F0IVvar", 7220, DWARF),
        ("M5 IIIvar", 3390, GIANT),
        ("M6e-M9eIII", 3250, GIANT),
        ("G8/K0(III)", 4950, GIANT),
        ("M3-M4III", 3660, GIANT),
        ("A0Vpec", 9700, DWARF),
        ("K2IIICN1", 4590, GIANT),
        ("A0VpSiCr", 9700, DWARF),
        ("O5V((f))", 41400, DWARF),
        ("F5", 6550, -1),
        ("M2", 3560, -1),
        ("F5VII", 6550, -1),
        ("A0p Var", 9700, -1),
        ("A0 interstellar", 9700, -1),
    ],
)
def test_types_tell_temperature_and_class(text, temperature_k, luminosity):
    assert found_of(text) == ([temperature_k], [luminosity])


@pytest.mark.parametrize("text", ["", "DA2", "C5,4", "S4/6", "WN5", "L2", "G", "pec", "K", "??", "3III"])
def test_types_that_are_not_understood_tell_nothing(text):
    temperature_k, luminosity = found_of(text)
    assert np.isnan(temperature_k).all()
    assert luminosity == [-1]


def test_temperature_falls_along_the_types():
    for roman in ("V", "III"):
        temperature_k, _ = found_of(*(f"{letter}{digit}{roman}" for letter in "OBAFGKM" for digit in range(10)))
        assert (np.diff(temperature_k) <= 0).all()


def test_types_without_a_class_tell_two_temperatures():
    temperature_k, _ = of_spectral_types(np.array(["F9", "G0", "K2", "M2", "K2V", "K2III"]))
    expected = [[6050] * 2, [5930, 5620], [5100, 4590], [3560, 3770], [5100] * 2, [4590] * 2]
    np.testing.assert_array_equal(temperature_k, expected)


SCATTER_KS_MAG = 0.15
"""Of Ks predicted from V and a type or a colour, as docs/catalogs.md states it."""

DWARFS_B_V_MAG = {"F8": 0.53, "G0": 0.58, "G5": 0.68, "K0": 0.82, "K2": 0.90, "K5": 1.13, "M2": 1.50}
GIANTS_B_V_MAG = {"G5": 0.87, "K0": 1.00, "K2": 1.17, "K5": 1.50}


def ks_mag(types, b_v_mag=np.nan, **known):
    """Ks of stars of V = 6 by type, colour, parallax [mas] and motion [mas/yr]."""
    n_star = len(types)
    fluxes = {
        name: photometric_bands()[name].zero_mag_jy * 10.0 ** (-0.4 * np.broadcast_to(magnitude, n_star))
        for name, magnitude in (("V", 6.0), ("B", 6.0 + np.asarray(b_v_mag)))
    }
    columns = {name: np.full(n_star, value) for name, value in known.items()}
    ra_dec_deg = (np.zeros(n_star), np.zeros(n_star))
    return StarCatalog.from_arrays(*ra_dec_deg, fluxes, spectral_type=types, **columns).filled().magnitude("Ks")


@pytest.mark.parametrize(
    ("known", "roman", "b_v_mag"),
    [
        ({"parallax_mas": 60.0}, "V", DWARFS_B_V_MAG),
        ({"pm_dec_mas_yr": 500.0}, "V", DWARFS_B_V_MAG),
        ({"parallax_mas": 6.0}, "III", GIANTS_B_V_MAG),
        ({}, "III", GIANTS_B_V_MAG),
    ],
    ids=["near", "fast", "far", "unknown"],
)
def test_types_without_a_class_have_that_of_their_star(known, roman, b_v_mag):
    """By type alone as by type and class, and as by B-V within the scatter; a colour beats the type."""
    types, colours_mag = list(b_v_mag), list(b_v_mag.values())
    by_type, by_colour = ks_mag(types, **known), ks_mag([""] * len(types), colours_mag, **known)
    np.testing.assert_array_equal(by_type, ks_mag([f"{kind}{roman}" for kind in types], **known))
    np.testing.assert_allclose(by_type, by_colour, atol=SCATTER_KS_MAG)
    np.testing.assert_array_equal(ks_mag(types, colours_mag, **known), by_colour)


def test_a_class_given_tells_the_temperature_of_a_type_without_one():
    luminosity = [DWARF, GIANT]
    stars = StarCatalog.from_arrays(
        [1.0, 2.0], [0.0] * 2, {"V": [1.0] * 2}, spectral_type=["K2"] * 2, luminosity=luminosity
    )
    assert stars.temperature_k.tolist() == [5100, 4590]


def test_columns_of_types(tmp_path):
    """What is given beats the type; the spectrum is that of the temperature given."""
    types = ["K3III", "G2V", "M2V", "F5", "K2", ""]
    columns = {"temperature_k": [np.nan, 5000.0, *[np.nan] * 4], "luminosity": [0, -1, -1, 1, -1, -1]}
    columns["parallax_mas"] = [*[np.nan] * 4, 300.0, np.nan]
    ra_dec_deg = ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [0.0] * 6)
    stars = StarCatalog.from_arrays(*ra_dec_deg, {"V": [1.0] * 6}, spectral_type=types, **columns)
    np.testing.assert_array_equal(stars.temperature_k, [4510, 5000, 3560, 6550, 5100, np.nan])
    assert stars.luminosity.tolist() == [0, 0, 0, 1, -1, -1]
    assert StarCatalog.from_table(stars.to_table()).checksum == stars.checksum

    names = {"ra_deg": ra_dec_deg[0], "dec_deg": ra_dec_deg[1], "flux_V_jy": [1.0] * 6, **columns}
    table = Table({**names, "spectral_type": MaskedColumn([*types[:5], "X"], mask=[False] * 5 + [True])})
    assert StarCatalog.from_table(table).checksum == stars.checksum
    table.write(tmp_path / "stars.ecsv")
    assert StarCatalog.read(tmp_path / "stars.ecsv").checksum == stars.checksum
    table.rename_column("spectral_type", "SpType")
    table.write(tmp_path / "own.fits")
    read = StarCatalog.read(tmp_path / "own.fits", columns={"spectral_type": "SpType"})
    assert read.checksum == stars.checksum
    red = read.irradiance_w_cm2("W1")
    assert red[2] > red[0] > red[3]


def test_masked_types_are_unknown():
    types = np.ma.masked_array(["K3III", "G2V"], mask=[False, True])
    stars = StarCatalog.from_arrays([1.0, 2.0], [0.0] * 2, {"V": [1.0] * 2}, spectral_type=types)
    assert stars.luminosity.tolist() == [GIANT, -1]


def test_unknown_types_are_counted_in_a_warning():
    with pytest.warns(UserWarning, match=r"^mine: 2 of 4 spectral types are unknown \(DA2, C5\)$"):
        stars = StarCatalog.from_arrays(
            [1.0] * 4, [0.0] * 4, {"V": [1.0] * 4}, spectral_type=["DA2", "", "C5", "K0V"], name="mine"
        )
    np.testing.assert_array_equal(stars.temperature_k, [np.nan, np.nan, np.nan, 5270])
