"""Targets: outlines, attitude, tracks between nodes, radiance table, occultation, light time."""

from fractions import Fraction
from itertools import pairwise

import erfa
import mpmath
import numpy as np
import pytest
import warp as wp
from bodies import ends_m
from conftest import slow
from on_devices import launched, radiance_kernel
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial import ConvexHull
from warpsim_kernels import apparent, motion
from warpsim_kernels.earth import Earth, is_occulted

import warpsim as ws
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING, SPEED_OF_LIGHT_M_S
from warpsim.orbit.track import Track
from warpsim.render.target_field import earth_struct, make_radiance
from warpsim.target.attitude import body_motion

SEED = 577215

AREA_RTOL = 1e-12  # float64 rounding
MESH_RTOL = 1e-4  # the mesh's own polygons: (2 pi / 2000)^2 / 6 is 2e-6
MEAN_RTOL = 1e-10  # quadrature over the aspect
ANGLE_ATOL_RAD = 1e-9  # after 1e6 s
TRACK_ATOL_M = 1e-6  # the same cubic in another order of operations, float64 at 1e7 m
RADIANCE_RTOL = 1e-8  # cubic Hermite in ln(T)
WIDE_RADIANCE_RTOL = 1e-8  # measured 8e-10, largest at 3 K
RANGE_ATOL_M = 1e-6
DIRECTION_ATOL_RAD = 1e-12
LIGHT_TIME_RTOL = 3e-14  # three steps of the iteration leave (v / c)^3 of the range
SECOND_ORDER_RAD = 5e-9  # v / c of the Earth times that of the orbit, 1e-4 * 2.6e-5, and its like
RADIANCE_FLOOR_W_M2_SR = 2e-300  # the table keeps this instead of 0, to have a logarithm

SHAPES = {
    "sphere": ws.Sphere(0.7),
    "cylinder": ws.Cylinder(0.4, 1.9),
    "cone": ws.Cone(0.5, 1.7),
    "flat-cone": ws.Cone(1.5, 0.4),
    "needle-cylinder": ws.Cylinder(1e-2, 1e2),
    "needle-cone": ws.Cone(1e-2, 1e2),
    "disc-cylinder": ws.Cylinder(10.0, 1e-3),
    "disc-cone": ws.Cone(10.0, 1e-3),
    "frustum": ws.Frustum(0.5, 0.2, 1.1),
    "frustum-wide-top": ws.Frustum(0.2, 0.6, 0.3),
    "needle-frustum": ws.Frustum(1e-2, 2e-3, 1e2),
    "disc-frustum": ws.Frustum(9.0, 10.0, 1e-3),
    "plate": ws.Plate(2.0, 0.3),
}
every_shape = pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)


def side_angle_rad(shape):
    """Angle between the side and the axis: the aspect from which a cone's side begins to hide, if positive."""
    if shape.kind in ("sphere", "plate"):
        return 0.5
    base, top, height = ends_m(shape)
    return abs(np.arctan2(base - top, height))


def half_flux_area(shape, aspect_rad):
    """Projected area of a convex body as half the integral of |n . v| over its surface, in 30 digits."""
    with mpmath.workdps(30):
        theta = mpmath.mpf(aspect_rad)
        c, s = mpmath.cos(theta), abs(mpmath.sin(theta))
        if shape.kind == "sphere":
            return mpmath.pi * mpmath.mpf(shape.radius_m) ** 2
        if shape.kind == "plate":
            return mpmath.mpf(shape.width_m) * mpmath.mpf(shape.length_m) * abs(c)
        base, top, h = (mpmath.mpf(x) for x in ends_m(shape))
        slant = mpmath.sqrt((base - top) ** 2 + h * h)
        # Side normal (h cos p, h sin p, base - top) / slant; the integrand a + b cos p changes sign at +-p0.
        a, b = (base - top) * c / slant, h * s / slant
        p0 = mpmath.acos(-a / b) if b > abs(a) else mpmath.pi
        lit = a * p0 + b * mpmath.sin(p0)
        dark = a * (mpmath.pi - p0) - b * mpmath.sin(p0)
        side = (base + top) * slant / 2 * 2 * (abs(lit) + abs(dark))
        return (mpmath.pi * (base**2 + top**2) * abs(c) + side) / 2


def hard_aspects(shape):
    """0, 90, 180 deg, the half-angle exactly and next to it, and random ones."""
    half = side_angle_rad(shape)
    near = [half, np.nextafter(half, 0), np.nextafter(half, 4), half - 1e-9, half + 1e-9, np.pi - half]
    ends = [0.0, 1e-12, np.pi / 2, np.nextafter(np.pi / 2, 4), np.pi, np.pi - 1e-9]
    return np.concatenate([near, ends, np.random.default_rng(SEED).uniform(0, np.pi, 300)])


def hull_area(shape, aspect_rad):
    """Area of the convex hull of the body's projected rims."""
    phi = np.arange(2000) * 2 * np.pi / 2000
    base, top, height = ends_m(shape)
    ring = np.column_stack([np.cos(phi), np.sin(phi), 0 * phi])
    points = np.vstack([base * ring, top * ring + [0, 0, height]])
    across = points[:, 0] * np.cos(aspect_rad) - points[:, 2] * np.sin(aspect_rad)  # view from (sin, 0, cos)
    return ConvexHull(np.column_stack([across, points[:, 1]])).volume


@every_shape
def test_area_is_half_the_surface_integral(shape, record_accuracy):
    aspect = hard_aspects(shape)
    expected = np.array([float(half_flux_area(shape, x)) for x in aspect])
    np.testing.assert_allclose(shape.projected_area_m2(aspect), expected, rtol=AREA_RTOL, atol=0)
    error = np.abs(shape.projected_area_m2(aspect) / np.where(expected, expected, 1) - (expected != 0)).max()
    record_accuracy("Projected area", error, AREA_RTOL, "of it", "mpmath")


@pytest.mark.ci
@pytest.mark.parametrize("name", [name for name in SHAPES if name not in ("sphere", "plate")])
def test_area_matches_the_outline_of_a_mesh(name, record_accuracy):
    shape = SHAPES[name]
    aspect = np.concatenate([np.linspace(0.01, np.pi - 0.01, 40), hard_aspects(shape)[:2]])
    expected = [hull_area(shape, x) for x in aspect]
    np.testing.assert_allclose(shape.projected_area_m2(aspect), expected, rtol=MESH_RTOL, atol=0)
    error = np.abs(shape.projected_area_m2(aspect) / expected - 1).max()
    record_accuracy("Projected area, as a mesh", error, MESH_RTOL, "of it", "hull of 2,000 corners around")


@every_shape
def test_mean_area_is_a_quarter_of_the_surface(shape, record_accuracy):
    """Cauchy's theorem, by quadrature in pieces that end where the outline changes."""
    half = side_angle_rad(shape)
    edges = np.unique([0.0, half, np.pi / 2, np.pi - half, np.pi])
    x, weight = np.polynomial.legendre.leggauss(120)
    total = 0.0
    for low, high in pairwise(edges):
        # The square root where the apex leaves the outline is smooth in a variable that is flat at both ends.
        t = (x + 1) / 2
        aspect = low + (high - low) * t**3 * (10 - 15 * t + 6 * t * t)
        slope = (high - low) * 30 * (t * (1 - t)) ** 2 / 2
        total += np.sum(weight * slope * shape.projected_area_m2(aspect) * np.sin(aspect))
    assert total / 2 == pytest.approx(shape.surface_m2 / 4, rel=MEAN_RTOL)
    error = abs(2 * total / shape.surface_m2 - 1)
    record_accuracy("Mean projected area", error, MEAN_RTOL, "of it", "a quarter of the surface")


def test_area_of_angles_beyond_half_a_turn():
    cone = SHAPES["cone"]
    angle = np.array([[0.3, 1.2], [2.5, 3.0]])
    np.testing.assert_allclose(cone.projected_area_m2(-angle), cone.projected_area_m2(angle), rtol=AREA_RTOL)
    far = angle + 2e5 * np.pi
    expected = [[float(half_flux_area(cone, x)) for x in row] for row in far]
    np.testing.assert_allclose(cone.projected_area_m2(far), expected, rtol=AREA_RTOL)
    with pytest.raises(ws.InputError, match="aspect_rad: must be finite, got nan"):
        cone.projected_area_m2([0.1, np.nan])


@wp.kernel(enable_backward=False)
def attitude_kernel(
    attitude: motion.Attitude, time_s: wp.array[wp.float64], turn: wp.array[wp.float64], axis: wp.array[wp.vec3d]
):
    i = wp.tid()
    turn[i] = motion.turns(attitude.precession_rev_s, time_s[i])
    axis[i] = motion.axes_before_spin(attitude, time_s[i])[2]


def attitude_struct(frame, tilt_rad, precession=(0.0, 0.0), rolling=(0.0, 0.0)):
    """The kernels' struct; motions as (rev/s, phase in rev)."""
    struct = motion.Attitude()
    struct.reference, struct.first, struct.second = (wp.vec3d(*row) for row in frame)
    struct.tilt_rad = tilt_rad
    struct.precession_rev_s, struct.precession_phase_rev = precession
    struct.rolling_rev_s, struct.rolling_phase_rev = rolling
    return struct


def device_attitude(struct, time_s, device):
    return launched(attitude_kernel, len(time_s), [struct, time_s], [wp.float64, wp.vec3d], device)


def some_frame(seed=SEED):
    """Reference, first, second: a random right-handed frame."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.linalg.det(q)


def turn_fraction(rate_rev_s, time_s):
    """Fraction of a turn, in exact rational arithmetic."""
    return (Fraction(rate_rev_s) * Fraction(time_s)) % 1


LONG_TIMES_S = np.concatenate([[0.0, 0.5, 1e6, 1e6 + 0.3, 999_999.9999], np.linspace(0, 1.1e6, 60)])


@pytest.mark.parametrize("rate_rev_s", [5.0, 4.9, -4.9, 1 / 3, 0.1, 1e-3, 0.0])
@pytest.mark.ci
def test_phase_is_kept_over_a_million_seconds(device, rate_rev_s):
    turn, _ = device_attitude(attitude_struct(some_frame(), 0.1, (rate_rev_s, 0.0)), LONG_TIMES_S, device)
    exact = np.array([float(turn_fraction(rate_rev_s, t)) for t in LONG_TIMES_S])
    error = np.abs((turn - exact + 0.5) % 1 - 0.5)
    assert error.max() * 2 * np.pi < ANGLE_ATOL_RAD
    assert ((turn >= 0) & (turn <= 1)).all()


@pytest.mark.parametrize(
    ("precession", "rolling"),
    [((5.0, 0.2), (0.0, 0.0)), ((4.9, 0.7), (0.0, 0.0)), ((0.0, 0.1), (4.9, 0.3)), ((4.9, 0.1), (5.0, 0.6))],
    ids=["precession-5", "precession-4.9", "rolling-4.9", "both"],
)
def test_axis_matches_mpmath_after_a_million_seconds(device, precession, rolling, record_accuracy):
    frame, tilt = some_frame(), 0.35
    _, axis = device_attitude(attitude_struct(frame, tilt, precession, rolling), LONG_TIMES_S, device)
    with mpmath.workdps(30):
        for seen, t in zip(axis, LONG_TIMES_S, strict=True):
            phases = [turn_fraction(rate, t) + Fraction(phase) for rate, phase in (precession, rolling)]
            azimuth, roll = (2 * mpmath.pi * mpmath.mpf(f.numerator) / f.denominator for f in phases)
            polar = mpmath.mpf(tilt) + roll
            c, s = mpmath.cos(polar), mpmath.sin(polar)
            parts = [float(c), float(s * mpmath.cos(azimuth)), float(s * mpmath.sin(azimuth))]
            apart_rad = np.linalg.norm(np.cross(seen, parts @ frame))
            assert apart_rad < ANGLE_ATOL_RAD
            record_accuracy(
                "Body axis after 1e6 s at 5 rev/s, in the kernel", apart_rad, ANGLE_ATOL_RAD, "rad", "mpmath"
            )
            assert seen @ (parts @ frame) > 0


def test_precession_keeps_the_cone_angle_and_visits_the_whole_cone(device):
    frame, tilt = some_frame(), np.radians(20.0)
    _, axis = device_attitude(attitude_struct(frame, tilt, (4.9, 0.3)), np.linspace(0, 1e6, 5000), device)
    np.testing.assert_allclose(axis @ frame[0], np.cos(tilt), rtol=0, atol=1e-14)
    azimuth = np.arctan2(axis @ frame[2], axis @ frame[1])
    assert np.histogram(azimuth, 12, (-np.pi, np.pi))[0].min() > 0


def test_precession_turns_right_handed_about_the_reference(device):
    frame = some_frame()
    _, axis = device_attitude(attitude_struct(frame, 0.5, (0.01, 0.0)), np.array([0.0, 1.0]), device)
    assert np.cross(axis[0], axis[1]) @ frame[0] > 0


def test_rolling_runs_along_a_great_circle(device):
    frame = some_frame()
    _, axis = device_attitude(attitude_struct(frame, 0.0, rolling=(0.25, 0.1)), np.linspace(0, 100, 1000), device)
    np.testing.assert_allclose(axis @ frame[2], 0, rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(axis, axis=1), 1, rtol=0, atol=1e-14)
    polar = np.unwrap(np.arctan2(axis @ frame[1], axis @ frame[0]))
    np.testing.assert_allclose(np.diff(polar), 2 * np.pi * 0.25 * 100 / 999, rtol=1e-9)


@pytest.mark.parametrize("axis", ["velocity", "random", (0.0, 0.0, -3.0)], ids=str)
def test_attitude_frame_is_right_handed_and_seeded(axis):
    attitude = ws.Attitude(precession_rev_s=1.0, precession_angle_deg=5.0, rolling_rev_s=0.1, axis=axis)
    velocity = np.array([1000.0, -7000.0, 30.0])
    settled = body_motion(attitude, velocity, 7, 3)
    frame = settled.axes
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), rtol=0, atol=1e-15 * 4)
    np.testing.assert_allclose(np.cross(frame[0], frame[1]), frame[2], rtol=0, atol=1e-15 * 4)
    if axis != "random":
        wanted = velocity if axis == "velocity" else np.array(axis)
        np.testing.assert_allclose(frame[0], wanted / np.linalg.norm(wanted), rtol=0, atol=1e-15)
    for phase in (settled.precession_phase_rev, settled.rolling_phase_rev, settled.spin_phase_rev):
        assert 0 < phase < 1
    again, other = body_motion(attitude, velocity, 7, 3), body_motion(attitude, velocity, 7, 4)
    np.testing.assert_array_equal(again.axes, frame)
    assert not np.allclose(other.axes[1], frame[1])


def orbit_tracks(n_node=40, step_s=12.0, start_s=-12.0):
    """Two crossing circular orbits, at 7000 km and at 8000 km."""
    time = start_s + step_s * np.arange(n_node)
    tracks = []
    for radius, tilt in ((7.0e6, 0.4), (8.0e6, 1.3)):
        rate = np.sqrt(3.986004418e14 / radius**3)
        across = np.array([0.0, np.cos(tilt), np.sin(tilt)])
        c, s = np.cos(rate * time)[:, None], np.sin(rate * time)[:, None]
        position = radius * (c * [1.0, 0, 0] + s * across)
        velocity = radius * rate * (c * across - s * [1.0, 0, 0])
        tracks.append(Track(f"at {radius:g} m", start_s, step_s, position, velocity))
    return tracks


def upload_tracks(tracks, device):
    """The kernels' Tracks, of bodies only."""
    rows, first = np.zeros(len(tracks), dtype=motion.BodyNodes.numpy_dtype()), 0
    for row, track in zip(rows, tracks, strict=True):
        row["first"], row["steps_per_m"] = first, 1.0 / (SPEED_OF_LIGHT_M_S * track.step_s)
        row["grid"] = track.start_s, track.step_s, track.n_node
        first += track.n_node
    struct = apparent.Tracks()
    struct.nodes = motion.Nodes()
    struct.nodes.bodies = wp.array(rows, dtype=motion.BodyNodes, device=device)
    for name in ("position_m", "velocity_m_s"):
        values = np.concatenate([getattr(track, name) for track in tracks])
        setattr(struct.nodes, name, wp.array(values, dtype=wp.vec3d, device=device))
    return struct


@wp.kernel(enable_backward=False)
def hermite_kernel(
    tracks: apparent.Tracks,
    time_s: wp.array[wp.float64],
    place: wp.array2d[wp.vec3d],
    speed: wp.array2d[wp.vec3d],
    linear: wp.array[wp.vec3d],
):
    body, i = wp.tid()
    place[body, i] = motion.hermite_position_m(tracks.nodes, body, time_s[i])
    speed[body, i] = motion.hermite_velocity_m_s(tracks.nodes, body, time_s[i])
    if body == 0:
        linear[i] = motion.linear_vector(tracks.nodes.position_m, time_s[i], tracks.nodes.bodies[0].grid)


@pytest.mark.parametrize("step_s", [12.0, 3.0], ids=["one step", "two steps"])
def test_tracks_between_nodes_are_the_hosts(device, step_s):
    tracks = [orbit_tracks()[0], orbit_tracks(n_node=160, step_s=step_s)[1]]
    time = np.concatenate([np.random.default_rng(SEED).uniform(-12, 456, 2000), [-12.0, 0.0, 12.0, 456.0, 455.9999]])
    outputs = [wp.empty(shape, dtype=wp.vec3d, device=device) for shape in ((2, len(time)), (2, len(time)), len(time))]
    inputs = [upload_tracks(tracks, device), wp.array(time, dtype=wp.float64, device=device)]
    wp.launch(hermite_kernel, (2, len(time)), inputs=inputs, outputs=outputs, device=device)
    place, speed, linear = (x.numpy() for x in outputs)
    nodes_s = -12 + 12 * np.arange(40)
    for body, track in enumerate(tracks):
        position, velocity = track.state(time)
        np.testing.assert_allclose(place[body], position, rtol=0, atol=TRACK_ATOL_M)
        np.testing.assert_allclose(speed[body], velocity, rtol=0, atol=TRACK_ATOL_M)
    straight = np.stack([np.interp(time, nodes_s, tracks[0].position_m[:, k]) for k in range(3)], axis=1)
    np.testing.assert_allclose(linear, straight, rtol=0, atol=TRACK_ATOL_M)


@wp.kernel(enable_backward=False)
def light_path_kernel(
    tracks: apparent.Tracks,
    time_s: wp.array[wp.float64],
    observer_m: wp.array[wp.vec3d],
    earth_velocity_m_s: wp.vec3d,
    observer_velocity_m_s: wp.array[wp.vec3d],
    range_m: wp.array[wp.float64],
    emission_s: wp.array[wp.float64],
    apparent_dir: wp.array[wp.vec3d],
):
    i = wp.tid()
    observer = apparent.observer_of(time_s[i], observer_m[i], earth_velocity_m_s, observer_velocity_m_s[i])
    path = apparent.path_from_body(tracks, 1, observer)
    range_m[i] = path.range_m
    emission_s[i] = path.emission_time_s
    apparent_dir[i] = path.apparent


def launch_light_path(tracks, time, observer, earth_m_s, observer_m_s, device):
    inputs = [upload_tracks(tracks, device), time, observer, wp.vec3d(*earth_m_s), observer_m_s]
    return launched(light_path_kernel, len(time), inputs, [wp.float64, wp.float64, wp.vec3d], device)


EARTH_M_S = np.array([-8_123.0, 26_700.0, 11_570.0])


def test_light_path_matches_an_independent_iteration(device):
    tracks = orbit_tracks()
    time = np.random.default_rng(SEED).uniform(0, 440, 300)
    observer, orbital = tracks[0].state(time)
    range_m, emission_s, seen = launch_light_path(tracks, time, observer, EARTH_M_S, EARTH_M_S + orbital, device)
    emitted = time.copy()
    for _ in range(20):
        distance = np.linalg.norm(tracks[1].state(emitted)[0] - observer, axis=1)
        emitted = time - distance / SPEED_OF_LIGHT_M_S
    np.testing.assert_allclose(range_m, distance, rtol=0, atol=RANGE_ATOL_M)
    np.testing.assert_allclose(time - emission_s, distance / SPEED_OF_LIGHT_M_S, rtol=0, atol=1e-13)
    # Out of the geocentric frame, which moves with the Earth, then into the observer's.
    expected = (tracks[1].state(emitted)[0] - observer) / distance[:, None]
    for velocity in (np.tile(-EARTH_M_S, (300, 1)), EARTH_M_S + orbital):
        beta = velocity / SPEED_OF_LIGHT_M_S
        expected = erfa.ab(expected, beta, 1e12, np.sqrt(1 - np.sum(beta**2, axis=1)))
    np.testing.assert_allclose(seen, expected, rtol=0, atol=DIRECTION_ATOL_RAD)
    # In the geocentric frame alone: what remains is second order in v / c.
    direct = (tracks[1].state(emitted)[0] - observer) / distance[:, None]
    direct = erfa.ab(direct, orbital / SPEED_OF_LIGHT_M_S, 1e12, 1.0)
    np.testing.assert_allclose(seen, direct, rtol=0, atol=SECOND_ORDER_RAD)


@pytest.mark.parametrize("far_m", [1e6, 1e9, 2e10], ids=["a body's own step", "within a step", "some steps"])
def test_light_that_left_before_a_node(device, far_m):
    """Just after nodes, the light left in an earlier step: the one before, or 66 s ago; and before the first node."""
    tracks = orbit_tracks()
    time = np.concatenate([12.0 * np.arange(0, 36) + 1e-6, 12.0 * np.arange(0, 36) + 5.0])
    observer = tracks[1].state(time)[0] + far_m * np.array([0.6, 0.0, 0.8])
    still = np.zeros((len(time), 3))
    range_m, emission_s, seen = launch_light_path(tracks, time, observer, np.zeros(3), still, device)
    emitted = time.copy()
    for _ in range(20):
        vector = hermite_twin(tracks[1], emitted) - observer
        distance = np.linalg.norm(vector, axis=1)
        emitted = time - distance / SPEED_OF_LIGHT_M_S
    np.testing.assert_allclose(range_m, distance, rtol=LIGHT_TIME_RTOL, atol=RANGE_ATOL_M)
    allowed_s = 2e-13 + LIGHT_TIME_RTOL * distance.max() / SPEED_OF_LIGHT_M_S
    np.testing.assert_allclose(emission_s, emitted, rtol=0, atol=allowed_s)
    np.testing.assert_allclose(seen, vector / distance[:, None], rtol=0, atol=DIRECTION_ATOL_RAD)


def hermite_twin(track, time_s):
    """Cubic between nodes by SciPy; the first and last polynomials hold beyond them."""
    node_s = track.start_s + track.step_s * np.arange(len(track.position_m))
    return CubicHermiteSpline(node_s, track.position_m, track.velocity_m_s, extrapolate=True)(time_s)


def test_target_at_the_sensor_stays_finite(device):
    tracks = orbit_tracks()
    place, speed = tracks[1].state(np.array([100.0]))
    range_m, _, seen = launch_light_path(tracks, np.array([100.0]), place, EARTH_M_S, EARTH_M_S + speed, device)
    assert range_m[0] < 1e-3
    assert np.isfinite(seen).all()


@pytest.mark.parametrize(
    ("start_k", "end_k"), [(300.0, 300.0), (200.0, 500.0), (50.0, 6000.0), (1e4, 1e4), (3.0, 30.0)], ids=str
)
def test_radiance_table_matches_the_integral(device, start_k, end_k, record_accuracy):
    bands = list(ws.BANDS)
    table = make_radiance(bands, (start_k, end_k), wp.get_device(device))
    kelvin = np.append(np.geomspace(start_k, end_k, 1001), [start_k, end_k])
    (found,) = launched(radiance_kernel, (len(bands), len(kelvin)), [table, kelvin], [wp.float64], device)
    for name, seen in zip(bands, found, strict=True):
        expected = ws.band_radiance_w_m2_sr(kelvin, ws.BANDS[name])
        np.testing.assert_allclose(seen, expected, rtol=RADIANCE_RTOL, atol=RADIANCE_FLOOR_W_M2_SR)
        known = expected > 1e3 * RADIANCE_FLOOR_W_M2_SR
        error = np.abs(seen[known] / expected[known] - 1).max(initial=0)
        record_accuracy("Band radiance, in the kernel", error, RADIANCE_RTOL, "of it", "the integral")


NARROW = ws.Band("narrow", np.array([8.0, 8.005, 8.01]), np.array([0.0, 1.0, 0.0]))
"""A band 0.01 um wide."""


def exact_radiance(kelvin, band):
    """Response times Planck's law in 30 digits."""
    with mpmath.workdps(30):
        h, c, k = mpmath.mpf("6.62607015e-34"), mpmath.mpf(299792458), mpmath.mpf("1.380649e-23")

        def planck(metres):
            return 2 * h * c * c / metres**5 / mpmath.expm1(h * c / (metres * k * mpmath.mpf(float(kelvin))))

        total = mpmath.mpf(0)
        fine = min(0.1, 1.3e-3 * float(kelvin))  # at 3 K light falls by decades within some percent
        for (a, b), (left, right) in zip(pairwise(band.wavelength_um), pairwise(band.response), strict=True):
            a, b, left, right = (mpmath.mpf(float(x)) for x in (a, b, left, right))
            total += mpmath.quad(
                lambda um, a=a, b=b, left=left, right=right: (left + (right - left) * (um - a) / (b - a))
                * planck(um / 10**6) / 10**6,
                mpmath.linspace(a, b, 2 + int((b - a) / a / fine)),
            )  # fmt: skip
        return total


@pytest.mark.parametrize(
    "band",
    [NARROW, slow(ws.BANDS["A"]), pytest.param(ws.BANDS["E"], marks=pytest.mark.ci)],
    ids=["narrow", "A", "E"],
)
def test_radiance_table_from_3_to_10000_kelvin_is_planck(device, band):
    """One table for all temperatures, against mpmath: between nodes, and where the band has next to no light."""
    tables = make_radiance([band], (3.0, 1e4), wp.get_device(device))
    kelvin = np.concatenate([np.geomspace(3.0, 1e4, 20), np.random.default_rng(SEED).uniform(3.0, 9.0, 5)])
    (found,) = launched(radiance_kernel, (1, len(kelvin)), [tables, kelvin], [wp.float64], device)
    for seen, temperature_k in zip(found[0], kelvin, strict=True):
        expected = float(exact_radiance(temperature_k, band))
        assert seen == pytest.approx(expected, rel=WIDE_RADIANCE_RTOL, abs=RADIANCE_FLOOR_W_M2_SR)


@wp.kernel(enable_backward=False)
def occulted_kernel(
    observer_m: wp.array[wp.vec3d], vector_m: wp.array[wp.vec3d], earth: Earth, hidden: wp.array[wp.int32]
):
    i = wp.tid()
    hidden[i] = 0
    if is_occulted(observer_m[i], vector_m[i], earth):
        hidden[i] = 1


def device_occulted(observer, vector, pole, device):
    earth = earth_struct(np.asarray(pole))
    (hidden,) = launched(occulted_kernel, len(observer), [observer, vector, earth], [wp.int32], device)
    return hidden.astype(bool)


def test_occultation_matches_sampling_of_the_segment(device):
    rng = np.random.default_rng(SEED)
    pole = np.array([0.02, -0.01, 1.0]) / np.linalg.norm([0.02, -0.01, 1.0])
    ends = rng.normal(size=(2, 4000, 3))
    ends *= (rng.uniform(6.6e6, 1.2e7, (2, 4000)) / np.linalg.norm(ends, axis=2))[..., None]
    ends[1, :200] = ends[0, :200] + rng.normal(size=(200, 3)) * 1e5  # near ones; some segments end before the Earth
    lowest = np.full(4000, np.inf)  # smallest (equatorial / a)^2 + (polar / b)^2 - 1 along the segment
    for part in np.linspace(0, 1, 4001):
        place = ends[0] + (ends[1] - ends[0]) * part
        along = place @ pole
        across2 = np.sum(place * place, axis=1) - along**2
        a, b = EARTH_EQUATORIAL_RADIUS_M, EARTH_EQUATORIAL_RADIUS_M * (1 - EARTH_FLATTENING)
        lowest = np.minimum(lowest, across2 / a**2 + along**2 / b**2 - 1)
    hidden = device_occulted(ends[0], ends[1] - ends[0], pole, device)
    clear = np.abs(lowest) > 1e-6  # 3 m of height; samples lie 5 km apart and miss the lowest point by less
    assert clear.mean() > 0.99
    np.testing.assert_array_equal(hidden[clear], lowest[clear] < 0)
    assert 500 < hidden.sum() < 3500


@pytest.mark.parametrize("toward_pole", [False, True], ids=["equator", "pole"])
def test_grazing_rays_feel_the_flattening_to_a_millimetre(device, toward_pole):
    """A ray along y that passes the ellipsoid's equator (or pole) just above and just below its surface."""
    radius = EARTH_EQUATORIAL_RADIUS_M * (1 - EARTH_FLATTENING if toward_pole else 1)
    height = np.array([1e-3, -1e-3])
    observer = np.zeros((2, 3))
    observer[:, 2 if toward_pole else 0] = radius + height
    observer[:, 1] = -3e6
    hidden = device_occulted(observer, np.tile([0.0, 6e6, 0.0], (2, 1)), [0.0, 0.0, 1.0], device)
    np.testing.assert_array_equal(hidden, [False, True])
    short = device_occulted(observer, np.tile([0.0, 2.9e6, 0.0], (2, 1)), [0.0, 0.0, 1.0], device)
    away = device_occulted(observer, np.tile([0.0, -6e6, 0.0], (2, 1)), [0.0, 0.0, 1.0], device)
    assert not short.any() and not away.any()
