"""A detector described by its noise-equivalent irradiance."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from warpsim.describe import Integer, NonNegative, Positive, Switch, closed_interval, part, part_error

MAX_DIFFUSION_PX = 10.0


@part
class NeiDetector:
    """Counts = ADC(offset + counts_per_nei * min(signal / NEI + unit Gaussian noise, SEI / NEI)).

    Args:
        nei_w_cm2: Irradiance whose signal equals one standard deviation of a pixel's noise [W/cm2].
        sei_w_cm2: Irradiance at which a pixel saturates [W/cm2].
        bits: Bits of the analogue-to-digital converter.
        offset_counts: Counts of blank sky. At 5 * counts_per_nei or more, the noise of blank sky is not clipped.
        counts_per_nei: Gain [counts per NEI].
        exposure_s: Length of the exposure about the frame's time [s], over which targets' brightness is averaged as
            they turn; 0 is an instant. NEI and SEI are those of this exposure.
        streaks: Whether light moves over the image during the exposure, as cameras turn and targets pass; without,
            places are those of its middle.
        diffusion_px: Standard deviation, along rows as along columns, by which charge spreads before it is collected
            [px, in widths of a pixel]; it widens the point spread function.
    """

    nei_w_cm2: Positive
    sei_w_cm2: Positive
    bits: Annotated[Integer, closed_interval(1, 16)] = 14
    offset_counts: NonNegative = 100.0
    counts_per_nei: Positive = 5.0
    exposure_s: Annotated[NonNegative, closed_interval(0, 10)] = 0.0
    streaks: Switch = True
    diffusion_px: Annotated[NonNegative, closed_interval(0, MAX_DIFFUSION_PX)] = 0.0
    kind: Literal["nei"] = Field(default="nei", kw_only=True)

    @model_validator(mode="after")
    def _ordered(self) -> NeiDetector:
        if self.sei_w_cm2 <= self.nei_w_cm2:
            raise part_error(f"sei_w_cm2: must be above nei_w_cm2 ({self.nei_w_cm2:g}), got {self.sei_w_cm2:g}")
        if self.offset_counts >= 2**self.bits:
            raise part_error(f"offset_counts: must be below 2**bits ({2**self.bits}), got {self.offset_counts:g}")
        return self

    @property
    def dynamic_range(self) -> float:
        """SEI / NEI."""
        return self.sei_w_cm2 / self.nei_w_cm2


def read_out_struct(detector: NeiDetector, seed: int) -> Any:
    """The detector and the seed of its noise as the kernels' struct."""
    from warpsim_kernels.read_out import NeiReadOut

    scalars = NeiReadOut()
    scalars.per_nei = 1.0 / detector.nei_w_cm2
    scalars.ceiling_nei = detector.dynamic_range
    scalars.counts_per_nei = detector.counts_per_nei
    scalars.offset_counts = detector.offset_counts
    scalars.max_counts = float(2**detector.bits - 1)
    scalars.seed_low = seed & 0xFFFFFFFF
    scalars.seed_high = (seed >> 32) & 0xFFFFFFFF
    return scalars
