"""Cost of a sequence of a data set, however short it is: processor time by what is drawn, and how it divides.

    python -m benchmarks.dataset_cost --json benchmarks/results/programs/dataset_cost.json

Sequences of `stss`, band A, 128 x 128 pixels, one sensor, format fits. `sequence_ms` is the processor time of one (all
threads of the process) with one frame, from the difference of data sets of 8 and of 2, and `frame_ms` of each frame
more, with truth, labels and files. `draw_ms` is the part of drawing it (orbits, access), `prepare_ms` that of a
renderer for its scene. Each data set has a seed of its own, so that no sequence is met again. Medians of 5.
"""

from __future__ import annotations

import itertools
import statistics
import tempfile
from typing import Any

import warp as wp

import warpsim as ws
from benchmarks.programs import parser_of, processor_name, processor_s, write_or_print
from warpsim.dataset.layout import draw_sequence

ROUNDS, FEW, MANY, N_FRAME = 5, 2, 8, 257
SEEDS = itertools.count(1)
CASES: dict[str, dict[str, Any]] = {
    "nothing": {},
    "detector.nei_w_cm2": {"sample": {"detector.nei_w_cm2": {"log_uniform": [1e-18, 3e-18]}}},
    "optics.aperture_m": {"sample": {"optics.aperture_m": {"uniform": [0.3, 0.5]}}},
    "targets.1.count": {"sample": {"targets.1.count": {"integer": [1, 20]}}},
    "constellation.altitude_km": {"sample": {"constellation.altitude_km": {"uniform": [1500.0, 1700.0]}}},
    "optics.aperture_m, masks and COCO": {
        "sample": {"optics.aperture_m": {"uniform": [0.3, 0.5]}},
        "masks": True,
        "coco": True,
    },
}


def written_ms(given: dict[str, Any], n_sequence: int, n_frame: int) -> float:
    """Processor time of writing a data set [ms]."""
    recipe = ws.Recipe("stss", n_sequence=n_sequence, n_frame=n_frame, seed=next(SEEDS), **given)
    with tempfile.TemporaryDirectory() as folder:
        return 1e3 * processor_s(ws.write_dataset, recipe, f"{folder}/data", n_worker=1, device="cpu")


def first_image(renderer: ws.Renderer, scene: ws.Scene, sensors: Any) -> None:
    """Make a renderer for a scene, and an image."""
    renderer.with_scene(scene).render([0], sensors).counts.numpy()


def costs(given: dict[str, Any]) -> dict[str, float]:
    """Medians of one case [ms]."""
    given = {"bands": ["A"], "interval_s": 0.1, "split": {"all": 1.0}, "coco": False} | given
    found: dict[str, list[float]] = {"sequence_ms": [], "frame_ms": [], "draw_ms": [], "prepare_ms": []}
    recipe = ws.Recipe("stss", n_sequence=MANY, n_frame=1, seed=next(SEEDS), **given)
    renderer = ws.Renderer(recipe.scene, "cpu")
    written_ms(given, FEW, 1)  # kernels, catalog
    for number in range(ROUNDS):
        one = (written_ms(given, MANY, 1) - written_ms(given, FEW, 1)) / (MANY - FEW)
        many = (written_ms(given, MANY, N_FRAME) - written_ms(given, FEW, N_FRAME)) / (MANY - FEW)
        found["sequence_ms"].append(one)
        found["frame_ms"].append((many - one) / (N_FRAME - 1))
        found["draw_ms"].append(1e3 * processor_s(draw_sequence, recipe, number))
        drawn = draw_sequence(recipe, number)
        found["prepare_ms"].append(1e3 * processor_s(first_image, renderer, drawn.scene, drawn.sensors))
    return {name: round(statistics.median(values), 2) for name, values in found.items()}


def main() -> None:
    """Measure, and print the result or write it."""
    options = parser_of(__doc__).parse_args()
    wp.config.log_level = wp.LOG_ERROR
    by_what_is_drawn = {name: costs(given) for name, given in CASES.items()}
    found = {"cpu": processor_name(), "by_what_is_drawn": by_what_is_drawn}
    write_or_print("python -m benchmarks.dataset_cost", found, options.json)


if __name__ == "__main__":
    main()
