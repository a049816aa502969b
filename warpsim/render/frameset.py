"""Result of a render call: images, and the truth beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from warpsim_kernels.pointing import BORESIGHT_REPLACED, SLEWING, UP_REPLACED

from warpsim.arguments import above_zero, whole_number
from warpsim.errors import InputError
from warpsim.orbit.sun import earth_states
from warpsim.render.artifacts import artifact_images, artifact_table
from warpsim.render.batch import Columns, HostColumns
from warpsim.render.contributions import CHUNK_BYTES, MOST_TARGETS, TargetLight, brightest_targets
from warpsim.render.device_scene import DeviceScene
from warpsim.render.image_stack import ImageStack
from warpsim.render.line_of_sight import LineOfSight, ViewGeometry
from warpsim.render.point_images import PointImages, sources_of_views
from warpsim.render.request import Request
from warpsim.render.truth import star_table, target_positions_m, truth_table
from warpsim.scene.description import SceneDescription
from warpsim.scene.instrument import Instrument
from warpsim.scene.provenance import provenance
from warpsim.scene.scenario import Scenario

if TYPE_CHECKING:
    from astropy.table import Table
    from astropy.wcs import WCS


@dataclass(frozen=True, repr=False)
class FrameSet:
    """Rendered frames. Image axes: (frame, sensor, band, row, column)."""

    scenario: Scenario
    instrument: Instrument
    """The kind of the sensors."""
    _numbers: Sequence[int]
    sensors: list[str]
    """Sensor names along the second axis."""
    bands: list[str]
    """Band names along the third axis."""
    counts: ImageStack
    """Counts, uint16, shape (frame, sensor, band, row, column)."""
    signal_w_cm2: ImageStack | None
    """Noiseless irradiance per pixel [W/cm2], float32, same shape; None unless keep_signal."""
    _device_scene: DeviceScene
    _columns: Columns
    _star_lists: list[tuple[npt.NDArray[Any], ...]] | None

    def one_frame(self, index: int) -> FrameSet:
        """The frame at an index along the first axis, as a set of its own that shares the memory; -1 for the last."""
        n_sensor, index = len(self.sensors), range(len(self.counts))[index]
        first, end = index * n_sensor, (index + 1) * n_sensor
        return replace(
            self,
            _numbers=self._numbers[index : index + 1],
            counts=self.counts.part(index, index + 1),
            signal_w_cm2=None if self.signal_w_cm2 is None else self.signal_w_cm2.part(index, index + 1),
            _columns=self._columns.part(first, end),
            _star_lists=self._star_lists and self._star_lists[first:end],
        )

    @cached_property
    def frames(self) -> list[int]:
        """Frame numbers along the first axis, in the order asked for."""
        return list(self._numbers)

    @property
    def scene(self) -> SceneDescription:
        """The description that the frames are of."""
        return self.scenario.scene

    def __repr__(self) -> str:
        names = f"{len(self.frames)} frames, {len(self.sensors)} sensors, bands {' '.join(self.bands)}"
        return f"FrameSet({self.scene.name}: {names}, {self.counts.shape[3]} x {self.counts.shape[4]} pixels)"

    @property
    def time_s(self) -> npt.NDArray[np.float64]:
        """Times of the frames after the epoch [s], shape (n_frame,)."""
        return self.instrument.frame_time_s(self.frames)

    @property
    def axes_icrs(self) -> npt.NDArray[np.float64]:
        """Camera axes as rows x, y, z, errors of pointing included, shape (frame, sensor, 3, 3)."""
        return self._of_views("axes")

    @property
    def up_replaced(self) -> npt.NDArray[np.bool_]:
        """Whether `pointing.up` lay along the line of sight, so that another served, shape (frame, sensor)."""
        return self._view_flag(int(UP_REPLACED))

    @property
    def boresight_replaced(self) -> npt.NDArray[np.bool_]:
        """Whether what is tracked had no direction, so that the camera looks along its motion, (frame, sensor)."""
        return self._view_flag(int(BORESIGHT_REPLACED))

    @property
    def slewing(self) -> npt.NDArray[np.bool_]:
        """Whether the camera turns to its next step, or settles after the turn, shape (frame, sensor)."""
        return self._view_flag(int(SLEWING))

    @property
    def _asked(self) -> Request:
        return Request(self.scenario, self.instrument, self.frames, self.sensors, self.bands)

    def _view_flag(self, bit: int) -> npt.NDArray[np.bool_]:
        return np.asarray((self._of_views("flags") & bit) != 0)

    def _of_views(self, name: str) -> npt.NDArray[Any]:
        """Field of the view records, (frame, sensor, ...)."""
        values = self._host.views[name]
        return values.reshape(len(self.frames), len(self.sensors), *values.shape[1:])

    @property
    def velocity_m_s(self) -> npt.NDArray[np.float64]:
        """Barycentric velocity of the sensors, ICRS axes [m/s], shape (frame, sensor, 3)."""
        return self._of_views("velocity_m_s")

    @property
    def barycentric_m(self) -> npt.NDArray[np.float64]:
        """Barycentric position of the sensors, ICRS axes [m], shape (frame, sensor, 3)."""
        return self._from_earth("barycentric_m")

    @property
    def heliocentric_m(self) -> npt.NDArray[np.float64]:
        """Heliocentric position of the sensors, ICRS axes [m], shape (frame, sensor, 3)."""
        return self._from_earth("heliocentric_m")

    def _from_earth(self, name: str) -> npt.NDArray[np.float64]:
        earth_m = getattr(earth_states(self.scenario.epoch, self.time_s), name)
        return np.asarray(earth_m[:, None] + self._of_views("position_m"))

    def wcs(self, frame: int, sensor: str) -> WCS:
        """TAN WCS of one image (astropy): apparent ICRS directions against zero-based pixel coordinates.

        Raises:
            InputError: The frame or the sensor was not rendered.
        """
        from warpsim.optics.wcs import tan_wcs

        if frame not in self.frames or sensor not in self.sensors:
            raise InputError(f"frame {frame} of {sensor!r} was not rendered", "wcs")
        axes = self.axes_icrs[self.frames.index(frame), self.sensors.index(sensor)]
        return tan_wcs(axes, self.instrument.sensor.camera)

    def line_of_sight(
        self, frame: int, sensor: str, xy_px: npt.ArrayLike, range_m: npt.ArrayLike | None = None, axes: str = "gcrs"
    ) -> LineOfSight:
        """Lines in space along which the light at positions of an image came: the inverse of `project`.

        The camera's axes are those of the image, errors of pointing included; aberration is taken out, by the sensor's
        barycentric velocity and the Earth's, so that directions are geometric in the geocentric frame. Light took
        range / c: what is seen was there at `emission_time_s`, and has moved on since. Where rows are read one after
        the other (`line_time_s`), a line is that of the time of its row; jitter from row to row is not in it.

        Args:
            frame: One of `frames`.
            sensor: One of `sensors`.
            xy_px: Positions in the image, zero-based, (n, 2) or (2,).
            range_m: How far away the light came from, one number or (n,) [m]; positions are not known when left out.
            axes: "gcrs", or "itrs" for Earth-fixed axes at the time of the image.

        Returns:
            Origin, unit directions, and with ranges where and when the light left.

        Raises:
            InputError: The image was not rendered, or a value is out of range.
        """
        return self._view_geometry("line_of_sight", frame, sensor).line_of_sight(xy_px, range_m, axes)

    def project(
        self, frame: int, sensor: str, position_m: npt.ArrayLike
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
        """Return where light falls in an image that left from positions in space: the inverse of `line_of_sight`.

        Args:
            frame: One of `frames`.
            sensor: One of `sensors`.
            position_m: Where the light left, geocentric, GCRS axes [m], (n, 3) or (3,). A moving body was there one
                light time before the frame.

        Returns:
            xy_px, (n, 2), NaN behind the camera; in_front, (n,). What the Earth hides is not asked.

        Raises:
            InputError: The image was not rendered, or a position is not finite.
        """
        return self._view_geometry("project", frame, sensor).project(position_m)

    def _view_geometry(self, what: str, frame: int, sensor: str) -> ViewGeometry:
        """Camera and state of the sensor of an image; InputError, as of `what`, if it was not rendered."""
        view, _ = self.image_numbers(what, frame, sensor, self.bands[0])
        time_s, axes = float(self.time_s[self.frames.index(frame)]), np.asarray(self._host.views[view]["axes"])
        return ViewGeometry(self.scenario, self.instrument, sensor, time_s, axes)

    @cached_property
    def truth(self) -> Table:
        """One row per frame x sensor x band x target (astropy Table); see the documentation of its columns.

        x_px and y_px are the very numbers that the light was drawn at. snr is irradiance / NEI; snr_peak counts only
        the light in the target's own pixel. left_out_w_cm2 is the light beyond the target's stamp.
        """
        return truth_table(self._asked, self._device_scene, self._host)

    @cached_property
    def stars(self) -> Table:
        """One row per frame x sensor x star whose light reaches the image (astropy Table).

        Raises:
            InputError: The frames were rendered without keep_stars.
        """
        if self._star_lists is None:
            raise InputError("render with keep_stars=True to have them", "stars")
        return self._with_provenance(star_table(self._asked, self._device_scene, self._star_lists))

    @cached_property
    def artifacts(self) -> Table:
        """One row per pixel of an image with charge of a radiation hit, or that flickers and is on (astropy Table).

        Columns: frame, sensor, band, kind ("hit" or "flicker"), x_px and y_px (column and row), irradiance_w_cm2, that
        which would give the same charge, and of a detector in electrons charge_e.
        """
        own = self._device_scene.artifacts
        return self._with_provenance(artifact_table(own, self._asked))

    def _with_provenance(self, table: Table) -> Table:
        """Say in a table's meta where it is from."""
        table.meta |= provenance(self.scene)
        return table

    def artifact_mask(self, frame: int, sensor: str, band: str) -> npt.NDArray[np.uint8]:
        """Pixels of one image that hold charge which is not light: 1 by radiation hits, 2 by flicker, 3 both, else 0.

        Args:
            frame: One of `frames`.
            sensor: One of `sensors`.
            band: One of `bands`.

        Returns:
            The mask, shape (row, column).

        Raises:
            InputError: The image was not rendered.
        """
        _, number = self.image_numbers("artifact_mask", frame, sensor, band)
        mask = np.zeros(self.counts.shape[3:], dtype=np.uint8)
        if (own := self._device_scene.artifacts) is not None:
            for kind, levels in artifact_images(own, frame, self.instrument.index(sensor)).items():
                mask |= np.where(levels[number] > 0, np.uint8(kind), np.uint8(0))
        return mask

    def contributions_w_cm2(
        self, frame: int, sensor: str, band: str, chunk_bytes: int = CHUNK_BYTES
    ) -> npt.NDArray[np.float32]:
        """Noiseless light of each target in one image, drawn as in the image itself, streaks included.

        Together with the light of the stars they add up to `signal_w_cm2`, but for float32 rounding.

        Args:
            frame: One of `frames`.
            sensor: One of `sensors`.
            band: One of `bands`.
            chunk_bytes: Planes drawn at a time, beside the result; at least one.

        Returns:
            Light per pixel [W/cm2], shape (target, row, column), in the order of scene.target_names; 0 for targets
            behind the Earth, not deployed or absent.

        Raises:
            InputError: The image was not rendered.
        """
        view, number = self.image_numbers("contributions_w_cm2", frame, sensor, band)
        return self.target_light.contributions(number, view, whole_number("chunk_bytes", chunk_bytes, 1))

    def target_mask(self, frame: int, sensor: str, band: str, least_nei: float = 1.0) -> npt.NDArray[np.uint16]:
        """The target that gives most light to each pixel of one image, among those that give enough of it.

        Args:
            frame: One of `frames`.
            sensor: One of `sensors`.
            band: One of `bands`.
            least_nei: Light that counts, in one pixel and of one target, over the NEI.

        Returns:
            0 where no target gives that much, k for target k - 1 of scene.target_names; shape (row, column).

        Raises:
            InputError: The image was not rendered, least_nei is not above 0, or there are more than 65,535 targets.
        """
        view, _ = self.image_numbers("target_mask", frame, sensor, band)
        (mask,) = self._masks(band, np.array([view]), least_nei)
        return np.asarray(mask)

    def target_masks(self, least_nei: float = 1.0) -> npt.NDArray[np.uint16]:
        """The target_mask of every image, shape (frame, sensor, band, row, column); quicker than one by one.

        Args:
            least_nei: Light that counts, in one pixel and of one target, over the NEI.

        Raises:
            InputError: least_nei is not above 0, or there are more than 65,535 targets.
        """
        views = np.arange(len(self.frames) * len(self.sensors))
        masks = np.empty(self.counts.shape, dtype=np.uint16)
        for number, band in enumerate(self.bands):
            masks[:, :, number] = self._masks(band, views, least_nei).reshape(masks[:, :, number].shape)
        return masks

    def _masks(self, band: str, views: npt.NDArray[np.int64], least_nei: float) -> npt.NDArray[np.uint16]:
        least_w_cm2 = above_zero("least_nei", least_nei) * self.instrument.nei_w_cm2(band)
        if self._device_scene.n_target > MOST_TARGETS:
            raise InputError(f"must be of at most {MOST_TARGETS} targets", "target_mask", self._device_scene.n_target)
        return brightest_targets(self.target_light, self.bands.index(band), views, least_w_cm2)

    def image_numbers(self, what: str, frame: int, sensor: str, band: str) -> tuple[int, int]:
        """Numbers of the view (frame x sensor) and the band of an image; InputError, as of `what`, if there is none."""
        if frame not in self.frames or sensor not in self.sensors or band not in self.bands:
            raise InputError(f"frame {frame} of {sensor!r} in band {band!r} was not rendered", what)
        view = self.frames.index(frame) * len(self.sensors) + self.sensors.index(sensor)
        return view, self.bands.index(band)

    @cached_property
    def target_light(self) -> TargetLight:
        """Light of each target alone."""
        camera = self.instrument.sensor.camera
        return TargetLight(self._device_scene, self._host, (camera.n_row, camera.n_col))

    def point_images(self, what: str, with_stars: bool) -> PointImages:
        """Sources of all views as they were drawn, targets first; InputError, as of `what`, if stars were not kept."""
        if with_stars and self._star_lists is None and len(self._device_scene.stars.index.star_row):
            raise InputError("render with keep_stars=True: stars move, too", what)
        return sources_of_views(self._device_scene, self._host, self._star_lists if with_stars else None)

    @property
    def target_position_m(self) -> npt.NDArray[np.float64]:
        """Where targets were when their light left, geocentric, GCRS axes [m], (frame * sensor, target, 3).

        NaN for absent ones.
        """
        return target_positions_m(self._asked, self._host)

    @property
    def target_vector_m(self) -> npt.NDArray[np.float64]:
        """The same from the sensor [m]."""
        return np.asarray(self.target_position_m - self._host.views["position_m"][:, None])

    @cached_property
    def _host(self) -> HostColumns:
        return HostColumns(self._columns, self.counts.ready)
