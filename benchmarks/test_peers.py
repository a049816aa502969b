"""Ours against what a user could pick instead, on the same work, by turns: median of the ratios, and their quartiles.

    python -m pip install -e '.[test,peers]'
    python -m pytest benchmarks/test_peers.py --benchmark-json=benchmarks/results/peers.json
    python benchmarks/report.py benchmarks/results/peers.json

The peers (`benchmarks/peers/`) get the place and the light of each source of each frame as arrays, before the clock
starts. Ours does the whole chain of `stss` in that time: where cameras look, which stars are in view and where, 30
turning targets and their light, and truth. Both draw sources integrated over pixels, add fresh noise, clip, and leave
uint16 in host memory; Numba and ours use all cores, or one thread each. Beside each ratio stand the errors of the worst
pixel of one noiseless image, in units of the noise: ours with its default stamps, and with stamps that end where it is
as exact as the peer ("as exact"), whose own stamps are all of one size.
"""

from __future__ import annotations

import itertools

import pytest

from benchmarks.peers.pairs import PEERS, SMALL, compare, is_installed, make_peer, peer_error_nei
from benchmarks.peers.work import PSFS, STAMPS, peer_work
from warpsim.speed.report import PAPER_FPS

# Peer, threads (0: all cores), stars, stamps.
CASES = [
    *itertools.product(["Numba"], [0], [100, 1_000], STAMPS),
    *itertools.product(["Numba"], [1], [100], ["default"]),
    *itertools.product(["NumPy", "GalSim"], [0], [100], ["default"]),
]


@pytest.mark.parametrize("n_pixel", PAPER_FPS)
@pytest.mark.parametrize("psf", PSFS)
@pytest.mark.parametrize(("name", "n_thread", "n_star", "stamps"), CASES)
def test_peer(benchmark, name, n_thread, n_star, stamps, psf, n_pixel):
    if not is_installed(name):
        pytest.skip(f"needs {PEERS[name][0]}: pip install warpsim[peers]")
    shape = (n_pixel, n_star, None) if benchmark.enabled else SMALL
    work = peer_work(shape[0], shape[1], psf, shape[2])
    peer = make_peer(name, work, n_thread or None)
    if stamps == "as exact":
        work = work.as_exact(peer_error_nei(work, peer))
    compare(benchmark, name, work, peer, n_thread, n_pixel=n_pixel, psf=psf, n_star=n_star, stamps=stamps)
