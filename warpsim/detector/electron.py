"""A detector described by what its electrons go through."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from warpsim.config.fields import NonNegative, Positive, Switch, closed_interval
from warpsim.config.model import config_model
from warpsim.detector.detector_fields import BadShare, Bits, Diffusion, GainSpread, Nonlinearity, PositiveExposure
from warpsim.errors import InputError
from warpsim.radiometry.by_band import FractionByBand, NonNegativeByBand


@config_model
class ElectronDetector:
    """Light and background become electrons, and electrons counts.

    Fields "by band" are one number for all bands, or a table.

    Args:
        exposure_s: Length of the exposure about the frame's time [s].
        full_well_e: Electrons that a pixel holds [e].
        gain_e_per_count: Electrons per count.
        bits: Bits of the analogue-to-digital converter.
        offset_counts: Counts of an empty pixel.
        streaks: Whether light moves over the image during the exposure, as cameras turn and targets pass; without,
            places are those of its middle.
        diffusion_px: Standard deviation, along rows as along columns, by which charge spreads before it is collected
            [px, in widths of a pixel]; it widens the point spread function.
        transmission: Of the optics where the band's response has its peak, by band.
        quantum_efficiency: Electrons per photon where the band's response has its peak, by band.
        background_w_cm2_sr: Radiance of the sky in the band, by band [W/cm2/sr].
        zodiacal_mjy_sr: Spectral radiance of the sky, the same at all frequencies of a band, by band [MJy/sr].
        optics_temperature_k: Temperature of the optics, whose own light does not pass the transmission [K].
        optics_emissivity: Its emissivity.
        dark_e_s: Dark current of a pixel [e/s].
        read_noise_e: Standard deviation of the noise of reading a pixel [e].
        shot_noise: Whether numbers of electrons are Poisson deviates about their mean.
        prnu: Photo-response non-uniformity: standard deviation of the pixels' gains about 1, the same in every frame.
        dsnu: Dark-signal non-uniformity: standard deviation of the pixels' dark currents as a share of dark_e_s, the
            same in every frame; no current is negative, so that above 0.3 their mean grows and their spread lags.
        column_noise_e: Standard deviation of an offset that the pixels of a column share, new in every frame [e].
        dead_fraction: Share of pixels that do not respond to light, the same in every frame.
        hot_fraction: Share of pixels whose well is always full.
        nonlinearity: Share of the charge that is lost in reading a full well: N electrons read
            N (1 - nonlinearity * N / full_well_e).
    """

    exposure_s: PositiveExposure
    full_well_e: Annotated[Positive, closed_interval(10, 1e9)]
    gain_e_per_count: Annotated[Positive, closed_interval(1e-6, 1e9)]
    bits: Bits = 14
    offset_counts: NonNegative = 100.0
    streaks: Switch = True
    diffusion_px: Diffusion = 0.0
    transmission: FractionByBand = 1.0
    quantum_efficiency: FractionByBand = 1.0
    background_w_cm2_sr: NonNegativeByBand = 0.0
    zodiacal_mjy_sr: NonNegativeByBand = 0.0
    optics_temperature_k: Annotated[Positive, closed_interval(1, 1000)] | None = None
    optics_emissivity: Annotated[NonNegative, closed_interval(0, 1)] = 0.0
    dark_e_s: Annotated[NonNegative, closed_interval(0, 1e12)] = 0.0
    read_noise_e: Annotated[NonNegative, closed_interval(0, 1e9)] = 0.0
    shot_noise: Switch = True
    prnu: GainSpread = 0.0
    dsnu: Annotated[NonNegative, closed_interval(0, 1)] = 0.0
    column_noise_e: Annotated[NonNegative, closed_interval(0, 1e9)] = 0.0
    dead_fraction: BadShare = 0.0
    hot_fraction: BadShare = 0.0
    nonlinearity: Nonlinearity = 0.0
    kind: Literal["electron"] = Field(default="electron", kw_only=True)

    @model_validator(mode="after")
    def _complete(self) -> ElectronDetector:
        if (self.optics_temperature_k is None) != (self.optics_emissivity == 0.0):
            raise InputError("must be given together", "optics_temperature_k, optics_emissivity")
        if self.offset_counts >= 2**self.bits:
            raise InputError(f"must be below 2**bits ({2**self.bits})", "offset_counts", self.offset_counts, "g")
        return self
