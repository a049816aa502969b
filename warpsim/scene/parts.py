"""The parts of a scene that belong to no other room: frames, sky, group."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from warpsim.config.fields import (
    Count,
    Group,
    Integer,
    Name,
    NonNegative,
    Number,
    Positive,
    Switch,
    as_tuple,
    closed_interval,
    rule_error,
    whole_path,
)
from warpsim.config.model import config_model
from warpsim.errors import InputError
from warpsim.orbit.constellations import Constellation
from warpsim.orbit.paths import Orbit
from warpsim.target.attitude import Attitude
from warpsim.target.attitude_table import AttitudeTable
from warpsim.target.shapes import Shape
from warpsim.target.surface import Graybody
from warpsim.target.temperature import HeatBalance, Temperature, TemperatureTable


def _of_kind(kind: str) -> Callable[[Any], Any]:
    """Tables of a scene file that do not say their kind are of this one."""

    def name_kind(value: Any) -> Any:
        return {"kind": kind, **value} if isinstance(value, dict) else value

    return name_kind


def _printable(value: str) -> str:
    if not re.fullmatch(r"[ -~]*", value):
        raise rule_error("must be printable ASCII text")
    return value


Text = Annotated[str, AfterValidator(_printable)]
"""Text that fits a FITS header."""
Trajectory = Annotated[Orbit, BeforeValidator(_of_kind("ballistic_arc"))]
"""Path of a main target; what names no kind is a ballistic arc."""
AnyConstellation = Annotated[Constellation, BeforeValidator(_of_kind("walker"))]
"""What names no kind is a Walker pattern."""
Speeds = Annotated[tuple[NonNegative, NonNegative], BeforeValidator(as_tuple)]


@config_model
class Frames:
    """When frames are taken. Frame k is at start_s + k * interval_s, its mid-exposure.

    Args:
        count: Frames of the whole sequence.
        interval_s: Time between frames [s].
        start_s: Time of frame 0 after the scene's epoch [s].
    """

    count: Count
    interval_s: Positive
    start_s: NonNegative = 0.0


BUILT_IN_CATALOGS = ("default", "union", "synthetic", "none")
"""Words for `Sky.catalog` that name no file."""


def _word_or_path(value: Any) -> str:
    rule = f"must be one of {', '.join(BUILT_IN_CATALOGS)}, or the path of a file"
    return value if isinstance(value, str) and value in BUILT_IN_CATALOGS else whole_path(value, rule)


@config_model
class SyntheticStars:
    """Made-up stars over the whole sky; give n_star or limit_jy.

    Args:
        n_star: How many.
        limit_jy: Flux density of the faintest in band A [Jy].
        sky: "astrometric", as dense as a catalog selected in visible light, or "infrared", as dense as the true sky.
        seed: Of their random numbers; the scene's seed plays no part.
    """

    n_star: Annotated[Count, closed_interval(1, 10**8)] | None = None
    limit_jy: Annotated[Positive, closed_interval(1e-6, 1e6)] | None = None
    sky: Literal["astrometric", "infrared"] = "astrometric"
    seed: Annotated[Integer, closed_interval(0, 2**63 - 1)] = 0

    @model_validator(mode="after")
    def _one_size(self) -> SyntheticStars:
        if (self.n_star is None) == (self.limit_jy is None):
            raise InputError("exactly one must be given", "n_star, limit_jy")
        return self


@config_model
class Sky:
    """The star background.

    Args:
        catalog: "default" (embedded), "union" (all of its sources, needs the extra `catalogs`), "synthetic", "none", or
            the path of a catalog file.
        synthetic: What to make, for catalog = "synthetic".
        physics: "physical", or "paper": motion by its Eq. 5 and irradiance by its zero points.
        aberration: Whether apparent places include the aberration of the sensor's motion.
        parallax: Whether they include the parallax of nearby stars.
        light_deflection: Whether they include the bending of light by the Sun.
    """

    catalog: Annotated[str, BeforeValidator(_word_or_path)] = "default"
    synthetic: SyntheticStars | None = None
    physics: Literal["physical", "paper"] = "physical"
    aberration: Switch = True
    parallax: Switch = False
    light_deflection: Switch = False

    @model_validator(mode="after")
    def _synthetic_is_described(self) -> Sky:
        if (self.catalog == "synthetic") != (self.synthetic is not None):
            raise InputError('must be given with catalog = "synthetic", and only then', "synthetic")
        return self


@config_model
class Release:
    """How targets leave the main target of their group.

    Args:
        speed_m_s: Smallest and largest speed relative to the main target [m/s]; directions are isotropic.
        time_s: When, after the scene's epoch [s]; negative for a group that is on its way already. Until then a target
            is stowed: it goes with the main one, and gives no light of its own.
    """

    speed_m_s: Speeds = (2.0, 5.0)
    time_s: Annotated[Number, closed_interval(-1e6, 1e9)] = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Release:
        if self.speed_m_s[0] > self.speed_m_s[1]:
            raise InputError("must be (lowest, highest)", "speed_m_s", self.speed_m_s)
        return self


def _kind_or(kind: str) -> Discriminator:
    """A table of a scene file that names no kind is of this one."""
    return Discriminator(
        lambda value: value.get("kind", kind) if isinstance(value, dict) else getattr(value, "kind", kind)
    )


AnyAttitude = Annotated[
    Annotated[Attitude, Tag("motion")] | Annotated[AttitudeTable, Tag("table")], _kind_or("motion")
]
AnyTemperature = Annotated[
    Annotated[Temperature, Tag("linear")]
    | Annotated[TemperatureTable, Tag("table")]
    | Annotated[HeatBalance, Tag("heat_balance")],
    _kind_or("linear"),
]


@config_model
class TargetSpec:
    """A target, or several of one kind.

    Args:
        name: Name; with count > 1 the targets are called name01, name02, ...
        shape: Sphere, Cylinder, Cone, Frustum, Plate or Mesh.
        surface: Reflectance or emissivity, by band or for all.
        temperature: Over the scene: Temperature (linear), TemperatureTable or HeatBalance.
        attitude: How it turns: Attitude, or AttitudeTable.
        count: How many.
        release: How these leave the main target; as the group's others when left out.
    """

    name: Name
    shape: Shape
    surface: Graybody
    temperature: AnyTemperature
    attitude: AnyAttitude = Field(default_factory=Attitude)
    count: Group = 1
    release: Release | None = None

    @property
    def names(self) -> list[str]:
        """Names of the single targets."""
        if self.count == 1:
            return [self.name]
        digits = max(2, len(str(self.count)))
        return [f"{self.name}{i + 1:0{digits}d}" for i in range(self.count)]


@config_model
class TargetGroup:
    """A main target on a trajectory, and what leaves it.

    Args:
        name: Name of the group.
        trajectory: Path of its main target.
        targets: The first one is the group's main target, with count 1.
        release: How the others leave it.
    """

    name: Name
    trajectory: Trajectory
    targets: Annotated[tuple[TargetSpec, ...], BeforeValidator(as_tuple)]
    release: Release = Field(default_factory=Release)

    @model_validator(mode="after")
    def _has_main(self) -> TargetGroup:
        if not self.targets:
            raise InputError("must hold at least the main target, which the trajectory belongs to", "targets")
        if self.targets[0].count != 1:
            raise InputError("must be 1 for the main target", "targets[0].count", self.targets[0].count)
        return self

    @property
    def specs(self) -> list[TargetSpec]:
        """The description behind each single target."""
        return [spec for spec in self.targets for _ in range(spec.count)]

    @property
    def names(self) -> list[str]:
        """Names of the single targets, the main one first."""
        return [name for spec in self.targets for name in spec.names]

    @property
    def releases(self) -> list[Release | None]:
        """How each single target leaves the main one, None for the main one itself."""
        return [None, *(spec.release or self.release for spec in self.specs[1:])]
