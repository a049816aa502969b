"""The renderer: same bits in any order, truth that agrees with astropy, erfa and closed forms."""

import itertools

import erfa
import numpy as np
import pytest
import warp as wp
from scipy.integrate import quad

import warpsim as ws

AU_M = 149_597_870_700.0
C_M_S = 299_792_458.0

TRUTH_PX = 1e-5
"""Whole chain in float64 at 28 arcsec per pixel; what is left is the 1 mm of the track interpolation and 1e-9 px."""

LABEL_PX = 1e-6  # float32 rounding of some hundred pixels
BITS = "Counts of a frame alone, in any batch and order, on any number of threads"
IRRADIANCE_REL = 1e-6
"""float32 irradiance, 6e-8, and the radiance table."""


@pytest.fixture(scope="module")
def renderer(scene):
    return ws.Renderer(scene, device="cpu")


@pytest.fixture(scope="module")
def batch(renderer):
    return renderer.render(range(8), keep_signal=True)


def test_shapes_and_names(scene, renderer, batch):
    n_sensor = len(renderer.sensors_with_access)
    assert n_sensor == 10  # as in the paper
    assert batch.counts.shape == (8, n_sensor, 3, 128, 128)
    assert batch.counts.numpy().shape == batch.counts.shape
    assert batch.counts.numpy().dtype == np.uint16
    assert batch.signal_w_cm2.shape == batch.counts.shape
    assert batch.frames == list(range(8))
    assert batch.bands == ["A", "C", "E"]
    assert batch.sensors == renderer.sensors_with_access
    assert len(batch.truth) == 8 * n_sensor * 3 * 30
    assert np.from_dlpack(batch.counts).shape == batch.counts.shape


def test_frames_are_bit_identical_alone_reversed_and_on_any_thread_count(scene, renderer, batch, record_accuracy):
    counts = batch.counts.numpy()
    alone = np.concatenate([renderer.render([k]).counts.numpy() for k in range(8)])
    np.testing.assert_array_equal(alone, counts)
    backwards = renderer.render(range(7, -1, -1))
    assert backwards.frames == list(range(7, -1, -1))
    np.testing.assert_array_equal(backwards.counts.numpy()[::-1], counts)
    for n_thread in (1, 3):
        other = ws.Renderer(scene, device="cpu", n_thread=n_thread).render(range(8)).counts.numpy()
        np.testing.assert_array_equal(other, counts)
        differ = sum(np.count_nonzero(a != counts) for a in (alone, backwards.counts.numpy()[::-1], other))
        record_accuracy(BITS, differ, 0, "pixels differ", "each other")


def test_a_choice_of_sensors_and_bands_changes_no_bit(renderer, batch):
    chosen = renderer.render([3, 5], sensors=["sat47", "sat11"], bands=["E", "A"])
    for i, frame in enumerate([3, 5]):
        for j, sensor in enumerate(["sat47", "sat11"]):
            for k, band in enumerate(["E", "A"]):
                whole = batch.counts.numpy()[frame, batch.sensors.index(sensor), batch.bands.index(band)]
                np.testing.assert_array_equal(chosen.counts.numpy()[i, j, k], whole)


def test_passes_and_list_growth_change_no_bit(scene, batch, monkeypatch):
    from warpsim.render import schedule

    monkeypatch.setattr(schedule, "BYTES_PER_PASS", 4 * 3 * 128 * 128)  # one view at a time
    renderer = ws.Renderer(scene, device="cpu")
    np.testing.assert_array_equal(renderer.render(range(8)).counts.numpy(), batch.counts.numpy())
    (pipelines,) = renderer._pipelines.values()
    assert {pipeline.n_view for pipeline in pipelines._pipelines} == {1}


def test_source_lists_grow_until_no_star_is_lost():
    # Some 1,700 stars a frame.
    wide = ws.Scene.load("stss").replace(
        camera__fov_deg=20.0, camera__n_row=64, camera__n_col=64, optics__psf="gaussian"
    )
    renderer = ws.Renderer(wide, device="cpu")
    frames = renderer.render([60], sensors=["sat11"], keep_stars=True)
    assert len(frames.stars) > 1000
    (pipelines,) = renderer._pipelines.values()
    assert pipelines._pipelines[0].n_slot > len(frames.stars)
    again = renderer.render([60], sensors=["sat11"])
    np.testing.assert_array_equal(again.counts.numpy(), frames.counts.numpy())


def sensor_velocity_m_s(scene, name, time_s):
    """Barycentric velocity: the Earth's from erfa, the orbital one by a central difference."""
    tdb = (scene.epoch + seconds(time_s)).tdb
    earth = erfa.epv00(tdb.jd1, tdb.jd2)[1]["v"] * AU_M / 86400.0
    ends = scene.position_m(name, [time_s - 0.5, time_s + 0.5])
    return earth + (ends[1] - ends[0]), earth


def seconds(time_s):
    from astropy.time import TimeDelta

    return TimeDelta(time_s, format="sec")


def aberrated(direction, velocity_m_s):
    beta = velocity_m_s / C_M_S
    return erfa.ab(direction, beta, 1.0, np.sqrt(1 - beta @ beta))


def meets_earth(start_m, direction, pole):
    """Whether rays meet the WGS84 ellipsoid x' M x = 1: a real root of the quadratic, ahead."""
    a, b = 6378137.0, 6378137.0 * (1 - 1 / 298.257223563)
    m = np.eye(3) / a**2 + np.outer(pole, pole) * (1 / b**2 - 1 / a**2)
    square = np.einsum("ni,ij,nj->n", direction, m, direction)
    half = direction @ m @ start_m
    root = half**2 - square * (start_m @ m @ start_m - 1)
    return (root > 0) & (half < 0)


@pytest.mark.parametrize("frame", [40, 90, 120])
def test_star_places_agree_with_erfa_and_astropy_wcs(scene, renderer, frame, record_accuracy):
    """Every star of the frame: proper motion by erfa, aberration by erfa, projection by astropy.wcs; and none lost."""
    frames = renderer.render([frame], keep_stars=True)
    time_s = float(frames.time_s[0])
    catalog = ws.StarCatalog.default()
    tdb = (scene.epoch + seconds(time_s)).tdb
    cos_dec = np.cos(np.radians(catalog.dec_deg))
    to_rad = np.radians(1 / 3.6e6)
    with pytest.warns(erfa.ErfaWarning):  # "distance overridden": parallax is 0 here
        ra, dec, *_ = erfa.pmsafe(
            np.radians(catalog.ra_deg), np.radians(catalog.dec_deg), catalog.pm_ra_mas_yr * to_rad / cos_dec,
            catalog.pm_dec_mas_yr * to_rad, 0.0, 0.0, 2451545.0, 0.0, tdb.jd1, tdb.jd2,
        )  # fmt: skip
    direction = erfa.s2c(ra, dec)
    worst, n_star, n_hidden = 0.0, 0, 0
    for name in frames.sensors:
        velocity, _ = sensor_velocity_m_s(scene, name, time_s)
        wcs = frames.wcs(frame, name)
        boresight = erfa.s2c(*np.radians(wcs.wcs.crval))
        near = np.flatnonzero(direction @ boresight > np.cos(np.radians(1.0)))
        seen_ra, seen_dec = erfa.c2s(aberrated(direction[near], velocity))
        x, y = wcs.all_world2pix(np.degrees(seen_ra), np.degrees(seen_dec), 0)
        inside = (np.abs(x - 63.5) < 64) & (np.abs(y - 63.5) < 64)
        hidden = meets_earth(scene.position_m(name, [time_s])[0], direction[near], scene.scenario.tracks.pole_icrs)
        n_hidden += np.count_nonzero(inside & hidden)
        inside &= ~hidden
        stars = frames.stars[(frames.stars["sensor"] == name) & frames.stars["in_fov"]]
        assert set(stars["catalog_row"]) == set(near[inside])
        place = dict(zip(near.tolist(), zip(x, y, strict=True), strict=True))
        for star in stars:
            worst = max(worst, np.hypot(*(np.array(place[star["catalog_row"]]) - [star["x_px"], star["y_px"]])))
            n_star += 1
    assert n_star > 10
    assert n_hidden > 0  # some sensors have no access and look at the Earth
    assert worst < TRUTH_PX
    record_accuracy("Position of a star, whole chain", worst, TRUTH_PX, "px", "ERFA, astropy.wcs")


def boost(velocity_m_s):
    """Lorentz transformation of (ct, x) into the frame that moves with the given velocity, 4 x 4."""
    beta = velocity_m_s / C_M_S
    gamma = 1 / np.sqrt(1 - beta @ beta)
    matrix = np.empty((4, 4))
    matrix[0, 0], matrix[0, 1:], matrix[1:, 0] = gamma, -gamma * beta, -gamma * beta
    matrix[1:, 1:] = np.eye(3) + (gamma - 1) * np.outer(beta, beta) / (beta @ beta)
    return matrix


@pytest.mark.parametrize("frame", [40, 90, 120])
def test_target_places_agree_with_lorentz_transformed_light(scene, renderer, frame, record_accuracy):
    """The photon's four-vector, geocentric -> barycentric -> observer, then astropy.wcs."""
    frames = renderer.render([frame], bands=["A"])
    time_s = float(frames.time_s[0])
    truth = frames.truth
    worst = 0.0
    for name in frames.sensors:
        velocity, earth_velocity = sensor_velocity_m_s(scene, name, time_s)
        sensor = scene.position_m(name, [time_s])[0]
        for target in ("center", "sphere01", "cylinder10", "cone09"):
            path, delay_s = np.zeros(3), 0.0
            for _ in range(4):
                path = scene.position_m(target, [time_s - delay_s])[0] - sensor
                delay_s = np.linalg.norm(path) / C_M_S
            photon = np.array([np.linalg.norm(path), *-path])  # it flies towards the sensor
            seen = -(boost(velocity) @ boost(-earth_velocity) @ photon)[1:]
            ra, dec = erfa.c2s(seen)
            x, y = frames.wcs(frame, name).all_world2pix(np.degrees(ra), np.degrees(dec), 0)
            row = truth[(truth["sensor"] == name) & (truth["target"] == target)][0]
            worst = max(worst, np.hypot(x - row["x_px"], y - row["y_px"]))
            assert row["range_km"] == pytest.approx(np.linalg.norm(path) / 1e3, abs=1e-5)
            if target == "center":  # the camera tracks it
                assert (row["x_px"], row["y_px"]) == pytest.approx((63.5, 63.5), abs=1e-6)
    assert worst < TRUTH_PX
    record_accuracy("Position of a target, whole chain", worst, TRUTH_PX, "px", "light's four-vector, astropy.wcs")


def test_irradiance_is_emissivity_times_radiance_times_area_over_range_squared(scene, renderer, record_accuracy):
    truth = renderer.render([90]).truth
    band = {name: ws.BANDS[name] for name in "ACE"}

    def radiance(kelvin, name):
        """Planck times response, integrated by scipy between the response's nodes."""
        h, k = 6.62607015e-34, 1.380649e-23
        nodes, response = np.asarray(band[name].wavelength_um), np.asarray(band[name].response)

        def integrand(um):
            m = um * 1e-6
            planck = 2 * h * C_M_S**2 / m**5 / np.expm1(h * C_M_S / (m * k * kelvin))
            return np.interp(um, nodes, response) * planck * 1e-6

        return sum(quad(integrand, a, b, epsrel=1e-12)[0] for a, b in itertools.pairwise(nodes))

    for row in truth[(truth["sensor"] == "sat11") & np.isin(truth["target"], ["center", "sphere03"])]:
        emissivity = 0.1 if row["target"] == "center" else 0.05
        expected = emissivity * radiance(row["temperature_k"], row["band"]) * row["projected_area_m2"]
        expected /= (row["range_km"] * 1e3) ** 2 * 1e4
        assert row["emitted_w_cm2"] == pytest.approx(expected, rel=IRRADIANCE_REL, abs=0)
        error = abs(row["emitted_w_cm2"] / expected - 1)
        record_accuracy("Thermal emission of a target", error, IRRADIANCE_REL, "of it", "scipy, Planck's law")
        assert row["temperature_k"] == pytest.approx(350 - 22 * 900 / 1614, abs=1e-3)
        if row["target"] == "sphere03":
            assert row["projected_area_m2"] == pytest.approx(np.pi * 0.25, rel=1e-12)


def test_size_of_the_main_cone_at_2000_km():
    """Emissivity 0.1, 340 K, band A, broadside: a few 1e-17 W/cm2, tens of NEI."""
    area = float(ws.Cone(0.25, 1.0).projected_area_m2(np.pi / 2))
    irradiance = 0.1 * float(ws.band_radiance_w_m2_sr(340.0, "A")) * area / 2e6**2 * 1e-4
    assert 2e-17 < irradiance < 9e-17


@pytest.mark.parametrize("offset_px", [(0.0, 0.0), (0.31, -0.47), (-20.123, 7.5)])
def test_light_and_label_are_the_same_number(scene, offset_px, record_accuracy):
    """The centroid of a lone target's noiseless stamp lies where truth says, and its light adds up to truth's."""
    alone = scene.replace(
        targets=scene.to_dict()["groups"][0]["targets"][:1],
        optics={"aperture_m": 0.4, "psf": "gaussian", "sigma_px": 1.3, "stamp_cut_nei": 1e-9},
        sky__catalog="none",
        pointing__offset_px=offset_px,
    )
    frames = ws.Renderer(alone, device="cpu").render([60], ["sat27"], ["A"], keep_signal=True)
    row, image = frames.truth[0], frames.signal_w_cm2.numpy()[0, 0, 0].astype(np.float64)
    rows, columns = np.indices(image.shape)
    total = image.sum()
    assert total == pytest.approx(row["irradiance_w_cm2"] - row["left_out_w_cm2"], rel=1e-6, abs=0)
    assert (row["x_px"], row["y_px"]) == pytest.approx((63.5 + offset_px[0], 63.5 + offset_px[1]), abs=1e-6)
    apart = max(abs((image * columns).sum() / total - row["x_px"]), abs((image * rows).sum() / total - row["y_px"]))
    assert apart < LABEL_PX
    record_accuracy("Centroid of a target's light from its label", apart, LABEL_PX, "px", "truth")


def test_noiseless_signal_explains_the_counts(scene, batch):
    """(counts - offset) / gain - signal / NEI is unit noise, and a little quantisation."""
    detector = scene.detector
    level = (batch.counts.numpy().astype(np.float64) - detector.offset_counts) / detector.counts_per_nei
    noise = level - np.minimum(batch.signal_w_cm2.numpy() / detector.nei_w_cm2, detector.dynamic_range)
    n = noise.size
    assert abs(noise.mean()) < 5 / np.sqrt(n)
    assert noise.var() == pytest.approx(1 + 1 / 12 / detector.counts_per_nei**2, abs=5 * np.sqrt(2 / n))


def test_images_do_not_depend_on_seedless_state_but_on_the_seed(scene, batch):
    other = ws.Renderer(scene.replace(seed=scene.seed + 2**32), device="cpu").render([0]).counts.numpy()
    assert (other != batch.counts.numpy()[:1]).mean() > 0.8


@pytest.mark.parametrize(("n_row", "n_col"), [(1, 1), (3, 200), (127, 129)])
@pytest.mark.ci
def test_odd_image_shapes(scene, n_row, n_col):
    odd = scene.replace(camera__n_row=n_row, camera__n_col=n_col, camera__fov_deg=n_col / 128)
    frames = ws.Renderer(odd, device="cpu").render([60, 61], sensors=["sat11"], keep_signal=True)
    assert frames.counts.shape == (2, 1, 3, n_row, n_col)
    assert frames.counts.numpy().min() > 0
    assert np.isfinite(frames.signal_w_cm2.numpy()).all()


def test_empty_sky_and_gaussian_optics(scene):
    frames = ws.Renderer(scene.replace(sky__catalog="none", optics__psf="gaussian"), device="cpu").render(
        [60], keep_stars=True
    )
    assert len(frames.stars) == 0
    assert frames.counts.numpy().max() > 110


def test_group_pointing_and_up_rules(scene):
    for up in ("zenith", "north", "orbit_normal"):
        turned = scene.replace(pointing={"track": "group", "up": up})
        frames = ws.Renderer(turned, device="cpu").render([90], sensors=["sat11"], bands=["A"])
        axes = frames.axes_icrs[0, 0]
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(axes) == pytest.approx(1.0)
        place = turned.position_m("sat11", frames.time_s)[0]
        if up == "zenith":  # rows grow downwards, and zenith has no part across
            assert axes[1] @ place < 0
            assert axes[0] @ place == pytest.approx(0, abs=1e-6 * np.linalg.norm(place))
        if up == "north":
            assert axes[1][2] < 0
            assert axes[0][2] == pytest.approx(0, abs=1e-14)
        mean = np.mean([frames.truth["x_px"], frames.truth["y_px"]], axis=1)
        np.testing.assert_allclose(mean, [63.5, 63.5], atol=0.01)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda r: r.render([-1]), "frames: must be whole numbers"),
        (lambda r: r.render([1.5]), "frames: must be whole numbers"),
        (lambda r: r.render([10**6]), "after the scene's end"),
        (lambda r: r.render([0], sensors=["sat99"]), "sensors: must be sensors of the scene .* got 'sat99'"),
        (lambda r: r.render([0], bands=["Z"]), "bands: must be among A, C, E, got 'Z'"),
        (lambda r: r.render([0], bands=[]), "bands: must name at least one"),
        (lambda r: r.render([0]).stars, "keep_stars"),
        (lambda r: r.render([0]).wcs(1, "sat11"), "was not rendered"),
        (lambda r: ws.Renderer(r.scene, device="cuda:9"), "device: must be "),
        (lambda r: ws.Renderer(r.scene, n_thread=0), "n_thread: must be a whole number >= 1"),
    ],
)
def test_bad_requests_say_what_is_wrong(renderer, call, text):
    with pytest.raises(ws.InputError, match=text) as caught:
        call(renderer)
    assert "\n" not in str(caught.value)


def test_no_sensor_with_access_is_said(scene):
    blind = scene.replace(access_rules__max_range_km=10.0)
    with pytest.raises(ws.InputError, match="none has access"):
        ws.Renderer(blind, device="cpu").render([0])


def test_hostile_but_legal_scenes_stay_finite(scene):
    hostile = scene.replace(
        targets=scene.to_dict()["groups"][0]["targets"][:1],
        targets__0__attitude__axis=[1e200, 1e200, 1e-200],
        targets__0__temperature={"start_k": 3.0, "end_k": 1e4},
        detector__bits=1,
        detector__offset_counts=0.0,
    )
    frames = ws.Renderer(hostile, device="cpu").render([60, 100], keep_signal=True)
    assert np.isfinite(frames.signal_w_cm2.numpy()).all()
    assert frames.counts.numpy().max() == 1
    for name in ("x_px", "aspect_deg", "irradiance_w_cm2", "snr_peak"):
        assert np.isfinite(frames.truth[name]).all()


def test_widest_gaussian_stamps_stay_within_their_buffer(scene):
    """Sigma where the half-width meets the buffer's size, and a cut far below any noise."""
    for sigma_px in (0.9973, 1.0, 2.14):
        optics = {"aperture_m": 0.4, "psf": "gaussian", "sigma_px": sigma_px, "stamp_cut_nei": 1e-12}
        renderer = ws.Renderer(scene.replace(optics=optics), device="cpu")
        frames = renderer.render([60], ["sat11"], ["A"], keep_signal=True)
        assert np.isfinite(frames.signal_w_cm2.numpy()).all()
        assert np.abs(frames.truth["left_out_w_cm2"] / frames.truth["irradiance_w_cm2"]).max() < 1e-6


def test_no_frames_is_an_empty_result(renderer):
    frames = renderer.render([])
    assert frames.counts.shape[0] == 0
    assert len(frames.truth) == 0
    assert len(renderer.render([], keep_stars=True).stars) == 0


@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_cpu_and_cuda_agree(scene, batch, record_accuracy):
    frames = ws.Renderer(scene, device="cuda:0").render(range(8), keep_signal=True)
    signal = batch.signal_w_cm2.numpy()
    np.testing.assert_allclose(frames.signal_w_cm2.numpy(), signal, rtol=0, atol=1e-6 * signal.max())
    error = np.abs(frames.signal_w_cm2.numpy() - signal).max() / signal.max()
    record_accuracy("Signal on CUDA and on the CPU", error, 1e-6, "of the brightest pixel", "each other")
    assert (frames.counts.numpy() != batch.counts.numpy()).mean() < 1e-3  # rounding at a count's edge


def test_a_renderer_of_another_scene_shares_the_stars_that_are_the_same(scene, renderer):
    other = scene.replace(seed=8, optics__aperture_m=0.4)
    shared = renderer.with_scene(other)
    assert shared.catalog is renderer.catalog
    alone = ws.Renderer(other, renderer.device)
    assert np.array_equal(shared.render([0, 1]).counts.numpy(), alone.render([0, 1]).counts.numpy())


def test_a_renderer_of_another_epoch_or_sky_has_its_own_stars(scene, renderer):
    for changes, same in (({"epoch_utc": "2035-01-01T14:00:00"}, True), ({"sky__catalog": "none"}, False)):
        other = scene.replace(**changes)
        moved, alone = renderer.with_scene(other), ws.Renderer(other, renderer.device)
        assert (moved.catalog._origin is renderer.catalog._origin) == same
        assert np.array_equal(moved.catalog.ra_deg, alone.catalog.ra_deg)
        assert np.array_equal(moved.render([0]).counts.numpy(), alone.render([0]).counts.numpy())


def test_renderers_of_renderers_have_the_stars_of_their_scenes(scene, renderer):
    chained = renderer.with_scene(scene.replace(name="other")).with_scene(scene.replace(sky__catalog="none"))
    assert len(chained.catalog) == 0


def test_a_catalog_that_was_given_stays(scene, renderer):
    mine = ws.StarCatalog.synthetic(1000, seed=3)
    given = ws.Renderer(scene, renderer.device, catalog=mine, chunk_bytes=2**20, pool_bytes=2**19)
    other = given.with_scene(scene.replace(sky__physics="paper"))
    assert other.catalog._origin is mine and other.chunk_bytes == 2**20
