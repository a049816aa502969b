"""Lines of sight and triangulation: against ERFA, astropy, positions of targets, and draws of noise."""

from dataclasses import replace

import astropy.units as u
import erfa
import numpy as np
import pytest
from astropy.coordinates import GCRS, ITRS, CartesianRepresentation
from astropy.time import TimeDelta

import warpsim as ws

C_M_S = 299792458.0
SENSORS = ["sat11", "sat27", "sat21"]


@pytest.fixture(scope="module")
def scene():
    return ws.Scene.load("stss").replace(sky__catalog="none", optics__psf="gaussian", optics__sigma_px=0.7)


@pytest.fixture(scope="module")
def frames(scene):
    return ws.Renderer(scene).render(range(60, 66), sensors=SENSORS, bands=["A"])


def rows_of(frames, frame, sensor):
    truth = frames.truth
    return truth[(truth["frame"] == frame) & (truth["sensor"] == sensor) & np.isfinite(truth["x_px"])]


POSITION_M = 1e-3
"""Tracks between their nodes; lines themselves are exact to 1e-7 m."""


def test_targets_were_where_their_lines_say(scene, frames):
    for frame in (60, 65):
        for sensor in SENSORS:
            rows = rows_of(frames, frame, sensor)
            line = frames.line_of_sight(frame, sensor, np.c_[rows["x_px"], rows["y_px"]], 1e3 * rows["range_km"])
            np.testing.assert_allclose(
                line.emission_time_s, rows["time_s"] - 1e3 * rows["range_km"] / C_M_S, rtol=1e-15
            )
            for target, position, time_s in zip(rows["target"], line.position_m, line.emission_time_s, strict=True):
                np.testing.assert_allclose(position, scene.position_m(target, [time_s])[0], atol=POSITION_M)


def test_light_falls_where_erfa_and_astropy_put_it(scene, frames):
    """Geometric direction, ERFA's aberration out of the Earth's frame and into the sensor's, astropy's WCS."""
    sensor, frame = "sat27", 62
    time_s = frames.time_s[2]
    origin = scene.position_m(sensor, [time_s])[0]
    away = frames.line_of_sight(frame, sensor, [[3.0, 100.0], [90.0, 20.0]], 2e6).position_m - origin
    epoch = scene.epoch + TimeDelta(time_s, format="sec")
    earth_m_s = np.asarray(erfa.epv00(epoch.tdb.jd1, epoch.tdb.jd2)[1]["v"]) * (erfa.DAU / erfa.DAYSEC)
    sensor_m_s = earth_m_s + (scene.position_m(sensor, [time_s + 0.5])[0] - scene.position_m(sensor, [time_s - 0.5])[0])

    def seen(direction, velocity_m_s):
        beta = velocity_m_s / C_M_S
        return erfa.ab(direction, beta, 1e12, np.sqrt(1 - beta @ beta))

    xy = []
    for vector in away:
        apparent = seen(seen(vector / np.linalg.norm(vector), -earth_m_s), sensor_m_s)
        ra_dec = np.degrees(erfa.c2s(apparent))
        xy.append(frames.wcs(frame, sensor).all_world2pix([ra_dec], 0)[0])
    np.testing.assert_allclose(xy, [[3.0, 100.0], [90.0, 20.0]], atol=1e-6)


def test_projecting_is_the_inverse(frames):
    xy = np.random.default_rng(1).uniform(-20.0, 150.0, (50, 2))
    line = frames.line_of_sight(61, "sat11", xy, np.linspace(1e3, 1e8, 50))
    back, in_front = frames.project(61, "sat11", line.position_m)
    assert in_front.all()
    np.testing.assert_allclose(back, xy, atol=1e-7)
    behind, in_front = frames.project(61, "sat11", line.origin_m[:1] - line.direction[:1])
    assert not in_front.any() and np.isnan(behind).all()


def test_earth_fixed_axes_are_those_of_astropy(scene, frames):
    inertial = frames.line_of_sight(60, "sat21", [64.0, 64.0], 3e6)
    fixed = frames.line_of_sight(60, "sat21", [64.0, 64.0], 3e6, axes="itrs")
    when = scene.epoch + TimeDelta(inertial.time_s[0], format="sec")
    x, y, z = inertial.position_m[0]
    expected = GCRS(CartesianRepresentation(x, y, z, unit="m"), obstime=when).transform_to(ITRS(obstime=when))
    # Polar motion and UT1 are astropy's by tables, ours by the model of the scene: metres.
    np.testing.assert_allclose(fixed.position_m[0], expected.cartesian.xyz.to_value("m"), atol=60.0)
    assert fixed.axes == "itrs"


def lines_of(frames, numbers, target, rng=None, sigma_px=0.0):
    lines = []
    for frame in numbers:
        for sensor in SENSORS:
            row = rows_of(frames, frame, sensor)
            (row,) = row[row["target"] == target]
            xy = np.array([row["x_px"], row["y_px"]])
            lines.append(frames.line_of_sight(frame, sensor, xy if rng is None else xy + rng.normal(0, sigma_px, 2)))
    return lines


SIGMA_RAD = np.radians(1.0 / 128)
"""A pixel."""


FLIGHT_M = 0.02
"""Tracks between their nodes, and float64 lines of 3000 km."""


def test_triangulation_without_noise(scene, frames):
    main = scene.target_names[0]

    def off_m(found):
        return np.linalg.norm(found.position_m - scene.position_m(main, [found.time_s])[0])

    still = ws.triangulate(lines_of(frames, [60], main), SIGMA_RAD)
    assert 5.0 < off_m(still) < 60.0  # it moves on between the times at which its light left for the sensors
    linear = ws.triangulate(lines_of(frames, [60], main), SIGMA_RAD, "linear")
    assert off_m(linear) < 0.01 and linear.n_freedom == 0
    flight = ws.triangulate(lines_of(frames, range(60, 66), main), SIGMA_RAD, "free_flight")
    velocity = (scene.position_m(main, [flight.time_s + 1])[0] - scene.position_m(main, [flight.time_s - 1])[0]) / 2
    assert off_m(flight) < FLIGHT_M
    np.testing.assert_allclose(flight.velocity_m_s, velocity, atol=1e-3)
    later = ws.triangulate(lines_of(frames, range(60, 66), main), SIGMA_RAD, "free_flight", time_s=660.0)
    assert later.time_s == 660.0 and off_m(later) < FLIGHT_M


def test_free_flight_has_the_oblate_earth(scene):
    """Half an hour of lines, of a target that flies by the scene's own gravity."""
    renderer, main = ws.Renderer(scene), scene.target_names[0]
    frames = renderer.render(range(40, 100, 4), sensors=SENSORS, bands=["A"])
    found = ws.triangulate(lines_of(frames, frames.frames, main), SIGMA_RAD, "free_flight")
    assert np.linalg.norm(found.position_m - scene.position_m(main, [found.time_s])[0]) < FLIGHT_M
    assert found.chi_square < 1e-6


N_DRAW = 120


@pytest.mark.slow
@pytest.mark.parametrize(("motion", "numbers"), [("still", [60]), ("free_flight", range(60, 66))])
def test_covariance_is_that_of_draws(scene, frames, motion, numbers):
    """Errors of N_DRAW draws of noise, whitened by the stated covariance, are unit; so is chi-square by its freedom."""
    rng, sigma_px = np.random.default_rng(5), 0.05
    main = scene.target_names[0]
    sigma_rad = sigma_px * SIGMA_RAD
    exact = ws.triangulate(lines_of(frames, numbers, main), sigma_rad, motion)
    found = [ws.triangulate(lines_of(frames, numbers, main, rng, sigma_px), sigma_rad, motion) for _ in range(N_DRAW)]
    root = np.linalg.cholesky(exact.covariance[:3, :3])
    errors = np.array([np.linalg.solve(root, one.position_m - exact.position_m) for one in found])
    assert np.abs(errors.mean(axis=0)).max() < 5 / np.sqrt(N_DRAW)
    np.testing.assert_allclose(errors.var(axis=0), 1.0, atol=5 * np.sqrt(2 / N_DRAW))
    chi_square = np.mean([one.chi_square for one in found])
    assert chi_square == pytest.approx(exact.n_freedom, abs=5 * np.sqrt(2 * exact.n_freedom / N_DRAW))


def test_bad_input_is_refused(scene, frames):
    line = lines_of(frames, [60], scene.target_names[0])
    several = frames.line_of_sight(60, "sat11", [[1.0, 2.0], [3.0, 4.0]])
    cases = [
        (lambda: ws.triangulate(line[:1], 1e-4), "lines: must be at least 2, got 1"),
        (lambda: ws.triangulate(line[:2], 1e-4, "linear"), "lines: must be at least 3 for 'linear', got 2"),
        (lambda: ws.triangulate([line[0], several], 1e-4), "lines[1]: must be of one direction"),
        (lambda: ws.triangulate(line, 0.0), "sigma_rad: must be above 0"),
        (lambda: ws.triangulate(line, 1e-4, "falling"), "motion: must be one of still, linear, free_flight"),
        (lambda: ws.triangulate([line[0], line[0]], 1e-4), "lines: must not all be parallel"),
        (lambda: several.position_m, "range_m: give it to line_of_sight"),
        (lambda: frames.line_of_sight(60, "sat11", [1.0, 2.0], -1.0), "range_m: must be finite and at least 0"),
        (lambda: frames.line_of_sight(60, "sat11", [1.0, 2.0], axes="teme"), "axes: must be one of gcrs, itrs"),
        (lambda: frames.line_of_sight(99, "sat11", [1.0, 2.0]), "line_of_sight: frame 99 of 'sat11'"),
        (lambda: frames.project(60, "sat11", [np.nan, 0.0, 0.0]), "position_m: must be finite"),
        (lambda: frames.project(60, "sat11", [1.0, 2.0]), "position_m: must have shape (n, 3) or (3,), got (2,)"),
        (lambda: frames.line_of_sight(60, "sat11", "ab"), "xy_px: must be numbers"),
        (lambda: ws.triangulate(line[0], 1e-4), "lines: must be a list of lines of sight"),
        (lambda: ws.triangulate(line, 1e-4, time_s=np.nan), "time_s: must be finite"),
        (lambda: ws.triangulate([replace(one, direction=-one.direction) for one in line], 1e-4), "lines[0]: goes away"),
    ]
    for call, message in cases:
        with pytest.raises(ws.InputError) as error:
            call()
        assert message in str(error.value) and "\n" not in str(error.value)


def test_units_are_converted(frames):
    plain = frames.line_of_sight(60, "sat11", [3.0, 4.0], 2e6)
    with_units = frames.line_of_sight(60, "sat11", [3.0, 4.0] * u.pix, 2000.0 * u.km)
    np.testing.assert_array_equal(plain.position_m, with_units.position_m)
    xy, _ = frames.project(60, "sat11", plain.position_m / 1e3 * u.km)
    np.testing.assert_allclose(xy, [[3.0, 4.0]], atol=1e-6)


@pytest.mark.ci
@pytest.mark.parametrize("line_time_s", [1e-3, -5e-3])
def test_lines_of_rows_that_are_read_in_turn(scene, line_time_s):
    """Targets were where their lines say at the time of their row; cameras that track, with an error of pointing."""
    bias = {"urad": [300.0, -500.0]}
    detector = {"detector__line_time_s": line_time_s, "camera__n_row": 64, "camera__n_col": 64}
    rolled = scene.replace(**detector, pointing={"kind": "track", "bias": bias})
    frames = ws.Renderer(rolled).render([60], sensors=["sat11", "sat21"], bands=["A"])
    for sensor in frames.sensors:
        rows = rows_of(frames, 60, sensor)
        line = frames.line_of_sight(60, sensor, np.c_[rows["x_px"], rows["y_px"]], 1e3 * rows["range_km"])
        np.testing.assert_allclose(line.time_s, rows["time_s"] + rows["row_time_s"], atol=1e-9)
        for target, position, time_s in zip(rows["target"], line.position_m, line.emission_time_s, strict=True):
            np.testing.assert_allclose(position, scene.position_m(target, [time_s])[0], atol=ROW_POSITION_M)
        back, _ = frames.project(60, sensor, line.position_m)
        np.testing.assert_allclose(back, np.c_[rows["x_px"], rows["y_px"]], atol=1e-3)


ROW_POSITION_M = 1.0
"""A path's series is within 1e-3 px, which is 0.5 m."""
