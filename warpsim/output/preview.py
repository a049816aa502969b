"""Previews: the images of a sensor as an animation in grey, GIF by OpenImageIO or MP4 by PyAV (the extra `video`).

They are for looking at: both formats change the greys a little.
"""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.detector.levels import Levels
from warpsim.errors import InputError
from warpsim.files import naming, whole_file, whole_file_by_memory
from warpsim.output.grey import grey

PREVIEW_PX = 512
"""Larger images are reduced to at most so many pixels a side."""

PREVIEW_FPS = 10.0
"""Default frames a second."""

_MOST_FPS = {".gif": 50.0, ".mp4": 240.0}
"""Players of GIF take shorter times for a mistake."""

GreyImage = npt.NDArray[np.uint8]


def write_preview(path: str | Path, counts: npt.NDArray[np.uint16], levels: Levels, fps: float = PREVIEW_FPS) -> None:
    """Write images as an animation in the grey of the contact sheet: black is blank sky, white 60 NEI.

    Images of more than 512 pixels a side are reduced by the brightest of each block of pixels.

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

    with contextlib.ExitStack() as files:
        partial = files.enter_context(whole_file(path))
        files.enter_context(naming(path))
        # Python's own file, as that reports a full disk.
        target = files.enter_context(partial.open("wb"))
        files.enter_context(_errors_of_writing(path))
        file = files.enter_context(av.open(target, "w", format="mp4", options={"fflags": "+bitexact"}))
        stream: Any = None

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


@contextlib.contextmanager
def _errors_of_writing(path: Path) -> Iterator[None]:
    """Errors of PyAV, some of which are no OSError, as such."""
    import av

    try:
        yield
    except av.FFmpegError as error:
        raise OSError(f"{path}: cannot be written: {' '.join(str(error).split())}") from error
