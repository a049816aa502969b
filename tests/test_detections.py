"""Detections against bounds, rates and directions that other code gives: ERFA, astropy, SciPy and draws of noise."""

import erfa
import numpy as np
import pytest
from astropy.coordinates import SkyCoord
from astropy.time import Time
from conftest import slow
from scipy import stats
from scipy.spatial.transform import Rotation

import warpsim as ws

C_M_S = 299792458.0
GATE_SIGMA = 5.0
"""Statistical gates, of fixed seeds."""


def small_scene(n_target=1, nei_w_cm2=3e-19, psf=("gaussian", 0.8), **more):
    """One group's first targets as the paper's ten sensors see them through small cameras that shake by a pixel."""
    scene = ws.Scene.load("stss")
    kind, size = psf
    gaussian = {"optics__psf": "gaussian", "optics__sigma_px": size}
    optics = gaussian if kind == "gaussian" else {"optics__aperture_m": size}
    fields = {
        "sky__catalog": "none", "targets": scene.targets[:n_target], "bands": ["A"],
        "camera__n_row": 32, "camera__n_col": 32, "camera__fov_deg": 0.25,
        "detector__nei_w_cm2": nei_w_cm2, "detector__sei_w_cm2": 1e-13, "detector__bits": 16,
        "pointing__jitter": {"rms_urad": 100.0, "correlation_s": 1.0},
    }  # fmt: skip
    return scene.replace(**(fields | optics | more))


@pytest.fixture(scope="module")
def frames():
    """The paper's group of 30, two sensors, two bands."""
    scene = ws.Scene.load("stss").replace(optics__psf="gaussian", optics__sigma_px=0.7)
    return ws.Renderer(scene).render(range(100, 130, 10), sensors=["sat11", "sat27"], bands=["A", "C"])


@pytest.fixture(scope="module")
def shaken():
    """Some 600 images of one target at positions all over a pixel."""
    return ws.Renderer(small_scene()).render(range(0, 162, 2))


def truth_of(frames, table):
    """The rows of the truth that rows of detections are of."""
    truth = frames.truth
    index = {tuple(row): number for number, row in enumerate(truth["frame", "sensor", "band", "target"])}
    return truth[[index[tuple(row)] for row in table["frame", "sensor", "band", "target"]]]


def assert_standard(values, what):
    """Mean 0 and variance 1 within the gate."""
    values = np.asarray(values)
    n = len(values)
    assert abs(values.mean()) < GATE_SIGMA / np.sqrt(n), what
    assert abs(values.var() - 1.0) < GATE_SIGMA * np.sqrt(2.0 / n), what


# ------------------------------------------------------------------------------------------------------ from truth


def test_errors_of_drawn_detections_are_as_stated(shaken):
    found = [ws.detections(shaken, method="truth", probability=1.0, seed=seed) for seed in range(3)]
    for table in found:
        there = truth_of(shaken, table)
        for name in ("x", "y"):
            assert_standard((table[f"{name}_px"] - there[f"{name}_px"]) / table[f"{name}_sigma_px"], name)
        off = (table["irradiance_w_cm2"] - there["irradiance_w_cm2"]) / table["irradiance_sigma_w_cm2"]
        assert_standard(off, "irradiance")
    assert len(found[0]) > 500
    first, second = (table["x_px"] - truth_of(shaken, table)["x_px"] for table in found[:2])
    assert abs(np.corrcoef(first, second)[0, 1]) < GATE_SIGMA / np.sqrt(len(first))  # another seed, other numbers


@pytest.mark.parametrize("probability", [None, 0.3])
def test_targets_are_detected_as_often_as_asked(probability):
    scene = small_scene(nei_w_cm2=2e-18)
    renderer, numbers = ws.Renderer(scene), range(1, 162, 2)
    table = ws.detections(renderer, numbers, method="truth", probability=probability, threshold_sigma=5.0)
    every = ws.detections(renderer, numbers, method="truth", probability=1.0, threshold_sigma=5.0)
    light = truth_of(renderer.render(numbers), every)["irradiance_w_cm2"]
    chance = stats.norm.cdf(light / every["irradiance_sigma_w_cm2"] - 5.0) if probability is None else probability
    chance = np.broadcast_to(chance, len(every))
    assert 0.1 < chance.mean() < 0.9
    assert abs(len(table) - chance.sum()) < GATE_SIGMA * np.sqrt(np.sum(chance * (1 - chance)))
    if probability is None:
        assert (table["snr"] >= 5.0).all()


def test_clutter_is_poisson_even_and_just_above_the_threshold(shaken):
    mean, n_image = 2.5, 81 * len(shaken.sensors)
    table = ws.detections(shaken, method="truth", probability=0.0, clutter_per_image=mean, threshold_sigma=4.0)
    assert (table["target"] == "").all() and (table["clump_id"] == -1).all() and (table["n_merged"] == 0).all()
    assert abs(len(table) - mean * n_image) < GATE_SIGMA * np.sqrt(mean * n_image)
    images = np.unique(table["frame", "sensor"].as_array(), return_counts=True)[1]
    counts = np.r_[images, np.zeros(n_image - len(images))]
    assert abs(counts.var() / mean - 1.0) < GATE_SIGMA * np.sqrt((2.0 + 1.0 / mean) / n_image)
    for name in ("x_px", "y_px"):
        assert stats.kstest(table[name], stats.uniform(-0.5, 32).cdf).pvalue > 1e-6
    tail = stats.norm.sf(table["snr"]) / stats.norm.sf(4.0)
    assert stats.kstest(tail, "uniform").pvalue > 1e-6


def test_an_image_has_the_same_detections_in_any_company(frames):
    options = {"method": "truth", "clutter_per_image": 1.5, "seed": 3}
    every = ws.detections(frames, **options)
    alone = ws.detections(frames, [110], "sat27", "C", **options)
    some = ws.detections(frames, [120, 110], ["sat27"], ["C", "A"], **options)
    mine = every[(every["frame"] == 110) & (every["sensor"] == "sat27") & (every["band"] == "C")]
    again = some[(some["frame"] == 110) & (some["band"] == "C")]
    assert len(alone) > 5
    for table in (alone, again):
        for name in every.colnames:
            assert (np.asarray(table[name]) == np.asarray(mine[name])).all(), name
    other = ws.detections(frames, [110], "sat27", "C", method="truth", clutter_per_image=1.5, seed=4)
    assert not set(other["x_px"]) & set(alone["x_px"])
    assert (other.meta["DRAW_SEED"], other.meta["METHOD"]) == (4, "truth")
    assert frames.truth.meta.items() <= other.meta.items()
    scene = ws.detections(frames.scenario, [110], "sat27", "C", **options)
    assert (scene["x_px"] == alone["x_px"]).all()


def test_targets_that_merge_are_one_detection_where_their_light_is():
    renderer = ws.Renderer(small_scene(n_target=2, nei_w_cm2=1e-19, pointing__jitter=None))
    near = renderer.render(range(5, 8), sensors=["sat11"])
    truth = near.truth
    table = ws.detections(near, method="truth")
    for frame in range(5, 8):
        rows = truth[(truth["frame"] == frame) & (truth["irradiance_w_cm2"] > 0)]
        (found,) = table[(table["frame"] == frame) & (table["n_merged"] > 1)]
        light = rows["irradiance_w_cm2"]
        assert found["n_merged"] == len(rows) > 2
        assert found["target"] == rows["target"][np.argmax(light)]
        assert found["x_px"] == pytest.approx(np.sum(light * rows["x_px"]) / light.sum(), abs=6 * found["x_sigma_px"])
        assert found["irradiance_w_cm2"] == pytest.approx(light.sum(), abs=6 * found["irradiance_sigma_w_cm2"])


# ------------------------------------------------------------------------------------------- directions and states


def test_directions_are_those_of_erfa_and_astropy(frames):
    """ERFA's aberration out of the Earth's frame and into the sensor's, then astropy's WCS, lead back to the pixel."""
    table = ws.detections(frames, [110], method="truth", clutter_per_image=5.0)
    for sensor in frames.sensors:
        rows = table[table["sensor"] == sensor]
        when = Time(str(rows["date_obs"][0]), scale="utc")
        earth_m_s = np.asarray(erfa.epv00(when.tdb.jd1, when.tdb.jd2)[1]["v"]) * (erfa.DAU / erfa.DAYSEC)
        sensor_m_s = earth_m_s + np.array([rows[f"sensor_v{axis}_m_s"][0] for axis in "xyz"])
        apparent = SkyCoord(rows["ra_deg"], rows["dec_deg"], unit="deg").cartesian.xyz.value.T
        for velocity in (-earth_m_s, sensor_m_s):
            beta = velocity / C_M_S
            apparent = np.array([erfa.ab(one, beta, 1e12, np.sqrt(1 - beta @ beta)) for one in apparent])
        ra_dec = np.degrees(np.stack(erfa.c2s(apparent), axis=1))
        xy = frames.wcs(110, sensor).all_world2pix(ra_dec, 0)
        np.testing.assert_allclose(xy, np.c_[rows["x_px"], rows["y_px"]], atol=1e-6)


@pytest.mark.ci
def test_states_of_sensors_are_those_of_their_times():
    scene = small_scene(detector__line_time_s=0.02, detector__exposure_s=0.01)
    frames = ws.Renderer(scene).render(range(100, 110), sensors=["sat11"])
    table = ws.detections(frames, method="truth", clutter_per_image=3.0)
    since_s = [(Time(str(date), scale="utc") - scene.epoch).sec for date in table["date_obs"]]
    np.testing.assert_allclose(table["time_s"], since_s, atol=1e-6)
    row_s = (table["y_px"] - 15.5) * 0.02
    np.testing.assert_allclose(table["time_s"] - 10.0 * table["frame"], np.clip(row_s, -0.32, 0.32), atol=1e-9)
    position = np.stack([table[f"sensor_{axis}_m"] for axis in "xyz"], axis=1)
    np.testing.assert_allclose(position, scene.position_m("sat11", table["time_s"]), atol=1e-6)
    assert (np.diff(table["time_s"]) >= 0).all()


def test_quaternions_turn_into_camera_axes(frames):
    table = ws.detections(frames, method="truth")
    q = np.stack([table[f"sensor_q{axis}"] for axis in "xyzw"], axis=1)
    views = [(frames.frames.index(row["frame"]), frames.sensors.index(row["sensor"])) for row in table]
    expected = frames.axes_icrs[tuple(np.transpose(views))]
    np.testing.assert_allclose(Rotation.from_quat(q).as_matrix(), expected, atol=1e-12)


N_DRAW = 20_000


@pytest.mark.ci
def test_errors_of_directions_are_those_of_draws():
    """Through a wide, distorted camera of tall pixels, at a corner, near the pole's meridians."""
    wide = {"camera__fov_deg": 20.0, "camera__pixel_aspect": 1.5, "camera__distortion": {"k1": -0.1, "p1": 0.02}}
    scene = small_scene(**wide, pointing__roll_deg=30.0)
    frames = ws.Renderer(scene).render([100], sensors=["sat11", "sat27"])
    table = ws.detections(frames, method="truth", probability=0.0, clutter_per_image=3.0)
    rng = np.random.default_rng(1)
    assert len(table) > 2
    for row in table:
        sigma = 0.02 * np.array([row["x_sigma_px"], row["y_sigma_px"]])  # within which the camera is linear
        xy = [row["x_px"], row["y_px"]] + sigma * rng.normal(size=(N_DRAW, 2))
        x, y, z = frames.line_of_sight(100, row["sensor"], xy).direction.T
        seen = SkyCoord(x, y, z, representation_type="cartesian")
        seen.representation_type = "unitspherical"
        here = SkyCoord(row["ra_deg"], row["dec_deg"], unit="deg")
        offsets = np.stack([part.deg for part in here.spherical_offsets_to(SkyCoord(seen.ra, seen.dec))]) / 0.02
        gate = GATE_SIGMA / np.sqrt(N_DRAW)
        spread = [row["ra_cosdec_sigma_deg"], row["dec_sigma_deg"]]
        np.testing.assert_allclose(offsets.std(axis=1), spread, rtol=gate)
        assert np.corrcoef(offsets)[0, 1] == pytest.approx(row["ra_dec_corr"], abs=gate)
    assert np.abs(table["ra_dec_corr"]).max() > 0.1


# ------------------------------------------------------------------------------------------------------ from images

WELL_SEEN = ["sat11", "sat27", "sat41", "sat47"]
WITHIN = 1.2
"""Errors over the Cramer-Rao bound."""


def bounds(xy_px, snr, psf):
    """Cramer-Rao bounds of x, y and flux by differences of images that `deposit` draws, each source on its own."""
    cell, half, step = 31, 15, 0.02
    shift = np.array([[0, 0], [step, 0], [-step, 0], [0, step], [0, -step]])
    n = len(xy_px)
    centre = np.stack([half + cell * np.arange(n), np.full(n, half)], axis=1) + (xy_px - np.round(xy_px))
    images = [ws.deposit(centre + move, np.ones(n), psf, (cell, cell * n), flux_error=1e-7) for move in shift]
    at, right, left, down, up = (
        np.moveaxis(image.astype(np.float64).reshape(cell, n, cell), 1, 0).reshape(n, -1) for image in images
    )
    flux = np.asarray(snr)[:, None]
    slopes = np.stack([(right - left) / (2 * step) * flux, (down - up) / (2 * step) * flux, at], axis=1)
    information = np.einsum("nap,nbp->nab", slopes, slopes)
    return np.sqrt(np.einsum("naa->na", np.linalg.inv(information)))


@pytest.mark.ci
@pytest.mark.parametrize(("kind", "size"), [("gaussian", 0.8), slow("airy", 0.06)])
def test_fits_reach_the_cramer_rao_bound(kind, size):
    scene = small_scene(psf=(kind, size), nei_w_cm2=2.5e-19)
    frames = ws.Renderer(scene).render(range(30, 130), sensors=WELL_SEEN)
    table = ws.detections(frames, background_px=0)
    table = table[table["target"] != ""]
    there = truth_of(frames, table)
    inside = (np.abs(there["x_px"] - 15.5) < 9) & (np.abs(there["y_px"] - 15.5) < 9) & (table["snr"] > 10)
    table, there = table[inside], there[inside]
    noise = np.sqrt(1 + 1 / 12 / scene.detector.counts_per_nei**2)
    psf = scene.scenario.instrument.psf("A")
    bound = bounds(np.c_[there["x_px"], there["y_px"]], there["snr"] / noise, psf) * [1.0, 1.0, noise * 2.5e-19]
    off = np.stack([table[name] - there[name] for name in ("x_px", "y_px", "irradiance_w_cm2")], axis=1)
    stated = np.stack([table[name] for name in ("x_sigma_px", "y_sigma_px", "irradiance_sigma_w_cm2")], axis=1)
    assert len(table) > 250
    for axis, name in enumerate(("column", "row", "light")):
        ratio = float(np.sqrt(np.mean((off[:, axis] / bound[:, axis]) ** 2)))
        assert 0.8 < ratio < WITHIN, name
        assert abs(np.std(off[:, axis] / stated[:, axis]) - 1.0) < 0.1
    assert np.mean(table["poor_fit"]) < 0.01


@pytest.mark.ci
def test_errors_hold_in_a_crowd():
    """Of sources in neighbouring pixels some are taken together; errors are as large as stated all the same."""
    frames = ws.Renderer(ws.Scene.load("stss")).render(range(60, 80), sensors=["sat27"], bands=["A"], keep_stars=True)
    found = ws.detections(frames)
    score = ws.evaluate.detections(found, frames.truth, radius_px=1.0, ignore=frames.stars)
    bins = score.by("neighbour_px", [1.0, 1.5, 2.0, 3.0, 5.0])
    assert (bins["n_found"] > 10).all() and (bins["chi_square"] < 3.0).all()
    poor = found["poor_fit"]
    assert 0.3 < poor.mean() < 0.9
    np.testing.assert_allclose(found["x_sigma_px"][poor], 12**-0.5)
    apart = score.truth[(score.truth["outcome"] == "found") & (score.truth["neighbour_px"] > 3.5)]
    assert len(apart) > 10 and np.mean(poor[apart["found_row"]]) < 0.2


@pytest.mark.ci
def test_images_are_as_sensitive_as_the_draws_say():
    """As many targets about the threshold are found in pixels as are drawn without them."""
    frames = ws.Renderer(small_scene(nei_w_cm2=4e-18)).render(range(30, 130), sensors=WELL_SEEN)
    drawn, found = (ws.detections(frames, method=method) for method in ("truth", "matched_filter"))
    n_image = 100 * len(frames.sensors)
    n_found, n_false = np.sum(found["target"] != ""), np.sum(found["target"] == "")
    gate = GATE_SIGMA * np.sqrt(len(drawn))
    # The best of a fit's positions has some more light than the true one: 0.3 sigma at the threshold.
    assert len(drawn) - gate < n_found < 1.15 * len(drawn) + gate
    assert n_false < 3e-3 * n_image + 5  # 32 x 32 pixels, several positions each, beyond 5 sigma


@pytest.mark.parametrize("method", ["sep", "photutils"])
def test_other_finders_find_the_same(frames, method):
    pytest.importorskip(method if method == "sep" else "photutils.detection", reason="needs the extra detect")
    own, theirs = (ws.detections(frames, bands="A", method=name) for name in ("matched_filter", method))
    assert theirs.meta["METHOD"] == method
    bright = own[(own["snr"] > 15) & (own["n_merged"] == 1)]
    names = {tuple(row) for row in theirs["frame", "sensor", "target"]}
    assert len(bright) > 20
    assert np.mean([tuple(row) in names for row in bright["frame", "sensor", "target"]]) > 0.8


@pytest.mark.slow
def test_what_is_no_target_is_a_star():
    frames = ws.Renderer(ws.Scene.load("stss")).render(range(60, 90, 6), bands=["A"], keep_stars=True)
    table, stars = ws.detections(frames), frames.stars
    others = table[table["target"] == ""]
    for row in others:
        near = stars[(stars["frame"] == row["frame"]) & (stars["sensor"] == row["sensor"])]
        distance = np.hypot(near["x_px"] - row["x_px"], near["y_px"] - row["y_px"])
        assert np.any((distance < 1.0) & (near["snr"][:, 0] > 3.0)), dict(row)
    assert len(others) > 20


def test_light_within_one_pixel_is_detected_in_it():
    """A blur of a thousandth of a pixel: nothing is known of the position but the pixel."""
    frames = ws.Renderer(small_scene(psf=("gaussian", 1e-3))).render(range(100, 110), sensors=["sat11", "sat27"])
    for method in ("truth", "matched_filter"):
        table = ws.detections(frames, method=method)
        named = table[table["target"] == "center"]
        assert len(named) > 10
        there = truth_of(frames, named)
        np.testing.assert_allclose(named["x_sigma_px"], 12**-0.5)
        off = (named["irradiance_w_cm2"] - there["irradiance_w_cm2"]) / named["irradiance_sigma_w_cm2"]
        assert np.abs(off).max() < GATE_SIGMA
        if method == "matched_filter":
            assert (np.round(named["x_px"]) == np.round(there["x_px"])).all()


def test_nothing_is_found_where_all_is_full():
    image = ws.Renderer(small_scene(background__earth=True)).render([100], sensors=["sat27"])
    drawn = ws.detections(image, method="truth", probability=1.0, clutter_per_image=5.0)
    assert len(ws.detections(image)) == len(drawn) == 0
    (row,) = ws.photometry(image, "center")
    assert np.isnan(row["irradiance_w_cm2"]) and row["blended"] and row["full_px"] > 0


# ------------------------------------------------------------------------------------------------------- bad input


def test_bad_input_is_one_line(frames):
    for source, options, text in (
        (frames.scenario, {"method": "sep"}, "method: must be truth of a scene; others need rendered frames, got"),
        (frames, {"method": "x"}, "method: must be one of truth, matched_filter, sep, photutils, got 'x'"),
        (frames, {"threshold_sigma": 0}, "threshold_sigma: must be a number above 0, got 0"),
        (frames, {"method": "truth", "probability": 2}, "probability: must be a number from 0 to 1, got 2"),
        (frames, {"clutter_per_image": 1.0}, "must be left out where detections are found in pixels"),
        (frames, {"frames": [3]}, "frames: frame 3 of 'sat11' in band 'A' was not rendered"),
        (frames, {"frames": [110.7]}, "frames: must be a whole number >= 0, got 110.7"),
        (frames, {"sensors": "sat12"}, "sensors: must be among sat11, sat27, got 'sat12'"),
        (frames, {"match_px": -1}, "match_px: must be a number above 0, got -1"),
        ("stss", {}, "scene: must be a Scene or a Scenario, got str"),
    ):
        with pytest.raises(ws.InputError) as error:
            ws.detections(source, **options)
        assert text in str(error.value) and "\n" not in str(error.value)


def test_nothing_detected_is_a_table_of_no_rows(frames, tmp_path):
    table = ws.detections(frames, method="truth", probability=0.0)
    assert len(table) == 0 and table["x_px"].dtype == np.float64 and table["frame"].dtype == np.int64
    assert table.colnames == ws.detections(frames, [110], method="truth").colnames
    table.write(tmp_path / "x.ecsv")
