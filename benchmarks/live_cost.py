"""What a page that follows a stream costs: frames rendered per second with and without it, by turns.

    python -m benchmarks.live_cost --json benchmarks/results/programs/live.json

20 sensors of 128 x 128 pixels, 100 stars in an image, one band, a frame each 1/30 s, rendered as fast as it goes and at
30 Hz. Needs the extra `live`; without a browser what the page sends is taken by a client that discards it.
"""

from __future__ import annotations

import statistics
import time
from typing import Any

import warpsim as ws
from benchmarks.programs import parser_of, write_or_print
from warpsim.speed.work import BAND, speed_work

N_FRAME = 600
N_TURN = 5
RATE_HZ = 30.0


def seconds(renderer: ws.Renderer, sensors: list[str], page: ws.View | None, rate_hz: float | None) -> float:
    """Return how long a stream of N_FRAME frames takes."""
    begin = time.perf_counter()
    for number, frames in enumerate(renderer.stream(range(N_FRAME), sensors, [BAND])):
        if page is not None:
            page.offer(frames)
        if rate_hz is not None:
            time.sleep(max(begin + (number + 1) / rate_hz - time.perf_counter(), 0.0))
    return time.perf_counter() - begin


def main() -> None:
    """Measure by turns and write the result."""
    options = parser_of(__doc__).parse_args()
    work = speed_work(128, 100, 20, n_frame=N_FRAME)
    renderer = ws.Renderer(work.scene, "cpu", catalog=work.catalog)
    found: dict[str, Any] = {}
    with ws.view(renderer, port=0, sensors=work.sensors) as page:
        for name, rate_hz in (("as fast as it goes", None), ("30 Hz", RATE_HZ)):
            turns = []
            shown = 0
            for _ in range(N_TURN):
                alone = seconds(renderer, work.sensors, None, rate_hz)
                before = page.n_dropped
                watched = seconds(renderer, work.sensors, page, rate_hz)
                shown += N_FRAME - (page.n_dropped - before)
                turns.append((N_FRAME / alone, N_FRAME / watched))
            found[name] = {
                "frames_per_s_alone": statistics.median(alone for alone, _ in turns),
                "frames_per_s_watched": statistics.median(watched for _, watched in turns),
                "ratio": statistics.median(watched / alone for alone, watched in turns),
                "shown_per_turn": shown / N_TURN,
            }
    write_or_print("python -m benchmarks.live_cost", found, options.json)


if __name__ == "__main__":
    main()
