"""Rotations of targets on the host: quaternions against mpmath and scipy, phases, and what the kernel makes of them."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest
import warp as wp
from bodies import aspects_rad, emission_s
from on_devices import launched
from scipy.spatial.transform import Rotation, Slerp
from warpsim_kernels import motion

import warpsim as ws
from warpsim import quaternion
from warpsim.render.target_field import motion_struct
from warpsim.streams import uniforms
from warpsim.target.attitude import body_motion, turns

SEED = 161803

ANGLE_ATOL_RAD = 1e-9  # asked for after 1e6 s
PHASE_ATOL_REV = 4e-16  # host: rounding of one addition and one fraction
ROTATION_ATOL_RAD = 2e-14  # sines and products of float64: some twenty roundings of 1e-16
ROUNDING = 1e-14  # of components of unit vectors
ASPECT_ATOL_RAD = 1e-9

LONG_TIMES_S = np.array([0.0, 0.5, 12.25, 999.999, 1e6, 1e6 + 0.3, 999_999.9999, 1e6 + 1 / 3, -0.04])
VELOCITY_M_S = np.array([1000.0, -7000.0, 30.0])

MOTIONS = {
    "at rest": {},
    "spin": {"spin_rev_s": 5.0},
    "spin-0.1": {"spin_rev_s": 0.1},
    "spin-1/3": {"spin_rev_s": 1 / 3},
    "precession": {"spin_rev_s": 3.0, "precession_rev_s": 5.0, "precession_angle_deg": 10.0},
    "backwards": {"spin_rev_s": -4.9, "precession_rev_s": -1 / 3, "precession_angle_deg": 120.0},
    "rolling": {"rolling_rev_s": 4.9},
    "all": {"spin_rev_s": 4.9, "precession_rev_s": 5.0, "precession_angle_deg": 33.0, "rolling_rev_s": -0.1},
}
every_motion = pytest.mark.parametrize("fields", MOTIONS.values(), ids=MOTIONS)


def moving(fields, target=2, **more):
    attitude = ws.Attitude(axis=(0.3, -0.5, 0.2), **{**fields, **more})
    return body_motion(attitude, VELOCITY_M_S, 7, target)


def exact_matrix(body, time_s):
    """Body -> GCRS by multiplying three matrices in 50 digits, phases as exact fractions of a turn."""
    attitude = body.attitude

    def angle(rate, phase):
        turn = (Fraction(rate) * Fraction(float(time_s)) + Fraction(phase)) % 1
        return 2 * mpmath.pi * turn.numerator / turn.denominator

    def about_z(a):
        return mpmath.matrix([[mpmath.cos(a), -mpmath.sin(a), 0], [mpmath.sin(a), mpmath.cos(a), 0], [0, 0, 1]])

    def about_y(a):
        return mpmath.matrix([[mpmath.cos(a), 0, mpmath.sin(a)], [0, 1, 0], [-mpmath.sin(a), 0, mpmath.cos(a)]])

    tilt = mpmath.mpf(attitude.precession_angle_deg) * mpmath.pi / 180
    reference, first, second = body.axes
    columns = mpmath.matrix(np.column_stack([first, second, reference]).tolist())
    azimuth = about_z(angle(attitude.precession_rev_s, body.precession_phase_rev))
    polar = about_y(tilt + angle(attitude.rolling_rev_s, body.rolling_phase_rev))
    spin = about_z(angle(attitude.spin_rev_s, body.spin_phase_rev))
    return columns * azimuth * polar * spin


def angle_between_rad(a, b):
    """Of two rotation matrices; good for small angles."""
    skew = a @ b.T
    return np.linalg.norm([skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0], skew[1, 0] - skew[0, 1]]) / 2


@pytest.mark.parametrize("rate_rev_s", [5.0, 0.1, 1 / 3, 4.9, -4.9, 1e-3, 1e-12, 12345.678, 0.0])
def test_phase_of_the_host_is_rounded_once(rate_rev_s):
    rng = np.random.default_rng(SEED)
    times = np.concatenate([LONG_TIMES_S, [1e9 + 0.1], rng.uniform(-1e6, 1e6, 500)])
    exact = np.array([float((Fraction(rate_rev_s) * Fraction(float(t))) % 1) for t in times])
    error = np.abs((turns(rate_rev_s, times) - exact + 0.5) % 1 - 0.5)
    assert error.max() <= PHASE_ATOL_REV


@every_motion
def test_rotation_matches_mpmath_after_a_million_seconds(fields, record_accuracy):
    body = moving(fields)
    seen = body.at(LONG_TIMES_S)
    np.testing.assert_allclose(np.linalg.norm(seen, axis=1), 1, rtol=0, atol=ROUNDING)
    with mpmath.workdps(50):
        for q, time_s in zip(seen, LONG_TIMES_S, strict=True):
            exact = np.array(exact_matrix(body, time_s).tolist(), dtype=np.float64)
            matrix = Rotation.from_quat(q).as_matrix()
            apart_rad = angle_between_rad(matrix, exact)
            assert apart_rad < ROTATION_ATOL_RAD < ANGLE_ATOL_RAD
            record_accuracy("Attitude after 1e6 s at 5 rev/s", apart_rad, ROTATION_ATOL_RAD, "rad", "mpmath")
            assert np.trace(matrix @ exact.T) > 2.9


@every_motion
def test_rotation_is_scipys_intrinsic_zyz(fields):
    """The order that the conventions page states: azimuth about z of F, polar about the new y, spin about the new z."""
    body = moving(fields)
    attitude = body.attitude
    times = np.linspace(0.0, 7.3, 50)
    reference, first, second = body.axes
    angles = np.column_stack(
        [
            2 * np.pi * (attitude.precession_rev_s * times + body.precession_phase_rev),
            np.radians(attitude.precession_angle_deg)
            + 2 * np.pi * (attitude.rolling_rev_s * times + body.rolling_phase_rev),
            2 * np.pi * (attitude.spin_rev_s * times + body.spin_phase_rev),
        ]
    )
    fixed = Rotation.from_matrix(np.column_stack([first, second, reference]))
    expected = fixed * Rotation.from_euler("ZYZ", angles)
    error = (Rotation.from_quat(body.at(times)) * expected.inv()).magnitude()
    assert error.max() < 1e-12  # scipy's angles here are not reduced


@every_motion
def test_sign_is_continuous_and_the_same_whatever_else_is_asked(fields):
    body = moving(fields)
    times = 1e6 - 3 + np.arange(0, 6, 0.004)
    seen = body.at(times)
    assert np.einsum("ij,ij->i", seen[1:], seen[:-1]).min() > 0.9
    np.testing.assert_array_equal(body.at(times[::-7]), seen[::-7])
    np.testing.assert_array_equal(body.at(times[41]), seen[41:42])


@wp.kernel(enable_backward=False)
def axis_kernel(attitude: motion.Attitude, time_s: wp.array[wp.float64], axis: wp.array[wp.vec3d]):
    i = wp.tid()
    axis[i] = motion.axes_before_spin(attitude, time_s[i])[2]


@every_motion
def test_body_z_is_the_kernels_symmetry_axis(device, fields):
    body = moving(fields)
    times = np.concatenate([LONG_TIMES_S, np.random.default_rng(SEED).uniform(0, 1e6, 2000)])
    (axis,) = launched(axis_kernel, len(times), [motion_struct(body), times], [wp.vec3d], device)
    expected = quaternion.rotated(body.at(times), [0.0, 0.0, 1.0])
    assert np.linalg.norm(axis - expected, axis=1).max() < 1e-13 < ANGLE_ATOL_RAD


def test_angular_velocity_is_the_right_handed_sum_of_the_three():
    """Spin about the body axis, precession about the fixed direction, rolling about the axis across both."""
    body = moving(MOTIONS["all"])
    attitude, (reference, _, _) = body.attitude, body.axes
    for time_s in (0.0, 0.37, 123.4):
        step = 1e-6
        before, now, after = Rotation.from_quat(body.at([time_s - step, time_s, time_s + step]))
        rate_rad_s = (after * before.inv()).as_rotvec() / (2 * step)
        expected = (
            2
            * np.pi
            * (
                attitude.spin_rev_s * now.apply([0, 0, 1])
                + attitude.precession_rev_s * reference
                + attitude.rolling_rev_s * (now * Rotation.from_euler("z", -spin_angle(body, time_s))).apply([0, 1, 0])
            )
        )
        np.testing.assert_allclose(rate_rad_s, expected, rtol=0, atol=1e-6)


def spin_angle(body, time_s):
    return 2 * np.pi * (body.attitude.spin_rev_s * time_s + body.spin_phase_rev)


def test_new_phase_comes_after_those_that_scenes_already_use():
    np.testing.assert_array_equal(uniforms(2024, "attitude", 3, 6)[:5], uniforms(2024, "attitude", 3, 5))
    body = moving(MOTIONS["all"])
    u = uniforms(7, "attitude", 2, 6)
    assert (body.precession_phase_rev, body.rolling_phase_rev, body.spin_phase_rev) == (u[3], u[4], u[5])
    assert moving(MOTIONS["spin"]).rolling_phase_rev == 0.0


def test_given_phases_leave_nothing_to_the_seed():
    phases = {"spin_phase_rev": 0.1, "precession_phase_rev": -1.75, "rolling_phase_rev": 0.3}
    first, second = (moving(MOTIONS["all"], target, **phases) for target in (2, 9))
    np.testing.assert_array_equal(first.at([0.0, 5.5]), second.at([0.0, 5.5]))
    assert first.precession_phase_rev == 0.25
    resting = moving({}, rolling_phase_rev=0.25, precession_phase_rev=0.0, spin_phase_rev=0.0)
    assert resting.rolling_phase_rev == 0.25  # a phase is kept without a rate


@pytest.mark.parametrize(
    ("axis", "towards"),
    [
        ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ((0.6, 0.0, 0.8), (-0.8, 0.0, 0.6)),
        ((0.0, 0.0, -2.0), (1.0, 0.0, 0.0)),
        ((1e-8, 1e-8, 1.0), (1.0, 0.0, 0.0)),
        ((0.0, 2e-6, 1.0), (0.0, -1.0, 0.0)),
    ],
    ids=str,
)
def test_precession_counts_from_north(axis, towards):
    attitude = ws.Attitude(
        axis=axis, precession_angle_deg=20.0, precession_phase_rev=0.0, spin_phase_rev=0.0, precession_rev_s=0.25
    )
    body = body_motion(attitude, VELOCITY_M_S, 7, 0)
    np.testing.assert_allclose(body.axes @ body.axes.T, np.eye(3), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(np.cross(body.axes[0], body.axes[1]), body.axes[2], rtol=0, atol=ROUNDING)
    reference = np.array(axis) / np.linalg.norm(axis)
    leaning = np.cos(np.radians(20)) * reference + np.sin(np.radians(20)) * np.array(towards)
    start, quarter = quaternion.rotated(body.at([0.0, 1.0]), [0.0, 0.0, 1.0])
    # The last axis is 2e-6 off the pole, and `towards` as much off its north.
    np.testing.assert_allclose(start, leaning, rtol=0, atol=5e-6 * np.sin(np.radians(20)))
    np.testing.assert_allclose(np.cross(reference, start - reference * (start @ reference)) @ quarter,
                               np.sin(np.radians(20)) ** 2, rtol=1e-12)  # fmt: skip


def some_rotations(n):
    return Rotation.random(n, random_state=SEED)


def test_quaternions_follow_scipy():
    """Scalar last, Hamilton's product, right-handed: what Rotation.from_quat understands."""
    a, b = some_rotations(40), some_rotations(80)[40:]
    qa, qb = a.as_quat(), b.as_quat()
    vectors = np.random.default_rng(SEED).normal(size=(40, 3))
    same = Rotation.from_quat(quaternion.product(qa, qb)) * (a * b).inv()
    assert same.magnitude().max() < ROTATION_ATOL_RAD
    np.testing.assert_allclose(quaternion.rotated(qa, vectors), a.apply(vectors), rtol=0, atol=ROUNDING)
    back = quaternion.rotated(quaternion.conjugate(qa), vectors)
    np.testing.assert_allclose(back, a.inv().apply(vectors), rtol=0, atol=ROUNDING)
    between = (a.inv() * b).magnitude()
    np.testing.assert_allclose(quaternion.rotation_between_rad(qa, -qb), between, rtol=0, atol=ROUNDING)
    tiny = Rotation.from_rotvec([0.0, 3e-12, 0.0])
    assert quaternion.rotation_between_rad(qa[0], (tiny * a[0]).as_quat()) == pytest.approx(3e-12, rel=1e-3)


def test_quaternion_of_a_matrix_even_for_half_turns():
    axes = np.concatenate([np.eye(3), np.random.default_rng(SEED).normal(size=(20, 3))])
    half = Rotation.from_rotvec(np.pi * axes / np.linalg.norm(axes, axis=1)[:, None])
    for rotation in (some_rotations(50), half, Rotation.identity(1)):
        seen = Rotation.from_quat(quaternion.from_matrix(rotation.as_matrix()))
        assert (seen * rotation.inv()).magnitude().max() < ROTATION_ATOL_RAD


@pytest.mark.parametrize("step_rad", [0.0, 1e-15, 1e-9, 9e-5, 3e-4, 0.3, 2.9])
def test_slerp_follows_scipy(step_rad):
    start = some_rotations(1)[0]
    end = Rotation.from_rotvec(step_rad * np.array([0.6, 0.0, -0.8])) * start
    part = np.linspace(0, 1, 101)
    rows = quaternion.in_one_hemisphere([start.as_quat(), -end.as_quat()])
    seen = Rotation.from_quat(quaternion.slerp(rows[0], rows[1], part))
    expected = Slerp([0.0, 1.0], Rotation.concatenate([start, end]))(part)
    assert (seen * expected.inv()).magnitude().max() < ROTATION_ATOL_RAD


def test_signs_are_made_continuous():
    rows = Rotation.from_rotvec(np.linspace(0, 9 * np.pi, 200)[:, None] * [0.0, 0.6, 0.8]).as_quat()
    flipped = rows * np.random.default_rng(SEED).choice([-1.0, 1.0], 200)[:, None]
    smooth = quaternion.in_one_hemisphere(flipped)
    assert np.einsum("ij,ij->i", smooth[1:], smooth[:-1]).min() > 0
    assert quaternion.rotation_between_rad(smooth, rows).max() < ROUNDING
    np.testing.assert_array_equal(smooth[0], flipped[0])


@pytest.mark.parametrize("target", ["center", "sphere02", "cylinder04", "cone03"])
@pytest.mark.ci
def test_aspect_is_that_of_the_scenes_body_axis_at_emission(scene, target):
    quick = scene.replace(frames={"count": 40, "interval_s": 0.037, "start_s": 1600.0})
    rows = ws.Renderer(quick, device="cpu").render(range(40), ["sat11"], ["A"]).truth
    rows = rows[rows["target"] == target]
    aspect = aspects_rad(quick, target, rows)
    np.testing.assert_allclose(np.radians(rows["aspect_deg"]), aspect, rtol=0, atol=ASPECT_ATOL_RAD)
    turned = Rotation.from_quat(quick.scenario.attitude_quaternion(target, emission_s(rows)))
    axis = quick.scenario.body_axis(target, emission_s(rows))
    np.testing.assert_allclose(turned.apply([0, 0, 1]), axis, rtol=0, atol=ROUNDING)


def test_scene_says_which_targets_turn(scene):
    assert scene.scenario.attitude_quaternion("center", 0.0).shape == (1, 4)
    assert scene.scenario.body_axis("cone03", np.zeros(3)).shape == (3, 3)
    with pytest.raises(ws.InputError, match=r"name: must be a target of the scene \(center, .*\), got 'sat11'"):
        scene.scenario.body_axis("sat11", 0.0)


@pytest.mark.ci
def test_axis_along_no_velocity_is_refused(scene):
    still = {"kind": "state_vector", "position_m": [7e6, 0.0, 0.0], "velocity_m_s": [0.0, 0.0, 0.0]}
    rule = r"^center: attitude\.axis: must be 'random' or a vector for a target at rest"
    fallen = scene.replace(trajectory=still, duration_s=60.0, frames={"count": 3, "interval_s": 10.0})
    with pytest.raises(ws.InputError, match=rule):
        fallen.scenario.body_axis("center", [0.0])
    with pytest.raises(ws.InputError, match=rule):
        ws.Renderer(fallen).render([0], sensors=["sat11"])
