"""Images as astropy's CCDData: irradiance with its error, mask, WCS and keywords, as photutils and others take it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpsim.output.fits_header import Views, image_cards
from warpsim.render.frameset import FrameSet
from warpsim.render.likelihood import irradiance_image

if TYPE_CHECKING:
    from astropy.nddata import CCDData


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
    one = frames.one_frame(frames.frames.index(frame))
    cards = next(image_cards(frames.scene, band, Views.of(one, sensor)))
    meta = {name: value for name, value, _ in cards if name not in ("BUNIT",)}
    return CCDData(
        image.light_w_cm2,
        unit=u.W / u.cm**2,
        uncertainty=StdDevUncertainty(np.sqrt(image.variance(image.light_w_cm2))),
        mask=image.is_full,
        wcs=frames.wcs(frame, sensor),
        meta=meta,
    )
