"""Patches of surfaces: areas against fine quadratures, all terms of light, spin, exposures, and what is refused."""

import numpy as np
import pytest
from bodies import emission_s, ends_m, sight_m, unit_vectors
from conftest import slow
from on_devices import target_field
from scipy.spatial.transform import Rotation

import warpsim as ws
from warpsim.constants import ASTRONOMICAL_UNIT_M
from warpsim.output.check import scene_report
from warpsim.radiometry.bands import band_radiance_w_m2_sr
from warpsim.radiometry.sun_and_earth import sun_irradiance_w_m2
from warpsim.scene.exposure import NODE_COUNTS
from warpsim.target.patches import PatchArea

SIDE_ATOL = 8e-5  # of the side's largest projection: strips of a degree are 4e-5 off where they end
SPHERE_ATOL = 6e-4  # cells of 3 degrees
LIGHT_RTOL = 3e-4  # light of patched bodies by facets against bodies of closed form
CURVE_RTOL = 2e-6  # rounding of truth's float32 light
QUADRATURE = 1e-3  # the scene's lighting.quadrature_error

PAINT, BARE = ws.Graybody(emissivity=0.9), ws.Graybody(emissivity=0.1)
SHAPES = [
    ws.Cylinder(0.3, 1.0),
    ws.Cone(0.3, 1.0),
    ws.Frustum(0.3, 0.5, 1.0),
    ws.Frustum(0.5, 0.2, 0.1),
    ws.Sphere(0.5),
]
WEDGE = ws.Mesh(
    vertices_m=[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], faces=[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
)
PARTS = [
    {"azimuth_deg": (30.0, 100.0)},
    {"azimuth_deg": (-100.0, 170.0), "along": (0.2, 0.7)},
    {"along": (0.9, 1.0)},
    {},
]


def fine_facets(shape, on="side", along=(0.0, 1.0), azimuth_deg=(0.0, 360.0), n=4000):
    """Normals and areas of many small pieces of a part, by the surface's parameters."""
    start, end = np.radians(azimuth_deg)
    if on != "side":
        radius = ends_m(shape)[on == "top"]
        return np.array([[0.0, 0.0, 1.0 if on == "top" else -1.0]]), np.array([0.5 * (end - start) * radius**2])
    if shape.kind == "sphere":
        n_ring, n = 200, 400
    else:
        n_ring = 1
    part = along[0] + (along[1] - along[0]) * (np.arange(n_ring) + 0.5) / n_ring
    phi = start + (end - start) * (np.arange(n) + 0.5) / n
    part, phi = (grid.ravel() for grid in np.meshgrid(part, phi, indexing="ij"))
    if shape.kind == "sphere":
        z = 2.0 * part - 1.0
        ring = np.sqrt(1.0 - z * z)
        area = 2.0 * shape.radius_m**2 * (along[1] - along[0]) / n_ring * (end - start) / n
        return np.stack([ring * np.cos(phi), ring * np.sin(phi), z], axis=1), np.full(len(z), area)
    base, top, height = ends_m(shape)
    slant, radius = np.hypot(height, base - top), base + (top - base) * part
    normal = np.stack([height * np.cos(phi), height * np.sin(phi), 0 * phi + base - top], axis=1)
    return normal / slant, radius * slant * (along[1] - along[0]) * (end - start) / n


@pytest.mark.parametrize("part", PARTS, ids=["sector", "piece", "band", "whole"])
@pytest.mark.parametrize("shape", SHAPES, ids=["cylinder", "cone", "frustum", "flat frustum", "sphere"])
def test_areas_are_those_of_a_fine_quadrature(shape, part, record_accuracy):
    view, sun = unit_vectors(1, 100), unit_vectors(2, 100)
    area = PatchArea(shape, ws.Patch(PAINT, **part))
    normal, piece = fine_facets(shape, **part)
    seen, lit = np.maximum(view @ normal.T, 0.0), np.maximum(sun @ normal.T, 0.0)
    off = [
        np.abs(area.projected_area_along_m2(view) - seen @ piece).max(),
        np.abs(area.reflected_area_m2(view, sun) - (seen * lit) @ piece).max(),
    ]
    scale = PatchArea(shape, ws.Patch(PAINT)).surface_m2 / np.pi
    name, limit = "Areas of patches of a side", SIDE_ATOL
    if shape.kind == "sphere":
        name, limit = "Areas of patches of a sphere", SPHERE_ATOL
    record_accuracy(name, max(off) / scale, limit, "of the side over pi", "quadrature")
    assert area.surface_m2 == pytest.approx(piece.sum(), rel=3e-4)


def test_flat_parts_and_faces_are_exact():
    view = unit_vectors(3, 50)
    sector = PatchArea(ws.Cylinder(0.5, 1.0), ws.Patch(PAINT, on="top", azimuth_deg=(10, 100)))
    np.testing.assert_allclose(sector.projected_area_along_m2(view), np.pi / 16 * np.maximum(view[:, 2], 0), rtol=1e-14)
    plate = PatchArea(ws.Plate(2.0, 3.0), ws.Patch(PAINT, on="base"))
    np.testing.assert_allclose(plate.projected_area_along_m2(view), 6 * np.maximum(-view[:, 2], 0), rtol=1e-14)
    face = PatchArea(WEDGE, ws.Patch(PAINT, on="faces", faces=(3,)))
    np.testing.assert_allclose(face.projected_area_along_m2(view), np.maximum(view.sum(axis=1), 0) / 2, atol=1e-15)
    parts = [PatchArea(WEDGE, ws.Patch(PAINT, on="faces", faces=faces)) for faces in ((0, 2), (1, 3))]
    whole = sum(part.projected_area_along_m2(view) for part in parts)
    np.testing.assert_allclose(whole, WEDGE.projected_area_along_m2(view), atol=1e-15)


def scene_of(shape, surface, patches=(), **changes):
    """One target in daylight, seen by satellites of the paper's scene."""
    scene = ws.Scene.load("stss").replace(sky__catalog="none", epoch_utc="2025-06-21T18:00:00")
    target = {
        "name": "body", "shape": shape, "surface": surface, "patches": patches,
        "temperature": {"start_k": 300.0},
        "attitude": {"spin_rev_s": 0.05, "precession_angle_deg": 70.0, "axis": [1.0, 0.0, 0.0]},
    }  # fmt: skip
    return scene.replace(targets=[target | changes])


FASTER = {"spin_rev_s": 0.1, "precession_angle_deg": 70.0, "axis": [1.0, 0.0, 0.0]}
TIMES_S = np.arange(700.0, 790.0, 1.3)
SENSORS = ["sat31", "sat46", "sat17"]  # see the body all the time


def curves_of(scene, times_s=TIMES_S, sensors=SENSORS, bands=("A", "E")):
    """Light by term, (n_time, n_sensor, n_band); some of it at all times."""
    curves = ws.light_curves(scene, times_s, sensors=sensors, bands=bands)
    assert not curves.occulted.any()
    return {name: light[..., 0] for name, light in curves.terms_w_cm2.items()}


ALL = {
    "cylinder": [{}, {"on": "top"}, {"on": "base"}],
    "cone": [{}, {"on": "base"}],
    "sphere": [{}],
}


@pytest.mark.ci
@pytest.mark.parametrize("shape", [SHAPES[0], SHAPES[1], SHAPES[4]], ids=lambda shape: shape.kind)
def test_a_body_all_painted_is_that_of_the_paint(shape):
    """By facets on a bare body against the closed forms of a painted one, and no change where paints agree."""
    parts = [
        {**part, "azimuth_deg": turn} for part in ALL[shape.kind] for turn in ((0.0, 130.0), (130.0, 360.0))
    ]  # fmt: skip
    plain, bare = (curves_of(scene_of(shape, surface)) for surface in (PAINT, BARE))
    painted = curves_of(scene_of(shape, BARE, [ws.Patch(PAINT, **part) for part in parts]))
    same = curves_of(scene_of(shape, PAINT, [ws.Patch(PAINT, **part) for part in parts]))
    for name, light in plain.items():
        assert light.max() > 0
        contrast = max(light.max(), bare[name].max())
        rtol = LIGHT_RTOL * (3 if shape.kind == "sphere" else 1)
        np.testing.assert_allclose(painted[name], light, rtol=0, atol=rtol * contrast)
        np.testing.assert_allclose(same[name], light, rtol=CURVE_RTOL, atol=0)


@pytest.mark.ci
def test_two_halves_sum_to_two_bodies():
    """Linear in what is painted: each half painted alone, and both bodies plain."""
    shape = SHAPES[2]
    halves = [[ws.Patch(PAINT, azimuth_deg=turn)] for turn in ((20.0, 200.0), (200.0, 380.0))]
    one, other = (curves_of(scene_of(shape, BARE, half)) for half in halves)
    ends = [ws.Patch(BARE, on=on) for on in ("top", "base")]
    bare, sides = (curves_of(scene_of(shape, *given)) for given in ((BARE,), (PAINT, ends)))
    for name in bare:
        assert np.abs(one[name] - other[name]).max() > 0.1 * sides[name].max()
        total = bare[name] + sides[name]
        np.testing.assert_allclose(one[name] + other[name], total, rtol=0, atol=LIGHT_RTOL * total.max())


@pytest.mark.ci
def test_emission_and_sunlight_are_those_of_fine_facets(device):
    """Attitude, spin, light time, radiance and the Sun written out on their own."""
    shape = SHAPES[0]
    part = {"azimuth_deg": (-60.0, 80.0), "along": (0.1, 0.8)}
    scene = scene_of(shape, BARE, [ws.Patch(PAINT, **part)])
    truth = ws.Renderer(scene, device=device).render(range(60, 100, 4), SENSORS, ["A"]).truth
    assert len(truth) == 30 and not truth["occulted"].any()
    whole = [fine_facets(shape, on) for on in ("side", "top", "base")]
    normal = np.concatenate([part[0] for part in whole])
    piece = np.concatenate([part[1] for part in whole])
    own_normal, own_piece = fine_facets(shape, **part)
    for row in truth:
        emitted_s, (place, view) = emission_s(row), sight_m(scene, "body", row)
        sun = scene.scenario.position_m("sun", [emitted_s])[0] - place
        back = Rotation.from_quat(scene.scenario.attitude_quaternion("body", [emitted_s])[0]).inv()
        view_body = back.apply(view / np.linalg.norm(view))
        sun_body = back.apply(sun / np.linalg.norm(sun))

        def areas(normal, piece, view_body=view_body, sun_body=sun_body):
            seen, lit = np.maximum(normal @ view_body, 0), np.maximum(normal @ sun_body, 0)
            return seen @ piece, (seen * lit) @ piece

        (body, lit), (patch, patch_lit) = areas(normal, piece), areas(own_normal, own_piece)
        over = 1e-4 / np.sum(view**2)
        emitted = band_radiance_w_m2_sr(300.0, "A") * (0.1 * (body - patch) + 0.9 * patch) * over
        sunlight = sun_irradiance_w_m2("A") * (ASTRONOMICAL_UNIT_M / np.linalg.norm(sun)) ** 2 / np.pi
        reflected = sunlight * (0.9 * (lit - patch_lit) + 0.1 * patch_lit) * over * row["sunlit_fraction"]
        assert row["emitted_w_cm2"] == pytest.approx(emitted, rel=LIGHT_RTOL)
        assert row["sun_w_cm2"] == pytest.approx(reflected, rel=LIGHT_RTOL, abs=1e-4 * sunlight * over * body)
        assert row["projected_area_m2"] == pytest.approx(body, rel=1e-6)
        terms = [row[f"{name}_w_cm2"] for name in ("emitted", "sun", "earth", "albedo")]
        assert row["irradiance_w_cm2"] == pytest.approx(sum(terms), rel=CURVE_RTOL)


@pytest.mark.ci
def test_a_dark_half_shows_the_spin():
    """The brightest frequency of the emitted light is the spin's; a plain body shows none."""
    times_s = np.arange(0.0, 200.0, 0.5)
    half = [ws.Patch(BARE, azimuth_deg=(0.0, 180.0))]
    for patches, is_seen in ((half, True), ((), False)):
        light = curves_of(scene_of(SHAPES[0], PAINT, patches), times_s, ["sat31"])["emitted"][:, 0, 0]
        light = light / np.polyval(np.polyfit(times_s, light, 3), times_s) - 1.0
        power = np.abs(np.fft.rfft(light * np.hanning(len(light)))) ** 2
        rate = np.fft.rfftfreq(len(light), 0.5)
        assert (np.ptp(light) > 0.3) == is_seen
        assert not is_seen or abs(rate[np.argmax(power)] - 0.05) < 0.003


@pytest.mark.ci
@pytest.mark.parametrize("streaks", [True, False])
def test_exposures_average_over_the_spin(streaks):
    """Light of a frame is the mean over its exposure, of as many instants as the patch asks for."""
    nei = {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "exposure_s": 6.0, "streaks": streaks}
    half = [ws.Patch(BARE, azimuth_deg=(0.0, 180.0))]
    scene = scene_of(SHAPES[0], PAINT, half, attitude=FASTER).replace(detector=nei)
    plain = scene_of(SHAPES[0], PAINT, attitude=FASTER).replace(detector=nei)
    n_node = [len(s.scenario.instrument.exposure_rule.weight) for s in (plain, scene)]
    assert n_node[1] > n_node[0] and n_node[1] in NODE_COUNTS
    truth = ws.Renderer(scene).render(range(70, 73), SENSORS[:1], ["A"]).truth
    for row in truth:
        times_s = row["time_s"] + np.linspace(-3.0, 3.0, 241)
        light = sum(curves_of(scene.replace(detector__exposure_s=0.0), times_s, SENSORS[:1], ["A"]).values())[:, 0, 0]
        assert np.ptp(light) > 0.2 * light.max()
        assert row["irradiance_w_cm2"] == pytest.approx(np.trapezoid(light, times_s) / 6.0, rel=2 * QUADRATURE)


@pytest.mark.ci
def test_streaks_are_as_bright_from_end_to_end_as_the_body_then():
    """Brightness along a streak, by the coefficients that images are drawn with, against the light curve."""
    nei = {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "exposure_s": 6.0}
    half = [ws.Patch(BARE, azimuth_deg=(0.0, 180.0))]
    scene = scene_of(SHAPES[0], PAINT, half, attitude=FASTER).replace(detector=nei)
    frames = ws.Renderer(scene).render([70], SENSORS[:1], ["A"])
    row, brightness = frames.truth[0], frames._columns.brightness.numpy()[0, 0, 0].astype(np.float64)
    u = np.linspace(-0.95, 0.95, 39)
    times_s = row["time_s"] + 3.0 * u
    light = sum(curves_of(scene.replace(detector__exposure_s=0.0), times_s, SENSORS[:1], ["A"]).values())[:, 0, 0]
    assert np.ptp(light) > 0.2 * light.max()
    found = np.polynomial.legendre.legval(u, brightness) * row["irradiance_w_cm2"]
    np.testing.assert_allclose(found, light, rtol=0, atol=20 * QUADRATURE * light.max())


@pytest.mark.ci
def test_surfaces_by_wavelength():
    """A patch, a body, or both by wavelength, of one value each, are those of numbers."""
    half = {"azimuth_deg": (0.0, 180.0)}
    flat = [ws.Graybody(emissivity=ws.ByWavelength([0.2, 50.0], [value, value])) for value in (0.9, 0.1)]
    expected = curves_of(scene_of(SHAPES[0], BARE, [ws.Patch(PAINT, **half)]))
    for body, patch in ((BARE, flat[0]), (flat[1], PAINT), (flat[1], flat[0])):
        found = curves_of(scene_of(SHAPES[0], body, [ws.Patch(patch, **half)]))
        for name, light in expected.items():
            np.testing.assert_allclose(found[name], light, rtol=0, atol=1e-6 * light.max())


def test_kernel_holds_patches_only_where_a_target_has_some():
    for patches, expected in (((), (False, False, 0)), ([ws.Patch(BARE)], (True, True, 1))):
        field = target_field(scene_of(SHAPES[0], PAINT, patches), ["A"])
        assert (field.features.patches, field.features.meshes, field.n_patch) == expected


def test_heat_balance_takes_means_over_the_surface():
    """Half the side of a long cylinder: coefficients in between, by area; temperature as of a body with those."""
    shape = ws.Cylinder(0.1, 2.0)
    balance = ws.HeatBalance("equilibrium", mass_kg=5.0, heat_capacity_j_kg_k=900.0)
    half = [ws.Patch(BARE, azimuth_deg=(0.0, 180.0))]
    part = np.pi * 0.1 * 2.0 / shape.surface_m2
    mean = 0.9 * (1 - part) + 0.1 * part
    scenes = [
        scene_of(shape, PAINT, half, temperature=balance),
        scene_of(shape, ws.Graybody(emissivity=mean), temperature=balance),
    ]
    found, expected = (s.scenario.temperature_k("body", [0.0, 800.0]) for s in scenes)
    np.testing.assert_allclose(found, expected, rtol=0, atol=0.01)


def test_scene_files_keep_patches(tmp_path):
    patches = [
        ws.Patch(BARE, azimuth_deg=(0, 90), along=(0.1, 0.2)),
        ws.Patch(ws.Graybody(reflectance={"A": 0.3, "C": 0.1, "E": 0.2}), on="top"),
    ]
    scene = scene_of(SHAPES[0], PAINT, patches)
    scene.save(tmp_path / "scene.toml")
    assert ws.Scene.load(tmp_path / "scene.toml") == scene
    assert "\n  patches    body has 2 patches, 13 % of its surface, by 91 facets\n" in scene_report(scene.scenario)


@pytest.mark.parametrize(
    ("patch", "message"),
    [
        ({"along": [0.5, 0.5]}, "patches[0].along: must be [first, last], the first before the last, got [0.5, 0.5]"),
        ({"along": [0.5, 1.5]}, "patches[0].along[1]: must be in [0, 1], got 1.5"),
        ({"azimuth_deg": [0, 400]}, "patches[0].azimuth_deg: must be [first, last], up to 360 apart, got [0.0, 400.0]"),
        ({"on": "faces"}, "patches[0].faces: must be given"),
        ({"on": "faces", "faces": [1]}, "patches[0].on: must be one of side, top, base of a cylinder, got 'faces'"),
        ({"on": "top", "along": [0, 0.5]}, "patches[0].along: belongs to a patch on the side, got [0.0, 0.5]"),
        ({"on": "faces", "faces": [1, 2, 1]}, "patches[0].faces: must name each face once, got [1, 2, 1]"),
        ({"faces": [1]}, "patches[0].faces: belongs to a patch on 'faces', got [1]"),
        (
            {"surface": {"emissivity": {"A": 0.5}}},
            "patches[0].surface: must give reflectance or emissivity of body in every band of the scene, "
            "got none in band C",
        ),
    ],
)  # fmt: skip
def test_what_is_refused(patch, message):
    with pytest.raises(ws.InputError) as error:
        scene_of(
            {"kind": "cylinder", "radius_m": 1, "height_m": 1},
            {"emissivity": 0.5},
            [{"surface": {"emissivity": 0.1}} | patch],
        )
    assert str(error.value).endswith(f"targets[0].{message}"), error.value
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("first", "second", "is_refused"),
    [
        ({"azimuth_deg": (0, 90)}, {"azimuth_deg": (90, 360)}, False),
        ({"azimuth_deg": (0, 90)}, {"azimuth_deg": (89, 100)}, True),
        ({"azimuth_deg": (300, 400)}, {"azimuth_deg": (30, 50)}, True),
        ({"azimuth_deg": (300, 400)}, {"azimuth_deg": (50, 300)}, False),
        ({"azimuth_deg": (-10, 10)}, {"azimuth_deg": (355, 356)}, True),
        ({"along": (0, 0.5)}, {"along": (0.5, 1)}, False),
        ({}, {"on": "top"}, False),
        ({}, {}, True),
    ],
)
def test_patches_do_not_overlap(first, second, is_refused):
    def make():
        patches = [ws.Patch(BARE, **one) for one in (first, second)]
        return ws.TargetSpec("body", SHAPES[0], PAINT, ws.Temperature(300.0), patches=patches)

    if not is_refused:
        assert len(make().patches) == 2
        return
    with pytest.raises(ws.InputError, match=r"patches: patches\[0\] and patches\[1\] must not overlap"):
        make()


@pytest.mark.parametrize(
    ("shape", "part", "area_m2"),
    [
        (SHAPES[4], {"along": (0.5, 0.5 + 2.0**-40)}, np.pi * 2.0**-40),
        (SHAPES[4], {"azimuth_deg": (0.0, 1e-10)}, np.pi * 1e-10 / 360.0),
        (SHAPES[0], {"azimuth_deg": (0.0, 1e-10)}, 0.6 * np.pi * 1e-10 / 360.0),
    ],
)
def test_thin_patches_have_their_area(shape, part, area_m2):
    assert PatchArea(shape, ws.Patch(PAINT, **part)).surface_m2 == pytest.approx(area_m2, rel=1e-3)


@pytest.mark.parametrize(
    ("shape", "along"),
    [(SHAPES[4], (0.0, 1e-20)), (SHAPES[4], (0.3, 0.30000000000000004)), (SHAPES[1], (1 - 1e-16, 1.0))],
)
def test_patches_without_area_are_refused(shape, along):
    scene = scene_of(shape, PAINT, [ws.Patch(BARE, along=along)])
    with pytest.raises(ws.InputError, match=r"targets\[0\]\.patches\[0\]: must be wide enough to have an area$"):
        scene.scenario.instrument  # noqa: B018


def test_faces_that_a_mesh_does_not_have():
    scene = scene_of(WEDGE, PAINT, [ws.Patch(BARE, on="faces", faces=(1, 4))])
    with pytest.raises(
        ws.InputError, match=r"targets\[0\]\.patches\[0\]\.faces: must be below 4, the number of faces, got 4"
    ):
        scene.scenario.instrument  # noqa: B018


@pytest.mark.ci
@pytest.mark.parametrize(
    "detector",
    [
        {},
        slow({"exposure_s": 0.5}),
        slow({"exposure_s": 0.5, "line_time_s": 1e-3}),
    ],
    ids=str,
)
def test_a_group_of_painted_bodies_is_that_of_the_paint(detector):
    """Thirty targets, some of them painted all over, some in part with what they have, some spread."""
    day = ws.Scene.load("stss").replace(epoch_utc="2025-06-21T18:00:00", sky__catalog="none")
    day = day.replace(targets__2__spread={"shape.radius_m": {"uniform": [0.2, 0.3]}})
    day = day.replace(**{f"detector__{name}": value for name, value in detector.items()})
    names, frames = day.sensor_names[6:9], range(80, 84)
    other = {1: ws.Graybody(emissivity=0.5), 2: ws.Graybody(reflectance={"A": 0.2, "C": 0.4, "E": 0.6})}
    same = [ws.Patch(day.targets[3].surface, along=(0.2, 0.4), azimuth_deg=(-20.0, 90.0))]
    painted = day.replace(
        targets__1__patches=[ws.Patch(other[1])],
        targets__2__patches=[ws.Patch(other[2], **part) for part in ALL["cylinder"]],
        targets__3__patches=same,
    )
    plain = day.replace(targets__1__surface=other[1], targets__2__surface=other[2])
    found, expected = (ws.Renderer(scene).render(frames, names, keep_signal=True) for scene in (painted, plain))
    for name in ("irradiance_w_cm2", "emitted_w_cm2", "sun_w_cm2", "earth_w_cm2", "albedo_w_cm2", "projected_area_m2"):
        ours, theirs = (np.asarray(both.truth[name]) for both in (found, expected))
        assert np.nanmax(theirs) > 0
        np.testing.assert_allclose(ours, theirs, rtol=3 * LIGHT_RTOL, atol=LIGHT_RTOL * np.nanmax(theirs))
    ours, theirs = (both.signal_w_cm2.numpy() for both in (found, expected))
    assert theirs.max() > 0
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=3 * LIGHT_RTOL * theirs.max())
