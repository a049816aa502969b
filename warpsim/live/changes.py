"""Numbers of a scene that a page lets one change: field of view, point spread, noise, exposure, pointing, seed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene


class Change(NamedTuple):
    """A field of the scene."""

    label: str
    path: str
    """As `Scene.replace` takes it."""
    value: Any
    options: tuple[str, ...] = ()
    """Of a field that is a name."""


def changes(scenario: Scenario, sensor: str) -> list[Change]:
    """Return what can be changed of a scene and of the kind of one of its sensors."""
    scene = scenario.scene
    number = list(scenario.instruments).index(scenario.instrument_of(sensor).sensor.name)
    kind, data = f"sensors__{number}__", scene.to_dict()["sensors"][number]
    known = [
        ("field of view [deg]", "camera__fov_deg"),
        ("aperture [m]", "optics__aperture_m"),
        ("PSF sigma [px]", "optics__sigma_px"),
        ("NEI [W/cm2]", "detector__nei_w_cm2"),
        ("exposure [s]", "detector__exposure_s"),
    ]
    found = []
    for label, path in known:
        part, name = path.split("__")
        value = data.get(part, {}).get(name)
        if isinstance(value, int | float):
            found.append(Change(label, kind + path, value))
    steps = data.get("pointing", [])
    if len(steps) == 1 and isinstance(steps[0].get("track"), str):
        names = (*scenario.group_names, *scenario.target_names)
        found.append(Change("pointed at", f"{kind}pointing__0__track", steps[0]["track"], names))
    return [*found, Change("seed", "seed", scene.seed)]


def changed_scene(scenario: Scenario, changes: list[Change], values: Callable[[Change], Any]) -> Scene:
    """Return the scene with those values that differ from it.

    Raises:
        InputError: A value is out of its range.
    """
    different = {change.path: value for change in changes if (value := values(change)) != change.value}
    return Scene.from_dict(scenario.scene.to_dict()).replace(**different)
