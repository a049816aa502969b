"""Surfaces by band and by wavelength: what is refused, emission and reflection against scipy, rendering, files."""

import copy
import hashlib
import pickle
from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from astropy.table import Table
from on_devices import launched, radiance_kernel
from refusals import refused_in_one_line
from scipy.integrate import quad

import warpsim as ws
from warpsim.radiometry.sun_and_earth import earth_spectrum, solar_spectrum
from warpsim.render.target_field import make_radiance
from warpsim.scene.provenance import input_checksums
from warpsim.target.heat_balance import surface_coefficients

KIRCHHOFF = 1e-15
RENDERED_RTOL = 1e-6  # truth holds float32 irradiances

BY_BAND = {"A": 0.9, "C": 0.85, "E": 0.8}


def test_one_number_holds_in_all_bands():
    for surface in (ws.Graybody(reflectance=0.9), ws.Graybody(emissivity=0.1), ws.Graybody(0.9, 0.1)):
        for band in ws.BANDS:
            assert surface.emissivity_in(band) == pytest.approx(0.1, abs=KIRCHHOFF)
            assert surface.reflectance_in(band) == pytest.approx(0.9, abs=KIRCHHOFF)
    assert ws.Graybody(emissivity=0.1).emissivity_in("A") == 0.1  # as given, not 1 - (1 - 0.1)


def test_tables_by_band_and_mixtures():
    surface = ws.Graybody(reflectance=BY_BAND)
    assert [band for band in ws.BANDS if surface.describes(band)] == ["A", "C", "E"]
    for band, reflectance in BY_BAND.items():
        assert surface.reflectance_in(band) == reflectance
        assert surface.emissivity_in(band) == pytest.approx(1 - reflectance, abs=KIRCHHOFF)
    mixed = ws.Graybody(reflectance={"A": 0.9}, emissivity={"C": 0.3, "A": 0.1})
    assert (mixed.reflectance_in("C"), mixed.emissivity_in("A")) == (0.7, 0.1)
    assert [band for band in ws.BANDS if mixed.describes(band)] == ["A", "C"]
    one_and_table = ws.Graybody(reflectance=0.9, emissivity={"C": 0.1})
    assert all(one_and_table.describes(band) for band in ws.BANDS)
    with pytest.raises(ws.InputError, match="must give reflectance or emissivity in band E, got them in A, C"):
        mixed.emissivity_in("E")


def test_tables_do_not_change_and_can_be_keys():
    given = dict(BY_BAND)
    surface = ws.Graybody(reflectance=given)
    given["A"] = 0.0
    assert surface == ws.Graybody(reflectance=BY_BAND)
    assert hash(surface) == hash(ws.Graybody(reflectance=dict(reversed(BY_BAND.items()))))
    assert surface != ws.Graybody(reflectance={**BY_BAND, "A": 0.5})
    with pytest.raises(TypeError):
        surface.reflectance["A"] = 1.0
    assert pickle.loads(pickle.dumps(surface)) == copy.deepcopy(surface) == surface


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "give reflectance or emissivity"),
        ({"reflectance": 1.1}, r"reflectance: must be in \[0, 1\], got 1.1"),
        ({"emissivity": -0.1}, r"emissivity: must be in \[0, 1\], got -0.1"),
        ({"reflectance": float("nan")}, "reflectance: must be finite, got nan"),
        ({"reflectance": "bright"}, "reflectance: must be a number, got 'bright'"),
        ({"reflectance": [0.1]}, "reflectance: must be a number"),
        ({"reflectance": True}, "reflectance: must be a number, got True"),
        ({"reflectance": {}}, "reflectance: must be a number or a table that names a band"),
        ({"reflectance": {"A": 1.5}}, r"reflectance: A: must be in \[0, 1\], got 1.5"),
        ({"reflectance": {"A": 0.5, "C": "x"}}, "reflectance: C: must be a number, got 'x'"),
        ({"emissivity": {"F ": 0.5}}, "emissivity: must be a table of numbers by names of bands, got {'F ': 0.5}"),
        ({"reflectance": 0.9, "emissivity": 0.2}, r"reflectance: must be 1 \(opaque graybody\), got 1.1"),
        ({"reflectance": BY_BAND, "emissivity": {"E": 0.1}}, r"must be 1 \(opaque graybody\) in band E, got 0.9"),
        ({"reflectance": 0.9, "emissivity": {"D": 0.2}}, r"must be 1 \(opaque graybody\) in band D, got 1.1"),
    ],
)
def test_bad_surfaces_are_refused_in_one_line(fields, message):
    with refused_in_one_line(message):
        ws.Graybody(**fields)


def test_every_band_of_the_scene_must_be_covered(scene):
    with pytest.raises(ws.InputError, match=r"targets\[1\]\.surface: .* of sphere in every band .* none in band C"):
        scene.replace(targets__1__surface={"reflectance": {"A": 0.9, "E": 0.9}})
    (group,) = scene.to_dict()["groups"]
    other = {**group["targets"][0], "name": "other", "surface": {"emissivity": {"A": 0.5}}}
    second = {"name": "second", "trajectory": group["trajectory"], "targets": [other]}
    with pytest.raises(ws.InputError, match=r"groups\[1\]\.targets\[0\]\.surface: .* of other .* none in band C"):
        scene.replace(groups=[group, second])
    assert scene.replace(bands=["A"], targets__1__surface={"reflectance": {"A": 0.9}}).bands == ("A",)


@pytest.mark.parametrize("ending", ["toml", "json"])
def test_scenes_with_tables_by_band_load_back_equal(scene, tmp_path, ending):
    tabled = scene.replace(targets__0__surface={"reflectance": BY_BAND})
    tabled.save(tmp_path / f"s.{ending}")
    assert ws.Scene.load(tmp_path / f"s.{ending}") == tabled
    assert tabled.to_dict()["groups"][0]["targets"][0]["surface"] == {"reflectance": BY_BAND}


def test_each_band_is_rendered_with_its_own_emissivity(scene, device):
    """Light of a target is proportional to its emissivity in the band, whatever it is in the others."""
    tabled = scene.replace(targets__0__surface={"emissivity": {"A": 0.3, "C": 0.6, "E": 1.0}}, sky__catalog="none")
    plain = scene.replace(targets__0__surface={"emissivity": 1.0}, sky__catalog="none")
    light = [ws.Renderer(s, device=device).render([60], ["sat11"], ["E", "A", "C"]).truth for s in (tabled, plain)]
    ours = [table[table["target"] == "center"] for table in light]
    share = np.array(ours[0]["emitted_w_cm2"] / ours[1]["emitted_w_cm2"])
    np.testing.assert_allclose(share, [1.0, 0.3, 0.6], rtol=RENDERED_RTOL)


QUAD_RTOL = 1e-6
GRAY_RTOL = 1e-12  # a constant curve against the gray surface, both in float64
TABLE_RTOL = 1e-8  # the device's table in ln(T)

PAINT = {
    "wavelength_um": [0.3, 0.45, 2.5, 4.0, 8.0, 9.2, 12.0, 25.0],
    "value": [0.9, 0.2, 0.3, 0.7, 0.92, 0.75, 0.9, 0.8],
}
WHITE = ws.Graybody(emissivity=PAINT)
MIRROR = ws.Graybody(reflectance={"wavelength_um": [0.2, 1.0, 20.0], "value": [0.5, 0.95, 0.99]})
BANDS = [
    ws.BANDS["A"],
    ws.BANDS["E"],
    ws.Band.top_hat("mwir", 3.5, 5.0),
    ws.Band("visible", [0.4, 0.6, 0.9], [0.3, 1.0, 0.2], per_photon=True),
]
each_band = pytest.mark.parametrize("band", BANDS, ids=lambda band: band.name)


def planck(um, kelvin):
    """Written out with constants of its own [W/m2/sr/um]."""
    return 1.191042972e8 / um**5 / np.expm1(14387.76877 / (um * kelvin))


def emissivity(um):
    return np.interp(um, PAINT["wavelength_um"], PAINT["value"])


def mean(value, weight, band, *nodes):
    """Mean of a function of wavelength over a band, piece by piece, with an energy response and a weight."""
    edges = np.unique(np.concatenate([band.wavelength_um, PAINT["wavelength_um"], *nodes]))
    edges = edges[(edges >= band.wavelength_um[0]) & (edges <= band.wavelength_um[-1])]
    totals = np.zeros(2)
    for a, b in pairwise(edges):
        for k, factor in enumerate((value, lambda um: 1.0)):
            totals[k] += quad(
                lambda um, of=factor: of(um) * weight(um) * float(band.energy_response(um)), a, b, epsabs=0, epsrel=1e-9
            )[0]
    return totals[0] / totals[1]


@each_band
@pytest.mark.parametrize("temperature_k", [220.0, 300.0, 450.0])
def test_emissivity_in_a_band(band, temperature_k, record_accuracy):
    expected = mean(emissivity, lambda um: planck(um, temperature_k), band)
    error = abs(WHITE.emissivity_in(band, temperature_k) / expected - 1)
    record_accuracy("Emissivity by wavelength, in a band", error, QUAD_RTOL, "of it", "scipy")
    radiance = WHITE.emitted_w_m2_sr([temperature_k, temperature_k], band)
    assert radiance[0] == pytest.approx(expected * ws.band_radiance_w_m2_sr(temperature_k, band), rel=QUAD_RTOL, abs=0)


@each_band
@pytest.mark.parametrize("light", ["sun", "earth", "albedo"])
def test_reflectance_in_a_band(band, light, record_accuracy):
    sun, earth = solar_spectrum(), earth_spectrum()
    weights = {
        "sun": lambda um: np.interp(um, *sun),
        "earth": lambda um: planck(um, earth.brightness_temperature_k.at(um)),
        "albedo": lambda um: np.interp(um, *sun) * earth.albedo.at(um),
    }
    nodes = (sun.wavelength_um, earth.albedo.wavelength_um)
    expected = mean(lambda um: 1.0 - emissivity(um), weights[light], band, *nodes)
    error = abs(WHITE.reflectance_in(band, light) / expected - 1)
    record_accuracy("Reflectance by wavelength, in a band", error, QUAD_RTOL, "of it", "scipy")


@each_band
def test_a_constant_curve_is_gray(band):
    gray = ws.Graybody(emissivity=0.37)
    flat = ws.Graybody(emissivity={"wavelength_um": [1.0, 20.0], "value": [0.37, 0.37]})
    for temperature_k in (200.0, 330.0):
        assert flat.emissivity_in(band, temperature_k) == pytest.approx(0.37, rel=GRAY_RTOL, abs=0)
        np.testing.assert_allclose(
            flat.emitted_w_m2_sr(temperature_k, band), gray.emitted_w_m2_sr(temperature_k, band), rtol=GRAY_RTOL
        )
    for light in ("sun", "earth", "albedo"):
        assert flat.reflectance_in(band, light) == pytest.approx(0.63, rel=GRAY_RTOL, abs=0)


def test_it_serves_any_band_and_its_emissivity_follows_the_temperature():
    wide = ws.Band.top_hat("wide", 3.0, 14.0)
    assert WHITE.describes(wide)
    assert WHITE.describes("A")
    assert WHITE.emissivity_in(wide, 1500.0) < WHITE.emissivity_in(wide, 250.0) - 0.1
    assert WHITE.emissivity_in("A", 300.0) == WHITE.emissivity_in(ws.BANDS["A"], 300.0)
    far = ws.Band.top_hat("far", 200.0, 300.0)  # beyond the Sun's spectrum: the last value
    assert WHITE.reflectance_in(far, "sun") == pytest.approx(0.2, rel=1e-12, abs=0)
    with pytest.raises(ws.InputError, match="temperature_k: must be given for a surface by wavelength"):
        WHITE.emissivity_in("A")


def test_the_device_has_a_row_for_each_band_and_surface(device, record_accuracy):
    table = make_radiance(BANDS[:3], (150.0, 600.0), wp.get_device(device), [WHITE, MIRROR])
    kelvin = np.random.default_rng(8).uniform(150.0, 600.0, 200)
    (found,) = launched(radiance_kernel, (9, 200), [table, kelvin], [wp.float64], device)
    expected = [ws.band_radiance_w_m2_sr(kelvin, band) for band in BANDS[:3]]
    expected += [surface.emitted_w_m2_sr(kelvin, band) for surface in (WHITE, MIRROR) for band in BANDS[:3]]
    error = np.abs(found / np.array(expected) - 1).max()
    record_accuracy("Emission by wavelength, in the kernel", error, TABLE_RTOL, "of it", "the integral")


@pytest.fixture(scope="module")
def day(scene):
    """The paper's scene in sunlight, without stars."""
    return scene.replace(epoch_utc="2025-03-20T18:00:00", sky__catalog="none")


def curves(scene, device):
    return ws.light_curves(scene, np.linspace(300, 1200, 4), ["sat11", "sat47"], device=device)


@pytest.mark.ci
def test_each_term_of_a_scene(day, device):
    """A black and a mirror body tell emission and reflection apart; gray targets beside are as they were."""
    painted, black = (
        day.replace(targets__0__surface=surface) for surface in ({"emissivity": PAINT}, {"emissivity": 0.5})
    )
    found, gray = curves(painted, device), curves(black, device)
    main = found.targets.index("center")
    seen = ~found.occulted[..., main] & ~found.absent[..., main]
    assert seen.sum() > 3
    ratio = {name: found.terms_w_cm2[name] / np.maximum(gray.terms_w_cm2[name], 1e-300) for name in found.terms_w_cm2}
    for k, name in enumerate(found.bands):
        kelvin = found.temperature_k[..., main][seen]
        expected = [WHITE.emissivity_in(name, one) / 0.5 for one in kelvin]
        np.testing.assert_allclose(ratio["emitted"][:, :, k, main][seen], expected, rtol=TABLE_RTOL)
        for light in ("sun", "earth", "albedo"):
            lit = seen & (gray.terms_w_cm2[light][:, :, k, main] > 0)
            expected = WHITE.reflectance_in(name, light) / 0.5
            np.testing.assert_allclose(ratio[light][:, :, k, main][lit], expected, rtol=1e-10)
    assert len(set(found.temperature_k[..., main][seen].round(3))) > 2
    for name, values in found.terms_w_cm2.items():
        others = np.delete(np.arange(len(found.targets)), main)
        np.testing.assert_array_equal(values[..., others], gray.terms_w_cm2[name][..., others])


@pytest.mark.ci
def test_a_band_of_the_scene(day, device):
    """A paint, the Sun and the Earth in a band that the scene describes: no table names it."""
    mwir = ws.Band.top_hat("mwir", 3.5, 5.0)
    own = day.replace(bands=[mwir], targets__0__surface={"emissivity": PAINT})
    gray = day.replace(bands=[mwir], targets__0__surface={"emissivity": 0.5})
    found, plain = (curves(scene, device) for scene in (own, gray))
    main = found.targets.index("center")
    seen = ~found.occulted[..., main] & ~found.absent[..., main]
    kelvin = found.temperature_k[..., main][seen]
    expected = [WHITE.emissivity_in(mwir, one) / 0.5 for one in kelvin]
    for light, ratio in (("emitted", expected), ("sun", WHITE.reflectance_in(mwir, "sun") / 0.5)):
        part = found.terms_w_cm2[light][:, :, 0, main][seen] / plain.terms_w_cm2[light][:, :, 0, main][seen]
        np.testing.assert_allclose(part, ratio, rtol=TABLE_RTOL)


@pytest.mark.ci
def test_a_painted_target_is_rendered(day, device):
    """Images, truth and light curves agree; two targets of one paint share its rows."""
    painted = day.replace(
        targets__0__surface={"emissivity": PAINT},
        targets__1__surface={"emissivity": PAINT},
        lighting__leave_out_nei=0.0,
    )
    frames = ws.Renderer(painted, device=device).render([60], ["sat11"], keep_signal=True)
    plain = ws.Renderer(day, device=device).render([60], ["sat11"], keep_signal=True)
    light = ws.light_curves(painted, [float(frames.truth["time_s"][0])], ["sat11"], device=device)
    for row in frames.truth:
        index = (0, 0, light.bands.index(row["band"]), light.targets.index(row["target"]))
        assert row["irradiance_w_cm2"] == pytest.approx(light.irradiance_w_cm2[index], rel=RENDERED_RTOL, abs=0)
    signal, before = (np.asarray(f.signal_w_cm2.numpy(), dtype=np.float64) for f in (frames, plain))
    change = frames.truth["irradiance_w_cm2"] - plain.truth["irradiance_w_cm2"]
    inside = np.array(frames.truth["in_fov"])
    assert abs(change[inside]).max() > 0
    for k, band in enumerate(frames.bands):
        rows = inside & (frames.truth["band"] == band)
        total = (signal - before)[0, 0, k].sum()
        assert total == pytest.approx(change[rows].sum(), rel=0.05, abs=1e-18)  # light beyond the frame's edge


@pytest.mark.parametrize("ending", ["toml", "json"])
def test_scenes_load_back_equal(scene, tmp_path, ending):
    painted = scene.replace(targets__0__surface={"emissivity": PAINT}, targets__1__surface=MIRROR)
    painted.save(tmp_path / f"s.{ending}")
    assert ws.Scene.load(tmp_path / f"s.{ending}") == painted
    assert painted.to_dict()["groups"][0]["targets"][0]["surface"] == {"emissivity": PAINT}
    assert pickle.loads(pickle.dumps(WHITE)) == WHITE
    assert hash(WHITE) == hash(ws.Graybody(emissivity=ws.ByWavelength(**PAINT)))


@pytest.fixture
def paint_file(tmp_path):
    """The paint as a file in nm and per cent."""
    path = tmp_path / "paint.ecsv"
    table = Table({"wavelength": 1e3 * np.array(PAINT["wavelength_um"]), "emissivity": 1e2 * np.array(PAINT["value"])})
    table["wavelength"].unit, table["emissivity"].unit = "nm", "%"
    table.write(path)
    return path


def test_a_file_is_the_same_as_its_nodes(scene, paint_file, tmp_path):
    filed = scene.replace(targets__0__surface={"emissivity": {"file": str(paint_file)}})
    surface = filed.groups[0].targets[0].surface
    for band in BANDS:
        assert surface.emissivity_in(band, 300.0) == pytest.approx(WHITE.emissivity_in(band, 300.0), rel=1e-12, abs=0)
    filed.save(tmp_path / "s.toml")
    assert 'file = "paint.ecsv"' in (tmp_path / "s.toml").read_text()
    assert ws.Scene.load(tmp_path / "s.toml") == filed
    assert input_checksums(filed.scenario) == {str(paint_file): hashlib.sha256(paint_file.read_bytes()).hexdigest()}


def test_a_scene_with_a_file_is_made_without_reading_it(scene, tmp_path):
    lost = scene.replace(targets__0__surface={"reflectance": {"file": str(tmp_path / "lost.csv")}})
    with pytest.raises(ws.InputError, match=r"targets\[0\]\.surface: .*lost\.csv: cannot be read: No such file"):
        _ = lost.scenario


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("wavelength,reflectance\n1,0.5\n2,0.6\n", "column wavelength: must state its unit"),
        ("wavelength_um,reflectance\n1,0.5\n2,1.6\n", r"must hold fractions from 0 to 1, got 1.6"),
        ("wavelength_um,reflectance\n2,0.5\n1,0.6\n", "must increase"),
        ("wavelength_um,a,b\n1,0.5,1\n2,0.6,1\n", "must have one column of values"),
    ],
    ids=["no-unit", "above-1", "unsorted", "two-columns"],
)
def test_bad_files_are_refused_in_one_line(scene, tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    bad = scene.replace(targets__0__surface={"reflectance": {"file": str(path)}})
    with refused_in_one_line(rf"targets\[0\]\.surface: .*bad\.csv: .*{message}"):
        _ = bad.scenario


def test_a_column_of_a_file_with_several(tmp_path):
    path = tmp_path / "two.csv"
    path.write_text("wavelength_um,white,black\n1,0.5,1\n2,0.6,1\n")
    surface = ws.Graybody(emissivity={"file": path, "column": "black"})
    assert surface.emissivity_in("A", 300.0) == pytest.approx(1.0, rel=1e-15, abs=0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"wavelength_um": [1.0, 2.0]}, "emissivity: wavelength_um, value: both must be given"),
        ({"value": [0.1, 0.2]}, "emissivity: wavelength_um, value: both must be given"),
        ({"wavelength_um": [1.0, 2.0], "value": [0.1, 1.2]}, r"emissivity.value\[1\]: must be in \[0, 1\], got 1.2"),
        ({"wavelength_um": [1.0, 2.0], "value": [0.1] * 3}, "emissivity.value: must be as long as wavelength_um"),
        ({"wavelength_um": [2.0, 1.0], "value": [0.1, 0.2]}, "emissivity.wavelength_um: must increase, got 2 then 1"),
        ({"wavelength_um": [0.0, 1.0], "value": [0.1, 0.2]}, "emissivity.wavelength_um: must be > 0, got 0"),
        ({"wavelength_um": [1.0], "value": [0.1]}, "must be a vector of at least 2 nodes"),
        ({"wavelength_um": [1.0, float("nan")], "value": [0.1, 0.2]}, r"wavelength_um\[1\]: must be finite, got nan"),
        ({"file": "a.csv", "value": [0.1]}, "exactly one of a file, or wavelength_um with value, must be given"),
        ({**PAINT, "column": "b"}, "emissivity.column: belongs to a file"),
        ({**PAINT, "kind": "x"}, "emissivity.kind: is not a known field"),
    ],
    ids=range(11),
)
def test_bad_nodes_are_refused_in_one_line(given, message):
    with refused_in_one_line(message):
        ws.Graybody(emissivity=given)


def test_only_one_of_both_is_given_by_wavelength():
    for other in (0.5, PAINT, {"A": 0.5}):
        with pytest.raises(ws.InputError, match="one of them must be given where it is by wavelength"):
            ws.Graybody(emissivity=PAINT, reflectance=other)


def test_a_heat_balance_takes_the_coefficients_of_the_spectrum():
    """Absorptance over all sunlight and emissivity over a room's emission; the white paint is cold, the mirror hot."""
    absorptance, emitted = surface_coefficients(WHITE, ["A"])
    um = np.geomspace(0.2, 100.0, 200_001)
    expected = [
        np.trapezoid(emissivity(um) * weight, um) / np.trapezoid(weight, um)
        for weight in (np.interp(um, *solar_spectrum()), planck(um, 300.0))
    ]
    assert (absorptance, emitted) == pytest.approx(expected, rel=1e-5, abs=0)
    assert absorptance < 0.4 < 0.7 < emitted
    assert surface_coefficients(ws.Graybody(emissivity={"A": 0.2, "C": 0.4}), ["A", "C"]) == pytest.approx((0.3, 0.3))


def test_the_spread_of_members_leaves_curves_alone(scene):
    spec = scene.to_dict()["groups"][0]["targets"][1]
    spread = {**spec, "surface": {"emissivity": PAINT}, "spread": {"temperature.start_k": {"normal": [300.0, 5.0]}}}
    targets = [scene.to_dict()["groups"][0]["targets"][0], spread]
    painted = scene.replace(targets=targets)
    assert {target.spec.surface for target in painted.scenario.targets[1:]} == {WHITE}


def test_a_surface_too_cold_to_emit_has_the_emissivity_of_the_longest_wavelength():
    paint = ws.Graybody(emissivity={"wavelength_um": [0.4, 0.6, 0.8], "value": [0.2, 0.4, 0.9]})
    green = ws.Band.top_hat("green", 0.5, 0.6)
    assert paint.emissivity_in(green, 3.0) == pytest.approx(0.4, rel=1e-12)
    warming = [paint.emissivity_in(green, temperature_k) for temperature_k in (3.0, 40.0, 60.0, 100.0)]
    offsets = 0.4 - np.array(warming[1:])  # grow as kT, the slope being constant there
    np.testing.assert_allclose(offsets / [40.0, 60.0, 100.0], offsets[0] / 40.0, rtol=2e-2)
    assert paint.emitted_w_m2_sr(3.0, green) == 0.0
