"""Attitude files of other programs, through the readers, into a scene."""

import erfa
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import warpsim as ws

pytest.importorskip("warpsim.exchange.read_files")

PRINTED_RAD = 1e-9  # ten printed digits of a quaternion

EPOCH_UTC = "2025-01-01T14:00:00"
LAST_S = 1650.0
AXIS = np.array([0.48, -0.6, 0.64])
RATE_RAD_S = 0.02


def turned(time_s):
    """Body -> reference axes: a constant rate about one axis, so that slerp adds no error."""
    return Rotation.from_rotvec(np.atleast_1d(time_s)[:, None] * RATE_RAD_S * AXIS)


def rows(quaternion_of, step_s=50.0):
    """Time and quaternion of each row, scalar last."""
    times = np.arange(-50.0, LAST_S + 1, step_s)
    return list(zip(times, quaternion_of(turned(times)), strict=True))


def date(time_s):
    """ISO date; the scene starts at 14:00 and lasts less than an hour."""
    total = 14 * 3600 + time_s
    return f"2025-01-01T{int(total // 3600):02d}:{int(total % 3600 // 60):02d}:{total % 60:09.6f}"


def numbers(values):
    return " ".join(f"{value:.12f}" for value in values)


def aem(direction, order="LAST", frame="GCRF", quaternion_of=Rotation.as_quat):
    cells = {"LAST": [0, 1, 2, 3], "FIRST": [3, 0, 1, 2]}[order]
    head = f"""CCSDS_AEM_VERS = 1.0
CREATION_DATE = 2025-01-01T00:00:00
ORIGINATOR = TEST
META_START
OBJECT_NAME = MAIN
OBJECT_ID = 2025-001A
CENTER_NAME = EARTH
REF_FRAME_A = {frame}
REF_FRAME_B = SC_BODY_1
ATTITUDE_DIR = {direction}
TIME_SYSTEM = UTC
START_TIME = {date(-50.0)}
STOP_TIME = {date(LAST_S)}
ATTITUDE_TYPE = QUATERNION
QUATERNION_TYPE = {order}
META_STOP
DATA_START
"""
    lines = [f"{date(time_s)} {numbers(np.array(q)[cells])}" for time_s, q in rows(quaternion_of)]
    return head + "\n".join(lines) + "\nDATA_STOP\n"


def stk():
    lines = [f"{time_s:.6f} {numbers(q)}" for time_s, q in rows(Rotation.as_quat)]
    return (
        f"stk.v.11.0\nBEGIN Attitude\nNumberOfAttitudePoints {len(lines)}\n"
        "ScenarioEpoch 1 Jan 2025 14:00:00.000000\nCentralBody Earth\nCoordinateAxes ICRF\n"
        "AttitudeTimeQuaternions\n" + "\n".join(lines) + "\nEND Attitude\n"
    )


def table():
    lines = [f"{time_s:.6f},{numbers(q).replace(' ', ',')}" for time_s, q in rows(Rotation.as_quat)]
    return "time_s,qx,qy,qz,qw\n" + "\n".join(lines) + "\n"


def inverse_quaternion(rotation):
    return rotation.inv().as_quat()


FILES = {
    "a2b.aem": aem("A2B"),
    "a2b-scalar-first.aem": aem("A2B", "FIRST"),
    "b2a.aem": aem("B2A", quaternion_of=inverse_quaternion),
    "scenario.a": stk(),
    "table.csv": table(),
}


@pytest.mark.parametrize("name", FILES)
def test_files_turn_a_target_as_they_say(scene, tmp_path, name):
    """A2B quaternions and STK's carry the reference axes to the body's: the same numbers as body -> reference."""
    (tmp_path / name).write_text(FILES[name])
    told = scene.replace(targets__1__attitude={"kind": "table", "file": str(tmp_path / name)})
    assert told.epoch_utc.startswith(EPOCH_UTC)
    times = np.array([0.0, 12.3, 800.0, 1614.0])
    seen = Rotation.from_quat(told.scenario.attitude_quaternion("sphere03", times))
    assert (seen * turned(times).inv()).magnitude().max() < PRINTED_RAD
    np.testing.assert_allclose(
        told.scenario.body_axis("sphere03", times), turned(times).apply([0, 0, 1]), rtol=0, atol=PRINTED_RAD
    )
    assert len(told.targets[1].attitude.checksum) == 64


def test_axes_of_j2000_differ_by_the_frame_bias(tmp_path):
    path = tmp_path / "j2000.aem"
    path.write_text(aem("A2B", frame="EME2000"))
    times = np.array([0.0, 700.0])
    seen = Rotation.from_quat(ws.AttitudeTable(file=str(path)).rows(ws.Scene.load("stss").epoch).at(times))
    longitude, obliquity, ascension = erfa.bi00()  # IERS Conventions 2003, section 5.6: small angles
    xi = longitude * np.sin(84381.448 * np.pi / 648000)
    bias = np.array([[1, ascension, -xi], [-ascension, 1, -obliquity], [xi, obliquity, 1]])  # GCRS -> J2000
    expected = turned(times).apply([1, 0, 0]) @ bias
    np.testing.assert_allclose(seen.apply([1, 0, 0]), expected, rtol=0, atol=PRINTED_RAD)
    assert np.abs(expected - turned(times).apply([1, 0, 0])).max() > 1e-8


def test_a_short_file_is_named_with_its_object_and_round_times(scene, tmp_path):
    """Seconds since the epoch of dates are 1e-12 s off, which nobody wants to read."""
    path = tmp_path / "short.aem"
    head, rest = aem("A2B").split("DATA_START\n")
    lines = [line for line in rest.splitlines(keepends=True) if date(0.0) <= line < date(1001.0)]
    head = head.replace(date(-50.0), date(0.0)).replace(date(LAST_S), date(1000.0))
    path.write_text(head + "DATA_START\n" + "".join(lines) + "DATA_STOP\n")
    table = ws.AttitudeTable(file=path).rows(scene.epoch)
    with pytest.raises(
        ws.InputError,
        match=rf"^{path}: MAIN: must cover the scene, 0 to 1614 s, got 0 to 1000 s \(2025-01-01T14:00:00\.000 to "
        r"2025-01-01T14:16:40\.000 UTC\)$",
    ):
        table.check_span(0.0, scene.duration_s)
    with pytest.raises(
        ws.InputError, match=r"MAIN: must be within the attitude table, 0 to 1000 s \(.* UTC\), got 1002"
    ):
        table.at([1002.0])
