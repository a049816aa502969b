"""Field types that kinds of detectors share."""

from __future__ import annotations

from typing import Annotated

from warpsim.config.fields import Integer, NonNegative, Positive, closed_interval

Bits = Annotated[Integer, closed_interval(1, 16)]
"""Of an analogue-to-digital converter."""
GainSpread = Annotated[NonNegative, closed_interval(0, 0.1)]
"""Standard deviation of gains about 1; at most a tenth, so that no gain is negative."""
BadShare = Annotated[NonNegative, closed_interval(0, 0.5)]
"""Share of pixels."""
Nonlinearity = Annotated[NonNegative, closed_interval(0, 0.5)]
"""Share of the response lost at saturation; at most a half, so that more light is never fewer counts."""
Exposure = Annotated[NonNegative, closed_interval(0, 10)]
"""Length of an exposure that may be an instant [s]."""
PositiveExposure = Annotated[Positive, closed_interval(0, 10)]
"""Length of an exposure [s]."""
Diffusion = Annotated[NonNegative, closed_interval(0, 10)]
"""Standard deviation of how far charge spreads, along rows as along columns [pixel widths]."""
