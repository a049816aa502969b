"""Likelihood of counts and Fisher information: against closed forms, draws of the renderer's noise, and differences."""

import numpy as np
import pytest
import scipy.stats
from test_resolution import ELECTRONS

import warpsim as ws
from warpsim.render.likelihood import pixel_likelihood, read_light

BASE = {"optics__psf": "gaussian", "optics__sigma_px": 0.8, "sky__catalog": "default"}
BENT = {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "nonlinearity": 0.1}
DETECTORS = {"nei": None, "electrons": ELECTRONS, "bent": BENT, "bent electrons": ELECTRONS | {"nonlinearity": 0.1}}


def rendered(detector=None, frames=(60,), sensors=("sat27",), bands=("A",), **changes):
    scene = ws.Scene.load("stss").replace(**(BASE | ({"detector": detector} if detector else {}) | changes))
    return ws.Renderer(scene, device="cpu").render(
        list(frames), list(sensors), list(bands), keep_signal=True, keep_stars=True
    )


@pytest.mark.parametrize("name", DETECTORS)
def test_density_of_a_pixel_is_that_of_a_normal_distribution(name):
    frames = rendered(DETECTORS[name])
    levels, nei = frames.instrument.levels["A"], frames.instrument.nei_w_cm2("A")
    light = np.array([0.0, 3.0, 40.0, 400.0]) * nei
    counts = np.round(levels.blank_counts + levels.counts_per_nei * np.array([1.0, 2.0, 41.0, 390.0]))
    density, slope, used = pixel_likelihood(frames.instrument, "A", counts, light)
    per_light = levels.counts_per_nei / nei
    detector = frames.instrument.sensor.detector
    mean = levels.blank_counts + light * per_light
    if name == "bent":
        mean = levels.blank_counts + light * (1 - 0.1 * light / levels.sei_w_cm2) * per_light
    if name == "bent electrons":
        e = levels.background_e + levels.dark_e + light * levels.e_per_w_cm2
        mean = detector.offset_counts + e * (1 - 0.1 * e / detector.full_well_e) / detector.gain_e_per_count
    variance = np.full(4, levels.counts_per_nei**2)
    variance = variance + (1 / 12 if "electrons" not in name else light / levels.e_per_w_cm2 * per_light**2)
    np.testing.assert_allclose(density[used], scipy.stats.norm.logpdf(counts, mean, np.sqrt(variance))[used], rtol=1e-9)
    h = 1e-3 * nei

    def at(more):
        return pixel_likelihood(frames.instrument, "A", counts, light + more)[0]

    expected = (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h)
    np.testing.assert_allclose(slope[used][1:], expected[used][1:], rtol=1e-7)
    read, by_light = read_light(frames.instrument, "A", light)
    up, down = (read_light(frames.instrument, "A", light + more)[0] for more in (h, -h))
    np.testing.assert_allclose(by_light, (up - down) / (2 * h), rtol=1e-8)
    assert used[:3].all() and read.shape == light.shape


def test_full_pixels_do_not_count():
    frames = rendered()
    sei = frames.instrument.levels["A"].sei_w_cm2
    counts, light = np.array([16383, 100, 100]), np.array([0.0, 2 * sei, 0.0])
    _, slope, used = pixel_likelihood(frames.instrument, "A", counts, light)
    assert used.tolist() == [False, False, True] and not slope[:2].any()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nei", "electrons"])
def test_scores_of_the_renderers_own_noise_have_mean_zero_and_the_information(name):
    """The score's mean over draws is 0, its covariance the Fisher information: of counts that the renderer made."""
    frames = rendered(DETECTORS[name], [100])
    targets = frames.truth["target"][frames.truth["neighbour_px"] > 4].tolist()
    information = ws.fisher(frames, targets=targets)
    chosen = [frames.scenario.target_names.index(target) for target in dict.fromkeys(information.target)]
    scene = frames.scene
    scores = []
    n_draw, renderer = 100, ws.Renderer(frames.scenario, device="cpu")
    for seed in range(n_draw):
        drawn = renderer.with_scene(scene.replace(noise_seed=seed)).render([100], ["sat27"], ["A"])
        found = ws.log_likelihood(frames, drawn.counts.numpy())
        gradient = found.gradient
        scores.append(np.concatenate([gradient[key].ravel()[chosen] for key in ("x_px", "y_px", "irradiance_w_cm2")]))
    scores = np.array(scores) * information.sigma
    scaled = information.information * np.outer(information.sigma, information.sigma)
    size = np.sqrt(np.diag(scaled))
    assert np.abs(scores.mean(axis=0) / size * np.sqrt(n_draw)).max() < 5
    ratio = scores.var(axis=0) / size**2
    assert np.abs(ratio - 1).max() < 5 * np.sqrt(2 / n_draw)


def test_gradient_is_that_of_the_likelihood_of_scenes_drawn_again():
    """By the light and the position of one target: central differences of the sum over pixels."""
    frames = rendered(optics__stamp_cut_nei=1e-4)
    counts = frames.counts.numpy()
    found = ws.log_likelihood(frames, counts)
    target = int(np.argmax(frames.target_light.irradiance_w_cm2[0, 0]))
    image = frames.signal_w_cm2.numpy()[0, 0, 0].astype(np.float64)
    row = frames.truth[target]
    args = ([row["irradiance_w_cm2"]], ws.PsfGaussian(0.8), image.shape)

    def value(dx, dy):
        shift = ws.deposit([[row["x_px"] + dx, row["y_px"] + dy]], *args, flux_error=1e-9).astype(np.float64)
        shift -= ws.deposit([[row["x_px"], row["y_px"]]], *args, flux_error=1e-9)
        return pixel_likelihood(frames.instrument, "A", counts[0, 0, 0], image + shift)[0].sum()

    h = 1e-2
    for name, step in (("x_px", (h, 0)), ("y_px", (0, h))):
        slope = (value(*step) - value(-step[0], -step[1])) / (2 * h)
        mine = found.gradient[name][0, 0, target]
        bound = row["x_sigma_px"] if name == "x_px" else row["y_sigma_px"]
        assert abs(slope - mine) < 1e-2 * max(abs(mine), 1 / bound)
    assert found.value == found.images.sum() and found.n_pixel[0, 0, 0] > 0.99 * image.size


BOUNDS = 0.04
"""Pixels outside the window of the truth's, light of neighbours that is noise, too, and its differences."""


@pytest.mark.ci
@pytest.mark.parametrize("name", ["nei", "electrons"])
def test_bounds_of_lone_targets_are_those_of_the_truth(name):
    """The truth has bounds of each target with all else known, by differences of central steps in a window."""
    frames = rendered(DETECTORS[name], [100])
    truth = frames.truth
    n_seen = 0
    for row in truth[(truth["snr"] > 5) & truth["in_fov"]]:
        table = ws.fisher(frames, targets=row["target"]).table()
        assert table["parameter"].tolist() == ["x_px", "y_px", "irradiance_w_cm2"]
        expected = [row["x_sigma_px"], row["y_sigma_px"], row["irradiance_sigma_w_cm2"]]
        if row["neighbour_px"] > 8:
            np.testing.assert_allclose(table["sigma"], expected, rtol=BOUNDS)
            n_seen += 1
        assert (table["alone"] <= table["sigma"] * (1 + 1e-12)).all()
    assert n_seen >= 3


def test_blended_targets_and_a_free_camera_have_larger_bounds():
    frames = rendered(bands=("A", "C"))
    alone = {target: ws.fisher(frames, targets=target).sigma[0] for target in ws.fisher(frames).target[:3]}
    together = ws.fisher(frames)
    for number, target in enumerate(alone):
        assert together.sigma[number] >= alone[target] * (1 - 1e-9)
    assert set(together.band) == {"", "A", "C"}
    camera = ws.fisher(frames, wrt=["boresight_rad", "roll_rad"])
    assert camera.parameter == ["boresight_x_rad", "boresight_y_rad", "roll_rad"] and (camera.sigma > 0).all()
    both = ws.fisher(frames, wrt=["x_px", "y_px", "irradiance_w_cm2", "boresight_rad"])
    assert (both.sigma[: len(alone)] >= together.sigma[: len(alone)] * (1 - 1e-9)).all()


def test_bounds_of_an_image_do_not_depend_on_other_images():
    """Views have lists of stars of different lengths."""
    many = rendered(frames=(0, 100), sensors=("sat11", "sat27"), bands=("A", "C"))
    one = rendered(frames=(100,), sensors=("sat11",), bands=("A", "C"))
    assert len({len(many.stars[many.stars["sensor"] == name]) for name in many.sensors}) > 1
    wrt = ["irradiance_w_cm2", "boresight_rad", "roll_rad"]
    targets = one.truth["target"][one.truth["neighbour_px"] > 2].tolist()[:2] or [one.scenario.target_names[0]]
    found, alone = ws.fisher(many, 100, "sat11", wrt, targets), ws.fisher(one, wrt=wrt, targets=targets)
    np.testing.assert_array_equal(found.information, alone.information)


def test_what_an_image_cannot_tell_is_named():
    bare = rendered(sky__catalog="none")
    with pytest.raises(ws.InputError, match=r"fisher: the image does not tell these apart .*boresight"):
        ws.fisher(bare, wrt=["x_px", "y_px", "boresight_rad"])
    early = rendered(sky__catalog="none", camera={"n_row": 8, "n_col": 8, "fov_deg": 1e-3})
    dark = next(row["target"] for row in early.truth if max(abs(row["x_px"]), abs(row["y_px"])) > 100)
    with pytest.raises(ws.InputError, match="fisher: tells nothing of x_px"):
        ws.fisher(early, targets=dark)
    with pytest.raises(ws.InputError, match="fisher: render with keep_signal=True"):
        ws.fisher(ws.Renderer(bare.scenario, device="cpu").render([60], "sat27", "A"))
    with pytest.raises(ws.InputError, match="wrt: must be of x_px"):
        ws.fisher(bare, wrt="range_m")
    two = rendered(frames=(60, 61))
    with pytest.raises(ws.InputError, match="frame: must be one of 60, 61"):
        ws.fisher(two)
    with pytest.raises(ws.InputError, match="counts: must be numbers of shape"):
        ws.log_likelihood(two, np.zeros((3, 3)))
    with pytest.raises(ws.InputError, match="log_likelihood: render with keep_signal"):
        ws.log_likelihood(ws.Renderer(bare.scenario, device="cpu").render([60], "sat27", "A"), 0)
