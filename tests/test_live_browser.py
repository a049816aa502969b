"""The page in a real browser without a display: `pip install playwright` and chromium, or WARPSIM_CHROMIUM=its path."""

from __future__ import annotations

import base64
import contextlib
import io
import os
import shutil

import numpy as np
import pytest
from PIL import Image
from waiting import until

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
        assert until(lambda frame=frame: f"frame {frame}," in tab.inner_text(".status"))
        assert until(lambda frame=frame: equal(greys(tab), expected(renderer, frame)))
    assert asked and all(url.startswith((page.url, "data:", "blob:")) for url in asked)
    tab.close()


def test_boxes_lie_on_the_light(browser, page, renderer):
    page.show(60)
    tab, _ = opened(browser, page)
    assert until(lambda: "frame 60," in tab.inner_text(".status"))
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
    assert until(lambda: "frame 60," in tab.inner_text(".status"))
    image = tab.locator(".tile img").first
    size = image.bounding_box()
    image.hover(position={"x": size["width"] * (40.5 / 128), "y": size["height"] * (30.5 / 128)})
    counts = renderer.render([60], SENSORS[:1], "C").counts.numpy()[0, 0, 0]
    assert until(lambda: f"column 40, row 30: {counts[30, 40]} counts" in tab.inner_text(".tile"))
    tab.close()


def test_two_clients_see_the_same_and_one_may_leave(browser, page, renderer):
    first, _ = opened(browser, page)
    second, _ = opened(browser, page)
    for frame in (65, 66):
        page.show(frame)
        for tab in (first, second):
            assert until(lambda tab=tab, frame=frame: equal(greys(tab), expected(renderer, frame)))
    first.close()
    page.show(67)
    assert until(lambda: equal(greys(second), expected(renderer, 67)))
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
    assert until(lambda: len(seen.add(tab.locator("input:visible").first.input_value()) or seen) > 3)  # its clock runs
    assert not errors and all(url.startswith(("file:", "data:", "blob:")) for url in asked)
    tab.close()


def field(tab, label):
    """The input beside a label."""
    return tab.locator(f"xpath=//label[normalize-space(.)='{label}']/following::input[not(@type='hidden')][1]")


def choose(tab, label, option):
    """Take one of the names of a field."""
    field(tab, label).click()
    tab.get_by_role("option", name=option, exact=True).click()


def test_typed_numbers_and_chosen_names_change_the_images(browser, renderer, scene):
    """Letter by letter, as people type; what the scene refuses is said, and the image stays."""
    with ws.view(renderer, port=0, sensors=SENSORS, band="C") as own:
        tab, _ = opened(browser, own)
        own.show(60)
        tab.get_by_text("Scene", exact=True).click()
        steps = [
            ("field of view [deg]", "2.5", {"camera__fov_deg": 2.5}),
            ("exposure [s]", "0.5", {"detector__exposure_s": 0.5}),
            ("NEI [W/cm2]", "4e-18", {"detector__nei_w_cm2": 4e-18}),
            ("PSF", "gaussian", {"optics__psf": "gaussian"}),
            ("sigma [px]", "1.75", {"optics__sigma_px": 1.75}),
            ("pointed at", "cone03", {"pointing__0__track": "cone03"}),
            ("seed", "7", {"seed": 7}),
        ]
        changed = {}
        for label, typed, change in steps:
            if label in ("PSF", "pointed at"):
                choose(tab, label, typed)
            else:
                field(tab, label).fill("")
                field(tab, label).press_sequentially(typed, delay=80)
            changed |= change
            wanted = expected(ws.Renderer(scene.replace(**changed), "cpu"), 60)
            assert until(lambda wanted=wanted: equal(greys(tab), wanted))
            assert "as before" not in tab.inner_text(".status") and field(tab, label).input_value() == typed
        for label, typed, words in (
            ("field of view [deg]", "200", "fov_deg: must be"),
            ("NEI [W/cm2]", "none", "nei_w_cm2: must be"),
        ):
            before = field(tab, label).input_value()
            field(tab, label).fill(typed)
            assert until(lambda words=words: words in tab.inner_text(".status"))
            assert "; the scene is as before" in tab.inner_text(".status") and equal(greys(tab), wanted)
            field(tab, label).fill(before)
            assert until(lambda: "as before" not in tab.inner_text(".status"))
        tab.close()


def test_words_of_the_page_tell_access_main_and_merging_targets(browser, page, renderer):
    page.show(84)
    tab, _ = opened(browser, page)
    assert until(lambda: "frame 84," in tab.inner_text(".status"))
    assert until(lambda: "no access: lost at 771.6 s, again at 1162 s" in tab.locator(".tile").nth(1).inner_text())
    first = tab.locator(".tile").first
    assert "access until 1422 s" in first.inner_text() and "main target (center)" in tab.inner_text(".legend")
    assert "295 to 771.6 s, 1162 to 1438 s" in tab.text_content(
        ".access"
    ) and "5 sensors have it now" in tab.inner_text(".access")
    truth = renderer.truth([84], SENSORS[:1], "C")
    clumps = {}
    for row in truth[truth["in_fov"] & ~truth["resolvable"] & (truth["clump_id"] >= 0)]:
        clumps.setdefault(int(row["clump_id"]), []).append(str(row["target"]))
    a, b = next(names for names in clumps.values() if len(names) == 2)
    assert f"{a} and {b} merge in sat11, band C" in first.inner_text()
    (word,) = first.locator("svg text").all_text_contents()
    assert word == "center (main)"
    tab.close()


def test_any_group_is_chosen_by_its_name(browser):
    with ws.view(ws.Renderer(ws.Scene.load("two_cameras"), "cpu"), port=0, sensors=["sat61.narrow"]) as own:
        own.show(80)
        tab, _ = opened(browser, own)
        choose(tab, "show", "group")
        for group, middle in (("second", "bus"), ("orbiting", "RB-A"), ("first", "center")):
            if group != field(tab, "group").input_value():
                choose(tab, "group", group)
            assert until(lambda middle=middle: own._groups._views.get(own._controls.chosen_group) is not None)
            assert until(lambda middle=middle: f"about {middle}; axes" in shown_group(own)._text.text)
            assert shown_group(own).root.visible
        tab.close()


def shown_group(page):
    return page._groups._views[page._controls.chosen_group]


def test_a_client_that_disappears_leaves_the_others_alone(browser, page, renderer):
    """Its process ends, while the page plays to it: it closes nothing."""
    gone, _ = opened(browser, page)
    stays, _ = opened(browser, page)
    page.show(60)
    page._controls.speed.value = 50.0
    page._press("play")
    assert until(lambda: page.frame > 62)
    with contextlib.suppress(Exception):
        gone.goto("chrome://crash", timeout=5000)
    at = page.frame
    assert until(lambda: page.frame > at + 3)
    page._press("pause")
    page.show(66)
    assert until(lambda: equal(greys(stays), expected(renderer, 66)))
    assert page._player._thread.is_alive() and not page.status.notes["frame"]
    stays.close()
    with contextlib.suppress(Exception):
        gone.close()
