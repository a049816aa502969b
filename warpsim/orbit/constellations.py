"""Kinds of paths, and constellations made of parts: a list of orbits, copies of one in a pattern, constellations.

Parts are distinguished by their field `kind`. Each has `states(epoch, time_s)`, which gives positions [m] and
velocities [m/s] in GCRS axes, (n_time, n_object, 3), with one object for an orbit. Constellations have `names` as well.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from warpsim.arrays import F64, I64
from warpsim.config.fields import Group, Name, as_tuple, rule_error
from warpsim.config.model import TOO_DEEP, complete, config_model
from warpsim.constants import EARTH_GM_M3_S2
from warpsim.errors import InputError, errors_at
from warpsim.orbit.arc import BallisticArc
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M, pole_of_date
from warpsim.orbit.element_catalog import LeftOut
from warpsim.orbit.elements import KeplerOrbit, StateVector, state_to_elements
from warpsim.orbit.ephemeris import EphemerisOrbit, EphemerisSatellites, Span
from warpsim.orbit.gravity import Gravity, propagate
from warpsim.orbit.tle import TleOrbit, TleSatellites
from warpsim.orbit.two_body import propagate_two_body
from warpsim.orbit.walker import Pattern, Phasing, Walker, pattern_turns, satellite_names

if TYPE_CHECKING:
    from warpsim.instant import Epoch


Orbit = Annotated[
    BallisticArc | StateVector | KeplerOrbit | TleOrbit | EphemerisOrbit,
    Field(discriminator="kind"),
]
"""The path of one object."""

SimpleConstellation = Walker | TleSatellites | EphemerisSatellites
"""Constellations that hold no other parts; `Constellation` adds those that do."""


class Propagator(Protocol):
    """Source of states: an orbit, a trajectory or a constellation."""

    def states(self, epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s], GCRS axes, each (n_time, n_object, 3)."""
        ...


def states_of(
    propagator: Propagator,
    epoch: Epoch,
    time_s: ArrayLike,
    within_s: Span | None = None,
    bodies: I64 | None = None,
) -> tuple[F64, F64]:
    """States of a propagator, of which only those within a span matter, if one is given.

    What knows its motion for a limited time only has `states_within(epoch, time_s, within_s)`: it must cover the span,
    and before and after it the motion goes on freely. `bodies` are the numbers, ascending, of the objects that are
    asked for, all if left out.
    """
    if bodies is not None:
        return _states_of_some(propagator, epoch, time_s, within_s, bodies)
    limited = None if within_s is None else getattr(propagator, "states_within", None)
    if limited is None:
        return propagator.states(epoch, time_s)
    position, velocity = limited(epoch, time_s, within_s)
    return position, velocity


MOST_SATELLITES = 100_000
"""Satellites of a constellation, those in files aside."""


def _states_of_some(
    propagator: Any, epoch: Epoch, time_s: ArrayLike, within_s: Span | None, bodies: I64
) -> tuple[F64, F64]:
    """States of some of the objects of a propagator; the others are not propagated."""
    if isinstance(propagator, MixedConstellation):
        members = [("", item) for item in propagator.parts]
        return _side_by_side(members, epoch, time_s, within_s, bodies)
    if isinstance(propagator, Walker):
        start_m, start_m_s = (part[bodies] for part in propagator.state())
        return propagate(start_m, start_m_s, time_s, propagator.gravity, pole_of_date(epoch))
    if isinstance(propagator, SeedPattern):
        start_m, start_m_s = (part[bodies] for part in propagator.state(epoch))
        return propagate(start_m, start_m_s, time_s, propagator.copies_gravity, pole_of_date(epoch))
    if isinstance(propagator, ListedSatellites):
        some = tuple(propagator.satellites[number] for number in bodies.tolist())
        return states_of(dataclasses.replace(propagator, satellites=some), epoch, time_s, within_s)
    if isinstance(propagator, TleSatellites | EphemerisSatellites):
        return states_of(propagator.some(bodies.tolist()), epoch, time_s, within_s)
    position, velocity = states_of(propagator, epoch, time_s, within_s)
    return position[:, bodies], velocity[:, bodies]


DEEPEST_MIXTURE = 20
"""Mixtures of constellations within each other."""


@config_model
class NamedOrbit:
    """One satellite of a list."""

    name: Name
    """Of the satellite."""
    orbit: Orbit
    """Of any kind."""


@config_model
class ListedSatellites:
    """Satellites with individual orbits of any kind."""

    satellites: Annotated[tuple[NamedOrbit, ...], BeforeValidator(as_tuple)]
    """At least one; names must differ."""
    kind: Literal["listed"] = "listed"

    @model_validator(mode="after")
    def _named_apart(self) -> ListedSatellites:
        _check_names("satellites", self.names)
        return self

    @property
    def names(self) -> list[str]:
        """Names in the order of the list."""
        return [item.name for item in self.satellites]

    def states(self, epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s], GCRS axes, each (n_time, n_satellite, 3).

        Raises:
            InputError: A satellite has no state at some time; the text begins with its name.
        """
        return self.states_within(epoch, time_s, None)

    def states_within(self, epoch: Epoch, time_s: ArrayLike, within_s: Span | None) -> tuple[F64, F64]:
        """Return states as `states` does, of which only those within a span matter (`states_of`)."""
        try:
            return self._states(epoch, np.asarray(time_s, np.float64), within_s)
        except InputError:
            # One by one: the same error, with a name.
            return _side_by_side([(item.name, item.orbit) for item in self.satellites], epoch, time_s, within_s)

    def _states(self, epoch: Epoch, times: F64, within_s: Span | None) -> tuple[F64, F64]:
        position, velocity = (np.empty((len(times), len(self.satellites), 3)) for _ in range(2))
        together: dict[Gravity, tuple[list[int], list[tuple[F64, F64]]]] = {}
        for k, item in enumerate(self.satellites):
            orbit = item.orbit
            if isinstance(orbit, KeplerOrbit) or (isinstance(orbit, StateVector) and orbit.time_s == 0.0):
                members, starts = together.setdefault(orbit.gravity, ([], []))
                members.append(k)
                starts.append(orbit.state())
            else:
                position[:, k : k + 1], velocity[:, k : k + 1] = states_of(orbit, epoch, times, within_s)
        for gravity, (members, starts) in together.items():
            start_m, start_m_s = (np.concatenate([start[i] for start in starts]) for i in range(2))
            moved = propagate(start_m, start_m_s, times, gravity, pole_of_date(epoch))
            position[:, members], velocity[:, members] = moved
        return position, velocity

    def notes(self, epoch: Epoch, duration_s: float) -> list[str]:
        """Return warnings about the single orbits, each line with the satellite's name."""
        return [f"{item.name}: {note}" for item in self.satellites for note in _notes_of(item.orbit, epoch, duration_s)]


@config_model
class SeedPattern:
    """Copies of one orbit, evenly spread over planes and slots.

    The seed's state at the epoch gives its Kepler conic. Slot j of plane i is the seed moved along that conic by
    (j - 1) / S + F (i - 1) / T of its period, then turned about the GCRS z axis by the plane's fraction of 360 degrees
    ("delta") or 180 degrees ("star"). All copies, the first included, then fly freely under `gravity`.
    """

    seed: Orbit
    """The first satellite of the first plane; its orbit must be closed."""
    n_plane: Group
    """P, orbital planes."""
    n_per_plane: Group
    """S, satellites per plane; T = P S."""
    phasing: Phasing = 0
    """F, in 0..P-1: a satellite is ahead of its neighbour one plane to the west by F / T of the period."""
    pattern: Pattern = "delta"
    """Nodes spread over 360 degrees ("delta") or 180 degrees ("star")."""
    gravity: Gravity | None = None
    """Of the copies; the seed's own if left out, "j2" where it has none."""
    prefix: Name = "sat"
    """What their names begin with."""
    kind: Literal["seed_pattern"] = "seed_pattern"

    @field_validator("n_per_plane")
    @classmethod
    def _not_too_many(cls, value: int, info: ValidationInfo) -> int:
        planes = info.data.get("n_plane")
        if planes is not None and planes * value > MOST_SATELLITES:
            raise rule_error(f"must give at most {MOST_SATELLITES} satellites in {planes} planes")
        return value

    @property
    def names(self) -> list[str]:
        """`sat{plane}{slot}`, counted from 1, as those of `Walker`."""
        return satellite_names(self.n_plane, self.n_per_plane, self.prefix)

    @property
    def copies_gravity(self) -> Gravity:
        """The gravity model that the copies fly under."""
        own: Gravity = getattr(self.seed, "gravity", "j2")
        return own if self.gravity is None else self.gravity

    def state(self, epoch: Epoch) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s] at the epoch, GCRS axes, each (n_satellite, 3).

        Raises:
            InputError: The seed has no state at the epoch, or its orbit is not closed.
        """
        with errors_at("seed"):
            seed_m, seed_m_s = (x[0] for x in self.seed.states(epoch, np.zeros(1)))  # (1, 3)
        try:
            conic = state_to_elements(seed_m[0], seed_m_s[0])
        except InputError:
            raise InputError("must be on a closed orbit, along which it can be copied", "seed") from None
        perigee_m = float(conic.semi_major_axis_m * (1.0 - conic.eccentricity))
        if perigee_m < EARTH_POLAR_RADIUS_M:
            below_km = (EARTH_POLAR_RADIUS_M - perigee_m) / 1e3
            rule = "its whole orbit must be above the Earth's surface, as copies are spread along it"
            raise InputError(f"{rule}, got a perigee {below_km:.0f} km below", "seed")
        period_s = 2.0 * np.pi * np.sqrt(float(conic.semi_major_axis_m) ** 3 / EARTH_GM_M3_S2)
        plane = np.repeat(np.arange(self.n_plane), self.n_per_plane)
        turns = pattern_turns(self.n_plane, self.n_per_plane, self.phasing)
        along_m, along_m_s = (x[:, 0] for x in propagate_two_body(seed_m, seed_m_s, period_s * turns))
        angle = (2.0 * np.pi if self.pattern == "delta" else np.pi) * plane / self.n_plane
        return _turned_about_z(along_m, angle), _turned_about_z(along_m_s, angle)

    def states(self, epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s], GCRS axes, each (n_time, n_satellite, 3).

        Raises:
            InputError: As `state`, or a path falls through half the Earth's radius.
        """
        return propagate(*self.state(epoch), np.asarray(time_s, np.float64), self.copies_gravity, pole_of_date(epoch))

    def notes(self, epoch: Epoch, duration_s: float) -> list[str]:
        """Return warnings about the seed at the epoch, the only time used."""
        return [f"seed: {note}" for note in _notes_of(self.seed, epoch, 0.0)]


@config_model
class MixedConstellation:
    """Several constellations together; names must be unique among them, those of files on first use."""

    parts: Annotated[tuple[Constellation, ...], BeforeValidator(as_tuple)]
    """Constellations of any kind; names must differ."""
    kind: Literal["mixed"] = "mixed"

    @model_validator(mode="after")
    def _named_apart(self) -> MixedConstellation:
        if self.depth > DEEPEST_MIXTURE:
            raise InputError(f"{TOO_DEEP}, at most {DEEPEST_MIXTURE} mixtures may lie within each other", "parts")
        _check_names("parts", self._stated_names, at_least=0 if self.parts else 1)
        return self

    @property
    def _stated_names(self) -> list[str]:
        """Names that are known without reading a file."""
        names: list[str] = []
        for part in self.parts:
            names += _names_without_files(part)
            if len(names) > MOST_SATELLITES:
                raise InputError(f"must hold at most {MOST_SATELLITES:,} satellites", "parts")
        return names

    @cached_property
    def depth(self) -> int:
        """Nesting depth of mixtures, this one included."""
        return 1 + max((item.depth for item in self.parts if isinstance(item, MixedConstellation)), default=0)

    @cached_property
    def names(self) -> list[str]:
        """Names of all satellites, part by part.

        Raises:
            InputError: A file of a part cannot be read, or a name comes twice.
        """
        names = [name for item in self.parts for name in item.names]
        _check_names("parts", names)
        return names

    def states(self, epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s], GCRS axes, each (n_time, n_satellite, 3).

        Raises:
            InputError: A part has no states at some time.
        """
        return self.states_within(epoch, time_s, None)

    def states_within(self, epoch: Epoch, time_s: ArrayLike, within_s: Span | None) -> tuple[F64, F64]:
        """Return states as `states` does, of which only those within a span matter (`states_of`)."""
        return _side_by_side([("", item) for item in self.parts], epoch, time_s, within_s)

    def notes(self, epoch: Epoch, duration_s: float) -> list[str]:
        """Return warnings about the parts."""
        return [note for item in self.parts for note in _notes_of(item, epoch, duration_s)]


Constellation = Annotated[
    SimpleConstellation | ListedSatellites | SeedPattern | MixedConstellation,
    Field(discriminator="kind"),
]
"""Any kind of constellation."""

complete(MixedConstellation, Constellation=Constellation)


def without_lost(part: Any, epoch: Epoch, first_s: float, last_s: float) -> tuple[Any, list[LeftOut]]:
    """Return a path or a constellation without the satellites that have no state in a span, and these.

    Those of element sets are meant (`TleSatellites.within`); what has none of them is returned itself.
    """
    if isinstance(part, TleSatellites):
        return part.within(epoch, first_s, last_s)
    if not isinstance(part, MixedConstellation):
        return part, []
    found = [without_lost(item, epoch, first_s, last_s) for item in part.parts]
    gone = [item for _, some in found for item in some]
    return (dataclasses.replace(part, parts=tuple(item for item, _ in found)) if gone else part), gone


def invalid_sets(part: Any) -> list[LeftOut]:
    """Return the element sets of a path or a constellation that are not valid, and done without."""
    if isinstance(part, TleSatellites | TleOrbit):
        return list(part.left_out)
    inner = getattr(part, "parts", ()) or [item.orbit for item in getattr(part, "satellites", ())]
    return [one for item in inner for one in invalid_sets(item)]


def _names_without_files(part: Constellation) -> list[str]:
    if isinstance(part, MixedConstellation):
        return part._stated_names
    in_files = isinstance(part, EphemerisSatellites) or (isinstance(part, TleSatellites) and part.file is not None)
    return [] if in_files else part.names


def _check_names(field: str, names: Sequence[str], at_least: int = 1) -> None:
    if len(names) < at_least:
        raise InputError("must hold at least one satellite", field)
    if len(set(names)) != len(names):
        twice = next(name for name, count in Counter(names).items() if count > 1)
        raise InputError(f"names must be unique, got {twice} twice (patterns take a prefix)", field)


def _side_by_side(
    members: Sequence[tuple[str, Propagator]],
    epoch: Epoch,
    time_s: ArrayLike,
    within_s: Span | None = None,
    bodies: I64 | None = None,
) -> tuple[F64, F64]:
    """States of several propagators along the axis of objects: of all objects, or of those of some numbers."""
    positions, velocities = [], []
    first = 0
    for name, propagator in members:
        own = None
        if bodies is not None:
            n_object = len(propagator.names)  # type: ignore[attr-defined]
            own = bodies[(bodies >= first) & (bodies < first + n_object)] - first
            first += n_object
            if not len(own):
                continue
        with errors_at("", name):
            position, velocity = states_of(propagator, epoch, time_s, within_s, own)
        positions.append(position)
        velocities.append(velocity)
    return np.concatenate(positions, axis=1), np.concatenate(velocities, axis=1)


def _turned_about_z(vectors: F64, angle_rad: F64) -> F64:
    """Vectors (n, 3), each turned by its own angle (n,)."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    x, y, z = vectors.T
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=-1)


def _notes_of(item: Any, epoch: Epoch, duration_s: float) -> list[str]:
    notes = getattr(item, "notes", None)
    return [] if notes is None else list(notes(epoch, duration_s))
