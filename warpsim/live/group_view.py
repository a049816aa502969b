"""A group of targets about its main one, with their attitudes, in a page's scene; unit metres or more."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.live.globe import quaternion_wxyz, rgb
from warpsim.plot.figure import plain, target_kinds
from warpsim.plot.group_figure import drawn_facets, group_offsets_m, local_frame
from warpsim.scene.scenario import Scenario

F64 = NDArray[np.float64]

ROOT = "/group"
EXTENT = 6.0
"""Of the farthest target from the middle, in the page's units: the page zooms about as far as with the Earth."""

_BODY = 0.22  # half extent of a drawn body, in the page's units
_DARK = 0.45  # of a quarter of its sectors, so that spin shows
_MOST_NAMES = 40
_ORDER = [1, 2, 0]  # along-track, cross-track, radial


class GroupView:
    """Targets of one group in its main target's local frame: x along-track, y cross-track, z radial.

    Distances are to scale, bodies are drawn far larger than they are.

    Args:
        scene: The server's `scene`.
        scenario: What is shown.
        group: Number of the group.
    """

    def __init__(self, scene: Any, scenario: Scenario, group: int = 0) -> None:
        self._scene, self.scenario = scene, scenario
        self.root = scene.add_frame(ROOT, show_axes=True, axes_length=1.0, axes_radius=0.01, visible=False)
        self._bodies: dict[int, Any] = {}
        self._targets: list[int] = []
        for kind in target_kinds(scenario):
            if kind.group == group:
                self._targets += kind.targets
                for target in kind.targets:
                    self._bodies[target] = self._body(target, kind.colour)
        self._text = scene.add_label(f"{ROOT}/scale", "", position=(0.0, 0.0, -EXTENT), anchor="top-center")

    def _body(self, target: int, colour: str) -> Any:
        import trimesh

        facets = drawn_facets(self.scenario.targets[target].spec.shape)
        corners = (_BODY * facets).reshape(-1, 3)
        first = 4 * np.arange(len(facets))
        faces = np.concatenate([np.stack([first, first + 1, first + 2], 1), np.stack([first, first + 2, first + 3], 1)])
        azimuth = np.arctan2(facets.mean(axis=1)[:, 1], facets.mean(axis=1)[:, 0])
        shade = np.where((azimuth > 0) & (azimuth < np.pi / 2), _DARK, 1.0)
        colours = np.concatenate([np.array(rgb(colour)) * shade[:, None], np.full((len(facets), 1), 255.0)], axis=1)
        mesh = trimesh.Trimesh(corners, faces, process=False)
        mesh.visual.vertex_colors = np.repeat(colours, 4, axis=0).astype(np.uint8)
        name = self.scenario.target_names[target]
        body = self._scene.add_mesh_trimesh(f"{ROOT}/body{target}", mesh, visible=False)
        if len(self.scenario.targets) <= _MOST_NAMES:
            self._scene.add_label(f"{ROOT}/body{target}/name", name, font_screen_scale=0.8)
        return body

    def show(self, time_s: float) -> None:
        """Move the bodies to an instant [s after the epoch]; hide those that are absent."""
        scenario, at = self.scenario, np.array([time_s])
        there = {target for target in self._targets if bool(scenario.tracks.exist(target, np.array(time_s)))}
        if self._targets and self._targets[0] in there:
            offset_m = group_offsets_m(scenario.tracks, self._targets, time_s)[:, _ORDER]
            extent_m = max(float(np.abs(offset_m).max()), 1.0)
            position_m, velocity_m_s = scenario.tracks.target_state(self._targets[0], at)
            to_local = local_frame(position_m[0], velocity_m_s[0])[_ORDER]
            for target, offset in zip(self._targets, offset_m, strict=True):
                body = self._bodies[target]
                body.position = tuple(EXTENT * offset / extent_m)
                body.wxyz = quaternion_wxyz(to_local @ _body_axes(scenario, target, at))
            one_m = plain(extent_m / EXTENT, 3)
            self._text.text = f"axes {one_m} m: along-track, cross-track, radial (red, green, blue)"
        for target, body in self._bodies.items():
            body.visible = target in there


def _body_axes(scenario: Scenario, target: int, at: F64) -> F64:
    """Columns: the body's axes in GCRS axes."""
    from scipy.spatial.transform import Rotation

    quaternion = scenario.attitude_quaternion(scenario.target_names[target], at)[0]
    return np.asarray(Rotation.from_quat(quaternion).as_matrix())
