"""Photometry against what was drawn, and tracking data messages against a reader of another project."""

import json
import re

import numpy as np
import pytest
from astropy.table import Table
from command_line import printed, refused
from test_detections import small_scene

import warpsim as ws

GATE_SIGMA = 5.0


@pytest.fixture(scope="module")
def frames():
    """One target, four sensors, two bands, 30 times."""
    scene = small_scene(bands=["A", "C"], nei_w_cm2=4e-19)
    return ws.Renderer(scene).render(range(90, 120), sensors=["sat11", "sat27", "sat41", "sat47"])


def assert_chi_square(table):
    pull = (table["irradiance_w_cm2"] - table["truth_w_cm2"]) / table["irradiance_sigma_w_cm2"]
    n = len(pull)
    assert abs(np.sum(pull**2) - n) < GATE_SIGMA * np.sqrt(2 * n)
    assert abs(np.mean(pull)) < GATE_SIGMA / np.sqrt(n) + 0.1  # the background's own error, the same in a whole image


@pytest.mark.parametrize("method", ["psf", "aperture"])
def test_measured_light_is_that_of_the_light_curve(frames, method):
    table = ws.photometry(frames, "center", method=method)
    assert len(table) > 150 and not table["blended"].any()
    assert_chi_square(table)
    curves = ws.light_curves(frames.scenario, frames.time_s, sensors=frames.sensors, targets="center", bands=["A", "C"])
    for row in table[::17]:
        number = frames.frames.index(row["frame"])
        expected = curves.irradiance_w_cm2[number, frames.sensors.index(row["sensor"]), "AC".index(row["band"]), 0]
        assert row["truth_w_cm2"] == pytest.approx(expected, rel=1e-6)


def test_the_psf_is_the_better_measure(frames):
    psf, aperture = (ws.photometry(frames, "center", method=method) for method in ("psf", "aperture"))
    assert (psf["irradiance_sigma_w_cm2"] < 0.7 * aperture["irradiance_sigma_w_cm2"]).all()


@pytest.mark.ci
def test_light_of_streaks_and_electrons_is_measured_whole():
    """A target crosses three pixels while the shutter is open; its own shot noise is most of the error."""
    electrons = ws.ElectronDetector(
        exposure_s=1.0, quantum_efficiency=0.7, read_noise_e=10.0, dark_e_s=50.0, full_well_e=1e6,
        gain_e_per_count=16.0, bits=16, offset_counts=100.0,
    )  # fmt: skip
    moving = small_scene(detector=electrons, pointing__jitter={"rms_urad": 300.0, "correlation_s": 2.0})
    frames = ws.Renderer(moving).render(range(80, 140), sensors=["sat11", "sat27"])
    table = ws.photometry(frames, "center", background_px=0)
    truth = frames.truth
    rows = truth[truth["in_fov"] & (truth["irradiance_w_cm2"] > 0)]
    assert np.median(np.hypot(rows["dx_px"], rows["dy_px"])) > 1.0
    assert len(table) > 60
    assert_chi_square(table)


def test_blended_targets_are_flagged():
    scene = ws.Scene.load("stss").replace(optics__psf="gaussian", optics__sigma_px=1.0, sky__catalog="none")
    frames = ws.Renderer(scene).render(range(70, 100, 2), sensors=["sat11", "sat27"], bands=["A"])
    table = ws.photometry(frames, "cylinder04", background_px=0)
    assert 0 < np.sum(table["blended"]) < len(table)
    assert_chi_square(table[~table["blended"]])
    pull = (table["irradiance_w_cm2"] - table["others_w_cm2"] - table["truth_w_cm2"]) / table["irradiance_sigma_w_cm2"]
    assert abs(np.sum(pull**2) - len(pull)) < GATE_SIGMA * np.sqrt(
        2 * len(pull)
    )  # the others' light is what is too much


# ------------------------------------------------------------------------------------------------------------- TDM


@pytest.fixture(scope="module")
def found(frames):
    return ws.detections(frames, method="truth", clutter_per_image=2.0)


def test_messages_are_read_by_the_package_ccsds_ndm(tmp_path, found):
    ndm_io = pytest.importorskip("ccsds_ndm.ndm_io")
    ws.write_tdm(found, tmp_path / "x.tdm", zero_mag_w_cm2={"A": 1e-15})
    message = ndm_io.NdmIo().from_path(tmp_path / "x.tdm")
    n_row = 0
    for segment in message.body.segment:
        meta, rows = segment.metadata, segment.data.observation
        assert meta.angle_type.value == "RADEC" and meta.reference_frame.value == "ICRF" and meta.path == "2,1"
        target = "" if meta.participant_2 == "UNKNOWN" else meta.participant_2
        mine = (
            (found["sensor"] == meta.participant_1) & (found["band"] == meta.receive_band) & (found["target"] == target)
        )
        dates = [row.epoch[:26] for row in rows if row.angle_1 is not None]
        ra = [float(row.angle_1.value) for row in rows if row.angle_1 is not None]
        dec = [float(row.angle_2.value) for row in rows if row.angle_2 is not None]
        mag = [float(row.mag) for row in rows if row.mag is not None]
        assert len(set(dates)) == len(dates) == len(ra) == len(dec)  # a keyword once at a time
        assert len(mag) == (len(ra) if meta.receive_band == "A" else 0)
        for number, (date, one, other) in enumerate(zip(dates, ra, dec, strict=True)):
            row = found[mine & (found["date_obs"] == date) & (np.abs(found["ra_deg"] - one) < 1e-9)]
            assert len(row) == 1 and row["dec_deg"][0] == pytest.approx(other, abs=1e-9)
            if mag:
                assert 10 ** (-0.4 * mag[number]) * 1e-15 == pytest.approx(row["irradiance_w_cm2"][0], rel=1e-5)
        n_row += len(ra)
    assert n_row == len(found)


def test_states_of_sensors_stand_beside(tmp_path, found):
    ws.write_tdm(found, tmp_path / "x.tdm")
    assert set(re.findall(r"EPHEMERIS_NAME_1 = (.*)", (tmp_path / "x.tdm").read_text())) == {"x.oem"}
    segments = {one.object_name: one for one in ws.read_ephemeris(tmp_path / "x.oem")}
    assert set(segments) == set(found["sensor"])
    for name, segment in segments.items():
        rows = found[found["sensor"] == name]
        (last,) = rows[-1:]
        expected = [last[f"sensor_{axis}_m"] for axis in "xyz"]
        np.testing.assert_allclose(segment.position_m[-1], expected, atol=1e-6)
        assert len(segment.instants) == len(set(rows["date_obs"]))


def test_messages_say_where_they_are_from(tmp_path, found):
    named = found.copy()
    named.meta["SCENE"] = "\u03b2 group"
    ws.write_tdm(named, tmp_path / "x.tdm")
    for name in ("x.tdm", "x.oem"):
        lines = (tmp_path / name).read_text("ascii").split("CREATION_DATE")[0].splitlines()
        assert lines[1] == "COMMENT SCENE = \\u03b2 group"
        for word in ("TIMESYS", "DATEREF", "SEED", "NOISSEED", "CREATOR", "METHOD", "CLUTTER_PER_IMAGE"):
            assert f"COMMENT {word} = {found.meta[word]}" in lines


def test_a_message_that_fails_leaves_nothing(tmp_path, found, monkeypatch):
    """A full disk while the second file is written."""
    (tmp_path / "x.oem").write_text("before")
    written = []

    def full(path, *arguments, **options):
        written.append(path)
        if len(written) == 2:
            raise OSError(28, "No space left on device")
        return path.write_bytes(b"x")

    monkeypatch.setattr("pathlib.Path.write_text", full)
    with pytest.raises(ws.InputError, match=r"x\.oem: cannot be written: No space left"):
        ws.write_tdm(found, tmp_path / "x.tdm", overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["x.oem"] and (tmp_path / "x.oem").read_text() == "before"


@pytest.mark.parametrize("suffix", [".ecsv", ".csv", ".parquet", ".tdm"])
def test_the_command_writes_what_python_gives(capsys, tmp_path, suffix):
    path = tmp_path / f"x{suffix}"
    options = ["--frames", "60:62", "--sensors", "sat11", "--bands", "A", "--clutter", "2", "--seed", "5"]
    out = printed(capsys, "detect", "stss", "-o", path, *options)
    expected = ws.detections(ws.Scene.load("stss"), [60, 61], "sat11", "A", clutter_per_image=2.0, seed=5)
    named = np.sum(expected["target"] != "")
    assert out == f"{len(expected)} detections in {path}, {named} of targets\n"
    if suffix == ".tdm":
        assert (tmp_path / "x.oem").is_file() and path.read_text().count("ANGLE_1 = ") == len(expected)
        return
    table = ws.labels.read_parquet(path) if suffix == ".parquet" else Table.read(path, format=f"ascii.{suffix[1:]}")
    assert table.colnames == expected.colnames
    np.testing.assert_array_equal(table["ra_deg"], expected["ra_deg"])
    if suffix == ".csv":
        assert json.loads((tmp_path / "x.json").read_text()) == expected.meta
        assert path.read_text().startswith("frame,time_s,")
    else:
        assert table.meta == expected.meta and table["ra_deg"].unit == "deg"


def test_the_command_looks_at_images_and_refuses_bad_options(capsys, tmp_path):
    some = ["detect", "stss", "-o", tmp_path / "x.csv", "--sensors", "sat11", "--bands", "A"]
    assert " detections in " in printed(capsys, *some, "--frames", "60:62", "--images", "matched_filter")
    for more, text in (
        (["--frames", "900:"], "--frames: must name some of the 162 frames, got '900:'"),
        (["--threshold", "x"], "--threshold: must be a number, got 'x'"),
        (["--images", "x", "--frames", "60"], "method: must be one of truth, matched_filter, sep, photutils, got 'x'"),
    ):
        assert text in refused(capsys, *some, "--overwrite", *more)
    assert "x.csv: is there already" in refused(capsys, *some)


def test_bad_input_is_one_line(tmp_path, found, frames):
    (tmp_path / "there.tdm").write_text("x")
    infinite = found.copy()
    infinite["ra_deg"][3] = np.inf
    cases = [
        (lambda: ws.write_tdm(found[:0], tmp_path / "x.tdm"), "x.tdm: detections: must be one at least, got none"),
        (
            lambda: ws.write_tdm(Table({"x": [1]}), tmp_path / "x.tdm"),
            "detections: must be a table of detections, got none",
        ),
        (lambda: ws.write_tdm(infinite, tmp_path / "x.tdm"), "detections.ra_deg: must be finite in row 3"),
        (lambda: ws.write_tdm(found, tmp_path / "x.oem"), "x.oem: must end in one of .tdm, .txt"),
        (lambda: ws.write_tdm(found, tmp_path / "x.csv"), "x.csv: must end in one of .tdm, .txt"),
        (lambda: ws.write_tdm(dict(found.columns), tmp_path / "x.tdm"), "must be an astropy table, got dict"),
        (lambda: ws.write_tdm(found, tmp_path / "x.tdm", {"Z": 1.0}), "zero_mag_w_cm2: must be among A, C, the bands"),
        (lambda: ws.write_tdm(found, tmp_path / "there.tdm"), "there.tdm: is there already"),
        (
            lambda: ws.write_tdm(found, tmp_path / "x.tdm", {"A": 0}),
            "zero_mag_w_cm2.A: must be a number above 0, got 0",
        ),
        (lambda: ws.photometry(frames, "moon"), "target: must be among center, got 'moon'"),
        (lambda: ws.photometry(frames, "center", method="x"), "method: must be one of psf, aperture, got 'x'"),
        (lambda: ws.photometry(frames, "center", radius_px=0), "radius_px: must be a number above 0, got 0"),
        (
            lambda: ws.photometry(frames, "center", method="aperture", radius_px=0.7),
            "radius_px: must be at least 0.707, to hold the centre of a pixel, got 0.7",
        ),
        (lambda: ws.photometry(frames, "center", bands="E"), "bands: must be among A, C, got 'E'"),
    ]
    for call, text in cases:
        with pytest.raises(ws.InputError) as error:
            call()
        assert text in str(error.value) and "\n" not in str(error.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["there.tdm"]
