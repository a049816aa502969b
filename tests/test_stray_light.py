"""Stray light of Sun, Earth and Moon: quadratures of their discs, and what has been measured of the Moon."""

import re

import numpy as np
import pytest
from backgrounds import added_w_cm2, at_altitude, narrow

import warpsim as ws
from warpsim.background.moon import SUBSOLAR_K, moon_brightness_w_cm2, moon_position_m
from warpsim.instant import instant
from warpsim.orbit.earth import grazing_altitude_m
from warpsim.orbit.sun import earth_states
from warpsim.output.check import scene_report
from warpsim.radiometry.bands import band_radiance_w_m2_sr
from warpsim.radiometry.sun_and_earth import earth_albedo

STRAY_RTOL = 0.02  # four nodes a piece of the table, eight along an arc; sunlight ends at the terminator


@pytest.fixture(scope="module")
def scene():
    return ws.Scene.load("stss").replace(sky__catalog="none", camera__fov_deg=4.0)


def test_stray_light_of_the_sun_is_its_irradiance_times_the_ratio(scene):
    table = {"angle_deg": [0.0, 90.0, 180.0], "ratio_sr": [1e-6, 1e-6, 1e-6], "moon": False, "earth": False}
    added, frames = added_w_cm2(scene, stray_light=table)
    instrument, scenario = frames.instrument, frames.scenario
    pixel_sr = 1 / (instrument.sensor.camera.focal_px * instrument.sensor.camera.focal_row_px)
    sun_m = scenario.tracks.sun.position_at_m(frames.time_s)[0]
    seen = 0
    for number, name in enumerate(frames.sensors):
        satellite = instrument.satellites[instrument.index(name)]
        position_m = scenario.tracks.satellites[satellite].state(frames.time_s)[0][0]
        lit = grazing_altitude_m(position_m, sun_m, scenario.tracks.pole_icrs) > 0
        sun_w_cm2 = scene.lighting.sun_w_m2_in(instrument.bands["A"]) * 1e-4
        distance_au = np.linalg.norm(sun_m) / 1.495978707e11
        expected = 1e-6 * sun_w_cm2 / distance_au**2 * pixel_sr * lit
        middle = added[0, number, 0, 60:68, 10:20].mean()
        assert middle == pytest.approx(expected, rel=2e-3, abs=1e-30)
        seen += int(lit)
    assert seen


def test_stray_light_of_the_earth_is_that_of_its_disc(scene):
    table = {"angle_deg": [0.0, 180.0], "ratio_sr": [1e-6, 1e-6], "moon": False, "sun": False}
    own = scene.replace(lighting__earth_albedo=0.0)
    added, frames = added_w_cm2(own, stray_light=table)
    instrument, scenario = frames.instrument, frames.scenario
    pixel_sr = 1 / (instrument.sensor.camera.focal_px * instrument.sensor.camera.focal_row_px)
    satellite = instrument.satellites[instrument.index(frames.sensors[1])]
    distance_m = np.linalg.norm(scenario.tracks.satellites[satellite].state(frames.time_s)[0][0])
    sine = 6378137.0 / distance_m
    radiance = float(band_radiance_w_m2_sr(own.lighting.earth_k_in(instrument.bands["E"]), "E")) * 1e-4
    solid_angle = 2 * np.pi * (1 - np.sqrt(1 - sine**2))
    expected = 1e-6 * radiance * solid_angle * pixel_sr
    assert added[0, 1, 2, 60:68, 10:20].mean() == pytest.approx(expected, rel=0.005)


STRAY = {"angle_deg": [0, 10, 30, 60, 90, 180], "ratio_sr": [1e-1, 1e-3, 1e-5, 1e-6, 1e-7, 1e-8]}


def earth_seen(position_m, boresight, sun, pole, n_ring=600, n_spoke=360):
    """Solid angles of the ellipsoid's disc by small parts, angles off the boresight [deg], cosines of the Sun there."""
    stretch = 1 / (1 - 1 / 298.257223563)
    nadir = -position_m / np.linalg.norm(position_m)
    side = np.cross(nadir, [0.1, 0.2, 0.9])
    side /= np.linalg.norm(side)
    turn = (np.arange(n_spoke) + 0.5) / n_spoke * 2 * np.pi

    def look(off_nadir):
        across = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * np.cross(nadir, side)
        lines = np.cos(off_nadir)[..., None] * nadir + np.sin(off_nadir)[..., None] * across
        start, ray = (v + np.multiply.outer(v @ pole, pole) * (stretch - 1) for v in (position_m, lines))
        square, half, rest = (ray**2).sum(-1), ray @ start, start @ start - 6378137.0**2
        root = half**2 - square * rest
        point = start + ray * ((-half - np.sqrt(np.maximum(root, 0.0))) / square)[..., None]
        normal = point + np.multiply.outer(point @ pole, pole) * (stretch - 1)
        return root > 0, lines, normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    low, high = np.zeros(n_spoke), np.full(n_spoke, np.pi / 2)
    for _ in range(50):
        middle = (low + high) / 2
        on = look(middle)[0]
        low, high = np.where(on, middle, low), np.where(on, high, middle)
    off_nadir = (np.arange(n_ring)[:, None] + 0.5) / n_ring * low
    _, lines, normal = look(off_nadir)
    area_sr = np.sin(off_nadir) * low / n_ring * 2 * np.pi / n_spoke
    angle_deg = np.degrees(np.arctan2(np.linalg.norm(np.cross(lines, boresight), axis=-1), lines @ boresight))
    return area_sr, angle_deg, np.maximum(normal @ sun, 0.0)


@pytest.mark.accuracy
@pytest.mark.parametrize("altitude_km", [400.0, 1598.0, 35786.0])
def test_stray_light_of_the_earth_by_parts_of_its_disc(scene, altitude_km, record_accuracy):
    heat, visible = ws.Band.top_hat("heat", 9.0, 11.0), ws.Band.top_hat("visible", 0.55, 0.75)
    bands = scene.replace(bands=[heat, visible], optics={"aperture_m": 0.1, "psf": "gaussian", "sigma_px": 0.5})
    errors = {heat.name: [], visible.name: []}
    for off_nadir_deg in (0.0, 8.0, 19.0, 30.0, 45.0, 60.0, 75.0, 90.0):
        own = at_altitude(bands, altitude_km, off_nadir_deg)
        added, frames = added_w_cm2(own, sensors="one", stray_light=STRAY | {"sun": False, "moon": False})
        tracks, camera = frames.scenario.tracks, frames.instrument.sensor.camera
        sun_m = tracks.sun.position_at_m(frames.time_s)[0]
        sun, r_au = sun_m / np.linalg.norm(sun_m), np.linalg.norm(sun_m) / 1.495978707e11
        position_m = tracks.satellites[0].state(frames.time_s)[0][0]
        area_sr, angle_deg, cosine = earth_seen(position_m, frames.axes_icrs[0, 0, 2], sun, np.array(tracks.pole_icrs))
        ratio = np.exp(np.interp(angle_deg, STRAY["angle_deg"], np.log(STRAY["ratio_sr"])))
        for number, band in enumerate((heat, visible)):
            emitted = float(band_radiance_w_m2_sr(own.lighting.earth_k_in(band), band)) * 1e-4
            light = earth_albedo(band) * own.lighting.sun_w_m2_in(band) * 1e-4 / np.pi / r_au**2
            expected = (area_sr * ratio * (emitted + light * cosine)).sum()
            found = added[0, 0, number, 4, 4] * camera.focal_px * camera.focal_row_px
            errors[band.name].append(found / expected - 1)
    lines = {"heat": "Stray light of the Earth, heat", "visible": "Stray light of the Earth, visible"}
    for name, error in errors.items():
        record_accuracy(lines[name], np.abs(error).max(), STRAY_RTOL, "", "600 x 360 parts")


def test_the_moon_is_as_bright_as_measured():
    full, moon, square = np.array([0.0]), instant("2026-01-03T10:00:00"), (3.844e8 / 1.7374e6) ** 2
    visible = narrow(0.55)
    ratio = moon_brightness_w_cm2([visible], np.array([1.0]), 1.0, full)[0, 0] / square
    assert -2.5 * np.log10(ratio) == pytest.approx(-12.74 + 26.76, abs=0.15)  # magnitudes of Moon and Sun
    thermal = moon_brightness_w_cm2([narrow(10.0)], np.array([0.0]), 1.0, full)[0, 0] / square
    disc = np.pi * (1.7374e6 / 3.844e8) ** 2
    hottest = float(band_radiance_w_m2_sr(SUBSOLAR_K, narrow(10.0))) * 1e-4 * disc
    assert 0.6 * hottest < thermal < 0.95 * hottest
    nearer = moon_brightness_w_cm2([visible], np.array([1.0]), 0.99, full)[0, 0] / square
    assert nearer / ratio == pytest.approx(0.99**-2, rel=1e-3)  # sunlight at the Moon
    # Full Moon of 3 January 2026, 10:03 UTC: opposite to the Sun but for its latitude.
    moon_m, sun_then_m = moon_position_m(moon, 0.0), earth_states(moon, 0.0).sun_m
    cosine = moon_m @ sun_then_m / np.linalg.norm(moon_m) / np.linalg.norm(sun_then_m)
    assert cosine < np.cos(np.radians(174))


@pytest.mark.parametrize("raan_deg", [200.0, 290.0, 20.0, 110.0])
def test_stray_light_of_the_moon_is_that_at_the_sensor(scene, raan_deg):
    """By Allen's law with the phase and the distance from geostationary orbit, up to a quarter from the Earth's."""
    table = {"angle_deg": [0.0, 180.0], "ratio_sr": [1e-3, 1e-3], "sun": False, "earth": False}
    visible = ws.Band.top_hat("visible", 0.55, 0.75)
    bands = scene.replace(bands=[visible], optics={"aperture_m": 0.1, "psf": "gaussian", "sigma_px": 0.5})
    own = at_altitude(bands.replace(epoch_utc="2026-01-03T10:00:00"), 35786.0, 0.0, raan_deg)
    added, frames = added_w_cm2(own, sensors="one", stray_light=table)
    tracks, camera = frames.scenario.tracks, frames.instrument.sensor.camera
    sun_m, position_m = tracks.sun.position_at_m(frames.time_s)[0], tracks.satellites[0].state(frames.time_s)[0][0]
    moon_m = moon_position_m(instant("2026-01-03T10:00:00"), float(frames.time_s[0])).reshape(3)
    if grazing_altitude_m(position_m, moon_m, tracks.pole_icrs) < 0:
        assert added[0, 0, 0, 4, 4] == 0
        return
    to_sun, to_sensor = sun_m - moon_m, position_m - moon_m
    phase = np.degrees(np.arccos(to_sun @ to_sensor / np.linalg.norm(to_sun) / np.linalg.norm(to_sensor)))
    fading = 10 ** (-0.4 * (0.026 * phase + 4e-9 * phase**4)) * (1.4959787e11 / np.linalg.norm(to_sun)) ** 2
    sun_w_cm2 = own.lighting.sun_w_m2_in(visible) * 1e-4
    expected = 1e-3 * 0.12 * fading * sun_w_cm2 * (1.7374e6 / np.linalg.norm(to_sensor)) ** 2
    assert added[0, 0, 0, 4, 4] * camera.focal_px * camera.focal_row_px == pytest.approx(expected, rel=2e-3)


def test_check_tells_the_size_of_stray_light():
    table = {"angle_deg": [0, 10, 30, 60, 90, 180], "ratio_sr": [1e-1, 1e-3, 1e-5, 1e-6, 1e-7, 1e-8]}
    scene = ws.Scene.load("stss").replace(sky__catalog="none", bands=["A"], background={"stray_light": table})
    line = next(line for line in scene_report(scene.scenario).splitlines() if "stray light:" in line)
    low, high = (float(text) for text in re.search(r"A (\S+) to (\S+) NEI", line).groups())
    frames = ws.Renderer(scene).render(range(60, 100, 20), sensors=["sat21"], keep_signal=True)
    found = np.median(frames.signal_w_cm2.numpy(), axis=(-1, -2)) / 1e-18
    assert 0.0 < 0.99 * low <= found.min() <= found.max() <= 1.01 * high
