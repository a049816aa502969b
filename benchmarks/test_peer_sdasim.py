"""Ours against sdasim on PyTorch, on the CPU, by turns: median of the ratios, and the error of either image.

    python -m pip install -e '.[test,peer-sdasim]'
    export MALLOC_MMAP_THRESHOLD_=1000000000 MALLOC_TRIM_THRESHOLD_=2000000000
    python -m pytest benchmarks/test_peer_sdasim.py -k one --benchmark-json=benchmarks/results/peer_sdasim.json
    python benchmarks/report.py benchmarks/results/peer_sdasim.json

As with the other peers, sdasim 0.5.0 gets position and light of each source of each frame before the clock starts,
and ours does the whole chain of `stss` in that time. sdasim takes a Gaussian at the centres of pixels and does not
integrate it over them, within 3 sigma; the error of its worst pixel against the float64 integral stands beside its
speed. Its own functions with its own defaults draw, add noise and convert; both leave uint16 in host memory.

The C library is set to keep memory that was freed: without that PyTorch gets new pages for each image of 1024 x 1024
pixels, which halves its speed. One thread each, which a busy machine slows down alike; without `-k one` also all cores,
on an idle machine. The extra is apart from `peers`, as PyTorch takes 5 GB with the CUDA libraries that its wheels for
Linux bring.
"""

from __future__ import annotations

import pytest

from benchmarks.peers.pairs import SMALL, compare, is_installed, make_peer
from benchmarks.peers.work import peer_work
from warpsim.speed.report import PAPER_FPS


@pytest.mark.parametrize("n_pixel", PAPER_FPS)
@pytest.mark.parametrize("n_star", [100, 1_000])
@pytest.mark.parametrize("n_thread", [0, 1], ids=["all", "one"])
def test_peer_sdasim(benchmark, n_thread, n_star, n_pixel):
    if not is_installed("sdasim"):
        pytest.skip("needs sdasim: pip install warpsim[peer-sdasim]")
    shape = (n_pixel, n_star, None) if benchmark.enabled else SMALL
    work = peer_work(shape[0], shape[1], "gaussian", n_frame=shape[2])
    peer = make_peer("sdasim", work, n_thread or None)
    facts = {"n_pixel": n_pixel, "psf": "gaussian", "n_star": n_star, "stamps": "default"}
    compare(benchmark, "sdasim", work, peer, n_thread, **facts)
