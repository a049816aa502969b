"""Walker constellations and released groups against their definitions, written out as loops."""

from __future__ import annotations

import math
import zlib

import numpy as np
import pytest
from astropy import units as u

from warpsim.errors import InputError
from warpsim.orbit.walker import Walker
from warpsim.scene.motion import release_velocities

MU = 3.986004418e14
ANGLE_DEG = 1e-11  # rounding of a few operations on 360
POSITION_M = 1e-6  # rounding of sines and cosines at 8,000 km


def by_definition(total, planes, phasing, spread_deg, raan0=0.0, anomaly0=0.0):
    """Walker's definition: (raan, mean anomaly) of satellite j of plane i, one by one."""
    slots = total // planes
    return [
        (raan0 + spread_deg * (i - 1) / planes, anomaly0 + 360 * (j - 1) / slots + 360 * phasing * (i - 1) / total)
        for i in range(1, planes + 1)
        for j in range(1, slots + 1)
    ]


def wrapped(difference_deg):
    return np.abs((np.asarray(difference_deg) + 180) % 360 - 180)


@pytest.mark.parametrize(
    ("total", "planes", "phasing", "pattern"),
    [(24, 3, 1, "delta"), (28, 4, 2, "delta"), (66, 6, 2, "star"), (1, 1, 0, "delta"), (5, 5, 4, "delta")],
)
def test_angles_follow_the_definition(total, planes, phasing, pattern):
    walker = Walker(total, planes, phasing, 1598, 78, pattern=pattern, raan0_deg=350, mean_anomaly0_deg=100)
    expected = by_definition(total, planes, phasing, 360 if pattern == "delta" else 180, 350, 100)
    assert wrapped(walker.raan_deg - [e[0] for e in expected]).max() < ANGLE_DEG
    assert wrapped(walker.mean_anomaly_deg - [e[1] for e in expected]).max() < ANGLE_DEG
    assert np.all((walker.raan_deg >= 0) & (walker.raan_deg < 360))
    assert np.all((walker.mean_anomaly_deg >= 0) & (walker.mean_anomaly_deg < 360))


def test_paper_definition_leaves_the_phasing_out():
    walker = Walker(28, 4, 2, 1598, 78, definition="paper")
    assert wrapped(walker.mean_anomaly_deg - [e[1] for e in by_definition(28, 4, 1, 360)]).max() < ANGLE_DEG


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


@pytest.mark.parametrize(
    "args",
    [
        (np.zeros(2), 3, (2, 5), 1), (np.zeros(3), -1, (2, 5), 1), (np.zeros(3), 3, (5, 2), 1),
        (np.zeros(3), 3, (-1, 2), 1), (np.zeros(3), 3, (2, math.nan), 1), (np.zeros(3), 3, (2, 5), -1),
        (np.zeros(3), 3, (2, 5), 2**64), (np.zeros(3), 3, (2, 5), 1.5), ([0, 0, math.nan], 3, (2, 5), 1),
    ],
)  # fmt: skip
def test_release_checks_its_arguments(args):
    with pytest.raises(InputError):
        release_velocities(*args)
