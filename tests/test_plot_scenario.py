"""Figures of scenarios: what is drawn is what the scene is, against ray casting, skyfield, scipy and the renderer."""

import numpy as np
import pytest
from figures import close_figures  # noqa: F401
from scipy.spatial.transform import Rotation

import warpsim as ws
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING, EARTH_GM_M3_S2, SPEED_OF_LIGHT_M_S
from warpsim.orbit.earth import gcrs_to_geodetic
from warpsim.orbit.sun import earth_states
from warpsim.plot.figure import annotate_points, globe_from, plain, save_figure
from warpsim.plot.figure_files import draw_access, draw_scenario
from warpsim.plot.group_figure import body_to_gcrs, drawn_facets, group_offsets_m
from warpsim.plot.image_figure import camera_view, earth_clearance
from warpsim.plot.scene_figure import broken_at_date_line, osculating_ellipse_m
from warpsim.render.device_stars import load_catalog, star_index

SEED = 417
DRAWN_ATOL = 1e-9  # thousands of km; only rounding
PIXEL_ATOL = 1e-6  # px; the renderer's own positions, and a float64 chain written anew
LIMB_RTOL = 1e-9  # of the Earth's radius: where a line is cut
TRACK_ATOL_DEG = 1e-7  # skyfield against this: rounding of its iterated latitude (1 cm on the ground)
ASPECT_ATOL_DEG = 1e-6
FACET_RTOL = 0.02  # a polygon of 24 corners has 1.2 % less area than its circle
TIME_S = 600.0
TETRAHEDRON = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


@pytest.fixture(scope="module")
def renderer(scene):
    return ws.Renderer(scene, device="cpu")


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def ellipsoid(pole):
    """Q with x Q x = 1 on WGS84 about a pole."""
    a, b = EARTH_EQUATORIAL_RADIUS_M, EARTH_EQUATORIAL_RADIUS_M * (1 - EARTH_FLATTENING)
    return np.eye(3) / a**2 + np.outer(pole, pole) * (1 / b**2 - 1 / a**2)


def hits_earth(start_m, direction, pole):
    """Whether rays meet the ellipsoid ahead of their start, by the roots of the quadratic, and its discriminant."""
    q = ellipsoid(pole)
    a = np.einsum("...i,ij,...j->...", direction, q, direction)
    b = np.einsum("...i,ij,...j->...", start_m, q, direction)
    c = np.einsum("...i,ij,...j->...", start_m, q, start_m) - 1
    discriminant = b * b - a * c
    return (discriminant > 0) & (-b + np.sqrt(np.maximum(discriminant, 0)) > 0), discriminant / (a * (c + 1))


def some_pole(seed=SEED):
    return unit(np.array([0.002, -0.001, 1.0]) + 1e-4 * np.random.default_rng(seed).normal(size=3))


# --- the globe ---


@pytest.mark.parametrize("view", [(20.0, 35.0), (300.0, -80.0), (0.0, 90.0), (123.0, 0.0)])
def test_what_the_earth_hides_is_what_rays_hit(view):
    globe = globe_from(*view, some_pole())
    rng = np.random.default_rng(SEED)
    point_m = unit(rng.normal(size=(4000, 3))) * rng.uniform(6.4e6, 2e7, (4000, 1))
    np.testing.assert_array_equal(globe.is_hidden(point_m), hits_earth(point_m, globe.towards, globe.pole)[0])


def test_lines_end_at_the_limb():
    globe = globe_from(40.0, 20.0, some_pole())
    rng = np.random.default_rng(SEED)
    for _ in range(20):
        plane = unit(rng.normal(size=(2, 3)))
        turn = np.linspace(0, 2 * np.pi, 37)[:, None]
        path_m = 8e6 * (np.cos(turn) * plane[0] + np.sin(turn) * unit(np.cross(plane[0], plane[1])))
        drawn = globe.visible_line(path_m)
        hidden = globe.is_hidden(path_m)
        shown = ~np.isnan(drawn[:, 0])
        n_cut = np.count_nonzero(hidden[1:] != hidden[:-1])
        assert np.count_nonzero(shown) == np.count_nonzero(~hidden) + n_cut
        # The points put in are on the limb: their rays only touch the ellipsoid.
        known = globe.project(path_m)
        new = [xy for xy in drawn[shown] if np.abs(known - xy).max(axis=1).min() > 0]
        points_m = 1e6 * (np.array(new).reshape(-1, 2) @ np.stack([globe.right, globe.up]))
        assert np.abs(hits_earth(points_m, globe.towards, globe.pole)[1]).max(initial=0) < 1e-9
    everywhere = globe.visible_line(3 * path_m + 5e7 * globe.towards)
    np.testing.assert_allclose(everywhere, globe.project(3 * path_m + 5e7 * globe.towards), rtol=0, atol=DRAWN_ATOL)


def test_the_limb_is_a_circle_from_the_pole_and_an_ellipse_from_the_equator():
    a, b = EARTH_EQUATORIAL_RADIUS_M / 1e6, EARTH_EQUATORIAL_RADIUS_M * (1 - EARTH_FLATTENING) / 1e6
    z = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(np.linalg.norm(globe_from(0, 90, z).limb(), axis=1), a, rtol=LIMB_RTOL)
    x, y = globe_from(77, 0, z).limb().T
    np.testing.assert_allclose((x / a) ** 2 + (y / b) ** 2, 1, rtol=LIMB_RTOL)


def test_normals_are_geodetic():
    pole = np.array([0.0, 0.0, 1.0])
    globe = globe_from(30.0, 25.0, pole)
    rng = np.random.default_rng(SEED)
    lon, lat = rng.uniform(-np.pi, np.pi, 500), np.arcsin(rng.uniform(-1, 1, 500))
    normal = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    normal = normal[normal @ globe.towards > 0.01]
    q = ellipsoid(pole)
    surface_m = normal @ np.linalg.inv(q) / np.sqrt(np.einsum("ni,ij,nj->n", normal, np.linalg.inv(q), normal))[:, None]
    np.testing.assert_allclose(globe.normals(globe.project(surface_m)), normal, rtol=0, atol=1e-9)
    assert np.isnan(globe.normals(np.array([[6.5, 0.0]]))).all()


@pytest.mark.parametrize("eccentricity", [0.0, 0.3, 0.9])
def test_osculating_ellipse_has_the_vis_viva_size(eccentricity):
    perigee_m = 7e6
    speed = np.sqrt(EARTH_GM_M3_S2 * (1 + eccentricity) / perigee_m)
    turn = Rotation.from_rotvec([0.3, -1.0, 0.7]).as_matrix()
    state = turn @ [perigee_m, 0, 0], turn @ [0, speed, 0]
    radius_m = np.linalg.norm(osculating_ellipse_m(*state), axis=1)
    assert radius_m.min() == pytest.approx(perigee_m, rel=1e-12)
    assert radius_m.max() == pytest.approx(perigee_m * (1 + eccentricity) / (1 - eccentricity), rel=1e-4)
    assert len(osculating_ellipse_m(state[0], 2 * state[1])) == 1  # it escapes: no ellipse to draw


# --- the scene ---


@pytest.mark.ci
def test_title_and_legend_are_within_the_figure(scene, tmp_path):
    """A flight far away, whose numbers at the axis are wide, so that the square takes all of the figure's height."""
    image = pytest.importorskip("matplotlib.image")
    far = scene.replace(
        trajectory=ws.StateVector([7e6, 0.0, 0.0], [0.0, 20000.0, 0.0]), duration_s=50000.0, access_rules={}
    )
    ax = ws.plot.plot_scene(far)
    ax.figure.canvas.draw()
    figure = ax.figure.bbox
    for part in (ax.title, ax.get_legend()):
        box = part.get_window_extent()
        assert figure.x0 <= box.x0 and figure.y0 <= box.y0 and box.x1 <= figure.x1 and box.y1 <= figure.y1
    ax.figure.set_size_inches(8.2, 8.0)  # where the figure is too low, the file is not
    save_figure(ax.figure, tmp_path / "far.png")
    pixels = image.imread(tmp_path / "far.png")[..., :3]
    assert pixels.shape[0] > 8.0 * 150
    assert all((edge == 1).all() for edge in (pixels[:6], pixels[-6:], pixels[:, :6], pixels[:, -6:]))


def by_label(ax, start):
    return [line for line in ax.get_lines() if str(line.get_label()).startswith(start)]


def test_scene_figure_has_the_positions_of_the_scene(scene):
    view = (10.0, 70.0)
    ax = ws.plot.plot_scene(scene, TIME_S, view_ra_dec_deg=view)
    # The projection written anew: towards the viewer, the pole upwards.
    ra, dec = np.radians(view)
    towards = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    pole = scene.scenario.tracks.pole_icrs
    right = unit(np.cross(pole, towards))
    up = np.cross(towards, right)

    def xy(position_m):
        return np.stack([position_m @ right, position_m @ up], axis=-1) / 1e6

    position_m = {name: scene.position_m(name, TIME_S)[0] for name in [*scene.sensor_names, "center"]}
    seen = {name for name in scene.sensor_names if scene.scenario.has_access(name, TIME_S)[0]}
    visible = {name for name in position_m if not hits_earth(position_m[name], towards, pole)[0]}
    assert seen == {"sat11", "sat12", "sat21", "sat27", "sat41", "sat47"}
    others = set(scene.sensor_names) - seen
    for label, wanted in (("satellites with access: 6", seen), ("satellites without access: 22", others)):
        (dots,) = by_label(ax, label)
        expected = [xy(position_m[name]) for name in scene.sensor_names if name in wanted & visible]
        np.testing.assert_allclose(dots.get_xydata(), expected, rtol=0, atol=DRAWN_ATOL)
    assert by_label(ax, f"{28 - len(visible - {'center'})} of them behind the Earth")
    (now,) = by_label(ax, "center now")
    np.testing.assert_allclose(now.get_xydata()[0], xy(position_m["center"]), rtol=0, atol=DRAWN_ATOL)
    ends = [line.get_xydata()[[0, -1]] for line in ax.get_lines() if len(line.get_xdata()) >= 101]
    for name in seen & visible:
        line = np.array([xy(position_m[name]), xy(position_m["center"])])
        assert np.nanmin([np.abs(end - line).max() for end in ends]) < DRAWN_ATOL
    texts = {text.get_text() for text in ax.texts}
    assert seen & visible <= texts and not texts & others
    assert "2025-01-01T14:10:00.000 UTC" in ax.get_title()
    assert ax.get_xlabel() == "[1000 km]"


def test_scene_figure_leaves_out_what_the_earth_hides(scene):
    """Seen from the far side the flight and its lines of sight are behind the Earth."""
    middle = unit(scene.position_m("center", scene.duration_s / 2)[0])
    far_side = float(np.degrees(np.arctan2(-middle[1], -middle[0]))), float(np.degrees(np.arcsin(-middle[2])))
    ax = ws.plot.plot_scene(scene, TIME_S, view_ra_dec_deg=far_side)
    (flight,) = by_label(ax, "flight of")
    assert np.isnan(flight.get_xydata()).mean() > 0.5
    assert not by_label(ax, "center now")


def test_scene_is_seen_aside_of_its_flight_on_the_side_of_the_sun(scene):
    ax = ws.plot.plot_scene(scene)
    (flight,) = by_label(ax, "flight of")
    assert not np.isnan(flight.get_xydata()).any()
    ra, dec = np.radians([300.0, 78.0])  # as the title says
    assert "seen from RA 300, dec 78 deg" in ax.get_title() and "at 807.0 s" in ax.get_title()
    towards = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    start, middle, end = unit(scene.position_m("center", [0.0, scene.duration_s / 2, scene.duration_s]))
    normal = unit(np.cross(start, end)) * np.sign(np.cross(start, end) @ scene.position_m("sun", 0.0)[0])
    assert np.degrees(np.arccos([towards @ middle, towards @ normal])) == pytest.approx([45.0, 45.0], abs=1.0)


def test_sun_arrow_points_to_the_sun_and_the_day_is_there(scene):
    ax = ws.plot.plot_scene(scene, TIME_S, view_ra_dec_deg=(281.0, 60.0))  # the Sun is at RA 281, dec -23
    (word,) = (text for text in ax.texts if text.get_text() == "Sun")
    (arrow,) = (text for text in ax.texts if text.get_text() == "" and text.get_zorder() == 9)
    x, y = np.subtract(arrow.xy, arrow.xyann)
    assert y < 0 and abs(x) < -0.1 * y
    assert np.hypot(*word.get_position()) > ax.get_xlim()[1]  # in a corner: neither on the Earth nor in an orbit
    image = np.asarray(ax.images[0].get_array())
    n = len(image)
    lower, upper = image[n // 4, n // 2].mean(), image[3 * n // 4, n // 2].mean()  # origin is below
    assert lower > upper + 0.2


# --- ground tracks ---


def test_ground_points_are_skyfields(scene):
    from skyfield.api import load, wgs84
    from skyfield.positionlib import Geocentric

    time_s = np.linspace(0, scene.duration_s, 23)
    position_m = scene.position_m("sat11", time_s)
    lon, lat, height_m = gcrs_to_geodetic(position_m, scene.epoch, time_s)
    tt = scene.epoch.tt
    t = load.timescale(builtin=True).tt_jd(np.full(23, tt.jd1), tt.jd2 + time_s / 86400)
    place = wgs84.geographic_position_of(Geocentric(position_m.T / 149_597_870_700.0, t=t, center=399))
    np.testing.assert_allclose((lon - place.longitude.degrees + 180) % 360 - 180, 0, rtol=0, atol=TRACK_ATOL_DEG)
    np.testing.assert_allclose(lat, place.latitude.degrees, rtol=0, atol=TRACK_ATOL_DEG)
    np.testing.assert_allclose(height_m, place.elevation.m, rtol=0, atol=1e-2)


def test_tracks_break_at_the_date_line():
    lon, lat = np.array([170.0, 178.0, -174.0, -166.0, 178.0]), np.array([0.0, 8.0, 16.0, 24.0, 40.0])
    track = broken_at_date_line(lon, lat)
    expected = [
        [170, 0], [178, 8], [180, 10], [np.nan, np.nan], [-180, 10], [-174, 16], [-166, 24],
        [-180, 38], [np.nan, np.nan], [180, 38], [178, 40],
    ]  # fmt: skip
    np.testing.assert_allclose(track, expected, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(broken_at_date_line(lon[:2], lat[:2]), np.stack([lon[:2], lat[:2]], axis=1))


@pytest.mark.ci
def test_map_marks_access(scene):
    ax = ws.plot.plot_ground_tracks(scene)
    for line in ax.get_lines():
        assert np.nanmax(np.abs(np.diff(line.get_xdata())), initial=0) <= 180
    thick = [line.get_xydata() for line in ax.get_lines() if line.get_linewidth() == 3 and len(line.get_xdata())]
    table = scene.access()
    assert len(thick) == len(table) == 11
    for line, row in zip(thick, table, strict=True):
        for end, time_s in ((0, row["start_s"]), (-1, row["end_s"])):
            lon, lat, _ = gcrs_to_geodetic(scene.position_m(row["sensor"], time_s), scene.epoch, np.array([time_s]))
            np.testing.assert_allclose(line[end], [lon[0], lat[0]], rtol=0, atol=TRACK_ATOL_DEG)
    flight = next(line.get_xydata() for line in ax.get_lines() if line.get_linewidth() == 2.4)
    np.testing.assert_allclose(flight[0], [129.67, 40.86], rtol=0, atol=1e-4)  # Table 5 of the paper
    np.testing.assert_allclose(flight[-1], [-118.40, 34.10], rtol=0, atol=1e-4)
    assert {text.get_text() for text in ax.texts} == set(table["sensor"])


# --- a satellite's view ---


def apparent_positions_px(scene, sensor, time_s, axes):
    """Pixels of the targets by a chain written anew: light time, then the two steps of aberration."""
    observer_m, velocity = (part[0] for part in scene.scenario.tracks.of(sensor).state(np.array([time_s])))
    earth = earth_states(scene.epoch, np.array([time_s])).velocity_m_s[0]
    directions = []
    for name in scene.target_names:
        emitted_s = time_s
        for _ in range(5):
            line_m = scene.position_m(name, emitted_s)[0] - observer_m
            emitted_s = time_s - np.linalg.norm(line_m) / SPEED_OF_LIGHT_M_S
        directions.append(ws.apparent_direction(ws.apparent_direction(unit(line_m), -earth), earth + velocity))
    return scene.camera.project(np.array(directions), axes)[0]


@pytest.mark.parametrize("time_s", [600.0, 603.7], ids=["of a frame", "between frames"])
def test_view_is_the_renderers(scene, renderer, time_s):
    view = camera_view(scene.scenario, "sat11", time_s, renderer)
    np.testing.assert_allclose(
        view.target_xy_px, apparent_positions_px(scene, "sat11", time_s, view.axes_icrs), rtol=0, atol=PIXEL_ATOL
    )
    if time_s == 600.0:
        truth = renderer.render([60], ["sat11"], ["C"]).truth
        np.testing.assert_array_equal(view.target_xy_px, np.stack([truth["x_px"], truth["y_px"]], axis=1))


def test_view_before_the_first_frame(scene):
    late = scene.replace(frames={"count": 10, "interval_s": 10.0, "start_s": 100.0}, sky__catalog="none")
    view, plain = (camera_view(one.scenario, "sat11", 50.0) for one in (late, scene.replace(sky__catalog="none")))
    np.testing.assert_array_equal(view.target_xy_px, plain.target_xy_px)


def test_stars_in_the_view_are_those_of_the_catalog(scene, renderer):
    view = camera_view(scene.scenario, "sat11", TIME_S, renderer)
    device = ws.BandIndex(ws.StarCatalog.from_arrays([], [], {})).device
    index = star_index(scene.sky, scene.scenario.epoch, load_catalog(scene.sky), device)
    rows = index.query(view.axes_icrs[2], scene.camera.half_diagonal_rad() + 2e-4)
    observer = earth_states(scene.epoch, np.array([TIME_S])).velocity_m_s[0] + view.velocity_m_s
    seen = ws.apparent_direction(index.catalog.direction_icrs[rows], observer)
    xy_px, _ = scene.camera.project(seen, view.axes_icrs)
    inside = ((xy_px >= -0.5) & (xy_px < 127.5)).all(axis=1)
    ax = ws.plot.plot_satellite_view(scene, "sat11", TIME_S, renderer=renderer)
    drawn = np.asarray(ax.collections[0].get_offsets())
    assert len(drawn) == np.count_nonzero(inside) == 4
    np.testing.assert_allclose(
        drawn[np.lexsort(drawn.T)], xy_px[inside][np.lexsort(xy_px[inside].T)], rtol=0, atol=PIXEL_ATOL
    )


def test_view_draws_every_target_at_its_pixel(scene, renderer):
    view = camera_view(scene.scenario, "sat11", TIME_S, renderer)
    ax = ws.plot.plot_satellite_view(scene, "sat11", TIME_S, renderer=renderer)
    drawn = np.concatenate([by_label(ax, label)[0].get_xydata() for label in ("center", "sphere", "cylinder", "cone")])
    np.testing.assert_array_equal(drawn, view.target_xy_px)
    assert ax.get_ylim() == (127.5, -0.5) and ax.get_xlim() == (-0.5, 127.5)
    assert "3508 km from center, access" in ax.get_title()
    names = {text.get_text() for inset in ax.child_axes for text in inset.texts}
    assert names == set(scene.target_names)


def test_compass_points_to_zenith_and_north(scene, renderer):
    view = camera_view(scene.scenario, "sat11", TIME_S, renderer)
    ax = ws.plot.plot_satellite_view(scene, "sat11", TIME_S, renderer=renderer)
    arrows = [text for text in ax.texts if text.get_text() == "" and hasattr(text, "xy")]
    for arrow, direction in zip(arrows[:2], (view.position_m, np.array([0, 0, 1.0])), strict=True):
        step = np.array(arrow.xy) - np.array(arrow.xyann)
        # A small step from the boresight towards the direction, projected.
        moved = unit(view.axes_icrs[2] + 1e-6 * unit(direction))
        wanted = scene.camera.project(moved[None], view.axes_icrs)[0][0] - scene.camera.centre_px
        np.testing.assert_allclose(unit(step), unit(wanted), rtol=0, atol=1e-5)


def test_limb_is_where_rays_touch_the_earth(scene):
    wide = scene.replace(camera__fov_deg=60.0, optics__psf="gaussian", sky__catalog="none")
    view = camera_view(wide.scenario, "sat11", TIME_S)
    camera, pole = wide.camera, wide.scenario.tracks.pole_icrs
    x, y = np.meshgrid(np.linspace(-0.5, 127.5, 60), np.linspace(-0.5, 127.5, 60))
    xy = np.stack([x, y], axis=-1)
    ray = np.concatenate([(xy - camera.centre_px) / camera.focal_px, np.ones((60, 60, 1))], axis=-1) @ view.axes_icrs
    ray = unit(ray)
    clearance = earth_clearance(view, pole, xy)
    # Rays as they are without the sensor's motion about the Earth, which moves the limb by up to 5 arcsec.
    still = ws.apparent_direction(ray.reshape(-1, 3), -view.velocity_m_s).reshape(ray.shape)
    hit, _ = hits_earth(view.position_m, still, pole)
    assert 0.2 < hit.mean() < 0.5
    np.testing.assert_array_equal(clearance < 0, hit)
    # Next to the limb: rays a thousandth of a pixel (1.7 arcsec) to either side.
    limb_row = np.interp(0, clearance[:, 30], y[:, 30])
    for _ in range(20):  # secant steps to the limb in the middle column
        at = np.array([[x[0, 30], limb_row], [x[0, 30], limb_row + 1e-3]])
        here, below = earth_clearance(view, pole, at)
        limb_row -= here * 1e-3 / (below - here)
    for step, expected in ((-1e-3, False), (1e-3, True)):
        seen = np.array([(x[0, 30] - camera.centre_px[0]), limb_row + step - camera.centre_px[1], camera.focal_px])
        direction = ws.apparent_direction(unit(seen @ view.axes_icrs), -view.velocity_m_s)
        assert hits_earth(view.position_m, direction, pole)[0] == expected
    ax = ws.plot.plot_satellite_view(wide, "sat11", TIME_S)
    assert by_label(ax, "Earth")
    limb = np.concatenate([path.vertices for path in ax.collections[1].get_paths()])
    assert np.abs(earth_clearance(view, pole, limb)).max() < 2e-5  # linear between grid points: 0.02 px


def test_view_marks_what_is_behind_the_earth(scene):
    ax = ws.plot.plot_satellite_view(scene.replace(sky__catalog="none"), "sat15", TIME_S)
    (crosses,) = by_label(ax, "behind the Earth (30)")
    assert len(crosses.get_xdata()) == 30
    assert not by_label(ax, "center") and "no access" in ax.get_title()


def test_targets_not_deployed_are_not_in_the_view(scene):
    late = scene.replace(targets__3__release={"time_s": 700.0}, sky__catalog="none")
    ax = ws.plot.plot_satellite_view(late, "sat11", TIME_S)
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert legend == ["center", "sphere (10)", "cylinder (10)", "not deployed, not drawn (9)"]
    assert not by_label(ax, "cone")
    words = {text.get_text() for part in (ax, *ax.child_axes) for text in part.texts}
    assert "sphere03" in words and not any(word.startswith("cone") for word in words)


def test_legend_of_a_view_is_of_what_is_in_the_frame(scene):
    """A camera that looks beside the group: some of it is outside."""
    beside = scene.replace(pointing={"offset_px": [62.0, 0.0]}, sky__catalog="none")
    view = camera_view(beside.scenario, "sat11", TIME_S)
    inside = (np.abs(view.target_xy_px - 63.5) < 64).all(axis=1)
    assert 0 < inside.sum() < 30
    ax = ws.plot.plot_satellite_view(beside, "sat11", TIME_S)
    for kind, first, last in (("center", 0, 1), ("sphere", 1, 11), ("cylinder", 11, 21), ("cone", 21, 30)):
        count = np.count_nonzero(inside[first:last])
        lines = by_label(ax, kind)
        assert sum(len(line.get_xdata()) for line in lines) == count
        if kind != "center" and 0 < count < 9:
            assert lines[0].get_label().startswith(f"{kind} ({count} of ")


@pytest.mark.parametrize("roll_deg", range(0, 360, 30))
@pytest.mark.ci
def test_words_of_the_compass_are_inside_the_frame(scene, roll_deg):
    rolled = scene.replace(pointing={"roll_deg": float(roll_deg)}, sky__catalog="none")
    ax = ws.plot.plot_satellite_view(rolled, "sat12", TIME_S)
    ax.figure.canvas.draw()
    words = [text for text in ax.texts if text.get_text() in ("zenith", "north")]
    assert len(words) == 2
    for word in words:
        box = word.get_window_extent()
        assert ax.bbox.x0 < box.x0 < box.x1 < ax.bbox.x1 and ax.bbox.y0 < box.y0 < box.y1 < ax.bbox.y1


# --- the group ---


def offsets_m(scene, time_s, group=0):
    targets = [index for index, target in enumerate(scene.scenario.targets) if target.group == group]
    return group_offsets_m(scene.scenario.tracks, targets, time_s)


def test_group_offsets_are_turned_differences(scene):
    offset_m = offsets_m(scene, TIME_S)
    position_m = np.stack([scene.position_m(name, TIME_S)[0] for name in scene.target_names])
    np.testing.assert_allclose(
        np.linalg.norm(offset_m, axis=1), np.linalg.norm(position_m - position_m[0], axis=1), rtol=0, atol=1e-6
    )
    before, after = (scene.position_m("center", TIME_S + step)[0] for step in (-0.5, 0.5))
    frame = Rotation.align_vectors([[1, 0, 0], [0, 0, 1]], [position_m[0], np.cross(before, after)])[0].as_matrix()
    np.testing.assert_allclose(offset_m, (position_m - position_m[0]) @ frame.T, rtol=0, atol=1e-3)
    speed_m_s = np.linalg.norm(offsets_m(scene, 1.0)[1:], axis=1)
    assert speed_m_s.min() > 1.99 and speed_m_s.max() < 5.01  # the release, after one second


@pytest.mark.parametrize(("late_s", "words"), [(1000.0, "\n29 not deployed"), (TIME_S, "")])
def test_panels_of_targets_on_one_spot_are_two_metres_wide(scene, late_s, words):
    axes = ws.plot.plot_group(scene.replace(release__time_s=late_s), TIME_S)
    assert {ax.get_xlim() for ax in axes[:3]} == {(-1.0, 1.0)}
    assert axes[0].get_title() == f"group about center at 600 s{words}"


def test_group_panels_show_the_offsets(scene):
    offset_km = offsets_m(scene, TIME_S) / 1e3
    axes = ws.plot.plot_group(scene, TIME_S)
    for ax, columns in zip(axes[:3], ([1, 0], [2, 0], [1, 2]), strict=True):
        drawn = np.concatenate([by_label(ax, label)[0].get_xydata() for label in ("center", "sphere", "cyl", "cone")])
        np.testing.assert_allclose(drawn, offset_km[:, columns], rtol=0, atol=1e-12)
        assert "[km]" in ax.get_xlabel()
    assert axes[0].get_xlabel().startswith("along") and axes[0].get_ylabel().startswith("radial")
    assert "[m]" in ws.plot.plot_group(scene, 10.0)[0].get_xlabel()
    assert len(axes) == 4 and len(ws.plot.plot_group(scene, TIME_S, axes[:3])) == 3


# --- attitudes ---


def test_body_axes_are_those_of_the_truth(scene, renderer):
    truth = renderer.render([60], ["sat11"], ["A"]).truth
    observer_m = scene.position_m("sat11", TIME_S)[0]
    for row in truth:
        emitted_s = TIME_S - 1e3 * row["range_km"] / SPEED_OF_LIGHT_M_S
        axis = body_to_gcrs(scene.scenario, row["target"], emitted_s)[0][:, 2]
        towards = unit(observer_m - scene.position_m(row["target"], emitted_s)[0])
        aspect_deg = np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, towards)), axis @ towards))
        assert aspect_deg == pytest.approx(row["aspect_deg"], abs=ASPECT_ATOL_DEG)


def test_bodies_are_turned_by_rotations(scene):
    rotation = body_to_gcrs(scene.scenario, "cylinder03", [0.0, 0.3, 1000.7])
    np.testing.assert_allclose(rotation @ np.swapaxes(rotation, 1, 2), np.tile(np.eye(3), (3, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotation), 1, rtol=0, atol=1e-12)


def test_spin_turns_a_body_about_its_axis(scene):
    spinning = scene.replace(targets__0__attitude={"spin_rev_s": 2.0})
    first, second = body_to_gcrs(spinning.scenario, "center", [10.0, 10.05])
    np.testing.assert_allclose(first.T @ second, Rotation.from_euler("z", 36, degrees=True).as_matrix(), atol=1e-9)


DRAWN = {
    "sphere": (ws.Sphere(0.5), 0.5),
    "cylinder": (ws.Cylinder(0.25, 1.0), np.hypot(0.25, 0.5)),
    "cone": (ws.Cone(0.25, 1.0), np.hypot(0.25, 0.5)),
    "frustum": (ws.Frustum(0.1, 0.25, 1.0), np.hypot(0.25, 0.5)),
    "plate": (ws.Plate(2.0, 0.6), np.hypot(1.0, 0.3)),
    "mesh": (ws.Mesh(vertices_m=[[3, 0, 0], [5, 0, 0], [3, 2, 0], [3, 0, 2]], faces=TETRAHEDRON), np.sqrt(3)),
}
"""Shapes, and the half extent that they are drawn with 1 for."""


@pytest.mark.parametrize(("shape", "scale"), DRAWN.values(), ids=DRAWN)
def test_drawn_bodies_have_the_projected_area(shape, scale):
    corners = drawn_facets(shape)
    assert np.linalg.norm(corners, axis=-1).max() == pytest.approx(1, abs=1e-12)
    for aspect in np.radians([0.0, 10.0, 40.0, 90.0, 150.0]):
        turned = corners @ Rotation.from_euler("y", aspect).as_matrix().T
        area = 0.5 * np.cross(turned[:, 2] - turned[:, 0], turned[:, 3] - turned[:, 1])[:, 2]
        expected = shape.projected_area_along_m2([-np.sin(aspect), 0.0, np.cos(aspect)]) / scale**2
        assert area[area > 0].sum() == pytest.approx(expected, rel=FACET_RTOL, abs=1e-12)
        assert area.sum() == pytest.approx(0, abs=1e-12)  # closed


def test_attitudes_of_every_kind_of_shape(scene):
    first = scene.to_dict()["groups"][0]["targets"][0]
    targets = [{**first, "name": name, "shape": shape} for name, (shape, _) in DRAWN.items()]
    ax = ws.plot.plot_attitudes(scene.replace(targets=targets), 0.0)
    words = [text.get_text() for text in ax.texts]
    for line in ("frustum, r 0.1 to 0.25 m, h 1 m", "plate, 2 x 0.6 m", "mesh, 2 x 2 x 2 m"):
        assert any(line in word for word in words)


def test_attitudes_show_one_of_each_kind_at_each_instant(scene):
    ax = ws.plot.plot_attitudes(scene, TIME_S)
    assert len(ax.collections) == 4 * 6
    words = [text.get_text() for text in ax.texts]
    assert [word.split("\n")[0] for word in words if "\n" in word] == ["center", "sphere01", "cylinder01", "cone01"]
    assert "+0.1667 s" in words  # one turn a second is the slowest motion
    assert len(ws.plot.plot_attitudes(scene, [0.0, 10.0]).collections) == 8
    assert len(ws.plot.plot_attitudes(scene, scene.duration_s).collections) == 4
    main = scene.to_dict()["groups"][0]["targets"][:1]
    still = scene.replace(targets=main, targets__0__attitude={"axis": [0.0, 0.0, 1.0]})
    assert len(ws.plot.plot_attitudes(still, 0.0).collections) == 6


@pytest.mark.ci
def test_times_are_written_plainly(scene):
    assert [plain(value) for value in (0.0, 10800.0, 0.25, 1234567.0)] == ["0", "10800", "0.25", "1234570"]
    assert plain(10833.4, 4) == "10830" and plain(1 / 6, 4) == "0.1667"
    main = scene.to_dict()["groups"][0]["targets"][:1]
    still = scene.replace(
        duration_s=64800.0, targets=main, targets__0__attitude={"axis": [0.0, 0.0, 1.0]},
        trajectory=ws.KeplerOrbit(66.0, altitude_km=600.0), access_rules={},
    )  # fmt: skip
    ax = ws.plot.plot_attitudes(still, 0.0)
    words = {text.get_text() for text in ax.texts}
    assert {"0 s", "+10800 s", "+21600 s", "+32400 s", "+43200 s", "+54000 s"} <= words
    marks, axes = ax.get_title().split("\n")
    assert marks == "stss: attitudes, a dark quarter marks the turn"
    assert axes == "axes of center at 0 s: along-track to the right, radial upwards"


# --- access and range ---


def test_bars_are_the_access_table(scene):
    table = scene.access()
    ax = ws.plot.plot_access(scene)
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == scene.sensor_names
    bars = [patch for container in ax.containers for patch in container]
    drawn = {(names[round(b.get_y() + b.get_height() / 2)], b.get_x(), b.get_x() + b.get_width()) for b in bars}
    expected = {(row["sensor"], row["start_s"], row["end_s"]) for row in table}
    assert {(name, round(a, 6), round(b, 6)) for name, a, b in drawn} == {
        (name, round(a, 6), round(b, 6)) for name, a, b in expected
    }
    words = [text.get_text() for text in ax.texts]
    assert "243.3" in words and "1421.9" in words and "1036.4 to 1162.8" in words
    assert words.count("no access") == 18
    total_min = sum(r["end_s"] - r["start_s"] for r in table if r["sensor"] == "sat27") / 60
    assert f"{total_min:.1f} min" in words
    colours = {label.get_text(): label.get_color() for label in ax.get_yticklabels()}
    assert colours["sat11"] != colours["sat13"]


def test_only_sensors_with_access_on_demand(scene):
    ax = ws.plot.plot_access(scene, only_with_access=True)
    assert [label.get_text() for label in ax.get_yticklabels()] == sorted(set(scene.access()["sensor"]))
    blind = scene.replace(access_rules__max_range_km=10.0)
    ax = ws.plot.plot_access(blind, only_with_access=True)
    assert "no sensor has access" in [text.get_text() for text in ax.texts]
    assert len(ws.plot.plot_range(blind).get_lines()) == 1  # the limit


def test_range_is_the_distance_and_thick_during_access(scene):
    ax = ws.plot.plot_range(scene, ["sat27", "sat13"])
    thin = [line for line in ax.get_lines() if line.get_linewidth() == 0.8 and len(line.get_xdata())]
    thick = [line for line in ax.get_lines() if line.get_linewidth() == 3]
    for line, name in zip(thin, ("sat27", "sat13"), strict=True):
        x, y = line.get_xydata()[::50].T
        gap_m = scene.position_m(name, x) - scene.position_m("center", x)
        np.testing.assert_allclose(y, np.sqrt((gap_m**2).sum(axis=1)) / 1e3, rtol=1e-12)
    rows = [row for row in scene.access() if row["sensor"] == "sat27"]
    assert [(line.get_xdata()[0], line.get_xdata()[-1]) for line in thick] == [(r["start_s"], r["end_s"]) for r in rows]
    assert {text.get_text() for text in ax.get_legend().get_texts()} == {"sat27", "sat13"}
    assert max(line.get_ydata()[0] for line in ax.get_lines() if len(set(line.get_ydata())) == 1) == 6000.0


def test_given_access_is_what_is_drawn(scene):
    sensors = ["sat11", "sat13", "sat27"]
    access = scene.access("cone03", sensors, rules=ws.AccessConstraints(max_range_km=5000.0))
    ax = ws.plot.plot_access(scene, access=access, sensors=sensors)
    assert [label.get_text() for label in ax.get_yticklabels()] == sensors
    bars = sorted(bar.get_x() for container in ax.containers for bar in container)
    np.testing.assert_array_equal(bars, sorted(access["start_s"]))
    assert ax.get_title() == "stss: access to cone03, 2 of 3 sensors"
    ax = ws.plot.plot_range(scene, ["sat27"], access=access)
    line = ax.get_lines()[0]
    gap_m = scene.position_m("cone03", line.get_xdata()) - scene.position_m("sat27", line.get_xdata())
    np.testing.assert_allclose(line.get_ydata(), np.linalg.norm(gap_m, axis=1) / 1e3, rtol=1e-12)
    assert ax.get_ylabel() == "range to cone03 [km]"
    assert max(line.get_ydata()[0] for line in ax.get_lines() if len(set(line.get_ydata())) == 1) == 5000.0


def test_named_sensors_are_drawn_without_access_too(scene, tmp_path, monkeypatch):
    drawn = {}
    monkeypatch.setattr("warpsim.plot.figure_files.save_figure", lambda figure, path: drawn.setdefault(path, figure))
    for path, names in (("named", ["sat13"]), ("all", None)):
        draw_access(scene, path, scene.access(sensors=names), names)
    chart, ranges = drawn["named"].axes
    assert [label.get_text() for label in chart.get_yticklabels()] == ["sat13"]
    assert "no access" in [text.get_text() for text in chart.texts]
    line = ranges.get_lines()[0]
    gap_m = scene.position_m("center", line.get_xdata()) - scene.position_m("sat13", line.get_xdata())
    np.testing.assert_allclose(line.get_ydata(), np.linalg.norm(gap_m, axis=1) / 1e3, rtol=1e-12)
    seen = sorted(set(scene.access()["sensor"]))
    assert [label.get_text() for label in drawn["all"].axes[0].get_yticklabels()] == seen
    assert [text.get_text() for text in drawn["all"].axes[1].get_legend().get_texts()] == seen


# --- several groups ---

BALL = {
    "shape": {"kind": "sphere", "radius_m": 0.3},
    "surface": {"reflectance": 0.5},
    "temperature": {"start_k": 300},
}
SECOND = {
    "name": "second",
    "trajectory": {
        "kind": "ballistic_arc", "start_lon_lat_deg": [100.0, 50.0], "end_lon_lat_deg": [-150.0, 40.0],
        "duration_s": 1700.0, "endpoint_altitude_km": 100.0,
    },
    "targets": [{"name": "bus", **BALL}, {"name": "ball", "count": 3, **BALL}],
    "release": {"time_s": 400.0, "speed_m_s": [1.0, 1.0]},
}  # fmt: skip


@pytest.fixture(scope="module")
def two_groups(scene):
    """A second group beside the paper's, whose others leave late."""
    return scene.replace(groups=[scene.to_dict()["groups"][0], SECOND], sky__catalog="none")


@pytest.mark.ci
def test_each_group_is_drawn_about_its_own_main_target(two_groups):
    offset_m = offsets_m(two_groups, 410.0, 1)
    np.testing.assert_allclose(np.linalg.norm(offset_m, axis=1), [0, 10, 10, 10], rtol=0, atol=0.01)  # 1 m/s for 10 s
    assert np.abs(offsets_m(two_groups, 390.0, 1)).max() == 0  # not deployed
    axes = ws.plot.plot_group(two_groups, 410.0, group="second")
    assert axes[0].get_title() == "group about bus at 410 s"
    drawn = np.concatenate([by_label(axes[0], label)[0].get_xydata() for label in ("bus", "ball (3)")])
    np.testing.assert_allclose(drawn, offset_m[:, [1, 0]], rtol=0, atol=1e-9)
    assert len(by_label(ws.plot.plot_group(two_groups, 410.0)[0], "center")) == 1
    with pytest.raises(ws.InputError, match=r"^group: must be one of main, second, got 'third'$"):
        ws.plot.plot_group(two_groups, 0.0, group="third")


@pytest.mark.ci
def test_figures_show_all_groups(two_groups):
    ax = ws.plot.plot_scene(two_groups, TIME_S)
    assert by_label(ax, "flight of center") and by_label(ax, "flight of bus")
    ax = ws.plot.plot_ground_tracks(two_groups)
    assert "bus" in [text.get_text() for text in ax.get_legend().get_texts()]
    paths = [line.get_xydata() for line in ax.get_lines() if line.get_linewidth() == 1.8]
    np.testing.assert_allclose(paths[0][0], [100.0, 50.0], rtol=0, atol=1e-4)
    names = [text.get_text().split("\n")[0] for text in ws.plot.plot_attitudes(two_groups, 0.0).texts]
    assert [name for name in names if name in two_groups.target_names][-2:] == ["bus", "ball01"]
    ax = ws.plot.plot_satellite_view(two_groups, "sat11", TIME_S)
    np.testing.assert_array_equal(by_label(ax, "center")[0].get_xydata()[0].round(6), [63.5, 63.5])


LATER = {**SECOND, "trajectory": {**SECOND["trajectory"], "duration_s": 1000.0}, "start_s": 500.0, "release": {}}
"""From 500 to 1500 s; its others leave at once."""


@pytest.fixture(scope="module")
def later_group(scene):
    return scene.replace(groups=[scene.to_dict()["groups"][0], LATER], sky__catalog="none")


@pytest.mark.parametrize(("time_s", "there"), [(499.0, False), (501.0, True), (1499.0, True), (1501.0, False)])
@pytest.mark.ci
def test_absent_targets_are_not_in_figures(later_group, time_s, there):
    ax = ws.plot.plot_scene(later_group, time_s, view_ra_dec_deg=(0.0, 90.0))
    assert by_label(ax, "center now") and bool(by_label(ax, "bus now")) == there
    (flight,) = by_label(ax, "flight of bus")
    assert np.isfinite(flight.get_xydata()).all()
    pole = later_group.scenario.tracks.pole_icrs
    globe = globe_from(0.0, 90.0, pole)
    ends_m = later_group.position_m("bus", [500.0, 1500.0])
    np.testing.assert_allclose(flight.get_xydata()[[0, -1]], globe.project(ends_m), rtol=0, atol=DRAWN_ATOL)
    axes = ws.plot.plot_group(later_group, time_s, group="second")
    words = "" if there else "\nabsent until 500 s" if time_s < 500 else "\nabsent since 1500 s"
    assert axes[0].get_title() == f"group about bus at {plain(time_s)} s{words}"
    assert bool(by_label(axes[0], "ball (3)")) == there
    ax = ws.plot.plot_attitudes(later_group, [time_s])
    assert [text.get_text() for text in ax.texts].count("absent") == (0 if there else 2)
    assert len(ax.collections) == (6 if there else 4)
    ax = ws.plot.plot_satellite_view(later_group, "sat11", time_s)
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert ("absent, not drawn (4)" in legend) == (not there)


def test_access_is_cut_where_a_sensor_turns_to_another_target(later_group):
    steps = [{"start_s": 0.0, "track": "main"}, {"start_s": 900.0, "track": "second"}]
    stepping = later_group.replace(pointing={"kind": "schedule", "steps": steps}, access_rules={})
    rows = [(row["target"], row["start_s"], row["end_s"]) for row in stepping.access(sensors="sat11")]
    assert rows == [("center", 0.0, 900.0), ("bus", 900.0, 1500.0)]
    ax = ws.plot.plot_access(stepping, sensors=["sat11"])
    first, second = [patch for container in ax.containers for patch in container if patch.get_width()]
    assert (first.get_width(), second.get_x(), second.get_width()) == (900.0, 900.0, 600.0)
    assert first.get_facecolor() != second.get_facecolor()
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["center", "bus"]


def test_a_view_of_a_target_that_is_absent_names_none(later_group):
    tracking = later_group.replace(pointing={"track": "second"})
    for time_s, words in ((499.0, "sat11 at 499 s, no access"), (501.0, " km from bus, ")):
        ax = ws.plot.plot_satellite_view(tracking, "sat11", time_s)
        assert words in ax.get_title() and (time_s > 500) == (" km from" in ax.get_title())


def test_attitudes_are_in_the_frame_of_a_group_that_is_there(later_group):
    first, second = later_group.to_dict()["groups"]
    swapped = later_group.replace(groups=[{**second, "name": "main"}, {**first, "name": "early"}])
    assert "axes of center at 100 s" in ws.plot.plot_attitudes(swapped, 100.0).get_title()
    assert "axes of bus at 600 s" in ws.plot.plot_attitudes(swapped, 600.0).get_title()
    alone = later_group.replace(groups=[second])
    assert "axes of bus at 500 s" in ws.plot.plot_attitudes(alone, 100.0).get_title()


def test_access_to_a_group_is_drawn_to_its_targets(later_group):
    """Not to what the sensors track."""
    table = later_group.access("second", sensors=["sat11"])
    ax = ws.plot.plot_range(later_group, ["sat11"], access=table)
    assert ax.get_ylabel() == "range to second [km]"
    time_s, range_km = ax.get_lines()[0].get_xydata().T
    observer_m, nearest_km = later_group.position_m("sat11", time_s), np.full(len(time_s), np.inf)
    for target in later_group.scenario.targets:
        if target.group == 1:
            gap_km = np.linalg.norm(later_group.position_m(target.name, time_s) - observer_m, axis=1) / 1e3
            nearest_km = np.minimum(nearest_km, gap_km)
    there = np.isfinite(range_km)
    np.testing.assert_allclose(range_km[there], nearest_km[there], rtol=1e-12)
    assert "access to second" in ws.plot.plot_access(later_group, sensors=["sat11"], access=table).get_title()


def test_ranges_end_with_the_targets(later_group):
    """Of a target that is not there all the time, and to the nearest of all where access counts by any."""
    ax = ws.plot.plot_range(later_group, ["sat11"], access=later_group.access("bus"))
    time_s, range_km = ax.get_lines()[0].get_xydata().T
    np.testing.assert_array_equal(np.isfinite(range_km), (time_s > 502.0) & (time_s <= 1500.0))  # a step behind 500 s
    ax = ws.plot.plot_range(later_group.replace(access_target="any"), ["sat11"])
    time_s, range_km = ax.get_lines()[0].get_xydata().T
    observer_m = later_group.position_m("sat11", time_s)
    nearest_km = np.full(len(time_s), np.inf)
    for target in later_group.scenario.targets:
        there = (time_s >= target.exists_s[0]) & (time_s <= target.exists_s[1])
        gap_km = np.linalg.norm(later_group.position_m(target.name, time_s) - observer_m, axis=1) / 1e3
        nearest_km = np.where(there, np.minimum(nearest_km, gap_km), nearest_km)
    drawn = np.isfinite(range_km)
    assert np.count_nonzero(~drawn) == 2  # breaks of the line, where the second group begins and ends
    np.testing.assert_allclose(range_km[drawn], nearest_km[drawn], rtol=1e-12)
    assert ax.get_ylabel() == "range to any target [km]"


@pytest.mark.ci
def test_a_group_on_orbits_of_its_own(scene):
    orbits = {
        "kind": "listed",
        "satellites": [
            {"name": f"d{k}", "orbit": {"kind": "elements", "altitude_km": 800.0 + 10 * k, "inclination_deg": 60.0,
                                        "raan_deg": -60.0, "mean_anomaly_deg": 40.0}} for k in range(3)
        ],
    }  # fmt: skip
    debris = {"name": "debris", "orbits": orbits, "targets": [{"name": "chip", **BALL}]}
    both = scene.replace(groups=[scene.to_dict()["groups"][0], debris], sky__catalog="none", access_rules={})
    ax = ws.plot.plot_scene(both, TIME_S, view_ra_dec_deg=(0.0, 90.0))
    (now,) = by_label(ax, "debris (3) now")
    globe = globe_from(0.0, 90.0, both.scenario.tracks.pole_icrs)
    expected = [globe.project(both.position_m(f"d{k}", [TIME_S])[0]) for k in range(3)]
    np.testing.assert_allclose(now.get_xydata(), expected, rtol=0, atol=DRAWN_ATOL)
    axes = ws.plot.plot_group(both, TIME_S, group="debris")
    assert by_label(axes[0], "chip (3)")[0].get_xydata().shape == (3, 2)
    assert "debris (3)" in [text.get_text() for text in ws.plot.plot_ground_tracks(both).get_legend().get_texts()]
    assert "d0\nsphere, r 0.3 m\none of 3" in [text.get_text() for text in ws.plot.plot_attitudes(both, 0.0).texts]


@pytest.mark.ci
def test_a_scene_without_targets_is_drawn(scene, tmp_path):
    pointing = {"kind": "fixed", "azimuth_elevation_deg": [0.0, -20.0]}
    empty = scene.replace(groups=[], sensors__0__pointing=pointing, sky__catalog="none")
    paths = draw_scenario(empty, tmp_path, sensors=["sat11"])
    assert [path.stem for path in paths] == ["scene", "ground_tracks", "bands", "access", "view_sat11"]
    for draw, message in ((ws.plot.plot_group, "^group: must be a group"), (ws.plot.plot_attitudes, "with targets")):
        with pytest.raises(ws.InputError, match=message):
            draw(empty, 0.0)


# --- several kinds of sensors ---

WIDE = {
    "name": "wide", "camera": {"n_row": 60, "n_col": 100, "fov_deg": 90.0}, "bands": ["C"],
    "optics": {"aperture_m": 0.1, "psf": "gaussian"}, "pointing": {"kind": "fixed", "azimuth_elevation_deg": [0, -25]},
    "on": ["sat1*", "sat2*"], "access_rules": {"in_fov": True, "max_range_km": 7000.0},
    "frames": {"count": 100, "interval_s": 7.0},
}  # fmt: skip


@pytest.fixture(scope="module")
def two_kinds(scene):
    """Two kinds of sensors, both on the satellites of the first two planes; three targets."""
    narrow = {**scene.to_dict()["sensors"][0], "name": "narrow"}
    few = scene.replace(targets=scene.to_dict()["groups"][0]["targets"][:2], targets__1__count=2)
    return few.replace(sensors=[narrow, {**WIDE, "detector": narrow["detector"]}], sky__catalog="none")


def test_satellites_are_drawn_once(two_kinds):
    """At 600 s both sensors of sat27 have access, of sat11, sat12 and sat21 the narrow ones."""
    scenario = two_kinds.scenario
    seeing = {name for name in two_kinds.sensor_names if scenario.has_access(name, TIME_S)[0]}
    assert seeing >= {"sat27.wide", "sat27.narrow", "sat11.narrow", "sat47"} and "sat11.wide" not in seeing
    ax = ws.plot.plot_scene(two_kinds, TIME_S, view_ra_dec_deg=(281.0, 60.0))
    assert by_label(ax, "satellites with access: 6") and by_label(ax, "satellites without access: 22")
    labels = [text.get_text() for text in ax.texts if text.get_text() not in ("", "Sun")]
    assert len(labels) == len(set(labels)) and set(labels) <= {
        "sat11.narrow", "sat12.narrow", "sat21.narrow", "sat27", "sat41", "sat47"
    }  # fmt: skip
    lines = [line for line in ax.get_lines() if line.get_color() == "#009E73" and line.get_linewidth() == 1.0]
    assert len(lines) == 6
    (orbits,) = (lines for lines in ax.collections if lines.get_label() == "orbits")
    assert len(orbits.get_segments()) == 28


@pytest.mark.ci
def test_ground_tracks_mark_the_access_of_each_kind(two_kinds):
    ax = ws.plot.plot_ground_tracks(two_kinds)
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert "narrow has access" in legend and "wide has access" in legend
    tracks = [line for line in ax.get_lines() if line.get_linewidth() == 0.9 and len(line.get_xdata())]
    assert len(tracks) == 28
    for kind, width in (("narrow", 5.5), ("wide", 3.0)):
        rows = two_kinds.access(sensors=kind)
        thick = [line.get_xydata() for line in ax.get_lines() if line.get_linewidth() == width]
        drawn = [line for line in thick if len(line)]  # the legend's is empty
        assert len(drawn) == len(rows) > 3
        starts = []
        for row in rows:
            position_m = two_kinds.position_m(row["sensor"], row["start_s"])
            lon, lat, _ = gcrs_to_geodetic(position_m, two_kinds.scenario.epoch, np.array([row["start_s"]]))
            starts.append([lon[0], lat[0]])
        np.testing.assert_allclose(sorted(line[0].tolist() for line in drawn), sorted(starts), atol=TRACK_ATOL_DEG)
    labels = [text.get_text() for text in ax.texts]
    assert len(labels) == len(set(labels)) and set(labels) <= set(two_kinds.scenario.satellite_names)


def test_access_has_a_row_for_every_sensor(two_kinds):
    ax = ws.plot.plot_access(two_kinds)
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == two_kinds.sensor_names and len(names) == 42
    assert ax.get_title() == "stss: access to center, 13 of 42 sensors"
    ax = ws.plot.plot_access(two_kinds, sensors=["wide"], only_with_access=True)
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names and all(name.endswith(".wide") for name in names)
    assert ax.get_title() == f"stss: access to center, {len(names)} of 14 sensors"
    ax = ws.plot.plot_range(two_kinds)
    limits = sorted(line.get_ydata()[0] for line in ax.get_lines() if len(set(line.get_ydata())) == 1)
    assert limits == [6000.0, 7000.0]
    with pytest.raises(ws.InputError, match=r"^sensors: must be .* or of the kinds narrow, wide\), got 'tele'$"):
        ws.plot.plot_access(two_kinds, sensors=["tele"])


@pytest.mark.parametrize("time_s", [600.0, 602.0, 603.5], ids=["of a narrow frame", "of a wide frame", "of none"])
@pytest.mark.ci
def test_views_are_of_the_sensors_own_camera(two_kinds, time_s):
    for sensor, n_row in (("sat27.wide", 60), ("sat27.narrow", 128)):
        camera = two_kinds.scenario.instrument_of(sensor).sensor.camera
        view = camera_view(two_kinds.scenario, sensor, time_s)
        axes = two_kinds.scenario.view_axes(sensor, time_s)[0]
        np.testing.assert_allclose(view.axes_icrs, axes, rtol=0, atol=1e-12)
        line_m = two_kinds.position_m("center", time_s)[0] - two_kinds.position_m(sensor, time_s)[0]
        xy_px = camera.project(unit(line_m)[None], axes)[0][0]
        # Light time and aberration, some arcsec: 0.5 px of the narrow camera.
        np.testing.assert_allclose(view.target_xy_px[0], xy_px, rtol=0, atol=1.0)
        ax = ws.plot.plot_satellite_view(two_kinds, sensor, time_s)
        assert ax.get_ylim() == (n_row - 0.5, -0.5)
        assert f"{sensor} at {plain(time_s)} s" in ax.get_title()
        assert f"field of {camera.field_deg[0]:.3g} deg across" in ax.get_title()
    with pytest.raises(ws.InputError, match=r"^sensor: must be a sensor of the scene \(sat11.narrow, .*, got 'wide'$"):
        camera_view(two_kinds.scenario, "wide", time_s)


@pytest.mark.ci
def test_views_are_of_some_sensors_of_each_kind(two_kinds, later_group, tmp_path, monkeypatch):
    monkeypatch.setattr("warpsim.plot.figure_files.save_figure", lambda figure, path: None)
    paths = draw_scenario(two_kinds.scenario, tmp_path, TIME_S)
    names = [path.stem for path in paths]
    assert names[:6] == ["scene", "ground_tracks", "group", "attitudes", "bands", "access"]
    assert names[6:9] == ["view_sat11.narrow", "view_sat12.narrow", "view_sat21.narrow"]
    assert names[9:] and all(name.endswith(".wide") for name in names[9:])
    names = [path.stem for path in draw_scenario(later_group, tmp_path, 100.0, sensors=["sat31"])]
    groups = ["group_main", "group_second"]
    assert names == ["scene", "ground_tracks", *groups, "attitudes", "bands", "access", "view_sat31"]


# --- labels, given axes, bad input ---


def test_names_of_points_on_one_spot_do_not_cover_one_another():
    from matplotlib import pyplot as plt

    _, ax = plt.subplots()
    labels = annotate_points(ax, [[0.5, 0.5]] * 4 + [[0.999, 0.5]], ["one", "two", "three", "four", "edge"])
    places = [label.xyann for label in labels]
    assert len(set(places[:4])) == 4
    assert places[4][0] <= 0  # inside the axes
    ax.figure.canvas.draw()
    boxes = [label.get_window_extent() for label in labels[:4]]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


@pytest.mark.slow
def test_a_single_target_and_many_satellites(scene, recwarn):
    """The smallest group, more names than can be written, and no access rules."""
    data = scene.to_dict()
    (group,) = data["groups"]
    many = ws.Scene.from_dict({
        **data, "groups": [{**group, "targets": group["targets"][:1]}], "access_rules": {}, "sky": {"catalog": "none"},
        "constellation": {**data["constellation"], "n_satellite": 220, "n_plane": 20},
    })  # fmt: skip
    axes = [
        ws.plot.plot_scene(many, TIME_S), ws.plot.plot_ground_tracks(many), ws.plot.plot_group(many, TIME_S)[0],
        ws.plot.plot_attitudes(many, TIME_S), ws.plot.plot_access(many), ws.plot.plot_range(many),
        ws.plot.plot_satellite_view(many, many.access()["sensor"][0], TIME_S),
    ]  # fmt: skip
    assert {text.get_text() for text in axes[0].texts} == {"", "Sun"}
    assert not axes[1].texts and axes[5].get_legend() is None
    for ax in axes:
        ax.figure.canvas.draw()
    assert [str(warning.message) for warning in recwarn] == []


@pytest.mark.ci
def test_functions_draw_on_given_axes(scene):
    from matplotlib.figure import Figure

    for draw in (
        lambda ax: ws.plot.plot_scene(scene, TIME_S, ax),
        lambda ax: ws.plot.plot_ground_tracks(scene, ax),
        lambda ax: ws.plot.plot_attitudes(scene, TIME_S, ax),
        lambda ax: ws.plot.plot_access(scene, ax),
        lambda ax: ws.plot.plot_range(scene, None, ax),
    ):
        ax = Figure().add_subplot()
        assert draw(ax) is ax
        ax.figure.canvas.draw()


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda s: ws.plot.plot_scene(s, 1e4), r"^time_s: must be in the scene, 0 to 1614 s, got 10000$"),
        (lambda s: ws.plot.plot_scene(s, float("nan")), "^time_s: must be in the scene, 0 to 1614 s, got nan$"),
        (lambda s: ws.plot.plot_scene(s, 0.0, view_ra_dec_deg=(0, 91)), "^view_ra_dec_deg: must be a right ascension"),
        (lambda s: ws.plot.plot_group(s, -1.0), "^time_s: must be in the scene"),
        (lambda s: ws.plot.plot_group(s, 0.0, [None]), "^axes: must be 3 or 4, got 1$"),
        (lambda s: ws.plot.plot_attitudes(s, []), "^time_s: must hold at least one instant$"),
        (
            lambda s: ws.plot.plot_range(s, ["sat99"]),
            r"^sensors: must be sensors of the scene \(sat11, .*\), got 'sat99'$",
        ),
        (
            lambda s: ws.plot.plot_satellite_view(s, "sat99", 0.0),
            r"^sensor: must be a sensor of the scene \(sat11, .*\), got 'sat99'$",
        ),
        (lambda s: ws.plot.plot_satellite_view(s, "sat11", "now"), "^time_s: must be a number, got 'now'$"),
    ],
)
def test_bad_input_is_named_in_one_line(scene, draw, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        draw(scene)
    assert "\n" not in str(caught.value)
