"""The main job: what a run leaves in its folder, in every format, and what is left when it is killed or damaged."""

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import erfa
import numpy as np
import pytest
from astropy.io import fits
from astropy.table import Table
from astropy.time import Time, TimeDelta
from astropy.wcs import WCS
from conftest import slow
from scipy.spatial.transform import Rotation

import warpsim as ws
from warpsim.cli import main
from warpsim.files import sha256_of, whole_file
from warpsim.optics.wcs import tan_keywords
from warpsim.output import fits_images, grey, wording, zarr_array
from warpsim.output.fits_images import read_cube
from warpsim.output.growing import GrowingFiles
from warpsim.output.image_files import read_image

pytest.importorskip("zarr")

PICKS = (range(60, 66), ["sat11", "sat47"], ["A", "E"])
EVERY = ("fits", "fits-frames", "png", "tiff", "exr", "zarr")
SMALL_RUN = ([60], ["sat11"], ["A"])
COMMAND = [sys.executable, "-m", "warpsim.cli", "render"]


def run(scene, path, *picks, **options):
    return ws.render_to_folder(scene, path, *(picks or PICKS), device="cpu", **options)


def files_of(path):
    """Content of every file below a folder, by name."""
    return {str(item.relative_to(path)): item.read_bytes() for item in sorted(path.rglob("*")) if item.is_file()}


@pytest.fixture(scope="module")
def folder(scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("formats") / "out"
    report = run(scene, path, formats=EVERY, preview="gif")
    assert report.n_image == report.n_image_rendered == 24
    assert str(path) in report.text() and "images per second" in report.text()
    return path


@pytest.fixture(scope="module")
def frames(scene):
    return ws.Renderer(scene, device="cpu").render(*PICKS, keep_signal=True)


def each_image(frames):
    for i, sensor in enumerate(frames.sensors):
        for j, band in enumerate(frames.bands):
            yield f"{sensor}_{band}", (slice(None), i, j)


@pytest.mark.ci
def test_the_folder_holds_what_was_promised(folder):
    expected = {"contact_sheet.png", "manifest.json", "truth.fits"}
    for stem in ("sat11_A", "sat11_E", "sat47_A", "sat47_E"):
        expected |= {f"{stem}.fits", f"{stem}.frames.fits", f"{stem}.gif"}
        expected |= {f"{stem}.zarr/zarr.json", f"{stem}.zarr/c/0/0/0"}
        expected |= {f"{stem}/{k:06d}.{suffix}" for k in range(60, 66) for suffix in ("png", "tif", "exr")}
    assert set(files_of(folder)) == expected
    manifest = json.loads((folder / "manifest.json").read_text())
    assert set(manifest["files"]) == expected - {"manifest.json"}


def test_cubes_hold_the_renderers_counts(folder, frames):
    for stem, part in each_image(frames):
        cube = read_cube(folder / f"{stem}.fits")
        np.testing.assert_array_equal(cube.counts, frames.counts.numpy()[part])
        assert list(cube.frames["FRAME"]) == frames.frames
        assert f"{cube.header['SENSOR']}_{cube.header['FILTER']}" == stem


def test_cubes_are_plain_fits_to_others(folder):
    with fits.open(folder / "sat11_A.fits") as file:
        file.verify("exception")
        assert file[0].data.dtype == np.uint16
        assert file[0].data.shape == (6, 128, 128)
        assert file["FRAMES"].columns.names[:3] == ["FRAME", "TIME_S", "DATE_OBS"]


def test_tables_of_cubes_are_made_once_for_all_bands(scene, folder, tmp_path, monkeypatch):
    """Of a sensor; bytes of the files are those that astropy appends."""
    made = []
    monkeypatch.setattr(fits_images, "tan_keywords", lambda *given: made.append(1) or tan_keywords(*given))
    run(scene, tmp_path / "out")
    assert len(made) == 6 * 2  # frames and sensors
    for path in sorted((tmp_path / "out").glob("sat*.fits")):
        assert path.read_bytes() == (folder / path.name).read_bytes()
        with fits.open(path) as file:
            file[0].writeto(tmp_path / path.name)
            fits.append(tmp_path / path.name, file["FRAMES"].data, file["FRAMES"].header)
        assert path.read_bytes() == (tmp_path / path.name).read_bytes()


@pytest.mark.parametrize("distortion", [None, {"k1": -60.0, "p1": 0.01}])
@pytest.mark.ci
def test_extensions_of_frames_have_counts_and_wcs(scene, tmp_path, distortion):
    """Astropy alone: each header leads to the sky of its frame, from corner to corner, also through a lens."""
    scene = scene.replace(camera__distortion=distortion)
    run(scene, tmp_path, range(60, 63), ["sat11"], ["A"], formats=["fits-frames"])
    frames = ws.Renderer(scene, device="cpu").render(range(60, 63), ["sat11"], ["A"])
    xy_px = np.array([[-0.5, -0.5], [127.5, 3.0], [63.5, 63.5], [10.0, 127.5]])
    with fits.open(tmp_path / "sat11_A.frames.fits") as file:
        file.verify("exception")
        assert [hdu.name for hdu in file] == ["PRIMARY", "FRAME000060", "FRAME000061", "FRAME000062"]
        for plane, (number, hdu) in enumerate(zip(frames.frames, file[1:], strict=True)):
            assert (hdu.data.dtype, hdu.header["FRAME"], hdu.header["SENSOR"]) == (np.uint16, number, "sat11")
            np.testing.assert_array_equal(hdu.data, frames.counts.numpy()[plane, 0, 0])
            sky = WCS(hdu.header).all_pix2world(xy_px, 0)
            back = frames.wcs(number, "sat11").all_world2pix(sky, 0, tolerance=1e-12)
            np.testing.assert_allclose(back, xy_px, rtol=0, atol=1e-9)


def test_wcs_of_each_plane_leads_from_sky_to_truth(scene, folder, frames):
    """The main target is in the middle; a second renderer's axes give the same sky."""
    cube = read_cube(folder / "sat11_E.fits")
    for plane in range(6):
        sky = cube.wcs(plane).pixel_to_world_values(20.0, 100.0)
        x, y = frames.wcs(60 + plane, "sat11").world_to_pixel_values(*sky)
        assert (x, y) == pytest.approx((20.0, 100.0), abs=1e-9)
        seconds = (Time(cube.frames["DATE_OBS"][plane], scale="utc") - scene.epoch).to_value("s")
        assert seconds == pytest.approx(600 + 10 * plane, abs=2e-6)


def test_states_of_each_plane_need_no_warpsim(scene, folder):
    """Astropy, SciPy and ERFA alone put the main target into the pixel that truth has."""
    with fits.open(folder / "sat11_E.fits") as file:
        table, epoch = Table(file["FRAMES"].data), Time(file[0].header["DATEREF"], scale="utc")
    truth = Table.read(folder / "truth.fits")
    for plane in (0, 5):
        row = table[plane]
        position, velocity = (np.array([row[f"{name}_{axis}"] for axis in "XYZ"]) for name in ("POS", "VEL"))
        attitude = Rotation.from_quat([row[f"QUAT_{axis}"] for axis in "XYZW"])
        time_s = row["TIME_S"]
        np.testing.assert_allclose(position, scene.position_m("sat11", [time_s])[0], rtol=1e-12)
        step = scene.position_m("sat11", [time_s - 0.5, time_s + 0.5])
        np.testing.assert_allclose(velocity, step[1] - step[0], atol=1e-2)
        main = truth[(truth["frame"] == row["FRAME"]) & (truth["target"] == scene.target_names[0])][0]
        emitted_s = time_s - 1e3 * main["range_km"] / 299792458.0
        away = scene.position_m(scene.target_names[0], [emitted_s])[0] - position
        now = epoch + TimeDelta(time_s, format="sec")
        earth = np.asarray(erfa.epv00(now.tdb.jd1, now.tdb.jd2)[1]["v"]) * (erfa.DAU / erfa.DAYSEC)
        seen = away / np.linalg.norm(away)
        for boost_m_s in (-earth, earth + velocity):
            beta = boost_m_s / 299792458.0
            seen = erfa.ab(seen, beta, 1e12, np.sqrt(1 - beta @ beta))
        x, y, z = attitude.apply(seen)
        focal_px = 64 / np.tan(np.radians(0.5))
        assert (63.5 + focal_px * x / z, 63.5 + focal_px * y / z) == pytest.approx((63.5, 63.5), abs=1e-5)


def test_truth_table(folder):
    truth = Table.read(folder / "truth.fits")
    assert len(truth) == 6 * 2 * 2 * 30
    assert truth["irradiance_w_cm2"].unit == "W / cm2"
    assert set(np.asarray(truth["sensor"]).astype(str)) == {"sat11", "sat47"}
    assert np.asarray(truth["in_fov"]).all()


def test_manifest(scene, folder):
    manifest = json.loads((folder / "manifest.json").read_text())
    assert ws.Scene.from_dict(manifest["scene"]) == scene
    assert manifest["provenance"]["SEED"] == scene.seed
    assert manifest["device"]["alias"] == "cpu"
    assert manifest["warpsim"] == ws.__version__
    assert set(manifest["files"]) == set(files_of(folder)) - {"manifest.json"}
    assert all(sha256_of(folder / name) == checksum for name, checksum in manifest["files"].items())
    assert manifest["orbit_interpolation"]["measured_error_m"] < 1e-3


@pytest.mark.ci
def test_files_tell_the_response_of_a_custom_band(tmp_path):
    band = ws.Band("notch", [8.0, 8.2, 9.3, 9.5], [0.0, 1.0, 1.0, 0.0], per_photon=True, zero_mag_jy=50.0)
    surface = {f"targets__{k}__surface": {"reflectance": 0.5} for k in range(4)}
    scene = ws.Scene.load("stss").replace(bands=[band, "A"], **surface)
    ws.render_to_folder(scene, tmp_path, [60], ["sat11"], device="cpu")
    header = read_cube(tmp_path / "sat11_notch.fits").header
    edges_um = [header[key] for key in ("WAVEMIN", "WAVELNTH", "WAVEMAX")]
    assert edges_um == [band.half_power_um[0], band.isophotal_um, band.half_power_um[1]]
    assert header["RESPONSE"] == "photon"
    msx = read_cube(tmp_path / "sat11_A.fits").header
    assert [msx[key] for key in ("WAVEMIN", "WAVELNTH", "WAVEMAX", "RESPONSE")] == [6.8, 8.28, 10.8, "energy"]
    found = json.loads((tmp_path / "manifest.json").read_text())["responses"]
    assert {name: ws.Band(name, **facts) for name, facts in found.items()} == {"notch": band, "A": ws.BANDS["A"]}


def test_a_changed_catalog_is_a_different_run(scene, tmp_path):
    stars = tmp_path / "stars.csv"
    own = scene.replace(sky__catalog=str(stars))
    stars.write_text("ra_deg,dec_deg,flux_A_jy\n10.0,20.0,5.0\n")
    ws.render_to_folder(own, tmp_path / "out", *SMALL_RUN, device="cpu")
    stars.write_text("ra_deg,dec_deg,flux_A_jy\n10.0,20.0,50.0\n")
    with pytest.raises(ws.InputError, match="holds a different run"):
        ws.render_to_folder(own, tmp_path / "out", *SMALL_RUN, device="cpu")


@pytest.mark.ci
def test_two_runs_do_not_share_a_folder(scene, tmp_path):
    import fcntl

    (tmp_path / ".warpsim-parts").mkdir()
    with (tmp_path / ".warpsim-parts" / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(ws.InputError, match="another run is writing to it"):
            ws.render_to_folder(scene, tmp_path, *SMALL_RUN, device="cpu")
    ws.render_to_folder(scene, tmp_path, *SMALL_RUN, device="cpu")
    assert not (tmp_path / ".warpsim-parts").exists()


def test_frames_without_access_are_left_out(scene, tmp_path):
    ws.render_to_folder(scene, tmp_path, [0, 60, 161], ["sat11"], ["A"], device="cpu")
    assert list(read_cube(tmp_path / "sat11_A.fits").frames["FRAME"]) == [60]


@pytest.mark.ci
def test_killed_halfway_then_completed(tmp_path, checkout_environment, record_accuracy):
    """SIGKILL after the first sensor: no half file under a final name; the same command then gives the same bytes."""
    command = [*COMMAND, "stss", "--bands", "A", "--sensors", "sat11,sat12,sat27,sat47", "--quiet", "-o"]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run([*command, str(whole)], env=checkout_environment, check=True, capture_output=True)
    n_final = 0
    for wanted in (1, 2):  # kill twice, each time later
        process = subprocess.Popen([*command, str(killed)], env=checkout_environment, stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + 120
        while len(list(killed.glob("*.fits"))) < wanted and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.002)
        process.send_signal(signal.SIGKILL)
        process.wait()
        finals = [path for path in killed.iterdir() if path.is_file() and not path.name.startswith(".")]
        for path in finals:
            assert path.read_bytes() == (whole / path.name).read_bytes(), f"half a file: {path.name}"
        n_final = len(finals)
    assert n_final >= 2
    subprocess.run([*command, str(killed)], env=checkout_environment, check=True, capture_output=True)
    assert sorted(files_of(killed)) == sorted(files_of(whole))
    for name in files_of(whole):
        assert (killed / name).read_bytes() == (whole / name).read_bytes(), name
    differ = sum((killed / name).read_bytes() != (whole / name).read_bytes() for name in files_of(whole))
    record_accuracy("Files of a run killed twice and resumed", differ, 0, "files differ", "an undisturbed run")


def test_whole_file_leaves_nothing_behind_on_an_error(tmp_path):
    path = tmp_path / "a.txt"

    def fail():
        with whole_file(path) as partial:
            partial.write_text("half")
            raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        fail()
    assert files_of(tmp_path) == {}


def test_contact_sheet_is_a_picture_with_content(folder):
    import OpenImageIO as oiio

    pixels = oiio.ImageBuf(str(folder / "contact_sheet.png")).get_pixels(oiio.UINT8)
    assert pixels.shape[2] == 3
    assert pixels.shape[0] > 2 * 128
    assert pixels.max() == 255
    assert pixels.std() > 5


@pytest.mark.ci
def test_every_frame_renders_without_access(tmp_path):
    """sat13 never has access; a camera that stares at the sky is rendered all the same."""
    scene = ws.Scene.load("stss").replace(pointing={"kind": "fixed", "ra_dec_deg": [83.8, -5.4], "up": "north"})
    options = {"frames": range(2), "sensors": ["sat13"], "bands": ["A"]}
    with pytest.raises(ws.InputError, match="--every-frame renders all the same"):
        ws.render_to_folder(scene, tmp_path / "none", **options)
    report = ws.render_to_folder(scene, tmp_path / "all", every_frame=True, **options)
    assert report.n_image == 2
    assert not Table.read(tmp_path / "all" / "truth.fits")["access"].any()
    with pytest.raises(ws.InputError, match="no sensor has access"):
        ws.render_to_folder(scene, tmp_path / "all", **options)


@pytest.mark.ci
def test_counts_are_the_same_in_every_format(folder, frames):
    import zarr

    for stem, part in each_image(frames):
        counts, signal = frames.counts.numpy()[part], frames.signal_w_cm2.numpy()[part]
        array = zarr.open_array(str(folder / f"{stem}.zarr"), mode="r")
        assert array.dtype == np.uint16
        np.testing.assert_array_equal(array[:], counts)
        for place, number in enumerate(frames.frames):
            for suffix in ("png", "tif"):
                np.testing.assert_array_equal(read_image(folder / stem / f"{number:06d}.{suffix}")[0], counts[place])
            read, _ = read_image(folder / stem / f"{number:06d}.exr")
            np.testing.assert_array_equal(read.view(np.uint32), signal[place].view(np.uint32))


@pytest.mark.ci
def test_pillow_reads_the_same_counts(folder, frames):
    image = pytest.importorskip("PIL.Image")
    for stem, part in each_image(frames):
        for suffix in ("png", "tif"):
            with image.open(folder / stem / f"000063.{suffix}") as file:
                np.testing.assert_array_equal(np.asarray(file), frames.counts.numpy()[part][3])


def test_every_image_says_what_it_is(folder, frames):
    """Its time, its levels and its sky, in the words of the cube's header."""
    import zarr

    for stem, _ in each_image(frames):
        cube = ws.read_cube(folder / f"{stem}.fits")
        sky = frames.wcs(63, stem.split("_")[0]).pixel_to_world_values(20.0, 100.0)
        for suffix, unit in (("png", "adu"), ("tif", "adu"), ("exr", "W/cm2")):
            meta = read_image(folder / stem / f"000063.{suffix}")[1]
            assert {name: meta[name] for name in ("SENSOR", "FILTER", "NEI", "OFFSET", "CNTNEI", "SEED")} == {
                name: cube.header[name] for name in ("SENSOR", "FILTER", "NEI", "OFFSET", "CNTNEI", "SEED")
            }
            assert (meta["BUNIT"], meta["FRAME"], meta["TIME_S"]) == (unit, 63, 630.0)
            assert meta["DATE-OBS"] == cube.frames["DATE_OBS"][3]
            place = WCS(fits.Header(meta)).world_to_pixel_values(*sky)
            assert place == pytest.approx((20.0, 100.0), abs=1e-6)
        attributes = zarr.open_array(str(folder / f"{stem}.zarr"), mode="r").attrs
        assert attributes["FRAME"] == list(range(60, 66))
        assert attributes["NEI"] == cube.header["NEI"]
        lists = {name: value[3] if isinstance(value, list) else value for name, value in attributes.items()}
        assert WCS(fits.Header(lists)).world_to_pixel_values(*sky) == pytest.approx((20.0, 100.0), abs=1e-6)


@pytest.mark.ci
def test_cubes_are_those_of_a_run_without_other_formats(scene, folder, tmp_path):
    run(scene, tmp_path, formats=["fits"])
    written = files_of(tmp_path)
    plain = json.loads(written.pop("manifest.json"))
    both = json.loads((folder / "manifest.json").read_text())
    assert all((folder / name).read_bytes() == content for name, content in written.items())
    assert {name: both["files"][name] for name in plain["files"]} == plain["files"]
    run(scene, tmp_path)  # the same run, said otherwise
    assert json.loads((tmp_path / "manifest.json").read_text()) == plain


@pytest.mark.ci
def test_files_do_not_depend_on_the_batch(scene, folder, tmp_path, monkeypatch):
    monkeypatch.setattr("warpsim.output.run.COUNTS_BYTES_PER_CALL", 1)  # one frame a call
    run(scene, tmp_path, formats=EVERY, preview="gif")
    assert files_of(tmp_path) == files_of(folder)


def test_the_same_run_again_does_nothing(scene, folder):
    before = {item: item.stat().st_mtime_ns for item in folder.rglob("*")}
    assert run(scene, folder, formats=EVERY, preview="gif").n_image_rendered == 0
    assert {item: item.stat().st_mtime_ns for item in folder.rglob("*")} == before


@pytest.mark.parametrize("n_frame", [slow(1), 4, slow(6), 100])
@pytest.mark.ci
def test_arrays_of_several_shards(scene, frames, tmp_path, monkeypatch, n_frame):
    """A call may end amid a shard, and the last shard need not be full."""
    import zarr

    monkeypatch.setattr(zarr_array, "SHARD_BYTES", n_frame * 2 * 128 * 128)
    monkeypatch.setattr("warpsim.output.run.COUNTS_BYTES_PER_CALL", 5 * 2 * 2 * 128 * 128)
    run(scene, tmp_path, formats=["zarr"])
    shards = [name for name in files_of(tmp_path) if name.startswith("sat11_A.zarr/c")]
    assert len(shards) == -(-6 // n_frame)
    for stem, part in each_image(frames):
        array = zarr.open_array(str(tmp_path / f"{stem}.zarr"), mode="r")
        np.testing.assert_array_equal(array[:], frames.counts.numpy()[part])
        assert array.chunks == (1, 128, 128)
    again = tmp_path / "again"
    run(scene, again, formats=["zarr"])
    assert {name: content for name, content in files_of(tmp_path).items() if "again" not in name} == files_of(again)


@pytest.mark.parametrize("kinds", [["fits-frames"], ["png"], ["zarr"], ["exr"]])
@pytest.mark.ci
def test_one_format_alone_has_a_contact_sheet(scene, folder, tmp_path, kinds):
    """That of the noiseless images has no noise between the targets."""
    import OpenImageIO as oiio

    run(scene, tmp_path, formats=kinds)
    assert [path.name for path in tmp_path.glob("*.fits") if ".frames." not in path.name] == ["truth.fits"]
    same = (tmp_path / "contact_sheet.png").read_bytes() == (folder / "contact_sheet.png").read_bytes()
    assert same == (kinds != ["exr"])
    pixels = oiio.ImageBuf(str(tmp_path / "contact_sheet.png")).get_pixels(oiio.UINT8)
    assert pixels.max() == 255


@pytest.mark.parametrize(
    "name", ["sat47_E.fits", "sat47_E/000063.png", "sat47_E.zarr/c/0/0/0", "sat47_E.zarr/zarr.json", "sat47_E.gif"]
)
@pytest.mark.parametrize("damage", ["changed", slow("missing")])
@pytest.mark.ci
def test_only_the_sensor_of_a_damaged_file_is_made_again(scene, tmp_path, name, damage):
    options = {"formats": ["fits", "png", "zarr"], "preview": "gif"}
    run(scene, tmp_path, [60, 61, 63], *PICKS[1:], **options)
    before = files_of(tmp_path)
    untouched = (tmp_path / "sat11_E" / "000063.png").stat().st_mtime_ns
    (tmp_path / name).write_bytes(b"x") if damage == "changed" else (tmp_path / name).unlink()
    report = run(scene, tmp_path, [60, 61, 63], *PICKS[1:], **options)
    assert report.n_image_rendered == 6 and "6 images kept from before" in report.text()
    assert (tmp_path / "sat11_E" / "000063.png").stat().st_mtime_ns == untouched
    assert files_of(tmp_path) == before


@pytest.mark.ci
def test_another_format_is_another_run(scene, tmp_path):
    run(scene, tmp_path, [60], ["sat11"], ["A"], formats=["png"])
    before = files_of(tmp_path)
    for options in ({}, {"formats": ["tiff"]}, {"formats": ["png", "exr"]}, {"formats": ["png"], "preview": "gif"}):
        with pytest.raises(ws.InputError, match="holds a different run"):
            run(scene, tmp_path, [60], ["sat11"], ["A"], **options)
    assert files_of(tmp_path) == before


@pytest.mark.ci
def test_overwrite_removes_the_old_runs_files_and_nothing_else(scene, tmp_path):
    run(scene, tmp_path, [60, 61], ["sat11", "sat47"], ["A"], formats=["png", "zarr"], preview="gif")
    (tmp_path / "sat11_A" / "notes.txt").write_text("mine")
    (tmp_path / ".warpsim-parts" / "growing" / "sat47").mkdir(parents=True)  # of a run that was killed
    (tmp_path / ".warpsim-parts" / "growing" / "sat47" / "sat47_A.fits").write_text("half")
    (tmp_path / ".truth.fits.partial").write_text("half")
    run(scene, tmp_path, [60], ["sat11"], ["A"], overwrite=True)
    expected = {"contact_sheet.png", "manifest.json", "sat11_A", "sat11_A.fits", "sat11_A/notes.txt", "truth.fits"}
    assert {str(item.relative_to(tmp_path)) for item in tmp_path.rglob("*")} == expected


NAMES_OF_ONE_SENSOR = (
    *("sat11_A.fits", "sat11_A/000060.png", "sat11_A", "sat11_A.gif"),
    *("sat11_A.zarr/c/0/0/0", "sat11_A.zarr/notes.txt", "sat11_A.zarr"),
)


def test_progress_on_a_log_is_a_line_now_and_then(monkeypatch, capsys):
    now_s = [0.0]
    monkeypatch.setattr(wording, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    with wording.progress_bar(1200, True, "sequences") as advance:
        for _ in range(100):  # 12 in 7 s each: the lines come with the fifth, tenth, ... step
            now_s[0] += 7.0
            advance(12)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 20
    assert lines[:2] == ["60 of 1,200 sequences (5 %) after 35 s", "120 of 1,200 sequences (10 %) after 70 s"]
    assert lines[-1] == "1,200 of 1,200 sequences (100 %) after 700 s"
    with wording.progress_bar(1200, False, "sequences") as advance:
        now_s[0] += 100.0
        advance(1200)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("command", ["render", "dataset"])
def test_files_are_not_scattered_among_those_of_others(tmp_path, monkeypatch, capsys, command):
    (tmp_path / "notes.txt").write_text("mine")
    monkeypatch.chdir(tmp_path)
    for more in ([], ["--overwrite"]):
        assert main([command, "stss", "-o", ".", "--device", "cpu", *more]) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1 and "is not empty (it holds notes.txt), and warpsim did not write it" in told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.txt"]


@pytest.mark.ci
def test_hidden_files_do_not_fill_a_folder(scene, tmp_path):
    (tmp_path / ".gitignore").write_text("*")
    run(scene, tmp_path, *SMALL_RUN)
    assert (tmp_path / "manifest.json").exists() and (tmp_path / ".gitignore").read_text() == "*"


@pytest.mark.parametrize(
    ("name", "earlier"),
    [
        *((name, False) for name in NAMES_OF_ONE_SENSOR),
        *(slow(name, True) if "zarr" in name else (name, True) for name in NAMES_OF_ONE_SENSOR),
        *(("truth.fits", False), ("contact_sheet.png", False)),
    ],
)
@pytest.mark.ci
def test_files_of_others_are_never_touched(scene, tmp_path, name, earlier):
    if earlier:
        run(scene, tmp_path, [60], ["sat47"], ["A"])
    (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
    (tmp_path / name).write_text("mine")
    before = files_of(tmp_path)
    named = "sat11_A.zarr" if name.endswith("notes.txt") else name
    with pytest.raises(ws.InputError, match=f"{named}: is there already, and warpsim did not write it"):
        run(scene, tmp_path, [60], ["sat11"], ["A"], formats=["fits", "png", "zarr"], preview="gif", overwrite=True)
    assert files_of(tmp_path) == before


@pytest.mark.parametrize(
    "name", ["../precious.txt", "notes/precious.txt", "a.zarr/c/0/../precious.txt", "/etc/hostname"]
)
@pytest.mark.ci
def test_manifests_of_others_do_not_make_their_files_ours(scene, tmp_path, name):
    """A file that looks like a manifest, but names what no run writes."""
    folder = tmp_path / "run"
    folder.mkdir()
    (tmp_path / "precious.txt").write_text("mine")
    (folder / "manifest.json").write_text(json.dumps({"key": "0" * 64, "files": {name: "x"}}))
    with pytest.raises(ws.InputError, match=r"manifest\.json: is there already, and warpsim did not write it"):
        run(scene, folder, [60], ["sat11"], ["A"], formats=["png"], overwrite=True)
    assert (tmp_path / "precious.txt").read_text() == "mine"


@pytest.mark.ci
def test_a_run_that_fails_leaves_no_half_array(scene, tmp_path, monkeypatch):
    real = zarr_array._new_array

    def fail(path, shape):
        if path.name == "sat11_E.zarr":
            raise OSError(28, "No space left on device")
        return real(path, shape)

    with monkeypatch.context() as patch:
        patch.setattr(zarr_array, "_new_array", fail)
        with pytest.raises(OSError, match=r"writing failed, .*No space left on device: '.*sat11_E\.zarr'"):
            run(scene, tmp_path, formats=["zarr"])
    assert not list(tmp_path.glob("*.zarr"))
    run(scene, tmp_path, formats=["zarr"])
    assert len(list(tmp_path.glob("*.zarr"))) == 4


def broken_off_after(n_step, scene, path, **options):
    """A run that is ended, as a kill would, when so many batches of frames are complete."""
    real, done = GrowingFiles.end_step, []

    def end_step(self, facts):
        if len(done) == n_step:
            raise KeyboardInterrupt
        done.append(facts)
        real(self, facts)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(GrowingFiles, "end_step", end_step)
        with pytest.raises(KeyboardInterrupt):
            run(scene, path, **options)


@pytest.mark.parametrize("n_step", [slow(1), 4, slow(8)])
@pytest.mark.ci
def test_a_run_goes_on_in_the_middle_of_a_sensor(scene, folder, tmp_path, monkeypatch, n_step):
    """Of 2 sensors and 6 frames each, one a call: those that are complete are not rendered again."""
    monkeypatch.setattr("warpsim.output.run.COUNTS_BYTES_PER_CALL", 1)
    monkeypatch.setattr(zarr_array, "SHARD_BYTES", 1)
    options = {"formats": ("fits", "fits-frames", "png", "exr", "zarr"), "preview": "gif", "stars": True}
    broken_off_after(n_step, scene, tmp_path / "broken", **options)
    left = files_of(tmp_path / "broken")
    assert bool([name for name in left if name.endswith(".fits") and "sat11_A" in name and "parts" not in name]) == (
        n_step > 6
    )
    report = run(scene, tmp_path / "broken", **options)
    assert report.n_image_rendered == 24 - 2 * n_step
    run(scene, tmp_path / "whole", **options)
    assert files_of(tmp_path / "broken") == files_of(tmp_path / "whole")
    assert (tmp_path / "broken" / "sat47_E.fits").read_bytes() == (folder / "sat47_E.fits").read_bytes()


@pytest.mark.ci
def test_rows_stand_in_the_order_of_frames_whatever_the_batch(scene, tmp_path, monkeypatch):
    picks = ([65, 60, 64, 61], ["sat11"], ["A"])
    run(scene, tmp_path / "one", *picks, stars=True)
    monkeypatch.setattr("warpsim.output.run.COUNTS_BYTES_PER_CALL", 1)
    run(scene, tmp_path / "many", *picks, stars=True)
    assert files_of(tmp_path / "one") == files_of(tmp_path / "many")
    assert list(dict.fromkeys(Table.read(tmp_path / "one" / "truth.fits")["frame"])) == picks[0]


@pytest.mark.parametrize("name", ["truth.fits", "stars.fits", "contact_sheet.png"])
@pytest.mark.parametrize("damage", ["changed", slow("missing")])
@pytest.mark.ci
def test_files_of_all_sensors_are_made_again(scene, tmp_path, name, damage):
    picks, options = ([60, 61], ["sat11", "sat47"], ["A"]), {"formats": ["fits", "png"], "stars": True}
    run(scene, tmp_path, *picks, **options)
    before = files_of(tmp_path)
    (tmp_path / name).write_bytes(b"x") if damage == "changed" else (tmp_path / name).unlink()
    run(scene, tmp_path, *picks, **options)
    assert files_of(tmp_path) == before


@pytest.mark.ci
def test_frames_of_another_run_are_never_taken_up(scene, tmp_path, monkeypatch):
    """Even where the record of the run is lost."""
    other = scene.replace(seed=5)
    monkeypatch.setattr("warpsim.output.run.COUNTS_BYTES_PER_CALL", 1)
    broken_off_after(2, scene, tmp_path / "broken")
    (tmp_path / "broken" / ".warpsim-parts" / "run.json").unlink()
    with pytest.raises(ws.InputError, match="holds a different run"):
        run(other, tmp_path / "broken")
    assert run(other, tmp_path / "broken", overwrite=True).n_image_rendered == 24
    run(other, tmp_path / "clean")
    assert files_of(tmp_path / "broken") == files_of(tmp_path / "clean")


@pytest.mark.ci
def test_a_run_that_completed_nothing_is_in_nobodys_way(scene, tmp_path):
    broken_off_after(0, scene, tmp_path)
    assert files_of(tmp_path) == {}
    assert run(scene.replace(seed=5), tmp_path, [60], ["sat11"], ["A"]).n_image_rendered == 1


@pytest.mark.ci
def test_folders_that_are_links_are_refused(scene, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "sat11_A").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ws.InputError, match="sat11_A: must not be a link"):
        run(scene, tmp_path / "run", [60], ["sat11"], ["A"], formats="png")
    assert not list((tmp_path / "elsewhere").iterdir())


@pytest.mark.parametrize(
    ("damage", "n_kept"),
    [slow("tail", 4), ("amid", 2), ("shorter", 3), ("missing", 1), ("journal", 3), slow("odd", 4), slow("other", 4)],
)
@pytest.mark.ci
def test_only_whole_frames_are_kept(scene, tmp_path, monkeypatch, damage, n_kept):
    """What was written beyond the last whole frame is cut off; from the first damaged one on all is rendered again."""
    monkeypatch.setattr("warpsim.output.run.COUNTS_BYTES_PER_CALL", 1)
    options = {"formats": ("fits", "png")}
    broken_off_after(4, scene, tmp_path / "broken", **options)
    (growing,) = (tmp_path / "broken" / ".warpsim-parts" / "growing").glob("*/sat11")
    cube, image_bytes = growing / "files" / "sat11_A.fits", 2 * 128 * 128
    data = bytearray(cube.read_bytes())
    header_bytes = len(data) - 5 * image_bytes  # that of the fifth frame was not complete
    if damage == "tail":
        cube.write_bytes(data + b"half a frame")
    elif damage == "amid":
        data[header_bytes + 2 * image_bytes + 5] ^= 1
        cube.write_bytes(data)
    elif damage == "shorter":
        cube.write_bytes(data[: header_bytes + 4 * image_bytes - 1])
    elif damage == "missing":
        (growing / "files" / "sat11_E" / "000061.png").unlink()
    elif damage == "journal":
        journal = growing / "journal"
        journal.write_text(journal.read_text()[:-30])
    elif damage == "odd":
        with (growing / "journal").open("ab") as file:
            file.write(b"\xff\xfe []\n")
    else:
        (growing / "files" / "sat11_A" / "000099.png").write_text("nobody asked for it")
    assert run(scene, tmp_path / "broken", **options).n_image_rendered == 24 - 2 * n_kept
    run(scene, tmp_path / "whole", **options)
    assert files_of(tmp_path / "broken") == files_of(tmp_path / "whole")


@pytest.mark.ci
def test_another_run_does_not_replace_frames_that_are_complete_unless_told(scene, tmp_path, monkeypatch):
    monkeypatch.setattr("warpsim.output.run.COUNTS_BYTES_PER_CALL", 1)
    broken_off_after(2, scene, tmp_path)
    with pytest.raises(ws.InputError, match=r"holds a different run \(scene.seed: 2024 there, 5 here\)"):
        run(scene.replace(seed=5), tmp_path)
    assert run(scene.replace(seed=5), tmp_path, overwrite=True).n_image_rendered == 24


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"formats": ["jpg"]}, r"formats: must be among fits, fits-frames, tiff, png, exr, zarr, got 'jpg'"),
        ({"formats": []}, "formats: must name at least one"),
        ({"formats": None}, "formats: must name at least one"),
        ({"preview": "avi"}, "preview: must be gif or mp4, got 'avi'"),
    ],
)
def test_formats_that_are_not_there_are_named(scene, tmp_path, options, text):
    with pytest.raises(ws.InputError, match=text):
        run(scene, tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_missing_packages_are_named(scene, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(ws.InputError, match=r"the extra `zarr` brings: pip install 'warpsim\[zarr\]'"):
        run(scene, tmp_path / "out", formats=["zarr"])
    monkeypatch.setattr(grey.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ws.InputError, match=r"the extra `video` brings: pip install 'warpsim\[video\]'"):
        run(scene, tmp_path / "out", preview="mp4")
    assert not (tmp_path / "out").exists()


@pytest.mark.ci
def test_names_given_twice_are_written_once(scene, tmp_path):
    run(scene, tmp_path, [60], ["sat11"], ["A"], formats=["png", "png"])
    run(scene, tmp_path, [60], ["sat11"], ["A"], formats="png")
    assert [path.name for path in (tmp_path / "sat11_A").iterdir()] == ["000060.png"]
    shutil.rmtree(tmp_path / "sat11_A")
    assert run(scene, tmp_path, [60], ["sat11"], ["A"], formats="png").n_image_rendered == 1


@pytest.mark.ci
def test_animations_of_a_run_have_every_frame(scene, tmp_path):
    av = pytest.importorskip("av")
    run(scene, tmp_path, *PICKS[:2], ["A"], preview="mp4")
    with av.open(tmp_path / "sat47_A.mp4") as file:
        assert sum(1 for _ in file.decode(video=0)) == 6


@pytest.mark.slow
def test_killed_amid_images_and_arrays_then_completed(tmp_path, checkout_environment):
    """SIGKILL amid a sensor: what has its name is whole; the same command then gives the same bytes."""
    command = [*COMMAND, "stss", "--bands", "A", "--sensors", "sat11,sat12,sat27", "--quiet", "--format", "png,zarr"]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run([*command, "-o", str(whole)], env=checkout_environment, check=True, capture_output=True)
    expected = files_of(whole)
    for wanted in ("sat11_A/000070.png", "sat12_A/*.png", "sat12_A.zarr"):  # each time later
        process = subprocess.Popen([*command, "-o", str(killed)], env=checkout_environment, stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + 120
        while not list(killed.glob(wanted)) and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.002)
        assert process.poll() is None
        process.send_signal(signal.SIGKILL)
        process.wait()
        left = files_of(killed)
        finals = {name for name in left if not any(part.startswith(".") for part in Path(name).parts)}
        assert finals
        assert all(left[name] == expected[name] for name in finals), "half a file"
        # An array is there as a whole, or has no description.
        arrays = {name.split("/")[0] for name in finals if name.endswith(".zarr/zarr.json")}
        assert all(name in finals for name in expected if name.split("/")[0] in arrays)
    result = subprocess.run([*command[:-3], "--format", "png,zarr", "-o", str(killed)], env=checkout_environment,
                            check=True, capture_output=True, text=True)  # fmt: skip
    assert "images kept from before" in result.stdout
    assert files_of(killed) == expected
    assert not list(killed.rglob(".*"))


@pytest.mark.ci
def test_stars_of_kinds_with_other_bands(tmp_path):
    """A star's row has the bands of all kinds, and light in those of its own sensor."""
    scene = ws.Scene.load("two_cameras")
    kinds = scene.scenario.instruments
    sensors = [instrument.names[0] for instrument in kinds.values()]
    ws.render_to_folder(scene, tmp_path / "run", [0, 1], sensors, stars=True, every_frame=True, device="cpu")
    table = Table.read(tmp_path / "run" / "stars.fits")
    bands = table.meta["BANDS"].split(",")
    assert bands == list(dict.fromkeys(band for instrument in kinds.values() for band in instrument.bands))
    for sensor, instrument in zip(sensors, kinds.values(), strict=True):
        frames = ws.Renderer(scene, device="cpu").render([0, 1], [sensor], keep_stars=True)
        own = table[np.asarray(table["sensor"]).astype(str) == sensor]
        mine = [bands.index(band) for band in instrument.bands]
        np.testing.assert_array_equal(own["irradiance_w_cm2"][:, mine], frames.stars["irradiance_w_cm2"])
        others = np.setdiff1d(np.arange(len(bands)), mine)
        assert np.isnan(np.ma.filled(np.ma.asarray(own["snr"][:, others], dtype=float), np.nan)).all()
    assert len(table) > 0 and len(bands) > len(next(iter(kinds.values())).bands)
