"""Lens distortion and pixels that are not square: OpenCV's numbers, inverses, brute force, astropy's SIP."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from astropy.io import fits
from astropy.wcs import WCS
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import fsolve
from warpsim_kernels import camera as camera_kernels

import warpsim as ws
from warpsim.optics.wcs import ERROR_PX, sip_polynomials
from warpsim.output.check import scene_report
from warpsim.plot.image_figure import camera_view, earth_clearance
from warpsim.render.device_upload import camera_struct

FRAME = 75

SIP_OFF_GRID = 1.02
"""Largest error of A and B anywhere over the one stated, that of a grid of 61 x 61 positions: 1.012 at most. The
order is raised until it is below 1e-6 px; rounding of degrees is 2e-9 px."""
FORMULA_ATOL = 1e-15
"""float64 rounding of numbers below 1; OpenCV's are printed with 15 digits."""
ROUND_TRIP_RAD = 1e-12
DEVICE_PX = 1e-9
"""float64 rounding times the image's size, a thousand times over."""
OFFSET_PX = 1e-9
"""The same, and the turn that puts a target at its offset."""

CAMERAS = {
    "barrel": ws.Camera(200, 256, fov_deg=40.0, distortion=ws.Distortion(k1=-0.2, k2=0.02)),
    "cushion": ws.Camera(128, 128, fov_deg=2.0, distortion=ws.Distortion(k1=150.0)),
    "all-terms": ws.Camera(
        300, 200, fov_deg=30.0, distortion=ws.Distortion(k1=-0.15, k2=0.3, k3=-0.2, p1=0.004, p2=-0.01)
    ),
    "wide-and-strong": ws.Camera(120, 160, fov_deg=80.0, distortion=ws.Distortion(k1=-0.09, p2=0.01)),
    "high-pixels": ws.Camera(90, 240, fov_deg=30.0, pixel_aspect=3.0, distortion=ws.Distortion(k1=0.3, p1=0.01)),
    "flat-pixels": ws.Camera(700, 64, fov_deg=4.0, pixel_aspect=0.1, distortion=ws.Distortion(k1=-5.0, k2=60.0)),
    "one-pixel": ws.Camera(1, 1, fov_deg=3.0, distortion=ws.Distortion(k1=-20.0, p2=0.1)),
    "high-only": ws.Camera(64, 80, fov_deg=10.0, pixel_aspect=1.7),
}
cameras = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)

lens_positions = camera_kernels.projection(True)


@wp.kernel(enable_backward=False)
def project_kernel(
    camera: camera_kernels.Camera, axes: wp.mat33d, direction: wp.array[wp.vec3d], xy_px: wp.array[wp.vec2d]
):
    i = wp.tid()
    xy_px[i] = lens_positions(camera, axes, direction[i])


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def some_axes(seed=1):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


def all_about(n, seed=2):
    """Directions all over the sphere, half of them about the boresight, z."""
    rng = np.random.default_rng(seed)
    return unit(rng.normal(size=(n, 3)) * np.where(rng.random(n) < 0.5, 1.0, 10.0 ** rng.uniform(-2, 0, n))[:, None]
                + np.outer(rng.integers(0, 2, n), [0, 0, 1]))  # fmt: skip


def in_frame(camera, xy):
    return ((xy >= -0.5) & (xy < np.array([camera.n_col, camera.n_row]) - 0.5)).all(axis=1)


def by_hand(camera, seen):
    """The formula, as it is written, times the focal lengths: within the checked radius."""
    (x, y), lens = (seen[:, :2] / seen[:, 2:]).T, camera.distortion or ws.Distortion()
    r2 = x**2 + y**2
    radial = 1 + lens.k1 * r2 + lens.k2 * r2**2 + lens.k3 * r2**3
    x_d = x * radial + 2 * lens.p1 * x * y + lens.p2 * (r2 + 2 * x**2)
    y_d = y * radial + lens.p1 * (r2 + 2 * y**2) + 2 * lens.p2 * x * y
    f = camera.n_col / 2 / np.tan(np.radians(camera.fov_deg) / 2)
    return np.column_stack([(camera.n_col - 1) / 2 + f * x_d, (camera.n_row - 1) / 2 + f / camera.pixel_aspect * y_d])


RAYS = [[0.3, -0.2, 1.0], [-0.45, 0.5, 1.0], [0.1, 0.7, 2.0]]
OPENCV = [  # k1, k2, k3, p1, p2 and where cv2.projectPoints 5.0.0 has the rays, with focal length 1
    (
        (-0.2, 0.05, 0.01, 0.004, -0.003),
        [[0.291050091, -0.193773394], [-0.4186714505390625, 0.465492167265625], [0.0485400390625, 0.3429052734374999]],
    ),
    ((0.15, 0.0, 0.0, 0.0, 0.002), [[0.30647, -0.20414], [-0.47882875, 0.5330375], [0.0511975, 0.3566325]]),
]


@pytest.mark.parametrize(("numbers", "expected"), OPENCV, ids=["all-terms", "radial"])
def test_the_formula_is_opencvs(numbers, expected, record_accuracy):
    lens = ws.Distortion(*numbers)
    camera = ws.Camera(2, 2, focal_length_m=1.0, pixel_pitch_m=1.0, distortion=lens)
    xy, _ = camera.project(unit(np.array(RAYS)), np.eye(3))
    np.testing.assert_allclose(xy - 0.5, expected, rtol=0, atol=FORMULA_ATOL)
    error = np.abs(xy - 0.5 - expected).max()
    record_accuracy("Distortion of a lens", error, FORMULA_ATOL, "of the focal length", "OpenCV's numbers")


@cameras
def test_project_is_the_formula_within_the_checked_radius(device, camera):
    axes, seen = some_axes(), all_about(3000)
    inner = (seen[:, 2] > 0) & (np.hypot(seen[:, 0], seen[:, 1]) <= camera.distortion_radius * seen[:, 2])
    xy, in_front = camera.project(seen @ axes, axes)
    np.testing.assert_array_equal(in_front, seen[:, 2] > 0)
    assert np.isnan(xy[~in_front]).all()
    np.testing.assert_allclose(xy[inner], by_hand(camera, seen[inner]), rtol=1e-12, atol=1e-10)
    assert 50 < in_frame(camera, xy[in_front]).sum() < in_front.sum() or camera.n_row == 1
    on_device = wp.empty(len(seen), dtype=wp.vec2d, device=device)
    inputs = [camera_struct(camera), wp.mat33d(*axes.ravel()), wp.array(seen @ axes, dtype=wp.vec3d, device=device)]
    if camera.lens is not None:
        wp.launch(project_kernel, len(seen), inputs, [on_device], device=device)
        near = in_front & (seen[:, 2] > 1e-3)
        np.testing.assert_allclose(on_device.numpy()[near], xy[near], rtol=1e-12, atol=DEVICE_PX)


@cameras
def test_nothing_folds_back(camera):
    """Beyond the checked radius no direction comes to the array; each frame edge is crossed once along each ray."""
    seen = all_about(200_000)
    xy, in_front = camera.project(seen, np.eye(3))
    beyond = np.hypot(seen[:, 0], seen[:, 1]) > camera.distortion_radius * seen[:, 2]
    assert not in_frame(camera, xy[beyond & in_front]).any()
    tangent = np.concatenate([np.linspace(0, 3 * np.tan(camera.half_diagonal_rad()), 3000), np.geomspace(3, 1e6, 500)])
    for angle in np.linspace(0, 2 * np.pi, 37):
        ray = unit(np.column_stack([tangent * np.cos(angle), tangent * np.sin(angle), np.ones(len(tangent))]))
        inside = in_frame(camera, camera.project(ray, np.eye(3))[0])
        assert inside[0] and not inside[-1]
        assert np.count_nonzero(np.diff(inside.astype(int))) == 1


@cameras
def test_direction_is_the_inverse_of_project(camera, record_accuracy):
    axes, rng = some_axes(3), np.random.default_rng(4)
    xy = rng.uniform(-1, 2, (20_000, 2)) * [camera.n_col, camera.n_row] - 0.5  # three arrays wide
    xy[0] = camera.centre_px
    direction = camera.direction(xy, axes)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, rtol=0, atol=1e-15 * 4)
    np.testing.assert_allclose(direction[0], axes[2], rtol=0, atol=1e-15 * 4)
    back, in_front = camera.project(direction, axes)
    assert in_front.all()
    np.testing.assert_allclose(back, xy, rtol=0, atol=ROUND_TRIP_RAD * max(camera.focal_px, camera.focal_row_px))
    seen = all_about(5000)
    seen = seen[seen[:, 2] > 0.05]
    again = camera.direction(camera.project(seen, np.eye(3))[0])
    np.testing.assert_allclose(again, seen, rtol=0, atol=ROUND_TRIP_RAD)
    record_accuracy("Direction of a pixel and back", np.abs(again - seen).max(), ROUND_TRIP_RAD, "rad", "round trip")


numbers = st.floats(-1, 1)


@pytest.mark.slow
@settings(deadline=None, max_examples=300)
@given(
    n_row=st.integers(1, 300), n_col=st.integers(1, 300), fov_deg=st.floats(0.01, 110), aspect=st.floats(0.1, 10),
    k1=numbers, k2=numbers, k3=numbers, p1=numbers, p2=numbers, seed=st.integers(0, 99),
)  # fmt: skip
def test_whatever_is_accepted_is_one_to_one(n_row, n_col, fov_deg, aspect, k1, k2, k3, p1, p2, seed):
    """Terms of all sizes, up to the radius of the array's corner; those that fold are refused."""
    plain = ws.Camera(n_row, n_col, fov_deg=fov_deg, pixel_aspect=aspect)
    r = np.tan(plain.half_diagonal_rad())
    lens = ws.Distortion(k1 / r**2, k2 / r**4, k3 / r**6, 0.3 * p1 / r, 0.3 * p2 / r)
    try:
        camera = ws.Camera(n_row, n_col, fov_deg=fov_deg, pixel_aspect=aspect, distortion=lens)
    except ws.InputError as error:
        refused = str(error)
    else:
        refused = None
        camera_is_one_to_one(camera, np.random.default_rng(seed))
    assert refused is None or refused.startswith("Camera: distortion: must be one-to-one until it fills the array")


def camera_is_one_to_one(camera, rng):
    size = np.array([camera.n_col, camera.n_row])
    xy = rng.uniform(-0.6, 1.6, (400, 2)) * size - 0.5
    direction = camera.direction(xy)
    back, _ = camera.project(direction, np.eye(3))
    np.testing.assert_allclose(back, xy, rtol=0, atol=ROUND_TRIP_RAD * max(camera.focal_px, camera.focal_row_px))
    on_array = camera.direction(rng.uniform(0, 1, (1000, 2)) * size - 0.5)
    assert np.arccos(on_array[:, 2].min()) <= camera.half_diagonal_rad() + 1e-7  # arccos near 1


REFUSED = {
    "folds": ({"k1": -0.5}, "it folds or shrinks to a tenth at 0.954 half diagonals"),
    "folds-inside": ({"k1": -3.0}, "at 0.3"),
    "tangential": ({"p1": 1.0}, "it folds"),
    "late-fold": ({"k1": 0.5, "k3": -1.0}, "it folds"),
    "overflows": ({"k1": -1e300}, "it folds"),
    "tiny-field": ({"k1": 1e300}, "the corners see less than 1/4 of the field"),
}


@pytest.mark.parametrize(("lens", "wrong"), REFUSED.values(), ids=REFUSED)
def test_what_is_not_one_to_one_is_refused(lens, wrong):
    message = f"Camera: distortion: must be one-to-one until it fills the array and a tenth beyond, .*{wrong}"
    with pytest.raises(ws.InputError, match=message):
        ws.Camera(100, 100, fov_deg=60, distortion=lens)


def test_the_error_names_its_field_in_a_scene(scene):
    with pytest.raises(ws.InputError, match=r"camera\.distortion: must be one-to-one"):
        scene.replace(camera__distortion={"k1": -1e4})
    with pytest.raises(ws.InputError, match=r"camera\.pixel_aspect: must be in \[0.1, 10\], got 11"):
        scene.replace(camera__pixel_aspect=11)
    with pytest.raises(ws.InputError, match=r"camera\.distortion\.k4: is not a known field"):
        scene.replace(camera__distortion={"k4": 1.0})


def test_without_distortion_nothing_changes(scene):
    from warpsim_kernels.stars import StarFeatures

    from warpsim.render.device_stars import make_gather_stars_kernel

    zero = scene.replace(camera__distortion={}, bands=["A"])
    assert zero.camera.distortion == ws.Distortion()
    assert zero.camera.lens is None and zero.camera.distortion_radius == np.inf
    assert ws.Scene.from_dict(zero.to_dict()) == zero
    ours, plain = (ws.Renderer(one, device="cpu") for one in (zero, scene.replace(bands=["A"])))
    np.testing.assert_array_equal(
        ours.render([FRAME], ["sat11"]).counts.numpy(), plain.render([FRAME], ["sat11"]).counts.numpy()
    )
    assert make_gather_stars_kernel(StarFeatures(), 1) is not make_gather_stars_kernel(StarFeatures(distortion=True), 1)


@cameras
@pytest.mark.parametrize("margin_px", [0.0, 20.0, 300.0])
@pytest.mark.ci
def test_half_diagonal_is_the_farthest_position_of_the_border(camera, margin_px):
    """By scipy's root finder, along the border and at its corners."""
    half = np.array([camera.n_col, camera.n_row]) / 2 + margin_px
    along = np.linspace(-1, 1, 41)
    sides = [np.column_stack(pair) for one in (-1, 1) for pair in ((along, 0 * along + one), (0 * along + one, along))]
    position = np.concatenate(sides) * half + camera.centre_px
    focal = np.array([camera.focal_px, camera.focal_row_px])

    def missed(tangent, wanted):
        seen = unit(np.append(tangent, 1.0))[None]
        return camera.project(seen, np.eye(3))[0][0] - wanted

    farthest = max(
        np.linalg.norm(fsolve(missed, (one - camera.centre_px) / focal, one, xtol=1e-11)) for one in position
    )
    given_rad = camera.half_diagonal_rad(margin_px)
    assert np.arctan(farthest) <= given_rad * (1 + 1e-12)
    assert np.tan(given_rad) <= farthest * (1.0011 if camera.lens else 1 + 1e-12)


def test_a_barrel_sees_more_sky():
    plain = ws.Camera(100, 100, fov_deg=40.0)
    barrel = ws.Camera(100, 100, fov_deg=40.0, distortion=ws.Distortion(k1=-0.3))
    assert barrel.half_diagonal_rad() > 1.05 * plain.half_diagonal_rad()
    assert barrel.field_deg[0] > 40.5
    assert plain.field_deg == pytest.approx((40.0, 40.0), rel=1e-14)
    assert ws.Camera(100, 200, fov_deg=40.0, pixel_aspect=2.0).field_deg == pytest.approx((40.0, 40.0), rel=1e-14)


@cameras
def test_frame_margin_has_the_sign_of_the_pixels(camera):
    direction = all_about(100_000)
    xy, in_front = camera.project(direction, np.eye(3))
    margin = camera.frame_margin_deg(direction)
    np.testing.assert_array_equal((margin >= 0)[np.abs(margin) > 1e-9],
                                  (in_front & in_frame(camera, xy))[np.abs(margin) > 1e-9])  # fmt: skip
    assert (margin[~in_front] < 0).all()
    assert camera.frame_margin_deg([0.0, 0.0, -1.0]) < 0
    # Steady all over the sphere, so that crossings are found: no jump where the formula ends, or beside the camera.
    turn = np.linspace(0, 2 * np.pi, 200_001)
    around = camera.frame_margin_deg(np.column_stack([0.6 * np.sin(turn), 0.8 * np.sin(turn), np.cos(turn)]))
    assert np.abs(np.diff(around)).max() < 360 / 200_000 * 12


STRONG = {"k1": -0.4, "k2": 0.1, "p1": 0.01, "p2": -0.02}
SEEN_BY = {
    "lens": {"n_row": 96, "n_col": 128, "fov_deg": 30.0, "distortion": STRONG},
    "pixels": {"n_row": 63, "n_col": 128, "fov_deg": 2.0, "pixel_aspect": 2.2},
    "both": {"n_row": 300, "n_col": 50, "fov_deg": 10.0, "pixel_aspect": 0.4, "distortion": STRONG},
}
seen_by = pytest.mark.parametrize("camera", SEEN_BY.values(), ids=SEEN_BY)


def stars_by_brute_force(scene, frames, catalog, index):
    """Rows of all stars on one image of a scene, by project alone; and their positions."""
    velocity = frames.velocity_m_s[index]
    seen = ws.apparent_direction(catalog.direction_icrs, velocity)
    xy, in_front = scene.camera.project(seen, frames.axes_icrs[index])
    return np.flatnonzero(in_front & in_frame(scene.camera, xy)), xy


@pytest.mark.slow
@seen_by
def test_every_star_is_on_the_image_where_the_camera_has_it(scene, device, camera):
    """The whole chain against brute force over the sky: none lost, none doubled, positions to 1e-6 px."""
    rng = np.random.default_rng(6)
    position = unit(rng.normal(size=(400_000, 3)))
    ra, dec = np.degrees(np.arctan2(position[:, 1], position[:, 0])), np.degrees(np.arcsin(position[:, 2]))
    catalog = ws.StarCatalog.from_arrays(ra, dec, {"A": np.full(len(ra), 1e-3)})  # far below the noise: no wide stamps
    wide = scene.replace(camera=camera, bands=["A"], optics__psf="gaussian", optics__sigma_px=0.3,
                         pointing={"kind": "fixed", "azimuth_elevation_deg": [30.0, 25.0]})  # fmt: skip
    frames = ws.Renderer(wide, device=device, catalog=catalog).render([3, FRAME], ["sat11"], keep_stars=True)
    n_star = 0
    for number, frame in enumerate(frames.frames):
        rows, xy = stars_by_brute_force(wide, frames, catalog, (number, 0))
        stars = frames.stars[(frames.stars["frame"] == frame) & frames.stars["in_fov"]]
        assert sorted(stars["catalog_row"]) == rows.tolist()
        found = np.column_stack([stars["x_px"], stars["y_px"]])
        np.testing.assert_allclose(found, xy[stars["catalog_row"]], rtol=0, atol=1e-6)
        n_star += len(rows)
    assert n_star > 15


@seen_by
@pytest.mark.parametrize("offset", [(0.0, 0.0), (-31.25, 17.8), (60.0, -200.0)])
@pytest.mark.ci
def test_what_is_tracked_stands_at_its_offset(scene, device, camera, offset):
    pointing = {"track": "main", "offset_px": offset, "roll_deg": 50.0}
    tracking = scene.replace(camera=camera, optics__psf="gaussian", pointing=pointing)
    frames = ws.Renderer(tracking, device=device).render([FRAME], ["sat11", "sat27"], ["A"])
    for index, sensor in enumerate(frames.sensors):
        row = frames.truth[(frames.truth["sensor"] == sensor) & (frames.truth["target"] == "center")][0]
        position = np.array([row["x_px"], row["y_px"]])
        np.testing.assert_allclose(position, np.add(tracking.camera.centre_px, offset), rtol=0, atol=OFFSET_PX)
        told = tracking.scenario.view_axes(sensor, frames.time_s)
        np.testing.assert_allclose(frames.axes_icrs[0, index], told[0], rtol=0, atol=1e-10)


SIP = {
    # camera, order of A and B, whether they reach 1e-6 px
    "mild": (ws.Camera(1024, 1024, fov_deg=5.0, distortion=ws.Distortion(k1=-1.0, p1=1e-3)), 7, True),
    "three-terms": (
        ws.Camera(512, 640, fov_deg=10.0, pixel_aspect=1.3,
                  distortion=ws.Distortion(k1=-0.6, k2=2.0, k3=5.0, p1=-2e-3, p2=1e-3)), 9, True,
    ),
    "tangential": (ws.Camera(100, 100, fov_deg=1.0, distortion=ws.Distortion(p1=0.05, p2=-0.02)), 3, True),
    "strong": (ws.Camera(512, 512, fov_deg=60.0, distortion=ws.Distortion(k1=-0.1)), 9, False),
    "cushion": (ws.Camera(300, 200, fov_deg=30.0, pixel_aspect=0.7, distortion=ws.Distortion(k1=0.5)), 9, False),
}  # fmt: skip


def sky_deg(direction):
    return np.degrees(np.arctan2(direction[:, 1], direction[:, 0])), np.degrees(np.arcsin(direction[:, 2]))


@pytest.mark.parametrize(("camera", "order", "reached"), SIP.values(), ids=SIP)
def test_sip_agrees_with_the_camera_as_well_as_it_says(camera, order, reached, record_accuracy):
    """Both ways by astropy: A and B to the stated error, AP and BP to rounding."""
    from warpsim.optics.wcs import tan_wcs

    sip = sip_polynomials(camera)
    assert (len(sip.a) - 1 == order) and (sip.error_px < ERROR_PX) == reached
    axes, rng = some_axes(7), np.random.default_rng(8)
    axes[0] *= np.linalg.det(axes)
    xy = rng.uniform(0, 1, (4000, 2)) * [camera.n_col, camera.n_row] - 0.5
    xy[:4] = np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) * [camera.n_col, camera.n_row] - 0.5
    wcs = tan_wcs(axes, camera)
    assert wcs.wcs.ctype[0] == "RA---TAN-SIP"
    direction = camera.direction(xy, axes)
    lon, lat = np.radians(wcs.all_pix2world(*xy.T, 0))
    read = np.column_stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    # Through the pinhole, where A and B count their pixels.
    pinhole = ws.Camera(camera.n_row, camera.n_col, fov_deg=camera.fov_deg, pixel_aspect=camera.pixel_aspect)
    missed = np.linalg.norm(pinhole.project(read, axes)[0] - pinhole.project(direction, axes)[0], axis=1).max()
    assert missed <= sip.error_px * SIP_OFF_GRID + 2e-9
    assert missed >= 0.5 * sip.error_px - 2e-9
    if reached:
        back = np.column_stack(wcs.all_world2pix(*sky_deg(direction), 0, tolerance=1e-9, maxiter=50))
        np.testing.assert_allclose(back, camera.project(direction, axes)[0], rtol=0, atol=1.5 * ERROR_PX)
        limit_px = SIP_OFF_GRID * ERROR_PX + 2e-9
        record_accuracy("SIP polynomials of a distorted camera", missed, limit_px, "px", "astropy.wcs")
    flat = np.column_stack(wcs.wcs_world2pix(*sky_deg(direction), 0))
    forward = wcs.sip_foc2pix(flat - camera.centre_px, 1) - 1
    np.testing.assert_allclose(forward, xy, rtol=0, atol=1e-8)
    assert np.abs(flat - xy).max() > 0.01


@pytest.mark.ci
def test_a_cube_of_a_distorted_camera(scene, tmp_path):
    """Frame set, read_cube and astropy alone, from the header of FRAMES, have the same WCS; it leads to the stars."""
    lens = {"k1": -0.5, "k2": 2.0, "p1": 1e-3, "p2": -2e-3}
    wide = scene.replace(
        camera={"n_row": 96, "n_col": 128, "fov_deg": 8.0, "pixel_aspect": 1.25, "distortion": lens}, bands=["A"]
    )
    ws.render_to_folder(wide, tmp_path, frames=[FRAME], sensors=["sat11"], device="cpu")
    frames = ws.Renderer(wide, device="cpu").render([FRAME], ["sat11"], keep_stars=True)
    with fits.open(tmp_path / "sat11_A.fits") as file:
        header, table = file["FRAMES"].header, file["FRAMES"].data
        assert header["SIPERR"] < ERROR_PX
        alone = fits.Header([card for card in header.cards if card.keyword[:2] in ("CT", "RA", "A_", "B_", "AP", "BP")])
        alone.update({name: table[name][0] for name in table.names if name[:2] in ("CR", "CD", "LO")})
    seen = ws.apparent_direction(
        ws.StarCatalog.default().at_epoch(wide.epoch).direction_icrs[frames.stars["catalog_row"]],
        frames.velocity_m_s[0, 0],
    )
    stars = np.column_stack([frames.stars["x_px"], frames.stars["y_px"]])
    inside = np.asarray(frames.stars["in_fov"])
    for wcs in (frames.wcs(FRAME, "sat11"), ws.read_cube(tmp_path / "sat11_A.fits").wcs(0), WCS(alone)):
        positions = np.column_stack(wcs.all_world2pix(*sky_deg(seen[inside]), 0, tolerance=1e-9, maxiter=50))
        np.testing.assert_allclose(positions, stars[inside], rtol=0, atol=1e-5)
    assert inside.sum() > 5


@pytest.mark.ci
def test_the_report_says_what_the_lens_does(scene):
    lines = scene_report(scene.replace(camera__distortion={"k1": -30.0}, camera__pixel_aspect=1.5).scenario)
    (line,) = [line for line in lines.splitlines() if line.startswith("  camera")]
    assert "28.13 x 42.19 arcsec per pixel, distorted by up to " in line and "WCS" not in line
    assert "distorted" not in scene_report(scene.scenario)
    strong = scene.replace(camera={"n_row": 512, "n_col": 512, "fov_deg": 60.0, "distortion": {"k1": -0.1}},
                           optics__psf="gaussian")  # fmt: skip
    assert "field 61.83 x 61.83 deg, WCS good to 0.0008 px" in scene_report(strong.scenario)


@seen_by
@pytest.mark.ci
def test_the_picture_of_a_view_has_the_limb_where_the_camera_sees_it(scene, camera):
    """Rays of a grid of positions, by project and the ellipsoid's equation."""
    low = scene.replace(camera=camera, optics__psf="gaussian", sky__catalog="none",
                        pointing={"kind": "fixed", "azimuth_elevation_deg": [0.0, -38.0]})  # fmt: skip
    view = camera_view(low.scenario, "sat11", low.scenario.instrument.frame_time_s([FRAME])[0])
    n_row, n_col, pole = low.camera.n_row, low.camera.n_col, low.scenario.tracks.pole_icrs
    xy = np.stack(np.meshgrid(np.linspace(-0.5, n_col - 0.5, 30), np.linspace(-0.5, n_row - 0.5, 30)), axis=-1)
    clearance = earth_clearance(view, pole, xy)
    assert clearance.shape == (30, 30)
    seen = np.random.default_rng(1).normal(size=(400_000, 3)) * [0.25, 0.25, 0] + [0, 0, 1]
    position, _ = low.camera.project(unit(seen), np.eye(3))
    ray = ws.apparent_direction(unit(seen) @ view.axes_icrs, -view.velocity_m_s)
    a, b = 6378137.0, 6378137.0 * (1 - 1 / 298.257223563)
    m = np.eye(3) / a**2 + np.outer(pole, pole) * (1 / b**2 - 1 / a**2)
    half = ray @ m @ view.position_m
    root = half**2 - np.einsum("ni,ij,nj->n", ray, m, ray) * (view.position_m @ m @ view.position_m - 1)
    meets = (root > 0) & (half < 0)
    inside = in_frame(low.camera, position)
    by_position = earth_clearance(view, pole, position[inside]) < 0
    assert np.count_nonzero(by_position != meets[inside]) <= 1
