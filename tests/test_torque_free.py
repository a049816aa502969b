"""Torque-free rotation: integrated equations, mpmath over long times, what is conserved, the kernel, and scenes."""

import mpmath
import numpy as np
import pytest
import warp as wp
from bodies import aspects_rad, emission_s
from on_devices import launched, target_field
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipkm1
from warpsim_kernels import motion
from warpsim_kernels.timed_tables import torque_free_axes

import warpsim as ws
from warpsim.output.check import scene_report
from warpsim.quaternion import product, rotated, rotation_between_rad
from warpsim.render.target_field import make_nutations, motion_struct
from warpsim.target.attitude import body_motion
from warpsim.target.rotating_area import RotatingArea

ROTATION_ATOL_RAD = 1e-9  # asked for over 1,000 rotations; the cubics are good to 1e-11
INTEGRATED_ATOL_RAD = 1e-10  # DOP853 at rtol 1e-13 over ten rotations
CONSERVED_RTOL = 1e-12  # asked for; the nodes are float64
CUBIC_RTOL = 1e-8  # a rate by differences of the cubic's rotation, good to 1e-11 rad, over 1e-3 of a turn
KERNEL_ATOL = 1e-13  # two evaluations of one expression
SYMMETRIC_ATOL_RAD = 5e-11  # the cubics' 1e-11 rad, twice

START = tuple(np.array([0.1, 0.5, -0.3, 0.8]) / np.linalg.norm([0.1, 0.5, -0.3, 0.8]))

MOTIONS = {
    "about the largest": ((1.5, 2.0, 3.0), (10.0, 20.0, 30.0)),
    "about the smallest": ((3.0, 2.0, 1.5), (10.0, 20.0, 30.0)),
    "backwards": ((2.0, 1.5, 3.0), (10.0, -20.0, -30.0)),
    "axes in another order": ((2.0, 3.0, 1.5), (-10.0, -20.0, 30.0)),
    "Dzhanibekov": ((3.0, 2.0, 1.0), (0.01, 40.0, 0.0)),
    "nearer still": ((3.0, 2.0, 1.0), (1e-9, 40.0, 2e-9)),
    "flat": ((1.0, 2.0, 3.0), (20.0, -3.0, 8.0)),
    "oblate": ((1.0, 1.0, 1.8), (3.0, 4.0, 20.0)),
    "prolate": ((1.0, 2.0, 2.0), (3.0, 4.0, -20.0)),
    "nearly symmetric": ((1.0, 1.0 + 1e-14, 1.8), (3.0, 4.0, 20.0)),
    "sphere": ((1.0, 1.0, 1.0), (3.0, 4.0, -20.0)),
    "about one axis": ((3.0, 2.0, 1.0), (0.0, 0.0, -20.0)),
    "about the middle one": ((3.0, 2.0, 1.0), (0.0, 20.0, 0.0)),
    "at rest": ((3.0, 2.0, 1.0), (0.0, 0.0, 0.0)),
}
every_motion = pytest.mark.parametrize(("moments", "rates_deg_s"), MOTIONS.values(), ids=MOTIONS)


def free(moments, rates_deg_s, quaternion=START):
    return ws.TorqueFree(moments=moments, rates_deg_s=rates_deg_s, quaternion=quaternion).motion(0, 0)


@pytest.mark.parametrize("factor", [2.0**-1000, 2.0**-560, 2.0**530, 2.0**1000])
@pytest.mark.parametrize("name", ["about the largest", "Dzhanibekov", "flat"])
def test_only_ratios_of_moments_count(name, factor):
    """Bit for bit where the factor is a power of 2."""
    moments, rates_deg_s = MOTIONS[name]
    found, expected = (free(own, rates_deg_s).at([0.0, 7.0, 1e3]) for own in (np.multiply(moments, factor), moments))
    assert np.isfinite(expected).all()
    np.testing.assert_array_equal(found, expected)


def integrated(moments, rates_deg_s, times_s):
    """Rotations, and rates in body axes, by Euler's equations."""
    inertia = np.array(moments)

    def derivative(_, state):
        q, w = state[:4], state[4:]
        return np.concatenate([0.5 * product(q, [*w, 0.0]), -np.cross(w, inertia * w) / inertia])

    start = np.concatenate([START, np.radians(rates_deg_s)])
    found = solve_ivp(derivative, (0.0, times_s[-1]), start, "DOP853", times_s, rtol=1e-13, atol=1e-15)
    return found.y[:4].T / np.linalg.norm(found.y[:4], axis=0)[:, None], found.y[4:].T


@every_motion
def test_rotation_is_that_of_eulers_equations(moments, rates_deg_s):
    """Over ten rotations; next to the separatrix, where the equations are unstable, over three."""
    slow = max(np.linalg.norm(rates_deg_s), 1.0)
    times_s = np.linspace(0.0, (3 if rates_deg_s[1] == 40.0 else 10) * 360.0 / slow, 97)
    expected, _ = integrated(moments, rates_deg_s, times_s)
    assert rotation_between_rad(free(moments, rates_deg_s).at(times_s), expected).max() < INTEGRATED_ATOL_RAD


def exact(moments, rates_deg_s, times_s):
    """Rotations against that at the epoch by mpmath: Euler's angles about the momentum, precession by quadrature.

    Axis 3, which the angles count from, is the body's z; moments are in order, and the turning is about z.
    """
    a, b, c = map(mpmath.mpf, moments)
    rate = [mpmath.radians(mpmath.mpf(value)) for value in rates_deg_s]
    energy2 = sum(m * w * w for m, w in zip((a, b, c), rate, strict=True))
    length2 = sum((m * w) ** 2 for m, w in zip((a, b, c), rate, strict=True))
    length = mpmath.sqrt(length2)
    w1 = mpmath.sqrt((length2 - energy2 * c) / (a * (a - c)))
    w2 = mpmath.sqrt((length2 - energy2 * c) / (b * (b - c)))
    w3 = mpmath.sqrt((length2 - energy2 * a) / (c * (c - a)))
    sign = 1 if c > b else -1
    speed = mpmath.sqrt((c - b) * (length2 - energy2 * a) / (a * b * c))
    modulus = (a - b) * (length2 - energy2 * c) / ((c - b) * (length2 - energy2 * a))
    phi = mpmath.atan2(sign * rate[1] / w2, rate[0] / w1)
    begin = mpmath.ellipf(phi, modulus)
    half = 2 * mpmath.ellipk(modulus) / speed

    def rates(time):
        u = begin + speed * time
        cn, sn, dn = (mpmath.ellipfun(name, u, m=modulus) for name in ("cn", "sn", "dn"))
        return w1 * cn, sign * w2 * sn, w3 * dn

    def turning(time):
        x, y, _ = rates(time)
        return length * (a * x * x + b * y * y) / ((a * x) ** 2 + (b * y) ** 2)

    def over(span):
        return mpmath.quad(turning, mpmath.linspace(0, span, 5))

    def from_body(time, precession):
        x, y, z = rates(time)
        momentum = mpmath.matrix([a * x, b * y, c * z]) / length
        node = mpmath.matrix([-momentum[1], momentum[0], 0])
        node /= mpmath.norm(node)
        across = mpmath.matrix([momentum[1] * node[2] - momentum[2] * node[1],
                                momentum[2] * node[0] - momentum[0] * node[2],
                                momentum[0] * node[1] - momentum[1] * node[0]])  # fmt: skip
        rows = mpmath.matrix([list(node), list(across), list(momentum)])
        turn = mpmath.matrix([[mpmath.cos(precession), -mpmath.sin(precession), 0],
                              [mpmath.sin(precession), mpmath.cos(precession), 0], [0, 0, 1]])  # fmt: skip
        return turn * rows

    over_half, found = over(half), []
    for time_s in times_s:
        n_half = mpmath.floor(time_s / half)
        angle = n_half * over_half + over(time_s - n_half * half)
        found.append((from_body(0, 0).T * from_body(time_s, angle)).tolist())
    return np.array(found, dtype=np.float64)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("moments", "rates_deg_s"),
    [
        ((1.5, 2.0, 3.0), (10, 20, 30)),
        ((3.0, 2.0, 1.5), (10, 20, 30)),
        ((2.0, 1.9, 1.0), (4, 3, 20)),
        ((1, 2, 3), (3, 2, 20)),
    ],
)
def test_rotation_over_a_thousand_rotations(moments, rates_deg_s, record_accuracy):
    """Rotations after 999 to 1,001 turns against mpmath with 25 digits."""
    own = free(moments, rates_deg_s, (0.0, 0.0, 0.0, 1.0))
    times_s = np.array([0.3, 999.1, 1000.77]) * 360.0 / np.linalg.norm(rates_deg_s)
    with mpmath.workdps(25):
        expected = exact(moments, rates_deg_s, [mpmath.mpf(float(time_s)) for time_s in times_s])
    found = np.stack([rotated(own.at(times_s), axis) for axis in np.eye(3)], axis=-1)
    worst = np.linalg.norm(found @ np.swapaxes(expected, 1, 2) - np.eye(3), axis=(1, 2)).max() / np.sqrt(2)
    record_accuracy("Torque-free attitude after 1,000 rotations", worst, ROTATION_ATOL_RAD, "rad", "mpmath")
    assert worst < ROTATION_ATOL_RAD


@every_motion
def test_momentum_and_energy_stay(moments, rates_deg_s):
    """At the nodes the momentum of the nodes' own rates is the z axis; rates between them are those of differences."""
    own, inertia = free(moments, rates_deg_s), np.array(moments)
    nutation = own.nutation
    start = inertia * np.radians(rates_deg_s)
    length, energy2 = np.linalg.norm(start), start @ np.radians(rates_deg_s)
    inner, step = nutation.quaternion, nutation.step * nutation.rate_rev_s * len(nutation.quaternion)
    turning = step + 0.5 * product([0.0, 0.0, 2 * np.pi * nutation.precession_rev_s, 0.0], inner)
    rate_rad_s = 2.0 * product(inner * [-1.0, -1.0, -1.0, 1.0], turning)[:, :3]
    momentum = rotated(inner, inertia * rate_rad_s)
    assert np.abs(momentum - [0.0, 0.0, length]).max() <= CONSERVED_RTOL * length
    assert np.abs(np.sum(inertia * rate_rad_s**2, axis=1) - energy2).max() <= CONSERVED_RTOL * energy2
    np.testing.assert_allclose(rotated(own.frame, [0.0, 0.0, length]), rotated(START, start), rtol=0, atol=1e-14)
    times_s = np.linspace(0.0, 5000.0, 301)
    before, after = own.at(times_s - 0.01), own.at(times_s + 0.01)
    difference = 2.0 * product(after - before, own.at(times_s) * [-1.0, -1.0, -1.0, 1.0])[:, :3] / 0.02
    body = rotated(own.at(times_s) * [-1.0, -1.0, -1.0, 1.0], difference)
    found = rotated(own.at(times_s), inertia * body)
    assert np.abs(found - rotated(START, start)).max() <= 1e-5 * max(length, 1e-9)  # differences: rate^3 step^2 / 6


@pytest.mark.parametrize("moments", [(1.0, 1.0, 1.8), (2.0, 2.0, 1.0)], ids=["oblate", "prolate"])
def test_symmetric_body_precesses_as_the_motion_does(moments):
    """Spin, precession and angle of a symmetric top by its textbook expressions, as the other attitude has them."""
    rate = np.array([3.0, 4.0, 20.0])
    momentum = np.array(moments) * rate
    attitude = ws.Attitude(
        axis=tuple(rotated(START, momentum)),
        precession_angle_deg=float(np.degrees(np.arctan2(np.hypot(*momentum[:2]), momentum[2]))),
        precession_rev_s=float(np.linalg.norm(momentum) / moments[0] / 360.0),
        spin_rev_s=float(rate[2] * (1.0 - moments[2] / moments[0]) / 360.0),
        rolling_phase_rev=0.0, spin_phase_rev=0.0, precession_phase_rev=0.0,
    )  # fmt: skip
    times_s = np.linspace(0.0, 3000.0, 400)
    ours = Rotation.from_quat(free(moments, tuple(rate)).at(times_s))
    theirs = Rotation.from_quat(body_motion(attitude, np.ones(3), 0, 0).at(times_s))
    # Phases apart, which are those of the start: about the momentum, and about the body's axis.
    reference = rotated(START, momentum) / np.linalg.norm(momentum)
    azimuth = [turned.apply([0.0, 0.0, 1.0])[0] for turned in (theirs, ours)]
    across = [axis - (axis @ reference) * reference for axis in azimuth]
    angle = np.arctan2(np.cross(*across) @ reference, across[0] @ across[1])
    spin = (Rotation.from_rotvec(angle * reference) * theirs).inv() * ours
    assert np.abs(spin.as_rotvec()[:, :2]).max() < SYMMETRIC_ATOL_RAD
    assert (spin * spin[0].inv()).magnitude().max() < SYMMETRIC_ATOL_RAD


def test_on_the_separatrix_the_body_turns_over_once():
    """6, 5, 2 with rates 1 : x : 1 is exactly there: hyperbolic functions of time."""
    moments, rates_deg_s = (6.0, 5.0, 2.0), (10.0, 13.0, 10.0)
    own, (a, b, c) = free(moments, rates_deg_s), moments
    middle = np.hypot(13.0, 10.0 * np.sqrt(a * (a - c) / (b * (b - c))))  # 4 : 3 of the outer ones
    speed = np.radians(middle) * np.sqrt((a - b) * (b - c) / (a * c))
    start = np.arctanh(13.0 / middle)
    times_s = np.linspace(0.0, 600.0 / speed, 500)
    sense = np.sign((c - a) / b)  # of the middle rate, as both others are positive
    u = sense * start + speed * times_s
    rates = np.stack(
        [10.0 * np.cosh(start) / np.cosh(u), sense * middle * np.tanh(u), 10.0 * np.cosh(start) / np.cosh(u)], 1
    )
    momentum = rotated(own.at(times_s) * [-1.0, -1.0, -1.0, 1.0], own.axes[0])
    expected = rates * moments / np.linalg.norm(np.array(rates_deg_s) * moments)
    assert np.abs(momentum - expected).max() < ROTATION_ATOL_RAD


@pytest.mark.ci
def test_nutation_has_the_period_of_the_elliptic_integral():
    """Motions from far to near to the separatrix; scipy's K of the complement."""
    for w in np.logspace(-4, 0, 200):
        own = free((3.0, 2.0, 1.0), (float(w), 1.0, 0.0)).nutation
        largest2 = w**2 + 2.0 * (2.0 - 1.0) / (3.0 * (3.0 - 1.0))  # of the rate about x
        speed = np.sqrt((3.0 - 2.0) * (3.0 - 1.0) / (2.0 * 1.0) * largest2) * np.radians(1.0)
        expected = speed / (4.0 * ellipkm1(w**2 / largest2))
        assert own.rate_rev_s == pytest.approx(expected, rel=1e-13)


def test_steady_turns_are_about_a_fixed_axis():
    own = free((3.0, 2.0, 1.0), (0.0, -20.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    half = np.radians(-20.0 * 7.0) / 2
    np.testing.assert_allclose(abs(own.at(7.0)[0] @ [0.0, np.sin(half), 0.0, np.cos(half)]), 1.0, rtol=0, atol=1e-15)
    np.testing.assert_allclose(free((3, 2, 1), (0, 0, 0)).at([0.0, 1e5]), [START, START], rtol=0, atol=1e-15)


def test_unstable_axis_turns_over_as_often_as_the_period_says():
    """Dzhanibekov's wing nut: a period is 4 K / speed, K = ln(4 / k') next to the separatrix."""
    own = free((3.0, 2.0, 1.0), (0.01, 40.0, 0.0))
    speed = np.radians(40.0) * np.sqrt((3 - 2) * (2 - 1) / (3.0 * 1.0))
    complement = 0.01 / (40.0 * np.sqrt(2 * (2 - 1) / (3 * (3 - 1))))  # the rate about x: now the least, later the most
    period_s = 4.0 * np.log(4.0 / complement) / speed
    assert own.nutation.rate_rev_s == pytest.approx(1.0 / period_s, rel=1e-6)
    axis = rotated(own.at(np.linspace(0.0, period_s, 2000)), [0.0, 1.0, 0.0]) @ own.axes[0]
    assert axis.max() > 0.999 and axis.min() < -0.999


@wp.kernel(enable_backward=False)
def axes_kernel(
    attitude: motion.Attitude, nodes: wp.array2d[wp.quatd], first: int, count: int,
    time_s: wp.array[wp.float64], axes: wp.array[wp.mat33d],
):  # fmt: skip
    i = wp.tid()
    axes[i] = torque_free_axes(attitude, nodes, first, count, time_s[i])


def test_kernel_has_the_hosts_rotation(device):
    bodies = [free(*given) for given in MOTIONS.values()]
    nodes, spans = make_nutations([*bodies, bodies[0]], wp.get_device(device))
    assert spans[-1] == spans[0] and nodes.shape[0] == sum(count for _, count in spans[:-1])
    times_s = np.concatenate([[0.0, -0.5, 1e6], np.random.default_rng(3).uniform(0, 1e5, 500)])
    for own, (first, count) in zip(bodies, spans, strict=False):
        inputs = [motion_struct(own), nodes, first, count, times_s]
        (found,) = launched(axes_kernel, len(times_s), inputs, [wp.mat33d], device)
        expected = np.stack([rotated(own.at(times_s), axis) for axis in np.eye(3)], axis=1)
        assert np.abs(found - expected).max() < 10 * KERNEL_ATOL


def test_sign_is_continuous():
    quaternion = free(*MOTIONS["about the smallest"]).at(np.arange(0.0, 500.0, 0.1))
    assert np.einsum("ij,ij->i", quaternion[1:], quaternion[:-1]).min() > 0.99


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"moments": [3, 1, 1]}, "moments: none must exceed the sum of the other two, got [3.0, 1.0, 1.0]"),
        ({"moments": [3, 2, 0]}, "moments[2]: must be > 0, got 0"),
        ({"moments": [3, 2]}, "moments[2]: is required"),
        ({"rates_deg_s": [1, 2, "fast"]}, "rates_deg_s[2]: must be a number, got 'fast'"),
        ({"quaternion": [1, 1, 0, 0]}, "quaternion: norm must be 1 within 0.001, got 1.41421"),
    ],
)
def test_what_is_refused(fields, message):
    with pytest.raises(ws.InputError) as error:
        ws.TorqueFree(**{"moments": [3, 2, 1], "rates_deg_s": [1, 2, 3]} | fields)
    assert str(error.value) == f"TorqueFree: {message}"


def test_flat_bodies_may_be_rounded():
    assert ws.TorqueFree((0.1, 0.2, 0.1 + 0.2), (1, 2, 3)).moments[2] > 0.3


BOX = {"kind": "torque_free", "moments": [1.0, 0.9, 0.4], "rates_deg_s": [10.0, 40.0, 5.0]}


@pytest.fixture(scope="module")
def tumbling():
    scene = ws.Scene.load("stss").replace(sky__catalog="none")
    return scene.replace(targets__0__attitude=BOX, targets__2__attitude={**BOX, "quaternion": [0, 0, 0, 1]})


def test_scene_file_and_seeds(tumbling, tmp_path):
    tumbling.save(tmp_path / "scene.toml")
    again = ws.Scene.load(tmp_path / "scene.toml")
    assert again == tumbling and again.targets[0].attitude == ws.TorqueFree((1.0, 0.9, 0.4), (10.0, 40.0, 5.0))
    first = tumbling.scenario.attitude_quaternion("center", 0.0)
    other = tumbling.replace(seed=5).scenario.attitude_quaternion("center", 0.0)
    assert rotation_between_rad(first, other)[0] > 0.01
    np.testing.assert_allclose(tumbling.scenario.attitude_quaternion("cylinder01", 0.0), [[0, 0, 0, 1]], atol=1e-10)


@pytest.mark.ci
def test_truth_has_the_aspect_of_the_rotation(tumbling, device):
    truth = ws.Renderer(tumbling, device=device).render(range(3), tumbling.sensor_names[:2], ["A"]).truth
    for name in ("center", "cylinder01"):
        rows = truth[truth["target"] == name]
        cosine = np.cos(aspects_rad(tumbling, name, rows))
        np.testing.assert_allclose(np.cos(np.radians(rows["aspect_deg"])), cosine, rtol=0, atol=1e-9)
        expected = Rotation.from_quat(tumbling.scenario.attitude_quaternion(name, emission_s(rows))).inv().as_matrix()
        labelled = Rotation.from_quat(np.stack([rows[f"target_q{part}"] for part in "xyzw"], axis=1)).as_matrix()
        np.testing.assert_allclose(labelled, expected, rtol=0, atol=1e-9)


def test_kernel_holds_it_only_where_a_target_turns_freely(tumbling):
    plain = ws.Scene.load("stss")
    fields = [target_field(one, ["A"]) for one in (plain, tumbling)]
    assert [field.features.torque_free for field in fields] == [False, True]


@pytest.mark.parametrize("rates_deg_s", [(30.0, 5.0, 2000.0), (0.4, 0.3, 2.0)], ids=["fast", "slow"])
def test_mean_area_over_turns_is_that_of_many_times(rates_deg_s):
    """What warms a body: the mean over phases where it turns fast, the area itself where it does not."""
    shape = ws.Cylinder(radius_m=0.3, height_m=2.0)
    bodies = [free((1.0, 0.9, 0.4), rates_deg_s), free((1.0, 0.9, 0.4), rates_deg_s, (0.0, 0.6, 0.0, 0.8))]
    span_s = 3600.0
    sun = np.broadcast_to([0.48, 0.6, 0.64], (2, 1, 3))
    found = RotatingArea(shape, bodies, span_s).towards(np.array([100.0]), sun)[:, 0]
    times_s = np.linspace(0.0, 36_000.0, 200_001) if rates_deg_s[2] > 100 else np.array([100.0])
    for own, area_m2 in zip(bodies, found, strict=True):
        seen = rotated(own.at(times_s) * [-1.0, -1.0, -1.0, 1.0], sun[0, 0])
        assert area_m2 == pytest.approx(shape.projected_area_along_m2(seen).mean(), rel=2e-3)


@pytest.mark.ci
def test_report_states_both_periods(tumbling):
    lines = [line for line in scene_report(tumbling.scenario).splitlines() if "turns freely" in line]
    own = tumbling.scenario.attitudes[0].nutation
    words = (
        f"turns freely, {own.precession_rev_s:.4g} rev/s about its angular momentum, "
        f"and nutates in {1 / own.rate_rev_s:.4g} s"
    )
    assert [line.split(maxsplit=1)[1] for line in lines] == [f"center {words}"]
