"""The two presets of physics: zero points, magnitudes, dynamic ranges, and the paper's Tables 1 and 2."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import BANDS
from warpsim.radiometry.magnitudes import PHYSICS, as_radiometry
from warpsim.sky.catalog import StarCatalog

PAPER, PHYSICAL = PHYSICS["paper"], PHYSICS["physical"]

# Tables as printed. Table 1: band, wavelength um, waveband um, zero magnitude Jy.
TABLE_1 = """\
A 8.28 6.8 10.8 58.49
B1 4.29 4.22 4.36 194.6
B2 4.35 4.24 4.45 188.8
C 12.13 11.1 13.2 26.51
D 14.65 13.5 15.9 18.29
E 21.34 18.2 25.1 8.80"""
TABLE_2 = """\
0 510.651 444.097 658.514 113.509 61.359 40.000
1 203.285 176.790 262.147 45.187 24.426 15.924
2 80.925 70.378 104.358 17.988 9.724 6.339
3 32.215 28.017 41.543 7.161 3.871 2.524
4 12.825 11.153 16.538 2.851 1.541 1.005
5 5.105 4.439 6.584 1.135 0.614 0.400
6 2.032 1.768 2.621 0.452 0.244 0.159"""

ROUNDING = 1e-14  # a power, a logarithm and a few products in float64
PRINT_ATOL = 0.001 + 1e-9  # one unit of the last printed digit; 37 of the 42 values are within half of it
N_WITHIN_HALF_A_UNIT = 37


def test_paper_preset_reproduces_table_1():
    table = PAPER.band_table()
    for row, line in zip(table, TABLE_1.splitlines(), strict=True):
        name, *numbers = line.split()
        assert row["band"] == name
        got = [row[key] for key in ("wavelength_um", "lower_um", "upper_um", "zero_mag_jy")]
        assert got == [float(number) for number in numbers]
    assert str(table["zero_mag_jy"].unit) == "Jy"


def test_paper_preset_reproduces_table_2():
    table = PAPER.dynamic_range_table()
    assert table.colnames == ["magnitude", "A", "B1", "B2", "C", "D", "E"]
    printed = np.array([line.split() for line in TABLE_2.splitlines()], dtype=float)
    np.testing.assert_array_equal(table["magnitude"], printed[:, 0])
    got = np.array([table[name] for name in table.colnames[1:]]).T
    np.testing.assert_allclose(got, printed[:, 1:], rtol=0, atol=PRINT_ATOL)
    np.testing.assert_array_equal(got[0], printed[0, 1:])
    assert np.sum(np.abs(got - printed[:, 1:]) < 0.0005 + 1e-9) == N_WITHIN_HALF_A_UNIT
    assert table.pformat()[2].split() == TABLE_2.splitlines()[0].split()


def test_physical_preset_follows_pogson_from_the_calibration():
    for name, zero_w_cm2 in {
        "A": 8.196e-16,
        "B1": 3.30e-16,
        "B2": 5.4e-16,
        "C": 9.26e-17,
        "D": 5.69e-17,
        "E": 3.55e-17,
    }.items():
        for magnitude in (-3.0, 0.0, 2.5, 6.0):
            expected = zero_w_cm2 * 10 ** (-0.4 * magnitude)
            assert PHYSICAL.irradiance_w_cm2(magnitude, name) == pytest.approx(expected, rel=ROUNDING, abs=0)
    assert PHYSICAL.dynamic_range(0.0, "A") == pytest.approx(819.6, rel=ROUNDING)
    assert PHYSICAL.irradiance_w_cm2(0.0, "A") / PHYSICAL.irradiance_w_cm2(5.0, "A") == pytest.approx(
        100.0, rel=ROUNDING
    )


def test_presets_differ_where_the_docs_say():
    for name in BANDS:
        assert PAPER.magnitude(1.0, name) == PHYSICAL.magnitude(1.0, name)
    assert PAPER.magnitude_base == 2.512
    ratio = {name: PAPER.irradiance_w_cm2(0, name) / PHYSICAL.irradiance_w_cm2(0, name) for name in BANDS}
    expected = {"A": 0.623, "B1": 1.346, "B2": 1.219, "C": 1.226, "D": 1.078, "E": 1.127}
    assert {name: round(value, 3) for name, value in ratio.items()} == expected
    widths = {name: zero.width_um for name, zero in PAPER.zero_points.items()}
    assert widths == pytest.approx({"A": 1.995, "B1": 0.14, "B2": 0.22, "C": 2.1, "D": 2.4, "E": 6.9}, rel=1e-4)


@pytest.mark.parametrize("physics", PHYSICS.values(), ids=list(PHYSICS))
def test_flux_magnitude_and_irradiance_agree(physics):
    for name, zero in physics.zero_points.items():
        flux_jy = np.array([0.0, 1e-3, 1.0, zero.zero_mag_jy, np.nan])
        magnitude = physics.magnitude(flux_jy, name)
        assert magnitude[0] == np.inf
        assert magnitude[3] == 0.0
        assert np.isnan(magnitude[4])
        irradiance = physics.flux_irradiance_w_cm2(flux_jy, name)
        assert irradiance[0] == 0.0
        # The calibration's W/cm2 per Jy is rounded on its own; the paper's follows from magnitude 0.
        rtol = 0.004 if physics.name == "physical" else ROUNDING
        np.testing.assert_allclose(irradiance, physics.irradiance_w_cm2(magnitude, name), rtol=rtol)


def test_dynamic_range_ends_at_the_sensors_own():
    for physics in PHYSICS.values():
        assert physics.dynamic_range(-1000.0, "A") == pytest.approx(3000.0, rel=ROUNDING)
        assert physics.dynamic_range(-1e6, "A", 2e-18, 3e-15) == pytest.approx(1500.0, rel=ROUNDING)
        faint = physics.dynamic_range(3.0, "C", 1e-18, 3e-15)
        assert physics.dynamic_range(3.0, "C", 4e-18, 3e-15) == pytest.approx(faint / 4, rel=ROUNDING)
    assert np.isnan(PAPER.dynamic_range(np.nan, "A"))


def test_arrays_keep_their_shape_and_numbers_stay_numbers():
    magnitude = np.zeros((2, 3))
    for function in (PAPER.irradiance_w_cm2, PAPER.dynamic_range, PAPER.flux_irradiance_w_cm2, PAPER.magnitude):
        assert function(magnitude, "A").shape == (2, 3)
        assert isinstance(function(1, BANDS["A"]), float)


def test_presets_are_immutable():
    with pytest.raises(dataclasses.FrozenInstanceError):
        PAPER.magnitude_base = 2.5
    with pytest.raises(TypeError):
        PAPER.zero_points["A"] = None
    with pytest.raises(TypeError):
        PHYSICS["paper"] = None


OWN = Band("own", [8.0, 12.0], [1.0, 1.0])
FALSE_A = Band("A", [8.0, 12.0], [1.0, 1.0])


@pytest.mark.parametrize("band", ["a", "F", "", None, ["A"], OWN, FALSE_A])
def test_unknown_band_is_named(band):
    for function in (PAPER.irradiance_w_cm2, PHYSICAL.dynamic_range, PHYSICAL.magnitude, PAPER.flux_irradiance_w_cm2):
        with pytest.raises(InputError, match=r"^band: must be one of A, B1, B2, C, D, E, got ") as error:
            function(1.0, band)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: PAPER.magnitude([1.0, -2.0], "A"), "flux_jy: must be >= 0, got -2"),
        (lambda: PHYSICAL.flux_irradiance_w_cm2(-2.0, "A"), "flux_jy: must be >= 0, got -2"),
        (lambda: PAPER.magnitude("bright", "A"), "flux_jy: must be numbers, got str"),
        (lambda: PAPER.irradiance_w_cm2("bright", "A"), "magnitude: must be numbers, got str"),
        (lambda: PAPER.dynamic_range(0.0, "A", 0.0), "nei_w_cm2: must be finite and > 0, got 0.0"),
        (lambda: PAPER.dynamic_range(0.0, "A", 1e-18, np.inf), "sei_w_cm2: must be finite and > 0, got inf"),
        (lambda: as_radiometry("Paper"), 'physics: must be "physical" or "paper", got \'Paper\''),
        (lambda: as_radiometry(["paper"]), 'physics: must be "physical" or "paper", got [\'paper\']'),
    ],
)
def test_bad_input_is_one_line(call, text):
    with pytest.raises(InputError) as error:
        call()
    assert str(error.value) == text


# --- catalogs ---


def test_catalog_light_follows_the_preset():
    stars = StarCatalog.from_arrays([1.0, 2.0, 3.0], [0.0, 0.0, 0.0], {"A": [58.49, 58.49 / 100, np.nan]})
    np.testing.assert_allclose(stars.irradiance_w_cm2("A", "physical")[:2], [58.49 * 1.401e-17, 0.5849 * 1.401e-17])
    # 5 magnitudes of base 2.512 are a factor 100.0226, not 100.
    np.testing.assert_allclose(
        stars.irradiance_w_cm2("A", "paper"), [5.10651e-16, 5.10651e-16 / 2.512**5, 0.0], rtol=1e-13
    )
    np.testing.assert_array_equal(stars.irradiance_w_cm2("A"), stars.irradiance_w_cm2("A", "physical"))
    # Light in C follows from the spectrum, at nearly the same magnitude.
    np.testing.assert_allclose(stars.irradiance_w_cm2("C", "paper")[:2], [1.13509e-16, 1.13509e-18], rtol=0.02)
    assert stars.irradiance_w_cm2("C", "paper")[2] == 0.0
    with pytest.raises(InputError, match='physics: must be "physical" or "paper", got \'fast\''):
        stars.irradiance_w_cm2("A", "fast")
    with pytest.raises(InputError, match="band: must be one of A, B1, B2, C, D, E, got 'own'"):
        stars.irradiance_w_cm2(OWN, "paper")
