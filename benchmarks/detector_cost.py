"""Cost of radiation hits, flickering pixels, and rows that are read in turn.

    python -m benchmarks.detector_cost --json benchmarks/results/programs/detector.json

Images of 100 stars in band A with each, by turns with a detector without them, processor time of one thread.
"""

from __future__ import annotations

from typing import Any

import warpsim as ws
from benchmarks.background_cost import us_an_image
from benchmarks.programs import parser_of, write_or_print
from warpsim.detector.hits_and_flicker import hit_area
from warpsim.speed.work import speed_work

N_EVENT = 1000
HITS = {"rate_cm2_s": 1.0, "nei_per_um": 20.0, "integration_s": 1.0, "pixel_pitch_um": 20.0}


def changes(n_pixel: int) -> dict[str, dict[str, Any]]:
    """Changes of the scene by what is measured."""
    camera = ws.Camera(n_row=n_pixel, n_col=n_pixel, fov_deg=1.0)
    detector = ws.NeiDetector(1e-18, 3e-15, hits=ws.RadiationHits(**HITS))
    rate = N_EVENT / hit_area(detector, camera).mean
    return {
        "none of it": {},
        "1,000 hits": {"detector__hits": HITS | {"rate_cm2_s": rate}},
        "1,000 flickering pixels": {"detector__flicker": {"fraction": N_EVENT / n_pixel**2, "nei": 20.0}},
        "exposure, all rows at once": {"detector__exposure_s": 0.005},
        "rows in turn, instants": {"detector__line_time_s": 5e-6},
        "rows in turn, exposure": {"detector__line_time_s": 5e-6, "detector__exposure_s": 0.005},
    }


def main() -> None:
    """Measure, and print the result or write it."""
    options = parser_of(__doc__).parse_args()
    us: dict[str, dict[str, float]] = {}
    for n_pixel in (128, 1024):
        work = speed_work(n_pixel, 100, 1, "gaussian")
        scenes = {name: work.scene.replace(**change) for name, change in changes(n_pixel).items()}
        us[str(n_pixel)] = us_an_image(work, scenes)
    write_or_print("python -m benchmarks.detector_cost", {"us_an_image": us}, options.json)


if __name__ == "__main__":
    main()
