"""Launches that are prepared once do what launches do, for any number of views, whichever array they write to."""

import threading

import numpy as np
import pytest
import warp as wp

from warpsim.launches import Launch, Stage

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
