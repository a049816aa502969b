"""Groups that begin and end, orbits of many targets, classes, spread numbers, and by what access counts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from test_orbit_tle import ISS

import warpsim as ws
from warpsim.scene.targets import drawn_spec

TRACK_M = 2e-3
"""Two paths between nodes of two grids."""

BALL = {
    "name": "ball", "shape": {"kind": "sphere", "radius_m": 0.5}, "surface": {"reflectance": 0.5},
    "temperature": {"start_k": 300.0, "end_k": 290.0},
}  # fmt: skip
ARC = {
    "kind": "ballistic_arc", "start_lon_lat_deg": [129.67, 40.86], "end_lon_lat_deg": [-118.4, 34.1],
    "duration_s": 1400.0, "endpoint_altitude_km": 121.92,
}  # fmt: skip
LATE = {"name": "late", "trajectory": ARC, "targets": [BALL], "start_s": 180.0}


@pytest.fixture(scope="module")
def two(scene):
    """The paper's group, and another that is launched three minutes later and lands before the end."""
    rules = {"max_range_km": 8000.0, "min_grazing_altitude_km": 50.0}
    return scene.replace(groups=[*scene.groups, LATE], sky__catalog="none", access_rules=rules)


def rows_of(truth, target, band="A"):
    return truth[(truth["target"] == target) & (truth["band"] == band)]


def test_a_launch_after_the_epoch_is_the_same_flight_from_its_own_epoch(two, scene):
    later = scene.replace(epoch_utc="2025-01-01T14:03:00", duration_s=1400.0, groups=[{**LATE, "start_s": 0.0}],
                          frames__count=141)  # fmt: skip
    times = np.linspace(0.0, 1400.0, 41)
    # The pole of date, which J2 acts about, is that of the launch in both.
    np.testing.assert_allclose(
        two.position_m("ball", times + 180.0), later.position_m("ball", times), rtol=0, atol=TRACK_M
    )


def test_targets_are_absent_before_and_after(two, device):
    frames = ws.Renderer(two, device=device).render(range(0, 162, 3), ["sat11", "sat47"], keep_signal=True)
    truth = frames.truth
    there = (frames.time_s >= 180.0) & (frames.time_s <= 1580.0)
    for band in two.bands:
        rows = rows_of(truth, "ball", band)
        absent = np.asarray(rows["absent"]).reshape(len(there), 2)
        assert (absent == ~there[:, None]).mean() > 0.95  # light that left before the launch comes after it
        late = absent & there[:, None]
        assert late.sum() <= 2 and not (~absent & ~there[:, None]).any()
        gone = np.asarray(rows["absent"])
        for name in ("occulted", "in_fov", "not_deployed", "access"):
            assert not rows[name][gone].any()
        for name in ("x_px", "y_px", "range_km", "temperature_k", "aspect_deg"):
            assert np.isnan(rows[name][gone]).all() and np.isfinite(rows["range_km"][~gone]).all()
        assert (rows["irradiance_w_cm2"][gone] == 0).all() and (rows["snr"][gone] == 0).all()
    alone = two.replace(groups=[two.groups[0]])
    before = [ws.Renderer(one, device=device).render([3], ["sat11"], keep_signal=True) for one in (two, alone)]
    np.testing.assert_array_equal(*(frames.signal_w_cm2.numpy() for frames in before))
    wide = {"camera__fov_deg": 60.0, "optics__psf": "gaussian", "optics__sigma_px": 0.7}
    during = [ws.Renderer(one.replace(**wide), device=device).render([40], ["sat11"], keep_signal=True)
              for one in (two, alone)]  # fmt: skip
    total = [frames.signal_w_cm2.numpy().sum() for frames in during]
    assert total[0] > total[1]


@pytest.mark.ci
def test_exists_s_bounds_what_there_is(scene, device):
    short = scene.replace(groups=[{**scene.to_dict()["groups"][0], "exists_s": [300.0, 900.0]}], sky__catalog="none")
    frames = ws.Renderer(short, device=device).render([10, 31, 60, 90, 100], ["sat11"], ["A"])
    rows = rows_of(frames.truth, "center")
    assert rows["absent"].tolist() == [True, False, False, False, True]
    whole = ws.Renderer(scene.replace(sky__catalog="none"), device=device).render([31, 60], ["sat11"], ["A"]).truth
    middle = frames.truth[~np.asarray(frames.truth["absent"])]
    middle = middle[np.isin(middle["frame"], [31, 60])]
    np.testing.assert_allclose(middle["x_px"], whole["x_px"], rtol=0, atol=1e-6)
    assert np.isnan(short.scenario.temperature_k("center", [100.0, 1000.0])).all()
    intervals = short.access(target="center")
    assert intervals["start_s"].min() >= 300.0 - 1e-3 and intervals["end_s"].max() <= 900.0 + 1e-3


def test_light_curves_know_absence(two):
    curves = ws.light_curves(two, [100.0, 600.0, 1600.0], sensors=["sat11"], targets=["ball", "center"])
    assert curves.absent[:, 0].tolist() == [[True, False], [False, False], [True, False]]
    assert (curves.irradiance_w_cm2[0, 0, :, 0] == 0).all() and (curves.irradiance_w_cm2[1, 0, :, 0] > 0).all()
    for name in ("range_km", "aspect_deg", "projected_area_m2", "temperature_k", "sunlit_fraction"):
        np.testing.assert_array_equal(np.isnan(getattr(curves, name)), curves.absent)  # as in truth


def test_targets_that_are_gone_before_their_release_are_never_seen(two):
    second = two.to_dict()["groups"][1]
    second |= {"targets": [*second["targets"], {**second["targets"][0], "name": "late", "count": 2}]}
    second |= {"exists_s": [500.0, 700.0], "release": {"time_s": 800.0}}
    late = two.replace(groups__1=second, frames__count=100)
    truth = ws.Renderer(late, device="cpu").render([60, 69], ["sat11"], ["A"]).truth
    own = truth[np.isin(truth["target"], late.groups[1].names[1:])]
    assert len(own) and own["not_deployed"].all() and not own["irradiance_w_cm2"].any()


@pytest.mark.ci
def test_scenes_with_spread_numbers_have_a_hash_and_do_not_change(scene):
    spread = {"shape.radius_m": {"uniform": [0.2, 0.4]}}
    one, other = (scene.replace(targets__1__spread=spread) for _ in range(2))
    assert one == other and hash(one) == hash(other) and one != scene
    with pytest.raises(TypeError):
        one.targets[1].spread["shape.radius_m"] = None
    empty = scene.replace(targets__1__spread={}, detector__exposure_s=0.1, sky__catalog="none")
    assert hash(empty) and ws.Renderer(empty, device="cpu").render([60], ["sat11"], ["A"]).counts.shape[0] == 1


def test_orbits_are_groups_of_many_targets(scene):
    swarm = {"kind": "walker", "n_satellite": 6, "n_plane": 2, "phasing": 1, "altitude_km": 700.0,
             "inclination_deg": 50.0, "prefix": "deb"}  # fmt: skip
    one = scene.replace(groups=[*scene.groups, {"name": "swarm", "orbits": swarm, "targets": [BALL]}])
    assert one.target_names[-6:] == ["deb11", "deb12", "deb13", "deb21", "deb22", "deb23"]
    orbits = ws.Walker(6, 2, 1, 700.0, 50.0, prefix="deb").states(one.scenario.epoch, [500.0])[0][0]
    for name, position in zip(one.target_names[-6:], orbits, strict=True):
        assert np.linalg.norm(one.position_m(name, [500.0])[0] - position) < TRACK_M
    truth = ws.Renderer(one.replace(sky__catalog="none"), device="cpu").render([60], ["sat11"], ["A"]).truth
    assert set(truth["class"][-6:]) == {"ball"}
    by_file = {"name": "station", "orbits": {"kind": "tle", "lines": list(ISS)}, "targets": [BALL]}
    dated = scene.replace(epoch_utc="2019-12-09T17:00:00", groups=[by_file])
    assert dated.target_names == ["norad25544"]


def test_class_of_a_target(scene):
    classed = scene.replace(targets__1__class="decoy", sky__catalog="none")
    frames = ws.Renderer(classed, device="cpu").render([60], ["sat11"], ["A"])
    assert list(dict.fromkeys(frames.truth["class"])) == ["center", "decoy", "cylinder", "cone"]
    names = [category["name"] for category in ws.labels.coco_categories(classed.scenario)]
    assert names == ["center", "decoy", "cylinder", "cone"]
    assert classed.to_dict()["groups"][0]["targets"][1]["class"] == "decoy"
    both = classed.replace(targets__2__class="decoy")
    assert [c["name"] for c in ws.labels.coco_categories(both)] == ["center", "decoy", "cone"]  # a scene will do


# Spread


SPREAD = {
    "shape.radius_m": {"uniform": [0.2, 0.4]},
    "temperature.start_k": {"normal": [350.0, 5.0]},
    "surface.reflectance": {"choice": [0.1, 0.9]},
}


def test_members_differ_as_their_distribution_says(scene, device):
    spread = scene.replace(targets__1__spread=SPREAD, targets__1__count=400, sky__catalog="none")
    members = [target.spec for target in spread.scenario.targets[1:401]]
    radii = np.array([spec.shape.radius_m for spec in members])
    kelvin = np.array([spec.temperature.start_k for spec in members])
    assert 0.2 < radii.min() < 0.21 and 0.39 < radii.max() < 0.4
    assert abs(radii.mean() - 0.3) < 5 * 0.2 / np.sqrt(12 * 400)
    assert abs(kelvin.mean() - 350.0) < 5 * 5.0 / np.sqrt(400) and abs(kelvin.std() - 5.0) < 5 * 5.0 / np.sqrt(800)
    assert {spec.surface.reflectance for spec in members} == {0.1, 0.9}
    assert abs(np.corrcoef(radii, kelvin)[0, 1]) < 5 / np.sqrt(400)
    truth = ws.Renderer(spread, device=device).render([0], ["sat11"], ["A"]).truth
    area = np.array([rows_of(truth, f"sphere{k:03d}")["projected_area_m2"][0] for k in (1, 77, 400)])
    np.testing.assert_allclose(area, np.pi * radii[[0, 76, 399]] ** 2, rtol=1e-6)


def test_a_member_is_the_same_in_any_crowd(scene):
    few, many = (scene.replace(targets__1__spread=SPREAD, targets__1__count=count) for count in (3, 30))
    assert [t.spec.shape for t in few.scenario.targets[1:4]] == [t.spec.shape for t in many.scenario.targets[1:4]]
    other = few.replace(seed=1)
    assert few.scenario.targets[1].spec.shape != other.scenario.targets[1].spec.shape
    noisy = few.replace(noise_seed=1)
    assert few.scenario.targets[1].spec.shape == noisy.scenario.targets[1].spec.shape
    spec = few.groups[0].targets[1]
    assert drawn_spec(spec, "main.sphere", 0, few.seed) == few.scenario.targets[1].spec


# By what access counts


def intervals(table):
    return [(row["sensor"], round(row["start_s"], 2), round(row["end_s"], 2)) for row in table]


@pytest.mark.ci
def test_access_counts_by_what_a_sensor_tracks(two):
    """Planes 1 and 2 follow the second launch, the others the first."""
    pointing = [{"track": "ball", "on": ["sat1?", "sat2?"]}, {"track": "center"}]
    split = two.replace(pointing=pointing)
    table, center, ball = split.access(), split.access("center"), split.access("ball")
    expected = [row for row in intervals(ball) if row[0][3] in "12"]
    expected += [row for row in intervals(center) if row[0][3] in "34"]
    assert sorted(intervals(table)) == sorted(expected)
    assert {(row["target"], row["sensor"][3] in "12") for row in table} == {("ball", True), ("center", False)}
    for wanted, same in (("center", center), ("late", ball), ("ball", ball)):
        assert intervals(split.replace(access_target=wanted).access()) == intervals(same)
    times = np.arange(0.0, 1610.0, 10.0)
    anything = split.replace(access_target="any")
    for sensor in ("sat11", "sat27", "sat47"):
        seen = [split.access_margins(times, target=name, sensors=[sensor]) for name in split.target_names]
        exists = [split.scenario.tracks.exist(k, times) for k in range(len(seen))]
        holds = [np.all([margin[0] >= 0 for margin in each.values()], axis=0) for each in seen]
        expected = np.any(np.array(holds) & np.array(exists), axis=0)
        np.testing.assert_array_equal(anything.scenario.has_access(sensor, times), expected)


def test_truth_tells_access_to_the_rows_own_target(two):
    frames = ws.Renderer(two, device="cpu").render(range(0, 162, 20), ["sat11", "sat27"], ["A"])
    for name in ("center", "sphere07", "ball"):
        rows = rows_of(frames.truth, name)
        for sensor in frames.sensors:
            own = rows[rows["sensor"] == sensor]
            index = two.target_names.index(name)
            margins = two.access_margins(own["time_s"], target=name, sensors=[sensor])
            holds = np.all([margin[0] >= 0 for margin in margins.values()], axis=0)
            expected = holds & two.scenario.tracks.exist(index, np.asarray(own["time_s"]))
            unclear = np.asarray(own["absent"]) & expected  # by light time
            np.testing.assert_array_equal(np.asarray(own["access"])[~unclear], expected[~unclear])


def test_a_scene_without_targets(scene, device):
    empty = scene.replace(groups=[], pointing=FIXED)
    frames = ws.Renderer(empty, device=device).render([0, 5], ["sat11"], keep_stars=True)
    assert frames.counts.shape == (2, 1, 3, 128, 128) and len(frames.truth) == 0 and len(frames.stars) > 0
    assert len(empty.access()) == 0
    with pytest.raises(ws.InputError, match=r"pointing.track: must be .*got 'main'"):
        scene.replace(groups=[])


FIXED = {"kind": "fixed", "ra_dec_deg": [10.0, 20.0]}
ORBIT = {"kind": "elements", "altitude_km": 500.0, "inclination_deg": 60.0}


def spread_over(field, low, high):
    return [{**BALL, "spread": {field: {"uniform": [low, high]}}}]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"start_s": 2000.0}, r"Scene: groups\[1\].start_s: must be below duration_s \(1614\), got 2000"),
        ({"start_s": 1614.0}, r"Scene: groups\[1\].start_s: must be below duration_s \(1614\), got 1614"),
        ({"start_s": -5.0}, r"Scene: groups\[1\].start_s: must be >= 0, got -5.0"),
        ({"exists_s": [900.0, 300.0]}, r"groups\[1\].exists_s: must be \[first, last\], the first before .* got \[900"),
        ({"exists_s": [100.0, 900.0]}, r"groups\[1\].exists_s\[0\]: must not begin before start_s \(180\), got 100"),
        ({"exists_s": [200.0, 1600.0]}, r"groups\[1\].exists_s\[1\]: must not be after .* end \(1580\), got 1600"),
        (
            {"trajectory": ORBIT, "start_s": 0.0, "exists_s": [2000.0, 3000.0]},
            r"Scene: groups\[1\].exists_s: must have a part within the scene, 0 to 1614 s",
        ),
        ({"trajectory": None}, r"Scene: groups\[1\]: trajectory, orbits: exactly one must be given"),
        (
            {"release": {"time_s": 1500.0}, "targets": [BALL, {**BALL, "name": "b", "count": 2}]},
            r"Scene: groups\[1\].release.time_s: must be",
        ),
        ({"targets": spread_over("shape.colour", 0, 1)}, r"groups\[1\].targets\[0\].spread.*shape.colour"),
        ({"targets": spread_over("name", 0, 1)}, r"groups\[1\].targets\[0\].spread: must name fields among"),
        (
            {"targets": spread_over("shape.radius_m", -1.0, 0.1)},
            r"groups\[1\].targets\[0\].spread.*shape.radius_m: must be > 0",
        ),
    ],
)  # fmt: skip
def test_bad_groups_are_one_line_with_the_place(scene, changes, message):
    late = {key: value for key, value in {**LATE, **changes}.items() if value is not None}
    with pytest.raises(ws.InputError, match=message) as caught:
        scene.replace(groups=[*scene.to_dict()["groups"], late]).scenario  # noqa: B018
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", ["nobody", "tracke"])
def test_access_target_is_there(scene, value):
    with pytest.raises(ws.InputError, match=rf"access_target: must be .* got '{value}'"):
        scene.replace(access_target=value).scenario  # noqa: B018


def test_a_camera_without_anything_to_track_looks_along_its_motion(two, device):
    """Before the launch of what it tracks, and on the host as in the kernel."""
    waiting = two.replace(pointing={"track": "ball"})
    frames = ws.Renderer(waiting, device=device).render([0, 10, 30, 60], ["sat11"], ["A"])
    assert frames.boresight_replaced[:, 0].tolist() == [True, True, False, False]
    axes = waiting.scenario.view_axes("sat11", frames.time_s)
    np.testing.assert_allclose(frames.axes_icrs[:, 0], axes, rtol=0, atol=1e-10)
    position_m, velocity_m_s = waiting.scenario.tracks.state("sat11", frames.time_s[:2])
    normal = np.cross(position_m, velocity_m_s)
    forward = np.cross(normal, position_m)
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    np.testing.assert_allclose(axes[:2, 2], forward, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_a_camera_keeps_its_target_through_the_exposure_in_which_it_ends(scene, device):
    still = {"start_k": 300.0, "end_k": 300.0}
    group = scene.to_dict()["groups"][0]
    group |= {"exists_s": [0.0, 300.0], "targets": [{**one, "temperature": still} for one in group["targets"]]}
    ending = scene.replace(
        groups=[group], sky__catalog="none", duration_s=320.0, frames__count=33,
        detector__exposure_s=2.0, detector__streaks=True, pointing=[{"track": "main"}],
    )  # fmt: skip
    endless = ending.replace(groups=[{**group, "exists_s": [0.0, 320.0]}])
    frames, whole = (
        ws.Renderer(one, device=device).render([29, 30, 31], "sat11", keep_signal=True) for one in (ending, endless)
    )
    absent = rows_of(frames.truth, ending.target_names[0])["absent"]
    assert absent.tolist() == [False, False, True]  # light that left before 300 s comes later
    np.testing.assert_array_equal(frames.signal_w_cm2.numpy()[:2], whole.signal_w_cm2.numpy()[:2])
    assert frames.boresight_replaced.ravel().tolist() == [False, False, True]
    boresight = frames.instrument.commanded_axes(0, np.array([299.0, 301.0, 301.0]), [-0.5, 1.5, 0.5]).axes[:, 2]
    assert boresight[0] @ boresight[1] > 0.99 > boresight[0] @ boresight[2]


def test_access_begins_with_the_first_light_of_a_group(two):
    """It left at the group's start; satellites that it has not reached yet see nothing, as truth has it."""
    scenario, start_s = two.scenario, 180.0
    table = scenario.access("ball")
    began = table[np.asarray(table["start_s"]) < start_s + 0.1]
    assert len(began) > 0
    from_m = scenario.position_m("ball", [start_s])[0]
    for row in began:

        def early_s(time_s, sensor=str(row["sensor"])):
            away_m = np.linalg.norm(scenario.position_m(sensor, [time_s])[0] - from_m)
            return time_s - start_s - away_m / 299_792_458.0

        arrives_s = brentq(early_s, start_s, start_s + 1.0, xtol=1e-12)
        assert row["start_s"] == pytest.approx(arrives_s, abs=1e-9)  # of times of 180 s: 3e-14


def test_no_access_lasts_as_long_as_light_takes():
    """Where targets that have not come yet stood in their first position, cameras had access for some milliseconds."""
    table = ws.Scene.load("two_cameras").access()
    assert np.asarray(table["duration_s"]).min() > 1.0
