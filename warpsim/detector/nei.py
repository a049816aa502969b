"""A detector described by its noise-equivalent irradiance."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from warpsim.config.fields import NonNegative, Positive, Switch
from warpsim.config.model import config_model
from warpsim.detector.detector_fields import BadShare, Bits, Diffusion, Exposure, GainSpread, Nonlinearity
from warpsim.errors import InputError
from warpsim.radiometry.by_band import PositiveByBand, in_band, named_bands


@config_model
class NeiDetector:
    """Counts = ADC(offset + counts_per_nei * min(signal / NEI + unit Gaussian noise, SEI / NEI)).

    Args:
        nei_w_cm2: Irradiance whose signal equals one standard deviation of a pixel's noise, one number or a table by
            band [W/cm2].
        sei_w_cm2: Irradiance at which a pixel saturates, alike [W/cm2].
        bits: Bits of the analogue-to-digital converter.
        offset_counts: Counts of blank sky. At 5 * counts_per_nei or more, the noise of blank sky is not clipped.
        counts_per_nei: Gain [counts per NEI].
        exposure_s: Length of the exposure about the frame's time [s], over which targets' brightness is averaged as
            they turn; 0 is an instant. NEI and SEI are those of this exposure.
        streaks: Whether light moves over the image during the exposure, as cameras turn and targets pass; without,
            places are those of its middle.
        diffusion_px: Standard deviation, along rows as along columns, by which charge spreads before it is collected
            [px, in widths of a pixel]; it widens the point spread function.
        prnu: Photo-response non-uniformity: standard deviation of the pixels' gains about 1, the same in every frame.
        dsnu_nei: Offset non-uniformity: standard deviation of the pixels' offsets [NEI], the same in every frame.
        column_noise_nei: Standard deviation of an offset that the pixels of a column share, new in every frame [NEI].
        dead_fraction: Share of pixels that do not respond to light, the same in every frame.
        hot_fraction: Share of pixels that are always saturated.
        nonlinearity: Share of its response that a pixel has lost at SEI: a signal S, at most SEI, reads
            S (1 - nonlinearity * S / SEI).
    """

    nei_w_cm2: PositiveByBand
    sei_w_cm2: PositiveByBand
    bits: Bits = 14
    offset_counts: NonNegative = 100.0
    counts_per_nei: Positive = 5.0
    exposure_s: Exposure = 0.0
    streaks: Switch = True
    diffusion_px: Diffusion = 0.0
    prnu: GainSpread = 0.0
    dsnu_nei: NonNegative = 0.0
    column_noise_nei: NonNegative = 0.0
    dead_fraction: BadShare = 0.0
    hot_fraction: BadShare = 0.0
    nonlinearity: Nonlinearity = 0.0
    kind: Literal["nei"] = Field(default="nei", kw_only=True)

    @model_validator(mode="after")
    def _ordered(self) -> NeiDetector:
        for band in named_bands(self.nei_w_cm2, self.sei_w_cm2) or [""]:
            nei, sei = in_band(self.nei_w_cm2, band), in_band(self.sei_w_cm2, band)
            if nei is not None and sei is not None and sei <= nei:
                where = f" in {band}" if band else ""
                raise InputError(f"must be above nei_w_cm2 ({nei:g}){where}", "sei_w_cm2", sei, "g")
        if self.offset_counts >= 2**self.bits:
            raise InputError(f"must be below 2**bits ({2**self.bits})", "offset_counts", self.offset_counts, "g")
        return self

    @property
    def dynamic_range(self) -> float:
        """SEI / NEI.

        Raises:
            InputError: They differ by band.
        """
        if isinstance(self.nei_w_cm2, float) and isinstance(self.sei_w_cm2, float):
            return self.sei_w_cm2 / self.nei_w_cm2
        rule = "differs by band; sei_w_cm2 over nei_w_cm2 of a scenario's instrument is that of a band"
        raise InputError(rule, "dynamic_range").of("NeiDetector")
