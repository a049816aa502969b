"""Numbers of a scene that a page lets one change: field of view, point spread, noise, exposure, pointing, seed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene

PSF, SIGMA = "optics__psf", "optics__sigma_px"

MOST_NAMES = 1000
"""Targets that a page lets one choose of."""

_NUMBERS = (
    ("field of view [deg]", "camera__fov_deg"),
    ("focal length [m]", "camera__focal_length_m"),
    ("aperture [m]", "optics__aperture_m"),
    ("smear [urad]", "optics__smear_urad"),
    ("NEI{} [W/cm2]", "detector__nei_w_cm2"),
    ("read noise [e]", "detector__read_noise_e"),
    ("dark current [e/s]", "detector__dark_e_s"),
    ("exposure [s]", "detector__exposure_s"),
)


class Change(NamedTuple):
    """A field of the scene."""

    label: str
    path: str
    """As `Scene.replace` takes it."""
    value: Any
    """None where it is left out."""
    options: tuple[str, ...] = ()
    """Of a field that is a name."""


def changes(scenario: Scenario, kind: str) -> list[Change]:
    """Return what can be changed of a scene and of one of its kinds of sensors.

    A detector in electrons has its noise in the place of an NEI; a Gaussian's sigma has the value None where it follows
    from the aperture.
    """
    number = list(scenario.instruments).index(kind)
    start, data = f"sensors__{number}__", scenario.scene.to_dict()["sensors"][number]
    found = []
    for label, path in _NUMBERS:
        part, name = path.split("__")
        value = data[part].get(name)
        of_band = value if isinstance(value, dict) else {"": value}
        for band, one in of_band.items():
            if isinstance(one, int | float):
                own = f"{path}__{band}" if band else path
                found.append(Change(label.format(f" {band}" if band else ""), start + own, float(one)))
        if path == "optics__aperture_m" and data["optics"]["psf"] != "table":
            found.append(Change("PSF", start + PSF, data["optics"]["psf"], ("airy", "gaussian")))
            found.append(Change("sigma [px]", start + SIGMA, data["optics"].get("sigma_px")))
    found += _pointings(scenario, data.get("pointing", []), start)
    return [*found, Change("seed", "seed", scenario.scene.seed)]


def _pointings(scenario: Scenario, pointings: list[dict[str, Any]], start: str) -> Iterator[Change]:
    """What cameras track, for all satellites of a pointing, and from each step of a schedule on."""
    for number, pointing in enumerate(pointings):
        on = f" ({', '.join(pointing['on'])})" if len(pointings) > 1 else ""
        steps = [(pointing, "", "")]
        for k, step in enumerate(pointing.get("steps", [])):
            steps.append((step, f"steps__{k}__", f" from {step['start_s']:g} s"))
        for step, path, when in steps:
            if isinstance(step.get("track"), str):
                names = (step["track"], "main", "group", *scenario.group_names, *scenario.target_names[:MOST_NAMES])
                label = f"pointed at{when}{on}"
                yield Change(
                    label, f"{start}pointing__{number}__{path}track", step["track"], tuple(dict.fromkeys(names))
                )


def changed_scene(scenario: Scenario, changes: list[Change], values: Callable[[Change], Any]) -> Scene:
    """Return the scene with those values that differ from it; a Gaussian's sigma goes with the Gaussian.

    Raises:
        InputError: A value is out of its range.
    """
    different = {change.path: value for change in changes if (value := values(change)) != change.value}
    for path, value in list(different.items()):
        if path.endswith(PSF) and value != "gaussian":
            different[path.removesuffix(PSF) + SIGMA] = None
    return Scene.from_dict(scenario.scene.to_dict()).replace(**different)
