"""What lies behind stars and targets, as a scene describes it."""

from __future__ import annotations

from warpsim.config.fields import FileName, Switch
from warpsim.config.model import config_model


@config_model
class Background:
    """What lies behind stars and targets; nothing when left out.

    Electron detectors count its electrons with their shot noise. A detector described by its NEI takes it as an offset:
    its noise is given.

    Args:
        zodiacal: Whether interplanetary dust glows (Kelsall et al. 1998).
        earth: Whether the Earth's disc and limb glow, and reflect sunlight.
        sky_map: FITS image with celestial WCS, or FITS table of HEALPix pixels, of surface brightness, for all bands.
    """

    zodiacal: Switch = False
    earth: Switch = False
    sky_map: FileName | None = None

    @property
    def is_on(self) -> bool:
        """Whether there is any."""
        return self.zodiacal or self.earth or self.sky_map is not None
