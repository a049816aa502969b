"""Two programs by turns, in one process, so that whatever else the machine does meets both."""

from __future__ import annotations

import importlib
import importlib.util
import itertools
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.work import EXACT, Peer, PeerWork
from warpsim.speed.work import render_call

PEERS = {
    "NumPy": ("numpy", "NumpyPeer"),
    "Numba": ("numba", "NumbaPeer"),
    "GalSim": ("galsim", "GalsimPeer"),
    "sdasim": ("sdasim", "SdasimPeer"),
}
"""Package and class of each."""

GAUSSIANS_ONLY = ("sdasim",)
"""Peers that draw no other pattern."""

N_PAIR = 9
SMALL = (32, 5, 2)
"""Pixels, stars and frames when benchmarks are disabled: only to see that it runs."""

TURN_S = 0.2
"""Each has its turn for so long."""


def is_installed(name: str) -> bool:
    """Whether a peer can be made."""
    return all(importlib.util.find_spec(package) for package in (PEERS[name][0], "scipy"))


def draws(name: str, psf: str) -> bool:
    """Whether a peer has a point spread function, one of PSFS."""
    return psf == "gaussian" or name not in GAUSSIANS_ONLY


def make_peer(name: str, work: PeerWork, n_thread: int | None = None) -> Peer:
    """A peer, for all cores or some threads where it knows them."""
    package, kind = PEERS[name]
    return getattr(importlib.import_module(f"benchmarks.peers.{package}_peer"), kind)(work, n_thread)


def peer_error_nei(work: PeerWork, peer: Peer) -> float:
    """Error of a peer's worst pixel in the first frame [noise]."""
    return float(np.abs(peer.image_nei(0) - work.signal_nei(0, **EXACT)).max())


@dataclass
class Pairs:
    """Turns of the product and of a peer."""

    work: PeerWork
    peer: Peer
    n_thread: int | None = None
    """Threads of the product; all cores for None."""
    seconds: list[tuple[float, float]] = field(default_factory=list)
    """Of each pair, the time of an image: ours, theirs."""

    def __post_init__(self) -> None:
        renderer, speed = self.work.renderer(self.n_thread), self.work.speed
        self.own_threads = renderer.n_thread
        calls, frames = itertools.count(), itertools.cycle(range(speed.n_frame))
        self._ours = Turn(lambda: render_call(speed, renderer, next(calls)), speed.n_view)
        self._theirs = Turn(lambda: self.peer.counts(next(frames)), 1)
        self._begin = time.perf_counter(), busy_by_others_s()

    def run(self) -> None:
        """One pair."""
        self.seconds.append((self._ours.run(), self._theirs.run()))

    def facts(self) -> dict[str, object]:
        """Median speeds, the quartiles of their ratio, and how far images are from the exact one."""
        ours, theirs = np.array(self.seconds).T
        wall_s, busy_s = time.perf_counter() - self._begin[0], busy_by_others_s() - self._begin[1]
        low, middle, high = np.quantile(theirs / ours, [0.25, 0.5, 0.75])
        exact = self.work.signal_nei(0, **EXACT)
        return {
            "n_thread": self.own_threads,
            "peer_threads": self.peer.n_thread,
            "fps": 1 / float(np.median(ours)),
            "peer_fps": 1 / float(np.median(theirs)),
            "ratio": float(middle),
            "ratio_quartiles": [float(low), float(high)],
            "n_pair": len(ours),
            "cores_of_others": max(0.0, busy_s / wall_s),
            "n_source": self.work.n_source,
            "stamp_cut_nei": self.work.speed.scene.optics.stamp_cut_nei,
            "error_nei": float(np.abs(self.work.signal_nei(0) - exact).max()),
            "peer_error_nei": peer_error_nei(self.work, self.peer),
        }


def compare(benchmark: Any, name: str, work: PeerWork, peer: Peer, n_thread: int, **facts: object) -> None:
    """Measure pairs by pytest-benchmark, with all cores for 0 threads, and keep their facts."""
    pairs = Pairs(work, peer, n_thread or None)
    benchmark.pedantic(pairs.run, rounds=N_PAIR, warmup_rounds=0)
    benchmark.extra_info.update(peer=name, one_thread=n_thread == 1, device="cpu", **facts, **pairs.facts())


def busy_by_others_s() -> float:
    """Processor time of the whole machine less one's own [s]; 0 where the system does not tell.

    Programs whose threads wait for each other at every step, as Numba's do, are many times slower while others use a
    core: a result in which others did says little.
    """
    try:
        first = Path("/proc/stat").read_text("ascii").partition("\n")[0]
    except OSError:
        return 0.0
    user, nice, system, _idle, _wait, irq, soft_irq, steal = map(int, first.split()[1:9])
    own = os.times()
    busy = (user + nice + system + irq + soft_irq + steal) / os.sysconf("SC_CLK_TCK")
    return busy - own.user - own.system


class Turn:
    """Calls repeated for TURN_S, as many as that takes once warm."""

    def __init__(self, call: Callable[[], object], n_image: int) -> None:
        self._call, self._n_image = call, n_image
        call()  # compiles
        self._n_call = 1
        self._n_call = max(1, round(TURN_S / (self.run() * n_image)))

    def run(self) -> float:
        """Seconds per image."""
        begin = time.perf_counter()
        for _ in range(self._n_call):
            self._call()
        return (time.perf_counter() - begin) / (self._n_call * self._n_image)
