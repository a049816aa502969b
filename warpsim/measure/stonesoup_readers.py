"""Readers and models in Stone Soup's classes; importing it imports Stone Soup."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.buffered_generator import BufferedGenerator
from stonesoup.models.measurement.nonlinear import CartesianToElevationBearing
from stonesoup.reader.base import DetectionReader, FrameReader, GroundTruthReader
from stonesoup.types.angle import Bearing, Elevation
from stonesoup.types.array import CovarianceMatrix, StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
from stonesoup.types.sensordata import ImageFrame

from warpsim.arrays import F64
from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.measure.paths import States
from warpsim.measure.rows import naive_utc


class LineOfSightAngles(CartesianToElevationBearing):  # type: ignore[misc]
    """Elevation and bearing of where a body was when its light left, of its state at the time that the light came in.

    Geocentric positions and velocities, GCRS axes [m, m/s]: elevation is declination, bearing right ascension. The body
    goes straight on during the light time; its acceleration is left out, 4 mm at 10,000 km. Derivatives are exact:
    Stone Soup's differences (1.9) step by 1e-8 m where a coordinate is negative, and are 10 % off.
    """

    velocity_mapping: Sequence[int] | None = Property(
        default=(1, 3, 5), doc="Rows of the velocity in the state vector; None for light without light time."
    )

    def _seen(self, state: Any) -> tuple[F64, F64, F64]:
        """Where light left, from the sensor (3, n), velocities (3, n), light times (n,)."""
        vectors = np.asarray(state.state_vector, dtype=np.float64)
        away_m = vectors[list(self.mapping)] - np.asarray(self.translation_offset, dtype=np.float64)
        velocity_m_s, delay_s, seen_m = np.zeros_like(away_m), np.zeros(away_m.shape[1]), away_m
        if self.velocity_mapping is not None:
            velocity_m_s = vectors[list(self.velocity_mapping)]
            for _ in range(3):  # each leaves v / c of the error
                delay_s = np.linalg.norm(seen_m, axis=0) / SPEED_OF_LIGHT_M_S
                seen_m = away_m - delay_s * velocity_m_s
        return seen_m, velocity_m_s, delay_s

    def _function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        seen = copy.copy(state)
        vectors = state.state_vector.copy()
        vectors[list(self.mapping), :] = self._seen(state)[0] + np.asarray(self.translation_offset, dtype=np.float64)
        seen.state_vector = vectors
        return super()._function(seen, noise, **kwargs)

    def jacobian(self, state: Any, **kwargs: Any) -> F64:
        """Derivatives of elevation and bearing by the state, (2, ndim_state)."""
        seen_m, velocity_m_s, delay_s = (part[..., 0] for part in self._seen(state))
        x, y, z = self.rotation_matrix @ seen_m
        square, flat = x**2 + y**2 + z**2, np.hypot(x, y)
        elevation = np.array([-x * z / flat, -y * z / flat, flat]) / square
        bearing = np.array([-y, x, 0.0]) / flat**2
        by_seen = np.stack([elevation, bearing]) @ self.rotation_matrix
        # seen + velocity |seen| / c = position - sensor, and its differential.
        stretch = np.eye(3) + np.outer(velocity_m_s, seen_m / np.sqrt(square)) / SPEED_OF_LIGHT_M_S
        by_position = by_seen @ np.linalg.inv(stretch)
        result = np.zeros((2, self.ndim_state))
        result[:, list(self.mapping)] = by_position
        if self.velocity_mapping is not None:
            result[:, list(self.velocity_mapping)] = -delay_s * by_position
        return result


class TableDetectionReader(DetectionReader):  # type: ignore[misc]
    """Detections of a table, scan by scan, each with the model of its measurement."""

    scans: Sequence[tuple[datetime, Sequence[int]]] = Property(doc="Time and rows of each scan.")
    values: Mapping[str, Any] = Property(
        doc="Arrays, one row each: angles_rad (elevation, bearing), covar_rad2 (2, 2), sensor_m (3)."
    )
    metadata: Sequence[Mapping[str, Any]] = Property(doc="What else is known of each row.")
    model: Mapping[str, Any] = Property(doc="Arguments of the models: mapping, velocity_mapping and ndim_state.")

    @BufferedGenerator.generator_method  # type: ignore[untyped-decorator]
    def detections_gen(self) -> Iterator[tuple[datetime, set[Detection]]]:
        """Yield the time and the detections of each scan."""
        for when, rows in self.scans:
            yield when, {self._detection(when, row) for row in rows}

    def _detection(self, when: datetime, row: int) -> Detection:
        elevation, bearing = (float(angle) for angle in self.values["angles_rad"][row])
        model = LineOfSightAngles(
            **self.model,
            noise_covar=CovarianceMatrix(self.values["covar_rad2"][row]),
            translation_offset=StateVector(self.values["sensor_m"][row]),
        )
        vector = StateVector([Elevation(elevation), Bearing(bearing)])
        return Detection(vector, timestamp=when, measurement_model=model, metadata=dict(self.metadata[row]))


class TableGroundTruthReader(GroundTruthReader):  # type: ignore[misc]
    """Paths of targets, state by state."""

    states: States = Property(doc="States in the order of time.")
    metadata: Sequence[Mapping[str, Any]] = Property(doc="What else is known of each state.")

    @BufferedGenerator.generator_method  # type: ignore[untyped-decorator]
    def groundtruth_paths_gen(self) -> Iterator[tuple[datetime, set[GroundTruthPath]]]:
        """Yield each time, and the paths that have a new state then."""
        paths = {name: GroundTruthPath(id=str(name)) for name in np.unique(self.states.name)}
        rows = zip(naive_utc(self.states.when), self.states.name, self.states.vector, self.metadata, strict=True)
        for when, group in itertools.groupby(rows, key=lambda row: row[0]):
            updated = set()
            for _, name, vector, metadata in group:
                paths[name].append(GroundTruthState(StateVector(vector), timestamp=when, metadata=dict(metadata)))
                updated.add(paths[name])
            yield when, updated


class ImageReader(FrameReader):  # type: ignore[misc]
    """Images of one sensor, each of one time."""

    images: Any = Property(doc="Function without arguments: an iterator of time and pixels (row, column, band).")

    @BufferedGenerator.generator_method  # type: ignore[untyped-decorator]
    def frames_gen(self) -> Iterator[tuple[datetime, set[ImageFrame]]]:
        """Yield each time, and its image."""
        for when, pixels in self.images():
            yield when, {ImageFrame(pixels, timestamp=when)}
