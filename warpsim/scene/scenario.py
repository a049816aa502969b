"""The scenario: data derived from a scene on the host in float64, each part computed on first use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from warpsim.arguments import some_names, times_s
from warpsim.arrays import F64
from warpsim.errors import InputError, errors_at
from warpsim.orbit.access_constraints import AccessConstraints, MarginFunction
from warpsim.orbit.sun import earth_states, eclipses, sunlit_fraction
from warpsim.quaternion import rotated
from warpsim.scene.band_descriptions import needs_file
from warpsim.scene.bodies import SceneBodies
from warpsim.scene.checks import (
    check_access_target,
    check_instances,
    check_instrument,
    check_paths,
    check_satellites,
    check_target_files,
    check_unique,
)
from warpsim.scene.description import SceneDescription
from warpsim.scene.instrument import Instrument
from warpsim.scene.left_out import left_out_table
from warpsim.scene.roster import Roster, check_rules, table_of_times
from warpsim.scene.short_form import with_paths
from warpsim.scene.target_access import ACCESS_STEP_S, target_margins
from warpsim.target.timed_rows import END_SLACK_S

if TYPE_CHECKING:
    from astropy.table import Table


class Scenario(SceneBodies):
    """Derived data of a scene: tracks, attitudes, temperatures, pointing, access, noise levels.

    Args:
        scene: The description. It is checked as far as files must be read and orbits solved for that.

    Raises:
        InputError: A file cannot be read or does not fit, or a path cannot be propagated.
    """

    def __init__(self, scene: SceneDescription) -> None:
        super().__init__(scene)
        scene = self.scene
        self._check_names()
        check_paths(scene.constellation, scene.groups, self.epoch, scene.duration_s)
        check_target_files(scene.groups)
        _ = self._attitude_tables, self._temperature_tables  # checks them
        self._check_instruments()

    def _check_names(self) -> None:
        """Check that names given by files are unique, and that sensors are on existing satellites."""
        satellites = self.satellite_names
        for path, sensor in with_paths("sensors", self.scene.sensors):
            with errors_at(path):
                check_satellites(sensor, satellites)
        names = [*satellites, *self.target_names, "sun"]
        check_unique(names)
        check_instances(self.scene.sensors, satellites, names)

    def _check_instruments(self) -> None:
        """Check that pointing is possible and covers the frames, and that PSF images can be read."""
        check_access_target(self.scene.access_target, self.targets, self.group_names)
        own = self.scene.band
        for path, instrument in with_paths("sensors", list(self.instruments.values())):
            from_files = [band for name, band in instrument.bands.items() if needs_file(name, own)]
            check_instrument(instrument.sensor, from_files, path)
            with errors_at(path):
                instrument.check_frames(instrument.frame_time_s([0, instrument.frames.count - 1]))
                if instrument.slews:
                    _ = [instrument.turns(index) for index in range(len(instrument.names))]
                with errors_at("optics.psf_file"):
                    instrument.sensor.optics.file_checksums  # noqa: B018  # reads the files

    def __repr__(self) -> str:
        return f"Scenario({self.scene.name}: {len(self.sensor_names)} sensors, {len(self.target_names)} targets)"

    @cached_property
    def left_out(self) -> Table:
        """Element sets that the scene does without, as a table: part of the scene, name, norad_id, location, reason.

        Those that are not valid, and those of satellites without a state at some time of the scene; norad_id is -1
        where it is not known.
        """
        return left_out_table(self._left_out)

    @cached_property
    def instruments(self) -> dict[str, Instrument]:
        """Instruments by name: each kind of sensor with its derived data."""
        sensors = zip(self.scene.sensors, self._instances, strict=True)
        return {sensor.name: Instrument(sensor, own, self) for sensor, own in sensors}

    @property
    def instrument(self) -> Instrument:
        """The only kind of sensor.

        Raises:
            InputError: There are several.
        """
        kinds = list(self.instruments)
        if len(kinds) != 1:
            rule = f"the scene has {len(kinds)} kinds of sensors ({', '.join(kinds)}); take scenario.instruments[...]"
            raise InputError(rule, "instrument")
        return self.instruments[kinds[0]]

    @cached_property
    def sensor_names(self) -> list[str]:
        """Names of all sensors, kind by kind."""
        return [name for instrument in self.instruments.values() for name in instrument.names]

    @cached_property
    def roster(self) -> Roster:
        """Sensors and targets by name."""
        return Roster(self.instruments, self.targets, self.group_names)

    def instrument_of(self, sensor: str) -> Instrument:
        """Return the kind that a sensor, or a name of a kind, belongs to.

        Raises:
            InputError: There is no such sensor.
        """
        return self.roster.instrument_of(sensor)

    def position_m(self, name: str, time_s: npt.ArrayLike) -> F64:
        """Return the geocentric position of a sensor, a satellite, a target or "sun" in GCRS axes.

        Args:
            name: One of sensor_names, satellite_names, target_names, or "sun".
            time_s: Times after the epoch [s], shape (n,).

        Returns:
            Positions [m], shape (n, 3). Before its release a target is where its main target is.

        Raises:
            InputError: The name is unknown, or a time lies outside the scene (by more than a track's node step).
        """
        times = times_s(time_s)
        if name == "sun":
            return earth_states(self.epoch, times).sun_m
        return self.tracks.state(self._body(name), times)[0]

    def _body(self, name: str) -> str:
        """The name of a track: a sensor's is that of its satellite."""
        for instrument in self.instruments.values():
            if name in instrument.index_of:
                return instrument.satellite_of(name)
        return name

    def _eclipsed_body(self, name: str) -> str:
        """Name of the track of a sensor, a satellite or a target; the Sun has no eclipses."""
        body = self._body(name)
        if body not in self.satellite_names and body not in self.target_names:
            known = some_names([*self.target_names[:1], *self.sensor_names])
            raise InputError(f"must be a sensor or a target ({known})", "name", name)
        return body

    def view_axes(self, sensor: str, time_s: npt.ArrayLike) -> F64:
        """Return the camera axes that a sensor is commanded to take: those of its images, without errors of pointing.

        Args:
            sensor: One of sensor_names.
            time_s: Times after the epoch [s], shape (n,).

        Returns:
            Rows x (right), y (down) and z (boresight), ICRS axes, shape (n, 3, 3).

        Raises:
            InputError: No such sensor, or a time outside the scene or its table of directions.
        """
        instrument, times = self.instrument_of(sensor), times_s(time_s)
        instrument.check_frames(times)
        return instrument.commanded_axes(instrument.index(sensor), times).axes

    def attitude_quaternion(self, name: str, time_s: npt.ArrayLike) -> F64:
        """Return the rotation of a target from its body's axes to GCRS axes, at the times asked (no light time).

        Args:
            name: One of target_names.
            time_s: Times after the epoch [s], shape (n,).

        Returns:
            Unit quaternions (x, y, z, w), scalar last, Hamilton's, shape (n, 4); the sign is continuous in time.

        Raises:
            InputError: No such target, or a time lies more than a second outside its attitude table.
        """
        attitude = self.attitudes[self.roster.target(name)]
        with errors_at("", name):
            return attitude.at(times_s(time_s))

    def body_axis(self, name: str, time_s: npt.ArrayLike) -> F64:
        """Return the direction of a target's body axis, base to apex, in GCRS axes, (n, 3); as attitude_quaternion."""
        return rotated(self.attitude_quaternion(name, time_s), np.array([0.0, 0.0, 1.0]))

    def temperature_k(self, name: str, time_s: npt.ArrayLike) -> F64:
        """Return the temperature of a target at the times asked (no light time).

        Args:
            name: One of target_names.
            time_s: Times after the epoch [s], shape (n,).

        Returns:
            Temperatures [K], shape (n,); NaN where the target is absent.

        Raises:
            InputError: No such target, a time lies more than a second outside the scene (or its table), or a heat
                balance cannot be integrated.
        """
        target, times = self.roster.target(name), times_s(time_s)
        duration_s = self.scene.duration_s
        outside = ~((times >= -END_SLACK_S) & (times <= duration_s + END_SLACK_S))
        if outside.any():
            rule = f"must be within the scene, 0 to {duration_s:g} s"
            raise InputError(rule, "time_s", times[outside][0], "g").of(name)
        there = self.tracks.exist(target, times)
        kelvin = np.full(times.shape, np.nan)
        with errors_at("", name):
            kelvin[there] = self.temperatures[target].at(times[there])
        return kelvin

    def select_sensors(self, names: str | Sequence[str] | None) -> list[str]:
        """Return names of sensors for names of sensors and of kinds, and for patterns like "sat11.*"; all for None.

        Raises:
            InputError: There is no such sensor, or none at all.
        """
        return self.roster.select_sensors(names)

    def access(
        self,
        target: str | None = None,
        sensors: str | Sequence[str] | None = None,
        rules: AccessConstraints | None = None,
        custom: Mapping[str, MarginFunction] | None = None,
        step_s: float = ACCESS_STEP_S,
    ) -> Table:
        """Return the intervals in which each sensor can observe a target: all constraints hold.

        Args:
            target: Name of a target or a group; for each sensor what the scene's access_target says when left out.
            sensors: Names of sensors, or of kinds; all if left out.
            rules: Constraints instead of the scene's `access_rules`.
            custom: Further constraints by name: functions of an `AccessGeometry` that return a signed margin, >= 0
                where the constraint holds (any unit: only the sign counts), or booleans, which show no window shorter
                than step_s.
            step_s: Step of the scan for changes [s].

        Returns:
            astropy Table with one row per interval: sensor, target, start_s, end_s (after the epoch), duration_s, ends
            good to 1 ms; its meta holds target, epoch and constraints: those of the first sensor's kind, and of
            all kinds.

        Raises:
            InputError: An unknown name, or a custom constraint that gives another shape, or NaN.
        """
        return self.roster.access(target, sensors, rules, custom, step_s, self.scene.epoch_utc)

    def access_margins(
        self,
        time_s: npt.ArrayLike,
        target: str | None = None,
        sensors: str | Sequence[str] | None = None,
        rules: AccessConstraints | None = None,
        custom: Mapping[str, MarginFunction] | None = None,
    ) -> dict[str, F64]:
        """Return the signed margin of every access constraint, >= 0 where it holds; each of shape (n_sensor, n_time).

        Args:
            time_s: Times after the epoch [s], shape (n_time,).
            target: Name of the target; the first group's main target when left out.
            sensors: Names of sensors of one kind, or of a kind; their order is that of the rows.
            rules: Constraints instead of the sensors'.
            custom: Further constraints by name.

        Raises:
            InputError: As `access`, or sensors of several kinds.
        """
        times, chosen = times_s(time_s), self.roster.distinct_sensors(sensors)
        check_rules(rules, custom)
        instrument = self.instrument_of(chosen[0])
        if any(name not in instrument.index_of for name in chosen):
            raise InputError(f"must be of one kind ({', '.join(self.instruments)})", "sensors", chosen)
        if not self.targets:
            raise InputError("must be a target of the scene, which has none", "target", target)
        index = 0 if target is None else self.roster.target(target, "target")
        observers = instrument.observers([instrument.index(name) for name in chosen])
        return target_margins(self.tracks, observers, index, rules or instrument.access_rules, times, custom)

    def has_access(self, sensor: str, time_s: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Return whether a sensor can observe what its access counts by at given times, shape (n,).

        Raises:
            InputError: No such sensor.
        """
        instrument = self.instrument_of(sensor)
        return instrument.has_access(instrument.index(sensor), times_s(time_s))

    @property
    def sensors_with_access(self) -> list[str]:
        """Sensors that can observe what their access counts by at some time, in the order of sensor_names."""
        return [name for instrument in self.instruments.values() for name in instrument.sensors_with_access]

    def sunlit_fraction(self, name: str, time_s: npt.ArrayLike) -> F64:
        """Return the fraction of the Sun's disc that a sensor or target sees past the Earth, 0 to 1, shape (n,).

        The Earth is the WGS84 ellipsoid without air, the Sun's disc uniform.

        Raises:
            InputError: The name is unknown, or a time lies outside the scene.
        """
        times, name = times_s(time_s), self._eclipsed_body(name)
        return sunlit_fraction(self.position_m(name, times), self.position_m("sun", times), self.tracks.pole_icrs)

    def eclipses(self, name: str, step_s: float = ACCESS_STEP_S) -> Table:
        """Return the passages of a sensor or target through the Earth's shadow.

        Returns:
            astropy Table with one row per passage: start_s and end_s of the penumbra, umbra_start_s and umbra_end_s
            (NaN without umbra), all after the epoch, good to 1 ms and within the scene, and duration_s.

        Raises:
            InputError: The name is unknown.
        """
        tracks, body = self.tracks, self._eclipsed_body(name)
        if body in self.target_names:
            position_m = tracks.position_function(self.target_names.index(body))
        else:
            position_m = tracks.of(body).position_at_m
        found = eclipses(position_m, tracks.sun.position_at_m, tracks.pole_icrs, self.scene.duration_s, step_s)
        rows = [(*eclipse, eclipse.end_s - eclipse.start_s) for eclipse in found]
        names = ("start_s", "umbra_start_s", "umbra_end_s", "end_s", "duration_s")
        return table_of_times(rows, names, {"name": name, "epoch_utc": self.scene.epoch_utc})
