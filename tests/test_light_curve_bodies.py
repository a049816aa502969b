"""Light curves as functions of parameters, of bodies with patches and of those that turn freely."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from test_light_curve import BOX, MOTION, SENSORS, SLOPE_RTOL, SLOPED, TIMES, random_sets, worst_slopes

import warpsim as ws

LIGHT_RTOL = 1e-12  # as of other bodies
SMOOTH = 0.97  # of geometries that are next to no kink: a facet's, or a node of the Earth's infrared
SEED = 7

STRIPE = ws.Patch(ws.Graybody(emissivity=0.1), azimuth_deg=(30.0, 140.0), along=(0.2, 0.7))
CAP = ws.Patch(ws.Graybody(emissivity=SLOPED), on="base")
FREE = ws.TorqueFree(moments=(1.0, 1.7, 2.2), rates_deg_s=(20.0, 3.0, 9.0), quaternion=(0.1, 0.1, 0.7, 0.7))
BODIES = {
    "striped": (ws.Sphere(0.5), MOTION, 0.3, (STRIPE,)),
    "patched": (ws.Cone(0.25, 1.0), MOTION, 0.5, (STRIPE, CAP)),
    "wave": (ws.Cylinder(0.25, 1.0), MOTION, SLOPED, (STRIPE,)),
    "free": (BOX, FREE, 0.6, ()),
    "flat": (ws.Cylinder(0.5, 0.1), FREE, 0.6, (STRIPE,)),
}


@pytest.fixture(scope="module")
def day(scene):
    targets = [
        ws.TargetSpec(name, shape, ws.Graybody(reflectance=rho), ws.Temperature(300.0, 320.0), motion, patches=patches)
        for name, (shape, motion, rho, patches) in BODIES.items()
    ]
    return scene.replace(
        epoch_utc="2025-03-20T06:00:00", sky__catalog="none", duration_s=1600.0, frames__count=100,
        groups=[dataclasses.replace(scene.groups[0], targets=targets)], lighting=ws.Lighting(leave_out_nei=0.0),
    ).scenario  # fmt: skip


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


def test_lengths_of_patched_bodies_are_refused(day):
    with pytest.raises(ws.InputError, match="patches keep the size"):
        ws.LightCurve(day, "patched", "radius_m", TIMES, SENSORS, device="cpu")
    with pytest.raises(ws.InputError, match="no motion of spin"):
        ws.LightCurve(day, "free", "precession_rev_s", TIMES, SENSORS, device="cpu")
