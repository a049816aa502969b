"""Recipes of data sets: what they take, what they refuse, and what is drawn from them."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import warpsim as ws
from warpsim.cli import main
from warpsim.config.distributions import Choice, LogUniform, Normal, Uniform, WholeNumbers
from warpsim.dataset.layout import (
    ImageKey,
    _chosen_clip,
    _clips,
    check_extremes,
    draw_sequence,
    drawn_values,
    identity_of,
    image_id,
    shards_of,
    split_of,
    varied,
)
from warpsim.dataset.recipe import with_absolute_choices
from warpsim.dataset.writers import _TarArchive
from warpsim.files import write_fits_table
from warpsim.output.output_folder import OutputFolder, difference

U = (np.arange(20_000) + 0.5) / 20_000


def drawn(distribution):
    return np.array([distribution.value(u) for u in U])


@pytest.mark.parametrize(
    ("distribution", "expected"),
    [
        (Uniform((-2.0, 6.0)), stats.uniform(-2, 8)),
        (LogUniform((1e-18, 1e-15)), stats.loguniform(1e-18, 1e-15)),
        (Normal((300.0, 5.0), cut_sigma=2.0), stats.truncnorm(-2, 2, 300, 5)),
    ],
)
def test_values_follow_their_distribution(distribution, expected):
    # Evenly spaced u: the empirical distribution is off by half a step.
    assert stats.kstest(drawn(distribution), expected.cdf).statistic < 1 / len(U)


def test_whole_numbers_are_all_as_likely_ends_included():
    values, number = np.unique(drawn(WholeNumbers((3, 7))), return_counts=True)
    assert values.tolist() == [3, 4, 5, 6, 7] and number.tolist() == [4000] * 5


def test_choices_follow_their_weights():
    values = [Choice(["airy", {"a": 1}, 7], weights=(1, 0, 3)).value(u) for u in U]
    assert {str(value) for value in values} == {"airy", "7"}
    assert values.count(7) == 15_000


@pytest.mark.parametrize("u", [2.0**-54, 0.5, 1 - 2.0**-53])
def test_extremes_are_extremes(u):
    for distribution in (Uniform((-1.0, 0.1)), LogUniform((0.3, 0.7)), Normal((0.1, 0.3)), WholeNumbers((-3, 3))):
        low, high = distribution.extremes
        assert low <= distribution.value(u) <= high
    assert Choice(["a", "b"]).value(u) in ("a", "b")


SAMPLE = {
    "detector": {"nei_w_cm2": {"log_uniform": [1e-18, 1e-17]}},
    "targets.1.count": {"integer": [1, 12]},
    "optics__psf": {"choice": ["airy", "gaussian"], "weights": [3, 1]},
}


def recipe(**changes):
    given = {"scene": "stss", "n_sequence": 12, "n_frame": 4, "interval_s": 0.5, "bands": "A"}
    return ws.Recipe(**(given | changes))


def test_fields_may_be_written_in_all_ways_that_scenes_know():
    assert list(recipe(sample=SAMPLE).distributions) == ["detector.nei_w_cm2", "targets.1.count", "optics.psf"]


def test_a_recipe_survives_its_dict_and_json():
    made = recipe(sample=SAMPLE, sensors=["sat11", "sat27"], split={"train": 3, "test": 1}, preview="gif")
    assert ws.Recipe.from_dict(json.loads(json.dumps(made.to_dict()))) == made


@pytest.mark.parametrize("name", ["saved.toml", "saved.json"])
def test_a_saved_recipe_loads_back_equal_and_travels_with_its_files(tmp_path, monkeypatch, name):
    home = tmp_path / "home"
    home.mkdir()
    scene = ws.Scene.load("stss").replace(sky__catalog=str(home / "stars.fits"))
    given = {
        "sensors": ["sat11", "sat27"],
        "split": {"train": 3, "test": 1},
        "crossings": {"main": {"range_km": [1, 2]}},
    }
    made = recipe(scene=scene, sample=SAMPLE, **given)
    made.save(home / name)
    monkeypatch.chdir("/")
    assert ws.Recipe.load(home / name) == made
    moved = home.rename(tmp_path / "moved")
    assert ws.Recipe.load(moved / name).scene.sky.catalog == str(moved / "stars.fits")
    with pytest.raises(ws.InputError, match=r"must end in \.toml or \.json"):
        made.save(tmp_path / "recipe.yaml")


def test_recipes_come_from_files(tmp_path):
    ws.Scene.load("stss").replace(name="mine").save(tmp_path / "scene.toml")
    path = tmp_path / "recipe.toml"
    path.write_text(
        'scene = "scene.toml"\nn_sequence = 5\n[split]\nall = 1\n'
        "[sample]\ndetector.nei_w_cm2 = { uniform = [1e-18, 2e-18] }\n"
        "[sample.release]\nspeed_m_s = { choice = [[2.0, 3.0], [4.0, 5.0]] }\n"
    )
    made = ws.Recipe.load(path, n_frame=7)
    assert (made.scene.name, made.n_sequence, made.n_frame) == ("mine", 5, 7)
    assert list(made.distributions) == ["detector.nei_w_cm2", "release.speed_m_s"]
    assert ws.Recipe.load(tmp_path / "scene.toml").scene.name == "mine"
    assert ws.Recipe.load("stss").n_sequence == 10


def test_a_file_that_is_neither_scene_nor_recipe_is_refused(tmp_path):
    (tmp_path / "x.toml").write_text("n_sequence = 3\n")
    with pytest.raises(ws.InputError, match=r"x\.toml: must be a scene, or a recipe with a field `scene`"):
        ws.Recipe.load(tmp_path / "x.toml")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"n_sequence": 0}, "Recipe: n_sequence: must be >= 1, got 0"),
        ({"n_frame": 10_000}, "n_frame: must fit into duration_s = 1614, take 4999.5 s"),
        ({"n_sensor": 29}, "n_sensor: must be at most 28, the sensors to draw from, got 29"),
        ({"n_sensor": 2, "sensors": ["sat11"]}, "n_sensor: must be at most 1"),
        ({"sensors": ["moon"]}, "sensors: must be among those of the scene, got 'moon'"),
        ({"bands": ["A", "A"]}, "bands: must name one or more, each once"),
        ({"bands": ["Z"]}, "bands: must be among those of the scene, got 'Z'"),
        ({"format": "gif"}, "format: must be 'fits', 'fits-frames', 'png', 'tiff', 'zarr' or 'webdataset', got 'gif'"),
        ({"split": {"train": 0.0}}, "split: must name splits and their sizes, not all 0"),
        ({"split": {"annotations": 1.0}}, "split: must not be called annotations"),
        ({"split": {"a/b": 1.0}}, "must be letters, digits"),
        ({"sample": {"frames.count": {"integer": [1, 2]}}}, "sample.frames.count: frames cannot be sampled"),
        ({"sample": {"seed": {"integer": [1, 2]}}}, "sample.seed: seed cannot be sampled"),
        ({"sample": {"detector.nei_w_cm2": {"uniform": [2, 1]}}}, "uniform: must be [lowest, highest], got [2.0,"),
        ({"sample": {"detector.nei_w_cm2": {"log_uniform": [0, 1]}}}, "must be > 0, got 0"),
        ({"sample": {"detector.nei_w_cm2": {"gauss": [0, 1]}}}, "sample: must have one of uniform, log_uniform,"),
        ({"sample": {"detector.nei_w_cm2": 3}}, "integer, choice for detector.nei_w_cm2, as in { uniform = [1, 2] }"),
        ({"sample": {"optics.psf": {"choice": [object()]}}}, "choice: must hold numbers, words and tables of them"),
        ({"scene": 3}, "scene: must be a Scene, the name of a preset, or the path of a file, got 3"),
        ({"sample": {"optics.psf": {"choice": []}}}, "must be a list of one value or more"),
        ({"sample": {"optics.psf": {"choice": ["airy"], "weights": [0]}}}, "weights: must be one per value, and not"),
        ({"format": "zarr", "sample": {"camera.n_row": {"integer": [64, 65]}}}, "images of one Zarr array must be"),
        ({"format": "zarr", "preview": "gif"}, "preview: needs a format with a folder for each sequence"),
        ({"format": "webdataset", "satnet": True}, "satnet: needs a format with a folder for each sequence"),
        ({"n_sequences": 3}, "n_sequences: is not a known field (did you mean n_sequence?)"),
    ],
)  # fmt: skip
def test_bad_recipes_are_told_in_one_line(changes, message):
    with pytest.raises(ws.InputError, match=re.escape(message)) as caught:
        recipe(**changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("sample", "message"),
    [
        (
            {"camera.fov_deg": {"uniform": [0.5, 500.0]}},
            "sample.camera.fov_deg (drawn: camera.fov_deg = 500.0): Scene: camera.fov_deg: must be in (0, ",
        ),
        (
            {"camera.fow_deg": {"uniform": [0.5, 0.6]}},
            "camera.fow_deg = 0.5): Scene: camera.fow_deg: is not a known field (did you mean fov_deg?)",
        ),
        ({"optix.aperture_m": {"uniform": [0.5, 0.6]}}, "is not a field of a part (did you mean optics?)"),
        ({"targets.99.count": {"integer": [1, 2]}}, "targets.99.count: must name an item by its number, 0 to 3"),
        ({"targets.0.class": {"choice": ["ghost"]}}, "must be of the scene's own classes (center, cone, "),
    ],
)  # fmt: skip
def test_fields_and_extremes_that_a_scene_refuses_are_found_when_a_recipe_is_made(sample, message):
    with pytest.raises(ws.InputError, match=re.escape(message)) as caught:
        recipe(sample=sample)
    assert str(caught.value).startswith("Recipe: sample.") and "\n" not in str(caught.value)


def test_fields_that_no_recipe_has_are_refused_however_it_is_made():
    for make in (
        lambda: ws.Recipe(scene="stss", n_sequnce=3),
        lambda: ws.Recipe.load("stss", n_sequnce=3),
        lambda: ws.Recipe.from_dict({"scene": "stss", "n_sequnce": 3}),
    ):
        with pytest.raises(ws.InputError, match=r"n_sequnce: is not a known field \(did you mean n_sequence\?\)"):
            make()


def test_extremes_that_cannot_be_flown_are_found_before_the_work():
    bad = recipe(sample={"trajectory.duration_s": {"uniform": [1614.0, 1e5]}})
    with pytest.raises(ws.InputError, match=r"\(drawn: trajectory.duration_s = 100000.0\)"):
        check_extremes(bad)
    check_extremes(recipe(sample=SAMPLE))


def test_a_sequence_depends_on_seed_and_number_alone():
    one, other = recipe(sample=SAMPLE), recipe(sample=SAMPLE, n_sequence=500, format="zarr")
    assert [drawn_values(one, k) for k in range(12)] == [drawn_values(other, k) for k in range(12)]
    assert drawn_values(one, 3) != drawn_values(one, 4)
    assert drawn_values(one, 3) != drawn_values(recipe(sample=SAMPLE, seed=1), 3)
    assert drawn_values(one, 3) != drawn_values(one, 3, attempt=1)
    less = {name: item for name, item in SAMPLE.items() if name != "detector"}
    assert drawn_values(recipe(sample=less), 5).items() <= drawn_values(one, 5).items()


def test_drawn_scenes_hold_the_values_and_seeds_of_their_own():
    made = recipe(sample=SAMPLE)
    sequences = [draw_sequence(made, number) for number in range(6)]
    for sequence in sequences:
        scene = sequence.scene
        assert scene.detector.nei_w_cm2 == sequence.values["detector.nei_w_cm2"]
        assert scene.targets[1].count == sequence.values["targets.1.count"]
        assert (scene.frames.count, scene.frames.interval_s, scene.bands) == (4, 0.5, ("A",))
    assert len({sequence.scene.seed for sequence in sequences}) == 6


@pytest.mark.parametrize("n_sensor", [1, 3])
@pytest.mark.ci
def test_sensors_see_the_targets_from_the_first_frame_to_the_last(n_sensor):
    made = recipe(n_frame=200, n_sensor=n_sensor)
    for number in range(8):
        sequence = draw_sequence(made, number)
        assert len(set(sequence.sensors)) == n_sensor
        for sensor in sequence.sensors:
            time_s = sequence.scenario.instrument.frame_time_s(range(200))
            assert sequence.scenario.has_access(sensor, time_s).all()


def test_all_starts_that_are_possible_are_as_likely():
    made = recipe(n_frame=20, n_sequence=400, sensors=["sat11", "sat27"])
    rows = made.scene.access()
    rows = rows[np.isin(rows["sensor"], ["sat11", "sat27"])]
    starts, ends = np.asarray(rows["start_s"]), np.asarray(rows["end_s"]) - made.clip_s
    times = np.linspace(0, made.scene.duration_s, 200_001)
    possible = times[((times[:, None] >= starts) & (times[:, None] <= ends)).any(axis=1)]
    clips = _clips(made, made.scene)
    drawn_s = [_chosen_clip(made, clips, number, 0)[0] for number in range(400)]
    # 400 draws: the distance of a fair sample exceeds 0.08 once in 100 seeds, and this one is fixed.
    assert stats.kstest(drawn_s, lambda x: np.searchsorted(possible, x) / len(possible)).statistic < 0.08


def test_a_sequence_may_lie_across_a_step_to_another_target():
    """Access goes on while a camera turns to its next target at once."""
    scene = ws.Scene.load("stss")
    whole = max(scene.access(sensors="sat27"), key=lambda row: row["duration_s"])
    start_s, end_s = float(whole["start_s"]), float(whole["end_s"])
    steps = [{"start_s": 0.0, "track": "center"}, {"start_s": 0.5 * (start_s + end_s), "track": "sphere03"}]
    both = scene.replace(pointing={"kind": "schedule", "steps": steps})
    table = both.access(sensors="sat27")
    assert {"center", "sphere03"} == set(table["target"]) and table["duration_s"].max() < 0.6 * (end_s - start_s)
    sequence = draw_sequence(recipe(scene=both, sensors=["sat27"], n_frame=2, interval_s=0.9 * (end_s - start_s)), 0)
    assert start_s <= sequence.scene.frames.start_s < steps[1]["start_s"]


def test_without_access_any_sensor_and_time_will_do():
    made = recipe(every_frame=True, n_sequence=60, n_sensor=2)
    sequences = [draw_sequence(made, number) for number in range(60)]
    assert len({name for sequence in sequences for name in sequence.sensors}) > 20
    assert max(sequence.scene.frames.start_s for sequence in sequences) > made.scene.duration_s * 0.9


@pytest.mark.parametrize(("sample", "n_draw"), [(None, 1), (SAMPLE, 3)])
def test_when_nobody_can_see_the_targets_it_is_said(monkeypatch, sample, n_draw):
    monkeypatch.setattr("warpsim.dataset.layout.MOST_ATTEMPTS", 3)
    blind = recipe(scene=ws.Scene.load("stss").replace(access_rules__max_range_km=200.0), sample=sample)
    with pytest.raises(ws.InputError, match=f"sequence 2: in {n_draw} draws there were never 1 sensors with access"):
        draw_sequence(blind, 2)


def test_values_that_break_a_rule_together_name_the_sequence_and_what_was_drawn():
    with pytest.raises(ws.InputError, match=r"sequence 3 \(drawn: detector.nei_w_cm2 = 1.0\): Scene: .*sei_w_cm2"):
        varied(recipe(), {"detector.nei_w_cm2": 1.0}, "sequence 3")


def test_splits_share_the_sequences_out():
    made = recipe(n_sequence=100, split={"train": 7, "val": 2, "test": 1})
    parts = split_of(made)
    assert {name: len(numbers) for name, numbers in parts.items()} == {"train": 70, "val": 20, "test": 10}
    assert sorted(itertools.chain(*parts.values())) == list(range(100))
    assert parts != split_of(recipe(n_sequence=100, split={"train": 7, "val": 2, "test": 1}, seed=1))
    assert sorted(itertools.chain(*split_of(recipe(n_sequence=1)).values())) == [0]


def test_shards_hold_sequences_of_one_split_each():
    made = recipe(n_sequence=100, sequences_per_shard=6)
    shards = shards_of(made)
    assert sorted(number for shard in shards for number in shard.sequences) == list(range(100))
    assert len({shard.name for shard in shards}) == len(shards) == 14 + 2 + 2
    for shard in shards:
        assert set(shard.sequences) <= set(split_of(made)[shard.split]) and len(shard.sequences) <= 6


def test_keys_of_archives_tell_sensors_apart():
    assert len({_TarArchive._key(0, 0, name) for name in ("s.11", "s-11", "s_11")}) == 3
    assert "." not in _TarArchive._key(0, 0, "s.11")


def test_images_have_numbers_of_their_own():
    made = recipe(n_sequence=3, n_frame=2, n_sensor=2, bands=["A", "C"])
    keys = [ImageKey(q, 0, f, "", s, "", b) for q in range(3) for f in range(2) for s in range(2) for b in range(2)]
    assert [image_id(made, key) for key in keys] == list(range(1, 25))


def test_numbers_of_numpy_are_numbers():
    made = recipe(sample={"optics.aperture_m": {"choice": [np.float32(0.5), np.int64(1)]}})
    assert json.loads(json.dumps(made.to_dict()))["sample"]["optics.aperture_m"]["choice"] == [0.5, 1]


@pytest.fixture
def catalogs(tmp_path):
    """Two star catalogs, and a recipe beside them that chooses one for each sequence."""
    for name, seed in (("one.fits", 1), ("two.fits", 2)):
        write_fits_table(ws.StarCatalog.synthetic(500, seed=seed).to_table(), tmp_path / name)
    path = tmp_path / "recipe.toml"
    path.write_text('scene = "stss"\n[sample]\nsky.catalog = { choice = ["one.fits", "two.fits", "none"] }\n')
    return path


@pytest.mark.ci
def test_files_among_choices_count_from_the_recipe(catalogs, tmp_path, monkeypatch):
    monkeypatch.chdir("/")
    made = ws.Recipe.load(catalogs)
    choices = [str(tmp_path / "one.fits"), str(tmp_path / "two.fits"), "none"]
    assert made.to_dict()["sample"]["sky.catalog"]["choice"] == choices
    drawn = {draw_sequence(made, number).scene.sky.catalog for number in range(10)}
    assert drawn == set(choices)
    nested = {"optics": {"choice": [{"psf_file": "psf.fits"}]}, "trajectory.file": {"choice": ["a.oem"]}}
    plain = with_absolute_choices(nested | {"constellation.files.0": {"choice": ["a.oem"]}}, Path("/"))
    assert plain["optics"]["choice"] == [{"psf_file": "/psf.fits"}]
    assert plain["trajectory.file"]["choice"] == plain["constellation.files.0"]["choice"] == ["/a.oem"]


def test_what_files_depend_on(catalogs, tmp_path):
    """The recipe, the files among its choices, and what writes."""
    made = ws.Recipe.load(catalogs)
    before = identity_of(made, "cpu")
    assert difference(before, identity_of(ws.Recipe.load(catalogs), "cpu")) is None
    write_fits_table(ws.StarCatalog.synthetic(500, seed=3).to_table(), tmp_path / "two.fits")
    after = identity_of(ws.Recipe.load(catalogs), "cpu")
    assert after != before
    assert "inputs.star catalog, for sky.catalog 1: " in difference(before, after)
    assert len(before["inputs"]) == 4
    other = identity_of(ws.Recipe.load(catalogs, least_nei=2.0, format="zarr"), "cuda:1")
    assert difference(before, other) == 'format: "fits" there, "zarr" here'
    assert difference(before | {"recipe": 0}, other | {"recipe": 0, "inputs": {}}) is not None
    assert "zarr" in other["packages"] and other["device"] == "cuda"
    assert identity_of(made, "cuda:0")["device"] == "cuda"
    assert OutputFolder(tmp_path, before | {"device": "cuda"}).key != OutputFolder(tmp_path, before).key


def test_differences_are_told_by_their_place():
    assert difference({"a": {"b": [1, 2]}}, {"a": {"b": [1, 3]}}) == "a.b[1]: 2 there, 3 here"
    assert difference({"a": 1}, {"a": 1, "c": "x" * 100}) == f'c: not set there, "{"x" * 56}... here'
    assert difference({"a": [1]}, {"a": [1, 2]}) == "a[1]: not set there, 2 here"
    assert difference({"a": 1}, {"a": 1}) is None


@pytest.mark.parametrize(
    ("changes", "n_sequence", "n_frame"),
    [
        ({"n_frame": 32}, 8, 32),
        ({"n_frame": 500, "scene": "long"}, 8, 500),
        ({"n_frame": 2000, "scene": "long"}, 2, 2000),
        ({"n_frame": 2000, "scene": "long", "signal": True, "masks": True}, 1, 1024),
        ({"n_frame": 32, "contributions": True}, 2, 32),
        ({"n_frame": 32, "contributions": True, "n_sensor": 3}, 1, 22),
        ({"n_frame": 2000, "scene": "long", "sequences_per_shard": 8}, 8, 2000),
    ],
)
def test_a_zarr_shard_fits_into_memory(changes, n_sequence, n_frame):
    scene = ws.Scene.load("stss")
    if changes.get("scene") == "long":
        scene = scene.replace(frames__interval_s=0.5)
    made = recipe(**{"format": "zarr", "bands": "A", "interval_s": None, **changes, "scene": scene})
    assert (made.shard_size, made.frames_per_shard) == (n_sequence, n_frame)
    if "sequences_per_shard" not in changes:
        assert made.shard_size * made.frames_per_shard * made.frame_bytes <= 128 * 2**20


def test_a_recipe_is_checked_before_it_is_run(catalogs, capsys):
    assert main(["check", str(catalogs)]) == 0
    words = capsys.readouterr().out
    for line in (
        "960 images: 10 sequences of 32 frames every 10 s, 1 of 28 sensors, bands A C E",
        "sequences: train 8, val 1, test 1",
        "fits, 10 shards; 31.5 MB before compression, and tables",
        'drawn: sky.catalog = {"choice": [',
        "sequence 0: from ",
        "stss: valid.",
    ):
        assert line in words
    (catalogs.parent / "two.fits").unlink()
    assert main(["check", str(catalogs)]) == 2
    assert "two.fits: cannot be read" in capsys.readouterr().err
    catalogs.write_text('scene = "stss"\n[sample]\ncamera.fov_deg = { uniform = [1, 500] }\n')
    assert main(["check", str(catalogs)]) == 2
    drawn = "sample.camera.fov_deg (drawn: camera.fov_deg = 500.0): Scene: camera.fov_deg: must be in (0, 120)"
    assert drawn in capsys.readouterr().err
