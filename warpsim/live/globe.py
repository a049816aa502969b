"""The Earth with orbits, satellites, targets, lines of sight and fields of view, in a page's scene; unit 1000 km."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from warpsim.arrays import F64
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.directions import normalised
from warpsim.exchange.geodetic import geodetic_to_itrs_m
from warpsim.orbit.earth import itrs_to_gcrs
from warpsim.orbit.sun import earth_states
from warpsim.orbit.track import TrackStack
from warpsim.plot.coastlines import coastlines_deg
from warpsim.plot.figure import observed_targets, target_kinds
from warpsim.quaternion import from_matrix
from warpsim.scene.scenario import Scenario

UNIT_M = 1e6
"""Positions on the page are float32: 0.1 m of 1000 km, far below a pixel."""
ROOT = "/earth"

MOST_NAMES = 24
"""More satellites with access than these are not named."""

_OCEAN, _COAST, _ORBIT, _SEEN, _UNSEEN = (30, 62, 110), (150, 170, 150), (70, 80, 95), (86, 180, 233), (120, 120, 120)
_SIGHT, _FIELD, _PATH = (0, 158, 115), (240, 228, 66), (213, 94, 0)
_N_PATH = 181


class GlobeScene:
    """The part of a page's scene about the Earth, in GCRS axes.

    Args:
        scene: The server's `scene`.
        scenario: What is shown.
        sensors: Sensors whose fields of view are drawn.
    """

    def __init__(self, scene: Any, scenario: Scenario, sensors: Sequence[str]) -> None:
        self._scene, self.scenario = scene, scenario
        self.sensors = list(sensors)
        self._satellites = TrackStack(scenario.tracks.satellites) if scenario.satellite_names else None
        self.root = scene.add_frame(ROOT, show_axes=False)
        self._earth = scene.add_frame(f"{ROOT}/globe", show_axes=False)
        vertices, faces = _ellipsoid()
        scene.add_mesh_simple(f"{ROOT}/globe/sea", vertices, faces, color=_OCEAN)
        lon_deg, lat_deg = coastlines_deg().T
        coast = _broken_line(1.002 * geodetic_to_itrs_m(lon_deg, lat_deg, 0.0) / UNIT_M)
        scene.add_line_segments(f"{ROOT}/globe/coast", coast, _COAST, thickness=1.0, thickness_units="screen")
        scene.add_light_ambient(f"{ROOT}/sky_light", intensity=0.35)
        self._sun = scene.add_light_directional(f"{ROOT}/sun", intensity=3.0)
        self._nodes: dict[str, Any] = {}
        self._add_paths()
        self._names: dict[str, Any] = {}
        self._kinds = target_kinds(scenario)

    def _add_paths(self) -> None:
        """Orbits of the satellites and paths of the first target of each group, over the scene."""
        scenario, duration_s = self.scenario, self.scenario.scene.duration_s
        time_s = np.linspace(0.0, duration_s, _N_PATH)
        lines = [self._line(name, time_s) for name in scenario.satellite_names[:200]]
        if lines:
            self._lines("orbits", np.concatenate(lines), _ORBIT)
        firsts = {target.group: number for number, target in reversed(list(enumerate(scenario.targets)))}
        for number in firsts.values():
            begin_s, end_s = np.clip(scenario.targets[number].exists_s, 0.0, duration_s)
            path = self._line(scenario.target_names[number], np.linspace(begin_s, end_s, _N_PATH))
            self._lines(f"path{number}", path, _PATH, 2.0)

    def _line(self, name: str, time_s: F64) -> F64:
        return _broken_line(self.scenario.position_m(name, time_s) / UNIT_M)

    def _lines(self, name: str, segments: F64, colour: Any, width_px: float = 1.0) -> None:
        """Draw line segments (n, 2, 3) in place of those of the same name."""
        points = segments.astype(np.float32) if len(segments) else np.zeros((1, 2, 3), np.float32)
        if self._is_new(name, points):
            self._nodes[name] = self._scene.add_line_segments(
                f"{ROOT}/{name}", points, colour, thickness=width_px, thickness_units="screen"
            )

    def show(self, time_s: float) -> None:
        """Move everything to an instant [s after the epoch]."""
        scenario, at = self.scenario, np.array([time_s])
        self._earth.wxyz = quaternion_wxyz(itrs_to_gcrs(scenario.epoch, at)[0])
        sun = earth_states(scenario.epoch, at).sun_m[0]
        self._sun.position = tuple(50.0 * sun / np.linalg.norm(sun))
        where_m = self._satellites.positions_m(at)[:, 0] if self._satellites else np.zeros((0, 3))
        place = dict(zip(scenario.satellite_names, where_m / UNIT_M, strict=True))
        there = [i for i in range(len(scenario.targets)) if bool(scenario.tracks.exist(i, np.array(time_s)))]
        target = {i: scenario.position_m(scenario.target_names[i], at)[0] / UNIT_M for i in there}
        seen = self._draw_sights(time_s, place, target)
        others = set(place) - set(seen)
        self._points("satellites", [place[name] for name in place if name in others], _UNSEEN, 0.08)
        self._points("observers", [place[name] for name in seen], _SEEN, 0.14)
        names = seen if len(seen) <= MOST_NAMES else []
        mains = [i for kind in self._kinds if kind.is_main for i in kind.targets if i in target]
        self._name(
            {name: place[name] for name in names} | {f"{scenario.target_names[i]} (main)": target[i] for i in mains}
        )
        for kind in self._kinds:
            own = [target[i] for i in kind.targets if i in target]
            self._points(f"kind{kind.number}", own, rgb(kind.colour), 0.16 if kind.is_main else 0.1)
        self._lines("fields", self._fields(time_s, place, target), _FIELD)

    def _draw_sights(self, time_s: float, place: dict[str, F64], target: dict[int, F64]) -> list[str]:
        """Lines from sensors with access to what they observe; return the names of their satellites."""
        lines, seen = [], []
        for instrument in self.scenario.instruments.values():
            access = instrument.access
            for sensor in np.unique(access.row[(access.start_s <= time_s) & (time_s <= access.end_s)]).tolist():
                satellite = instrument.satellite_names[sensor]
                ends = [i for i in observed_targets(self.scenario, instrument, sensor, time_s) if i in target]
                lines += [(place[satellite], target[i]) for i in ends[:1]]
                seen.append(satellite)
        self._lines("sights", np.array(lines).reshape(-1, 2, 3), _SIGHT, 2.0)
        return list(dict.fromkeys(seen))

    def _fields(self, time_s: float, place: dict[str, F64], target: dict[int, F64]) -> F64:
        """Edges of the fields of view of the chosen sensors, to the Earth or as far as the nearest target is."""
        edges: list[F64] = []
        for name in self.sensors:
            instrument = self.scenario.instrument_of(name)
            camera = instrument.sensor.camera
            right, low = camera.n_col - 0.5, camera.n_row - 0.5
            corners = np.array([(-0.5, -0.5), (right, -0.5), (right, low), (-0.5, low)])
            axes = self.scenario.view_axes(name, np.array([time_s]))[0]
            here = place[instrument.satellite_of(name)]
            far = min((float(np.linalg.norm(there - here)) for there in target.values()), default=10.0)
            ends = np.array([_end_of_ray(here, ray, far) for ray in camera.direction(corners, axes)])
            edges += [np.stack([np.broadcast_to(here, ends.shape), ends], 1), np.stack([ends, np.roll(ends, 1, 0)], 1)]
        return np.concatenate(edges) if edges else np.zeros((0, 2, 3))

    def _points(self, name: str, points: list[F64], colour: Any, size: float) -> None:
        where = np.array(points, np.float32).reshape(-1, 3)
        if self._is_new(name, where):
            self._nodes[name] = self._scene.add_point_cloud(
                f"{ROOT}/{name}", where, colour, point_size=size, point_shape="circle", precision="float32"
            )

    def _is_new(self, name: str, points: NDArray[np.float32]) -> bool:
        """Return whether a node must be added; one of as many points is moved, which a browser does far faster."""
        node = self._nodes.get(name)
        if node is None or node.points.shape != points.shape:
            return True
        if not np.array_equal(node.points, points):
            node.points = points
        return False

    def _name(self, wanted: dict[str, F64]) -> None:
        """Names beside satellites and main targets."""
        for name in [name for name in self._names if name not in wanted]:
            self._names.pop(name).remove()
        for name, position in wanted.items():
            if name not in self._names:
                self._names[name] = self._scene.add_label(f"{ROOT}/name_{name}", name, anchor="bottom-left")
            self._names[name].position = tuple(position)


def _end_of_ray(start: F64, ray: F64, far: float) -> F64:
    """Where a ray meets a sphere of the Earth's radius, or its point at a distance."""
    along = -float(start @ ray)
    below = float(start @ start) - along * along
    radius = EARTH_EQUATORIAL_RADIUS_M / UNIT_M
    hit = along - np.sqrt(radius * radius - below) if along > 0 and below < radius * radius else np.inf
    return np.asarray(start + min(hit, max(far, 1.0)) * ray)


def _broken_line(points: F64) -> F64:
    """Segments (n, 2, 3) of a line of points (m, 3), without those that have an end of NaN."""
    segments = np.stack([points[:-1], points[1:]], axis=1)
    return np.asarray(segments[np.isfinite(segments).all(axis=(1, 2))])


def _ellipsoid(n_lat: int = 61, n_lon: int = 121) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Vertices [1000 km] and faces of WGS84 in ITRS axes."""
    lat, lon = np.meshgrid(np.linspace(-90, 90, n_lat), np.linspace(-180, 180, n_lon), indexing="ij")
    vertices = geodetic_to_itrs_m(lon.ravel(), lat.ravel(), 0.0) / UNIT_M
    corner = (np.arange(n_lat - 1)[:, None] * n_lon + np.arange(n_lon - 1)).ravel()
    east, north = corner + 1, corner + n_lon
    faces = np.concatenate([np.stack([corner, east, north], 1), np.stack([east, north + 1, north], 1)])
    return vertices.astype(np.float32), faces.astype(np.uint32)


def rgb(colour: str) -> tuple[int, int, int]:
    """A colour of matplotlib as three numbers of 0 to 255, light enough for a dark page."""
    hue, lightness, saturation = colorsys.rgb_to_hls(*to_rgb(colour))
    red, green, blue = colorsys.hls_to_rgb(hue, max(lightness, 0.45), saturation)
    return round(255 * red), round(255 * green), round(255 * blue)


def quaternion_wxyz(rotation: F64) -> tuple[float, ...]:
    """Quaternion of a rotation matrix (3, 3), scalar first."""
    return tuple(np.roll(from_matrix(rotation), 1).tolist())


def camera_of_earth(scenario: Scenario) -> tuple[float, ...]:
    """Return where the page's camera stands at first: above the first target, or satellite."""
    middle = np.array([0.5 * scenario.scene.duration_s])
    body = (scenario.target_names or scenario.satellite_names)[0]
    return tuple((26.0 * normalised(scenario.position_m(body, middle)[0])).tolist())
