"""Each target's own light: all planes together are the image, and a patch shows what the whole plane shows."""

import numpy as np
import pytest

import warpsim as ws
from warpsim.render.contributions import Patches, brightest_targets

SENSOR = "sat11"
FRAME = 60
"""600 s: stars behind all targets, which lie within 6 px of the image's centre, SNR 20 to 60."""
LATER = 100

SUM_RTOL = 1e-6
"""Of each pixel: float32 sums in another order, one rounding of 6e-8 for each source there."""
STREAK_SUM_RTOL = 1e-5
"""The same where a source is the sum of a hundred nodes, whose roundings lean to one side."""
LIGHT_RTOL = 1e-5
"""Of a target's light: the tables' error, 6e-7 a pixel, over the few pixels that hold it; and float32 fractions."""
THRESHOLD_RTOL = 1e-5
"""A pixel so near to a threshold may fall on either side: patches are drawn from shifted positions."""

GAUSSIAN = {"aperture_m": 0.4, "psf": "gaussian", "sigma_px": 0.9, "stamp_cut_nei": 0.1}
OBSCURED = {"aperture_m": 0.4, "obscuration": 0.4, "psf": "airy", "smear_urad": 120.0, "stamp_cut_nei": 0.01}
OPTICS = {
    "airy": {},
    "gaussian": {"optics": GAUSSIAN},
    "obscured": {"optics": OBSCURED, "camera__pixel_aspect": 1.6},
}


def shaking(scene):
    """Pointing at where the group is, jitter of several pixels included."""
    z = scene.scenario.view_axes(SENSOR, scene.scenario.instrument.frame_time_s([FRAME]))[0, 2]
    position = [float(np.degrees(np.arctan2(z[1], z[0])) % 360), float(np.degrees(np.arcsin(z[2])))]
    return {"kind": "fixed", "ra_dec_deg": position, "jitter": {"rms_urad": 400.0, "correlation_s": 0.1}}


@pytest.fixture(scope="module", params=OPTICS)
def optics(request):
    return OPTICS[request.param]


@pytest.fixture(scope="module", params=["still", "streaks", "at the edge"])
def changed(request, scene, optics):
    changes = dict(optics)
    if request.param == "streaks":
        changes |= {"detector__exposure_s": 0.15, "pointing": shaking(scene)}
    if request.param == "at the edge":
        changes |= {"pointing__offset_px": [62.0, -60.0]}
    return scene.replace(**changes)


@pytest.fixture(scope="module")
def stars(scene):
    """A thousand within two degrees of where the cameras look in either frame."""
    rng = np.random.default_rng(5)
    positions = []
    for x, y, z in scene.scenario.view_axes(SENSOR, scene.scenario.instrument.frame_time_s([FRAME, LATER])):
        angles = np.radians(rng.uniform(-2, 2, (2, 1000)))
        positions.append(z + angles[0, :, None] * x + angles[1, :, None] * y)
    x, y, z = np.concatenate(positions).T
    ra_deg, dec_deg = np.degrees(np.arctan2(y, x)) % 360, np.degrees(np.arctan2(z, np.hypot(x, y)))
    flux_jy = {band: 10 ** rng.uniform(-1, 1, len(x)) for band in ("A", "C")}
    return ws.StarCatalog.from_arrays(ra_deg, dec_deg, flux_jy)


@pytest.fixture(scope="module")
def frames(changed, stars):
    renderer = ws.Renderer(changed, device="cpu", catalog=stars)
    return renderer.render([FRAME, LATER], [SENSOR], ["A", "C"], keep_signal=True)


def dark(scene):
    """The same scene with targets that give no light."""
    lights_off = {"sun": False, "earth": False, "albedo": False}
    mirrors = {f"targets__{number}__surface": {"reflectance": 1.0} for number in range(len(scene.targets))}
    return scene.replace(lighting=lights_off, **mirrors)


@pytest.mark.ci
def test_planes_and_stars_add_up_to_the_image(changed, frames, stars):
    renderer = ws.Renderer(dark(changed), device="cpu", catalog=stars)
    without = renderer.render(frames.frames, [SENSOR], frames.bands, keep_signal=True)
    assert without.signal_w_cm2.numpy().any()  # there are stars
    for i, frame in enumerate(frames.frames):
        for k, band in enumerate(frames.bands):
            planes = frames.contributions_w_cm2(frame, SENSOR, band)
            assert planes.dtype == np.float32 and planes.shape == (30, 128, 128)
            total = planes.sum(axis=0, dtype=np.float64) + without.signal_w_cm2[i, 0, k]
            rtol = STREAK_SUM_RTOL if changed.sensors[0].streaks else SUM_RTOL
            np.testing.assert_allclose(frames.signal_w_cm2[i, 0, k], total, rtol=rtol, atol=0)


@pytest.mark.ci
def test_a_plane_is_the_image_of_the_target_alone(changed, frames):
    """Bit for bit: no target but the main one is deployed, and there are no stars."""
    alone = changed.replace(release__time_s=1600.0)
    renderer = ws.Renderer(alone, device="cpu", catalog=ws.StarCatalog.from_arrays([], [], {}))
    signal = renderer.render([FRAME], [SENSOR], frames.bands, keep_signal=True).signal_w_cm2[0, 0]
    for k, band in enumerate(frames.bands):
        assert signal[k].any()
        np.testing.assert_array_equal(frames.contributions_w_cm2(FRAME, SENSOR, band)[0], signal[k])


@pytest.mark.ci
def test_a_plane_holds_the_targets_light(changed, frames):
    margin_px = 40
    n_inside = 0
    for row in frames.truth:
        number = changed.target_names.index(row["target"])
        if number == 0:
            planes = frames.contributions_w_cm2(row["frame"], SENSOR, row["band"])
        planes_sum = planes[number].sum(dtype=np.float64)
        assert planes_sum <= row["irradiance_w_cm2"] * (1 + LIGHT_RTOL)
        inside = all(margin_px < row[name] < 127 - margin_px for name in ("x_px", "y_px"))
        if inside:
            light = planes_sum + row["left_out_w_cm2"]
            np.testing.assert_allclose(light, row["irradiance_w_cm2"], rtol=LIGHT_RTOL)
            n_inside += 1
    if changed.pointing[0].kind == "track" and changed.pointing[0].offset_px != (0.0, 0.0):
        assert n_inside == 0
    else:
        assert n_inside > 10


@pytest.mark.parametrize("least_nei", [0.3, 1.0, 20.0])
@pytest.mark.ci
def test_mask_is_that_of_the_planes(frames, least_nei):
    for frame in frames.frames:
        planes = frames.contributions_w_cm2(frame, SENSOR, "A").astype(np.float64)
        least = least_nei * frames.scene.scenario.instrument.nei_w_cm2("A")
        first, second = np.sort(planes, axis=0)[:-3:-1]
        wanted = np.where(first >= least, planes.argmax(axis=0) + 1, 0)
        found = frames.target_mask(frame, SENSOR, "A", least_nei)
        assert found.dtype == np.uint16
        assert found.any() or frame != FRAME or least_nei > 1.0
        unclear = (np.abs(first / least - 1) < THRESHOLD_RTOL) | (first - second < THRESHOLD_RTOL * first)
        np.testing.assert_array_equal(found[~unclear], wanted[~unclear])
        assert unclear.sum() < 3


def test_masks_of_many_images_are_those_of_each(scene):
    frames = ws.Renderer(scene, device="cpu").render(range(40, 44), ["sat11", "sat27"], ["C", "A"])
    masks = frames.target_masks(0.5)
    assert masks.shape == (4, 2, 2, 128, 128) and masks.dtype == np.uint16 and masks.any()
    for f, s, b in np.ndindex(masks.shape[:3]):
        one = frames.target_mask(frames.frames[f], frames.sensors[s], frames.bands[b], 0.5)
        np.testing.assert_array_equal(masks[f, s, b], one)


def test_of_equals_the_first_is_taken_in_whatever_order_patches_come():
    class Light:
        """Two views, three targets: 0 and 2 are equally bright, 1 is brighter in one pixel; the last come first."""

        xy_px, shape = np.zeros((2, 3, 2)), (4, 5)

        def patches(self, band, view, target, least_w_cm2):
            for number in range(len(view))[::-1]:
                plane = np.full((1, 2, 2), 2.0 if target[number] != 1 else 0.5, dtype=np.float32)
                if target[number] == 1:
                    plane[0, 1, 1] = 3.0
                yield Patches(np.array([number]), np.array([[1 + view[number], 1]]), plane)

    masks = brightest_targets(Light(), 0, np.array([0, 1]), 1.0)
    assert masks[0].tolist() == [[0] * 5, [0, 1, 1, 0, 0], [0, 1, 2, 0, 0], [0] * 5]
    assert masks[1].tolist() == [[0] * 5, [0, 0, 1, 1, 0], [0, 0, 1, 2, 0], [0] * 5]


@pytest.mark.ci
def test_memory_may_be_small(frames):
    whole = frames.contributions_w_cm2(FRAME, SENSOR, "A")
    np.testing.assert_array_equal(whole, frames.contributions_w_cm2(FRAME, SENSOR, "A", chunk_bytes=1))


def test_bright_targets_reach_far(scene):
    """Wings that leave the image: patches are as large as the array."""
    bright = scene.replace(targets__0__shape={"kind": "sphere", "radius_m": 100.0})
    frames = ws.Renderer(bright, device="cpu").render([FRAME], [SENSOR], ["A"])
    planes = frames.contributions_w_cm2(FRAME, SENSOR, "A")
    least_w_cm2 = 0.2 * scene.scenario.instrument.nei_w_cm2("A")
    wanted = planes.max(axis=0) >= least_w_cm2
    np.testing.assert_array_equal(frames.target_mask(FRAME, SENSOR, "A", 0.2) > 0, wanted)
    assert (planes[0] >= least_w_cm2).any(axis=1).sum() > 64


def test_targets_without_light_have_empty_planes(scene):
    frames = ws.Renderer(scene, device="cpu").render(range(0, 162, 20), bands=["A"])
    hidden = frames.truth[frames.truth["occulted"] & frames.truth["in_fov"]]
    assert len(hidden)
    for row in hidden[::20]:
        planes = frames.contributions_w_cm2(row["frame"], row["sensor"], "A")
        assert not planes[scene.target_names.index(row["target"])].any()
    late = scene.replace(release__time_s=1500.0)
    frames = ws.Renderer(late, device="cpu").render([FRAME], [SENSOR], ["A"])
    planes = frames.contributions_w_cm2(FRAME, SENSOR, "A")
    assert planes[0].any() and not planes[1:].any()
    assert set(np.unique(frames.target_mask(FRAME, SENSOR, "A"))) == {0, 1}


def test_images_that_are_not_there(scene):
    frames = ws.Renderer(scene, device="cpu").render([FRAME], [SENSOR], ["A"])
    for image in ((99, SENSOR, "A"), (FRAME, "sat27", "A"), (FRAME, SENSOR, "C")):
        with pytest.raises(ws.InputError, match="was not rendered"):
            frames.contributions_w_cm2(*image)
        with pytest.raises(ws.InputError, match="was not rendered"):
            frames.target_mask(*image)
    for least_nei in (0.0, -1.0, np.nan, np.inf, "1", True):
        with pytest.raises(ws.InputError, match="least_nei: must be a number above 0"):
            frames.target_mask(FRAME, SENSOR, "A", least_nei)


def test_on_every_device(scene, device):
    """Where the images are drawn, the planes are."""
    frames = ws.Renderer(scene, device=device).render([FRAME], [SENSOR], ["A"], keep_signal=True)
    alone = ws.Renderer(scene, device=device, catalog=ws.StarCatalog.from_arrays([], [], {}))
    signal = alone.render([FRAME], [SENSOR], ["A"], keep_signal=True).signal_w_cm2[0, 0, 0]
    total = frames.contributions_w_cm2(FRAME, SENSOR, "A").sum(axis=0, dtype=np.float64)
    np.testing.assert_allclose(total, signal, rtol=SUM_RTOL, atol=0)
    assert frames.target_mask(FRAME, SENSOR, "A").any()
