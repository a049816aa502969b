"""Fisher information of images: how well an unbiased fit can know what they show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.arguments import chosen_names
from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.render.frameset import FrameSet
from warpsim.render.gradients import camera_slopes, checked_parameters
from warpsim.render.likelihood import irradiance_of, read_light
from warpsim.render.point_images import JacobianStamps
from warpsim.render.resolution import full_w_cm2

if TYPE_CHECKING:
    from astropy.table import Table


FITTED = ("x_px", "y_px", "irradiance_w_cm2", "boresight_rad", "roll_rad")
"""Parameters whose information is known."""

SINGULAR = 1e-10
"""Least eigenvalue of information scaled to a diagonal of 1: a fit loses five digits there."""


@dataclass(frozen=True)
class Fisher:
    """Fisher information of parameters, all unknown together, by one image of a sensor in one or more bands."""

    parameter: list[str]
    """Name of each parameter, (n,)."""
    target: list[str]
    """Its target; empty for the camera's."""
    band: list[str]
    """Its band; empty where all have it."""
    information: F64
    """Fisher information, (n, n), in the inverse units of the parameters."""

    @cached_property
    def covariance(self) -> F64:
        """Least covariance of an unbiased fit: the inverse of the information."""
        size = np.sqrt(np.diag(self.information))
        return np.asarray(np.linalg.inv(self.information / np.outer(size, size)) / np.outer(size, size))

    @property
    def sigma(self) -> F64:
        """Cramer-Rao bounds: least standard deviations, (n,)."""
        return np.sqrt(np.diag(self.covariance))

    def table(self) -> Table:
        """Return one row per parameter: parameter, target, band, sigma, and alone, the bound if all else were known."""
        from astropy.table import Table

        alone = 1.0 / np.sqrt(np.diag(self.information))
        columns = {"parameter": self.parameter, "target": self.target, "band": self.band}
        return Table(columns | {"sigma": self.sigma, "alone": alone})


def fisher(
    frames: FrameSet,
    frame: int | None = None,
    sensor: str | None = None,
    wrt: str | Sequence[str] = ("x_px", "y_px", "irradiance_w_cm2"),
    targets: str | Sequence[str] | None = None,
) -> Fisher:
    """Return the information of an image about sources and camera, all unknown at once, in all rendered bands.

    With the slopes J of pixels by parameters, and the variance V of each, it is the sum over pixels of J J / V: so
    neighbours that blend, and a camera that moves all sources, raise each other's bounds. Pixels that are full, and
    the change of the variance with light, tell nothing. Stars are known: where they are in the sky, and how bright.

    Args:
        frames: Rendered with keep_signal=True, and with keep_stars=True for the camera's parameters.
        frame: One of `frames.frames`; the only one when left out.
        sensor: One of `frames.sensors`; likewise.
        wrt: Parameters, of "x_px", "y_px" (the same in all bands), "irradiance_w_cm2" (in each), "boresight_rad" (two:
            towards larger x, larger y) and "roll_rad".
        targets: Whose positions and light are unknown; those in the frame with light when left out.

    Raises:
        InputError: The image was not rendered, an unknown name, or parameters that it does not tell apart: the text
            names those of the direction.
    """
    names = checked_parameters(wrt, FITTED)
    frame, sensor = _only("frame", frame, frames.frames), _only("sensor", sensor, frames.sensors)
    view, _ = frames.image_numbers("fisher", frame, sensor, frames.bands[0])
    signal = frames.signal_w_cm2
    if signal is None:
        raise InputError("render with keep_signal=True", "fisher")
    light = signal[frames.frames.index(frame)][frames.sensors.index(sensor)].astype(np.float64)
    turns = any(name in ("boresight_rad", "roll_rad") for name in names)
    images = frames.point_images("fisher", turns).of_view(view)
    chosen = _chosen(frames, view, targets)
    stamps = images.jacobian()
    xy_px = images.xy_px[0]
    labels, information = _labels(names, [frames.scenario.target_names[i] for i in chosen], frames.bands), None
    for number, band in enumerate(frames.bands):
        columns = _columns(names, stamps, number, chosen, xy_px, frames)
        found = irradiance_of(frames.instrument, band, np.zeros(0))
        used = light[number].ravel() < full_w_cm2(frames.instrument, band)
        slope = read_light(frames.instrument, band, light[number].ravel())[1]
        weight = np.where(used, slope**2 / found.variance(light[number].ravel()), 0.0)
        part = (columns.T @ columns.multiply(weight[:, None])).toarray()
        information = part if information is None else information + part
    assert information is not None
    _check_regular(information, labels)
    parameter, target, in_band = (list(column) for column in zip(*labels, strict=True))
    return Fisher(parameter, target, in_band, information)


def _only(what: str, value: Any, known: Sequence[Any]) -> Any:
    """A value, or the only one there is."""
    if value is None and len(known) != 1:
        raise InputError(f"must be one of {', '.join(map(str, known))}", what)
    return known[0] if value is None else value


def _chosen(frames: FrameSet, view: int, targets: str | Sequence[str] | None) -> list[int]:
    """Numbers of the targets whose parameters are unknown."""
    names = list(frames.scenario.target_names)
    if targets is not None:
        return [names.index(name) for name in chosen_names("targets", targets, names)]
    light, camera = frames.target_light, frames.instrument.sensor.camera
    lit = (light.irradiance_w_cm2[view] > 0.0).any(axis=0) & ~light.is_behind[view]
    size = np.array([camera.n_col, camera.n_row])
    return np.flatnonzero(lit & ((light.xy_px[view] >= -0.5) & (light.xy_px[view] < size - 0.5)).all(axis=1)).tolist()


def _labels(names: Sequence[str], targets: Sequence[str], bands: Sequence[str]) -> list[tuple[str, str, str]]:
    """Parameter, target and band of each column."""
    labels = []
    for name in names:
        if name == "irradiance_w_cm2":
            labels += [(name, target, band) for band in bands for target in targets]
        elif name == "boresight_rad":
            labels += [("boresight_x_rad", "", ""), ("boresight_y_rad", "", "")]
        else:
            labels += [(name, target, "") for target in (targets if name != "roll_rad" else [""])]
    return labels


def _columns(
    names: Sequence[str], stamps: JacobianStamps, band: int, chosen: list[int], xy_px: F64, frames: FrameSet
) -> Any:
    """Derivatives of an image by all parameters, sparse, n_pixel rows."""
    from scipy.sparse import csc_array, hstack

    by_x, by_y, by_light = (stamps.matrix(0, band, [name]) for name in ("x", "y", "light"))
    n_source, n_band = by_x.shape[1], len(frames.bands)
    xy_px = xy_px[:n_source]  # slots behind are those of other views, which have more stars
    empty = csc_array((by_x.shape[0], len(chosen)))
    parts = []
    for name in names:
        if name in ("x_px", "y_px"):
            parts.append((by_x if name == "x_px" else by_y)[:, chosen])
        elif name == "irradiance_w_cm2":
            parts += [by_light[:, chosen] if number == band else empty for number in range(n_band)]
        else:
            slopes = np.zeros((n_source, 2, 3))
            there = (np.abs(xy_px) < 1e6).all(axis=1)
            slopes[there] = camera_slopes(frames.instrument.sensor.camera, xy_px[there])
            which = [0, 1] if name == "boresight_rad" else [2]
            parts.append(csc_array(by_x @ slopes[:, 0, which] + by_y @ slopes[:, 1, which]))
    return hstack(parts, format="csc")


def _check_regular(information: F64, labels: Sequence[tuple[str, str, str]]) -> None:
    """See that information can be inverted; the error names the direction in which it is 0."""
    size = np.sqrt(np.diag(information))
    words = [" ".join(part for part in label if part) for label in labels]
    if not (size > 0.0).all():
        raise InputError("tells nothing of " + ", ".join(words[i] for i in np.flatnonzero(size == 0.0)[:4]), "fisher")
    value, vector = np.linalg.eigh(information / np.outer(size, size))
    if value[0] < SINGULAR:
        direction = vector[:, 0]
        order = np.argsort(-np.abs(direction))
        strong = [i for i in order[:4] if abs(direction[i]) > 0.05 * abs(direction[order[0]])]
        named = ", ".join(f"{direction[i] / direction[order[0]]:+.2f} {words[i]}" for i in strong)
        raise InputError(f"the image does not tell these apart (in units of their bounds): {named}", "fisher")
