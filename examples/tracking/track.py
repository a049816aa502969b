"""Where does a body fly that several sensors see? An unscented Kalman filter in Stone Soup, of a file of detections.

    python examples/tracking/track.py detections.csv [more.csv ...]

writes detections.track.csv. It reads tables of detections as text, and imports Stone Soup, NumPy and SciPy alone. Of
the first scans it takes what is in the middle of each image, where the cameras point; from then on the detection
nearest to the prediction.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from stonesoup.base import Property
from stonesoup.dataassociator.neighbour import NearestNeighbour
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.measures import Mahalanobis
from stonesoup.models.base import TimeVariantModel
from stonesoup.models.measurement.nonlinear import CartesianToElevationBearing
from stonesoup.models.transition.nonlinear import GaussianTransitionModel
from stonesoup.predictor.kalman import UnscentedKalmanPredictor
from stonesoup.reader.generic import CSVDetectionReader
from stonesoup.types.angle import Bearing, Elevation
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState, State
from stonesoup.types.track import Track
from stonesoup.updater.kalman import UnscentedKalmanUpdater

N_START = 4
"""Scans of the first state: a fit of them all."""

GATE_SIGMA = 6.0
"""Distance from the prediction up to which a detection is the body's."""

NOISE_M2_S3 = 1e-9
"""Spectral density of the acceleration that the model of motion leaves out: a centimetre in 100 s."""

CENTRE_PX = 63.5
"""Where the cameras of 128 x 128 pixels point, column and row."""

C_M_S, GM_M3_S2, RADIUS_M, J2 = 299792458.0, 3.986004418e14, 6378137.0, 1.0826267e-3


class FreeFlight(GaussianTransitionModel, TimeVariantModel):
    """Free flight about the Earth, J2 included: states x, vx, y, vy, z, vz, GCRS axes [m, m/s]."""

    pole: np.ndarray = Property(doc="Unit vector of the Earth's pole of date.")
    ndim_state = 6

    def acceleration(self, position):
        """Gravity at positions (3, n) [m/s2]."""
        square = (position**2).sum(axis=0)
        height = self.pole @ position
        bulge = 1.5 * J2 * RADIUS_M**2 / square
        along = position * (1.0 + bulge * (1.0 - 5.0 * height**2 / square)) + 2.0 * bulge * np.outer(self.pole, height)
        return -GM_M3_S2 * along / square**1.5

    def function(self, state, noise=False, time_interval=None, **kwargs):
        """States after an interval, by one step of Runge and Kutta's each 5 s."""
        vectors = np.asarray(state.state_vector, dtype=float)
        n_step = max(1, int(np.ceil(abs(time_interval.total_seconds()) / 5.0)))
        h = time_interval.total_seconds() / n_step
        x, v = vectors[::2], vectors[1::2]
        for _ in range(n_step):
            a = self.acceleration(x)
            b = self.acceleration(x + h / 2 * v)
            c = self.acceleration(x + h / 2 * v + h**2 / 4 * a)
            d = self.acceleration(x + h * v + h**2 / 2 * b)
            x, v = x + h * v + h**2 / 6 * (a + b + c), v + h / 6 * (a + 2 * b + 2 * c + d)
        moved = state.state_vector.copy()
        moved[::2], moved[1::2] = x, v
        return moved if noise is None or isinstance(noise, bool) else moved + noise

    def covar(self, time_interval=None, **kwargs):
        """Covariance of white acceleration over an interval."""
        t = abs(time_interval.total_seconds())
        return np.kron(np.eye(3), NOISE_M2_S3 * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]]))


class SeenDirection(CartesianToElevationBearing):
    """Elevation (declination) and bearing (right ascension) of where the body was when its light left."""

    def _function(self, state, noise=False, **kwargs):
        vectors = np.asarray(state.state_vector, dtype=float)
        left = vectors[::2]
        for _ in range(3):
            delay_s = np.linalg.norm(left - np.asarray(self.translation_offset, dtype=float), axis=0) / C_M_S
            left = vectors[::2] - delay_s * vectors[1::2]
        moved = state.state_vector.copy()
        moved[::2] = left
        return super()._function(State(moved), noise, **kwargs)


def read_scans(path):
    """Lists of detections, one for each time and sensor, in the order of time."""
    scans = []
    for when, rows in CSVDetectionReader(path, ["dec_deg", "ra_deg"], time_field="date_obs"):
        by_sensor = {}
        for row in rows:
            by_sensor.setdefault(row.metadata["sensor"], []).append(measured(row, when))
        scans += [by_sensor[sensor] for sensor in sorted(by_sensor)]
    return scans


def measured(row, when):
    """A detection with the model of its measurement."""
    dec, ra = np.radians(np.asarray(row.state_vector, dtype=float).ravel())
    said = {name: float(text) for name, text in row.metadata.items() if name.endswith(("_deg", "_corr", "_m", "_px"))}
    sigma = np.radians([said["dec_sigma_deg"], said["ra_cosdec_sigma_deg"] / np.cos(dec)])
    both = said["ra_dec_corr"] * sigma.prod()
    model = SeenDirection(
        ndim_state=6,
        mapping=(0, 2, 4),
        noise_covar=np.array([[sigma[0] ** 2, both], [both, sigma[1] ** 2]]),
        translation_offset=np.array([[said[f"sensor_{axis}_m"]] for axis in "xyz"]),
    )
    place = {"x_px": said["x_px"], "y_px": said["y_px"]}
    return Detection([Elevation(dec), Bearing(ra)], timestamp=when, measurement_model=model, metadata=place)


def nearest_point(detections):
    """The point nearest to the lines of sight of detections of one time."""
    matrix, right = np.zeros((3, 3)), np.zeros(3)
    for detection in detections:
        dec, ra = np.asarray(detection.state_vector, dtype=float).ravel()
        line = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
        across = np.eye(3) - np.outer(line, line)
        matrix += across
        right += across @ np.asarray(detection.measurement_model.translation_offset, dtype=float).ravel()
    return np.linalg.solve(matrix, right)


def first_state(times, motion):
    """State and covariance at the last of some times, fitted to the detections of all of them."""
    ends = [times[0][0].timestamp, times[-1][0].timestamp]
    first, last = nearest_point(times[0]), nearest_point(times[-1])
    span_s = (ends[1] - ends[0]).total_seconds()
    pull = motion.acceleration(((first + last) / 2)[:, None])[:, 0]
    guess = np.stack([last, (last - first) / span_s + pull * span_s / 2], axis=1).ravel()
    inverse_roots = [
        [np.linalg.inv(np.linalg.cholesky(detection.measurement_model.noise_covar)) for detection in detections]
        for detections in times
    ]

    def missed(vector):
        angles = []
        for detections, roots in zip(times, inverse_roots, strict=True):
            then = motion.function(State(vector.reshape(6, 1)), time_interval=detections[0].timestamp - ends[1])
            for detection, root in zip(detections, roots, strict=True):
                difference = detection.measurement_model.function(State(then)) - detection.state_vector
                angles.append(root @ np.asarray(difference, dtype=float).ravel())
        return np.concatenate(angles)

    fit = least_squares(missed, guess, x_scale=np.tile([1e3, 10.0], 3), diff_step=1e-6)
    return GaussianState(fit.x[:, None], np.linalg.inv(fit.jac.T @ fit.jac), timestamp=ends[1])


def in_the_middle(scan):
    """Detections of a scan within a pixel of where the camera points, at most one."""
    off_px = [np.hypot(one.metadata["x_px"] - CENTRE_PX, one.metadata["y_px"] - CENTRE_PX) for one in scan]
    nearest = int(np.argmin(off_px))
    return [scan[nearest]] if off_px[nearest] < 1.0 else []


def follow(scans):
    """The track of the body that the cameras point at."""
    whens = sorted({scan[0].timestamp for scan in scans})
    start = [
        [one for scan in scans if scan[0].timestamp == when for one in in_the_middle(scan)] for when in whens[:N_START]
    ]
    centuries = (whens[0].year - 2000.0) / 100.0
    tilt = np.radians(2004.19 / 3600.0) * centuries  # precession of the pole in GCRS axes
    motion = FreeFlight(pole=np.array([np.sin(tilt), 0.0, np.cos(tilt)]))
    cubature = {"alpha": 1.0, "beta": 0.0, "kappa": 0.0}
    predictor, updater = UnscentedKalmanPredictor(motion, **cubature), UnscentedKalmanUpdater(**cubature)
    hypothesiser = DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=GATE_SIGMA)
    associator = NearestNeighbour(hypothesiser)
    track = Track([first_state(start, motion)])
    for scan in scans:
        when = scan[0].timestamp
        if when <= whens[N_START - 1]:
            continue
        hypothesis = associator.associate({track}, set(near(track, scan, predictor)), when)[track]
        track.append(updater.update(hypothesis) if hypothesis else hypothesis.prediction)
    return track


def near(track, scan, predictor):
    """The three detections nearest to the prediction: the others need no distance."""
    ahead = predictor.predict(track[-1], timestamp=scan[0].timestamp)
    angles = scan[0].measurement_model.function(State(ahead.state_vector))
    off = [np.abs(np.asarray(one.state_vector - angles, dtype=float)).max() for one in scan]
    return [scan[number] for number in np.argsort(off)[:3]]


def write_track(track, path):
    """One row per time: the state after its last scan, and the standard deviation of each number."""
    names = ["x_m", "vx_m_s", "y_m", "vy_m_s", "z_m", "vz_m_s"]
    with Path(path).open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["track", "date_obs", *names, *(f"{name.split('_')[0]}_sigma" for name in names)])
        for state in track.last_timestamp_generator():
            when = state.timestamp.isoformat(timespec="microseconds")
            vector = np.asarray(state.state_vector, dtype=float).ravel()
            writer.writerow(["main", when, *vector, *np.sqrt(np.diag(state.covar))])


if __name__ == "__main__":
    for path in map(Path, sys.argv[1:]):
        write_track(follow(read_scans(path)), path.with_suffix(".track.csv"))
