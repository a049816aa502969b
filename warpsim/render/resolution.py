"""How well targets can be told apart in images: neighbours, clumps, blended light."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.records import BEHIND
from warpsim_kernels.resolution import TargetImages, find_clumps_kernel
from warpsim_kernels.streaks import Paths

from warpsim.launches import Launch, struct_of, to_numpy
from warpsim.optics.enclosed import box_half_width_px
from warpsim.optics.psf_bank import paths_struct
from warpsim.render.batch import HostColumns
from warpsim.render.bounds import cramer_rao_bounds
from warpsim.render.device_scene import DeviceScene
from warpsim.render.device_upload import table_accuracy
from warpsim.scene.instrument import Instrument

BOX_FRACTION = 0.84
"""Part of a point's light that its box holds, pixels included; of an Airy pattern about that within the first dark
ring."""


WINDOW = 1.5
"""Pixels within so many merging distances of a target are fitted: what lies farther out makes bounds a few percent
smaller."""


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


def resolution_columns(scene: DeviceScene, bands: Sequence[str], seen: HostColumns) -> dict[str, npt.NDArray[Any]]:
    """Return how well targets can be told apart and measured, by column of truth.

    Args:
        scene: What was rendered.
        bands: Names of the bands.
        seen: Its columns.

    Returns:
        neighbour_px, clump_id, resolvable, blend_fraction, x_sigma_px, y_sigma_px and irradiance_sigma_w_cm2, each
        (view, band, target); NaN, -1 and false without light.
    """
    instrument, device, shape = scene.instrument, scene.device, seen.irradiance_w_cm2.shape
    behind = (seen.observations["flags"] & int(BEHIND)) != 0
    irradiance = np.where(behind[:, None], np.float32(0.0), seen.irradiance_w_cm2)
    targets = _target_images(scene, seen, irradiance)
    merging = wp.array([merge_px(instrument, band) for band in bands], dtype=wp.vec2d, device=device)
    parent, n_member, clump = (wp.empty(shape, dtype=wp.int32, device=device) for _ in range(3))
    nearest, own, others = (wp.full(shape, np.nan, dtype=wp.float64, device=device) for _ in range(3))
    if parent.size:
        Launch(find_clumps_kernel, shape[:2], [targets, merging], [parent, n_member, clump], device).run()
        scene.psf.measure_blends(targets, scene.stamp_rule, [nearest, own, others], scene.streaks.enabled)
    near_px, own_w_cm2, others_w_cm2 = (to_numpy(array) for array in (nearest, own, others))
    half_px = WINDOW * np.array([merge_px(instrument, band) for band in bands]).reshape(-1, 2)
    bound = cramer_rao_bounds(scene, bands, targets, seen, half_px)
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
