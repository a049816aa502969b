"""The scene: an immutable, validated description of sensors, targets and sky."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt
from pydantic import ValidationError

from warpsim.config.model import adapter, config_model, input_error
from warpsim.errors import InputError, errors_at
from warpsim.instant import utc_time
from warpsim.scene.band_descriptions import without_superseded
from warpsim.scene.description import SceneDescription
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene_files import (
    check_depth,
    read_scene_data,
    with_absolute_paths,
    with_relative_paths,
    write_scene_data,
)
from warpsim.scene.short_form import SHORT_FORMS, changed, list_of, shortened, with_lists

if TYPE_CHECKING:
    import numpy as np
    from astropy.table import Table
    from astropy.time import Time


@config_model
class Scene(SceneDescription):
    """Description of the simulated scene.

    A scene with one kind of sensor may give `camera`, `optics`, `detector`, `bands` and `pointing` instead of
    `sensors`; one with one group `trajectory`, `targets` and `release` instead of `groups`. It has them as attributes.

    Args:
        epoch_utc: UTC instant that all times count from.
        duration_s: Length of the scene [s].
        frames: When frames are taken.
        constellation: The satellites.
        sensors: The kinds of sensors, and which satellites carry one.
        groups: Groups of targets.
        access_rules: When a sensor can observe a target; a kind of sensor may have its own.
        access_target: What a sensor's access counts by: "tracked", the target that it tracks, of a group its main
            target, and where it tracks none the main targets of all groups; "any" target; or the name of a target or of
            a group, any of which makes access.
        band: Spectral bands that the scene describes itself, by name: BandDescription or Band.
        sky: The star background.
        lighting: Which light the targets reflect.
        background: What lies behind stars and targets; nothing when left out.
        seed: Seed of the world: releases, attitudes, what is spread over members, errors of pointing; 0 to 2**63 - 1
            (the largest integer of TOML).
        noise_seed: Seed of the detectors' noise; `seed` when left out. Noise also depends on the scene's name.
        name: Short name.
        description: One line about the scene.

    Raises:
        InputError: One line: field, rule, value.
    """

    @classmethod
    def load(cls, source: str | os.PathLike[str]) -> Scene:
        """Load a preset by name, or a scene file (.toml or .json).

        Raises:
            InputError: No such preset or file, or one of its values is not valid; the text begins with the source.
        """
        data = with_absolute_paths(read_scene_data(source), Path(source).parent)
        return cls.from_dict(data, os.fspath(source))

    @classmethod
    def from_dict(cls, data: dict[str, Any], where: str = "Scene") -> Scene:
        """Return the scene of nested dicts and lists (the structure of a scene file); `where` begins error texts."""
        check_depth(data, where)
        try:
            return adapter(cls).validate_python(data)  # type: ignore[no-any-return]
        except ValidationError as error:
            try:
                listed = with_lists(data)
            except InputError:
                listed = data
            raise input_error(error, shorten=shortened(listed)).of(where) from None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a scene file (.toml or .json) that loads back equal.

        Paths of files beside it or below are written relative to its folder, which can travel with them.

        Raises:
            InputError: The path cannot be written, or ends in something else.
        """
        write_scene_data(with_relative_paths(self.to_dict(), Path(path).parent), path)

    def replace(self, **changes: Any) -> Scene:
        """Return a new scene with some fields changed.

        Fields of parts are reached by double underscores, items of lists by their number, which may be left out for an
        only one: `scene.replace(sensors__0__camera__n_row=256, groups__1__targets__0__count=5)`. The short form serves
        where there is one kind of sensor, or one group: `scene.replace(camera__n_row=256, targets__1__count=5)`. None
        takes an optional value away. Band objects in `bands` replace the scene's bands of their names, if no other
        sensor has those.

        Raises:
            InputError: A field is unknown or the new scene is not valid.
        """
        data, named = {"background": {}} | self.to_dict(), {}
        for name, value in changes.items():
            part = list_of(name.partition("__")[0])
            if part is not None and len(data[part]) != 1:
                field = name.replace("__", ".")
                raise InputError(f"names no one of {len(data[part])} {part}; begin with {part}__0__", field).of("Scene")
            named[name if part is None else f"{part}__0__{name}"] = value
        with errors_at("", "Scene"):
            data = changed(data, named)
        if not any(name.partition("__")[0] == "band" for name in changes):
            data = without_superseded(data)
        return Scene.from_dict(data)

    @property
    def epoch(self) -> Time:
        """The instant that all times count from (astropy Time, UTC)."""
        return utc_time(self.epoch_utc)

    @cached_property
    def scenario(self) -> Scenario:
        """Scenario of the scene, made on first use.

        Raises:
            InputError: A file cannot be read or does not fit, or a path cannot be propagated.
        """
        return Scenario(self)

    @property
    def sensor_names(self) -> list[str]:
        """Names of the sensors, kind by kind and plane by plane."""
        return list(self.scenario.sensor_names)

    @property
    def target_names(self) -> list[str]:
        """Names of the single targets, group by group, the main target of each first."""
        return list(self.scenario.target_names)

    def position_m(self, name: str, time_s: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return geocentric positions of a sensor, a target or "sun" [m], GCRS axes, (n, 3); Scenario.position_m."""
        return self.scenario.position_m(name, time_s)

    def access(self, target: str | None = None, sensors: str | Sequence[str] | None = None, **options: Any) -> Table:
        """Return the intervals of access of each sensor as an astropy Table; Scenario.access."""
        return self.scenario.access(target, sensors, **options)

    def access_margins(self, time_s: npt.ArrayLike, **options: Any) -> dict[str, npt.NDArray[np.float64]]:
        """Return the signed margin of every access constraint, each (n_sensor, n_time); Scenario.access_margins."""
        return self.scenario.access_margins(time_s, **options)

    def __getattr__(self, name: str) -> Any:
        """Fields of the only kind of sensor, or of the only group.

        Raises:
            InputError: There are several; an AttributeError too, as for `hasattr`.
        """
        part = next((part for part, fields in SHORT_FORMS.items() if name in fields), None)
        if part is None:
            hint = f"; scene.scenario.{name} is it" if not name.startswith("_") and hasattr(Scenario, name) else ""
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}{hint}")
        items = getattr(self, part)
        if len(items) != 1:
            names = ", ".join(item.name for item in items) or "none"
            raise _NoOnlyPartError(f"the scene has {len(items)} {part} ({names}); take scene.{part}[0].{name}", name)
        return getattr(items[0], name)


class _NoOnlyPartError(InputError, AttributeError):
    """A field of the only sensor or group, where there are several."""


def scenario_of(scene: Scene | Scenario) -> Scenario:
    """Return the scenario of a scene, or the scenario itself.

    Raises:
        InputError: It is neither, or the scene has no scenario.
    """
    if isinstance(scene, Scenario):
        return scene
    if not isinstance(scene, Scene):
        rule = f"must be a Scene or a Scenario, got {type(scene).__name__}; Scene.load reads presets and files"
        raise InputError(rule, "scene")
    return scene.scenario
