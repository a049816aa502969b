"""The scene: an immutable, validated description of what is there and who looks at it.

A scene knows nothing about devices. Everything derived from it (tracks, access) is computed on the host in float64, on
first use, and kept.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, BeforeValidator, Field, TypeAdapter, ValidationError, model_validator
from pydantic_core import ArgsKwargs

from warpsim.arguments import times_s
from warpsim.config.fields import Integer, Positive, as_tuple, closed_interval, rule_error
from warpsim.config.model import config_model, input_error
from warpsim.detector.kinds import Detector
from warpsim.detector.levels import Levels, levels
from warpsim.errors import InputError
from warpsim.optics.camera import Camera
from warpsim.optics.psf import Psf
from warpsim.optics.telescope import Optics
from warpsim.orbit.arc import BallisticArc, UtcText
from warpsim.orbit.epoch import instant, utc_time
from warpsim.orbit.rules import AccessConstraints
from warpsim.quaternion import rotated
from warpsim.radiometry.bands import BANDS
from warpsim.scene.attitudes import table_rows, target_attitudes
from warpsim.scene.carry_over import carry_over
from warpsim.scene.changes import changed
from warpsim.scene.flight_epochs import is_utc, with_epoch, without_flight_epochs
from warpsim.scene.light_terms import LightTerm, light_terms
from warpsim.scene.lighting import Lighting
from warpsim.scene.parts import AnyConstellation, Frames, Release, Sky, TargetGroup, TargetSpec, Text, Trajectory
from warpsim.scene.pointing import Pointing, TablePointing, TrackPointing
from warpsim.scene.rules import check_scene
from warpsim.scene.temperatures import target_temperatures, temperature_tables
from warpsim.target.temperature import TemperatureRows
from warpsim.target.timed_rows import END_SLACK_S

if TYPE_CHECKING:
    from astropy.table import Table
    from astropy.time import Time

    from warpsim.instant import Instant
    from warpsim.orbit.access import AccessInterval
    from warpsim.orbit.rules import MarginFunction
    from warpsim.scene.sights import Sights
    from warpsim.scene.tracks import Tracks
    from warpsim.target.attitude import BodyMotion
    from warpsim.target.attitude_table import AttitudeRows


def _known_band(name: str) -> str:
    if name not in BANDS:
        raise rule_error(f"must be one of {', '.join(BANDS)}")
    return name


ACCESS_STEP_S = 10.0
"""Step of the scan for access [s]."""

BandName = Annotated[str, AfterValidator(_known_band)]


@config_model
class Scene:
    """What is simulated.

    Args:
        epoch_utc: UTC instant that all times count from.
        duration_s: Length of the scene [s].
        frames: When frames are taken.
        constellation: The satellites; each carries one sensor.
        camera: The sensors' geometry.
        optics: The sensors' telescope.
        detector: The sensors' detector.
        bands: Names of the spectral bands each sensor records.
        trajectory: Path of the main target.
        targets: Targets; the first one is the main target, the others are released from it.
        release: How the secondary targets leave the main one.
        groups: Further groups of targets, each with a trajectory of its own.
        pointing: Where the cameras look.
        access_rules: When a sensor can observe the main target.
        sky: The star background.
        lighting: Which light the targets reflect.
        seed: Seed of all randomness, 0 to 2**63 - 1 (the largest integer of TOML).
        name: Short name.
        description: One line about the scene.

    Raises:
        InputError: One line: field, rule, value.
    """

    epoch_utc: UtcText
    duration_s: Positive
    frames: Frames
    constellation: AnyConstellation
    camera: Camera
    optics: Optics
    detector: Detector
    bands: Annotated[tuple[BandName, ...], BeforeValidator(as_tuple)]
    trajectory: Trajectory
    targets: Annotated[tuple[TargetSpec, ...], BeforeValidator(as_tuple)]
    release: Release = Field(default_factory=Release)
    groups: Annotated[tuple[TargetGroup, ...], BeforeValidator(as_tuple)] = ()
    pointing: Pointing = Field(default_factory=TrackPointing)
    access_rules: AccessConstraints = Field(default_factory=AccessConstraints)
    sky: Sky = Field(default_factory=Sky)
    lighting: Lighting = Field(default_factory=Lighting)
    seed: Annotated[Integer, closed_interval(0, 2**63 - 1)] = 0
    name: Text = "scene"
    description: str = ""

    @model_validator(mode="before")
    @classmethod
    def _one_epoch(cls, data: Any) -> Any:
        """Give flights the scene's epoch, so that a scene file states it once."""
        values = data if isinstance(data, dict) else (data.kwargs or {})
        epoch_utc = values.get("epoch_utc")
        if epoch_utc is None or not is_utc(epoch_utc):
            return data  # one complaint about the epoch is enough
        values = {
            name: with_epoch(value, epoch_utc) if name in ("trajectory", "groups", "constellation") else value
            for name, value in values.items()
        }
        return values if isinstance(data, dict) else ArgsKwargs(data.args, values)

    @model_validator(mode="after")
    def _consistent(self) -> Scene:
        check_scene(self)
        return self

    @classmethod
    def load(cls, source: str | os.PathLike[str]) -> Scene:
        """Load a preset by name, or a scene file (.toml or .json).

        Raises:
            InputError: No such preset or file, one of its values breaks a rule, or its trajectory cannot be flown; the
                text begins with the source.
        """
        from warpsim.scene.files import read_scene_data, with_absolute_paths

        where = os.fspath(source)
        scene = cls.from_dict(with_absolute_paths(read_scene_data(source), Path(source).parent), where)
        for number, group in enumerate(scene.groups_of_targets):
            place = "trajectory" if number == 0 else f"groups[{number - 1}].trajectory"
            if isinstance(group.trajectory, BallisticArc):  # solved here, where the file's name is known
                try:
                    group.trajectory.start_velocity_m_s  # noqa: B018
                except InputError as error:
                    raise InputError(f"{place}.{str(error).removeprefix('BallisticArc: ')}").of(where) from None
        try:
            table_rows(scene)
            temperature_tables(scene)
            scene.optics.file_checksums  # noqa: B018  # reads the files
        except InputError as error:
            raise error.of(where) from None
        return scene

    @classmethod
    def from_dict(cls, data: dict[str, Any], where: str = "Scene") -> Scene:
        """Build a scene from nested dicts and lists (the structure of a scene file); `where` begins error texts."""
        from warpsim.scene.files import check_depth

        check_depth(data, where)
        try:
            return _adapter().validate_python(data)
        except ValidationError as error:
            raise input_error(error).of(where) from None

    def to_dict(self) -> dict[str, Any]:
        """Nested dicts and lists of plain values, without what is None; `from_dict` gives back an equal scene."""
        return _without_none(_adapter().dump_python(self, mode="json"))  # type: ignore[no-any-return]

    @property
    def files(self) -> list[str]:
        """Paths of the files that the description names, but for the star catalog."""
        from warpsim.scene.files import named_files

        return named_files(self.to_dict())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a scene file (.toml or .json) that loads back equal.

        Paths of files beside it or below are written relative to its folder, which can travel with them.

        Raises:
            InputError: The path cannot be written, or ends in something else.
        """
        from warpsim.scene.files import with_relative_paths, write_scene_data

        write_scene_data(with_relative_paths(self.to_dict(), Path(path).parent), path)

    def replace(self, **changes: Any) -> Scene:
        """A new scene with some fields changed.

        Fields of parts are reached by double underscores, items of lists by their number:
        `scene.replace(camera__n_row=256, targets__1__count=5)`. None takes an optional value away.

        Raises:
            InputError: A field is unknown or the new scene breaks a rule.
        """
        scene = Scene.from_dict(changed(without_flight_epochs(self.to_dict()), changes))
        carry_over(self, scene)
        return scene

    @property
    def epoch(self) -> Time:
        """The instant that all times count from (astropy Time, UTC)."""
        return utc_time(self.epoch_utc)

    @property
    def instant(self) -> Instant:
        """The epoch as motion takes it, without astropy."""
        return instant(self.epoch_utc)

    @property
    def sensor_names(self) -> list[str]:
        """Names of the sensors, plane by plane."""
        return list(self.constellation.names)

    @property
    def target_names(self) -> list[str]:
        """Names of the single targets, the main target first."""
        return [name for group in self.groups_of_targets for name in group.names]

    @property
    def target_specs(self) -> list[TargetSpec]:
        """The description behind each single target, in the order of target_names."""
        return [spec for group in self.groups_of_targets for spec in group.specs]

    @cached_property
    def groups_of_targets(self) -> tuple[TargetGroup, ...]:
        """All groups: first the one of `trajectory`, `targets` and `release`, then those of `groups`."""
        return TargetGroup("main", self.trajectory, self.targets, self.release), *self.groups

    @property
    def streaks(self) -> bool:
        """Whether light moves over the image during the exposure."""
        return self.detector.streaks and self.detector.exposure_s > 0.0

    @cached_property
    def levels(self) -> dict[str, Levels]:
        """What the detector's noise, saturation and gain are in each band, as irradiance and counts."""
        return {band: levels(self.detector, self.optics, self.camera, band) for band in self.bands}

    def nei_w_cm2(self, band: str) -> float:
        """Noise equivalent irradiance of a pixel in a band of the scene [W/cm2]."""
        return self.levels[band].nei_w_cm2

    def sei_w_cm2(self, band: str) -> float:
        """Saturation equivalent irradiance of a pixel in a band of the scene [W/cm2]."""
        return self.levels[band].sei_w_cm2

    def psf(self, band: str) -> Psf:
        """Point spread function in a band, in pixel widths: the telescope's, its jitter's and the detector's together.

        Raises:
            InputError: Its file cannot be read.
        """
        return self.optics.psf_for(band, self.camera, self.detector.diffusion_px)

    def frame_time_s(self, frames: Sequence[int] | npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        """Times of frames after the epoch [s], shape (n,)."""
        return self.frames.start_s + np.asarray(frames, dtype=np.float64) * self.frames.interval_s

    @cached_property
    def tracks(self) -> Tracks:
        """States of all sensors and targets at the nodes of one time grid."""
        from warpsim.scene.tracks import build_tracks

        return build_tracks(self)

    def position_m(self, name: str, time_s: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Geocentric position of a sensor, a target or "sun" in GCRS axes.

        Args:
            name: One of sensor_names, target_names, or "sun".
            time_s: Times after the epoch [s], shape (n,).

        Returns:
            Positions [m], shape (n, 3).

        Raises:
            InputError: The name is unknown, or a time lies outside the scene (by more than a track's node step).
        """
        from warpsim.orbit.sun import sun_position_m

        times = times_s(time_s)
        if name == "sun":
            return sun_position_m(self.instant, times)
        return self.tracks.state(name, times)[0]

    @cached_property
    def sights(self) -> Sights | None:
        """The rows of a table of directions, read from its file; None for the other kinds of pointing."""
        from warpsim.scene.sights import make_sights

        if not isinstance(self.pointing, TablePointing):
            return None
        try:
            return make_sights(self.pointing, self.sensor_names)
        except InputError as error:
            raise error.within("pointing") from None

    def view_axes(self, sensor: str, time_s: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Camera axes that a sensor is told to take: those of its images, without their jitter.

        Args:
            sensor: One of sensor_names.
            time_s: Times after the epoch [s], shape (n,).

        Returns:
            Rows x (right), y (down) and z (boresight), ICRS axes, shape (n, 3, 3).

        Raises:
            InputError: No such sensor, or a time outside the scene or its table of directions.
        """
        from warpsim.scene.view_axes import commanded_axes

        return commanded_axes(self, sensor, times_s(time_s)).axes

    @cached_property
    def light_terms(self) -> dict[str, LightTerm]:
        """Whether the targets' reflected light has each term (sun, earth, albedo), by how much at most, and why."""
        return light_terms(self)

    @cached_property
    def attitudes(self) -> list[BodyMotion | AttitudeRows]:
        """What turns each single target, in the order of target_names; `.at(time_s)` gives the rotation."""
        return target_attitudes(self)

    def attitude_quaternion(self, name: str, time_s: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Rotation of a target from its body's axes to GCRS axes, at the times asked (no light time).

        Args:
            name: One of target_names.
            time_s: Times after the epoch [s], shape (n,).

        Returns:
            Unit quaternions (x, y, z, w), scalar last, Hamilton's, shape (n, 4); the sign is continuous in time.

        Raises:
            InputError: No such target, or a time lies more than a second outside its attitude table.
        """
        names = self.target_names
        if name not in names:
            raise InputError(f"must be a target ({', '.join(names[:3])}, ...)", "name", name)
        attitude = self.attitudes[names.index(name)]
        try:
            return attitude.at(times_s(time_s))
        except InputError as error:
            raise error.of(name) from None

    def body_axis(self, name: str, time_s: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Direction of a target's body axis, base to apex, in GCRS axes, shape (n, 3); as attitude_quaternion."""
        return rotated(self.attitude_quaternion(name, time_s), np.array([0.0, 0.0, 1.0]))

    @cached_property
    def temperatures(self) -> list[TemperatureRows]:
        """Temperature of each single target, in the order of target_names; `.at(time_s)` gives it."""
        return target_temperatures(self)

    def temperature_k(self, name: str, time_s: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Temperature of a target at the times asked (no light time).

        Args:
            name: One of target_names.
            time_s: Times after the epoch [s], shape (n,).

        Returns:
            Temperatures [K], shape (n,).

        Raises:
            InputError: No such target, a time lies more than a second outside the scene (or its table), or a heat
                balance cannot be followed.
        """
        names = self.target_names
        if name not in names:
            raise InputError(f"must be a target ({', '.join(names[:3])}, ...)", "name", name)
        times = times_s(time_s)
        outside = ~((times >= -END_SLACK_S) & (times <= self.duration_s + END_SLACK_S))
        if outside.any():
            span = f"0 to {self.duration_s:g} s"
            raise InputError(f"time_s: must be within the scene, {span}", name, times[outside][0], "g")
        try:
            return self.temperatures[names.index(name)].at(times)
        except InputError as error:
            raise error.of(name) from None

    def access(
        self,
        target: str | None = None,
        sensors: Sequence[str] | None = None,
        rules: AccessConstraints | None = None,
        custom: Mapping[str, MarginFunction] | None = None,
        step_s: float = ACCESS_STEP_S,
    ) -> Table:
        """When each sensor can observe a target: all rules at once.

        Args:
            target: Name of the target; the main target if left out.
            sensors: Names of sensors; all if left out.
            rules: Instead of the scene's `access_rules`.
            custom: Further rules by name: functions of an `AccessGeometry` that return a signed margin, >= 0 where the
                rule holds (any unit: only the sign counts), or booleans, which show no window shorter than step_s.
            step_s: Step of the scan for changes [s].

        Returns:
            astropy Table with one row per interval: sensor, start_s, end_s (after the epoch), duration_s, ends good to
            1 ms; its meta says target, epoch and rules.

        Raises:
            InputError: An unknown name, or a rule of the user's that gives another shape, or NaN.
        """
        from warpsim.scene import access

        target, sensors = access.chosen_target(self, target), access.chosen_sensors(self, sensors)
        rules = access.chosen_rules(self, rules)
        main = target == self.target_names[0] and sensors == self.sensor_names
        if main and rules == self.access_rules and not custom and step_s == ACCESS_STEP_S:
            intervals = self._intervals
        else:
            intervals = access.intervals_of(self, target, sensors, rules, custom, step_s)
        return access.access_table(self, intervals, target, sensors, rules, custom)

    def access_margins(
        self,
        time_s: npt.ArrayLike,
        target: str | None = None,
        sensors: Sequence[str] | None = None,
        rules: AccessConstraints | None = None,
        custom: Mapping[str, MarginFunction] | None = None,
    ) -> dict[str, npt.NDArray[np.float64]]:
        """Signed margin of every access rule, >= 0 where it holds; each of shape (n_sensor, n_time).

        Args:
            time_s: Times after the epoch [s], shape (n_time,).
            target: As for `access`, like the others.
            sensors: Their order is that of the rows.
            rules: Instead of the scene's.
            custom: Further rules by name.
        """
        from warpsim.scene import access

        times = times_s(time_s)
        target, sensors = access.chosen_target(self, target), access.chosen_sensors(self, sensors)
        return access.margins_of(self, times, target, sensors, access.chosen_rules(self, rules), custom)

    def sunlit_fraction(self, name: str, time_s: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Share of the Sun's disc that a sensor or target sees past the Earth, 0 to 1, shape (n,).

        The Earth is the WGS84 ellipsoid without air, the Sun's disc uniform.

        Raises:
            InputError: The name is unknown, or a time lies outside the scene.
        """
        from warpsim.scene.access import sunlit_fraction_of

        return sunlit_fraction_of(self, name, times_s(time_s))

    def eclipses(self, name: str, step_s: float = ACCESS_STEP_S) -> Table:
        """When a sensor or target is in the Earth's shadow.

        Returns:
            astropy Table with one row per passage: start_s and end_s of the penumbra, umbra_start_s and umbra_end_s
            (NaN without umbra), all after the epoch, good to 1 ms and within the scene, and duration_s.

        Raises:
            InputError: The name is unknown.
        """
        from warpsim.scene.access import eclipse_table

        return eclipse_table(self, name, step_s)

    @cached_property
    def sensors_with_access(self) -> list[str]:
        """Sensors that can observe the main target at some time, in the order of sensor_names."""
        seen = {interval.sensor for interval in self._intervals}
        return [name for number, name in enumerate(self.sensor_names) if number in seen]

    def has_access(self, sensor: str, time_s: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Whether a sensor can observe the main target at given times, shape (n,).

        Raises:
            InputError: No such sensor.
        """
        if sensor not in self.sensor_names:
            raise InputError("must be a sensor of the scene", "sensor", sensor)
        times = times_s(time_s)
        seen = np.zeros(times.shape, dtype=bool)
        number = self.sensor_names.index(sensor)
        for interval in self._intervals:
            if interval.sensor == number:
                seen |= (times >= interval.start_s) & (times <= interval.end_s)
        return seen

    @cached_property
    def _intervals(self) -> list[AccessInterval]:
        from warpsim.scene.access import intervals_of

        target, sensors = self.target_names[0], self.sensor_names
        return intervals_of(self, target, sensors, self.access_rules, None, ACCESS_STEP_S)


def _adapter() -> TypeAdapter[Scene]:
    global _ADAPTER
    if _ADAPTER is None:
        _ADAPTER = TypeAdapter(Scene)
    return _ADAPTER


_ADAPTER: TypeAdapter[Scene] | None = None


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value
