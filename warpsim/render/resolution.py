"""How well targets can be told apart in images: neighbours, clumps, blended light."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.records import BEHIND
from warpsim_kernels.resolution import TargetImages, find_clumps_kernel
from warpsim_kernels.streaks import Paths

from warpsim.detector.levels import ElectronLevels, noise_variance
from warpsim.launches import Launch, struct_of, to_numpy
from warpsim.optics.enclosed import box_half_width_px
from warpsim.optics.psf_bank import paths_struct
from warpsim.render.batch import HostColumns
from warpsim.render.device_scene import DeviceScene
from warpsim.render.device_upload import table_accuracy
from warpsim.scene.instrument import Instrument

BOX_FRACTION = 0.84
"""Part of a point's light that its box holds, pixels included; of an Airy pattern about that within the first dark
ring."""


WINDOW = 1.5
"""Pixels within so many merging distances of a target are fitted: what lies farther out makes bounds a few percent
smaller."""


MOST_VALUES = 2**22
"""Pixels about moving targets that are held at a time, of 32 bytes; those of one target at least."""


def blur_half_px(instrument: Instrument, band: str) -> tuple[float, float]:
    """Return half the box that holds BOX_FRACTION of a point's light in a band: along columns and rows [px]."""
    aspect = instrument.sensor.camera.pixel_aspect
    half_px = box_half_width_px(instrument.psf(band), BOX_FRACTION, aspect, table_accuracy(instrument))
    return half_px, half_px / aspect


def merge_px(instrument: Instrument, band: str) -> tuple[float, float]:
    """Return the distance within which two targets merge: along columns and rows [px].

    Half the box of a point's light, which for an Airy pattern is about Rayleigh's distance, and half a pixel: of
    narrower images those of neighbouring pixels merge.
    """
    half_x_px, half_y_px = blur_half_px(instrument, band)
    return half_x_px + 0.5, half_y_px + 0.5


def resolution_columns(scene: DeviceScene, seen: HostColumns) -> dict[str, npt.NDArray[Any]]:
    """Return how well targets can be told apart and measured, by column of truth.

    Args:
        scene: What was rendered.
        seen: Its columns.

    Returns:
        neighbour_px, clump_id, resolvable, blend_fraction, x_sigma_px, y_sigma_px and irradiance_sigma_w_cm2, each
        (view, band, target); NaN, -1 and false without light.
    """
    instrument, device, shape = scene.instrument, scene.device, seen.irradiance_w_cm2.shape
    behind = (seen.observations["flags"] & int(BEHIND)) != 0
    irradiance = np.where(behind[:, None], np.float32(0.0), seen.irradiance_w_cm2)
    targets = _target_images(scene, seen, irradiance)
    merging = wp.array([merge_px(instrument, band) for band in scene.bands], dtype=wp.vec2d, device=device)
    parent, n_member, clump = (wp.empty(shape, dtype=wp.int32, device=device) for _ in range(3))
    nearest, own, others = (wp.full(shape, np.nan, dtype=wp.float64, device=device) for _ in range(3))
    if parent.size:
        Launch(find_clumps_kernel, shape[:2], [targets, merging], [parent, n_member, clump], device).run()
        scene.psf.measure_blends(targets, scene.stamp_rule, [nearest, own, others], scene.streaks.enabled)
    near_px, own_w_cm2, others_w_cm2 = (to_numpy(array) for array in (nearest, own, others))
    half_px = WINDOW * np.array([merge_px(instrument, band) for band in scene.bands]).reshape(-1, 2)
    bound = cramer_rao_bounds(scene, targets, seen, half_px)
    whole = own_w_cm2 + others_w_cm2
    return {
        "neighbour_px": np.where(np.isinf(near_px), np.nan, near_px),
        "clump_id": to_numpy(clump),
        "resolvable": to_numpy(n_member) == 1,
        "blend_fraction": np.divide(others_w_cm2, whole, out=np.zeros(shape) * whole, where=whole > 0.0),
        "x_sigma_px": bound[..., 0],
        "y_sigma_px": bound[..., 1],
        "irradiance_sigma_w_cm2": bound[..., 2] * irradiance,
    }


def _target_images(scene: DeviceScene, seen: HostColumns, irradiance_w_cm2: npt.NDArray[np.float32]) -> Any:
    """The kernels' TargetImages."""
    device, here = scene.device, seen.columns.to(scene.device)
    xy_px = seen.observations["xy_px"]
    order = np.argsort(xy_px[..., 0], axis=1, kind="stable")
    targets = struct_of(
        TargetImages,
        device,
        xy_px=xy_px,
        irradiance_w_cm2=irradiance_w_cm2,
        order=order,
        rank=np.argsort(order, axis=1),
        paths=paths_struct(here.offset_px, here.brightness, scene.n_target) if scene.streaks.enabled else Paths(),
    )
    if here.background_w_cm2 is not None:
        targets.background_w_cm2 = here.background_w_cm2
    return targets


def full_w_cm2(instrument: Instrument, band: str) -> float:
    """Return the light in a pixel from which on it, or the converter, is full [W/cm2]."""
    levels = instrument.levels[band]
    if isinstance(levels, ElectronLevels):  # the converter's end is part of the SEI
        return levels.sei_w_cm2
    most_nei = (2.0**instrument.sensor.detector.bits - 1.0 - levels.blank_counts) / levels.counts_per_nei
    return min(levels.sei_w_cm2, most_nei * levels.nei_w_cm2)


def cramer_rao_bounds(
    scene: DeviceScene, targets: Any, seen: HostColumns, half_px: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the bounds of x and y [px] and of the light over itself, (view, band, target, 3); NaN without light.

    Args:
        scene: What was rendered.
        targets: The kernels' TargetImages, of the same views.
        seen: Columns of the views.
        half_px: Columns and rows to each side of a target, or of its path, that are fitted, (n_band, 2).
    """
    instrument, moving = scene.instrument, scene.streaks.enabled
    shape = tuple(targets.irradiance_w_cm2.shape)
    found = np.full((*shape, 3), np.nan)
    if found.size == 0:
        return found
    noise = _pixel_noise(instrument, scene.bands, scene.device)
    item = np.argwhere(to_numpy(targets.irradiance_w_cm2) > 0.0)
    window = _windows(instrument, seen, half_px)[tuple(item.T)]
    n_value = (window[:, 1] - window[:, 0]) * (window[:, 3] - window[:, 2]) * int(moving)
    for first, end in _parts(n_value):
        own = n_value[first:end]
        kinds = ((item[first:end], wp.vec3i), (window[first:end], wp.vec4i), (np.cumsum(own) - own, wp.int32))
        given = [wp.array(array.astype(np.int32), dtype=dtype, device=scene.device) for array, dtype in kinds]
        sigma = wp.empty(end - first, dtype=wp.vec3d, device=scene.device)
        values = wp.empty(int(own.sum()), dtype=wp.vec4d, device=scene.device)
        scene.psf.measure_bounds(targets, scene.stamp_rule, noise, given, [sigma, values], moving)
        found[tuple(item[first:end].T)] = to_numpy(sigma).reshape(-1, 3)
    return found


def _windows(instrument: Instrument, seen: HostColumns, half_px: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """First and end of columns, then of rows, that are fitted, cut to the image, (view, band, target, 4)."""
    camera = instrument.sensor.camera
    middle = np.floor(np.nan_to_num(seen.observations["xy_px"], nan=-1e9) + 0.5)[:, None]
    way_px = np.abs(seen.offset_px).sum(axis=2, dtype=np.float64)[:, None]  # Legendre polynomials are at most 1
    half = np.ceil(half_px[:, None] + way_px)
    size = np.array([camera.n_col, camera.n_row])
    low = np.clip(middle - half, 0, size).astype(np.int64)
    high = np.clip(middle + half + 1, low, size).astype(np.int64)
    return np.stack([low[..., 0], high[..., 0], low[..., 1], high[..., 1]], axis=-1)


def _parts(n_value: npt.NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """First and end of targets whose values are held together."""
    first, held = 0, 0
    for number, n in enumerate(n_value.tolist()):
        if held + n > MOST_VALUES and number > first:
            yield first, number
            first, held = number, 0
        held += n
    if first < len(n_value):
        yield first, len(n_value)


def _pixel_noise(instrument: Instrument, bands: Sequence[str], device: wp.Device) -> Any:
    """The kernels' PixelNoise; rounding to counts included."""
    from warpsim_kernels.bounds import PixelNoise  # with the kernels of gradients, which take time to import

    noise = [noise_variance(instrument.sensor.detector, instrument.levels[band]) for band in bands]
    variance, shot = zip(*noise, strict=True)
    sei = [full_w_cm2(instrument, band) for band in bands]
    return struct_of(PixelNoise, device, variance_w2_cm4=variance, shot_w_cm2=shot, sei_w_cm2=sei)
