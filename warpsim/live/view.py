"""The page: what it shows of a frame."""

from __future__ import annotations

import contextlib
import html
import io
import itertools
import threading
import time
from collections.abc import Sequence
from typing import Any, Self

from warpsim.errors import InputError, one_line
from warpsim.instant import utc_dates
from warpsim.live.access_bars import access_bars, access_note
from warpsim.live.controls import EARTH, Controls, first_frame
from warpsim.live.globe import GlobeScene, camera_of_earth
from warpsim.live.group_view import CAMERA_OF_GROUP, Groups
from warpsim.live.page import ImagesOfBand, Player, Status, Watch, open_server
from warpsim.live.run_images import GrowingImages
from warpsim.live.scene_controls import SceneControls, changed_scene
from warpsim.live.shown_images import ImageSource, RenderedImages, ShownImage, images_of, main_targets
from warpsim.live.tile import legend_html, tile_html
from warpsim.render.frameset import FrameSet
from warpsim.render.renderer import Renderer
from warpsim.scene.scene import Scene

PORT = 8080
"""Of the page."""

MOST_TILES = 6
"""Sensors whose images are shown at first."""

MOST_SHOWN = 12
"""Sensors whose images have room on the page."""

_COUNTS_PX, _PLAYED_PX = 512 * 512, 256 * 256  # larger images travel without their counts, at rest and playing


class View:
    """A page at http://127.0.0.1:PORT that shows a scene at one instant, or plays it; all clients see the same.

    A context, which closes the page at its end.

    Args:
        images: Where images come from.
        port: TCP port; 0 chooses a free one.
        sensors: Sensors whose images are shown; the first few that have access when left out.
        band: Band that is shown; the first one of each sensor when left out.

    Raises:
        InputError: viser (extra `live`) is not installed, the port is in use, or an unknown sensor or band.
    """

    def __init__(
        self, images: ImageSource, port: int = PORT, sensors: str | Sequence[str] | None = None, band: str | None = None
    ) -> None:
        self.images, self.scenario = images, images.scenario
        chosen = images.sensors[:MOST_TILES] if sensors is None else self.scenario.select_sensors(sensors)
        if band is not None and band not in self.scenario.bands:
            raise InputError(f"must be one of {', '.join(self.scenario.bands)}", "band", band)
        self.server, self.port = open_server(port)
        self.url = f"http://127.0.0.1:{self.port}"
        self.shown: list[ShownImage] = []
        """Images of the frame that the page shows."""
        self.frame = -1
        """Number of the frame that the page shows."""
        self.status = Status()
        """How the page keeps up, and problems."""
        self.sensors = list(chosen)
        """Sensors whose images are shown."""
        self._lock = threading.RLock()
        self._watch: Watch | None = None
        self._player = Player(self, self._try_to_show, self._frames_per_s)
        self._set_up(band)
        self.show(int(self._controls.slider.value))
        self._player.start()

    def _set_up(self, band: str | None) -> None:
        """Lay out the page."""
        server, scenario = self.server, self.scenario
        server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, control_width="large")
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(False)
        server.initial_camera.position = camera_of_earth(scenario)
        self._globe = GlobeScene(server.scene, scenario, self.sensors)
        self._groups = Groups(server.scene, scenario)
        frames = self.frames = self._frames_there()
        begin = first_frame(scenario, self.sensors, frames)
        controls = self._controls = Controls(server.gui, scenario, self.sensors, (frames[0], frames[-1], begin))
        if band is not None:
            controls.band.value = band
        controls.slider.on_update(self._moved)
        controls.buttons.on_click(lambda _: self._press(controls.buttons.value))
        for choice in (controls.view, controls.group):
            choice.on_update(lambda _: self._look_at())
        controls.when_changed(self._player.ask_again, self._draw_curve)
        self._draw_curve()
        self._scene_controls: SceneControls | None = None
        if isinstance(self.images, RenderedImages):
            kind = scenario.instrument_of((self.sensors or scenario.sensor_names)[0]).sensor.name
            self._scene_controls = SceneControls(server.gui, scenario, kind, self._change)
        panel = server.gui.add_panel()
        with panel.add_tab("Images"):
            server.gui.add_html(legend_html(main_targets(scenario)))
            self._tiles = [server.gui.add_html("") for _ in range(max(len(self.sensors), MOST_SHOWN))]
        panel.dock_left()
        panel.set_width(330)
        server.gui.main_panel.dock_right()

    def _frames_there(self) -> list[int]:
        """Numbers of the frames that there are images of."""
        return sorted({frame for sensor in self.sensors for frame in self.images.frames(sensor)} or {0})

    @property
    def n_dropped(self) -> int:
        """Frames that were not shown, as the page could not keep up."""
        return self.status.n_dropped

    @property
    def time_s(self) -> float:
        """Time of the frame that the page shows, after the epoch [s]."""
        instruments = self.scenario.instruments
        kind = self.scenario.instrument_of(self.sensors[0]) if self.sensors else next(iter(instruments.values()))
        return float(kind.frame_time_s([max(self.frame, 0)])[0])

    def show(self, frame: int) -> None:
        """Show a frame; returns when the page was sent what there is to see.

        Raises:
            InputError: There is no such frame.
        """
        self._check(frame)
        self._player.wanted = frame
        self._show(frame)

    def _check(self, frame: int) -> None:
        if not self.frames[0] <= frame <= self.frames[-1]:
            raise InputError(f"must be in {self.frames[0]} to {self.frames[-1]}", "frame", frame)

    def offer(self, frames: FrameSet) -> None:
        """Give the page rendered frames, of which it shows the last one when it has time; returns at once.

        For a loop over `Renderer.stream(...)`: the page takes little of the time of the one who renders
        (`MOST_LOAD`), and counts the frames that it did not show.
        """
        self.status.n_dropped += len(frames.frames) - 1

        def last(band: str | None) -> list[ShownImage]:
            return images_of(frames, len(frames.frames) - 1, band if band in frames.bands else frames.bands[0])

        self.offer_images(frames.frames[-1], last)

    def offer_images(self, frame: int, images: ImagesOfBand) -> None:
        """Give the page the images of a frame as a function of the band that it shows; as `offer`."""
        self._player.offer(frame, images)

    def _try_to_show(self, frame: int, images: ImagesOfBand | None) -> None:
        """Show a frame, or images of it that were offered; what goes wrong stands on the page, which lives on."""
        try:
            self._show(frame, images)
            self.note("frame", "")
        except Exception as error:  # a file that is gone, a packet of another scene
            self.note("frame", one_line(error))

    def _show(self, frame: int, offered: ImagesOfBand | None = None) -> None:
        """Send the images of a frame, or those that were offered of it, and move what there is in three dimensions."""
        controls = self._controls
        with self._lock:
            begin_s, before = time.perf_counter(), self.frame
            if offered is None:
                self._check(frame)
                self._update_sensors()
                self.shown = self.images.at(frame, self.sensors, controls.chosen_band)
            else:
                by_sensor = {image.sensor: image for image in offered(controls.chosen_band)}
                self.shown = [by_sensor[sensor] for sensor in self.sensors if sensor in by_sensor]
            self.frame = frame
            try:
                self._send(self.time_s)
            except Exception:
                self.frame = before
                raise
            if int(controls.slider.value) != frame:
                controls.slider.value = frame
            self.status.shown(begin_s)
            self._tell()

    def _send(self, time_s: float) -> None:
        """Send what there is to see at the time of the frame."""
        controls, images = self._controls, {image.sensor: image for image in self.shown}
        with self.server.atomic():
            for tile, sensor in itertools.zip_longest(self._tiles, self.sensors):
                tile.content = "" if sensor is None else self._tile(sensor, images.get(sensor))
            if controls.moving.value or not self._player.playing:
                group = controls.chosen_group
                if group is None:
                    self._globe.show(time_s)
                else:
                    self._groups.show(group, time_s)
            controls.curves.show(time_s)
            controls.access.content = access_bars(self.scenario, time_s, self.sensors)

    def _tile(self, sensor: str, image: ShownImage | None) -> str:
        if image is None:
            return f"<div>{html.escape(sensor)}: no image</div>"
        controls = self._controls
        with_counts = image.counts.size <= (_PLAYED_PX if self._player.playing else _COUNTS_PX)
        note = access_note(self.scenario, sensor, self.time_s)
        image = image.about_targets() if controls.crop.value else image
        return tile_html(image, controls.ceiling.value, controls.overlay.value, with_counts, note)

    def note(self, of: str, note: str) -> None:
        """Let the line of status say something of one of its subjects; nothing for an empty text."""
        if note != self.status.notes[of]:
            self.status.notes[of] = note
            self._tell()

    def watch(self) -> None:
        """Grow from now on with a run that is still being rendered; nothing for other images."""
        if self._watch is None and isinstance(self.images, GrowingImages):
            self._watch = Watch(self, self.images)

    def grow(self, newest: int | None, before: int) -> None:
        """Take the frames that there are images of by now.

        Args:
            newest: Number of the frame that came last, which is shown if the page stands still at the one before.
            before: Number of that one.
        """
        with self._lock:
            frames, slider = self._frames_there(), self._controls.slider
            self.frames = frames
            slider.min, slider.max = frames[0], max(frames[-1], frames[0] + 1)
        if newest is not None and not self._player.playing and self.frame == self._player.wanted == before:
            if newest == before:
                self._player.ask_again()
            else:
                self._player.ask(newest)

    def _tell(self) -> None:
        """Bring the line of status up to date."""
        date = utc_dates(self.scenario.scene.epoch_utc, [self.time_s])[0]
        self._controls.status.content = self.status.html(self.frame, self.time_s, date)

    def _update_sensors(self) -> None:
        """Take other sensors where the page asks for them; what is not a sensor leaves the tiles as they are."""
        names = self._controls.chosen_sensors
        try:
            chosen = self.scenario.select_sensors(names) if names else []
            self.sensors = self._globe.sensors = chosen[: len(self._tiles)]
            more = len(chosen) - len(self._tiles)
            self.status.notes["sensors"] = f"{more} sensors more than fit are not shown" if more > 0 else ""
        except InputError as error:
            self.status.notes["sensors"] = str(error)

    def _draw_curve(self) -> None:
        if self.scenario.targets and self.images.sensors:
            with self._lock:
                self._controls.curves.draw(self.scenario, self._controls.band.value, self.time_s)

    def _change(self) -> None:
        """Render another scene from now on: the one with the numbers of the page."""
        controls = self._scene_controls
        if controls is None or not isinstance(self.images, RenderedImages):
            return
        self.note("source", "changing the scene ...")
        try:
            with self._lock:
                scene = changed_scene(self.images.renderer.scenario, controls.changes, controls.value)
                if scene.to_dict() != self.scenario.scene.to_dict():
                    self._take(scene, self.images.renderer)
                controls.accept(self.scenario)
                self.status.notes["scene"] = ""
        except Exception as error:  # also what no rule foresees, such as want of memory
            problem = str(error) if isinstance(error, InputError) else one_line(error)
            self.status.notes["scene"] = f"{problem}; the scene is as before"
        self.note("source", "")
        self._draw_curve()
        self._player.ask_again()

    def _take(self, scene: Scene, renderer: Renderer) -> None:
        """Take another scene, if its images can be rendered."""
        images = RenderedImages(renderer.with_scene(scene))
        images.at(max(self.frame, 0), self.sensors[:1], self._controls.chosen_band)
        self.images, self.scenario = images, images.scenario
        self._globe.scenario = self.scenario
        self._groups.change(self.scenario)

    def _press(self, what: str) -> None:
        self._player.playing = what == "play"
        if what == "pause":
            self._player.ask_again()
        if what == "step":
            slider = self._controls.slider
            slider.value = min(int(slider.value) + 1, self.frames[-1])
            self._player.ask(int(slider.value))
        self._player.wake()

    def _look_at(self) -> None:
        """Show the Earth, or the chosen group."""
        what = self._controls.view.value
        with self._lock:
            self._globe.root.visible = what == EARTH
            self._groups.choose(self._controls.chosen_group)
        for client in self.server.get_clients().values():
            client.camera.position = camera_of_earth(self.scenario) if what == EARTH else CAMERA_OF_GROUP
            client.camera.look_at = (0.0, 0.0, 0.0)
        self._player.ask_again()

    def _moved(self, event: Any) -> None:
        """Show what somebody moved the slider to; where the page itself did, it shows that already."""
        if event.client is not None:
            self._player.ask(int(event.target.value))

    def _frames_per_s(self) -> float:
        """How fast the page plays."""
        interval_s = self.scenario.instrument_of(self.sensors[0]).frames.interval_s if self.sensors else 1.0
        return float(self._controls.speed.value) / interval_s

    def run(self) -> None:
        """Keep the page until Ctrl-C."""
        with contextlib.suppress(KeyboardInterrupt):
            self._player.wait()

    def close(self) -> None:
        """Take the page away."""
        if self._watch is not None:
            self._watch.close()
        if self._scene_controls is not None:
            self._scene_controls.close()
        self._player.stop()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
