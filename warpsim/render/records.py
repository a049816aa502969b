"""What goes into and comes out of a pass over views, as rows of bytes: a few copies move the share of a chunk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.render.buffers import Observations, Views, path_inputs, path_views_of
from warpsim.render.device_scene import DeviceBodies, DeviceScene
from warpsim.render.pool import Pool
from warpsim.render.rows import RowLayout

GEOMETRY = RowLayout(
    {
        "axes": (wp.mat33d, ()),
        "position_m": (wp.vec3d, ()),
        "velocity_m_s": (wp.vec3d, ()),
        "flags": (wp.int32, ()),
        "n_wanted": (wp.int32, ()),
        "reach": (wp.vec2d, ()),
    }
)
"""What is found out about a view."""


@dataclass(frozen=True)
class Inputs:
    """What views are told; each array is (n_view,).

    They are arrays of their own, not columns: the compiler makes vector instructions of `read_out` for arrays without
    gaps only, even of those that it reads one number of.
    """

    time_s: wp.array
    frame: wp.array
    sensor: wp.array
    path: tuple[wp.array, wp.array, wp.array] | None
    """Times, middles and sensors at the instants of the exposure, (n_view, n_path) each; None where nothing moves."""

    @property
    def arrays(self) -> tuple[wp.array, ...]:
        """All arrays."""
        return (self.time_s, self.frame, self.sensor, *(self.path or ()))


def new_inputs(scene: DeviceBodies, time_s: Any, frame: Any, sensor: Any) -> Inputs:
    """Inputs of views of given times, frame numbers and sensor rows, each (n_view,)."""
    device, streaks = scene.device, scene.streaks
    return Inputs(
        wp.array(np.asarray(time_s, dtype=np.float64), dtype=wp.float64, device=device, copy=False),
        wp.array(np.asarray(frame, dtype=np.uint32), dtype=wp.uint32, device=device, copy=False),
        wp.array(np.asarray(sensor, dtype=np.uint32), dtype=wp.uint32, device=device, copy=False),
        path_inputs(device, streaks.offset_s, time_s, sensor) if streaks.wanted else None,
    )


@dataclass(frozen=True)
class Records:
    """What is found out about views."""

    geometry: wp.array
    """Rows of GEOMETRY, (n_view, n_byte)."""
    targets: wp.array
    """Rows of DeviceScene.observation_rows, (n_view, n_byte)."""

    @property
    def arrays(self) -> tuple[wp.array, ...]:
        """All arrays."""
        return (self.geometry, self.targets)

    def view_column(self, name: str) -> npt.NDArray[Any]:
        """NumPy array of one of GEOMETRY's columns, (n_view, ...)."""
        return np.asarray(GEOMETRY.column(self.geometry, name).numpy())

    def observations(self, scene: DeviceScene) -> Observations:
        """What is known of the targets, on the scene's device."""
        return Observations(**scene.observation_rows.columns(self.targets.to(scene.device)))

    def part(self, first: int, end: int) -> Records:
        """Records of some consecutive views."""
        return Records(self.geometry[first:end], self.targets[first:end])


def new_records(scene: DeviceScene, n_view: int, pool: Pool) -> Records:
    """Uninitialised records that are to be filled."""
    layouts = (GEOMETRY, scene.observation_rows)
    return Records(*(pool.new((n_view, layout.n_byte), wp.uint8) for layout in layouts))


def zero_records(scene: DeviceScene, n_view: int) -> Records:
    """Records that stages write into: 0 where none writes."""
    layouts = (GEOMETRY, scene.observation_rows)
    return Records(*(wp.zeros((n_view, layout.n_byte), dtype=wp.uint8, device=scene.device) for layout in layouts))


def views_of(inputs: Inputs, records: Records) -> Views:
    """Inputs and geometry as the arrays that stages take."""
    path = None if inputs.path is None else path_views_of(inputs.path)
    return Views(
        inputs.time_s,
        inputs.time_s,
        inputs.frame,
        inputs.sensor,
        path=path,
        **GEOMETRY.columns(records.geometry),
    )
