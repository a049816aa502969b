"""How does a network train on frames that are rendered as it asks for them?

    python examples/10_pytorch_iterable.py

`RenderedFrames` is an iterable dataset: it renders a batch, hands it to PyTorch without a copy, and stores nothing. A
DataLoader may have several workers (`--workers 2`): each renders every n-th frame with a renderer of its own. They are
to be spawned, as a GPU cannot be used in a forked process. Here a matched filter stands for the network; the picture
shows a batch and what the truth says of it. Without PyTorch the same goes through NumPy. With --quick: few frames.
"""

import argparse
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import warpsim as ws

try:
    import torch
    from torch.utils.data import DataLoader, IterableDataset, get_worker_info
except ImportError:
    torch, IterableDataset = None, object

SENSOR, BAND = "sat11", "A"
BATCH = 8
LEAST_SNR = 8.0


class RenderedFrames(IterableDataset):
    """Batches: images (frame, band, row, column), places of targets [px] (frame, target, 2), which ones stand out."""

    def __init__(self, scene: ws.Scene, frames: range) -> None:
        self.scene, self.frames = scene, frames

    def __iter__(self):
        worker = get_worker_info() if torch else None
        mine = self.frames[worker.id :: worker.num_workers] if worker else self.frames
        renderer = ws.Renderer(self.scene, n_thread=1 if worker else None)  # here, in the worker itself
        for first in range(0, len(mine), BATCH):
            rendered = renderer.render(mine[first : first + BATCH], [SENSOR], [BAND])
            truth = rendered.truth
            places_px = np.stack([truth["x_px"], truth["y_px"]], axis=-1).reshape(len(rendered.frames), -1, 2)
            seen = np.asarray(truth["in_fov"] & (truth["snr_peak"] > LEAST_SNR)).reshape(places_px.shape[:2])
            images = torch.from_dlpack(rendered.counts) if torch else np.from_dlpack(rendered.counts)
            yield images[:, 0], places_px, seen


def brightest_px(images) -> np.ndarray:
    """Column and row of the brightest 3 x 3 pixels of each image, shape (frame, 2): the stand-in for a network."""
    n_frame, n_col = images.shape[0], images.shape[-1]
    if torch:
        summed = torch.nn.functional.avg_pool2d(images.to(torch.float32), 3, stride=1, padding=1).numpy()
    else:
        padded = np.pad(images.astype(np.float32), [(0, 0), (0, 0), (1, 1), (1, 1)])
        summed = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(2, 3)).mean(axis=(4, 5))
    row, column = np.divmod(np.asarray(summed).reshape(n_frame, -1).argmax(axis=1), n_col)
    return np.stack([column, row], axis=-1)


def main(output: Path, n_worker: int = 0, quick: bool = False) -> None:
    """Go through the frames once, say how fast, and draw the last batch to `output`."""
    dataset = RenderedFrames(ws.Scene.load("stss"), range(60, 76 if quick else 140))
    if torch:
        context = "spawn" if n_worker else None
        loader = DataLoader(dataset, batch_size=None, num_workers=n_worker, multiprocessing_context=context)
    else:
        print("PyTorch is not installed: the same batches, as NumPy arrays")
        loader = dataset
    begin, hits, n_image = time.perf_counter(), 0, 0
    for images, places_px, seen in loader:
        found_px = brightest_px(images)
        miss_px = np.linalg.norm(np.asarray(places_px) - found_px[:, None], axis=-1)
        hits += int((np.where(seen, miss_px, np.inf).min(axis=1) < 1.5).sum())
        n_image += len(images)
    print(f"{n_image} images in {time.perf_counter() - begin:.1f} s, with the first one's kernels")
    print(f"the brightest 3 x 3 pixels lie on a target in {hits} of them")

    figure, panels = plt.subplots(2, BATCH // 2, figsize=(13, 6.6), layout="constrained", squeeze=False)
    for axes, image, places, shown in zip(panels.flat, np.asarray(images), places_px, seen, strict=False):
        axes.imshow(image[0], cmap="gray", vmin=90, vmax=np.percentile(image, 99.9), interpolation="nearest")
        axes.plot(*np.asarray(places)[np.asarray(shown)].T, "o", color="#E69F00", mfc="none", ms=11)
        axes.set(xlabel="column", ylabel="row", xlim=(32, 96), ylim=(96, 32))
    figure.suptitle(f"A batch of {SENSOR} in band {BAND}; circles: targets of an SNR above {LEAST_SNR:g}")
    figure.savefig(output, dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("10_pytorch_iterable.png"))
    parser.add_argument("--workers", type=int, default=0, help="processes that render; 0: this one")
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.workers, options.quick)
