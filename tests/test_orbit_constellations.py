"""Constellations: Walker patterns, lists, copies of an orbit, mixtures; released groups."""

from __future__ import annotations

import math
import zlib

import numpy as np
import pytest
from astropy import units as u
from element_sets import iss
from pydantic import TypeAdapter

from warpsim.config.model import input_error
from warpsim.errors import InputError
from warpsim.instant import utc_time
from warpsim.orbit.arc import BallisticArc
from warpsim.orbit.constellations import Constellation, ListedSatellites, MixedConstellation, SeedPattern
from warpsim.orbit.elements import KeplerOrbit, StateVector, state_to_elements
from warpsim.orbit.gravity import propagate
from warpsim.orbit.tle import TleOrbit, TleSatellites
from warpsim.orbit.walker import Walker
from warpsim.scene.motion import release_velocities

MU = 3.986004418e14
EPOCH = utc_time("2025-06-01T00:00:00")
ISS = iss("25152.00000000")

ANGLE_DEG = 1e-9  # of nodes and anomalies found from states; measured 3e-13
COPY_M = 1e-6  # two ways to one state at 8,000 km; measured 2e-8
TOGETHER_M = 1e-6  # paths followed in company and alone; measured 1e-8
CONIC = 1e-12  # relative, of semi-major axis and eccentricity of copies; measured 4e-15

PATTERNS = [
    (24, 3, 1, "delta", 1400.0, 65.0),
    (28, 4, 2, "delta", 1598.0, 78.0),
    (66, 6, 2, "star", 780.0, 86.4),
]
"""T/P/F; a Walker's own example, the paper's, and one like Iridium."""


def wrapped(degrees):
    return (np.asarray(degrees) + 180) % 360 - 180


def angles_from_states(position, velocity):
    """Right ascension of the ascending node and angle from it [deg], by vectors: the node is z x (r x v)."""
    momentum = np.cross(position, velocity)
    node = np.cross([0.0, 0.0, 1.0], momentum)
    node /= np.linalg.norm(node, axis=1)[:, None]
    ahead = np.cross(momentum / np.linalg.norm(momentum, axis=1)[:, None], node)
    along = np.arctan2(np.sum(position * ahead, axis=1), np.sum(position * node, axis=1))
    return np.degrees(np.arctan2(node[:, 1], node[:, 0])), np.degrees(along)


@pytest.mark.parametrize(("total", "planes", "phasing", "pattern", "altitude_km", "inclination_deg"), PATTERNS)
def test_walker_is_its_definition_seen_from_the_states(total, planes, phasing, pattern, altitude_km, inclination_deg):
    walker = Walker(total, planes, phasing, altitude_km, inclination_deg, pattern=pattern, raan0_deg=10.0)
    position, velocity = (x[0] for x in walker.states(EPOCH, [0.0]))
    node, along = (x.reshape(planes, -1) for x in angles_from_states(position, velocity))
    slots = total // planes
    spread = 360 if pattern == "delta" else 180
    assert np.abs(wrapped(node - 10 - spread / planes * np.arange(planes)[:, None])).max() < ANGLE_DEG
    assert np.abs(wrapped(along - along[:, :1] - 360 / slots * np.arange(slots))).max() < ANGLE_DEG
    # Neighbours in the plane to the east are F * 360/T ahead.
    assert np.abs(wrapped(np.diff(along, axis=0) - 360 * phasing / total)).max() < ANGLE_DEG
    tilt = np.degrees(
        np.arccos(np.cross(position, velocity)[:, 2] / np.linalg.norm(np.cross(position, velocity), axis=1))
    )
    assert np.abs(tilt - inclination_deg).max() < ANGLE_DEG
    if pattern == "delta":  # the pattern closes: the last plane is F * 360/T behind the first, but for whole slots
        gap = wrapped((along[0, 0] - along[-1, 0] - 360 * phasing / total) * slots) / slots
        assert abs(gap) < ANGLE_DEG


def test_the_papers_equations_9_and_10():
    """RAAN 2 pi (i-1)/P and M 2 pi (j-1)/S + 2 pi (i-1)/T: no F, from the states."""
    walker = Walker(28, 4, 2, 1598.0, 78.0, definition="paper")
    node, along = angles_from_states(*(x[0] for x in walker.states(EPOCH, [0.0])))
    for k in range(28):
        i, j = k // 7 + 1, k % 7 + 1
        assert abs(wrapped(node[k] - 360 * (i - 1) / 4)) < ANGLE_DEG
        assert abs(wrapped(along[k] - 360 * (j - 1) / 7 - 360 * (i - 1) / 28)) < ANGLE_DEG


def test_walker_flies_under_its_own_gravity():
    from warpsim.orbit.earth import pole_of_date

    for gravity in ("two_body", "j2"):
        walker = Walker(6, 3, 1, 1400.0, 65.0, gravity=gravity)
        states = walker.states(EPOCH, [0.0, 900.0])
        expected = propagate(*walker.state(), [0.0, 900.0], gravity, pole_of_date(EPOCH))
        assert states[0].shape == (2, 6, 3) and all(np.array_equal(a, b) for a, b in zip(states, expected, strict=True))
    assert Walker(6, 3, 1, 1400.0, 65.0).gravity == "j2"


def test_prefixes_name_satellites():
    assert Walker(4, 2, 1, 1400.0, 65.0, prefix="low").names == ["low11", "low12", "low21", "low22"]
    seed = KeplerOrbit(65.0, altitude_km=1400.0)
    assert SeedPattern(seed, 2, 10, prefix="x").names[:2] == ["x01-01", "x01-02"]
    with pytest.raises(InputError, match="prefix: must be letters, digits"):
        Walker(4, 2, 1, 1400.0, 65.0, prefix="low ")


@pytest.mark.parametrize(("total", "planes", "phasing", "pattern", "altitude_km", "inclination_deg"), PATTERNS)
def test_a_circular_seed_gives_the_walker_pattern(total, planes, phasing, pattern, altitude_km, inclination_deg):
    seed = KeplerOrbit(inclination_deg, altitude_km=altitude_km, raan_deg=33.0, mean_anomaly_deg=12.0)
    copies = SeedPattern(seed, planes, total // planes, phasing, pattern)
    walker = Walker(
        total, planes, phasing, altitude_km, inclination_deg, pattern=pattern, raan0_deg=33.0, mean_anomaly0_deg=12.0
    )
    assert copies.names == walker.names
    for mine, theirs in zip(copies.states(EPOCH, [0.0, 60.0]), walker.states(EPOCH, [0.0, 60.0]), strict=True):
        assert np.abs(mine - theirs).max() < COPY_M


def test_an_eccentric_seed_keeps_its_conic_and_turns():
    seed = KeplerOrbit(
        63.4,
        perigee_altitude_km=600.0,
        eccentricity=0.7,
        raan_deg=20.0,
        argument_of_perigee_deg=270.0,
        mean_anomaly_deg=9.0,
    )
    copies = SeedPattern(seed, n_plane=3, n_per_plane=4, phasing=2)
    position, velocity = copies.state(EPOCH)
    found = state_to_elements(position, velocity)
    assert np.abs(found.semi_major_axis_m / seed.semi_major_axis_m - 1).max() < CONIC
    assert np.abs(found.eccentricity - 0.7).max() < CONIC
    plane, slot = np.divmod(np.arange(12), 4)
    assert np.abs(wrapped(found.raan_deg - 20 - 120 * plane)).max() < ANGLE_DEG
    assert np.abs(wrapped(found.mean_anomaly_deg - 9 - 90 * slot - 360 * 2 / 12 * plane)).max() < ANGLE_DEG
    assert np.abs(wrapped(found.argument_of_perigee_deg - 270)).max() < ANGLE_DEG
    assert np.linalg.norm(position[0] - seed.state()[0][0]) < COPY_M


@pytest.mark.parametrize(
    "seed",
    [
        TleOrbit(lines=ISS),
        StateVector((7e6, 0, 0), (0, 6e3, 5e3), time_s=-50.0, gravity="two_body"),
        KeplerOrbit(60.0, altitude_km=800.0),
    ],
    ids=lambda seed: seed.kind,
)
def test_any_closed_orbit_may_be_the_seed(seed):
    copies = SeedPattern(seed, 2, 2)
    position, velocity = copies.states(EPOCH, [0.0, 10.0])
    assert position.shape == velocity.shape == (2, 4, 3)
    own_m, own_m_s = seed.states(EPOCH, [0.0])
    assert np.linalg.norm(position[0, 0] - own_m[0, 0]) < COPY_M
    assert np.linalg.norm(velocity[0, 0] - own_m_s[0, 0]) < COPY_M
    # Half a revolution on, and in the second plane turned by half a turn about z.
    assert np.sum(position[0, 0] * position[0, 1]) < 0
    assert np.abs(position[0, 2] - position[0, 0] * [-1, -1, 1]).max() < COPY_M
    assert copies.copies_gravity == ("two_body" if seed.kind == "state_vector" else "j2")
    assert SeedPattern(seed, 2, 2, gravity="two_body").copies_gravity == "two_body"


@pytest.mark.parametrize(
    ("seed", "message"),
    [
        (StateVector((7e6, 0, 0), (0, 12e3, 0)), "^seed: must be on a closed orbit, along which it can be copied$"),
        (
            KeplerOrbit(60.0, semi_major_axis_km=7e3, eccentricity=0.1, true_anomaly_deg=180.0),
            "^seed: its whole orbit must be above the Earth's surface, .* perigee 57 km below$",
        ),
    ],
)
def test_seeds_that_cannot_be_copied(seed, message):
    with pytest.raises(InputError, match=message):
        SeedPattern(seed, 2, 2).states(EPOCH, [0.0])


ARC = {
    "kind": "ballistic_arc", "start_lon_lat_deg": [10, 50], "end_lon_lat_deg": [30, 60], "duration_s": 600,
    "endpoint_altitude_km": 120,
}  # fmt: skip


def test_a_list_holds_orbits_of_any_kind():
    orbits = {
        "a": KeplerOrbit(60.0, altitude_km=800.0),
        "b": StateVector((7e6, 0, 0), (0, 6e3, 5e3)),
        "c": TleOrbit(lines=ISS),
        "d": BallisticArc(**ARC, epoch_utc="2025-06-01T00:00:00"),
        "e": StateVector((7e6, 0, 0), (0, 6e3, 5e3), time_s=7.0),
        "f": KeplerOrbit(60.0, altitude_km=800.0, gravity="two_body"),
        "g": KeplerOrbit(10.0, altitude_km=900.0),
    }
    listed = ListedSatellites([{"name": name, "orbit": orbit} for name, orbit in orbits.items()])
    assert listed.names == list(orbits)
    time_s = [0.0, 333.0]
    position, velocity = listed.states(EPOCH, time_s)
    for k, orbit in enumerate(orbits.values()):
        alone = orbit.states(EPOCH, time_s)
        # Those that fly together share the segments of their polynomials, so the last bits differ.
        assert np.abs(position[:, k] - alone[0][:, 0]).max() < TOGETHER_M
        assert np.abs(velocity[:, k] - alone[1][:, 0]).max() < 1e-3 * TOGETHER_M


def test_errors_in_a_list_name_the_satellite():
    falling = KeplerOrbit(60.0, semi_major_axis_km=7e3, eccentricity=0.8, true_anomaly_deg=180.0)
    listed = ListedSatellites([{"name": "a", "orbit": KeplerOrbit(60.0, altitude_km=800.0)},
                               {"name": "b", "orbit": falling}])  # fmt: skip
    with pytest.raises(InputError, match=r"^b: .*falls through"):
        listed.states(EPOCH, [6000.0])
    arc = ListedSatellites([{"name": "d", "orbit": {**ARC, "epoch_utc": "2000-01-01T12:00:00"}}])
    with pytest.raises(InputError, match=r"^d: epoch_utc: must be left out, or .* \(2025-06-01T00:00"):
        arc.states(EPOCH, [0.0])


def test_arcs_are_orbits():
    arc = BallisticArc(**ARC, epoch_utc="2025-06-01T00:00:00")
    position, velocity = arc.states(EPOCH, [0.0, 300.0])
    plain = arc.state([0.0, 300.0])
    assert np.array_equal(position[:, 0], plain[0]) and np.array_equal(velocity[:, 0], plain[1])


def test_mixtures_stand_side_by_side():
    walker, pattern = Walker(6, 3, 1, 1400.0, 65.0), SeedPattern(TleOrbit(lines=ISS), 1, 2, prefix="iss")
    mixed = MixedConstellation([walker, MixedConstellation([pattern]), TleSatellites(lines=ISS)])
    assert mixed.names == [*walker.names, "iss11", "iss12", "norad25544"]
    position, velocity = mixed.states(EPOCH, [0.0, 100.0])
    for states, at in (
        (walker.states(EPOCH, [0.0, 100.0]), slice(0, 6)),
        (pattern.states(EPOCH, [0.0, 100.0]), slice(6, 8)),
    ):
        assert np.array_equal(position[:, at], states[0]) and np.array_equal(velocity[:, at], states[1])


def test_notes_come_through():
    late = utc_time("2026-06-01")
    mixed = MixedConstellation([
        ListedSatellites([{"name": "a", "orbit": TleOrbit(lines=ISS)}]),
        SeedPattern(TleOrbit(lines=ISS), 1, 2),
        Walker(2, 1, 0, 1400.0, 65.0, prefix="w"),
    ])  # fmt: skip
    notes = mixed.notes(late, 60.0)
    assert [note.split(":")[0] for note in notes] == ["a", "seed"] and "365 days" in notes[0]
    assert mixed.notes(EPOCH, 60.0) == []


NESTED = {
    "kind": "mixed",
    "parts": [
        {"kind": "walker", "n_satellite": 6, "n_plane": 3, "phasing": 1, "altitude_km": 1400, "inclination_deg": 65},
        {"kind": "mixed", "parts": [
            {"kind": "seed_pattern", "prefix": "p", "n_plane": 2, "n_per_plane": 3,
             "seed": {"kind": "elements", "inclination_deg": 60, "altitude_km": 700}},
            {"kind": "listed", "satellites": [{"name": "x", "orbit": {**ARC, "epoch_utc": "2025-06-01T00:00:00"}}]},
            {"kind": "tle", "lines": list(ISS)},
        ]},
    ],
}  # fmt: skip


SEED = ("parts", 1, "parts", 0, "seed")
LISTED = ("parts", 1, "parts", 1, "satellites", 0)
PLACE = r"parts\[1\]\.parts"


def changed(value, *path):
    """NESTED with something else at a path."""
    import copy

    data = copy.deepcopy(NESTED)
    place = data
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    return data


def test_nested_descriptions_survive_plain_data():
    adapter = TypeAdapter(Constellation)
    mixed = adapter.validate_python(NESTED)
    assert len(mixed.names) == 6 + 6 + 1 + 1
    again = adapter.validate_python(adapter.dump_python(mixed, mode="json"))
    assert again == mixed
    assert np.array_equal(again.states(EPOCH, [5.0])[0], mixed.states(EPOCH, [5.0])[0])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (changed(61, "parts", 0, "n_plane"), r"parts\[0\]\.n_plane: must divide n_satellite \(6\), got 61$"),
        (changed(200, *SEED, "inclination_deg"), PLACE + r"\[0\]\.seed\.inclination_deg: must be in .*, got 200$"),
        (changed("helix", *SEED, "kind"), PLACE + r"\[0\]\.seed\.kind: must be one of .*'elements'.*, got 'helix'$"),
        (changed("cube", *SEED[:-1], "pattern"), PLACE + r"\[0\]\.pattern: must be 'delta' or 'star', got 'cube'$"),
        (changed(2, *SEED[:-1], "phasing"), PLACE + r"\[0\]\.phasing: must be in 0\.\.1 \(below n_plane\), got 2$"),
        (changed(60000, *SEED[:-1], "n_per_plane"), PLACE + r"\[0\]\.n_per_plane: must give at most 100000 satellites"),
        (changed("a b", *LISTED, "name"), PLACE + r"\[1\]\.satellites\[0\]\.name: must be letters, .*, got 'a b'$"),
        (changed([1], *LISTED, "orbit", "end_lon_lat_deg"), PLACE + r"\[1\]\.satellites\[0\]\.orbit\.end_lon_lat_deg"),
        (changed("sat", *SEED[:-1], "prefix"), r"parts: names must be unique, got sat11 twice \(patterns take a "),
        (changed([], *LISTED[:-1]), r"satellites: must hold at least one satellite$"),
        (changed(list(ISS[:1]), "parts", 1, "parts", 2, "lines"), PLACE + r"\[2\]\.lines: line 1: must be followed"),
        ({"kind": "mixed"}, r"parts: is required$"),
        ({"kind": "mixed", "parts": []}, r"parts: must hold at least one satellite$"),
    ],
)  # fmt: skip
def test_faults_name_their_place(data, message):
    from pydantic import ValidationError

    with pytest.raises(ValidationError) as caught:
        TypeAdapter(Constellation).validate_python(data)
    with pytest.raises(InputError, match=message):
        raise input_error(caught.value, "scene.toml")
    with pytest.raises(InputError, match=message) as direct:
        MixedConstellation(**data)
    assert len(str(direct.value).splitlines()) == 1


def test_a_seed_turns_by_whole_periods_only():
    """The one-plane, one-slot pattern is the seed itself."""
    seed = StateVector((7e6, 0, 0), (0, 6e3, 5e3))
    alone = SeedPattern(seed, 1, 1).state(EPOCH)
    assert np.linalg.norm(alone[0][0] - seed.position_m) == pytest.approx(0, abs=1e-9)
    assert math.dist(alone[1][0], seed.velocity_m_s) == pytest.approx(0, abs=1e-12)


ROUNDING_DEG = 1e-11  # rounding of a few operations on 360
POSITION_M = 1e-6  # rounding of sines and cosines at 8,000 km


def by_definition(total, planes, phasing, spread_deg, raan0=0.0, anomaly0=0.0):
    """Walker's definition: (raan, mean anomaly) of satellite j of plane i, one by one."""
    slots = total // planes
    return [
        (raan0 + spread_deg * (i - 1) / planes, anomaly0 + 360 * (j - 1) / slots + 360 * phasing * (i - 1) / total)
        for i in range(1, planes + 1)
        for j in range(1, slots + 1)
    ]


def apart_deg(difference_deg):
    return np.abs((np.asarray(difference_deg) + 180) % 360 - 180)


@pytest.mark.parametrize(
    ("total", "planes", "phasing", "pattern"),
    [(24, 3, 1, "delta"), (28, 4, 2, "delta"), (66, 6, 2, "star"), (1, 1, 0, "delta"), (5, 5, 4, "delta")],
)
def test_angles_follow_the_definition(total, planes, phasing, pattern):
    walker = Walker(total, planes, phasing, 1598, 78, pattern=pattern, raan0_deg=350, mean_anomaly0_deg=100)
    expected = by_definition(total, planes, phasing, 360 if pattern == "delta" else 180, 350, 100)
    assert apart_deg(walker.raan_deg - [e[0] for e in expected]).max() < ROUNDING_DEG
    assert apart_deg(walker.mean_anomaly_deg - [e[1] for e in expected]).max() < ROUNDING_DEG
    assert np.all((walker.raan_deg >= 0) & (walker.raan_deg < 360))
    assert np.all((walker.mean_anomaly_deg >= 0) & (walker.mean_anomaly_deg < 360))


def test_paper_definition_leaves_the_phasing_out():
    walker = Walker(28, 4, 2, 1598, 78, definition="paper")
    assert apart_deg(walker.mean_anomaly_deg - [e[1] for e in by_definition(28, 4, 1, 360)]).max() < ROUNDING_DEG


def test_known_constellation():
    walker = Walker(n_satellite=28, n_plane=4, phasing=2, altitude_km=1598, inclination_deg=78)
    assert walker.raan_deg[[0, 7, 14, 21]].tolist() == [0, 90, 180, 270]
    assert walker.mean_anomaly_deg[[0, 1, 7, 14]] == pytest.approx([0, 360 / 7, 180 / 7, 360 / 7])


@pytest.mark.parametrize("inclination_deg", [0.0, 78.0, 90.0, 180.0])
def test_states_are_circular_orbits_with_those_elements(inclination_deg):
    walker = Walker(28, 4, 2, 1598, inclination_deg, raan0_deg=20, mean_anomaly0_deg=5)
    position, velocity = walker.state()
    radius = 6378137.0 + 1598e3
    assert walker.period_s == pytest.approx(2 * math.pi * math.sqrt(radius**3 / MU))
    for k in range(28):
        angles_deg = (walker.raan_deg[k], walker.mean_anomaly_deg[k], inclination_deg)
        node, anomaly, tilt = (math.radians(x) for x in angles_deg)
        # Rotation Rz(node) Rx(tilt) Rz(anomaly) applied to the x axis, and to y for the velocity.
        turn = np.array([[math.cos(node), -math.sin(node), 0], [math.sin(node), math.cos(node), 0], [0, 0, 1]])
        lean = np.array([[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]])
        place = turn @ lean @ [math.cos(anomaly), math.sin(anomaly), 0]
        course = turn @ lean @ [-math.sin(anomaly), math.cos(anomaly), 0]
        assert np.abs(position[k] - radius * place).max() < POSITION_M
        assert np.abs(velocity[k] - math.sqrt(MU / radius) * course).max() < POSITION_M


def test_names():
    names = Walker(28, 4, 2, 1598, 78).names
    assert names[0] == "sat11" and names[6] == "sat17" and names[7] == "sat21" and names[-1] == "sat47"
    assert Walker(66, 6, 2, 780, 86.4).names[-1] == "sat06-11"
    assert Walker(1000, 10, 2, 780, 86.4).names[-1] == "sat10-100"
    assert len(set(Walker(1000, 10, 2, 780, 86.4).names)) == 1000


def test_quantities_are_converted():
    assert Walker(28, 4, 2, 1598e3 * u.m, (78 * u.deg).to(u.rad)).altitude_km == pytest.approx(1598)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"n_plane": 5}, r"^Walker: n_plane: must divide n_satellite \(28\), got 5$"),
        ({"phasing": 4}, r"^Walker: phasing: must be in 0..3 \(below n_plane\), got 4$"),
        ({"phasing": -1}, "phasing: must be in 0..3"),
        ({"n_satellite": 0}, "n_satellite: must be >= 1"),
        ({"altitude_km": -1}, "altitude_km: must be > 0"),
        ({"altitude_km": math.nan}, "altitude_km: must be finite"),
        ({"inclination_deg": 181}, r"inclination_deg: must be in \[0, 180\], got 181"),
        ({"pattern": "flower"}, "pattern: must be 'delta' or 'star'"),
        ({"raan_deg": 1}, "raan_deg: is not a known field"),
    ],
)
def test_errors_are_one_clear_line(changes, message):
    good = {"n_satellite": 28, "n_plane": 4, "phasing": 2, "altitude_km": 1598, "inclination_deg": 78}
    with pytest.raises(InputError, match=message) as caught:
        Walker(**{**good, **changes})
    assert "\n" not in str(caught.value)


def philox_words(key, n):
    """Philox4x64-10 of Salmon et al. 2011 in whole numbers; NumPy counts up before its first block."""
    words, mask = [], 2**64 - 1
    for block in range(1, n // 4 + 2):
        x, k = [block, 0, 0, 0], [key & mask, key >> 64]
        for _ in range(10):
            a, b = 0xD2E7470EE14C6C93 * x[0], 0xCA5A826395121157 * x[2]
            x = [(b >> 64) ^ x[1] ^ k[0], b & mask, (a >> 64) ^ x[3] ^ k[1], a & mask]
            k = [(k[0] + 0x9E3779B97F4A7C15) & mask, (k[1] + 0xBB67AE8584CAA73B) & mask]
        words += x
    return words[:n]


def test_release_follows_the_published_generator():
    seed, main = 20250320, np.array([100.0, -200.0, 7000.0])
    got = release_velocities(main, 29, (2.0, 5.0), seed) - main
    stream = zlib.crc32(b"group release") << 32
    unit = [((w >> 11) + 0.5) / 2**53 for w in philox_words(seed | stream << 64, 87)]
    for i in range(29):
        z, azimuth, speed = 2 * unit[3 * i] - 1, 2 * math.pi * unit[3 * i + 1], 2 + 3 * unit[3 * i + 2]
        across = math.sqrt(1 - z * z)
        expected = [speed * across * math.cos(azimuth), speed * across * math.sin(azimuth), speed * z]
        np.testing.assert_allclose(got[i], expected, rtol=0, atol=1e-11)  # adding 7 km/s costs four digits


def test_release_is_isotropic_and_uniform_in_speed():
    n = 200_000
    relative = release_velocities(np.zeros(3), n, (2.0, 5.0), 7)
    speed = np.linalg.norm(relative, axis=1)
    direction = relative / speed[:, None]
    five_sigma = 5.0 / math.sqrt(n)
    assert speed.min() >= 2.0 and speed.max() < 5.0
    assert np.abs(direction.mean(axis=0)).max() < five_sigma / math.sqrt(3)
    # E[u u^T] = 1/3, each entry's standard deviation below 0.3 / sqrt(n).
    assert np.abs(direction.T @ direction / n - np.eye(3) / 3).max() < 0.3 * five_sigma
    assert abs(speed.mean() - 3.5) < five_sigma * 3 / math.sqrt(12)
    assert abs(speed.var() - 0.75) < five_sigma * 0.75


def test_seeds_and_sizes():
    a, b = (release_velocities(np.zeros(3), n, (2, 5), 1) for n in (10, 29))
    assert np.array_equal(a, b[:10])
    assert not np.allclose(a, release_velocities(np.zeros(3), 10, (2, 5), 2))
    assert release_velocities(np.zeros(3), 0, (2, 5), 1).shape == (0, 3)
    release_velocities(np.zeros(3), 1, (0, 0), 2**64 - 1)
