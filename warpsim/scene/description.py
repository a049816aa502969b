"""The description of a scene: its fields, checks, and bounds of its work. It reads no file and solves nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import ArgsKwargs

from warpsim.config.fields import Integer, Positive, as_tuple, closed_interval
from warpsim.config.model import adapter, config_model
from warpsim.errors import InputError
from warpsim.orbit.access_constraints import AccessConstraints
from warpsim.orbit.arc import UtcText
from warpsim.radiometry.by_band import ByBand
from warpsim.scene import checks
from warpsim.scene.background_terms import Background
from warpsim.scene.band_descriptions import BandDescriptions, with_names
from warpsim.scene.environment import Lighting, Sky
from warpsim.scene.groups import MOST_TARGETS, AnyConstellation, TargetGroup, Text
from warpsim.scene.pointing import TRACKED
from warpsim.scene.sensors import Frames, Sensor
from warpsim.scene.short_form import shortened, with_lists, with_paths
from warpsim.target.temperature import HeatBalance

Seed = Annotated[Integer, closed_interval(0, 2**63 - 1)]
"""A seed: up to the largest integer of TOML."""

LONGEST_TRACKS_S = 2e8
"""Longest scene times number of bodies: 1 GB of orbit nodes at most, and below 2 GB while they are made."""

LONGEST_SCENE_S = 31 * 86_400.0
"""Longest scene: free flight is integrated step by step, some ten seconds of work for a month."""

LONGEST_HEAT_S = 3e7
"""Longest scene, with HEAT_BALANCE_S, times number of heat balances: a microsecond of work for each second."""

HEAT_BALANCE_S = 700.0
"""Time of a scene [s] whose work is that of beginning a heat balance."""

MOST_VIEWS = 100_000_000
"""Frames times sensors of a kind: access is asked for every one, and numbers of frames take 4 bytes each in a report,
8 and their text in a run."""

MOST_BANDS = 100
"""Bands of all sensors: `warpsim check` takes 40 ms for one."""


@config_model
class SceneDescription:
    """Description of the simulated scene: the fields of a Scene, which see."""

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
    background: Background = Field(default_factory=Background)
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
    def _consistent(self) -> SceneDescription:
        _check_bounds(self.constellation, self.sensors, self.groups, self.frames, self.duration_s)
        checks.check_sensors(self.constellation, self.sensors, self.frames)
        checks.check_zodiacal(self.sensors, self.background)
        checks.check_names(self.constellation, self.sensors, self.groups)
        checks.check_times(self.groups, self.duration_s)
        checks.check_frames(self.sensors, self.frames, self.duration_s)
        checks.check_bands(self.band, self.sensors, self.groups, self.lighting, self.sky)
        checks.check_instruments(self.sensors, self.band)
        checks.check_targets(self.groups, self.sensors, self.epoch_utc, self.duration_s)
        checks.check_pointing(self.constellation, self.sensors, self.groups, self.access_target, self.frames)
        return self

    def to_dict(self) -> dict[str, Any]:
        """Return nested dicts and lists of plain values, without what is None; `from_dict` gives an equal scene."""
        left_out = {name for name, value in (("band", self.band), ("background", self.background.is_on)) if not value}
        plain: dict[str, Any] = adapter(type(self)).dump_python(
            self, mode="json", by_alias=True, exclude=left_out, exclude_none=True
        )
        return plain

    shortened_path = staticmethod(shortened)


def _check_bounds(
    constellation: AnyConstellation,
    sensors: Sequence[Sensor],
    groups: Sequence[TargetGroup],
    frames: Frames,
    duration_s: float,
) -> None:
    """Check that a scene asks for no more than can be done; satellites and targets in files do not count.

    Raises:
        InputError: It does; the text names the field.
    """
    satellites = checks.known_names(constellation)
    _check_bodies(len(satellites or []), groups, duration_s)
    n_sensor = 1 if satellites is None else len(satellites)
    for path, sensor in with_paths("sensors", sensors):
        n_frame = (sensor.frames or frames).count
        if n_frame * n_sensor > MOST_VIEWS:
            rule = f"must be so few that frames times satellites are at most {MOST_VIEWS:,}, got {n_frame:,} for"
            raise InputError(f"{rule} {n_sensor:,}", "frames.count").within(path if sensor.frames else "")
    n_band = sum(len(sensor.bands) for sensor in sensors)
    if n_band > MOST_BANDS:
        raise InputError(f"must be at most {MOST_BANDS} in all sensors, got {n_band}", "bands")


def _check_bodies(n_satellite: int, groups: Sequence[TargetGroup], duration_s: float) -> None:
    """Check the number of satellites and targets, and of heat balances among them."""
    n_target, heat_s = 0, 0.0
    for path, group in with_paths("groups", groups):
        n_orbit = None if group.orbits is None else len(checks.known_names(group.orbits) or [])
        for entry, spec in enumerate(group.targets):
            n = spec.count if n_orbit is None else n_orbit
            n_target += n
            if isinstance(spec.temperature, HeatBalance):
                heat_s += n * (duration_s + HEAT_BALANCE_S)
            if heat_s > LONGEST_HEAT_S:
                rule = (
                    f"{n:,} heat balances over {duration_s:g} s are too much work: those of a scene times its length "
                    f"and {HEAT_BALANCE_S:g} s must be at most {LONGEST_HEAT_S:g} s"
                )
                raise InputError(rule, f"targets[{entry}].count").within(path)
        if n_target > MOST_TARGETS:
            raise InputError(f"must be at most {MOST_TARGETS:,} single targets in a scene", "targets").within(path)
    n_body = n_satellite + n_target
    if duration_s > LONGEST_SCENE_S and n_body * duration_s <= LONGEST_TRACKS_S:
        rule = f"must be at most {LONGEST_SCENE_S:g} (31 days); longer ones are several scenes"
        raise InputError(rule, "duration_s", duration_s, "g")
    if n_body * duration_s > LONGEST_TRACKS_S:
        raise InputError(
            f"{duration_s:g} s are too long for {n_body} satellites and targets: their product must be at most "
            f"{LONGEST_TRACKS_S:g} s",
            "duration_s",
        )
