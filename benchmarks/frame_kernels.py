"""Kernels that a frame launches on CUDA, found and compiled without a GPU.

The stages are bound to arrays of the CPU, for a scene whose device says that it is a GPU, and with launches that are
not prepared: so the list is that of the stages themselves, and what is new in them is in it. Warp's own compiler then
makes the machine code of a GPU that need not be there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import warp as wp

import warpsim as ws
from warpsim.launches import THREADS_PER_BLOCK_CUDA, Stage
from warpsim.render import stages
from warpsim.render.batch import new_inputs
from warpsim.render.buffers import new_signal, new_spots, new_view_arrays
from warpsim.render.device_scene import DeviceScene
from warpsim.render.device_stars import load_catalog, star_index
from warpsim.render.device_upload import make_device_scene

BAND = "A"
N_VIEW, N_SLOT = 2, 128
EXPOSED: dict[str, Any] = {"detector__exposure_s": 0.05, "epoch_utc": "2025-03-20T00:00:00"}
GAUSSIAN: dict[str, Any] = {"optics__psf": "gaussian", "optics__sigma_px": 0.7}
ELECTRONS = ws.ElectronDetector(
    exposure_s=0.1, full_well_e=2e4, gain_e_per_count=1.0, bits=16, transmission=0.6, quantum_efficiency=0.5,
    dark_e_s=40.0, read_noise_e=2.0, prnu=0.01, dsnu=0.3, column_noise_e=3.0, dead_fraction=0.01, hot_fraction=0.01,
    nonlinearity=0.1, streaks=False,
)  # fmt: skip

SCENES: dict[str, dict[str, Any]] = {
    "stss, Gaussian": GAUSSIAN,
    "stss, Airy": {},
    "in sunlight, exposure, Gaussian": {**EXPOSED, **GAUSSIAN},
    "in sunlight, exposure, Airy": EXPOSED,
    "pixels behind the last whole strip": {"camera__n_row": 40, "camera__n_col": 61},
    "electrons, all terms": {"detector": ELECTRONS},
}
"""By name, what is changed of `stss`; a kernel of several scenes counts for the first."""


STAND_IN = SimpleNamespace(is_cuda=True, is_cpu=False)
"""Says of itself what the stages ask a device for."""


@dataclass(frozen=True)
class FrameKernel:
    """A kernel of the frame path, as it would be launched on CUDA."""

    scene: str
    """The first of SCENES that needs it."""
    stage: str
    kernel: wp.Kernel
    block_dim: int
    """Threads of a block."""

    @property
    def name(self) -> str:
        """Its name without that of the function that made it."""
        return str(self.kernel.key).rpartition("__locals__")[2].removesuffix("_kernel")


def frame_kernels(scenes: dict[str, dict[str, Any]] = SCENES) -> list[FrameKernel]:
    """Kernels of all scenes, in the order of the stages, each once."""
    found: dict[tuple[wp.Kernel, int], FrameKernel] = {}
    for name, changes in scenes.items():
        for stage, kernel, block_dim in _launched(ws.Scene.load("stss").replace(**changes)):
            found.setdefault((kernel, block_dim), FrameKernel(name, stage, kernel, block_dim))
    return list(found.values())


def _launched(scene: ws.Scene) -> Iterator[tuple[str, wp.Kernel, int]]:
    """Stage, kernel and threads of a block of each launch that a pass would make on CUDA."""
    scenario, cpu = scene.scenario, wp.get_device("cpu")
    index = star_index(scene.sky, scenario.epoch, load_catalog(scene.sky), cpu)
    on_cpu = make_device_scene(scenario, scenario.instrument, [BAND], cpu, index)
    for stage in cuda_stages(on_cpu):
        for launch in stage.launches:
            yield stage.name, launch.kernel, launch.block_dim or THREADS_PER_BLOCK_CUDA


def cuda_stages(scene: DeviceScene) -> list[Stage]:
    """The stages of a pass as CUDA would have them, of a scene on the CPU; they cannot be run."""
    own = new_view_arrays(scene, new_inputs(scene.device, *np.zeros((3, N_VIEW))), N_SLOT)
    camera, sources = scene.instrument.sensor.camera, own.sources
    shape = (N_VIEW, scene.n_band, camera.n_row, camera.n_col)
    signal, counts = new_signal(shape, scene.device), wp.empty(shape, dtype=wp.uint16, device=scene.device)
    cuda: Any = dataclasses.replace(scene, device=STAND_IN)
    spots = new_spots(scene, N_VIEW, N_SLOT)
    with mock.patch.object(wp, "launch"), mock.patch.object(wp, "launch_tiled"):
        at_once = stages.deposit_read_out(cuda, own.inputs, sources, spots, counts)
        return [
            *stages.view_stages(cuda, own),
            stages.deposit(cuda, sources, own.columns.brightness, signal),
            stages.read_out(cuda, own.inputs, signal, counts, 0),
            *([stages.find_spots(cuda, sources, spots), at_once] if stages.is_read_out_at_once(cuda) else []),
        ]


def compiled(kernel: FrameKernel, arch: int, folder: Path) -> Path:
    """Compile the module of a kernel to a cubin in a folder of its own.

    Args:
        kernel: What is compiled.
        arch: 90 for sm_90.
        folder: Where the cubin is put.
    """
    module = kernel.kernel.module
    before = module.options["block_dim"]
    module.options["block_dim"] = kernel.block_dim
    try:
        (path,) = wp.compile_aot_module(module, arch=arch, module_dir=folder, use_ptx=False)
    finally:
        module.options["block_dim"] = before
    return Path(path)
