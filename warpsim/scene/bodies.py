"""Satellites and targets of a scene with their paths, attitudes and temperatures, each part computed on first use."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from warpsim.errors import InputError, errors_at
from warpsim.instant import Instant, instant
from warpsim.radiometry.band import Band
from warpsim.scene.band_descriptions import find_band
from warpsim.scene.description import SceneDescription
from warpsim.scene.left_out import without_lost_satellites
from warpsim.scene.motion import breakpoints_s
from warpsim.scene.sensors import sensor_instances
from warpsim.scene.target_histories import AnyAttitude, target_attitudes, target_temperatures, timed_tables
from warpsim.scene.targets import SceneTarget, scene_targets
from warpsim.scene.tracks import Tracks, build_tracks
from warpsim.target.temperature import TemperatureRows


class SceneBodies:
    """What follows from a scene for its satellites and targets, as instruments observe them."""

    def __init__(self, scene: SceneDescription) -> None:
        if not isinstance(scene, SceneDescription):
            rule = f"must be a Scene, got {type(scene).__name__}; Scene.load reads presets and files"
            raise InputError(rule, "scene")
        self.epoch: Instant = instant(scene.epoch_utc)
        """What all times count from."""
        self.scene, self._left_out = without_lost_satellites(scene, self.epoch)
        """The description, without the satellites of element sets that have no state in it."""

    @cached_property
    def satellite_names(self) -> list[str]:
        """Names of the satellites, in the order of the constellation."""
        with errors_at("constellation"):
            return list(self.scene.constellation.names)

    @cached_property
    def targets(self) -> list[SceneTarget]:
        """The single targets, group by group, the main target of each first."""
        return scene_targets(self.scene.groups, self.scene.seed)

    @cached_property
    def target_names(self) -> list[str]:
        """Names of the single targets, in that order."""
        return [target.name for target in self.targets]

    @cached_property
    def group_names(self) -> list[str]:
        """Names of the groups."""
        return [group.name for group in self.scene.groups]

    @cached_property
    def _instances(self) -> list[list[tuple[str, int]]]:
        """Name, and index of the satellite, of each sensor of each kind."""
        return sensor_instances(self.scene.sensors, self.satellite_names)

    @cached_property
    def body_names(self) -> set[str]:
        """Names of satellites and sensors, that rows of directions may name."""
        return {*self.satellite_names, *(name for some in self._instances for name, _ in some)}

    @cached_property
    def bands(self) -> dict[str, Band]:
        """Spectral bands of all sensors, by name.

        Raises:
            InputError: The file of one cannot be read, or holds no response.
        """
        names = dict.fromkeys(name for sensor in self.scene.sensors for name in sensor.bands)
        return {name: find_band(name, self.scene.band) for name in names}

    @cached_property
    def tracks(self) -> Tracks:
        """States of satellites and targets at the nodes of one time grid."""
        scene = self.scene
        return build_tracks(scene.constellation, scene.groups, self.targets, self.epoch, scene.duration_s, scene.seed)

    @cached_property
    def breakpoints_s(self) -> dict[str, list[float]]:
        """Times at which the velocity of each satellite and target may jump [s after the epoch]."""
        scene = self.scene
        return breakpoints_s(scene.constellation, scene.groups, self.targets, self.epoch, scene.duration_s)

    @cached_property
    def attitudes(self) -> list[AnyAttitude]:
        """Attitude motion of each single target; `.at(time_s)` gives the rotation."""
        return target_attitudes(self.targets, self.tracks, self._attitude_tables, self.scene.seed)

    @cached_property
    def temperatures(self) -> list[TemperatureRows]:
        """Temperature of each single target; `.at(time_s)` gives it."""
        return target_temperatures(
            self.targets, self.tracks, self.attitudes, self._temperature_tables, list(self.bands),
            self.scene.duration_s, len(self.scene.groups),
        )  # fmt: skip

    @cached_property
    def _attitude_tables(self) -> dict[tuple[int, int], Any]:
        """Tables of attitudes, by group and entry."""
        return timed_tables(self.scene.groups, "attitude", self.epoch, self.scene.duration_s)

    @cached_property
    def _temperature_tables(self) -> dict[tuple[int, int], Any]:
        """Tables of temperatures, by group and entry."""
        return timed_tables(self.scene.groups, "temperature", self.epoch, self.scene.duration_s)
