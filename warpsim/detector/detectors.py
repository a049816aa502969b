"""Detectors: described by noise-equivalent irradiance (NEI), or by what their electrons go through."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from warpsim.config.fields import FileName, Integer, NonNegative, Number, Positive, Switch, closed_interval
from warpsim.config.model import config_model
from warpsim.detector.hits_and_flicker import Flicker, RadiationHits, check_artifacts
from warpsim.errors import InputError
from warpsim.radiometry.by_band import FractionByBand, NonNegativeByBand, PositiveByBand, in_band, named_bands

Bits = Annotated[Integer, closed_interval(1, 16)]
"""Of an analogue-to-digital converter."""
GainSpread = Annotated[NonNegative, closed_interval(0, 0.1)]
"""Standard deviation of gains about 1; at most a tenth, so that no gain is negative."""
BadFraction = Annotated[NonNegative, closed_interval(0, 0.5)]
"""Fraction of pixels."""
Nonlinearity = Annotated[NonNegative, closed_interval(0, 0.5)]
"""Fraction of the response lost at saturation; at most a half, so that more light is never fewer counts."""
Exposure = Annotated[NonNegative, closed_interval(0, 10)]
"""Length of an exposure that may be an instant [s]."""
PositiveExposure = Annotated[Positive, closed_interval(0, 10)]
"""Length of an exposure [s]."""
Diffusion = Annotated[NonNegative, closed_interval(0, 10)]
"""Standard deviation of how far charge spreads, along rows as along columns [pixel widths]."""
LineTime = Annotated[Number, closed_interval(-1, 1)]
"""From the mid-exposure of a row to that of the next [s]; 0: all rows at once."""
Stages = Annotated[Integer, closed_interval(0, 100_000)]
"""Of time delay and integration; 0: none."""


def _check_alike(detector: Any, dsnu: str) -> None:
    """Raise where maps, artifacts or rows that are exposed one after the other do not fit the rest of a detector."""
    for name in ("prnu", dsnu, "dead_fraction", "hot_fraction"):
        if detector.maps_file is not None and getattr(detector, name) > 0.0:
            raise InputError("must be left out with maps_file, which has it for every pixel", name)
    check_artifacts(detector)
    line_s, stages, exposure_s = abs(detector.line_time_s), detector.tdi_stages, detector.exposure_s
    if line_s > 0.0 and not detector.streaks:
        raise InputError("must be true with line_time_s, which moves light over the image", "streaks", False)
    if stages and line_s == 0.0:
        raise InputError("needs line_time_s, the time of a stage", "tdi_stages", stages)
    if stages and not math.isclose(exposure_s, stages * line_s, rel_tol=1e-9):
        rule = f"must be tdi_stages * |line_time_s| ({stages * line_s:g})"
        raise InputError(rule, "exposure_s", exposure_s, ".12g")


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
            positions are those of its middle.
        diffusion_px: Standard deviation, along rows as along columns, by which charge spreads before it is collected
            [px, in widths of a pixel]; it widens the point spread function.
        prnu: Photo-response non-uniformity: standard deviation of the pixels' gains about 1, the same in every frame.
        dsnu_nei: Offset non-uniformity: standard deviation of the pixels' offsets [NEI], the same in every frame.
        column_noise_nei: Standard deviation of an offset that the pixels of a column share, new in every frame [NEI].
        dead_fraction: Fraction of pixels that do not respond to light, the same in every frame.
        hot_fraction: Fraction of pixels that are always saturated.
        nonlinearity: Fraction of its response that a pixel has lost at SEI: a signal S, at most SEI, reads
            S (1 - nonlinearity * S / SEI).
        maps_file: FITS file of the pixels' gains, offsets [W/cm2] and bad ones in the place of prnu, dsnu_nei,
            dead_fraction and hot_fraction, as `ws.calibrate` writes it; "{sensor}" in it stands for each one's name.
        hits: Radiation hits; none when left out.
        flicker: Flickering pixels; none when left out.
        line_time_s: Time from the mid-exposure of a row to that of the next [s], negative where the bottom row is the
            first; the frame's time is that of the array's middle. 0 exposes all rows at once.
        tdi_stages: Stages of time delay and integration, each as long as line_time_s, whose sum is the exposure: the
            image is a strip, along which charge moves in step with the scene. 0 is none.
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
    dead_fraction: BadFraction = 0.0
    hot_fraction: BadFraction = 0.0
    nonlinearity: Nonlinearity = 0.0
    maps_file: FileName | None = None
    hits: RadiationHits | None = None
    flicker: Flicker | None = None
    line_time_s: LineTime = 0.0
    tdi_stages: Stages = 0
    kind: Literal["nei"] = Field(default="nei", kw_only=True)

    @model_validator(mode="after")
    def _ordered(self) -> NeiDetector:
        _check_alike(self, "dsnu_nei")
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
            positions are those of its middle.
        diffusion_px: Standard deviation, along rows as along columns, by which charge spreads before it is collected
            [px, in widths of a pixel]; it widens the point spread function.
        transmission: Of the optics where the band's response has its peak, by band.
        quantum_efficiency: Electrons per photon where the band's response has its peak, by band.
        background_w_cm2_sr: Radiance of the sky in the band, by band [W/cm2/sr].
        zodiacal_mjy_sr: Spectral radiance of the sky, the same at all frequencies of a band, by band [MJy/sr].
        optics_temperature_k: Temperature of the optics, whose thermal emission does not pass the transmission [K].
        optics_emissivity: Its emissivity.
        dark_e_s: Dark current of a pixel [e/s].
        read_noise_e: Standard deviation of the noise of reading a pixel [e].
        shot_noise: Whether numbers of electrons are Poisson deviates about their mean.
        prnu: Photo-response non-uniformity: standard deviation of the pixels' gains about 1, the same in every frame.
        dsnu: Dark-signal non-uniformity: standard deviation of the pixels' dark currents as a fraction of dark_e_s, the
            same in every frame; no current is negative, so that above 0.3 their mean grows and their spread lags.
        column_noise_e: Standard deviation of an offset that the pixels of a column share, new in every frame [e].
        dead_fraction: Fraction of pixels that do not respond to light, the same in every frame.
        hot_fraction: Fraction of pixels whose well is always full.
        nonlinearity: Fraction of the charge that is lost in reading a full well: N electrons read
            N (1 - nonlinearity * N / full_well_e).
        maps_file: FITS file of the pixels' gains, electrons by dark current in an exposure and bad ones in the place of
            prnu, dsnu, dead_fraction and hot_fraction, as `ws.calibrate` writes it; "{sensor}" in it stands for each
            one's name. dark_e_s is that of the mean pixel.
        hits: Radiation hits; none when left out.
        flicker: Flickering pixels; none when left out.
        line_time_s: Time from the mid-exposure of a row to that of the next [s], negative where the bottom row is the
            first; the frame's time is that of the array's middle. 0 exposes all rows at once.
        tdi_stages: Stages of time delay and integration, each as long as line_time_s, whose sum is the exposure: the
            image is a strip, along which charge moves in step with the scene. 0 is none.
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
    dead_fraction: BadFraction = 0.0
    hot_fraction: BadFraction = 0.0
    nonlinearity: Nonlinearity = 0.0
    maps_file: FileName | None = None
    hits: RadiationHits | None = None
    flicker: Flicker | None = None
    line_time_s: LineTime = 0.0
    tdi_stages: Stages = 0
    kind: Literal["electron"] = Field(default="electron", kw_only=True)

    @model_validator(mode="after")
    def _complete(self) -> ElectronDetector:
        _check_alike(self, "dsnu")
        if (self.optics_temperature_k is None) != (self.optics_emissivity == 0.0):
            raise InputError("must be given together", "optics_temperature_k, optics_emissivity")
        if self.offset_counts >= 2**self.bits:
            raise InputError(f"must be below 2**bits ({2**self.bits})", "offset_counts", self.offset_counts, "g")
        return self


def _kind_of(value: Any) -> Any:
    """The kind that a table of a scene file states; "nei" where it states none."""
    return value.get("kind", "nei") if isinstance(value, dict) else getattr(value, "kind", "nei")


Detector = Annotated[
    Annotated[NeiDetector, Tag("nei")] | Annotated[ElectronDetector, Tag("electron")], Discriminator(_kind_of)
]


def has_maps(detector: NeiDetector | ElectronDetector) -> bool:
    """Return whether gains, offsets or bad pixels stay with the pixels of a detector from frame to frame."""
    random = ("prnu", "dsnu", "dsnu_nei", "dead_fraction", "hot_fraction")
    always = detector.maps_file is not None or detector.flicker is not None
    return always or any(getattr(detector, name, 0.0) > 0.0 for name in random)


TERMS: dict[str, tuple[str, str, float | None]] = {
    "prnu": ("PRNU", "{:g} rms of gains", 0.0),
    "dead_fraction": ("DEADFRAC", "{:g} of the pixels dead", 0.0),
    "hot_fraction": ("HOTFRAC", "{:g} of the pixels hot", 0.0),
    "nonlinearity": ("NONLIN", "{:g} of the response lost at saturation", 0.0),
    "dsnu": ("DSNU", "{:g} rms of dark currents", 0.0),
    "dsnu_nei": ("DSNU", "{:g} NEI rms of offsets", 0.0),
    "column_noise_e": ("COLNOISE", "{:g} e rms by column", 0.0),
    "column_noise_nei": ("COLNOISE", "{:g} NEI rms by column", 0.0),
    "shot_noise": ("SHOT", "no shot noise", True),
    "maps_file": ("MAPSFILE", "maps of {}", None),
    "hits": ("HITS", "radiation hits, {}", None),
    "flicker": ("FLICKER", "flickering pixels, {}", None),
    "line_time_s": ("LINETIME", "{:g} s from row to row", 0.0),
    "tdi_stages": ("TDI", "{} stages of TDI", 0),
}
"""What may differ from the plain chain of a detector, by field: FITS keyword, words, value in the plain chain."""


def detector_terms(detector: NeiDetector | ElectronDetector) -> dict[str, str]:
    """What a detector has beyond the plain chain of its kind, by field: a few words about each."""
    return {
        name: words.format(getattr(detector, name))
        for name, (_, words, plain) in TERMS.items()
        if getattr(detector, name, plain) != plain
    }
