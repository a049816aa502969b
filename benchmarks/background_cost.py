"""Cost of what lies behind stars and targets, and speed against error of its grids.

    python -m benchmarks.background_cost --json benchmarks/results/programs/background.json

Images of 100 stars in band A with each term, by turns with a black sky, processor time of one thread; then the cube of
zodiacal light and the nodes of a view, coarser and finer, against the model itself in the directions of pixels.
"""

from __future__ import annotations

import statistics
import time
from typing import Any

import numpy as np

import warpsim as ws
from benchmarks.programs import parser_of, processor_s, write_or_print
from warpsim.background.zodiacal import ECLIPTIC_AXES, band_light, zodiacal_radiance_w_cm2_sr
from warpsim.constants import ASTRONOMICAL_UNIT_M
from warpsim.render import background
from warpsim.speed.work import render_call, speed_work

ROUNDS = 9
STRAY = {"angle_deg": [0, 10, 30, 60, 90, 180], "ratio_sr": [1e-1, 1e-3, 1e-5, 1e-6, 1e-7, 1e-8]}
TERMS: dict[str, dict[str, Any]] = {
    "black sky": {},
    "zodiacal light": {"background__zodiacal": True},
    "Earth": {"background__earth": True},
    "stray light": {"background__stray_light": STRAY},
    "all of it": {"background__zodiacal": True, "background__earth": True, "background__stray_light": STRAY},
}
N_NODES = (31, 61, 91, 181)
PER_CELL = (1, 2, 4)


def costs(n_pixel: int, down: bool) -> dict[str, float]:
    """Microseconds of processor time an image by term; with cameras that look at targets, or straight down."""
    work = speed_work(n_pixel, 100, 1, "gaussian")
    scene = (
        work.scene.replace(pointing={"kind": "fixed", "azimuth_elevation_deg": [0.0, -90.0], "up": "orbit_normal"})
        if down
        else work.scene
    )
    return us_an_image(work, {name: scene.replace(**change) for name, change in TERMS.items()})


def us_an_image(work: Any, scenes: dict[str, ws.Scene]) -> dict[str, float]:
    """Median processor time of one thread for an image of each scene, by turns [us]."""
    renderers = {name: ws.Renderer(scene, "cpu", n_thread=1, catalog=work.catalog) for name, scene in scenes.items()}
    times: dict[str, list[float]] = {name: [] for name in scenes}
    for number in range(ROUNDS + 2):
        for name, renderer in renderers.items():
            times[name].append(1e6 * processor_s(render_call, work, renderer, number) / work.n_view)
    return {name: statistics.median(values[2:]) for name, values in times.items()}


def errors() -> list[dict[str, float]]:
    """Largest error of zodiacal light in pixels 20 degrees and more from the Sun, by the nodes of its grids."""
    pointing = {"kind": "fixed", "azimuth_elevation_deg": [90.0, 20.0]}
    base = ws.Scene.load("stss").replace(sky__catalog="none", camera__fov_deg=20.0, groups=[], pointing=pointing)
    names = base.scenario.sensor_names
    found = []
    for n_node in N_NODES:
        for per_cell in PER_CELL:
            background.ZODIACAL_NODES, background._NODES_PER_CELL = n_node, per_cell
            renderer = ws.Renderer(base.replace(background__zodiacal=True), "cpu", n_thread=1)
            before = time.perf_counter()
            frames = renderer.render([0], sensors=names, bands="A", keep_signal=True)
            first_s = time.perf_counter() - before
            again_s = statistics.median(processor_s(renderer.render, [0], names, "A") for _ in range(ROUNDS))
            cost = {"first_s": first_s, "us": 1e6 * again_s / len(names)}
            found.append({"nodes": n_node, "per_cell": per_cell, **cost, "error": error_of(frames)})
    return found


def error_of(frames: Any) -> float:
    """Largest relative error of the light in some pixels, against the integral along their lines of sight."""
    instrument, scenario = frames.instrument, frames.scenario
    camera = instrument.sensor.camera
    earth_au = -scenario.tracks.sun.position_at_m(np.array([scenario.scene.duration_s / 2]))[0] / ASTRONOMICAL_UNIT_M
    now_au = -scenario.tracks.sun.position_at_m(np.zeros(1))[0] / ASTRONOMICAL_UNIT_M
    rows, cols = (axis.ravel() for axis in np.meshgrid(*2 * [np.arange(3, camera.n_row, 11)], indexing="ij"))
    xy = np.stack([cols, rows], axis=1).astype(np.float64)
    wide, high = (camera.direction(xy + half) - camera.direction(xy - half) for half in 0.5 * np.eye(2))
    pixel_sr = np.linalg.norm(np.cross(wide, high), axis=1)
    light, worst = [band_light(instrument.bands["A"])], 0.0
    for number in range(len(frames.sensors)):
        lines = camera.direction(xy) @ frames.axes_icrs[0, number]
        far = lines @ (-now_au / np.linalg.norm(now_au)) < np.cos(np.radians(20.0))
        if far.any():
            exact = zodiacal_radiance_w_cm2_sr(lines[far] @ ECLIPTIC_AXES.T, ECLIPTIC_AXES @ earth_au, light)[0]
            seen = frames.signal_w_cm2.numpy()[0, number, 0][rows[far], cols[far]]
            worst = max(worst, float(np.abs(seen / (exact * pixel_sr[far]) - 1.0).max()))
    return worst


def main() -> None:
    """Measure, and print the result or write it."""
    options = parser_of(__doc__).parse_args()
    found = {
        "us_an_image": {
            f"{n_pixel}{', straight down' if down else ''}": costs(n_pixel, down)
            for n_pixel in (128, 1024)
            for down in (False, True)
        },
        "grids": errors(),
    }
    write_or_print("python -m benchmarks.background_cost", found, options.json)


if __name__ == "__main__":
    main()
