"""Single images, each with its metadata: 16-bit PNG and TIFF, float EXR and TIFF, FITS with a WCS; astropy's CCDData.

PNG, TIFF and EXR are written and read by OpenImageIO. Counts are stored as they are, signals bit for bit. What is known
of an image stands as one JSON text in its description (`ImageDescription`): attributes of other types are dropped
silently by some formats. No file holds the time at which it was written.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.files import naming, plain_number, whole_file, whole_file_by_memory
from warpsim.output.fits_header import Card, Views, image_cards
from warpsim.render.frameset import FrameSet
from warpsim.render.likelihood import irradiance_image

if TYPE_CHECKING:
    from astropy.nddata import CCDData

_PLUGINS = {".png": "png", ".tif": "tiff", ".tiff": "tiff", ".exr": "openexr"}
COUNTS_SUFFIXES = (".png", ".tif", ".tiff")
SIGNAL_SUFFIXES = (".exr", ".tif", ".tiff")

Settings = dict[str, str | int]

_SETTINGS: dict[str, Settings] = {
    "png": {"oiio:ColorSpace": "data", "png:compressionLevel": 4},  # counts are no colours
    "tiff": {"compression": "lzw"},
    "openexr": {"compression": "zip"},
}
"""Ways of compressing that take a quarter to half of the time of the usual ones, and up to 13 % more space."""

_NOISE: Settings = _SETTINGS["png"] | {"png:filter": 8}
"""Of 8-bit noise: differences of neighbours take more space than the pixels, and twice the time."""


def write_counts(path: str | Path, counts: npt.NDArray[np.uint16], meta: dict[str, Any]) -> None:
    """Write counts as a 16-bit grey image: the file's numbers are the counts.

    Args:
        path: File to write: .png, .tif or .tiff.
        counts: Shape (row, column), uint16; row 0 is the top row.
        meta: What is to be known of the image, as JSON can hold it; see image_facts.

    Raises:
        InputError: Another suffix, shape or type.
        OSError: Writing failed.
    """
    _write(Path(path), counts, np.dtype(np.uint16), COUNTS_SUFFIXES, meta)


def write_grey(path: Path, grey: npt.NDArray[np.uint8], meta: dict[str, Any], settings: Settings = _NOISE) -> None:
    """Write an 8-bit image of one or more channels, shape (row, column, channel), as PNG."""
    _write_channels(path, grey, "png", meta, settings)


def write_signal(path: str | Path, signal_w_cm2: npt.NDArray[np.float32], meta: dict[str, Any]) -> None:
    """Write a noiseless image as 32-bit floats, bit for bit.

    Args:
        path: File to write: .exr, .tif or .tiff.
        signal_w_cm2: Irradiance per pixel [W/cm2], shape (row, column), float32; row 0 is the top row.
        meta: What is to be known of the image, as JSON can hold it; see image_facts.

    Raises:
        InputError: Another suffix, shape or type.
        OSError: Writing failed.
    """
    _write(Path(path), signal_w_cm2, np.dtype(np.float32), SIGNAL_SUFFIXES, meta)


def read_image(path: str | Path) -> tuple[npt.NDArray[Any], dict[str, Any]]:
    """Read an image of write_counts or write_signal, or another one of one channel and these types.

    Returns:
        Its numbers, shape (row, column), uint16 or float32, and what is known of it; nothing where it does not say.

    Raises:
        InputError: The file is missing, is no image, or has several channels or numbers of another type.
    """
    import OpenImageIO as oiio

    oiio.geterror()  # of calls before
    file = oiio.ImageInput.open(str(path))
    if file is None:
        raise InputError(f"cannot be read: {_one_line(oiio.geterror())}").of(path)
    try:
        spec = file.spec()
        kinds = {str(oiio.TypeDesc(oiio.UINT16)): oiio.UINT16, str(oiio.TypeDesc(oiio.FLOAT)): oiio.FLOAT}
        if spec.nchannels != 1 or str(spec.format) not in kinds:
            found = f"{spec.nchannels} of {spec.format}"
            raise InputError("must have one channel of 16-bit counts or 32-bit floats", "", found, "s").of(path)
        pixels = file.read_image(kinds[str(spec.format)])
        if pixels is None:
            raise InputError(f"cannot be read: {_one_line(file.geterror())}").of(path)
        return np.ascontiguousarray(pixels[..., 0]), _facts(spec.get_string_attribute("ImageDescription"))
    finally:
        file.close()


def image_facts(frames: FrameSet, frame: int, sensor: str, band: str) -> dict[str, Any]:
    """Metadata of an image by FITS keyword: for `meta` of other files; `WCS(fits.Header(facts))` is its WCS.

    Raises:
        InputError: The image was not rendered.
    """
    return facts_of(_cards(frames, frame, sensor, band))


def facts_of(cards: list[Card]) -> dict[str, Any]:
    """Keywords and values."""
    return {keyword: value for keyword, value, _ in cards}


def write_fits_image(path: str | Path, frames: FrameSet, frame: int, sensor: str, band: str) -> None:
    """Write the counts of one image as FITS: one primary array, and a header with its time, its WCS and its detector.

    Args:
        path: File to write.
        frames: Where the image is.
        frame: Frame number.
        sensor: Sensor name.
        band: Band name.

    Raises:
        InputError: The image was not rendered.
        OSError: Writing failed.
    """
    from astropy.io import fits

    header = fits.Header([fits.Card(*card) for card in _cards(frames, frame, sensor, band)])
    counts = frames.counts[frames.frames.index(frame), frames.sensors.index(sensor), frames.bands.index(band)]
    with whole_file(Path(path)) as partial, naming(Path(path)), partial.open("wb") as file:
        fits.PrimaryHDU(np.ascontiguousarray(counts), header).writeto(file)


def ccddata(frames: FrameSet, frame: int, sensor: str, band: str) -> CCDData:
    """Return one image as irradiance with all that belongs to it.

    Args:
        frames: Rendered frames.
        frame: One of `frames.frames`.
        sensor: One of `frames.sensors`.
        band: One of `frames.bands`.

    Returns:
        CCDData of (row, column): irradiance by the counts above blank sky [W/cm2], where the response is linear; its
        standard deviation, the NEI and, of a detector with shot noise, that of the light in the pixel; mask, True where
        the converter or the pixel is full; WCS of the apparent sky; the keywords of FITS images in `meta`.

    Raises:
        InputError: The image was not rendered.
    """
    import astropy.units as u
    from astropy.nddata import CCDData, StdDevUncertainty

    image = irradiance_image(frames, frame, sensor, band, "ccddata")
    meta = facts_of(_cards(frames, frame, sensor, band))
    del meta["BUNIT"]
    return CCDData(
        image.light_w_cm2,
        unit=u.W / u.cm**2,
        uncertainty=StdDevUncertainty(np.sqrt(image.variance(image.light_w_cm2))),
        mask=image.is_full,
        wcs=frames.wcs(frame, sensor),
        meta=meta,
    )


def _cards(frames: FrameSet, frame: int, sensor: str, band: str) -> list[Card]:
    if frame not in frames.frames or sensor not in frames.sensors or band not in frames.bands:
        raise InputError(f"frame {frame} of {sensor!r} in band {band!r} was not rendered", "image")
    views = Views.of(frames.one_frame(frames.frames.index(frame)), sensor)
    return next(image_cards(frames.scene, band, views))


def _write(
    path: Path, pixels: npt.NDArray[Any], kind: np.dtype[Any], suffixes: tuple[str, ...], meta: dict[str, Any]
) -> None:
    suffix = path.suffix.lower()
    if suffix not in suffixes:
        raise InputError(f"must end in one of {', '.join(suffixes)}").of(path)
    if pixels.ndim != 2 or pixels.dtype != kind or 0 in pixels.shape:
        raise InputError(f"must be of {kind} and two axes, got {pixels.dtype} of shape {pixels.shape}").of(path)
    plugin = _PLUGINS[suffix]
    _write_channels(path, pixels[..., None], plugin, meta, _SETTINGS[plugin])


def _write_channels(
    path: Path, pixels: npt.NDArray[Any], plugin: str, meta: dict[str, Any], settings: Settings
) -> None:
    """Write an image, shape (row, column, channel), whole or not at all."""
    import OpenImageIO as oiio

    n_row, n_col, n_channel = pixels.shape
    kinds = {"uint8": oiio.UINT8, "uint16": oiio.UINT16, "float32": oiio.FLOAT}
    spec = oiio.ImageSpec(n_col, n_row, n_channel, kinds[str(pixels.dtype)])
    spec.attribute("ImageDescription", json.dumps(meta, default=plain_number))
    spec.attribute("DateTime", "")  # else it is that of writing
    for name, value in settings.items():
        spec.attribute(name, value)
    with whole_file_by_memory(path) as name:
        oiio.geterror()  # of calls before
        file = oiio.ImageOutput.create(plugin)
        if file is None:
            raise OSError(f"{path}: cannot be written: {_one_line(oiio.geterror())}")
        if not (file.open(name, spec) and file.write_image(np.ascontiguousarray(pixels)) and file.close()):
            raise OSError(f"{path}: cannot be written: {_one_line(file.geterror())}")


def _facts(description: str) -> dict[str, Any]:
    try:
        facts = json.loads(description)
    except ValueError:
        return {}
    return facts if isinstance(facts, dict) else {}


def _one_line(message: str) -> str:
    return " ".join(message.split()) or "no reason given"
