"""Scores of tracks: against numbers by hand, and Stone Soup's generators asked directly."""

from datetime import datetime, timedelta

import numpy as np
import pytest
from astropy.table import Table

import warpsim as ws

pytest.importorskip("stonesoup")

from stonesoup.measures import Euclidean
from stonesoup.metricgenerator.ospametric import GOSPAMetric, OSPAMetric
from stonesoup.types.groundtruth import GroundTruthPath
from stonesoup.types.state import State
from stonesoup.types.track import Track

START = datetime(2025, 1, 1, 14, 10)
N_TIME = 10


def times(n=N_TIME):
    return [START + timedelta(seconds=k) for k in range(n)]


def line(x0, v=7.0, n=N_TIME):
    """States x, vx, y, vy, z, vz of a body that flies along x."""
    return np.array([[x0 + v * k, v, 0.0, 0.0, 7e6, 0.0] for k in range(n)])


def table(**bodies):
    """Tracks of named states, one row each time; None leaves one out."""
    rows = [
        (name, when.isoformat(timespec="microseconds"), *vector[[0, 2, 4, 1, 3, 5]])
        for name, vectors in bodies.items()
        for when, vector in zip(times(len(vectors)), vectors, strict=True)
        if np.isfinite(vector).all()
    ]
    names = ("track", "date_obs", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")
    return Table(rows=rows, names=names, dtype=[str, str, *[float] * 6])


def paths(kind=GroundTruthPath, **bodies):
    return {
        kind([State(vector, timestamp=when) for when, vector in zip(times(), vectors, strict=True)], id=name)
        for name, vectors in bodies.items()
    }


EARLIER = {GroundTruthPath([State(line(0.0)[0], timestamp=datetime(year, 1, 1)) for year in (2023, 2024)])}


def test_perfect_tracks():
    truth = paths(a=line(0.0), b=line(5000.0))
    score = ws.evaluate.tracks(table(one=line(0.0), two=line(5000.0)), truth, cutoff_m=100.0)
    assert (score.completeness, score.ambiguity, score.spuriousness) == (1.0, 1.0, 0.0)
    assert score.position_m == score.velocity_m_s == score.ospa_m == score.gospa_m == 0.0
    assert (score.longest_segment, score.track_changes_per_s, score.n_unscored) == (1.0, 0.0, 0)
    assert len(score.by_time) == N_TIME and set(score.by_time["n_track"]) == {2}


def test_numbers_by_hand():
    """One target followed at 30 m, one missed, one track of nothing; cut-off 100 m, order 2."""
    wrong = line(0.0)
    wrong[:, 2] += 30.0
    wrong[:, 1] += 2.0
    truth = paths(a=line(0.0), b=line(5000.0))
    score = ws.evaluate.tracks(table(one=wrong, ghost=line(-9000.0)), truth, cutoff_m=100.0)
    np.testing.assert_allclose(score.by_time["ospa_m"], np.sqrt((30.0**2 + 100.0**2) / 2))
    np.testing.assert_allclose(score.by_time["gospa_m"], np.sqrt(30.0**2 + 100.0**2 / 2 + 100.0**2 / 2))
    np.testing.assert_allclose(score.by_time["localisation"], 900.0)
    np.testing.assert_allclose([score.by_time["missed"], score.by_time["false"]], 5000.0)
    assert (score.completeness, score.ambiguity, score.spuriousness) == (0.5, 1.0, 0.5)
    np.testing.assert_allclose([score.position_m, score.velocity_m_s], [30.0, 2.0])
    assert score.longest_segment == 0.5
    assert "position 30 m" in repr(score)


def test_a_change_of_track():
    first, second = line(0.0), line(0.0)
    first[5:], second[:5] = np.nan, np.nan
    score = ws.evaluate.tracks(table(one=first, two=second), paths(a=line(0.0)), cutoff_m=100.0, switching_m=40.0)
    assert score.completeness == 1.0
    np.testing.assert_allclose(score.longest_segment, 4.0 / 9.0)
    np.testing.assert_allclose(score.track_changes_per_s, 1.0 / 8.0)  # tracked for 4 s, and again
    switching = np.zeros(N_TIME)
    switching[5] = 40.0  # a full switch is two halves
    np.testing.assert_allclose(score.by_time["switching"], switching)
    np.testing.assert_allclose(score.by_time["gospa_m"], switching)


def test_a_gap_is_a_time_without_track():
    broken = line(0.0)
    broken[4] = np.nan
    score = ws.evaluate.tracks(table(one=broken), paths(a=line(0.0)), cutoff_m=100.0)
    assert list(score.by_time["completeness"]) == [1.0] * 4 + [0.0] + [1.0] * 5
    np.testing.assert_allclose(score.completeness, 0.9)
    assert np.isnan(score.by_time["position_m"][4]) and score.position_m == 0.0


def test_no_tracks_at_all():
    score = ws.evaluate.tracks(table()[:0], paths(a=line(0.0)), cutoff_m=100.0)
    assert score.completeness == 0.0 and np.isnan(score.spuriousness) and np.isnan(score.position_m)
    np.testing.assert_allclose(score.by_time["ospa_m"], 100.0)
    np.testing.assert_allclose(score.by_time["gospa_m"], np.sqrt(100.0**2 / 2))


def test_distances_are_those_of_stone_soup():
    """OSPA and GOSPA of random sets, asked one time at a time with Stone Soup's tracks given."""
    rng = np.random.default_rng(3)
    truth = {f"t{k}": line(0.0) + rng.normal(0, 200, (N_TIME, 6)) for k in range(4)}
    found = {f"f{k}": line(0.0) + rng.normal(0, 200, (N_TIME, 6)) for k in range(5)}
    own = paths(Track, **found)
    for order in (1.0, 2.0):
        score = ws.evaluate.tracks(own, paths(**truth), cutoff_m=300.0, order=order)
        again = ws.evaluate.tracks(table(**found), paths(**truth), cutoff_m=300.0, order=order)
        np.testing.assert_allclose(again.by_time["gospa_m"], score.by_time["gospa_m"])
        measure = Euclidean(mapping=(0, 2, 4))
        for k, when in enumerate(times()):
            sets = [[State(vectors[k], timestamp=when) for vectors in bodies.values()] for bodies in (found, truth)]
            ospa = OSPAMetric(p=order, c=300.0, measure=measure).compute_OSPA_distance(*sets).value
            gospa = GOSPAMetric(p=order, c=300.0, measure=measure).compute_gospa_metric(*sets)[0].value
            np.testing.assert_allclose(score.by_time["ospa_m"][k], ospa)
            np.testing.assert_allclose(score.by_time["gospa_m"][k], gospa["distance"])


def test_positions_alone():
    found = table(one=line(0.0, n=2))
    found.keep_columns(["track", "date_obs", "x_m", "y_m", "z_m"])
    truth = paths(a=line(3.0))
    score = ws.evaluate.tracks(found, truth, cutoff_m=10.0, n_confirm=2)
    np.testing.assert_allclose(score.by_time["gospa_m"][:2], 3.0)
    assert score.position_m == 3.0 and np.isnan(score.velocity_m_s) and np.isnan(score.by_time["velocity_m_s"]).all()


def test_times_that_truth_lacks_are_counted():
    score = ws.evaluate.tracks(table(one=line(0.0, n=N_TIME + 3)), paths(a=line(0.0)), cutoff_m=100.0)
    assert score.n_unscored == 3 and score.spuriousness == 0.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"found": table(one=line(0.0))[["track", "date_obs", "x_m"]]}, "found: must have the column y_m"),
        ({"cutoff_m": -1.0}, "cutoff_m: must be a number above 0"),
        ({"order": 0.5}, "order, switching_m: must be at least 1"),
        ({"found": {1}}, "found: must be Stone Soup's tracks or paths"),
        ({"mapping": (0, 2, 9), "found": paths(a=line(0.0))}, "must be Stone Soup's tracks or paths"),
        ({"truth": set()}, "truth: must have states of two times or more"),
        ({"truth": EARLIER}, "found: must have a time in common with the truth, got 2025-01-01T14:10:00.000000"),
    ],
)
def test_bad_input_is_one_line(change, words):
    usual = {"found": table(one=line(0.0)), "truth": paths(a=line(0.0)), "cutoff_m": 100.0}
    with pytest.raises(ws.InputError, match=words):
        ws.evaluate.tracks(**(usual | change))


@pytest.mark.parametrize(
    "zoned", ["2025-01-01T14:10:00Z", "2025-01-01T14:10:00+01:00", "2025-01-01T14:10:00-05:00", "noon"]
)
def test_dates_have_no_zone(zoned):
    found = table(one=line(0.0))
    found["date_obs"] = [zoned] * N_TIME
    with pytest.raises(ws.InputError, match=r"found.date_obs: must be UTC dates, ISO 8601 without a zone"):
        ws.evaluate.tracks(found, paths(a=line(0.0)), cutoff_m=100.0)
