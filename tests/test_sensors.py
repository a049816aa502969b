"""Kinds of sensors: who carries one, names, images of their own, pointing by satellite, noise that nobody shares."""

from __future__ import annotations

import numpy as np
import pytest

import warpsim as ws

SENSOR = {
    "name": "wide",
    "camera": {"n_row": 24, "n_col": 40, "fov_deg": 5.0},
    "optics": {"aperture_m": 0.2},
    "detector": {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15},
    "bands": ["A", "C"],
    "pointing": {"track": "main"},
}
NARROW = {
    **SENSOR,
    "name": "narrow",
    "camera": {"n_row": 16, "n_col": 16, "fov_deg": 0.5},
    "bands": ["E"],
    "pointing": {"track": "group"},
}


def with_sensors(scene, *sensors, **changes):
    return scene.replace(sensors=list(sensors), sky__catalog="none", **changes)


@pytest.fixture(scope="module")
def both(scene):
    """Wide cameras on all satellites, narrow ones on those of planes 1 and 4."""
    return with_sensors(scene, SENSOR, {**NARROW, "on": ["sat1?", "sat4*"]})


def test_names_say_the_kind_where_a_satellite_carries_several(both, scene):
    planes = [name for name in scene.sensor_names if name[3] in "14"]
    expected = [f"{name}.wide" if name in planes else name for name in scene.sensor_names]
    assert both.scenario.instruments["wide"].names == expected
    assert both.scenario.instruments["narrow"].names == [f"{name}.narrow" for name in planes]
    assert both.sensor_names == [*expected, *(f"{name}.narrow" for name in planes)]
    assert both.scenario.satellite_names == scene.sensor_names
    for name in ("sat11", "sat11.wide", "sat11.narrow"):
        np.testing.assert_array_equal(both.position_m(name, [500.0]), scene.position_m("sat11", [500.0]))


def test_patterns_choose_satellites(scene):
    for on, n in (("all", 28), ("sat2*", 7), (["sat11", "sat3?"], 8), ("sat?1", 4)):
        one = with_sensors(scene, {**SENSOR, "on": on})
        assert len(one.sensor_names) == n
        assert all("." not in name for name in one.sensor_names)


def test_patterns_choose_sensors(both):
    choose = both.scenario.select_sensors
    assert choose("sat11.*") == ["sat11.wide", "sat11.narrow"]
    assert choose(["*.narrow"]) == choose("narrow") == both.scenario.instruments["narrow"].names
    assert choose(["sat2[1-3]", "sat4?.wide"]) == ["sat21", "sat22", "sat23", *(f"sat4{k}.wide" for k in range(1, 8))]
    with pytest.raises(ws.InputError, match=r"^sensors: must be sensors of the scene \(.*\), got 'sat11.x\*'$"):
        choose(["sat11.*", "sat11.x*"])
    assert choose("na*") == choose("?arrow") == choose("narrow")
    assert choose(["na*", "*"]) == [*choose("narrow"), *choose("wide")]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["sat21", "sat2[12]"], ["sat21", "sat22"]),
        (["sat2[12]", "sat21"], ["sat21", "sat22"]),
        (["sat2[23]", "sat2[12]", "sat22"], ["sat22", "sat23", "sat21"]),
        (["sat11.narrow", "sat11.*"], ["sat11.narrow", "sat11.wide"]),
        (["sat21", "sat21"], ["sat21", "sat21"]),
    ],
)
def test_overlapping_patterns_choose_a_sensor_once(both, names, expected):
    assert both.scenario.select_sensors(names) == expected


def test_overlapping_patterns_render_a_sensor_once(scene):
    assert ws.Renderer(scene, device="cpu").render([1], sensors=["sat21", "sat2[12]"]).sensors == ["sat21", "sat22"]


@pytest.mark.ci
def test_each_kind_has_images_of_its_own(both, device):
    renderer = ws.Renderer(both, device=device)
    wide = renderer.render([60, 61], sensors="wide")
    narrow = renderer.render([60, 61], sensors=["sat11.narrow", "sat47.narrow"], keep_signal=True)
    assert wide.counts.shape == (2, 28, 2, 24, 40)
    assert narrow.counts.shape == (2, 2, 1, 16, 16)
    assert (narrow.bands, wide.bands) == (["E"], ["A", "C"])
    assert set(narrow.truth["sensor"]) == {"sat11.narrow", "sat47.narrow"}
    alone = ws.Renderer(with_sensors(both, {**NARROW, "on": ["sat1?", "sat4*"]}), device=device)
    same = alone.render([60, 61], sensors=["sat11", "sat47"], keep_signal=True)
    np.testing.assert_array_equal(narrow.signal_w_cm2.numpy(), same.signal_w_cm2.numpy())
    np.testing.assert_array_equal(narrow.counts.numpy(), same.counts.numpy())


def test_sensors_of_several_kinds_are_one_clear_error(both):
    renderer = ws.Renderer(both, device="cpu")
    text = r"sensors: must be of one kind, got several \(wide 24 x 40, narrow 16 x 16 pixels\); call once for each"
    with pytest.raises(ws.InputError, match=text):
        renderer.render([60], sensors=["sat11.wide", "sat11.narrow"])
    with pytest.raises(ws.InputError, match="must be of one kind"):
        renderer.render([60])
    with pytest.raises(ws.InputError, match=r"sensors: must be sensors of the scene .* or of the kinds wide, narrow"):
        renderer.render([60], sensors="sat11")


@pytest.mark.ci
def test_frames_of_a_kind(scene):
    quick = {**NARROW, "frames": {"count": 500, "interval_s": 0.5, "start_s": 600.0}}
    both = with_sensors(scene, SENSOR, quick)
    renderer = ws.Renderer(both, device="cpu")
    assert renderer.render([3], "narrow").time_s.tolist() == [601.5]
    assert renderer.render([3], "wide").time_s.tolist() == [30.0]
    assert both.scenario.instruments["narrow"].frames.count == 500
    with pytest.raises(ws.InputError, match=r"^Scene: sensors\[1\].frames: the last frame .* got 3099.5"):
        with_sensors(scene, SENSOR, {**quick, "frames": {"count": 5000, "interval_s": 0.5, "start_s": 600.0}})


def test_access_rules_of_a_kind(scene):
    rules = {"max_range_km": 3000.0}
    both = with_sensors(scene, SENSOR, {**NARROW, "pointing": SENSOR["pointing"], "access_rules": rules})
    table = both.access()
    near = with_sensors(scene, SENSOR, access_rules=rules).access()
    for kind, expected in (("wide", with_sensors(scene, SENSOR).access()), ("narrow", near)):
        own = table[[str(name).endswith(kind) for name in table["sensor"]]]
        assert [f"{name}.{kind}" for name in expected["sensor"]] == list(own["sensor"])
        np.testing.assert_array_equal(own["start_s"], expected["start_s"])


@pytest.mark.ci
def test_pointing_by_satellite(both, scene):
    """A satellite takes the first entry that chooses it."""
    fixed = {"kind": "fixed", "ra_dec_deg": [10.0, 20.0]}
    one = with_sensors(
        scene, {**SENSOR, "pointing": [{**fixed, "on": ["sat1?"]}, {"track": "group", "on": "sat*"}, fixed]}
    )
    group = with_sensors(scene, {**SENSOR, "pointing": {"track": "group"}})
    boresight = one.scenario.view_axes("sat13", [60.0])[0, 2]
    np.testing.assert_allclose(
        boresight, ws.StarCatalog.from_arrays([10.0], [20.0], {"A": [1.0]}).direction_icrs[0], atol=1e-12
    )
    np.testing.assert_array_equal(one.scenario.view_axes("sat21", [60.0]), group.scenario.view_axes("sat21", [60.0]))
    frames = ws.Renderer(one, device="cpu").render([6], ["sat13", "sat21"])
    np.testing.assert_allclose(frames.axes_icrs[0, 0, 2], boresight, atol=1e-12)
    np.testing.assert_allclose(frames.axes_icrs[0, 1], group.scenario.view_axes("sat21", [60.0])[0], atol=1e-12)


# Noise


@pytest.fixture(scope="module")
def noise_of(scene):
    """Counts of blank sky of a scene with some sensors, by sensor."""

    def noise(*sensors, names=("sat11",), **changes):
        blank = with_sensors(scene, *sensors, **changes)
        blank = blank.replace(groups=[])
        return ws.Renderer(blank, device="cpu").render([5], list(names)).counts.numpy()[0, :, 0].astype(float)

    return noise


BLANK = {**SENSOR, "pointing": {"kind": "fixed", "ra_dec_deg": [0.0, 0.0]}, "bands": ["A"]}
BLANK["detector"] = {**SENSOR["detector"], "counts_per_nei": 50.0, "offset_counts": 1000.0}
BLANK["camera"] = {"n_row": 64, "n_col": 64, "fov_deg": 1.0}


def test_another_sensor_changes_no_noise(noise_of):
    alone = noise_of(BLANK)
    np.testing.assert_array_equal(alone, noise_of(BLANK, {**NARROW, "pointing": BLANK["pointing"], "on": "sat2?"}))
    carried = noise_of(BLANK, {**BLANK, "name": "second"}, names=["sat11.wide"])
    np.testing.assert_array_equal(alone, carried)
    np.testing.assert_array_equal(alone[0], noise_of(BLANK, names=["sat12", "sat11"])[1])
    np.testing.assert_array_equal(alone, noise_of(BLANK, seed=5, noise_seed=2024))


@pytest.mark.parametrize(
    ("sensors", "changes"),
    [
        ([BLANK], {"name": "other"}),
        ([BLANK], {"noise_seed": 5}),
        ([BLANK], {"seed": 5}),
        ([{**BLANK, "name": "other"}], {}),
    ],
)
def test_no_two_sensors_share_noise(noise_of, sensors, changes):
    one, other = noise_of(BLANK)[0], noise_of(*sensors, **changes)[0]
    n = one.size
    assert (one == other).mean() < 5 / 50  # equal by chance: 1 in 177 counts for Gaussians of 50 counts
    assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 5 / np.sqrt(n)


def test_satellites_and_kinds_have_noise_of_their_own(noise_of):
    twins = noise_of(BLANK, {**BLANK, "name": "second"}, names=["sat11.wide", "sat12.wide"])
    others = noise_of(BLANK, {**BLANK, "name": "second"}, names=["sat11.second", "sat12.second"])
    images = [*twins, *others]
    for i, one in enumerate(images):
        for other in images[:i]:
            assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 5 / np.sqrt(one.size)


# Bad input


@pytest.mark.parametrize(
    ("sensors", "message"),
    [
        ([{**SENSOR, "on": "sat99"}], r"Scene: on: must be satellites of the constellation \(sat11, .*\), got 'sat99'"),
        (
            [SENSOR, {**NARROW, "on": ["sat11", "hubble"]}],
            r"Scene: sensors\[1\].on\[1\]: must be satellites of the constellation \(sat11, .*\), got 'hubble'",
        ),
        ([SENSOR, {**NARROW, "name": "wide"}], r"Scene: sensors\[1\].name: must be no other sensor's name, got 'wide'"),
        ([SENSOR, {**NARROW, "name": "sat11"}], r"Scene: sensors\[1\].name: must be no name of a satellite"),
        ([], r"Scene: sensors: must hold at least one"),
        ([{**SENSOR, "bands": []}], r"Scene: bands: must name at least one band"),
        ([{**SENSOR, "pointing": []}], r"Scene: pointing: must hold at least one"),
        (
            [SENSOR, {**NARROW, "pointing": [{"track": "main", "on": "sat1?"}]}],
            r"Scene: sensors\[1\].pointing: must say where every sensor looks, got nothing for that of sat21",
        ),
        (
            [SENSOR, {**NARROW, "pointing": [{"track": "main", "on": "sat1?"}, {"track": "nobody"}]}],
            r"Scene: sensors\[1\].pointing\[1\].track: must be 'main', .* got 'nobody'",
        ),
        (
            [{**SENSOR, "pointing": [{"track": "main"}, {"track": "group", "on": "sat1?"}]}],
            r"Scene: pointing\[1\].on: must choose a satellite that no entry before it does, got \['sat1\?'\]",
        ),
        (
            [SENSOR, {**NARROW, "detector": {**SENSOR["detector"], "exposure_s": 11.0}}],
            r"Scene: sensors\[1\].detector.exposure_s: must be",
        ),
    ],
)  # fmt: skip
def test_bad_sensors_are_one_line_with_the_place(scene, sensors, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        with_sensors(scene, *sensors)
    assert "\n" not in str(caught.value)


def test_no_sensor_has_the_name_of_another_body(scene):
    """Satellites a, with two sensors, and a.wide; a target called as a sensor; names that a file gives."""
    low = {"kind": "elements", "altitude_km": 700.0, "inclination_deg": 50.0}
    listed = {"kind": "listed", "satellites": [{"name": "a", "orbit": low}, {"name": "a.wide", "orbit": low}]}
    text = r"sensors\[0\].name: must not make the name of another sensor, satellite or target \(a.wide\), got 'wide'"
    two = [{**SENSOR, "on": "a"}, {**NARROW, "on": "a"}]
    with pytest.raises(ws.InputError, match=text):
        with_sensors(scene, *two, constellation=listed)
    called = scene.to_dict()["groups"][0]["targets"]
    with pytest.raises(ws.InputError, match=r"\(sat11.wide\), got 'wide'"):
        with_sensors(scene, SENSOR, NARROW, targets=[{**called[0], "name": "sat11.wide"}])


def test_files_of_satellites_that_cannot_be_read_are_the_constellations(scene, tmp_path):
    missing = with_sensors(scene, SENSOR, NARROW, constellation={"kind": "tle", "file": str(tmp_path / "no.tle")})
    with pytest.raises(ws.InputError, match=r"^constellation: .*no.tle: cannot be read"):
        missing.scenario  # noqa: B018


def test_the_short_form_stands_beside_no_list(scene):
    with pytest.raises(ws.InputError, match="camera: must not be given beside sensors, which hold it"):
        ws.Scene.from_dict({**scene.to_dict(), "camera": SENSOR["camera"]})


def test_short_names_of_several_kinds_say_where_to_look(both):
    text = r"camera: the scene has 2 sensors \(wide, narrow\); take scene.sensors\[0\].camera"
    with pytest.raises(ws.InputError, match=text):
        both.camera  # noqa: B018
    with pytest.raises(ws.InputError, match=r"camera.n_row: names no one of 2 sensors; begin with sensors__0__"):
        both.replace(camera__n_row=4)
    assert both.replace(sensors__1__camera__n_row=4).sensors[1].camera.n_row == 4


def test_scenes_of_several_kinds_load_back_equal(both, tmp_path):
    both.save(tmp_path / "both.toml")
    assert ws.Scene.load(tmp_path / "both.toml") == both


@pytest.mark.ci
def test_runs_and_tables_hold_all_kinds(both, tmp_path):
    from astropy.table import Table

    few = both.replace(sensors__0__on=["sat11"], sensors__1__on=["sat11", "sat47"])
    report = ws.render_to_folder(few, tmp_path, frames=[60, 61], device="cpu")
    assert report.n_image == 2 * 2 + 2 * 2
    names = {path.name for path in tmp_path.glob("*.fits")}
    assert names == {"sat11.wide_A.fits", "sat11.wide_C.fits", "sat11.narrow_E.fits", "sat47_E.fits", "truth.fits"}
    truth = Table.read(tmp_path / "truth.fits")
    assert set(truth["sensor"]) == {"sat11.wide", "sat11.narrow", "sat47"}
    cube = ws.read_cube(tmp_path / "sat11.narrow_E.fits")
    said = [cube.header[word] for word in ("TELESCOP", "INSTRUME", "SENSOR")]
    assert said == ["sat11", "narrow", "sat11.narrow"]
    rendered = ws.Renderer(few, device="cpu").render([60, 61], ["sat11.narrow"])
    np.testing.assert_array_equal(cube.counts, rendered.counts.numpy()[:, 0, 0])
    one = ws.render_to_folder(few, tmp_path / "one", frames=[60], sensors="narrow", device="cpu")
    assert one.n_image == 2
    with pytest.raises(ws.InputError, match=r"bands: sat11.wide has none of them, but A, C, got 'E'"):
        ws.render_to_folder(few, tmp_path / "none", frames=[60], sensors=["sat11.wide"], bands=["E"], device="cpu")


def test_fields_of_the_only_sensor_are_absent_where_there_are_several():
    several = ws.Scene.load("two_cameras")
    assert not hasattr(several, "camera") and getattr(several, "detector", None) is None
    with pytest.raises(ws.InputError, match=r"^camera: the scene has 2 sensors \(wide, narrow\); take scene.sensors"):
        _ = several.camera
