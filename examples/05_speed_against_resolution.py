"""How many images per second does this machine render, and how many sensors in real time (the paper's Table 7)?

    python examples/05_speed_against_resolution.py

One sensor, one band, 30 targets and about 100 stars, fresh noise in every pixel, counts in host memory. With --quick:
128 x 128 pixels only.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt

import warpsim as ws
from warpsim.speed.report import PAPER_FPS

REAL_TIME_FPS = 30.0
N_ROUND = 7


def main(output: Path, quick: bool = False, device: str | None = None) -> None:
    """Measure, print a table, and draw it to `output`."""
    sizes = [128] if quick else list(PAPER_FPS)
    fps = [ws.measure_fps(n_pixel, device, n_round=2 if quick else N_ROUND) for n_pixel in sizes]
    paper = [PAPER_FPS[n_pixel] for n_pixel in sizes]
    print(f"{'pixels':>10} {'frames/s':>10} {'paper':>8} {'ratio':>8} {'real-time sensors':>18}")
    for n_pixel, ours, theirs in zip(sizes, fps, paper, strict=True):
        print(f"{n_pixel:>8}^2 {ours:>10,.0f} {theirs:>8} {ours / theirs:>8.1f} {ours / REAL_TIME_FPS:>18,.0f}")

    figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
    axes.loglog(sizes, fps, "o-", base=10, label="warpsim, this machine")
    axes.loglog(sizes, paper, "s--", base=10, label="paper, Table 7")
    axes.axhline(REAL_TIME_FPS, color="grey", linestyle=":", label="real time, one sensor")
    axes.set_xticks(list(PAPER_FPS), [f"{n_pixel}$^2$" for n_pixel in PAPER_FPS])
    axes.minorticks_off()
    axes.set(xlim=(100, 1300), ylim=(10, None), xlabel="image size [px]", ylabel="frames per second")
    axes.legend()
    axes.grid(alpha=0.3, which="both")
    figure.savefig(output, dpi=150)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("05_speed_against_resolution.png"))
    parser.add_argument("--device", help="Warp device: cpu, cuda:0, ...")
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick, options.device)
