"""Files of user-given point spread functions: FITS images and NumPy arrays."""

from __future__ import annotations

import hashlib
import io
import warnings
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from pydantic import PlainValidator
from pydantic_core import PydanticCustomError

from warpsim.config.fields import rule_error, whole_path
from warpsim.errors import InputError, one_line
from warpsim.exchange.source import SourceFile, read_source
from warpsim.radiometry.by_band import AS_DICT, ByBand, are_names


def _file_or_table(value: Any) -> str | ByBand[str]:
    """One path for all bands, or a table of them."""
    if not isinstance(value, Mapping):
        return whole_path(value, "must be the path of a file, or a table of paths by band")
    if not value or not are_names(value):
        raise rule_error("must be the path of a file, or a table of paths by names of bands")
    paths = {}
    for band, path in value.items():
        try:
            paths[band] = whole_path(path)
        except PydanticCustomError as error:
            raise InputError(error.message(), value=path).of(band) from None
    return ByBand(paths)


FileByBand = Annotated[str | Mapping[str, str], PlainValidator(_file_or_table), AS_DICT]
"""A file for all bands, or a table of files by band; paths become absolute."""


def read_psf_file(path: str) -> tuple[npt.NDArray[np.float64], str]:
    """Image of a file (.fits, .fit, .fts or .npy), and the SHA-256 of the file; read again only when that has changed.

    Raises:
        InputError: The file cannot be read, or holds no image.
    """
    try:
        state = Path(path).stat()
    except OSError:
        return _read(path, 0, 0)  # which says why it cannot be read
    return _read(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=32)
def _read(path: str, mtime_ns: int, size: int) -> tuple[npt.NDArray[np.float64], str]:
    source = read_source(path)
    image = _npy(source) if source.data.startswith(b"\x93NUMPY") else _fits(source)
    if image.ndim != 2 or image.dtype.kind not in "fiub":
        raise source.error(0, f"must hold an array of numbers of two axes, got shape {image.shape} of {image.dtype}")
    values = image.astype(np.float64)
    values.setflags(write=False)
    return values, hashlib.sha256(source.data).hexdigest()


def _npy(source: SourceFile) -> npt.NDArray[Any]:
    try:
        return np.asarray(np.load(io.BytesIO(source.data), allow_pickle=False))
    except (ValueError, EOFError, OSError) as error:
        raise source.error(0, f"cannot be read as a NumPy array: {one_line(error)}") from None


def _fits(source: SourceFile) -> npt.NDArray[Any]:
    """The first image of two axes."""
    from astropy.io import fits

    if not source.data.startswith(b"SIMPLE"):
        raise source.error(0, "must be a FITS image or a NumPy array (.npy)")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # headers that are not quite FITS
            with fits.open(io.BytesIO(source.data)) as units:
                images = [unit.data for unit in units if unit.is_image and unit.data is not None]
    except Exception as error:  # astropy's own and those of the layers below
        raise source.error(0, f"cannot be read as FITS: {one_line(error)}") from None
    flat = [image for image in images if image.ndim == 2]
    if not flat:
        found = f"images of {', '.join(str(image.ndim) for image in images)} axes" if images else "none"
        raise source.error(0, f"must hold an image of two axes, got {found}")
    return np.asarray(flat[0])
