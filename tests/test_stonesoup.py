"""Readers for Stone Soup: against the scene, rendered counts, and readers of its own."""

import subprocess
import sys
from datetime import datetime, timedelta

import numpy as np
import pytest
from astropy.table import Table

import warpsim as ws

pytest.importorskip("stonesoup")

from stonesoup.models.measurement.nonlinear import CartesianToElevationBearing
from stonesoup.reader.generic import CSVGroundTruthReader
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.state import State

SENSORS = ["sat11", "sat27", "sat21"]
SIGMA_PX = 0.1
C_M_S = 299792458.0
AXES = ("x", "y", "z")


def made_detections(frames, truth, sigma_px, rng):
    """Detections of all rows of the truth, each moved by noise in both axes of its image."""
    rows = []
    for row in truth:
        xy = np.array([row["x_px"], row["y_px"]]) + rng.normal(0.0, sigma_px, 2)
        points = xy + np.array([[0.0, 0.0], [0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
        x, y, z = frames.line_of_sight(row["frame"], row["sensor"], points).direction.T
        ra, dec = np.degrees(np.arctan2(y, x)) % 360.0, np.degrees(np.arcsin(z))
        steps = [((part[1] - part[2]), (part[3] - part[4])) for part in (ra * np.cos(np.radians(dec[0])), dec)]
        covariance = sigma_px**2 * np.array(steps) @ np.array(steps).T
        sigma = np.sqrt(np.diag(covariance))
        rows.append(
            {name: row[name] for name in ("frame", "time_s", "date_obs", "sensor", "band", "target", "snr")}
            | {"x_px": xy[0], "y_px": xy[1], "x_sigma_px": sigma_px, "y_sigma_px": sigma_px}
            | {"ra_deg": ra[0], "dec_deg": dec[0], "ra_cosdec_sigma_deg": sigma[0], "dec_sigma_deg": sigma[1]}
            | {"ra_dec_corr": covariance[0, 1] / sigma.prod() if sigma_px else 0.0}
            | {f"sensor_{axis}_m": row[f"sensor_{axis}_m"] for axis in AXES}
        )
    return Table(rows=rows)


@pytest.fixture(scope="module")
def frames():
    scene = ws.Scene.load("stss").replace(sky__catalog="none", optics__psf="gaussian", optics__sigma_px=0.7)
    return ws.Renderer(scene).render(range(60, 64), sensors=SENSORS, bands=["A", "C"])


@pytest.fixture(scope="module")
def truth(frames):
    return frames.truth


@pytest.fixture(scope="module")
def main(frames, truth):
    """Detections of the main target, without noise, in one band."""
    rows = truth[(truth["target"] == frames.scene.target_names[0]) & (truth["band"] == "A")]
    found = made_detections(frames, rows, 0.0, np.random.default_rng(0))
    for name in ("ra_cosdec_sigma_deg", "dec_sigma_deg"):
        found[name] = SIGMA_PX * frames.scene.camera.fov_deg / frames.scene.camera.n_col
    found["ra_dec_corr"] = np.linspace(-0.5, 0.5, len(found))
    return found


def dates_of(frames):
    start = datetime.fromisoformat(frames.scene.epoch_utc)
    return [start + timedelta(seconds=float(time_s)) for time_s in frames.time_s]


def test_one_scan_for_each_time_sensor_or_image(frames, truth):
    rows = truth[truth["in_fov"] & (truth["irradiance_w_cm2"] > 0)]
    rows = rows[np.isin(rows["target"], frames.scene.target_names[:3])]
    found = made_detections(frames, rows, SIGMA_PX, np.random.default_rng(1))[::-1]  # out of order
    for scan, count in (("time", 4), ("sensor", 12), ("image", 24)):
        scans = list(ws.stonesoup.detections(found, scan=scan))
        times = [when for when, _ in scans]
        assert len(scans) == count and times == sorted(times) and set(times) == set(dates_of(frames))
        assert sum(len(detections) for _, detections in scans) == len(found)
        for when, detections in scans:
            assert {detection.timestamp for detection in detections} == {when}
            for name in {"time": [], "sensor": ["sensor"], "image": ["sensor", "band"]}[scan]:
                assert len({detection.metadata[name] for detection in detections}) == 1


def pairs_of(main):
    """Detections and their rows, one of each scan."""
    scans = ws.stonesoup.detections(main, scan="sensor")
    return [(*scan, row) for (_, scan), row in zip(scans, main.group_by(["date_obs", "sensor"]), strict=True)]


def test_a_detection_says_what_its_row_says(main):
    for detection, row in pairs_of(main):
        angles_deg = np.degrees(detection.state_vector.astype(float).ravel())
        ra_deg = row["ra_deg"] - 360 if row["ra_deg"] > 180 else row["ra_deg"]
        np.testing.assert_allclose(angles_deg, [row["dec_deg"], ra_deg], rtol=1e-14)
        assert {name: detection.metadata[name] for name in ("sensor", "band", "target", "frame")} == {
            "sensor": row["sensor"], "band": "A", "target": row["target"], "frame": row["frame"],
        }  # fmt: skip
        covar = np.degrees(np.degrees(detection.measurement_model.covar()))
        dec, across = row["dec_sigma_deg"], row["ra_cosdec_sigma_deg"] / np.cos(np.radians(row["dec_deg"]))
        both = row["ra_dec_corr"] * dec * across
        np.testing.assert_allclose(covar, [[dec**2, both], [both, across**2]])


LINE_RAD = 1e-9
"""Positions of the scene between nodes, 1e-3 m at 1000 km and more."""


def states_at(scene, found, time_s, h_s=0.05):
    """State vectors of the main target, x, vx, y, vy, z, vz."""
    name = found["target"][0]
    place = [scene.position_m(name, time_s + shift) for shift in (-h_s, 0.0, h_s)]
    return np.stack([place[1], (place[2] - place[0]) / (2 * h_s)], axis=2).reshape(-1, 6)


def test_the_model_says_where_the_target_is_seen(frames, main):
    """Of the state at the time of the frame, not when the light left: 50 m and more between."""
    off = {"light time": [], "none": []}
    for detection, row in pairs_of(main):
        vector = states_at(frames.scenario, main, np.array([row["time_s"]]))[0]
        model = detection.measurement_model
        plain = CartesianToElevationBearing(
            ndim_state=6, mapping=(0, 2, 4), noise_covar=model.noise_covar, translation_offset=model.translation_offset
        )
        for name, function in (("light time", model.function), ("none", plain.function)):
            missed = (function(State(vector)) - detection.state_vector).astype(float).ravel()
            off[name].append(np.abs(missed).max())
    assert max(off["light time"]) < LINE_RAD
    assert max(off["none"]) > 1e-6  # metres at some 1000 km, ten to fifty


DERIVATIVE = 1e-6
"""Differences over 100 m and 1 m/s, relative to the largest: curvature, and rounding of angles."""


@pytest.mark.parametrize("turned", [0.0, 0.7])
def test_the_model_takes_many_states_and_its_derivatives(main, frames, turned):
    _, detections = next(iter(ws.stonesoup.detections(main)))
    model = next(iter(detections)).measurement_model
    model.rotation_offset = StateVector([0.3 * turned, turned, -turned])
    vector = states_at(frames.scenario, main, frames.time_s[:1])[0]
    steps = np.diag([100.0, 1.0] * 3)
    many = model.function(State(StateVectors((vector + steps).T)))
    for column, step in enumerate(steps):
        one = model.function(State(vector + step))
        np.testing.assert_allclose(many[:, [column]].astype(float), one.astype(float), rtol=1e-14)
    ahead, back = (model.function(State(StateVectors((vector + sign * steps).T))) for sign in (1, -1))
    expected = (ahead - back).astype(float) / (2 * steps.max(axis=1))
    got = model.jacobian(State(vector))
    for columns in (slice(0, 6, 2), slice(1, 6, 2)):  # of position, and of velocity: light time smaller
        largest = np.abs(expected[:, columns]).max()
        np.testing.assert_allclose(got[:, columns], expected[:, columns], atol=DERIVATIVE * largest)


def test_without_velocities_it_is_stone_soups_own_model(main):
    for _, detections in ws.stonesoup.detections(main, mapping=(0, 1, 2), velocity_mapping=None, ndim_state=3):
        for detection in detections:
            model, state = detection.measurement_model, State(np.array([1e6, 2e6, 7e6]))
            own = CartesianToElevationBearing(
                3, (0, 1, 2), model.noise_covar, translation_offset=model.translation_offset
            )
            np.testing.assert_array_equal(model.function(state), own.function(state))
            largest = np.abs(own.jacobian(state)).max()
            np.testing.assert_allclose(model.jacobian(state), own.jacobian(state), atol=1e-5 * largest)


STATE_M, STATE_M_S = 2e-3, 2e-3
"""Positions of the scene between nodes, and differences of them."""


def test_ground_truth_at_frames_is_that_of_the_scene(frames, truth):
    paths = set()
    for _, updated in ws.stonesoup.ground_truth(truth):
        paths |= updated
    assert {path.id for path in paths} == set(frames.scene.target_names)
    for path in paths:
        assert [state.timestamp for state in path] == dates_of(frames)  # once, of three sensors and two bands
        assert path[0].metadata["target"] == path.id and path[0].metadata["class"]
        got = np.stack([np.asarray(state.state_vector, dtype=float).ravel() for state in path])
        expected = states_at(frames.scenario, {"target": [path.id]}, frames.time_s)
        np.testing.assert_allclose(got[:, ::2], expected[:, ::2], rtol=0, atol=STATE_M)
        np.testing.assert_allclose(got[:, 1::2], expected[:, 1::2], rtol=0, atol=STATE_M_S)


def test_rows_that_are_read_in_turn_have_times_of_their_own():
    """States at frames are those of the scene all the same: rows of the array are up to 64 ms apart from it."""
    scene = ws.Scene.load("stss").replace(sky__catalog="none", detector__line_time_s=1e-3)
    truth = ws.Renderer(scene).truth([60], sensors=["sat27"], bands=["A"])
    assert np.ptp(truth["row_time_s"]) > 0.01
    ((_, paths),) = ws.stonesoup.ground_truth(truth)
    for path in paths:
        expected = states_at(scene.scenario, {"target": [path.id]}, np.array([600.0]))[0]
        got = np.asarray(path[0].state_vector, dtype=float).ravel()
        np.testing.assert_allclose(got[::2], expected[::2], rtol=0, atol=STATE_M)


def test_ground_truth_at_emission_is_the_truths_own(truth):
    one = truth[(truth["target"] == truth["target"][0]) & (truth["band"] == "A")]
    count = 0
    for when, paths in ws.stonesoup.ground_truth(one, at="emission"):
        (path,) = paths
        delay_s = [
            (datetime.fromisoformat(row["date_obs"]) - when).total_seconds() - 1e3 * row["range_km"] / C_M_S
            for row in one
        ]
        row = one[int(np.argmin(np.abs(delay_s)))]
        assert np.min(np.abs(delay_s)) < 1e-6
        expected = [row[name] for axis in AXES for name in (f"target_{axis}_m", f"target_v{axis}_m_s")]
        np.testing.assert_array_equal(np.asarray(path[-1].state_vector, dtype=float).ravel(), expected)
        count += 1
    assert count == len(one)


def test_stone_soups_reader_reads_the_same_from_a_csv_file(truth, tmp_path):
    """As the documentation says: one image for each time, states at emission under the time of the frame."""
    one = truth[(truth["sensor"] == "sat27") & (truth["band"] == "A")]
    one.write(tmp_path / "truth.csv")
    fields = [name for axis in AXES for name in (f"target_{axis}_m", f"target_v{axis}_m_s")]
    reader = CSVGroundTruthReader(tmp_path / "truth.csv", fields, time_field="date_obs", path_id_field="target")
    late = {}
    for (when, theirs), (same, ours) in zip(reader, ws.stonesoup.ground_truth(one), strict=True):
        assert when == same and {path.id for path in theirs} == {path.id for path in ours}
        by_name = {path.id: np.asarray(path[-1].state_vector, dtype=float).ravel() for path in ours}
        for path in theirs:
            off = by_name[path.id] - np.asarray(path[-1].state_vector, dtype=float).ravel()
            late[path.id, when] = np.linalg.norm(off[::2])
    delay_m = 7000.0 * np.asarray(one["range_km"]) * 1e3 / C_M_S
    assert delay_m.min() / 2 < min(late.values()) and max(late.values()) < 2 * delay_m.max()


def test_stone_soups_reader_reads_detections_from_a_parquet_file(frames, tmp_path):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    from stonesoup.reader.pandas_reader import DataFrameDetectionReader

    found = ws.detections(frames, method="truth")
    ws.labels.write_parquet(found, tmp_path / "found.parquet")
    rows = pandas.read_parquet(tmp_path / "found.parquet")
    reader = DataFrameDetectionReader(dataframe=rows, state_vector_fields=["dec_deg", "ra_deg"], time_field="date_obs")
    for (when, theirs), (same, ours) in zip(reader, ws.stonesoup.detections(found), strict=True):
        assert when == same and len(theirs) == len(ours)
        degrees = sorted(tuple(np.asarray(one.state_vector, dtype=float).ravel()) for one in theirs)
        radians = sorted(tuple(np.asarray(one.state_vector, dtype=float).ravel()) for one in ours)
        np.testing.assert_allclose(np.sin(np.radians(degrees)), np.sin(radians), atol=1e-14)
        assert {one.metadata["target"] for one in theirs} == {one.metadata["target"] for one in ours}


def test_truth_scores_perfect_tracks(frames, truth):
    one = truth[(truth["sensor"] == "sat11") & (truth["band"] == "A")]
    found = one["target", "date_obs"]
    found.rename_column("target", "track")
    place = [frames.scenario.position_m(str(row["target"]), [row["time_s"]])[0] for row in one]
    found["x_m"], found["y_m"], found["z_m"] = np.transpose(place)
    score = ws.evaluate.tracks(found, truth, cutoff_m=100.0)
    assert score.completeness == 1.0 and score.ospa_m < STATE_M and score.position_m < STATE_M


def test_images_are_the_counts(frames, tmp_path):
    counts = np.asarray(frames.counts)
    scans = list(ws.stonesoup.frames(frames, "sat27"))
    assert [when for when, _ in scans] == dates_of(frames)
    for number, (when, images) in enumerate(scans):
        (image,) = images
        assert image.timestamp == when and image.pixels.dtype == np.uint16
        np.testing.assert_array_equal(image.pixels, np.moveaxis(counts[number, 1], 0, -1))
    ws.render_to_folder(frames.scene, tmp_path, frames=frames.frames, sensors=["sat27"], bands=["A", "C"])
    for reader in (ws.stonesoup.frames(tmp_path, "sat27", ["C", "A"]), ws.stonesoup.frames(tmp_path / "sat27_C.fits")):
        again = list(reader)
        assert [when for when, _ in again] == dates_of(frames)
        for number, (_, images) in enumerate(again):
            np.testing.assert_array_equal(next(iter(images)).pixels[..., 0], counts[number, 1, 1])


def test_nothing_of_stone_soup_is_imported_before_it_is_asked_for():
    code = (
        "import sys, warpsim as ws; ws.stonesoup.detections, ws.evaluate.tracks; assert 'stonesoup' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_without_stone_soup_it_is_one_line(main, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    for call in (ws.stonesoup.detections, ws.stonesoup.ground_truth, ws.stonesoup.frames):
        with pytest.raises(ws.InputError, match=r"needs Stone Soup, which the extra `stonesoup` brings"):
            call(main)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"dec_deg": 90.0}, r"found.dec_deg: must be within 89.999 of 0.*got 90.0 in row 0 \(12 such rows\)"),
        ({"dec_sigma_deg": 0.0}, "found.dec_sigma_deg, ra_cosdec_sigma_deg: must be above 0 in row 0"),
        ({"ra_dec_corr": -1.0}, "found.ra_dec_corr: must be between -1 and 1, got -1.0 in row 0"),
        ({"date_obs": "yesterday"}, "found.date_obs: must be UTC dates"),
        ({"sensor_x_m": np.nan}, "found.sensor_x_m: must be finite"),
    ],
)
def test_bad_detections_are_one_line(main, change, words):
    found = main.copy()
    for name, value in change.items():
        found[name] = value
    with pytest.raises(ws.InputError, match=words):
        ws.stonesoup.detections(found)


def test_bad_arguments_are_one_line(frames, main, truth, tmp_path):
    with pytest.raises(ws.InputError, match="scan: must be one of time, sensor, image"):
        ws.stonesoup.detections(main, scan="frame")
    with pytest.raises(ws.InputError, match="truth: must have the column target_x_m"):
        ws.stonesoup.ground_truth(main)
    with pytest.raises(ws.InputError, match="at: must be frame or emission"):
        ws.stonesoup.ground_truth(truth, at="noon")
    with pytest.raises(ws.InputError, match="sensor: must be one of sat11, sat27, sat21"):
        ws.stonesoup.frames(frames)
    with pytest.raises(ws.InputError, match="sensor, bands: must be given for a folder"):
        ws.stonesoup.frames(tmp_path)
    with pytest.raises(ws.InputError, match="is not a warpsim FITS cube"):
        ws.stonesoup.frames(tmp_path / "none.fits")
