"""Layouts of orbit and attitude files as programs really write them: each a small file, read."""

from __future__ import annotations

import bz2
import gzip
import lzma

import numpy as np
import pytest
from element_sets import iss, read_element_sets
from exchange_samples import AEM, CSV, CSV_ATTITUDE, OEM, STK_A, STK_E, reader
from scipy.spatial.transform import Rotation
from skyfield.api import wgs84

import warpsim as ws
from warpsim.instant import utc_time

EPOCH = "2025-03-20T12:00:00"
GEODETIC_M = 1e-6  # against skyfield, which sums in another order; measured 2e-9
ARC_M = 1e-3  # cubics of 1e-3 rad along arcs are 1e-7 m off; measured 2e-5 near waypoints, where the velocity is a mean
HERMITE_M = 0.7  # twice a (n h)^4 / 384, of degree 3 in steps of 60 s at 7,000 km; from one row alone 3.6 km


@pytest.fixture
def orbits(tmp_path):
    return reader(tmp_path, ws.read_ephemeris)


@pytest.mark.parametrize("text", [OEM, STK_E, CSV], ids=["oem", "stk", "csv"])
@pytest.mark.parametrize(
    "packed", [gzip.compress, bz2.compress, lzma.compress, lambda data: data.decode().encode("utf-16"),
               lambda data: b"\xef\xbb\xbf" + data, lambda data: data.rstrip(b"\n")],
    ids=["gz", "bz2", "xz", "utf-16", "bom", "open"],
)  # fmt: skip
def test_compressed_and_encoded_files_are_the_same(orbits, text, packed):
    plain, other = orbits(text), orbits(packed(text.encode()), "other.dat")
    for one, same in zip(plain, other, strict=True):
        assert np.array_equal(one.position_m, same.position_m) and one.frame == same.frame
        assert np.array_equal(one.instants.second, same.instants.second)


@pytest.mark.parametrize("text", [AEM, STK_A, CSV_ATTITUDE], ids=["aem", "stk", "csv"])
def test_compressed_attitudes_are_the_same(tmp_path, text):
    (tmp_path / "plain").write_text(text)
    (tmp_path / "packed").write_bytes(gzip.compress(b"\xef\xbb\xbf" + text.rstrip("\n").encode()))
    for one, same in zip(*(ws.read_attitude(tmp_path / name) for name in ("plain", "packed")), strict=True):
        assert np.array_equal(one.quaternion, same.quaternion)


def test_compressed_element_sets(tmp_path):
    lines = iss()
    for name, data in {"a": gzip.compress("\n".join(lines).encode()), "b": "\r\n".join(lines).encode("utf-16")}.items():
        (tmp_path / name).write_bytes(data)
        assert read_element_sets(tmp_path / name)[0].norad_id == 25544


def test_a_number_cut_off_in_the_last_line_is_seen(tmp_path):
    rows = "".join(f"{60 * k},7000.125,{k}.250,{k}.500\n" for k in range(6))
    path = tmp_path / "cut.csv"
    path.write_text("time_s,x_km,y_km,z_km\n" + rows[:-1])
    assert len(ws.read_ephemeris(path)[0].instants) == 6
    path.write_text("time_s,x_km,y_km,z_km\n" + rows[:-3])
    with pytest.raises(ws.InputError, match="line 7: must have as many digits as the lines before, or a line break"):
        ws.read_ephemeris(path)


def test_what_stands_after_the_end_and_epochs_of_axes_are_passed_over(orbits, tmp_path):
    plain = orbits(STK_E)
    other = STK_E.replace("END Ephemeris", "END Ephemeris\n\nBEGIN Other\nfree text\nEND Other")
    other = other.replace("Earth\n", "Earth\nCoordinateSystemEpoch 1 Jan 2025 00:00:00\n")
    for one, same in zip(plain, orbits(other), strict=True):
        assert np.array_equal(one.position_m, same.position_m)
    (tmp_path / "x.a").write_text(STK_A + "\nBEGIN Comments\nmore\nEND Comments\n")
    assert len(ws.read_attitude(tmp_path / "x.a")) == 1


def stk(kind, keywords, rows):
    body = "\n".join(" ".join(f"{value!r}" for value in row) for row in np.asarray(rows, float).tolist())
    return (
        f'stk.v.8.0\nBEGIN Ephemeris\nNumberOfEphemerisPoints {len(rows)}\nScenarioEpoch "20 Mar 2025 12:00:00.0"\n'
        f"CentralBody Earth\nCoordinateSystem Fixed\n{keywords}{kind}\n{body}\nEnd Ephemeris"
    )


def test_dates_of_stk_are_asked_for_in_its_own_form(orbits):
    with pytest.raises(
        ws.InputError, match=r"ScenarioEpoch: must be a date like 20 Mar 2025 12:00:00\.0, got '20/3/25"
    ):
        orbits(stk("EphemerisTimePos", "", [[0.0, 7e6, 0.0, 0.0]]).replace("20 Mar 2025", "20/3/25"))


FLIGHT = [[0.0, 10.0, -16.0, 1000.0], [3600.0, 14.0, -14.0, 9000.0], [7200.0, 12.0, -9.0, 9500.0]]


def test_geodetic_positions(orbits):
    (flight,) = orbits(stk("EphemerisLLATimePos", "InterpolationSamplesM1 1\n", FLIGHT))
    expected = [wgs84.latlon(lat, lon, height).itrs_xyz.m for _, lat, lon, height in FLIGHT]
    np.testing.assert_allclose(flight.position_m, expected, rtol=0, atol=GEODETIC_M)
    assert flight.frame == "ITRF" and flight.interpolation == "lagrange" and flight.velocity_m_s is None
    with pytest.raises(ws.InputError, match="line 6: CoordinateSystem: must be Fixed for geodetic positions"):
        orbits(stk("EphemerisLLATimePos", "", FLIGHT).replace("Fixed", "J2000"))
    with pytest.raises(ws.InputError, match=r"line 10: latitude: must be in \[-90, 90\] deg, got 95"):
        orbits(stk("EphemerisLLATimePos", "", [FLIGHT[0], [60.0, 95.0, 0.0, 0.0]]).replace("\nCentral", "\n\nCentral"))


def test_great_arcs_between_waypoints(tmp_path):
    path = tmp_path / "plane.e"
    path.write_text(stk("EphemerisLLATimePos", "InterpolationMethod GreatArc\n", FLIGHT))
    time_s = np.array([0.0, 900.0, 1800.0, 3600.0, 5000.0, 7200.0])
    orbit = ws.EphemerisOrbit(path)
    from warpsim.orbit.earth import itrs_to_gcrs

    fixed = np.einsum(
        "tji,tj->ti", itrs_to_gcrs(utc_time(EPOCH), time_s), orbit.states(utc_time(EPOCH), time_s)[0][:, 0]
    )
    ends = np.array([wgs84.latlon(lat, lon, height).itrs_xyz.m for _, lat, lon, height in FLIGHT])
    radius = np.linalg.norm(ends, axis=1)
    for t, at in zip(time_s, fixed, strict=True):
        leg = 0 if t < 3600.0 else 1
        part = t / 3600.0 - leg
        turn = Rotation.from_rotvec(
            part * np.arccos(ends[leg] @ ends[leg + 1] / radius[leg] / radius[leg + 1])
            * np.cross(ends[leg], ends[leg + 1]) / np.linalg.norm(np.cross(ends[leg], ends[leg + 1]))
        )  # fmt: skip
        length = radius[leg] + part * (radius[leg + 1] - radius[leg])
        assert np.linalg.norm(at - turn.apply(ends[leg]) * length / radius[leg]) < ARC_M
    assert orbit.notes(utc_time(EPOCH), 7200.0) == []


@pytest.mark.parametrize("sequence", ["313", "321", None])
def test_euler_angles_of_stk(tmp_path, sequence):
    angles = np.array([[10.0, 20.0, 30.0], [11.0, 21.0, 33.0]])
    rows = "\n".join(f"{60.0 * k} {a} {b} {c}" for k, (a, b, c) in enumerate(angles))
    keyword = f"Sequence {sequence}\n" if sequence else ""
    (tmp_path / "x.a").write_text(
        "stk.v.12.0\nBEGIN Attitude\nNumberOfAttitudePoints 2\nScenarioEpoch 20 Mar 2025 12:00:00.0\n"
        f"CoordinateAxes J2000\n{keyword}AttitudeTimeEulerAngles\n{rows}\nEND Attitude"
    )
    (segment,) = ws.read_attitude(tmp_path / "x.a")
    axes = {"1": np.eye(3)[0], "2": np.eye(3)[1], "3": np.eye(3)[2]}
    for row, own in zip(angles, segment.quaternion, strict=True):
        turned = Rotation.identity()  # one turn after the other, about the axes as turned so far
        for axis, angle in zip(sequence or "313", row, strict=True):
            turned = Rotation.from_rotvec(np.radians(angle) * turned.apply(axes[axis])) * turned
        assert (Rotation.from_quat(own).inv() * turned).magnitude() < 1e-12


def oem(rows, degree=5, frame="EME2000", more=""):
    last = f"2025-03-20T12:{len(rows) - 1:02d}:00"
    body = "\n".join(f"2025-03-20T12:{k:02d}:00 " + " ".join(map(repr, row)) for k, row in enumerate(rows))
    return (
        "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2025-03-20T00:00:00\nORIGINATOR = ME\nMETA_START\nOBJECT_NAME = A\n"
        f"OBJECT_ID = 2025-001A\nCENTER_NAME = EARTH\nREF_FRAME = {frame}\n{more}TIME_SYSTEM = UTC\n"
        f"START_TIME = 2025-03-20T12:00:00\nSTOP_TIME = {last}\nINTERPOLATION = HERMITE\n"
        f"INTERPOLATION_DEGREE = {degree}\nMETA_STOP\n{body}\n"
    )


def circle(time_s, radius_m=7.0e6):
    rate = np.sqrt(3.986004418e14 / radius_m**3)
    angle = rate * np.atleast_1d(time_s)[:, None]
    x, y = np.eye(3)[:2]
    return radius_m * (np.cos(angle) * x + np.sin(angle) * y), radius_m * rate * (np.cos(angle) * y - np.sin(angle) * x)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_hermite_of_low_degree_uses_two_rows(tmp_path, degree):
    position, velocity = circle(60.0 * np.arange(6))
    (tmp_path / "x.oem").write_text(oem((1e-3 * np.hstack([position, velocity])).tolist(), degree, "GCRF"))
    orbit = ws.EphemerisOrbit(tmp_path / "x.oem")
    middles = 60.0 * np.arange(5) + 30.0
    off_m = np.linalg.norm(orbit.states(utc_time(EPOCH), middles)[0][:, 0] - circle(middles)[0], axis=1)
    assert off_m.max() < HERMITE_M
    assert orbit.notes(utc_time(EPOCH), 300.0) == []  # of a metre or more


def test_accelerations_in_some_rows_only(orbits):
    rows = [[7000.0, k, 0.0, 0.0, 7.5, 0.0] for k in range(3)]
    mixed = [rows[0], [*rows[1], 0.1, 0.2, 0.3], rows[2]]
    assert np.array_equal(orbits(oem(rows))[0].position_m, orbits(oem(mixed))[0].position_m)
    with pytest.raises(ws.InputError, match=r"line 16: must be a finite number, got 'nan'"):
        orbits(oem([rows[0], [*rows[1], 0.1, 0.2, float("nan")], rows[2]]))


def test_an_epoch_beside_the_turning_axes(orbits):
    rows = [[7000.0, k, 0.0, 0.0, 7.5, 0.0] for k in range(3)]
    (segment,) = orbits(oem(rows, frame="ITRF2000", more="REF_FRAME_EPOCH = 2000-01-01T12:00:00\n"))
    assert segment.frame == "ITRF"
