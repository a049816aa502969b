"""From the scene's words to the image: each property of the description must be seen in what is rendered."""

import numpy as np
import pytest
from scipy.special import erf

import warpsim as ws
from warpsim.output.contact_sheet import GAP_PX, LEFT_PX, TILE_PX, TOP_PX, draw_contact_sheet, grey_tile
from warpsim.output.formats import Images
from warpsim.output.grey import window_about
from warpsim.target.attitude import body_motion

C_M_S = 299_792_458.0
SIGNAL_REL = 1e-6
"""float32 sums of some tens of sources, relative to the brightest pixel, and the stamps' cut of 1e-6 NEI."""
ASPECT_RAD = 1e-7
"""Sensor and target positions from the host's tracks; the axis itself is good to 1e-9 rad."""


def test_every_pixel_is_the_sum_of_the_labelled_sources(scene, record_accuracy):
    """Noiseless signal against error-function sums over truth and star rows: x and y, light and label, all bands."""
    soft = scene.replace(optics={"aperture_m": 0.4, "psf": "gaussian", "sigma_px": 0.9, "stamp_cut_nei": 1e-6})
    frames = ws.Renderer(soft, device="cpu").render([77], ["sat27", "sat12"], keep_signal=True, keep_stars=True)
    edges = np.arange(129) - 0.5
    for i, sensor in enumerate(frames.sensors):
        stars = frames.stars[frames.stars["sensor"] == sensor]
        for j, band in enumerate(frames.bands):
            rows = frames.truth[(frames.truth["sensor"] == sensor) & (frames.truth["band"] == band)]
            x = np.concatenate([rows["x_px"], stars["x_px"]])
            y = np.concatenate([rows["y_px"], stars["y_px"]])
            light = np.concatenate([rows["irradiance_w_cm2"], stars["irradiance_w_cm2"][:, j]])
            across, down = (
                np.diff(erf((edges[None, :] - centre[:, None]) / (0.9 * np.sqrt(2))), axis=1) / 2 for centre in (x, y)
            )
            expected = np.einsum("s,sr,sc->rc", light, down, across)
            signal = frames.signal_w_cm2.numpy()[0, i, j]
            atol = SIGNAL_REL * expected.max() + 1e-6 * 1e-18 * 60
            np.testing.assert_allclose(signal, expected, rtol=0, atol=atol)
            error, limit = np.abs(signal - expected).max() / expected.max(), atol / expected.max()
            record_accuracy("Pixels of a scene", error, limit, "of the brightest", "error functions at the labels")
            # The group is neither on the diagonal nor symmetric: a swap of x and y would show.
            assert np.abs(signal - signal.T).max() > 0.5 * signal.max()


def test_targets_behind_the_earth_give_no_light(scene):
    dark = scene.replace(sky__catalog="none")
    frames = ws.Renderer(dark, device="cpu").render([5], dark.sensor_names, ["A"], keep_signal=True)
    truth = frames.truth
    assert 0 < np.count_nonzero(truth["occulted"]) < len(truth)
    assert np.all(truth["irradiance_w_cm2"][truth["occulted"]] == 0)
    assert np.all(truth["irradiance_w_cm2"][~truth["occulted"]] > 0)
    for i, sensor in enumerate(frames.sensors):
        rows = truth[truth["sensor"] == sensor]
        light = frames.signal_w_cm2.numpy()[0, i].max()
        assert (light == 0) == bool(np.all(rows["occulted"]))


@pytest.mark.parametrize("target", ["center", "sphere02", "cylinder04", "cone03"])
def test_aspect_follows_the_described_motion(scene, target):
    """Spin, precession and rolling rates and angles of the scene, by complex rotation of the axis at emission time."""
    quick = scene.replace(frames={"count": 60, "interval_s": 0.037, "start_s": 700.0})
    frames = ws.Renderer(quick, device="cpu").render(range(60), ["sat11"], ["A"])
    rows = frames.truth[frames.truth["target"] == target]
    number = scene.target_names.index(target)
    motion = scene.scenario.targets[number].spec.attitude
    velocity = scene.scenario.tracks.targets[number].state(np.zeros(1))[1][0]
    frame = body_motion(motion, velocity, scene.seed, number)
    (reference, first, second), precession, rolling = frame.axes, frame.precession_phase_rev, frame.rolling_phase_rev
    aspect = []
    for row in rows:
        sensor = scene.position_m("sat11", [row["time_s"]])[0]
        emitted_s = row["time_s"] - row["range_km"] * 1e3 / C_M_S
        sight = sensor - scene.position_m(target, [emitted_s])[0]
        azimuth = np.exp(2j * np.pi * (motion.precession_rev_s * emitted_s + precession))
        tumbled = 2j * np.pi * (motion.rolling_rev_s * emitted_s + rolling)
        polar = np.exp(1j * np.radians(motion.precession_angle_deg) + tumbled)
        axis = polar.real * reference + polar.imag * (azimuth.real * first + azimuth.imag * second)
        aspect.append(np.arctan2(np.linalg.norm(np.cross(axis, sight)), axis @ sight))
    np.testing.assert_allclose(np.radians(rows["aspect_deg"]), aspect, rtol=0, atol=ASPECT_RAD)
    swing = np.ptp(np.degrees(aspect))
    if motion.rolling_rev_s:
        assert swing > 90
    else:  # twice the precession angle, seen from the side
        assert motion.precession_angle_deg < swing <= 2 * motion.precession_angle_deg + 0.1


def test_noise_differs_between_bands_sensors_and_frames(scene):
    frames = ws.Renderer(scene.replace(sky__catalog="none"), device="cpu").render(range(60, 64), ["sat11", "sat12"])
    counts = frames.counts.numpy().astype(np.float64)
    noise = (counts - counts.mean(axis=(3, 4), keepdims=True))[..., :40, :].reshape(24, -1)  # off the targets
    correlation = np.corrcoef(noise) - np.eye(24)
    assert np.abs(correlation).max() < 5 / np.sqrt(noise.shape[1])


def test_truth_says_when_there_is_access(scene):
    frames = ws.Renderer(scene, device="cpu").render([0, 30, 80, 150], bands=["A"])
    margins = scene.access_margins(frames.time_s)
    allowed = np.minimum.reduce(list(margins.values())) >= 0
    assert allowed.any() and not allowed.all()
    for row in frames.truth[frames.truth["target"] == "center"]:
        sensor, frame = scene.sensor_names.index(row["sensor"]), frames.frames.index(row["frame"])
        assert row["access"] == allowed[sensor, frame]


@pytest.mark.parametrize(("n_row", "n_col"), [(128, 128), (40, 100), (300, 260)])
def test_tiles_keep_the_orientation_and_every_point(scene, n_row, n_col):
    counts = np.full((n_row, n_col), 100, dtype=np.uint16)
    counts[n_row // 10, n_col - 2] = 8000  # near the top, far right
    tile = grey_tile(counts, scene.scenario.instrument.levels["A"])
    row, column = np.unravel_index(tile.argmax(), tile.shape)
    assert max(tile.shape) <= TILE_PX
    assert row / tile.shape[0] == pytest.approx(0.1, abs=0.05)
    assert column / tile.shape[1] > 0.95
    assert tile.max() == 255


def test_contact_sheet_shows_the_frames_it_says(scene, tmp_path):
    """Stand-in images whose level tells sensor and frame, with a bright point near the top right: read both back."""
    import OpenImageIO as oiio

    frames_of = {"sat11": list(range(40, 50)), "sat47": [44, 45]}
    base = {"sat11": 110, "sat47": 200}

    def planes(row, frames):
        images = np.stack([np.full((128, 128), base[row.sensor] + 2 * frame, dtype=np.uint16) for frame in frames])
        images[:, 30, 120] = 8000
        return images

    path = tmp_path / "sheet.png"
    instrument = scene.scenario.instrument
    rows = [Images(scene.scenario, sensor, "A", frames) for sensor, frames in frames_of.items()]
    draw_contact_sheet(scene, rows, planes, path)
    pixels = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)
    for row, sensor in enumerate(frames_of):
        for column in range(10):
            top, left = TOP_PX + row * (TILE_PX + GAP_PX), LEFT_PX + column * (TILE_PX + GAP_PX)
            seen = pixels[top + 100, left + 10, 0]
            if 40 + column in frames_of[sensor]:
                expected = grey_tile(planes(rows[row], [40 + column])[0], instrument.levels["A"])[0, 0]
                assert seen == expected, (sensor, column)
                assert pixels[top + 30, left + 120, 0] == 255
                assert np.count_nonzero(pixels[top + 20 : top + 128, left : left + 128, 0] == 255) == 1
            else:
                assert seen == 40, (sensor, column)  # "no access"


def test_a_sheet_of_targets_shows_the_part_about_them_with_ticks(scene, tmp_path):
    import OpenImageIO as oiio

    image = np.full((128, 128), 100, dtype=np.uint16)
    image[70, 61] = image[70, 81] = 8000
    xy_px = np.array([(61.0, 70.0), (81.0, 70.0), (400.0, 2.0)])  # the last is outside
    rows = [Images(scene.scenario, "sat11", "A", [60])]
    path = tmp_path / "sheet.png"
    draw_contact_sheet(scene, rows, lambda *_: image[None], path, lambda *_: [xy_px])
    assert window_about(xy_px, image.shape) == (slice(52, 89), slice(53, 90))
    assert window_about(xy_px[2:], image.shape) == (slice(0, 128), slice(0, 128))
    pixels = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)
    tile = pixels[TOP_PX : TOP_PX + TILE_PX, LEFT_PX : LEFT_PX + TILE_PX]
    per_px = TILE_PX / 37
    for column in (61, 81):
        x, y = int((column - 53 + 0.5) * per_px), (70 - 52 + 0.5) * per_px
        assert tuple(tile[int(y), x]) == (255, 255, 255)
        assert tuple(tile[round(y - 2 * per_px), x]) == (79, 209, 255)
    blue = (tile == (79, 209, 255)).all(axis=2)
    assert len(set(np.nonzero(blue)[1].tolist())) == 2 and (tile[~blue].max(axis=1) == tile[~blue].min(axis=1)).all()


def test_an_unknown_sheet_is_refused(scene, tmp_path):
    with pytest.raises(ws.InputError, match="sheet: must be whole or targets, got 'crop'"):
        ws.render_to_folder(scene, tmp_path / "run", sheet="crop")
    assert not (tmp_path / "run").exists()
