"""Pictures of scenarios: what is drawn is what the scene is, against ray casting, skyfield, scipy and the renderer."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import warpsim as ws
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING, EARTH_GM_M3_S2, SPEED_OF_LIGHT_M_S
from warpsim.orbit.earth import gcrs_to_geodetic
from warpsim.orbit.sun import earth_velocity_m_s
from warpsim.plot.bodies import body_to_gcrs, drawn_facets
from warpsim.plot.figure import place_labels, plain, save_figure
from warpsim.plot.globe import globe_from
from warpsim.plot.pictures import draw_access
from warpsim.plot.scenario import broken_at_date_line, group_offsets_m, osculating_ellipse_m
from warpsim.plot.view import camera_view, earth_clearance
from warpsim.render.star_field import load_catalog, star_index

pytest.importorskip("matplotlib").use("Agg")

SEED = 417
DRAWN_ATOL = 1e-9  # thousands of km; only rounding
PIXEL_ATOL = 1e-6  # px; the renderer's own places, and a float64 chain written anew
LIMB_RTOL = 1e-9  # of the Earth's radius: where a line is cut
TRACK_ATOL_DEG = 1e-7  # skyfield against this: rounding of its iterated latitude (1 cm on the ground)
ASPECT_ATOL_DEG = 1e-6
FACET_RTOL = 0.02  # a polygon of 24 corners has 1.2 % less area than its circle
TIME_S = 600.0
TETRAHEDRON = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


@pytest.fixture(autouse=True)
def close_figures():
    yield
    from matplotlib import pyplot as plt

    plt.close("all")


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
        # The points put in are on the outline: their rays only touch the ellipsoid.
        known = globe.project(path_m)
        new = [xy for xy in drawn[shown] if np.abs(known - xy).max(axis=1).min() > 0]
        places_m = 1e6 * (np.array(new).reshape(-1, 2) @ np.stack([globe.right, globe.up]))
        assert np.abs(hits_earth(places_m, globe.towards, globe.pole)[1]).max(initial=0) < 1e-9
    everywhere = globe.visible_line(3 * path_m + 5e7 * globe.towards)
    np.testing.assert_allclose(everywhere, globe.project(3 * path_m + 5e7 * globe.towards), rtol=0, atol=DRAWN_ATOL)


def test_the_outline_is_a_circle_from_the_pole_and_an_ellipse_from_the_equator():
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


def test_title_and_legend_are_within_the_picture(scene, tmp_path):
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


def test_scene_picture_has_the_places_of_the_scene(scene):
    view = (10.0, 70.0)
    ax = ws.plot.plot_scene(scene, TIME_S, view_ra_dec_deg=view)
    # The projection written anew: towards the viewer, the pole upwards.
    ra, dec = np.radians(view)
    towards = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    pole = scene.tracks.pole_icrs
    right = unit(np.cross(pole, towards))
    up = np.cross(towards, right)

    def xy(position_m):
        return np.stack([position_m @ right, position_m @ up], axis=-1) / 1e6

    place_m = {name: scene.position_m(name, TIME_S)[0] for name in [*scene.sensor_names, "center"]}
    seen = {name for name in scene.sensor_names if scene.has_access(name, TIME_S)[0]}
    visible = {name for name in place_m if not hits_earth(place_m[name], towards, pole)[0]}
    assert seen == {"sat11", "sat12", "sat21", "sat27", "sat41", "sat47"}
    others = set(scene.sensor_names) - seen
    for label, wanted in (("satellites with access: 6", seen), ("satellites without: 22", others)):
        (dots,) = by_label(ax, label)
        expected = [xy(place_m[name]) for name in scene.sensor_names if name in wanted & visible]
        np.testing.assert_allclose(dots.get_xydata(), expected, rtol=0, atol=DRAWN_ATOL)
    assert by_label(ax, f"{28 - len(visible - {'center'})} of them behind the Earth")
    (now,) = by_label(ax, "center now")
    np.testing.assert_allclose(now.get_xydata()[0], xy(place_m["center"]), rtol=0, atol=DRAWN_ATOL)
    ends = [line.get_xydata()[[0, -1]] for line in ax.get_lines() if len(line.get_xdata()) >= 101]
    for name in seen & visible:
        sight = np.array([xy(place_m[name]), xy(place_m["center"])])
        assert np.nanmin([np.abs(end - sight).max() for end in ends]) < DRAWN_ATOL
    texts = {text.get_text() for text in ax.texts}
    assert seen & visible <= texts and not texts & others
    assert "2025-01-01T14:10:00.000 UTC" in ax.get_title()
    assert ax.get_xlabel() == "[1000 km]"


def test_scene_picture_leaves_out_what_the_earth_hides(scene):
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
    x, y = word.get_position()
    assert y < 0 and abs(x) < -0.1 * y
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


def apparent_places_px(scene, sensor, time_s, axes):
    """Pixels of the targets by a chain written anew: light time, then the two steps of aberration."""
    observer_m, velocity = (part[0] for part in scene.tracks.of(sensor).state(np.array([time_s])))
    earth = earth_velocity_m_s(scene.epoch, np.array([time_s]))[0]
    directions = []
    for name in scene.target_names:
        emitted_s = time_s
        for _ in range(5):
            sight_m = scene.position_m(name, emitted_s)[0] - observer_m
            emitted_s = time_s - np.linalg.norm(sight_m) / SPEED_OF_LIGHT_M_S
        directions.append(ws.apparent_direction(ws.apparent_direction(unit(sight_m), -earth), earth + velocity))
    return scene.camera.project(np.array(directions), axes)[0]


@pytest.mark.parametrize("time_s", [600.0, 603.7], ids=["of a frame", "between frames"])
def test_view_is_the_renderers(scene, renderer, time_s):
    view = camera_view(scene, "sat11", time_s, renderer)
    np.testing.assert_allclose(
        view.target_xy_px, apparent_places_px(scene, "sat11", time_s, view.axes_icrs), rtol=0, atol=PIXEL_ATOL
    )
    if time_s == 600.0:
        truth = renderer.render([60], ["sat11"], ["C"]).truth
        np.testing.assert_array_equal(view.target_xy_px, np.stack([truth["x_px"], truth["y_px"]], axis=1))


def test_view_before_the_first_frame(scene):
    late = scene.replace(frames={"count": 10, "interval_s": 10.0, "start_s": 100.0}, sky__catalog="none")
    view, plain = (camera_view(one, "sat11", 50.0) for one in (late, scene.replace(sky__catalog="none")))
    np.testing.assert_array_equal(view.target_xy_px, plain.target_xy_px)


def test_stars_in_the_view_are_those_of_the_catalog(scene, renderer):
    view = camera_view(scene, "sat11", TIME_S, renderer)
    index = star_index(scene, load_catalog(scene), ws.BandIndex(ws.StarCatalog.from_arrays([], [], {})).device)
    rows = index.query(view.axes_icrs[2], scene.camera.half_diagonal_rad() + 2e-4)
    observer = earth_velocity_m_s(scene.epoch, np.array([TIME_S]))[0] + view.velocity_m_s
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
    view = camera_view(scene, "sat11", TIME_S, renderer)
    ax = ws.plot.plot_satellite_view(scene, "sat11", TIME_S, renderer=renderer)
    drawn = np.concatenate([by_label(ax, label)[0].get_xydata() for label in ("center", "sphere", "cylinder", "cone")])
    np.testing.assert_array_equal(drawn, view.target_xy_px)
    assert ax.get_ylim() == (127.5, -0.5) and ax.get_xlim() == (-0.5, 127.5)
    assert "3508 km from center, access" in ax.get_title()
    names = {text.get_text() for inset in ax.child_axes for text in inset.texts}
    assert names == set(scene.target_names)


def test_compass_points_to_zenith_and_north(scene, renderer):
    view = camera_view(scene, "sat11", TIME_S, renderer)
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
    view = camera_view(wide, "sat11", TIME_S)
    camera = wide.camera
    x, y = np.meshgrid(np.linspace(-0.5, 127.5, 60), np.linspace(-0.5, 127.5, 60))
    xy = np.stack([x, y], axis=-1)
    ray = np.concatenate([(xy - camera.centre_px) / camera.focal_px, np.ones((60, 60, 1))], axis=-1) @ view.axes_icrs
    ray = unit(ray)
    clearance = earth_clearance(wide, view, xy)
    # Rays as they are without the sensor's motion about the Earth, which moves the limb by up to 5 arcsec.
    still = ws.apparent_direction(ray.reshape(-1, 3), -view.velocity_m_s).reshape(ray.shape)
    hit, _ = hits_earth(view.position_m, still, wide.tracks.pole_icrs)
    assert 0.2 < hit.mean() < 0.5
    np.testing.assert_array_equal(clearance < 0, hit)
    # Next to the limb: rays a thousandth of a pixel (1.7 arcsec) to either side.
    limb_row = np.interp(0, clearance[:, 30], y[:, 30])
    for _ in range(20):  # secant steps to the limb in the middle column
        at = np.array([[x[0, 30], limb_row], [x[0, 30], limb_row + 1e-3]])
        here, below = earth_clearance(wide, view, at)
        limb_row -= here * 1e-3 / (below - here)
    for step, expected in ((-1e-3, False), (1e-3, True)):
        seen = np.array([(x[0, 30] - camera.centre_px[0]), limb_row + step - camera.centre_px[1], camera.focal_px])
        direction = ws.apparent_direction(unit(seen @ view.axes_icrs), -view.velocity_m_s)
        assert hits_earth(view.position_m, direction, wide.tracks.pole_icrs)[0] == expected
    ax = ws.plot.plot_satellite_view(wide, "sat11", TIME_S)
    assert by_label(ax, "Earth")
    limb = np.concatenate([path.vertices for path in ax.collections[1].get_paths()])
    assert np.abs(earth_clearance(wide, view, limb)).max() < 2e-5  # linear between grid points: 0.02 px


def test_view_marks_what_is_behind_the_earth(scene):
    ax = ws.plot.plot_satellite_view(scene.replace(sky__catalog="none"), "sat15", TIME_S)
    (crosses,) = by_label(ax, "behind the Earth (30)")
    assert len(crosses.get_xdata()) == 30
    assert not by_label(ax, "center") and "no access" in ax.get_title()


def test_stowed_targets_are_not_in_the_view(scene):
    late = scene.replace(targets__3__release={"time_s": 700.0}, sky__catalog="none")
    ax = ws.plot.plot_satellite_view(late, "sat11", TIME_S)
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert legend == ["center", "sphere (10)", "cylinder (10)", "stowed, dark, not drawn (9)"]
    assert not by_label(ax, "cone")
    words = {text.get_text() for part in (ax, *ax.child_axes) for text in part.texts}
    assert "sphere03" in words and not any(word.startswith("cone") for word in words)


def test_legend_of_a_view_is_of_what_is_in_the_frame(scene):
    """A camera that looks beside the group: some of it is outside."""
    beside = scene.replace(pointing={"offset_px": [62.0, 0.0]}, sky__catalog="none")
    view = camera_view(beside, "sat11", TIME_S)
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


def test_group_offsets_are_turned_differences(scene):
    offset_m = group_offsets_m(scene, TIME_S)
    place_m = np.stack([scene.position_m(name, TIME_S)[0] for name in scene.target_names])
    np.testing.assert_allclose(
        np.linalg.norm(offset_m, axis=1), np.linalg.norm(place_m - place_m[0], axis=1), rtol=0, atol=1e-6
    )
    before, after = (scene.position_m("center", TIME_S + step)[0] for step in (-0.5, 0.5))
    frame = Rotation.align_vectors([[1, 0, 0], [0, 0, 1]], [place_m[0], np.cross(before, after)])[0].as_matrix()
    np.testing.assert_allclose(offset_m, (place_m - place_m[0]) @ frame.T, rtol=0, atol=1e-3)
    speed_m_s = np.linalg.norm(group_offsets_m(scene, 1.0)[1:], axis=1)
    assert speed_m_s.min() > 1.99 and speed_m_s.max() < 5.01  # the release, after one second


@pytest.mark.parametrize(("late_s", "words"), [(1000.0, "\n29 still stowed in it"), (TIME_S, "")])
def test_panels_of_targets_on_one_spot_are_two_metres_wide(scene, late_s, words):
    axes = ws.plot.plot_group(scene.replace(release__time_s=late_s), TIME_S)
    assert {ax.get_xlim() for ax in axes[:3]} == {(-1.0, 1.0)}
    assert axes[0].get_title() == f"group about center at 600 s{words}"


def test_group_panels_show_the_offsets(scene):
    offset_km = group_offsets_m(scene, TIME_S) / 1e3
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
        axis = body_to_gcrs(scene, row["target"], emitted_s)[0][:, 2]
        towards = unit(observer_m - scene.position_m(row["target"], emitted_s)[0])
        aspect_deg = np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, towards)), axis @ towards))
        assert aspect_deg == pytest.approx(row["aspect_deg"], abs=ASPECT_ATOL_DEG)


def test_bodies_are_turned_by_rotations(scene):
    rotation = body_to_gcrs(scene, "cylinder03", [0.0, 0.3, 1000.7])
    np.testing.assert_allclose(rotation @ np.swapaxes(rotation, 1, 2), np.tile(np.eye(3), (3, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotation), 1, rtol=0, atol=1e-12)


def test_spin_turns_a_body_about_its_axis(scene):
    spinning = scene.replace(targets__0__attitude={"spin_rev_s": 2.0})
    first, second = body_to_gcrs(spinning, "center", [10.0, 10.05])
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
def test_drawn_outline_has_the_projected_area(shape, scale):
    corners, sector = drawn_facets(shape)
    assert np.linalg.norm(corners, axis=-1).max() == pytest.approx(1, abs=1e-12)
    assert len(corners) == len(sector)
    for aspect in np.radians([0.0, 10.0, 40.0, 90.0, 150.0]):
        turned = corners @ Rotation.from_euler("y", aspect).as_matrix().T
        area = 0.5 * np.cross(turned[:, 2] - turned[:, 0], turned[:, 3] - turned[:, 1])[:, 2]
        expected = shape.projected_area_along_m2([-np.sin(aspect), 0.0, np.cos(aspect)]) / scale**2
        assert area[area > 0].sum() == pytest.approx(expected, rel=FACET_RTOL, abs=1e-12)
        assert area.sum() == pytest.approx(0, abs=1e-12)  # closed


def test_attitudes_of_every_kind_of_shape(scene):
    first = scene.to_dict()["targets"][0]
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
    still = scene.replace(targets=scene.to_dict()["targets"][:1], targets__0__attitude={"axis": [0.0, 0.0, 1.0]})
    assert len(ws.plot.plot_attitudes(still, 0.0).collections) == 6


def test_times_are_written_plainly(scene):
    assert [plain(value) for value in (0.0, 10800.0, 0.25, 1234567.0)] == ["0", "10800", "0.25", "1234570"]
    assert plain(10833.4, 4) == "10830" and plain(1 / 6, 4) == "0.1667"
    still = scene.replace(
        duration_s=64800.0, targets=scene.to_dict()["targets"][:1], targets__0__attitude={"axis": [0.0, 0.0, 1.0]},
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


def test_access_of_ones_own_is_what_is_drawn(scene):
    sensors = ["sat11", "sat13", "sat27"]
    access = scene.access("cone03", sensors, ws.AccessConstraints(max_range_km=5000.0))
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
    monkeypatch.setattr("warpsim.plot.pictures.save_figure", lambda figure, path: drawn.setdefault(path, figure))
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


@pytest.fixture(scope="module")
def two_groups(scene):
    """A second group beside the paper's, whose others leave late."""
    ball = {
        "shape": {"kind": "sphere", "radius_m": 0.3},
        "surface": {"reflectance": 0.5},
        "temperature": {"start_k": 300},
    }
    path = {"kind": "ballistic_arc", "start_lon_lat_deg": [100.0, 50.0], "end_lon_lat_deg": [-150.0, 40.0]}
    second = {
        "name": "second",
        "trajectory": {**path, "duration_s": 1700.0, "endpoint_altitude_km": 100.0},
        "targets": [{"name": "bus", **ball}, {"name": "ball", "count": 3, **ball}],
        "release": {"time_s": 400.0, "speed_m_s": [1.0, 1.0]},
    }
    return scene.replace(groups=[second], sky__catalog="none")


def test_each_group_is_drawn_about_its_own_main_target(two_groups):
    offset_m = group_offsets_m(two_groups, 410.0, "second")
    np.testing.assert_allclose(np.linalg.norm(offset_m, axis=1), [0, 10, 10, 10], rtol=0, atol=0.01)  # 1 m/s for 10 s
    assert np.abs(group_offsets_m(two_groups, 390.0, "second")).max() == 0  # stowed
    axes = ws.plot.plot_group(two_groups, 410.0, group="second")
    assert axes[0].get_title() == "group about bus at 410 s"
    drawn = np.concatenate([by_label(axes[0], label)[0].get_xydata() for label in ("bus", "ball (3)")])
    np.testing.assert_allclose(drawn, offset_m[:, [1, 0]], rtol=0, atol=1e-9)
    assert len(by_label(ws.plot.plot_group(two_groups, 410.0)[0], "center")) == 1
    with pytest.raises(ws.InputError, match=r"^group: must be one of main, second, got 'third'$"):
        ws.plot.plot_group(two_groups, 0.0, group="third")


def test_pictures_show_all_groups(two_groups):
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


# --- labels, axes of one's own, bad input ---


def test_names_of_points_on_one_spot_do_not_cover_one_another():
    from matplotlib import pyplot as plt

    _, ax = plt.subplots()
    labels = place_labels(ax, [[0.5, 0.5]] * 4 + [[0.999, 0.5]], ["one", "two", "three", "four", "edge"])
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
    many = ws.Scene.from_dict({
        **data, "targets": data["targets"][:1], "access_rules": {}, "sky": {"catalog": "none"},
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
        (lambda s: ws.plot.plot_range(s, ["sat99"]), "^sensors: must be sensors of the scene, got 'sat99'$"),
        (
            lambda s: ws.plot.plot_satellite_view(s, "sat99", 0.0),
            "^sensor: must be a sensor of the scene, got 'sat99'$",
        ),
        (lambda s: ws.plot.plot_satellite_view(s, "sat11", "now"), "^time_s: must be a number, got 'now'$"),
    ],
)
def test_bad_input_is_named_in_one_line(scene, draw, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        draw(scene)
    assert "\n" not in str(caught.value)
