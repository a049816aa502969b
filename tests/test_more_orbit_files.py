"""States of OPM, OCM, SP3, SPK and MEME text files, written by hand in their exact layout."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
from astropy.time import Time
from element_sets import iss
from exchange_samples import reader
from jplephem.daf import DAF
from jplephem.spk import SPK

import warpsim as ws
from warpsim.instant import utc_time

EPOCH = "2025-03-20T12:00:00"
MU = 3.986004418e14
CLOCK_S = 1e-9
SERIES_M = 5e-3  # of a Chebyshev series of degree 9 over 300 s, and of times of 1e-7 s; measured 1e-3
JULIAN_M = 0.5  # jplephem's begin of a series is a Julian date of 4e-5 s, of 7.5 km/s

OPM = """CCSDS_OPM_VERS = 2.0
COMMENT made by hand
CREATION_DATE = 2025-03-20T00:00:00
ORIGINATOR = ME
OBJECT_NAME = SAT ONE
OBJECT_ID = 2025-001A
CENTER_NAME = EARTH
REF_FRAME = GCRF
TIME_SYSTEM = UTC
EPOCH = 2025-03-20T12:00:00
X = 7000.0 [km]
Y = 0.0 [km]
Z = 0.0 [km]
X_DOT = 0.0 [km/s]
Y_DOT = 6.0 [km/s]
Z_DOT = 4.5 [km/s]
MASS = 100.0 [kg]
"""

OCM = """CCSDS_OCM_VERS = 3.0
CREATION_DATE = 2025-03-20T00:00:00
ORIGINATOR = ME
META_START
OBJECT_NAME = SAT ONE
INTERNATIONAL_DESIGNATOR = 2025-001A
TIME_SYSTEM = UTC
EPOCH_TZERO = 2025-03-20T12:00:00
META_STOP
TRAJ_START
COMMENT relative times
CENTER_NAME = EARTH
TRAJ_REF_FRAME = EME2000
TRAJ_TYPE = CARTPV
INTERPOLATION = HERMITE
INTERPOLATION_DEGREE = 5
0.0 7000.0 0.0 0.0 0.0 6.0 4.5
60.0 6985.0 360.0 270.0 -0.5 6.0 4.4
TRAJ_STOP
TRAJ_START
CENTER_NAME = EARTH
TRAJ_REF_FRAME = ITRF
TRAJ_TYPE = CARTP
2025-03-20T12:02:00 7000.0 0.0 0.0
2025-03-20T12:03:00 7001.0 2.0 3.0
TRAJ_STOP
"""


@pytest.fixture
def read(tmp_path):
    return reader(tmp_path, ws.read_ephemeris)


def test_the_state_of_an_opm_flies_freely(read, tmp_path):
    (segment,) = read(OPM, "x.opm")
    assert (segment.object_name, segment.object_id, segment.frame) == ("SAT ONE", "2025-001A", "GCRF")
    orbit = ws.EphemerisOrbit(tmp_path / "x.opm")
    free = ws.StateVector(position_m=[7e6, 0, 0], velocity_m_s=[0, 6e3, 4.5e3])
    time_s = np.array([-600.0, 0.0, 5000.0])
    for one, other in zip(orbit.states(utc_time(EPOCH), time_s), free.states(utc_time(EPOCH), time_s), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-5)
    (note,) = orbit.notes(utc_time(EPOCH), 5000.0)
    assert note.endswith("SAT_ONE: one state, at 0 s (2025-03-20T12:00:00.000), from which it flies freely with J2")


def test_trajectories_of_an_ocm(read):
    one, two = read(OCM)
    assert (one.object_name, one.object_id, one.frame, one.degree) == ("SAT ONE", "2025-001A", "EME2000", 5)
    np.testing.assert_allclose(one.instants.since(utc_time(EPOCH)), [0.0, 60.0], rtol=0, atol=CLOCK_S)
    assert one.velocity_m_s.tolist() == [[0.0, 6000.0, 4500.0], [-500.0, 6000.0, 4400.0]]
    assert two.frame == "ITRF" and two.velocity_m_s is None
    np.testing.assert_allclose(two.instants.since(utc_time(EPOCH)), [120.0, 180.0], rtol=0, atol=CLOCK_S)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (OPM.replace("X_DOT = 0.0 [km/s]\n", ""), "X_DOT: is required"),
        (OPM.replace("EARTH", "MOON"), "line 7: CENTER_NAME: must be EARTH, got 'MOON'"),
        (OPM + "MAN_EPOCH_IGNITION = 2025-03-20T13:00:00\n", "line 18: MAN_EPOCH_IGNITION: must not be given"),
        (OPM.replace("7000.0", "x"), "line 11: X: must be a finite number, got 'x'"),
        (OCM.replace("CARTPV", "KEPLERIAN"), "line 14: TRAJ_TYPE: must be one of CARTP, CARTPV, CARTPVA, got 'KEPL"),
        (OCM.replace("EPOCH_TZERO", "OTHER"), "EPOCH_TZERO: is required"),
        (OCM.replace("TRAJ_STOP\n", ""), "line 10: ends early: TRAJ_STOP must close what begins here"),
        (OCM.replace(" 6.0 4.4\n", " 6.0\n"), "line 18: must have 7 values"),
    ],
)
def test_faults_are_one_line(read, text, message):
    with pytest.raises(ws.InputError) as caught:
        read(text)
    assert str(caught.value).split("x.txt: ")[1].startswith(message)


SP3 = """#dV2025  3 20 12  0  0.00000000       2 ORBIT IGS20 HLM  IGS
## 2358 388800.00000000   900.00000000 60754 0.5000000000000
+    2   G01G02  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0
++         2  2  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0
%c G  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc
%f  1.2500000  1.025000000  0.00000000000  0.000000000000000
/* made by hand
*  2025  3 20 12  0  0.00000000
PG01  10000.000001 -20000.000002  15000.000003    123.456789
VG01  10000.000000 -20000.000000  30000.000000 999999.999999
PG02      0.000000      0.000000      0.000000 999999.999999
VG02      0.000000      0.000000      0.000000 999999.999999
*  2025  3 20 12 15  0.00000000
PG01  10001.000001 -20001.000002  15001.000003    123.456789
VG01  10000.000000 -20000.000000  30000.000000 999999.999999
PG02  10002.000001 -20002.000002  15002.000003    123.456789
VG02  10000.000000 -20000.000000  30000.000000 999999.999999
EOF"""


def test_sp3(read):
    one, two = read(SP3)
    assert (one.object_name, one.frame, one.time_system) == ("G01", "ITRF", "GPS")
    np.testing.assert_allclose(one.position_m[0], [10000000.001, -20000000.002, 15000000.003], rtol=0, atol=1e-8)
    assert one.velocity_m_s[0].tolist() == [1000.0, -2000.0, 3000.0]  # of 10,000 dm/s
    gps_ahead_s = 18.0
    np.testing.assert_allclose(one.instants.since(utc_time(EPOCH)) + gps_ahead_s, [0.0, 900.0], rtol=0, atol=CLOCK_S)
    assert two.object_name == "G02" and len(two.instants) == 1  # its first position is not known
    with pytest.raises(ws.InputError, match="line 17: ends early: EOF must be the last line"):
        read(SP3.removesuffix("\nEOF"))


MEME = """created:2025-03-20 11:00:00 UTC
ephemeris_start:2025-03-20 12:00:42 UTC ephemeris_stop:2025-03-20 12:01:42 UTC step_size:60
ephemeris_source:blend
UVW
2025079120042.000 7000.0000000000 0.0000000000 0.0000000000 0.0000000000 6.0000000000 4.5000000000
1.0e-07 -1.0e-08 2.0e-07 3.0e-13 4.0e-12 5.0e-08 1.0e-10
1.0e-07 -1.0e-08 2.0e-07 3.0e-13 4.0e-12 5.0e-08 1.0e-10
1.0e-07 -1.0e-08 2.0e-07 3.0e-13 4.0e-12 5.0e-08 1.0e-10
2025079120142.000 6985.0000000000 360.0000000000 270.0000000000 -0.5000000000 6.0000000000 4.4000000000
1.0e-07 -1.0e-08 2.0e-07 3.0e-13 4.0e-12 5.0e-08 1.0e-10
1.0e-07 -1.0e-08 2.0e-07 3.0e-13 4.0e-12 5.0e-08 1.0e-10
1.0e-07 -1.0e-08 2.0e-07 3.0e-13 4.0e-12 5.0e-08 1.0e-10
"""


def test_meme(read):
    (segment,) = read(MEME, "MEME_47798_STARLINK-2379_3171301_Operational_1415710920_UNCLASSIFIED.txt")
    assert (segment.object_name, segment.object_id, segment.frame) == ("STARLINK-2379", "47798", "EME2000")
    np.testing.assert_allclose(segment.instants.since(utc_time(EPOCH)), [42.0, 102.0], rtol=0, atol=CLOCK_S)
    assert segment.position_m[1].tolist() == [6985000.0, 360000.0, 270000.0]
    assert segment.velocity_m_s[1].tolist() == [-500.0, 6000.0, 4400.0]


def circle(time_s, radius_m=7.0e6):
    rate = np.sqrt(MU / radius_m**3)
    angle = rate * np.atleast_1d(time_s)[:, None]
    x, y = np.eye(3)[0], np.array([0.0, 0.6, 0.8])
    return radius_m * (np.cos(angle) * x + np.sin(angle) * y), radius_m * rate * (np.cos(angle) * y - np.sin(angle) * x)


def kernel(data, first_s, last_s, kind, frame=1, center=399, target=-48):
    """Bytes of an SPK kernel of one segment (NAIF, "DAF required reading")."""
    head = struct.pack("<8sii60siii8s603s28s297s", b"DAF/SPK ", 2, 6, b"made by hand".ljust(60), 2, 2, 0, b"LTL-IEEE",
                       b"", b"FTPSTR:\r:\n:\r\n:\r\x00:\x81:\x10\xce:ENDFTP", b"")  # fmt: skip
    start = 3 * 128 + 1
    numbers = first_s, last_s, target, center, frame, kind, start, start + len(data) - 1
    summary = struct.pack("<ddd", 0.0, 0.0, 1.0) + struct.pack("<ddiiiiii", *numbers)
    names = b"SEGMENT".ljust(1024)
    return head.ljust(1024, b"\0") + summary.ljust(1024, b"\0") + names + np.asarray(data, "<f8").tobytes().ljust(1024)


def since_j2000_s(time_s):
    """TDB seconds after J2000 of seconds after the epoch."""
    return (Time(EPOCH, scale="utc").tdb - Time(2451545.0, format="jd", scale="tdb")).sec + np.asarray(time_s)


@pytest.mark.parametrize(("kind", "degree"), [(8, 5), (9, 5), (12, 7), (13, 7)])
def test_states_of_spk(read, tmp_path, kind, degree):
    time_s = 60.0 * np.arange(20)
    position, velocity = circle(time_s)
    second = since_j2000_s(time_s)
    states = 1e-3 * np.hstack([position, velocity]).ravel()
    size = degree if kind < 10 else (degree - 1) // 2
    tail = [second[0], 60.0, size, 20.0] if kind in (8, 12) else [*second, size, 20.0]
    (segment,) = read(kernel([*states, *tail], second[0], second[-1], kind), "x.bsp")
    assert (segment.object_name, segment.frame, segment.degree) == ("-48", "GCRF", degree)
    assert segment.interpolation == ("lagrange" if kind < 10 else "hermite")
    np.testing.assert_allclose(segment.position_m, position, rtol=0, atol=1e-6)
    np.testing.assert_allclose(segment.instants.since(utc_time(EPOCH)), time_s, rtol=0, atol=1e-6)
    middle_s = np.array([330.0, 570.0])
    off_m = ws.EphemerisOrbit(tmp_path / "x.bsp").states(utc_time(EPOCH), middle_s)[0][:, 0] - circle(middle_s)[0]
    assert np.abs(off_m).max() < 0.05


def test_series_of_spk(read, tmp_path):
    """Against jplephem at other times."""
    first = since_j2000_s(0.0)
    records = []
    for number in range(4):
        at = 150.0 * np.cos(np.pi * (np.arange(10) + 0.5) / 10)
        values = 1e-3 * circle(300.0 * number + 150.0 + at)[0]
        series = np.polynomial.chebyshev.chebfit(at / 150.0, values, 9)
        records += [first + 300.0 * number + 150.0, 150.0, *series.T.ravel()]
    data = kernel([*records, first, 300.0, 32.0, 4.0], first, first + 1200.0, 2)
    (segment,) = read(data, "x.bsp")
    assert len(segment.instants) == 41 and segment.instants.since(utc_time(EPOCH))[-1] == pytest.approx(
        1200.0, abs=1e-6
    )
    time_s = np.array([10.0, 333.3, 1111.0])
    states = ws.EphemerisOrbit(tmp_path / "x.bsp").states(utc_time(EPOCH), time_s)
    known = SPK(DAF(io.BytesIO(data))).segments[0]
    for t, position, velocity in zip(time_s, states[0][:, 0], states[1][:, 0], strict=True):
        expected, rate = known.compute_and_differentiate(2451545.0, since_j2000_s(t) / 86400.0)
        assert np.abs(position - 1e3 * expected).max() < JULIAN_M
        assert np.abs(velocity - 1e3 * np.asarray(rate) / 86400.0).max() < JULIAN_M
        assert np.abs(position - circle(t)[0]).max() < SERIES_M


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"center": 10}, "must hold segments about the Earth of type 2, 3, 8, 9, 12 or 13, got 9 about 10"),
        ({"kind": 1}, "must hold segments about the Earth of type 2, 3, 8, 9, 12 or 13, got 1 about 399"),
        ({"frame": 17}, "frame: must be 1 (J2000) or 13000 (ITRF93), got 17"),
    ],
)
def test_kernels_that_are_not_read(read, change, message):
    second = since_j2000_s(np.arange(3))
    data = [*np.ones(18), *second, 1.0, 3.0]
    with pytest.raises(ws.InputError) as caught:
        read(kernel(data, second[0], second[-1], **{"kind": 9, **change}))
    assert str(caught.value).split("x.txt: ")[1] == message
    with pytest.raises(ws.InputError, match=r"x\.txt: must be a whole SPK kernel: "):
        read(kernel(data, second[0], second[-1], 9)[:700])


def test_one_name_for_one_idea(tmp_path):
    """`file` and the kinds "tle" and "ephemeris" serve constellations and orbits alike; the old names as well."""
    (tmp_path / "x.ocm").write_text(OCM.split("TRAJ_START\nCENTER_NAME = EARTH\nTRAJ_REF_FRAME = ITRF")[0])
    lines = list(iss("25079.50000000"))
    file = str(tmp_path / "x.ocm")
    for kind, name in (("ephemeris", "file"), ("ephemeris_files", "files")):
        for value in (file, [file]):
            scene = ws.Scene.load("stss").replace(constellation={"kind": kind, name: value})
            assert scene.constellation.files == (file,) and scene.constellation.names == ["SAT_ONE"]
    for kind in ("tle", "tle_orbit"):
        scene = ws.Scene.load("stss").replace(trajectory={"kind": kind, "lines": lines})
        assert isinstance(scene.trajectory, ws.TleOrbit)
    with pytest.raises(ws.InputError, match="file, files: must not both be given"):
        ws.EphemerisSatellites(file=file, files=[file])
    with pytest.raises(ws.InputError, match=r"trajectory\.object: must be a name or a catalog number"):
        ws.Scene.load("stss").replace(trajectory={"kind": "tle", "lines": lines, "object": 1.5})
