"""The scene: an immutable, validated description of sensors, targets and sky."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy.typing as npt
from pydantic import BeforeValidator, Field, ValidationError, model_validator
from pydantic_core import ArgsKwargs

from warpsim.config.fields import Integer, Positive, as_tuple, closed_interval
from warpsim.config.model import adapter, config_model, input_error
from warpsim.errors import InputError
from warpsim.instant import utc_time
from warpsim.orbit.access_constraints import AccessConstraints
from warpsim.orbit.arc import UtcText
from warpsim.radiometry.by_band import ByBand
from warpsim.scene import checks
from warpsim.scene.band_descriptions import BandDescriptions, with_names, without_superseded
from warpsim.scene.environment import Lighting, Sky
from warpsim.scene.groups import AnyConstellation, TargetGroup, Text
from warpsim.scene.instrument import TRACKED
from warpsim.scene.scene_files import (
    check_depth,
    read_scene_data,
    with_absolute_paths,
    with_relative_paths,
    write_scene_data,
)
from warpsim.scene.sensors import Frames, Sensor
from warpsim.scene.short_form import changed, list_of, shortened, with_lists

if TYPE_CHECKING:
    import numpy as np
    from astropy.table import Table
    from astropy.time import Time

    from warpsim.scene.scenario import Scenario


Seed = Annotated[Integer, closed_interval(0, 2**63 - 1)]
"""A seed: up to the largest integer of TOML."""


@config_model
class Scene:
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
        seed: Seed of the world: releases, attitudes, what is spread over members, errors of pointing; 0 to 2**63 - 1
            (the largest integer of TOML).
        noise_seed: Seed of the detectors' noise; `seed` when left out. Noise also depends on the scene's name.
        name: Short name.
        description: One line about the scene.

    Raises:
        InputError: One line: field, rule, value.
    """

    epoch_utc: UtcText
    duration_s: Positive
    frames: Frames
    constellation: AnyConstellation
    sensors: Annotated[tuple[Sensor, ...], BeforeValidator(as_tuple)]
    groups: Annotated[tuple[TargetGroup, ...], BeforeValidator(as_tuple)]
    access_rules: AccessConstraints = Field(default_factory=AccessConstraints)
    access_target: str = TRACKED
    band: BandDescriptions = ByBand({})
    sky: Sky = Field(default_factory=Sky)
    lighting: Lighting = Field(default_factory=Lighting)
    seed: Seed = 0
    noise_seed: Seed | None = None
    name: Text = "scene"
    description: str = ""

    @model_validator(mode="before")
    @classmethod
    def _with_lists(cls, data: Any) -> Any:
        """Expand the short form of one sensor and one group, and collect the bands that sensors bring along."""
        if isinstance(data, dict):
            return with_names(with_lists(data))
        return ArgsKwargs(data.args, with_names(with_lists(data.kwargs or {})))

    @model_validator(mode="after")
    def _consistent(self) -> Scene:
        checks.check_sensors(self.constellation, self.sensors, self.frames)
        checks.check_names(self.constellation, self.sensors, self.groups)
        checks.check_times(self.constellation, self.groups, self.duration_s)
        checks.check_frames(self.sensors, self.frames, self.duration_s)
        checks.check_bands(self.band, self.sensors, self.groups, self.lighting, self.sky)
        checks.check_instruments(self.sensors, self.band)
        checks.check_targets(self.groups, self.sensors, self.epoch_utc, self.duration_s)
        checks.check_pointing(self.constellation, self.sensors, self.groups, self.access_target, self.frames)
        return self

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

    def to_dict(self) -> dict[str, Any]:
        """Return nested dicts and lists of plain values, without what is None; `from_dict` gives an equal scene."""
        plain: dict[str, Any] = adapter(type(self)).dump_python(self, mode="json", by_alias=True)
        left_out = ("band",) if not self.band else ()
        return {
            name: _without_none(value) for name, value in plain.items() if value is not None and name not in left_out
        }

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
        data, named = self.to_dict(), {}
        for name, value in changes.items():
            part = list_of(name.partition("__")[0])
            if part is not None and len(data[part]) != 1:
                field = name.replace("__", ".")
                raise InputError(f"names no one of {len(data[part])} {part}; begin with {part}__0__", field).of("Scene")
            named[name if part is None else f"{part}__0__{name}"] = value
        try:
            data = changed(data, named)
        except InputError as error:
            raise error.of("Scene") from None
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
        from warpsim.scene.scenario import Scenario

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

    @staticmethod
    def shortened_path(values: dict[str, Any]) -> Any:
        """Return the function that shortens field paths in errors."""
        return shortened(values)

    def __getattr__(self, name: str) -> Any:
        """Fields of the only kind of sensor, or of the only group.

        Raises:
            InputError: There are several; an AttributeError too, as for `hasattr`.
        """
        part = list_of(name)
        if part is None:
            from warpsim.scene.scenario import Scenario

            hint = f"; scene.scenario.{name} is it" if not name.startswith("_") and hasattr(Scenario, name) else ""
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}{hint}")
        items = getattr(self, part)
        if len(items) != 1:
            names = ", ".join(item.name for item in items) or "none"
            raise _NoOnlyPartError(f"the scene has {len(items)} {part} ({names}); take scene.{part}[0].{name}", name)
        return getattr(items[0], name)


class _NoOnlyPartError(InputError, AttributeError):
    """A field of the only sensor or group, where there are several."""


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value
