"""The CPU against the device, scene by scene: light, counts, stars and truth.

Compilers fuse multiplications and additions as they like, so single results differ in their last bits: a source's stamp
may end a pixel earlier, and a count at the edge of two may be its neighbour.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np
import numpy.typing as npt

import warpsim as ws
from benchmarks.gpu.plan import Plan, Row, rows_of
from warpsim.render.device import n_usable_cpu
from warpsim.sky.catalog import StarCatalog
from warpsim.speed.work import speed_work

OF_BRIGHTEST = 1e-6
"""Difference of light that is allowed, over the brightest pixel of the band."""

OF_CUT = 1.01
"""The same over what a stamp may leave out of a pixel: there a stamp may end on one device and not on the other."""

DIFFERING = 1e-3
"""Part of the pixels whose counts may differ, by 1."""

OF_TRUTH = 1e-5
"""Relative difference of numbers of the truth; of what is below a hundredth of a column's largest, over that."""

MEASURED_BY = {"left_out_w_cm2": "irradiance_w_cm2", "snr_peak": "snr"}
"""Columns that are parts of others, by which their differences are measured."""

OF_OWN_PIXEL = (
    "blend_fraction", "snr_peak", "background_w_cm2", "noise_nei", "x_sigma_px", "y_sigma_px", "irradiance_sigma_w_cm2",
)  # fmt: skip
"""Columns that ask which pixel a target lies in. A tracked one may lie on the corner of four, where the last bit
decides: these are compared for targets that are EDGE_PX and more from an edge."""

EDGE_PX = 1e-6

FEW_E: dict[str, Any] = {
    "exposure_s": 0.1, "full_well_e": 20000.0, "gain_e_per_count": 1.0, "bits": 16, "offset_counts": 200.0,
    "transmission": 0.6, "quantum_efficiency": 0.5, "dark_e_s": 40.0, "read_noise_e": 2.0,
}  # fmt: skip
TERMS: dict[str, Any] = {"prnu": 0.01, "dead_fraction": 0.01, "hot_fraction": 0.01, "nonlinearity": 0.1}
ODD: dict[str, Any] = {"bands": ["A", "C"], "camera__n_row": 40, "camera__n_col": 61}
DAYLIGHT: dict[str, Any] = {
    "bands": ["G"], "camera__fov_deg": 60.0, "optics__psf": "gaussian", "optics__sigma_px": 0.7,
    "detector__nei_w_cm2": 1e-11, "detector__sei_w_cm2": 1e-5, "detector__counts_per_nei": 0.2,
}  # fmt: skip
BODY: dict[str, Any] = {"temperature": {"start_k": 300.0}, "surface": {"emissivity": 0.9}}
ROTATING: list[dict[str, Any]] = [
    {"name": "half", "shape": ws.Cylinder(radius_m=0.25, height_m=1.0), **BODY,
     "patches": [{"azimuth_deg": [0.0, 180.0], "surface": {"emissivity": 0.1}}],
     "attitude": {"spin_rev_s": 0.05, "precession_angle_deg": 70.0, "axis": [1.0, 0.0, 0.0], "spin_phase_rev": 0.0,
                  "precession_phase_rev": 0.0}},
    {"name": "tumbler", "shape": ws.Cone(radius_m=0.3, height_m=1.2), **BODY,
     "attitude": {"kind": "torque_free", "moments": [1.0, 1.6, 2.0], "rates_deg_s": [0.3, 20.0, 0.3],
                  "quaternion": [0.0, 0.0, 0.0, 1.0]}},
]  # fmt: skip


@dataclass(frozen=True)
class Case:
    """Case that is rendered on both."""

    scene: ws.Scene
    frames: Sequence[int]
    sensors: Sequence[str] | None = None
    catalog: StarCatalog | None = None


MOST_WORKERS = 8


def agreement(plan: Plan) -> Iterator[Row]:
    """Compare all cases, some at a time: most of it is compilation, one kernel after the other."""
    if plan.quick:
        yield from rows_of((name, partial(compared, case, plan.device)) for name, case in _small().items())
        return
    n_worker = max(1, min(MOST_WORKERS, n_usable_cpu() // 2))
    with ProcessPoolExecutor(n_worker, get_context("spawn")) as workers:
        asked = {name: workers.submit(_compared_by_name, name, plan.device) for name in _cases()}
        yield from rows_of((name, future.result) for name, future in asked.items())


def _cases() -> dict[str, Case]:
    return {**_small(), **_terms(), **_later_terms(), **_sizes(), **_presets()}


def _compared_by_name(name: str, device: str) -> Row:
    return compared(_cases()[name], device)


def _small() -> dict[str, Case]:
    stss = ws.Scene.load("stss")
    gaussian = stss.replace(optics__psf="gaussian", camera__n_row=40, camera__n_col=61)
    return {"Airy": Case(stss, [60, 61], ["sat11"]), "Gaussian, 40 x 61": Case(gaussian, [60], ["sat11", "sat47"])}


def _terms() -> dict[str, Case]:
    stss, two = ws.Scene.load("stss"), ["sat11", "sat47"]
    moving = stss.replace(detector__exposure_s=0.5, detector__streaks=True)
    jitter = [{"track": "group", "jitter": {"rms_urad": 100.0, "correlation_s": 0.3}}]
    noisy = {f"detector__{name}": value for name, value in (TERMS | {"dsnu_nei": 0.5, "column_noise_nei": 0.4}).items()}
    electrons = stss.replace(detector=ws.ElectronDetector(**FEW_E), **ODD)
    all_terms = ws.ElectronDetector(**FEW_E, **TERMS, dsnu=0.3, column_noise_e=3.0)
    return {
        "all sensors and bands": Case(stss, range(60, 64)),
        "streaks": Case(moving, range(5, 45, 10), two),
        "streaks, Gaussian": Case(moving.replace(optics__psf="gaussian"), range(5, 45, 10), two),
        "jitter": Case(moving.replace(pointing=jitter), [5, 25], ["sat11"]),
        "rows read in turn": Case(moving.replace(detector__line_time_s=2e-3), range(5, 45, 10), two),
        "distortion": Case(stss.replace(camera__distortion={"k1": -0.05, "k2": 0.01}), range(60, 64), two),
        "in sunlight": Case(stss.replace(epoch_utc="2025-03-20T00:00:00"), range(60, 64), two),
        "NEI, all terms": Case(stss.replace(**noisy, **ODD), range(60, 64), two),
        "few electrons": Case(electrons, range(60, 64), two),
        "electrons, all terms": Case(stss.replace(detector=all_terms, **ODD), range(60, 64), two),
    }


def _later_terms() -> dict[str, Case]:
    stss, two = ws.Scene.load("stss"), ["sat11", "sat47"]
    hits = ws.RadiationHits(rate_cm2_s=2000.0, integration_s=0.1, nei_per_um=2.0, pixel_pitch_um=30.0)
    stray = {"angle_deg": [0, 10, 30, 60, 90, 180], "ratio_sr": [1e-1, 1e-3, 1e-5, 1e-6, 1e-7, 1e-8]}
    rows = {"detector__exposure_s": 0.032, "detector__streaks": True, "detector__line_time_s": 1e-3}
    limb = {"kind": "fixed", "azimuth_elevation_deg": [90.0, -36.4]}
    down = {"kind": "fixed", "azimuth_elevation_deg": [0.0, -90.0]}
    earth = {"zodiacal": True, "earth": True, "stray_light": stray}
    wide = {"camera__fov_deg": 3.0, "detector__sei_w_cm2": 1e-10, "detector__nei_w_cm2": 1e-16}
    return {
        "hits and flicker": Case(
            stss.replace(detector__hits=hits, detector__flicker=ws.Flicker(fraction=1e-2, nei=10.0)), [60, 61], two
        ),
        "zodiacal light": Case(stss.replace(background={"zodiacal": True, "stray_light": stray}), [60, 61], two),
        "the Earth behind": Case(stss.replace(pointing=limb, background=earth, **wide), [60], two),
        "TDI": Case(stss.replace(**rows, detector__tdi_stages=32), [60, 61], two),
        "map of the sky": Case(stss.replace(background={"sky_map": f"python:{__name__}:glow"}), [60, 61], two),
        "the Earth by day": Case(stss.replace(pointing=down, background=earth, **DAYLIGHT), [0, 1], ["sat24", "sat45"]),
        "painted and tumbling": Case(stss.replace(targets=ROTATING), range(60, 64), two),
    }


def glow(directions: npt.NDArray[np.float64], band: ws.Band) -> npt.NDArray[np.float64]:
    """A sky whose radiance [W/cm2/sr] waves in all directions."""
    x, y, z = directions.T
    return 1e-11 * (2.0 + np.sin(40.0 * x) * np.cos(30.0 * y) + z)


def _sizes() -> dict[str, Case]:
    works = [speed_work(n_pixel, 100, 1, psf, 4) for n_pixel in (128, 1024) for psf in ("gaussian", "airy")]
    return {
        f"{work.psf} {work.n_pixel}": Case(work.scene, work.frames(0), work.sensors, work.catalog) for work in works
    }


def _presets() -> dict[str, Case]:
    cases = {}
    for preset in ("two_cameras", "visible_to_lwir"):
        scene = ws.Scene.load(preset)
        for kind, instrument in scene.scenario.instruments.items():
            cases[f"{preset}, {kind}"] = Case(scene, [5, 6], instrument.names[:2])
    return cases


def compared(case: Case, device: str) -> Row:
    """Render a case on the CPU and on a device, there also without signal that is kept, and compare."""
    one, two = (
        ws.Renderer(case.scene, where, catalog=case.catalog).render(
            case.frames, case.sensors, keep_signal=True, keep_stars=True
        )
        for where in ("cpu", device)
    )
    without = ws.Renderer(case.scene, device, catalog=case.catalog).render(case.frames, case.sensors)
    counts, *others = (frames.counts.numpy().astype(np.int64) for frames in (one, two, without))
    differ = np.abs(counts - np.stack(others))
    part, by = float((differ > 0).mean()), int(differ.max(initial=0))
    stars = _same_stars(one, two)
    worst, error = _worst_of_truth(one, two)
    light = _light(one, two)
    return {
        "ok": light["over_limit"] <= 1.0 and part < DIFFERING and by <= 1 and stars and error < OF_TRUTH,
        **light,
        "counts_differ": part,
        "by_at_most": by,
        "same_stars": stars,
        "worst_of_truth": worst,
        "truth_differs": error,
    }


def _light(one: ws.FrameSet, two: ws.FrameSet) -> dict[str, float]:
    """Largest difference of light: over the brightest pixel, over the NEI, and over what is allowed."""
    assert one.signal_w_cm2 is not None and two.signal_w_cm2 is not None
    a, b = (stack.numpy().astype(np.float64) for stack in (one.signal_w_cm2, two.signal_w_cm2))
    sensor, axes = one.instrument.sensor, (0, 1, 3, 4)
    nei = np.array([one.instrument.nei_w_cm2(band) for band in one.bands])
    difference, brightest = np.abs(a - b).max(axis=axes), np.abs(a).max(axis=axes)
    limit = np.maximum(OF_BRIGHTEST * brightest, OF_CUT * sensor.optics.stamp_cut_nei * nei)
    return {
        "light_of_brightest": float((difference / np.maximum(brightest, 1e-300)).max()),
        "light_nei": float((difference / nei).max()),
        "over_limit": float((difference / limit).max()),
    }


def _same_stars(one: ws.FrameSet, two: ws.FrameSet) -> bool:
    """Whether each view has the same stars, in the same order."""
    return len(one.stars) == len(two.stars) and all(
        np.array_equal(np.asarray(one.stars[name]), np.asarray(two.stars[name]))
        for name in ("frame", "sensor", "catalog_row")
    )


def _worst_of_truth(one: ws.FrameSet, two: ws.FrameSet) -> tuple[str, float]:
    """Column that differs most, and by how much; infinite where words, flags or what is unknown differ."""
    xy_px = np.stack([np.asarray(one.truth[name]) for name in ("x_px", "y_px")])
    inside = ~(np.abs(xy_px % 1.0 - 0.5).min(axis=0) < EDGE_PX)  # pixels end half-way between whole numbers
    everywhere = np.ones_like(inside)
    differences = {
        name: _difference(one, two, name, inside if name in OF_OWN_PIXEL else everywhere) for name in one.truth.colnames
    }
    worst = max(differences, key=differences.__getitem__)
    return worst, differences[worst]


def _difference(one: ws.FrameSet, two: ws.FrameSet, name: str, rows: npt.NDArray[np.bool_]) -> float:
    a, b = np.asarray(one.truth[name])[rows], np.asarray(two.truth[name])[rows]
    if a.dtype.kind != "f":
        return 0.0 if np.array_equal(a, b) else np.inf
    size: npt.NDArray[Any] = np.abs(np.nan_to_num(one.truth[MEASURED_BY.get(name, name)], posinf=0.0))[rows]
    known = np.isfinite(a) & np.isfinite(b)
    if not np.array_equal(a[~known], b[~known], equal_nan=True):
        return np.inf
    if not known.any():
        return 0.0
    scale = np.maximum(size[known], max(0.01 * float(size[known].max()), 1e-300))
    return float((np.abs(a[known] - b[known]) / scale).max())
