"""The detector in electrons: its chain against a float64 twin, its noise, and the NEI it implies."""

import dataclasses

import numpy as np
import pytest
from astropy import constants as const
from astropy import units as u
from astropy.modeling.models import BlackBody
from read_outs import (
    CAMERA,
    N_SIGMA,
    N_SIGMA_TAIL,
    OPTICS,
    SEED,
    assert_alone_as_in_batch,
    assert_uncorrelated,
    levels_of,
    read_out,
    twin_columns,
    twin_deviates,
)
from scipy import stats
from warpsim_kernels.canvas import N_PAIR, STRIP_PIXELS
from warpsim_kernels.pixel_pairs import STREAM_GAIN, STREAM_OFFSET

import warpsim as ws
from warpsim.output.check import scene_report
from warpsim.output.fits_header import scene_cards
from warpsim.output.run import render_to_folder
from warpsim.render.read_out import read_out_features

SHAPE = (1, 1, 1024, 1024)
# Some 1.2e6 electrons of background, as in a warm thermal-infrared band; 300 electrons of dark current.
WARM = ws.ElectronDetector(
    exposure_s=0.1, full_well_e=5e6, gain_e_per_count=320.0, bits=14, offset_counts=100.0, transmission=0.6,
    quantum_efficiency=0.5, background_w_cm2_sr=3.76e-8, dark_e_s=3000.0, read_noise_e=100.0,
)  # fmt: skip
# Few electrons: every pixel is below the smallest mean of the expansion until it is lit.
COLD = ws.ElectronDetector(
    exposure_s=0.1, full_well_e=20000.0, gain_e_per_count=1.0, bits=16, offset_counts=200.0, transmission=0.6,
    quantum_efficiency=0.5, dark_e_s=40.0, read_noise_e=2.0,
)  # fmt: skip
ALL_TERMS = {"prnu": 0.01, "dead_fraction": 0.01, "hot_fraction": 0.01, "nonlinearity": 0.1}
QUIET = {"shot_noise": False, "read_noise_e": 0.0}

ELECTRONS_RTOL = 5e-7  # eight float32 roundings of 6e-8 from signal to counts: where a rounding edge may be missed


def bright(detector, most_e, shape=SHAPE, seed=1):
    """Signal whose electrons spread evenly up to most_e, and those electrons in float64."""
    per = levels_of(detector).e_per_w_cm2
    signal = (np.random.default_rng(seed).uniform(0, most_e, shape) / per).astype(np.float32)
    return signal, signal.astype(np.float64) * per


def test_electrons_by_hand():
    """Electrons per irradiance, background and dark current from constants and integrals of other packages."""
    warm_optics = {"optics_temperature_k": 120.0, "optics_emissivity": 0.08}
    deep = {"full_well_e": 5e7, "gain_e_per_count": 3200.0}
    sky = {"background_w_cm2_sr": {"A": 4.5e-8}, "zodiacal_mjy_sr": 15.0}
    detector = dataclasses.replace(WARM, **warm_optics, **deep, **sky)
    band = ws.BANDS["A"]
    area = np.pi / 4 * (40 * u.cm) ** 2 * (1 - 0.3**2)
    photon = const.h * const.c / (9.91 * u.um)  # where band A has its peak
    per_irradiance = (area * 0.6 * 0.5 * 0.1 * u.s / photon).to_value(u.cm**2 / u.W)
    pixel = (np.tan(np.radians(0.5)) / 64) ** 2 * u.sr

    nodes = np.concatenate([band.wavelength_um, np.linspace(*band.wavelength_um[[0, -1]], 20001)])
    wavelength = np.unique(nodes) * u.um
    response = np.interp(wavelength.value, band.wavelength_um, band.response)

    def in_band(radiance):  # per wavelength
        return np.trapezoid(response * radiance, wavelength).to(u.W / u.cm**2 / u.sr)

    zodiacal = in_band(15 * u.MJy / u.sr * const.c / wavelength**2)
    own = 0.08 * in_band(BlackBody(120 * u.K, scale=1 * u.W / u.m**2 / u.um / u.sr)(wavelength))
    sky = 4.5e-8 * u.W / u.cm**2 / u.sr + zodiacal
    background = ((sky + own / 0.6) * pixel).to_value(u.W / u.cm**2) * per_irradiance

    known = levels_of(detector)
    assert known.e_per_w_cm2 == pytest.approx(per_irradiance, rel=1e-12)
    assert known.background_e == pytest.approx(background, rel=1e-6)  # the trapezoids' error
    assert known.dark_e == pytest.approx(300.0, rel=1e-12)
    noise = np.sqrt(background + 300 + 100**2 + 3200**2 / 12)
    assert known.noise_e == pytest.approx(noise, rel=1e-6)
    assert known.nei_w_cm2 == pytest.approx(noise / per_irradiance, rel=1e-6)
    assert known.sei_w_cm2 == pytest.approx((5e7 - background - 300) / per_irradiance, rel=1e-6)


def test_the_converter_may_saturate_first():
    short = dataclasses.replace(WARM, gain_e_per_count=160.0)
    known = levels_of(short)
    assert known.sei_w_cm2 == pytest.approx(
        ((2**14 - 1 - 100) * 160 - known.background_e - 300) / known.e_per_w_cm2, rel=1e-12
    )
    bent = levels_of(dataclasses.replace(short, nonlinearity=0.2))
    full_e = bent.sei_w_cm2 * bent.e_per_w_cm2 + bent.background_e + 300
    assert full_e * (1 - 0.2 * full_e / 5e6) == pytest.approx((2**14 - 1 - 100) * 160, rel=1e-12)


def twin_counts(detector, electrons, column=0.0):
    """Counts before rounding, in float64, of mean electrons by light alone; no noise but that by column."""
    known = levels_of(detector)
    held = np.minimum(electrons + known.background_e + known.dark_e, detector.full_well_e)
    read = held * (1 - detector.nonlinearity * held / detector.full_well_e) + column
    return np.clip(read / detector.gain_e_per_count + detector.offset_counts + 0.5, 0, 2**detector.bits - 1)


@pytest.mark.parametrize(
    "changes",
    [{}, {"nonlinearity": 0.31}, {"bits": 12}, {"full_well_e": 2e6}, {"gain_e_per_count": 5.0, "bits": 16}],
    ids=str,
)
@pytest.mark.parametrize("shape", [(64, 128), (7, 61)], ids=str)
@pytest.mark.ci
def test_chain_without_noise(device, changes, shape):
    detector = dataclasses.replace(WARM, **QUIET, **changes)
    if changes.get("bits") == 16:
        detector = dataclasses.replace(detector, background_w_cm2_sr=0.0)
    signal, electrons = bright(detector, 6e6, (1, 1, *shape))
    counts = read_out(detector, signal, device)
    free = twin_counts(detector, electrons)
    near = np.abs(free - np.round(free)) < ELECTRONS_RTOL * free
    near &= (free > 0.5) & (free < 2**detector.bits - 1.5)
    np.testing.assert_array_equal(counts[~near], np.floor(free[~near]))
    assert np.abs(counts - np.floor(free)).max() <= 1
    assert near.mean() < 0.1


@pytest.mark.ci
def test_column_noise_without_other_noise(device):
    detector = dataclasses.replace(WARM, **QUIET, column_noise_e=2000.0)
    signal, electrons = bright(detector, 3e6, (1, 1, 20, 70))
    counts = read_out(detector, signal, device, frames=[5], sensors=[3])
    column = twin_columns(5, 3, 0, SEED, 70)
    free = twin_counts(detector, electrons, 2000.0 * column)
    assert np.abs(counts - np.floor(free)).max() <= 1
    assert (counts != np.floor(free)).mean() < 0.02


@pytest.mark.parametrize(
    ("detector", "light_e"),
    [(WARM, 0.0), (WARM, 2e6), (COLD, 0.0), (COLD, 7.0), (COLD, 300.0)],
    ids=["warm", "warm-lit", "cold", "cold-7", "cold-300"],
)
@pytest.mark.ci
def test_noise_has_the_variance_of_its_terms(device, detector, light_e):
    """Mean and variance of counts over a million pixels: Poisson, reading, and rounding to counts."""
    known = levels_of(detector)
    signal = np.full(SHAPE, light_e / known.e_per_w_cm2)
    counts = read_out(detector, signal, device).astype(np.float64).ravel()
    mean_e = light_e + known.background_e + known.dark_e
    gain, n = detector.gain_e_per_count, counts.size
    variance = (mean_e + detector.read_noise_e**2) / gain**2 + 1 / 12
    fourth = 3 * variance**2 + mean_e / gain**4
    assert abs(counts.mean() - detector.offset_counts - mean_e / gain) < N_SIGMA * np.sqrt(variance / n)
    assert abs(counts.var() - variance) < N_SIGMA * np.sqrt((fourth - variance**2) / n)
    third = mean_e / gain**3
    assert abs(((counts - counts.mean()) ** 3).mean() - third) < N_SIGMA * np.sqrt(15 * variance**3 / n)


@pytest.mark.ci
def test_blank_frames_show_the_implied_nei(device):
    """Standard deviation of blank frames, in counts and per counts of a small signal, is 1 NEI; so is the header's."""
    for detector in (WARM, COLD, dataclasses.replace(WARM, nonlinearity=0.3, column_noise_e=0.0)):
        known = levels_of(detector)
        blank = read_out(detector, np.zeros((10, 1, 400, 400)), device).astype(np.float64)
        n = blank.size
        assert abs(blank.std() / known.counts_per_nei - 1) < N_SIGMA / np.sqrt(2 * n) + 2e-4  # rounding is not uniform
        assert abs(blank.mean() - known.blank_counts) < 5 * N_SIGMA * known.counts_per_nei / np.sqrt(n)
        faint = read_out(detector, np.full(blank.shape, 0.5 * known.nei_w_cm2), device, frames=np.arange(10, 20))
        rise = (faint.mean() - blank.mean()) / known.counts_per_nei
        assert abs(rise - 0.5) < N_SIGMA * np.sqrt(2 / n) + 2e-4  # the curve's own, at half an NEI


@pytest.mark.ci
def test_counts_are_distributed_as_those_of_the_nei_detector_it_implies(device):
    """On blank sky and for faint sources, where shot noise is that of the background."""
    known = levels_of(WARM)
    same = ws.NeiDetector(
        known.nei_w_cm2, known.sei_w_cm2, offset_counts=known.blank_counts, counts_per_nei=known.counts_per_nei
    )
    for light_nei in (0.0, 1.0, 5.0):
        signal = np.full(SHAPE, light_nei * known.nei_w_cm2)
        electrons = read_out(WARM, signal, device, frames=[1]).ravel().astype(np.float64)
        plain = read_out(same, signal, device, frames=[2]).ravel().astype(np.float64)
        n = electrons.size
        assert abs(electrons.mean() - plain.mean()) < N_SIGMA * known.counts_per_nei * np.sqrt(2 / n)
        # 5 NEI of 1.2e6 electrons add half a percent of shot noise, a quarter of that to the deviation.
        assert abs(electrons.std() / plain.std() - 1) < N_SIGMA / np.sqrt(n) + 0.0025 * light_nei / 5
        # The detector's noise includes the rounding to counts, which is done to both: a little more for the plain one.
        statistic = stats.ks_2samp(electrons, plain).statistic
        assert statistic * np.sqrt(n / 2) < np.sqrt(-0.5 * np.log(N_SIGMA_TAIL)) + 0.002 * np.sqrt(n / 2)


@pytest.mark.ci
def test_saturated_electrons_read_full_well_with_read_noise(device):
    counts = read_out(WARM, np.full(SHAPE, 1e6 * levels_of(WARM).sei_w_cm2), device).astype(np.float64)
    full = 100 + 5e6 / 320
    assert abs(counts.mean() - full) < N_SIGMA * 0.5 / 1024
    edges = stats.norm.cdf((np.arange(-6, 6) + 0.5) * 320 / 100)  # the mean is a whole count
    rounded = np.diff(edges) @ np.arange(-5, 6) ** 2
    assert abs(counts.var() - rounded) < N_SIGMA * np.sqrt(3) * rounded / 1024


@pytest.mark.parametrize("terms", [{}, {"prnu": 0.1, "dsnu": 1.0, "hot_fraction": 0.1, "nonlinearity": 0.5}], ids=str)
@pytest.mark.ci
def test_any_signal_gives_counts_in_range(device, terms):
    """From nothing to what overflows float32, below zero and not a number: saturated or dark, never wrapped."""
    detector = dataclasses.replace(WARM, bits=16, offset_counts=0.0, gain_e_per_count=90.0, **terms)
    plain = ws.NeiDetector(1e-18, 3e-15, bits=16, offset_counts=0.0, counts_per_nei=30.0)
    rows = [np.full(200, value) for value in (0, 1e-45, 1e-25, 1e-10, 1.0, 3e38, np.inf, np.nan)]
    dark = [np.full(200, value) for value in (-1e-25, -1e-10, -3e38, -np.inf)]
    for ragged in (False, True):
        with np.errstate(over="ignore"):
            signal = np.array([*rows, *dark], dtype=np.float32)[None, None]
        for one in (detector, plain):
            counts = read_out(one, signal, device, ragged=ragged)[0, 0]
            most = 2 * 3000 * 30 if one is plain else 5e6 * (1 - one.nonlinearity) / 90 + 20
            assert (counts[3:8] >= min(65535, most) * 0.4).all()
            assert counts.max() <= most
            assert np.diff(counts[2:4].astype(int).mean(axis=1)) > 0
            assert counts[9:].mean() < counts[0].mean() + 10 + 0.11 * counts[3].mean()  # hot pixels are among them


@pytest.mark.ci
def test_one_pixel(device):
    counts = np.array([read_out(WARM, np.zeros((1, 1, 1, 1)), device, frames=[k])[0, 0, 0, 0] for k in range(200)])
    known = levels_of(WARM)
    assert abs(counts.mean() - known.blank_counts) < N_SIGMA * known.counts_per_nei / np.sqrt(200)
    assert counts.std() == pytest.approx(known.counts_per_nei, rel=0.3)


def standardised(device, shape=SHAPE, detector=COLD, **numbers):
    counts = read_out(detector, np.full(shape, 30.0 / levels_of(COLD).e_per_w_cm2), device, **numbers)
    return (counts.astype(np.float64) - 234) / np.sqrt(34 + 4 + 1 / 12)


@pytest.mark.ci
def test_pixels_frames_sensors_bands_and_seeds_are_independent(device):
    z = standardised(device)[0, 0]
    assert_uncorrelated(z[:, :-1], z[:, 1:])
    assert_uncorrelated(z[:-1], z[1:])
    tiles = z.reshape(-1, 2, 64)
    assert_uncorrelated(tiles[:, 0], tiles[:, 1])
    for other in ({"frames": [1]}, {"sensors": [1]}, {"seed": SEED + 1}):
        assert_uncorrelated(z, standardised(device, **other)[0, 0])


@pytest.mark.ci
def test_shot_noise_is_independent_of_read_noise(device):
    shot = standardised(device, detector=dataclasses.replace(COLD, read_noise_e=0.0))
    read = standardised(device, detector=dataclasses.replace(COLD, shot_noise=False, read_noise_e=5.0))
    assert_uncorrelated(shot, read)


@pytest.mark.ci
def test_persistent_terms(device):
    """Gains act on light and background, dark currents differ by a share and have shot noise."""
    n_frame = 40
    detector = dataclasses.replace(WARM, prnu=0.02, gain_e_per_count=80.0, bits=16)
    signal = np.full((n_frame, 1, 64, 128), 2e6 / levels_of(WARM).e_per_w_cm2)
    mean = read_out(detector, signal, device).astype(np.float64).mean(axis=0).ravel()
    gain = 1 + 0.02 * twin_deviates(0, 0, 0, SEED, mean.size, stream=int(STREAM_GAIN))
    known = levels_of(detector)
    expected = 100 + ((2e6 + known.background_e) * gain + known.dark_e) / 80
    sigma = np.sqrt(2e6 + known.background_e + 1e4) / 80 / np.sqrt(n_frame)
    assert np.abs(mean - expected).max() < 6 * sigma  # 8,192 pixels

    dark = dataclasses.replace(COLD, dark_e_s=20000.0, dsnu=0.5)
    frames = read_out(dark, np.zeros((n_frame, 1, 64, 128)), device).astype(np.float64)[:, 0].reshape(n_frame, -1)
    current = 2000 * np.maximum(1 + 0.5 * twin_deviates(0, 0, 0, SEED, 8192, stream=int(STREAM_OFFSET)), 0)
    assert np.abs((frames.mean(axis=0) - 200 - current) / np.sqrt((current + 4.1) / n_frame)).max() < 6
    share = frames.var(axis=0, ddof=1).sum() / (current + 4 + 1 / 12).sum()
    assert abs(share - 1) < N_SIGMA * np.sqrt(2 / (n_frame - 1) / 8192) * 1.2  # currents differ: fewer count
    dead = read_out(dataclasses.replace(COLD, dead_fraction=0.5), np.full(SHAPE, 1e-10), device)
    assert abs((dead < 250).mean() - 0.5) < N_SIGMA * 0.5 / 1024


@pytest.mark.parametrize("detector", [WARM, COLD], ids=["warm", "cold"])
@pytest.mark.parametrize(
    "terms",
    [{}, {"shot_noise": False}, ALL_TERMS | {"dsnu": 0.3, "column_noise_e": 9.0}],
    ids=["plain", "no-shot-noise", "all"],
)
@pytest.mark.ci
def test_an_image_does_not_depend_on_its_batch(device, detector, terms):
    detector = dataclasses.replace(detector, **terms)
    signal, _ = bright(detector, detector.full_well_e / 2, (3, 2, 40, 61))
    assert_alone_as_in_batch(detector, signal, device)


def test_the_search_is_compiled_only_for_small_means():
    known = {"A": levels_of(WARM)}
    assert not read_out_features(WARM, known).small_means
    assert not read_out_features(dataclasses.replace(WARM, prnu=0.1), known).small_means
    assert read_out_features(dataclasses.replace(WARM, dsnu=0.3, dark_e_s=0.0), known).dsnu is False
    assert read_out_features(COLD, {"A": levels_of(COLD)}).small_means
    assert read_out_features(WARM, {"A": known["A"], "C": levels_of(COLD)}).small_means
    assert not read_out_features(dataclasses.replace(COLD, shot_noise=False), {"A": levels_of(COLD)}).small_means


@pytest.fixture(scope="module")
def warm_scene(scene):
    detector = dataclasses.replace(WARM, background_w_cm2_sr={"A": 1e-8, "C": 1.2e-8, "E": 8e-9})
    return scene.replace(detector=detector, bands=["A", "C", "E"], camera__n_row=40, camera__n_col=61)


@pytest.mark.ci
def test_scene_with_electrons(warm_scene):
    again = ws.Scene.from_dict(warm_scene.to_dict())
    assert again == warm_scene
    assert isinstance(again.detector, ws.ElectronDetector)
    assert len({warm_scene.scenario.instrument.nei_w_cm2(band) for band in warm_scene.bands}) == 3
    frames = ws.Renderer(warm_scene, device="cpu", n_thread=1).render([60, 61, 62, 63], keep_signal=True)
    truth = frames.truth
    nei = np.array([warm_scene.scenario.instrument.nei_w_cm2(band) for band in truth["band"]])
    np.testing.assert_allclose(truth["snr"], truth["irradiance_w_cm2"] / nei, rtol=1e-12)
    signal, counts = frames.signal_w_cm2.numpy(), frames.counts.numpy()
    for band, name in enumerate(warm_scene.bands):
        known = warm_scene.scenario.instrument.levels[name]
        light = (counts[:, :, band] - known.blank_counts) / known.counts_per_nei * known.nei_w_cm2
        faint = signal[:, :, band] < known.nei_w_cm2
        off = (light - signal[:, :, band])[faint] / known.nei_w_cm2
        assert abs(off.mean()) < N_SIGMA / np.sqrt(off.size) + 1e-3
        assert abs(off.std() - 1) < N_SIGMA / np.sqrt(2 * off.size) + 1e-3


@pytest.mark.ci
def test_threads_and_bands_make_no_difference(scene, warm_scene):
    plain = scene.replace(
        detector=ALL_TERMS | {"kind": "nei", "nei_w_cm2": {"A": 1e-18, "C": 2e-18}, "sei_w_cm2": 3e-15, "dsnu_nei": 1.0,
                              "column_noise_nei": 1.0},
        bands=["A", "C"], camera__n_row=40, camera__n_col=61,
    )  # fmt: skip
    changed = {f"detector__{name}": value for name, value in ALL_TERMS.items()}
    electrons = warm_scene.replace(**changed, detector__dsnu=0.3, detector__column_noise_e=30.0)
    for one in (plain, electrons):
        many = ws.Renderer(one, device="cpu", n_thread=3).render(range(60, 72), sensors=["sat11", "sat47"])
        few = ws.Renderer(one, device="cpu", n_thread=1)
        alone = few.render([65], sensors=["sat47"], bands=["C"])
        np.testing.assert_array_equal(many.counts.numpy()[5, 1, 1], alone.counts.numpy()[0, 0, 0])
        again = few.render(range(60, 72), sensors=["sat11", "sat47"])
        np.testing.assert_array_equal(many.counts.numpy(), again.counts.numpy())


@pytest.mark.ci
def test_reports_tell_the_chain(warm_scene):
    report = scene_report(warm_scene.scenario)
    known = warm_scene.scenario.instrument.levels["A"]
    assert f"A: NEI {known.nei_w_cm2:.4g}, SEI {known.sei_w_cm2:.4g} W/cm2" in report
    assert f"A: background {known.background_e:.4g} e, dark 300 e, read noise 100 e" in report
    assert "\n  pixels " not in report
    told = scene_report(warm_scene.replace(detector__prnu=0.01, detector__hot_fraction=0.002).scenario)
    assert "  pixels     0.01 rms of gains, 0.002 of the pixels hot" in told
    coarse = scene_report(warm_scene.replace(detector__gain_e_per_count=3500.0, detector__offset_counts=0.5).scenario)
    assert "warning    the noise of blank sky is below half a count: rounding shapes it in band A" in coarse


@pytest.mark.ci
def test_header_and_manifest_tell_the_chain(warm_scene, tmp_path):
    uneven = warm_scene.replace(detector__prnu=0.01, detector__line_time_s=-1e-3, detector__tdi_stages=100)
    instrument = uneven.scenario.instrument_of("sat11")
    header = {card[0]: card[1] for card in scene_cards(uneven, instrument, "sat11", "C")}
    known = uneven.scenario.instrument.levels["C"]
    assert header["NEI"] == pytest.approx(known.nei_w_cm2, rel=1e-12)
    assert (header["DETECTOR"], header["EXPTIME"], header["GAIN"]) == ("electron", 0.1, 320.0)
    assert header["BACKGR"] == pytest.approx(known.background_e, rel=1e-12)
    assert (header["PRNU"], header["LINETIME"], header["TDI"]) == (0.01, -1e-3, 100)
    assert "COLNOISE" not in header
    render_to_folder(uneven, tmp_path / "run", frames=[60], sensors=["sat11"], bands=["C"], device="cpu")
    manifest = __import__("json").loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["sensors"]["sensor"]["detector"]["terms"] == {
        "prnu": "0.01 rms of gains",
        "line_time_s": "-0.001 s from row to row",
        "tdi_stages": "100 stages of TDI",
    }
    assert manifest["sensors"]["sensor"]["detector"]["bands"]["C"]["dark_e"] == pytest.approx(300.0, rel=1e-12)


BROKEN = [
    (lambda: ws.ElectronDetector(), "ElectronDetector: exposure_s: is required; full_well_e: is required"),
    (lambda: dataclasses.replace(WARM, exposure_s=0.0), "exposure_s: must be > 0, got 0.0"),
    (lambda: dataclasses.replace(WARM, quantum_efficiency=1.2), r"quantum_efficiency: must be in \(0, 1\], got 1.2"),
    (lambda: dataclasses.replace(WARM, transmission={0: 0.5}), "transmission: must be a table of numbers by names of"),
    (lambda: dataclasses.replace(WARM, optics_emissivity=0.1), "optics_emissivity: must be given together"),
    (lambda: dataclasses.replace(WARM, prnu=0.2), r"prnu: must be in \[0, 0.1\], got 0.2"),
    (lambda: dataclasses.replace(WARM, offset_counts=2e5), r"must be below 2\*\*bits \(16384\), got 200000"),
    (lambda: ws.ElectronDetector(0.1, 1e5, 1.0, dsnu_nei=1.0), "dsnu_nei: is not a known field here"),
    (lambda: ws.NeiDetector(1e-18, 1e-15, noise="template"), "NeiDetector: noise: is not a known field"),
    (lambda: ws.NeiDetector({"A": 1e-18, "C": 2e-18}, {"C": 1e-18}), r"\(2e-18\) in C, got 1e-18"),
    (lambda: ws.NeiDetector({}, 1e-15), "nei_w_cm2: must be a number or a table that names a band, got {}"),
    (lambda: ws.NeiDetector({"A": 0.0}, 1e-15), "nei_w_cm2: A: must be > 0, got 0.0"),
    (lambda: ws.NeiDetector({"A": 1e-18}, 1e-15).dynamic_range, "dynamic_range: differs by band"),
]


@pytest.mark.parametrize(("act", "message"), BROKEN, ids=[message[:40] for _, message in BROKEN])
def test_bad_values_are_told_in_a_line(act, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        act()
    assert "\n" not in str(caught.value)


def test_scenes_tell_what_a_band_lacks(scene, warm_scene):
    with pytest.raises(ws.InputError, match=r"detector\.nei_w_cm2: must name every band of the scene, got none for C"):
        scene.replace(bands=["A", "C"], detector__nei_w_cm2={"A": 1e-18})
    with pytest.raises(ws.InputError, match="detector: background and dark current must not saturate a"):
        warm_scene.replace(detector__background_w_cm2_sr=1e-6)
    with pytest.raises(ws.InputError, match=r"detector\.kind: must be one of 'nei', 'electron', got 'photon'"):
        scene.replace(detector__kind="photon")


def test_quantities(warm_scene):
    detector = ws.ElectronDetector(
        100 * u.ms, 5e6 * u.electron, 320.0, dark_e_s=180_000 * u.electron / u.min, zodiacal_mjy_sr=15e6 * u.Jy / u.sr,
        background_w_cm2_sr=2e-5 * u.W / u.m**2 / u.sr,
    )  # fmt: skip
    assert (detector.exposure_s, detector.dark_e_s, detector.zodiacal_mjy_sr) == (0.1, 3000.0, 15.0)
    assert detector.background_w_cm2_sr == pytest.approx(2e-9, rel=1e-12)
    assert CAMERA.focal_px > 0 and OPTICS.aperture_m == 0.4


@pytest.mark.parametrize("ragged", [False, True])
@pytest.mark.parametrize(("first_e", "second_e"), [(13.0, 11.0), (11.0, 13.0), (100.0, 1.0), (1.0, 100.0)])
@pytest.mark.ci
def test_few_electrons_beside_many_are_independent(device, first_e, second_e, ragged):
    """Pixels of a pair share random words: the way of few electrons must not reuse those of many."""
    detector = ws.ElectronDetector(exposure_s=0.1, full_well_e=1e6, gain_e_per_count=1.0, offset_counts=0.0, bits=16)
    first = np.arange(256 * 256) % STRIP_PIXELS < N_PAIR
    signal = np.where(first, first_e, second_e) / levels_of(detector).e_per_w_cm2
    counts = read_out(detector, signal.reshape(1, 1, 256, 256), device, ragged=ragged).ravel().astype(float)
    one, other = counts[first] - counts[first].mean(), counts[~first] - counts[~first].mean()
    gate = N_SIGMA / np.sqrt(len(one))
    assert abs(np.corrcoef(one, other)[0, 1]) < gate
    assert abs(np.corrcoef(one, other**2)[0, 1]) < gate
    assert abs(np.corrcoef(one**2, other)[0, 1]) < gate
