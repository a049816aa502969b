"""Cost of gradients of images: the adjoint against the stage `deposit`, the Jacobian, differences, and sdasim's.

    python -m pip install -e '.[peer-sdasim]'
    python -m benchmarks.image_gradients --json benchmarks/results/programs/image_gradients.json

Images of 100 and 1,000 sources at random, one thread, processor time, median of five by turns. Both kernels are
prepared launches on arrays that are there, as in a frame. Stamps end where a pixel holds 1e-5 of a source. Differences
are of one more image for each parameter, x, y and light of every source. sdasim 0.5.0 (PyTorch) draws Gaussians at the
centres of pixels within 3 sigma, on one thread; it is left out where it is not installed. Last, how well merged pairs
are fitted with Jacobian stamps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

import numpy as np
import warp as wp
from scipy.optimize import least_squares

import warpsim as ws
from benchmarks.peers.pairs import is_installed
from benchmarks.programs import parser_of, processor_s, write_or_print
from warpsim.optics.psf_bank import PsfBank, stamp_rule
from warpsim.render.point_images import PointImages

N_ROUND, LEAST_S = 5, 0.2
STAMP_ERROR = 1e-5
SIGMA_PX = 0.7
PATTERNS = {"gaussian": ws.PsfGaussian(SIGMA_PX), "airy": ws.PsfAiry(1.2)}


def us_by_turns(*calls: Callable[[], Any]) -> list[float]:
    """Median processor time of each of some calls, made by turns [us]."""
    counts = []
    for call in calls:
        call()
        counts.append(max(1, int(LEAST_S / N_ROUND / max(processor_s(call), 1e-7))))
    rounds: list[list[float]] = [[] for _ in calls]
    for _ in range(N_ROUND):
        for call, n, times in zip(calls, counts, rounds, strict=True):
            start = time.process_time()
            for _ in range(n):
                call()
            times.append((time.process_time() - start) / n)
    return [1e6 * median(times) for times in rounds]


def sources(n_pixel: int, n_source: int) -> tuple[Any, Any, Any]:
    """Positions, light and a cotangent, at random."""
    rng = np.random.default_rng(n_pixel + n_source)
    xy_px, light = rng.uniform(0, n_pixel - 1, (n_source, 2)), 10 ** rng.uniform(-1, 1, n_source)
    return xy_px, light, rng.normal(size=(1, 1, n_pixel, n_pixel))


def own_costs(n_pixel: int, n_source: int, psf: Any) -> dict[str, float]:
    """Times of ours [us]."""
    xy_px, light, cotangent = sources(n_pixel, n_source)
    kinds = (([n_source], wp.int32), (xy_px[None], wp.vec2d), (light[None, None], wp.float32))
    lists = [wp.array(given, dtype=dtype, device="cpu") for given, dtype in kinds]
    bank, rule = PsfBank([psf], wp.get_device("cpu")), stamp_rule([0.0], STAMP_ERROR, "cpu")
    images = PointImages(bank, lists, rule, (n_pixel, n_pixel))
    signal = wp.zeros((1, 1, n_pixel, n_pixel), dtype=wp.float32, device="cpu")
    values = wp.array(cotangent, dtype=wp.float32, device="cpu")
    outputs = [wp.zeros((1, 1, n_source), dtype=wp.vec4d, device="cpu")]
    outputs.append(wp.zeros((1, 1, n_source, 0), dtype=wp.vec2d, device="cpu"))
    deposit = bank.deposit(lists, rule, n_pixel, signal)
    adjoint, with_sigma = (bank.gather(lists, rule, values, outputs, None, flag) for flag in (False, True))
    times = us_by_turns(deposit.run, adjoint.run, with_sigma.run, images.jacobian, images.draw)
    found = dict(zip(("deposit", "adjoint", "adjoint with sigma", "jacobian"), times, strict=False))
    if not isinstance(psf, ws.PsfGaussian):
        del found["adjoint with sigma"]
    found["differences"] = (3 * n_source + 1) * times[4]
    found["adjoint / deposit"] = found["adjoint"] / found["deposit"]
    return found


def sdasim_costs(n_pixel: int, n_source: int) -> dict[str, float]:
    """Times of sdasim [us]: an image, and an image with the gradient by positions and light."""
    import sdasim
    import torch

    torch.set_num_threads(1)
    xy_px, light, cotangent = sources(n_pixel, n_source)
    places = torch.tensor(xy_px[:, ::-1].copy(), dtype=torch.float32, requires_grad=True)
    flux = torch.tensor(light, dtype=torch.float32, requires_grad=True)
    values = torch.tensor(cotangent[0, 0], dtype=torch.float32)

    def draw() -> Any:
        return sdasim.splat_gaussians(n_pixel, n_pixel, places, flux, SIGMA_PX)

    def forward() -> Any:
        with torch.inference_mode():
            return draw()

    def both() -> None:
        places.grad = flux.grad = None
        (draw() * values).sum().backward()

    image, gradient = us_by_turns(forward, both)
    return {"image": image, "image and gradient": gradient, "ratio": gradient / image}


def torch_costs(n_pixel: int, n_source: int) -> dict[str, float]:
    """Times of `ws.torch.render` [us], as those of sdasim."""
    import torch

    xy_px, light, cotangent = sources(n_pixel, n_source)
    places = torch.tensor(xy_px[None], requires_grad=True)
    flux = torch.tensor(light[None, None], dtype=torch.float32, requires_grad=True)
    values = torch.tensor(cotangent, dtype=torch.float32)
    psf, shape = PATTERNS["gaussian"], (n_pixel, n_pixel)

    def both() -> None:
        places.grad = flux.grad = None
        (ws.torch.render(places, flux, psf, shape, STAMP_ERROR) * values).sum().backward()

    def forward() -> Any:
        with torch.inference_mode():
            return ws.torch.render(places, flux, psf, shape, STAMP_ERROR)

    image, gradient = us_by_turns(forward, both)
    return {"image": image, "image and gradient": gradient, "ratio": gradient / image}


def merged_pairs(separations_px: Sequence[float], n_draw: int, snr: float = 100.0) -> list[dict[str, float]]:
    """Fit pairs of equal sources by SciPy's least squares with Jacobian stamps, to images with noise.

    Each source has `snr` times a pixel's noise in light, a Gaussian of 0.8 px; positions and light of both are free.

    Returns:
        For each separation the Cramer-Rao bounds of it [px] and of the light over itself, root mean square and mean of
        its errors [px], and the part of the fits that count: two sources of positive light, not 2 px too far apart.
    """
    rng, psf, shape = np.random.default_rng(8), ws.PsfGaussian(0.8), (24, 24)

    def sources_of(values: Any) -> tuple[Any, Any, Any, Any]:
        return values[:4].reshape(2, 2).T, values[4:], psf, shape

    def columns(values: Any) -> Any:
        return ws.deposit_jacobian(*sources_of(values)).matrix().toarray()

    rows = []
    for separation_px in separations_px:
        errors, bound, light = [], 0.0, 0.0
        for _ in range(n_draw):
            angle, middle = rng.uniform(0, np.pi), 11.5 + rng.uniform(-0.5, 0.5, 2)
            half = 0.5 * separation_px * np.array([np.cos(angle), np.sin(angle)])
            true = np.concatenate([np.stack([middle - half, middle + half], axis=1).ravel(), [snr, snr]])
            image = ws.deposit(*sources_of(true)) + rng.normal(size=shape)
            fit = least_squares(lambda x, image=image: (ws.deposit(*sources_of(x)) - image).ravel(), true, columns)
            apart = np.diff(fit.x[:4].reshape(2, 2), axis=1)[:, 0]
            if np.hypot(*apart) < separation_px + 2.0 and (fit.x[4:] > 0).all():
                errors.append(np.hypot(*apart) - separation_px)
            slope = np.zeros(6)
            slope[:4] = np.outer([np.cos(angle), np.sin(angle)], [-1.0, 1.0]).ravel()
            jacobian = columns(true)
            covariance = np.linalg.inv(jacobian.T @ jacobian)
            bound += slope @ covariance @ slope / n_draw
            light += covariance[4, 4] / snr**2 / n_draw
        rms, mean = np.sqrt(np.mean(np.square(errors))), np.mean(errors)
        found = (separation_px, np.sqrt(bound), np.sqrt(light), rms, mean, len(errors) / n_draw)
        names = ("separation_px", "bound_px", "light_bound", "rms_px", "bias_px", "kept")
        rows.append(dict(zip(names, map(float, found), strict=True)))
    return rows


def main() -> None:
    """Measure, and print the result or write it."""
    options = parser_of(__doc__).parse_args()
    found: dict[str, Any] = {"us": {}}
    for n_pixel in (128, 1024):
        for n_source in (100, 1000):
            name = f"{n_source} sources on {n_pixel} px"
            for kind, psf in PATTERNS.items():
                found["us"][f"{name}, {kind}"] = own_costs(n_pixel, n_source, psf)
            if is_installed("sdasim"):
                found["us"][f"{name}, gaussian, ws.torch"] = torch_costs(n_pixel, n_source)
                found["us"][f"{name}, gaussian, sdasim"] = sdasim_costs(n_pixel, n_source)
    found["merged_pairs"] = merged_pairs([3.0, 2.0, 1.5, 1.2, 1.0, 0.8, 0.6, 0.4], 150)
    write_or_print("python -m benchmarks.image_gradients", found, options.json)


if __name__ == "__main__":
    main()
