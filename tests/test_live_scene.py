"""The page's scene in three dimensions: bodies, lines and fields of view are where the scenario has them."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import warpsim as ws
from warpsim.live.globe import GlobeScene
from warpsim.live.group_view import EXTENT, Groups, GroupView
from warpsim.plot.group_figure import local_frame

TIME_S = 600.0


class Recorded:
    """A scene that keeps what is added to it, by name."""

    def __init__(self):
        self.nodes = {}

    def __getattr__(self, name):
        assert name.startswith("add_")

        def add(path, *args, **kwargs):
            first = args[0] if args else None
            node = SimpleNamespace(kind=name, args=args, points=first, remove=lambda: self.nodes.pop(path), **kwargs)
            self.nodes[path] = node
            return node

        return add


def rotation_of(node):
    return Rotation.from_quat(node.wxyz, scalar_first=True)


@pytest.fixture(scope="module")
def globe(scene):
    recorded = Recorded()
    GlobeScene(recorded, scene.scenario, ["sat11"]).show(TIME_S)
    return recorded.nodes


def points(nodes, name):
    return np.asarray(nodes[f"/earth/{name}"].args[0], np.float64)


def test_satellites_and_targets_stand_where_they_are(globe, scene):
    scenario, at = scene.scenario, np.array([TIME_S])
    seen = [name for name in scenario.sensor_names if scenario.has_access(name, at)[0]]
    wanted = [scenario.position_m(name, at)[0] / 1e6 for name in seen]
    np.testing.assert_allclose(points(globe, "observers"), wanted, atol=1e-5)
    assert len(points(globe, "satellites")) == 28 - len(seen)
    np.testing.assert_allclose(points(globe, "kind0"), scenario.position_m("center", at) / 1e6, atol=1e-6)
    names = {path.removeprefix("/earth/name_") for path in globe if path.startswith("/earth/name_")}
    assert names == {*seen, "center (main)"}
    sights = points(globe, "sights")
    np.testing.assert_allclose(sights[:, 0], wanted, atol=1e-5)
    main = np.tile(scenario.position_m("center", at) / 1e6, (len(seen), 1))
    np.testing.assert_allclose(sights[:, 1], main, atol=1e-5)


def test_what_moves_is_moved_and_not_added_again(scene):
    """At instants with the same satellites in access."""
    recorded = Recorded()
    globe = GlobeScene(recorded, scene.scenario, ["sat11"])
    globe.show(TIME_S)
    before = dict(recorded.nodes)
    globe.show(TIME_S + 10.0)
    alone = Recorded()
    GlobeScene(alone, scene.scenario, ["sat11"]).show(TIME_S + 10.0)
    moved = 0
    for path, node in alone.nodes.items():
        assert recorded.nodes[path] is before[path], path
        if node.points is not None and not isinstance(node.points, str):
            np.testing.assert_array_equal(before[path].points, node.points)
            moved += not np.array_equal(before[path].points, before[path].args[0])
    assert moved == 8  # satellites, those with access, four kinds of targets, lines of sight, edges of the field


def test_the_field_of_view_is_the_cameras(globe, scene):
    scenario, at = scene.scenario, np.array([TIME_S])
    fields = points(globe, "fields")
    edges = fields[:4, 1] - fields[:4, 0]
    rays = edges / np.linalg.norm(edges, axis=1)[:, None]
    boresight = scenario.view_axes("sat11", at)[0, 2]
    np.testing.assert_allclose(np.degrees(np.arccos(rays @ boresight)), np.sqrt(2) / 2, rtol=2e-3)
    np.testing.assert_allclose(np.degrees(np.arccos(rays[0] @ rays[1])), 1.0, rtol=2e-3)
    np.testing.assert_allclose(fields[:4, 0], np.tile(scenario.position_m("sat11", at) / 1e6, (4, 1)), atol=1e-5)


def test_the_earth_turns_and_the_sun_stands_at_noon(globe, scene):
    from astropy.coordinates import EarthLocation, get_sun
    from astropy.time import TimeDelta

    time = scene.epoch + TimeDelta(TIME_S, format="sec")
    place = EarthLocation.from_geodetic(20.0, 50.0)
    gcrs = place.get_gcrs(time).cartesian.xyz.to_value("m")
    itrs = place.get_itrs(time).cartesian.xyz.to_value("m")
    turned = rotation_of(globe["/earth/globe"]).apply(itrs)
    assert np.linalg.norm(turned - gcrs) < 100.0  # metres: other polar motion
    sun = get_sun(time).cartesian.xyz.value
    towards = np.asarray(globe["/earth/sun"].position)
    assert np.degrees(np.arccos(towards @ sun / np.linalg.norm(towards) / np.linalg.norm(sun))) < 0.02


def shown_group(scenario, group):
    """Nodes of a group as it is shown; its bodies stand and turn as in the scenario, about the first of them."""
    at, recorded = np.array([TIME_S]), Recorded()
    GroupView(recorded, scenario, group).show(TIME_S)
    members = [number for number, target in enumerate(scenario.targets) if target.group == group]
    names = [scenario.target_names[number] for number in members]
    position_m, velocity_m_s = scenario.tracks.target_state(members[0], at)
    radial, along, cross = local_frame(position_m[0], velocity_m_s[0])
    local = np.stack([along, cross, radial])
    offsets = np.array([local @ (scenario.position_m(name, at)[0] - position_m[0]) for name in names])
    bodies = [recorded.nodes[f"/group{group}/body{number}"] for number in members]
    assert len([path for path in recorded.nodes if re.fullmatch(r".*/body\d+", path)]) == len(members)
    scale = EXTENT / np.abs(offsets).max()
    np.testing.assert_allclose([body.position for body in bodies], scale * offsets, atol=1e-6)
    for name, body in zip(names, bodies, strict=True):
        axis = local @ scenario.body_axis(name, at)[0]
        np.testing.assert_allclose(rotation_of(body).apply([0, 0, 1]), axis, atol=1e-9)
        assert body.visible
    return recorded.nodes, names


def test_bodies_stand_and_turn_as_in_the_scenario(scene):
    assert len(shown_group(scene.scenario, 0)[1]) == 30


def test_absent_bodies_are_hidden(scene):
    late = scene.replace(groups__0__start_s=300.0, frames__count=1)
    recorded = Recorded()
    view = GroupView(recorded, late.scenario)
    for time_s, there in ((100.0, False), (400.0, True)):
        view.show(time_s)
        assert all(
            node.visible is there for path, node in recorded.nodes.items() if path.count("/") == 2 and "body" in path
        )


@pytest.fixture(scope="module")
def three_groups():
    return ws.Scene.load("two_cameras").scenario


@pytest.mark.parametrize(("group", "middle"), [(0, "center"), (1, "bus"), (2, "RB-A")])
def test_every_group_stands_about_its_first_target(three_groups, group, middle):
    nodes, names = shown_group(three_groups, group)
    assert names[0] == middle
    labels = {node.args[0] for path, node in nodes.items() if path.endswith("/name")}
    assert labels == {f"{middle} (main)" if group < 2 else middle, *names[1:]}
    words = nodes[f"/group{group}/scale"].text
    assert words.startswith(f"about {middle}; axes ")
    assert f" {'km' if group == 2 else 'm'}: along-track" in words


def test_a_group_that_is_absent_says_so(three_groups):
    recorded = Recorded()
    view = GroupView(recorded, three_groups, 1)
    view.show(100.0)
    assert recorded.nodes["/group1/scale"].text == "no target of this group is there now"
    assert not any(node.visible for path, node in recorded.nodes.items() if re.fullmatch(r".*/body\d+", path))


def test_the_first_that_is_there_stands_for_an_absent_main(scene):
    """Two targets in orbits of their own, of which the first is absent at first."""
    recorded = Recorded()
    view = GroupView(recorded, scene.scenario)
    exists = scene.scenario.tracks.exist
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            type(scene.scenario.tracks), "exist", lambda self, i, t: exists(i, t) if i != 0 else np.array(False)
        )
        view.show(TIME_S)
    assert not recorded.nodes["/group0/body0"].visible
    np.testing.assert_allclose(recorded.nodes["/group0/body1"].position, 0.0, atol=1e-9)


def test_large_groups_are_drawn_in_part(scene):
    many = scene.replace(targets__1__count=400)
    recorded = Recorded()
    view = GroupView(recorded, many.scenario)
    view.show(TIME_S)
    assert len([path for path in recorded.nodes if re.fullmatch(r".*/body\d+", path)]) == 300
    assert recorded.nodes["/group0/scale"].text.endswith("; 300 of 420 targets")
    assert [node.args[0] for path, node in recorded.nodes.items() if path.endswith("/name")] == ["center (main)"]


def test_one_group_is_visible_at_a_time(three_groups):
    recorded = Recorded()
    groups = Groups(recorded, three_groups)
    assert not recorded.nodes
    for chosen, visible in ((1, {1}), (2, {2}), (None, set()), (1, {1})):
        groups.choose(chosen)
        assert {
            n for n in range(3) if f"/group{n}" in recorded.nodes and recorded.nodes[f"/group{n}"].visible
        } == visible
    assert "/group0" not in recorded.nodes
