"""Satellites and asteroids that cross the fields of a data set's sensors, and are no targets."""

import json
import re

import numpy as np
import pytest

import warpsim as ws
from warpsim.dataset.layout import draw_sequence, recipe_report

EARTH_GM_M3_S2, EARTH_RADIUS_M = 3.986004418e14, 6.378137e6
CROSSINGS = {
    "satellite": {"range_km": [300.0, 3000.0]},
    "asteroid": {"range_km": [2e5, 5e5], "speed_km_s": [5.0, 20.0], "probability": 0.5},
}


@pytest.fixture(scope="module")
def scene():
    warm = {"temperature": ws.Temperature(start_k=290.0), "surface": ws.Graybody(emissivity=0.85)}
    orbit, far = ws.KeplerOrbit(altitude_km=700.0, inclination_deg=98.0), {"velocity_m_s": [0.0, 1e4, 0.0]}
    body = ws.TargetSpec(name="passer", class_="satellite", shape=ws.Plate(width_m=2.0, length_m=5.0), **warm)
    rock = ws.TargetSpec(name="rock", class_="asteroid", shape=ws.Sphere(radius_m=20.0), **warm)
    groups = [
        ws.TargetGroup(name="satellite", trajectory=orbit, targets=[body]),
        ws.TargetGroup(name="asteroid", trajectory=ws.StateVector(position_m=[4e8, 0.0, 0.0], **far), targets=[rock]),
    ]
    plain = ws.Scene.load("stss")
    return plain.replace(groups=[*plain.groups, *groups])


def recipe(scene, **changes):
    given = {"n_sequence": 6, "n_frame": 4, "interval_s": 0.2, "n_sensor": 2, "bands": "A", "crossings": CROSSINGS}
    return ws.Recipe(scene, **(given | changes))


@pytest.mark.ci
def test_groups_are_in_the_field_of_a_sensor_at_a_frame(scene):
    made, renderer, n_rock = recipe(scene), ws.Renderer(scene, "cpu"), 0
    for number in range(made.n_sequence):
        sequence = draw_sequence(made, number)
        truth = renderer.with_scene(sequence.scene).render(range(4), sequence.sensors, ["A"]).truth
        for name, crossing in CROSSINGS.items():
            rows = truth[truth["class"] == name]
            assert len(rows) == 4 * 2
            if rows["absent"].all():
                assert name == "asteroid" and not rows["irradiance_w_cm2"].any()
                continue
            n_rock += name == "asteroid"
            inside = rows[rows["in_fov"] & ~rows["occulted"] & (rows["irradiance_w_cm2"] > 0)]
            low_km, high_km = crossing["range_km"]
            assert np.any((inside["range_km"] > 0.99 * low_km) & (inside["range_km"] < 1.01 * high_km))
        assert truth[truth["target"] == "center"]["access"].all()  # what cameras follow is what it was
    assert 0 < n_rock < made.n_sequence


def test_paths_are_circular_orbits_or_have_the_speed_that_is_asked_for(scene):
    made = recipe(scene)
    drawn = [draw_sequence(made, number).scene for number in range(6)]
    for of_sequence in drawn:
        _, satellite, asteroid = (group.trajectory for group in of_sequence.groups)
        position_m, velocity_m_s = np.array(satellite.position_m), np.array(satellite.velocity_m_s)
        radius_m = np.linalg.norm(position_m)
        assert radius_m > EARTH_RADIUS_M + 150e3
        assert velocity_m_s @ velocity_m_s == pytest.approx(EARTH_GM_M3_S2 / radius_m, rel=1e-12)
        assert abs(velocity_m_s @ position_m) < 1e-9 * radius_m * np.linalg.norm(velocity_m_s)
        if of_sequence.groups[2].exists_s is None:
            assert 5e3 <= np.linalg.norm(asteroid.velocity_m_s) <= 20e3
    assert len({of_sequence.groups[1].trajectory.position_m for of_sequence in drawn}) == 6


def test_a_crossing_depends_on_seed_and_number_alone(scene):
    one = recipe(scene)
    other = recipe(scene, n_sequence=60, format="zarr", crossings={"satellite": CROSSINGS["satellite"]})
    assert ws.Recipe.from_dict(json.loads(json.dumps(one.to_dict()))) == one
    for number in range(3):
        assert draw_sequence(one, number).scene.groups[1] == draw_sequence(other, number).scene.groups[1]
    assert draw_sequence(one, 0).scene.groups[1] != draw_sequence(recipe(scene, seed=1), 0).scene.groups[1]
    assert 'crossing: satellite, {"range_km": [300.0, 3000.0]' in recipe_report(one)


@pytest.mark.parametrize(
    ("crossings", "message"),
    [
        ({"comet": {"range_km": [1, 2]}}, "crossings: must name a group of the scene (main, satellite, asteroid), got"),
        ({"satellite": {"range_km": [2, 1]}}, "range_km: must be [lowest, highest], got [2.0, 1.0]"),
        ({"satellite": {"range": [1, 2]}}, "crossings.satellite.range: is not a known field (did you mean range_km?)"),
        ({"satellite": {"range_km": [1, 2], "probability": 2}}, "probability: must be in [0, 1], got 2"),
    ],
)
def test_bad_crossings_are_told_in_one_line(scene, crossings, message):
    with pytest.raises(ws.InputError, match=re.escape(message)) as caught:
        recipe(scene, crossings=crossings)
    assert str(caught.value).startswith("Recipe: crossings") and "\n" not in str(caught.value)


def test_groups_must_be_there_all_the_time(scene):
    late = scene.replace(groups__1__start_s=100.0)
    with pytest.raises(ws.InputError, match=r"crossings\.satellite: must have a trajectory, which is replaced"):
        recipe(late)


def test_ranges_at_which_nothing_can_be_are_told(scene):
    """Of cameras that look at the ground all that is farther than the ground."""
    down = scene.replace(pointing={"kind": "fixed", "azimuth_elevation_deg": [0.0, -90.0]})
    with pytest.raises(ws.InputError, match=r"sequence 0: crossings\.satellite: no path in 200 draws that is in sight"):
        draw_sequence(recipe(down, every_frame=True, crossings={"satellite": {"range_km": [2000, 3000]}}), 0)
