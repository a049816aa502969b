"""Groups of targets about their main ones, with their attitudes, in a page's scene; unit metres or more."""

from __future__ import annotations

from typing import Any

import numpy as np

from warpsim.live.globe import quaternion_wxyz, rgb
from warpsim.plot.figure import TargetKind, plain, target_kinds
from warpsim.plot.group_figure import body_to_gcrs, drawn_facets, group_offsets_m, local_frame
from warpsim.scene.scenario import Scenario

ROOT = "/group"
CAMERA_OF_GROUP = (-7.0, -10.0, 5.0)
"""Where the page's camera stands: behind and above it."""
EXTENT = 6.0
"""Of the farthest target from the middle, in the page's units: the page zooms about as far as with the Earth."""

_BODY = 0.22  # half extent of a drawn body, in the page's units
_DARK = 0.45  # of a quarter of its sectors, so that spin shows
_MOST_NAMES = 40
_MOST_BODIES = 300
_ORDER = [1, 2, 0]  # along-track, cross-track, radial


class Groups:
    """The groups of a scene, of which one is visible at most; each is made when it is first shown.

    Args:
        scene: The server's `scene`.
        scenario: What is shown.
    """

    def __init__(self, scene: Any, scenario: Scenario) -> None:
        self._scene, self._scenario = scene, scenario
        self._views: dict[int, GroupView] = {}

    def choose(self, group: int | None) -> None:
        """Let one group be visible, or none."""
        if group is not None and group not in self._views:
            self._views[group] = GroupView(self._scene, self._scenario, group)
        for number, view in self._views.items():
            view.root.visible = number == group

    def change(self, scenario: Scenario) -> None:
        """Take another scene with the same groups."""
        self._scenario = scenario
        for view in self._views.values():
            view.scenario = scenario

    def show(self, group: int, time_s: float) -> None:
        """Move the bodies of a chosen group to an instant [s after the epoch]."""
        self._views[group].show(time_s)


class GroupView:
    """Targets of one group in its main target's local frame: x along-track, y cross-track, z radial.

    Where the main target is absent, or there is none, the first one that is there stands for it. Distances are to
    scale, bodies are drawn far larger than they are.

    Args:
        scene: The server's `scene`.
        scenario: What is shown.
        group: Number of the group.
    """

    def __init__(self, scene: Any, scenario: Scenario, group: int = 0) -> None:
        self._scene, self.scenario, self._path = scene, scenario, f"{ROOT}{group}"
        self.root = scene.add_frame(self._path, show_axes=True, axes_length=1.0, axes_radius=0.01, visible=False)
        kinds = [kind for kind in target_kinds(scenario) if kind.group == group]
        members = [(target, kind) for kind in kinds for target in kind.targets]
        self._n_all = len(members)
        self._bodies = {target: self._body(target, kind) for target, kind in members[:_MOST_BODIES]}
        self._text = scene.add_label(f"{self._path}/scale", "", position=(0.0, 0.0, -EXTENT), anchor="top-center")

    def _body(self, target: int, kind: TargetKind) -> Any:
        import trimesh

        facets = drawn_facets(self.scenario.targets[target].spec.shape)
        corners = (_BODY * facets).reshape(-1, 3)
        first = 4 * np.arange(len(facets))
        faces = np.concatenate([np.stack([first, first + 1, first + 2], 1), np.stack([first, first + 2, first + 3], 1)])
        x, y, _ = facets.mean(axis=1).T
        colours = np.array(rgb(kind.colour)) * np.where((x > 0) & (y > 0), _DARK, 1.0)[:, None]
        mesh = trimesh.Trimesh(corners, faces, process=False)
        mesh.visual.vertex_colors = np.repeat(colours, 4, axis=0).astype(np.uint8)
        body = self._scene.add_mesh_trimesh(f"{self._path}/body{target}", mesh, visible=False)
        if kind.is_main or self._n_all <= _MOST_NAMES:
            name = self.scenario.target_names[target]
            label, size = (f"{name} (main)", 1.0) if kind.is_main else (name, 0.8)
            self._scene.add_label(f"{self._path}/body{target}/name", label, font_screen_scale=size)
        return body

    def show(self, time_s: float) -> None:
        """Move the bodies to an instant [s after the epoch]; hide those that are absent."""
        scenario, at = self.scenario, np.array([time_s])
        there = [target for target in self._bodies if scenario.tracks.exist(target, np.array(time_s))]
        for target, body in self._bodies.items():
            body.visible = target in there
        if not there:
            self._text.text = "no target of this group is there now"
            return
        offset_m = group_offsets_m(scenario.tracks, there, time_s)[:, _ORDER]
        extent_m = max(float(np.abs(offset_m).max()), 1.0)
        position_m, velocity_m_s = scenario.tracks.target_state(there[0], at)
        to_local = local_frame(position_m[0], velocity_m_s[0])[_ORDER]
        for target, offset in zip(there, offset_m, strict=True):
            body = self._bodies[target]
            body.position = tuple(EXTENT * offset / extent_m)
            body.wxyz = quaternion_wxyz(to_local @ body_to_gcrs(scenario, scenario.target_names[target], time_s)[0])
        axis_m, n_drawn = extent_m / EXTENT, len(self._bodies)
        length = f"{plain(axis_m, 3)} m" if axis_m < 1000 else f"{plain(axis_m / 1000, 3)} km"
        more = "" if n_drawn == self._n_all else f"; {n_drawn} of {self._n_all:,} targets"
        middle = f"about {scenario.target_names[there[0]]}; axes {length}"
        self._text.text = f"{middle}: along-track, cross-track, radial (red, green, blue){more}"
