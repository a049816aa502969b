"""The page that opens a CZML file: what it loads, and that it shows the scene in CesiumJS where there is one.

The check in a browser needs playwright, chromium (or WARPSIM_CHROMIUM=its path) and WARPSIM_CESIUM, a folder that holds
Cesium.js (`npm install cesium`: node_modules/cesium/Build/Cesium).
"""

from __future__ import annotations

import functools
import http.server
import os
import re
import shutil
import threading
from pathlib import Path

import numpy as np
import pytest

import warpsim as ws
from warpsim.orbit.earth import itrs_to_gcrs
from warpsim.output.czml_targets import ERROR_RAD
from warpsim.quaternion import conjugate, from_matrix, product, rotation_between_rad

pytest.importorskip("czml3")

CHROMIUM = os.environ.get("WARPSIM_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
CESIUM = os.environ.get("WARPSIM_CESIUM", "")
FLAGS = "--no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader --ignore-gpu-blocklist"
POSITION_ATOL_M = 50.0  # UT1 - UTC turns Cesium's frame by 3.4e-6 rad here, 25 m; 0.35 deg without precession is 40 km
FRAME_ATOL_RAD = 1e-5


def addresses(text):
    """What a page links to or runs, and every URL in it."""
    return re.findall(r'(?:src|href)="([^"]*)"', text), set(re.findall(r"https?://[^\s\"'`<]+", text))


@pytest.fixture
def cesium(tmp_path):
    folder = tmp_path / "my cesium"
    folder.mkdir()
    (folder / "Cesium.js").write_text("")
    return folder


def test_a_page_without_cesium_loads_nothing_and_says_how_to_give_it(scene, tmp_path):
    ws.write_czml(scene, tmp_path / "a.czml", html=tmp_path / "a.html")
    text = (tmp_path / "a.html").read_text("utf-8")
    assert addresses(text) == ([], set())
    assert "<script" not in text
    assert "--cesium" in text and "<title>stss</title>" in text


@pytest.mark.parametrize("url", ["http://[::1]:8000/Cesium", "HTTPS://example.org/Cesium/"])
def test_urls_of_cesium_stay_as_they_are(scene, tmp_path, url):
    ws.write_czml(scene, tmp_path / "a.czml", html=tmp_path / "a.html", cesium=url)
    assert f'src="{url.rstrip("/")}/Cesium.js"' in (tmp_path / "a.html").read_text("utf-8")


def test_a_page_links_to_the_cesium_that_is_given_and_to_nothing_else(scene, tmp_path, cesium):
    (tmp_path / "pages").mkdir()
    page = tmp_path / "pages" / "a.html"
    ws.write_czml(scene, tmp_path / "it's <mine>.czml", html=page, cesium=cesium)
    text = page.read_text("utf-8")
    base = "../my%20cesium/"
    assert addresses(text) == ([f"{base}Widgets/widgets.css", f"{base}Cesium.js"], {"http://localhost:8000"})
    assert '"../it%27s%20%3Cmine%3E.czml"' in text
    ws.write_czml(
        scene, tmp_path / "a.czml", html=page, cesium="https://example.org/a b/Cesium", overwrite=True
    )  # fmt: skip
    linked, urls = addresses(page.read_text("utf-8"))
    base = "https://example.org/a%20b/Cesium/"
    assert linked == [f"{base}Widgets/widgets.css", f"{base}Cesium.js"]
    assert {url for url in urls if not url.startswith(base)} == {"http://localhost:8000"}


def test_words_of_a_scene_do_not_become_a_page(scene, tmp_path):
    hostile = scene.replace(name='</title><script>alert("x")</script>')
    ws.write_czml(hostile, tmp_path / "a.czml", html=tmp_path / "a.html", cesium='https://x/"><script>y</script>')
    text = (tmp_path / "a.html").read_text("utf-8")
    assert "alert(" in text and "<script>alert" not in text and "<script>y" not in text


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"html": "a.htm"}, r"a\.htm: must end in \.html$"),
        ({"html": "there.html"}, "there.html: is there already"),
        (
            {"html": "a.html", "cesium": "there"},
            "^cesium: must be a URL .* a folder that holds Cesium.js, got 'there'$",
        ),
        ({"html": "a.html", "cesium": "ftp://x/Cesium"}, "^cesium: must be a URL"),
        ({"cesium": "https://x/Cesium"}, "^cesium: serves the page alone"),
        ({"html": "a.html", "cesium": "https://x/b?c=d"}, "^cesium: must be the URL of a folder, without a query"),
        ({"html": "a.html", "cesium": 3}, "^cesium: must be a URL or a folder, got 3"),
    ],
)
def test_bad_pages_are_refused_before_anything_is_written(scene, tmp_path, monkeypatch, more, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.html").write_text("mine")
    (tmp_path / "there").mkdir()
    with pytest.raises(ws.InputError, match=message) as caught:
        ws.write_czml(scene, "a.czml", **more)
    assert "\n" not in str(caught.value)
    assert {path.name for path in tmp_path.iterdir()} == {"there.html", "there"}
    assert (tmp_path / "there.html").read_text() == "mine"


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture
def served(tmp_path):
    """URL of a server of a folder, on this machine alone."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(tmp_path)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


IN_CESIUM = """([sensor, band, times]) => {
  const data = viewer.dataSources.get(0), body = data.entities.getById("cylinder01");
  const list = (q, n) => ["x", "y", "z", "w"].slice(0, n).map((name) => q[name]);
  return times.map((time) => {
    const at = Cesium.JulianDate.addSeconds(data.clock.startTime, time, new Cesium.JulianDate());
    const fixed = Cesium.Transforms.computeIcrfToFixedMatrix(at);
    return [list(body.orientation.getValue(at), 4), list(body.position.getValue(at), 3),
      body.properties["irradiance_w_cm2/" + sensor + "/" + band].getValue(at), Cesium.Matrix3.toArray(fixed)];
  });
}"""


@pytest.mark.ci
@pytest.mark.skipif(CHROMIUM is None or not CESIUM, reason="no chromium, or no WARPSIM_CESIUM")
def test_cesium_shows_what_the_scene_says(scene, tmp_path, served):
    playwright = pytest.importorskip("playwright.sync_api")
    shutil.copytree(Path(CESIUM), tmp_path / "cesium")
    ws.write_czml(
        scene, tmp_path / "a.czml", attitudes="cylinder01", curves="cylinder01", html=tmp_path / "a.html",
        cesium=tmp_path / "cesium",
    )  # fmt: skip
    times, asked = [300.0, 617.123, 807.3, 1200.0], []
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS.split())
        tab = browser.new_page()
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(f"{served}/a.html")
        tab.wait_for_function("window.viewer || !document.getElementById('words').textContent.startsWith('Loading')",
                              timeout=120_000)  # fmt: skip
        assert tab.inner_text("#words") == ""
        found = tab.evaluate(IN_CESIUM, ["sat11", "A", times])
        browser.close()
    assert all(url.startswith((served, "blob:", "data:")) for url in asked)
    scenario = scene.scenario
    attitude = scenario.attitudes[scene.target_names.index("cylinder01")]
    light = ws.light_curves(scene, times, ["sat11"], ["cylinder01"], ["A"]).irradiance_w_cm2.ravel()
    to_gcrs = itrs_to_gcrs(scenario.epoch, np.array(times))
    for number, (quaternion, position_m, w_cm2, fixed) in enumerate(found):
        own = attitude.at([times[number]])[0]
        expected = product(conjugate(from_matrix(to_gcrs[number])), own)
        assert rotation_between_rad(quaternion, expected) < ERROR_RAD
        cesiums = product(from_matrix(np.reshape(fixed, (3, 3)).T), own)
        assert rotation_between_rad(expected, cesiums) < FRAME_ATOL_RAD
        at_m = to_gcrs[number].T @ scene.position_m("cylinder01", times[number])[0]
        assert np.linalg.norm(position_m - at_m) < POSITION_ATOL_M
        if times[number] % 10 == 0:
            assert w_cm2 == pytest.approx(light[number], rel=6e-6)
