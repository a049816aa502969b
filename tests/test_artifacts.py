"""Radiation hits and flickering pixels: statistics against closed forms, charge against what frames hold."""

import numpy as np
import pytest
import warp as wp
from astropy.io import fits
from astropy.table import Table
from scipy import stats
from warpsim_kernels import artifacts as kernel_artifacts
from warpsim_kernels.artifacts import Hits, Track, track_of

import warpsim as ws
from warpsim.cli import main
from warpsim.detector.hits_and_flicker import LONGEST_TANGENT
from warpsim.render.calibration_frames import calibration_counts, detector_maps

NEI = {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "exposure_s": 0.0}
HITS = {"rate_cm2_s": 500.0, "nei_per_um": 4.0, "integration_s": 0.1, "pixel_pitch_um": 50.0, "thickness_um": 20.0}
ELECTRONS = {
    "kind": "electron", "exposure_s": 0.1, "full_well_e": 1e6, "gain_e_per_count": 20.0, "bits": 16,
    "shot_noise": False,
}  # fmt: skip


def scene_of(detector, n_row=64, n_col=96, **changes):
    camera = {"n_row": n_row, "n_col": n_col, "fov_deg": 1.0}
    frames = {"count": 1600, "interval_s": 1.0}
    given = {"detector": detector, "camera": camera, "bands": ["A", "C"], "frames": frames, "sky__catalog": "none"}
    return ws.Scene.load("stss").replace(**given, **changes)


@wp.kernel(enable_backward=False)
def tracks_kernel(hits: Hits, n_col: int, n_row: int, tracks: wp.array[Track]):
    number = wp.tid()
    key = wp.vec2ui(wp.uint32(7), wp.uint32(9))
    tracks[number] = track_of(hits, number, n_col, n_row, 1.0, wp.uint32(3), wp.uint32(2), key)


def tracks_of(n, landau_width=0.15, n_col=200, n_row=100, margin=(3.0, 6.0), thickness=(0.5, 0.25)):
    hits = Hits()
    hits.margin_px, hits.thickness_px = wp.vec2d(*margin), wp.vec2d(*thickness)
    hits.landau_width = landau_width
    tracks = wp.zeros(n, dtype=Track, device="cpu")
    wp.launch(tracks_kernel, dim=n, inputs=[hits, n_col, n_row], outputs=[tracks], device="cpu")
    return tracks.numpy()


LEAST_P = 1e-4
"""Of tests of distributions; seeds are fixed."""


def test_tracks_have_the_distributions_that_are_stated():
    tracks = tracks_of(200_000)
    x, y = tracks["start_px"].T
    assert stats.kstest(x, stats.uniform(-3.5, 206.0).cdf).pvalue > LEAST_P
    assert stats.kstest(y, stats.uniform(-6.5, 112.0).cdf).pvalue > LEAST_P
    tangent = np.hypot(*(tracks["way_px"] / (0.5, 0.25)).T)
    cosine_2 = 1.0 / (1.0 + tangent**2)  # uniform, cut at the flattest
    assert tangent.max() == pytest.approx(30.0)
    assert stats.kstest(cosine_2[tangent < 29.99], stats.uniform(1 / 901, 900 / 901).cdf).pvalue > LEAST_P
    turn = np.arctan2(*(tracks["way_px"] / (0.5, 0.25)).T[::-1])
    assert stats.kstest(turn, stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > LEAST_P
    loss = tracks["level_w_cm2"] * np.sqrt(cosine_2)
    moyal = stats.moyal(1.0 - 0.15 * stats.moyal.mean(), 0.15)
    assert stats.kstest(loss, moyal.cdf).pvalue > LEAST_P
    assert loss.mean() == pytest.approx(1.0, abs=5 * 0.15 * stats.moyal.std() / np.sqrt(200_000)) and loss.min() > 0.0
    for one, other in ((x, y), (x, cosine_2), (turn, cosine_2), (loss, cosine_2), (loss, x), (turn, loss)):
        assert abs(np.corrcoef(one, other)[0, 1]) < 5 / np.sqrt(200_000)


def image_by_samples(start, way, level, n_row, n_col, n=20_001):
    """The charge of a track, of points along it."""
    points = start + way * (np.arange(n)[:, None] + 0.5) / n
    col, row = np.floor(points + 0.5).astype(int).T
    inside = (col >= 0) & (col < n_col) & (row >= 0) & (row < n_row)
    image = np.zeros((n_row, n_col))
    np.add.at(image, (row[inside], col[inside]), level / n)
    return image


@pytest.mark.ci
def test_charge_lies_along_the_tracks():
    """A frame's hits are those of samples along the same tracks, within two samples of a pixel."""
    scene = scene_of(NEI | {"hits": HITS}, camera__pixel_aspect=1.5)
    frames = ws.Renderer(scene).render([5], sensors=["sat21"])
    own = frames._device_scene.artifacts
    table = frames.artifacts
    for band, name in enumerate(("A", "C")):
        image = np.zeros((64, 96))
        mine = table[table["band"] == name]
        image[mine["y_px"], mine["x_px"]] = mine["irradiance_w_cm2"]
        tracks = wp.zeros(200, dtype=Track, device="cpu")
        level, number = float(own.hits.level_w_cm2.numpy()[band]), list(scene.bands).index(name)
        key = wp.vec2ui(*own.key.numpy()[frames.instrument.index("sat21")])
        wp.launch(one_image_kernel, 200, [own.hits, 96, 64, level, 5, number, key], [tracks], device="cpu")
        found = [image_by_samples(t["start_px"], t["way_px"], t["level_w_cm2"], 64, 96) for t in tracks.numpy()]
        # The number of hits is what the image says it is: the first so many, and no other.
        sums = np.cumsum([one.sum() for one in found])
        count = int(np.argmin(np.abs(sums - image.sum()))) + 1
        expected = np.sum(found[:count], axis=0)
        np.testing.assert_allclose(image, expected, atol=4e-4 * max(t["level_w_cm2"] for t in tracks.numpy()[:count]))
        assert count > 5


@wp.kernel(enable_backward=False)
def one_image_kernel(
    hits: Hits, n_col: int, n_row: int, level: float, frame: int, band: int, key: wp.vec2ui, tracks: wp.array[Track]
):
    number = wp.tid()
    tracks[number] = track_of(hits, number, n_col, n_row, level, wp.uint32(frame), wp.uint32(band), key)


def test_numbers_of_hits_are_poisson_and_their_mean_is_the_rate():
    """Steep tracks in a thin layer: a hit is a pixel, but for those that share one."""
    hits = HITS | {"thickness_um": 1e-3, "rate_cm2_s": 400.0, "landau_width": 0.0}
    scene = scene_of(NEI | {"hits": hits})
    table = ws.Renderer(scene).render(range(1000), sensors=["sat21"], bands=["A"]).artifacts
    count = np.bincount(table["frame"], minlength=1000)
    mean = 400.0 * (64 * 96 * 50e-4**2) * 0.1  # rate, area, time
    assert count.mean() == pytest.approx(mean, abs=5 * np.sqrt(mean / 1000) + 0.01 * mean)
    assert count.var() == pytest.approx(mean, rel=5 * np.sqrt(2 / 1000))


@pytest.mark.ci
def test_hits_in_electrons_are_the_counts_that_they_give():
    """Without noise a frame less the same without hits is their charge over the gain."""
    hits = {"rate_cm2_s": 2000.0, "e_per_um": 100.0, "pixel_pitch_um": 50.0}
    with_hits, without = scene_of(ELECTRONS | {"hits": hits}), scene_of(ELECTRONS)
    frames = ws.Renderer(with_hits).render([3], sensors=["sat21"], bands=["C"], keep_signal=True)
    plain = ws.Renderer(without).render([3], sensors=["sat21"], bands=["C"], keep_signal=True)
    assert np.array_equal(frames.signal_w_cm2.numpy(), plain.signal_w_cm2.numpy())  # hits are no light
    more = frames.counts.numpy()[0, 0, 0].astype(float) - plain.counts.numpy()[0, 0, 0]
    table = frames.artifacts
    charge_e = np.zeros(more.shape)
    charge_e[table["y_px"], table["x_px"]] = table["charge_e"]
    assert len(table) > 5
    np.testing.assert_allclose(more, charge_e / 20.0, atol=1.0)
    mask = frames.artifact_mask(3, "sat21", "C")
    assert np.array_equal(mask, (charge_e > 0).astype(np.uint8))


FLICKER = {"fraction": 0.02, "nei": 40.0, "duty": 0.3, "dwell_frames": 5}


def test_pixels_flicker_as_stated():
    scene = scene_of(NEI | {"flicker": FLICKER})
    table = ws.Renderer(scene).render(range(1000), sensors=["sat21"], bands=["A"]).artifacts
    maps = detector_maps(scene.scenario, "sat21", ["A", "C"])
    level = maps.flicker[0]
    n = np.count_nonzero(level)
    assert n == pytest.approx(0.02 * 64 * 96, abs=5 * np.sqrt(0.02 * 64 * 96))
    assert stats.kstest(level[level > 0] / 1e-18, stats.expon(scale=40.0).cdf).pvalue > LEAST_P
    assert set(table["kind"]) == {"flicker"}
    np.testing.assert_array_equal(table["irradiance_w_cm2"], level[table["y_px"], table["x_px"]])
    on = np.zeros((1000, 64, 96), dtype=bool)
    on[table["frame"], table["y_px"], table["x_px"]] = True
    on = on[:, level > 0].astype(float)
    assert on.mean() == pytest.approx(0.3, abs=5 * np.sqrt(0.3 * 0.7 * 5 / on.size))
    centred = on - 0.3  # a state lasts five frames: the correlation falls to 0 in a straight line
    for lag in range(8):
        mean = np.mean(centred[: 1000 - lag] * centred[lag:])
        assert mean == pytest.approx(0.21 * max(0.0, 1 - lag / 5), abs=0.01)
    starts = np.argmax(np.diff(on, axis=0) != 0, axis=0) % 5
    assert np.ptp(np.bincount(starts, minlength=5)) < n / 5  # they do not change together
    assert np.count_nonzero(level * maps.flicker[1]) < 0.1 * n  # other pixels in another band


def test_flicker_is_in_the_counts():
    scene = scene_of(NEI | {"flicker": FLICKER | {"nei": 400.0}})
    frames = ws.Renderer(scene).render(range(40), sensors=["sat21"], bands=["A"])
    plain = ws.Renderer(scene.replace(detector__flicker=None)).render(range(40), sensors=["sat21"], bands=["A"])
    more = frames.counts.numpy().astype(float) - plain.counts.numpy()
    table = frames.artifacts
    expected = np.zeros((40, 64, 96))
    expected[table["frame"], table["y_px"], table["x_px"]] = np.asarray(table["irradiance_w_cm2"]) / 1e-18 * 5.0
    free = expected < 3e-15 / 1e-18 * 5.0 * 0.9
    np.testing.assert_allclose(more[:, 0, 0][free], expected[free], atol=1.01)  # both rounded


BOTH = NEI | {"hits": HITS, "flicker": FLICKER}


@pytest.mark.ci
def test_a_frame_is_the_same_alone_and_in_any_batch():
    scene = scene_of(BOTH, n_row=37, n_col=53)
    every = ws.Renderer(scene, n_thread=2).render(range(30), sensors=["sat21", "sat11"])
    alone = ws.Renderer(scene, n_thread=1, chunk_bytes=1).render([17], sensors=["sat11"], bands=["C"])
    assert np.array_equal(alone.counts.numpy()[0, 0, 0], every.counts.numpy()[17, 1, 1])
    rows = every.artifacts
    rows = rows[(rows["frame"] == 17) & (rows["sensor"] == "sat11") & (rows["band"] == "C")]
    assert len(rows) and np.array_equal(rows["irradiance_w_cm2"], alone.artifacts["irradiance_w_cm2"])
    others = every.counts.numpy()[17]
    assert not np.array_equal(others[0], others[1])


def test_a_detector_without_them_has_none():
    frames = ws.Renderer(scene_of(NEI)).render([0], sensors=["sat21"], bands=["A"])
    assert len(frames.artifacts) == 0 and "irradiance_w_cm2" in frames.artifacts.colnames
    assert not frames.artifact_mask(0, "sat21", "A").any()
    assert frames._device_scene.artifacts is None


@pytest.mark.ci
def test_runs_write_them(tmp_path):
    scene = tmp_path / "scene.toml"
    scene_of(BOTH).save(scene)
    assert ws.Scene.load(scene) == scene_of(BOTH).replace(name=ws.Scene.load(scene).name)
    arguments = ["render", str(scene), "-o", str(tmp_path / "out"), "--frames", "600:603", "--sensors", "sat21"]
    assert main([*arguments, "--quiet"]) == 0
    frames = ws.Renderer(ws.Scene.load(scene)).render(range(600, 603), sensors=["sat21"])
    written, expected = Table.read(tmp_path / "out" / "artifacts.fits"), frames.artifacts
    assert written.colnames == expected.colnames and len(written) == len(expected) > 0
    for name in ("frame", "x_px", "y_px", "irradiance_w_cm2"):
        np.testing.assert_array_equal(written[name], expected[name])
    header = fits.getheader(tmp_path / "out" / "sat21_A.fits")
    assert header["HITS"] == "500/cm2/s, 4 NEI/um" and header["FLICKER"] == "0.02 of the pixels, 40 NEI, duty 0.3"
    with fits.open(tmp_path / "out" / "sat21.maps.fits") as hdus:
        assert np.count_nonzero(hdus["FLICKER_C"].data) > 50 and hdus["FLICKER_C"].header["BUNIT"] == "W/cm2"


def test_dark_frames_have_them_and_bias_frames_have_not():
    detector = ELECTRONS | {"dark_e_s": 100.0, "flicker": {"fraction": 0.05, "e_s": 1e5, "duty": 1.0}}
    scene = scene_of(detector).scenario
    bias, dark = (calibration_counts(scene, "sat21", ["A"], kind, 1)[0, 0].astype(float) for kind in ("bias", "dark"))
    level = detector_maps(scene, "sat21", ["A"]).flicker[0]
    assert level[level > 0].mean() == pytest.approx(1e4, rel=0.3)
    np.testing.assert_allclose(dark - bias, (level + 10.0) / 20.0, atol=1.01)


IN_NEI = "must be given for a detector in NEI terms"
IN_ELECTRONS = "must be given for a detector in electrons"


@pytest.mark.parametrize(
    ("detector", "message"),
    [
        (NEI | {"hits": {"rate_cm2_s": 5.0}}, "hits: e_per_um, nei_per_um: exactly one must be given"),
        (NEI | {"hits": HITS | {"nei_per_um": None, "e_per_um": 1.0}}, f"hits.nei_per_um: {IN_NEI}, not e_per_um"),
        (NEI | {"hits": HITS | {"integration_s": None}}, "hits.integration_s: must be given where exposure_s is 0"),
        (NEI | {"hits": HITS | {"rate_cm2_s": -1.0}}, "hits.rate_cm2_s: must be > 0"),
        (NEI | {"hits": HITS | {"landau_width": 0.3}}, "hits.landau_width: must be in [0, 0.19]"),
        (NEI | {"flicker": {"fraction": 0.1, "e_s": 3.0}}, f"flicker.nei: {IN_NEI}, not e_s"),
        (ELECTRONS | {"flicker": {"fraction": 0.1, "nei": 3.0}}, f"flicker.e_s: {IN_ELECTRONS}, not nei"),
        (NEI | {"flicker": FLICKER | {"fraction": 0.6}}, "flicker.fraction: must be in [0, 0.5]"),
        (NEI | {"flicker": FLICKER | {"dwell_frames": 0}}, "flicker.dwell_frames: must be"),
    ],
)
def test_bad_descriptions_are_refused(detector, message):
    with pytest.raises(ws.InputError) as error:
        scene_of(detector)
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("hits", "message"),
    [
        (HITS | {"pixel_pitch_um": None}, "hits.pixel_pitch_um: must be given where the camera has no pixel_pitch_m"),
        (HITS | {"rate_cm2_s": 1e12}, "hits.rate_cm2_s: must give at most 1e+06 hits in an image"),
    ],
)
def test_hits_that_do_not_fit_the_camera_are_refused(hits, message):
    with pytest.raises(ws.InputError) as error:
        scene_of(NEI | {"hits": hits})
    assert message in str(error.value)


def test_longest_tracks_are_those_of_the_kernel():
    assert LONGEST_TANGENT == kernel_artifacts.LONGEST_TANGENT


def test_quantities_are_converted():
    import astropy.units as u

    hits = ws.RadiationHits(rate_cm2_s=3e4 / u.m**2 / u.s, e_per_um=1e5 * u.electron / u.mm)
    assert (hits.rate_cm2_s, hits.e_per_um) == (pytest.approx(3.0), pytest.approx(100.0))
