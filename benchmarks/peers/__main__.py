"""A quick look on a machine that is not idle: processor time of an image, one thread each, by turns.

    python -m benchmarks.peers [NumPy | Numba | GalSim | sdasim] [--stars 1000] [--as-exact]

Median of the ratios of some turns. With --as-exact stamps end where ours is as exact as the
peer. What counts is benchmarks/test_peers.py, on an idle machine.
"""

from __future__ import annotations

import argparse
import statistics
from functools import partial

import warp as wp

from benchmarks.peers.pairs import PEERS, draws, is_installed, make_peer, peer_error_nei
from benchmarks.peers.work import PSFS, peer_work
from benchmarks.programs import processor_s
from warpsim.speed.work import render_call

N_TURN = 12
PIXELS_PER_TURN = 2**22


def look(name: str, psf: str, n_pixel: int, n_star: int, as_exact: bool) -> str:
    """A row: microseconds of an image, ours and theirs, the least of all turns; and the median of their ratios."""
    n_frame = min(max(16, PIXELS_PER_TURN // n_pixel**2), 256)
    work = peer_work(n_pixel, n_star, psf, n_frame=n_frame)
    peer = make_peer(name, work, 1)
    if as_exact:
        work = work.as_exact(peer_error_nei(work, peer))
    renderer = work.renderer(1)
    render_call(work.speed, renderer, 0)
    peer.counts(0)
    n_theirs = n_frame if name == "Numba" else 8
    turns = [
        (
            processor_s(render_call, work.speed, renderer, call) / n_frame,
            processor_s(lambda: [peer.counts(frame) for frame in range(n_theirs)]) / n_theirs,
        )
        for call in range(N_TURN)
    ]
    ours, theirs = (min(seconds) * 1e6 for seconds in zip(*turns, strict=True))
    ratio = statistics.median(peer_s / own_s for own_s, peer_s in turns)
    cut_nei = work.speed.scene.optics.stamp_cut_nei
    return f"{psf:<9} {n_pixel:>5}^2 {cut_nei:>9.2g} {ours:>12,.0f} {theirs:>12,.0f} {ratio:>7.2f}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("peer", nargs="?", default="Numba", choices=[*filter(is_installed, PEERS)])
    parser.add_argument("--stars", type=int, default=100, help="stars in view")
    parser.add_argument("--as-exact", action="store_true", help="stamps as wide as the peer's error asks for")
    args = parser.parse_args()
    name = args.peer
    wp.config.log_level = wp.LOG_ERROR
    print(f"{'PSF':<9} {'pixels':>7} {'cut [NEI]':>9} {'ours [us]':>12} {f'{name} [us]':>12} {'ratio':>7}")
    for psf in filter(partial(draws, name), PSFS):
        for n_pixel in (128, 256, 512, 1024):
            print(look(name, psf, n_pixel, args.stars, args.as_exact), flush=True)
