"""Report of what lies behind stars and targets: its size in NEI, band by band, and what is left out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

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


def background_lines(instrument: Instrument, scenario: Scenario, frames_of: Mapping[str, Sequence[int]]) -> list[str]:
    """Return a line for each band: the background in a pixel in the middle of the frame [NEI], on or left out.

    One more for a map, and for an image, of the user's.

    Raises:
        InputError: The map or the image cannot be read, or the function cannot be called.
    """
    views = _sampled_views(instrument, frames_of)
    boresights = _boresights(instrument, views)
    sky = _sky_lines(instrument, scenario, boresights) if len(boresights) else []
    own = [*_stray_lines(instrument, scenario, views), *_own_lines(instrument)]
    return [*sky, *own, *_zodiacal_warning(scenario)]


def _sky_lines(instrument: Instrument, scenario: Scenario, boresights: npt.NDArray[np.float64]) -> list[str]:
    wanted, camera = instrument.background, instrument.sensor.camera
    pixel_sr = 1 / (camera.focal_px * camera.focal_row_px)
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
    pixel_sr = 1 / (camera.focal_px * camera.focal_row_px)
    bands = list(instrument.bands.values())
    nei_w_cm2 = [instrument.nei_w_cm2(name) for name in instrument.bands]
    lines = []
    if wanted.sky_map is not None:
        ends = sky_map_sizes(wanted.sky_map, bands) * pixel_sr
        lines.append(
            f"  background map {wanted.sky_map}, median to maximum: {_ranges(instrument.bands, ends, nei_w_cm2)}"
        )
    if wanted.image is not None:
        planes = read_pixel_image(wanted.image, len(bands), camera.n_row, camera.n_col)
        ends = np.array([[plane.min(), plane.max()] for plane in planes], dtype=np.float64)
        lines.append(f"  background image {wanted.image}: {_ranges(instrument.bands, ends, nei_w_cm2)}")
    return lines


def _ranges(names: Iterable[str], ends_w_cm2: npt.NDArray[np.float64], nei_w_cm2: Sequence[float]) -> str:
    texts = [
        f"{name} {low / nei:.2g} to {high / nei:.2g}"
        for name, (low, high), nei in zip(names, ends_w_cm2, nei_w_cm2, strict=True)
    ]
    return f"{', '.join(texts)} NEI"


def _sampled_views(
    instrument: Instrument, frames_of: Mapping[str, Sequence[int]]
) -> list[tuple[str, npt.NDArray[np.float64]]]:
    """Sensors and times of some views: of those with access, or of any where there are none."""
    own = {name: frames for name, frames in frames_of.items() if len(frames)}
    own = own or dict.fromkeys(instrument.names, range(instrument.frames.count))
    each = max(1, _MOST_VIEWS // max(1, len(own)))
    return [
        (name, instrument.frame_time_s(frames[:: max(1, len(frames) // each)]))
        for name, frames in list(own.items())[:_MOST_VIEWS]
    ]


def _boresights(instrument: Instrument, views: Sequence[tuple[str, Any]]) -> npt.NDArray[np.float64]:
    """Boresights of views, (n, 3)."""
    found = [instrument.commanded_axes(instrument.index(name), time_s).axes[:, 2] for name, time_s in views]
    return np.concatenate(found) if found else np.zeros((0, 3))


def _stray_lines(instrument: Instrument, scenario: Scenario, views: Sequence[tuple[str, Any]]) -> list[str]:
    """A line of stray light: its sizes in each band [NEI]; none where the scene has none."""
    if scenario.scene.background.stray_light is None or not views:
        return []
    pixel_sr = 1 / (instrument.sensor.camera.focal_px * instrument.sensor.camera.focal_row_px)
    light = np.concatenate([stray_light_w_cm2_sr(scenario, instrument, name, time_s) for name, time_s in views])
    ends = np.stack([light.min(axis=0), light.max(axis=0)], axis=1).astype(np.float64) * pixel_sr
    nei_w_cm2 = [instrument.nei_w_cm2(name) for name in instrument.bands]
    return [f"  background stray light: {_ranges(instrument.bands, ends, nei_w_cm2)}"]


def earth_warning(scenario: Scenario, frames_of: Mapping[str, Sequence[int]]) -> str | None:
    """Return a warning of an Earth in fields of view that is not rendered; None where there is none."""
    if scenario.scene.background.earth:
        return None
    texts = []
    for instrument in scenario.instruments.values():
        own = {name: frames_of[name] for name in instrument.names if frames_of.get(name)}
        found = field_contents(instrument, scenario.tracks, own)
        if found.earth:
            views = f"{found.earth:,} of {counted(found.n_view, 'view')}"
            texts.append(f"the Earth is in the field of {views}, and is not rendered; background.earth = true does it")
    return texts[0] if texts else None
