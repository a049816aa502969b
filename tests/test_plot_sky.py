"""Figures of star catalogs and bands: what is drawn is what they are, against brute force, astropy and root finding."""

import subprocess
import sys

import numpy as np
import pytest
from figures import close_figures  # noqa: F401

import warpsim as ws
from warpsim.plot.partition_figure import (
    COMPREHENSIVE,
    LATITUDE,
    MESH,
    PARTITIONS,
    SORTED,
    costs_by_latitude,
    cover_of,
    plot_sky_partition,
    star_table,
    stars_in_window,
    view_costs,
)
from warpsim.plot.sky_figure import density_map, mollweide, plot_sky_density, plot_star_counts
from warpsim.radiometry.sun_and_earth import earth_spectrum, solar_spectrum
from warpsim.sky.star_counts import magnitude_counts

SEED = 20250
SKY_DEG2 = 41_252.961
MAP_AREA_RTOL = 1e-3  # squares on the limb are weighed by 144 points each
MOLLWEIDE_ATOL = 3e-4  # the table's step near the poles [rad]; a map's square is 0.017 at least
EDGE_DEG = 1e-3  # cones whose rim comes this close to the border of a cell: the samples of the rim may miss it
SIGMAS = 5.0


@pytest.fixture(scope="module")
def default():
    return ws.StarCatalog.default()


def random_sky(n, seed=SEED, **columns):
    rng = np.random.default_rng(seed)
    flux = {"A": 10.0 ** rng.uniform(-2, 4, n)}
    return ws.StarCatalog.from_arrays(rng.uniform(0, 360, n), np.degrees(np.arcsin(rng.uniform(-1, 1, n))), flux)


def random_views(n, seed=SEED):
    """Points all over the sky, a third within 5 degrees of a pole, a third within 2 degrees of a change of table."""
    rng = np.random.default_rng(seed)
    dec = np.degrees(np.arcsin(rng.uniform(-1, 1, n)))
    dec[: n // 3] = rng.choice([-1, 1], n // 3) * rng.uniform(85, 90, n // 3)
    dec[n // 3 : 2 * (n // 3)] = rng.choice([-1, 1], n // 3) * rng.uniform(58, 62, n // 3)
    return rng.uniform(0, 360, n), dec


# --- counts by magnitude ---


def test_bars_are_the_numbers_of_stars(default):
    ax = plot_star_counts(default)
    zero_mag_jy = {"B1": 194.6, "B2": 188.8, "A": 58.49, "C": 26.51, "D": 18.29, "E": 8.80}  # the paper's Table 1
    assert [text.get_text().split(",")[0] for text in ax.get_legend().get_texts()] == list(zero_mag_jy)
    for bars, (band, zero_jy) in zip(ax.containers, zero_mag_jy.items(), strict=True):
        heights = {int(np.floor(bar.get_x())): int(bar.get_height()) for bar in bars}
        # The catalog's magnitudes have three digits: one of 3.000 counts as 3, whatever the last bit of its flux.
        magnitude = np.round(-2.5 * np.log10(default.flux_jy(band) / zero_jy), 6)
        expected = np.histogram(magnitude, np.arange(-10, 21))[0]
        drawn = [heights.get(m, 0) for m in range(-10, 20)]
        assert drawn == expected.tolist()
        assert sum(drawn) == len(default)
    assert ax.get_yscale() == "log"
    assert ax.get_xlabel() and ax.get_ylabel()


def test_whole_magnitudes_and_stars_without_light():
    # Magnitudes 0 and 5 exactly, just below 5, no flux, no light.
    flux = [58.49, 0.5849, 0.5850, np.nan, 0.0]
    catalog = ws.StarCatalog.from_arrays([1.0] * 5, [2.0] * 5, {"A": flux})
    magnitudes, n_star = magnitude_counts(catalog, "A")
    assert dict(zip(magnitudes.tolist(), n_star.tolist(), strict=True)) == {0: 1, 1: 0, 2: 0, 3: 0, 4: 1, 5: 1}
    assert len(magnitude_counts(catalog, "E")[0]) == 0
    labels = [text.get_text() for text in plot_star_counts(catalog, ("A", "E")).get_legend().get_texts()]
    assert [label.endswith(": no fluxes") for label in labels] == [False, True]


def test_drawing_on_given_axes():
    from matplotlib.figure import Figure

    for draw in (plot_star_counts, plot_sky_density):
        ax = Figure().add_subplot()
        assert draw(random_sky(100), ax=ax) is ax


@pytest.mark.parametrize("draw", [plot_star_counts, plot_sky_density, plot_sky_partition])
def test_catalogs_without_stars_are_drawn(draw):
    draw(ws.StarCatalog.from_arrays([], [], {"A": []}))


# --- density map ---


@pytest.mark.parametrize("frame", ["galactic", "equatorial"])
@pytest.mark.parametrize("n_star", [300, 50_000])
def test_a_map_holds_all_stars_and_the_whole_sky(frame, n_star):
    density, extent = density_map(random_sky(n_star), frame)
    square_deg2 = (extent[1] - extent[0]) * (extent[3] - extent[2]) / density.size * np.degrees(1) ** 2
    # Whole squares only: on the limb the map divides by what lies inside.
    row, column = (np.linspace(-1, 1, n + 1) for n in density.shape)
    corners = row[:, None] ** 2 + column[None, :] ** 2 <= 1
    whole = corners[1:, 1:] & corners[1:, :-1] & corners[:-1, 1:] & corners[:-1, :-1]
    assert not np.isnan(density[whole]).any()
    counts = density[whole] * square_deg2
    np.testing.assert_allclose(counts, np.round(counts), rtol=0, atol=1e-6)
    mean = n_star / SKY_DEG2
    expected = mean * square_deg2 * whole.sum()
    assert abs(counts.sum() - expected) < SIGMAS * np.sqrt(expected)
    limb = ~whole & np.isfinite(density)
    assert density[limb].size and np.median(density[limb]) < 3 * mean


def test_the_area_of_the_map_is_that_of_the_sky():
    """A star on every place of a fine grid, weighed: the density is the same everywhere, poles included."""
    rng = np.random.default_rng(SEED)
    n_star = 400_000
    catalog = ws.StarCatalog.from_arrays(
        rng.uniform(0, 360, n_star), np.degrees(np.arcsin(rng.uniform(-1, 1, n_star))), {"A": np.ones(n_star)}
    )
    density, _ = density_map(catalog, "equatorial")
    rows = np.array_split(np.arange(len(density)), 6)
    for part in rows:
        seen = density[part][np.isfinite(density[part])]
        n_mean = n_star / SKY_DEG2 * 4  # stars in a square of 2 degrees, about
        assert np.median(seen) == pytest.approx(
            n_star / SKY_DEG2, rel=SIGMAS * 1.3 / np.sqrt(n_mean * len(seen)) + 0.02
        )


@pytest.mark.parametrize(
    ("ra_deg", "dec_deg", "x", "y"),
    [
        (266.404996, -28.936172, 0.0, 0.0),  # galactic centre
        (192.859481, 27.128251, 0.0, np.sqrt(2)),  # north galactic pole
        (86.404996, 28.936172, 2 * np.sqrt(2), 0.0),  # anticentre, on the limb
        (318.004, 48.330, -np.sqrt(2), 0.0),  # l = 90: to the left
    ],
)
def test_a_cluster_shows_where_it_is_in_the_galaxy(ra_deg, dec_deg, x, y):
    catalog = ws.StarCatalog.from_arrays(np.full(50, ra_deg), np.full(50, dec_deg), {"A": np.ones(50)})
    density, (left, _, low, high) = density_map(catalog, "galactic")
    row, column = np.unravel_index(np.nanargmax(density), density.shape)
    side = (high - low) / len(density)
    assert low + (row + 0.5) * side == pytest.approx(y, abs=side)
    drawn = left + (column + 0.5) * side
    # Longitude 180 is on either end.
    assert min(abs(drawn - x), abs(abs(drawn) - x)) < side


def test_galactic_axes_are_astropys():
    from astropy import units as u
    from astropy.coordinates import SkyCoord

    from warpsim.plot.sky_figure import _longitude_latitude_deg

    catalog = random_sky(1000)
    theirs = SkyCoord(catalog.ra_deg * u.deg, catalog.dec_deg * u.deg, frame="icrs").galactic
    ours = _unit(*_longitude_latitude_deg(catalog, "galactic"))
    # astropy goes by the FK5 axes of the definition, 0.02 arcsec (1e-7 rad) away.
    np.testing.assert_allclose(ours, _unit(theirs.l.deg, theirs.b.deg), rtol=0, atol=3e-7)


def test_mollweide_against_a_root_finder():
    from scipy.optimize import brentq

    rng = np.random.default_rng(SEED)
    longitude, latitude = rng.uniform(-180, 180, 400), np.degrees(np.arcsin(rng.uniform(-1, 1, 400)))
    latitude[:4] = [-90, 90, 89.99, 0]
    x, y = mollweide(longitude, latitude)
    for k in range(400):
        equation = lambda t, k=k: 2 * t + np.sin(2 * t) - np.pi * np.sin(np.radians(latitude[k]))  # noqa: E731
        t = brentq(equation, -np.pi / 2 - 1e-9, np.pi / 2 + 1e-9, xtol=1e-14)
        assert x[k] == pytest.approx(-np.sqrt(8) / np.pi * np.radians(longitude[k]) * np.cos(t), abs=2 * MOLLWEIDE_ATOL)
        assert y[k] == pytest.approx(np.sqrt(2) * np.sin(t), abs=MOLLWEIDE_ATOL)


def test_density_picture(default):
    ax = plot_sky_density(default, range_per_deg2=(1.0, 20.0))
    assert ax.images[0].get_clim() == (1.0, 20.0)
    assert "stars per square degree" in [other.get_ylabel() for other in ax.child_axes]


# --- partition ---


def cells_touched(ra_deg, dec_deg, radius_deg, n=20_001):
    """Zones and columns of many points of a cone: rings around its axis."""
    turn = np.linspace(0, 2 * np.pi, n)[:, None]
    away = np.radians(radius_deg) * np.array([1.0, 0.999, 0.9, 0.75, 0.5, 0.25, 0.0])
    ra, dec = np.radians([ra_deg, dec_deg])
    axis = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    east = np.array([-np.sin(ra), np.cos(ra), 0.0])
    north = np.cross(axis, east)
    x, y, z = (
        np.cos(away) * axis[k] + np.sin(away) * (np.cos(turn) * east[k] + np.sin(turn) * north[k]) for k in range(3)
    )
    longitude, latitude = np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))
    return set(np.floor(latitude + 90).clip(0, 179).astype(int).flat), set((np.floor(longitude) % 360).astype(int).flat)


@pytest.mark.ci
def test_a_cover_is_what_the_cone_touches():
    ra, dec = random_views(90)
    radius_deg = 0.75
    cover = cover_of(ra, dec, radius_deg)
    wider, narrower = (cover_of(ra, dec, radius_deg + side * EDGE_DEG) for side in (1, -1))
    n_sure = 0
    for k in range(90):
        zones, columns = cells_touched(ra[k], dec[k], radius_deg)
        covered = {(cover.first_column[k] + i) % 360 for i in range(cover.n_column[k])}
        assert zones <= set(range(cover.first_zone[k], cover.first_zone[k] + cover.n_zone[k]))
        assert columns <= covered
        if all(getattr(wider, key)[k] == getattr(narrower, key)[k] for key in ("n_zone", "n_column", "first_column")):
            n_sure += 1
            assert len(zones) == cover.n_zone[k]
            assert columns == covered
    assert n_sure > 60


@pytest.mark.parametrize(
    ("ra_deg", "dec_deg", "zone", "n_zone", "column", "n_column"),
    [
        (10.5, 0.5, 89, 3, 9, 3),
        (0.2, 30.5, 119, 3, 359, 3),
        (10.5, 90.0, 179, 1, 0, 360),
        (10.5, 89.5, 178, 2, 0, 360),
        (10.5, -89.5, 0, 2, 0, 360),
    ],
)
def test_covers_worked_out_by_hand(ra_deg, dec_deg, zone, n_zone, column, n_column):
    cover = cover_of([ra_deg], [dec_deg], 0.7)
    got = [int(values[0]) for values in (cover.first_zone, cover.n_zone, cover.first_column, cover.n_column)]
    assert got == [zone, n_zone, column, n_column]


def test_costs_are_those_of_counting_star_by_star():
    catalog, radius_deg = random_sky(20_000), 0.7071
    ra, dec = random_views(150)
    cover = cover_of(ra, dec, radius_deg)
    stars = star_table(catalog)
    assert stars.sum() == len(catalog)
    star_zone, star_column = np.floor(catalog.dec_deg + 90), np.floor(catalog.ra_deg)
    costs = {partition: view_costs(partition, stars, cover) for partition in PARTITIONS}
    window = stars_in_window(catalog, cover)
    inside = catalog.direction_icrs @ _unit(ra, dec).T >= np.cos(np.radians(radius_deg))
    for k in range(150):
        in_zone = (star_zone >= cover.first_zone[k]) & (star_zone < cover.first_zone[k] + cover.n_zone[k])
        in_column = (star_column - cover.first_column[k]) % 360 < cover.n_column[k]
        polar = (star_zone < 30) | (star_zone >= 150)
        expected = {MESH: in_zone & in_column, LATITUDE: in_zone, COMPREHENSIVE: in_zone & (in_column | polar)}
        for partition, mask in expected.items():
            assert costs[partition][1][k] == np.count_nonzero(mask), (partition, k)
            assert not (inside[:, k] & ~mask).any()  # no star of the view is missed
        in_window = in_zone & ((catalog.ra_deg - cover.west_deg[k]) % 360 <= cover.width_deg[k])
        assert window[k] == np.count_nonzero(in_window)
        assert not (inside[:, k] & ~in_window).any()
        zones = np.arange(cover.first_zone[k], cover.first_zone[k] + cover.n_zone[k])
        n_polar = np.count_nonzero((zones < 30) | (zones >= 150))
        n_column = cover.n_column[k]
        assert costs[MESH][0][k] == n_column * len(zones)
        assert costs[LATITUDE][0][k] == len(zones)
        assert costs[COMPREHENSIVE][0][k] == n_polar + n_column * (len(zones) - n_polar)


def _unit(ra_deg, dec_deg):
    ra, dec = np.radians(ra_deg), np.radians(dec_deg)
    return np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)


def test_the_comprehensive_table_is_the_mesh_below_60_degrees_and_the_latitude_table_above(default):
    latitude, costs, n_inside = costs_by_latitude(default, n_view=60)
    for quantity in ("stars", "cells"):
        mixed, mesh, zones = (costs[p.name][quantity] for p in (COMPREHENSIVE, MESH, LATITUDE))
        np.testing.assert_array_equal(mixed[latitude < 59], mesh[latitude < 59])
        np.testing.assert_array_equal(mixed[latitude > 61], zones[latitude > 61])
    # Why there are three: see the docstring of plot_sky_partition.
    assert costs[LATITUDE.name]["stars"][0] > 100 * costs[COMPREHENSIVE.name]["stars"][0]
    assert costs[MESH.name]["cells"][88] > 50 * costs[COMPREHENSIVE.name]["cells"][88]
    assert (n_inside <= costs[SORTED]["stars"]).all()
    assert (costs[SORTED]["stars"] <= costs[COMPREHENSIVE.name]["stars"]).all()


@pytest.mark.ci
def test_stars_in_the_cone_are_as_many_as_brute_force_finds(default):
    """Means over latitudes: both count the same sky."""
    latitude, _, n_inside = costs_by_latitude(default, n_view=10)
    rng = np.random.default_rng(SEED)
    axis = rng.normal(size=(300, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    found = np.count_nonzero(default.direction_icrs @ axis.T >= np.cos(np.radians(np.sqrt(0.5))))
    mean = np.average(n_inside, weights=np.cos(np.radians(latitude)))
    assert mean == pytest.approx(found / 300, rel=SIGMAS * 1.3 / np.sqrt(found))  # 1.3: clumps in the Milky Way


def test_partition_picture(default):
    axes = plot_sky_partition(default)
    assert len(axes) == 5
    assert [ax.get_title().split(") ")[1] for ax in axes[:3]] == [partition.name for partition in PARTITIONS]
    for ax in axes[3:]:
        assert ax.get_yscale() == "log" and "[deg]" in ax.get_xlabel()
    assert plot_sky_partition(default, axes) is axes


# --- bad input, and no input ---


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda c: plot_star_counts(c, ()), "^bands: must name at least one$"),
        (lambda c: plot_star_counts(c, ("A", "Z")), "Z"),
        (lambda c: plot_sky_density(c, "ecliptic"), '^frame: must be "galactic" or "equatorial", got \'ecliptic\'$'),
        (lambda c: plot_sky_density(c, range_per_deg2=(2.0, 1.0)), "^range_per_deg2: must be two growing positive"),
        (lambda c: plot_sky_density(c, range_per_deg2=(0.0, 1.0)), "^range_per_deg2: must be two growing positive"),
        (lambda c: plot_sky_partition(c, [None]), "^axes: must be 5, got 1$"),
    ],
)
def test_bad_input_is_named_in_one_line(draw, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        draw(random_sky(10))
    assert "\n" not in str(caught.value)


@pytest.mark.ci
def test_matplotlib_is_loaded_only_to_draw(checkout_environment):
    script = "import sys, warpsim.plot, warpsim.output.star_catalogs; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], env=checkout_environment, check=False).returncode == 0


# --- bands ---


@pytest.fixture(scope="module")
def drawn_bands():
    surface = {"reflectance": {"wavelength_um": [0.4, 2.0, 4.0], "value": [0.9, 0.8, 0.1]}}
    changes = {f"targets__{k}__surface": surface for k in range(4)}
    bands = [ws.Band.top_hat("red", 0.6, 0.7, per_photon=True), "A"]
    scene = ws.Scene.load("stss").replace(**changes, bands=bands)
    return scene, ws.plot.plot_bands(scene)


def test_responses_are_areas_with_names(drawn_bands):
    _, ax = drawn_bands
    assert [text.get_text() for text in ax.texts] == ["red", "A"]
    red, infrared = (line.get_xydata() for line in ax.lines)
    np.testing.assert_allclose(red, [[0.6, 0.0], [0.6, 1.0], [0.7, 1.0], [0.7, 0.0]])
    np.testing.assert_array_equal(infrared[1:-1, 1], ws.BANDS["A"].response)
    assert ax.get_xlim() == (0.3, 30.0)


def test_spectra_are_powers_over_their_peak(drawn_bands):
    scene, ax = drawn_bands
    (spectra,) = (other for other in ax.figure.axes if other is not ax)
    lines = {line.get_label(): line.get_xydata() for line in spectra.lines}
    assert list(lines)[:1] == ["Sun"] and "Earth, emitted" in lines
    names = ", ".join(dict.fromkeys(target.spec.name for target in scene.scenario.targets))  # all alike: one line
    assert f"{names}, 350 K" in lines and f"{names}, reflected" in lines
    for label, spectrum in (("Sun", solar_spectrum().at), ("Earth, emitted", earth_spectrum().radiance_w_m2_sr_um)):
        wavelength_um, drawn_power = lines[label].T
        power = wavelength_um * spectrum(wavelength_um)
        np.testing.assert_allclose(drawn_power, power / power.max(), rtol=1e-12)
    peak_um = lines["Sun"][lines["Sun"][:, 1].argmax(), 0]
    assert 0.45 < peak_um < 0.75
    assert 8.0 < lines["Earth, emitted"][lines["Earth, emitted"][:, 1].argmax(), 0] < 13.5
