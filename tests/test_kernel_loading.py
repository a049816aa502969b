"""Loading of kernels ahead: what is begun once, in which order, and what happens when one cannot be compiled."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest
import warp as wp
from on_devices import device_scene

from benchmarks.frame_kernels import EXPOSED, STAND_IN, compiled, cuda_stages, frame_kernels
from warpsim.launches import THREADS_PER_BLOCK_CUDA
from warpsim.render import device, device_upload
from warpsim.render.device import KernelLoading
from warpsim.render.stages import image_kernels
from warpsim.render.stars import star_kernel, star_threads

CPU, GPU = SimpleNamespace(is_cuda=False), SimpleNamespace(is_cuda=True)


def kernels_of(*modules: str) -> list[SimpleNamespace]:
    return [SimpleNamespace(module=module) for module in modules]


@pytest.fixture
def loaded(monkeypatch):
    """Modules in the order in which they were begun and ended, instead of loading them."""
    events: list[str] = []
    begun = threading.Event()

    def load(module: str, device: object, block_dim: int | None) -> None:
        module = module if block_dim is None else f"{module} {block_dim}"
        events.append(f"begin {module}")
        if module == "first":
            begun.wait(0.2)
        if module == "broken":
            raise RuntimeError("cannot be compiled")
        events.append(f"end {module}")

    monkeypatch.setattr(wp, "load_module", load)
    return events


def test_each_module_is_loaded_once(loaded):
    loading = KernelLoading(CPU)
    loading.start(*kernels_of("first", "a", "a"))
    loading.start(*kernels_of("a", "b"))
    loading.wait()
    loading.start(*kernels_of("b", "first", "c"))
    loading.wait()
    assert sorted(event for event in loaded if event.startswith("end")) == ["end a", "end b", "end c", "end first"]


def test_the_first_is_complete_before_others_begin(loaded):
    loading = KernelLoading(CPU)
    loading.start(*kernels_of("first", "a", "b", "c"))
    loading.wait()
    assert loaded[:2] == ["begin first", "end first"]
    assert len(loaded) == 8


@pytest.mark.parametrize("broken", [0, 1])
def test_one_that_fails_leaves_the_others_alone(loaded, broken):
    names = ["a", "b"]
    names.insert(broken, "broken")
    loading = KernelLoading(CPU)
    loading.start(*kernels_of(*names))
    loading.wait()
    assert {"end a", "end b"} < set(loaded)


def test_on_cuda_a_module_is_loaded_once_for_each_size_of_blocks(loaded):
    loading = KernelLoading(GPU)
    loading.start(*kernels_of("a", "b"))
    loading.start(*kernels_of("a"), block_dim=64)
    loading.start(*kernels_of("a"), block_dim=128)
    loading.wait()
    assert THREADS_PER_BLOCK_CUDA == 64
    assert sorted(event for event in loaded if event.startswith("end")) == ["end a 128", "end a 64", "end b 64"]


def test_on_cuda_none_waits_for_the_first(monkeypatch):
    """Two that wait for each other: both are on their way at a time, the first one, too."""
    together = threading.Barrier(2, timeout=20)
    monkeypatch.setattr(device, "n_usable_cpu", lambda: 2)
    monkeypatch.setattr(wp, "load_module", lambda module, device, block_dim: together.wait())
    loading = KernelLoading(GPU)
    loading.start(*kernels_of("a", "b"))
    loading.share_headers()
    loading.wait()
    assert not together.broken


@pytest.mark.parametrize("changes", [{}, {"optics__psf": "gaussian", **EXPOSED}], ids=["Airy", "Gaussian, exposure"])
def test_what_is_begun_is_what_frames_launch(scene, monkeypatch, changes):
    """With the same threads of a block; those of the long stages among them."""
    begun = set()

    def start(self, *kernels, block_dim=THREADS_PER_BLOCK_CUDA):
        begun.update((kernel, block_dim) for kernel in kernels)

    monkeypatch.setattr(KernelLoading, "start", start)
    monkeypatch.setattr(device_upload, "kernel_loading", lambda device: KernelLoading(CPU))
    made = device_scene(scene.replace(**changes), ["A"])
    on_cuda = {
        *image_kernels(dataclasses.replace(made, device=STAND_IN), made.psf, made.read_out),
        (star_kernel(made.stars.features, GPU), star_threads(GPU)),
    }
    launched = {
        stage.name: {(launch.kernel, launch.block_dim or THREADS_PER_BLOCK_CUDA) for launch in stage.launches}
        for stage in cuda_stages(made)
    }
    assert on_cuda <= set().union(*launched.values())
    drawing = ("deposit", "read_out") if changes else ("find_spots", "deposit_read_out")
    assert {name for name, kernels in launched.items() if on_cuda & kernels} == {"gather_stars", *drawing}
    kernels = {kernel for kernel, _ in begun}
    for stage in ("aim", "observe_targets", "deposit", "read_out"):
        assert kernels & {kernel for kernel, _ in launched[stage]}, stage
    assert star_kernel(made.stars.features, CPU) in kernels


@pytest.mark.ci
def test_cuda_modules_are_compiled_side_by_side_to_the_same_bytes(tmp_path):
    """Kernels of a frame, by Warp's compiler for GPUs, which needs none: one after the other, then in threads."""
    short = [kernel for kernel in frame_kernels({"Airy": {}}) if kernel.stage in ("aim", "gather_stars", "read_out")]
    alone = [compiled(kernel, 90, tmp_path / f"alone{k}").read_bytes() for k, kernel in enumerate(short)]
    together = threading.Barrier(len(short), timeout=60)

    def compile_in_thread(number):
        together.wait()
        return compiled(short[number], 90, tmp_path / f"together{number}").read_bytes()

    with ThreadPoolExecutor(len(short)) as threads:
        assert list(threads.map(compile_in_thread, range(len(short)))) == alone
    assert len(set(alone)) == len(short) == 3


COLD = """
import threading
import warp as wp
import warp._src.context as context
from warpsim.render.device import KernelLoading

@wp.kernel(module="unique", enable_backward=False)
def one(a: wp.array[float]):
    a[wp.tid()] = 1.0

@wp.kernel(module="unique", enable_backward=False)
def two(a: wp.array[float]):
    a[wp.tid()] = 2.0

loading = KernelLoading(wp.get_device("cpu"))
loading.start(one, two)
loading.wait()
translated = getattr(context.runtime, "_pch_dirs", None)
before = None if translated is None else len({folder.name for folder in translated.values()})
a = wp.zeros(3, dtype=float, device="cpu")
wp.launch(two, 3, outputs=[a], device="cpu")
print(a.numpy().tolist(), before)
"""


@pytest.mark.ci
def test_headers_are_translated_once(tmp_path, checkout_environment):
    script = tmp_path / "cold.py"  # Warp reads the source of its kernels
    script.write_text(COLD)
    environment = checkout_environment | {"WARP_CACHE_PATH": str(tmp_path / "cache")}
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.count("(compiled)") == done.stdout.count("Module ") == 2, "the launch loads nothing any more"
    counts, n_folder = done.stdout.strip().splitlines()[-1].rsplit(" ", 1)
    assert counts == "[2.0, 2.0, 2.0]"
    assert n_folder in ("1", "None")  # None: Warp keeps its folders in another way


@pytest.mark.slow  # two processes, the first with an empty cache
def test_a_second_process_compiles_nothing(tmp_path, checkout_environment):
    """Warp's names in the cache hang on a kernel's source only, not on what was compiled before it."""
    environment = checkout_environment | {"WARP_CACHE_PATH": str(tmp_path)}
    code = "import warpsim as ws; ws.Renderer(ws.Scene.load('stss'), 'cpu').render([60], sensors=['sat11'])"
    shown = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True).stdout
        for _ in range(2)
    ]
    assert "(compiled)" in shown[0]
    assert "(cached)" in shown[1]
    assert "(compiled)" not in shown[1]


def test_devices_have_one_loading_each():
    cpu = wp.get_device("cpu")
    assert device.kernel_loading(cpu) is device.kernel_loading(cpu)


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_on_a_gpu_launches_find_what_was_loaded(tmp_path, checkout_environment):
    """A process with an empty cache: each module is compiled once, however it is begun, and the context is kept."""
    environment = checkout_environment | {"WARP_CACHE_PATH": str(tmp_path)}
    code = "import warpsim as ws; ws.Renderer(ws.Scene.load('stss'), 'cuda:0').render([60], sensors=['sat11'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    modules = [line.split(" load on device")[0] for line in done.stdout.splitlines() if "'cuda:0'" in line]
    assert len(modules) == len(set(modules)) >= 5
