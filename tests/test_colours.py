"""Colours of stars: relations, colour temperatures, offsets between bands.

The numbers are written out once more here: the published fits as they were printed, sums by hand.
"""

import numpy as np
import pytest

from warpsim.radiometry.bands import BANDS
from warpsim.sky.colours import (
    CLASS_EDGES_K,
    CLASS_TEMPERATURE_K,
    N_CLASS,
    RELATIONS,
    UNKNOWN_COLOUR_CLASS,
    colour_class,
    colour_temperature_k,
    flux_from_magnitude_a,
    magnitude_minus_a,
)

EXACT = 1e-12
DWARF_RTOL = 0.06
"""Colour temperatures against effective temperatures of dwarfs: the table is meant for dwarfs and giants alike."""

ZERO_MAG_JY = {"B1": 194.6, "B2": 188.8, "A": 58.49, "C": 26.51, "D": 18.29, "E": 8.80}

# Magnitude, colour, coefficients from the constant on, range of the colour, scatter.
FITS = {
    "G": ("G", "BP-RP", [-0.268, 2.287, -0.2565, 0.0189], (-0.26, 6.7), 0.15),
    "Hp": ("Hp", "V-I", [-0.0695, 2.8869, -0.3278, 0.0427, -0.0011], (-0.27, 5.3), 0.16),
    "V": ("V", "B-V", [-0.0135, 2.738, -0.551, 0.194], (-0.40, 1.45), 0.11),
    "VK": ("V", "V-K", [0.052, 0.970, 0.017], (-0.8, 10.0), 0.12),
    "K": ("K", "J-K", [0.039, -0.113, 0.285], (-0.35, 2.3), 0.12),
}


def test_no_relation_is_missing():
    assert set(RELATIONS) == set(FITS)


@pytest.mark.parametrize("name", FITS)
def test_relations_are_the_fits(name):
    magnitude, colour, coefficients, (low, high), scatter_mag = FITS[name]
    relation = RELATIONS[name]
    assert (relation.magnitude, relation.colour) == (magnitude, colour)
    assert relation.colour_range == (low, high)
    assert relation.scatter_mag == scatter_mag
    colours = np.linspace(low, high, 41)
    found, clipped = relation.magnitude_a(np.full(41, 6.0), colours)
    expected = 6.0 - np.polynomial.polynomial.polyval(colours, coefficients)
    np.testing.assert_allclose(found, expected, rtol=0, atol=EXACT)
    assert not clipped.any()


@pytest.mark.parametrize("name", FITS)
def test_colours_outside_are_clipped_and_said_to_be(name):
    relation = RELATIONS[name]
    low, high = FITS[name][3]
    found, clipped = relation.magnitude_a(np.full(4, 6.0), np.array([low - 1, low, high, high + 2]))
    assert clipped.tolist() == [True, False, False, True]
    assert found[0] == found[1] and found[2] == found[3]
    unknown, _ = relation.magnitude_a(np.array([6.0, np.nan]), np.array([np.nan, 0.5]))
    assert np.isnan(unknown).all()


@pytest.mark.parametrize(
    ("name", "magnitude", "colour", "magnitude_a"),
    [
        ("K", 5.0, 0.8, 4.869),  # 5 - (0.039 - 0.0904 + 0.1824)
        ("K", 5.0, -0.2, 4.927),  # 5 - (0.039 + 0.0226 + 0.0114)
        ("VK", 8.0, 3.0, 4.885),  # 8 - (0.052 + 2.910 + 0.153)
        ("VK", 8.0, 0.5, 7.45875),  # 8 - (0.052 + 0.485 + 0.00425)
        ("V", 4.0, 1.0, 1.6325),  # 4 - (-0.0135 + 2.738 - 0.551 + 0.194)
        ("G", 7.0, 2.0, 3.5688),  # 7 - (-0.268 + 4.574 - 1.026 + 0.1512)
        ("Hp", 7.0, 2.0, 2.2829),  # 7 - (-0.0695 + 5.7738 - 1.3112 + 0.3416 - 0.0176)
    ],
)
def test_relations_by_hand(name, magnitude, colour, magnitude_a):
    found, _ = RELATIONS[name].magnitude_a(np.array([magnitude]), np.array([colour]))
    assert found[0] == pytest.approx(magnitude_a, abs=1e-9)


# --- classes ---

# Colour temperature [K] of the edges, and the colours there, at which the classes were measured.
EDGES = {5250.0: (1.0, 0.8), 4500.0: (1.4, 1.2), 3850.0: (2.0, 1.8), 3500.0: (2.6, 2.4), 2800.0: (5.0, 4.5)}

# Magnitude relative to A of classes 0 (hot) to 5 (red).
OFFSETS = {
    "B1": [0.00, 0.10, 0.25, 0.30, 0.35, 0.35],
    "B2": [0.00, 0.10, 0.25, 0.30, 0.35, 0.35],
    "A": [0.00, 0.00, 0.00, 0.00, 0.00, 0.00],
    "C": [0.02, 0.00, -0.01, -0.02, -0.03, -0.05],
    "D": [0.01, 0.00, 0.00, -0.03, -0.10, -0.40],
    "E": [0.00, 0.00, 0.00, -0.05, -0.19, -0.85],
}


def test_classes_part_at_their_edges():
    assert tuple(EDGES) == CLASS_EDGES_K
    assert N_CLASS == 6
    for hotter, edge_k in enumerate(EDGES):
        # The edge itself belongs to the redder class.
        around = colour_class(np.array([np.nextafter(edge_k, 1e5), edge_k, np.nextafter(edge_k, 0.0)]))
        assert around.tolist() == [hotter, hotter + 1, hotter + 1]
    assert colour_class(np.array([1e5, 1.0, np.nan])).tolist() == [0, 5, 1]
    assert UNKNOWN_COLOUR_CLASS == 1  # a K giant


def test_edges_lie_at_the_colours_that_classes_were_measured_by():
    for edge_k, (bp_rp, v_i) in EDGES.items():
        assert colour_temperature_k(bp_rp, "BP-RP") == edge_k
        assert colour_temperature_k(v_i, "V-I") == edge_k


def test_typical_temperatures_belong_to_their_classes():
    assert CLASS_TEMPERATURE_K.tolist() == [7000.0, 4850.0, 4150.0, 3650.0, 3100.0, 2600.0]
    assert colour_class(CLASS_TEMPERATURE_K).tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize("band", OFFSETS)
def test_offsets_of_every_class(band):
    assert magnitude_minus_a(band, np.arange(6)).tolist() == OFFSETS[band]
    fluxes = flux_from_magnitude_a(np.full(6, 3.0), np.arange(6))
    assert set(fluxes) == set(BANDS)
    expected = [ZERO_MAG_JY[band] * 10 ** (-0.4 * (3.0 + offset)) for offset in OFFSETS[band]]
    np.testing.assert_allclose(fluxes[band], expected, rtol=EXACT)


# --- colour temperatures ---

NODES_K = [2200, 2800, 3500, 3850, 4500, 5250, 5772, 7000, 9600, 20000]
NODES = {
    "BP-RP": [7.0, 5.0, 2.6, 2.0, 1.4, 1.0, 0.82, 0.46, 0.0, -0.35],
    "V-I": [5.5, 4.5, 2.4, 1.8, 1.2, 0.8, 0.70, 0.43, 0.0, -0.25],
    "V-K": [11.0, 9.0, 4.7, 3.75, 2.55, 1.85, 1.50, 0.90, 0.0, -0.70],
    "J-K": [2.2, 1.45, 1.15, 1.0, 0.72, 0.50, 0.37, 0.18, 0.0, -0.18],
    "B-V": [1.9, 1.75, 1.62, 1.5, 1.1, 0.82, 0.65, 0.34, 0.0, -0.22],
}


@pytest.mark.parametrize("kind", NODES)
def test_colour_temperatures_at_and_between_nodes(kind):
    np.testing.assert_allclose(colour_temperature_k(NODES[kind], kind), NODES_K, rtol=EXACT)
    halfway = (np.array(NODES[kind][1:]) + NODES[kind][:-1]) / 2
    expected = (np.array(NODES_K[1:]) + NODES_K[:-1]) / 2
    np.testing.assert_allclose(colour_temperature_k(halfway, kind), expected, rtol=EXACT)
    beyond = colour_temperature_k([99.0, -9.0, np.nan], kind)
    np.testing.assert_array_equal(beyond, [2200.0, 20000.0, np.nan])


DWARFS = {
    # theta = 5040 K / T = a + b X + c X^2 for dwarfs, Casagrande et al. (2010), where it holds
    "V-K": ((0.5057, 0.2600, -0.0146), (0.8, 3.1)),
    "V-I": ((0.4033, 0.8171, -0.1987), (0.5, 1.4)),
    "J-K": ((0.6393, 0.6104, 0.0920), (0.2, 0.8)),
}


@pytest.mark.parametrize("kind", DWARFS)
def test_colour_temperatures_are_near_those_of_dwarfs(kind):
    (a, b, c), (low, high) = DWARFS[kind]
    colour = np.linspace(low, high, 30)
    np.testing.assert_allclose(colour_temperature_k(colour, kind), 5040 / (a + b * colour + c * colour**2), DWARF_RTOL)


def test_colour_temperatures_of_b_minus_v_are_near_a_blackbodys():
    """Ballesteros (2012), EPL 97, 34008, Eq. 14."""
    b_v = np.linspace(0.0, 1.4, 30)
    expected = 4600 * (1 / (0.92 * b_v + 1.7) + 1 / (0.92 * b_v + 0.62))
    np.testing.assert_allclose(colour_temperature_k(b_v, "B-V"), expected, DWARF_RTOL)
