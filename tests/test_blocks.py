"""Kernels for blocks of threads, as CUDA has them: on the CPU, where threads of a block are fibers with barriers.

Stars gathered by 32 threads, and deposit and read-out at once, against the stages of one thread, which have oracles.

One launch at a time: two that run beside each other crash Warp's blocks on the CPU, which are experimental.
"""

import numpy as np
import pytest
import warp as wp
from warpsim_kernels.deposit_read_out import make_deposit_read_out_kernel
from warpsim_kernels.detector import ReadOutFeatures
from warpsim_kernels.spots import gaussian_spots

import warpsim as ws
from warpsim.render import pipeline, stages
from warpsim.speed.work import speed_work

GAUSSIAN = {"optics__psf": "gaussian", "optics__sigma_px": 0.7}
NEI_TERMS = {
    "detector__prnu": 0.02, "detector__dsnu_nei": 1.0, "detector__column_noise_nei": 0.5,
    "detector__dead_fraction": 0.01, "detector__hot_fraction": 0.01, "detector__nonlinearity": 0.05,
}  # fmt: skip
ELECTRONS = ws.ElectronDetector(
    exposure_s=0.1, full_well_e=2e4, gain_e_per_count=1.0, bits=16, transmission=0.6, quantum_efficiency=0.5,
    dark_e_s=40.0, read_noise_e=2.0, prnu=0.01, dsnu=0.3, column_noise_e=3.0, dead_fraction=0.01, hot_fraction=0.01,
    nonlinearity=0.1, streaks=False,
)  # fmt: skip


def shape(n_row, n_col):
    return {"camera__n_row": n_row, "camera__n_col": n_col}


CASES = {
    "Airy": {},
    "Gaussian": GAUSSIAN,
    "NEI, all terms": NEI_TERMS,
    "electrons, all terms": {"detector": ELECTRONS},
    "runs that begin within a row": shape(96, 120),
    "less than a block of strips": {**GAUSSIAN, **shape(16, 24)},
    "pixels higher than wide": {**GAUSSIAN, "camera__pixel_aspect": 1.3},
    "nothing in the sky": {
        "groups": [],
        "sky__catalog": "none",
        "pointing": {"kind": "fixed", "ra_dec_deg": [10.0, 20.0]},
    },
    "wide stamps, beyond the table": {"optics__stamp_cut_nei": 1e-5, **shape(64, 256)},
}
"""By name, what is changed of `stss`."""


@pytest.fixture
def blocks(monkeypatch):
    """Lets the CPU launch blocks of several threads."""
    monkeypatch.setattr(wp.config, "enable_cpu_blocks", True)


@pytest.fixture
def at_once(blocks, monkeypatch):
    """Makes the CPU render as CUDA would."""

    def is_read_out_at_once(scene):
        camera = scene.instrument.sensor.camera
        return not scene.streaks.enabled and camera.n_row * camera.n_col % stages.STRIP_PIXELS == 0

    monkeypatch.setattr(pipeline, "is_read_out_at_once", is_read_out_at_once)


def counts_of(scene, **arguments):
    renderer = ws.Renderer(scene, device="cpu", n_thread=1)
    frames = renderer.render(
        [0, 7, 150], sensors=(renderer.sensors_with_access or scene.scenario.instrument.names)[:2], **arguments
    )
    (pipelines,) = renderer._pipelines.values()
    return frames.counts.numpy(), pipelines._pipelines[0]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.ci
def test_counts_are_those_of_deposit_and_read_out(name, at_once, monkeypatch):
    scene = ws.Scene.load("stss").replace(**CASES[name])
    counts, made = counts_of(scene)
    assert made._at_once is not None and made._images is None
    with monkeypatch.context() as patch:
        patch.setattr(pipeline, "is_read_out_at_once", lambda scene: False)
        expected, other = counts_of(scene)
    assert other._at_once is None
    np.testing.assert_array_equal(counts, expected)
    assert np.ptp(expected) > (100 if scene.scenario.targets else 20)


@pytest.mark.parametrize("psf", ["airy", "gaussian"])
@pytest.mark.ci
def test_more_sources_than_threads(psf, at_once):
    """They are looked at some at a time, in order; sums of overlapping stars are those of the signal that is kept."""
    work = speed_work(96, 700, 1, psf)
    renderer = ws.Renderer(work.scene, device="cpu", n_thread=1, catalog=work.catalog)
    counts = renderer.render(range(2), work.sensors, keep_stars=True)
    kept = renderer.render(range(2), work.sensors, keep_signal=True)
    assert len(counts.stars) > 2 * stages.RUN_THREADS
    assert counts.signal_w_cm2 is None and kept.signal_w_cm2 is not None
    np.testing.assert_array_equal(counts.counts.numpy(), kept.counts.numpy())


@pytest.mark.ci
def test_frames_are_the_same_alone_and_in_any_batch(at_once):
    renderer = ws.Renderer(ws.Scene.load("stss"), device="cpu", n_thread=1)
    sensors = renderer.sensors_with_access[:2]
    batch = renderer.render([4, 9, 2], sensors).counts.numpy()
    np.testing.assert_array_equal(renderer.render([9], sensors[1]).counts.numpy()[0, 0], batch[1, 1])


@pytest.mark.ci
def test_images_that_strips_do_not_fill_take_both_stages(at_once):
    _, made = counts_of(ws.Scene.load("stss").replace(**shape(33, 57)))
    assert made._at_once is None


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"sky__parallax": True, "sky__light_deflection": True},
        {"camera__distortion": {"k1": 0.01}, "detector__exposure_s": 0.01},
    ],
    ids=["stss", "all shifts", "a lens, streaks"],
)
@pytest.mark.ci
def test_stars_gathered_by_32_threads(changes, blocks, monkeypatch):
    """The same stars, in the same order and with the same bits: more than a round of threads can take."""
    work = speed_work(128, 300, 1, "gaussian")
    scene = work.scene.replace(**changes)

    def stars(n_thread):
        for module in (stages, stars):
            monkeypatch.setattr(module, "star_threads", lambda device: n_thread)
        renderer = ws.Renderer(scene, device="cpu", n_thread=1, catalog=work.catalog)
        return renderer.render([0, 80, 161], sensors=scene.scenario.instrument.names[:4], keep_stars=True).stars

    one, many = stars(1), stars(32)
    assert one.colnames == many.colnames and len(one) > 500
    for name in one.colnames:
        np.testing.assert_array_equal(many[name], one[name], err_msg=name)


@pytest.mark.parametrize("n_thread", [1, 32, 192, 2048])
def test_threads_that_do_not_own_pixels_evenly_are_refused(n_thread):
    with pytest.raises(ValueError, match=f"n_thread: must be one of .*, got {n_thread}"):
        make_deposit_read_out_kernel(gaussian_spots(), ReadOutFeatures(), n_thread)
