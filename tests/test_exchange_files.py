"""Orbit and attitude files: what is read, what is refused, and what damage does to them."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from astropy.time import Time
from element_sets import iss
from exchange_samples import (
    AEM,
    AEM_XML,
    ATTITUDES,
    CSV,
    CSV_ATTITUDE,
    ECSV,
    EPHEMERIDES,
    OEM,
    OEM_XML,
    STK_A,
    STK_E,
    damaged,
    reader,
)
from scipy.spatial.transform import Rotation

import warpsim as ws
from warpsim.constants import EARTH_GM_M3_S2
from warpsim.exchange.instants import parse_dates
from warpsim.exchange.segments import plain_name
from warpsim.orbit.two_body import propagate_two_body
from warpsim.tables.text import unlike

EPOCH = Time("2025-03-20T12:00:00", scale="utc")
CLOCK_S = 2e-11  # rounding of seconds of a day
N_WOUND = 400

LEAP_EVE = Time("2016-12-31T23:59:30.123456789", scale="utc")  # half a minute before a leap second
POSITION_M, WRITTEN_S, SPEED_M_S = 1e-9, 1e-9, 2e-12  # the digits written: half a unit of the last, and rounding
KM_ROUNDING_M = 1e-9  # kilometres in float64 on the way
LIBRARY_M, LIBRARY_M_S, LIBRARY_S = 1e-8, 1e-11, 1e-6  # what the other packages keep


@pytest.fixture
def orbits(tmp_path):
    return reader(tmp_path, ws.read_ephemeris)


@pytest.fixture
def attitudes(tmp_path):
    return reader(tmp_path, ws.read_attitude)


def refused(read, text, name="x.txt"):
    """The error of a file, without its path."""
    with pytest.raises(ws.InputError) as caught:
        read(text, name)
    message = str(caught.value)
    assert "\n" not in message
    assert name in message
    return message.split(f"{name}: ", 1)[1]


def test_oem(orbits):
    one, two = orbits(OEM)
    assert (one.object_name, one.object_id, one.frame, one.time_system) == ("SAT ONE", "2025-001A", "EME2000", "UTC")
    assert (one.interpolation, one.degree) == ("hermite", 5)
    np.testing.assert_allclose(one.instants.since(EPOCH), [0, 60, 120, 180], rtol=0, atol=CLOCK_S)
    np.testing.assert_allclose(one.useable.since(EPOCH), [60, 120], rtol=0, atol=CLOCK_S)
    np.testing.assert_allclose(one.position_m[3], [6866e3, 1341e3, 178.8e3], rtol=1e-15)
    np.testing.assert_allclose(one.velocity_m_s[1], [-500, 7480, 990], rtol=1e-15)
    assert (one.line, one.lines.tolist()) == (6, [22, 23, 24, 25])
    assert (two.object_name, two.frame, two.interpolation, two.useable) == ("SAT/TWO", "ITRF", None, None)
    np.testing.assert_allclose(two.instants.since(EPOCH), [0, 60], rtol=0, atol=CLOCK_S)  # TAI is 37 s ahead
    np.testing.assert_allclose(two.velocity_m_s[0], [1e3, 2e3, 3e3], rtol=1e-15)


def test_oem_in_xml_is_the_same(orbits):
    (segment,) = orbits(OEM_XML)
    assert (segment.frame, segment.interpolation, segment.degree) == ("GCRF", "lagrange", 1)
    np.testing.assert_allclose(segment.instants.since(EPOCH), [0, 60], rtol=0, atol=CLOCK_S)  # GPS is 18 s ahead
    np.testing.assert_allclose(segment.position_m[1], [6985e3, 449e3, 60e3], rtol=1e-15)
    assert segment.lines.tolist() == [13, 18]
    wrapped = OEM_XML.replace("<oem ", "<ndm><oem ").replace("</oem>", "</oem></ndm>")
    assert len(orbits(wrapped)[0].instants) == 2


def test_object_is_chosen_by_name_number_or_plain_name(orbits):
    for name in ("SAT/TWO", "2025-001B", "SAT_TWO"):
        assert [s.object_name for s in orbits(OEM, object=name)] == ["SAT/TWO"]
    with pytest.raises(ws.InputError, match="object: must be one of SAT ONE, SAT/TWO, got 'three'"):
        orbits(OEM, object="three")


def test_stk_ephemeris(orbits):
    one, two = orbits(STK_E, "flyer.e")
    assert (one.object_name, one.frame, one.interpolation, one.degree) == ("flyer", "EME2000", "lagrange", 3)
    np.testing.assert_allclose(one.instants.since(EPOCH), [0, 60, 120], rtol=0, atol=CLOCK_S)
    np.testing.assert_allclose(two.instants.since(EPOCH), [120, 180], rtol=0, atol=CLOCK_S)
    assert (one.velocity_m_s[2, 1], two.velocity_m_s[0, 1]) == (7450.0, 7460.0)
    metres = STK_E.replace("DistanceUnit Kilometers", "").replace("Lagrange", "HERMITE")
    one, _ = orbits(metres, "flyer.e")
    assert (one.position_m[0, 0], one.interpolation, one.degree) == (7000.0, "hermite", 7)


def test_stk_without_velocities_or_with_accelerations(orbits):
    body = "stk.v.4.3\nBEGIN Ephemeris\nScenarioEpoch 20 Mar 2025 12:00:00\nCoordinateSystem Fixed\n{}\nEND Ephemeris\n"
    (segment,) = orbits(body.format("EphemerisTimePos\n0 7e6 0 0\n60 7e6 1 0"))
    assert (segment.velocity_m_s, segment.frame, segment.degree) == (None, "ITRF", 5)
    (segment,) = orbits(body.format("EphemerisTimePosVelAcc\n0 7e6 0 0 1 2 3 4 5 6\n60 7e6 1 0 1 2 3 4 5 6"))
    assert segment.velocity_m_s.shape == (2, 3)
    covered = "EphemerisTimePos\n0 7e6 0 0\n60 7e6 1 0\nCovarianceTimePosVel\n0 1 2 3"
    assert len(orbits(body.format(covered))[0].instants) == 2


def test_a_file_may_end_with_its_last_keyword(orbits, attitudes):
    """No line break is needed where nothing can have been cut off."""
    assert len(orbits(STK_E.rstrip("\n"))) == 2
    assert len(attitudes(STK_A.rstrip("\n"))) == len(attitudes(AEM.rstrip("\n"))) == 1
    assert len(orbits(OEM.replace("\n", "\r\n"))) == 2
    assert refused(orbits, STK_E.rstrip("s\n")).startswith("line 27: END: is not a known keyword")
    assert len(orbits(OEM.rstrip("\n"))) == 2 and len(orbits(CSV.rstrip("\n"))) == len(orbits(CSV))


def test_a_single_row_at_a_boundary_begins_a_segment(orbits):
    rows = STK_E.splitlines(keepends=True)
    text = "".join(row for i, row in enumerate(rows) if i != 23).replace("Points 5", "Points 4")
    one, two = orbits(text)
    assert [len(one.instants), len(two.instants)] == [2, 2]


def test_csv(orbits):
    one, two = orbits(CSV)
    assert (one.object_name, two.object_name, one.frame) == ("one", "two", "TEME")
    np.testing.assert_allclose(one.instants.since(EPOCH), [0, 60.5], rtol=0, atol=CLOCK_S)
    np.testing.assert_allclose(two.velocity_m_s[1], [-7480, -500, 990], rtol=1e-15)
    assert two.lines.tolist() == [4, 6]


def test_ecsv_has_units_and_a_frame(orbits):
    (segment,) = orbits(ECSV, "path.ecsv")
    assert (segment.object_name, segment.frame, segment.velocity_m_s) == ("path", "ITRF", None)
    assert segment.instants.relative
    np.testing.assert_allclose(segment.instants.since(EPOCH), [0, 60, 120], rtol=1e-15)
    np.testing.assert_allclose(segment.position_m[1], [6985e3, 449e3, 59.9e3], rtol=1e-15)


QUARTER = Rotation.from_euler("z", 90, degrees=True)


def test_aem_leads_from_reference_to_body(attitudes):
    """A frame B that stands a quarter turn about z ahead of A: the body's x axis is A's y axis."""
    (segment,) = attitudes(AEM)
    assert (segment.frame, segment.body_frame, segment.interpolation) == ("EME2000", "SC_BODY_1", "linear")
    body_x = Rotation.from_quat(segment.quaternion[0]).apply([1, 0, 0])
    np.testing.assert_allclose(body_x, [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(segment.instants.since(EPOCH), [0, 60], rtol=0, atol=CLOCK_S)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("A2B", "B2A"),
        ("REF_FRAME_A = EME2000\nREF_FRAME_B = SC_BODY_1", "REF_FRAME_A = SC_BODY_1\nREF_FRAME_B = EME2000"),
    ],
)
def test_aem_the_other_way_round_is_the_inverse(attitudes, old, new):
    (forth,), (back,) = attitudes(AEM), attitudes(AEM.replace(old, new))
    np.testing.assert_allclose(back.quaternion * [-1, -1, -1, 1], forth.quaternion, atol=1e-15)
    assert back.frame == "EME2000"


def test_aem_orders_and_rates(attitudes):
    first = AEM.replace("LAST", "FIRST").replace(
        "0.0 0.0 0.7071067811865476 0.7071067811865476", "0.7071067811865476 0.0 0.0 0.7071067811865476"
    ).replace("0.0 0.0 0.0 1.0", "1.0 0.0 0.0 0.0")  # fmt: skip
    np.testing.assert_array_equal(attitudes(first)[0].quaternion, attitudes(AEM)[0].quaternion)
    rates = AEM.replace("= QUATERNION\n", "= QUATERNION/RATE\n").replace("865476\n", "865476 1 2 3\n")
    rates = rates.replace("0 1.0\n", "0 1.0 4 5 6\n")
    np.testing.assert_array_equal(attitudes(rates)[0].quaternion, attitudes(AEM)[0].quaternion)


@pytest.mark.parametrize(("sequence", "upper"), [("ZXZ", "ZXZ"), ("321", "ZYX"), ("XYZ", "XYZ")])
def test_euler_angles_against_scipy(attitudes, sequence, upper):
    """scipy's capital letters turn about the axes as turned so far: body to reference."""
    text = AEM.replace("= QUATERNION\n", f"= EULER_ANGLE\nEULER_ROT_SEQ = {sequence}\n")
    text = text.replace("0.0 0.0 0.7071067811865476 0.7071067811865476", "10 -20 30")
    (segment,) = attitudes(text.replace("0.0 0.0 0.0 1.0", "200 40 -60"))
    expected = Rotation.from_euler(upper, [[10, -20, 30], [200, 40, -60]], degrees=True)
    angle = (Rotation.from_quat(segment.quaternion) * expected.inv()).magnitude()
    np.testing.assert_allclose(angle, 0, atol=1e-15)


def test_aem_in_xml(attitudes):
    (segment,) = attitudes(AEM_XML)
    assert (segment.frame, segment.body_frame) == ("GCRF", "SC_BODY_1")
    np.testing.assert_allclose(segment.quaternion, [[0, 0, -0.6, 0.8], [0, 0, 0, 1]], atol=1e-16)


def test_stk_and_csv_attitudes(attitudes):
    (segment,) = attitudes(STK_A, "turn.a")
    assert (segment.object_name, segment.frame) == ("turn", "GCRF")
    np.testing.assert_allclose(segment.quaternion, [[0, 0, 0.6, 0.8], [0, 0, 0, 1]], atol=1e-16)
    first = STK_A.replace("QuatAngVels", "QuatScalarFirst").replace(" 0.1 0.2 0.3", "")
    np.testing.assert_allclose(attitudes(first)[0].quaternion[0], [0, 0.6, 0.8, 0], atol=1e-16)
    (table,) = attitudes(CSV_ATTITUDE)
    np.testing.assert_array_equal(table.quaternion, segment.quaternion)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("CCSDS_OEM_VERS = 2.0", "CCSDS_OEM_VERS = 9.0", "line 1: CCSDS_OEM_VERS: must be 1.0 to 3.0, got '9.0'"),
        ("ORIGINATOR = TEST", "ORIGIN = TEST", "line 4: must be a keyword of the header or META_START"),
        ("CENTER_NAME = EARTH", "CENTER_NAME = MARS", "line 10: CENTER_NAME: must be EARTH, got 'MARS'"),
        ("CENTER_NAME = EARTH\n", "", "line 6: metadata: must have CENTER_NAME"),
        ("REF_FRAME = EME2000", "REF_FRAME = RTN", "line 11: REF_FRAME: must be one of GCRF, EME2000, ITRF, TEME"),
        ("REF_FRAME = EME2000", "REF_FRAMES = EME2000", "line 11: REF_FRAMES: is not a known keyword of the metadata"),
        ("TIME_SYSTEM = UTC", "TIME_SYSTEM = UT1", "line 12: TIME_SYSTEM: must be one of UTC, TAI, TT, TDB, GPS, got"),
        ("TIME_SYSTEM = UTC", "TIME_SYSTEM =", "line 12: TIME_SYSTEM: must have a value"),
        ("STOP_TIME = 2025-03-20T12:03:00.000", "STOP_TIME = 2025-03-20T12:13:00",
         "line 16: STOP_TIME: must be the time of the last row, which is 600 s before it (a file cut off?)"),
        ("INTERPOLATION = HERMITE", "INTERPOLATION = SPLINE", "line 17: INTERPOLATION: must be one of LINEAR, LAGR"),
        ("DEGREE = 5", "DEGREE = five", "line 18: INTERPOLATION_DEGREE: must be a whole number, got 'five'"),
        ("DEGREE = 5", "DEGREE = 50", "line 6: interpolation degree: must be 1 to 27, got 50"),
        ("12:02:00.000Z", "12:02:61.000Z", "line 24: must be a time of the day, got '2025-079T12:02:61.000Z'"),
        ("2025-079T12:02", "2025-379T12:02", "line 24: must be a day of the calendar"),
        ("2025-079T12:02", "2025-079T12:05", "line 25: time: must come after the time before it, got 120 s earlier"),
        ("2025-079T12:02", "2025-079T12:01", "line 24: time: must come after the time before it, got the same"),
        ("897.0", "nan", "line 24: must be a finite number, got 'nan'"),
        ("897.0", "8_97.0", "line 24: must be a finite number, got '8_97.0'"),
        ("449.0 59.9", "449.0", "line 23: must have 7 or 10 values (a date, position, velocity, and acceleration or "),
        ("6985.0", "6.985e12", "line 23: position: must be below 1e+12 m, got 6.985e+15"),
        ("7.48 0.99", "7.48 1e300", "line 23: velocity: must be below 2.99792e+08 m/s, got 1e+303"),
        ("COVARIANCE_STOP\n", "", "line 33: must come after COVARIANCE_STOP, got META_START"),
        ("USEABLE_STOP_TIME = 2025-03-20T12:02", "USEABLE_STOP_TIME = 2025-03-20T12:04", "line 6: useable span: must "),
        ("USEABLE_STOP_TIME = 2025-03-20T12:02", "USEABLE_STOP_TIME = 2025-03-20T12:00", "line 6: useable span: must "),
        ("0.97\n", "0.97\n2025-03-20T12:04:00.000 1 2 3\n", "line 26: must have 7 or 10 values"),
        ("= ITRF-97\n", "= TEME\nREF_FRAME_EPOCH = 2000-01-01T12:00:00\n",
         "line 39: REF_FRAME_EPOCH: must not be given, TEME is read as of date"),
    ],
)  # fmt: skip
def test_malformed_oem(orbits, old, new, message):
    assert old in OEM
    assert refused(orbits, OEM.replace(old, new, 1)).startswith(message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (OEM[: OEM.index("META_STOP")], "line 6: ends early: META_STOP must close what begins here"),
        (OEM[: OEM.index("COVARIANCE_STOP")], "line 27: ends early: COVARIANCE_STOP must close what begins here"),
        (OEM[: OEM.index("META_START")], "ends early: an OEM must have a segment"),
        (OEM[: OEM.index("\nCOMMENT states")], "line 6: segment: must hold data, got none"),
        (AEM, "line 1: must be an OEM, got an AEM"),
        (OEM_XML[: OEM_XML.index("</data>")], "line 23: XML: "),
        (OEM_XML.replace("<oem", "<omm").replace("</oem", "</omm"), "line 2: XML: must be an OEM, got <omm>"),
        (OEM_XML.replace('<X units="km">', '<X units="m">'), "line 15: X: must be in km or km/s or km/s**2, got 'm'"),
        (OEM_XML.replace("<Y>449.0</Y>", ""), "line 18: XML: must have <Y>"),
        (OEM_XML.replace("449.0", "449.0.0"), "line 18: must be a finite number, got '449.0.0'"),
        (OEM_XML.replace("<oem", "<!DOCTYPE oem [<!ENTITY a 'b'>]><oem"), "line 2: XML: must have no document type"),
        (STK_E.replace("Points 5", "Points 6"), "line 6: NumberOfEphemerisPoints: must be the number of rows, 5, got "),
        (STK_E.replace("END Ephemeris\n", ""), "line 4: ends early: END Ephemeris must close what begins here"),
        (STK_E.replace("Lagrange", "LagrangeVOP"), "line 8: InterpolationMethod: must be Lagrange, Hermite or Great"),
        (STK_E.replace("J2000", "MeanOfEpoch"), "line 12: CoordinateSystem: must be one of ICRF, J2000, Fixed, TEMEOf"),
        (STK_E.replace("Earth", "Moon"), "line 11: CentralBody: must be Earth, got 'Moon'"),
        (STK_E.replace("Kilometers", "Feet"), "line 10: DistanceUnit: must be Meters or Kilometers, got 'Feet'"),
        (STK_E.replace("20 Mar", "20 Foo"), "line 7: ScenarioEpoch: must have a month like Jan"),
        (STK_E.replace("Method ", "Methods "), "line 8: InterpolationMethods: is not a known keyword"),
        (STK_E.replace("TimePosVel", "GrazingTimePos"), "line 19: EphemerisGrazingTimePos: must be one of Ephe"),
        (STK_E.replace("449.0 59.9", "449.0"), "line 22: must have 7 values (EphemerisTimePosVel) as the line before"),
        (STK_E.replace("    120.0\n", ""), "line 23: time: must come after the time before it, got the same"),
        (STK_E.replace("SamplesM1   3", "SamplesM1   0"), "line 9: InterpolationSamplesM1: must be 1 to 27, got 0"),
        (STK_A, "must have the line BEGIN Ephemeris, got none"),
        (CSV.replace("y_km", "why_km", 1), "must have all of x_m, y_m, z_m or all of x_km, y_km, z_km, got x_km, z_km"),
        (CSV.replace("time_utc", "when"), "must have one of the columns time_s (since the scene's epoch) and time_utc"),
        (CSV.replace("12:01:00.5", "25:01:00.5"), "line 5: time_utc: must be a time of the day"),
        (CSV.replace("449.0", "", 1), "line 5: position_m: must be finite, got [6985000.0, nan, 59900.0]"),
        (CSV.replace("TEME", "LUNAR"), "frame: must be one of GCRF, "),
        (CSV.replace("one,", ",", 1), "line 3: name: must not be empty"),
        (CSV_ATTITUDE, "must have columns of position (x_m, y_m, z_m or x_km, y_km, z_km), got time_s, qx"),
        ("time_s,x_m,y_m,z_m\n", "must hold at least one row, got none"),
        ("hello world\n", "must hold at least one row, got none"),
        (" \n", "must hold data, got an empty file"),
        (b"\x89PNG\r\n\x1a\n\x00", "must be text, got a PNG image"),
        (b"PK\x03\x04 and so on", "must be text, got a ZIP archive"),
        (b"<!DOCTYPE html><html></html>", "must be text, got a web page (a download that failed?)"),
        (b"time_s\0,x_m", "must be text, got binary data"),
        (b"\x1f\x8b\x08\x00 damaged", "ends early: the gzip data are cut off"),
    ],
)  # fmt: skip
def test_malformed_orbit_files(orbits, text, message):
    got = refused(orbits, text)
    assert got.startswith(message), got


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (AEM.replace("DATA_STOP\n", ""), "line 19: ends early: DATA_STOP must close what begins here"),
        (AEM.replace("DATA_START\n", ""), "line 20: must be DATA_START, got '2025"),
        (AEM.replace("ATTITUDE_DIR = A2B\n", ""), "line 4: metadata: must have ATTITUDE_DIR"),
        (AEM.replace("A2B", "AB"), "line 10: ATTITUDE_DIR: must be A2B or B2A, got 'AB'"),
        (AEM.replace("QUATERNION_TYPE = LAST\n", ""), "line 4: metadata: must have QUATERNION_TYPE"),
        (AEM.replace("= LAST", "= MIDDLE"), "line 15: QUATERNION_TYPE: must be FIRST or LAST, got 'MIDDLE'"),
        (AEM.replace("= QUATERNION\n", "= SPIN\n"), "line 14: ATTITUDE_TYPE: must be one of QUATERNION, QUATERNION/DE"),
        (AEM.replace("= EME2000", "= SUN"), "line 8: REF_FRAME_A, REF_FRAME_B: must be a frame of the Earth or the sk"),
        (AEM.replace("= SC_BODY_1", "= LVLH"), "line 9: REF_FRAME: must not be an orbit's frame, got 'LVLH'"),
        (AEM.replace("0.0 0.0 0.0 1.0", "0.0 0.0 0.0 1.1"), "line 22: quaternion: must have norm 1, got 1.1"),
        (AEM.replace("0.0 0.0 0.0 1.0", "0.0 0.0 1.0"), "line 22: must have 5 values"),
        (AEM.replace("= QUATERNION\n", "= EULER_ANGLE\n"), "line 4: metadata: must have EULER_ROT_SEQ"),
        (OEM, "line 1: must be an AEM, got an OEM"),
        (AEM_XML.replace("<Q2>0.0</Q2>", "", 1), "line 10: XML: must have <Q2>"),
        (STK_A.replace("Points 2", "Points 3"), "line 3: NumberOfAttitudePoints: must be the number of rows, 2, got 3"),
        (STK_A.replace("ICRF", "VVLH"), "line 8: CoordinateAxes: must be one of ICRF, J2000, Fixed"),
        (STK_A.replace("QuatAngVels", "AngVels"), "line 9: AttitudeTimeAngVels: must be one of AttitudeTimeQu"),
        (CSV_ATTITUDE.replace("qw", "q4"), "must have the column qw, got time_s, qx, qy, qz, q4"),
        (CSV_ATTITUDE.replace("0.8", "0.9"), "line 2: quaternion: must have norm 1, got 1.08167"),
        (CSV, "must have columns of attitude (qx, qy, qz, qw), got name, time_utc"),
    ],
)  # fmt: skip
def test_malformed_attitude_files(attitudes, text, message):
    got = refused(attitudes, text)
    assert got.startswith(message), got


@pytest.mark.parametrize("name", EPHEMERIDES)
@pytest.mark.filterwarnings("ignore")
@pytest.mark.ci
def test_damaged_orbit_files_are_read_or_refused_in_one_line(orbits, name):
    check_damage(orbits, EPHEMERIDES[name], name)


@pytest.mark.parametrize("name", ATTITUDES)
@pytest.mark.filterwarnings("ignore")
@pytest.mark.ci
def test_damaged_attitude_files_are_read_or_refused_in_one_line(attitudes, name):
    check_damage(attitudes, ATTITUDES[name], name)


def check_damage(read, text, name):
    messages = []
    for seed in range(N_WOUND):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                segments = read(damaged(text, seed), "x." + name)
        except ws.InputError as error:
            messages.append(str(error))
            continue
        for segment in segments:
            value = segment.position_m if hasattr(segment, "position_m") else segment.quaternion
            assert np.isfinite(value).all()
            assert (segment.instants.steps_s() > 0).all()
    assert N_WOUND // 4 < len(messages) < N_WOUND
    assert not [message for message in messages if "\n" in message or f"x.{name}: " not in message]


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(ws.InputError, match="must be a file, got a folder"):
        ws.read_ephemeris(tmp_path)
    with pytest.raises(ws.InputError, match="cannot be read: No such file"):
        ws.read_attitude(tmp_path / "no.aem")


@pytest.mark.parametrize("system", ["utc", "tai", "tt", "tdb"])
def test_dates_against_astropy(system):
    texts = ["2016-12-31T23:59:59.123456789", "2025-03-20T12:00:00.000000001", "1999-07-04T06:07:08.25"]
    got = parse_dates(texts, system.upper())
    for row, text in enumerate(texts):
        expected = Time(text, scale=system, format="isot")
        assert abs(got[row].since(expected)[0]) < 1e-9 / 20
    assert got.dates(system.upper()) == [f"{text:0<29}" for text in texts]


def test_leap_second_and_day_of_year():
    before, leap, after = (
        parse_dates([text], "UTC")
        for text in ("2016-12-31T23:59:59.5", "2016-366T23:59:60.5Z", "2017-01-01T00:00:00.5")
    )
    assert leap.since_instant(before)[0] == pytest.approx(1.0, abs=CLOCK_S, rel=0)
    assert after.since_instant(leap)[0] == pytest.approx(1.0, abs=CLOCK_S, rel=0)
    assert leap.dates("UTC") == ["2016-12-31T23:59:60.500000000"]
    gps = parse_dates(["1980-01-06T00:00:00"], "GPS")
    assert gps.dates("UTC") == ["1980-01-06T00:00:00.000000000"]
    assert gps.dates("GPS") == ["1980-01-06T00:00:00.000000000"]


TLE = "\n".join(["ISS (ZARYA)", *iss("25152.00000000"), ""])


@pytest.mark.parametrize(
    "text", [TLE, TLE.split("\n", 1)[1], TLE.replace("\n", "\r\n"), "EPOCH,MEAN_MOTION\n2025,15.5\n"]
)
def test_element_sets_are_told_from_states(orbits, attitudes, text):
    assert refused(orbits, text) == "must hold states, got element sets, which TleOrbit and TleSatellites read"
    assert refused(attitudes, text).startswith("must hold attitudes, got element sets")
    with pytest.raises(ws.InputError, match="must have columns of position"):
        orbits("a,b\n1,2\n")


@pytest.mark.parametrize("big", ["1e308", "-1e308", "1e200"])
def test_huge_numbers_are_refused_without_warnings(orbits, attitudes, recwarn, big):
    for read, text, number in (
        (orbits, OEM, "6940.0"),
        (orbits, STK_E, "6.985e+003"),
        (orbits, CSV, "7000.0"),
        (orbits, ECSV, "6985.0"),
        (attitudes, AEM, "0.7071067811865476"),
    ):
        assert number in text
        assert re.search("must (be|have)", refused(read, text.replace(number, big, 1)))
    assert not recwarn.list


def test_times_that_files_cannot_tell_apart_are_one(orbits):
    rows = "time_s,x_m,y_m,z_m\n0,7e6,0,0\n{},7e6,1,0\n60,7e6,2,0\n"
    assert "line 3: time: must come after the time before it, got the same" in refused(orbits, rows.format("1e-310"))
    assert len(orbits(rows.format("1e-9"))[0].instants) == 3


def test_an_object_has_one_name_in_all_formats(orbits, tmp_path):
    (tmp_path / "x.oem").write_text(OEM.replace("SAT ONE", "ISS (ZARYA)"))
    satellites = ws.EphemerisSatellites(tmp_path / "x.oem")
    assert satellites.names[0] == ws.TleSatellites(lines=TLE.splitlines()).names[0] == "ISS_ZARYA"


def test_names():
    assert [plain_name(n) for n in ("SAT/TWO", "(a b)", "été", "///", "x-1.2_3")] == [
        "SAT_TWO", "a_b", "t", "object", "x-1.2_3"
    ]  # fmt: skip
    assert unlike(map(plain_name, ["a b", "a/b", "a_b", "c"])) == ["a_b", "a_b_2", "a_b_3", "c"]


def states():
    """A low orbit, in steps of 30 s over the leap second."""
    time_s = np.arange(0.0, 300.0, 30.0)
    radius_m = 7.0e6
    speed_m_s = np.sqrt(EARTH_GM_M3_S2 / radius_m)
    r, v = propagate_two_body(np.array([[radius_m, 0.0, 0.0]]), speed_m_s * np.array([[0.0, 0.6, 0.8]]), time_s)
    return time_s, r[:, 0], v[:, 0]


@pytest.fixture
def segment():
    time_s, position_m, velocity_m_s = states()
    return ws.EphemerisSegment.of_states(
        "SAT ONE", LEAP_EVE, time_s, position_m, velocity_m_s, object_id="2016-001A", frame="EME2000",
        interpolation="hermite", degree=7,
    )  # fmt: skip


def assert_same(got, expected):
    assert got.frame == expected.frame
    seconds = np.abs(got.instants.since(LEAP_EVE) - expected.instants.since(LEAP_EVE))
    assert seconds.max() < WRITTEN_S
    assert np.abs(got.position_m - expected.position_m).max() < POSITION_M + KM_ROUNDING_M
    assert np.abs(got.velocity_m_s - expected.velocity_m_s).max() < SPEED_M_S


@pytest.mark.parametrize("system", ["UTC", "TAI", "TT", "TDB", "GPS"])
def test_oem_round_trip(tmp_path, segment, system):
    time_s, position_m, velocity_m_s = states()
    again = ws.EphemerisSegment.of_states(
        "b", LEAP_EVE, time_s, position_m, velocity_m_s, frame="ITRF", time_system=system
    )
    ws.write_oem(tmp_path / "x.oem", [segment, again], creation_date="2025-01-01T00:00:00")
    one, two = ws.read_ephemeris(tmp_path / "x.oem")
    assert (one.object_name, one.object_id, one.interpolation, one.degree) == ("SAT ONE", "2016-001A", "hermite", 7)
    assert (two.object_name, two.object_id, two.time_system, two.interpolation) == ("b", "UNKNOWN", system, None)
    assert_same(one, segment)
    assert_same(two, again)


def test_oem_of_a_file_with_a_useable_span(tmp_path):
    (tmp_path / "a.oem").write_text(OEM)
    segments = ws.read_ephemeris(tmp_path / "a.oem")
    ws.write_oem(tmp_path / "b.oem", segments)
    for got, expected in zip(ws.read_ephemeris(tmp_path / "b.oem"), segments, strict=True):
        assert_same(got, expected)
        assert (got.useable is None) == (expected.useable is None)
    useable = ws.read_ephemeris(tmp_path / "b.oem")[0].useable
    np.testing.assert_allclose(useable.since_instant(segments[0].instants[0]), [60.0, 120.0], rtol=0, atol=WRITTEN_S)


def test_oem_read_by_the_package_oem(tmp_path, segment):
    """An independent reader that checks the standard's rules."""
    oem = pytest.importorskip("oem")
    ws.write_oem(tmp_path / "x.oem", segment)
    message = oem.OrbitEphemerisMessage.open(tmp_path / "x.oem")
    (part,) = message.segments
    assert part.metadata["OBJECT_NAME"] == "SAT ONE"
    assert part.metadata["REF_FRAME"] == "EME2000"
    found = list(part.states)
    assert len(found) == len(segment.instants)
    for row, state in enumerate(found):
        assert np.abs(np.asarray(state.position) * 1e3 - segment.position_m[row]).max() < LIBRARY_M
        assert np.abs(np.asarray(state.velocity) * 1e3 - segment.velocity_m_s[row]).max() < LIBRARY_M_S
        assert abs(segment.instants[row].since(state.epoch)[0]) < LIBRARY_S


def test_oem_written_by_the_package_oem_is_read(tmp_path, segment):
    oem = pytest.importorskip("oem")
    ws.write_oem(tmp_path / "x.oem", segment)
    oem.OrbitEphemerisMessage.open(tmp_path / "x.oem").save_as(tmp_path / "x.xml", file_format="xml")
    (got,) = ws.read_ephemeris(tmp_path / "x.xml")
    assert np.abs(got.position_m - segment.position_m).max() < 1e-3  # the package prints metres with few digits
    assert np.abs(got.instants.since(LEAP_EVE) - segment.instants.since(LEAP_EVE)).max() < LIBRARY_S


@pytest.mark.ci
def test_oem_read_by_the_package_ccsds_ndm(tmp_path, segment):
    ndm_io = pytest.importorskip("ccsds_ndm.ndm_io")
    ws.write_oem(tmp_path / "x.oem", segment)
    rows = ndm_io.NdmIo().from_path(tmp_path / "x.oem").body.segment[0].data.state_vector
    for row, state in enumerate(rows):
        assert float(state.x.value) * 1e3 == pytest.approx(segment.position_m[row, 0], abs=LIBRARY_M, rel=0)


def test_aem_through_the_package_ccsds_ndm(tmp_path):
    """It reads AEM 1.0, which has two keywords more, and writes it as XML."""
    ndm_io = pytest.importorskip("ccsds_ndm.ndm_io")
    (tmp_path / "a.aem").write_text(AEM)
    (expected,) = ws.read_attitude(tmp_path / "a.aem")
    ws.write_aem(tmp_path / "b.aem", expected)
    text = (tmp_path / "b.aem").read_text().replace("AEM_VERS = 2.0", "AEM_VERS = 1.0")
    text = text.replace("= QUATERNION\n", "= QUATERNION\nATTITUDE_DIR = A2B\nQUATERNION_TYPE = LAST\n")
    (tmp_path / "c.aem").write_text(text)
    message = ndm_io.NdmIo().from_path(tmp_path / "c.aem")
    meta = message.body.segment[0].metadata
    assert (meta.ref_frame_a, meta.ref_frame_b, meta.object_name) == ("EME2000", "SC_BODY_1", "SAT ONE")
    ndm_io.NdmIo().to_file(message, ndm_io.NDMFileFormats.XML, tmp_path / "d.xml")
    (got,) = ws.read_attitude(tmp_path / "d.xml")
    np.testing.assert_allclose(got.quaternion, expected.quaternion, rtol=0, atol=1e-15)


@pytest.mark.parametrize("has_velocity", [True, False])
def test_stk_round_trip(tmp_path, segment, has_velocity):
    time_s, position_m, velocity_m_s = states()
    velocity = velocity_m_s if has_velocity else None
    expected = ws.EphemerisSegment.of_states("x", LEAP_EVE, time_s, position_m, velocity, frame="TEME")
    ws.write_stk_ephemeris(tmp_path / "x.e", expected)
    (got,) = ws.read_ephemeris(tmp_path / "x.e")
    assert (got.object_name, got.frame) == ("x", "TEME")
    assert (got.interpolation, got.degree) == (("hermite", 7) if has_velocity else ("lagrange", 7))
    assert np.abs(got.instants.since(LEAP_EVE) - time_s).max() < WRITTEN_S
    assert np.abs(got.position_m - position_m).max() < POSITION_M
    if has_velocity:
        assert np.abs(got.velocity_m_s - velocity_m_s).max() < SPEED_M_S


@pytest.mark.parametrize("gap_s", [0.0, 7.0])
def test_stk_segments_round_trip(tmp_path, gap_s):
    time_s, position_m, velocity_m_s = states()
    first = ws.EphemerisSegment.of_states("x", LEAP_EVE, time_s, position_m, velocity_m_s)
    then = ws.EphemerisSegment.of_states("x", LEAP_EVE, time_s[-1] + gap_s + time_s, position_m, velocity_m_s + 1.0)
    ws.write_stk_ephemeris(tmp_path / "x.e", [first, then])
    for got, expected in zip(ws.read_ephemeris(tmp_path / "x.e"), (first, then), strict=True):
        assert_same(got, expected)


def test_attitude_round_trips(tmp_path):
    (tmp_path / "a.aem").write_text(AEM)
    (expected,) = ws.read_attitude(tmp_path / "a.aem")
    ws.write_aem(tmp_path / "b.aem", expected)
    ws.write_stk_attitude(tmp_path / "b.a", expected)
    for name in ("b.aem", "b.a"):
        (got,) = ws.read_attitude(tmp_path / name)
        assert got.frame == expected.frame
        np.testing.assert_allclose(got.quaternion, expected.quaternion, rtol=0, atol=1e-16)
        assert np.abs(got.instants.since_instant(expected.instants[0]) - [0.0, 60.0]).max() < WRITTEN_S


def test_what_cannot_be_written_leaves_nothing(tmp_path, segment):
    (tmp_path / "r.ecsv").write_text(ECSV)
    (relative,) = ws.read_ephemeris(tmp_path / "r.ecsv")
    with pytest.raises(ws.InputError, match=r"x.oem: r: must have velocities to be written as an OEM"):
        ws.write_oem(tmp_path / "x.oem", relative)
    with pytest.raises(ws.InputError, match="times: must be instants to be written as dates, got seconds since"):
        ws.write_stk_ephemeris(tmp_path / "x.e", relative)
    (tmp_path / "r.csv").write_text(CSV_ATTITUDE)
    with pytest.raises(ws.InputError, match="times: must be instants"):
        ws.write_aem(tmp_path / "x.aem", ws.read_attitude(tmp_path / "r.csv"))
    with pytest.raises(ws.InputError, match="segments: must be one at least, got none"):
        ws.write_oem(tmp_path / "x.oem", [])
    with pytest.raises(ws.InputError, match="segments: must follow each other in time"):
        ws.write_stk_ephemeris(tmp_path / "x.e", [segment, segment])
    with pytest.raises(ws.InputError, match="names: must be printable ASCII text, got 'été'"):
        ws.write_oem(tmp_path / "x.oem", segment, originator="été")
    with pytest.raises(ws.InputError, match=r"x.oem: cannot be written: .*no is not a folder"):
        ws.write_oem(tmp_path / "no" / "x.oem", segment)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["r.csv", "r.ecsv"]


def test_existing_files_are_kept(tmp_path, segment):
    (tmp_path / "a.aem").write_text(AEM)
    attitude = ws.read_attitude(tmp_path / "a.aem")
    path = tmp_path / "x.x"
    for write, what in (
        (ws.write_oem, [segment]),
        (ws.write_aem, attitude),
        (ws.write_stk_ephemeris, segment),
        (ws.write_stk_attitude, attitude[0]),
    ):
        path.write_text("mine")
        with pytest.raises(ws.InputError, match=r"x.x: is there already; choose another name, .* \(overwrite=True\)$"):
            write(path, what)
        assert path.read_text() == "mine"
        write(path, what, overwrite=True)
        assert len(path.read_text()) > 100
        path.unlink()
        write(path, what)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frame": "RTN"}, "frame: must be one of GCRF"),
        ({"time_system": "UT1"}, "time_system: must be one of UTC"),
        ({"velocity_m_s": None, "interpolation": "hermite"}, "interpolation: must not be Hermite for states without"),
        ({"degree": 0}, "interpolation degree: must be 1 to 27, got 0"),
        ({"time_s": np.zeros(10)}, "row 1: time: must come after the time before it, got the same"),
        ({"position_m": np.zeros((9, 3))}, r"position_m: must have shape \(10, 3\), got \(9, 3\)"),
    ],
)
def test_records_are_checked(change, message):
    time_s, position_m, velocity_m_s = states()
    given = {"time_s": time_s, "position_m": position_m, "velocity_m_s": velocity_m_s} | change
    with pytest.raises(ws.InputError, match=message):
        ws.EphemerisSegment.of_states("x", LEAP_EVE, **given)
