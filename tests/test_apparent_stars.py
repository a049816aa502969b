"""Apparent places of stars, whole: against ERFA, against astropy, and as light on the image."""

import itertools

import erfa
import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import GCRS, CartesianRepresentation, SkyCoord
from astropy.time import Time, TimeDelta

import warpsim as ws

ARCSEC_RAD = np.pi / 180 / 3600
AU_M = 149_597_870_700.0

PLACE_ARCSEC = 1e-5
"""The promise. ERFA's aberration also knows the Sun's potential (4e-7 arcsec)."""
ERFA_RAD = 1e-13
"""2e-8 arcsec. The same formulas in another order: near the Sun 1 + cosine loses digits, 5e-15 rad."""
CHAIN_PX = 1e-7
"""Kernels against the host's twin: 2.8e-6 arcsec, of the 1e-5 promised. Rounding of unit vectors times the focal length
is 2e-8 px."""
SUN_PX = 1e-7
"""Kernels against ERFA near the Sun, 3e-6 arcsec: ERFA's potential term, and the observer's velocity by differences."""
SPEED_AU_YR = 12.5
"""59 km/s across the line of sight, as fast as Barnard's star nearly: 10 arcsec/yr at a parallax of 800 mas."""
CENTROID_PX = 1e-3
"""The promise for light on the image, through the whole chain, at any size."""


def directions(n, seed=17):
    vectors = np.random.default_rng(seed).normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def earth(epoch, time_s=0.0):
    """Barycentric position and velocity and heliocentric position of the Earth, by ERFA [m, m/s]."""
    time = (epoch + TimeDelta(time_s, format="sec")).tdb
    heliocentric, barycentric = erfa.epv00(time.jd1, time.jd2)
    return barycentric["p"] * AU_M, barycentric["v"] * AU_M / 86400.0, heliocentric["p"] * AU_M


def test_deflection_is_erfas(scene, record_accuracy):
    """All over the sky, and on a line into the Sun."""
    _, _, heliocentric = earth(scene.epoch)
    distance = np.linalg.norm(heliocentric)
    away = heliocentric / distance
    side = np.cross(away, [0.0, 0.0, 1.0])
    angle = np.radians(np.geomspace(1e-3, 179.9, 200))[:, None]
    near_sun = -away * np.cos(angle) + side / np.linalg.norm(side) * np.sin(angle)
    stars = np.concatenate([directions(2000), near_sun, -away[None], away[None]])
    seen = ws.apparent_direction(stars, np.zeros(3), heliocentric_m=heliocentric)
    expected = erfa.ldsun(stars, away, distance / AU_M)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(seen, expected, rtol=0, atol=ERFA_RAD)
    record_accuracy("Deflection of light by the Sun", np.abs(seen - expected).max(), ERFA_RAD, "rad", "ERFA")
    moved = np.linalg.norm(seen - stars, axis=1) / ARCSEC_RAD
    assert 1.5 < moved.max() < 6.5  # 1.75 arcsec at the Sun's limb, more where it hides the star
    # The textbook's 4.07 mas at 90 degrees and 1 au; a hundredth of a radian from there, 1 % more or less.
    assert np.allclose(moved[np.abs(stars @ away) < 0.01] * distance / AU_M, 0.004072, rtol=0, atol=1e-4)


def test_parallax_is_erfas(scene, record_accuracy):
    barycentric, _, _ = earth(scene.epoch)
    ra, dec = np.radians(np.random.default_rng(5).uniform([0, -90], [360, 90], (500, 2)).T)
    parallax_mas = np.random.default_rng(6).uniform(0, 800, 500)
    seen = ws.apparent_direction(erfa.s2c(ra, dec), np.zeros(3), parallax_mas=parallax_mas, barycentric_m=barycentric)
    expected = erfa.pmpx(ra, dec, 0.0, 0.0, parallax_mas / 1e3, 0.0, 0.0, barycentric / AU_M)
    np.testing.assert_allclose(seen, expected, rtol=0, atol=ERFA_RAD)
    record_accuracy("Parallax", np.abs(seen - expected).max(), ERFA_RAD, "rad", "ERFA")
    still = ws.apparent_direction(
        erfa.s2c(ra, dec), np.zeros(3), parallax_mas=np.where(ra > 3, np.nan, -5.0), barycentric_m=barycentric
    )
    np.testing.assert_allclose(still, erfa.s2c(ra, dec), rtol=0, atol=ERFA_RAD)


def astropy_place(star, epoch_time, position_m, velocity_m_s, moved_to=None):
    """Unit vectors of the geocentric-axes apparent place for an observer in orbit, by astropy.

    Stars are moved from J2000 to the instant moved_to; not at all when left out.
    """
    distance = (star.parallax_mas * u.mas).to(u.pc, equivalencies=u.parallax())
    coordinates = SkyCoord(star.ra_deg * u.deg, star.dec_deg * u.deg, distance=distance)
    if moved_to is not None:
        moving = SkyCoord(
            coordinates.ra,
            coordinates.dec,
            distance=distance,
            pm_ra_cosdec=star.pm_ra_mas_yr * u.mas / u.yr,
            pm_dec=star.pm_dec_mas_yr * u.mas / u.yr,
            obstime=Time("J2000"),
        ).apply_space_motion(new_obstime=moved_to)
        coordinates = SkyCoord(moving.ra, moving.dec, distance=moving.distance)
    observer = GCRS(
        obstime=epoch_time,
        obsgeoloc=CartesianRepresentation(position_m * u.m),
        obsgeovel=CartesianRepresentation(velocity_m_s * u.m / u.s),
    )
    seen = coordinates.transform_to(observer).cartesian.xyz.value.T
    return seen / np.linalg.norm(seen, axis=1, keepdims=True)


def moved_by_erfa(star, epoch):
    """Unit vectors of stars moved from J2000 to an instant, in TT, by ERFA's pmsafe.

    At a parallax of 100 arcsec the speeds are far below that of light: ERFA's relativistic and light-time terms, which
    the model leaves out, stay below 1e-7 arcsec.
    """
    mas_rad = ARCSEC_RAD / 1e3
    ra, dec = np.radians(star.ra_deg), np.radians(star.dec_deg)
    pm_ra, pm_dec = star.pm_ra_mas_yr * mas_rad / np.cos(dec), star.pm_dec_mas_yr * mas_rad
    time = epoch.tt
    moved = erfa.pmsafe(ra, dec, pm_ra, pm_dec, 100.0, 0.0, 2451545.0, 0.0, time.jd1, time.jd2)
    return erfa.s2c(moved[0], moved[1])


def test_apparent_places_are_astropys(scene, record_accuracy):
    """Parallax, deflection and aberration together, for an observer in low orbit, all over the sky."""
    position = np.array([4.1e6, -3.9e6, 4.4e6])
    velocity = np.array([5_200.0, 5_500.0, 100.0])
    rng = np.random.default_rng(23)
    place = directions(3000)
    star = ws.StarCatalog.from_arrays(
        np.degrees(np.arctan2(place[:, 1], place[:, 0])),
        np.degrees(np.arcsin(place[:, 2])),
        {"A": np.ones(3000)},
        parallax_mas=rng.uniform(0.5, 800, 3000),
    )
    barycentric, earth_velocity, heliocentric = earth(scene.epoch)
    seen = ws.apparent_direction(
        star.direction_icrs,
        earth_velocity + velocity,
        parallax_mas=star.parallax_mas,
        barycentric_m=barycentric + position,
        heliocentric_m=heliocentric + position,
    )
    expected = astropy_place(star, scene.epoch, position, velocity)
    apart = np.linalg.norm(seen - expected, axis=1) / ARCSEC_RAD
    far_from_sun = star.direction_icrs @ heliocentric / np.linalg.norm(heliocentric) > -np.cos(np.radians(1.0))
    assert apart[far_from_sun].max() < PLACE_ARCSEC
    record_accuracy(
        "Apparent direction in low orbit, all effects", apart[far_from_sun].max(), PLACE_ARCSEC, "arcsec", "astropy"
    )
    assert far_from_sun.sum() > 2990


def star_catalog_around(axes, scene, n, seed):
    """Bright stars all over an image and beside it, with motions and parallaxes, no two near each other."""
    rng = np.random.default_rng(seed)
    camera = scene.camera
    grid = int(np.ceil(np.sqrt(n)))
    cell = np.stack(np.meshgrid(np.arange(grid), np.arange(grid)), axis=-1).reshape(-1, 2)
    xy = (cell + 0.5 + rng.uniform(-0.3, 0.3, cell.shape)) * camera.n_col / grid - 0.5
    pinhole = np.column_stack([(xy - camera.centre_px) / camera.focal_px, np.ones(len(xy))])
    place = pinhole @ axes  # aberration carries them about 1 % of the frame away
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    parallax_mas = rng.uniform(1, 800, len(xy))
    heading, speed_mas_yr = rng.uniform(0, 2 * np.pi, len(xy)), SPEED_AU_YR * parallax_mas
    motion_mas_yr = speed_mas_yr[:, None] * np.column_stack([np.sin(heading), np.cos(heading)])
    # Back to J2000 along the way they come, near enough: at the scene's epoch they are where they are wanted.
    years = scene.epoch.tt.jyear - 2000.0
    east = np.cross([0.0, 0.0, 1.0], place)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    north = np.cross(place, east)
    way = motion_mas_yr[:, :1] * east + motion_mas_yr[:, 1:] * north
    start = place - years * ARCSEC_RAD / 1e3 * way
    return ws.StarCatalog.from_arrays(
        np.degrees(np.arctan2(start[:, 1], start[:, 0])),
        np.degrees(np.arctan2(start[:, 2], np.hypot(start[:, 0], start[:, 1]))),
        {"A": 10.0 ** rng.uniform(1, 4, len(xy))},
        pm_ra_mas_yr=motion_mas_yr[:, 0],
        pm_dec_mas_yr=motion_mas_yr[:, 1],
        parallax_mas=parallax_mas,
    )


SWITCHES = list(itertools.product([False, True], repeat=3))


@pytest.mark.parametrize(("aberration", "parallax", "light_deflection"), SWITCHES)
@pytest.mark.ci
def test_each_switch_does_its_part_and_no_more(scene, device, aberration, parallax, light_deflection):
    """Star rows of the renderer against ERFA's proper motion and the host's twin with the same steps on."""
    axes = ws.Renderer(scene, device=device).render([70], ["sat11"], ["A"]).axes_icrs[0, 0]
    catalog = star_catalog_around(axes, scene, 60, seed=1)
    described = scene.replace(
        sky={"aberration": aberration, "parallax": parallax, "light_deflection": light_deflection}
    )
    frames = ws.Renderer(described, device=device, catalog=catalog).render([70], ["sat11"], ["A"], keep_stars=True)
    rows = frames.stars["catalog_row"]
    assert len(rows) > 40
    observer = {}
    if parallax:
        observer |= {"parallax_mas": catalog.parallax_mas[rows], "barycentric_m": frames.barycentric_m[0, 0]}
    if light_deflection:
        observer |= {"heliocentric_m": frames.heliocentric_m[0, 0]}
    velocity = frames.velocity_m_s[0, 0] if aberration else np.zeros(3)
    seen = ws.apparent_direction(moved_by_erfa(catalog, scene.epoch)[rows], velocity, **observer)
    xy, in_front = described.camera.project(seen, frames.axes_icrs[0, 0])
    assert in_front.all()
    np.testing.assert_allclose(frames.stars["x_px"], xy[:, 0], rtol=0, atol=CHAIN_PX)
    np.testing.assert_allclose(frames.stars["y_px"], xy[:, 1], rtol=0, atol=CHAIN_PX)


SUN_VIEWS = {
    # epoch, sensor and frame whose target passes by the Sun, and the Sun's angle from the boresight [deg]
    "july": ("2025-07-06T15:00:00", "sat45", 124, 0.391),  # beyond 1 au
    "january": ("2025-01-15T21:00:00", "sat11", 110, 0.165),  # within
}


@pytest.mark.parametrize(("epoch_utc", "sensor", "frame", "angle_deg"), SUN_VIEWS.values(), ids=SUN_VIEWS)
@pytest.mark.ci
def test_stars_around_the_sun_are_erfas(scene, device, epoch_utc, sensor, frame, angle_deg):
    """The kernel with the Sun in the frame: parallax, deflection with its fade, and aberration, each by ERFA."""
    described = scene.replace(
        epoch_utc=epoch_utc, sky={"aberration": True, "parallax": True, "light_deflection": True}, bands=["A"]
    )
    time_s = float(described.scenario.instrument.frame_time_s([frame])[0])
    barycentric, velocity, heliocentric = earth(described.epoch, time_s)
    position = described.position_m(sensor, [time_s])[0]
    step = 0.05
    ends = described.position_m(sensor, [time_s - step, time_s + step])
    beta = (velocity + (ends[1] - ends[0]) / (2 * step)) / 299_792_458.0
    from_sun_au = (heliocentric + position) / AU_M
    distance_au = np.linalg.norm(from_sun_au)
    sun = -from_sun_au / distance_au
    axes = ws.Renderer(described, device=device).render([frame], [sensor], ["A"]).axes_icrs[0, 0]
    assert np.degrees(np.arccos(sun @ axes[2])) == pytest.approx(angle_deg, abs=0.01)

    # From the Sun's centre, over the 5 arcmin of the fade and the limb at 16, across the frame.
    angle = np.radians(np.concatenate([[0.0], np.geomspace(0.01, 60, 400)]) / 60)[:, None]
    turn = 2.4 * np.arange(len(angle))[:, None]
    across = np.cross(sun, axes[0])
    across /= np.linalg.norm(across)
    place = np.cos(angle) * sun + np.sin(angle) * (np.cos(turn) * across + np.sin(turn) * np.cross(sun, across))
    ra, dec = np.arctan2(place[:, 1], place[:, 0]), np.arcsin(place[:, 2])
    parallax_mas = np.random.default_rng(8).uniform(0, 800, len(place))
    catalog = ws.StarCatalog.from_arrays(
        np.degrees(ra), np.degrees(dec), {"A": np.ones(len(ra))}, parallax_mas=parallax_mas
    )
    stars = (
        ws.Renderer(described, device=device, catalog=catalog).render([frame], [sensor], ["A"], keep_stars=True).stars
    )
    rows = np.asarray(stars["catalog_row"])
    assert (rows < 200).sum() > 190  # those within the fade, but for some that the frame's border cuts off
    observer_au = (barycentric + position) / AU_M
    proper = erfa.pmpx(ra[rows], dec[rows], 0.0, 0.0, parallax_mas[rows] / 1e3, 0.0, 0.0, observer_au)
    natural = erfa.ldsun(proper, -sun, distance_au)
    seen = erfa.ab(natural, beta, distance_au, np.sqrt(1 - beta @ beta))
    xy, _ = described.camera.project(seen, axes)
    np.testing.assert_allclose(np.column_stack([stars["x_px"], stars["y_px"]]), xy, rtol=0, atol=SUN_PX)
    shift_arcsec = np.linalg.norm(natural - proper, axis=1) / ARCSEC_RAD
    assert 5.5 < shift_arcsec.max() < 6.5


def centroid(image, x, y, half):
    """Centre of light in a square window about a pixel."""
    row, column = int(np.rint(y)), int(np.rint(x))
    window = image[row - half : row + half + 1, column - half : column + half + 1].astype(np.float64)
    rows, columns = np.mgrid[row - half : row + half + 1, column - half : column + half + 1]
    return (window * columns).sum() / window.sum(), (window * rows).sum() / window.sum()


@pytest.mark.parametrize("n_pixel", [1024, 6000])
@pytest.mark.ci
def test_light_falls_where_astropy_says(scene, device, n_pixel, record_accuracy):
    """Centroids of rendered stars against astropy's apparent places through astropy.wcs; noiseless, no targets near."""
    # Stamps that leave next to nothing out: the light beyond a disc of pixels is not centred on the star.
    optics = {"aperture_m": 0.4, "psf": "gaussian", "sigma_px": 1.2, "stamp_cut_nei": 1e-4}
    sharp = scene.replace(camera__n_row=n_pixel, camera__n_col=n_pixel, optics=optics)
    axes = ws.Renderer(scene, device=device).render([70], ["sat11"], ["A"]).axes_icrs[0, 0]
    catalog = star_catalog_around(axes, sharp, 100, seed=n_pixel)
    whole = sharp.replace(sky={"parallax": True, "light_deflection": True})
    renderer = ws.Renderer(whole, device=device, catalog=catalog)
    frames = renderer.render([70], ["sat11"], ["A"], keep_signal=True, keep_stars=True)
    image = frames.signal_w_cm2.numpy()[0, 0, 0]

    time_s = float(frames.time_s[0])
    position = scene.position_m("sat11", [time_s])[0]
    step = 0.05
    velocity = np.diff(scene.position_m("sat11", [time_s - step, time_s + step]), axis=0)[0] / (2 * step)
    when = scene.epoch + TimeDelta(time_s, format="sec")
    seen = astropy_place(catalog, when, position, velocity, moved_to=scene.epoch)
    x, y = frames.wcs(70, "sat11").all_world2pix(
        np.degrees(np.arctan2(seen[:, 1], seen[:, 0])), np.degrees(np.arcsin(seen[:, 2])), 0
    )
    half = 12
    targets = np.column_stack([frames.truth["x_px"], frames.truth["y_px"]])
    apart = np.min(np.hypot(x[:, None] - targets[:, 0], y[:, None] - targets[:, 1]), axis=1)
    alone = (apart > 60) & (np.minimum(x, y) > 2 * half) & (np.maximum(x, y) < n_pixel - 2 * half)
    assert alone.sum() > 60
    off = [np.hypot(*np.subtract(centroid(image, x[k], y[k], half), (x[k], y[k]))) for k in np.flatnonzero(alone)]
    assert max(off) < CENTROID_PX
    record_accuracy(
        "Centroid of a rendered star, 1024 and 6000 px per degree", max(off), CENTROID_PX, "px", "astropy, astropy.wcs"
    )
    assert len(frames.stars) >= alone.sum()
    # Without the steps that are off by default the light would lie visibly elsewhere at 6000 pixels.
    plain = ws.apparent_direction(moved_by_erfa(catalog, scene.epoch), frames.velocity_m_s[0, 0])
    shift_px = np.linalg.norm(plain - seen, axis=1) * whole.camera.focal_px
    assert np.median(shift_px) > 50 * CENTROID_PX
    print(f"{n_pixel} px: worst of {len(off)} centroids {max(off):.1e} px")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"parallax_mas": 5.0}, "parallax_mas: needs barycentric_m, the observer's position"),
        ({"heliocentric_m": [1.0, 2.0]}, r"heliocentric_m: must end in an axis of 3, got shape \(2,\)"),
        ({"heliocentric_m": "here"}, "heliocentric_m: must be numbers, got str"),
    ],
    ids=["no-position", "two-numbers", "text"],
)
def test_bad_observers_are_named(arguments, message):
    with pytest.raises(ws.InputError, match=message):
        ws.apparent_direction([1.0, 0.0, 0.0], np.zeros(3), **arguments)
