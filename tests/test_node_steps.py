"""Node steps of bodies side by side: uneven ones have shorter steps of their own, and change nothing for the others."""

from __future__ import annotations

import numpy as np
import pytest
from element_sets import low_orbit, uneven

import warpsim as ws
from warpsim.orbit import node_steps
from warpsim.orbit.node_steps import SHARED_STEP_S, make_tracks

EPOCH = "2025-03-20T12:25:00"
TRACK_M = 1e-3  # what tracks are asked for
OFF_MIDDLE = 1.1  # the largest error of an interval over that in its middle
DURATION_S = 600.0

RATE_RAD_S = {"low": 1.1e-3, "high": 6e-4, "swinging": 8e-3, "fast": 6e-2}
"""Of circles of 7,000 km; the last two move faster than any orbit, and need steps of some 2 and 0.2 s."""


def states(time_s, bodies):
    rate = np.array(list(RATE_RAD_S.values()))[bodies]
    angle = rate * time_s[:, None]
    position = 7e6 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    return position, 7e6 * rate[:, None] * np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=-1)


def tracks_of(numbers, asked=None):
    """Tracks of some of the bodies; `asked` collects how many states they were asked for."""

    def of_some(time_s, bodies):
        if asked is not None:
            asked.append(len(time_s) * len(bodies))
        return states(time_s, np.array(numbers)[bodies])

    names = [list(RATE_RAD_S)[number] for number in numbers]
    return make_tracks(names, lambda t: of_some(t, np.arange(len(numbers))), DURATION_S, some_states=of_some)


def same(one, other):
    """Whether two tracks are the same to the last bit."""
    return (one.start_s, one.step_s) == (other.start_s, other.step_s) and all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("position_m", "velocity_m_s")
    )


def test_uneven_bodies_have_their_own_steps_and_the_others_theirs():
    together = tracks_of([0, 1, 2, 3])
    assert together[0].step_s == together[1].step_s > SHARED_STEP_S > 4 * together[2].step_s > 16 * together[3].step_s
    for own, number in zip(together, range(4), strict=True):
        assert own.error_m < TRACK_M
        time_s = np.linspace(0.0, DURATION_S, 7001)
        missed = np.linalg.norm(own.position_at_m(time_s) - states(time_s, [number])[0][:, 0], axis=1).max()
        assert missed < OFF_MIDDLE * own.error_m + 1e-8
    # Each is what it is without the other classes.
    for one, other in zip(together, [*tracks_of([0, 1]), *tracks_of([2]), *tracks_of([3])], strict=True):
        assert same(one, other)


def test_few_uneven_bodies_cost_little():
    even, uneven = [], []
    n = 200
    tracks_of([0] * n, even)
    tracks_of([*[0] * n, 2, 3], uneven)
    assert sum(uneven) < 1.5 * sum(even)  # with one step it would be forty times as much


def test_a_class_in_pieces_is_the_same(monkeypatch):
    whole = tracks_of([0, 1] * 5)
    monkeypatch.setattr(node_steps, "PAIRS_PER_PIECE", 300)
    for one, other in zip(whole, tracks_of([0, 1] * 5), strict=True):
        assert same(one, other)


def test_the_worst_of_many_decide_their_step(monkeypatch):
    """Only those of many bodies that are near the worst are tried again; the step is that of trials of all."""
    whole = tracks_of([1] * 30 + [0])
    monkeypatch.setattr(node_steps, "_MANY", 5)
    asked = []
    for one, other in zip(whole, tracks_of([1] * 30 + [0], asked), strict=True):
        assert same(one, other)
    assert sorted(asked)[0] < 200  # one body alone


PARTS = {
    "walker": {"kind": "walker", "n_satellite": 6, "n_plane": 2, "phasing": 1, "altitude_km": 1400.0,
               "inclination_deg": 60.0, "prefix": "w"},
    "pattern": {"kind": "seed_pattern", "n_plane": 2, "n_per_plane": 2, "prefix": "p",
                "seed": {"kind": "elements", "altitude_km": 900.0, "inclination_deg": 60.0}},
    "listed": {"kind": "listed", "satellites": [
        {"name": f"l{k}", "orbit": {"kind": "elements", "altitude_km": 700.0 + k, "inclination_deg": 30.0}}
        for k in range(3)
    ]},
}  # fmt: skip


def scene_of(constellation, **changes):
    return ws.Scene.load("stss").replace(
        epoch_utc=EPOCH, duration_s=DURATION_S, frames={"count": 2, "interval_s": 60.0}, constellation=constellation,
        sky={"catalog": "none"}, access_rules={"max_range_km": 8000.0}, **changes,
    )  # fmt: skip


def test_some_bodies_of_a_scene_move_as_all_do():
    """Of every kind of constellation and of released targets: what a class is sampled from is the motion of its own."""
    from warpsim.scene.motion import motion_of

    rng = np.random.default_rng(3)
    sets = {"kind": "tle", "lines": [line for number in range(1, 5) for line in low_orbit(number, rng)]}
    scene = scene_of({"kind": "mixed", "parts": [*PARTS.values(), sets]})
    scenario = scene.scenario
    motion = motion_of(scene.constellation, scene.groups, scenario.epoch, DURATION_S, scene.seed)
    time_s = np.linspace(-10.0, DURATION_S, 40)
    whole = motion.states(time_s)
    n_body = whole[0].shape[1]
    assert n_body == 6 + 4 + 3 + 4 + len(scenario.target_names)
    for bodies in (np.arange(0, n_body, 3), np.array([12, 14]), np.array([18]), np.array([n_body - 1])):
        for some, every in zip(motion.states(time_s, bodies), whole, strict=True):
            assert np.abs(some - every[:, bodies]).max() < 1e-6


@pytest.mark.ci
def test_a_catalog_with_an_uneven_set():
    """Frames, truth and access of the even satellites are those of the catalog without the other, to the last bit."""
    rng = np.random.default_rng(3)
    even = [line for number in range(1, 9) for line in low_orbit(number, rng)]
    plain, mixed = (scene_of({"kind": "tle", "lines": lines}) for lines in (even, [*even, *uneven(21)]))
    tracks = mixed.scenario.tracks
    steps = {track.name: track.step_s for track in tracks.satellites}
    assert steps["SAT_21"] < SHARED_STEP_S <= steps["SAT_1"] == tracks.longest_step_s == plain.scenario.tracks.step_s
    assert tracks.step_s == min(steps.values()) and f"nodes every {tracks.step_s:g} to" in repr(tracks)
    names = plain.sensor_names
    for name in names:
        assert same(tracks.of(name), plain.scenario.tracks.of(name))
    some, other = (ws.Renderer(scene, "cpu").render([0, 1], sensors=names[:3]) for scene in (plain, mixed))
    assert np.array_equal(some.counts.numpy(), other.counts.numpy())
    assert np.array_equal(some.truth["x_px"], other.truth["x_px"])
    assert np.array_equal(some.truth["range_km"], other.truth["range_km"])
    first, second = (scene.scenario.access(sensors=names) for scene in (plain, mixed))
    assert len(first) and all(np.array_equal(first[name], second[name]) for name in first.colnames)
    # The uneven one is seen as it moves: by the propagator, between the nodes.
    time_s = np.linspace(0.0, DURATION_S, 3001)
    exact_m = ws.TleSatellites(lines=uneven(21)).states(mixed.scenario.epoch, time_s)[0][:, 0]
    missed = np.linalg.norm(mixed.position_m("SAT_21", time_s) - exact_m, axis=1).max()
    assert missed < OFF_MIDDLE * tracks.of("SAT_21").error_m + 1e-6
    frames = ws.Renderer(mixed, "cpu").render([1], sensors=["SAT_21"])
    seen_m = np.array([frames.truth[f"sensor_{axis}_m"][0] for axis in "xyz"])
    assert np.abs(seen_m - mixed.position_m("SAT_21", np.array([60.0]))[0]).max() < 1e-6
