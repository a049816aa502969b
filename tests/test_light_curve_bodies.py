"""Light curves as functions of parameters, of bodies with patches and of those that turn freely."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from test_light_curve import BOX, MOTION, SENSORS, SLOPE_RTOL, SLOPED, TIMES, in_sunlight, random_sets, worst_slopes

import warpsim as ws
from warpsim.render.information import LEAST_COLUMN, information_of

LIGHT_RTOL = 1e-12  # as of other bodies
SMOOTH = 0.97  # of geometries that are next to no kink: a facet's, or a node of the Earth's infrared
SEED = 7

STRIPE = ws.Patch(ws.Graybody(emissivity=0.1), azimuth_deg=(30.0, 140.0), along=(0.2, 0.7))
CAP = ws.Patch(ws.Graybody(emissivity=SLOPED), on="base")
BAND = ws.Patch(ws.Graybody(emissivity=0.1), along=(0.2, 0.7))
TILT = {
    "precession_rev_s", "precession_phase_rev", "precession_angle_deg", "rolling_rev_s", "rolling_phase_rev",
    "axis_ra_deg", "axis_dec_deg",
}  # fmt: skip
FREE = ws.TorqueFree(moments=(1.0, 1.7, 2.2), rates_deg_s=(20.0, 3.0, 9.0), quaternion=(0.1, 0.1, 0.7, 0.7))
WARMING = ws.Temperature(300.0, 320.0)
BODIES = {
    "striped": (ws.Sphere(0.5), MOTION, WARMING, 0.3, STRIPE),
    "patched": (ws.Cone(0.25, 1.0), MOTION, WARMING, 0.5, STRIPE, CAP),
    "wave": (ws.Cylinder(0.25, 1.0), MOTION, WARMING, SLOPED, STRIPE),
    "free": (BOX, FREE, WARMING, 0.6),
    "flat": (ws.Cylinder(0.5, 0.1), FREE, WARMING, 0.6, STRIPE),
}


@pytest.fixture(scope="module")
def day(scene):
    return in_sunlight(scene, BODIES)


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.ci
def test_the_scenes_own_values_give_its_light_curves(day, name, device):
    for phase_s in (0.0, 800.0):
        curve = ws.LightCurve(day, name, None, TIMES, SENSORS, device=device, phase_time_s=phase_s)
        expected = ws.light_curves(day, TIMES, SENSORS, name, device=device)
        light = curve(curve.values)
        np.testing.assert_allclose(light, expected.irradiance_w_cm2[..., 0], rtol=LIGHT_RTOL, atol=1e-12 * light.max())
        np.testing.assert_allclose(curve.with_jacobian(curve.values)[0], light, rtol=0, atol=1e-13 * light.max())


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.ci
def test_the_jacobian_is_that_of_differences(day, name):
    curve = ws.LightCurve(day, name, None, TIMES, SENSORS, "A", "cpu", phase_time_s=TIMES[18])
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
def test_spin_acts_where_patches_show_it(day, shape, patches, acting):
    target = dataclasses.replace(day.targets[0].spec, shape=shape, patches=patches)
    groups = [dataclasses.replace(day.scene.groups[0], targets=[target])]
    own = ws.LightCurve(day.scene.replace(groups=groups), target.name, None, TIMES[:2], SENSORS, "A", "cpu")
    assert {name for name in own.parameters if name in TILT | SPIN} == acting
    if acting == TILT:
        with pytest.raises(ws.InputError, match="looks the same however it spins"):
            ws.LightCurve(day.scene.replace(groups=groups), target.name, "spin_rev_s", TIMES[:2], SENSORS, "A", "cpu")


def test_rounding_is_no_information(day):
    """A column at the light's rounding is named; one that is small for its unit is not."""
    light, pattern = np.ones(50), np.random.default_rng(SEED).normal(size=(50, 3))
    known = information_of(["a", "b", "c"], pattern * [1.0, 1e-16, 1e-9], light)
    assert known.degenerate == "the measurements do not change with b"
    with pytest.raises(ws.InputError, match="singular"):
        known.covariance  # noqa: B018
    assert information_of(["a", "b"], pattern[:, :2] * [1.0, 1e-9], light).sigma["b"] > 1e8
    curve = ws.LightCurve(day, "patched", ["scale", "spin_phase_rev"], TIMES, SENSORS, "A", "cpu")
    known = curve.fisher(curve.values, 1e-18)
    length = np.linalg.norm(curve(curve.values)) / 1e-18
    assert known.least_length == pytest.approx(LEAST_COLUMN * length, rel=1e-12)
    assert not known.degenerate


def test_lengths_of_patched_bodies_are_refused(day):
    with pytest.raises(ws.InputError, match="patches keep the size"):
        ws.LightCurve(day, "patched", "radius_m", TIMES, SENSORS, device="cpu")
    with pytest.raises(ws.InputError, match="no motion of spin"):
        ws.LightCurve(day, "free", "precession_rev_s", TIMES, SENSORS, device="cpu")
