"""Recorded launches do what launches do, for any number of views, wherever an array is moved to."""

import threading

import numpy as np
import pytest
import warp as wp

from warpsim import launches as launches_module
from warpsim.launches import Launches, call, clear, launch, launch_tiled, recorded

N_VIEW, N_ITEM, WIDTH = 6, 5, 8


@wp.kernel(enable_backward=False)
def add_kernel(amount: float, total: wp.array2d[float]):
    view, item = wp.tid()
    total[view, item] = total[view, item] + amount


@wp.func
def doubled(value: float):
    return value * 2.0


@wp.kernel(enable_backward=False)
def double_kernel(values: wp.array[float], results: wp.array[float]):
    tile = wp.tid()
    part = wp.tile_load(values, shape=WIDTH, offset=tile * WIDTH)
    wp.tile_store(results, wp.tile_map(doubled, part), offset=tile * WIDTH)


@pytest.fixture(params=["own-way", "warp's-way"])
def total(request, device, monkeypatch):
    """An array; launches are packed here, or left to Warp as with a version that is not known."""
    if request.param == "warp's-way":
        monkeypatch.setattr(launches_module, "PACKED_BY_WARP", "none")
    return wp.full((N_VIEW, N_ITEM), 7.0, dtype=float, device=device)


def record_sum(total) -> Launches:
    with recorded(N_VIEW) as launches:
        clear(total)
        launch(add_kernel, (N_VIEW, N_ITEM), [2.0], [total], total.device)
        launch(add_kernel, (N_VIEW, N_ITEM), [0.5], [total], total.device)
    return launches


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


def test_arguments_of_all_kinds_arrive(device, total):
    """Structs, vectors, and numbers that leave gaps in the structure, like those of a plain launch."""
    weights = Weights()
    weights.factor = 3.0
    weights.values = wp.array(np.arange(N_ITEM), dtype=float, device=device)
    weights.turn = wp.mat33d(*range(9))
    turned = [wp.zeros((N_VIEW, N_ITEM), dtype=wp.vec3, device=device) for _ in range(2)]
    inputs = [True, weights, -4, wp.vec3(1.0, 2.0, 3.0)]
    with recorded(N_VIEW) as launches:
        launch(weigh_kernel, (N_VIEW, N_ITEM), inputs, [turned[0]], device)
    launches.run(N_VIEW)
    wp.launch(weigh_kernel, (N_VIEW, N_ITEM), inputs, [turned[1]], device=device)
    np.testing.assert_array_equal(turned[0].numpy(), turned[1].numpy())
    assert turned[0].numpy().any()


def test_nothing_happens_while_recording(total):
    record_sum(total)
    assert (total.numpy() == 7.0).all()


@pytest.mark.parametrize("captured", [False, True])
def test_recorded_launches_are_made_in_order_for_the_views_asked_for(total, captured):
    launches = record_sum(total)
    if captured:
        if not total.device.is_cuda:
            pytest.skip("graphs are for CUDA")
        launches.capture(total.device)
    for n_view in (2, N_VIEW, 1, 4):
        total.fill_(7.0)
        launches.run(n_view)
        assert (total.numpy()[:n_view] == 2.5).all()
        assert (total.numpy()[n_view:] == 7.0).all()


def test_tiled_launches_have_several_tiles_a_view(device):
    n_tile, block_dim = 3, 32 if wp.get_device(device).is_cuda else 1
    values = wp.array(np.arange(N_VIEW * n_tile * WIDTH), dtype=float, device=device)
    results = wp.zeros_like(values)
    with recorded(N_VIEW) as launches:
        launch_tiled(double_kernel, [N_VIEW * n_tile], [values], [results], block_dim, device)
    launches.run(2)
    expected = 2 * values.numpy()
    expected[2 * n_tile * WIDTH :] = 0
    np.testing.assert_array_equal(results.numpy(), expected)


def test_arguments_can_be_moved(total):
    """Those of the whole array and those of a part of it."""
    with recorded(N_VIEW) as launches:
        launch(add_kernel, (N_VIEW, N_ITEM), [2.0], [total], total.device)
        with launches.part(1, N_VIEW):
            launch(add_kernel, (N_VIEW - 1, N_ITEM), [0.5], [total[1:]], total.device)
    arguments = launches.arguments_within(total)
    assert [place for _, place in arguments] == [0, total.strides[0]]
    other = wp.zeros_like(total)
    for argument, place in arguments:
        argument.data = other.ptr + place
    launches.run(N_VIEW)
    assert (other.numpy()[0] == 2.0).all() and (other.numpy()[1:] == 2.5).all()
    assert (total.numpy() == 7.0).all()


def test_clearing_stays_with_its_array(total):
    """It is no launch: what moves the arguments of launches does not move it."""
    launches = record_sum(total)
    other = wp.zeros_like(total)
    for argument, place in launches.arguments_within(total):
        argument.data = other.ptr + place
    launches.run(N_VIEW)
    assert (other.numpy() == 2.5).all()
    assert (total.numpy() == 0.0).all()


def test_parts_that_are_not_wanted_are_left_out(total):
    with recorded(N_VIEW) as launches:
        for first in range(0, N_VIEW, 2):
            end = min(first + 2, N_VIEW)
            with launches.part(first, end):
                launch(add_kernel, (end - first, N_ITEM), [1.0], [total[first:end]], total.device)
    for n_view in (3, 1, N_VIEW, 2):
        before = total.numpy().copy()
        launches.run(n_view)
        assert (total.numpy()[:n_view] == before[:n_view] + 1.0).all()
        assert (total.numpy()[n_view:] == before[n_view:]).all()


def test_other_threads_launch_while_one_records(total):
    """Warp's own capture of CPU launches would take them, too."""
    other = wp.zeros_like(total)
    with recorded(N_VIEW) as launches:
        thread = threading.Thread(target=launch, args=(add_kernel, (N_VIEW, N_ITEM), [1.0], [other], total.device))
        thread.start()
        thread.join()
    assert (other.numpy() == 1.0).all()
    launches.run(N_VIEW)
    assert (other.numpy() == 1.0).all()


def test_launches_of_nothing_are_left_out(total):
    with recorded(N_VIEW) as launches:
        launch(add_kernel, (N_VIEW, 0), [1.0], [total], total.device)
    launches.run(3)
    assert (total.numpy() == 7.0).all()


def test_calls_are_made_in_their_turn(total):
    seen = []
    with recorded(N_VIEW) as launches:
        clear(total)
        call(lambda n_view: seen.append((n_view, total.numpy()[0, 0])))
        launch(add_kernel, (N_VIEW, N_ITEM), [2.0], [total], total.device)
        call(lambda n_view: seen.append((n_view, total.numpy()[0, 0])))
    if total.device.is_cuda:
        launches.capture(total.device)
    for n_view in (3, N_VIEW):
        launches.run(n_view)
    assert seen == [(3, 0.0), (3, 2.0), (N_VIEW, 0.0), (N_VIEW, 2.0)]
    with pytest.raises(RuntimeError, match="only for what is recorded"):
        call(print)


def test_a_recording_ends_with_an_exception(total):
    with pytest.raises(ZeroDivisionError), recorded(N_VIEW):
        raise ZeroDivisionError
    launch(add_kernel, (N_VIEW, N_ITEM), [1.0], [total], total.device)
    assert (total.numpy() == 8.0).all()
