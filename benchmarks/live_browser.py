"""What rate a browser shows of the page: frames that were painted, of those asked for and sent.

    WARPSIM_CHROMIUM=/usr/bin/chromium python -m benchmarks.live_browser \
        --json benchmarks/results/programs/live_browser.json

A page of 1400 x 900 pixels in a headless chromium, on the machine that renders, with its three-dimensional scene drawn
by the processor (no GPU). Images of 128 x 128 pixels, 100 stars in an image, one band: the page plays 30 frames a
second of one sensor or twelve, with its scene in three dimensions or with that one left still; or it is offered a
stream of the same rate. A frame counts as shown when the first image differs at a repaint. Needs the extra `live`,
playwright and a chromium.
"""

from __future__ import annotations

import os
import shutil
import statistics
import threading
import time
from collections.abc import Callable
from typing import Any

import warpsim as ws
from benchmarks.programs import parser_of, write_or_print
from warpsim.speed.work import BAND, speed_work

RATE_HZ = 30.0
SPAN_S = 6.0
SETTLE_S = 2.0
N_SENSOR = (1, 12)
SIZE = {"width": 1400, "height": 900}
FLAGS = "--no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader --ignore-gpu-blocklist"
COUNT = """() => {
  window.shown = {frames: 0, paints: 0, last: null};
  const look = () => {
    const image = document.querySelector('.tile img');
    window.shown.paints += 1;
    if (image && image.complete && image.src !== window.shown.last) {
      window.shown.frames += 1; window.shown.last = image.src;
    }
    requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
}"""


def chromium_path() -> str:
    """Return the path of the browser; an error where there is none."""
    found = os.environ.get("WARPSIM_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        raise SystemExit("no chromium: set WARPSIM_CHROMIUM to its path")
    return found


def counted(tab: Any, page: ws.View, span_s: float) -> dict[str, float]:
    """Return frames sent and shown, and repaints, per second of a span."""
    before, begin_s, n_sent = tab.evaluate("window.shown"), time.perf_counter(), page.status.n_shown
    time.sleep(span_s)
    passed_s, sent = time.perf_counter() - begin_s, page.status.n_shown - n_sent
    after = tab.evaluate("window.shown")
    return {
        "sent_per_s": sent / passed_s,
        "shown_per_s": (after["frames"] - before["frames"]) / passed_s,
        "paints_per_s": (after["paints"] - before["paints"]) / passed_s,
    }


def played(tab: Any, page: ws.View, n_turn: int, moving: bool) -> list[dict[str, float]]:
    """Let the page play from the first frame on, by turns."""
    interval_s = page.scenario.instrument_of(page.sensors[0]).frames.interval_s
    turns = []
    for _ in range(n_turn):
        page.show(page.frames[0])
        page._controls.moving.value = moving
        page._controls.speed.value = RATE_HZ * interval_s
        page._press("play")
        time.sleep(SETTLE_S)
        turns.append(counted(tab, page, SPAN_S))
        page._press("pause")
    return turns


def offered(tab: Any, page: ws.View, n_turn: int, renderer: ws.Renderer, sensors: list[str]) -> list[dict[str, float]]:
    """Offer the page a stream of its rate, by turns."""
    turns = []
    for _ in range(n_turn):
        stop = threading.Event()

        def feed(stop: threading.Event = stop) -> None:
            begin_s = time.perf_counter()
            for number, frames in enumerate(renderer.stream(page.frames, sensors, [BAND])):
                page.offer(frames)
                if stop.wait(max(begin_s + (number + 1) / RATE_HZ - time.perf_counter(), 0.0)):
                    return

        thread = threading.Thread(target=feed)
        thread.start()
        time.sleep(SETTLE_S)
        turns.append(counted(tab, page, SPAN_S))
        stop.set()
        thread.join()
    return turns


def main() -> None:
    """Measure and write the result."""
    parser = parser_of(__doc__)
    parser.add_argument("--turns", type=int, default=3, metavar="N", help="of each case; medians are reported (3)")
    options = parser.parse_args()
    n_turn = options.turns
    from playwright.sync_api import sync_playwright

    found: dict[str, Any] = {"n_turn": n_turn}
    found["load_average_before"] = os.getloadavg()[0]  # of others on this machine
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium_path(), args=FLAGS.split())
        found |= {"chromium": browser.version, "page_px": list(SIZE.values()), "asked_per_s": RATE_HZ}
        for n_sensor in N_SENSOR:
            for name, moving in (("", True), (", not in 3-D", False)):
                found[f"played, {n_sensor} sensors{name}"] = on_page(
                    browser,
                    n_sensor,
                    n_turn,
                    lambda tab, page, n_turn, *_, moving=moving: played(tab, page, n_turn, moving),
                )
        found[f"offered, {N_SENSOR[-1]} sensors"] = on_page(browser, N_SENSOR[-1], n_turn, offered)
        browser.close()
    write_or_print(f"python -m benchmarks.live_browser --turns {n_turn}", found, options.json)


def on_page(
    browser: Any, n_sensor: int, n_turn: int, measure: Callable[..., list[dict[str, float]]]
) -> dict[str, float]:
    """Return medians of what is measured on a page of so many sensors."""
    work = speed_work(128, 100, n_sensor, n_frame=1000)
    renderer = ws.Renderer(work.scene, "cpu", catalog=work.catalog)
    with ws.view(renderer, port=0, sensors=work.sensors) as page:
        tab = browser.new_page(viewport=SIZE, locale="en-US")
        tab.goto(page.url)
        tab.wait_for_selector(".tile img", timeout=60_000)
        tab.evaluate(COUNT)
        turns = measure(tab, page, n_turn, renderer, work.sensors)
        tab.close()
    return {name: round(statistics.median(turn[name] for turn in turns), 2) for name in turns[0]}


if __name__ == "__main__":
    main()
