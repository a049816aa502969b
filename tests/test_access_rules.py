"""Rules of access: each against geometry of its own, the user's rules, and scenes."""

from __future__ import annotations

import erfa
import numpy as np
import pytest
import warp as wp
from warpsim_kernels.earth import Earth, is_occulted

import warpsim as ws
from warpsim.constants import ASTRONOMICAL_UNIT_M
from warpsim.errors import InputError
from warpsim.exchange.geodetic import geodetic_to_itrs_m
from warpsim.orbit.access import access_intervals, margins
from warpsim.orbit.access_constraints import AccessConstraints, CameraGeometry
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M, earth_clearance_m, grazing_altitude_m
from warpsim.orbit.sun import sunlit_fraction
from warpsim.scene.camera_axes import apparent_mean, satellite_state

Z = np.array([0.0, 0.0, 1.0])
EDGE_S = 1.1e-3  # ends are halved down to the promised 1 ms and off by up to all of it; the rest is for rounding
GRAZING_M = 1e-5  # Newton's last step and rounding at 2e7 m
PIXEL_PX = 1e-5  # the kernel's light path against the host's


def random_geometry(n_sensor=5, n_time=7, seed=2):
    rng = np.random.default_rng(seed)
    sensor = rng.normal(size=(n_sensor, n_time, 3)) * 1.5e6 + [8e6, 1e6, 2e6]
    target = rng.normal(size=(n_time, 3)) * 5e5 + [7.3e6, 3e6, 0.0]
    return sensor, target, rng.normal(size=(n_time, 3)) * 1.5e11


def test_limits_from_both_sides():
    sensor, target, sun = random_geometry()
    low = margins(sensor, target, sun, AccessConstraints(min_range_km=1000, min_elevation_deg=-20), Z)
    high = margins(sensor, target, sun, AccessConstraints(max_range_km=3000, max_elevation_deg=30), Z)
    distance_km = np.linalg.norm(target - sensor, axis=-1) / 1e3
    np.testing.assert_allclose(low["min_range_km"], distance_km - 1000, rtol=0, atol=1e-9)
    np.testing.assert_allclose(low["min_range_km"] + high["range_km"], 2000, rtol=0, atol=1e-9)
    np.testing.assert_allclose(low["elevation_deg"] + high["max_elevation_deg"], 50, rtol=0, atol=1e-9)


@pytest.mark.ci
def test_background_altitude_against_sampled_rays():
    rng = np.random.default_rng(8)
    sensor = rng.normal(size=(300, 3))
    sensor *= (rng.uniform(6.6e6, 1.2e7, 300) / np.linalg.norm(sensor, axis=1))[:, None]
    target = sensor + rng.normal(size=(300, 3)) * 1.5e6
    got = grazing_altitude_m(sensor, target, Z, beyond=True)
    between = grazing_altitude_m(sensor, target, Z)
    along_m = np.concatenate([[0.0], np.geomspace(1e3, 1e8, 30001)])
    n_lower = 0
    for a, b, lowest, segment in zip(sensor, target, got, between, strict=True):
        unit = (b - a) / np.linalg.norm(b - a)
        near_m = np.clip(-(a @ unit), 0, None) + np.linspace(-1e5, 1e5, 20001)  # the sphere's nearest point
        points = a + np.concatenate([along_m, near_m[near_m > 0]])[:, None] * unit
        sampled = erfa.gc2gd(1, points)[2].min()
        if sampled < -1e5:
            assert lowest < -5e4
        else:
            assert lowest - sampled == pytest.approx(0.0, abs=0.1)  # 10 m between samples, and 1e-4 of the way
        assert lowest <= segment + 1e-6
        n_lower += lowest < segment - 1.0
    assert n_lower > 100 and (got > 0).sum() > 60 and (got < 0).sum() > 30


def test_background_rule_tells_space_from_ground():
    sensor = np.array([[[8.0e6, 0, 0]]])
    rule = AccessConstraints(min_background_altitude_km=100)
    for target, against_space in (([7.5e6, 0, 0], False), ([8.5e6, 0, 0], True), ([7.9e6, 3e6, 0], True)):
        margin = margins(sensor, np.array([target]), np.zeros(3), rule, Z)
        assert (margin["background_altitude_km"][0, 0] >= 0) == against_space
        assert margin["earth_km"][0, 0] > 0


@wp.kernel(enable_backward=False)
def occulted_kernel(
    start: wp.array[wp.vec3d], way: wp.array[wp.vec3d], earth: Earth, hidden: wp.array[wp.int32]
):  # fmt: skip
    i = wp.tid()
    if is_occulted(start[i], way[i], earth):
        hidden[i] = 1


@pytest.mark.parametrize("pole", [Z, np.array([0.3, 0.4, np.sqrt(0.75)])], ids=["upright", "tilted"])
@pytest.mark.ci
def test_a_metre_over_the_horizon_is_free_and_a_metre_under_it_is_hidden(device, pole):
    """Lines that touch the ellipsoid raised by h metres: the lowest point is known. Kernel, rule and erfa agree."""
    rng = np.random.default_rng(6)
    n = 400
    lon, lat = rng.uniform(-180, 180, n), np.degrees(np.arcsin(rng.uniform(-1, 1, n)))
    lat[:3] = 90, -90, 0
    height = np.where(np.arange(n) % 2, 1.0, -1.0)
    up = geodetic_to_itrs_m(lon, lat, 1.0) - geodetic_to_itrs_m(lon, lat, 0.0)
    along = np.cross(up, rng.normal(size=(n, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    touch = geodetic_to_itrs_m(lon, lat, height)
    start, end = touch - along * rng.uniform(1e5, 5e6, (n, 1)), touch + along * rng.uniform(1e5, 5e6, (n, 1))
    # erfa: heights about the touching point, a metre apart in height within 3.5 km of it
    for a, b, t, h in zip(start[:20], end[:20], touch[:20], height[:20], strict=True):
        near = t + np.linspace(-1, 1, 2001)[:, None] * (b - a) / np.linalg.norm(b - a) * 5e3
        assert erfa.gc2gd(1, near)[2].min() == pytest.approx(h, abs=1e-5)
        assert erfa.gc2gd(1, np.stack([a, b]))[2].min() > 100
    # The same lines about another pole.
    across = np.cross(Z, pole) if pole is not Z else np.array([1.0, 0, 0])
    across /= np.linalg.norm(across)
    turn = np.stack([across, np.cross(pole, across), pole], axis=-1)
    start, end = start @ turn.T, end @ turn.T
    np.testing.assert_allclose(grazing_altitude_m(start, end, pole), height, rtol=0, atol=GRAZING_M)
    assert np.array_equal(earth_clearance_m(start, end, pole) > 0, height > 0)
    earth = Earth()
    earth.pole, earth.equatorial_radius_m = wp.vec3d(*pole), 6378137.0
    earth.polar_radius_m = EARTH_POLAR_RADIUS_M
    hidden = wp.zeros(n, dtype=wp.int32, device=device)
    inputs = [wp.array(x, dtype=wp.vec3d, device=device) for x in (start, end - start)]
    wp.launch(occulted_kernel, dim=n, inputs=[*inputs, earth], outputs=[hidden], device=device)
    assert np.array_equal(hidden.numpy() == 1, height < 0)


# --- the field of view ---

CAMERA = ws.Camera(n_row=100, n_col=240, fov_deg=40.0)


def test_frame_margin_has_the_sign_of_the_pixels():
    rng = np.random.default_rng(3)
    direction = rng.normal(size=(200000, 3))
    direction[:100000] += [0, 0, 3]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    margin = CAMERA.frame_margin_deg(direction)
    xy, in_front = CAMERA.project(direction, np.eye(3))
    inside = in_front & (np.abs(xy - CAMERA.centre_px) <= [120, 50]).all(axis=1)
    assert np.array_equal(margin >= 0, inside)
    assert inside.sum() > 5000 and (~in_front).sum() > 40000


def test_frame_margin_is_the_angle_to_the_nearest_edge():
    half = np.degrees(np.arctan(50 / CAMERA.focal_px))
    for angle in (-19.0, 0.0, 5.0, 19.9, 30.0, 100.0, 179.0):
        sine, cosine = np.sin(np.radians(angle)), np.cos(np.radians(angle))
        margin = CAMERA.frame_margin_deg([sine, 0, cosine])
        upright = np.degrees(np.arcsin(cosine * np.sin(np.radians(half))))  # from the edges above and below
        sideways = np.degrees(np.arcsin(np.sin(np.radians(20.0 - abs(angle)))))
        assert margin == pytest.approx(min(sideways, upright), abs=1e-9)
        assert CAMERA.frame_margin_deg([0, sine, cosine]) <= half - abs(angle) + 1e-9 or abs(angle) > 90
    assert CAMERA.frame_margin_deg([0, 0, -1.0]) == pytest.approx(-20.0, abs=1e-9)
    edges = np.linspace(-120, 120, 20001)  # nearest point of the drawn rectangle
    rectangle = np.concatenate([
        np.stack([edges, np.full_like(edges, y), np.full_like(edges, CAMERA.focal_px)], -1) for y in (-50, 50)
    ] + [np.stack([np.full_like(edges, x), edges * 5 / 12, np.full_like(edges, CAMERA.focal_px)], -1)
         for x in (-120, 120)])  # fmt: skip
    rectangle /= np.linalg.norm(rectangle, axis=1, keepdims=True)
    for x, y in ((0, 0), (100, 10), (-30, 45), (-119, -2)):
        seen = np.array([x, y, CAMERA.focal_px]) / np.linalg.norm([x, y, CAMERA.focal_px])
        nearest = np.degrees(2 * np.arcsin(np.linalg.norm(rectangle - seen, axis=1).min() / 2))
        assert CAMERA.frame_margin_deg(seen) == pytest.approx(nearest, abs=1e-4)


SENSORS_M = [[2.0e7, 0.0, 0.0], [2.0e7, 1e5, 0.0]]


def still(place):
    return lambda t: np.broadcast_to(np.asarray(place, float), (*np.shape(t), 3))


def turning(t):
    """A target 1,000 km above the first sensor, at 0.1 deg/s from its x axis towards its y axis."""
    angle = np.radians(0.1) * np.asarray(t)
    return np.array(SENSORS_M[0]) + 1e6 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)


def test_in_fov_is_entered_and_left_at_the_edges():
    """A camera along -x: the target stands in its frame while it is within 20 degrees of that."""
    axes = np.array([[0.0, 1, 0], [0, 0, 1], [-1, 0, 0]])  # rows; right-handed about -x is not asked for
    asked = []

    def held(number, time_s):
        asked.append(number)
        assert np.ndim(time_s) == 1
        return np.broadcast_to(axes, (len(time_s), 3, 3))

    fov = CameraGeometry(CAMERA, held)
    rule = AccessConstraints(in_fov=True)
    got = access_intervals([still(SENSORS_M[0])], turning, still([1e11, 0, 0]), rule, Z, 3600.0, 30.0, fov=fov)
    assert [(g.start_s, g.end_s) for g in got] == [(pytest.approx(1600, abs=EDGE_S), pytest.approx(2000, abs=EDGE_S))]
    assert set(asked) == {0}
    away = CameraGeometry(CAMERA, held, direction=lambda _, t: np.broadcast_to([0.0, 0, 1], (len(t), 3)))
    assert access_intervals([still(SENSORS_M[0])], turning, still([1e11, 0, 0]), rule, Z, 3600.0, fov=away) == []
    with pytest.raises(InputError, match="in_fov: needs to know how the camera stands"):
        access_intervals([still(SENSORS_M[0])], turning, still([1e11, 0, 0]), rule, Z, 3600.0)


def test_each_camera_has_axes_of_its_own():
    axes = [np.array([[0.0, 1, 0], [0, 0, 1], [-1, 0, 0]]), np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])]
    fov = CameraGeometry(CAMERA, lambda i, t: np.broadcast_to(axes[i], (len(t), 3, 3)))
    time_s = np.linspace(0, 3600, 41)
    place = np.stack([still(p)(time_s) for p in SENSORS_M])
    margin = margins(
        place, turning(time_s), np.zeros(3), AccessConstraints(in_fov=True), Z, time_s=time_s, fov=fov
    )["fov_deg"]  # fmt: skip
    for i in range(2):
        seen = (turning(time_s) - SENSORS_M[i]) @ axes[i].T
        np.testing.assert_array_equal(margin[i], CAMERA.frame_margin_deg(seen))
    assert 0 < (margin >= 0).sum() < margin.size


@pytest.mark.ci
def test_apparent_direction_is_where_the_image_shows_it(scene):
    frames = ws.Renderer(scene, device="cpu").render([60, 90], ["sat11", "sat27"], ["A"])
    tracks = scene.scenario.tracks
    for row in frames.truth[::7]:
        satellite, target = scene.sensor_names.index(row["sensor"]), scene.target_names.index(row["target"])
        seen = apparent_mean(tracks, [target], satellite_state(tracks, satellite, np.array([row["time_s"]])))
        axes = frames.axes_icrs[list(frames.frames).index(row["frame"]), frames.sensors.index(row["sensor"])]
        xy, in_front = scene.camera.project(seen, axes)
        if in_front[0] and np.isfinite(row["x_px"]):
            assert np.abs(xy[0] - [row["x_px"], row["y_px"]]).max() < PIXEL_PX
            margin = scene.camera.frame_margin_deg(seen @ axes.T)[0]
            assert (margin >= 0) == row["in_fov"]


def test_a_scene_asks_its_cameras(scene):
    """Cameras that look straight down, 119 degrees wide: the rule ends accesses that others allow."""
    down = {"kind": "fixed", "azimuth_elevation_deg": [0.0, -90.0]}
    gaussian = {"aperture_m": 0.4, "psf": "gaussian", "sigma_px": 0.8}
    wide = scene.replace(camera__fov_deg=119.0, optics=gaussian, pointing=down)
    rules = AccessConstraints(in_fov=True)
    table = wide.access("center", rules=rules)
    free = {row["sensor"]: (row["start_s"], row["end_s"]) for row in wide.access("center", rules=AccessConstraints())}
    assert len(table)
    for row in table:
        start_s, end_s = row["start_s"], row["end_s"]
        assert free[row["sensor"]][0] <= start_s < end_s <= free[row["sensor"]][1]
        near = np.array([start_s - EDGE_S, start_s, end_s, end_s + EDGE_S])
        near = np.clip(near, 0, wide.duration_s)
        found = wide.access_margins(near, sensors=[row["sensor"]], rules=rules)
        assert set(found) == {"earth_km", "fov_deg"}
        seen = (found["earth_km"][0] >= 0) & (found["fov_deg"][0] >= 0)
        assert seen[1] and seen[2]
        assert not seen[0] or start_s == 0
        assert not seen[3] or end_s == wide.duration_s


@pytest.mark.ci
def test_in_fov_agrees_with_the_truth_of_images(scene):
    """A frame so narrow that targets of the group leave it."""
    scene = scene.replace(camera__fov_deg=0.05, optics={"aperture_m": 0.4, "psf": "gaussian", "sigma_px": 0.8})
    sensors, rules = ["sat11", "sat27"], AccessConstraints(in_fov=True)
    frames = ws.Renderer(scene, device="cpu").render(range(10, 162, 10), sensors, ["A"])
    n_inside = 0
    for target in scene.target_names:
        margin = scene.access_margins(frames.time_s, target=target, sensors=sensors, rules=rules)["fov_deg"]
        rows = frames.truth[frames.truth["target"] == target]
        truth = np.stack([np.array(rows["in_fov"][rows["sensor"] == sensor]) for sensor in sensors])
        assert np.array_equal(margin >= 0, truth)
        n_inside += truth.sum()
    assert 100 < n_inside < 800


# --- light on the target ---


def test_sunlit_rule_ends_in_the_penumbra():
    rate = np.sqrt(3.986004418e14 / 7.2e6**3)

    def circling(t):
        angle = rate * np.asarray(t)
        return 7.2e6 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)

    sensor = lambda t: 1.4 * circling(t)  # noqa: E731
    sun = still([ASTRONOMICAL_UNIT_M, 0, 0])
    ends = []
    for share in (1e-6, 0.5, 1.0):
        rule = AccessConstraints(min_target_sunlit=share)
        got = access_intervals([sensor], circling, sun, rule, Z, 6000.0, 60.0)
        assert len(got) == 2 and got[0].start_s == 0.0
        for t, outward in ((got[0].end_s, 1), (got[1].start_s, -1)):
            lit = sunlit_fraction(circling(np.array([t, t + outward * EDGE_S])), sun(t), Z)
            assert lit[0] >= share > lit[1]
        ends.append(got[0].end_s)
    assert ends[0] > ends[1] + 2 > ends[2] + 4


# --- the user's rules ---


def day_of_walker(duration_s=20000.0):
    """Tracks of twelve satellites and a circling target."""
    from warpsim.orbit.gravity import propagate
    from warpsim.orbit.sampling import node_grid, sample_tracks

    start, n_node = node_grid(duration_s, 14.0)
    sample = lambda walker: sample_tracks(  # noqa: E731
        walker.names, lambda t: propagate(*walker.state(), t, "two_body", Z), start, 14.0, n_node
    )
    return sample(ws.Walker(12, 3, 1, 1200, 65)), sample(ws.Walker(1, 1, 0, 500, 30))[0].position_at_m


def test_a_custom_rule_like_a_built_in_one_gives_the_same():
    sensors, target = day_of_walker()
    args = target, still([0, 1.5e11, 0])
    own = {"near": lambda view: 3e6 - view.range_m, "low": lambda view: np.sin(np.radians(-view.elevation_deg - 5))}
    built_in = AccessConstraints(max_range_km=3000, max_elevation_deg=-5)
    for step_s in (10.0, 60.0):
        expected = access_intervals(sensors, *args, built_in, Z, 20000.0, step_s)
        got = access_intervals(sensors, *args, AccessConstraints(), Z, 20000.0, step_s, custom=own)
        assert len(expected) > 10 and [g.sensor for g in got] == [e.sensor for e in expected]
        np.testing.assert_allclose([g[1:] for g in got], [e[1:] for e in expected], rtol=0, atol=EDGE_S)


def test_custom_rules_see_times_and_sensors():
    sensors, target = day_of_walker()
    free = access_intervals(sensors, target, still([0, 1.5e11, 0]), AccessConstraints(), Z, 2e4)
    chosen = free[len(free) // 2]
    low_s, high_s = chosen.start_s + 50.25, chosen.end_s - 20.5
    seen = set()

    def window(view):
        seen.update(np.unique(view.sensor).tolist())
        assert view.sensor.shape[1] == 1 and view.shape[0] == view.sensor.shape[0]
        return np.where(view.sensor == chosen.sensor, np.minimum(view.time_s - low_s, high_s - view.time_s), -1.0)

    got = access_intervals(sensors, target, still([0, 1.5e11, 0]), AccessConstraints(), Z, 2e4, custom={"w": window})
    assert [g.sensor for g in got] == [chosen.sensor]
    assert got[0][1:] == (pytest.approx(low_s, abs=EDGE_S), pytest.approx(high_s, abs=EDGE_S))
    assert seen == {a.sensor for a in free}  # where the Earth is in the way, nobody asks


def test_booleans_and_infinite_margins_are_rules_too(scene):
    yes = scene.access(custom={"yes": lambda view: np.ones(view.shape, bool), "far": lambda view: np.inf})
    assert len(yes) == len(scene.access())
    assert yes.meta["custom_rules"] == ["yes", "far"]
    assert len(scene.access(custom={"no": lambda view: view.range_m < 0})) == 0
    late = scene.access(custom={"late": lambda view: view.time_s > 800.0})
    assert len(late) and late["start_s"].min() == pytest.approx(800.0, abs=2e-3)


@pytest.mark.parametrize(
    ("custom", "message"),
    [
        ({"mine": lambda view: np.zeros(7)}, r"custom\['mine'\]: must give an array of shape \(\d+, 1\), got \(7,\)"),
        ({"mine": lambda view: np.full(view.shape, np.nan)}, r"custom\['mine'\]: must give a number .*, got NaN"),
        ({"mine": lambda view: np.full(view.shape, "x")}, r"custom\['mine'\]: must give numbers or booleans"),
        ({"mine": 3.0}, r"custom\['mine'\]: must be a function"),
        ({"range_km": lambda view: view.range_m}, "names other than warpsim's own constraints, got 'range_km'"),
        ({3: lambda view: view.range_m}, "custom: must have names other"),
        ([], "custom: must be a dict of names and functions, got list"),
    ],
)  # fmt: skip
def test_errors_of_custom_rules_name_the_rule(scene, custom, message):
    with pytest.raises(InputError, match=message) as caught:
        scene.access(sensors=["sat11"], custom=custom)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"min_target_sunlit": 0.0}, r"min_target_sunlit: must be in \(0, 1\], got 0.0"),
        ({"min_target_sunlit": 1.1}, "min_target_sunlit"),
        ({"max_elevation_deg": 95}, r"max_elevation_deg: must be in \[-90, 90\], got 95"),
        ({"min_range_km": -1}, "min_range_km: must be > 0"),
        ({"in_fov": 1}, "in_fov: must be true or false"),
        ({"min_range_km": 7000, "max_range_km": 6000}, r"min_range_km: must be at most .* \(6000\), got 7000"),
        ({"min_elevation_deg": 1, "max_elevation_deg": 0}, "min_elevation_deg: must be at most max_elevation_deg"),
    ],
)  # fmt: skip
def test_errors_of_the_new_rules(changes, message):
    with pytest.raises(InputError, match=message):
        AccessConstraints(**changes)


# --- scenes ---


def test_access_to_another_target_by_other_sensors_and_rules(scene):
    other = scene.target_names[5]
    rules = AccessConstraints(max_range_km=5000, min_background_altitude_km=30, min_target_sunlit=1.0)
    table = scene.access(target=other, sensors=["sat27", "sat11"], rules=rules)
    assert table.meta["target"] == other
    assert table.meta["rules"] == {
        "max_range_km": 5000.0, "min_background_altitude_km": 30.0, "min_target_sunlit": 1.0,
    }  # fmt: skip
    order = [["sat27", "sat11"].index(name) for name in table["sensor"]]
    assert len(table) and order == sorted(order)
    for row in table:
        assert row["duration_s"] == row["end_s"] - row["start_s"] > 0
        for edge, outward in ((row["start_s"], -1), (row["end_s"], 1)):
            beyond_s = np.clip(edge + outward * 2e-3, 0, scene.duration_s)
            found = scene.access_margins([edge, beyond_s], target=other, sensors=[row["sensor"]], rules=rules)
            assert set(found) == {"earth_km", "range_km", "background_altitude_km", "target_sunlit"}
            assert min(v[0, 0] for v in found.values()) > -1e-6
            assert beyond_s == edge or min(v[0, 1] for v in found.values()) < 0
    same = scene.access(target="center", sensors=scene.sensor_names, rules=scene.access_rules)
    assert list(same["start_s"]) == list(scene.access()["start_s"])
    assert str(scene.access()["duration_s"].unit) == "s"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"target": "sat11"}, r"target: must be a target of the scene \(center, .*\), got 'sat11'"),
        ({"sensors": ["sat11", "sat99"]}, r"sensors: must be sensors of the scene \(sat11, .*\), got 'sat99'"),
        ({"sensors": []}, "sensors: must name at least one"),
        ({"sensors": ["sat11", "sat11"]}, "sensors: must be one or more without repeats"),
        ({"rules": {"max_range_km": 5}}, "rules: must be AccessConstraints, got dict"),
        ({"step_s": 0.0}, "step_s: must be a number > 0, got 0.0"),
        ({"step_s": "10"}, "step_s: must be a number > 0, got '10'"),
        ({"step_s": 1e-9}, "step_s: must be >= 0.00032 for 1614 s, got 1e-09"),
    ],
)
def test_errors_of_scene_access(scene, arguments, message):
    with pytest.raises(InputError, match=message):
        scene.access(**arguments)


def test_eclipses_of_a_scene(scene):
    """At night over the northern Pacific in winter: some satellites and the target pass through the shadow."""
    n_row = 0
    for name in [*scene.sensor_names[:14], "center"]:
        table = scene.scenario.eclipses(name)
        n_row += len(table)
        time_s = np.arange(0.0, scene.duration_s, 5.0)
        share = scene.scenario.sunlit_fraction(name, time_s)
        dark = np.zeros(len(time_s), bool)
        umbra = dark.copy()
        for row in table:
            dark |= (time_s >= row["start_s"]) & (time_s <= row["end_s"])
            umbra |= (time_s >= row["umbra_start_s"]) & (time_s <= row["umbra_end_s"])
        assert np.array_equal(dark, share < 1) and np.array_equal(umbra, share == 0)
    assert n_row > 3
    names = ["start_s", "umbra_start_s", "umbra_end_s", "end_s", "duration_s"]
    assert scene.scenario.eclipses("sat11").colnames == names
    with pytest.raises(InputError, match="name: must be a sensor or a target"):
        scene.scenario.eclipses("moon")
