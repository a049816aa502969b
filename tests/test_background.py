"""Background: zodiacal light, the Earth and maps of the sky, against what shares no code with them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS
from backgrounds import NEI_W_CM2, added_w_cm2, at_altitude, narrow, rendered, sight_lines
from scipy.integrate import quad

import warpsim as ws
from warpsim.background.earth_limb import limb_profile
from warpsim.background.fits_map import radiance_scales, response_width_hz
from warpsim.background.sky_plates import sky_cube
from warpsim.background.zodiacal import (
    ECLIPTIC_AXES,
    band_light,
    phase_functions,
    zodiacal_map,
    zodiacal_radiance_w_cm2_sr,
)
from warpsim.instant import instant
from warpsim.orbit.earth import grazing_altitude_m
from warpsim.orbit.sun import earth_states
from warpsim.output.check import scene_report
from warpsim.radiometry.bands import band_radiance_w_m2_sr
from warpsim.radiometry.sun_and_earth import earth_albedo
from warpsim.scene.provenance import input_checksums

REFERENCE = json.loads((Path(__file__).parent / "data" / "zodiacal_reference.json").read_text())["cases"]

DIRBE_UM = (1.25, 2.2, 3.5, 4.9, 12.0, 25.0)
DIRBE_RTOL, BETWEEN_RTOL = 0.02, 0.05
MAP_RTOL = 0.015  # cubic splines between nodes, and plates of 1.3 degrees
LIMB_RTOL = 0.05  # heights within 0.1 km, of light that falls by a third per km where it is steepest
FUNCTION_RTOL = 4e-3  # lines between nodes 0.6 degrees apart, of light that curves within 17
STAGE_RTOL = 2e-3  # light between nodes half a plate's step apart


@pytest.fixture(scope="module")
def scene():
    return ws.Scene.load("stss").replace(sky__catalog="none", camera__fov_deg=4.0)


@pytest.mark.accuracy
@pytest.mark.parametrize("case", REFERENCE, ids=lambda case: f"{case['date']}-{case['wavelength_um']}")
def test_zodiacal_light_against_zodipy(case, record_accuracy):
    wavelength_um = case["wavelength_um"]
    band = narrow(wavelength_um)
    light = zodiacal_radiance_w_cm2_sr(case["direction"], case["earth_au"], [band_light(band)])[0]
    mjy_sr = light * 1e4 / response_width_hz(band) * 1e20
    error = np.abs(mjy_sr / case["mjy_sr"] - 1).max()
    of_dirbe = wavelength_um in DIRBE_UM
    name = "Zodiacal light in DIRBE's bands" if of_dirbe else "Zodiacal light between DIRBE's bands"
    record_accuracy(name, error, DIRBE_RTOL if of_dirbe else BETWEEN_RTOL, "", "zodipy 1.1.5")


def test_phase_functions_share_out_all_light():
    for number in range(3):
        total = quad(lambda a, k=number: 2 * np.pi * np.sin(a) * phase_functions(np.array(a))[k], 0, np.pi)[0]
        assert total == pytest.approx(1.0, abs=1e-9)


@pytest.mark.accuracy
def test_map_and_plates_follow_the_model(record_accuracy):
    earth_au = -earth_states(instant("2026-03-05T00:00:00"), 0.0).sun_m / 1.495978707e11
    bands = [ws.bands()["B1"], ws.bands()["E"]]
    radiance_of = zodiacal_map(bands, earth_au)
    rng = np.random.default_rng(31)
    lines = rng.normal(size=(3000, 3)) * [1, 1, 0.5]
    lines /= np.linalg.norm(lines, axis=1, keepdims=True)
    lines = lines @ ECLIPTIC_AXES  # most near the ecliptic
    lines = lines[-lines @ earth_au / np.linalg.norm(earth_au) < np.cos(np.radians(20))]
    lights = [band_light(band) for band in bands]
    exact = zodiacal_radiance_w_cm2_sr(lines @ ECLIPTIC_AXES.T, ECLIPTIC_AXES @ earth_au, lights)
    found, n_found = np.zeros_like(exact), np.zeros(len(lines), dtype=int)
    for plate in sky_cube(radiance_of, 91):
        seen = lines @ plate.axes.T
        on = (seen[:, 2] > 0) & (np.abs(seen[:, :2]) <= seen[:, 2:]).all(axis=1)
        place = (seen[on, :2] / seen[on, 2:] + 1) * 45
        node = np.clip(place.astype(int), 0, 89)
        (u, v), (col, row) = (place - node).T, node.T
        light = plate.radiance_w_cm2_sr
        upper = light[:, row, col] * (1 - u) + light[:, row, col + 1] * u
        lower = light[:, row + 1, col] * (1 - u) + light[:, row + 1, col + 1] * u
        found[:, on] = upper * (1 - v) + lower * v
        n_found += on
    assert (n_found == 1).all()
    record_accuracy("Zodiacal light by plates", np.abs(found / exact - 1).max(), MAP_RTOL, "", "the model itself")


@pytest.mark.ci
def test_images_hold_the_light_of_each_pixels_direction(scene):
    added, frames = added_w_cm2(scene, zodiacal=True)
    instrument = frames.instrument
    pixel_sr = 1 / (instrument.sensor.camera.focal_px * instrument.sensor.camera.focal_row_px)
    middle_s = scene.duration_s / 2
    sun_m = frames.scenario.tracks.sun.position_at_m(np.array([middle_s]))[0]
    radiance_of = zodiacal_map(list(instrument.bands.values()), -sun_m / 1.495978707e11)
    for sensor in (0, 4, 9):
        lines = sight_lines(frames, sensor=sensor)
        slant = (lines @ frames.axes_icrs[0, sensor, 2]) ** 3
        expected = radiance_of(lines.reshape(-1, 3)).reshape(-1, *slant.shape) * pixel_sr * slant
        assert np.abs(added[0, sensor] / expected - 1).max() < MAP_RTOL + STAGE_RTOL


@pytest.mark.ci
def test_what_is_off_is_in_no_image_no_truth_and_no_file(scene):
    plain = ws.Renderer(scene, "cpu").render([60])
    assert "background" not in scene.to_dict()
    assert plain._device_scene.background is None
    assert not {"background_w_cm2", "noise_nei", "earth_behind"} & set(plain.truth.colnames)


@pytest.mark.ci
def test_frames_are_the_same_alone_and_in_any_batch(scene):
    own = scene.replace(background__zodiacal=True, background__earth=True)
    many = ws.Renderer(own, "cpu", n_thread=2).render(range(58, 66))
    alone = ws.Renderer(own, "cpu", n_thread=1).render([61])
    assert np.array_equal(alone.counts.numpy()[0], many.counts.numpy()[3])


@pytest.mark.ci
@pytest.mark.parametrize(("n_row", "n_col", "fov_deg"), [(128, 128, 4.0), (1, 1, 1.0), (65, 33, 3.0), (130, 257, 40.0)])
def test_every_pixel_has_it_whatever_the_size(scene, n_row, n_col, fov_deg):
    own = scene.replace(camera={"n_row": n_row, "n_col": n_col, "fov_deg": fov_deg}, optics__psf="gaussian")
    table = {"angle_deg": [0.0, 180.0], "ratio_sr": [1.0, 1.0]}
    for background in ({"zodiacal": True}, {"earth": True, "stray_light": table}):
        added, _ = added_w_cm2(own, **background)
        assert (added[:, :4] > 0).all()
        assert np.isfinite(added).all()


def test_truth_has_the_level_behind_each_target(scene):
    added, frames = added_w_cm2(scene, zodiacal=True)
    truth = frames.truth
    row = truth[(truth["sensor"] == frames.sensors[2]) & (truth["band"] == "C")][0]
    pixel = added[0, 2, 1, round(float(row["y_px"])), round(float(row["x_px"]))]
    assert row["background_w_cm2"] == pytest.approx(pixel, rel=STAGE_RTOL)
    assert row["noise_nei"] == 1.0
    assert not row["earth_behind"]


@pytest.mark.ci
def test_truth_has_the_light_of_the_targets_own_pixel(scene):
    """Of a column of targets before the limb, whose own light is faint."""
    wide = scene.replace(camera__fov_deg=20.0, optics__aperture_m=0.02)
    frames_of = range(20, 140, 6)
    added, frames = added_w_cm2(wide, frames_of, zodiacal=True, earth=True)
    plain = ws.Renderer(wide, "cpu").render(list(frames_of), keep_signal=True).signal_w_cm2.numpy()
    truth = frames.truth
    truth = truth[truth["in_fov"]]
    at = [list(frames_of).index(frame) for frame in truth["frame"]], [frames.sensors.index(n) for n in truth["sensor"]]
    band = [frames.bands.index(name) for name in truth["band"]]
    x, y = (np.floor(truth[name] + 0.5).astype(int) for name in ("x_px", "y_px"))
    pixel, others = added[*at, band, y, x], added[*at, band, np.minimum(y + 1, 127), x]
    dim = plain[*at, band, y, x] < 10 * pixel
    sharp = dim & (np.abs(others / pixel - 1) > 0.1)
    assert dim.sum() > 100 and sharp.sum() > 10
    np.testing.assert_allclose(truth["background_w_cm2"][dim], pixel[dim], rtol=1e-4)


def electrons(scene):
    detector = {"kind": "electron", "exposure_s": 0.1, "full_well_e": 1e6, "gain_e_per_count": 60.0}
    return scene.replace(detector=detector | {"read_noise_e": 50.0, "dark_e_s": 1e4}, optics__aperture_m=0.3)


@pytest.mark.ci
def test_electron_detectors_have_its_shot_noise(scene):
    own = electrons(scene)
    _, frames = added_w_cm2(own, zodiacal=True)
    levels = frames.instrument.levels["E"]
    mean_e = frames.signal_w_cm2.numpy()[0, 0, 2].astype(np.float64) * levels.e_per_w_cm2
    counts = frames.counts.numpy()[0, 0, 2].astype(np.float64)
    truth = frames.truth
    row = truth[(truth["sensor"] == frames.sensors[0]) & (truth["band"] == "E")][0]
    background_e = row["background_w_cm2"] * levels.e_per_w_cm2
    assert background_e > 1e3  # far above the read noise' square
    counts_e = counts * 60.0
    expected_e = levels.noise_e * row["noise_nei"]
    pixels = (counts_e - mean_e)[:40, :40]  # away from the targets
    assert pixels.std() == pytest.approx(expected_e, rel=0.1)
    assert row["noise_nei"] == pytest.approx(np.sqrt(1 + background_e / levels.noise_e**2))


@pytest.mark.ci
def test_the_limb_lies_where_lines_of_sight_graze_the_ellipsoid(scene):
    wide = scene.replace(camera__fov_deg=20.0)
    added, frames = added_w_cm2(wide, frames=(60,), earth=True)
    scenario, instrument = frames.scenario, frames.instrument
    checked = 0
    for number, name in enumerate(frames.sensors):
        satellite = instrument.satellites[instrument.index(name)]
        position_m = scenario.tracks.satellites[satellite].state(frames.time_s)[0][0]
        lines = sight_lines(frames, sensor=number)
        height_m = grazing_altitude_m(position_m, position_m + 1e7 * lines, scenario.tracks.pole_icrs, beyond=True)
        step_m = np.abs(np.diff(height_m, axis=0)).max()
        disc = added[0, number, 0] > 0.9 * added[0, number, 0].max()
        if not (height_m < -step_m).any():
            continue
        assert disc[height_m < -step_m].all()
        assert (added[0, number, 0][height_m > 130e3] < 1e-6 * added[0, number, 0].max()).all()
        checked += 1
    assert checked >= 3


@pytest.mark.ci
@pytest.mark.accuracy
@pytest.mark.parametrize("roll_deg", [0.0, 20.0, 45.0])
def test_pixels_hold_the_mean_of_the_limb_over_the_heights_that_they_span(scene, record_accuracy, roll_deg):
    """By 32 x 32 lines of sight a pixel in the middle and outermost columns, in float64, against WGS84."""
    pointing = {"kind": "fixed", "azimuth_elevation_deg": [0.0, -37.0], "roll_deg": roll_deg}
    own = scene.replace(camera__fov_deg=12.0, lighting__earth_albedo=0.0, access_rules={}, pointing=pointing, groups=[])
    added, frames = added_w_cm2(own, frames=(60,), sensors="sat11", earth=True)
    scenario, instrument, camera = frames.scenario, frames.instrument, frames.instrument.sensor.camera
    position_m = scenario.tracks.satellites[instrument.satellites[0]].state(frames.time_s)[0][0]
    columns, rows, part = np.array([0, 40, 127]), np.arange(camera.n_row), (np.arange(32) + 0.5) / 32 - 0.5
    grid = np.meshgrid(columns, rows, part, part, indexing="ij")
    xy = np.stack([grid[0] + grid[2], grid[1] + grid[3]], axis=-1).reshape(-1, 2)
    lines = camera.direction(xy, frames.axes_icrs[0, 0])
    height_km = grazing_altitude_m(position_m, position_m + 1e7 * lines, scenario.tracks.pole_icrs, beyond=True) / 1e3
    height_km = height_km.reshape(len(columns), len(rows), -1)
    slant = (lines @ frames.axes_icrs[0, 0, 2]).reshape(height_km.shape).mean(axis=-1) ** 3
    for index, band in enumerate(instrument.bands.values()):
        profile, area = limb_profile(band), 1 / (camera.focal_px * camera.focal_row_px)
        disc = float(band_radiance_w_m2_sr(own.lighting.earth_k_in(band), band)) * 1e-4
        light = np.interp(height_km, profile.height_km, profile.emission_w_cm2_sr, right=0.0)
        light = np.where(height_km < 0, disc, light).mean(axis=-1)
        inner = (height_km.max(axis=-1) < 100) & (light > 0)
        assert inner.sum() > 100 and (light[inner] < 0.5 * disc).any()
        error = np.abs(added[0, 0, index].T[columns][inner] / (light * area * slant)[inner] - 1)
        record_accuracy("Limb of the Earth, mean over a pixel", error.max(), LIMB_RTOL, "", "1024 lines of sight")


@pytest.mark.ci
def test_the_disc_has_the_radiance_of_its_temperature(scene):
    wide = scene.replace(camera__fov_deg=20.0, lighting__earth_albedo=0.0)
    added, frames = added_w_cm2(wide, frames=(60,), earth=True)
    instrument = frames.instrument
    camera = instrument.sensor.camera
    for number, (name, band) in enumerate(instrument.bands.items()):
        kelvin = wide.lighting.earth_k_in(band)
        expected = float(band_radiance_w_m2_sr(kelvin, band)) * 1e-4 / (camera.focal_px * camera.focal_row_px)
        slant = (sight_lines(frames, sensor=3) @ frames.axes_icrs[0, 3, 2]) ** 3
        light = added[0, 3, number] / slant
        assert light[-1, camera.n_col // 2] == pytest.approx(expected, rel=1e-4), name


@pytest.mark.ci
@pytest.mark.parametrize(("epoch_utc", "raan_deg"), [("2025-01-04T14:00:00", 200.0), ("2025-07-04T14:00:00", 20.0)])
@pytest.mark.parametrize(("lighting", "albedo"), [({}, None), ({"earth_albedo": 0.25}, 0.25)])
def test_the_sunlit_disc_has_the_albedo_of_the_band(scene, lighting, albedo, epoch_utc, raan_deg):
    bands = dict.fromkeys(("B1", "B2", "A"))
    own = at_altitude(scene.replace(bands=list(bands), lighting=lighting, epoch_utc=epoch_utc), 800.0, 0.0, raan_deg)
    added, frames = added_w_cm2(own, sensors="one", earth=True)
    tracks, camera = frames.scenario.tracks, frames.instrument.sensor.camera
    sun_m, position_m = tracks.sun.position_at_m(frames.time_s)[0], tracks.satellites[0].state(frames.time_s)[0][0]
    cosine = sun_m @ position_m / np.linalg.norm(sun_m) / np.linalg.norm(position_m)
    r_au = np.linalg.norm(sun_m) / 1.495978707e11
    assert cosine > 0.3 and abs(r_au - 1) > 0.015
    for number, name in enumerate(bands):
        night = float(band_radiance_w_m2_sr(own.lighting.earth_k_in(ws.bands()[name]), name)) * 1e-4
        sun_w_cm2 = own.lighting.sun_w_m2_in(ws.bands()[name]) * 1e-4
        reflected = added[0, 0, number, 4, 4] * camera.focal_px * camera.focal_row_px - night
        expected = (earth_albedo(name) if albedo is None else albedo) * sun_w_cm2 / np.pi * cosine / r_au**2
        assert reflected == pytest.approx(expected, rel=5e-3, abs=1e-5 * night), name  # of geodetic verticals
        if name == "B1":
            noon_over_night = 1 + (earth_albedo(name) if albedo is None else albedo) * sun_w_cm2 / np.pi / night
    assert own.lighting.earth_albedo_in(ws.bands()["B1"]) == (0.3 if albedo is None else albedo)  # of targets
    report = scene_report(scene.replace(bands=["B1"], lighting=lighting).scenario)
    said = [float(number) for number in re.search(r"Earth (\S+) by night and (\S+) under the Sun", report).groups()]
    assert said[1] / said[0] == pytest.approx(noon_over_night, rel=0.1)  # of two digits


def map_file(path, frames, unit="MJy/sr", sensor=0):
    """A map of 64 x 64 pixels about the boresight of a sensor, with a slope in its values."""
    wcs = WCS(naxis=2)
    x, y, z = frames.axes_icrs[0, sensor, 2]
    wcs.wcs.crval = [np.degrees(np.arctan2(y, x)) % 360, np.degrees(np.arcsin(z))]
    wcs.wcs.crpix, wcs.wcs.cdelt, wcs.wcs.ctype = [32.5, 32.5], [-0.1, 0.1], ["RA---TAN", "DEC--TAN"]
    rows, columns = np.mgrid[:64, :64]
    header = wcs.to_header()
    header["BUNIT"] = unit
    fits.writeto(path, 10.0 + 0.1 * columns + 0.2 * rows, header)
    return wcs


def test_a_map_with_wcs_lies_where_its_header_says(scene, tmp_path):
    plain = ws.Renderer(scene, "cpu").render([60], keep_signal=True)
    wcs = map_file(tmp_path / "map.fits", plain)
    added, frames = added_w_cm2(scene, sky_map=tmp_path / "map.fits")
    lines = sight_lines(frames)
    lines = lines - frames.velocity_m_s[0, 0] / 299792458.0
    lines /= np.linalg.norm(lines, axis=-1, keepdims=True)
    ra, dec = np.degrees(np.arctan2(lines[..., 1], lines[..., 0])), np.degrees(np.arcsin(lines[..., 2]))
    x, y = wcs.wcs_world2pix(ra, dec, 0)
    band = frames.instrument.bands["A"]
    scale = radiance_scales("MJy/sr", [band])[0]
    camera = frames.instrument.sensor.camera
    slant = (sight_lines(frames) @ frames.axes_icrs[0, 0, 2]) ** 3
    expected = (10 + 0.1 * x + 0.2 * y) * scale / (camera.focal_px * camera.focal_row_px) * slant
    dark = plain.signal_w_cm2.numpy()[0, 0, 0] == 0  # of float32, beside the light of targets
    inside = (x > 1) & (x < 62) & (y > 1) & (y < 62) & dark
    assert inside.sum() > 1000
    assert np.abs(added[0, 0, 0] / expected - 1)[inside].max() < STAGE_RTOL


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"background__sky_map": "no-such.fits"}, "must be a file that exists"),
        ({"background__stray_light": {"angle_deg": [0, 1], "ratio_sr": [1.0]}}, "must hold 2 numbers"),
        ({"background__stray_light": {"angle_deg": [5, 1], "ratio_sr": [1.0, 1.0]}}, "angles or more that increase"),
        ({"background__stray_light": {"angle_deg": [0, 1], "ratio_sr": [1e39, 1.0]}}, "must be in [0, 1e+30]"),
        ({"background__zodi": True}, "zodi"),
    ],
)
def test_what_is_wrong_is_one_line(scene, change, words):
    with pytest.raises(ws.InputError) as caught:
        ws.Renderer(scene.replace(**change), "cpu").render([60])
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("system", ["C", "G"])
def test_a_map_of_healpix_pixels_lies_where_its_system_says(scene, tmp_path, system):
    healpix = pytest.importorskip("astropy_healpix")
    grid = healpix.HEALPix(64, "nested", frame={"C": "icrs", "G": "galactic"}[system])
    where = grid.healpix_to_skycoord(np.arange(grid.npix)).icrs.cartesian.xyz.value
    values = (2.0 + where[2]).astype(np.float32)  # of the sine of the declination
    table = fits.BinTableHDU.from_columns([fits.Column("I", "E", unit="MJy/sr", array=values)])
    table.header["PIXTYPE"], table.header["ORDERING"] = "HEALPIX", "NESTED"
    table.header["NSIDE"], table.header["COORDSYS"] = 64, system
    table.writeto(tmp_path / "map.fits")
    added, frames = added_w_cm2(scene, sky_map=tmp_path / "map.fits")
    scale = radiance_scales("MJy/sr", [frames.instrument.bands["C"]])[0]
    camera = frames.instrument.sensor.camera
    dark = frames.signal_w_cm2.numpy()[0, 5, 1] < 2 * np.median(frames.signal_w_cm2.numpy()[0, 5, 1])
    lines = sight_lines(frames, sensor=5)
    slant = (lines @ frames.axes_icrs[0, 5, 2]) ** 3
    expected = (2.0 + lines[..., 2]) * scale / (camera.focal_px * camera.focal_row_px) * slant
    assert np.abs(added[0, 5, 1] / expected - 1)[dark].max() < 2e-3  # pixels of 0.9 degrees


def test_a_map_without_unit_is_refused(scene, tmp_path):
    plain = ws.Renderer(scene, "cpu").render([60])
    map_file(tmp_path / "map.fits", plain, unit="")
    with pytest.raises(ws.InputError, match="surface brightness"):
        rendered(scene, sky_map=tmp_path / "map.fits")


def test_scenes_with_a_background_load_equal(scene, tmp_path):
    own = scene.replace(background__zodiacal=True, background__stray_light={"angle_deg": [0, 9], "ratio_sr": [1, 0.1]})
    own.save(tmp_path / "own.toml")
    assert ws.Scene.load(tmp_path / "own.toml") == own


@pytest.mark.ci
def test_check_says_what_is_left_out_and_the_end_of_a_run_too(scene, tmp_path):
    wide = scene.replace(camera__fov_deg=20.0)
    report = scene_report(wide.scenario)
    assert "the Earth is in the field of" in report
    assert "(left out)" in report
    assert "(left out)" not in scene_report(wide.replace(background={"zodiacal": True, "earth": True}).scenario)
    run = ws.render_to_folder(wide, tmp_path / "out", frames=[60], bands=["A"])
    assert "background.earth" in run.text()


@pytest.mark.parametrize(
    ("days", "zodiacal", "warned"), [(21.0, True, True), (21.0, False, False), (19.0, True, False)]
)
def test_check_warns_of_zodiacal_light_of_long_scenes(scene, days, zodiacal, warned):
    own = at_altitude(scene.replace(duration_s=days * 86400.0, background__zodiacal=zodiacal), 35786.0, 0.0)
    assert ("zodiacal light is that of the middle of 21 days" in scene_report(own.scenario)) == warned


# --- the user's own: a function, and an image of every pixel ---


def galactic_glow(direction, band):
    """As a function of the user's: a band of light along the galactic plane, brighter at longer waves."""
    pole = np.array([-0.867666, -0.198076, 0.455984])
    return 1e-12 * band.isophotal_um * np.exp(-((direction @ pole / 0.3) ** 2))


def test_a_function_is_looked_up_where_pixels_look(scene, tmp_path):
    own = scene.replace(background__sky_map=galactic_glow)
    assert own.background.sky_map == f"python:{__name__}:galactic_glow"
    own.save(tmp_path / "own.toml")
    assert ws.Scene.load(tmp_path / "own.toml") == own
    light, frames = added_w_cm2(scene, sky_map=galactic_glow)
    camera, axes = frames.instrument.sensor.camera, frames.axes_icrs[0, 0]
    rows, cols = np.meshgrid(np.arange(0, 128, 9), np.arange(0, 128, 9), indexing="ij")
    xy = np.stack([cols.ravel(), rows.ravel()], axis=1).astype(float)
    wide, high = (camera.direction(xy + half) - camera.direction(xy - half) for half in 0.5 * np.eye(2))
    pixel_sr = np.linalg.norm(np.cross(wide, high), axis=1)
    for number, name in enumerate(frames.bands):
        expected = galactic_glow(camera.direction(xy) @ axes, frames.instrument.bands[name]) * pixel_sr
        np.testing.assert_allclose(light[0, 0, number][rows.ravel(), cols.ravel()], expected, rtol=FUNCTION_RTOL)


def one_number(direction, band):
    return 1e-12


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (lambda direction, band: 0.0, "must be a function of a module, that workers can import"),
        ("python:nowhere", "must be a file, or a function such as"),
    ],
)
def test_functions_that_workers_cannot_import_are_refused(scene, value, words):
    with pytest.raises(ws.InputError, match=words):
        scene.replace(background__sky_map=value)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("python:no_such_module:f", "background.sky_map: cannot be imported"),
        ("python:math:no_such", "background.sky_map: cannot be imported"),
        (one_number, r"background.sky_map: must return [0-9,]+ radiances of 0 or more for as many directions"),
    ],
)
def test_functions_that_do_not_answer_are_named(scene, value, words):
    with pytest.raises(ws.InputError, match=words):
        rendered(scene, sky_map=value)


@pytest.mark.parametrize("kind", ["npy", "fits"])
@pytest.mark.parametrize("planes", [False, True], ids=["one plane", "a plane a band"])
def test_an_image_is_added_to_every_pixel(scene, tmp_path, kind, planes):
    names = list(scene.sensors[0].bands)
    random = np.random.default_rng(2)
    image = random.uniform(0.0, 50.0 * NEI_W_CM2, ((len(names), 128, 128) if planes else (128, 128)))
    path = tmp_path / f"glow.{kind}"
    np.save(path, image) if kind == "npy" else fits.writeto(path, image)
    light, frames = added_w_cm2(scene, (60, 61), image=path)
    expected = np.broadcast_to(image, (len(names), 128, 128))[[names.index(name) for name in frames.bands]]
    np.testing.assert_allclose(light, np.broadcast_to(expected, light.shape), rtol=1e-4, atol=1e-3 * NEI_W_CM2)
    some = ws.Renderer(scene.replace(background__image=path), "cpu").render([60], bands=frames.bands[-1])
    np.testing.assert_array_equal(some.counts.numpy()[0, :, 0], frames.counts.numpy()[0, :, -1])
    truth = frames.truth[frames.truth["in_fov"]]
    x, y = (np.floor(truth[name] + 0.5).astype(int) for name in ("x_px", "y_px"))
    assert len(truth)
    band = [frames.bands.index(name) for name in truth["band"]]
    np.testing.assert_allclose(truth["background_w_cm2"], expected[band, y, x], rtol=1e-6)


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (
            np.zeros((4, 4)),
            r"must have shape \(128, 128\), or \(\d, 128, 128\) with a plane for each band, has \(4, 4\)",
        ),
        (np.full((128, 128), -1.0), "must hold finite numbers of 0 or more .* has -1 in row 0, column 0"),
        (np.full((128, 128), np.nan), "must hold finite numbers of 0 or more .* has nan in row 0, column 0"),
        (np.full((128, 128), 1e39), r"must hold finite numbers of 0 or more that float32 holds, has 1e\+39"),
        (np.full((128, 128), 1j), "must hold real numbers, has complex128"),
        (np.full((128, 128), "a"), "must hold real numbers, has <U1"),
        (np.zeros((128, 128), dtype=bool), "must hold real numbers, has bool"),
    ],
    ids=["shape", "negative", "not finite", "beyond float32", "complex", "text", "switches"],
)
def test_images_that_do_not_fit_are_named(scene, tmp_path, image, words):
    np.save(tmp_path / "x.npy", image)
    with pytest.raises(ws.InputError, match=f"background.image: .*x.npy: {words}"):
        rendered(scene, image=tmp_path / "x.npy")
    with pytest.raises(ws.InputError, match=r"background.image: must be a file that exists"):
        rendered(scene, image=tmp_path / "none.npy")


@pytest.mark.parametrize("name", ["x.npy", "x.fits"])
@pytest.mark.parametrize("content", [b"", b"hello", "early"])
def test_images_that_are_damaged_are_one_line_in_check_too(scene, tmp_path, name, content):
    image = np.zeros((128, 128))
    np.save(tmp_path / name, image) if name == "x.npy" else fits.writeto(tmp_path / name, image)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[:9000] if content == "early" else content)
    own = scene.replace(background__image=tmp_path / name)
    for use in (lambda: scene_report(own.scenario), lambda: ws.Renderer(own, "cpu").render([60])):
        with pytest.raises(ws.InputError, match=r"^background.image: .*: cannot be read \(") as caught:
            use()
        assert "\n" not in str(caught.value)


def test_scene_files_name_their_map_and_image_from_their_folder(scene, tmp_path):
    np.save(tmp_path / "glow.npy", np.zeros((128, 128)))
    own = scene.replace(background__image=tmp_path / "glow.npy")
    own.save(tmp_path / "own.toml")
    assert 'image = "glow.npy"' in (tmp_path / "own.toml").read_text()
    loaded = ws.Scene.load(tmp_path / "own.toml")
    assert loaded.background.image == str(tmp_path / "glow.npy")
    assert str(tmp_path / "glow.npy") in input_checksums(loaded.scenario)
    assert "image " in scene_report(loaded.scenario)


def test_the_summary_names_what_is_on(scene):
    assert scene.background.summary == "nothing, a black sky"
    own = scene.replace(background__zodiacal=True, background__earth=True)
    assert own.background.summary == "zodiacal light, Earth"


def test_zodiacal_light_is_not_counted_twice():
    scene = ws.Scene.load("visible_to_lwir")  # one of its detectors has zodiacal light of its own
    with pytest.raises(ws.InputError, match=r"detector.zodiacal_mjy_sr: must be 0 where background.zodiacal is on"):
        scene.replace(background__zodiacal=True)


def test_check_warns_of_a_background_that_saturates():
    """A camera straight down, which never has access to a target, too."""
    down = {"kind": "fixed", "azimuth_elevation_deg": [0.0, -90.0]}
    scene = ws.Scene.load("stss").replace(sky__catalog="none", pointing=down, bands=["A"])
    words = "warning: the Earth saturates pixels in A, whose SEI is 3e+03 NEI"
    assert words in scene_report(scene.replace(background__earth=True).scenario)
    assert words not in scene_report(scene.scenario) and "background A" in scene_report(scene.scenario)


@pytest.mark.ci
def test_kinds_of_sensors_have_images_of_their_own(tmp_path):
    scene = ws.Scene.load("two_cameras").replace(sky__catalog="none", background__image=str(tmp_path / "{kind}.npy"))
    scenario = scene.scenario
    for number, (kind, instrument) in enumerate(scenario.instruments.items()):
        camera = instrument.sensor.camera
        np.save(tmp_path / f"{kind}.npy", np.full((camera.n_row, camera.n_col), 1e-17 * (number + 1)))
    for number, kind in enumerate(scenario.instruments):
        sensors = scenario.instruments[kind].names[:1]
        frames = ws.Renderer(scene, "cpu").render([0], sensors=sensors, keep_signal=True)
        assert np.median(frames.signal_w_cm2.numpy()) == pytest.approx(1e-17 * (number + 1), rel=1e-6)
    assert sum(path.startswith(str(tmp_path)) for path in input_checksums(scenario)) == len(scenario.instruments)
