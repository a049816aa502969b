"""Frames are the same bits however they are cut: into calls, passes, images at a time, source slots, pipelines."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import slow
from on_devices import device_scene

import warpsim as ws
from warpsim.errors import InputError
from warpsim.pool import Pool
from warpsim.render import pipelines, schedule, stages
from warpsim.render.batch import new_batch
from warpsim.render.device import rows_per_block
from warpsim.render.pipeline import Pipeline
from warpsim.render.request import checked_frames

FRAMES, SENSORS = [3, 4, 70, 71, 9], ["sat11", "sat27"]
N_VIEW = len(FRAMES) * len(SENSORS)
SMALL = {"n_row": 40, "n_col": 51, "fov_deg": 3.0}
"""2040 pixels: 15 strips and a ragged end."""
IMAGE_BYTES = 2 * 4 * 40 * 51

DRIFT = {"urad_s": [15e3, -9e3], "reset_s": 2.0}  # some 10 px in an exposure
SCENES = {"still": {}, "streaks": {"detector__exposure_s": 0.7, "pointing__drift": DRIFT}}


@pytest.fixture(scope="module", params=SCENES)
def small(request, scene):
    """Two bands; targets in sunlight, so that all terms of their light count."""
    lit = scene.replace(epoch_utc="2025-03-20T06:00:00", camera=SMALL, bands=["A", "C"])
    return lit.replace(**SCENES[request.param])


def contents(columns):
    """What is known of views, by name, on the host."""
    views, observations = columns.views.numpy(), columns.observations.numpy()
    found = {name: views[name] for name in ("axes", "position_m", "velocity_m_s", "flags", "n_required")}
    found |= {f"target_{name}": observations[name] for name in observations.dtype.names}
    for name in ("irradiance_w_cm2", "offset_px", "brightness"):
        array = getattr(columns, name)
        found |= {} if array is None else {name: array.numpy()}
    return found


def rendered(renderer, frames=FRAMES, **kept):
    """All that a call gives, by name, on the host."""
    frames = renderer.render(frames, SENSORS, **(kept or {"keep_signal": True, "keep_stars": True}))
    found = {"counts": frames.counts.numpy(), **contents(frames._columns)}
    if frames.signal_w_cm2 is not None:
        found["signal"] = frames.signal_w_cm2.numpy()
    if frames._star_lists is not None:
        stars = frames.stars
        found |= {f"star_{name}": np.asarray(stars[name]) for name in ("sensor", "x_px", "dx_px", "irradiance_w_cm2")}
    return found


def assert_same(found, expected):
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)


@pytest.fixture(scope="module")
def expected(small):
    """By device: one thread, all frames in one pass."""
    made = {}

    def of(device):
        if device not in made:
            made[device] = rendered(ws.Renderer(small, device=device, n_thread=1))
        return made[device]

    return of


def pipelines_in(renderer):
    (group,) = renderer._pipelines.values()
    return [pipeline for pipeline in group._pipelines if pipeline is not None]


@pytest.mark.ci
def test_there_is_something_to_compare(small, expected):
    found = expected("cpu")
    assert len(found["star_x_px"]) > N_VIEW
    assert len({values.tobytes() for values in found["counts"].reshape(-1, *found["counts"].shape[-2:])}) == 2 * N_VIEW
    assert (found["irradiance_w_cm2"] > 0).any() and (found["signal"] > 0).any()
    assert ("offset_px" in found) == (small.detector.exposure_s > 0)


@pytest.mark.parametrize("n_thread", [slow(1), 3])
@pytest.mark.parametrize(("n_view", "n_image"), [(1, 1), (3, 1), (3, 2), (4, 3), (7, 7), (99, 2)])
@pytest.mark.ci
def test_passes_and_images_at_a_time_of_any_size(small, device, expected, monkeypatch, n_view, n_image, n_thread):
    """Signal, star lists and columns too: of several passes they are those of one."""
    monkeypatch.setattr(schedule, "SIGNAL_BYTES_AT_A_TIME", n_image * IMAGE_BYTES)
    monkeypatch.setattr(schedule, "PIXELS_PER_PASS", 1)
    # A pass holds columns and source lists too, which here are larger than the images.
    monkeypatch.setattr(pipelines, "most_views", lambda *_: n_view)
    renderer = ws.Renderer(small, device=device, n_thread=n_thread)
    assert_same(rendered(renderer), expected(device))
    assert all(pipeline.n_view <= max(n_view, 1) for pipeline in pipelines_in(renderer))
    for frames in (FRAMES[2:3], FRAMES):
        found = rendered(renderer, frames)
        np.testing.assert_array_equal(found["counts"], expected(device)["counts"][[FRAMES.index(k) for k in frames]])
    assert_same(found, expected(device))


@pytest.mark.parametrize("chunk_bytes", [1, IMAGE_BYTES, 10 * IMAGE_BYTES])
@pytest.mark.ci
def test_chunk_bytes_change_nothing(small, device, expected, chunk_bytes):
    renderer = ws.Renderer(small, device=device, n_thread=2, chunk_bytes=chunk_bytes)
    assert_same(rendered(renderer), expected(device))
    assert max(pipeline.n_view for pipeline in pipelines_in(renderer)) < N_VIEW or chunk_bytes > IMAGE_BYTES


@pytest.mark.parametrize("kept", [{"keep_signal": True}, {"keep_stars": True}, {"keep_signal": False}], ids=str)
@pytest.mark.ci
def test_what_is_kept_changes_nothing_else(small, device, expected, kept):
    found = rendered(ws.Renderer(small, device=device, chunk_bytes=2 * IMAGE_BYTES), **kept)
    assert ("signal" in found, "star_x_px" in found) == (kept.get("keep_signal", False), "keep_stars" in kept)
    assert_same(found, {name: values for name, values in expected(device).items() if name in found})


@pytest.mark.ci
def test_frames_alone_and_in_another_order(small, device, expected):
    renderer = ws.Renderer(small, device=device)
    everything = expected(device)
    for frames in (FRAMES[::-1], *([frame] for frame in FRAMES)):
        chosen = [FRAMES.index(frame) for frame in frames]
        found = rendered(renderer, frames)
        for name in ("counts", "signal"):
            np.testing.assert_array_equal(found[name], everything[name][chosen])
        rows = (np.array(chosen)[:, None] * len(SENSORS) + np.arange(len(SENSORS))).ravel()
        for name in ("axes", "target_xy_px", "target_temperature_k", "irradiance_w_cm2"):
            np.testing.assert_array_equal(found[name], everything[name][rows])


@pytest.mark.parametrize("n_thread", [1, 2])
@pytest.mark.ci
def test_source_lists_grow_until_they_hold_all(small, device, expected, monkeypatch, n_thread):
    monkeypatch.setattr(pipelines, "EXTRA_SLOTS", 1)
    monkeypatch.setattr(pipelines, "certain_slots", lambda scene: None)  # a GPU would begin with lists that hold all
    monkeypatch.setattr(schedule, "PIXELS_PER_PASS", 1)
    renderer = ws.Renderer(small, device=device, n_thread=n_thread)
    assert_same(rendered(renderer), expected(device))
    required = expected(device)["n_required"].max()
    assert all(required <= pipeline.n_slot <= required + required // 4 for pipeline in pipelines_in(renderer))


@pytest.mark.ci
def test_calls_that_grow_little_by_little_need_few_new_arrays(small, monkeypatch):
    made = []

    class Counted(Pipeline):
        def __init__(self, *arguments):
            made.append(arguments[1])
            super().__init__(*arguments)

    monkeypatch.setattr(pipelines, "Pipeline", Counted)
    renderer = ws.Renderer(small, device="cpu", n_thread=1)
    for n_frame in (*range(1, 9), *range(8, 0, -1)):
        renderer.render(range(n_frame), SENSORS)
    assert made == [2, 4, 8, 16]


@pytest.mark.ci
def test_label_and_light_are_one(small, device):
    """What truth reports of targets is what is drawn: the first source slots hold the same bits."""
    world = device_scene(small, ["A", "C"], device)
    batch, group = new_batch(world, FRAMES, SENSORS, Pool(world.device)), pipelines.Pipelines([world], 1, False)
    group.render(batch, None)
    (pipeline,) = group._pipelines
    reported, sources, n_target = contents(batch.columns), pipeline.own.sources, world.n_target
    n_source = sources.n_source.numpy()[:N_VIEW]
    np.testing.assert_array_equal(n_source, reported["n_required"])
    assert (n_target < n_source).any() and (n_source <= pipeline.n_slot).all()
    drawn = {"target_xy_px": sources.xy_px.numpy()[:N_VIEW, :n_target]}
    drawn["irradiance_w_cm2"] = sources.irradiance_w_cm2.numpy()[:N_VIEW, :, :n_target]
    if world.streaks.enabled:
        drawn["offset_px"] = sources.offset_px.numpy()[:N_VIEW, :n_target]
        assert np.abs(drawn["offset_px"]).max() > 1
    assert (sources.star.numpy()[:N_VIEW, :n_target] == -1).all()
    assert reported["irradiance_w_cm2"].max() > 0
    for name, values in drawn.items():
        assert reported[name].dtype == values.dtype and reported[name].tobytes() == values.tobytes(), name
    own = contents(pipeline.own.columns)
    assert_same({name: values[:N_VIEW] for name, values in own.items()}, reported)


@pytest.mark.ci
def test_images_at_a_time_fit_the_cache_of_the_cpu_and_are_many_on_cuda(scene):
    scene = device_scene(scene.replace(camera=SMALL, bands=["A", "C"]), ["A", "C"], "cpu")
    gpu = dataclasses.replace(scene, device=SimpleNamespace(is_cuda=True))
    for where, room in ((scene, 2**20), (gpu, 2**29)):
        n_image = schedule.images_at_a_time(where, 10**6)
        assert n_image * IMAGE_BYTES <= room < (n_image + 1) * IMAGE_BYTES
        assert schedule.images_at_a_time(where, 5) == 5
    assert schedule.most_views(gpu, 100) > schedule.images_at_a_time(scene, 10**6)


@pytest.mark.slow
@pytest.mark.parametrize("psf", ["airy", "gaussian"])
@pytest.mark.parametrize("changes", SCENES.values(), ids=SCENES)
def test_light_does_not_depend_on_the_rows_that_threads_own(psf, changes, monkeypatch):
    """Where a stamp ends just on the edge of a thread's rows, too."""
    scene = ws.Scene.load("stss").replace(optics__psf=psf, **changes)

    def light(n_row):
        monkeypatch.setattr(stages, "rows_per_block", lambda device, rows, n_image: n_row)
        frames = ws.Renderer(scene, "cpu").render([60, 61], ["sat11"], keep_signal=True)
        return frames.signal_w_cm2.numpy().copy()

    whole = light(128)
    for n_row in (1, 3, 8):
        np.testing.assert_array_equal(light(n_row), whole)


@pytest.mark.ci
def test_threads_of_a_deposit_own_few_rows_on_cuda():
    """One row of few images, up to eight of many, all on the CPU."""
    cpu, gpu = SimpleNamespace(is_cuda=False), SimpleNamespace(is_cuda=True)
    assert [rows_per_block(gpu, 128, n) for n in (1, 256, 512, 800, 10_000)] == [1, 1, 2, 3, 8]
    assert rows_per_block(cpu, 128, 10_000) == 128


EVEN = [
    range(5),
    range(3, 90, 7),
    range(40, 2, -3),
    [1, 2, 3],
    [9, 6, 3],
    np.arange(50),
    np.array([8, 4], dtype=np.uint8),
]
UNEVEN = [[4, 4], [1, 2, 4], [7, 7, 8], [3], np.array([5, 1, 2]), (np.int64(2), 0, 7), [0, 2, 4, 6, 9]]


@pytest.fixture
def checked(scene):
    return lambda frames: checked_frames(frames, scene.scenario.instrument, scene.duration_s)


@pytest.mark.parametrize("frames", [*EVEN, *UNEVEN], ids=str)
def test_numbers_are_those_asked_for(checked, frames):
    found = checked(frames)
    assert list(found) == [int(number) for number in frames]
    assert all(type(number) is int for number in found)
    assert isinstance(found, range) == any(frames is even for even in EVEN)


def test_no_frames_are_fine(checked):
    for frames in ([], range(0), np.zeros(0, dtype=int)):
        assert list(checked(frames)) == []


@pytest.mark.parametrize(
    ("frames", "wrong"),
    [
        ([3, -1, -2], "-1"), (range(3, -3, -1), "-2"), ([0, 2**32], "4294967296"), ([1, 2**70], str(2**70)),
        (np.array([4, -7, 1]), "-7"), ([True, 1], "True"), ([1.5], "1.5"), (np.array([1.0]), "1"), (range(-4, 4), "-4"),
    ],
    ids=str,
)  # fmt: skip
def test_wrong_numbers_are_named(checked, frames, wrong):
    with pytest.raises(InputError, match=rf"frames: must be whole numbers from 0 to 2\*\*32 - 1, got {wrong}"):
        checked(frames)


def test_frames_beyond_the_scene_are_named(checked):
    for frames in (range(160, 170), [0, 165, 3], np.array([165, 166])):
        with pytest.raises(InputError, match=r"frame 16[25] is at 16[25]0 s, after the scene's end"):
            checked(frames)


@pytest.mark.parametrize("frames", [b"ab", "12", np.array(3), np.float64(2.0)])
def test_what_is_no_list_of_numbers_is_refused(checked, frames):
    with pytest.raises(InputError, match="frames: must be a list or range of frame numbers"):
        checked(frames)


def test_endless_ranges_are_refused_by_their_ends(checked):
    with pytest.raises(InputError, match="after the scene's end"):
        checked(range(2**32))
