"""Hard cases end to end, through the renderer: each image finite, its counts in range, and right by a slow reference.

Stars are put where a test wants them on the image: the camera's inverse on the axes of the view, without aberration.
"""

from __future__ import annotations

import copy

import numpy as np
import pytest
from astropy.table import MaskedColumn, Table
from fuzz_cases import SCENE
from scipy.special import j1, ndtr

import warpsim as ws

SENSOR, FRAME = "sat11", 75
NEI, SEI = 1e-18, 3e-15
W_CM2_PER_JY = ws.BANDS["A"].w_cm2_per_jy
SIGMA_PX = 0.8

FRACTION = 3e-7
"""Of a star's light, in a pixel: float32 fractions and sums."""
POSITION_PX = 1e-8
"""Of a star put at a position: rounding of degrees in the catalog, times the focal length."""
NOISE_SIGMAS = 7.0
"""No pixel of these few images is farther off: 2e-12 each."""


def sky_scene(scene, camera, pointing=(30.0, 40.0), detector=(), **optics):
    """One sensor that looks in a fixed direction, with stars only."""
    one_target = [scene.to_dict()["groups"][0]["targets"][0]]
    return scene.replace(
        camera={"fov_deg": 1.0, **camera},
        optics={"aperture_m": 0.4, "psf": "gaussian", "sigma_px": SIGMA_PX, "stamp_cut_nei": 1e-9, **optics},
        detector={"kind": "nei", "nei_w_cm2": NEI, "sei_w_cm2": SEI, **dict(detector)},
        pointing={"kind": "fixed", "azimuth_elevation_deg": pointing},
        targets=one_target, bands=["A"], sky={"catalog": "none", "aberration": False},
    )  # fmt: skip


def catalog_at(scene, xy_px, irradiance_w_cm2, **columns):
    """Stars at positions of the image in the frame FRAME."""
    axes = scene.scenario.view_axes(SENSOR, scene.scenario.instrument.frame_time_s([FRAME]))[0]
    direction = scene.camera.direction(np.asarray(xy_px, dtype=float).reshape(-1, 2), axes)
    flux_jy = np.broadcast_to(irradiance_w_cm2, len(direction)) / W_CM2_PER_JY
    ra_deg, dec_deg = np.degrees(np.arctan2(direction[:, 1], direction[:, 0])), np.degrees(np.arcsin(direction[:, 2]))
    return ws.StarCatalog.from_table(Table({"ra_deg": ra_deg, "dec_deg": dec_deg, "flux_A_jy": flux_jy, **columns}))


def rendered(scene, catalog, device="cpu", frames=(FRAME,)):
    """A frame set, checked to be finite and in range."""
    images = ws.Renderer(scene, device=device, catalog=catalog).render(
        list(frames), [SENSOR], ["A"], keep_signal=True, keep_stars=True
    )
    signal, counts = images.signal_w_cm2.numpy(), images.counts.numpy()
    assert np.isfinite(signal).all() and (signal >= 0).all()
    assert counts.dtype == np.uint16 and counts.max() <= 2**scene.detector.bits - 1
    positions = np.column_stack([images.stars["x_px"], images.stars["y_px"]])
    assert np.isfinite(positions).all()
    return images


def gaussian_image(xy_px, irradiance_w_cm2, n_row, n_col, sigmas_px=(SIGMA_PX, SIGMA_PX)):
    """Sum of pixel-integrated Gaussians in float64, shape (n_row, n_col); sigmas along columns and rows."""
    across, down = (
        np.diff(ndtr((np.arange(n + 1)[None] - 0.5 - np.asarray(xy_px)[:, axis, None]) / sigmas_px[axis]), axis=1)
        for axis, n in ((0, n_col), (1, n_row))
    )
    return np.einsum("s,sr,sc->rc", np.broadcast_to(irradiance_w_cm2, len(xy_px)), down, across)


def level_counts(signal_w_cm2, detector):
    """Counts without noise, not rounded."""
    level = np.minimum(signal_w_cm2 / detector.nei_w_cm2, detector.sei_w_cm2 / detector.nei_w_cm2)
    return np.clip(detector.offset_counts + detector.counts_per_nei * level, 0, 2**detector.bits - 1)


def assert_counts_follow(counts, signal_w_cm2, detector):
    """Counts are those of the signal to within noise; exactly the ceiling's where the signal is far above it."""
    spread = NOISE_SIGMAS * detector.counts_per_nei + 1.0
    low, high = (level_counts(signal_w_cm2 + sign * NOISE_SIGMAS * detector.nei_w_cm2, detector) for sign in (-1, 1))
    assert (counts >= np.floor(low) - 1).all() and (counts <= np.ceil(high) + 1).all()
    ceiling = min(detector.offset_counts + detector.counts_per_nei * detector.dynamic_range, 2**detector.bits - 1)
    full = signal_w_cm2 > detector.sei_w_cm2 + NOISE_SIGMAS * detector.nei_w_cm2
    assert (np.abs(counts[full] - ceiling) <= 0.5).all()
    assert np.abs(counts - level_counts(signal_w_cm2, detector)).max() <= spread
    return np.count_nonzero(full)


DETECTORS = {
    "14-bits": {"bits": 14},
    "16-bits": {"bits": 16, "counts_per_nei": 20.0},
    "adc-is-full-first": {"bits": 8, "offset_counts": 30.0},
    "all-16-bits": {"bits": 16, "counts_per_nei": 50.0},
    "one-bit": {"bits": 1, "offset_counts": 0.0, "counts_per_nei": 1.0},
}


@pytest.mark.parametrize("detector", DETECTORS.values(), ids=DETECTORS)
@pytest.mark.parametrize("psf", ["gaussian", "airy"])
def test_a_source_a_million_times_above_saturation(scene, device, psf, detector):
    optics = {"psf": psf} if psf == "gaussian" else {"psf": psf, "sigma_px": None}
    dazzled = sky_scene(scene, {"n_row": 96, "n_col": 128}, detector=detector, **optics)
    xy = [[40.3, 50.8]]
    images = rendered(dazzled, catalog_at(dazzled, xy, 1e6 * SEI), device)
    signal, counts = images.signal_w_cm2.numpy()[0, 0, 0], images.counts.numpy()[0, 0, 0].astype(float)
    assert signal.max() > 1e5 * SEI
    n_full = assert_counts_follow(counts, signal, dazzled.detector)
    if psf == "gaussian":
        expected = gaussian_image(xy, 1e6 * SEI, 96, 128)
        # What is left out is below 1e-11 of the star, the smallest cut there is.
        np.testing.assert_allclose(signal, expected, rtol=0, atol=FRACTION * 1e6 * SEI)
        np.testing.assert_allclose(signal, expected, rtol=2e-5, atol=1e-11 * 1e6 * SEI)
        assert n_full == np.count_nonzero(expected > SEI)
    else:
        assert n_full > 100


def test_light_from_1e_minus_25_to_1e_minus_10_in_one_frame(device, scene):
    """Sixteen decades side by side; each star's stamp is its own, to float32, or to the cut of 1e-27 W/cm2."""
    faint = sky_scene(scene, {"n_row": 64, "n_col": 256})
    light = 10.0 ** np.arange(-25, -9)
    order = np.random.default_rng(3).permutation(16)
    xy = np.column_stack([15.2 * np.arange(16) + 10.37, 20.0 + 1.61 * (np.arange(16) % 14)])
    images = rendered(faint, catalog_at(faint, xy, light[order]), device)
    signal = images.signal_w_cm2.numpy()[0, 0, 0]
    near = [np.s_[max(0, int(y) - 6) : int(y) + 8, max(0, int(x) - 6) : int(x) + 8] for x, y in xy]
    for position, box, own in zip(xy, near, light[order], strict=True):
        expected = gaussian_image([position], own, 64, 256)[box]
        others = gaussian_image(xy[light[order] != own], light[order][light[order] != own], 64, 256)[box]
        clean = others < 1e-3 * own  # where a brighter neighbour's wing does not come first
        assert clean.any()
        cut = 16 * 1e-9 * NEI + 1e-11 * own
        np.testing.assert_allclose((signal[box] - others)[clean], expected[clean], rtol=0, atol=FRACTION * own + cut)
    assert_counts_follow(images.counts.numpy()[0, 0, 0].astype(float), signal, faint.detector)
    assert len(images.stars) == 16
    by_row = images.stars["irradiance_w_cm2"][np.argsort(images.stars["catalog_row"]), 0]
    np.testing.assert_allclose(by_row, light[order], rtol=1e-7)


@pytest.mark.parametrize("shape", [(64, 64), (1, 1), (37, 5)])
@pytest.mark.ci
def test_nothing_in_the_frame(scene, device, shape):
    """An empty catalog, and targets behind or beside the camera: exactly dark, and the detector's own noise."""
    empty = sky_scene(scene, {"n_row": shape[0], "n_col": shape[1]})
    images = rendered(empty, None, device, frames=range(40, 140))
    assert not images.truth["in_fov"].any()
    assert len(images.stars) == 0
    assert (images.signal_w_cm2.numpy() == 0).all()
    noise = (images.counts.numpy().astype(float) - 100.0) / 5.0
    n = noise.size
    assert abs(noise.mean()) < 5 / np.sqrt(n)
    assert abs(noise.var() - 1 - 1 / 12 / 25) < 5 * np.sqrt(2 / n)  # the last digit adds its own


@pytest.mark.parametrize("xy", [(0.0, 0.0), (0.5, -0.5), (0.2, 3.0), (-4.0, -4.0)], ids=str)
@pytest.mark.ci
def test_an_image_of_one_pixel(scene, device, xy):
    single = sky_scene(scene, {"n_row": 1, "n_col": 1, "fov_deg": 0.01})
    images = rendered(single, catalog_at(single, [xy], 1e-15), device)
    assert images.counts.shape == (1, 1, 1, 1, 1)
    expected = gaussian_image([xy], 1e-15, 1, 1)
    np.testing.assert_allclose(images.signal_w_cm2.numpy()[0, 0, 0], expected, rtol=0, atol=FRACTION * 1e-15)
    assert_counts_follow(images.counts.numpy()[0, 0, 0].astype(float), expected, single.detector)
    np.testing.assert_allclose([images.stars["x_px"][0], images.stars["y_px"][0]], xy, rtol=0, atol=POSITION_PX)
    if xy != (0.5, -0.5):  # where rounding decides
        assert images.stars["in_fov"][0] == (max(np.abs(xy)) < 0.5)


LENS = {"k1": -0.4, "k2": 0.1, "p1": 0.01, "p2": -0.02}
ODD_CAMERAS = {
    "tall": {"n_row": 500, "n_col": 3},
    "flat": {"n_row": 2, "n_col": 700, "fov_deg": 10.0},
    "high-pixels": {"n_row": 40, "n_col": 130, "pixel_aspect": 2.5},
    "flat-pixels": {"n_row": 300, "n_col": 64, "pixel_aspect": 0.2},
    "lens": {"n_row": 90, "n_col": 70, "fov_deg": 30.0, "distortion": LENS},
    "all": {"n_row": 150, "n_col": 64, "fov_deg": 15.0, "pixel_aspect": 0.4, "distortion": LENS},
}


@pytest.mark.parametrize("camera", ODD_CAMERAS.values(), ids=ODD_CAMERAS)
@pytest.mark.ci
def test_arrays_and_pixels_that_are_not_square(scene, device, camera):
    """The light of each star is where its label and astropy's WCS say, whatever the array."""
    odd = sky_scene(scene, camera, sigma_px=0.45)
    n_row, n_col = camera["n_row"], camera["n_col"]
    xy = np.random.default_rng(8).uniform(0, 1, (12, 2)) * [n_col, n_row] - 0.5
    for position in xy:
        images = rendered(odd, catalog_at(odd, [position], 1e-14), device)
        label = np.array([images.stars["x_px"][0], images.stars["y_px"][0]])
        np.testing.assert_allclose(label, position, rtol=0, atol=POSITION_PX)
        assert images.stars["in_fov"][0]
        signal = images.signal_w_cm2.numpy()[0, 0, 0].astype(float)
        sigmas_px = (0.45, 0.45 / odd.camera.pixel_aspect)
        expected = gaussian_image(position[None], 1e-14, n_row, n_col, sigmas_px)
        np.testing.assert_allclose(signal, expected, rtol=0, atol=FRACTION * 1e-14)
        sky = images.wcs(FRAME, SENSOR).pixel_to_world_values(*label)
        star = odd.camera.direction(position[None], images.axes_icrs[0, 0])[0]
        lon, lat = np.radians(sky)
        read = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
        assert np.linalg.norm(read - star) * odd.camera.focal_px < 1e-2


@pytest.mark.parametrize("lens", [None, {"k1": -0.12, "k2": 0.01}], ids=["pinhole", "barrel"])
@pytest.mark.ci
def test_a_field_of_60_degrees(scene, device, lens):
    """Stars all over the sky: those of a brute-force projection, each lighting its pixel."""
    wide = sky_scene(scene, {"n_row": 200, "n_col": 256, "fov_deg": 60.0, "distortion": lens}, pointing=(10.0, 45.0))
    rng = np.random.default_rng(12)
    position = rng.normal(size=(40_000, 3))
    position /= np.linalg.norm(position, axis=1, keepdims=True)
    ra_deg, dec_deg = np.degrees(np.arctan2(position[:, 1], position[:, 0])), np.degrees(np.arcsin(position[:, 2]))
    light = 10.0 ** rng.uniform(-18, -14, len(position))
    catalog = ws.StarCatalog.from_arrays(ra_deg, dec_deg, {"A": light / W_CM2_PER_JY})
    images = rendered(wide, catalog, device)
    xy, in_front = wide.camera.project(catalog.direction_icrs, images.axes_icrs[0, 0])
    near = np.flatnonzero(in_front & (np.abs(xy - wide.camera.centre_px) < [140, 112]).all(axis=1))
    expected = gaussian_image(xy[near], light[near], 200, 256)
    signal = images.signal_w_cm2.numpy()[0, 0, 0]
    np.testing.assert_allclose(signal, expected, rtol=0, atol=FRACTION * light.max())
    assert images.stars["in_fov"].sum() > 1500
    assert_counts_follow(images.counts.numpy()[0, 0, 0].astype(float), signal, wide.detector)


def textbook_gnomonic(ra_deg, dec_deg, boresight_deg):
    """Standard coordinates (xi east, eta north), in radians; the formula of Green (1985), 13.12."""
    ra, dec, ra0, dec0 = np.radians([ra_deg, dec_deg, *np.broadcast_arrays(*boresight_deg, ra_deg)[:2]])
    cosine = np.sin(dec) * np.sin(dec0) + np.cos(dec) * np.cos(dec0) * np.cos(ra - ra0)
    xi = np.cos(dec) * np.sin(ra - ra0) / cosine
    eta = (np.sin(dec) * np.cos(dec0) - np.cos(dec) * np.sin(dec0) * np.cos(ra - ra0)) / cosine
    return xi, eta


POLES_AND_WRAPS = [(0.0, 90.0), (0.0, -90.0), (123.0, 90.0), (0.0, 0.0), (360.0, 0.0), (180.0, 0.0), (0.0, 60.0)]


@pytest.mark.parametrize("boresight", POLES_AND_WRAPS, ids=str)
def test_boresight_on_a_pole_and_at_right_ascension_0(scene, device, boresight):
    """Stars all around it, across the wrap of right ascension and at the pole, against spherical trigonometry."""
    camera = {"n_row": 128, "n_col": 160, "fov_deg": 4.0}
    described = sky_scene(scene, camera).replace(
        pointing={"kind": "fixed", "ra_dec_deg": boresight, "up": "north"}, optics__stamp_cut_nei=1e-4
    )
    frame, sensor = frame_that_sees(described, boresight)
    rng = np.random.default_rng(5)
    step = np.radians(1.8) * rng.uniform(-1, 1, (300, 2))
    z = direction_of(*boresight)
    aside = np.linalg.qr(np.column_stack([z, np.eye(3)[np.argsort(np.abs(z))[:2]].T]))[0][:, 1:]
    position = z + step @ aside.T
    position = np.concatenate([position / np.linalg.norm(position, axis=1, keepdims=True), [z]])
    ra_deg, dec_deg = (
        np.degrees(np.arctan2(position[:, 1], position[:, 0])),
        np.degrees(np.arcsin(position[:, 2].clip(-1, 1))),
    )
    catalog = ws.StarCatalog.from_arrays(ra_deg, dec_deg, {"A": np.full(len(position), 50.0)})
    images = ws.Renderer(described, device=device, catalog=catalog).render([frame], [sensor], keep_stars=True)
    assert images.up_replaced[0, 0] == (abs(boresight[1]) == 90.0)
    xi, eta = textbook_gnomonic(ra_deg, dec_deg, boresight)
    # At a pole north's spare, the ICRS x axis, is up; east and north of the formula turn with the boresight's RA there.
    x, y, _ = images.axes_icrs[0, 0]
    ra0, dec0 = np.radians(boresight)
    east = np.array([-np.sin(ra0), np.cos(ra0), 0.0])
    north = np.array([-np.sin(dec0) * np.cos(ra0), -np.sin(dec0) * np.sin(ra0), np.cos(dec0)])
    focal = 80 / np.tan(np.radians(2.0))
    x_px = 79.5 + focal * (xi * (east @ x) + eta * (north @ x))
    y_px = 63.5 + focal * (xi * (east @ y) + eta * (north @ y))
    inside = (np.abs(x_px - 79.5) < 80) & (np.abs(y_px - 63.5) < 64)
    stars = images.stars
    assert set(stars["catalog_row"][stars["in_fov"]]) == set(np.flatnonzero(inside))
    rows = np.asarray(stars["catalog_row"])
    np.testing.assert_allclose(stars["x_px"], x_px[rows], rtol=0, atol=1e-7)
    np.testing.assert_allclose(stars["y_px"], y_px[rows], rtol=0, atol=1e-7)
    (own,) = np.flatnonzero(rows == 300)  # the star at the boresight
    np.testing.assert_allclose([stars["x_px"][own], stars["y_px"][own]], [79.5, 63.5], rtol=0, atol=POSITION_PX)
    assert inside.sum() > 200
    if abs(dec0) < np.pi / 2:
        np.testing.assert_allclose([east @ x, north @ y], [-1.0, -1.0], rtol=0, atol=1e-12)


def direction_of(ra_deg, dec_deg):
    ra, dec = np.radians([ra_deg, dec_deg])
    return np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])


def frame_that_sees(scene, boresight):
    """A frame and a sensor on the side of the Earth where the boresight is free."""
    for sensor in scene.sensor_names:
        position = scene.position_m(sensor, scene.scenario.instrument.frame_time_s([FRAME]))[0]
        if position @ direction_of(*boresight) > 0.5 * np.linalg.norm(position):
            return FRAME, sensor
    raise AssertionError("no sensor sees it")


EDGES = {
    # position on an image of 40 x 64 pixels, fraction of the light on it
    "left": ((-0.5, 20.0), 0.5),
    "right": ((63.5, 11.3), 0.5),
    "top": ((30.25, -0.5), 0.5),
    "bottom": ((27.0, 39.5), 0.5),
    "corner": ((-0.5, -0.5), 0.25),
    "far-corner": ((63.5, 39.5), 0.25),
    "pixel-corner": ((20.5, 10.5), 1.0),
    "pixel-edge": ((20.5, 11.0), 1.0),
}


@pytest.mark.parametrize(("xy", "fraction"), EDGES.values(), ids=EDGES)
@pytest.mark.parametrize("sigma_px", [0.01, 0.8, 2.0])
def test_a_star_on_the_edge_of_the_field_and_on_a_corner(scene, device, xy, fraction, sigma_px):
    """Half or a quarter of its light is on the array; a sharp one on a corner is shared by four pixels alike."""
    edge = sky_scene(scene, {"n_row": 40, "n_col": 64}, sigma_px=sigma_px)
    images = rendered(edge, catalog_at(edge, [xy], 1e-15), device)
    label = [images.stars["x_px"][0], images.stars["y_px"][0]]
    np.testing.assert_allclose(label, xy, rtol=0, atol=POSITION_PX)
    signal = images.signal_w_cm2.numpy()[0, 0, 0].astype(float)
    rounding = POSITION_PX / sigma_px  # of the position, where the light is steepest
    assert signal.sum() == pytest.approx(fraction * 1e-15, rel=0, abs=(2e-6 + rounding) * 1e-15)
    expected = gaussian_image([xy], 1e-15, 40, 64, (sigma_px, sigma_px))
    np.testing.assert_allclose(signal, expected, rtol=0, atol=(FRACTION + rounding) * 1e-15)
    if xy == (20.5, 10.5):
        four = signal[10:12, 20:22]
        np.testing.assert_allclose(four, four.mean(), rtol=2e-6 + 4 * rounding)


@pytest.mark.parametrize("apart_px", [9e-4, 1e-6, 0.0])
@pytest.mark.parametrize("psf", ["gaussian", "airy"])
@pytest.mark.ci
def test_two_stars_closer_than_a_thousandth_of_a_pixel(scene, device, psf, apart_px):
    """Both are drawn, both are labelled, and the light is the sum; even at the same position."""
    optics = {"psf": psf} if psf == "gaussian" else {"psf": psf, "sigma_px": None}
    close = sky_scene(scene, {"n_row": 32, "n_col": 40}, **optics)
    xy = np.array([[20.31, 15.77], [20.31 + apart_px, 15.77]])
    both = rendered(close, catalog_at(close, xy, [1e-15, 3e-15]), device)
    alone = [rendered(close, catalog_at(close, xy[i : i + 1], [1e-15, 3e-15][i]), device) for i in range(2)]
    assert len(both.stars) == 2 and both.stars["in_fov"].all()
    order = np.argsort(both.stars["catalog_row"])
    gap = np.diff(both.stars["x_px"][order])[0]
    assert gap == pytest.approx(apart_px, rel=0, abs=2 * POSITION_PX)
    signal, parts = (both.signal_w_cm2.numpy(), [one.signal_w_cm2.numpy() for one in alone])
    np.testing.assert_allclose(signal, parts[0] + parts[1], rtol=2e-6, atol=1e-12 * 1e-15)
    if psf == "gaussian":
        expected = gaussian_image(xy, [1e-15, 3e-15], 32, 40)
        np.testing.assert_allclose(signal[0, 0, 0], expected, rtol=0, atol=FRACTION * 3e-15)


@pytest.mark.slow
def test_a_million_stars_in_one_frame(scene, device):
    """The list grows to hold them all; the sum of their light is exact to float32 rounding in every pixel."""
    n_star, n_row, n_col = 1_000_000, 200, 256
    crowd = sky_scene(scene, {"n_row": n_row, "n_col": n_col}, sigma_px=0.3, stamp_cut_nei=1e-5)
    rng = np.random.default_rng(4)
    xy = rng.uniform(0, 1, (n_star, 2)) * [n_col, n_row] - 0.5
    light = 10.0 ** rng.uniform(-19, -17, n_star)
    images = rendered(crowd, catalog_at(crowd, xy, light), device)
    assert len(images.stars) == n_star
    found = np.column_stack([images.stars["x_px"], images.stars["y_px"]])[np.argsort(images.stars["catalog_row"])]
    np.testing.assert_allclose(found, xy, rtol=0, atol=POSITION_PX)
    signal = images.signal_w_cm2.numpy()[0, 0, 0]
    expected = crowd_image(xy, light, n_row, n_col, 0.3)
    # 20 stars a pixel and 9 stamps each: what is cut is below 1e-5 NEI a star and pixel, float32 adds up to 200 times.
    np.testing.assert_allclose(signal, expected, rtol=200 * 6e-8, atol=1e-3 * NEI)
    assert_counts_follow(images.counts.numpy()[0, 0, 0].astype(float), signal, crowd.detector)


def crowd_image(xy_px, irradiance_w_cm2, n_row, n_col, sigma_px, reach=3):
    """The same as gaussian_image for many sharp stars: stamps of 7 x 7 pixels."""
    image = np.zeros((n_row + 2 * reach) * (n_col + 2 * reach))
    own = np.floor(xy_px + 0.5).astype(int)
    fractions = [
        [ndtr((own[:, axis] + step + 0.5 - xy_px[:, axis]) / sigma_px)
         - ndtr((own[:, axis] + step - 0.5 - xy_px[:, axis]) / sigma_px) for step in range(-reach, reach + 1)]
        for axis in (0, 1)
    ]  # fmt: skip
    for j, down in enumerate(fractions[1]):
        for i, across in enumerate(fractions[0]):
            flat = (own[:, 1] + j) * (n_col + 2 * reach) + own[:, 0] + i
            image += np.bincount(flat, irradiance_w_cm2 * down * across, len(image))
    return image.reshape(n_row + 2 * reach, -1)[reach:-reach, reach:-reach]


@pytest.mark.ci
def test_a_row_without_numbers_in_a_catalog(scene, device):
    """A star without a flux gives no light and disturbs no other, whatever else is unknown of it."""
    clean = sky_scene(scene, {"n_row": 32, "n_col": 40}).replace(
        sky={"catalog": "none", "aberration": False, "parallax": True}
    )
    xy = [[10.2, 8.3], [20.0, 16.0], [30.4, 25.1]]
    nan = np.full(3, np.nan)
    holes = {"parallax_mas": nan, "pm_ra_mas_yr": nan, "pm_dec_mas_yr": nan, "temperature_k": nan}
    with_hole = rendered(clean, catalog_at(clean, xy, [1e-15, np.nan, 2e-15], **holes), device)
    without = rendered(clean, catalog_at(clean, [xy[0], xy[2]], [1e-15, 2e-15]), device)
    np.testing.assert_array_equal(with_hole.counts.numpy(), without.counts.numpy())
    np.testing.assert_array_equal(with_hole.signal_w_cm2.numpy(), without.signal_w_cm2.numpy())
    dark = with_hole.stars[with_hole.stars["catalog_row"] == 1]
    assert (dark["irradiance_w_cm2"] == 0).all()


def test_a_row_without_a_position_in_a_catalog(scene, device):
    """It is left out, with a warning; the image is that of the others."""
    clean = sky_scene(scene, {"n_row": 32, "n_col": 40})
    table = catalog_at(clean, [[10.2, 8.3], [20.0, 16.0], [30.4, 25.1]], 1e-15).to_table()
    expected = rendered(clean, ws.StarCatalog.from_table(table[[0, 2]]), device).counts.numpy()
    masked = MaskedColumn(np.asarray(table["ra_deg"]), mask=[False, True, False])
    for column, values in (("ra_deg", [0, np.nan, 0]), ("dec_deg", [0, np.nan, 0]), ("ra_deg", masked)):
        holed = table.copy()
        holed[column] = values if values is masked else np.asarray(table[column]) + values
        with pytest.warns(UserWarning, match="1 of 3 stars without a finite position"):
            catalog = ws.StarCatalog.from_table(holed)
        np.testing.assert_array_equal(rendered(clean, catalog, device).counts.numpy(), expected)


RADIUS = np.hypot(*np.indices((41, 41)) - 20.0) / 4.0  # of the samples [px]
PATTERNS = {
    "sampled-gaussian": (np.exp(-0.5 * (RADIUS / 0.8) ** 2), 4.0),
    "sampled-airy": ((2 * j1(np.maximum(3.2 * RADIUS, 1e-9)) / np.maximum(3.2 * RADIUS, 1e-9)) ** 2, 4.0),
    "impulse": (np.pad(np.ones((1, 1)), 7), 1.0),
    "edge": (np.pad(np.ones((3, 3)), 6), 1.0),
}
RINGING = {"sampled-gaussian": 1e-6, "sampled-airy": 2e-4, "impulse": 0.073, "edge": 0.02}
"""Of a star's light, in a pixel: what lies below zero of a spline through samples that are cut off, or too few."""
GATE_SIGMAS = 5.0


@pytest.mark.ci
@pytest.mark.parametrize("dark_e_s", [0.0, 1e4], ids=["few-electrons", "many"])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_patterns_that_ring_read_as_blank_where_they_are_below_zero(scene, tmp_path, device, pattern, dark_e_s):
    """Under shot noise a negative mean is no mean: such pixels have the dark current alone, however bright the star."""
    image, oversample = PATTERNS[pattern]
    np.save(tmp_path / "psf.npy", image)
    detector = {"kind": "electron", "exposure_s": 0.1, "full_well_e": 2e5, "gain_e_per_count": 12.0, "bits": 14,
                "quantum_efficiency": 0.6, "dark_e_s": dark_e_s, "read_noise_e": 30.0}  # fmt: skip
    optics = {"psf": "table", "sigma_px": None, "psf_file": str(tmp_path / "psf.npy"), "psf_oversample": oversample}
    ringing = sky_scene(scene, {"n_row": 32, "n_col": 48}, **optics).replace(detector=detector)
    light = 1e-5
    catalog = catalog_at(ringing, [[20.3, 14.4]], light)
    images = ws.Renderer(ringing, device=device, catalog=catalog).render([FRAME], [SENSOR], ["A"], keep_signal=True)
    signal, counts = images.signal_w_cm2.numpy(), images.counts.numpy().astype(float)
    assert np.isfinite(signal).all() and signal.min() >= -RINGING[pattern] * light
    assert signal.sum() == pytest.approx(light, rel=1e-3)
    assert counts.max() <= 2**14 - 1
    levels = ringing.scenario.instrument.levels["A"]
    below = counts[signal < 0.0]
    spread = np.sqrt(levels.dark_e + 30.0**2) / 12.0
    if pattern in ("impulse", "edge"):
        assert below.size > 20
    if below.size:
        assert abs(below.mean() - levels.blank_counts) < GATE_SIGMAS * np.hypot(spread, 0.3) / np.sqrt(below.size)
        assert np.abs(below - levels.blank_counts).max() < NOISE_SIGMAS * spread + 1.0


ORBIT = {"kind": "elements", "altitude_km": 1400.0, "inclination_deg": 65.0}


@pytest.mark.parametrize(
    ("trajectory", "radius_m"),
    [
        *(({**ORBIT, "mean_anomaly_deg": anomaly}, 0.5) for anomaly in (0.0, 1e-12, 1e-9, 1e-6, 1e-3, 10.0)),
        ({**ORBIT, "mean_anomaly_deg": 1e-9}, 1e5), ({**ORBIT, "mean_anomaly_deg": 1e-2}, 1e-22),
        ({"kind": "state_vector", "position_m": [4e8, 0.0, 0.0], "velocity_m_s": [0.0, 5.0, 0.0]}, 0.5),
        ({"kind": "state_vector", "position_m": [4e8, 0.0, 0.0], "velocity_m_s": [0.0, 5.0, 0.0]}, 1e-22),
    ],
)  # fmt: skip
def test_light_from_no_range_to_that_of_the_moon_is_a_number(device, trajectory, radius_m):
    """In the sensor itself, a nanometre away, larger than its distance, and too faint for float32."""
    small = copy.deepcopy(SCENE)
    small["targets"][0]["shape"]["radius_m"] = radius_m
    small |= {"constellation": {"kind": "listed", "satellites": [{"name": "one", "orbit": ORBIT}]},
              "trajectory": trajectory, "access_rules": {}, "frames": {"count": 1, "interval_s": 1.0}}  # fmt: skip
    images = ws.Renderer(ws.Scene.from_dict(small), device=device).render([0], ["one"], ["A"], keep_signal=True)
    row = images.truth[0]
    names = ("range_km", "irradiance_w_cm2", "snr", "snr_peak", "left_out_w_cm2")
    assert np.isfinite([row[name] for name in names]).all() and min(row[name] for name in names) >= 0.0
    assert row["snr_peak"] <= row["snr"] and row["snr"] == row["irradiance_w_cm2"] / 1e-18
    assert np.isfinite(images.signal_w_cm2.numpy()).all() and images.counts.numpy().max() < 2**14
    if row["range_km"] > 0.0:
        assert np.isfinite([row["x_px"], row["y_px"]]).all()
        bound_px = row["x_sigma_px"]  # infinite where the pixels are full
        assert bound_px > 0.0 if row["irradiance_w_cm2"] > 0.0 else np.isnan(bound_px)
