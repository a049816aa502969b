"""The description of a scene: its fields, and their checks. It reads no file and solves nothing."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import ArgsKwargs

from warpsim.config.fields import Integer, Positive, as_tuple, closed_interval
from warpsim.config.model import adapter, config_model
from warpsim.orbit.access_constraints import AccessConstraints
from warpsim.orbit.arc import UtcText
from warpsim.radiometry.by_band import ByBand
from warpsim.scene import checks
from warpsim.scene.background import Background
from warpsim.scene.band_descriptions import BandDescriptions, with_names
from warpsim.scene.bounds import check_bounds
from warpsim.scene.environment import Lighting, Sky
from warpsim.scene.groups import AnyConstellation, TargetGroup, Text
from warpsim.scene.pointing import TRACKED
from warpsim.scene.sensors import Frames, Sensor
from warpsim.scene.short_form import shortened, with_lists

Seed = Annotated[Integer, closed_interval(0, 2**63 - 1)]
"""A seed: up to the largest integer of TOML."""


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
        check_bounds(self.constellation, self.sensors, self.groups, self.frames, self.duration_s)
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
        plain: dict[str, Any] = adapter(type(self)).dump_python(self, mode="json", by_alias=True)
        left_out = {"band": not self.band, "background": self.background == Background()}
        return {
            name: _without_none(value) for name, value in plain.items() if value is not None and not left_out.get(name)
        }

    @staticmethod
    def shortened_path(values: dict[str, Any]) -> Any:
        """Return the function that shortens field paths in errors."""
        return shortened(values)


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value
