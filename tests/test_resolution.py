"""What truth says of states, and of how well targets can be told apart and measured."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation
from scipy.special import erf

import warpsim as ws
from warpsim.render.resolution import merge_px

BASE = {"sky__catalog": "none", "optics__psf": "gaussian", "optics__sigma_px": 0.7}
ELECTRONS = {
    "kind": "electron", "exposure_s": 0.1, "full_well_e": 6e6, "gain_e_per_count": 100.0, "bits": 16,
    "read_noise_e": 20.0, "dark_e_s": 100.0, "background_w_cm2_sr": 1e-13,
}  # fmt: skip
SENSORS = ["sat11", "sat27"]
C_M_S = 299792458.0


def rendered(frames=range(60, 64), keep_signal=False, sensors=SENSORS, **changes):
    scene = ws.Scene.load("stss").replace(**(BASE | changes))
    return ws.Renderer(scene).render(frames, sensors=sensors, keep_signal=keep_signal)


@pytest.fixture(scope="module")
def frames():
    return rendered()


def pixel_slopes(x, y, flux, sigma, side):
    """A Gaussian integrated over pixels, and its derivatives by x and y, in closed form; each (side, side)."""

    def along(centre):
        edges = (np.arange(side + 1) - 0.5 - centre) / sigma
        below, density = 0.5 * (1 + erf(edges / np.sqrt(2))), np.exp(-0.5 * edges**2) / (sigma * np.sqrt(2 * np.pi))
        return np.diff(below), -np.diff(density)

    (across, d_across), (down, d_down) = along(x), along(y)
    return flux * np.stack([np.outer(down, d_across), np.outer(d_down, across), np.outer(down, across)])


WINDOW = 0.03
"""Bounds of the pixels that are looked at, those of the stamp near the target, over those of all."""


BOUNDS = "Cramer-Rao bounds of position and light"


@pytest.mark.parametrize("sigma_px", [0.3, 0.7, 2.0])
@pytest.mark.parametrize("is_electrons", [False, True], ids=["nei", "electrons"])
def test_bounds_are_those_of_all_pixels_in_closed_form(sigma_px, is_electrons, record_accuracy):
    frames = rendered(optics__sigma_px=sigma_px, **({"detector": ELECTRONS} if is_electrons else {}))
    instrument, side = frames.instrument, 128
    rows = frames.truth[np.isfinite(frames.truth["x_sigma_px"])]
    assert len(rows) > 100
    for row in rows[:: len(rows) // 40]:
        levels = instrument.levels[row["band"]]
        slopes = pixel_slopes(row["x_px"], row["y_px"], row["irradiance_w_cm2"], sigma_px, side)
        variance = np.full((side, side), levels.nei_w_cm2**2)
        if is_electrons:
            variance += slopes[2] / levels.e_per_w_cm2
        else:
            variance *= 1 + 1 / (12 * levels.counts_per_nei**2)
        fisher = np.einsum("aij,bij->ab", slopes / variance, slopes)
        sigma = np.sqrt(np.diag(np.linalg.inv(fisher))) * [1, 1, row["irradiance_w_cm2"]]
        found = [row["x_sigma_px"], row["y_sigma_px"], row["irradiance_sigma_w_cm2"]]
        assert np.all(found > sigma * (1 - 1e-4))
        record_accuracy(BOUNDS, np.abs(found / sigma - 1).max(), WINDOW, "relative", "closed form over all pixels")


EXPOSED = {"detector__exposure_s": 0.5, "detector__streaks": True}
MOVING = {
    "still": {},
    "straight": EXPOSED | {"pointing__drift": {"urad_s": [800.0, -300.0], "reset_s": 1.0}},
    "jitter": EXPOSED | {"pointing__jitter": {"rms_urad": 100.0, "correlation_s": 0.3}},
}
PSFS = {"airy": {"optics__psf": "airy", "optics__sigma_px": None}, "gaussian": {}}


@pytest.mark.parametrize("psf", PSFS.values(), ids=PSFS)
@pytest.mark.parametrize("changes", MOVING.values(), ids=MOVING)
@pytest.mark.ci
def test_bounds_are_those_of_the_image_as_it_is_drawn(psf, changes):
    """By its Jacobian source by source, summed over the pixels about the target; 1e-9: sums in another order."""
    frames = rendered([60], sensors=["sat11"], **psf, **changes)
    jacobian, band = frames.point_images("bounds", False).jacobian(), frames.bands[0]
    levels, camera = frames.instrument.levels[band], frames.instrument.sensor.camera
    variance = levels.nei_w_cm2**2 * (1 + 1 / (12 * levels.counts_per_nei**2))
    names = list(dict.fromkeys(frames.truth["target"]))
    rows = [row for row in frames.truth if row["band"] == band and np.isfinite(row["x_sigma_px"])]
    way_px = np.abs(frames._host.offset_px[0]).sum(axis=1)
    assert len(rows) > 20
    for row in rows:
        number = names.index(row["target"])
        (item,) = np.flatnonzero((jacobian.source == number) & (jacobian.band == 0))
        left, right, top, bottom = jacobian.window[item]
        whole = np.zeros((4, camera.n_row, camera.n_col))
        whole[:, top:bottom, left:right] = jacobian.image(item)
        column, line = (int(np.floor(row[name] + 0.5)) for name in ("x_px", "y_px"))
        across, down = (int(n) for n in np.ceil(1.5 * np.array(merge_px(frames.instrument, band)) + way_px[number]))
        part = whole[:, max(line - down, 0) : line + down + 1, max(column - across, 0) : column + across + 1]
        slopes = np.stack([part[1], part[2], part[0] * row["irradiance_w_cm2"]])
        sigma = np.sqrt(np.diag(np.linalg.inv(np.einsum("aij,bij->ab", slopes / variance, slopes))))
        found = [row["x_sigma_px"], row["y_sigma_px"], row["irradiance_sigma_w_cm2"] / row["irradiance_w_cm2"]]
        np.testing.assert_allclose(found, sigma, rtol=1e-9)


@pytest.mark.ci
def test_a_fit_of_images_reaches_the_bounds(record_accuracy):
    """Draws of noise about the image that was rendered, each fitted: standard deviations within 5 of their own."""
    frames = rendered([60], True, optics__sigma_px=1.0, sensors=["sat27"])
    row = max(frames.truth[frames.truth["band"] == "A"], key=lambda row: row["neighbour_px"] * (row["snr"] > 10))
    nei = frames.instrument.nei_w_cm2("A")
    x, y, side = row["x_px"], row["y_px"], 15
    column, top = round(x) - side // 2, round(y) - side // 2
    image = frames.contributions_w_cm2(60, "sat27", "A")[frames.scene.target_names.index(row["target"])]
    patch = image[top : top + side, column : column + side].astype(float) / nei
    start = np.array([x - column, y - top, row["snr"]])

    def misses(values, noisy):
        return (pixel_slopes(values[0], values[1], values[2], 1.0, side)[2] - noisy).ravel()

    rng, n_draw = np.random.default_rng(1), 1500
    fits = np.array(
        [least_squares(misses, start, args=(patch + rng.normal(size=patch.shape),)).x for _ in range(n_draw)]
    )
    bound = np.array([row["x_sigma_px"], row["y_sigma_px"], row["irradiance_sigma_w_cm2"] / nei])
    gate = 5 / np.sqrt(2 * n_draw)
    off = np.abs(fits.std(axis=0) / bound - 1).max()
    record_accuracy("Fits of noisy images over their bounds", off, gate + WINDOW, "relative", "1,500 draws of noise")


def test_neighbours_and_clumps_are_those_of_a_brute_force_search(frames):
    truth = frames.truth
    for band in frames.bands:
        reach = np.array(merge_px(frames.instrument, band))
        for sensor in SENSORS:
            rows = truth[(truth["frame"] == 61) & (truth["sensor"] == sensor) & (truth["band"] == band)]
            lit = (rows["irradiance_w_cm2"] > 0) & np.isfinite(rows["x_px"])
            xy = np.c_[rows["x_px"], rows["y_px"]][lit]
            apart = np.linalg.norm(xy[:, None] - xy, axis=-1) + np.where(np.eye(len(xy)), np.inf, 0)
            np.testing.assert_allclose(rows["neighbour_px"][lit], apart.min(axis=1), rtol=1e-12)
            linked = np.linalg.norm((xy[:, None] - xy) / reach, axis=-1) <= 1
            label = connected_components(coo_array(linked))[1]
            np.testing.assert_array_equal(rows["clump_id"][lit], label)
            np.testing.assert_array_equal(rows["resolvable"][lit], np.bincount(label)[label] == 1)
            assert not rows["resolvable"][~lit].any() and (rows["clump_id"][~lit] == -1).all()


BLEND = 1e-5
"""float32 images, and stamps of others that end before the pixel."""


@pytest.mark.ci
@pytest.mark.parametrize("exposure_s", [0.0, 0.5])
@pytest.mark.parametrize("psf", ["gaussian", "airy"])
def test_blended_light_is_that_of_the_planes_of_the_targets(psf, exposure_s):
    optics = {"aperture_m": 0.4} | ({"psf": "gaussian", "sigma_px": 0.7} if psf == "gaussian" else {})
    detector = {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "exposure_s": exposure_s}
    frames = rendered([60], optics=optics, detector=detector, optics__psf=psf, optics__sigma_px=optics.get("sigma_px"))
    truth = frames.truth[(frames.truth["sensor"] == "sat11") & (frames.truth["band"] == "A")]
    planes = frames.contributions_w_cm2(60, "sat11", "A").astype(float)
    n_shown = 0
    for number, row in enumerate(truth):
        if np.isnan(row["blend_fraction"]) or not row["in_fov"]:
            continue
        here = planes[:, int(np.floor(row["y_px"] + 0.5)), int(np.floor(row["x_px"] + 0.5))]
        assert abs(row["blend_fraction"] - (1 - here[number] / here.sum())) < BLEND
        n_shown += row["blend_fraction"] > 0.01
    assert n_shown > 3


def test_states_are_those_of_scene_and_geometry(frames):
    scene, truth = frames.scene, frames.truth
    for row in truth[::97]:
        if row["absent"]:
            continue
        state = {
            name: np.array([row[f"{name}_{axis}_m"] for axis in "xyz"], dtype=float) for name in ("sensor", "target")
        }
        left_s = row["time_s"] - 1e3 * row["range_km"] / C_M_S
        np.testing.assert_allclose(state["sensor"], scene.position_m(row["sensor"], [row["time_s"]])[0], atol=1e-6)
        np.testing.assert_allclose(state["target"], scene.position_m(row["target"], [left_s])[0], atol=1e-6)
        away = state["sensor"] - state["target"]
        assert abs(np.linalg.norm(away) / 1e3 - row["range_km"]) < 1e-6
        for name, time_s in (("sensor", row["time_s"]), ("target", left_s)):
            around = scene.position_m(row[name], [time_s - 0.5, time_s + 0.5])
            velocity = [row[f"{name}_v{axis}_m_s"] for axis in "xyz"]
            np.testing.assert_allclose(velocity, around[1] - around[0], atol=2e-2)
        camera = Rotation.from_quat([row[f"sensor_q{axis}"] for axis in "xyzw"])
        axes = frames.axes_icrs[frames.frames.index(row["frame"]), SENSORS.index(row["sensor"])]
        np.testing.assert_allclose(camera.as_matrix(), axes, atol=1e-12)
        body_axis = Rotation.from_quat([row[f"target_q{axis}"] for axis in "xyzw"]).inv().apply([0, 0, 1])
        aspect = np.degrees(np.arccos(body_axis @ away / np.linalg.norm(away)))
        assert abs(aspect - row["aspect_deg"]) < 1e-3  # light time of the motion, and aberration of the direction
        assert row["date_obs"].startswith("20")


def test_earth_fixed_positions_are_those_of_astropy(frames):
    from astropy.coordinates import GCRS, ITRS, CartesianRepresentation, EarthLocation
    from astropy.time import TimeDelta

    truth = frames.truth[frames.truth["frame"] == 62]
    fixed = ws.earth_fixed(truth, frames.scene.epoch)
    for body in ("sensor", "target"):
        row = fixed[5]
        time_s = row["time_s"] - (1e3 * row["range_km"] / C_M_S if body == "target" else 0.0)
        now = frames.scene.epoch + TimeDelta(time_s, format="sec")
        at = GCRS(CartesianRepresentation([row[f"{body}_{axis}_m"] for axis in "xyz"], unit="m"), obstime=now)
        expected = at.transform_to(ITRS(obstime=now)).cartesian.xyz.to_value("m")
        found = [row[f"{body}_itrs_{axis}_m"] for axis in "xyz"]
        np.testing.assert_allclose(found, expected, atol=40.0)  # UT1 of two tables, and polar motion
        place = EarthLocation.from_geocentric(*found, unit="m").geodetic
        assert abs(place.lat.deg - row[f"{body}_lat_deg"]) < 1e-9
        assert abs(place.height.to_value("m") - row[f"{body}_height_m"]) < 1e-3
    assert "target_lon_deg" not in ws.earth_fixed(truth, frames.scene.epoch, "sensor").colnames
    with pytest.raises(ws.InputError, match="table: must have target_x_m"):
        ws.earth_fixed(truth["time_s", "range_km"], frames.scene.epoch, "target")


SCENES = {
    "streaks": {"detector": {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "exposure_s": 0.5}},
    "rows": {"detector": {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "line_time_s": 1e-4}},
    "electrons": {"detector": ELECTRONS},
    "background": {"background": {"zodiacal": True, "earth": True}},
    "stars": {"sky__catalog": "default"},
}


@pytest.mark.parametrize("name", SCENES)
def test_truth_needs_no_images(name):
    scene = ws.Scene.load("stss").replace(**(BASE | SCENES[name]))
    renderer = ws.Renderer(scene)
    with_images, without = (f(range(60, 66, 2), SENSORS, ["C", "A"]) for f in (renderer.render, renderer.truth))
    assert with_images.truth.colnames == without.colnames
    assert with_images.truth.meta == without.meta and without.meta["SCENE"] == scene.name
    for column in without.colnames:
        np.testing.assert_array_equal(np.asarray(with_images.truth[column]), np.asarray(without[column]))
    some = renderer.truth([64], SENSORS[1], "A")
    mine = without[(without["frame"] == 64) & (without["sensor"] == SENSORS[1]) & (without["band"] == "A")]
    for column in some.colnames:  # alone as among others
        np.testing.assert_array_equal(np.asarray(mine[column]), np.asarray(some[column]))


def test_hard_cases_have_bounds_or_say_that_there_are_none():
    scene = ws.Scene.load("stss").replace(**BASE)
    one_pixel = ws.Renderer(scene.replace(camera={"n_row": 1, "n_col": 1, "fov_deg": 0.01})).truth([60], "sat11", "A")
    lit = one_pixel["clump_id"] >= 0
    assert lit.any() and np.isinf(one_pixel["x_sigma_px"][lit]).all()  # one number fixes no three
    bright = {"kind": "nei", "nei_w_cm2": 1e-24, "sei_w_cm2": 1e-23}
    saturated = ws.Renderer(scene.replace(detector=bright)).truth([60], "sat11", "A")
    centre = saturated[saturated["target"] == scene.target_names[0]]
    assert np.isinf(centre["irradiance_sigma_w_cm2"][0]) or centre["irradiance_sigma_w_cm2"][0] > 1e-23
    detector = {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15}
    narrow = scene.replace(optics__sigma_px=0.3)
    many, few = (
        ws.Renderer(narrow.replace(detector=detector | {"bits": n_bit})).truth([60], "sat27", "A") for n_bit in (14, 8)
    )
    full = (many["snr_peak"] > 32) & (many["irradiance_w_cm2"] > 0)  # 8 bits end at 31 NEI
    name = "irradiance_sigma_w_cm2"
    assert full.any() and (few[name][full] > 1.5 * many[name][full]).all()
    np.testing.assert_array_equal(few[name][many["snr_peak"] < 25], many[name][many["snr_peak"] < 25])
