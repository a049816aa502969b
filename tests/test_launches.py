"""Launches prepared once and made many times; kernels compiled ahead, side by side."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from on_devices import device_scene

from benchmarks.frame_kernels import EXPOSED, STAND_IN, compiled, cuda_stages, frame_kernels
from warpsim.launches import THREADS_PER_BLOCK_CUDA, Launch, Stage
from warpsim.render import device, device_upload
from warpsim.render.device import KernelLoading
from warpsim.render.device_stars import star_kernel, star_threads
from warpsim.render.stages import image_kernels

N_VIEW, N_ITEM, WIDTH = 6, 5, 8


@wp.kernel(enable_backward=False)
def add_kernel(amount: float, total: wp.array2d[float]):
    view, item = wp.tid()
    total[view, item] = total[view, item] + amount


@wp.kernel(enable_backward=False)
def scale_kernel(factor: float, total: wp.array2d[float]):
    view, item = wp.tid()
    total[view, item] = total[view, item] * factor


@wp.func
def doubled(value: float):
    return value * 2.0


@wp.kernel(enable_backward=False)
def double_kernel(values: wp.array[float], results: wp.array[float]):
    tile = wp.tid()
    part = wp.tile_load(values, shape=WIDTH, offset=tile * WIDTH)
    wp.tile_store(results, wp.tile_map(doubled, part), offset=tile * WIDTH)


@pytest.fixture
def total(device):
    return wp.full((N_VIEW, N_ITEM), 7.0, dtype=float, device=device)


def adding(amount, total, n_view=N_VIEW) -> Launch:
    return Launch(add_kernel, (n_view, N_ITEM), [amount], [total], total.device)


def clearing_and_adding(total) -> Stage:
    """What makes 2.5 of 7 in this order only."""
    clear = Launch(scale_kernel, (N_VIEW, N_ITEM), [0.0], [total], total.device)
    halve = Launch(scale_kernel, (N_VIEW, N_ITEM), [0.5], [total], total.device)
    return Stage("sum", N_VIEW, [clear, adding(4.0, total), halve, adding(0.5, total)])


@wp.struct
class Weights:
    factor: float
    values: wp.array[float]
    turn: wp.mat33d


@wp.kernel(enable_backward=False)
def weigh_kernel(flag: wp.bool, weights: Weights, small: wp.int8, shift: wp.vec3, turned: wp.array2d[wp.vec3]):
    view, item = wp.tid()
    value = weights.values[item] * weights.factor + float(weights.turn[1, 2])
    if flag:
        turned[view, item] = shift * (value + float(small))


def test_arguments_of_all_kinds_arrive(device):
    """Structs, vectors, and numbers that leave gaps in the structure, like those of a plain launch."""
    weights = Weights()
    weights.factor = 3.0
    weights.values = wp.array(np.arange(N_ITEM), dtype=float, device=device)
    weights.turn = wp.mat33d(*range(9))
    turned = [wp.zeros((N_VIEW, N_ITEM), dtype=wp.vec3, device=device) for _ in range(2)]
    inputs = [True, weights, -4, wp.vec3(1.0, 2.0, 3.0)]
    launch = Launch(weigh_kernel, (N_VIEW, N_ITEM), inputs, [turned[0]], wp.get_device(device))
    del weights, inputs[1]  # the launch holds what it reads
    launch.run()
    again = Weights()
    again.factor, again.turn = 3.0, wp.mat33d(*range(9))
    again.values = wp.array(np.arange(N_ITEM), dtype=float, device=device)
    inputs.insert(1, again)
    wp.launch(weigh_kernel, (N_VIEW, N_ITEM), inputs=inputs, outputs=[turned[1]], device=device)
    np.testing.assert_array_equal(turned[0].numpy(), turned[1].numpy())
    assert turned[0].numpy().any()


def test_nothing_happens_before_it_is_run(total):
    clearing_and_adding(total)
    assert (total.numpy() == 7.0).all()


def test_launches_are_made_in_order_for_the_views_asked_for(total):
    stage = clearing_and_adding(total)
    for n_view in (2, N_VIEW, 1, 4, None, 3):
        total.fill_(7.0)
        stage.run(n_view)
        done = N_VIEW if n_view is None else n_view
        assert (total.numpy()[:done] == 2.5).all()
        assert (total.numpy()[done:] == 7.0).all()


def test_on_a_stream(total):
    if not total.device.is_cuda:
        pytest.skip("streams are for CUDA")
    stream = wp.Stream(total.device)
    wp.synchronize_device(total.device)
    clearing_and_adding(total).run(4, stream)
    wp.synchronize_stream(stream)
    assert (total.numpy()[:4] == 2.5).all() and (total.numpy()[4:] == 7.0).all()


@pytest.mark.parametrize("n_view", [2, 5, N_VIEW])
def test_several_threads_a_view(device, n_view):
    """The first axis may be a multiple of the views."""
    flat = wp.zeros((N_VIEW * 3, N_ITEM), dtype=float, device=device)
    Stage("flat", N_VIEW, [adding(1.0, flat, N_VIEW * 3)]).run(n_view)
    assert (flat.numpy()[: n_view * 3] == 1.0).all() and not flat.numpy()[n_view * 3 :].any()


def test_tiled_launches_have_several_tiles_a_view(device):
    n_tile, block_dim = 3, 32 if wp.get_device(device).is_cuda else 1
    values = wp.array(np.arange(N_VIEW * n_tile * WIDTH), dtype=float, device=device)
    results = wp.zeros_like(values)
    launch = Launch(double_kernel, [N_VIEW * n_tile], [values], [results], wp.get_device(device), block_dim)
    stage = Stage("double", N_VIEW, [launch])
    for n_view in (2, N_VIEW, 1):
        results.zero_()
        stage.run(n_view)
        expected = 2 * values.numpy()
        expected[n_view * n_tile * WIDTH :] = 0
        np.testing.assert_array_equal(results.numpy(), expected)


def test_outputs_can_be_replaced(total):
    """By whole arrays and by parts of them, there and back."""
    launch = adding(2.0, total, N_VIEW - 1)
    other = wp.zeros_like(total)
    for array in (other, other[1:], total, total):
        launch.set_output(0, array)
        launch.run()
    assert (other.numpy()[0] == 2.0).all() and (other.numpy()[1:-1] == 4.0).all() and (other.numpy()[-1] == 2.0).all()
    assert (total.numpy()[:-1] == 11.0).all() and (total.numpy()[-1] == 7.0).all()


def test_parts_of_arrays(total):
    adding(0.5, total[2:], N_VIEW - 2).run()
    assert (total.numpy()[:2] == 7.0).all() and (total.numpy()[2:] == 7.5).all()


def test_other_threads_launch_while_one_prepares(total):
    other = wp.zeros_like(total)
    prepared = []

    def use(array):
        for _ in range(50):
            prepared.append(adding(1.0, array))
            adding(1.0, array).run()

    threads = [threading.Thread(target=use, args=(array,)) for array in (total, other)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (total.numpy() == 57.0).all() and (other.numpy() == 50.0).all()
    for launch in prepared:
        launch.run()
    assert (total.numpy() == 107.0).all() and (other.numpy() == 100.0).all()


@pytest.mark.parametrize("tiled", [False, True])
def test_launches_of_nothing_are_left_out(device, total, tiled):
    where, nothing = wp.get_device(device), wp.empty(0, dtype=float, device=device)
    if tiled:
        none = Launch(double_kernel, [0], [nothing], [nothing], where, 1)
    else:
        none = Launch(add_kernel, (N_VIEW, 0), [1.0], [total], where)
    stage = Stage("nothing", N_VIEW, [none, adding(1.0, total)])
    for n_view in (3, None, 0):
        stage.run(n_view)
    none.set_output(0, nothing if tiled else total)
    none.run()
    assert (total.numpy()[:3] == 9.0).all() and (total.numpy()[3:] == 8.0).all()


def test_an_interrupt_between_sizes_is_forgotten(total, monkeypatch):
    """Ctrl-C after Warp's launch has got its new size, before that is noted."""
    launch, set_dim = adding(1.0, total), wp.Launch.set_dim

    def interrupted(self, dim):
        set_dim(self, dim)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(wp.Launch, "set_dim", interrupted)
        with pytest.raises(KeyboardInterrupt):
            launch.run(2, N_VIEW)
    launch.run()
    assert (total.numpy() == 8.0).all()


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

wp.config.log_level = wp.LOG_INFO

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
    code = (
        "import warp as wp; import warpsim as ws; renderer = ws.Renderer(ws.Scene.load('stss'), 'cpu')\n"
        "wp.config.log_level = wp.LOG_INFO; renderer.render([60], sensors=['sat11'])"
    )
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
    code = (
        "import warp as wp; import warpsim as ws; wp.config.log_level = wp.LOG_INFO\n"
        "ws.Renderer(ws.Scene.load('stss'), 'cuda:0').render([60], sensors=['sat11'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    modules = [line.split(" load on device")[0] for line in done.stdout.splitlines() if "'cuda:0'" in line]
    assert len(modules) == len(set(modules)) >= 5
