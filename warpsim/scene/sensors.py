"""Sensors: a camera with its telescope and detector, and the satellites that carry one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from pydantic import Field, model_validator

from warpsim.config.fields import Count, Name, NonNegative, Positive
from warpsim.config.model import config_model
from warpsim.detector.detectors import Detector
from warpsim.errors import InputError, errors_at
from warpsim.optics.camera import Camera
from warpsim.optics.telescope import Optics
from warpsim.orbit.access_constraints import AccessConstraints
from warpsim.scene.band_descriptions import BandNames
from warpsim.scene.pointing import ALL, Pointings, Satellites, TrackPointing, satellites_of
from warpsim.scene.short_form import with_paths

LARGEST_VIEW = 2**29
"""Pixels of one sensor's image in all bands: array strides are 32-bit numbers of bytes."""
LONGEST_READ_OUT_S = 10.0
"""As of an exposure: orbits are known somewhat beyond the scene's ends."""


@config_model
class Frames:
    """Times of frames. Frame k is at start_s + k * interval_s, its mid-exposure.

    Args:
        count: Frames of the whole sequence.
        interval_s: Time between frames [s].
        start_s: Time of frame 0 after the scene's epoch [s].
    """

    count: Count
    interval_s: Positive
    start_s: NonNegative = 0.0


@config_model
class Sensor:
    """A kind of sensor, and which satellites carry one.

    The sensor of a satellite that carries one is called as the satellite is, `sat11`; those of a satellite with several
    are `sat11.wide`, `sat11.narrow`.

    Args:
        name: Of the kind; unique in the scene.
        camera: Array and field of view.
        optics: Telescope.
        detector: Detector.
        bands: The spectral bands that it records: names of shipped ones (`warpsim.bands()`) and of those that the
            scene describes (`band`), or Band objects, which join these.
        pointing: Where it looks: one kind of pointing, or several of which each says on which satellites.
        on: Satellites that carry one: "all", names, or patterns with * and ?.
        frames: When it takes frames; as the scene's when left out.
        access_rules: When it can observe a target; as the scene's when left out.
    """

    name: Name
    camera: Camera
    optics: Optics
    detector: Detector
    bands: BandNames
    pointing: Pointings = Field(default_factory=lambda: (TrackPointing(),))
    on: Satellites = (ALL,)
    frames: Frames | None = None
    access_rules: AccessConstraints | None = None

    @model_validator(mode="after")
    def _bands(self) -> Sensor:
        if not self.bands:
            raise InputError("must name at least one band", "bands")
        if len(set(self.bands)) != len(self.bands):
            names = ", ".join(str(getattr(band, "name", band)) for band in self.bands)
            raise InputError(f"must not repeat, got {names}", "bands")
        n_value = self.camera.n_row * self.camera.n_col * len(self.bands)
        if n_value >= LARGEST_VIEW:
            raise InputError("n_row * n_col * number of bands must be below 2**29", "camera", n_value)
        line_s = self.detector.line_time_s
        if self.camera.n_row * abs(line_s) > LONGEST_READ_OUT_S:
            rule = f"must read all {self.camera.n_row} rows within {LONGEST_READ_OUT_S:g} s"
            raise InputError(rule, "detector.line_time_s", line_s, "g")
        if not self.pointing:
            raise InputError("must hold at least one", "pointing")
        return self

    @property
    def streaks(self) -> bool:
        """Return whether light moves over the image during the exposure."""
        return self.detector.streaks and self.window_s > 0.0

    @property
    def rolls(self) -> bool:
        """Return whether rows are exposed one after the other."""
        return self.detector.line_time_s != 0.0

    @property
    def window_s(self) -> float:
        """Return how long light is collected for a frame [s]: from its first row's exposure to its last one's."""
        return self.detector.exposure_s + self.camera.n_row * abs(self.detector.line_time_s)


def sensor_instances(sensors: Sequence[Sensor], satellites: Sequence[str]) -> list[list[tuple[str, int]]]:
    """Return the name, and the index of the satellite, of each sensor of each kind."""
    carriers = []
    for path, sensor in with_paths("sensors", sensors):
        with errors_at(path):
            carriers.append(satellites_of(sensor.on, satellites))
    n_carried = Counter(index for some in carriers for index in some)
    return [
        [(satellites[i] if n_carried[i] == 1 else f"{satellites[i]}.{sensor.name}", i) for i in some]
        for sensor, some in zip(sensors, carriers, strict=True)
    ]
