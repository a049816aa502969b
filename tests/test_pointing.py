"""Where cameras look: every kind of pointing against astropy, closed forms and the host's twin, up to the image."""

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import GCRS, CartesianRepresentation, SkyCoord
from astropy.table import Table
from astropy.time import TimeDelta
from astropy.wcs import WCS
from on_devices import arrays_of_views, device_scene
from scipy.spatial.transform import Rotation, Slerp

import warpsim as ws
from warpsim.output.check import scene_report
from warpsim.output.check_pointing import pointing_warning
from warpsim.pool import Pool
from warpsim.render.batch import new_batch
from warpsim.render.pipelines import Pipelines
from warpsim.render.stages import aim

STAR_PX = 1e-5
"""Star rows against astropy's apparent place and WCS: 1e-5 arcsec is 4e-7 px here, the observer's velocity the rest."""
CENTROID_PX = 1e-3
"""The promise for light on the image."""
OFFSET_PX = 1e-9
TWIN_RAD = 1e-12
"""Kernel against host: rounding of positions (1e-9 m at 1e6 m) and of unit vectors."""
AXES_ATOL = 4e-15
CLOSE_RAD = 5e-9
"""Rounding of positions, 1e-9 m, a metre away; second order in v / c, 1e-9."""

FRAME = 70
SMALL = {"n_row": 8, "n_col": 8, "fov_deg": 1 / 16}


def unit(vectors):
    return np.asarray(vectors) / np.linalg.norm(vectors, axis=-1, keepdims=True)


def spherical(lon_deg, lat_deg):
    lon, lat = np.radians(lon_deg), np.radians(lat_deg)
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)


def lon_lat_deg(vectors):
    x, y, z = np.moveaxis(np.asarray(vectors), -1, 0)
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))


def state(scene, sensor, time_s):
    """Position and velocity of a satellite, the latter by differences."""
    step = 0.05
    position = scene.position_m(sensor, [time_s])[0]
    return position, np.diff(scene.position_m(sensor, [time_s - step, time_s + step]), axis=0)[0] / (2 * step)


def local_axes(scene, sensor, time_s):
    """Forward, right and zenith of a satellite."""
    position, velocity = state(scene, sensor, time_s)
    zenith = unit(position)
    forward = unit(velocity - zenith * (velocity @ zenith))
    return np.stack([forward, np.cross(forward, zenith), zenith])


def seen_by_astropy(scene, sensor, time_s, catalog):
    """Apparent unit vectors of stars for the orbiting observer."""
    position, velocity = state(scene, sensor, time_s)
    observer = GCRS(
        obstime=scene.epoch + TimeDelta(time_s, format="sec"),
        obsgeoloc=CartesianRepresentation(position * u.m),
        obsgeovel=CartesianRepresentation(velocity * u.m / u.s),
    )
    seen = SkyCoord(catalog.ra_deg * u.deg, catalog.dec_deg * u.deg).transform_to(observer)
    return unit(seen.cartesian.xyz.value.T)


def tan_by_hand(camera, ra_deg, dec_deg, roll_deg, focal_px):
    """Astropy's TAN WCS of a boresight with north up, rolled right-handed; no warpsim code in it."""
    wcs = WCS(naxis=2)
    wcs.wcs.ctype = ["RA---TAN", "DEC--TAN"]
    wcs.wcs.crval = [ra_deg, dec_deg]
    wcs.wcs.crpix = [(camera.n_col + 1) / 2, (camera.n_row + 1) / 2]
    scale, cosine, sine = np.degrees(1 / focal_px), np.cos(np.radians(roll_deg)), np.sin(np.radians(roll_deg))
    wcs.wcs.cd = scale * np.array([[-cosine, sine], [-sine, -cosine]])
    wcs.wcs.lonpole = 180.0
    wcs.wcs.set()
    return wcs


PLACES = {
    # ra, dec of the pointing; ra of the meridian that is up: its own, but for poles, where +x (RA 0) is up
    "north-pole": (37.0, 90.0, 180.0),
    "south-pole": (0.0, -90.0, 0.0),
    "ra-0": (0.0, 12.0, 0.0),
    "ra-360": (360.0, -35.0, 360.0),
    "equator": (180.0, 0.0, 180.0),
    "beside-the-pole": (200.0, 89.95, 200.0),
    "orion": (84.0, -1.2, 84.0),
    "south": (-77.3, -62.0, -77.3),
}


def sensor_above(scene, direction, time_s):
    """The sensor that sees most of that side of the sky."""
    return max(scene.sensor_names, key=lambda name: scene.position_m(name, [time_s])[0] @ direction)


@pytest.mark.parametrize("roll_deg", [0.0, 33.0])
@pytest.mark.parametrize(("ra", "dec", "up_ra"), PLACES.values(), ids=PLACES)
@pytest.mark.ci
def test_stars_of_a_fixed_view_are_astropys(scene, device, ra, dec, up_ra, roll_deg):
    """Boresight, roll and pixels of known stars, from the description to the light on the image."""
    pointing = {"kind": "fixed", "ra_dec_deg": [ra, dec], "up": "north", "roll_deg": roll_deg}
    soft = {"aperture_m": 0.4, "psf": "gaussian", "sigma_px": 1.1, "stamp_cut_nei": 1e-3}
    described = scene.replace(pointing=pointing, optics=soft, bands=["A"], sky={"light_deflection": True})
    time_s = float(described.scenario.instrument.frame_time_s([FRAME])[0])
    boresight = spherical(ra, dec)
    sensor = sensor_above(described, boresight, time_s)
    focal_px = 64 / np.tan(np.radians(0.5))
    wcs = tan_by_hand(described.camera, up_ra, dec, roll_deg, focal_px)
    x, y = (grid.ravel() for grid in np.meshgrid([12.3, 64.8, 110.1], [20.6, 63.2, 101.7]))
    catalog = ws.StarCatalog.from_arrays(*wcs.all_pix2world(x, y, 0), {"A": np.full(9, 300.0)})
    renderer = ws.Renderer(described, device=device, catalog=catalog)
    frames = renderer.render([FRAME], [sensor], ["A"], keep_signal=True, keep_stars=True)

    np.testing.assert_allclose(frames.axes_icrs[0, 0, 2], boresight, rtol=0, atol=AXES_ATOL)
    assert frames.up_replaced[0, 0] == (abs(dec) == 90)
    assert not frames.boresight_replaced.any()
    seen = seen_by_astropy(described, sensor, time_s, catalog)
    expected = np.column_stack(wcs.all_world2pix(*lon_lat_deg(seen), 0))
    stars = frames.stars
    assert len(stars) == 9
    expected = expected[stars["catalog_row"]]
    got = np.column_stack([stars["x_px"], stars["y_px"]])
    np.testing.assert_allclose(got, expected, rtol=0, atol=STAR_PX)
    assert np.abs(got - np.column_stack([x, y])[stars["catalog_row"]]).max() > 0.05  # aberration is there to be seen
    own = frames.wcs(FRAME, sensor).all_world2pix(*lon_lat_deg(seen), 0)
    np.testing.assert_allclose(np.column_stack(own)[stars["catalog_row"]], expected, rtol=0, atol=1e-7)

    image = frames.signal_w_cm2.numpy()[0, 0, 0].astype(float)
    rows, columns = np.mgrid[:128, :128]
    for place_x, place_y in expected:
        near = (np.abs(columns - place_x) < 9) & (np.abs(rows - place_y) < 9)
        light = image * near
        off = (light * columns).sum() / light.sum() - place_x, (light * rows).sum() / light.sum() - place_y
        assert np.hypot(*off) < CENTROID_PX


@pytest.mark.parametrize("up", ["zenith", "north", "orbit_normal"])
@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 0.0), (90.0, 0.0), (200.0, 35.0), (-50.0, -80.0)])
def test_local_directions(scene, azimuth, elevation, up):
    """Along the motion, to its right, upwards: by the local axes from the position's differences."""
    pointing = {"kind": "fixed", "azimuth_elevation_deg": [azimuth, elevation], "up": up}
    described = scene.replace(pointing=pointing, camera=SMALL)
    frames = ws.Renderer(described, device="cpu").render([3, FRAME], ["sat11", "sat27"], ["A"])
    for i, time_s in enumerate(frames.time_s):
        for j, sensor in enumerate(frames.sensors):
            local = local_axes(described, sensor, time_s)
            x, y, z = frames.axes_icrs[i, j]
            np.testing.assert_allclose(z, spherical(azimuth, elevation) @ local, rtol=0, atol=1e-9)
            upwards = {"zenith": local[2], "north": np.array([0.0, 0, 1]), "orbit_normal": -local[1]}[up]
            if (azimuth, elevation, up) != (90.0, 0.0, "orbit_normal"):
                assert y @ upwards < 0
                assert x @ upwards == pytest.approx(0, abs=1e-9)
            np.testing.assert_allclose(np.cross(x, y), z, rtol=0, atol=AXES_ATOL)


LOST = {
    "zenith-up": ({"azimuth_elevation_deg": [10.0, 90.0]}, "zenith", lambda local: -local[1]),
    "nadir": ({"azimuth_elevation_deg": [0.0, -90.0]}, "zenith", lambda local: -local[1]),
    "normal": ({"azimuth_elevation_deg": [-90.0, 0.0]}, "orbit_normal", lambda local: local[2]),
    "pole": ({"ra_dec_deg": [123.0, 90.0]}, "north", lambda local: np.array([1.0, 0.0, 0.0])),
}


@pytest.mark.parametrize(("direction", "up", "spare"), LOST.values(), ids=LOST)
@pytest.mark.ci
def test_up_along_the_boresight_is_replaced_and_said(scene, device, tmp_path, direction, up, spare):
    described = scene.replace(pointing={"kind": "fixed", "up": up, **direction}, camera=SMALL, bands=["A"])
    frames = ws.Renderer(described, device=device).render([FRAME], ["sat11"])
    local = local_axes(described, "sat11", frames.time_s[0])
    assert frames.up_replaced.all()
    np.testing.assert_allclose(frames.axes_icrs[0, 0, 1], -spare(local), rtol=0, atol=1e-9)
    told = described.scenario.view_axes("sat11", frames.time_s)
    np.testing.assert_allclose(frames.axes_icrs[0, 0], told[0], rtol=0, atol=TWIN_RAD)

    report = ws.render_to_folder(described, tmp_path / "run", frames=[FRAME], sensors=["sat11"], device=device)
    said = report.text().splitlines()[-1]
    assert said.startswith("warning: 1 view of 1 with pointing.up along the line of sight, its fallback is up")
    table = ws.read_cube(tmp_path / "run" / "sat11_A.fits").frames
    assert list(table["UP_REPLACED"]) == [True]
    assert list(table["BORESIGHT_REPLACED"]) == [False]


@pytest.mark.ci
def test_nothing_is_said_where_nothing_is_replaced(scene, tmp_path):
    small = scene.replace(camera=SMALL)
    report = ws.render_to_folder(small, tmp_path / "run", frames=[FRAME], sensors=["sat11"], bands=["A"], device="cpu")
    assert report.warning is None and "warning" not in report.text()
    assert not any(ws.read_cube(tmp_path / "run" / "sat11_A.fits").frames["UP_REPLACED"])
    assert "pointing.up" not in scene_report(scene.scenario)
    lost = scene.replace(pointing={"kind": "fixed", "azimuth_elevation_deg": [0.0, 90.0]})
    assert "warning" in next(line for line in scene_report(lost.scenario).splitlines() if "pointing.up" in line)


@pytest.mark.parametrize("roll_deg", [0.0, -120.0])
@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.5, 0.5), (-31.25, 17.8), (600.0, -2000.0)])
@pytest.mark.parametrize("track", ["main", "sphere03", "group"])
@pytest.mark.ci
def test_what_is_tracked_stands_at_its_offset(scene, device, track, offset, roll_deg):
    """Exactly, under the gnomonic projection, on an even and an odd array."""
    for n_row, n_col in ((128, 128), (63, 128)):
        described = scene.replace(
            pointing={"track": track, "offset_px": offset, "roll_deg": roll_deg},
            camera={"n_row": n_row, "n_col": n_col, "fov_deg": 1.0},
        )
        frames = ws.Renderer(described, device=device).render([FRAME], ["sat11", "sat27"], ["A"])
        for sensor in frames.sensors:
            truth = frames.truth[frames.truth["sensor"] == sensor]
            centre = np.array([(n_col - 1) / 2, (n_row - 1) / 2]) + offset
            if track == "group":
                axes = frames.axes_icrs[0, frames.sensors.index(sensor)]
                pinhole = np.column_stack([truth["x_px"], truth["y_px"]]) - described.camera.centre_px
                seen = unit(np.column_stack([pinhole, np.full(len(truth), described.camera.focal_px)])) @ axes
                place = described.camera.project(unit(seen.sum(axis=0))[None], axes)[0][0]
            else:
                row = truth[truth["target"] == ("center" if track == "main" else track)][0]
                place = np.array([row["x_px"], row["y_px"]])
            np.testing.assert_allclose(place, centre, rtol=0, atol=OFFSET_PX)


def test_pixel_corner_and_pixel_centre(scene):
    """On an even array the tracked target is on a corner of four pixels, all alike; half a pixel off, in one."""
    sharp = scene.replace(sky__catalog="none", targets=[scene.to_dict()["groups"][0]["targets"][0]], bands=["A"])
    corner = ws.Renderer(sharp, device="cpu").render([FRAME], ["sat11"], keep_signal=True).signal_w_cm2.numpy()
    four = corner[0, 0, 0, 63:65, 63:65]
    assert four.min() / four.max() > 1 - 1e-6
    centred = sharp.replace(pointing__offset_px=[0.5, 0.5])
    image = ws.Renderer(centred, device="cpu").render([FRAME], ["sat11"], keep_signal=True).signal_w_cm2.numpy()
    assert np.unravel_index(image[0, 0, 0].argmax(), (128, 128)) == (64, 64)
    assert image.max() > 3 * corner.max()


def test_roll_turns_up_to_the_right(scene):
    """Right-handed about the boresight: what was up is then on the left; the tracked target stays."""
    plain = ws.Renderer(scene, device="cpu").render([FRAME], ["sat11"], ["A"]).axes_icrs[0, 0]
    for angle in (90.0, 25.0, -300.0):
        rolled = ws.Renderer(scene.replace(pointing__roll_deg=angle), device="cpu").render([FRAME], ["sat11"], ["A"])
        expected = Rotation.from_rotvec(np.radians(angle) * plain[2]).apply(plain)
        np.testing.assert_allclose(rolled.axes_icrs[0, 0], expected, rtol=0, atol=AXES_ATOL)
        if angle == 90.0:
            np.testing.assert_allclose(-rolled.axes_icrs[0, 0, 1], plain[0], rtol=0, atol=AXES_ATOL)


ROWS = [
    {"time_s": 0.0, "ra_deg": 350.0, "dec_deg": 10.0, "roll_deg": 350.0},
    {"time_s": 700.0, "ra_deg": 20.0, "dec_deg": -15.0, "roll_deg": 20.0},
    {"time_s": 705.0, "ra_deg": 20.0, "dec_deg": -15.0, "roll_deg": 160.0},
    {"time_s": 1650.0, "ra_deg": 80.0, "dec_deg": 88.0, "roll_deg": -140.0},
]


@pytest.mark.parametrize("common_roll_deg", [0.0, 40.0])
def test_scan_goes_along_great_circles(scene, device, common_roll_deg):
    """Directions by scipy's Slerp, roll the short way by hand; at rows, between them, at ends."""
    table = {"kind": "table", "mode": "scan", "rows": ROWS, "up": "north", "roll_deg": common_roll_deg}
    described = scene.replace(pointing=table, camera=SMALL, frames={"count": 1601, "interval_s": 1.0})
    numbers = [0, 1, 350, 699, 700, 702, 705, 706, 1000, 1600]
    frames = ws.Renderer(described, device=device).render(numbers, ["sat27"], ["A"])
    times = [row["time_s"] for row in ROWS]
    roll_at_rows = [-10.0, 20.0, 160.0, 220.0]
    directions = spherical([row["ra_deg"] for row in ROWS], [row["dec_deg"] for row in ROWS])
    for time_s, axes in zip(frames.time_s, frames.axes_icrs[:, 0], strict=True):
        row = min(np.searchsorted(times, time_s, side="right") - 1, 2)
        part = (time_s - times[row]) / (times[row + 1] - times[row])
        start, end = directions[row], directions[row + 1]
        if (start == end).all():
            boresight = start
        else:
            axis = unit(np.cross(start, end))
            angle = np.arccos(start @ end)
            boresight = Slerp([0, 1], Rotation.from_rotvec([0 * axis, angle * axis]))(part).apply(start)
        np.testing.assert_allclose(axes[2], boresight, rtol=0, atol=1e-14)
        roll = np.interp(time_s, times, roll_at_rows) + common_roll_deg
        east = unit(np.cross([0, 0, 1.0], boresight))
        north = np.cross(boresight, east)
        up = np.cos(np.radians(roll)) * north - np.sin(np.radians(roll)) * east  # to the right is west
        np.testing.assert_allclose(-axes[1], up, rtol=0, atol=1e-12)


@pytest.mark.ci
def test_stare_holds_each_row(scene, device):
    rows = [
        {"time_s": 0.0, "azimuth_deg": 30.0, "elevation_deg": 5.0},
        {"time_s": 200.0, "azimuth_deg": 60.0, "elevation_deg": -15.0, "roll_deg": 12.0},
        {"time_s": -5.0, "azimuth_deg": 0.0, "elevation_deg": 40.0, "sensor": "sat27"},
        {"time_s": 400.0, "azimuth_deg": 1.0, "elevation_deg": 40.0, "sensor": "sat27"},
        {"time_s": 600.0, "azimuth_deg": 2.0, "elevation_deg": 40.0, "sensor": "sat27"},
    ]
    described = scene.replace(pointing={"kind": "table", "mode": "stare", "rows": rows}, camera=SMALL)
    frames = ws.Renderer(described, device=device).render([0, 19, 20, 39, 40, 60, 161], ["sat11", "sat27"], ["A"])
    expected = {"sat11": [0, 0, 1, 1, 1, 1, 1], "sat27": [2, 2, 2, 2, 3, 4, 4]}
    for j, sensor in enumerate(frames.sensors):
        for i, row in enumerate(expected[sensor]):
            local = local_axes(described, sensor, frames.time_s[i])
            boresight = spherical(rows[row]["azimuth_deg"], rows[row]["elevation_deg"]) @ local
            np.testing.assert_allclose(frames.axes_icrs[i, j, 2], boresight, rtol=0, atol=1e-9)
            right = frames.axes_icrs[i, j, 0] @ local[2]  # of the zenith: the sine of the roll, foreshortened
            roll = np.radians(rows[row].get("roll_deg", 0.0))
            elevation = np.radians(rows[row]["elevation_deg"])
            assert right == pytest.approx(-np.sin(roll) * np.cos(elevation), rel=0, abs=1e-9)


@pytest.mark.parametrize("suffix", ["csv", "ecsv"])
def test_table_from_a_file_is_the_same(scene, tmp_path, suffix):
    path = tmp_path / f"scan.{suffix}"
    table = Table(rows=ROWS)
    if suffix == "ecsv":  # units of columns are honoured
        table["time_s"] = (table["time_s"] / 60) * u.min
        table["dec_deg"] = np.radians(table["dec_deg"]) * u.rad
    table.write(path, format=f"ascii.{suffix}")
    inline = scene.replace(pointing={"kind": "table", "mode": "scan", "rows": ROWS})
    filed = scene.replace(pointing={"kind": "table", "mode": "scan", "file": str(path)})
    times = np.linspace(0, 1600, 50)
    axes = [one.scenario.view_axes("sat11", times) for one in (filed, inline)]
    np.testing.assert_allclose(*axes, rtol=0, atol=TWIN_RAD)
    assert ws.Scene.from_dict(filed.to_dict()) == filed
    inline.save(tmp_path / "scene.toml")
    assert ws.Scene.load(tmp_path / "scene.toml") == inline


@pytest.mark.ci
def test_a_run_knows_its_table(scene, tmp_path):
    """Another content of the same file is another run."""
    path = tmp_path / "stare.csv"
    path.write_text("time_s,ra_deg,dec_deg\n0,10,20\n")
    small = scene.replace(camera=SMALL, bands=["A"])
    described = small.replace(pointing={"kind": "table", "mode": "stare", "file": str(path)})
    ws.render_to_folder(described, tmp_path / "run", frames=[FRAME], sensors=["sat11"], device="cpu")
    path.write_text("time_s,ra_deg,dec_deg\n0,10,21\n")
    changed = ws.Scene.from_dict(described.to_dict())
    with pytest.raises(ws.InputError, match="holds a different run"):
        ws.render_to_folder(changed, tmp_path / "run", frames=[FRAME], sensors=["sat11"], device="cpu")


POINTINGS = {
    "main": {},
    "group": {"track": "group", "up": "orbit_normal", "roll_deg": 17.0},
    "offset": {"track": "cone02", "offset_px": [12.0, -7.5], "up": "north"},
    "fixed": {"kind": "fixed", "ra_dec_deg": [300.0, 40.0], "roll_deg": 300.0},
    "local": {"kind": "fixed", "azimuth_elevation_deg": [100.0, 12.0], "up": "north"},
    "scan": {"kind": "table", "mode": "scan", "rows": ROWS, "up": "orbit_normal"},
    "stare": {"kind": "table", "mode": "stare", "rows": ROWS},
}


@pytest.mark.parametrize("pointing", POINTINGS.values(), ids=POINTINGS)
def test_host_axes_are_the_devices(scene, device, pointing):
    """Every kind of pointing; jitter plays no part on the host."""
    described = scene.replace(pointing=pointing, camera=SMALL)
    numbers = [0, 1, 50, 70, 71, 161]
    frames = ws.Renderer(described, device=device).render(numbers, described.sensor_names[::5], ["A"])
    for j, sensor in enumerate(frames.sensors):
        told = described.scenario.view_axes(sensor, frames.time_s)
        np.testing.assert_allclose(frames.axes_icrs[:, j], told, rtol=0, atol=TWIN_RAD)
    shaken = described.replace(pointing__jitter={"rms_urad": 50.0, "correlation_s": 1.0})
    axes = [one.scenario.view_axes("sat11", [700.0]) for one in (shaken, described)]
    np.testing.assert_array_equal(*axes)


def world_with(scene, device, change):
    """A world whose bodies' positions and velocities are changed in place."""
    world = device_scene(scene.replace(camera=SMALL, sky__catalog="none"), ["A"], device)
    nodes, n_body = world.tracks.nodes, len(world.tracks.nodes.bodies)
    arrays = [array.numpy().reshape(n_body, -1, 3).copy() for array in (nodes.position_m, nodes.velocity_m_s)]
    change(*arrays, world.tracks.first_target)
    for array, values in zip((nodes.position_m, nodes.velocity_m_s), arrays, strict=True):
        array.assign(values.reshape(-1, 3))
    return world


def aimed(world):
    """View records of the first sensor in frames FRAME and 71, after the first stage."""
    inputs, columns, _ = arrays_of_views(world, world.instrument.frame_time_s([FRAME, 71]))
    aim(world, inputs, columns.views).run()
    return columns.views.numpy()


def test_a_target_at_the_sensor_has_no_direction(scene, device):
    """Range 0: the camera looks along the motion, the view is flagged, and nothing is NaN."""

    def meet(position, velocity, first_target):
        position[first_target], velocity[first_target] = position[0], velocity[0]

    world = world_with(scene, device, meet)
    batch = new_batch(world, [FRAME, 71], ["sat11"], Pool(world.device), keep_signal=True)
    Pipelines([world], n_thread=1, to_host=False).render(batch, None)
    views, seen = batch.columns.views.numpy(), batch.columns.observations.numpy()
    assert list(views["flags"]) == [2, 2]
    axes = views["axes"]
    for i, time_s in enumerate(world.instrument.frame_time_s([FRAME, 71])):
        np.testing.assert_allclose(axes[i, 2], local_axes(scene, "sat11", time_s)[0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(axes[i] @ axes[i].T, np.eye(3), rtol=0, atol=AXES_ATOL)
    for name in seen.dtype.names:
        assert np.isfinite(seen[name]).all(), name
    for array in (batch.columns.irradiance_w_cm2, batch.signal_w_cm2):
        assert np.isfinite(array.numpy()).all()
    assert seen["range_m"][:, 0].max() == 0.0


def test_a_target_close_by_is_tracked(scene, device):
    """A metre away is still a direction. Both move alike: light time and aberration cancel."""
    direction = spherical(77.0, -20.0)

    def meet(position, velocity, first_target):
        position[first_target], velocity[first_target] = position[0] + direction, velocity[0]

    views = aimed(world_with(scene, device, meet))
    assert not views["flags"].any()
    for axes in views["axes"]:
        np.testing.assert_allclose(axes[2], direction, rtol=0, atol=CLOSE_RAD)


def test_a_sensor_at_rest_keeps_finite_axes(scene, device):
    """No orbit, no normal, no direction of motion: every rule falls back to something finite."""

    def stop(position, velocity, first_target):
        position[0], velocity[0] = position[0, 0], 0.0
        position[first_target:], velocity[first_target:] = position[0, 0], 0.0

    for up in ("zenith", "orbit_normal", "north"):
        views = aimed(world_with(scene.replace(pointing__up=up), device, stop))
        axes = views["axes"]
        np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (2, 3, 3)), atol=1e-14)
        assert (views["flags"] & 2).all()


def test_the_hosts_twin_of_a_meeting(scene):
    """The same flags and axes as the kernel's, from tracks that meet."""
    from dataclasses import replace

    met = scene.replace(duration_s=1614.0)
    tracks = met.scenario.tracks
    together = replace(tracks, targets=[replace(tracks.satellites[0], name="center"), *tracks.targets[1:]])
    met.scenario.__dict__["tracks"] = together
    commanded = met.scenario.instrument.commanded_axes(0, np.array([700.0, 710.0]))
    assert commanded.boresight_replaced.all()
    np.testing.assert_allclose(commanded.axes[0, 2], local_axes(scene, "sat11", 700.0)[0], rtol=0, atol=1e-9)
    assert pointing_warning(met.scenario.instruments.values(), {"sat11": [70, 71]}) == (
        "2 views of 2 with no direction to track, the motion's is taken"
    )


BAD = {
    "unknown-track": ({"track": "nobody"}, "pointing.track: must be 'main', 'group' or a target's name, got 'nobody'"),
    "track-type": ({"track": 3}, "pointing.track: .* got 3"),
    "unknown-kind": ({"kind": "wander"}, "pointing.kind: must be one of 'track', 'fixed', .* got 'wander'"),
    "unknown-field": ({"kind": "fixed", "ra_dec_deg": [0, 0], "track": "main"}, "track: is not a known field"),
    "up": ({"up": "left"}, "pointing.up: must be 'zenith', 'north' or 'orbit_normal', got 'left'"),
    "no-direction": ({"kind": "fixed"}, "pointing: ra_dec_deg, azimuth_elevation_deg: exactly one must be given"),
    "dec": ({"kind": "fixed", "ra_dec_deg": [0, 91]}, r"pointing.ra_dec_deg\[1\]: must be in \[-90, 90\], got 91"),
    "jitter": ({"jitter": {"rms_urad": -1, "correlation_s": 1}}, "pointing.jitter.rms_urad: must be >= 0, got -1"),
    "late": (
        {"kind": "table", "mode": "scan", "rows": [{**ROWS[0], "time_s": t} for t in (0.0, 900.0)]},
        r"pointing: the rows of sat11 cover \[0, 900\] s, not the frame at 1610 s",
    ),
    "early": (
        {"kind": "table", "mode": "stare", "rows": [{**ROWS[0], "time_s": 5.0}]},
        "pointing: the rows of sat11 cover from 5 s on, not the frame at 0 s",
    ),
    "order": (
        {"kind": "table", "mode": "stare", "rows": [ROWS[0], ROWS[0]]},
        r"pointing.rows\[1\].time_s: must be above that of the sensor's row before \(0\), got 0",
    ),
    "one-row": ({"kind": "table", "mode": "scan", "rows": ROWS[:1]}, "a scan needs at least two rows per sensor"),
    "opposite": (
        {"kind": "table", "mode": "scan", "rows": [ROWS[0], {"time_s": 2000.0, "ra_deg": 170.0, "dec_deg": -10.0}]},
        r"pointing.rows\[1\]: a scan has no way to the opposite of the row before",
    ),
    "sensor": (
        {"kind": "table", "mode": "stare", "rows": [{**ROWS[0], "sensor": "sat99"}]},
        r"pointing.rows\[0\].sensor: must be a sensor of the scene, got 'sat99'",
    ),
    "missing-sensor": (
        {"kind": "table", "mode": "stare", "rows": [{**ROWS[0], "sensor": "sat11"}]},
        "pointing.rows: there are none for sensor sat12, and none for all sensors",
    ),
    "mixed": (
        {"kind": "table", "mode": "stare", "rows": [ROWS[0], {"time_s": 1, "azimuth_deg": 0, "elevation_deg": 0}]},
        r"pointing.rows\[1\]: must give ra_deg and dec_deg, as the first row does",
    ),
    "half": (
        {"kind": "table", "mode": "stare", "rows": [{"time_s": 1, "azimuth_deg": 0}]},
        r"pointing.rows\[0\]: must have ra_deg and dec_deg, or azimuth_deg and elevation_deg",
    ),
    "no-rows": ({"kind": "table", "mode": "stare", "rows": []}, "pointing.rows: must hold at least one"),
    "no-source": ({"kind": "table", "mode": "stare"}, "pointing: rows, file: exactly one must be given"),
}


@pytest.mark.parametrize(("pointing", "message"), BAD.values(), ids=BAD)
def test_bad_pointings_are_named(scene, pointing, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        scene.replace(pointing=pointing)
    assert "\n" not in str(caught.value)


BAD_FILES = {
    "no-file": ("csv", None, "cannot be read"),
    "suffix": ("txt", "", "must end in .csv or .ecsv"),
    "column": ("csv", "time_s,ra_deg,dec_deg,colour\n0,1,2,3\n", "column colour: must be one of time_s, ra_deg"),
    "no-time": ("csv", "ra_deg,dec_deg\n1,2\n", "columns: must hold time_s"),
    "pair": ("csv", "time_s,ra_deg,elevation_deg\n0,1,2\n", "columns: must hold ra_deg and dec_deg, or"),
    "range": ("csv", "time_s,ra_deg,dec_deg\n0,1,2\n9,1,92\n", r"line 3: column dec_deg: must be in \[-90, 90\]"),
    "gap": ("csv", "time_s,ra_deg,dec_deg\n0,1,2\n9,,20\n", "line 3: column ra_deg: must be finite, got nan"),
    "word": ("csv", "time_s,ra_deg,dec_deg\n0,1,2\nsoon,1,2\n", "line 3: column time_s: must be a number, got 'soon'"),
    "order": ("csv", "time_s,ra_deg,dec_deg\n5,1,2\n4,1,2\n", "line 3: time_s: must be above .* got 4"),
}


@pytest.mark.parametrize(("suffix", "text", "message"), BAD_FILES.values(), ids=BAD_FILES)
def test_bad_files_are_named(scene, tmp_path, suffix, text, message):
    path = tmp_path / f"table.{suffix}"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ws.InputError, match=message) as caught:
        scene.replace(pointing={"kind": "table", "mode": "stare", "file": str(path)}).scenario  # noqa: B018
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"pointing: {path}: ")


def test_frames_beyond_the_table_are_refused(scene):
    """Frames that the scene does not count may be rendered, but only where the table says where to look."""
    table = {"kind": "table", "mode": "scan", "rows": [ROWS[0], {**ROWS[1], "time_s": 900.0}]}
    described = scene.replace(frames={"count": 10, "interval_s": 10.0}, pointing=table)
    renderer = ws.Renderer(described, device="cpu")
    with pytest.raises(ws.InputError, match=r"the rows of sat11 cover \[0, 900\] s, not the frame at 1000 s"):
        renderer.render([100], ["sat11"])
    with pytest.raises(ws.InputError, match="cover"):
        described.scenario.view_axes("sat11", [1000.0])
    with pytest.raises(ws.InputError, match=r"sensor: must be a sensor of the scene \(sat11, .*\), got 'sat99'"):
        described.scenario.view_axes("sat99", [1.0])


def test_old_descriptions_still_work(scene):
    """Without a kind a pointing is a "track"; parts and tables are the same."""
    assert scene.pointing == (ws.TrackPointing(),)
    assert scene.replace(pointing={"track": "group"}).pointing == (ws.TrackPointing(track="group"),)
    assert scene.replace(pointing=ws.FixedPointing(ra_dec_deg=(10.0, 20.0))).pointing[0].kind == "fixed"
    quantity = ws.FixedPointing(ra_dec_deg=(1 * u.hourangle, 600 * u.arcmin))
    np.testing.assert_allclose(quantity.ra_dec_deg, (15.0, 10.0), rtol=1e-14)


def test_a_target_whose_light_takes_too_long_is_told(scene):
    """Its track begins two seconds before the scene, or a node step."""
    far = scene.replace(
        trajectory={"kind": "state_vector", "position_m": [5e9, 0.0, 0.0], "velocity_m_s": [0.0, 300.0, 0.0]},
        release={}, duration_s=600.0, frames={"count": 2, "interval_s": 60.0}, access_rules={},
    )  # fmt: skip
    with pytest.raises(ws.InputError, match=r"^\w+: is too far: its light takes 16\.7 s \(.* km\) to the camera"):
        far.scenario.view_axes("sat11", [0.0])
