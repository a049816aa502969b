"""Loading of kernels ahead: what is begun once, in which order, and what happens when one cannot be compiled."""

from __future__ import annotations

import subprocess
import sys
import threading
from types import SimpleNamespace

import pytest
import warp as wp

from warpsim.render import kernel_loading
from warpsim.render.kernel_loading import KernelLoading

CPU = SimpleNamespace(is_cuda=False)


def kernels_of(*modules: str) -> list[SimpleNamespace]:
    return [SimpleNamespace(module=module) for module in modules]


@pytest.fixture
def loaded(monkeypatch):
    """Modules in the order in which they were begun and ended, instead of loading them."""
    events: list[str] = []
    begun = threading.Event()

    def load(module: str, device: object) -> None:
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


def test_nothing_is_begun_on_cuda(loaded):
    loading = KernelLoading(SimpleNamespace(is_cuda=True))
    loading.start(*kernels_of("a"))
    loading.wait()
    assert loaded == []


COLD = """
import threading
import warp as wp
import warp._src.context as context
from warpsim.render.kernel_loading import KernelLoading

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
    assert kernel_loading.kernel_loading(cpu) is kernel_loading.kernel_loading(cpu)
