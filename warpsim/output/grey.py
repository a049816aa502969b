"""Counts as grey for people: linear about the noise, logarithmic above, large images reduced by the brightest pixel.

Animations are for looking at: GIF by OpenImageIO and MP4 by PyAV (the extra `video`) change the greys a little.
"""

from __future__ import annotations

import contextlib
import importlib.util
import math
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.detector.levels import Levels
from warpsim.errors import InputError
from warpsim.files import naming, whole_file, whole_file_by_memory

CEILING_NEI = 60.0
"""Drawn white."""
MARGIN_PX = 8.0
"""Of sky about targets, where only a part of an image is shown."""
SOFTENING_NEI = 2.0
"""The grey scale is linear below, logarithmic above: asinh(x / softening)."""

PREVIEW_PX = 512
"""Larger images are reduced to at most so many pixels a side."""

LEAST_GIF_PX = 256
"""Images of fewer pixels are enlarged: OpenImageIO fills up their palettes from memory that nobody has written."""

PREVIEW_FPS = 10.0
"""Default frames a second."""

_MOST_FPS = {".gif": 50.0, ".mp4": 240.0}
"""Players of GIF take shorter times for a mistake."""

GreyImage = npt.NDArray[np.uint8]


def grey(counts: npt.NDArray[np.uint16], levels: Levels, most_px: int, ceiling_nei: float = CEILING_NEI) -> GreyImage:
    """An image in grey: black is blank sky, white ceiling_nei.

    Args:
        counts: Shape (row, column).
        levels: What the counts mean.
        most_px: A larger image is reduced to at most so many pixels a side, by the brightest of each block of pixels,
            so that no point source is lost.
        ceiling_nei: Light that is drawn white.
    """
    level = (counts.astype(np.float32) - levels.blank_counts) / levels.counts_per_nei
    block = -(-max(level.shape) // most_px)
    if block > 1:
        rows, columns = (n * block for n in grey_shape(level.shape, most_px))
        padded = np.full((rows, columns), -np.inf, dtype=np.float32)
        padded[: level.shape[0], : level.shape[1]] = level
        level = padded.reshape(rows // block, block, columns // block, block).max(axis=(1, 3))
    shade = np.arcsinh(np.maximum(level, 0) / SOFTENING_NEI) / np.arcsinh(ceiling_nei / SOFTENING_NEI)
    return np.asarray(np.minimum(shade, 1) * 255, dtype=np.uint8)


def window_about(xy_px: npt.ArrayLike, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of the square part of an image that holds some points and sky about them; all for none.

    Args:
        xy_px: Columns and rows, shape (n, 2); those outside the image do not count.
        shape: Rows and columns of the image.
    """
    points = np.asarray(xy_px, dtype=np.float64).reshape(-1, 2)
    points = points[((points > -0.5) & (points < np.array(shape[::-1]) - 0.5)).all(axis=1)]
    if not len(points):
        return slice(0, shape[0]), slice(0, shape[1])
    low, high = points.min(axis=0), points.max(axis=0)
    half = (high - low).max() / 2 + MARGIN_PX
    first = np.maximum(np.floor((low + high) / 2 - half).astype(int), 0)
    end = np.minimum(np.ceil((low + high) / 2 + half).astype(int) + 1, shape[::-1])
    return slice(int(first[1]), int(end[1])), slice(int(first[0]), int(end[0]))


def grey_shape(shape: tuple[int, ...], most_px: int) -> tuple[int, int]:
    """Rows and columns of an image in grey."""
    block = -(-max(shape) // most_px)
    n_row, n_col = (-(-n // block) for n in shape)
    return n_row, n_col


# --- animations ---


def write_preview(path: str | Path, counts: npt.NDArray[np.uint16], levels: Levels, fps: float = PREVIEW_FPS) -> None:
    """Write images as an animation in the grey of the contact sheet: black is blank sky, white 60 NEI.

    Images of more than 512 pixels a side are reduced by the brightest of each block of pixels; in GIF, those of fewer
    than 256 pixels in all are enlarged by a whole factor.

    Args:
        path: File to write: .gif, or .mp4 with the extra `video`.
        counts: Shape (n, row, column), uint16.
        levels: Scale of the counts: `frames.instrument.levels[band]`.
        fps: Frames a second.

    Raises:
        InputError: Another suffix, a rate that the format does not have, no images, or PyAV is not installed.
        OSError: Writing failed.
    """
    if counts.ndim != 3 or 0 in counts.shape:
        raise InputError("must have the shape (n, row, column)", "counts", counts.shape).of(path)
    with animation(Path(path), fps) as add:
        for image in counts:
            add(grey(image, levels, PREVIEW_PX))


@contextlib.contextmanager
def animation(path: Path, fps: float = PREVIEW_FPS) -> Iterator[Callable[[GreyImage], None]]:
    """Open an animation that takes grey images; it gets its name when it is complete."""
    check_preview(path, fps)
    writer = _gif if path.suffix.lower() == ".gif" else _mp4
    with writer(path, Fraction(fps).limit_denominator(1000)) as add:
        yield add


def check_preview(path: Path, fps: float = PREVIEW_FPS) -> None:
    """Check that an animation can be made, before the work is done.

    Raises:
        InputError: Another suffix than .gif and .mp4, a rate that the format does not have, or PyAV is not installed.
    """
    suffix = path.suffix.lower()
    if suffix not in _MOST_FPS:
        raise InputError(f"must end in one of {', '.join(_MOST_FPS)}").of(path)
    if not 0.01 <= fps <= _MOST_FPS[suffix]:
        raise InputError(f"must be in [0.01, {_MOST_FPS[suffix]:g}]", "fps", fps, "g").of(path)
    if suffix == ".mp4" and importlib.util.find_spec("av") is None:
        raise InputError("needs PyAV, which the extra `video` brings: pip install 'warpsim[video]'").of(path)


@contextlib.contextmanager
def _gif(path: Path, rate: Fraction) -> Iterator[Callable[[GreyImage], None]]:
    """GIF, assembled in memory."""
    import OpenImageIO as oiio

    file: Any = oiio.ImageOutput.create("gif")
    n_image = 0

    def check(done: bool) -> None:
        if not done:
            raise OSError(f"{path}: cannot be written: {' '.join(file.geterror().split()) or 'no reason given'}")

    with whole_file_by_memory(path) as name:

        def add(image: GreyImage) -> None:
            nonlocal n_image
            times = math.ceil(math.sqrt(LEAST_GIF_PX / image.size))
            image = image.repeat(times, 0).repeat(times, 1)
            spec = oiio.ImageSpec(image.shape[1], image.shape[0], 3, oiio.UINT8)
            spec.attribute("FramesPerSecond", oiio.TypeRational, (rate.numerator, rate.denominator))
            check(file.open(name, spec, "AppendSubimage" if n_image else "Create"))
            check(file.write_image(np.repeat(image[..., None], 3, axis=2)))
            n_image += 1

        yield add
        check(file.close())


@contextlib.contextmanager
def _mp4(path: Path, rate: Fraction) -> Iterator[Callable[[GreyImage], None]]:
    """H.264 in the only layout of pixels that every player shows; one thread and no marks of time or version."""
    import av

    stream: Any = None
    # Python's own file, as that reports a full disk.
    with whole_file(path) as partial, naming(path), partial.open("wb") as target:
        try:
            with av.open(target, "w", format="mp4", options={"fflags": "+bitexact"}) as file:

                def add(image: GreyImage) -> None:
                    nonlocal stream
                    # Colours come in blocks of 2 x 2 pixels: numbers of rows and columns must be even.
                    even = np.pad(image, [(0, n % 2) for n in image.shape])
                    if stream is None:
                        # A constant quality: where x264 chooses it, what lay in memory before has a say.
                        stream = file.add_stream("libx264", rate=rate, options={"qp": "18"})
                        stream.height, stream.width = even.shape
                        stream.pix_fmt = "yuv420p"
                        stream.codec_context.thread_count = 1
                        stream.codec_context.flags |= av.codec.context.Flags.bitexact
                    file.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="gray")))

                yield add
                if stream is not None:
                    file.mux(stream.encode())
        except av.FFmpegError as error:  # some of which are no OSError
            raise OSError(f"{path}: cannot be written: {' '.join(str(error).split())}") from error
