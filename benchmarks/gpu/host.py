"""Steps on the host itself: versions and device, a few frames, the first frame of a process, peers that are there."""

from __future__ import annotations

import os
import platform
import tempfile
from collections.abc import Iterator
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import warp as wp

import warpsim as ws
from benchmarks.first_frame import first_frame
from benchmarks.gpu.plan import Plan, Row, rows_of
from benchmarks.peers.pairs import PEERS, Turn, draws, is_installed, make_peer
from benchmarks.peers.work import PSFS, peer_work
from warpsim.render.device import n_usable_cpu
from warpsim.speed.work import work_fps

PACKAGES = ("warpsim", "warp-lang", "numpy", "torch", "cupy-cuda12x", "cupy-cuda13x", "jax")


def versions(plan: Plan) -> Iterator[Row]:
    """Yield what figures hang on."""
    device = wp.get_device(plan.device)
    yield {
        "name": "software",
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        **{name: known for name in PACKAGES if (known := _version(name))},
    }
    yield {"name": "processor", "cores": os.cpu_count(), "usable": n_usable_cpu()}
    row: Row = {"name": "device", "device": str(device), "model": device.name}
    if device.is_cuda:
        row |= {
            "architecture": device.arch,
            "multiprocessors": device.sm_count,
            "memory_gib": round(device.total_memory / 2**30, 1),
            "free_gib": round(device.free_memory / 2**30, 1),
            "toolkit": ".".join(map(str, wp.get_cuda_toolkit_version())),
            "driver": ".".join(map(str, wp.get_cuda_driver_version())),
            "memory_pools": wp.is_mempool_enabled(device),
        }
    yield row


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return ws.__version__ if name == "warpsim" else None


def smoke(plan: Plan) -> Iterator[Row]:
    """A few frames of `stss`: there is light in them, noise, and truth."""

    def frames() -> Row:
        few = ws.Renderer(ws.Scene.load("stss"), plan.device).render(
            range(60, 63), ["sat11", "sat47"], keep_signal=True
        )
        counts, truth = few.counts.numpy(), few.truth
        assert few.signal_w_cm2 is not None
        light = few.signal_w_cm2.numpy()
        facts = {"images": int(np.prod(counts.shape[:3])), "truth rows": len(truth), "mean": float(counts.mean())}
        is_fine = bool((light.max(axis=(3, 4)) > 0).all() and counts.std() > 0 and np.isfinite(light).all())
        return facts | {"ok": is_fine and bool(np.asarray(truth["in_fov"]).any())}

    return rows_of([("stss", frames)])


def first_frames(plan: Plan) -> Iterator[Row]:
    """Seconds until the first frame of a process, with no kernel compiled and with all."""
    with tempfile.TemporaryDirectory() as folder:
        made, python = Path(folder) / "kernels", Path(folder) / "python"
        if plan.quick:
            wp.init()
            made = Path(str(wp.config.kernel_cache_dir))  # what this process has compiled
        kinds = ["compiled"] if plan.quick else ["none compiled", "compiled"]
        yield from rows_of((kind, partial(first_frame, made, python, plan.device)) for kind in kinds)


def peers(plan: Plan) -> Iterator[Row]:
    """Images per second of each peer that is installed, on the CPU, and of the product on the device."""

    def both(name: str, psf: str, n_pixel: int) -> Row:
        work = peer_work(n_pixel, 5 if plan.quick else 100, psf, n_frame=4 if plan.quick else 16)
        renderer = ws.Renderer(work.speed.scene, plan.device, catalog=work.speed.catalog)
        peer = make_peer(name, work)
        theirs = Turn(lambda: peer.counts(0), 1)
        ours = {
            "fps, counts in host memory": work_fps(work.speed, renderer, 3),
            "fps, counts on the device": work_fps(work.speed, renderer, 3, resident=True),
        }
        return {"device": plan.device, **ours, "peer_fps": 1 / theirs.run(), "peer_threads": peer.n_thread}

    sizes = (32,) if plan.quick else (128, 1024)
    names = [name for name in PEERS if is_installed(name)][: 1 if plan.quick else None]
    cases = [(name, psf, n) for name in names for psf in PSFS[: len(sizes)] if draws(name, psf) for n in sizes]
    if not cases:
        yield {"name": "no peer is installed"}
    yield from rows_of((f"{name}, {psf} {n}", partial(both, name, psf, n)) for name, psf, n in cases)
