"""The background on a device: what its stage reads, and the stage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.background import Background as BackgroundStruct
from warpsim_kernels.background import (
    SkyPlates,
    make_add_background_kernel,
    make_background_nodes_kernel,
    make_background_of_targets_kernel,
    stray_light_kernel,
)
from warpsim_kernels.canvas import N_PAIR
from warpsim_kernels.earth_shine import EarthShine, SunPath
from warpsim_kernels.records import View
from warpsim_kernels.stray_light import StrayLight

from warpsim.background.earth_limb import limb_profile
from warpsim.background.moon import MOON_RADIUS_M, moon_brightness_w_cm2, moon_position_m
from warpsim.background.sky_plates import SkyPlate, sky_cube
from warpsim.background.user_maps import read_pixel_image, sky_map_plates
from warpsim.background.zodiacal import ECLIPTIC_AXES, zodiacal_map
from warpsim.constants import ASTRONOMICAL_UNIT_M, EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING
from warpsim.directions import normalised
from warpsim.launches import struct_of, to_numpy
from warpsim.optics.camera import Camera
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import band_radiance_w_m2_sr
from warpsim.scene.background_terms import StrayLight as StrayLightModel
from warpsim.scene.environment import Lighting
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.scene.tracks import Tracks

ZODIACAL_NODES = 91
"""Nodes along an edge of the cube of zodiacal light: 1.3 degrees apart, within 1.3 % beyond 20 degrees of the Sun."""

HEIGHT_ERROR_KM = 0.1
"""Largest error of the height of a line of sight by lines between nodes."""

_NODES_PER_CELL = 2
_W_CM2_PER_W_M2 = 1e-4


@dataclass(frozen=True)
class DeviceBackground:
    """Kernels and arguments of the stage `background`."""

    struct: Any
    n_node: int
    earth: bool
    stray: bool
    nodes_kernel: wp.Kernel
    add_kernel: wp.Kernel
    n_thread: int
    """Threads of its blocks, each of which is a row of an image."""
    targets_kernel: wp.Kernel
    image_w_cm2: wp.array | None
    """The user's light of every pixel, (n_band, n_row, n_col)."""


def make_background(
    scenario: Scenario, instrument: Instrument, bands: Sequence[str], device: wp.Device
) -> DeviceBackground | None:
    """Make what the stage `background` reads; None where a scene has none.

    Raises:
        InputError: A map of the sky cannot be read.
    """
    wanted = instrument.background
    if not wanted.is_on:
        return None
    some = [instrument.bands[name] for name in bands]
    plates = sky_plates(scenario, some)
    camera, tracks, stray = instrument.sensor.camera, scenario.tracks, wanted.stray_light
    step_px = node_step_px(camera, [plate for _, plate in plates], tracks if wanted.earth else None)
    n_across, n_down = (-(-n // step_px) + 1 for n in (camera.n_col, camera.n_row))
    direction, pixel_sr = _node_geometry(camera, step_px, n_across, n_down)
    struct = struct_of(
        BackgroundStruct,
        device,
        step_px=step_px,
        n_across=n_across,
        n_down=n_down,
        direction=direction,
        pixel_sr=pixel_sr,
        plates=_plates_struct(plates, len(some), device),
        sun=_sun_struct(tracks, scenario.scene.duration_s, device),
    )
    if wanted.earth or stray is not None:
        struct.earth = _earth_struct(tracks, some, scenario.scene.lighting, device)
    if stray is not None:
        struct.stray = _stray_struct(stray, scenario, some, device)
    n_thread = N_PAIR if device.is_cuda else 1
    return DeviceBackground(
        struct,
        len(direction),
        wanted.earth,
        stray is not None,
        make_background_nodes_kernel(wanted.earth, stray is not None),
        make_add_background_kernel(wanted.earth, n_thread),
        n_thread,
        make_background_of_targets_kernel(wanted.earth),
        None if wanted.image is None else _image(wanted.image, instrument, bands, device),
    )


def stray_light_w_cm2_sr(
    scenario: Scenario, instrument: Instrument, sensor: str, time_s: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Return the stray light in the images of a sensor at times, in its bands [W/cm2/sr], (n_time, n_band)."""
    device, tracks = wp.get_device("cpu"), scenario.tracks
    bands, stray = list(instrument.bands.values()), scenario.scene.background.stray_light
    light = wp.zeros((len(time_s), len(bands)), dtype=wp.float32, device=device)
    if stray is None:
        return to_numpy(light)
    struct = struct_of(
        BackgroundStruct,
        sun=_sun_struct(tracks, scenario.scene.duration_s, device),
        earth=_earth_struct(tracks, bands, scenario.scene.lighting, device),
        stray=_stray_struct(stray, scenario, bands, device),
    )
    views = np.zeros(len(time_s), dtype=View.numpy_dtype())
    views["axes"] = instrument.commanded_axes(instrument.index(sensor), time_s).axes
    views["position_m"] = instrument.state(sensor, time_s)[0]
    inputs = [wp.array(time_s, dtype=wp.float64, device=device), wp.array(views, dtype=View, device=device), struct]
    wp.launch(stray_light_kernel, dim=len(time_s), inputs=inputs, outputs=[light], device=device)
    return to_numpy(light)


def _image(path: str, instrument: Instrument, bands: Sequence[str], device: wp.Device) -> wp.array:
    camera, names = instrument.sensor.camera, list(instrument.sensor.bands)
    planes = read_pixel_image(path, len(names), camera.n_row, camera.n_col)
    return wp.array(planes[[names.index(name) for name in bands]], dtype=wp.float32, device=device)


def sky_plates(scenario: Scenario, bands: list[Band]) -> list[tuple[int, SkyPlate]]:
    """Plates of the sky with the number of their layer: 0 is the zodiacal light, which goes with the Sun."""
    plates: list[tuple[int, SkyPlate]] = []
    background = scenario.scene.background
    if background.zodiacal:
        sun_m = scenario.tracks.sun.state(scenario.scene.duration_s / 2)[0]
        light = zodiacal_map(bands, -sun_m / ASTRONOMICAL_UNIT_M)
        plates += [(0, plate) for plate in sky_cube(light, ZODIACAL_NODES)]
    if background.sky_map is not None:
        plates += [(1, plate) for plate in sky_map_plates(background.sky_map, bands)]
    return plates


def node_step_px(camera: Camera, plates: list[SkyPlate], tracks: Tracks | None) -> int:
    """Return the pixels between nodes: as many as plates of the sky, and the curvature of the limb, allow."""
    step_rad = min((plate.step_rad for plate in plates), default=math.radians(2)) / _NODES_PER_CELL
    if tracks is not None:
        farthest_m = max(float(np.linalg.norm(track.position_m, axis=1).max()) for track in tracks.satellites)
        sine = min(EARTH_EQUATORIAL_RADIUS_M / farthest_m, 0.999)
        distance_m, cotangent = farthest_m * math.sqrt(1 - sine**2), math.sqrt(1 - sine**2) / sine
        step_rad = min(step_rad, math.sqrt(8e3 * HEIGHT_ERROR_KM / (distance_m * cotangent)))
    pixels = step_rad * min(camera.focal_px, camera.focal_row_px)
    most = 1 << (max(camera.n_row, camera.n_col) - 1).bit_length()
    return int(min(most, 1 << max(0, int(math.log2(max(pixels, 1.0))))))


def _node_geometry(camera: Camera, step_px: int, n_across: int, n_down: int) -> tuple[npt.NDArray[np.float64], ...]:
    """Directions of nodes in camera axes, (n_node, 3), and solid angles of pixels there [sr], (n_node,)."""
    x, y = np.meshgrid(np.arange(n_across) * step_px, np.arange(n_down) * step_px)
    xy = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)
    width, height = (camera.direction(xy + half) - camera.direction(xy - half) for half in 0.5 * np.eye(2))
    return camera.direction(xy), np.linalg.norm(np.cross(width, height), axis=1)


def _plates_struct(plates: list[tuple[int, SkyPlate]], n_band: int, device: wp.Device) -> Any:
    sizes = [plate.radiance_w_cm2_sr.shape[-1] for _, plate in plates]
    flat = [plate.radiance_w_cm2_sr.reshape(n_band, -1) for _, plate in plates]
    return struct_of(
        SkyPlates,
        device,
        axes=np.array([plate.axes for _, plate in plates]).reshape(-1, 3, 3),
        half_width=[plate.half_width for _, plate in plates],
        n_side=sizes,
        first=np.cumsum([0, *np.square(sizes)])[:-1],
        layer=[layer for layer, _ in plates],
        radiance_w_cm2_sr=np.concatenate(flat, axis=1) if flat else np.zeros((n_band, 1)),
    )


def _sun_struct(tracks: Tracks, duration_s: float, device: wp.Device) -> Any:
    path = tracks.sun
    strength = (ASTRONOMICAL_UNIT_M / np.linalg.norm(path.position_m, axis=1)) ** 2
    return struct_of(
        SunPath,
        device,
        start_s=path.start_s,
        step_s=path.step_s,
        direction=normalised(path.position_m),
        strength=strength,
        middle=normalised(path.state(duration_s / 2)[0]),
        ecliptic_pole=ECLIPTIC_AXES[2],
    )


def _earth_struct(tracks: Tracks, bands: list[Band], lighting: Lighting, device: wp.Device) -> Any:
    profiles = [limb_profile(band) for band in bands]
    height_km = profiles[0].height_km
    step_km = float(height_km[1] - height_km[0])
    limb = np.stack([[profile.emission_w_cm2_sr, profile.reflected_w_cm2_sr] for profile in profiles])
    between = step_km * 0.5 * (limb[..., 1:] + limb[..., :-1])
    above = np.concatenate([np.cumsum(between[..., ::-1], axis=-1)[..., ::-1], np.zeros((*limb.shape[:2], 1))], axis=-1)
    disc = [
        (
            float(band_radiance_w_m2_sr(lighting.earth_k_in(band), band)) * _W_CM2_PER_W_M2,
            lighting.background_albedo_in(band) * lighting.sun_w_m2_in(band) * _W_CM2_PER_W_M2 / math.pi,
        )
        for band in bands
    ]
    return struct_of(
        EarthShine,
        device,
        pole=tracks.pole_icrs,
        stretch=1 / (1 - EARTH_FLATTENING),
        radius_km=EARTH_EQUATORIAL_RADIUS_M / 1e3,
        step_km=step_km,
        n_height=len(height_km),
        disc_w_cm2_sr=disc,
        limb_w_cm2_sr=limb,
        above_km_w_cm2_sr=above,
    )


_MOST_ANGLE_DEG, _MOST_LOG = 20.0, 3.0
"""Largest extent of a piece of the table of stray light, and change of the ratio's logarithm along it."""

N_ACROSS, N_ALONG = 4, 8
"""Gauss nodes across a piece of the table, and along an arc about the boresight, of the Earth's stray light."""


_N_PHASE = 181
"""Angles at the Moon, from full to new, by which its light is looked up."""


def stray_pieces(stray: StrayLightModel) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Angles from 0 to pi [rad] between which the logarithm of the ratio is a line, and the logarithms."""
    ends = np.unique([0.0, *stray.angle_deg, 180.0])
    logs = np.interp(ends, stray.angle_deg, np.log(stray.ratio_sr))
    n_part = np.maximum(np.ceil(np.diff(ends) / _MOST_ANGLE_DEG), np.ceil(np.abs(np.diff(logs)) / _MOST_LOG))
    parts = [np.linspace(a, b, int(n) + 1)[:-1] for a, b, n in zip(ends, ends[1:], n_part, strict=False)]
    angles = np.append(np.concatenate(parts), 180.0)
    return np.radians(angles), np.interp(angles, ends, logs)


def _stray_struct(stray: StrayLightModel, scenario: Scenario, bands: list[Band], device: wp.Device) -> Any:
    tracks, lighting = scenario.tracks, scenario.scene.lighting
    angle_rad, log_ratio = stray_pieces(stray)
    moon_m = moon_position_m(scenario.epoch, tracks.sun.node_s)
    sun_w_cm2 = np.array([lighting.sun_w_m2_in(band) * _W_CM2_PER_W_M2 for band in bands])
    sun_au = float(np.linalg.norm(tracks.sun.position_m - moon_m, axis=1).mean()) / ASTRONOMICAL_UNIT_M
    phase_rad = np.linspace(0.0, math.pi, _N_PHASE)
    of_moon = stray.moon * moon_brightness_w_cm2(bands, sun_w_cm2, sun_au, phase_rad)
    across, along = (np.stack(np.polynomial.legendre.leggauss(n), axis=1) for n in (N_ACROSS, N_ALONG))
    return struct_of(
        StrayLight,
        device,
        earth=stray.earth,
        moon_radius_m=MOON_RADIUS_M,
        angle_rad=angle_rad,
        log_ratio=log_ratio,
        moon_m=moon_m,
        sun_w_cm2=stray.sun * sun_w_cm2,
        moon_w_cm2=of_moon,
        across=0.5 * across + [0.5, 0.0],
        along=along * [1.0, 0.5],
    )
