"""Single images as files: numbers and facts come back as they were, to OpenImageIO and to others; animations."""

import json
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from astropy.io import fits
from astropy.wcs import WCS

import warpsim as ws
from warpsim.output.grey import write_preview
from warpsim.output.image_files import image_facts, read_image, write_counts, write_fits_image, write_signal

FRAME = 60
PLACE_PX = 1e-6
"""Keywords are decimal texts of 16 digits, and SIP polynomials are fitted to this."""
EVERY_COUNT = np.arange(65536, dtype=np.uint16).reshape(128, 512)
META = {"SCENE": "st\u00e4tte \u03b2", "NEI": 1.2345678901234567e-15, "FRAME": 7, "UPREPL": False, "note": "x" * 3000}
COUNTS_FILES = ["png", "tif", "tiff"]
SIGNAL_FILES = ["exr", "tif", "tiff"]


def levels_of(scene):
    """What counts of band A mean."""
    return scene.scenario.instrument.levels["A"]


def every_kind_of_float():
    """Zeros of both signs, denormals, the smallest and largest, infinities, NaN, and random bits of all exponents."""
    bits = np.random.default_rng(3).integers(0, 2**32, (60, 90), dtype=np.uint64).astype(np.uint32)
    ends = (1e-45, 1.1754942e-38, 1.1754944e-38, 3.4028235e38, np.inf)
    special = [0.0, -0.0, *ends, *(-end for end in ends), np.nan, 1e-15]
    image = bits.view(np.float32)
    image[0, : len(special)] = special
    return image


@pytest.mark.parametrize(
    ("write", "pixels", "suffix"),
    [
        *((write_counts, EVERY_COUNT, suffix) for suffix in COUNTS_FILES),
        *((write_signal, every_kind_of_float(), suffix) for suffix in SIGNAL_FILES),
    ],
)
def test_images_come_back_bit_for_bit(tmp_path, write, pixels, suffix):
    write(tmp_path / f"a.{suffix}", pixels, META)
    read, meta = read_image(tmp_path / f"a.{suffix}")
    assert (read.dtype, read.shape, read.tobytes()) == (pixels.dtype, pixels.shape, pixels.tobytes())
    assert meta == META


@pytest.mark.parametrize("suffix", COUNTS_FILES)
def test_pillow_reads_the_same_counts(tmp_path, suffix):
    image = pytest.importorskip("PIL.Image")
    path = tmp_path / f"a.{suffix}"
    write_counts(path, EVERY_COUNT, META)
    with image.open(path) as file:
        assert file.mode == "I;16"
        assert file.size == (512, 128)
        np.testing.assert_array_equal(np.asarray(file), EVERY_COUNT)
        text = file.info["Description"] if suffix == "png" else file.tag_v2[270]
    assert json.loads(text) == META


def test_png_makes_no_claim_about_colours(tmp_path):
    """Viewers would bend the numbers."""
    write_counts(tmp_path / "a.png", EVERY_COUNT, META)
    written = (tmp_path / "a.png").read_bytes()
    assert not any(chunk in written for chunk in (b"sRGB", b"gAMA", b"cHRM", b"iCCP", b"tIME"))


def test_pillow_reads_the_same_floats(tmp_path):
    image = pytest.importorskip("PIL.Image")
    signal = every_kind_of_float()
    write_signal(tmp_path / "a.tiff", signal, META)
    with image.open(tmp_path / "a.tiff") as file:
        np.testing.assert_array_equal(np.asarray(file).view(np.uint32), signal.view(np.uint32))


def test_views_of_other_arrays_are_written_as_they_look(tmp_path):
    """Neither steps nor the order of axes in memory matter."""
    for number, view in enumerate((EVERY_COUNT[::-2, 3::5], EVERY_COUNT.T, np.asfortranarray(EVERY_COUNT))):
        write_counts(tmp_path / f"{number}.png", view, {})
        np.testing.assert_array_equal(read_image(tmp_path / f"{number}.png")[0], view)


@pytest.mark.ci
def test_bytes_do_not_depend_on_time(tmp_path):
    small = EVERY_COUNT[:40]
    writers = {
        **{f"counts.{suffix}": lambda path: write_counts(path, small, META) for suffix in COUNTS_FILES},
        **{f"signal.{suffix}": lambda path: write_signal(path, every_kind_of_float(), META) for suffix in SIGNAL_FILES},
    }
    for round_ in ("first", "second"):
        (tmp_path / round_).mkdir()
        for name, write in writers.items():
            write(tmp_path / round_ / name)
        time.sleep(1.1)  # dates in files count seconds
    for name in writers:
        written = (tmp_path / "first" / name).read_bytes()
        assert written == (tmp_path / "second" / name).read_bytes()
        assert b"OpenImageIO" not in written
        spec = oiio.ImageInput.open(str(tmp_path / "first" / name)).spec()
        assert not spec.get_string_attribute("DateTime") and not spec.get_string_attribute("Software")


@pytest.mark.parametrize(
    ("write", "name", "pixels", "text"),
    [
        (write_counts, "a.jpg", EVERY_COUNT, r"a\.jpg: must end in one of \.png, \.tif, \.tiff"),
        (write_counts, "a.exr", EVERY_COUNT, r"a\.exr: must end in one of"),
        (write_signal, "a.png", np.zeros((2, 2), np.float32), r"a\.png: must end in one of \.exr, \.tif, \.tiff"),
        (write_counts, "a.png", EVERY_COUNT.astype(int), r"must be of uint16 and two axes, got int64"),
        (write_counts, "a.png", EVERY_COUNT[None], r"got uint16 of shape \(1, 128, 512\)"),
        (write_signal, "a.exr", np.zeros((0, 2), np.float32), r"got float32 of shape \(0, 2\)"),
    ],
)
def test_what_cannot_be_written_is_named(tmp_path, write, name, pixels, text):
    with pytest.raises(ws.InputError, match=text) as caught:
        write(tmp_path / name, pixels, {})
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_read_is_named(tmp_path):
    (tmp_path / "text.png").write_text("no image")
    for name in ("missing.png", "text.png", "text.unknown"):
        with pytest.raises(ws.InputError, match=rf"{name}: cannot be read: ") as caught:
            read_image(tmp_path / name)
        assert "\n" not in str(caught.value)
    colours = oiio.ImageBuf(oiio.ImageSpec(4, 4, 3, oiio.UINT8))
    assert colours.write(str(tmp_path / "colours.png"))
    with pytest.raises(ws.InputError, match="must have one channel of 16-bit counts or 32-bit floats, got 3 of uint8"):
        read_image(tmp_path / "colours.png")
    write_counts(tmp_path / "half.png", EVERY_COUNT, {})
    whole = (tmp_path / "half.png").read_bytes()
    (tmp_path / "half.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ws.InputError, match=r"half\.png: cannot be read"):
        read_image(tmp_path / "half.png")


def test_images_of_others_have_no_facts(tmp_path):
    image = pytest.importorskip("PIL.Image")
    image.fromarray(EVERY_COUNT).save(tmp_path / "a.png")
    counts, meta = read_image(tmp_path / "a.png")
    np.testing.assert_array_equal(counts, EVERY_COUNT)
    assert meta == {}


FILM = np.full((5, 33, 47), 300, dtype=np.uint16)
WRITERS = {
    "a.png": lambda path, scene: write_counts(path, EVERY_COUNT, {}),
    "a.tiff": lambda path, scene: write_counts(path, EVERY_COUNT[:2, :2], {}),
    "a.exr": lambda path, scene: write_signal(path, np.zeros((4, 4), np.float32), {}),
    "a.gif": lambda path, scene: write_preview(path, FILM, levels_of(scene)),
    "a.mp4": lambda path, scene: pytest.importorskip("av") and write_preview(path, FILM, levels_of(scene)),
    "a.fits": lambda path, scene: write_fits_image(path, rendered(scene), FRAME, "sat11", "A"),
}


def rendered(scene):
    return ws.Renderer(scene, device="cpu").render([FRAME], ["sat11"], ["A"])


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_told(scene, tmp_path, monkeypatch, name):
    """OpenImageIO alone says that PNG and GIF, and small EXR, were written."""
    (tmp_path / f".{name}.partial").symlink_to("/dev/full")
    monkeypatch.setattr(Path, "is_symlink", lambda path: False)  # which would be removed
    with pytest.raises(OSError, match=r"No space left on device.*a\.|a\..*(No space left|callback)"):
        WRITERS[name](tmp_path / name, scene)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", WRITERS)
def test_a_missing_folder_is_told(scene, tmp_path, name):
    with pytest.raises(OSError, match=r"No such file or directory: .*a\."):
        WRITERS[name](tmp_path / "none" / name, scene)


LENS = {"k1": -0.5, "k2": 2.0, "p1": 1e-3, "p2": -2e-3}
CAMERAS = {
    "plain": {"n_row": 96, "n_col": 128, "fov_deg": 1.0, "pixel_aspect": 1.25},
    "distorted": {"n_row": 96, "n_col": 128, "fov_deg": 8.0, "pixel_aspect": 1.25, "distortion": LENS},
}


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("way", ["fits", "png"])
@pytest.mark.ci
def test_the_header_leads_where_the_camera_sees(scene, tmp_path, camera, way):
    """Astropy alone, from the file alone, jitter on; without a warning. PNG: the facts in it are such a header."""
    shaken = scene.replace(camera=CAMERAS[camera], pointing__jitter={"rms_urad": 100.0, "correlation_s": 3.0})
    frames = ws.Renderer(shaken, device="cpu").render([FRAME, 63], ["sat11", "sat47"], ["A", "C"])
    assert np.abs(frames.axes_icrs[1, 1] - shaken.scenario.view_axes("sat47", [630.0])[0]).max() > 1e-6
    if way == "fits":
        write_fits_image(tmp_path / "a.fits", frames, 63, "sat47", "C")
        header = fits.getheader(tmp_path / "a.fits")
    else:
        write_counts(tmp_path / "a.png", frames.counts[1, 1, 1], image_facts(frames, 63, "sat47", "C"))
        header = fits.Header(read_image(tmp_path / "a.png")[1])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        wcs = WCS(header)
    assert (wcs.sip is not None) == (camera == "distorted")
    xy = np.stack(np.meshgrid(np.linspace(-0.5, 127.5, 9), np.linspace(-0.5, 95.5, 7)), axis=-1).reshape(-1, 2)
    lon, lat = np.radians(wcs.all_pix2world(xy, 0)).T
    direction = np.column_stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    places, in_front = shaken.camera.project(direction, frames.axes_icrs[1, 1])
    assert in_front.all()
    np.testing.assert_allclose(places, xy, rtol=0, atol=PLACE_PX)


@pytest.mark.ci
def test_a_single_fits_image(scene, tmp_path):
    described = scene.replace(detector={"kind": "nei", "nei_w_cm2": 1e-15, "sei_w_cm2": 1e-12, "exposure_s": 0.1})
    frames = ws.Renderer(described, device="cpu").render([FRAME, 63], ["sat11", "sat47"], ["A", "C"])
    path = tmp_path / "a.fits"
    write_fits_image(path, frames, 63, "sat47", "C")
    with fits.open(path) as file:
        file.verify("exception")
        assert len(file) == 1
        header, counts = file[0].header, file[0].data
    assert counts.dtype == np.uint16
    np.testing.assert_array_equal(counts, frames.counts.numpy()[1, 1, 1])
    known = {"FRAME": 63, "SENSOR": "sat47", "FILTER": "C", "EXPTIME": 0.1, "NEI": 1e-15, "SEI": 1e-12, "TIME_S": 630.0}
    assert {name: header[name] for name in known} == known
    seconds = (fits_time(header) - described.epoch).to_value("s")
    assert seconds == pytest.approx(630.0, abs=2e-6)  # dates are written to a microsecond
    assert header["MJD-OBS"] == pytest.approx(fits_time(header).mjd, abs=1e-11)
    assert (header["UPREPL"], header["BOREPL"]) == (False, False)
    ws.render_to_folder(described, tmp_path / "run", [63], ["sat47"], ["C"], device="cpu")
    cube = ws.read_cube(tmp_path / "run" / "sat47_C.fits")
    shared = set(cube.header) - {"SIMPLE", "NAXIS", "NAXIS3", "EXTEND", "BZERO", "BSCALE", "BITPIX"}
    assert {name: header[name] for name in shared} == {name: cube.header[name] for name in shared}
    row = {name: cube.frames[name][0] for name in cube.frames.colnames if "REPLACED" not in name}
    assert header["DATE-OBS"] == row.pop("DATE_OBS")
    assert {name: header[name] for name in row} == pytest.approx(row, rel=1e-14)  # headers are decimal texts
    before = path.read_bytes()
    write_fits_image(path, frames, 63, "sat47", "C")
    assert path.read_bytes() == before


def fits_time(header):
    from astropy.time import Time

    return Time(header["DATE-OBS"], scale="utc")


def test_images_that_were_not_rendered_are_named(scene, tmp_path):
    frames = rendered(scene)
    for frame, sensor, band in ((61, "sat11", "A"), (FRAME, "sat12", "A"), (FRAME, "sat11", "C")):
        with pytest.raises(
            ws.InputError, match=rf"image: frame {frame} of '{sensor}' in band '{band}' was not rendered"
        ):
            write_fits_image(tmp_path / "a.fits", frames, frame, sensor, band)
    assert list(tmp_path.iterdir()) == []


def film(scene, n=6, shape=(40, 50)):
    """Noise about the blank sky, and a bright pixel that moves; where it is in each image."""
    levels = levels_of(scene)
    rng = np.random.default_rng(1)
    counts = (levels.blank_counts + levels.counts_per_nei * rng.normal(0, 1, (n, *shape))).astype(np.uint16)
    places = [(5 + 3 * k, 40 - 4 * k) for k in range(n)]
    for image, place in zip(counts, places, strict=True):
        image[place] = levels.blank_counts + 100 * levels.counts_per_nei
    return counts, places


def pictures_of(path):
    """Frames of a film, as grey of shape (n, row, column), and their number a second."""
    if path.suffix == ".gif":
        image = pytest.importorskip("PIL.Image")
        with image.open(path) as file:
            rate, grey = 1000 / file.info["duration"], []
            for number in range(file.n_frames):
                file.seek(number)
                grey.append(np.asarray(file.convert("L")))
        return np.array(grey), rate
    av = pytest.importorskip("av")
    with av.open(path) as file:
        rate = float(file.streams.video[0].average_rate)
        return np.array([picture.to_ndarray(format="gray") for picture in file.decode(video=0)]), rate


@pytest.mark.parametrize("name", ["a.gif", "a.mp4"])
@pytest.mark.ci
def test_animations_show_every_image(scene, tmp_path, name):
    pytest.importorskip("av") if name == "a.mp4" else None
    counts, places = film(scene)
    path = tmp_path / name
    write_preview(path, counts, levels_of(scene), fps=12.5)
    grey, rate = pictures_of(path)
    assert grey.shape == counts.shape
    assert rate == pytest.approx(12.5)
    for picture, place in zip(grey, places, strict=True):
        assert np.unravel_index(picture.argmax(), picture.shape) == place
        assert picture.max() > 200 > 3 * np.median(picture)
    before = path.read_bytes()
    time.sleep(1.1)
    write_preview(path, counts, levels_of(scene), fps=12.5)
    assert path.read_bytes() == before


def test_small_images_of_a_gif_are_enlarged(scene, tmp_path):
    """OpenImageIO's palettes of fewer than 256 pixels hold what lay in memory."""
    counts = film(scene)[0][:2, :3, :5]
    written = []
    for filling in (0, 85, 170):
        junk = [np.full(size, filling, dtype=np.uint8) for size in range(10, 5000, 20)]
        del junk
        write_preview(tmp_path / "a.gif", counts, levels_of(scene))
        written.append((tmp_path / "a.gif").read_bytes())
    assert written[0] == written[1] == written[2]
    assert pictures_of(tmp_path / "a.gif")[0].shape == (2, 15, 25)


WRITE_A_FILM = """
import sys
import numpy as np
from warpsim.detector.levels import Levels
from warpsim.output.grey import write_preview
write_preview(sys.argv[2], np.load(sys.argv[1]), Levels(1e-15, 1e-12, float(sys.argv[3]), float(sys.argv[4])), 12.5)
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.gif", "a.mp4"])
def test_animations_do_not_depend_on_what_lay_in_memory(scene, tmp_path, checkout_environment, name):
    """Where x264 chooses the quality itself they do."""
    pytest.importorskip("av") if name == "a.mp4" else None
    np.save(tmp_path / "counts.npy", film(scene)[0])
    levels = [str(number) for number in (levels_of(scene).blank_counts, levels_of(scene).counts_per_nei)]
    written = []
    for filling in ("1", "85", "170"):  # of freed and of new memory, by the C library
        command = [sys.executable, "-c", WRITE_A_FILM, str(tmp_path / "counts.npy"), str(tmp_path / name), *levels]
        subprocess.run(command, env=checkout_environment | {"MALLOC_PERTURB_": filling}, check=True)
        written.append((tmp_path / name).read_bytes())
    assert written[0] == written[1] == written[2]


@pytest.mark.parametrize("name", ["a.gif", "a.mp4"])
def test_large_images_are_reduced_by_their_brightest_pixels(scene, tmp_path, monkeypatch, name):
    pytest.importorskip("av") if name == "a.mp4" else None
    monkeypatch.setattr("warpsim.output.grey.PREVIEW_PX", 30)
    counts, places = film(scene)  # 40 x 50 by blocks of 2: 20 x 25; MP4 has even sides
    write_preview(tmp_path / name, counts, levels_of(scene))
    grey, _ = pictures_of(tmp_path / name)
    assert grey.shape == ((6, 20, 25) if name == "a.gif" else (6, 20, 26))
    for picture, (row, column) in zip(grey, places, strict=True):
        assert np.unravel_index(picture.argmax(), picture.shape) == (row // 2, column // 2)


@pytest.mark.parametrize(
    ("name", "counts", "fps", "text"),
    [
        ("a.avi", FILM, 10, r"a\.avi: must end in one of \.gif, \.mp4"),
        ("a.gif", FILM, 60, r"a\.gif: fps: must be in \[0\.01, 50\], got 60"),
        ("a.gif", FILM, 0, "fps: must be in"),
        ("a.gif", FILM, float("nan"), "fps: must be in"),
        ("a.gif", FILM[:0], 10, r"counts: must have the shape \(n, row, column\), got \(0, 33, 47\)"),
        ("a.gif", FILM[0], 10, r"got \(33, 47\)"),
    ],
)
def test_animations_that_cannot_be_made_are_named(scene, tmp_path, name, counts, fps, text):
    with pytest.raises(ws.InputError, match=text):
        write_preview(tmp_path / name, counts, levels_of(scene), fps)
    assert list(tmp_path.iterdir()) == []


def test_mp4_says_which_extra_it_needs(scene, tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ws.InputError, match=r"needs PyAV, .* the extra `video` brings: pip install 'warpsim\[video\]'"):
        write_preview(tmp_path / "a.mp4", FILM, levels_of(scene))


# --- CCDData: light, its errors against draws, and what stands beside it ---


NEI = {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "counts_per_nei": 0.7}
ELECTRONS = {
    "kind": "electron", "exposure_s": 0.1, "full_well_e": 1e6, "gain_e_per_count": 16.0, "bits": 16, "dark_e_s": 1e4,
    "read_noise_e": 60.0,
}  # fmt: skip


@pytest.mark.parametrize("detector", [NEI, ELECTRONS], ids=["nei", "electrons"])
def test_errors_are_those_of_the_noise(detector):
    """Light less the noiseless signal, over the stated errors, is unit normal; bright pixels have their shot noise."""
    scene = ws.Scene.load("stss").replace(detector=detector, bands=["A"])
    frames = ws.Renderer(scene).render(range(60, 100), sensors=["sat21"], keep_signal=True)
    ratios, bright = [], []
    for index, frame in enumerate(frames.frames):
        image = ws.ccddata(frames, frame, "sat21", "A")
        signal = frames.signal_w_cm2.numpy()[index, 0, 0].astype(float)
        free = ~image.mask
        error = (image.data - signal) / image.uncertainty.array
        ratios.append(error[free])
        bright.append(error[free & (signal > 30 * scene.scenario.instrument.nei_w_cm2("A"))])
    ratios, bright = np.concatenate(ratios), np.concatenate(bright)
    assert ratios.std() == pytest.approx(1.0, abs=5 / np.sqrt(2 * len(ratios)) + 0.003)
    assert len(bright) > 50 and bright.std() == pytest.approx(1.0, abs=5 / np.sqrt(2 * len(bright)))
    assert abs(ratios.mean()) < 5 / np.sqrt(len(ratios)) + 2e-3


def test_what_stands_beside_an_image():
    scene = ws.Scene.load("stss").replace(bands=["A", "C"])
    frames = ws.Renderer(scene).render([60, 61], sensors=["sat11", "sat21"])
    image = ws.ccddata(frames, 61, "sat21", "C")
    assert image.unit == "W / cm2" and image.meta["SENSOR"] == "sat21" and image.meta["FRAME"] == 61
    assert image.meta["FILTER"] == "C" and image.meta["DATE-OBS"].startswith("2025-01-01T14:10:10")
    assert not image.mask.any()
    sky, own = image.wcs.pixel_to_world(3.0, 90.0), frames.wcs(61, "sat21").pixel_to_world(3.0, 90.0)
    assert sky.separation(own).arcsec == 0.0
    counts = frames.counts.numpy()[1, 1, 1]
    np.testing.assert_allclose(image.data, (counts - 100.0) / 5.0 * 1e-18, atol=1e-32)
    with pytest.raises(ws.InputError, match="ccddata: frame 7"):
        ws.ccddata(frames, 7, "sat21", "C")


def test_full_pixels_are_masked():
    scene = ws.Scene.load("stss").replace(detector=NEI | {"sei_w_cm2": 2e-17, "hot_fraction": 0.01}, bands=["A"])
    frames = ws.Renderer(scene).render([60], sensors=["sat21"])
    image = ws.ccddata(frames, 60, "sat21", "A")
    assert image.mask.mean() == pytest.approx(0.01, abs=0.005)
    assert (frames.counts.numpy()[0, 0, 0][image.mask] == frames.counts.numpy().max()).all()
