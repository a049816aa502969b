"""Cameras that are fixed in a body whose attitude a file gives, and attitude rows with angular velocities."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import printed
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import warpsim as ws
from warpsim.instant import utc_time

EPOCH = "2025-03-20T12:00:00"
PRINTED_RAD = 1e-9  # twelve printed digits of a quaternion
CUBIC_RAD = 5e-4  # the cubic's error for the motion below in steps of 10 s, 35 deg; measured 1.8e-4
SLERP_RAD = 0.02  # what slerp misses there is above this: 0.029
DENSE_RAD = 2e-7  # twice what slerp between dense rows may miss

INERTIA = np.array([1.0, 2.0, 3.0])


def tumbling(time_s):
    """A free asymmetric body: rotation body -> GCRS and angular velocity in its axes [rad/s], by Euler's equations."""

    def change(_, state):
        q, w = state[:4], state[4:]
        turned = 0.5 * np.concatenate([q[3] * w + np.cross(q[:3], w), [-q[:3] @ w]])
        return np.concatenate([turned, -np.cross(w, INERTIA * w) / INERTIA])

    start = np.concatenate([Rotation.from_rotvec([0.3, -0.5, 0.8]).as_quat(), [0.02, 0.06, 0.01]])
    ends = min(0.0, time_s[0]), time_s[-1]
    assert ends[0] == 0.0
    states = solve_ivp(change, ends, start, t_eval=time_s, rtol=1e-12, atol=1e-13, method="DOP853").y.T
    return Rotation.from_quat(states[:, :4]), states[:, 4:]


def stk(time_s, quaternion, rate_rad_s=None, axes="ICRF"):
    columns = [time_s[:, None], quaternion] + ([] if rate_rad_s is None else [np.degrees(rate_rad_s)])
    rows = [" ".join(f"{value:.12f}" for value in row) for row in np.concatenate(columns, axis=1)]
    data = "AttitudeTimeQuaternions" if rate_rad_s is None else "AttitudeTimeQuatAngVels"
    return (
        f"stk.v.12.0\nBEGIN Attitude\nNumberOfAttitudePoints {len(rows)}\nScenarioEpoch 20 Mar 2025 12:00:00.0\n"
        f"CentralBody Earth\nCoordinateAxes {axes}\n{data}\n" + "\n".join(rows) + "\nEND Attitude\n"
    )


def aem(time_s, cells, kind, version="2.0", **meta):
    def date(t):
        return f"2025-03-20T12:{int(t // 60):02d}:{t % 60:09.6f}"

    meta = {
        "OBJECT_NAME": "SAT", "OBJECT_ID": "2025-001A", "CENTER_NAME": "EARTH", "REF_FRAME_A": "GCRF",
        "REF_FRAME_B": "SC_BODY_1", "ATTITUDE_DIR": "A2B", "TIME_SYSTEM": "UTC", "START_TIME": date(time_s[0]),
        "STOP_TIME": date(time_s[-1]), "ATTITUDE_TYPE": kind, **meta,
    }  # fmt: skip
    lines = [f"{name} = {value}" for name, value in meta.items()]
    rows = [" ".join([date(t), *(f"{value:.12f}" for value in row)]) for t, row in zip(time_s, cells, strict=True)]
    head = f"CCSDS_AEM_VERS = {version}\nCREATION_DATE = 2025-03-20T00:00:00\nORIGINATOR = ME"
    return "\n".join([head, "META_START", *lines, "META_STOP", "DATA_START", *rows, "DATA_STOP\n"])


def off_rad(rows, time_s):
    """Angle between a table and the true motion."""
    return (Rotation.from_quat(rows.at(time_s)).inv() * tumbling(time_s)[0]).magnitude()


def every(step_s, end_s=300.0):
    return np.arange(0.0, end_s + 1e-9, step_s)


def test_rows_with_rates_are_followed_between_them(tmp_path):
    time_s = every(10.0)
    turned, rate = tumbling(time_s)
    middles = time_s[:-1] + 5.0
    for name, text in {"plain": stk(time_s, turned.as_quat()), "rates": stk(time_s, turned.as_quat(), rate)}.items():
        (tmp_path / f"{name}.a").write_text(text)
    plain, rates = (ws.AttitudeTable(file=tmp_path / f"{name}.a").rows(utc_time(EPOCH)) for name in ("plain", "rates"))
    assert off_rad(plain, middles).max() > SLERP_RAD and off_rad(rates, middles).max() < CUBIC_RAD
    assert off_rad(rates, time_s).max() < PRINTED_RAD
    for rows, about in ((plain, off_rad(plain, middles)), (rates, off_rad(rates, every(2.5)))):
        estimated_rad, near_s = rows.worst_error(0.0, 300.0)
        assert 0.3 < estimated_rad / about.max() < 3.0 and 0.0 < near_s < 300.0
    assert plain.note == "" and rates.note == "with its angular velocities" and len(rates.time_s) > 1000


def test_a_constant_rate_stays_exact(tmp_path):
    time_s = every(40.0)
    rate = np.tile([0.0, 0.0, 0.05], (len(time_s), 1))  # 115 deg from row to row
    (tmp_path / "spin.a").write_text(stk(time_s, Rotation.from_rotvec(rate * time_s[:, None]).as_quat(), rate))
    rows = ws.AttitudeTable(file=tmp_path / "spin.a").rows(utc_time(EPOCH))
    at_s = np.linspace(0.0, 280.0, 500)
    expected = Rotation.from_rotvec(np.outer(at_s, [0.0, 0.0, 0.05]))
    assert (Rotation.from_quat(rows.at(at_s)).inv() * expected).magnitude().max() < DENSE_RAD
    assert rows.worst_error(0.0, 280.0)[0] < 1e-9


KINDS = {
    "derivative": ("QUATERNION/DERIVATIVE", {}),
    "body": ("QUATERNION/ANGVEL", {"ANGVEL_FRAME": "REF_FRAME_B"}),
    "reference": ("QUATERNION/ANGVEL", {"ANGVEL_FRAME": "GCRF"}),
    "first": ("QUATERNION/RATE", {"RATE_FRAME": "REF_FRAME_B", "QUATERNION_TYPE": "FIRST"}),
    "first derivative": ("QUATERNION/DERIVATIVE", {"QUATERNION_TYPE": "FIRST"}),
    "backwards": ("QUATERNION/DERIVATIVE", {"ATTITUDE_DIR": "B2A"}),
}


@pytest.mark.parametrize("name", KINDS)
def test_rates_of_aem_are_used(tmp_path, name):
    kind, meta = KINDS[name]
    time_s = every(10.0)
    turned, rate = tumbling(time_s)
    quaternion, step_s = turned.as_quat(), 1e-4
    beside = {
        "body": np.degrees(rate), "first": np.degrees(rate), "reference": np.degrees(turned.apply(rate))
    }.get(name)  # fmt: skip
    if beside is None:
        ahead = (turned * Rotation.from_rotvec(rate * step_s)).as_quat()
        beside = (ahead * np.sign(np.sum(ahead * quaternion, axis=1, keepdims=True)) - quaternion) / step_s
    if name == "backwards":
        quaternion, beside = quaternion * [-1, -1, -1, 1], beside * [-1, -1, -1, 1]
    if "first" in name:
        quaternion = np.roll(quaternion, 1, axis=1)
        beside = np.roll(beside, 1, axis=1) if beside.shape[1] == 4 else beside
    (tmp_path / "sat.aem").write_text(aem(time_s, np.concatenate([quaternion, beside], axis=1), kind, **meta))
    rows = ws.AttitudeTable(file=tmp_path / "sat.aem").rows(utc_time(EPOCH))
    assert off_rad(rows, every(2.5)).max() < CUBIC_RAD


def test_rates_of_another_unit_are_not_used(tmp_path):
    time_s = every(10.0)
    turned, rate = tumbling(time_s)
    (tmp_path / "odd.a").write_text(stk(time_s, turned.as_quat(), np.radians(rate)))
    rows = ws.AttitudeTable(file=tmp_path / "odd.a").rows(utc_time(EPOCH))
    assert rows.note == "its angular velocities are not those of its rows, and not used"
    assert len(rows.time_s) == len(time_s)


def test_rates_relative_to_the_turning_earth(tmp_path):
    """A body at rest among the stars turns with -7.3e-5 rad/s in Earth-fixed axes."""
    from warpsim.orbit.earth import frame_to_gcrs

    time_s = every(100.0, 1000.0)
    to_gcrs = Rotation.from_matrix(frame_to_gcrs("ITRF", utc_time(EPOCH), time_s))
    rate = to_gcrs.apply(np.tile([0.0, 0.0, -7.292115e-5], (len(time_s), 1)))
    (tmp_path / "fixed.a").write_text(stk(time_s, to_gcrs.inv().as_quat(), rate, axes="Fixed"))
    rows = ws.AttitudeTable(file=tmp_path / "fixed.a").rows(utc_time(EPOCH))
    assert rows.note == "with its angular velocities"
    assert Rotation.from_quat(rows.at(every(25.0, 1000.0))).magnitude().max() < DENSE_RAD


@pytest.fixture
def held(tmp_path):
    """The scene of a satellite with an attitude file, and the file's motion."""
    time_s = every(10.0)
    turned, rate = tumbling(time_s)
    (tmp_path / "sat11.a").write_text(stk(time_s, turned.as_quat(), rate))

    def scene(**pointing):
        return ws.Scene.load("stss").replace(
            epoch_utc=EPOCH, duration_s=300.0, frames={"count": 3, "interval_s": 100.0}, access_rules={},
            pointing=[
                {"kind": "body", "on": "sat11", "file": str(tmp_path / "{satellite}.a"), **pointing},
                {"track": "main"},
            ],
        )  # fmt: skip

    return scene


def test_a_camera_looks_where_its_body_is_turned(held):
    at_s = np.array([0.0, 37.0, 200.0])
    body = tumbling(at_s)[0]
    axes = held().scenario.view_axes("sat11", at_s)
    np.testing.assert_allclose(axes, np.swapaxes(body.as_matrix(), 1, 2), rtol=0, atol=CUBIC_RAD)
    boresight, up = np.array([1.0, 0.0, 0.0]), np.array([0.5, 0.0, 2.0])
    looking = held(boresight=boresight, image_up=up).scenario.view_axes("sat11", at_s)
    np.testing.assert_allclose(looking[:, 2], body.apply(boresight), rtol=0, atol=CUBIC_RAD)
    np.testing.assert_allclose(-looking[:, 1], body.apply([0.0, 0.0, 1.0]), rtol=0, atol=CUBIC_RAD)
    assert np.linalg.det(looking) == pytest.approx(1.0, abs=1e-12)
    mounting = Rotation.from_euler("xyz", [20.0, -50.0, 110.0], degrees=True)
    mounted = held(mounting=mounting.as_quat().tolist()).scenario.view_axes("sat11", at_s)
    expected = np.swapaxes((body * mounting).as_matrix(), 1, 2)
    np.testing.assert_allclose(mounted, expected, rtol=0, atol=CUBIC_RAD)
    rolled = held(mounting=mounting.as_quat().tolist(), roll_deg=90.0).scenario.view_axes("sat11", at_s)
    np.testing.assert_allclose(rolled[:, 0], expected[:, 1], rtol=0, atol=CUBIC_RAD)


@pytest.mark.ci
def test_frames_and_truth_have_these_axes(held):
    """The kernel's axes are the host's, and stars lie where these say."""
    scene = held(boresight=[1.0, 0.0, 0.0], image_up=[0.0, 0.0, 1.0])
    frames = ws.Renderer(scene, "cpu").render([0, 2], sensors=["sat11", "sat12"], keep_stars=True)
    for number, frame in enumerate((0, 2)):
        axes = scene.scenario.view_axes("sat11", [100.0 * frame])[0]
        np.testing.assert_allclose(frames.axes_icrs[number, 0], axes, rtol=0, atol=1e-12)


def test_check_says_how_rows_are_followed(held, tmp_path, capsys):
    scene = held()
    scene.save(tmp_path / "scene.toml")
    report = printed(capsys, "check", tmp_path / "scene.toml")
    assert "fixed in a body" in report
    assert "  attitude   body by 31 rows, with its angular velocities, some " in report


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"up": "north"}, r"pointing\[0\]\.up: must be left out: image_up says it in the body's axes, got 'north'"),
        ({"boresight": [1, 0, 0]}, r"boresight, image_up: both must be given, or none"),
        ({"boresight": [0, 0, 0], "image_up": [1, 0, 0]}, r"boresight: must not be 0"),
        ({"boresight": [1, 0, 0], "image_up": [2, 0, 0]}, r"image_up: must not be along the boresight"),
        ({"mounting": [1, 1, 0, 0]}, r"mounting: must have norm 1, got 1\.41421"),
        ({"mounting": [1, 0, 0, 0], "boresight": [1, 0, 0], "image_up": [0, 1, 0]}, r"must be left out where mounting"),
    ],
)
def test_mountings_that_are_none(held, fields, message):
    with pytest.raises(ws.InputError, match=message):
        held(**fields)


def test_files_must_be_there_and_cover_the_frames(held, tmp_path):
    with pytest.raises(ws.InputError, match=r"pointing\[0\]: .*gone.a: cannot be read"):
        _ = held(file=str(tmp_path / "gone.a")).scenario
    with pytest.raises(ws.InputError, match=r"pointing: sat11: .*must be within the attitude table, 0 to 300 s"):
        _ = held().replace(duration_s=400.0, frames={"count": 2, "interval_s": 400.0}).scenario


@pytest.mark.ci
def test_bodies_scans_and_tracks_in_one_kind_of_sensor(held, tmp_path):
    """With an exposure: light moves over the image as the body turns."""
    (tmp_path / "sat13.a").write_text(stk(np.zeros(1), Rotation.from_rotvec([[0.1, 0.2, 0.3]]).as_quat()))
    rows = [{"time_s": 0.0, "ra_deg": 10.0, "dec_deg": 5.0}, {"time_s": 300.0, "ra_deg": 40.0, "dec_deg": -5.0}]
    scene = held().replace(
        detector={"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "exposure_s": 0.5},
        pointing=[
            {"kind": "table", "mode": "scan", "rows": rows, "on": "sat12", "up": "north"},
            {"kind": "body", "on": ["sat11", "sat13"], "file": str(tmp_path / "{satellite}.a")},
            {"track": "main"},
        ],
    )
    names = ["sat11", "sat12", "sat13", "sat14"]
    frames = ws.Renderer(scene, "cpu").render([0, 1, 2], sensors=names)
    for column, name in enumerate(names):
        axes = scene.scenario.view_axes(name, [0.0, 100.0, 200.0])
        np.testing.assert_allclose(frames.axes_icrs[:, column], axes, rtol=0, atol=1e-12)
    still = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix().T
    np.testing.assert_allclose(frames.axes_icrs[1, 2], still, rtol=0, atol=PRINTED_RAD)
