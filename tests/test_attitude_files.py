"""Attitude files of other programs, through the readers, into a scene."""

import erfa
import numpy as np
import pytest
from exchange_samples import AEM_XML
from scipy.spatial.transform import Rotation

import warpsim as ws

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


SEQUENCES = {
    "AttitudeTimeEulerAngles": [a + b + c for a in "123" for b in "123" for c in "123" if a != b != c],
    "AttitudeTimeYPRAngles": ["123", "132", "213", "231", "312", "321"],
}
ANGLES_DEG = [[10.0, -20.0, 30.0], [200.0, 40.0, -70.0]]


def stk_file(tmp_path, data, lines, keywords=""):
    """The layout of STK's examples, with tabs among its blanks."""
    path = tmp_path / "scenario.a"
    path.write_text(
        f"stk.v.5.0\nBEGIN Attitude\nNumberOfAttitudePoints\t\t{len(lines)}\n    BlockingFactor          20\n"
        f"    InterpolationOrder      1\nCentralBody\t\t\tEarth\nScenarioEpoch\t\t\t1 Jul 2005 12:00:00.00\n"
        f"CoordinateAxes\t\tJ2000\n{keywords}{data}\n" + "\n".join(lines) + " \nEND Attitude\n"
    )
    return path


def elementary(axis, angle_deg):
    """The matrix that takes components in axes to those in axes turned about one of them (Wertz, appendix E)."""
    s, c = np.sin(np.radians(angle_deg)), np.cos(np.radians(angle_deg))
    return {"1": np.array([[1, 0, 0], [0, c, s], [0, -s, c]]), "2": np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]),
            "3": np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])}[axis]  # fmt: skip


def same_turn(quaternion, to_body):
    """Whether a quaternion takes body components to those that a matrix takes to the body."""
    return np.abs(Rotation.from_quat(quaternion).as_matrix() - to_body.T).max() < PRINTED_RAD


@pytest.mark.parametrize(("data", "sequence"), [(data, one) for data in SEQUENCES for one in (*SEQUENCES[data], None)])
def test_angles_of_stk_are_turns_about_the_body_or_the_reference(tmp_path, data, sequence):
    """Euler's stand in the order of the turns, about axes turned so far; yaw, pitch and roll always so, about fixed."""
    lines = [f"{60.0 * k:.4f} " + " ".join(f"{angle:9.3f}" for angle in row) for k, row in enumerate(ANGLES_DEG)]
    path = stk_file(tmp_path, data, lines, f"Sequence                {sequence}\n" if sequence else "")
    (segment,) = ws.read_attitude(path)
    for row, quaternion in zip(ANGLES_DEG, segment.quaternion, strict=True):
        to_body = np.eye(3)
        if data == "AttitudeTimeEulerAngles":
            for axis, angle in zip(sequence or "313", row, strict=True):
                to_body = elementary(axis, angle) @ to_body
        else:
            for axis in sequence or "321":
                to_body = to_body @ elementary(axis, row["321".index(axis)])
        assert same_turn(quaternion, to_body)


def test_yaw_pitch_and_roll_of_a_steady_turn(tmp_path):
    """Rows of a published file of sequence 231, which change branch but are 6 deg/s about z."""
    rows = [(0, 0, 0, 0), (5, 30, 0, 0), (15, 90, -0.0, 0), (20, 60, 180, -180), (35, -30, 180, -180), (45, -90, 0, 0)]
    lines = ["{:10.4f} {:12.3f} {:14.3f} {:13.3f}".format(*row) for row in rows]
    (segment,) = ws.read_attitude(stk_file(tmp_path, "AttitudeTimeYPRAngles", lines, "Sequence 231\n"))
    for (time_s, *_), quaternion in zip(rows, segment.quaternion, strict=True):
        assert same_turn(quaternion, elementary("3", 6.0 * time_s))


@pytest.mark.parametrize("rates", ["", " 0.1 0.2 0.3"])
def test_matrices_of_stk_have_the_body_s_axes_as_rows(tmp_path, rates):
    """The published example's matrix, and its transpose, which is not the same turn."""
    numbers = ("0.45959131992578 0.65939233328195 0.59496014106650 -0.09650521823583 -0.62885739983663 "
               "0.77150833665228 0.88287176956914 -0.41199529303100 -0.22538260140960")  # fmt: skip
    data = "AttitudeTimeDCMAngVels" if rates else "AttitudeTimeDCM"
    lines = [f"{time_s}.00e+000 {numbers}{rates}" for time_s in (0, 60, 120)]
    (segment,) = ws.read_attitude(stk_file(tmp_path, data, lines, "AttitudeDeviations Mild\n"))
    to_body = np.array(numbers.split(), float).reshape(3, 3)
    assert all(same_turn(quaternion, to_body) for quaternion in segment.quaternion)
    assert not same_turn(segment.quaternion[0], to_body.T)
    assert (segment.rate_rad_s is None) == (not rates)
    if rates:
        np.testing.assert_allclose(segment.rate_rad_s, np.radians([[0.1, 0.2, 0.3]] * 3), rtol=1e-15)


@pytest.mark.parametrize("numbers", ["0 1 0 1 0 0 0 0 1", "1 0 0 0 1 0 0 0 1.01", "0 0 0 0 0 0 0 0 0", "1e300 " * 9])
def test_matrices_that_are_no_rotation_are_refused(tmp_path, numbers):
    path = stk_file(tmp_path, "AttitudeTimeDCM", ["0.0 1 0 0 0 1 0 0 0 1", f"60.0 {numbers}"])
    with pytest.raises(ws.InputError, match=r"line 11: AttitudeTimeDCM: must be the matrix of a rotation$"):
        ws.read_attitude(path)


@pytest.mark.parametrize(
    "data", ["AngVels", "EulerAngleRates", "EulerAnglesAndRates", "YPRAngleRates", "YPRAnglesAndRates", "ECIVector",
             "ECFVector", "AzElAngles"],
)  # fmt: skip
def test_what_is_not_read_of_stk_is_named(tmp_path, data):
    with pytest.raises(ws.InputError, match=rf"line 9: AttitudeTime{data}: must be one of AttitudeTimeQuaternions, "):
        ws.read_attitude(stk_file(tmp_path, f"AttitudeTime{data}", ["0.0 1 0 0"]))


@pytest.mark.parametrize(("data", "sequence"), [("YPRAngles", "313"), ("YPRAngles", "12"), ("EulerAngles", "331")])
def test_sequences_that_are_none_are_named(tmp_path, data, sequence):
    path = stk_file(tmp_path, f"AttitudeTime{data}", ["0.0 1 0 0"], f"Sequence {sequence}\n")
    with pytest.raises(ws.InputError, match=rf"line 9: Sequence: must be three axes like .*321, got '{sequence}'"):
        ws.read_attitude(path)


@pytest.mark.parametrize(
    "kind", ["SPIN", "SPIN/NUTATION", "SPIN/NUTATION_MOM", "EULER_ANGLE/RATE", "EULER_ANGLE/DERIVATIVE",
             "EULER_ANGLE/ANGVEL"],
)  # fmt: skip
@pytest.mark.parametrize("xml", [False, True])
def test_attitude_types_of_aem_that_are_not_read_are_named(tmp_path, kind, xml):
    """All of CCSDS 504.0-B-1 and B-2 but for quaternions and Euler angles."""
    text = AEM_XML.replace("Q1>", "SPIN_ALPHA>") if xml else aem("A2B")
    (tmp_path / "x.aem").write_text(text.replace("QUATERNION\n", f"{kind}\n").replace("QUATERNION<", f"{kind}<"))
    with pytest.raises(
        ws.InputError, match=rf"x.aem: line \d+: .*(ATTITUDE_TYPE: .*got '|got ATTITUDE_TYPE ){kind}'?$"
    ):
        ws.read_attitude(tmp_path / "x.aem")
