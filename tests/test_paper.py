"""The paper's Table 2 against warpsim.paper."""

from __future__ import annotations

import numpy as np
import pytest

from warpsim import paper
from warpsim.errors import InputError
from warpsim.radiometry.bands import BANDS

# Table 2 as printed: dynamic range at magnitudes 0 to 6.
PRINTED = {
    "A": (510.651, 203.285, 80.925, 32.215, 12.825, 5.105, 2.032),
    "B1": (444.097, 176.790, 70.378, 28.017, 11.153, 4.439, 1.768),
    "B2": (658.514, 262.147, 104.358, 41.543, 16.538, 6.584, 2.621),
    "C": (113.509, 45.187, 17.988, 7.161, 2.851, 1.135, 0.452),
    "D": (61.359, 24.426, 9.724, 3.871, 1.541, 0.614, 0.244),
    "E": (40.000, 15.924, 6.339, 2.524, 1.005, 0.400, 0.159),
}
# Cells whose print is one unit of the last digit away from the rounded value (no single base explains them).
MISPRINTED = {("A", 3), ("B1", 5), ("B2", 3), ("D", 5), ("E", 3)}

PRINT_ATOL = 0.0005 + 1e-9  # half a unit of the last printed digit, to which the print's rounding may come
MISPRINT_ATOL = 0.001  # one unit

# Wavelength and width of each band that the first row follows from [um]: Table 1, but for B2's wavelength (4.35 there)
# and A's width (4.0 there).
FIRST_ROW_FROM_UM = {
    "A": (8.28, 1.9952),
    "B1": (4.29, 0.14),
    "B2": (4.25, 0.21),
    "C": (12.13, 2.1),
    "D": (14.65, 2.4),
    "E": (21.34, 6.9),
}
FIRST_ROW_ATOL = {"A": 0.006, "B2": 0.001, "D": 0.0011}  # A: a fitted width of five digits; B2, D: one unit


@pytest.mark.parametrize("band", PRINTED)
def test_table_2_comes_out_as_printed(band, record_accuracy):
    for magnitude, printed in enumerate(PRINTED[band]):
        atol = MISPRINT_ATOL if (band, magnitude) in MISPRINTED else PRINT_ATOL
        assert paper.dynamic_range(magnitude, band) == pytest.approx(printed, rel=0, abs=atol)
        error = abs(paper.dynamic_range(magnitude, band) - printed)
        name = "The paper's Table 2, five values" if atol == MISPRINT_ATOL else "The paper's Table 2, 37 values"
        record_accuracy(name, error, atol, "", "as printed")


@pytest.mark.parametrize("band", PRINTED)
def test_first_row_follows_from_table_1_and_the_stated_changes(band):
    wavelength_um, width_um = FIRST_ROW_FROM_UM[band]
    zero_w_cm2_um = BANDS[band].zero_mag_jy * 1e-26 * 3e8 / (wavelength_um * 1e-6) ** 2 * 1e-10
    expected = zero_w_cm2_um * width_um / 1e-18
    assert paper.dynamic_range(0, band) == pytest.approx(expected, rel=0, abs=FIRST_ROW_ATOL.get(band, PRINT_ATOL))


def test_no_rounding_rule_gives_the_row_of_magnitude_5():
    """floor(1000 D0 g + t) = 1000 printed has no solution g, t in [0, 1]: whatever the base, whatever the rounding.

    D0 may lie anywhere within 0.001 of its print; the lower bound is asked of the largest D0, the upper of the least.
    """
    linprog = pytest.importorskip("scipy.optimize").linprog

    def status(magnitude):
        rows, bounds = [], []
        for band in ("B1", "B2", "D"):
            zero, printed = PRINTED[band][0], round(1000 * PRINTED[band][magnitude])
            rows += [[-1000 * (zero + 0.001), -1.0], [1000 * (zero - 0.001), 1.0]]
            bounds += [-printed, printed + 1]
        return linprog([0.0, 0.0], rows, bounds, bounds=[(0, 1), (0, 1)]).status

    feasible, infeasible = 0, 2
    assert status(5) == infeasible
    assert status(4) == feasible


def test_array_in_array_out():
    magnitudes = np.array([[0.0, 1.0], [np.nan, 6.0]])
    result = paper.dynamic_range(magnitudes, "A")
    assert result.shape == (2, 2)
    assert np.isnan(result[1, 0])
    assert isinstance(paper.dynamic_range(1.0, "A"), float)


@pytest.mark.parametrize("magnitude", [-2.0, -10.0, -1e6])
def test_a_bright_star_saturates_at_sei_over_nei(magnitude):
    assert paper.dynamic_range(magnitude, "B2") == pytest.approx(3000.0)


@pytest.mark.parametrize("band", ["a", "F", "", None, ["A"]])
def test_unknown_band_is_named(band):
    with pytest.raises(InputError, match=r"^band: must be one of A, B1, B2, C, D, E, got "):
        paper.dynamic_range(0.0, band)


def test_magnitude_must_be_numbers():
    with pytest.raises(InputError, match="magnitude: must be numbers, got str"):
        paper.dynamic_range("bright", "A")
