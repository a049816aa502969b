"""Infrared magnitudes predicted from G and BP-RP against 2MASS and WISE, of stars that made no template.

`catalogs/collect_star_photometry.py` collected the stars; every second one of them made the templates, the others are
compared here.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from warpsim.sky.stellar_templates import DWARF, GIANT, colour, colour_temperature_k
from warpsim.sky.visible_stars import FAIR, by_gaia, by_hipparcos

STARS = Path(__file__).parent / "data" / "star_photometry.csv"

MEDIAN_LIMIT_MAG = 0.1  # asked of every class and band
SCATTER_LIMIT_MAG = 0.08  # half of what a fair star may have
FAIR_LIMIT_MAG = 0.45  # three times the 0.15 mag of a fair star
FAIR_SHARE = 0.01

CLASSES = {"FGK dwarfs": (DWARF, 0.5, 1.7), "M dwarfs": (DWARF, 1.7, 3.6), "giants": (GIANT, 0.9, 2.3)}
FEWEST = 10  # a median of fewer stars says little
RECORDED = {
    "FGK dwarfs": ("W1 to W4 of FGK dwarfs from G, median", "W1 to W4 of FGK dwarfs from G, scatter"),
    "M dwarfs": ("W2 to W4 of M dwarfs from G, median", "W2 to W4 of M dwarfs from G, scatter"),
    "giants": ("W3 and W4 of giants from G, median", "W3 and W4 of giants from G, scatter"),
}
N_STAR = {
    "FGK dwarfs": {"W1": 48, "W2": 116, "W3": 280, "W4": 173},
    "M dwarfs": {"W2": 17, "W3": 34, "W4": 26},
    "giants": {"W3": 47, "W4": 57},
}
"""Stars that the lines of docs/accuracy.md stand on, as its note (benchmarks/accuracy.py) has them. W1 and W2 of giants
are saturated; three M dwarfs have a W1."""


@pytest.fixture(scope="module")
def measured():
    with STARS.open(encoding="ascii", newline="") as stream:
        rows = list(csv.DictReader(stream))[1::2]
    names = [name for name in rows[0] if name not in ("hip", "source")]
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in names}


@pytest.fixture(scope="module")
def stars(measured):
    return by_gaia(*(measured[name] for name in ("G", "BP-RP", "parallax_mas", "pm_mas_yr", "Hp")))


def of_class(name, stars, bp_rp_mag):
    luminosity, bluest, reddest = CLASSES[name]
    return (stars.luminosity == luminosity) & (bp_rp_mag >= bluest) & (bp_rp_mag < reddest)


def residual(measured, stars, band):
    """Measured minus predicted magnitude."""
    return measured[band] - (measured["G"] - colour("G", band, stars.luminosity, stars.temperature_k))


@pytest.mark.parametrize("name", CLASSES)
def test_infrared_of_classes(name, measured, stars, record_accuracy):
    chosen = of_class(name, stars, measured["BP-RP"])
    bands, n_star = [], {}
    for band in ("J", "H", "Ks", "W1", "W2", "W3", "W4"):
        deviation = residual(measured, stars, band)[chosen]
        deviation = deviation[np.isfinite(deviation)]
        if len(deviation) < FEWEST:
            continue
        bands.append(band)
        median = np.median(deviation)
        scatter = 1.48 * np.median(np.abs(deviation - median))
        assert abs(median) < MEDIAN_LIMIT_MAG
        assert scatter < SCATTER_LIMIT_MAG
        if band.startswith("W"):
            n_star[band] = len(deviation)
            record_accuracy(RECORDED[name][0], abs(median), MEDIAN_LIMIT_MAG, "mag", "WISE")
            record_accuracy(RECORDED[name][1], scatter, SCATTER_LIMIT_MAG, "mag", "WISE")
    assert {"J", "H", "Ks"} <= set(bands)
    assert n_star == N_STAR[name]


@pytest.mark.parametrize("name", CLASSES)
def test_fair_stars_are_fair(name, measured, stars, record_accuracy):
    chosen = of_class(name, stars, measured["BP-RP"]) & (stars.quality == FAIR)
    deviation = np.concatenate([residual(measured, stars, band)[chosen] for band in ("Ks", "W1", "W2", "W3", "W4")])
    deviation = deviation[np.isfinite(deviation)]
    assert len(deviation) > 90
    share = np.mean(np.abs(deviation) > FAIR_LIMIT_MAG)
    record_accuracy("Stars of quality 2 off by more than 0.45 mag", share, FAIR_SHARE, "of them", "2MASS, WISE")
    assert np.mean(chosen) / np.mean(of_class(name, stars, measured["BP-RP"])) > 0.85


def test_quality_tells_who_is_off(measured, stars):
    """Nearly all that are off are flagged: pairs that Gaia resolves and 2MASS does not."""
    off = np.abs(residual(measured, stars, "Ks")) > FAIR_LIMIT_MAG
    assert off.sum() >= 10
    assert np.mean(stars.quality[off] < FAIR) > 0.9


@pytest.mark.parametrize(("kind", "bands"), [("V-K", ("V", "Ks")), ("J-K", ("J", "Ks"))])
@pytest.mark.parametrize("name", CLASSES)
def test_back_to_the_visible(kind, bands, name, measured, stars, record_accuracy):
    """G from Ks, by an infrared or long colour; J-K of M dwarfs does not tell their temperature."""
    if (kind, name) == ("J-K", "M dwarfs"):
        pytest.skip("J-K of M dwarfs is the same for all")
    chosen = of_class(name, stars, measured["BP-RP"])
    value = measured[bands[0]] - measured[bands[1]]
    temperature_k = colour_temperature_k(value, kind, stars.luminosity)
    deviation = (measured["G"] - measured["Ks"] - colour("G", "Ks", stars.luminosity, temperature_k))[chosen]
    deviation = deviation[np.isfinite(deviation)]
    assert len(deviation) > FEWEST
    record_accuracy("G of stars from Ks, median", abs(np.median(deviation)), MEDIAN_LIMIT_MAG, "mag", "Gaia DR3")


def test_w4_lies_between_the_surveys(measured, stars):
    """WISE's W4 is 0.05 mag brighter than Spitzer's 24 um: templates go between the two."""
    deviation = residual(measured, stars, "W4")[of_class("FGK dwarfs", stars, measured["BP-RP"])]
    assert -0.05 < np.nanmedian(deviation) < 0.0


def test_m_dwarfs_by_hipparcos_alone(measured, stars):
    """Their V-I is often guessed, the absolute magnitude is not: no more than 0.1 mag off on average."""
    chosen = of_class("M dwarfs", stars, measured["BP-RP"]) & np.isfinite(measured["Hp"])
    alone = by_hipparcos(*(measured[name] for name in ("Hp", "V-I", "B-V", "parallax_mas", "pm_mas_yr")))
    assert (alone.quality[chosen] < FAIR).all()
    predicted = measured["Hp"] - colour("Hp", "Ks", alone.luminosity, alone.temperature_k)
    deviation = (measured["Ks"] - predicted)[chosen]
    assert abs(np.nanmedian(deviation)) < MEDIAN_LIMIT_MAG
    assert np.nanmean(np.abs(deviation) > 1.0) < 0.02


def test_stars_without_a_colour_are_uncertain():
    star = by_gaia([7.0], [np.nan], [np.nan], [np.nan], [np.nan])
    assert (star.luminosity[0], star.quality[0]) == (GIANT, 1)
    assert np.isnan(star.temperature_k[0])
    star = by_hipparcos([3.0, 3.0], [np.nan, 0.6], [np.nan, 0.55], [10.0, 10.0], [5.0, 5.0])
    assert star.quality.tolist() == [1, 2]
    assert np.isnan(star.temperature_k).tolist() == [True, False]
