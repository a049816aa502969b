"""Time of each term of a detector, and quality of its noise.

    python -m pytest benchmarks/test_read_out.py --benchmark-json=benchmarks/results/read_out.json
    python benchmarks/report.py benchmarks/results/read_out.json

The stage `read_out` alone, one thread, on blank frames of 1024 x 1024 pixels. The error is the largest distance of the
distribution of counts from the Gaussian that it should be (Kolmogorov and Smirnov); up to 1e-3 is chance.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from scipy import special

import warpsim as ws
from warpsim.detector.detectors import ElectronDetector, NeiDetector
from warpsim.optics.telescope import Optics
from warpsim.render import stages
from warpsim.render.batch import new_inputs
from warpsim.render.buffers import new_signal
from warpsim.render.read_out import make_read_out

N_PIXEL = 1024
NEI = {"nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "bits": 16, "offset_counts": 3000.0, "counts_per_nei": 300.0}
UNEVEN = {"prnu": 0.01, "dead_fraction": 1e-3, "hot_fraction": 1e-4, "nonlinearity": 0.05}
ELECTRONS = {
    "exposure_s": 0.1, "full_well_e": 5e6, "gain_e_per_count": 5.0, "bits": 16, "transmission": 0.6,
    "quantum_efficiency": 0.5, "background_w_cm2_sr": 3e-7, "dark_e_s": 3000.0,
}  # fmt: skip
SHOT = {"read_noise_e": 100.0}

DETECTORS = {
    "NEI": NeiDetector(**NEI),
    "NEI, non-linearity": NeiDetector(**NEI, nonlinearity=0.05),
    "NEI, PRNU": NeiDetector(**NEI, prnu=0.01),
    "NEI, DSNU": NeiDetector(**NEI, dsnu_nei=1.0),
    "NEI, bad pixels": NeiDetector(**NEI, dead_fraction=1e-3, hot_fraction=1e-4),
    "NEI, column noise": NeiDetector(**NEI, column_noise_nei=1.0),
    "NEI, all": NeiDetector(**NEI, **UNEVEN, dsnu_nei=1.0, column_noise_nei=1.0),
    "electrons, no noise": ElectronDetector(**ELECTRONS, shot_noise=False),
    "electrons, shot": ElectronDetector(**ELECTRONS),
    "electrons, shot and read": ElectronDetector(**ELECTRONS, **SHOT),
    "electrons, small means": ElectronDetector(**ELECTRONS | {"background_w_cm2_sr": 0.0, "dark_e_s": 10.0}, **SHOT),
    "electrons, all": ElectronDetector(**ELECTRONS, **SHOT, **UNEVEN, dsnu=0.1, column_noise_e=30.0),
}


@pytest.mark.parametrize("name", DETECTORS)
def test_read_out(benchmark, name, device):
    detector, device = DETECTORS[name], wp.get_device(device)
    n_view = 4 if benchmark.enabled else 1
    sensor = {"camera__n_row": N_PIXEL, "camera__n_col": N_PIXEL, "optics": Optics(aperture_m=0.4), "bands": ["A"]}
    instrument = ws.Scene.load("stss").replace(detector=detector, **sensor).scenario.instrument
    known = instrument.levels["A"]
    on_device = SimpleNamespace(
        band_id=wp.zeros(1, dtype=wp.uint32, device=device),
        read_out=make_read_out(instrument, ["A"], device),
        device=device,
    )
    inputs = new_inputs(device, np.zeros(n_view), np.arange(n_view), np.zeros(n_view))
    shape = (n_view, 1, N_PIXEL, N_PIXEL)
    counts = wp.zeros(shape, dtype=wp.uint16, device=device)
    stage = stages.read_out(on_device, inputs, new_signal(shape, device), counts, 0)

    def read_out() -> None:
        stage.run()
        wp.synchronize_device(device)

    benchmark.pedantic(read_out, rounds=9, warmup_rounds=1)
    if benchmark.stats is None:
        return
    z = (counts.numpy().astype(np.float64) - known.blank_counts) / known.counts_per_nei
    benchmark.extra_info.update(
        device=str(device),
        device_name=device.name,
        detector=name,
        ns_per_pixel=benchmark.stats.stats.median / z.size * 1e9,
        distance=distance(z.ravel(), 0.5 / known.counts_per_nei) if plain(detector) else None,
    )


def plain(detector):
    """Whether a pixel's counts should be a rounded Gaussian about those of blank sky."""
    noisy = isinstance(detector, NeiDetector) or (detector.shot_noise and detector.background_w_cm2_sr)
    uneven = ("prnu", "dead_fraction", "hot_fraction", "dsnu_nei", "column_noise_nei")
    return bool(noisy) and not any(getattr(detector, term, 0.0) for term in uneven)


def distance(z, half_count):
    """Largest difference of the distribution of rounded deviates from the Gaussian's, at upper edges of counts."""
    values, counts = np.unique(z, return_counts=True)
    return float(np.abs(np.cumsum(counts) / z.size - special.ndtr(values + half_count)).max())
