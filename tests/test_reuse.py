"""Scenes made from others by replace() keep what was worked out, and only what is the same."""

from __future__ import annotations

import numpy as np
import pytest

import warpsim as ws

OEM = """CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2025-01-01T00:00:00
ORIGINATOR = TEST
META_START
OBJECT_NAME = TARGET
OBJECT_ID = 2025-001A
CENTER_NAME = EARTH
REF_FRAME = GCRF
TIME_SYSTEM = UTC
START_TIME = 2025-01-01T13:50:00
STOP_TIME = 2025-01-01T15:50:00
META_STOP
"""


def fresh(scene):
    return ws.Scene.from_dict(scene.to_dict())


@pytest.fixture
def scene():
    scene = ws.Scene.load("stss")
    assert scene.scenario.sensors_with_access  # works out tracks and access
    return scene


@pytest.mark.parametrize(
    "changes",
    [
        {"camera__n_row": 64},
        {"frames__interval_s": 5.0},
        {"bands": ["A"]},
        {"sky__catalog": "none"},
        {"optics__aperture_m": 0.3},
        {"name": "other", "lighting__sun": False},
    ],
)
def test_what_has_nothing_to_do_with_motion_keeps_tracks_and_access(scene, changes):
    other = scene.replace(**changes)
    assert other.scenario.tracks is scene.scenario.tracks
    assert np.array_equal(other.access().as_array(), fresh(other).access().as_array())


@pytest.mark.parametrize(
    "changes",
    [
        {"seed": 5},
        {"duration_s": 1612.0},
        {"epoch_utc": "2025-01-02T14:00:00"},
        {"targets__1__count": 3},
        {"release__speed_m_s": [1.0, 2.0]},
        {"constellation__altitude_km": 1500.0},
    ],
)
def test_what_moves_otherwise_is_worked_out_anew(scene, changes):
    other = scene.replace(**changes)
    assert other.scenario.tracks is not scene.scenario.tracks
    sampled = other.position_m(other.target_names[-1], [900.0])
    assert np.array_equal(sampled, fresh(other).position_m(other.target_names[-1], [900.0]))


FIXED = {"kind": "fixed", "azimuth_elevation_deg": [90.0, -20.0]}
MANY = {"camera__n_row": 8192, "camera__n_col": 8192}


@pytest.mark.parametrize("rules", [{"max_range_km": 1500.0}, {"in_fov": True}])
def test_access_follows_its_rules(scene, rules):
    scene = scene.replace(pointing=FIXED, camera__fov_deg=20.0, **MANY)
    other = scene.replace(**{f"access_rules__{name}": value for name, value in rules.items()})
    assert other.scenario.tracks is scene.scenario.tracks
    assert np.array_equal(other.access().as_array(), fresh(other).access().as_array())
    assert not np.array_equal(other.access().as_array(), scene.access().as_array())


def test_a_camera_matters_where_access_asks_for_the_field_of_view(scene):
    narrow = scene.replace(access_rules__in_fov=True, pointing=FIXED, camera__fov_deg=5.0, **MANY)
    assert narrow.scenario.sensors_with_access is not None
    wide = narrow.replace(camera__fov_deg=119.0)
    assert wide.scenario.tracks is narrow.scenario.tracks
    assert np.array_equal(wide.access().as_array(), fresh(wide).access().as_array())
    assert not np.array_equal(wide.access().as_array(), narrow.access().as_array())


def test_nothing_is_worked_out_for_the_sake_of_it():
    scene = ws.Scene.load("stss")
    scene.replace(camera__n_row=64)
    assert "scenario" not in vars(scene)


def test_a_file_that_was_changed_meanwhile_is_read_anew(tmp_path):
    path = tmp_path / "target.oem"
    times = [f"2025-01-01T{13 + (50 + i) // 60}:{(50 + i) % 60:02d}:00" for i in range(121)]
    angles = np.arange(121) * 60 / 5800 * 2 * np.pi

    def write(radius_km):
        speed = 2 * np.pi / 5800 * radius_km
        rows = [
            f"{time} {radius_km * np.cos(a):.9f} {radius_km * np.sin(a):.9f} 0 "
            f"{-speed * np.sin(a):.12f} {speed * np.cos(a):.12f} 0"
            for time, a in zip(times, angles, strict=True)
        ]
        path.write_text(OEM + "\n".join(rows) + "\n")

    write(7000.0)
    scene = ws.Scene.load("stss").replace(trajectory={"kind": "ephemeris", "file": str(path)}, release__time_s=0.0)
    before = scene.position_m(scene.target_names[0], [500.0])
    assert scene.replace(camera__n_row=64).scenario.tracks is scene.scenario.tracks
    write(7100.0)
    after = scene.replace(camera__n_row=64).position_m(scene.target_names[0], [500.0])
    assert np.linalg.norm(before) == pytest.approx(7.0e6, abs=1)
    assert np.linalg.norm(after) == pytest.approx(7.1e6, abs=1)


def test_pointing_matters_where_access_asks_for_the_field_of_view(scene):
    one = scene.replace(access_rules__in_fov=True, pointing=FIXED, camera__fov_deg=50.0, **MANY)
    assert one.scenario.sensors_with_access is not None
    other = one.replace(pointing={"kind": "fixed", "azimuth_elevation_deg": [0.0, -20.0]})
    assert other.scenario.tracks is one.scenario.tracks
    assert np.array_equal(other.access().as_array(), fresh(other).access().as_array())


def test_a_table_of_directions_is_read_anew(scene, tmp_path):
    path = tmp_path / "look.csv"

    def write(azimuth_deg):
        path.write_text(f"time_s,azimuth_deg,elevation_deg\n0,{azimuth_deg},-20\n1614,{azimuth_deg},-20\n")

    write(90)
    table = {"kind": "table", "mode": "stare", "file": str(path)}
    one = scene.replace(access_rules__in_fov=True, pointing=table, camera__fov_deg=50.0, **MANY)
    assert one.scenario.sensors_with_access is not None
    write(10)
    other = one.replace(name="other")
    assert np.array_equal(other.access().as_array(), fresh(other).access().as_array())
    assert not np.array_equal(other.access().as_array(), one.access().as_array())
