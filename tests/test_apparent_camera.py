"""Apparent directions against ERFA and closed forms; camera axes and projection against astropy.wcs."""

import erfa
import mpmath
import numpy as np
import pytest
import warp as wp
from warpsim_kernels import apparent as apparent_kernels
from warpsim_kernels import camera as camera_kernels

import warpsim as ws
from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.optics.wcs import tan_wcs
from warpsim.render.device_upload import camera_struct

SEED = 161803
ARCSEC_RAD = np.pi / 180 / 3600

ERFA_ATOL = 1e-5 * ARCSEC_RAD  # ERFA adds the Sun's potential, 4e-7 arcsec
NO_SUN_ATOL = 1e-15 * 4  # the same formula in two orders: float64 rounding of unit vectors
DEVICE_ATOL_RAD = 1e-12
WCS_ATOL_PX = 1e-9  # float64 rounding of degrees times the focal length in pixels
AXES_ATOL = 4e-15  # float64 rounding of unit vectors

EARTH_M_S = np.array([-8_123.0, 26_700.0, 11_570.0])
LEO_M_S = np.array([3_100.0, -4_200.0, 5_600.0])
VELOCITIES = {
    "at-rest": np.zeros(3),
    "earth": EARTH_M_S,
    "earth-and-orbit": EARTH_M_S + LEO_M_S,
    "half-light": np.array([0.3, -0.4, 0.0]) * SPEED_OF_LIGHT_M_S,
}


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def random_directions(n, seed=SEED):
    return unit(np.random.default_rng(seed).normal(size=(n, 3)))


@wp.kernel(enable_backward=False)
def aberrated_kernel(direction: wp.array[wp.vec3d], velocity_m_s: wp.vec3d, out: wp.array[wp.vec3d]):
    i = wp.tid()
    boost = apparent_kernels.boost_by(velocity_m_s)
    out[i] = wp.normalize(apparent_kernels.boosted(direction[i], wp.float64(1.0), boost))


pinhole_places = camera_kernels.projection(False)


@wp.kernel(enable_backward=False)
def project_kernel(
    camera: camera_kernels.Camera,
    axes: wp.mat33d,
    direction: wp.array[wp.vec3d],
    xy_px: wp.array[wp.vec2d],
    depth: wp.array[wp.float64],
    inside: wp.array[wp.int32],
):
    i = wp.tid()
    xy_px[i] = pinhole_places(camera, axes, direction[i])
    depth[i] = camera_kernels.depth(axes, direction[i])
    if camera_kernels.within_frame(camera, xy_px[i], wp.float64(0.0)):
        inside[i] = 1


@wp.kernel(enable_backward=False)
def axes_kernel(boresight: wp.array[wp.vec3d], up: wp.array[wp.vec3d], spare_up: wp.vec3d, axes: wp.array[wp.mat33d]):
    i = wp.tid()
    axes[i] = camera_kernels.camera_axes(boresight[i], up[i], spare_up)


def device_axes(boresight, up, device, spare_up=(1.0, 0.0, 0.0)):
    out = wp.empty(len(boresight), dtype=wp.mat33d, device=device)
    inputs = [wp.array(x, dtype=wp.vec3d, device=device) for x in (boresight, np.broadcast_to(up, boresight.shape))]
    wp.launch(axes_kernel, len(boresight), inputs=[*inputs, wp.vec3d(*spare_up)], outputs=[out], device=device)
    return out.numpy()


def device_project(camera, axes, direction, device):
    struct = camera_struct(camera)
    n = len(direction)
    xy, depth = wp.empty(n, dtype=wp.vec2d, device=device), wp.empty(n, dtype=wp.float64, device=device)
    inside = wp.zeros(n, dtype=wp.int32, device=device)
    inputs = [struct, wp.mat33d(*axes.ravel().tolist()), wp.array(direction, dtype=wp.vec3d, device=device)]
    wp.launch(project_kernel, n, inputs=inputs, outputs=[xy, depth, inside], device=device)
    return xy.numpy(), depth.numpy(), inside.numpy().astype(bool)


@pytest.mark.parametrize("velocity_m_s", [EARTH_M_S, EARTH_M_S + LEO_M_S], ids=["earth", "earth-and-orbit"])
def test_aberration_matches_erfa(velocity_m_s, record_accuracy):
    direction = random_directions(2000)
    beta = velocity_m_s / SPEED_OF_LIGHT_M_S
    seen = ws.apparent_direction(direction, velocity_m_s)
    for sun_au, atol in ((1.0, ERFA_ATOL), (1e12, NO_SUN_ATOL)):
        expected = erfa.ab(direction, beta, sun_au, np.sqrt(1 - beta @ beta))
        np.testing.assert_allclose(seen, expected, rtol=0, atol=atol)
        if sun_au == 1.0:
            error_arcsec = np.abs(seen - expected).max() / ARCSEC_RAD
            record_accuracy("Aberration", error_arcsec, atol / ARCSEC_RAD, "arcsec", "ERFA")
    assert np.abs(seen - direction).max() > 15 * ARCSEC_RAD  # there is something to compare


def test_aberration_at_half_the_speed_of_light():
    """The textbook's cos a' = (cos a + b) / (1 + b cos a), in 40 digits."""
    velocity = VELOCITIES["half-light"]
    for direction in random_directions(20):
        seen = ws.apparent_direction(direction, velocity)
        with mpmath.workdps(40):
            length = mpmath.norm([mpmath.mpf(float(x)) for x in direction])
            cosine = mpmath.fdot(direction.tolist(), (velocity / np.linalg.norm(velocity)).tolist()) / length
            beta = mpmath.norm([mpmath.mpf(float(x)) for x in velocity]) / SPEED_OF_LIGHT_M_S
            expected = float((cosine + beta) / (1 + beta * cosine))
        assert seen @ velocity / np.linalg.norm(velocity) == pytest.approx(expected, rel=0, abs=1e-14)
        assert np.linalg.norm(seen) == pytest.approx(1.0, rel=0, abs=AXES_ATOL)
        assert np.linalg.det([direction, seen, velocity]) / SPEED_OF_LIGHT_M_S == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize("velocity_m_s", VELOCITIES.values(), ids=VELOCITIES)
def test_device_aberration_is_the_hosts(device, velocity_m_s):
    direction = np.concatenate([random_directions(2000), np.eye(3), -np.eye(3)])
    out = wp.empty(len(direction), dtype=wp.vec3d, device=device)
    inputs = [wp.array(direction, dtype=wp.vec3d, device=device), wp.vec3d(*velocity_m_s)]
    wp.launch(aberrated_kernel, len(direction), inputs=inputs, outputs=[out], device=device)
    expected = ws.apparent_direction(direction, velocity_m_s)
    np.testing.assert_allclose(out.numpy(), expected, rtol=0, atol=DEVICE_ATOL_RAD)


def test_aberration_shapes():
    one = ws.apparent_direction([1.0, 0.0, 0.0], EARTH_M_S)
    assert one.shape == (3,)
    many = ws.apparent_direction(random_directions(4), np.tile(EARTH_M_S, (4, 1)))
    np.testing.assert_array_equal(many, ws.apparent_direction(random_directions(4), EARTH_M_S))


@pytest.mark.parametrize(
    ("direction", "velocity", "message"),
    [
        ([np.nan, 0.0, 1.0], EARTH_M_S, "must be finite"),
        ([1.0, 0.0], EARTH_M_S, "must end in an axis of 3"),
        ([1.0, 0.0, 0.0], [3e8, 0.0, 0.0], "velocity_m_s: must be below the speed of light"),
    ],
    ids=["nan", "two-numbers", "too-fast"],
)
def test_bad_aberration_input_is_named(direction, velocity, message):
    with pytest.raises(ws.InputError, match=message):
        ws.apparent_direction(direction, velocity)


BORESIGHTS = {
    "north-pole": [0.0, 0.0, 1.0],
    "south-pole": [0.0, 0.0, -1.0],
    "beside-the-pole": [1e-6, -2e-6, 1.0],
    "ra-0": [1.0, 0.0, 0.0],
    "ra-0-high": [0.5, 0.0, 0.8],
    "ra-180": [-1.0, 0.0, 0.2],
    "somewhere": [0.3, -0.7, -0.4],
}
CAMERAS = {
    "1-deg": ws.Camera(128, 128, fov_deg=1.0),
    "60-deg": ws.Camera(100, 160, fov_deg=60.0),
    "tall": ws.Camera(300, 20, fov_deg=5.0),
    "lens": ws.Camera(64, 80, focal_length_m=0.5, pixel_pitch_m=30e-6),
    "one-pixel": ws.Camera(1, 1, fov_deg=0.5),
    "high-pixels": ws.Camera(100, 160, fov_deg=20.0, pixel_aspect=2.5),
    "flat-pixels": ws.Camera(300, 40, fov_deg=2.0, pixel_aspect=0.3),
}


def directions_in_view(camera, axes, n=300):
    """Directions whose pixels lie on the array and a little around it, and those pixels."""
    xy = np.random.default_rng(SEED).uniform(-0.2, 1.2, (n, 2)) * [camera.n_col, camera.n_row] - 0.5
    seen = np.column_stack([(xy - camera.centre_px) / [camera.focal_px, camera.focal_row_px], np.ones(n)])
    return unit(seen @ axes), xy


@pytest.mark.parametrize("boresight", BORESIGHTS.values(), ids=BORESIGHTS)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_projection_matches_astropy_wcs(device, camera, boresight, record_accuracy):
    axes = device_axes(unit(np.array([boresight])), [0.1, 0.6, 0.3], device)[0]
    direction, _ = directions_in_view(camera, axes)
    ra = np.degrees(np.arctan2(direction[:, 1], direction[:, 0]))
    dec = np.degrees(np.arctan2(direction[:, 2], np.hypot(direction[:, 0], direction[:, 1])))
    expected = np.column_stack(tan_wcs(axes, camera).all_world2pix(ra, dec, 0))
    xy, in_front = camera.project(direction, axes)
    assert in_front.all()
    np.testing.assert_allclose(xy, expected, rtol=0, atol=WCS_ATOL_PX)
    on_device, depth, inside = device_project(camera, axes, direction, device)
    np.testing.assert_allclose(on_device, expected, rtol=0, atol=WCS_ATOL_PX)
    error_px = np.abs(on_device - expected).max()
    record_accuracy("Gnomonic projection", error_px, WCS_ATOL_PX, "px", "astropy.wcs")
    np.testing.assert_allclose(depth, direction @ axes[2], rtol=0, atol=AXES_ATOL)
    frame = np.array([camera.n_col, camera.n_row])
    np.testing.assert_array_equal(inside, ((expected >= -0.5) & (expected < frame - 0.5)).all(axis=1))


def test_projection_by_hand():
    """Right is +x and columns grow; down is +y and rows grow; the field of view ends at the array's edges."""
    camera = ws.Camera(n_row=50, n_col=100, fov_deg=60.0)
    edge = np.tan(np.radians(30.0))
    xy, in_front = camera.project(
        unit(np.array([[0.0, 0, 1], [edge, 0, 1], [-edge, 0, 1], [0, edge / 2, 1]])), np.eye(3)
    )
    np.testing.assert_allclose(xy, [[49.5, 24.5], [99.5, 24.5], [-0.5, 24.5], [49.5, 49.5]], rtol=0, atol=1e-12)
    assert in_front.all()
    assert camera.half_diagonal_rad() == pytest.approx(np.arctan(edge * np.hypot(1, 0.5)), rel=1e-14)


def test_behind_the_camera_is_nan_and_not_in_front():
    camera = CAMERAS["1-deg"]
    xy, in_front = camera.project([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.01, 0.0, -0.9], [0.0, 0.0, 1.0]], np.eye(3))
    np.testing.assert_array_equal(in_front, [False, False, False, True])
    assert np.isnan(xy[:3]).all() and np.isfinite(xy[3]).all()


def test_field_of_view_and_lens_are_the_same_camera():
    lens = ws.Camera(96, 128, focal_length_m=0.8, pixel_pitch_m=25e-6)
    fov = ws.Camera(96, 128, fov_deg=float(2 * np.degrees(np.arctan(64 * 25e-6 / 0.8))))
    assert fov.focal_px == pytest.approx(lens.focal_px, rel=1e-14)
    assert lens.focal_px == pytest.approx(32000.0, rel=1e-14)


def test_axes_are_a_right_handed_rotation_with_up_upwards(device):
    boresight, up = random_directions(5000), random_directions(5000, SEED + 1)
    up *= np.logspace(-6, 7, 5000)[:, None]  # zenith may come as a position in metres
    x, y, z = np.moveaxis(device_axes(boresight, up, device), 1, 0)
    np.testing.assert_array_equal(z, boresight)
    for a, b, product in ((x, x, 1), (y, y, 1), (x, y, 0), (y, z, 0), (x, z, 0)):
        np.testing.assert_allclose(np.sum(a * b, axis=1), product, rtol=0, atol=2e-12)
    np.testing.assert_allclose(np.cross(x, y), z, rtol=0, atol=2e-12)
    assert (np.sum(y * up, axis=1) < 0).all()  # up is towards row 0
    np.testing.assert_allclose(np.sum(x * up, axis=1) / np.linalg.norm(up, axis=1), 0, rtol=0, atol=AXES_ATOL)


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["along", "against"])
def test_up_along_the_boresight_falls_back_to_the_spare(device, side):
    boresight = random_directions(200)
    spare = [0.0, 1.0, 0.0]
    near = device_axes(boresight, side * 7e6 * boresight, device, spare)
    np.testing.assert_allclose(near, device_axes(boresight, np.array(spare), device), rtol=0, atol=AXES_ATOL)
    assert np.isfinite(near).all()
