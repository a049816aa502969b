"""Groups of targets: their members, motion and time span."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from warpsim.config.distributions import Distribution
from warpsim.config.fields import Group, Name, NonNegative, Number, as_tuple, closed_interval, rule_error
from warpsim.config.model import config_model, exactly_one
from warpsim.errors import InputError
from warpsim.orbit.arc import BallisticArc
from warpsim.orbit.constellations import Constellation, Orbit
from warpsim.radiometry.by_band import AS_DICT, FixedMapping
from warpsim.target.attitude import Attitude
from warpsim.target.attitude_table import AttitudeTable
from warpsim.target.patches import Patch, check_patches
from warpsim.target.shapes import Shape
from warpsim.target.surface import Graybody
from warpsim.target.temperature import HeatBalance, Temperature, TemperatureTable
from warpsim.target.torque_free import TorqueFree

MOST_TARGETS = 200_000
"""Single targets of a scene: `warpsim check` takes 0.2 ms and 4 kB for each, longer where access counts by all."""

SPREAD_PARTS = ("shape", "surface", "temperature", "attitude")
"""Parts of a target whose numbers may differ from member to member."""


def of_kind(kind: str) -> Callable[[Any], Any]:
    """Return a validator that names the kind of tables that do not say theirs."""
    return lambda value: {"kind": kind, **value} if isinstance(value, dict) else value


def kind_or(kind: str) -> Discriminator:
    """Return a discriminator for which tables that name no kind are of this one."""
    return Discriminator(
        lambda value: value.get("kind", kind) if isinstance(value, dict) else getattr(value, "kind", kind)
    )


def _printable(value: str) -> str:
    if not re.fullmatch(r"[ -~]*", value):
        raise rule_error("must be printable ASCII text")
    return value


Text = Annotated[str, AfterValidator(_printable)]
"""Text that fits a FITS header."""
Trajectory = Annotated[Orbit, BeforeValidator(of_kind("ballistic_arc"))]
"""Path of a main target; what names no kind is a ballistic arc."""
AnyConstellation = Annotated[Constellation, BeforeValidator(of_kind("walker"))]
"""What names no kind is a Walker pattern."""
AnyAttitude = Annotated[
    Annotated[Attitude, Tag("motion")]
    | Annotated[AttitudeTable, Tag("table")]
    | Annotated[TorqueFree, Tag("torque_free")],
    kind_or("motion"),
]
AnyTemperature = Annotated[
    Annotated[Temperature, Tag("linear")]
    | Annotated[TemperatureTable, Tag("table")]
    | Annotated[HeatBalance, Tag("heat_balance")],
    kind_or("linear"),
]
Speeds = Annotated[tuple[NonNegative, NonNegative], BeforeValidator(as_tuple)]
Times = Annotated[tuple[Number, Number], BeforeValidator(as_tuple)]


class Spread(FixedMapping[Any]):
    """Distributions by field; does not change."""

    def __hash__(self) -> int:
        return hash(frozenset(self._values))  # values of choices may be lists, which have none


AnySpread = Annotated[
    dict[str, Distribution],
    BeforeValidator(lambda value: dict(value) if isinstance(value, Mapping) else value),
    AfterValidator(Spread),
    AS_DICT,
]
"""Distributions by field."""


@config_model
class Release:
    """Release of targets from the main target of their group.

    Args:
        speed_m_s: Smallest and largest speed relative to the main target [m/s]; directions are isotropic.
        time_s: When, after the start of the group [s]; negative for a group that is on its way already. Until then a
            target is not deployed: it goes with the main one, and gives no light.
    """

    speed_m_s: Speeds = (2.0, 5.0)
    time_s: Annotated[Number, closed_interval(-1e6, 1e9)] = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Release:
        if self.speed_m_s[0] > self.speed_m_s[1]:
            raise InputError("must be (lowest, highest)", "speed_m_s", self.speed_m_s)
        return self


@config_model
class TargetSpec:
    """A target, or several of one kind.

    Args:
        name: Name; with count > 1 the targets are called name01, name02, ...
        shape: Sphere, Cylinder, Cone, Frustum, Plate or Mesh.
        surface: Reflectance or emissivity, by band or for all.
        temperature: While the target is there: Temperature (linear), TemperatureTable or HeatBalance.
        attitude: How it turns: Attitude, AttitudeTable or TorqueFree.
        count: How many.
        release: How these leave the main target; as the group's others when left out.
        class_: What a classifier is to call it (`class` in a file); the name when left out.
        spread: Numbers that differ from member to member: distributions by field, as in
            {"shape.radius_m": {"normal": [0.5, 0.05]}}; seeded by the scene.
        patches: Parts of the surface of another reflectance or emissivity; they do not overlap.
    """

    name: Name
    shape: Shape
    surface: Graybody
    temperature: AnyTemperature
    attitude: AnyAttitude = Field(default_factory=Attitude)
    count: Group = 1
    release: Release | None = None
    class_: Annotated[Name | None, Field(alias="class")] = None
    spread: AnySpread | None = None
    patches: Annotated[tuple[Patch, ...], BeforeValidator(as_tuple)] = ()

    @model_validator(mode="after")
    def _parts_fit(self) -> TargetSpec:
        for field in self.spread or ():
            part, _, leaf = field.partition(".")
            if part not in SPREAD_PARTS or not leaf:
                allowed = ", ".join(f"{name}.*" for name in SPREAD_PARTS)
                raise InputError(f"must name fields among {allowed}", "spread", field)
        check_patches(self.shape, self.patches)
        return self

    @property
    def surfaces(self) -> tuple[Graybody, ...]:
        """The surface and those of the patches."""
        return (self.surface, *(patch.surface for patch in self.patches))

    @property
    def names(self) -> list[str]:
        """Names of the single targets."""
        if self.count == 1:
            return [self.name]
        digits = max(2, len(str(self.count)))
        return [f"{self.name}{i + 1:0{digits}d}" for i in range(self.count)]

    @property
    def class_name(self) -> str:
        """The class, by default the name."""
        return self.class_ or self.name


@config_model
class TargetGroup:
    """Targets that belong together: a main target on a trajectory and what leaves it, or one target on each orbit.

    Args:
        name: Name of the group.
        trajectory: Path of the main target.
        targets: The first one is the main target, with count 1; the others leave it. With `orbits` there is one only,
            and each orbit of them has it.
        release: How the others leave the main target.
        orbits: Several paths, of any kind of constellation: one target each, called by the orbit's name.
        start_s: Launch of the group, the time 0 of its paths, after the scene's epoch [s]; targets exist from then on.
            At 0 the group is on its way when the scene begins. Paths that have dates of their own keep them.
        exists_s: Start and end of the targets' existence after the scene's epoch [s]; before and after they are absent.
            When left out from start_s on, and to the end of a ballistic flight.
    """

    name: Name
    trajectory: Trajectory | None = None
    targets: Annotated[tuple[TargetSpec, ...], BeforeValidator(as_tuple)] = ()
    release: Release = Field(default_factory=Release)
    orbits: AnyConstellation | None = None
    start_s: NonNegative = 0.0
    exists_s: Times | None = None

    @model_validator(mode="after")
    def _complete(self) -> TargetGroup:
        exactly_one(self, "trajectory", "orbits")
        if not self.targets:
            raise InputError("must hold at least the main target, which the trajectory belongs to", "targets")
        if sum(spec.count for spec in self.targets) > MOST_TARGETS:
            raise InputError(f"must be at most {MOST_TARGETS:,} single targets", "targets")
        main = self.targets[0]
        if main.count != 1:
            raise InputError("must be 1 for the main target", "targets[0].count", main.count)
        if main.release is not None:
            raise InputError("must not be given, the main target is not released", "targets[0].release")
        if self.orbits is not None and len(self.targets) > 1:
            raise InputError("must be one only, which every orbit has", "targets", len(self.targets))
        return self

    @model_validator(mode="after")
    def _exists(self) -> TargetGroup:
        first_s, last_s = self.span_s
        if first_s >= last_s:
            raise InputError("must be [first, last], the first before the last", "exists_s", list(self.exists_s or ()))
        if self.start_s > 0.0 and first_s < self.start_s:
            raise InputError(f"must not begin before start_s ({self.start_s:g})", "exists_s[0]", first_s)
        if isinstance(self.trajectory, BallisticArc) and last_s > self.start_s + self.trajectory.duration_s:
            end_s = self.start_s + self.trajectory.duration_s
            raise InputError(f"must not be after the flight's end ({end_s:g})", "exists_s[1]", last_s)
        if isinstance(self.trajectory, BallisticArc):
            for release in self.releases[1:]:
                if release is not None and release.time_s < 0:
                    raise InputError("must be >= 0, as the flight starts then", "release.time_s", release.time_s, "g")
        return self

    @property
    def path(self) -> Any:
        """The trajectory, or the orbits."""
        return self.orbits if self.trajectory is None else self.trajectory

    @property
    def path_field(self) -> str:
        """The field that describes it."""
        return "orbits" if self.trajectory is None else "trajectory"

    @property
    def names(self) -> list[str]:
        """Names of the single targets, the main one first.

        Raises:
            InputError: The orbits' file cannot be read.
        """
        if self.orbits is not None:
            return list(self.orbits.names)
        return [name for spec in self.targets for name in spec.names]

    @property
    def specs(self) -> list[TargetSpec]:
        """The entry of `targets` of each single target."""
        if self.orbits is not None:
            return [self.targets[0]] * len(self.names)
        return [spec for spec in self.targets for _ in range(spec.count)]

    @property
    def releases(self) -> list[Release | None]:
        """Release of each single target, None for the main one itself and for those on orbits."""
        if self.orbits is not None:
            return [None] * len(self.names)
        return [None, *(spec.release or self.release for spec in self.specs[1:])]

    @property
    def span_s(self) -> tuple[float, float]:
        """Start and end of the targets' existence after the scene's epoch [s]; infinite where there is no bound."""
        if self.exists_s is not None:
            return self.exists_s
        end_s = self.start_s + self.trajectory.duration_s if isinstance(self.trajectory, BallisticArc) else math.inf
        return (self.start_s if self.start_s > 0.0 else -math.inf), end_s
