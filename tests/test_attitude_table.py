"""Attitude tables: kernel and host against scipy, what is refused, files, and scenes that use them."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from bodies import aspects_rad
from on_devices import launched, target_field
from refusals import refused_in_one_line
from scipy.spatial.transform import Rotation, Slerp
from warpsim_kernels import timed_tables

import warpsim as ws
from warpsim import quaternion
from warpsim.render.target_field import make_attitudes
from warpsim.target.attitude import body_motion
from warpsim.target.attitude_table import checked_rows

SEED = 141421

ROUNDING = 1e-14  # of components of unit quaternions and vectors, 1e-16 each time
ROTATION_ATOL_RAD = 1e-14  # float64: sines, products, and the place between two rows
TIME_ROUNDING_RAD = 1e-12  # a time near 1e6 s is good to 1e-10 s, at rates of some hundredths of a radian per second
ASPECT_ATOL_RAD = 1e-9

KINDS = "'motion', 'table', 'torque_free'"
IDENTITY = (0.0, 0.0, 0.0, 1.0)


@wp.kernel(enable_backward=False)
def table_kernel(
    tables: timed_tables.AttitudeTables,
    first: int,
    count: int,
    time_s: wp.array[wp.float64],
    turned: wp.array[wp.quatd],
    axis: wp.array[wp.vec3d],
):
    i = wp.tid()
    turned[i] = timed_tables.table_quaternion(tables, first, count, time_s[i])
    axis[i] = timed_tables.turned_axes(turned[i])[2]


def on_device(all_rows, number, time_s, device):
    """Quaternion and body axis from one of several tables."""
    tables, spans = make_attitudes(all_rows, wp.get_device(device))
    return launched(table_kernel, len(time_s), [tables, *spans[number], time_s], [wp.quatd, wp.vec3d], device)


def some_table(n, last_s, largest_deg=160.0, seed=SEED):
    """Random ascending times from 0 to last_s, random turns between rows, random signs."""
    rng = np.random.default_rng(seed)
    time_s = np.concatenate([[0.0], np.sort(rng.uniform(0, last_s, n - 2)), [last_s]])
    steps = rng.normal(size=(n, 3))
    steps *= (np.radians(rng.uniform(0, largest_deg, n)) / np.linalg.norm(steps, axis=1))[:, None]
    rotation, rows = Rotation.identity(), []
    for step in Rotation.from_rotvec(steps):
        rotation = step * rotation
        rows.append(rotation.as_quat())
    return time_s, np.array(rows) * rng.choice([-1.0, 1.0], n)[:, None]


def rotation_error_rad(seen, expected):
    return (Rotation.from_quat(seen) * expected.inv()).magnitude()


@pytest.mark.parametrize(
    ("n", "last_s", "largest_deg"),
    [(2, 10.0, 169.0), (300, 1614.0, 169.0), (300, 1614.0, 1e-6), (300, 1e6, 20.0)],
    ids=["two-rows", "large-turns", "tiny-turns", "long"],
)
def test_table_on_host_and_device_is_scipys_slerp(device, n, last_s, largest_deg):
    time_s, rows = some_table(n, last_s, largest_deg)
    table = checked_rows(time_s, rows)
    times = np.concatenate([np.random.default_rng(1).uniform(0, last_s, 3000), time_s, np.nextafter(time_s, 0)[1:]])
    expected = Slerp(time_s, Rotation.from_quat(rows))(times)
    turned, axis = on_device([table], 0, times, device)
    for seen in (turned, table.at(times)):
        np.testing.assert_allclose(np.linalg.norm(seen, axis=1), 1, rtol=0, atol=ROUNDING)
        assert rotation_error_rad(seen, expected).max() < ROTATION_ATOL_RAD + TIME_ROUNDING_RAD * (last_s > 1e5)
    np.testing.assert_allclose(axis, Rotation.from_quat(turned).apply([0, 0, 1]), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(turned, table.at(times), rtol=0, atol=ROTATION_ATOL_RAD)  # signs too


def test_rows_are_met_exactly_and_signs_play_no_part(device):
    time_s, rows = some_table(50, 100.0)
    table, mirrored = checked_rows(time_s, rows), checked_rows(time_s, -rows)
    for seen in (table.at(time_s), on_device([table], 0, time_s, device)[0]):
        assert quaternion.rotation_between_rad(seen, rows).max() < ROUNDING
    between = np.linspace(0, 100, 777)
    np.testing.assert_array_equal(mirrored.at(between), -table.at(between))
    np.testing.assert_array_equal(
        on_device([mirrored], 0, between, device)[1], on_device([table], 0, between, device)[1]
    )


def test_equal_neighbours_stay_and_q_and_minus_q_are_the_same(device):
    row = Rotation.random(random_state=SEED).as_quat()
    table = checked_rows(np.arange(4.0), np.array([row, -row, row, -row]))
    for seen in (table.at(np.linspace(0, 3, 31)), on_device([table], 0, np.linspace(0, 3, 31), device)[0]):
        np.testing.assert_allclose(seen, np.tile(row, (31, 1)), rtol=0, atol=ROUNDING)


def test_one_row_holds_for_all_times(device):
    row = Rotation.random(random_state=SEED).as_quat()
    table = checked_rows(np.array([5.0]), row[None])
    times = np.array([-1e6, 0.0, 5.0, 1e6])
    np.testing.assert_array_equal(on_device([table], 0, times, device)[0], table.at(times))
    np.testing.assert_allclose(table.at(times), np.tile(row, (4, 1)), rtol=0, atol=ROUNDING)
    assert table.span_s == (-np.inf, np.inf)


def test_ends_hold_for_a_second(device):
    time_s, rows = some_table(20, 50.0)
    table = checked_rows(time_s, rows)
    outside = np.array([-1.0, -0.3, 50.2, 51.0])
    expected = table.at(np.array([0.0, 0.0, 50.0, 50.0]))
    np.testing.assert_array_equal(table.at(outside), expected)
    np.testing.assert_allclose(on_device([table], 0, outside, device)[0], expected, rtol=0, atol=ROTATION_ATOL_RAD)
    for time in (-1.01, 51.01, np.nan):
        with pytest.raises(ws.InputError, match=r"time_s: must be within the attitude table, 0 to 50 s, got"):
            table.at(time)


def test_a_hundred_thousand_rows_and_several_tables(device):
    """Rows of a spin of 5 rev/s each 0.01 s, between two other tables: no search may stray into them."""
    time_s = np.arange(100_000) * 0.01
    spin = ws.Attitude(spin_rev_s=5.0, axis=(0.0, 0.6, 0.8), precession_angle_deg=40.0)
    body = body_motion(spin, np.ones(3), 1, 0)
    tables = [checked_rows(*some_table(7, 900.0, seed=1)), checked_rows(time_s, body.at(time_s)),
              checked_rows(np.zeros(1), np.array([IDENTITY])), checked_rows(*some_table(9, 800.0, seed=2))]  # fmt: skip
    times = np.random.default_rng(SEED).uniform(0, 790, 4000)
    for number, table in enumerate(tables):
        turned, _ = on_device(tables, number, times, device)
        np.testing.assert_allclose(turned, table.at(times), rtol=0, atol=ROTATION_ATOL_RAD)
    # About one axis at one rate there is no error of interpolation, only that of 31 rad/s times a time's rounding.
    assert rotation_error_rad(tables[1].at(times), Rotation.from_quat(body.at(times))).max() < 1e-11


@wp.kernel(enable_backward=False)
def slerp_kernel(a: wp.quatd, b: wp.quatd, part: wp.array[wp.float64], turned: wp.array[wp.quatd]):
    i = wp.tid()
    turned[i] = timed_tables.slerp(a, b, part[i])


@pytest.mark.parametrize("step_rad", [0.0, 1e-15, 1e-9, 1.9e-4, 2.1e-4, 0.3, 2.96, np.pi], ids=str)
def test_slerp_of_the_kernel_from_no_turn_to_half_a_turn(device, step_rad):
    part = np.linspace(0, 1, 101)
    axis = np.array([0.6, 0.0, -0.8])
    start = Rotation.random(random_state=SEED)
    a, b = (quaternion.product([*(axis * np.sin(t)), np.cos(t)], start.as_quat()) for t in (0.0, step_rad / 2))
    (turned,) = launched(slerp_kernel, 101, [wp.quatd(*a), wp.quatd(*b), part], [wp.quatd], device)
    expected = Rotation.from_rotvec(step_rad * part[:, None] * axis) * start
    assert rotation_error_rad(turned, expected).max() < ROTATION_ATOL_RAD


# Errors against a motion that slerp does not follow exactly


@pytest.mark.parametrize("step_s", [0.02, 0.01, 0.005])
def test_error_of_a_tabulated_precession_is_what_the_page_says(step_s):
    """At most step^2 / 8 times the angular acceleration, precession x spin x sin(angle), in radians."""
    main = ws.Attitude(spin_rev_s=3.0, precession_rev_s=1.0, precession_angle_deg=3.0)
    body = body_motion(main, np.array([1.0, 2.0, 3.0]), 5, 0)
    time_s = np.arange(0, 3, step_s)
    times = np.linspace(0, time_s[-1], 20001)
    seen = checked_rows(time_s, body.at(time_s)).at(times)
    error = rotation_error_rad(seen, Rotation.from_quat(body.at(times))).max()
    bound = step_s**2 / 8 * (2 * np.pi) ** 2 * 3.0 * 1.0 * np.sin(np.radians(3.0))
    assert 0.9 * bound < error < 1.02 * bound


# What is refused


def half_turn(angle_deg):
    return [np.sin(np.radians(angle_deg) / 2), 0.0, 0.0, np.cos(np.radians(angle_deg) / 2)]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "AttitudeTable: file, time_s: exactly one"),
        ({"file": "a.aem", "time_s": [0.0], "quaternion": [IDENTITY]}, "file, time_s: exactly one"),
        ({"time_s": [0.0]}, "time_s, quaternion: both must be given"),
        ({"time_s": [0.0], "quaternion": [IDENTITY], "object": "x"}, "object: names an object of a file"),
        ({"time_s": [], "quaternion": []}, "time_s: must hold at least one time"),
        ({"time_s": [0.0, 1.0], "quaternion": [IDENTITY]}, "quaternion: must have a row for each of 2 times, got 1"),
        ({"time_s": [0.0, 0.0], "quaternion": [IDENTITY] * 2}, "time_s: must ascend, got 0 after 0 in row 1"),
        ({"time_s": [0.0, 2.0, 1.5], "quaternion": [IDENTITY] * 3}, "time_s: must ascend, got 1.5 after 2 in row 2"),
        ({"time_s": [0.0, np.nan], "quaternion": [IDENTITY] * 2}, r"time_s\[1\]: must be finite"),
        ({"time_s": [0.0], "quaternion": [[0, 0, 0, 1.002]]}, "quaternion: norm must be 1 within 0.001, got 1.002"),
        ({"time_s": [0.0], "quaternion": [[0, 0, 0, 0]]}, "quaternion: norm must be 1 within 0.001, got 0 in row 0"),
        ({"time_s": [0.0], "quaternion": [[1e200, 0, 0, 0]]}, "quaternion: norm must be 1 within 0.001, got"),
        ({"time_s": [0.0], "quaternion": [[0, 0, 1]]}, r"quaternion\[0\]\[3\]: is required"),
        ({"time_s": [0.0], "quaternion": [[0, 0, 0, "1"]]}, r"quaternion\[0\]\[3\]: must be a number"),
        ({"time_s": 3.0, "quaternion": [IDENTITY]}, "time_s: must be a list, got 3.0"),
        ({"time_s": [0, 1], "quaternion": [IDENTITY, half_turn(180)]}, "at most 170 deg .* 180 deg"),
        ({"time_s": [0, 1], "quaternion": [IDENTITY, half_turn(170.1)]}, "got 170.1 deg from row 0 to 1"),
        ({"time_s": [0, 1], "quaternion": [IDENTITY, half_turn(189.9)]}, "got 170.1 deg from row 0 to 1"),
        ({"time_s": [0.0], "quaternion": [IDENTITY], "kind": "motion"}, "kind: must be 'table', got 'motion'"),
    ],
)  # fmt: skip
def test_bad_tables_are_refused_in_one_line(fields, message):
    with refused_in_one_line(message):
        ws.AttitudeTable(**fields)


def test_tables_near_the_limits_are_taken():
    table = ws.AttitudeTable(time_s=[0, 1, 2], quaternion=[IDENTITY, half_turn(169.9), [0.0, 0.0, 0.0, 1.0009]])
    rows = table.rows(None)
    np.testing.assert_allclose(np.linalg.norm(rows.quaternion, axis=1), 1, rtol=0, atol=ROUNDING)
    assert table.span_s(None) == (0.0, 2.0)


def test_arrays_and_quantities_are_taken():
    import astropy.units as u

    time_s, rows = some_table(5, 120.0)
    table = ws.AttitudeTable(time_s=(time_s / 60) * u.min, quaternion=rows)
    np.testing.assert_allclose(table.time_s, time_s, rtol=1e-15)
    np.testing.assert_array_equal(np.array(table.quaternion), rows)
    with pytest.raises(ws.InputError, match="time_s: must be convertible to s"):
        ws.AttitudeTable(time_s=time_s * u.m, quaternion=rows)


# Scenes


def table_fields(scene, seed=SEED, n=4000):
    time_s, rows = some_table(n, scene.duration_s, 30.0, seed)
    return {"kind": "table", "time_s": time_s.tolist(), "quaternion": rows.tolist()}


@pytest.fixture(scope="module")
def tabled(scene):
    """Cylinders turn by one table, the main target by another; spheres and cones move by themselves."""
    frames = {"count": 40, "interval_s": 0.7, "start_s": 1100.0}
    return scene.replace(
        frames=frames,
        sky__catalog="none",
        targets__0__attitude=table_fields(scene, 1),
        targets__2__attitude=table_fields(scene, 2),
    )


def test_attitudes_without_a_kind_are_motions(scene, tmp_path):
    data = scene.to_dict()
    for target in data["groups"][0]["targets"]:
        assert target["attitude"].pop("kind") == "motion"
    assert ws.Scene.from_dict(data) == scene
    data["groups"][0]["targets"][1].pop("attitude")
    assert ws.Scene.from_dict(data).targets[1].attitude == ws.Attitude()


@pytest.mark.parametrize("ending", ["toml", "json"])
@pytest.mark.ci
def test_scenes_with_tables_load_back_equal(tabled, tmp_path, ending):
    tabled.save(tmp_path / f"t.{ending}")
    again = ws.Scene.load(tmp_path / f"t.{ending}")
    assert again == tabled
    np.testing.assert_array_equal(again.scenario.body_axis("center", 500.0), tabled.scenario.body_axis("center", 500.0))


@pytest.mark.parametrize(
    ("attitude", "message"),
    [
        ({"kind": "tabel"}, rf"targets\[1\]\.attitude\.kind: must be one of {KINDS}, got 'tabel'"),
        ({"kind": ["table"]}, rf"targets\[1\]\.attitude\.kind: must be one of {KINDS}, got"),
        ({"kind": "table"}, r"targets\[1\]\.attitude: file, time_s: exactly one"),
        ({"kind": "table", "spin_rev_s": 1.0, "file": "x"}, r"\.attitude\.spin_rev_s: is not a known field"),
        ({"quaternions": [IDENTITY]}, r"targets\[1\]\.attitude\.quaternions: is not a known field"),
        ({"spin_phase_rev": "a"}, r"targets\[1\]\.attitude\.spin_phase_rev: must be a number"),
        (5.0, r"targets\[1\]\.attitude: .*got 5.0"),
        ({"kind": "table", "time_s": [0.0, 9.0], "quaternion": [IDENTITY] * 2},
         r"targets\[1\]\.attitude\.time_s: must cover the scene, 0 to 1614 s, got 0 to 9 s"),
        ({"kind": "table", "time_s": [0.1, 2e3], "quaternion": [IDENTITY] * 2}, r"must cover .* got 0.1 to 2000"),
        ({"kind": "table", "time_s": [0.0, 2e3], "quaternion": [IDENTITY, [1, 1, 0, 0]]},
         r"targets\[1\]\.attitude\.quaternion: norm must be 1 within 0.001, got 1.41421 in row 1"),
    ],
)  # fmt: skip
def test_scenes_say_where_an_attitude_is_wrong(scene, attitude, message):
    with refused_in_one_line(message):
        scene.replace(targets__1__attitude=attitude)


@pytest.mark.ci
def test_rendered_aspect_is_the_tables(tabled, device):
    truth = ws.Renderer(tabled, device=device).render(range(40), ["sat11", "sat27"], ["A"]).truth
    for name in ("center", "cylinder01", "cylinder04", "cone03"):
        rows = truth[truth["target"] == name]
        aspect = aspects_rad(tabled, name, rows)
        np.testing.assert_allclose(np.radians(rows["aspect_deg"]), aspect, rtol=0, atol=ASPECT_ATOL_RAD)
    table = tabled.targets[2].attitude
    expected = Slerp(table.time_s, Rotation.from_quat(table.quaternion))([3.3, 1200.0])
    assert rotation_error_rad(tabled.scenario.attitude_quaternion("cylinder04", [3.3, 1200.0]), expected).max() < 1e-13


@pytest.mark.ci
def test_frames_alone_and_in_a_batch_are_the_same(tabled, device):
    batch = ws.Renderer(tabled, device=device).render(range(12), ["sat11", "sat27"], ["A", "C"], keep_signal=True)
    alone = ws.Renderer(tabled, device=device, n_thread=1).render([7], ["sat27"], ["C"], keep_signal=True)
    np.testing.assert_array_equal(alone.counts.numpy()[0, 0, 0], batch.counts.numpy()[7, 1, 1])
    np.testing.assert_array_equal(alone.signal_w_cm2.numpy()[0, 0, 0], batch.signal_w_cm2.numpy()[7, 1, 1])


@pytest.mark.ci
def test_targets_without_a_table_are_as_before(tabled, scene, device):
    plain = scene.replace(frames=tabled.to_dict()["frames"], sky__catalog="none")
    both = [ws.Renderer(s, device=device).render(range(6), ["sat11"], ["A"]).truth for s in (plain, tabled)]
    for name in ("sphere02", "cone03"):
        ours = [table[table["target"] == name] for table in both]
        np.testing.assert_array_equal(ours[0]["aspect_deg"], ours[1]["aspect_deg"])
    ours = [table[table["target"] == "cylinder02"] for table in both]
    assert not np.any(ours[0]["aspect_deg"] == ours[1]["aspect_deg"])


def test_tables_are_in_the_kernel_only_where_a_target_has_one(scene, tabled):
    cpu = wp.get_device("cpu")
    fields = [target_field(one, ["A"]) for one in (scene, tabled)]
    assert [field.features.attitude_tables for field in fields] == [False, True]
    assert fields[0].observe_kernel is not fields[1].observe_kernel
    shared, _ = make_attitudes(tabled.scenario.attitudes, cpu)
    assert shared.time_s.shape == (8000,)  # the targets of a kind share their table


# Files


def segment(name, start_s, rows):
    """Times and quaternions of a reader's segment, rows a second apart."""
    times, instants = start_s + np.arange(float(len(rows))), SimpleNamespace(relative=True)
    return SimpleNamespace(object_name=name, instants=instants, time_s=times, quaternion=np.array(rows))


@pytest.fixture
def reader(monkeypatch):
    """Put segments where the readers of files would give them; returns the list to fill."""
    segments = []
    monkeypatch.setattr("warpsim.target.from_file.read_source", lambda path: SimpleNamespace(data=b"rows"))
    monkeypatch.setattr("warpsim.exchange.read_files.attitude_of", lambda source: segments)
    monkeypatch.setattr("warpsim.orbit.earth.attitude_in_gcrs", lambda one, epoch: (one.time_s, one.quaternion, None))
    return segments


def spinning(first, n):
    return Rotation.from_rotvec((first + np.arange(n))[:, None] * [0.1, 0.0, 0.05]).as_quat()


def test_segments_of_an_object_are_joined_where_they_meet(scene, reader):
    reader += [segment("A", 0.0, spinning(0, 6)), segment("B", 0.0, spinning(3, 6)),
               segment("A", 5.0, -spinning(5, 6))]  # fmt: skip
    joined = ws.AttitudeTable(file="a.aem", object="A").rows(scene.epoch)
    np.testing.assert_array_equal(joined.time_s, np.arange(11.0))
    assert quaternion.rotation_between_rad(joined.quaternion, spinning(0, 11)).max() < 1e-12
    with pytest.raises(ws.InputError, match=r"^/.*/a\.aem: object: must be given, the file holds A, B"):
        ws.AttitudeTable(file="a.aem").rows(scene.epoch)
    with pytest.raises(ws.InputError, match=r"^/.*/a\.aem: object: must be one of A, B, got 'C'"):
        ws.AttitudeTable(file="a.aem", object="C").rows(scene.epoch)
    reader[2] = segment("A", 6.0, spinning(6, 6))
    with pytest.raises(
        ws.InputError, match=r"^/.*/a\.aem: segments of one object must join .* ends at 5 s .* begins at 6 s"
    ):
        ws.AttitudeTable(file="a.aem", object="A").rows(scene.epoch)
    reader[2] = segment("A", 5.0, spinning(6, 6))
    with pytest.raises(ws.InputError, match=r"without a gap or a jump"):
        ws.AttitudeTable(file="a.aem", object="A").rows(scene.epoch)


def test_a_short_attitude_file_is_refused(scene, reader, tmp_path):
    reader.append(segment("A", 0.0, spinning(0, 50)))
    path = tmp_path / "short.toml"
    scene.replace(targets__1__attitude={"kind": "table", "file": "a.aem"}).save(path)
    with pytest.raises(
        ws.InputError,
        match=r"^targets\[1\]\.attitude: /.*/a\.aem: A: must cover the scene, 0 to 1614 s, got 0 to 49 s",
    ) as caught:
        ws.Scene.load(path).scenario  # noqa: B018
    assert "\n" not in str(caught.value)
