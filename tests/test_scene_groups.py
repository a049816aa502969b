"""Groups of targets: releases at a chosen time, several groups, and how files of a scene are named."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import warpsim as ws
from warpsim.orbit.earth import pole_of_date
from warpsim.scene.motion import motion_of
from warpsim.scene.scene_files import named_files, with_absolute_paths

MU, RADIUS, J2 = 3.986004418e14, 6378137.0, 1.0826266835e-3
TRACK_M = 1e-3  # what interpolation between nodes may add
FREE_FLIGHT_M = 1e-5  # DOP853's own error

SECOND = {
    "name": "second",
    "trajectory": {
        "kind": "ballistic_arc",
        "start_lon_lat_deg": [100.0, 50.0],
        "end_lon_lat_deg": [-150.0, 40.0],
        "duration_s": 1700.0,
        "endpoint_altitude_km": 100.0,
    },
    "targets": [
        {"name": "bus", "shape": {"kind": "sphere", "radius_m": 1.0}, "surface": {"reflectance": 0.5},
         "temperature": {"start_k": 300.0}},
        {"name": "ball", "count": 3, "shape": {"kind": "sphere", "radius_m": 0.3}, "surface": {"reflectance": 0.5},
         "temperature": {"start_k": 310.0}},
    ],
}  # fmt: skip


def with_second(scene, **changes):
    """The scene with a second group."""
    return scene.replace(groups=[*scene.to_dict()["groups"], {**SECOND, **changes}])


def fly(r, v, duration_s, pole):
    """Two-body and J2 by DOP853, with the acceleration written out in vectors."""

    def force(t, y):
        p, d = y[:3], np.linalg.norm(y[:3])
        w = p @ pole
        k = 1.5 * J2 * MU * RADIUS**2 / d**5
        return np.concatenate([y[3:], -MU * p / d**3 + k * ((5 * w * w / d**2 - 1) * p - 2 * w * pole)])

    run = solve_ivp(force, (0, duration_s), np.concatenate([r, v]), "DOP853", rtol=1e-13, atol=1e-8)
    return run.y[:3, -1]


def motion_of_scene(scene):
    """All that moves in a scene, and the number of satellites, which come first."""
    given = scene.constellation, scene.groups, scene.scenario.epoch, scene.duration_s, scene.seed
    return motion_of(*given), len(scene.scenario.satellite_names)


def test_targets_go_with_the_main_one_until_their_release_and_then_fly_freely(scene):
    late = scene.replace(targets__2__release={"time_s": 700.0, "speed_m_s": [1.0, 3.0]})
    names = late.target_names
    cylinders = [name for name in names if name.startswith("cylinder")]
    assert len(cylinders) == 10
    before, at = np.array([0.0, 350.0, 699.999]), np.array([700.0])
    main_r, main_v = (x[0, 0] for x in late.trajectory.states(late.scenario.epoch, at))
    motion, n_satellite = motion_of_scene(late)
    for name in cylinders:
        assert np.array_equal(late.position_m(name, before), late.position_m("center", before))
        row = n_satellite + names.index(name)
        start_r, start_v = (x[0, row] for x in motion.states(at))
        assert np.linalg.norm(start_r - main_r) < FREE_FLIGHT_M
        assert 1.0 - 1e-9 < np.linalg.norm(start_v - main_v) < 3.0 + 1e-9
        assert np.linalg.norm(late.position_m(name, at)[0] - main_r) < TRACK_M
        flown = fly(start_r, start_v, 800.0, pole_of_date(late.epoch))
        assert np.linalg.norm(motion.states(np.array([1500.0]))[0][0, row] - flown) < FREE_FLIGHT_M
        assert np.linalg.norm(late.position_m(name, [1500.0])[0] - flown) < TRACK_M
    # The others go as before.
    for name in ("center", "sphere01", "cone09"):
        time_s = np.linspace(0, 1614, 50)
        assert np.abs(late.position_m(name, time_s) - scene.position_m(name, time_s)).max() < TRACK_M
    assert late.scenario.tracks.error_m < 1e-3


def test_releases_are_within_the_flight(scene):
    with pytest.raises(ws.InputError, match=r"release.time_s: must be >= 0, as the flight starts then, got -5"):
        scene.replace(release__time_s=-5.0)
    with pytest.raises(ws.InputError, match=r"release.time_s: must be within duration_s \(1614\), got 2000"):
        scene.replace(release__time_s=2000.0)


def test_a_group_may_be_on_its_way_already(scene):
    """Released 1000 s before the epoch at 2 to 5 m/s: kilometres away by then, along free flights."""
    orbit = {"kind": "elements", "altitude_km": 500.0, "inclination_deg": 66.0, "gravity": "two_body"}
    early = scene.replace(trajectory=orbit, release__time_s=-1000.0)
    start = ws.KeplerOrbit(66.0, altitude_km=500.0, gravity="two_body").states(early.epoch, [-1000.0])
    motion, _ = motion_of_scene(early)
    assert np.linalg.norm(motion.states(np.array([-1000.0]))[0][0, -29:] - start[0][0], axis=1).max() < FREE_FLIGHT_M
    away_m = np.linalg.norm(early.position_m("sphere01", [0.0]) - early.position_m("center", [0.0]))
    assert 500.0 < away_m < 20e3
    truth = ws.Renderer(early.replace(sky__catalog="none")).render([0], sensors=["sat11"], bands=["A"]).truth
    assert not truth["not_deployed"].any()


def test_several_groups(scene, tmp_path):
    both = with_second(scene)
    assert both.target_names == [*scene.target_names, "bus", "ball01", "ball02", "ball03"]
    assert [target.spec.name for target in both.scenario.targets[-4:]] == ["bus", "ball", "ball", "ball"]
    arc = both.groups[1].trajectory
    time_s = np.array([0.0, 800.0, 1614.0])
    assert np.abs(both.position_m("bus", time_s) - arc.states(both.scenario.epoch, time_s)[0][:, 0]).max() < TRACK_M
    assert np.abs(both.position_m("sphere07", time_s) - scene.position_m("sphere07", time_s)).max() < TRACK_M
    # Each group draws numbers of its own.
    leaving = [
        both.scenario.tracks.state(name, [0.0])[1][0] - both.scenario.tracks.state(main, [0.0])[1][0]
        for name, main in (("sphere01", "center"), ("ball01", "bus"))
    ]
    assert np.linalg.norm(leaving[0] - leaving[1]) > 0.1
    both.save(tmp_path / "both.toml")
    assert ws.Scene.load(tmp_path / "both.toml") == both


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"targets": []}, r"groups\[1\].targets: must hold at least the main target"),
        ({"targets": [{**SECOND["targets"][0], "count": 2}]}, r"groups\[1\].targets\[0\].count: must be 1"),
        ({"name": "a b"}, r"groups\[1\].name: must be letters"),
        (
            {"trajectory": {**SECOND["trajectory"], "duration_s": 900.0}},
            r"^groups\[1\].trajectory.duration_s: .*below",
        ),
        ({"targets": [{**SECOND["targets"][0], "name": "center"}]}, "names must be unique .* got center twice"),
        ({"name": "main"}, r"groups\[1\].name: must be no other name of the scene, 'main' .*, got 'main'"),
        ({"name": "cone03"}, r"groups\[1\].name: must be no other name of the scene, .* got 'cone03'"),
        ({"release": {"time_s": 1700.0}}, r"groups\[1\].release.time_s: must be within duration_s"),
    ],
)
def test_errors_of_groups_name_the_place(scene, changes, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        with_second(scene, **changes).scenario  # noqa: B018
    assert "\n" not in str(caught.value)


def test_paths_of_a_scene_file_are_taken_from_its_folder(tmp_path):
    data = {
        "constellation": {"kind": "mixed", "parts": [{"file": "a.tle"}, {"files": ["b.oem", "/c.e"]}]},
        "sky": {"catalog": "stars.csv"},
        "pointing": {"file": "scan.csv"},
    }
    found = with_absolute_paths(data, tmp_path)
    assert found["constellation"]["parts"][0]["file"] == str(tmp_path / "a.tle")
    assert found["constellation"]["parts"][1]["files"] == [str(tmp_path / "b.oem"), "/c.e"]
    assert found["sky"]["catalog"] == str(tmp_path / "stars.csv")
    assert with_absolute_paths({"sky": {"catalog": "union"}}, tmp_path)["sky"]["catalog"] == "union"
    assert named_files(found) == [str(tmp_path / name) for name in ("a.tle", "b.oem")] + [
        "/c.e", str(tmp_path / "scan.csv")
    ]  # fmt: skip


def test_targets_that_are_not_deployed_go_with_the_main_one_and_are_dark(scene, device):
    """Frames at 690, 700 and 710 s; the light of the frame at 700 s left before the release."""
    late = scene.replace(targets__1__release={"time_s": 700.0}, sky__catalog="none")
    shown = ws.Renderer(late, device=device).render([69, 70, 71], sensors=["sat11"], bands=["A"], keep_signal=True)
    truth = shown.truth
    spheres = np.char.startswith(np.asarray(truth["target"]), "sphere")
    undeployed = np.asarray(truth["not_deployed"])
    assert np.array_equal(undeployed, spheres & (np.asarray(truth["frame"]) < 71))
    assert (truth["irradiance_w_cm2"][undeployed] == 0).all()
    assert (truth["irradiance_w_cm2"][~undeployed] > 0).all()
    for frame in (69, 70):
        rows = truth[np.asarray(truth["frame"]) == frame]
        main = rows[rows["target"] == "center"][0]
        for row in rows[np.char.startswith(np.asarray(rows["target"]), "sphere")]:
            assert (row["x_px"], row["y_px"], row["range_km"]) == (main["x_px"], main["y_px"], main["range_km"])
    # The image holds the light of the others only.
    early = ws.Renderer(scene.replace(sky__catalog="none"), device=device)
    before = early.render([69], sensors=["sat11"], bands=["A"], keep_signal=True)
    rows = before.truth
    gone = rows["irradiance_w_cm2"][np.char.startswith(np.asarray(rows["target"]), "sphere")].sum()
    left_out = [float(frames.truth["left_out_w_cm2"][:30].sum()) for frames in (before, shown)]
    difference = float(before.signal_w_cm2.numpy().sum() - shown.signal_w_cm2.numpy()[0].sum())
    assert difference == pytest.approx(gone - left_out[0] + left_out[1], rel=1e-5, abs=0)


def test_cameras_follow_a_group_that_is_not_deployed(scene):
    late = scene.replace(release__time_s=700.0, pointing={"track": "group"}, sky__catalog="none")
    shown = ws.Renderer(late).render([40, 90], sensors=["sat11"], bands=["A"])
    assert np.abs(shown.axes_icrs[:, 0] - late.scenario.view_axes("sat11", shown.time_s)).max() < 1e-12
    alone = ws.Renderer(late.replace(pointing={"track": "main"})).render([40], sensors=["sat11"], bands=["A"])
    assert np.abs(alone.axes_icrs[0] - shown.axes_icrs[0]).max() < 1e-12


def test_cameras_follow_a_group_by_name(scene):
    both = with_second(scene).replace(pointing={"track": "second"}, sky__catalog="none")
    shown = ws.Renderer(both).render([60], sensors=["sat11"], bands=["A"])
    assert np.abs(shown.axes_icrs[:, 0] - both.scenario.view_axes("sat11", shown.time_s)).max() < 1e-12
    rows = shown.truth
    centre = np.mean([rows["x_px"][-4:], rows["y_px"][-4:]], axis=1)
    assert np.abs(centre - 63.5).max() < 1e-3  # the mean of directions is that of places while they are close
    with pytest.raises(ws.InputError, match=r"pointing.track: must be 'main', 'group', 'second' or a target's name"):
        both.replace(pointing={"track": "third"}).scenario  # noqa: B018
