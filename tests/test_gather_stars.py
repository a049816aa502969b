"""No star lost, doubled or extra: the renderer's star lists against brute force over every star of a catalog.

Stars crowd the rims and corners of frames, where the cone of the index could cut too close. The stage runs on views
made by hand, so that frames lie anywhere: at poles, across right ascension 0, beside the Sun.
"""

from __future__ import annotations

import erfa
import numpy as np
import pytest
import warp as wp
from astropy.time import TimeDelta
from on_devices import arrays_of_views, device_scene
from scipy.special import ndtr
from warpsim_kernels.earth import Earth, is_earth_near, is_star_occulted

import warpsim as ws
from warpsim.render.stages import aim, gather_stars
from warpsim.render.target_field import earth_struct

ARCSEC_RAD = np.pi / 180 / 3600
AU_M = 149_597_870_700.0

EDGE_PX = 1e-6
"""Stars this close to a border are left out of the comparison: the kernel and the host round differently."""
FAINTER = 1 - 1e-3
"""Light this much below the cut of stamps may still be drawn: float32."""
SIGMA_PX = 1.2
VELOCITY_M_S = 0.05
"""The kernel's velocities come from nodes of tracks; this is 4e-5 arcsec of aberration."""
REACH_PX = 12.0
"""More than the widest stamp of these tests."""
NEARBY_MAS, NEAREST_MAS = 800.0, 1e5
"""Parallaxes of true stars, and the largest that a catalog may hold: 100 arcsec, beyond all other shifts."""
START_S = 300.0
ALL_ON = {"aberration": True, "parallax": True, "light_deflection": True}


def sky_scene(scene, n_row, n_col, fov_deg, sky=ALL_ON, distortion=None):
    return scene.replace(
        camera={"n_row": n_row, "n_col": n_col, "fov_deg": fov_deg, "distortion": distortion},
        optics={"aperture_m": 0.4, "psf": "gaussian", "sigma_px": SIGMA_PX},
        frames={"count": 100, "interval_s": 1.0, "start_s": START_S},
        bands=["A", "E"],
        sky=sky,
    )


def unit(vector):
    vector = np.asarray(vector, dtype=float)
    return vector / np.linalg.norm(vector)


def axes_with_corner_towards(boresight, point):
    """Camera axes (rows x, y, z) whose diagonal, right and down, leads to a direction of the sky."""
    z = unit(boresight)
    diagonal = unit(point - z * (point @ z))
    across = -np.cross(z, diagonal)
    return np.stack([unit(diagonal + across), unit(diagonal - across), z])


def earth_state(scene, time_s):
    """The Earth about the Sun and about the barycentre, by ERFA: positions "p" [au] and velocities "v" [au/day]."""
    time = (scene.epoch + TimeDelta(float(time_s), format="sec")).tdb
    return erfa.epv00(time.jd1, time.jd2)


def earth_velocity_m_s(scene, time_s):
    """Barycentric."""
    return earth_state(scene, time_s)[1]["v"] * AU_M / 86400.0


def hand_made_views(world, time_s, axes, n_slot):
    """Views with given axes of an observer with the Earth behind the camera: nothing is hidden."""
    inputs, columns, sources = arrays_of_views(world, time_s, n_slot=n_slot)
    aim(world, inputs, columns.views).run()  # velocities
    views = columns.views.numpy().copy()
    views["axes"], views["position_m"] = axes, np.asarray(axes)[:, 2] * 8e6
    columns.views.assign(views)
    return inputs, columns.views, sources


def stars_on_the_rim(
    camera, axes, velocities_m_s, observers_au, n_star, light, seed, shift_arcsec=60.0, parallax_mas=NEARBY_MAS
):
    """Stars about the border of each frame, half of them at its corners, one in nine without a parallax.

    Distances from the border: a third within 1 px, a third within shift_arcsec, a third within REACH_PX, of apparent
    positions; the inverse Lorentz transformation and the parallax carry them back. Half the parallaxes are the largest.
    """
    rng = np.random.default_rng(seed)
    positions, parallaxes = [], []
    for view_axes, velocity, observer_au in zip(axes, velocities_m_s, observers_au, strict=True):
        size = np.array([camera.n_col, camera.n_row])
        xy = rng.uniform(-0.5, size - 0.5, (n_star, 2))
        side = rng.integers(0, 2, (n_star, 2))  # before or after the array, along each axis
        corner = rng.random(n_star) < 0.5
        on_border = np.column_stack([rng.random(n_star) < 0.5] * 2) ^ np.array([False, True])
        on_border |= corner[:, None]
        spread_px = rng.choice([1.0, shift_arcsec * ARCSEC_RAD * camera.focal_px, REACH_PX], n_star)[:, None]
        border = side * size - 0.5 + rng.uniform(-1, 1, (n_star, 2)) * spread_px
        xy = np.where(on_border, border, xy)
        seen = camera.direction(xy, view_axes)
        parallax = np.where(rng.random(n_star) < 0.5, parallax_mas, rng.uniform(0, parallax_mas, n_star))
        parallax[::9] = np.nan
        unmoved = ws.apparent_direction(seen, -velocity)
        positions.append(unmoved + np.nan_to_num(parallax)[:, None] * ARCSEC_RAD / 1e3 * observer_au)
        parallaxes.append(parallax)
    position = np.concatenate(positions)
    position /= np.linalg.norm(position, axis=1, keepdims=True)
    return ws.StarCatalog.from_arrays(
        np.degrees(np.arctan2(position[:, 1], position[:, 0])),
        np.degrees(np.arcsin(np.clip(position[:, 2], -1, 1))),
        light(rng, len(position)),
        parallax_mas=np.concatenate(parallaxes),
    )


def stamp_half_width_px(irradiance_w_cm2, scene):
    """Half-widths by the documented rule, and where rounding may decide otherwise; shape (n_band, n_star) each.

    A pixel beyond the stamp begins at least half_width from the source: it holds less than exp(-h^2 / 2 sigma^2) times
    1/2 and times the peak 1 / 2 pi sigma^2, and that must be below the cut, or 1e-15 of the source where that is more.
    """
    cut = np.maximum(scene.optics.stamp_cut_nei * scene.detector.nei_w_cm2 / irradiance_w_cm2, 1e-15)
    highest = min(0.5, 1 / (2 * np.pi * SIGMA_PX**2))
    reach = SIGMA_PX * np.sqrt(-2 * np.log(np.minimum(cut / highest, 1.0)))
    return np.where(cut >= highest, 0, np.ceil(reach)), np.abs(reach - np.rint(reach)) < 1e-4


def light_on_the_frame(xy_px, irradiance_w_cm2, camera):
    """Most light that a star leaves in one pixel of the frame, (n_band, n_star): its nearest pixel, by scipy."""
    fraction = 1.0
    for axis, n_pixel in enumerate((camera.n_col, camera.n_row)):
        pixel = np.clip(np.rint(xy_px[:, axis]), 0, n_pixel - 1)
        offset = np.abs(pixel - xy_px[:, axis])
        fraction = fraction * (ndtr(-(offset - 0.5) / SIGMA_PX) - ndtr(-(offset + 0.5) / SIGMA_PX))
    return irradiance_w_cm2 * fraction


def assert_lists_are_complete(scene, catalog, views):
    """Compare lists of catalog rows with brute force.

    Args:
        scene: Its camera, optics and switches count.
        catalog: Every star, without proper motion.
        views: Per view: axes, position about the Earth [m], barycentric velocity [m/s], time [s], rows listed.

    Returns:
        Number of stars in frames, and of stars beside frames whose stamps reach in.
    """
    camera, sky = scene.camera, scene.sky
    irradiance = np.stack([catalog.irradiance_w_cm2(band) for band in scene.bands])
    half_width, undecided = stamp_half_width_px(irradiance, scene)
    widest, undecided = half_width.max(axis=0), undecided.any(axis=0)
    size = np.array([camera.n_col, camera.n_row])
    n_inside, n_beside = 0, 0
    for axes, position_m, velocity_m_s, time_s, rows in views:
        heliocentric_au, barycentric_au = (state["p"] for state in earth_state(scene, time_s))
        observer = {}
        if sky.parallax:
            observer |= {"parallax_mas": catalog.parallax_mas, "barycentric_m": barycentric_au * AU_M + position_m}
        if sky.light_deflection:
            observer |= {"heliocentric_m": heliocentric_au * AU_M + position_m}
        seen = ws.apparent_direction(
            catalog.direction_icrs, velocity_m_s if sky.aberration else np.zeros(3), **observer
        )
        xy, in_front = camera.project(seen, axes)
        xy[~in_front] = np.inf
        listed = np.zeros(len(catalog), dtype=bool)
        listed[rows] = True
        assert len(rows) == listed.sum(), "a star is listed twice"

        # How far inside the frame: negative outside; the borders at -0.5 belong to it, those at n - 0.5 do not.
        depth_px = np.minimum(xy + 0.5, size - 0.5 - xy).min(axis=1)
        on_frame = np.all((xy >= -0.5) & (xy < size - 0.5), axis=1)
        clear = np.abs(depth_px) > EDGE_PX
        lost = np.flatnonzero(on_frame & clear & ~listed)
        assert lost.size == 0, f"{lost.size} of {on_frame.sum()} stars on the frame are not listed"

        shines = (light_on_the_frame(np.where(in_front[:, None], xy, 1e9), irradiance, camera) * FAINTER).max(axis=0)
        lit = shines > scene.optics.stamp_cut_nei * scene.detector.nei_w_cm2
        assert not (lit & ~listed).any(), f"{(lit & ~listed).sum()} of {lit.sum()} stars whose light counts are lost"

        wide = np.all((xy >= -0.5 - widest[:, None]) & (xy < size - 0.5 + widest[:, None]), axis=1)
        clear = (np.abs(depth_px + widest) > EDGE_PX) & ~undecided
        extra, lost = listed & ~wide & clear, wide & ~listed & clear
        assert not extra.any(), f"{extra.sum()} stars are listed though their stamps miss the frame"
        assert not lost.any(), f"{lost.sum()} of {wide.sum()} stars whose stamps touch the frame are not listed"
        n_inside += int(on_frame.sum())
        n_beside += int((listed & ~on_frame).sum())
    return n_inside, n_beside


def alike(rng, n):
    """The same light for all: the widest stamp is every star's, so that no margin is left over."""
    return {"A": np.full(n, 50.0), "E": np.full(n, 5.0)}


def mixed(rng, n):
    """Most stars bright in the second band only: its stamps reach farther."""
    faint, bright = 10.0 ** rng.uniform(-2.5, 0, n), 10.0 ** rng.uniform(2, 5, n)
    first = rng.random(n) < 0.2
    return {"A": np.where(first, bright, faint), "E": np.where(first, faint, bright)}


def borders_of_the_sky():
    """Axes of frames: in mid-sky, at the poles and near them, across right ascension 0, at cells of the index."""
    rng = np.random.default_rng(2)
    sight = [[0.3, 0.5, 0.6], [-0.5, 0.1, -0.3], [0, 0, 1], [0, 0, -1], [0.008, 0, 1], [-0.003, 0.006, -1]]
    sight += [[1, 0, 0], [1, -1e-3, 1e-3], [-1, 0, 0], [0.5, 0, 0.75**0.5], [0.5, -1e-12, -(0.75**0.5)]]
    return np.stack([axes_with_corner_towards(unit(z), unit(rng.normal(size=3))) for z in sight])


def with_the_sun_at_a_corner(scene, angle_deg=0.05):
    """Axes of a frame that shows the Sun inside a corner: there its light bends into the frame, or out of it."""
    sun = -unit(earth_state(scene, START_S)[0]["p"])
    aside = unit(np.cross(sun, [0.2, 0.1, 1.0]))
    angle = scene.camera.half_diagonal_rad() - np.radians(angle_deg)
    return axes_with_corner_towards(np.cos(angle) * sun + np.sin(angle) * aside, sun)[None]


CASES = {
    # rows, columns, field of view [deg], stars a frame, their light
    "128-px": (128, 128, 1.0, 1200, alike),
    "6000-px": (6000, 6000, 1.0, 3000, alike),
    "60-deg": (128, 128, 60.0, 1200, alike),
    "narrow": (96, 160, 0.1, 1200, alike),
    "two-bands": (100, 128, 1.0, 1200, mixed),
}


@pytest.mark.parametrize(("n_row", "n_col", "fov_deg", "n_star", "light"), CASES.values(), ids=CASES)
@pytest.mark.ci
def test_every_star_on_and_about_a_frame(scene, device, n_row, n_col, fov_deg, n_star, light):
    described = sky_scene(scene, n_row, n_col, fov_deg)
    axes = np.concatenate([borders_of_the_sky(), with_the_sun_at_a_corner(described)])
    assert_stage_is_complete(described, device, axes, n_star, light)


LENSES = {
    # rows, columns, field of view [deg], coefficients
    "barrel": (96, 128, 60.0, {"k1": -0.13, "k2": 0.02}),
    "cushion": (128, 128, 20.0, {"k1": 2.0}),
    "tangential": (128, 100, 30.0, {"k1": -0.2, "p1": 0.03, "p2": -0.05}),
    "narrow": (2000, 1500, 1.0, {"k1": -300.0, "k2": 2e5, "p2": 0.3}),
}


@pytest.mark.parametrize(("n_row", "n_col", "fov_deg", "lens"), LENSES.values(), ids=LENSES)
@pytest.mark.ci
def test_behind_a_lens_that_distorts(scene, device, n_row, n_col, fov_deg, lens):
    described = sky_scene(scene, n_row, n_col, fov_deg, distortion=lens)
    plain = sky_scene(scene, n_row, n_col, fov_deg)
    assert abs(described.camera.half_diagonal_rad() / plain.camera.half_diagonal_rad() - 1) > 0.02
    assert_stage_is_complete(described, device, borders_of_the_sky(), 1200, alike)


@pytest.mark.parametrize("on", ["", "aberration", "parallax", "light_deflection"])
@pytest.mark.ci
def test_with_switches_off(scene, device, on):
    described = sky_scene(scene, 128, 128, 1.0, {name: name == on for name in ALL_ON})
    assert_stage_is_complete(described, device, borders_of_the_sky()[:4], 600, mixed)


@pytest.mark.parametrize("n_pixel", [128, 6000])
@pytest.mark.ci
def test_parallaxes_as_large_as_a_catalog_may_hold(scene, device, n_pixel):
    described = sky_scene(scene, n_pixel, n_pixel, 1.0)
    sun = -unit(earth_state(described, START_S)[0]["p"])
    aside = unit(np.cross(sun, [0.2, 0.1, 1.0]))  # where parallaxes are largest, along a diagonal
    axes = np.concatenate([borders_of_the_sky(), [axes_with_corner_towards(aside, sun)]])
    far_off = {"shift_arcsec": 1.3e-3 * NEAREST_MAS, "parallax_mas": NEAREST_MAS}
    assert_stage_is_complete(described, device, axes, 3000, alike, **far_off)


def assert_stage_is_complete(scene, device, axes, n_star, light, **far_off):
    """Run the stage on stars about the borders of frames with given axes, and compare."""
    on = wp.get_device(device)
    time_s = scene.scenario.instrument.frame_time_s(np.arange(len(axes)))
    earth_m_s = np.stack([earth_velocity_m_s(scene, time) for time in time_s])
    carried = (earth_m_s + scene.scenario.tracks.satellites[0].state(time_s)[1]) * scene.sky.aberration
    barycentric_au = np.stack([earth_state(scene, time)[1]["p"] for time in time_s]) * scene.sky.parallax
    catalog = stars_on_the_rim(scene.camera, axes, carried, barycentric_au, n_star, light, n_star, **far_off)
    world = device_scene(scene, scene.bands, on, catalog)
    inputs, views, sources = hand_made_views(world, time_s, axes, world.n_target + len(catalog))
    gather_stars(world, inputs, views, sources).run()
    n_source, star, seen = sources.n_source.numpy(), sources.star.numpy(), views.numpy()
    np.testing.assert_array_equal(seen["n_required"], n_source)
    lists = [world.stars.index.star_row[star[view, world.n_target : n]] for view, n in enumerate(n_source)]
    position_m, velocity_m_s = seen["position_m"], seen["velocity_m_s"]
    np.testing.assert_allclose(velocity_m_s * scene.sky.aberration, carried, rtol=0, atol=VELOCITY_M_S)
    listed = zip(axes, position_m, velocity_m_s, time_s, lists, strict=True)
    n_inside, n_beside = assert_lists_are_complete(scene, catalog, listed)
    assert n_inside > 0.2 * len(catalog)
    assert n_beside > 0.05 * len(catalog)


@pytest.mark.parametrize(("n_pixel", "bands"), [(128, ["A", "E"]), (6000, ["A"])])
@pytest.mark.ci
def test_the_renderers_list_is_complete(scene, device, n_pixel, bands):
    """The same through the renderer, where targets are: sensors of the constellation, frames apart in time."""
    described = sky_scene(scene, n_pixel, n_pixel, 1.0).replace(
        bands=bands, frames={"count": 162, "interval_s": 10.0, "start_s": 0.0}
    )
    frames, sensors = ([70, 61], ["sat11", "sat47"]) if n_pixel < 1000 else ([70], ["sat11"])
    dark = ws.Renderer(scene, device=device).render(frames, sensors, ["A"])
    n_view = len(frames) * len(sensors)
    axes, velocities = dark.axes_icrs.reshape(n_view, 3, 3), dark.velocity_m_s.reshape(n_view, 3)
    catalog = stars_on_the_rim(described.camera, axes, velocities, np.zeros((n_view, 3)), 1000, mixed, seed=4)
    seen = ws.Renderer(described, device=device, catalog=catalog).render(frames, sensors, bands, keep_stars=True)
    np.testing.assert_array_equal(seen.axes_icrs, dark.axes_icrs)
    stars, views = seen.stars, []
    for number, frame in enumerate(frames):
        time_s = float(described.scenario.instrument.frame_time_s([frame])[0])
        for column, sensor in enumerate(sensors):
            mine = stars[(stars["frame"] == frame) & (stars["sensor"] == sensor)]
            position_m = described.position_m(sensor, [time_s])[0]
            rows = np.asarray(mine["catalog_row"])
            views.append((seen.axes_icrs[number, column], position_m, seen.velocity_m_s[number, column], time_s, rows))
    n_inside, n_beside = assert_lists_are_complete(described, catalog, views)
    assert np.count_nonzero(stars["in_fov"]) == n_inside
    assert n_inside > 200 * n_view
    assert n_beside > 100 * n_view


@wp.kernel(enable_backward=False)
def near_kernel(
    observer_m: wp.array[wp.vec3d],
    direction: wp.array[wp.vec3d],
    star: wp.array[wp.vec3d],
    radius_rad: wp.array[wp.float64],
    earth: Earth,
    near: wp.array[wp.int32],
    hidden: wp.array[wp.int32],
):
    i = wp.tid()
    near[i] = wp.where(is_earth_near(observer_m[i], direction[i], radius_rad[i], earth), 1, 0)
    hidden[i] = wp.where(is_star_occulted(observer_m[i], star[i], earth), 1, 0)


def test_no_star_is_hidden_where_the_earth_is_not_near(scene, device):
    """Cones about the limb, some over a pole and some in the Earth, with stars up to their rims."""
    rng = np.random.default_rng(3)
    n = 20_000
    observer = np.stack([unit(v) for v in rng.normal(size=(n, 3))])
    height = rng.choice([6.3e6, 6.379e6, 6.9e6, 8e6, 4.2e7], n)
    observer[::5] = [0.0, 0.0, 1.0]
    radius = rng.choice([1e-6, 0.01, 0.3, 2.0], n)
    limb = np.arcsin(np.minimum(6.378137e6 / height, 1.0))
    across = np.cross(observer, np.roll(observer, 1, axis=0) + np.array([1e-3, 0, 0]))
    across /= np.linalg.norm(across, axis=1)[:, None]
    off_nadir = limb + radius * rng.uniform(-2, 2, n)
    direction = -observer * np.cos(off_nadir)[:, None] + across * np.sin(off_nadir)[:, None]
    towards = off_nadir - radius * rng.choice([1.0, 0.5], n)  # a star of the cone, mostly on the rim next to the Earth
    star = -observer * np.cos(towards)[:, None] + across * np.sin(towards)[:, None]
    arrays = [wp.array(v, dtype=wp.vec3d, device=device) for v in (observer * height[:, None], direction, star)]
    near, hidden = (wp.empty(n, dtype=wp.int32, device=device) for _ in range(2))
    inputs = [*arrays, wp.array(radius, dtype=wp.float64, device=device), earth_struct(scene.scenario.tracks.pole_icrs)]
    wp.launch(near_kernel, n, inputs=inputs, outputs=[near, hidden], device=device)
    near, hidden = near.numpy().astype(bool), hidden.numpy().astype(bool)
    assert not (hidden & ~near).any()
    assert hidden.sum() > n / 10
    assert (~near).sum() > n / 10
