"""Report of what lies behind stars and targets: its size in NEI, band by band, and what is left out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from warpsim.background.user_maps import read_pixel_image, sky_map_sizes
from warpsim.background.zodiacal import zodiacal_map
from warpsim.constants import ASTRONOMICAL_UNIT_M
from warpsim.output.check_views import field_contents
from warpsim.output.wording import counted
from warpsim.radiometry.bands import band_radiance_w_m2_sr
from warpsim.render.background import stray_light_w_cm2_sr
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario

_MOST_VIEWS = 50
_MOST_ZODIACAL_DAYS = 20.0
_W_CM2_PER_W_M2 = 1e-4

View = tuple[str, npt.NDArray[np.float64]]
"""A sensor, and times [s]."""


def background_lines(instrument: Instrument, scenario: Scenario, frames_of: Mapping[str, Sequence[int]]) -> list[str]:
    """Return a line for each band: the background in a pixel in the middle of the frame [NEI], on or left out.

    One more for a map, and for an image, of the user's.

    Args:
        instrument: The kind of sensor.
        scenario: With it.
        frames_of: Frames of some sensors, of which some are looked at.

    Raises:
        InputError: The map or the image cannot be read, or the function cannot be called.
    """
    each = max(1, _MOST_VIEWS // max(1, len(frames_of)))
    views = [
        (name, instrument.frame_time_s(frames[:: max(1, len(frames) // each)]))
        for name, frames in list(frames_of.items())[:_MOST_VIEWS]
    ]
    sky = [*_sky_lines(instrument, scenario, views), *_stray_lines(instrument, scenario, views)] if views else []
    return [*sky, *_own_lines(instrument), *_zodiacal_warning(scenario)]


def _pixel_sr(instrument: Instrument) -> float:
    return 1 / (instrument.sensor.camera.focal_px * instrument.sensor.camera.focal_row_px)


def _sky_lines(instrument: Instrument, scenario: Scenario, views: Sequence[View]) -> list[str]:
    wanted, pixel_sr = instrument.background, _pixel_sr(instrument)
    axes = [instrument.commanded_axes(instrument.index(name), time_s).axes for name, time_s in views]
    boresights = np.concatenate(axes)[:, 2]
    sun_m = scenario.tracks.sun.position_at_m(np.array([scenario.scene.duration_s / 2]))[0]
    bands = list(instrument.bands.values())
    strength = (ASTRONOMICAL_UNIT_M / float(np.linalg.norm(sun_m))) ** 2
    dust = zodiacal_map(bands, -sun_m / ASTRONOMICAL_UNIT_M)(boresights)
    lighting, lines = scenario.scene.lighting, []
    for (name, band), zodiacal in zip(instrument.bands.items(), dust, strict=True):
        nei_sr = instrument.nei_w_cm2(name) / pixel_sr
        low, high = zodiacal.min() / nei_sr, zodiacal.max() / nei_sr
        night = float(band_radiance_w_m2_sr(lighting.earth_k_in(band), band)) * _W_CM2_PER_W_M2
        sunlight = lighting.sun_w_m2_in(band) * strength * _W_CM2_PER_W_M2
        noon = night + lighting.background_albedo_in(band) * sunlight / math.pi
        off = "" if wanted.zodiacal else " (left out)"
        earth = "" if wanted.earth else " (left out)"
        text = f"zodiacal light {low:.2g} to {high:.2g} NEI{off}, Earth {night / nei_sr:.2g} by night and "
        lines.append(f"  background {name}: {text}{noon / nei_sr:.2g} under the Sun{earth}")
        levels = {"zodiacal light": high * wanted.zodiacal, "the Earth": noon / nei_sr * wanted.earth}
        sei = instrument.sei_w_cm2(name) / instrument.nei_w_cm2(name)
        filled = [what for what, level in levels.items() if level >= sei]
        if filled:
            lines.append(f"  warning: {' and '.join(filled)} saturates pixels in {name}, whose SEI is {sei:.3g} NEI")
    return lines


def _zodiacal_warning(scenario: Scenario) -> list[str]:
    """A warning of zodiacal light that is far from the middle of a long scene, or no line."""
    days = scenario.scene.duration_s / 86400.0
    if not scenario.scene.background.zodiacal or days <= _MOST_ZODIACAL_DAYS:
        return []
    words = f"zodiacal light is that of the middle of {days:.3g} days, turned with the Sun: 2 % off 10 days from it"
    return [f"  warning    {words}, 7 % 30 days from it"]


def _own_lines(instrument: Instrument) -> list[str]:
    """Lines of the user's map and image, which are read or called: their sizes in each band [NEI]."""
    wanted, camera = instrument.background, instrument.sensor.camera
    bands = list(instrument.bands.values())
    lines = []
    if wanted.sky_map is not None:
        ends = sky_map_sizes(wanted.sky_map, bands) * _pixel_sr(instrument)
        lines.append(f"  background map {wanted.sky_map}, median to maximum: {_ranges(instrument, ends)}")
    if wanted.image is not None:
        planes = read_pixel_image(wanted.image, len(bands), camera.n_row, camera.n_col)
        ends = np.array([[plane.min(), plane.max()] for plane in planes], dtype=np.float64)
        lines.append(f"  background image {wanted.image}: {_ranges(instrument, ends)}")
    return lines


def _ranges(instrument: Instrument, ends_w_cm2: npt.NDArray[np.float64]) -> str:
    """Least and largest light in a pixel, (band, 2), in words."""
    of_band = zip(instrument.bands, ends_w_cm2, strict=True)
    nei = {name: (low / instrument.nei_w_cm2(name), high / instrument.nei_w_cm2(name)) for name, (low, high) in of_band}
    return f"{', '.join(f'{name} {low:.2g} to {high:.2g}' for name, (low, high) in nei.items())} NEI"


def _stray_lines(instrument: Instrument, scenario: Scenario, views: Sequence[View]) -> list[str]:
    """A line of stray light: its sizes in each band [NEI]; none where the scene has none."""
    if scenario.scene.background.stray_light is None:
        return []
    light = np.concatenate([stray_light_w_cm2_sr(scenario, instrument, name, time_s) for name, time_s in views])
    ends = np.stack([light.min(axis=0), light.max(axis=0)], axis=1).astype(np.float64) * _pixel_sr(instrument)
    return [f"  background stray light: {_ranges(instrument, ends)}"]


def earth_warning(scenario: Scenario, frames_of: Mapping[str, Sequence[int]]) -> str | None:
    """Return a warning of an Earth in fields of view that is not rendered; None where there is none."""
    if scenario.scene.background.earth:
        return None
    for instrument in scenario.instruments.values():
        found = field_contents(instrument, scenario.tracks, frames_of)
        if found.earth:
            views = f"{found.earth:,} of {counted(found.n_view, 'view')}"
            return f"the Earth is in the field of {views}, and is not rendered; background.earth = true does it"
    return None
