"""Whole, small files of every format, and damage done to them, for the tests of warpsim.exchange."""

from __future__ import annotations

import random

OEM = """\
CCSDS_OEM_VERS = 2.0
COMMENT made by hand
CREATION_DATE = 2025-03-20T00:00:00
ORIGINATOR = TEST

META_START
COMMENT first leg
OBJECT_NAME = SAT ONE
OBJECT_ID = 2025-001A
CENTER_NAME = EARTH
REF_FRAME = EME2000
TIME_SYSTEM = UTC
START_TIME = 2025-03-20T12:00:00.000
USEABLE_START_TIME = 2025-03-20T12:01:00.000
USEABLE_STOP_TIME = 2025-03-20T12:02:00.000
STOP_TIME = 2025-03-20T12:03:00.000
INTERPOLATION = HERMITE
INTERPOLATION_DEGREE = 5
META_STOP

COMMENT states
2025-03-20T12:00:00.000 7000.0 0.0 0.0 0.0 7.5 1.0
2025-03-20T12:01:00.000 6985.0 449.0 59.9 -0.5 7.48 0.99
2025-079T12:02:00.000Z 6940.0 897.0 119.6 -1.0 7.45 0.98
2025-03-20T12:03:00.000 6866.0 1341.0 178.8 -1.4 7.38 0.97

COVARIANCE_START
EPOCH = 2025-03-20T12:00:00.000
COV_REF_FRAME = EME2000
1.0
0.1 1.0
COVARIANCE_STOP

META_START
OBJECT_NAME = SAT/TWO
OBJECT_ID = 2025-001B
CENTER_NAME = Earth
REF_FRAME = ITRF-97
TIME_SYSTEM = TAI
START_TIME = 2025-03-20T12:00:37.000
STOP_TIME = 2025-03-20T12:01:37.000
META_STOP
2025-03-20T12:00:37.000 1.0e3 2.0e3 -7.0e3 1 2 3 0.001 0.002 0.003
2025-03-20T12:01:37.000 1.1e3 2.1e3 -7.1e3 1 2 3 0.001 0.002 0.003
"""

OEM_XML = """\
<?xml version="1.0" encoding="UTF-8"?>
<oem xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" id="CCSDS_OEM_VERS" version="2.0">
  <header><COMMENT>x</COMMENT><CREATION_DATE>2025-03-20T00:00:00</CREATION_DATE><ORIGINATOR>TEST</ORIGINATOR></header>
  <body>
    <segment>
      <metadata>
        <OBJECT_NAME>SAT ONE</OBJECT_NAME><OBJECT_ID>2025-001A</OBJECT_ID><CENTER_NAME>EARTH</CENTER_NAME>
        <REF_FRAME>ICRF</REF_FRAME><TIME_SYSTEM>GPS</TIME_SYSTEM>
        <START_TIME>2025-03-20T12:00:18.000</START_TIME><STOP_TIME>2025-03-20T12:01:18.000</STOP_TIME>
        <INTERPOLATION>LAGRANGE</INTERPOLATION><INTERPOLATION_DEGREE>1</INTERPOLATION_DEGREE>
      </metadata>
      <data>
        <stateVector>
          <EPOCH>2025-03-20T12:00:18.000</EPOCH>
          <X units="km">7000.0</X><Y units="km">1.0</Y><Z units="km">2.0</Z>
          <X_DOT units="km/s">0.5</X_DOT><Y_DOT units="km/s">7.5</Y_DOT><Z_DOT units="km/s">1.0</Z_DOT>
        </stateVector>
        <stateVector>
          <EPOCH>2025-03-20T12:01:18.000</EPOCH>
          <X>6985.0</X><Y>449.0</Y><Z>60.0</Z><X_DOT>-0.5</X_DOT><Y_DOT>7.5</Y_DOT><Z_DOT>1.0</Z_DOT>
        </stateVector>
        <covarianceMatrix><EPOCH>2025-03-20T12:00:18.000</EPOCH><CX_X>1</CX_X></covarianceMatrix>
      </data>
    </segment>
  </body>
</oem>
"""

AEM = """\
CCSDS_AEM_VERS = 1.0
CREATION_DATE = 2025-03-20T00:00:00
ORIGINATOR = TEST
META_START
OBJECT_NAME = SAT ONE
OBJECT_ID = 2025-001A
CENTER_NAME = EARTH
REF_FRAME_A = EME2000
REF_FRAME_B = SC_BODY_1
ATTITUDE_DIR = A2B
TIME_SYSTEM = UTC
START_TIME = 2025-03-20T12:00:00
STOP_TIME = 2025-03-20T12:01:00
ATTITUDE_TYPE = QUATERNION
QUATERNION_TYPE = LAST
INTERPOLATION_METHOD = LINEAR
INTERPOLATION_DEGREE = 1
META_STOP
DATA_START
COMMENT a quarter turn about z, and none
2025-03-20T12:00:00 0.0 0.0 0.7071067811865476 0.7071067811865476
2025-03-20T12:01:00 0.0 0.0 0.0 1.0
DATA_STOP
"""

AEM_XML = """\
<aem id="CCSDS_AEM_VERS" version="2.0"><header><CREATION_DATE>2025-03-20T00:00:00</CREATION_DATE></header>
 <body><segment>
  <metadata>
   <OBJECT_NAME>SAT ONE</OBJECT_NAME><OBJECT_ID>2025-001A</OBJECT_ID>
   <REF_FRAME_A>SC_BODY_1</REF_FRAME_A><REF_FRAME_B>GCRF</REF_FRAME_B><TIME_SYSTEM>UTC</TIME_SYSTEM>
   <START_TIME>2025-03-20T12:00:00</START_TIME><STOP_TIME>2025-03-20T12:01:00</STOP_TIME>
   <ATTITUDE_TYPE>QUATERNION</ATTITUDE_TYPE>
  </metadata>
  <data>
   <attitudeState><quaternionEphemeris><EPOCH>2025-03-20T12:00:00</EPOCH>
    <quaternion><Q1>0.0</Q1><Q2>0.0</Q2><Q3>0.6</Q3><QC>0.8</QC></quaternion></quaternionEphemeris></attitudeState>
   <attitudeState><quaternionEphemeris><EPOCH>2025-03-20T12:01:00</EPOCH>
    <quaternion><QC>1.0</QC><Q1>0.0</Q1><Q2>0.0</Q2><Q3>0.0</Q3></quaternion></quaternionEphemeris></attitudeState>
  </data>
 </segment></body>
</aem>
"""

STK_E = """\
stk.v.11.0

# WrittenBy    STK_v11.0.0
BEGIN Ephemeris

NumberOfEphemerisPoints 5
ScenarioEpoch            20 Mar 2025 12:00:00.000000
InterpolationMethod      Lagrange
InterpolationSamplesM1   3
DistanceUnit Kilometers
CentralBody              Earth
CoordinateSystem         J2000
BEGIN SegmentBoundaryTimes
    0.0
    120.0
    180.0
END SegmentBoundaryTimes

EphemerisTimePosVel

0.00000000000000e+000  7.0e+003 0.0e+000 0.0e+000 0.0e+000 7.5e+000 1.0e+000
6.00000000000000e+001  6.985e+003 449.0 59.9 -0.5 7.48 0.99
1.20000000000000e+002  6.94e+003 897.0 119.6 -1.0 7.45 0.98
1.20000000000000e+002  6.94e+003 897.0 119.6 -1.0 7.46 0.98
1.80000000000000e+002  6.866e+003 1341.0 178.8 -1.4 7.38 0.97

END Ephemeris
"""

STK_A = """\
stk.v.11.0
BEGIN Attitude
NumberOfAttitudePoints 2
ScenarioEpoch 20 Mar 2025 12:00:00.000
BlockingFactor 20
InterpolationOrder 1
CentralBody Earth
CoordinateAxes ICRF
AttitudeTimeQuatAngVels
0.0 0.0 0.0 0.6 0.8 0.1 0.2 0.3
60.0 0.0 0.0 0.0 1.0 0.1 0.2 0.3
END Attitude
"""

CSV = """\
# frame = TEME
name,time_utc,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s
one,2025-03-20T12:00:00,7000.0,0.0,0.0,0.0,7.5,1.0
two,2025-03-20T12:00:00,0.0,7000.0,0.0,-7.5,0.0,1.0
one,2025-03-20 12:01:00.5,6985.0,449.0,59.9,-0.5,7.48,0.99
two,2025-03-20T12:01:00Z,-449.0,6985.0,59.9,-7.48,-0.5,0.99
"""

ECSV = """\
# %ECSV 1.0
# ---
# datatype:
# - {name: time_s, unit: min, datatype: float64}
# - {name: x_m, unit: km, datatype: float64}
# - {name: y_m, unit: km, datatype: float64}
# - {name: z_m, unit: km, datatype: float64}
# meta: !!omap
# - {frame: ITRF}
# schema: astropy-2.0
time_s x_m y_m z_m
0.0 7000.0 0.0 0.0
1.0 6985.0 449.0 59.9
2.0 6940.0 897.0 119.6
"""

CSV_ATTITUDE = """\
time_s,qx,qy,qz,qw
0.0,0.0,0.0,0.6,0.8
60.0,0.0,0.0,0.0,1.0
"""

EPHEMERIDES = {"oem": OEM, "oem.xml": OEM_XML, "e": STK_E, "csv": CSV, "ecsv": ECSV}
ATTITUDES = {"aem": AEM, "aem.xml": AEM_XML, "a": STK_A, "att.csv": CSV_ATTITUDE}


def damaged(text: str, seed: int) -> bytes:
    """The text with one to three random wounds: bytes changed, cut out, doubled or moved, lines lost, ends cut."""
    rng = random.Random(seed)
    data = bytearray(text.encode())
    for _ in range(rng.randint(1, 3)):
        a, b = sorted((rng.randrange(len(data)), rng.randrange(len(data))))
        b = min(b, a + rng.choice([1, 3, 10, 100]))
        wound = rng.randrange(8)
        if wound == 0:
            data[a] = rng.randrange(256)
        elif wound == 1:
            del data[a:b]
        elif wound == 2:
            data[a:a] = data[a:b]
        elif wound == 3:
            data = data[: max(b, 1)]
        elif wound == 4:
            data[a:a] = rng.choice(
                [
                    b"NaN",
                    b" 1e999 ",
                    b"-",
                    b"\n",
                    b"=",
                    b"\xff\xfe",
                    b"\x00",
                    b"<x>",
                    b"&a;",
                    b"_",
                    "²٣".encode(),
                    b" -5",
                ]
            )
        else:
            lines = bytes(data).split(b"\n")
            i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
            if wound == 5:
                del lines[i]
            elif wound == 6:
                lines[i], lines[j] = lines[j], lines[i]
            else:
                lines.insert(j, lines[i])
            data = bytearray(b"\n".join(lines))
        data = data or bytearray(b"x")
    return bytes(data)


def reader(folder, read):
    """What reads a text or bytes as a file in a folder."""

    def do(content, name="x.txt", **options):
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        return read(folder / name, **options)

    return do
