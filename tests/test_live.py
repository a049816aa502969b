"""The page in the browser: what it is sent is what was rendered, and what it is asked for is what it shows."""

from __future__ import annotations

import base64
import io
import json
import re
import socket
import time
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from waiting import until

import warpsim as ws
from warpsim.cli import main
from warpsim.errors import InputError
from warpsim.labels.boxes import target_boxes
from warpsim.live import shown_images
from warpsim.live.access_bars import _words, access_bars, access_note
from warpsim.live.globe import _end_of_ray
from warpsim.live.page import Player, Status
from warpsim.live.run_images import FolderImages
from warpsim.live.shown_images import RenderedImages, images_of
from warpsim.live.sources import images_from
from warpsim.live.tile import _MERGED, _name, legend_html, png, tile_html
from warpsim.output.grey import grey
from warpsim.plot.coastlines import coastlines_deg

SENSORS, FRAME = ["sat11", "sat27"], 60


@pytest.fixture(scope="module")
def renderer(scene):
    return ws.Renderer(scene, "cpu")


class Parts(HTMLParser):
    """Attributes of the elements of a tile, by tag."""

    def __init__(self, text):
        super().__init__()
        self.found = {}
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.setdefault(tag, []).append(dict(attrs))


def picture_of(tile):
    source = tile.found["img"][0]["src"]
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(source.partition(",")[2]))))


def counts_of(tile):
    (data,) = [part for part in tile.found["div"] if "data-counts" in part]
    counts = np.frombuffer(base64.b64decode(data["data-counts"]), "<u2")
    return counts.reshape(int(data["data-h"]), int(data["data-w"])), json.loads(data["data-marks"])


def test_a_png_holds_the_grey_image():
    image = np.random.default_rng(1).integers(0, 256, (5, 300), dtype=np.uint8)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(png(image)))), image)


def test_a_tile_holds_the_rendered_counts_boxes_and_truth(renderer):
    frames = renderer.render([FRAME], SENSORS, "C")
    shown = RenderedImages(renderer).at(FRAME, SENSORS, "C")
    boxes = target_boxes(frames, shown_images.LEAST_BOX_PX)
    for number, image in enumerate(shown):
        tile = Parts(tile_html(image, 60.0, True, True))
        counts, marks = counts_of(tile)
        levels = frames.instrument.levels["C"]
        np.testing.assert_array_equal(counts, frames.counts.numpy()[0, number, 0])
        np.testing.assert_array_equal(picture_of(tile), grey(frames.counts.numpy()[0, number, 0], levels, 1024))
        rects = sorted(tile.found["rect"], key=lambda rect: renderer.scene.target_names.index(rect["data-target"]))
        names = [rect["data-target"] for rect in rects]
        visible = boxes.visible[number, 0]
        assert names == [name for name, seen in zip(frames.scenario.target_names, visible, strict=True) if seen]
        drawn = [[float(rect[key]) for key in ("x", "y", "width", "height")] for rect in rects]
        np.testing.assert_allclose(drawn, boxes.box_px[number, 0][visible], atol=6e-4)
        truth = frames.truth[(frames.truth["sensor"] == SENSORS[number])]
        for name, x_px, y_px, snr in marks:
            row = truth[truth["target"] == name][0]
            assert abs(row["x_px"] - x_px) < 0.006 and abs(row["y_px"] - y_px) < 0.006
            assert snr == f"{row['snr']:.3g}"


def test_a_tile_tells_the_main_target_and_which_merge(renderer):
    """In words: clumps of truth, the small ones first."""
    for image in RenderedImages(renderer).at(84, SENSORS, "A"):
        text = tile_html(image, 60.0, True, True)
        truth = renderer.truth([84], [image.sensor], "A")
        clumps = {}
        for row in truth[truth["in_fov"] & (truth["clump_id"] >= 0) & ~truth["resolvable"]]:
            clumps.setdefault(int(row["clump_id"]), []).append(str(row["target"]))
        lines = re.findall(r"<div>([^<>]*) merge in ([^<>]*)</div>", text)
        assert len(lines) == min(len(clumps), 3) and bool(lines) is (image.sensor == "sat11")
        for names, where in lines:
            assert re.split(", | and ", names) in clumps.values() and where == f"{image.sensor}, band A"
        assert ("more groups of targets that merge</div>" in text) is (len(clumps) > 4)
        assert [mark.target for mark in image.marks if mark.main] == ["center"]
        (main,) = [rect for rect in Parts(text).found["rect"] if rect["data-target"] == "center"]
        others = [rect for rect in Parts(text).found["rect"] if rect is not main and rect["data-target"] != "center"]
        assert main["stroke-width"] == "2" and {rect["stroke-width"] for rect in others} == {"1"}
        assert re.findall(r">([^<>]*)</text>", text) == ["center (main)"]  # of so many only this one
        red = {rect["data-target"] for rect in Parts(text).found["rect"] if rect["stroke"] == _MERGED}
        assert red == {name for names in clumps.values() for name in names}


def test_a_name_at_the_edge_stays_in_the_image():
    assert 'text-anchor="end"' in _name("center (main)", (120.0, 5.0), 128, 4.0, "#fff")
    assert 'text-anchor="end"' not in _name("center (main)", (60.0, 5.0), 128, 4.0, "#fff")


def test_the_legend_names_main_targets():
    assert "main target (center, bus)" in legend_html(["center", "bus"])
    assert "main target (a, b, c, ...)" in legend_html(["a", "b", "c", "d"])
    assert "main" not in legend_html([]) and "<b>" not in legend_html(["<b>"])


def test_without_overlay_and_counts_a_tile_has_neither(renderer):
    (image,) = RenderedImages(renderer).at(FRAME, SENSORS[:1], None)
    tile = Parts(tile_html(image, 60.0, False, False))
    assert "rect" not in tile.found and not any(part.get("data-counts") for part in tile.found["div"])
    assert image.band == "A"


def test_a_tile_does_not_run_what_names_hold(renderer):
    (image,) = RenderedImages(renderer).at(FRAME, SENSORS[:1], "A")
    evil = '"><script>alert(1)</script>'
    marked = shown_images.replace(image, sensor=evil, marks=[shown_images.replace(image.marks[0], target=evil)])
    tile = Parts(tile_html(marked, 60.0, True, True))
    assert "script" not in tile.found and counts_of(tile)[1][0][0] == evil


def test_the_part_about_the_targets_is_a_part(renderer):
    (image,) = RenderedImages(renderer).at(FRAME, SENSORS[:1], "A")
    part = image.about_targets()
    left, top = part.corner_px
    n_row, n_col = part.counts.shape
    assert n_row < 128 and n_col < 128
    np.testing.assert_array_equal(part.counts, image.counts[top : top + n_row, left : left + n_col])
    for mark, whole in zip(part.marks, image.marks, strict=True):
        assert (mark.x_px + left, mark.y_px + top) == pytest.approx((whole.x_px, whole.y_px))
        assert mark.box_px[0] + left == pytest.approx(whole.box_px[0])
        assert 0 <= mark.x_px < n_col and 0 <= mark.y_px < n_row


def test_merging_targets_are_those_of_truth(renderer):
    (image,) = RenderedImages(renderer).at(FRAME, SENSORS[:1], "A")
    truth = renderer.truth([FRAME], SENSORS[:1], "A")
    clumps = {}
    for row in truth:
        if row["clump_id"] >= 0:
            clumps.setdefault(int(row["clump_id"]), set()).add(str(row["target"]))
    assert {frozenset(c) for c in clumps.values() if len(c) > 1} == {frozenset(names) for names in image.merged}
    assert image.merged


def test_a_run_is_shown_as_it_was_written(renderer, scene, tmp_path):
    ws.render_to_folder(scene, tmp_path / "run", frames=range(60, 63), sensors=SENSORS, bands=["A", "C"], device="cpu")
    run = images_from(tmp_path / "run")
    assert isinstance(run, FolderImages) and run.sensors == SENSORS and list(run.frames("sat11")) == [60, 61, 62]
    for own, read in zip(RenderedImages(renderer).at(61, SENSORS, "C"), run.at(61, SENSORS, "C"), strict=True):
        np.testing.assert_array_equal(read.counts, own.counts)
        lit = {m.target: m for m in own.marks if 0 <= m.x_px < 128 and 0 <= m.y_px < 128}
        assert [m.target for m in read.marks] == list(lit)
        for mark in read.marks:
            same = lit[mark.target]
            assert mark.clump == same.clump
            assert (mark.x_px, mark.y_px, mark.snr) == pytest.approx((same.x_px, same.y_px, same.snr))
    assert run.at(70, SENSORS, "C") == [] and run.at(61, SENSORS, "E") == []


def test_a_folder_of_neither_is_refused(tmp_path):
    with pytest.raises(InputError, match="holds neither a run nor a data set"):
        images_from(tmp_path)


def test_access_bars_tell_when_access_ends(scene):
    bars = access_bars(scene.scenario, 600.0)
    rows = scene.access(sensors="sat27")
    for start_s, end_s in zip(rows["start_s"], rows["end_s"], strict=True):
        assert f"{start_s:.4g} to {end_s:.4g} s" in bars
    assert bars.count("<rect") == len(scene.access())


def test_access_bars_say_who_has_access_now_and_begin_with_those_shown(scene):
    bars = access_bars(scene.scenario, 840.0, ["sat27", "sat12"])
    texts = re.findall(r'<text[^>]*fill="([^"]*)">([^<]*)', bars)
    names = [word for _, word in texts if word.startswith("sat")]
    assert names[:2] == ["sat12", "sat27"] and len(names) == len(set(names)) == 10
    assert {word for colour, word in texts if colour == "#fff"} == {"sat12", "sat27", "230.6 to 1416 s"}
    rows = scene.access()
    n_now = int(((rows["start_s"] <= 840.0) & (rows["end_s"] >= 840.0)).sum())
    assert f": {n_now} sensors have it now" in bars and "18 of 28 sensors never have access" in bars


def test_long_lists_of_access_say_the_one_of_now_or_next():
    spans_s = [(0.0, 100.25), (1200.5, 1300.25), (1400.5, 1500.25)]
    for time_s, words in ((50.0, "0 to 100.2 s"), (500.0, "1200 to 1300 s"), (1600.0, "1400 to 1500 s")):
        assert _words(spans_s, time_s) == f"{words} and 2 more"
    assert _words(spans_s[:2], 50.0) == "0 to 100.2 s, 1200 to 1300 s"


def test_rays_end_on_the_ground_or_in_space():
    np.testing.assert_allclose(_end_of_ray(np.array([0, 0, 8.0]), np.array([0, 0, -1.0]), 3.0), [0, 0, 6.378137])
    np.testing.assert_allclose(_end_of_ray(np.array([0, 0, 8.0]), np.array([0, 0, -1.0]), 1.0), [0, 0, 7.0])
    np.testing.assert_allclose(_end_of_ray(np.array([0, 0, 8.0]), np.array([0, 0, 1.0]), 3.0), [0, 0, 11.0])


def test_coastlines_pass_where_coasts_are():
    lines = coastlines_deg()
    for lon_deg, lat_deg in ((-5.6, 36.0), (18.5, -34.3), (-67.3, -55.9), (142.0, 45.5)):  # Tarifa, the Capes, Soya
        apart = np.hypot((lines[:, 0] - lon_deg) * np.cos(np.radians(lat_deg)), lines[:, 1] - lat_deg)
        assert np.nanmin(apart) < 0.6
    steps = np.abs(np.diff(lines, axis=0))
    assert np.nanmax(steps) < 25  # no line across the map


@pytest.mark.ci
def test_the_page_shows_what_it_is_asked_for(renderer):
    with ws.view(renderer, port=0, sensors=SENSORS, band="C") as page:
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+", page.url)
        page.show(61)
        assert page.frame == 61 and page.time_s == 610.0
        expected = renderer.render([61], SENSORS, "C").counts.numpy()[0, :, 0]
        np.testing.assert_array_equal([image.counts for image in page.shown], expected)
        with pytest.raises(InputError, match=f"port: cannot be taken: address already in use, got {page.port}"):
            ws.view(renderer, port=page.port)
        frames = renderer.render(range(70, 73), SENSORS, ["A", "C"])
        page.offer(frames)
        assert until(lambda: page.frame == 72) and page.n_dropped == 2
        np.testing.assert_array_equal([image.counts for image in page.shown], frames.counts.numpy()[2, :, 1])
    with socket.socket() as probe:  # the port is free again
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", page.port))


def test_images_of_a_stream_are_those_rendered(renderer):
    frames = renderer.render([60, 64], SENSORS, ["A", "C"])
    own = images_of(frames, 1, "C")
    for image, alone in zip(own, RenderedImages(renderer).at(64, SENSORS, "C"), strict=True):
        np.testing.assert_array_equal(image.counts, alone.counts)
        assert image.marks == alone.marks


def test_bad_names_are_refused_before_the_page_opens(renderer):
    with pytest.raises(InputError, match="band: must be one of A, C, E"):
        ws.view(renderer, port=0, band="Q")
    with pytest.raises(InputError, match="sat99"):
        ws.view(renderer, port=0, sensors="sat99")
    with pytest.raises(InputError, match="port: must be in 0 to 65535"):
        ws.view(renderer, port=70000)


def test_without_viser_the_extra_is_named(renderer, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match="the extra `live` brings"):
        ws.view(renderer, port=0)


@pytest.mark.ci
def test_recordings_hold_the_images(renderer, tmp_path):
    with ws.view(renderer, port=0, sensors=SENSORS) as page:
        ws.record(page, tmp_path / "page.gif", [60, 62])
        ws.record(page, tmp_path / "page.html", [60, 62])
        for path, frames, message in (
            ("page.gif", [60], "is there already"),
            ("page.txt", [60], "must end in one of .html, .mp4, .gif"),
            ("new.gif", [], "must be one or more"),
        ):
            with pytest.raises(InputError, match=message):
                ws.record(page, tmp_path / path, frames)
    with Image.open(tmp_path / "page.gif") as film:
        assert film.n_frames == 2 and film.size == (520, 260)
    text = (tmp_path / "page.html").read_text()
    assert text.lstrip().startswith("<!") and "http-equiv" not in text
    assert not list(tmp_path.glob("*.partial*"))


@pytest.mark.ci
def test_a_recording_is_as_large_as_the_guide_says_and_the_command_tells_its_size(tmp_path, capsys):
    """Some 40 kB a frame of two sensors of 128 x 128 pixels."""
    size = {}
    for n in (2, 10):
        path = tmp_path / f"{n}.html"
        frames = f"60:{60 + n}"
        assert main(["view", "stss", "--sensors", "sat11,sat27", "--frames", frames, "--record", str(path)]) == 0
        size[n] = path.stat().st_size
        assert capsys.readouterr().out == f"{path}: {n} frames, {size[n] / 1e6:.3g} MB\n"
    assert 25e3 < (size[10] - size[2]) / 8 < 60e3


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--fps", "20"], "--fps: goes with --record alone"),
        (["--frames", "60:64"], "--frames: goes with --record alone"),
        (["--overwrite"], "--overwrite: goes with --record alone"),
        (["--follow", "tcp://127.0.0.1:5999", "--record", "a.gif"], "--follow: must not come with --record: "),
    ],
)
def test_options_that_would_do_nothing_are_refused(options, text, capsys):
    assert main(["view", "stss", *options]) == 2
    assert capsys.readouterr().err.startswith(f"warpsim: {text}")


@pytest.mark.ci
def test_a_page_follows_a_server(renderer):
    pytest.importorskip("zmq")
    from warpsim.live.follow import Follower

    frames = range(60, 64)
    with ws.view(renderer, port=0, sensors=SENSORS, band="C") as page:
        server = ws.FrameServer(
            renderer, frames, SENSORS, ["A", "C"], rate_hz=4.0, address="tcp://127.0.0.1:*", wait_for=1, late="send"
        )
        with server, Follower(page, server.address):
            server.run()
            assert until(lambda: page.frame == frames[-1])
        expected = renderer.render(frames[-1:], SENSORS, "C").counts.numpy()[0, :, 0]
        np.testing.assert_array_equal([image.counts for image in page.shown], expected)
        assert all(image.marks for image in page.shown)
        with pytest.raises(InputError, match="follow: must be an address such as tcp://HOST:PORT"):
            Follower(page, "nowhere")


def lives(page, frame):
    """Whether the page shows a frame that it is asked for, by its thread."""
    page._player.ask(frame)
    return until(lambda: page.frame == frame) and page._player._thread.is_alive()


@pytest.mark.ci
def test_the_page_lives_on_after_what_goes_wrong(renderer):
    with ws.view(renderer, port=0, sensors=SENSORS, band="C") as page:
        page._player.ask(10**6)
        assert until(lambda: page.status.notes.get("frame")) and page.frame < 10**6
        assert lives(page, 61) and until(lambda: not page.status.notes["frame"])
        page.offer_images(3, lambda band: 1 / 0)
        assert until(lambda: "division" in page.status.notes["frame"])
        page._controls.sensors.value = "nosuch"
        assert until(lambda: "nosuch" in page.status.notes["sensors"])
        page._controls.sensors.value = "sat27"
        assert until(lambda: page.sensors == ["sat27"] and not page.status.notes["sensors"])
        page._controls.sensors.value = ""
        assert lives(page, 62) and page.shown == []
        with pytest.raises(InputError, match="frame"):
            page.show(10**6)
        assert page.frame == 62


@pytest.mark.ci
def test_playing_goes_on_in_time_from_the_frame_that_shows(renderer):
    with ws.view(renderer, port=0, sensors=SENSORS) as page:
        page.show(60)
        time.sleep(0.5)  # the thread of the page waits
        page._controls.speed.value = 100.0  # of frames each 10 s: 10 a second
        begin = time.perf_counter()
        page._press("play")
        assert until(lambda: page.frame > 60)
        while page.frame < 75:
            latest = 60 + 10 * (time.perf_counter() - begin) + 1
            assert page.frame <= latest
            time.sleep(0.02)
        page._controls.moving.value = False
        time.sleep(0.5)
        still = page._globe._nodes["kind0"].points
        time.sleep(0.5)
        assert page._globe._nodes["kind0"].points is still
        page._press("pause")
        time.sleep(0.5)
        stopped = page.frame
        place = page.scenario.position_m("center", np.array([page.time_s]))[0] / 1e6
        assert until(lambda: np.allclose(page._globe._nodes["kind0"].points, place, atol=1e-6))
        time.sleep(0.5)
        assert page.frame == stopped < page.frames[-1]
        page._press("step")
        assert until(lambda: page.frame == stopped + 1)


@pytest.mark.ci
def test_all_groups_of_a_scene_can_be_looked_at():
    """Targets of the second launch: bodies, curve, boxes and main target; rocket bodies in orbits have no main one."""
    renderer = ws.Renderer(ws.Scene.load("two_cameras"), "cpu")
    with ws.view(renderer, port=0, sensors=["sat61.narrow"], band="A") as page:
        controls = page._controls
        assert controls.group.options == ("first", "second", "orbiting") and controls.group.visible
        page.show(80)
        assert {mark.target: mark.main for mark in page.shown[0].marks}["bus"] is True
        controls.view.value = "group"
        controls.group.value = "second"
        assert until(lambda: controls.chosen_group == 1 and 1 in page._groups._views)
        view = page._groups._views[1]
        assert until(lambda: view.root.visible and view._text.text.startswith("about bus; axes"))
        assert not page._globe.root.visible
        controls.curves.target.value = "bus"
        alone = ws.light_curves(renderer.scene, [800.0], ["sat61.narrow"], ["bus"], ["A"]).snr[0, 0, 0, 0]
        assert until(lambda: "bus" in controls.curves._plot.title)
        assert until(lambda: np.nanmax(controls.curves._plot.data[-1]) == pytest.approx(alone, rel=0.05))
        controls.group.value = "orbiting"
        assert until(lambda: 2 in page._groups._views and page._groups._views[2]._text.text.startswith("about RB-A"))
        assert until(lambda: not view.root.visible)
        controls.view.value = "Earth"
        assert until(lambda: page._globe.root.visible and not page._groups._views[2].root.visible)


@pytest.mark.ci
def test_a_page_of_two_kinds_without_a_sensor_lives():
    with ws.view(ws.Renderer(ws.Scene.load("two_cameras"), "cpu"), port=0) as page:
        page._controls.sensors.value = ""
        assert until(lambda: page.sensors == []) and lives(page, 5)


def test_an_image_without_access_says_until_when(renderer):
    with ws.view(renderer, port=0, sensors=["sat27"]) as page:
        for frame, note in (
            (10, "no access: first at 295 s"),
            (60, "access until 771.6 s"),
            (84, "no access: lost at 771.6 s, again at 1162 s"),
            (155, "no access: lost at 1438 s, not again"),
        ):
            page.show(frame)
            assert access_note(page.scenario, "sat27", page.time_s) == (note, frame == 60)
            assert f">{note}</span>" in page._tiles[0].content


def test_ports_are_whole_numbers(renderer):
    for port in (1.5, "x", None, True):
        with pytest.raises(InputError, match="port: must be"):
            ws.view(renderer, port=port)


def test_what_is_nothing_to_show_is_refused():
    with pytest.raises(InputError, match="nowhere: must be a preset, a scene file, or the folder"):
        images_from("nowhere")


def test_damaged_packets_are_dropped():
    import zlib

    from warpsim.live.follow import _image_of
    from warpsim.serving.packet import HEADER, MAGIC

    def packet(**changes):
        header, payload = np.zeros(1, HEADER), np.arange(4, dtype="<u2").tobytes()
        fields = {"magic": MAGIC, "n_row": 2, "n_col": 2, "sensor_name": b"sat11", "band_name": b"A"} | changes
        for name, value in ({"payload_crc32": zlib.crc32(payload)} | fields).items():
            header[name] = value
        header["header_crc32"] = zlib.crc32(header.tobytes()[: HEADER.itemsize - 4])
        return header.tobytes() + payload

    header, name, counts = _image_of([b"frame/x", packet()])
    assert name == ("sat11", "A") and counts.tolist() == [[0, 1], [2, 3]] and header["n_row"] == 2
    for message in (
        [b"frame/x"],
        [b"frame/x", packet()[:10]],
        [b"frame/x", packet()[:-1]],
        [b"frame/x", packet(n_row=5)],
        [b"frame/x", packet(magic=b"OTHER")],
        [b"frame/x", packet(payload_crc32=1)],
        [b"frame/x", b"\0" + packet()[1:]],
    ):
        assert _image_of(message) is None


def playing_on(frames, frames_per_s=0.0, fails=()):
    """A player and its page; frames that fail are not shown."""
    page = SimpleNamespace(frame=frames[0], frames=list(frames), status=Status(), seen=[])

    def show(frame, images):
        page.seen.append((frame, images))
        if frame not in fails:
            page.frame = frame

    return Player(page, show, lambda: frames_per_s), page


def test_what_is_asked_for_is_shown_once_and_failures_are_not_tried_again():
    player, page = playing_on(range(10), fails=[7])
    player.start()
    player.ask(3)
    assert until(lambda: page.frame == 3)
    player.ask(7)
    assert until(lambda: (7, None) in page.seen and player.wanted == 3)
    player.ask_again()
    assert until(lambda: len(page.seen) == 3)
    time.sleep(0.05)
    assert page.seen == [(3, None), (7, None), (3, None)] and player._thread.is_alive()
    player.stop()
    assert not player._thread.is_alive()


def test_playing_drops_frames_and_ends_with_the_last():
    player, page = playing_on(range(100, 200), frames_per_s=2000.0, fails=[199])
    player.playing = True
    player.start()
    assert until(lambda: not player.playing)
    player.stop()
    shown = [frame for frame, _ in page.seen]
    assert shown == sorted(set(shown)) and shown[-1] == page.frame == 199
    assert page.status.n_dropped == 99 - len(shown)


def test_of_what_is_offered_the_last_is_shown():
    player, page = playing_on(range(10))
    for frame in (1, 2, 5):
        player.offer(frame, str(frame))  # stands for the function of the images
    player.start()
    assert until(lambda: page.seen)
    player.stop()
    assert page.seen == [(5, "5")] and page.status.n_dropped == 2 and player.wanted == 5
