"""Time and error of drawing a point source.

    python -m pytest benchmarks/test_deposit.py --benchmark-json=benchmarks/results/deposit.json
    python benchmarks/report.py benchmarks/results/deposit.json --plot deposit.png

The deposit alone, one thread, thousands of sources at random positions of one image; launches are recorded, so that no
Python is timed. Ways to draw: a Gaussian by tables of one axis and by error functions, effective PSF tables of several
orders and errors, and polynomials of several degrees, for Gaussian and Airy patterns; stamps that leave out more or
less; few and many sources; streaks by more or fewer nodes; sums in float32, float64 and fixed point. The error is that
of the worst pixel of single sources of unit light at random positions, against float64 quadrature written here; of
sums, that of the worst pixel of a crowd, as a fraction of the brightest one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from scipy.special import ndtr
from warpsim_kernels.canvas import n_flag

import warpsim as ws
from benchmarks.deposit_variants import VARIANTS, Variant, draw_by_error_functions
from benchmarks.psf_oracle import pixel_fraction
from warpsim.optics.psf_bank import PsfBank, paths_struct, stamp_rule
from warpsim.optics.tables import TableAccuracy
from warpsim.render.device import rows_per_block

N_SOURCE = 4000
N_PIXEL = 256
N_CHECKED = 24
MARGIN = 24

SIGMA_PX = 0.7
AIRY = ws.PsfAiry(0.478)
"""Band E of the paper's sensor."""
GAUSSIAN_IMAGE_STEP = 16
ERRORS = (1e-3, 1e-4, 1e-5, 1e-6)
STREAK_PX = 5.0
PRODUCT = "gather float32 by vectors, the product"


def gaussian_image() -> ws.PsfTable:
    """The Gaussian as samples of a user."""
    position = np.arange(-6 * GAUSSIAN_IMAGE_STEP, 6 * GAUSSIAN_IMAGE_STEP + 1) / GAUSSIAN_IMAGE_STEP
    profile = np.exp(-0.5 * (position / SIGMA_PX) ** 2)
    return ws.PsfTable(np.outer(profile, profile), GAUSSIAN_IMAGE_STEP)


WAYS: dict[str, tuple[Any, TableAccuracy | None]] = {"Gaussian, tables of one axis": (ws.PsfGaussian(SIGMA_PX), None)}
WAYS |= {
    f"{name}, table, {n_point} points, {error:g}": (psf, TableAccuracy(error, n_point))
    for name, psf in (("Gaussian", gaussian_image()), ("Airy", AIRY))
    for n_point in (2, 4, 6, 8)
    for error in ERRORS
    if n_point > 2 or error > 1e-5  # tables of two points for less would not fit
}
WAYS |= {
    f"{name}, polynomials of degree {degree}, {error:g}": (psf, TableAccuracy(error, None, degree))
    for name, psf in (("Gaussian", gaussian_image()), ("Airy", AIRY))
    for degree in (3, 5, 7)
    for error in ERRORS
    if degree > 3 or error > 1e-6  # of the third degree for less would not fit
}


class Drawing:
    """Sources of unit light, ready to be drawn where the rule of their stamps is."""

    def __init__(self, psf: Any, accuracy: TableAccuracy | None, xy_px: Any, rule: Any, path_px: Any = None) -> None:
        n = len(xy_px)
        self.device = device = rule.cut_w_cm2.device
        self.bank = PsfBank([psf], device, 1.0, accuracy)
        self.rule = rule
        self.sources = [
            wp.array([n], dtype=wp.int32, device=device),
            wp.array(xy_px[None], dtype=wp.vec2d, device=device),
            wp.array(np.ones((1, 1, n)), dtype=wp.float32, device=device),
        ]
        self.signal = wp.zeros((1, 1, N_PIXEL, N_PIXEL), dtype=wp.float32, device=device)
        self.touched = wp.zeros((1, 1, n_flag(N_PIXEL * N_PIXEL)), dtype=wp.uint8, device=device)
        self.paths = None
        if path_px is not None:
            series = np.broadcast_to(np.asarray(path_px, np.float32), (1, n, len(path_px), 2))
            still = wp.zeros((1, 1, 0, 0), dtype=wp.float32, device=device)
            self.paths = paths_struct(wp.array(series.copy(), dtype=wp.vec2, device=device), still, 0)

    def draw(self) -> None:
        """Add the light of the sources to the image."""
        n_row_per_block = rows_per_block(self.device, N_PIXEL, 1)
        self.bank.deposit(self.sources, self.rule, n_row_per_block, self.signal, self.paths, self.touched).run()

    def __call__(self) -> Any:
        """The image, float64."""
        self.signal.zero_()
        self.draw()
        return self.signal.numpy()[0, 0].astype(np.float64)


def random_positions(n: int) -> Any:
    """Random positions away from the image's edges."""
    return np.random.default_rng(271).uniform(MARGIN, N_PIXEL - MARGIN, (n, 2))


def worst_pixel(psf: Any, accuracy: TableAccuracy | None, rule: Any, path_px: Any = None, reach: int = 6) -> float:
    """Largest error of a pixel, of single sources."""
    worst = 0.0
    for xy_px in random_positions(N_CHECKED):
        image = Drawing(psf, accuracy, xy_px[None], rule, path_px)()
        worst = max(worst, error_near(image, psf, xy_px, reach, path_px))
    return worst


def error_near(image: Any, psf: Any, xy_px: Any, reach: int, path_px: Any = None) -> float:
    """Largest error of the pixels about a single source."""
    middle = np.round(xy_px).astype(int)
    near = range(-reach, reach + 1)
    pixels = [(middle[0] + dx, middle[1] + dy) for dy in near for dx in near]
    exact = [exact_fraction(psf, column - xy_px[0], row - xy_px[1], path_px) for column, row in pixels]
    found = [image[row, column] for column, row in pixels]
    return float(np.abs(np.subtract(found, exact)).max())


def exact_fraction(psf: Any, dx: float, dy: float, path_px: Any = None) -> float:
    """Fraction of the pixel at an offset from the source, or of a straight, even streak about it."""
    if path_px is not None:
        t = (np.arange(10_000) + 0.5) / 5000 - 1
        x, y = dx - path_px[1][0] * t, dy - path_px[1][1] * t
        return float((gaussian_axis(x) * gaussian_axis(y)).mean())
    if isinstance(psf, ws.PsfAiry):
        return pixel_fraction(psf, dx, dy)
    return float(gaussian_axis(dx) * gaussian_axis(dy))


def gaussian_axis(offset: Any) -> Any:
    return ndtr((offset + 0.5) / SIGMA_PX) - ndtr((offset - 0.5) / SIGMA_PX)


def timed(benchmark: Any, draw: Any, device: str) -> bool:
    """Time what draws, its launches recorded; whether there is a time."""
    draw()  # compiles
    with wp.ScopedCapture(device) as capture:
        draw()

    def launch() -> None:
        wp.capture_launch(capture.graph)
        wp.synchronize_device(device)

    benchmark.pedantic(launch, rounds=15, warmup_rounds=1)
    return benchmark.stats is not None


def note(
    benchmark: Any, device: str, group: str, way: str, error: float, n_source: int = N_SOURCE, **more: float
) -> None:
    """Keep what was measured of a way to draw."""
    ns_per_source = float(benchmark.stats.stats.median / n_source * 1e9)
    benchmark.extra_info.update(
        device=device, group=group, way=way, ns_per_source=ns_per_source, deposit_error=error, **more
    )


@pytest.mark.parametrize("way", WAYS)
def test_ways(benchmark, way, device):
    psf, accuracy = WAYS[way]
    # The same stamps for all: 7 x 7 pixels hold what is above 1e-5 of a source's light, or nearly so.
    rule = stamp_rule([0.0], 1e-5, device)
    if timed(benchmark, Drawing(psf, accuracy, random_positions(N_SOURCE), rule).draw, device):
        kind, _, how = way.partition(", ")
        fine = stamp_rule([0.0], 1e-9, device)
        note(benchmark, device, f"{kind}, pixel fractions", how, worst_pixel(psf, accuracy, fine, reach=4))


def test_error_functions(benchmark, device):
    """The same Gaussian stamps without tables or vectors."""
    rule = stamp_rule([0.0], 1e-5, device)
    lists = Drawing(ws.PsfGaussian(SIGMA_PX), None, random_positions(N_SOURCE), rule).sources
    xy_px, irradiance, image = lists[1][0], lists[2][0, 0], wp.zeros((N_PIXEL, N_PIXEL), dtype=float, device=device)
    if timed(benchmark, lambda: draw_by_error_functions(xy_px, irradiance, SIGMA_PX, rule, image), device):
        fine, worst = stamp_rule([0.0], 1e-9, device), 0.0
        for position in random_positions(N_CHECKED):
            one = wp.array(position[None], dtype=wp.vec2d, device=device)
            draw_by_error_functions(one, irradiance[:1], SIGMA_PX, fine, image)
            worst = max(worst, error_near(image.numpy(), ws.PsfGaussian(SIGMA_PX), position, 4))
        note(benchmark, device, "Gaussian, pixel fractions", "error functions", worst)


@pytest.mark.parametrize("n_source", [100, 1000, 10_000, 100_000])
@pytest.mark.parametrize("name", ["Gaussian", "Airy"])
def test_number_of_sources(benchmark, name, n_source, device):
    """Time grows with the number of sources, and with nothing else."""
    psf, rule = ws.PsfGaussian(SIGMA_PX) if name == "Gaussian" else AIRY, stamp_rule([0.0], 1e-3, device)
    if timed(benchmark, Drawing(psf, None, random_positions(n_source), rule).draw, device):
        error = worst_pixel(psf, None, rule)
        note(benchmark, device, f"{name}, number of sources", f"{n_source:,} sources", error, n_source)


@pytest.mark.parametrize("cut", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("name", ["Gaussian", "Airy"])
def test_stamp_rules(benchmark, name, cut, device):
    psf = ws.PsfGaussian(SIGMA_PX) if name == "Gaussian" else AIRY
    rule = stamp_rule([0.0], cut, device)
    drawing = Drawing(psf, None, random_positions(N_SOURCE), rule)
    if timed(benchmark, drawing.draw, device):
        fractions = [wp.empty((1, 1, N_SOURCE), dtype=wp.float32, device=device) for _ in range(2)]
        drawing.bank.measure_stamps(drawing.sources[1:], rule, fractions)
        error, left_out = worst_pixel(psf, None, rule), float(1 - fractions[1].numpy().mean())
        way = f"cut at {cut:g} of the light per pixel"
        note(benchmark, device, f"{name}, stamps", way, error, left_out=left_out)


@pytest.mark.parametrize("error", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
def test_streaks(benchmark, error, device):
    psf, path_px = ws.PsfGaussian(SIGMA_PX), [(0.0, 0.0), (0.4 * STREAK_PX, 0.3 * STREAK_PX)]
    rule = stamp_rule([0.0], 1e-6, device, error)
    if timed(benchmark, Drawing(psf, None, random_positions(N_SOURCE), rule, path_px).draw, device):
        worst = worst_pixel(psf, None, stamp_rule([0.0], 1e-9, device, error), path_px)
        note(benchmark, device, f"Gaussian, streak of {STREAK_PX:g} px", f"nodes for {error:g}", worst)


@pytest.mark.parametrize("n_source", [1000, 100_000])
@pytest.mark.parametrize("name", [PRODUCT, *VARIANTS])
def test_sums(benchmark, name, n_source, device):
    """Gathered or scattered, in float32, float64 or fixed point; errors are those of the sums, against float64."""
    psf, rule = AIRY, stamp_rule([0.0], 1e-4, device)
    rng = np.random.default_rng(1)
    xy_px = wp.array(rng.uniform(MARGIN, N_PIXEL - MARGIN, (n_source, 2)), dtype=wp.vec2d, device=device)
    strength = wp.array(rng.uniform(0.1, 1.0, n_source), dtype=wp.float32, device=device)
    n_row_per_block = rows_per_block(wp.get_device(device), N_PIXEL, 1)
    exact = Variant("gather float64", psf, (N_PIXEL, N_PIXEL), device, n_row_per_block)
    if name == PRODUCT:
        product = Drawing(psf, None, xy_px.numpy(), rule)
        product.sources[2] = strength.reshape((1, 1, n_source))
        draw, values = product.draw, product
    else:
        way = Variant(name, psf, (N_PIXEL, N_PIXEL), device, n_row_per_block)
        draw, values = (lambda: way.draw(xy_px, strength, rule)), way.values
    if timed(benchmark, draw, device):
        exact.draw(xy_px, strength, rule)
        error = float(np.abs(values() - exact.values()).max() / exact.values().max())
        note(benchmark, device, f"sums of {n_source:,} sources", name, error, n_source)
