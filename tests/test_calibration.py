"""Calibration: maps against what frames show, and frames against the statistics of their detector."""

import re

import numpy as np
import pytest
from astropy.io import fits
from conftest import slow

import warpsim as ws
from warpsim.cli import main
from warpsim.output.check import scene_report
from warpsim.render.calibration_frames import FIRST_FRAME, calibration_counts, detector_maps
from warpsim.scene.provenance import input_checksums

NEI = {
    "kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 2e-15, "prnu": 0.05, "dsnu_nei": 8.0, "dead_fraction": 0.01,
    "hot_fraction": 0.02, "counts_per_nei": 5.0, "offset_counts": 200.0,
}  # fmt: skip
ELECTRONS = {
    "kind": "electron", "exposure_s": 0.1, "full_well_e": 1e5, "gain_e_per_count": 10.0, "offset_counts": 300.0,
    "dark_e_s": 5e4, "read_noise_e": 20.0, "prnu": 0.04, "dsnu": 0.1, "dead_fraction": 0.01, "hot_fraction": 0.01,
    "background_w_cm2_sr": 1e-11,
}  # fmt: skip


def scene_of(detector, n_row=100, n_col=72):
    camera = {"n_row": n_row, "n_col": n_col, "fov_deg": 1.0}  # strips that end within an image
    return ws.Scene.load("stss").replace(detector=detector, camera=camera, bands=["A", "C"], sky__catalog="none")


def means(scene, kind, n_frame=200, band="A", level=0.5):
    counts = calibration_counts(scene.scenario, "sat21", [band], kind, n_frame, level)
    return counts[:, 0].astype(np.float64).mean(axis=0)


def map_of(scene, band="A"):
    maps = detector_maps(scene.scenario, "sat21", [band])
    return maps.gain[0].astype(np.float64), maps.offset[0].astype(np.float64), maps.bad[0]


@pytest.mark.ci
def test_maps_in_nei_terms_are_those_of_frames():
    """Mean flats minus mean darks tell gains, mean darks offsets, within the noise of 200 frames."""
    scene = scene_of(NEI)
    gain, offset_w_cm2, bad = map_of(scene)
    dark, flat = means(scene, "dark"), means(scene, "flat")
    good, rms = bad == 0, 5.0 / np.sqrt(200)  # counts
    np.testing.assert_allclose(dark[good], 200.0 + 5.0 * offset_w_cm2[good] / 1e-18, atol=6 * rms)
    np.testing.assert_allclose((flat - dark)[good], 0.5 * 2e-15 / 1e-18 * 5.0 * gain[good], atol=9 * rms)
    assert (flat[bad == 2] == flat[bad == 2].max()).all() and flat[bad == 2][0] > 10_000
    np.testing.assert_allclose(flat[bad == 1], dark[bad == 1], atol=9 * rms)
    assert gain.std() == pytest.approx(0.05, rel=0.05) and (offset_w_cm2 / 1e-18).std() == pytest.approx(8.0, rel=0.05)
    assert ((bad == 1).mean(), (bad == 2).mean()) == (pytest.approx(0.01, abs=4e-3), pytest.approx(0.02, abs=6e-3))


@pytest.mark.slow
def test_maps_in_electrons_are_those_of_frames():
    scene = scene_of(ELECTRONS)
    gain, dark_e, bad = map_of(scene)
    bias, dark, flat = (means(scene, kind) for kind in ("bias", "dark", "flat"))
    good = bad == 0
    rms = np.sqrt(5e3 + 20.0**2) / 10.0 / np.sqrt(200)
    np.testing.assert_allclose(bias[good], 300.0, atol=6 * 20.0 / 10.0 / np.sqrt(200) + 0.02)
    np.testing.assert_allclose(dark[good], 300.0 + dark_e[good] / 10.0, atol=6 * rms)
    assert dark_e.mean() == pytest.approx(5e3, rel=0.01) and dark_e.std() == pytest.approx(500.0, rel=0.05)
    light_e = 10.0 * (flat - dark)[good] / gain[good]
    assert light_e.std() / light_e.mean() < 0.003  # gains have 0.04
    np.testing.assert_allclose(flat[bad == 1], dark[bad == 1], atol=9 * rms)


@pytest.mark.ci
def test_photon_transfer():
    """Variance over frames against mean, of flats: the slope is the gain, and what is left the read noise."""
    scene = scene_of({**ELECTRONS, "dead_fraction": 0.0, "hot_fraction": 0.0, "dark_e_s": 0.0, "dsnu": 0.0})
    points = []
    for level in (0.1, 0.3, 0.5, 0.7):
        counts = calibration_counts(scene.scenario, "sat21", ["A"], "flat", 60, level)[:, 0].astype(np.float64)
        points.append((counts.mean() - 300.0, counts.var(axis=0, ddof=1).mean()))
    slope, rest = np.polyfit(*np.array(points).T, 1)
    assert 1.0 / slope == pytest.approx(10.0, rel=0.02)
    assert np.sqrt(rest) * 10.0 == pytest.approx(20.0, rel=0.25)


@pytest.mark.ci
def test_maps_are_those_of_every_frame_band_and_sensor():
    scene = scene_of({**NEI, "hot_fraction": 0.05})
    frames = ws.Renderer(scene, "cpu").render([3], sensors="sat21")
    for number, band in enumerate(frames.bands):
        bad = map_of(scene, band)[2]
        counts = frames.counts.numpy()[0, 0, number]
        assert (counts[bad == 2] == counts.max()).all()
        assert (counts[bad != 2] < counts.max()).mean() > 0.99
    both = detector_maps(scene.scenario, "sat21", ["A", "C"])
    assert not np.array_equal(both.bad[0], both.bad[1])
    np.testing.assert_array_equal(both.bad[1], map_of(scene, "C")[2])
    assert not np.array_equal(both.bad, detector_maps(scene.scenario, "sat22", ["A", "C"]).bad)


@pytest.mark.ci
def test_frames_have_noise_of_their_own():
    scene = scene_of(NEI)
    dark = calibration_counts(scene.scenario, "sat21", ["A"], "dark", 3)
    again = calibration_counts(scene.scenario, "sat21", ["A", "C"], "dark", 2)
    np.testing.assert_array_equal(again[:, 0], dark[:2, 0])
    assert not np.array_equal(dark[0], dark[1])
    assert len(set(FIRST_FRAME.values())) == 3 and min(FIRST_FRAME.values()) >= 2**31


@pytest.mark.ci
def test_files(tmp_path, capsys):
    scene = scene_of(ELECTRONS)
    scene.save(tmp_path / "s.toml")
    arguments = [
        "calibrate",
        str(tmp_path / "s.toml"),
        "-o",
        str(tmp_path / "c"),
        "--sensors",
        "sat21",
        "--frames",
        "4",
    ]
    assert main(arguments) == 0
    assert "7 files in " in capsys.readouterr().out
    names = {f"sat21_{band}_{kind}.fits" for band in "AC" for kind in ("bias", "dark", "flat")}
    assert {path.name for path in (tmp_path / "c").iterdir()} == names | {"sat21.maps.fits"}
    with fits.open(tmp_path / "c" / "sat21_C_flat.fits") as hdus:
        header = hdus[0].header
        assert hdus[0].data.shape == (4, 100, 72)
        assert (header["IMAGETYP"], header["BAND"], header["FLATFRAC"], header["BUNIT"]) == ("flat", "C", 0.5, "count")
        expected = calibration_counts(scene.scenario, "sat21", ["C"], "flat", 4)[:, 0]
        np.testing.assert_array_equal(hdus[0].data, expected)
    with fits.open(tmp_path / "c" / "sat21.maps.fits") as hdus:
        assert [hdu.name for hdu in hdus[1:]] == [
            f"{name}_{band}" for band in "AC" for name in ("GAIN", "OFFSET", "BAD")
        ]
        np.testing.assert_array_equal(hdus["BAD_C"].data, map_of(scene, "C")[2])
        assert hdus["OFFSET_A"].header["BUNIT"] == "electron"
    assert main(arguments) == 2 and "is there already" in capsys.readouterr().err
    assert len(ws.calibrate(scene_of(NEI), tmp_path, sensors="sat21", bands="A", n_frame=1)) == 3  # no bias


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("n_frame", 0, "n_frame: must be"),
        ("n_frame", 10_001, "n_frame: must be at most 10,000, got 10001"),
        ("flat_level", 0.0, "flat_level: must be above 0, and at most 1"),
        ("flat_level", 2, "flat_level: must be above 0, and at most 1"),
        ("bands", "Q", "bands: "),
        ("sensors", "nobody", "sensors: "),
    ],
)
def test_bad_arguments_write_nothing(tmp_path, option, value, words):
    with pytest.raises(ws.InputError, match=words):
        ws.calibrate(scene_of(NEI), tmp_path, **{option: value})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--sensors", "nobody"], "sensors: must be sensors of the scene"),
        (["--frames", "0"], "--frames: must be from 1 to 10,000, got 0"),
        (["--frames", "1e12"], "--frames: must be from 1 to 10,000, got 1000000000000"),
        (["--frames", "x"], "--frames: must be a whole number, got 'x'"),
        (["--level", "0"], "--level: must be above 0, and at most 1, got 0.0"),
        (["--level", "nan"], "--level: must be above 0, and at most 1, got nan"),
        (["--bands", "Q"], "bands: must be among"),
        (["--bands", ","], "bands: must name at least one"),
        (["--device", "tpu"], "device: must be one of cpu"),
    ],
)
def test_a_refused_call_leaves_no_folder(tmp_path, capsys, arguments, message):
    scene_of(NEI).save(tmp_path / "s.toml")
    assert main(["calibrate", str(tmp_path / "s.toml"), "-o", str(tmp_path / "a" / "b"), *arguments]) == 2
    out, err = capsys.readouterr()
    assert not out and err.startswith(f"warpsim: {message}") and err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["s.toml"]


def test_maps_that_cannot_be_read_leave_no_folder(tmp_path):
    (tmp_path / "m.fits").write_text("no FITS")
    scene = scene_of(without_patterns(NEI, tmp_path / "m.fits"))
    with pytest.raises(ws.InputError, match="maps_file: cannot be read"):
        ws.calibrate(scene, tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_a_file_is_no_folder(tmp_path, capsys):
    scene_of(NEI).save(tmp_path / "s.toml")
    (tmp_path / "f").touch()
    for output in (tmp_path / "f", tmp_path / "f" / "c"):
        assert main(["calibrate", str(tmp_path / "s.toml"), "-o", str(output), "--sensors", "sat21"]) == 2
        assert re.fullmatch(rf"warpsim: {output}: cannot be written: .*\n", capsys.readouterr().err)


# --- maps of the user's ---


def without_patterns(detector, file):
    own = {name: value for name, value in detector.items() if name not in ("prnu", "dsnu", "dsnu_nei")}
    return own | {"dead_fraction": 0.0, "hot_fraction": 0.0, "maps_file": str(file)}


@pytest.mark.parametrize("detector", [NEI, ELECTRONS], ids=["nei", "electrons"])
@pytest.mark.parametrize("shape", [(100, 72), slow((64, 64))], ids=["ragged", "whole strips"])
@pytest.mark.ci
def test_frames_with_maps_are_those_of_the_patterns_they_are_of(tmp_path, detector, shape):
    """Within a count, where float32 rounds: maps go by way of gains and offsets, patterns by deviates."""
    seeded = scene_of(detector, *shape)
    ws.calibrate(seeded, tmp_path, sensors=["sat21", "sat22"], n_frame=1)
    mapped = scene_of(without_patterns(detector, tmp_path / "{sensor}.maps.fits"), *shape)
    with pytest.raises(ws.InputError, match="must be a file that exists for sat23"):
        ws.Renderer(mapped, "cpu").render([3], sensors=["sat21", "sat23"])  # but nobody else's is asked for
    one, other = (ws.Renderer(scene, "cpu").render([3, 4], sensors=["sat21", "sat22"]) for scene in (seeded, mapped))
    difference = np.abs(one.counts.numpy().astype(int) - other.counts.numpy().astype(int))
    assert difference.max() <= 1 and (difference > 0).mean() < 2e-3
    alone = ws.Renderer(mapped, "cpu").render([4], sensors="sat22", bands="C").counts.numpy()
    np.testing.assert_array_equal(alone[0, 0, 0], other.counts.numpy()[1, 1, 1])
    mine, theirs = (detector_maps(scene.scenario, "sat22", ["C"]) for scene in (seeded, mapped))
    np.testing.assert_array_equal(mine.gain, theirs.gain)
    np.testing.assert_array_equal(mine.bad, theirs.bad)


@pytest.mark.ci
def test_a_map_for_all_sensors_and_bands(tmp_path):
    bad = np.zeros((100, 72), dtype=np.uint8)
    bad[10, 20], bad[99, 71] = 1, 2
    gain = np.full((100, 72), 1.5, dtype=np.float32)
    hdus = [fits.PrimaryHDU(), fits.ImageHDU(gain, name="GAIN"), fits.ImageHDU(bad, name="BAD")]
    fits.HDUList(hdus).writeto(tmp_path / "m.fits")
    scene = scene_of(without_patterns(NEI, tmp_path / "m.fits"))
    scene.save(tmp_path / "s.toml")
    assert ws.Scene.load(tmp_path / "s.toml") == scene
    flat = means(scene, "flat", 50, "C", 0.2)
    assert flat[0, 0] == pytest.approx(200.0 + 0.2 * 2000.0 * 5.0 * 1.5, rel=0.005)
    assert flat[99, 71] == flat.max() > 9000.0 and flat[10, 20] == pytest.approx(200.0, abs=5.0)
    assert f"maps of {tmp_path / 'm.fits'}" in scene_report(scene.scenario)
    assert str(tmp_path / "m.fits") in input_checksums(scene.scenario)


@pytest.mark.ci
def test_a_band_without_a_map_keeps_its_own(tmp_path):
    """Offsets of one band leave the others' dark current, in any choice of bands; a map of zeros is one."""
    hdus = [fits.PrimaryHDU(), fits.ImageHDU(np.full((100, 72), 2000.0), name="OFFSET_A")]
    fits.HDUList(hdus).writeto(tmp_path / "m.fits")
    scene = scene_of(without_patterns(ELECTRONS, tmp_path / "m.fits"))
    a, c = (means(scene, "dark", 20, band).mean() for band in "AC")
    assert (a, c) == (pytest.approx(300.0 + 200.0, abs=0.5), pytest.approx(300.0 + 500.0, abs=0.5))
    renderer = ws.Renderer(scene, "cpu")
    both, alone = (renderer.render([3], sensors=["sat21"], bands=bands).counts.numpy() for bands in (["A", "C"], ["C"]))
    np.testing.assert_array_equal(both[0, 0, 1], alone[0, 0, 0])
    maps = detector_maps(scene.scenario, "sat21", ["A", "C"])
    assert (maps.offset[0] == 2000.0).all() and maps.offset[1] == pytest.approx(5000.0)
    fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(np.zeros((100, 72)), name="OFFSET")]).writeto(tmp_path / "z.fits")
    without = scene_of(without_patterns(ELECTRONS, tmp_path / "z.fits"))
    assert means(without, "dark", 20).mean() == pytest.approx(300.0, abs=0.5)


@pytest.mark.ci
def test_bias_frames_of_sensors_with_maps(tmp_path):
    """What `calibrate` has written can be calibrated again."""
    ws.calibrate(scene_of(ELECTRONS), tmp_path, sensors="sat21", n_frame=1)
    mapped = scene_of(without_patterns(ELECTRONS, tmp_path / "{sensor}.maps.fits"))
    (tmp_path / "again").mkdir()
    ws.calibrate(mapped, tmp_path / "again", sensors="sat21", bands="A", n_frame=20)
    bias, dark = (np.median(fits.getdata(tmp_path / "again" / f"sat21_A_{kind}.fits")) for kind in ("bias", "dark"))
    assert (bias, dark) == (pytest.approx(300.0, abs=2.0), pytest.approx(800.0, abs=15.0))


@pytest.mark.parametrize(
    ("hdu", "words"),
    [
        (fits.ImageHDU(np.zeros((3, 3)), name="GAIN"), r"must hold images of shape \(100, 72\), got \(3, 3\) of GAIN"),
        (fits.ImageHDU(np.full((100, 72), 9.0), name="GAIN"), "must be finite, and within 0 to 4, in GAIN of"),
        (fits.ImageHDU(np.full((100, 72), 3), name="BAD"), "must be finite, and within 0 to 2, in BAD of"),
        (fits.ImageHDU(np.full((100, 72), 1.5), name="BAD"), "must be 0, 1 or 2, in BAD of"),
        (fits.ImageHDU(np.full((100, 72), np.nan), name="OFFSET"), "must be finite"),
        (fits.ImageHDU(np.zeros((100, 72)), name="FLAT"), "must have an image GAIN, OFFSET or BAD in"),
    ],
    ids=["shape", "gain", "bad", "half", "not finite", "none"],
)
def test_bad_maps_are_named(tmp_path, hdu, words):
    fits.HDUList([fits.PrimaryHDU(), hdu]).writeto(tmp_path / "m.fits")
    with pytest.raises(ws.InputError, match=f"detector.maps_file: {words}"):
        ws.Renderer(scene_of(without_patterns(NEI, tmp_path / "m.fits")), "cpu").render([0])
    with pytest.raises(ws.InputError, match=words):
        scene_report(scene_of(without_patterns(NEI, tmp_path / "m.fits")).scenario)
    with pytest.raises(ws.InputError, match=r"detector.maps_file: must be a file that exists"):
        ws.Renderer(scene_of(without_patterns(NEI, tmp_path / "no.fits")), "cpu").render([0])
    with pytest.raises(ws.InputError, match=r"prnu: must be left out with maps_file"):
        scene_of(without_patterns(NEI, tmp_path / "m.fits") | {"prnu": 0.1})


@pytest.mark.ci
def test_runs_write_the_maps_of_their_detectors(tmp_path):
    scene = scene_of({**NEI, "dsnu_nei": 0.0})
    arguments = {"frames": [3, 4], "sensors": ["sat21"], "bands": ["C"], "every_frame": True, "device": "cpu"}
    ws.render_to_folder(scene, tmp_path / "run", **arguments)
    with fits.open(tmp_path / "run" / "sat21.maps.fits") as hdus:
        np.testing.assert_array_equal(hdus["BAD_C"].data, map_of(scene, "C")[2])
        np.testing.assert_array_equal(hdus["GAIN_C"].data, map_of(scene, "C")[0].astype(np.float32))
    again = ws.render_to_folder(scene, tmp_path / "run", **arguments)
    assert again.n_image_rendered == 0
    (tmp_path / "run" / "sat21.maps.fits").unlink()
    assert ws.render_to_folder(scene, tmp_path / "run", **arguments).n_image_rendered > 0
    plain = scene_of({"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 2e-15})
    ws.render_to_folder(plain, tmp_path / "plain", **arguments)
    assert not list((tmp_path / "plain").glob("*.maps.fits"))
