"""The programs that speed is compared with draw the same images as the product, and their noise is noise."""

import numpy as np
import pytest

pytest.importorskip("scipy")
from scipy.special import ndtr

from benchmarks.peers.pairs import PEERS, Pairs, draws, is_installed, make_peer, peer_error_nei
from benchmarks.peers.work import CUTS_NEI, EXACT, PSFS, SIGMA_PX, peer_work

# Of the worst pixel, in units of the noise, over the brightest pixel. Gaussians: stamps of 9 x 9 pixels, and GalSim's
# own accuracy, 2.4e-5. Airy patterns: 1.5 % of a source's light lies beyond 31 x 31 pixels, and tables of 32 phases.
SHARE = {"gaussian": 5e-5, "airy": 3e-3}

# sdasim takes a Gaussian of 0.7 px at the centres of pixels: 16 % of the brightest pixel beside the integral.
SAMPLED = 0.33

# The images that errors are counted from, over the brightest pixel: float32 sums, stamps cut at 1e-4 of the noise.
FLOAT32 = 3e-6

# Rounding to counts adds 1 / sqrt(12) counts of 5 to a pixel; moments are good to 5 standard deviations.
N_SIGMA = 5.0


@pytest.fixture(scope="module", params=PSFS)
def work(request):
    return peer_work(48, 60, request.param, n_frame=3)


@pytest.fixture(params=PEERS)
def peer(request, work):
    if not is_installed(request.param):
        pytest.skip(f"{request.param} is not installed")
    if not draws(request.param, work.psf):
        pytest.skip(f"{request.param} has no {work.psf} pattern")
    return make_peer(request.param, work)


@pytest.mark.ci
def test_sources_are_those_of_the_image(work):
    """All light within the frame is in the list: 30 targets and some 60 stars."""
    assert 30 + 30 < work.n_source < 30 + 120
    for frame in range(3):
        x, y, light = work.x_px[frame], work.y_px[frame], work.light_nei[frame]
        inside = (abs(x - 23.5) < 21) & (abs(y - 23.5) < 21)
        total = work.signal_nei(frame, **EXACT).sum()
        assert light[inside].sum() * 0.95 < total < light.sum()


@pytest.mark.ci
def test_errors_are_counted_from_the_float64_integral(work):
    if work.psf != "gaussian":
        pytest.skip("Airy patterns have no closed form; test_airy_table.py has their quadrature")
    edges = np.arange(work.n_pixel + 1) - 0.5
    sources = zip(work.x_px[0], work.y_px[0], work.light_nei[0], strict=True)
    exact = sum(
        light * np.outer(*(np.diff(ndtr((edges - centre) / SIGMA_PX)) for centre in (y, x))) for x, y, light in sources
    )
    np.testing.assert_allclose(work.signal_nei(0, **EXACT), exact, rtol=0, atol=FLOAT32 * exact.max())


@pytest.mark.slow
def test_noiseless_images_agree(work, peer):
    for frame in (0, 2):
        exact = work.signal_nei(frame, **EXACT)
        limit = SAMPLED if type(peer).__name__ == "SdasimPeer" else SHARE[work.psf]
        np.testing.assert_allclose(peer.image_nei(frame), exact, rtol=0, atol=limit * exact.max())


@pytest.mark.ci
def test_noise_is_gaussian_and_new_in_every_frame(work, peer):
    noise = []
    for frame in range(3):
        light, counts = np.array(peer.image_nei(frame), dtype=np.float64), peer.counts(frame)
        assert counts.dtype == np.uint16 and counts.shape == (48, 48)
        noise.append((counts - work.detector.offset) / work.detector.gain - light)
    values = np.array(noise)
    sigma = np.hypot(1.0, 1 / np.sqrt(12) / work.detector.gain)
    n = values.size
    assert abs(values.mean()) < N_SIGMA * sigma / np.sqrt(n)
    assert abs(values.std() - sigma) < N_SIGMA * sigma / np.sqrt(2 * n)
    for one, other in [(values[0], values[1]), (values[:, :, :24], values[:, :, 24:]), (values[:, 1:], values[:, :-1])]:
        assert abs(np.mean(one * other)) < N_SIGMA * sigma**2 / np.sqrt(one.size)


@pytest.mark.parametrize("psf", PSFS)
@pytest.mark.ci
def test_stamps_end_where_the_product_is_as_exact_as_a_peer(psf):
    """At the largest cut of those tried: the next larger one errs by more."""
    if not is_installed("Numba"):
        pytest.skip("Numba is not installed")
    work = peer_work(48, 60, psf, n_frame=1)
    theirs = peer_error_nei(work, make_peer("Numba", work))
    matched = work.as_exact(theirs)
    exact = work.signal_nei(0, **EXACT)
    assert np.abs(matched.signal_nei(0) - exact).max() <= theirs
    at = CUTS_NEI.index(matched.speed.scene.optics.stamp_cut_nei)
    assert at > 0
    wider = work.signal_nei(0, optics__stamp_cut_nei=CUTS_NEI[at - 1])
    assert np.abs(wider - exact).max() > theirs


@pytest.mark.ci
def test_pairs_take_turns(work):
    pairs = Pairs(work, make_peer("NumPy", work), 1)
    for _ in range(3):
        pairs.run()
    facts = pairs.facts()
    assert len(pairs.seconds) == facts["n_pair"] == 3
    low, high = facts["ratio_quartiles"]
    assert 0 < low <= facts["ratio"] <= high and facts["n_thread"] == facts["peer_threads"] == 1
