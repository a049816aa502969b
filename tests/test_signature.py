"""Signatures of targets in a scene: axes, shadow, terms of light, exposure, light curves."""

import dataclasses

import numpy as np
import pytest
import warp as wp
from astropy import units as u
from bodies import CORNERS, TRIANGLES, emission_s, facets, ground_m, sight_m
from on_devices import arrays_of_views, device_bodies, launched, target_field
from scipy.spatial.transform import Rotation
from warpsim_kernels import motion
from warpsim_kernels.earth import Earth
from warpsim_kernels.earth import sunlit_fraction as sunlit_fraction_there
from warpsim_kernels.signature import Features

import warpsim as ws
from warpsim.orbit.sun import sunlit_fraction
from warpsim.radiometry.sun_and_earth import sun_irradiance_w_m2
from warpsim.render.buffers import new_area_series
from warpsim.render.stages import aim, observe_targets
from warpsim.render.target_field import earth_struct, motion_struct
from warpsim.target.attitude import body_motion
from warpsim.target.earth_light import INFRARED_ERRORS

SEED = 31415
AXES_ATOL = 2e-14  # phases of both sides are rounded once
SUNLIT_ATOL = 1e-12  # the same formulae in another order of operations
FACET_RTOL = 2e-6  # 2000 x 500 facets against closed forms
SPLIT_RTOL = 2e-7  # float32 of the sum
EXPOSURE_SAFETY = 2.0  # the error is measured on samples


@pytest.fixture(scope="module")
def day(scene):
    """The preset in sunlight: all targets lit, no emission left out, every sensor free to look."""
    return scene.replace(epoch_utc="2025-03-20T06:00:00", sky__catalog="none", duration_s=1600.0, frames__count=100)


@wp.kernel(enable_backward=False)
def axes_kernel(
    attitude: motion.Attitude, time_s: wp.array[wp.float64], before: wp.array[wp.mat33d], after: wp.array[wp.mat33d]
):
    i = wp.tid()
    before[i] = motion.axes_before_spin(attitude, time_s[i])
    after[i] = motion.spun(before[i], attitude, time_s[i])


def test_axes_of_the_kernel_are_the_hosts(device):
    """Rows are the body's axes; spin, precession and rolling at once, to 1e6 s."""
    attitude = ws.Attitude(
        spin_rev_s=4.9, precession_rev_s=1 / 3, precession_angle_deg=20.0, rolling_rev_s=-0.7, axis=(0.2, -0.5, 0.4)
    )
    body = body_motion(attitude, np.array([1.0, 2.0, 3.0]), SEED, 3)
    time_s = np.concatenate([[0.0, 0.5], np.random.default_rng(SEED).uniform(0, 1e6, 200)])
    kinds = [wp.mat33d, wp.mat33d]
    before, after = launched(axes_kernel, len(time_s), [motion_struct(body), time_s], kinds, device)
    expected = np.swapaxes(Rotation.from_quat(body.at(time_s)).as_matrix(), 1, 2)
    np.testing.assert_allclose(after, expected, rtol=0, atol=AXES_ATOL * 2 * np.pi)
    np.testing.assert_allclose(before[:, 2], expected[:, 2], rtol=0, atol=AXES_ATOL * 2 * np.pi)
    np.testing.assert_allclose(before @ np.swapaxes(before, 1, 2), np.broadcast_to(np.eye(3), before.shape), atol=1e-15)


@wp.kernel(enable_backward=False)
def sunlit_kernel(place_m: wp.array[wp.vec3d], sun_m: wp.array[wp.vec3d], earth: Earth, part: wp.array[wp.float64]):
    i = wp.tid()
    part[i] = sunlit_fraction_there(place_m[i], sun_m[i] - place_m[i], earth)


def test_sunlit_fraction_of_the_kernel_is_the_hosts(scene, device):
    """Places about the edge of the shadow, high and low, and everywhere else."""
    rng = np.random.default_rng(SEED)
    sun = np.array([0.3, -0.8, 0.35]) * 1.496e11
    away = -sun / np.linalg.norm(sun)
    across = rng.normal(size=(4000, 3))
    across -= (across @ away)[:, None] * away
    across /= np.linalg.norm(across, axis=1)[:, None]
    along_m = rng.uniform(0, 4e7, 4000)
    half_width_m = 0.00465 * along_m  # of the penumbra
    radius_m = 6.37e6 + rng.uniform(-3, 3, 4000) * np.maximum(half_width_m, 2e4)
    place = along_m[:, None] * away + radius_m[:, None] * across
    place = np.concatenate([place, rng.normal(size=(1000, 3)) * 1e7])
    place = place[np.linalg.norm(place, axis=1) > 6.4e6]
    expected = sunlit_fraction(place, sun, scene.scenario.tracks.pole_icrs)
    assert 300 < np.sum((expected > 0) & (expected < 1)) < 4000
    inputs = [place, np.broadcast_to(sun, place.shape), earth_struct(scene.scenario.tracks.pole_icrs)]
    (found,) = launched(sunlit_kernel, len(place), inputs, [wp.float64], device)
    np.testing.assert_allclose(found, expected, rtol=0, atol=SUNLIT_ATOL)


@pytest.mark.parametrize("target", ["center", "sphere04", "cylinder02", "cone03"])
def test_reflected_sunlight_is_that_of_a_mesh(day, device, target, record_accuracy):
    """Track, light time, attitude, Sun's distance and eclipse, radiance and facets, written out on their own."""
    frames = ws.Renderer(day, device=device).render([1, 33, 99], ["sat11", "sat47"], ["A", "E"])
    rows = frames.truth[frames.truth["target"] == target]
    spec = day.scenario.targets[day.target_names.index(target)].spec
    normal, area = facets(spec.shape, 2000, 500)
    assert np.all(rows["sunlit_fraction"] == 1)
    for row in rows[~rows["occulted"]]:
        emitted_s, (place, view) = emission_s(row), sight_m(day, target, row)
        sun = day.position_m("sun", [emitted_s])[0] - place
        turned = Rotation.from_quat(day.scenario.attitude_quaternion(target, [emitted_s])[0]).apply(normal)
        lit = np.maximum(turned @ view / np.linalg.norm(view), 0) * np.maximum(turned @ sun / np.linalg.norm(sun), 0)
        sunlight = sun_irradiance_w_m2(row["band"]) * (149597870700.0 / np.linalg.norm(sun)) ** 2
        reflectance = spec.surface.reflectance_in(row["band"])
        expected = reflectance / np.pi * sunlight * np.sum(lit * area) / np.sum(view**2) * 1e-4
        assert row["sun_w_cm2"] == pytest.approx(expected, rel=FACET_RTOL, abs=1e-6 * row["emitted_w_cm2"])
        error = abs(row["sun_w_cm2"] - expected) / row["emitted_w_cm2"]
        limit = max(FACET_RTOL * expected / row["emitted_w_cm2"], 1e-6)
        record_accuracy("Reflected sunlight of a target", error, limit, "of its own light", "a million facets")
    assert (rows["sun_w_cm2"] > 1e-19).any()


def view_factors(cosine, height):
    """Plane element to a sphere, height = distance over radius; Howell's catalog, as printed with arc sines."""
    out = np.where(cosine > 0, cosine / height**2, 0.0)
    root = np.sqrt(height**2 - 1)
    rising = np.abs(cosine) < 1 / height
    c = cosine[rising]
    sine = np.sqrt(1 - c * c)
    out[rising] = (
        0.5
        - np.arcsin(root / (height * sine)) / np.pi
        + (c * np.arccos(-root * c / sine) - root * np.sqrt(1 - height**2 * c * c)) / (np.pi * height**2)
    )
    return out


@pytest.mark.parametrize("target", ["center", "sphere04", "cylinder02", "cone03"])
def test_reflected_heat_of_the_earth_is_that_of_a_mesh(day, device, target, record_accuracy):
    """Facets with the printed view factor, the Earth's radius below the target, default brightness temperatures."""
    truth = ws.Renderer(day, device=device).render([1, 99], ["sat11", "sat47"], ["A", "E"]).truth
    rows = truth[(truth["target"] == target) & ~truth["occulted"]]
    spec = day.scenario.targets[day.target_names.index(target)].spec
    normal, area = facets(spec.shape, 2000, 500)
    pole = day.scenario.tracks.pole_icrs
    for row in rows:
        emitted_s, (place, view) = emission_s(row), sight_m(day, target, row)
        distance = np.linalg.norm(place)
        up = place / distance
        radius = ground_m(up, pole)
        turned = Rotation.from_quat(day.scenario.attitude_quaternion(target, [emitted_s])[0]).apply(normal)
        factor = view_factors(-turned @ up, distance / radius)
        kelvin = {"A": 275.0, "E": 260.0}[row["band"]]
        seen = np.sum(np.maximum(turned @ view / np.linalg.norm(view), 0) * factor * area)
        intensity = spec.surface.reflectance_in(row["band"]) * ws.band_radiance_w_m2_sr(kelvin, row["band"]) * seen
        most = INFRARED_ERRORS[0] * np.pi * 0.5**2 * spec.surface.reflectance_in(row["band"])
        slack = most * ws.band_radiance_w_m2_sr(kelvin, row["band"]) * 1e-4 / np.sum(view**2)
        expected = intensity / np.sum(view**2) * 1e-4
        assert row["earth_w_cm2"] == pytest.approx(expected, rel=FACET_RTOL, abs=slack)
        error = abs(row["earth_w_cm2"] - expected) / max(slack, FACET_RTOL * expected)
        record_accuracy("Earth infrared, by its rule", error, 1, "of what it allows", "a million facets")
    assert (rows["earth_w_cm2"] > 1e-19).all()


@pytest.mark.ci
def test_sunlight_by_way_of_the_earth_is_that_of_patches(day, device, record_accuracy):
    """A sphere: the Earth's disc in 400 x 400 patches, each a small sun."""
    fine = day.replace(lighting__albedo_error=2e-3)
    row, short = (ws.light_curves(s, [200.0], ["sat11"], ["sphere04"], ["A"], device=device) for s in (fine, day))
    emitted_s = 200.0 - row.range_km.item() * 1e3 / 299792458.0
    place = day.position_m("sphere04", [emitted_s])[0]
    view = day.position_m("sat11", [200.0])[0] - place
    sun = day.position_m("sun", [emitted_s])[0]
    distance, au = np.linalg.norm(place), np.linalg.norm(sun - place) / 149597870700.0
    pole = day.scenario.tracks.pole_icrs
    up = place / distance
    radius = ground_m(up, pole)
    # Patches of ground on rings of equal area about the point below, as far as the horizon.
    n = 400
    cosine = 1 - (np.arange(n) + 0.5) / n * (1 - radius / distance)
    turn = (np.arange(n) + 0.5) * 2 * np.pi / n
    first = np.cross(up, [0.3, 0.4, 0.5])
    first /= np.linalg.norm(first)
    across = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * np.cross(up, first)
    ground = cosine[:, None, None] * up + np.sqrt(1 - cosine**2)[:, None, None] * across
    way = place - radius * ground  # to the target
    far = np.linalg.norm(way, axis=-1)
    shine = np.maximum(ground @ sun / np.linalg.norm(sun), 0) * np.einsum("ijk,ijk->ij", ground, way) / far
    patch = 2 * np.pi * radius**2 * (1 - radius / distance) / n**2
    cosine = np.clip(-way @ view / np.linalg.norm(view) / far, -1, 1)
    phase = np.arccos(cosine)
    reflected = 2 / 3 * 0.5**2 * (np.sin(phase) + (np.pi - phase) * cosine)
    sunlight = sun_irradiance_w_m2("A") / au**2
    irradiance = np.sum(0.3 / np.pi * sunlight * shine * patch / far**2 * reflected) * 0.95 / np.pi
    expected = irradiance / np.sum(view**2) * 1e-4
    assert row.terms_w_cm2["albedo"].item() == pytest.approx(expected, rel=2e-3, abs=0)  # patches at the terminator
    assert row.terms_w_cm2["albedo"].item() > 1e-20
    error = abs(row.terms_w_cm2["albedo"].item() / expected - 1)
    record_accuracy("Earth albedo on a sphere", error, 2e-3, "of it", "400 x 400 patches of ground")
    assert short.terms_w_cm2["albedo"].item() == pytest.approx(expected, rel=day.lighting.albedo_error, abs=0)


@pytest.mark.ci
def test_albedo_may_be_rougher_where_it_is_faint(day):
    """By the error asked for, and by what may be left out."""

    def degree(scene):
        return target_field(scene, ["A"]).features.albedo_degree

    fine = day.replace(lighting__albedo_error=2e-3)
    bound_nei = day.scenario.instrument.light_terms["albedo"].bound_nei
    assert degree(day) == 4
    assert degree(fine) == 12
    assert degree(fine.replace(lighting__leave_out_nei=bound_nei * 1.1e-2)) == 4
    assert degree(fine.replace(lighting__leave_out_nei=bound_nei * 0.9e-2)) == 8


def test_terms_add_up_to_the_light(day, device):
    truth = ws.Renderer(day, device=device).render([0, 60], ["sat11", "sat27", "sat47"]).truth
    total = sum(truth[f"{name}_w_cm2"] for name in ("emitted", "sun", "earth", "albedo"))
    np.testing.assert_allclose(truth["irradiance_w_cm2"], total, rtol=SPLIT_RTOL, atol=0)
    for name in ("emitted", "sun"):
        assert str(truth[f"{name}_w_cm2"].unit) == "W / cm2"
        assert (truth[f"{name}_w_cm2"][~truth["occulted"]] > 0).any()


def test_sun_and_earth_of_ones_own(day, device):
    """Irradiance and brightness temperature by band; other bands keep theirs."""
    own = day.replace(lighting={"sun_w_cm2": {"A": 1.75e-4}, "earth_k": {"E": 255.0}, "earth_albedo": 0.6})
    both = [ws.light_curves(s, [300.0, 900.0], ["sat11"], ["sphere04"], device=device) for s in (own, day)]
    ratio = {name: both[0].terms_w_cm2[name] / both[1].terms_w_cm2[name] for name in ("sun", "earth", "albedo")}
    sunlight = [1.75 / ws.Lighting().sun_w_m2_in(ws.BANDS["A"]), 1.0, 1.0]
    heat = [1.0, 1.0, ws.band_radiance_w_m2_sr(255.0, "E") / ws.band_radiance_w_m2_sr(260.0, "E")]
    np.testing.assert_allclose(ratio["sun"][:, 0, :, 0], np.broadcast_to(sunlight, (2, 3)), rtol=1e-12)
    np.testing.assert_allclose(ratio["earth"][:, 0, :, 0], np.broadcast_to(heat, (2, 3)), rtol=1e-12)
    np.testing.assert_allclose(ratio["albedo"][:, 0, :, 0], 2 * np.broadcast_to(sunlight, (2, 3)), rtol=1e-12)
    bad = [("earth_k", {"Z": 250.0}), ("earth_k", {"A": 1.0}), ("sun_w_cm2", 3.0), ("sun_w_cm2", {"A": -1.0})]
    for field, value in bad:
        with pytest.raises(ws.InputError, match=f"^Scene: lighting.{field}: "):
            day.replace(**{f"lighting__{field}": value})


def test_no_term_is_above_its_bound(day, scene):
    for one in (day, scene, day.replace(epoch_utc="2025-03-20T18:00:00")):
        curves = ws.light_curves(one, np.linspace(0, one.duration_s, 60), one.sensor_names)
        for name, term in one.scenario.instrument.light_terms.items():
            most_nei = curves.terms_w_cm2[name].max() / one.detector.nei_w_cm2
            assert most_nei <= term.bound_nei
            assert (most_nei > 0) <= term.kept


def test_what_is_left_out_and_why(day, scene):
    night = scene.replace(epoch_utc="2025-03-20T12:00:00")
    assert not night.scenario.instrument.light_terms["sun"].kept
    reason = night.scenario.instrument.light_terms["sun"].reason
    assert reason == "left out: all targets are in the Earth's shadow throughout"
    assert not night.scenario.instrument.light_terms["albedo"].kept
    for name in ("sun", "earth", "albedo"):
        off = day.replace(**{f"lighting__{name}": False}).scenario.instrument.light_terms[name]
        assert (off.kept, off.reason) == (False, "off")
    noisy = day.replace(detector__nei_w_cm2=1e-12, detector__sei_w_cm2=3e-9)
    assert not any(term.kept for term in noisy.scenario.instrument.light_terms.values())
    assert noisy.scenario.instrument.light_terms["sun"].reason.startswith("left out: at most ")
    all_kept = noisy.replace(lighting__leave_out_nei=0.0)
    assert all_kept.scenario.instrument.light_terms["sun"].kept


def test_a_term_left_out_is_not_in_the_kernel(day):
    bare = day.replace(lighting={"sun": False, "earth": False, "albedo": False})
    fields = [target_field(s, ["A"]) for s in (day, bare)]
    assert fields[1].features == Features()
    assert fields[0].features.sun
    assert fields[0].observe_kernel is not fields[1].observe_kernel
    again = target_field(bare.replace(seed=5), ["A"])
    assert again.observe_kernel is fields[1].observe_kernel


@pytest.mark.parametrize("exposure_s", [0.01, 0.13, 0.5])
@pytest.mark.ci
def test_brightness_is_averaged_over_the_exposure(day, exposure_s):
    """Against the mean of 4001 instants: cone 03 precesses at 5 rev/s, cylinders roll at 1 rev/s."""
    exposed = day.replace(detector__exposure_s=exposure_s)
    rule = exposed.scenario.instrument.exposure_rule
    assert rule.error <= exposed.lighting.quadrature_error
    names = ["center", "cylinder02", "cone03"]
    where = {"sensors": ["sat11", "sat47"], "targets": names, "bands": ["A"]}
    middle = np.array([300.0, 333.3, 1200.0])
    seen = ws.light_curves(exposed, middle, **where)
    offset = (np.arange(4001) + 0.5) / 4001 - 0.5
    many = ws.light_curves(day, (middle[:, None] + exposure_s * offset).ravel(), **where)
    for name in ("emitted", "sun"):
        mean = many.terms_w_cm2[name].reshape(3, 4001, *many.terms_w_cm2[name].shape[1:]).mean(axis=1)
        missed = np.abs(seen.terms_w_cm2[name] - mean).max(axis=(0, 1, 2))
        assert (missed < EXPOSURE_SAFETY * exposed.lighting.quadrature_error * mean.max(axis=(0, 1, 2))).all()
    instant = ws.light_curves(day, middle, **where)
    np.testing.assert_array_equal(seen.aspect_deg, instant.aspect_deg)  # of the middle
    assert day.scenario.instrument.exposure_rule.offset_s.tolist() == [0.0]


def test_light_curves_are_the_truth_of_frames(day, device):
    frames = ws.Renderer(day, device=device).render([3, 50], ["sat11", "sat27"])
    curves = ws.light_curves(day, frames.time_s, ["sat11", "sat27"], device=device).table()
    truth = frames.truth
    for name in curves.colnames:
        if name in ("irradiance_w_cm2", "snr"):
            np.testing.assert_allclose(curves[name], truth[name], rtol=SPLIT_RTOL, atol=0)
        else:
            np.testing.assert_array_equal(curves[name], truth[name], err_msg=name)
            assert curves[name].unit == truth[name].unit


def test_light_curves_do_not_depend_on_threads_or_company(day):
    times = np.linspace(0, 1600, 301)
    whole = ws.light_curves(day, times, ["sat11", "sat27"], n_thread=1)
    again = ws.light_curves(day, times, ["sat11", "sat27"], n_thread=3)
    alone = ws.light_curves(day, times[17:18], ["sat27"], ["cone03"], ["C"])
    np.testing.assert_array_equal(whole.irradiance_w_cm2, again.irradiance_w_cm2)
    column = day.target_names.index("cone03")
    assert alone.irradiance_w_cm2.item() == whole.irradiance_w_cm2[17, 1, 1, column]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"time_s": [1.0, 2000.0]}, "time_s: must be within the scene, 0 to 1600 s, got 2000"),
        ({"time_s": [np.nan]}, "time_s: must be within the scene, .* got nan"),
        ({"time_s": "noon"}, "time_s: must be numbers, got str"),
        ({"targets": ["sat11"]}, "targets: must be among center, .* got 'sat11'"),
        ({"sensors": []}, "sensors: must name at least one"),
        ({"bands": ["B1"]}, "bands: must be among A, C, E, got 'B1'"),
        ({"time_s": np.linspace(0, 1600, 10**6)}, "time_s: these curves would be .* numbers"),
    ],
)
def test_errors_of_light_curves(day, arguments, message):
    with pytest.raises(ws.InputError, match=message):
        ws.light_curves(day, **arguments)


def test_curves_say_what_they_are(day):
    curves = ws.light_curves(day, [0.0], ["sat11"], ["center"])
    assert repr(curves) == "LightCurves(stss: 1 times, 1 sensors, 1 targets, bands A C E)"
    assert {field.name for field in dataclasses.fields(curves)} >= {"range_km", "aspect_deg", "terms_w_cm2"}
    assert curves.snr.shape == (1, 1, 3, 1)


@pytest.mark.ci
def test_a_mesh_gives_the_light_of_the_body_it_is_made_after(day, device):
    """A cube without spin against a closed form; a fine cone against the cone; spin turns a brick."""
    brick = ws.Mesh(vertices_m=CORNERS * [1.0, 0.2, 0.5], faces=TRIANGLES)
    spinning = {"spin_rev_s": 0.02, "spin_phase_rev": 0.0, "axis": [0.3, 0.1, 0.9], "precession_phase_rev": 0.0}
    one = day.replace(targets__0__shape=brick, targets__0__attitude=spinning)
    time_s = np.linspace(0, 40, 9)
    seen = ws.light_curves(one, time_s, ["sat11"], ["center"], ["A"], device=device)
    emitted_s = time_s - seen.range_km[:, 0, 0] * 1e3 / 299792458.0
    view = one.position_m("sat11", time_s) - one.position_m("center", emitted_s)
    turned = Rotation.from_quat(one.scenario.attitude_quaternion("center", emitted_s)).inv()
    inside = np.abs(turned.apply(view / np.linalg.norm(view, axis=1)[:, None]))
    expected = inside @ [0.2 * 0.5, 1.0 * 0.5, 1.0 * 0.2]
    np.testing.assert_allclose(seen.projected_area_m2[:, 0, 0], expected, rtol=1e-9)
    assert np.ptp(expected) > 0.05
    assert seen.terms_w_cm2["sun"].max() > 0


DARK = {"sun": False, "earth": False, "albedo": False}


@pytest.mark.parametrize("lighting", [DARK, {}], ids=["emitted", "all light"])
def test_micromotion_of_the_papers_targets(scene, lighting):
    """Fig. 12 in words: the cylinder varies most, the sphere least, cone 2 more than cone 1, and faster."""
    time_s = 700.0 + np.arange(0.0, 3.0, 0.01)
    names = ["center", "sphere01", "cylinder01", "cone01"]
    curves = ws.light_curves(scene.replace(lighting=lighting), time_s, ["sat47"], names, ["A"])
    light = curves.snr[:, 0, 0] * curves.range_km[:, 0] ** 2  # without the change of the distance
    drift = np.array([np.polyval(np.polyfit(time_s - 701.5, column, 2), time_s - 701.5) for column in light.T]).T
    swing = dict(zip(names, np.ptp(light - drift, axis=0) / light.mean(axis=0), strict=True))
    assert swing["cylinder01"] > 0.3
    assert swing["sphere01"] < 1e-4
    assert swing["cylinder01"] > 3 * swing["cone01"]
    assert swing["cone01"] > 2 * swing["center"]
    assert swing["center"] > 10 * swing["sphere01"]
    spectrum = np.abs(np.fft.rfft(light - drift, axis=0))
    fastest = dict(zip(names, np.fft.rfftfreq(300, 0.01)[spectrum.argmax(axis=0)], strict=True))
    assert fastest["cone01"] == pytest.approx(5.0, abs=0.34)  # its precession, within a bin
    assert fastest["center"] == pytest.approx(1.0, abs=0.34)
    assert fastest["cylinder01"] == pytest.approx(2.0, abs=0.34)  # twice its rolling: both ends are alike


@pytest.mark.slow
def test_an_exposure_with_too_many_turns_is_refused(day):
    mad = day.replace(detector__exposure_s=10.0, targets__3__attitude__precession_rev_s=300.0)
    with pytest.raises(ws.InputError, match=r"detector.exposure_s: targets must turn less often .* 1025 instants"):
        ws.light_curves(mad, [100.0], ["sat11"])


def test_times_may_be_quantities(day):
    """Converted once; what is no time is refused."""
    curves = ws.light_curves(day, np.array([1.0, 2.0]) * u.min, ["sat11"], ["center"])
    assert curves.time_s.tolist() == [60.0, 120.0]
    np.testing.assert_array_equal(day.position_m("center", 2 * u.min), day.position_m("center", 120.0))
    kelvin = [day.scenario.temperature_k("center", time) for time in ([0.2] * u.h, [720.0])]
    np.testing.assert_array_equal(*kelvin)
    assert ws.Cone(0.3, 1.0).projected_area_m2(90 * u.deg) == pytest.approx(0.3, rel=1e-12)
    for call in (
        lambda: day.position_m("center", [1.0] * u.m),
        lambda: day.scenario.temperature_k("center", ["noon"]),
        lambda: day.scenario.temperature_k("center", [1e6]),
        lambda: ws.light_curves("stss"),
        lambda: ws.light_curves(day, [1.0], n_thread=0),
    ):
        with pytest.raises(ws.InputError):
            call()
    assert ws.light_curves(day, [], ["sat11"]).snr.shape == (0, 1, 3, 30)


@pytest.mark.ci
def test_sunlit_fraction_is_not_made_up(day, scene):
    off = ws.light_curves(day.replace(lighting__sun=False), [100.0], ["sat11"])
    assert np.isnan(off.sunlit_fraction).all()
    night = ws.light_curves(scene.replace(epoch_utc="2025-03-20T12:00:00"), [100.0], ["sat11"])
    assert (night.sunlit_fraction == 0).all()


def test_threads_share_the_targets_of_a_view(day, device):
    """Whether one thread takes all targets of a view or each takes one, every bit is the same."""
    bodies = device_bodies(day, ["A", "E"], device)
    found = []
    for threads_per_view in (1, 7, bodies.n_target):
        field = dataclasses.replace(bodies.field, threads_per_view=threads_per_view)
        world = dataclasses.replace(bodies, field=field)
        inputs, columns, sources = arrays_of_views(world, np.linspace(0, 1600, 9), sensor=np.arange(9))
        aim(world, inputs, columns.views).run()
        observe_targets(world, inputs, columns, sources, new_area_series(world, 9)).run()
        seen = columns.observations.numpy()
        found.append([*(seen[name] for name in seen.dtype.names), columns.irradiance_w_cm2.numpy()])
    assert (found[0][-1] > 0).any()
    for other in found[1:]:
        for one, two in zip(found[0], other, strict=True):
            np.testing.assert_array_equal(one, two)


def test_a_spread_group_is_lit_where_its_main_target_is_not(scene):
    """Released a day ago, 1,200 km wide: the main target is deep in the shadow, others are out of it."""
    wide = scene.replace(
        trajectory={"kind": "elements", "altitude_km": 500.0, "inclination_deg": 20.0, "mean_anomaly_deg": 120.0},
        epoch_utc="2025-03-20T12:00:00",
        duration_s=300.0,
        frames__count=3,
        release={"speed_m_s": [2.0, 5.0], "time_s": -86400.0},
    )
    assert wide.scenario.sunlit_fraction("center", [0.0, 150.0, 300.0]).max() == 0
    assert wide.scenario.instrument.light_terms["sun"].kept
    times = np.linspace(0, 300, 7)
    curves = ws.light_curves(wide, times, ["sat11"])
    told = np.stack([wide.scenario.sunlit_fraction(name, times) for name in wide.target_names], axis=1)
    assert told.max() > 0.2
    np.testing.assert_allclose(curves.sunlit_fraction[:, 0], told, rtol=0, atol=1e-2)  # 3e-3 in a light time of ms


@pytest.mark.ci
def test_attitude_tables_hold_their_ends_through_an_exposure(day):
    table = {"kind": "table", "time_s": [0.0, 1600.0], "quaternion": [[0, 0, 0, 1], [0, 0.6, 0, 0.8]]}
    tabled = day.replace(targets__0__attitude=table, detector__exposure_s=4.0)
    assert np.isfinite(ws.light_curves(tabled, [0.0, 1600.0], ["sat11"], ["center"]).irradiance_w_cm2).all()


def test_an_exposure_fits_between_frames(day):
    with pytest.raises(ws.InputError, match=r"detector.exposure_s: must be at most frames.interval_s \(0.5\), got 1"):
        day.replace(frames={"count": 5, "interval_s": 0.5}, detector__exposure_s=1.0)


def test_sensor_at_the_target_gives_finite_light(day):
    """Range 0: every shape has some light, and nothing is NaN."""
    orbit = {"kind": "elements", "altitude_km": 600.0, "inclination_deg": 50.0}
    both = day.replace(
        trajectory=orbit, constellation={"kind": "listed", "satellites": [{"name": "eye", "orbit": orbit}]}
    )
    curves = ws.light_curves(both, [0.0, 100.0], ["eye"])
    assert np.isfinite(curves.irradiance_w_cm2).all()
    assert (curves.irradiance_w_cm2[:, :, :, 0] > 0).all()
