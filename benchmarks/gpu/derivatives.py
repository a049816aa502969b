"""Derivatives of images and of light curves: the CPU against the device, and what they cost there.

Sums are float64 on both, over images and areas that differ in the last bits of float32.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt

import warpsim as ws
from benchmarks.gpu.plan import Plan, Row, lack_of_torch, rows_of
from benchmarks.gradients import IN_SUNLIGHT, PARAMETERS

OF_LARGEST = 1e-5
"""Difference of gradients that is allowed, over the largest of their kind: the images' own, in float32."""

OF_CURVES = 1e-9
"""The same of light curves, which are float64."""

PATTERNS: dict[str, ws.Psf] = {"Gaussian": ws.PsfGaussian(0.7), "Airy": ws.PsfAiry(1.2)}
N_SOURCE, N_PIXEL = 1000, 128
OF_FRAMES = ("x_px", "y_px", "irradiance_w_cm2", "boresight_rad", "roll_rad", "target_position_m")


def derivatives(plan: Plan) -> Iterator[Row]:
    """Compare all; measure where it is not quick."""
    checks: list[tuple[str, Callable[[], Row]]] = []
    for name, psf in PATTERNS.items():
        checks.append((f"adjoint and Jacobian, {name}", partial(of_images, psf, plan.device)))
    checks.append(("gradients of frames", partial(of_frames, plan.device)))
    checks.append(("light curves", partial(of_curves, plan.device, 1 if plan.quick else 10_000)))
    checks.append(("PyTorch", partial(of_tensors, plan.device)))
    return rows_of(checks)


def _sources() -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(7)
    xy_px, flux = rng.uniform(0, N_PIXEL - 1, (N_SOURCE, 2)), rng.uniform(0.5, 2.0, N_SOURCE)
    return xy_px, flux, rng.normal(size=(N_PIXEL, N_PIXEL))


def _differ(one: npt.ArrayLike, two: npt.ArrayLike) -> float:
    """Largest difference over the largest number."""
    a, b = np.asarray(one, dtype=np.float64), np.asarray(two, dtype=np.float64)
    if a.shape != b.shape or not np.isfinite(a).all() or not np.isfinite(b).all():
        return float("inf")
    return float(np.abs(a - b).max(initial=0.0) / max(float(np.abs(a).max(initial=0.0)), 1e-300))


def _seconds(call: Callable[[], Any], n_round: int = 5) -> float:
    call()
    times = []
    for _ in range(n_round):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return median(times)


def of_images(psf: ws.Psf, device: str) -> Row:
    """Gradients and Jacobians of images of many sources."""
    xy_px, flux, cotangent = _sources()
    shape, found = (N_PIXEL, N_PIXEL), {}
    one, two = (ws.deposit_gradient(xy_px, flux, psf, shape, cotangent, where) for where in ("cpu", device))
    for name in ("xy_px", "flux", "sigma_px"):
        found[name] = _differ(getattr(one, name), getattr(two, name))
    columns = [ws.deposit_jacobian(xy_px, flux, psf, shape, where).matrix() for where in ("cpu", device)]
    found["jacobian"] = float(abs(columns[0] - columns[1]).max() / abs(columns[0]).max())
    image_s, gradient_s = (
        _seconds(call)
        for call in (
            lambda: ws.deposit(xy_px, flux, psf, shape, device),
            lambda: ws.deposit_gradient(xy_px, flux, psf, shape, cotangent, device),
        )
    )
    return {"ok": max(found.values()) < OF_LARGEST, **found, "image_s": image_s, "gradient_s": gradient_s}


def of_frames(device: str) -> Row:
    """Gradients of rendered frames by all that they know."""
    scene, rng = ws.Scene.load("stss"), np.random.default_rng(3)
    found = []
    for where in ("cpu", device):
        frames = ws.Renderer(scene, where).render([60, 61], ["sat11", "sat47"], ["A", "C"], keep_stars=True)
        found.append(ws.gradients(frames, _cotangent(rng, frames), OF_FRAMES))
        rng = np.random.default_rng(3)
    differ = {name: _differ(found[0][name], found[1][name]) for name in OF_FRAMES}
    return {"ok": max(differ.values()) < OF_LARGEST, **differ}


def _cotangent(rng: np.random.Generator, frames: ws.FrameSet) -> npt.NDArray[np.float64]:
    nei = np.array([frames.instrument.nei_w_cm2(band) for band in frames.bands])
    return rng.normal(size=frames.counts.shape) / nei[:, None, None]


def of_curves(device: str, n_set: int) -> Row:
    """Light curves with all terms and their Jacobians, for many sets of parameters."""
    lighting = ws.Lighting(sun=True, earth=True, albedo=True, leave_out_nei=0.0)
    scene, time_s = ws.Scene.load("stss").replace(**IN_SUNLIGHT, lighting=lighting), np.linspace(600.0, 610.0, 1000)
    one, two = (ws.LightCurve(scene, "center", PARAMETERS, time_s, "sat47", "A", where) for where in ("cpu", device))
    (light, slope), (light_there, slope_there) = (curve.with_jacobian(curve.values) for curve in (one, two))
    by_parameter = max(_differ(slope[..., k], slope_there[..., k]) for k in range(len(PARAMETERS)))
    found = {"light": _differ(light, light_there), "jacobian": by_parameter}
    sets = np.repeat(two.values[None], n_set, axis=0)
    sets[:, 1] = np.linspace(0.0, 1.0, n_set)
    parts = np.split(sets, 10) if n_set >= 10 else [sets]  # of a Jacobian that all at once would take 640 MB
    speed = {
        "one_set_s": _seconds(lambda: two(two.values)),
        "sets_s": _seconds(lambda: two(sets), 3),
        "sets_jacobian_s": _seconds(lambda: [two.jacobian(part) for part in parts], 3),
    }
    return {"ok": max(found.values()) < OF_CURVES, **found, "n_set": n_set, **speed}


def of_tensors(device: str) -> Row:
    """`ws.torch.render` on tensors of the device, on a stream of their own, and its gradients."""
    if lack := lack_of_torch(device):
        return lack
    import torch

    xy_px, flux, cotangent = _sources()
    psf, shape, expected = PATTERNS["Gaussian"], (N_PIXEL, N_PIXEL), ws.deposit_gradient
    wanted = expected(xy_px, flux, psf, shape, cotangent, "cpu")
    image = ws.deposit(xy_px, flux, psf, shape, "cpu")
    side = torch.cuda.Stream(device) if device.startswith("cuda") else None
    with torch.cuda.stream(side) if side is not None else torch.enable_grad():
        places = torch.tensor(xy_px[None], device=device, requires_grad=True)
        light = torch.tensor(flux[None, None], dtype=torch.float32, device=device, requires_grad=True)
        drawn = ws.torch.render(places, light, psf, shape)
        (drawn * torch.tensor(cotangent, dtype=torch.float32, device=device)).sum().backward()
        tensors = [drawn[0, 0], places.grad[0], light.grad[0, 0]]
        arrays = [tensor.detach().cpu().numpy() for tensor in tensors]
    differ = [_differ(a, b) for a, b in zip((image, wanted.xy_px, wanted.flux), arrays, strict=True)]
    found = dict(zip(("image", "xy_px", "flux"), differ, strict=True))
    return {"ok": max(differ) < OF_LARGEST, **found}
