"""The page in a real browser without a display: `pip install playwright` and chromium, or WARPSIM_CHROMIUM=its path."""

from __future__ import annotations

import base64
import contextlib
import io
import os
import shutil
import time

import numpy as np
import pytest
from PIL import Image

import warpsim as ws
from warpsim.output.grey import grey

CHROMIUM = os.environ.get("WARPSIM_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = "--no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader --ignore-gpu-blocklist"
SENSORS = ["sat11", "sat27"]

pytestmark = [pytest.mark.ci, pytest.mark.skipif(CHROMIUM is None, reason="no chromium")]


@pytest.fixture(scope="module")
def renderer(scene):
    return ws.Renderer(scene, "cpu")


@pytest.fixture(scope="module")
def page(renderer):
    with ws.view(renderer, port=0, sensors=SENSORS, band="C") as page:
        yield page


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS.split())
        yield browser
        browser.close()


def opened(browser, page):
    """A tab with the page, and what it asked for on the network."""
    tab, asked = browser.new_page(viewport={"width": 1400, "height": 900}, locale="en-US"), []
    tab.on("request", lambda request: asked.append(request.url))
    tab.goto(page.url)
    tab.wait_for_selector(".tile img", timeout=60_000)
    return tab, asked


def greys(tab):
    """The pictures of all tiles, as the browser holds them."""
    sources = tab.eval_on_selector_all(".tile img", "images => images.map(image => image.src)")
    return [np.asarray(Image.open(io.BytesIO(base64.b64decode(s.partition(",")[2])))) for s in sources]


def until(condition, seconds=60):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it took too long"
        time.sleep(0.1)


def expected(renderer, frame):
    frames = renderer.render([frame], SENSORS, "C")
    return [grey(image, frames.instrument.levels["C"], 1024) for image in frames.counts.numpy()[0, :, 0]]


def equal(found, wanted):
    return len(found) == len(wanted) and all(np.array_equal(a, b) for a, b in zip(found, wanted, strict=True))


def test_a_moved_slider_sends_the_rendered_images_and_nothing_leaves_the_machine(browser, page, renderer):
    tab, asked = opened(browser, page)
    box = tab.locator("input[type=text]:visible").first  # the slider's number
    for frame in (58, 63):
        box.fill(str(frame))
        box.press("Enter")
        until(lambda frame=frame: f"frame {frame}," in tab.inner_text(".status"))
        until(lambda frame=frame: equal(greys(tab), expected(renderer, frame)))
    assert asked and all(url.startswith((page.url, "data:", "blob:")) for url in asked)
    tab.close()


def test_boxes_lie_on_the_light(browser, page, renderer):
    page.show(60)
    tab, _ = opened(browser, page)
    until(lambda: "frame 60," in tab.inner_text(".status"))
    tile = tab.locator(".tile").first
    image = tile.locator("img").bounding_box()
    alone = ws.light_curves(renderer.scene, [600.0], SENSORS[:1], bands="C")
    name = alone.targets[int(np.argmax(alone.snr[0, 0, 0]))]
    rect = tile.locator(f'rect[data-target="{name}"]').bounding_box()
    middle = [(rect[a] + rect[s] / 2 - image[a]) / image[s] * 128 - 0.5 for a, s in (("x", "width"), ("y", "height"))]
    contributions = renderer.render([60], SENSORS[:1], "C").contributions_w_cm2(60, SENSORS[0], "C")
    light = contributions[alone.targets.index(name)]
    rows, columns = np.indices(light.shape)
    centroid = [(columns * light).sum() / light.sum(), (rows * light).sum() / light.sum()]
    assert np.abs(np.subtract(middle, centroid)).max() < 1.0
    tab.close()


def test_the_cursor_tells_counts(browser, page, renderer):
    page.show(60)
    tab, _ = opened(browser, page)
    until(lambda: "frame 60," in tab.inner_text(".status"))
    image = tab.locator(".tile img").first
    size = image.bounding_box()
    image.hover(position={"x": size["width"] * (40.5 / 128), "y": size["height"] * (30.5 / 128)})
    counts = renderer.render([60], SENSORS[:1], "C").counts.numpy()[0, 0, 0]
    until(lambda: f"column 40, row 30: {counts[30, 40]} counts" in tab.inner_text(".tile"))
    tab.close()


def test_two_clients_see_the_same_and_one_may_leave(browser, page, renderer):
    first, _ = opened(browser, page)
    second, _ = opened(browser, page)
    for frame in (65, 66):
        page.show(frame)
        for tab in (first, second):
            until(lambda tab=tab, frame=frame: equal(greys(tab), expected(renderer, frame)))
    first.close()
    page.show(67)
    until(lambda: equal(greys(second), expected(renderer, 67)))
    second.close()
    with contextlib.suppress(Exception):
        first.close()


def test_a_recording_plays_from_a_file(browser, page, tmp_path):
    ws.record(page, tmp_path / "page.html", range(60, 66), fps=2.0)
    tab, asked, errors = browser.new_page(locale="en-US"), [], []
    tab.on("request", lambda request: asked.append(request.url))
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.goto((tmp_path / "page.html").as_uri())
    tab.wait_for_selector("canvas", timeout=60_000)
    seen = set()
    until(lambda: len(seen.add(tab.locator("input:visible").first.input_value()) or seen) > 3)  # its clock runs
    assert not errors and all(url.startswith(("file:", "data:", "blob:")) for url in asked)
    tab.close()
