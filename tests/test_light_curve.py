"""Light curves as functions of parameters, their Jacobians, fits, and what they say about parameters."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from bodies import CORNERS, TRIANGLES
from conftest import slow

import warpsim as ws
from warpsim.render.information import LEAST_COLUMN, information_of

LIGHT_RTOL = 1e-12  # asked for: the same functions, with axes and phases rounded once more
SLOPE_RTOL = 1e-9  # of the largest derivative: asked for; differences are good to 1e-10
NEAR_KINK = 1e-4  # how near a kink no derivative is compared
EARTH_SHARE = 0.97  # of geometries that are not next to a node of the Earth's infrared, 8 samples each
RADIANCE_RTOL = 1e-7  # of the table of radiances, at half the scene's lowest temperature
EXPOSED_RTOL = 1e-4  # a box turns faces into view and light during any exposure
SEED = 7

BOX = ws.Mesh(vertices_m=CORNERS * [0.6, 0.4, 1.0], faces=TRIANGLES)
MOTION = ws.Attitude(0.7, 0.4, 20.0, 0.3, (0.2, -0.5, 0.4))
TABLE = ws.AttitudeTable(time_s=[0.0, 900.0, 1600.0], quaternion=[(0, 0, 0, 1), (0.6, 0, 0, 0.8), (0, 0.8, 0, 0.6)])
WARM = ws.TemperatureTable(time_s=[0.0, 700.0, 1600.0], temperature_k=[300.0, 340.0, 310.0])
SLOPED = ws.ByWavelength(wavelength_um=[6.0, 14.0], value=[0.2, 0.6])
BODIES = {
    "sphere": (ws.Sphere(0.5), MOTION, ws.Temperature(300.0, 320.0), 0.3),
    "cone": (ws.Cone(0.25, 1.0), MOTION, ws.Temperature(350.0), 0.9),
    "cylinder": (ws.Cylinder(0.25, 1.0), MOTION, ws.Temperature(350.0, 328.0), {"A": 0.9, "C": 0.8, "E": 0.5}),
    "frustum": (ws.Frustum(0.5, 0.2, 0.7), MOTION, WARM, 0.4),
    "flared": (ws.Frustum(0.2, 0.5, 0.4), MOTION, WARM, SLOPED),
    "plate": (ws.Plate(0.6, 0.9), MOTION, ws.Temperature(300.0), 0.5),
    "box": (BOX, MOTION, ws.Temperature(300.0), 0.6),
    "turned": (ws.Cone(0.4, 0.5), TABLE, ws.Temperature(300.0), 0.6),
}
TIMES = np.linspace(100.0, 1500.0, 36)
SENSORS = ["sat11", "sat47"]


def in_sunlight(scene, bodies):
    """Bodies by name: shape, attitude, temperature, reflectance, patches; no term of light left out."""
    targets = [
        ws.TargetSpec(name, shape, ws.Graybody(reflectance=rho), temperature, attitude, patches=patches)
        for name, (shape, attitude, temperature, rho, *patches) in bodies.items()
    ]
    return scene.replace(
        epoch_utc="2025-03-20T06:00:00", sky__catalog="none", duration_s=1600.0, frames__count=100,
        groups=[dataclasses.replace(scene.groups[0], targets=targets)], lighting=ws.Lighting(leave_out_nei=0.0),
    ).scenario  # fmt: skip


@pytest.fixture(scope="module")
def day(scene):
    return in_sunlight(scene, BODIES)


def terms_of(day, **terms):
    """The same scene with some terms of light alone."""
    off = {"sun": False, "earth": False, "albedo": False}
    return day.scene.replace(lighting=ws.Lighting(leave_out_nei=0.0, **(off | terms))).scenario


def five_points(curve, at, column, step):
    """Derivative by five points; the step is a power of 2 of the parameter's digits, so that it is what it says."""
    move = np.zeros(at.shape[-1])
    move[column] = step
    near = curve(at + move) - curve(at - move)
    far = curve(at + 2 * move) - curve(at - 2 * move)
    return (8 * near - far) / (12 * step)


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.ci
def test_the_scenes_own_values_give_its_light_curves(day, name, device):
    curve = ws.LightCurve(day, name, None, TIMES, SENSORS, device=device)
    expected = ws.light_curves(day, TIMES, SENSORS, name, device=device)
    assert expected.terms_w_cm2["albedo"].max() > 0 and expected.terms_w_cm2["earth"].max() > 0
    light = curve(curve.values)
    assert light.shape == (36, 2, 3)
    np.testing.assert_allclose(light, expected.irradiance_w_cm2[..., 0], rtol=LIGHT_RTOL, atol=0)
    np.testing.assert_allclose(curve.with_jacobian(curve.values)[0], light, rtol=1e-12, atol=light.max() * 1e-14)
    seen = light[..., 0] > 0
    np.testing.assert_array_equal(curve.range_km[seen], expected.range_km[..., 0][seen])


CHANGED = {
    "spin_rev_s": -0.31, "spin_phase_rev": 0.87, "precession_rev_s": 1.3, "precession_phase_rev": 0.21,
    "precession_angle_deg": 41.0, "rolling_rev_s": 0.77, "rolling_phase_rev": 0.4, "axis_ra_deg": 200.0,
    "axis_dec_deg": -35.0, "radius_m": 0.37, "height_m": 0.81, "top_radius_m": 0.29, "width_m": 0.7, "length_m": 0.5,
    "temperature_start_k": 301.0, "temperature_end_k": 287.0, "temperature_offset_k": 12.5, "emissivity.A": 0.3,
    "emissivity.C": 0.45, "emissivity.E": 0.6,
}  # fmt: skip
"""Other values of all parameters that a scene can have."""


def changed_spec(spec, value):
    """A target as a scene describes it, by the values of parameters."""
    ra, dec = np.radians(value.get("axis_ra_deg", 0.0)), np.radians(value.get("axis_dec_deg", 0.0))
    axis = (np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec))
    parts = {
        "shape": {name: value[name] for name in vars(spec.shape) if name in value},
        "attitude": {"axis": axis} | {name: value[name] for name in vars(spec.attitude) if name in value},
        "temperature": {name: value[f"temperature_{name}"] for name in ("start_k", "end_k")
                        if f"temperature_{name}" in value},
    }  # fmt: skip
    if "temperature_offset_k" in value:
        parts["temperature"] = {"temperature_k": tuple(np.array(WARM.temperature_k) + value["temperature_offset_k"])}
    new = {name: dataclasses.replace(getattr(spec, name), **change) for name, change in parts.items()}
    emissivity = {band: value[f"emissivity.{band}"] for band in "ACE"}
    return dataclasses.replace(spec, surface=ws.Graybody(emissivity=emissivity), **new)


@pytest.mark.parametrize("name", ["cone", "cylinder", "frustum", "plate", "box"])
@pytest.mark.ci
def test_other_values_give_the_light_curves_of_the_scene_that_has_them(day, name):
    """The meaning of each parameter: against scenes with other numbers."""
    curve = ws.LightCurve(day, name, None, TIMES, SENSORS, device="cpu")
    given = [own for own in curve.parameters if own in CHANGED]
    assert set(curve.parameters) - set(given) == {"scale", "range_offset_m"}
    value = {own: CHANGED[own] for own in given}
    specs = [changed_spec(target.spec, value) if target.name == name else target.spec for target in day.targets]
    other = day.scene.replace(groups=[dataclasses.replace(day.scene.groups[0], targets=specs)]).scenario
    expected = ws.light_curves(other, TIMES, SENSORS, name, device="cpu").irradiance_w_cm2[..., 0]
    sets = [CHANGED.get(own, at) for own, at in zip(curve.parameters, curve.values, strict=True)]
    found = curve(sets)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * expected.max())
    sets[curve.parameters.index("scale")] = 1.2
    sets[curve.parameters.index("range_offset_m")] = 5e4
    far = curve.range_km / (curve.range_km + 50.0)
    expected = found * 1.2**2 * np.nan_to_num(far)[..., None] ** 2
    np.testing.assert_allclose(curve(sets), expected, rtol=1e-12)


def test_phases_count_at_the_time_asked_for(day):
    for name in ("cone", "box"):
        late = ws.LightCurve(day, name, None, TIMES, SENSORS, device="cpu", phase_time_s=800.0)
        epoch = ws.LightCurve(day, name, None, TIMES, SENSORS, device="cpu")
        expected = epoch(epoch.values)
        np.testing.assert_allclose(late(late.values), expected, rtol=0, atol=1e-12 * expected.max())


@pytest.mark.ci
def test_light_is_averaged_over_the_exposure(day):
    exposed = day.scene.replace(detector__exposure_s=0.3).scenario
    curve = ws.LightCurve(exposed, "box", ["spin_rev_s", "precession_rev_s"], TIMES, SENSORS, "A", "cpu",
                          phase_time_s=TIMES[0])  # fmt: skip
    expected = ws.light_curves(exposed, TIMES, SENSORS, "box", "A", device="cpu").irradiance_w_cm2[..., 0]
    np.testing.assert_allclose(curve(curve.values), expected, rtol=0, atol=1e-12 * expected.max())
    slopes = curve.jacobian(curve.values)
    for column in range(2):
        found = five_points(curve, curve.values, column, 2.0**-32)
        np.testing.assert_allclose(slopes[..., column], found, rtol=0, atol=EXPOSED_RTOL * np.abs(found).max())


@pytest.mark.ci
def test_a_batch_is_each_of_its_sets_bit_for_bit(day, device):
    curve = ws.LightCurve(day, "cone", None, TIMES, SENSORS, device=device)
    threads = ws.LightCurve(day, "cone", None, TIMES, SENSORS, device=device, n_thread=3)
    rng = np.random.default_rng(SEED)
    sets = curve.values * (1 + 0.01 * rng.uniform(-1, 1, (700, len(curve.values))))
    light, slopes = curve.with_jacobian(sets)
    np.testing.assert_array_equal(threads(sets), curve(sets))
    np.testing.assert_array_equal(threads.jacobian(sets), slopes)
    for k in (0, 123, 699):
        np.testing.assert_array_equal(curve(sets[k]), curve(sets)[k])
        np.testing.assert_array_equal(curve.jacobian(sets[k]), slopes[k])
        np.testing.assert_array_equal(curve.with_jacobian(sets[k : k + 1])[0][0], light[k])


STEPS = {
    "_rev_s": 2.0**-30, "_rev": 2.0**-21, "_deg": 2.0**-13, "_m": 2.0**-16, "_k": 2.0**-8, "scale": 2.0**-16,
    "range_offset_m": 64.0,
}  # fmt: skip


def step_of(name):
    ends = [end for end in STEPS if name.endswith(end)]
    return STEPS[max(ends, key=len)] if ends else 2.0**-14


def random_sets(curve, rng, n_set):
    """Sets all over a target's attitudes, sizes and temperatures, in digits that steps do not round."""
    sets = np.repeat(curve.values[None], n_set, axis=0)
    for column, name in enumerate(curve.parameters):
        if name.endswith("_rev"):
            sets[:, column] = rng.uniform(0, 1, n_set)
        elif name.endswith("_deg"):
            low, high = {"axis_ra_deg": (0, 360), "axis_dec_deg": (-80, 80)}.get(name, (5, 85))
            sets[:, column] = rng.uniform(low, high, n_set)
        elif name.endswith("_k") and "offset" not in name:
            sets[:, column] = rng.uniform(280, 360, n_set)
        elif "." not in name and not name.endswith(("_rev_s", "offset_m", "_k")):
            sets[:, column] *= rng.uniform(0.7, 1.4, n_set)
    return np.round(sets * 2**21) / 2**21


def away_from_kinks(curve, sets, day, name):
    """Whether set, time and sensor are away from ends turning into view or sunlight, and from the side's cones."""
    value = dict(zip(curve.parameters, sets.T, strict=True))
    ra, dec = np.radians(value["axis_ra_deg"]), np.radians(value["axis_dec_deg"])
    reference = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)
    north = np.stack([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)], axis=-1)
    west = np.cross(reference, north)
    emitted_s = TIMES[:, None] - curve.range_km * 1e3 / 299792458.0
    since_s = (emitted_s - curve.phase_time_s)[None]

    def angle(motion):
        turn = value[f"{motion}_rev_s"][:, None, None] * since_s + value[f"{motion}_phase_rev"][:, None, None]
        return 2 * np.pi * turn

    azimuth, polar = angle("precession")[..., None], angle("rolling")[..., None]
    polar = polar + np.radians(value["precession_angle_deg"])[:, None, None, None]
    out = north[:, None, None] * np.cos(azimuth) + west[:, None, None] * np.sin(azimuth)
    axis = reference[:, None, None] * np.cos(polar) + out * np.sin(polar)
    shape = day.targets[day.target_names.index(name)].spec.shape
    top = {"cone": 0.0, "cylinder": value.get("radius_m")}.get(shape.kind, value.get("top_radius_m"))
    lean = np.arctan2(value["radius_m"] - top, value["height_m"])[:, None, None]
    good = np.isfinite(curve.range_km)[None] & np.ones(axis.shape[:-1], bool)
    states = [(day.position_m(sensor, TIMES), column) for column, sensor in enumerate(curve.sensors)]
    for position_m, column in states:
        left_s = np.nan_to_num(emitted_s[:, column], nan=TIMES[0])
        target_m = day.position_m(name, left_s)
        for towards in (position_m - target_m, day.position_m("sun", left_s) - target_m):
            unit = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
            aspect = np.arccos(np.clip(np.einsum("stx,tx->st", axis[:, :, column], unit), -1, 1))
            for kink in (np.pi / 2, np.abs(lean[..., 0]), np.pi - np.abs(lean[..., 0])):
                good[:, :, column] &= np.abs(aspect - kink) > NEAR_KINK
    return good


def worst_slopes(curve, sets, good, names=None):
    """Largest error of each column over its largest derivative, with the best of three steps of differences."""
    slopes = curve.jacobian(sets)
    found = {}
    for column, name in enumerate(curve.parameters):
        if names is not None and name not in names:
            continue
        steps = (2 * step_of(name), step_of(name) / 2, step_of(name) / 16)
        errors = [np.abs(five_points(curve, sets, column, step) - slopes[..., column]) for step in steps]
        errors = np.where(good[..., None], np.min(errors, axis=0), 0.0)
        found[name] = errors / np.abs(slopes[good][..., column]).max()
    return found


@pytest.mark.parametrize("name", [slow("cone"), "cylinder", "frustum", slow("flared")])
@pytest.mark.parametrize("terms", [{"sun": True}, {"sun": True, "albedo": True}], ids=["sun", "albedo"])
@pytest.mark.ci
def test_the_jacobian_is_that_of_differences(day, name, terms, record_accuracy):
    """2,500 attitudes, sizes and temperatures at 36 times of two sensors each, five-point differences."""
    some = terms_of(day, **terms)
    curve = ws.LightCurve(some, name, None, TIMES, SENSORS, "A", "cpu", phase_time_s=TIMES[18])
    sets = random_sets(curve, np.random.default_rng(SEED), 2500 if terms == {"sun": True} else 200)
    good = away_from_kinks(curve, sets, some, name)
    assert good.mean() > 0.5
    temperature = [end for end in curve.parameters if end.startswith("temperature_")]
    others = [end for end in curve.parameters if end not in temperature]
    worst = worst_slopes(curve, sets, good, others)
    worst_of_all = max(errors.max() for errors in worst.values())
    record_accuracy(
        "Jacobian of a light curve, of the largest derivative", worst_of_all, SLOPE_RTOL, "", "five-point differences"
    )
    # Radiances are cubics between nodes 0.5 % apart: the curvature jumps at nodes, which some steps hold.
    for errors in worst_slopes(curve, sets[:100], good[:100], temperature).values():
        assert np.quantile(errors, 0.9) < SLOPE_RTOL and errors.max() < 1e-6


@pytest.mark.parametrize("name", ["box", "plate", "sphere", "turned"])
@pytest.mark.ci
def test_the_jacobian_of_other_bodies(day, name):
    """Meshes and plates have a kink where any face comes into view or light, so most geometries count, not all."""
    curve = ws.LightCurve(day, name, None, TIMES, SENSORS, "A", "cpu", phase_time_s=TIMES[18])
    sets = random_sets(curve, np.random.default_rng(SEED), 100)
    good = np.broadcast_to(np.isfinite(curve.range_km), (100, *curve.range_km.shape))
    for errors in worst_slopes(curve, sets, good).values():
        assert np.quantile(errors, EARTH_SHARE) < SLOPE_RTOL


@pytest.mark.parametrize("name", ["cone", "cylinder", "frustum", "flared"])
@pytest.mark.ci
def test_the_jacobian_with_earth_infrared(day, name):
    """Its tables are linear between nodes: the derivative is exact but at nodes, where it jumps by a little."""
    some = terms_of(day, earth=True)
    curve = ws.LightCurve(some, name, None, TIMES, SENSORS, "A", "cpu", phase_time_s=TIMES[18])
    sets = random_sets(curve, np.random.default_rng(SEED), 100)
    good = away_from_kinks(curve, sets, some, name)
    for errors in worst_slopes(curve, sets, good).values():
        assert np.quantile(errors, EARTH_SHARE) < SLOPE_RTOL and errors.max() < 1e-2


def test_what_does_not_act_is_refused_with_the_reason(day):
    def refused(name, parameters):
        with pytest.raises(ws.InputError) as error:
            ws.LightCurve(day, name, parameters, TIMES, SENSORS, device="cpu")
        return str(error.value)

    assert refused("cone", ["spin_rev_s"]) == (
        "parameters: spin_rev_s does not act: a cone looks the same however it spins"
    )
    assert "a sphere looks the same from all sides" in refused("sphere", "axis_ra_deg")
    assert "a cone has none" in refused("cone", "top_radius_m")
    assert "by wavelength" in refused("flared", "emissivity.A")
    assert "is not linear in time" in refused("frustum", "temperature_start_k")
    assert "no motion of spin" in refused("turned", "precession_rev_s")
    unknown = refused("cone", ["spinn"])
    assert "must be among precession_rev_s, " in unknown and "spin_rev_s" not in unknown
    assert "once" in refused("cone", ["emissivity.A", "reflectance.A"])
    assert "at least one" in refused("cone", [])


def test_a_constant_temperature_stays_constant(day):
    """Unless its end is a parameter of its own."""
    both = ws.LightCurve(day, "cone", ["temperature_start_k", "temperature_end_k"], TIMES, SENSORS, device="cpu")
    one = ws.LightCurve(day, "cone", "temperature_start_k", TIMES, SENSORS, device="cpu")
    np.testing.assert_array_equal(one(320.0 + np.zeros(1)), both([320.0, 320.0]))
    slopes = both.jacobian([320.0, 320.0])
    np.testing.assert_allclose(one.jacobian([320.0])[..., 0], slopes.sum(axis=-1), rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "parameter"), [("sphere", "temperature_start_k"), ("frustum", "temperature_offset_k")]
)
def test_temperatures_reach_as_far_as_their_bounds(day, name, parameter):
    """Emission alone, against Planck's law, and the light at the scene's own temperature."""
    curve = ws.LightCurve(terms_of(day), name, parameter, [0.0], SENSORS[:1], "A", "cpu")
    own_k = curve.scenario.temperature_k(name, [0.0])[0]
    for value in curve.bounds[0]:
        kelvin = value + own_k if parameter == "temperature_offset_k" else value
        expected = curve(curve.values) / ws.band_radiance_w_m2_sr(own_k, "A") * ws.band_radiance_w_m2_sr(kelvin, "A")
        np.testing.assert_allclose(curve([value]), expected, rtol=RADIANCE_RTOL)
        with pytest.raises(ws.InputError, match="must be from"):
            curve([value + np.sign(value - curve.values[0])])


def test_bad_values_are_refused(day):
    curve = ws.LightCurve(day, "cone", ["radius_m", "emissivity.A"], TIMES, SENSORS, device="cpu")
    for params, words in (
        ([0.0, 0.5], "radius_m must be from 1e-09"),
        ([0.3, 1.5], "emissivity.A must be from 0 to 1, got 1.5"),
        ([0.3], "must have shape"),
        (["a", "b"], "must be numbers"),
        ([np.nan, 0.5], "radius_m must be"),
        (np.zeros((2, 2, 2)), "must have shape"),
    ):
        with pytest.raises(ws.InputError, match=words):
            curve(params)


def test_noise_depends_on_key_and_number_alone(day):
    curve = ws.LightCurve(day, "cone", ["scale"], TIMES, SENSORS, device="cpu")
    sets = np.full((400, 1), 1.1)
    noisy = curve.sample(sets, key=3)
    np.testing.assert_array_equal(noisy[17], curve.sample(sets[0], key=3, first=17))
    assert (curve.sample(sets[0], key=4) != noisy[0]).all()
    light = curve(sets[0])
    unit = (noisy - light) / curve.sigma_w_cm2(light)
    assert abs(unit.mean()) < 5 / np.sqrt(unit.size) and abs(unit.std() - 1) < 5 / np.sqrt(2 * unit.size)


def test_photons_of_a_light_are_part_of_its_noise(day):
    electrons = {
        "kind": "electron", "exposure_s": 0.01, "read_noise_e": 10.0, "full_well_e": 1e7, "gain_e_per_count": 100.0,
    }  # fmt: skip
    for shot in (True, False):
        some = day.scene.replace(detector=electrons | {"shot_noise": shot}).scenario
        curve = ws.LightCurve(some, "cone", ["scale"], TIMES[:1], SENSORS[:1], "A", "cpu")
        levels = curve.instrument.levels["A"]
        light = 1000 * levels.nei_w_cm2
        electrons_e = light * levels.e_per_w_cm2 * shot
        expected = np.sqrt(levels.noise_e**2 + electrons_e) / levels.e_per_w_cm2
        np.testing.assert_allclose(curve.sigma_w_cm2([light]), expected, rtol=1e-12)


# Bodies with patches, and those that turn freely

SMOOTH = 0.97  # of geometries that are next to no kink: a facet's, or a node of the Earth's infrared

STRIPE = ws.Patch(ws.Graybody(emissivity=0.1), azimuth_deg=(30.0, 140.0), along=(0.2, 0.7))
CAP = ws.Patch(ws.Graybody(emissivity=SLOPED), on="base")
BAND = ws.Patch(ws.Graybody(emissivity=0.1), along=(0.2, 0.7))
TILT = {
    "precession_rev_s", "precession_phase_rev", "precession_angle_deg", "rolling_rev_s", "rolling_phase_rev",
    "axis_ra_deg", "axis_dec_deg",
}  # fmt: skip
FREE = ws.TorqueFree(moments=(1.0, 1.7, 2.2), rates_deg_s=(20.0, 3.0, 9.0), quaternion=(0.1, 0.1, 0.7, 0.7))
WARMING = ws.Temperature(300.0, 320.0)
PAINTED = {
    "striped": (ws.Sphere(0.5), MOTION, WARMING, 0.3, STRIPE),
    "patched": (ws.Cone(0.25, 1.0), MOTION, WARMING, 0.5, STRIPE, CAP),
    "wave": (ws.Cylinder(0.25, 1.0), MOTION, WARMING, SLOPED, STRIPE),
    "free": (BOX, FREE, WARMING, 0.6),
    "flat": (ws.Cylinder(0.5, 0.1), FREE, WARMING, 0.6, STRIPE),
}


@pytest.fixture(scope="module")
def painted(scene):
    return in_sunlight(scene, PAINTED)


@pytest.mark.parametrize("name", PAINTED)
@pytest.mark.ci
def test_painted_and_free_bodies_have_the_light_of_their_scene(painted, name, device):
    for phase_s in (0.0, 800.0):
        curve = ws.LightCurve(painted, name, None, TIMES, SENSORS, device=device, phase_time_s=phase_s)
        expected = ws.light_curves(painted, TIMES, SENSORS, name, device=device)
        light = curve(curve.values)
        np.testing.assert_allclose(light, expected.irradiance_w_cm2[..., 0], rtol=LIGHT_RTOL, atol=1e-12 * light.max())
        np.testing.assert_allclose(curve.with_jacobian(curve.values)[0], light, rtol=0, atol=1e-13 * light.max())


@pytest.mark.slow
@pytest.mark.parametrize("name", PAINTED)
def test_the_jacobian_of_painted_and_free_bodies(painted, name):
    curve = ws.LightCurve(painted, name, None, TIMES, SENSORS, "A", "cpu", phase_time_s=TIMES[18])
    sets = random_sets(curve, np.random.default_rng(SEED), 100)
    good = np.broadcast_to(np.isfinite(curve.range_km), (100, *curve.range_km.shape))
    slopes = worst_slopes(curve, sets, good)
    assert ("spin_phase_rev" in slopes) == (name in ("striped", "patched", "wave"))
    for errors in slopes.values():
        assert np.quantile(errors, SMOOTH) < SLOPE_RTOL


SPIN = {"spin_rev_s", "spin_phase_rev"}


@pytest.mark.parametrize(
    ("shape", "patches", "acting"),
    [
        (ws.Cylinder(0.25, 1.0), [BAND], TILT),
        (ws.Cone(0.25, 1.0), [BAND, CAP], TILT),
        (ws.Cylinder(0.25, 1.0), [dataclasses.replace(CAP, azimuth_deg=(0.0, 90.0))], TILT),
        (ws.Plate(1.0, 2.0), [CAP], TILT),
        (ws.Sphere(0.5), [BAND], TILT),
        (ws.Sphere(0.5), [dataclasses.replace(BAND, along=(0.0, 1.0))], set()),
        (ws.Sphere(0.5), [STRIPE], TILT | SPIN),
        (ws.Cone(0.25, 1.0), [CAP, STRIPE], TILT | SPIN),
        (BOX, [ws.Patch(CAP.surface, on="faces", faces=(0,))], TILT | SPIN),
    ],
)
def test_spin_acts_where_patches_show_it(painted, shape, patches, acting):
    target = dataclasses.replace(painted.targets[0].spec, shape=shape, patches=patches)
    scene = painted.scene.replace(groups=[dataclasses.replace(painted.scene.groups[0], targets=[target])])
    own = ws.LightCurve(scene, target.name, None, TIMES[:2], SENSORS, "A", "cpu")
    assert {name for name in own.parameters if name in TILT | SPIN} == acting
    if acting == TILT:
        with pytest.raises(ws.InputError, match="looks the same however it spins"):
            ws.LightCurve(scene, target.name, "spin_rev_s", TIMES[:2], SENSORS, "A", "cpu")


@pytest.mark.ci
def test_rounding_is_no_information(painted):
    """A column at the light's rounding is named; one that is small for its unit is not."""
    light, pattern = np.ones(50), np.random.default_rng(SEED).normal(size=(50, 3))
    known = information_of(["a", "b", "c"], pattern * [1.0, 1e-16, 1e-9], light)
    assert known.degenerate == "the measurements do not change with b"
    with pytest.raises(ws.InputError, match="singular"):
        known.covariance  # noqa: B018
    assert information_of(["a", "b"], pattern[:, :2] * [1.0, 1e-9], light).sigma["b"] > 1e8
    curve = ws.LightCurve(painted, "patched", ["scale", "spin_phase_rev"], TIMES, SENSORS, "A", "cpu")
    known = curve.fisher(curve.values, 1e-18)
    length = np.linalg.norm(curve(curve.values)) / 1e-18
    assert known.least_length == pytest.approx(LEAST_COLUMN * length, rel=1e-12)
    assert not known.degenerate


def test_lengths_of_patched_bodies_are_refused(painted):
    with pytest.raises(ws.InputError, match="patches keep the size"):
        ws.LightCurve(painted, "patched", "radius_m", TIMES, SENSORS, device="cpu")
    with pytest.raises(ws.InputError, match="no motion of spin"):
        ws.LightCurve(painted, "free", "precession_rev_s", TIMES, SENSORS, device="cpu")
