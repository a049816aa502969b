"""The telescope, and the point spread functions that follow from it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import PlainValidator, model_validator
from pydantic_core import PydanticCustomError

from warpsim.config.fields import Count, NonNegative, Number, Positive, closed_interval, rule_error, whole_path
from warpsim.config.model import config_model
from warpsim.errors import InputError, one_line
from warpsim.exchange.source import SourceFile, read_source
from warpsim.optics.camera import Camera
from warpsim.optics.pattern import FIRST_DARK_RING
from warpsim.optics.psf import (
    MAX_N_WAVELENGTH,
    MAX_OBSCURATION,
    MAX_OVERSAMPLE,
    Psf,
    PsfAiry,
    PsfGaussian,
    PsfTable,
    checked_samples,
)
from warpsim.optics.tables import DEFAULT_ERROR, ERROR_RANGE
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import as_band
from warpsim.radiometry.by_band import AS_DICT, ByBand, are_names
from warpsim.tables.checked_files import is_image, npy_array, open_fits


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
    """Return the image of a file (.fits or .npy), and its SHA-256; it is read again only when it has changed."""
    try:
        state = Path(path).stat()
    except OSError:
        return _read(path, 0, 0)  # which says why it cannot be read
    return _read(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=32)
def _read(path: str, mtime_ns: int, size: int) -> tuple[npt.NDArray[np.float64], str]:
    source = read_source(path)
    with source.at(0):
        image = npy_array(source.data) if source.data.startswith(b"\x93NUMPY") else _fits(source)
    if image.ndim != 2 or image.dtype.kind not in "fiub":
        raise source.error(0, f"must hold an array of numbers of two axes, got shape {image.shape} of {image.dtype}")
    with source.at(0):
        checked_samples(image)
    values = image.astype(np.float64)
    values.setflags(write=False)
    return values, hashlib.sha256(source.data).hexdigest()


def _fits(source: SourceFile) -> npt.NDArray[Any]:
    """The first image of two axes."""
    if not source.data.startswith(b"SIMPLE"):
        raise InputError("must be a FITS image or a NumPy array (.npy)")
    try:
        with open_fits(source.data) as units:
            images = [unit.data for unit in units if is_image(unit)]
    except InputError:
        raise
    except Exception as error:  # astropy's own and those of the layers below
        raise InputError(f"cannot be read as FITS: {one_line(error)}") from None
    flat = [image for image in images if image.ndim == 2]
    if not flat:
        found = f"images of {', '.join(str(image.ndim) for image in images)} axes" if images else "none"
        raise InputError(f"must hold an image of two axes, got {found}")
    return np.asarray(flat[0])


GAUSSIAN_PER_LAMBDA_F = 0.42
"""Sigma of the Gaussian that resembles an Airy pattern's core, in units of lambda * F."""


@config_model
class Optics:
    """The telescope.

    Args:
        aperture_m: Pupil diameter [m].
        obscuration: Diameter of the central obscuration over that of the pupil; an Airy pattern only.
        psf: "airy", "gaussian" with sigma = 0.42 lambda F, or "table" with an image of one's own.
        sigma_px: Sigma of the Gaussian in all bands, instead of 0.42 lambda F [px].
        psf_file: Image of the table (FITS or .npy), or a table of files by band; see PsfTable for its samples.
        psf_oversample: Samples of the image per pixel width.
        n_interval: Wavelengths over which an Airy pattern is averaged: the nodes of the band's spectral intervals,
            weighted by its response, for a source whose spectrum is flat in W/um; 1 is the isophotal wavelength alone.
        smear_urad: Standard deviation of each axis of the line of sight, moving faster than the exposure [urad].
        stamp_cut_nei: Light left out of a source's stamp stays below this in every pixel [NEI].
        psf_error: Largest error per pixel of the tables behind "airy" and "table", as a part of the source's light.
    """

    aperture_m: Positive
    obscuration: Annotated[Number, closed_interval(0, MAX_OBSCURATION)] = 0.0
    psf: Literal["airy", "gaussian", "table"] = "airy"
    sigma_px: Positive | None = None
    psf_file: FileByBand | None = None
    psf_oversample: Annotated[Number, closed_interval(1, MAX_OVERSAMPLE)] | None = None
    n_interval: Annotated[Count, closed_interval(1, MAX_N_WAVELENGTH)] = 6
    smear_urad: NonNegative = 0.0
    stamp_cut_nei: Positive = 0.1
    psf_error: Annotated[Number, closed_interval(*ERROR_RANGE)] = DEFAULT_ERROR

    @model_validator(mode="after")
    def _file_of_a_table(self) -> Optics:
        if self.sigma_px is not None and self.psf != "gaussian":
            raise InputError(f"belongs to psf = 'gaussian', got psf = {self.psf!r}", "sigma_px")
        for name, value in (("psf_file", self.psf_file), ("psf_oversample", self.psf_oversample)):
            if self.psf == "table" and value is None:
                raise InputError("is required with psf = 'table'", name)
            if self.psf != "table" and value is not None:
                raise InputError(f"belongs to psf = 'table', got psf = {self.psf!r}", name)
        return self

    def psf_for(self, band: Band | str, camera: Camera, diffusion_px: float = 0.0) -> Psf:
        """The point spread function in a band, in pixel widths of the camera.

        Args:
            band: A Band, or the name of a shipped one.
            camera: Gives the size of a pixel.
            diffusion_px: Standard deviation of each axis of the charge's diffusion in the detector [px]; it adds to
                smear_urad in quadrature.

        Raises:
            InputError: The pattern is outside the range that can be drawn, or its file cannot be read.
        """
        band = as_band(band)
        smear_px = math.hypot(self.smear_urad * 1e-6 * camera.focal_px, diffusion_px)
        if self.psf == "table":
            return PsfTable(self._image_of(band.name), self.psf_oversample or 1.0, smear_px)
        lambda_f_px = 1e-6 / self.aperture_m * camera.focal_px  # of 1 um
        if self.psf == "gaussian":
            sigma_px = GAUSSIAN_PER_LAMBDA_F * band.isophotal_um * lambda_f_px
            return PsfGaussian(math.hypot(sigma_px if self.sigma_px is None else self.sigma_px, smear_px))
        unit_px = FIRST_DARK_RING * lambda_f_px
        if self.n_interval == 1:
            return PsfAiry(unit_px * band.isophotal_um, self.obscuration, smear_px)
        wavelength_um, weight_um = band.intervals(self.n_interval)
        return PsfAiry((unit_px * wavelength_um).tolist(), self.obscuration, smear_px, weight_um.tolist())

    @property
    def file_checksums(self) -> dict[str, str]:
        """SHA-256 of the files behind "table", by path.

        Raises:
            InputError: A file cannot be read.
        """
        paths = self.psf_file.values() if isinstance(self.psf_file, Mapping) else [self.psf_file]
        return {path: read_psf_file(path)[1] for path in dict.fromkeys(paths) if path is not None}

    def _image_of(self, band: str) -> npt.NDArray[np.float64]:
        if isinstance(self.psf_file, Mapping) and band not in self.psf_file:
            raise InputError(f"must name a file for every band, got none for {band}", "psf_file")
        path = self.psf_file[band] if isinstance(self.psf_file, Mapping) else self.psf_file
        assert path is not None  # by the validator
        return read_psf_file(path)[0]
