"""Scores of detections: against counts by hand, all assignments of small images, and motmetrics."""

import itertools

import numpy as np
import pytest
from astropy.table import Table

import warpsim as ws

RNG = np.random.default_rng(5)


def truth_of(points, **columns):
    """Truth rows of points (frame, x, y), with light and on the array."""
    frame, x, y = np.array(points, dtype=float).reshape(-1, 3).T
    n = len(frame)
    usual = {
        "frame": frame.astype(int),
        "sensor": np.full(n, "eye"),
        "band": np.full(n, "A"),
        "target": np.array([f"t{k}" for k in range(n)], dtype=str),
        "class": np.full(n, "ball"),
        "in_fov": np.ones(n, dtype=bool),
        "irradiance_w_cm2": np.full(n, 1e-17),
        "snr": np.full(n, 10.0),
        "x_px": x,
        "y_px": y,
    }
    return Table(usual | columns)


def found_of(points, **columns):
    frame, x, y = np.array(points, dtype=float).reshape(-1, 3).T
    n = len(frame)
    usual = {"frame": frame.astype(int), "sensor": np.full(n, "eye"), "band": np.full(n, "A"), "x_px": x, "y_px": y}
    return Table(usual | columns)


def test_an_image_counted_by_hand():
    truth = truth_of([(0, 10, 10), (0, 20, 20), (0, 30, 30), (1, 5, 5)])
    found = found_of([(0, 10.3, 10.4), (0, 29.0, 30.0), (0, 50, 50), (0, 10.0, 10.9)], snr=[9.0, 8.0, 7.0, 6.0])
    score = ws.evaluate.detections(found, truth, radius_px=1.0)
    assert list(score.truth["outcome"]) == ["found", "missed", "found", "missed"]
    assert list(score.found["outcome"]) == ["target", "target", "false", "false"]
    assert list(score.found["truth_row"]) == [0, 2, -1, -1]
    assert (score.precision, score.recall, score.false_alarms_per_image, score.n_image) == (0.5, 0.5, 1.0, 2)
    np.testing.assert_allclose(score.found["distance_px"][:2], [0.5, 1.0])  # the radius itself is within
    np.testing.assert_allclose(score.rms_px, np.sqrt((0.25 + 1.0) / 2))
    np.testing.assert_allclose(score.bias_px, [(0.3 - 1.0) / 2, 0.2], atol=1e-12)
    assert np.isnan(score.chi_square)


def test_perfect_and_empty_inputs():
    points = np.c_[np.repeat([0, 1], 20), RNG.uniform(0, 100, (40, 2))]
    truth = truth_of(points)
    best = ws.evaluate.detections(found_of(points), truth)
    assert (best.precision, best.recall, best.false_alarms_per_image, best.rms_px) == (1.0, 1.0, 0.0, 0.0)
    nothing = ws.evaluate.detections(found_of([]), truth)
    assert np.isnan(nothing.precision) and np.isnan(nothing.rms_px)
    assert (nothing.recall, nothing.false_alarms_per_image) == (0.0, 0.0)
    dark = truth_of(points, irradiance_w_cm2=np.zeros(40))
    clutter = ws.evaluate.detections(found_of(points), dark)
    assert np.isnan(clutter.recall) and clutter.precision == 0.0 and clutter.false_alarms_per_image == 20.0
    assert set(clutter.truth["outcome"]) == {"not counted"}


def best_assignment(distance, radius):
    """Most pairs, then the least sum, by trying all."""
    n, m = distance.shape
    best = (0, 0.0)
    for columns in itertools.permutations([*range(m), *[-1] * n], n):
        pairs = [distance[row, column] for row, column in enumerate(columns) if column >= 0]
        if all(value <= radius for value in pairs):
            best = min(best, (-len(pairs), sum(pairs)))
    return best


def test_assignment_is_the_best_of_all():
    for image in range(12):
        left, right = RNG.uniform(0, 3, (4, 2)), RNG.uniform(0, 3, (4, 2))
        distance = np.linalg.norm(left[:, None] - right, axis=-1)
        found, truth = found_of(np.c_[np.full(4, image), left]), truth_of(np.c_[np.full(4, image), right])
        score = ws.evaluate.detections(found, truth, radius_px=1.2)
        taken = score.found["distance_px"][score.found["outcome"] == "target"]
        np.testing.assert_allclose((-len(taken), taken.sum()), best_assignment(distance, 1.2), atol=1e-12)


def crowded_images(n_image=50):
    """Truth and detections of crowded images: some are lost, some false."""
    truth, found = [], []
    for image in range(n_image):
        points = RNG.uniform(0, 20, (15, 2))
        truth += [(image, *point) for point in points]
        kept = points[RNG.random(15) < 0.7]
        found += [(image, *point) for point in kept + RNG.normal(0, 0.5, kept.shape)]
        found += [(image, *point) for point in RNG.uniform(0, 20, (4, 2))]
    return truth, found


def test_counts_are_those_of_motmetrics():
    mm = pytest.importorskip("motmetrics")
    points, found = crowded_images()
    score = ws.evaluate.detections(found_of(found), truth_of(points), radius_px=1.5)
    truth, found = np.array(points), np.array(found)
    book = mm.MOTAccumulator(auto_id=True)
    for image in range(50):
        here, seen = (np.flatnonzero(rows[:, 0] == image) for rows in (truth, found))
        squares = mm.distances.norm2squared_matrix(truth[here, 1:], found[seen, 1:], max_d2=1.5**2)
        book.update(1000 * image + here, 1000 * image + seen, squares)
    row = mm.metrics.create().compute(book, metrics=["num_detections", "num_misses", "num_false_positives"]).iloc[0]
    total = score.by("sensor")[0]
    assert (total["n_found"], total["n_missed"], total["n_false"]) == tuple(row.astype(int))
    assert 0.5 < score.recall < 0.9  # crowded, so that assignment matters


def test_merged_targets_are_counted_both_ways():
    points = [(0, 10, 10), (0, 10.8, 10), (0, 30, 30), (0, 33, 30), (0, 36, 30), (0, 60, 60), (0, 61, 60), (1, 10, 10)]
    light = np.array([1, 1, 1, 2, 1, 1, 1, 1]) * 1e-17
    clump = [0, 0, 1, 1, 1, 2, 2, 0]  # numbers of an image; the last image's has one target
    found = [(0, 10.1, 10), (0, 33.0, 30.4), (1, 10, 10)]
    score = ws.evaluate.detections(found_of(found), truth_of(points, clump_id=clump, irradiance_w_cm2=light))
    assert list(score.truth["outcome"]) == ["found", "merged", "merged", "found", "merged", "missed", "missed", "found"]
    assert list(score.truth["alone"]) == [False] * 7 + [True]
    assert (score.recall, score.recall_resolved, score.precision) == (6 / 8, 3 / 8, 1.0)
    assert score.rms_px == 0.0  # of the one that is alone
    assert list(score.by("alone")["n_found"]) == [2, 1]
    strict = ws.evaluate.detections(found_of(found), truth_of(points, irradiance_w_cm2=light))
    assert strict.recall == strict.recall_resolved == 3 / 8


def test_a_detection_of_the_whole_clump_is_at_its_centroid():
    truth = truth_of([(0, 10, 10), (0, 14, 10)], clump_id=[3, 3], irradiance_w_cm2=[1e-17, 3e-17])
    score = ws.evaluate.detections(found_of([(0, 13.2, 10), (0, 11, 13)]), truth, radius_px=0.5)
    assert list(score.found["outcome"]) == ["clump", "false"]
    assert list(score.truth["outcome"]) == ["merged", "merged"]
    assert (score.recall, score.recall_resolved, score.precision) == (1.0, 0.0, 0.5)


def test_what_does_not_count_is_neither_right_nor_false():
    truth = truth_of([(0, 10, 10), (0, 20, 20), (0, -1, 5)], snr=[10.0, 1.0, 10.0], in_fov=[True, True, False])
    stars = Table({"frame": [0], "sensor": ["eye"], "x_px": [40.0], "y_px": [40.0]})
    found = found_of([(0, 10, 10), (0, 20, 20), (0, 0, 5), (0, 40, 40.5), (0, 50, 50)])
    score = ws.evaluate.detections(found, truth, least_snr=3.0, ignore=stars)
    assert list(score.found["outcome"]) == ["target", "ignored", "ignored", "ignored", "false"]
    assert (score.recall, score.precision) == (1.0, 0.5)
    stars["band"] = "B"
    assert list(ws.evaluate.detections(found, truth, ignore=stars).found["outcome"])[3] == "false"


def test_curve_is_that_of_the_brighter_detections_alone():
    points, found = crowded_images(20)
    snr = RNG.uniform(3, 20, len(found))
    truth, table = truth_of(points), found_of(found, snr=snr)
    curve = ws.evaluate.detections(table, truth, radius_px=1.5).curve([5.0, 10.0, 15.0, 30.0])
    for row in curve[:3]:
        part = ws.evaluate.detections(table[snr >= row["snr"]], truth, radius_px=1.5)
        assert (row["precision"], row["recall"]) == (part.precision, part.recall)
        assert row["false_alarms_per_image"] == part.false_alarms_per_image
    assert np.isnan(curve["precision"][3]) and curve["recall"][3] == curve["n_detection"][3] == 0
    usual = ws.evaluate.detections(table, truth, radius_px=1.5).curve()
    assert len(usual) == 30 and usual["n_detection"][0] == len(found) and (np.diff(usual["n_detection"]) < 0).all()


N_DRAW = 4000
DRAWN = 5.0 / np.sqrt(2 * 2 * N_DRAW)
"""Five standard deviations of a root mean square over N_DRAW points, in two axes, relative."""


def test_errors_are_those_that_were_drawn():
    sigma = np.where(np.arange(N_DRAW) < N_DRAW // 2, 0.05, 0.2)
    centre = np.c_[np.arange(N_DRAW), np.full((N_DRAW, 2), 50.0)]
    moved = centre + np.c_[np.zeros(N_DRAW), RNG.normal(0.0, 1.0, (N_DRAW, 2)) * sigma[:, None]]
    snr = np.where(sigma == 0.05, 20.0, 5.0)
    found = found_of(moved, snr=snr, x_sigma_px=sigma, y_sigma_px=sigma)
    score = ws.evaluate.detections(found, truth_of(centre, snr=snr), radius_px=2.0)
    assert abs(score.chi_square - 1.0) < 2 * DRAWN
    bins = score.by("snr", [0.0, 10.0, 100.0])
    np.testing.assert_allclose(bins["rms_px"], np.sqrt(2) * np.array([0.2, 0.05]), rtol=np.sqrt(2) * DRAWN)
    assert list(bins["n_false"]) == [0, 0] and list(bins["low"]) == [0.0, 10.0]
    found["x_sigma_px"][0] = np.inf  # says nothing, and is left out
    without = ws.evaluate.detections(found, truth_of(centre, snr=snr), radius_px=2.0)
    assert abs(without.chi_square - score.chi_square) < 0.01
    assert np.abs(score.bias_px).max() < 5 * 0.2 / np.sqrt(N_DRAW)


def test_parts_of_the_truth():
    truth = truth_of([(0, 10, 10), (0, 20, 20), (0, 30, 30)], **{"class": ["cone", "ball", "ball"]})
    score = ws.evaluate.detections(found_of([(0, 20, 20), (0, 70, 70)]), truth)
    classes = score.by("class")
    assert list(classes["class"]) == ["ball", "cone"] and list(classes["recall"]) == [0.5, 0.0]
    assert "n_false" not in classes.colnames  # detections have no class
    assert list(score.by("band")["precision"]) == [0.5]
    assert list(score.by("x_px", [0.0, 15.0, 40.0])["n_found"]) == [0, 1]  # any column of the truth
    assert "recall 0.333" in repr(score)


def test_tables_of_text_files_serve_as_well(tmp_path):
    """Texts for flags, and masked cells for empty ones and numbers that are not known."""
    points, found = crowded_images(5)
    truth = truth_of(points, in_fov=np.arange(75) % 3 > 0)
    truth["x_px"][:4] = np.nan
    table = found_of(found, target=np.where(np.arange(len(found)) % 2, "", "t1"))
    expected = ws.evaluate.detections(table, truth)
    for name, rows in (("found.csv", table), ("truth.csv", truth)):
        rows.write(tmp_path / name)
    again = ws.evaluate.detections(Table.read(tmp_path / "found.csv"), Table.read(tmp_path / "truth.csv"))
    for part in ("found", "truth"):
        assert list(getattr(again, part)["outcome"]) == list(getattr(expected, part)["outcome"])
    truth["in_fov"] = np.where(truth["in_fov"], "true", "false")  # as other libraries write them
    assert list(ws.evaluate.detections(table, truth).found["outcome"]) == list(expected.found["outcome"])
    truth["in_fov"][3] = "yes"
    with pytest.raises(ws.InputError, match=r"truth\.in_fov: must be true or false, got 'yes'"):
        ws.evaluate.detections(table, truth)


def test_pandas_and_dicts_serve_as_well():
    pytest.importorskip("pandas")
    points, found = crowded_images(5)
    table, truth = found_of(found), truth_of(points)
    expected = ws.evaluate.detections(table, truth)
    for form in (Table.to_pandas, lambda rows: {name: np.asarray(rows[name]) for name in rows.colnames}):
        score = ws.evaluate.detections(form(table), form(truth))
        assert list(score.found["truth_row"]) == list(expected.found["truth_row"])


@pytest.mark.ci
def test_truth_of_images_finds_itself():
    frames = ws.Renderer(ws.Scene.load("stss")).render(range(100, 104), sensors=["sat11", "sat27"], bands=["A", "C"])
    truth = frames.truth
    lit = truth[truth["in_fov"] & (truth["irradiance_w_cm2"] > 0)]
    score = ws.evaluate.detections(lit, truth)
    assert score.precision == score.recall == 1.0 and score.rms_px == 0.0 and score.n_image == 16
    assert sum(score.by("sensor")["n_truth"]) == len(lit)


@pytest.mark.ci
def test_detections_drawn_from_truth_score_as_they_were_drawn():
    renderer = ws.Renderer(ws.Scene.load("stss"))
    what = {"sensors": ["sat11", "sat27", "sat21"], "bands": ["A"]}
    truth = renderer.truth(range(60, 66), **what)
    every = ws.detections(renderer, range(60, 66), probability=1.0, **what)
    every = ws.evaluate.detections(every, truth, radius_px=1.5)
    assert every.precision == every.recall == 1.0 and every.recall_resolved < 0.6  # the rest merge
    n_alone = int((every.truth["alone"] & (every.truth["outcome"] == "found")).sum())
    assert abs(every.chi_square - 1.0) < 5.0 / np.sqrt(n_alone)
    assert every.by("resolvable")["n_merged"][1] == 0
    some = ws.detections(renderer, range(60, 66), probability=0.7, clutter_per_image=3.0, **what)
    score = ws.evaluate.detections(some, truth, radius_px=1.5)
    n, n_right = len(every.found), (score.found["outcome"] == "target").sum()
    assert abs(n_right / n - 0.7) < 5 * np.sqrt(0.7 * 0.3 / n)
    assert abs(score.false_alarms_per_image - 3.0) < 5 * np.sqrt(3.0 / score.n_image)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda found, _: found.remove_column("x_px"), "found: must have the column x_px"),
        (lambda _, truth: truth.remove_column("snr"), "truth: must have the column snr"),
        (lambda found, _: found.add_row((7, "eye", "A", 0.0, 0.0)), "found: frame 7 of 'eye' in band 'A' is not in"),
        (lambda found, _: found.add_row((0, "eye", "A", np.nan, 0.0)), "found.x_px: must be finite, got nan in row 1"),
        (lambda _, truth: truth.add_row(truth[0]), "truth: must have each target .* once, got 't0' of rows 0 and 1"),
        (lambda _, truth: truth.remove_rows(slice(0, 3)), "truth: must have rows"),
    ],
)
def test_bad_tables_are_one_line(change, words):
    found, truth = found_of([(0, 1, 1)]), truth_of([(0, 1, 1)])
    change(found, truth)
    with pytest.raises(ws.InputError, match=words.replace("(", r"\(")):
        ws.evaluate.detections(found, truth)


def test_bad_arguments_are_one_line():
    found, truth = found_of([(0, 1, 1)]), truth_of([(0, 1, 1)])
    with pytest.raises(ws.InputError, match="radius_px: must be a number above 0"):
        ws.evaluate.detections(found, truth, radius_px=0.0)
    with pytest.raises(ws.InputError, match="least_snr: must be finite, got nan"):
        ws.evaluate.detections(found, truth, least_snr=np.nan)
    score = ws.evaluate.detections(found, truth)
    with pytest.raises(ws.InputError, match="edges: must ascend"):
        score.by("snr", [3.0, 2.0])
    with pytest.raises(ws.InputError, match="found: must have the column snr"):
        score.curve()
