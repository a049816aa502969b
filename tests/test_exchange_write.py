"""What is written can be read again, by warpsim without loss and by other packages."""

from __future__ import annotations

import numpy as np
import pytest
from astropy.time import Time
from exchange_samples import AEM, CSV_ATTITUDE, ECSV, OEM

import warpsim as ws
from warpsim.constants import EARTH_GM_M3_S2
from warpsim.orbit.two_body import propagate_two_body

EPOCH = Time("2016-12-31T23:59:30.123456789", scale="utc")  # half a minute before a leap second
POSITION_M, CLOCK_S, SPEED_M_S = 1e-9, 1e-9, 2e-12  # the digits written: half a unit of the last, and rounding
KM_ROUNDING_M = 1e-9  # kilometres in float64 on the way
LIBRARY_M, LIBRARY_M_S, LIBRARY_S = 1e-8, 1e-11, 1e-6  # what the other packages keep


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
        "SAT ONE", EPOCH, time_s, position_m, velocity_m_s, object_id="2016-001A", frame="EME2000",
        interpolation="hermite", degree=7,
    )  # fmt: skip


def assert_same(got, expected):
    assert got.frame == expected.frame
    seconds = np.abs(got.instants.since(EPOCH) - expected.instants.since(EPOCH))
    assert seconds.max() < CLOCK_S
    assert np.abs(got.position_m - expected.position_m).max() < POSITION_M + KM_ROUNDING_M
    assert np.abs(got.velocity_m_s - expected.velocity_m_s).max() < SPEED_M_S


@pytest.mark.parametrize("system", ["UTC", "TAI", "TT", "TDB", "GPS"])
def test_oem_round_trip(tmp_path, segment, system):
    time_s, position_m, velocity_m_s = states()
    again = ws.EphemerisSegment.of_states(
        "b", EPOCH, time_s, position_m, velocity_m_s, frame="ITRF", time_system=system
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
    np.testing.assert_allclose(useable.since_instant(segments[0].instants[0]), [60.0, 120.0], rtol=0, atol=CLOCK_S)


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
    assert np.abs(got.instants.since(EPOCH) - segment.instants.since(EPOCH)).max() < LIBRARY_S


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
    expected = ws.EphemerisSegment.of_states("x", EPOCH, time_s, position_m, velocity, frame="TEME")
    ws.write_stk_ephemeris(tmp_path / "x.e", expected)
    (got,) = ws.read_ephemeris(tmp_path / "x.e")
    assert (got.object_name, got.frame) == ("x", "TEME")
    assert (got.interpolation, got.degree) == (("hermite", 7) if has_velocity else ("lagrange", 7))
    assert np.abs(got.instants.since(EPOCH) - time_s).max() < CLOCK_S
    assert np.abs(got.position_m - position_m).max() < POSITION_M
    if has_velocity:
        assert np.abs(got.velocity_m_s - velocity_m_s).max() < SPEED_M_S


@pytest.mark.parametrize("gap_s", [0.0, 7.0])
def test_stk_segments_round_trip(tmp_path, gap_s):
    time_s, position_m, velocity_m_s = states()
    first = ws.EphemerisSegment.of_states("x", EPOCH, time_s, position_m, velocity_m_s)
    then = ws.EphemerisSegment.of_states("x", EPOCH, time_s[-1] + gap_s + time_s, position_m, velocity_m_s + 1.0)
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
        assert np.abs(got.instants.since_instant(expected.instants[0]) - [0.0, 60.0]).max() < CLOCK_S


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
        ws.EphemerisSegment.of_states("x", EPOCH, **given)
