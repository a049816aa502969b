"""What `warpsim check` says: stars with light, their positions and effects left out, constraints, bands."""

import math
import re

import numpy as np
import pytest
from scipy import integrate

import warpsim as ws
from warpsim.constants import PLANCK_J_S, SPEED_OF_LIGHT_M_S
from warpsim.orbit.access_constraints import MARGIN_NAMES
from warpsim.output.check import scene_report
from warpsim.output.check_sensor import RULE_NAMES, mean_photon_j
from warpsim.radiometry.band import AB_ZERO_JY
from warpsim.sky.star_counts import complete_to

QUADRATURE_RTOL = 1e-9
TWO_DIGITS = 0.051
"""Numbers are printed with two digits."""
SIZE = r"\((?P<arcsec>[-+.\de]+) arcsec, (?P<px>[-+.\de]+) px(?P<note>[^)]*)\)"

CAMERAS = {
    # changes, and arcsec per pixel by hand: at the centre, across columns; 64 px / tan(0.5 deg) = 7333.6 px
    "paper": ({}, 28.126),
    "lens": ({"camera": {"n_row": 50, "n_col": 100, "focal_length_m": 2.0, "pixel_pitch_m": 2e-5}}, 2.0626),
}
NEAR_STARS = "ra_deg,dec_deg,parallax_mas,flux_A_jy\n10,20,3.5,1\n30,-40,412.0,2\n50,60,-900.0,3\n70,80,,4\n"


@pytest.fixture
def near_stars(tmp_path):
    path = tmp_path / "near.csv"
    path.write_text(NEAR_STARS)
    return str(path)


def line(report, name):
    """What follows a word at the start of a line of a report; None where there is no such line."""
    found = re.findall(rf"^  {name} +(.*)$", report, flags=re.MULTILINE)
    assert len(found) < 2
    return found[0] if found else None


def left_out(report):
    """Sizes of the effects left out: arcsec, px, and the words after them."""
    text = line(report, "positions").split("; left out: ")[1]
    sizes = re.finditer(rf"(?P<effect>[a-z ]+) {SIZE}", text)
    return {
        match["effect"].strip(): (float(match["arcsec"]), float(match["px"]), match["note"].strip()) for match in sizes
    }


@pytest.mark.parametrize(("changes", "arcsec_per_px"), CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("exclusion_deg", [0.0, 20.0, 60.0, 90.0])
def test_sizes_of_what_is_left_out(scene, near_stars, changes, arcsec_per_px, exclusion_deg):
    described = scene.replace(
        **changes, access_rules__min_solar_exclusion_deg=exclusion_deg, sky={"catalog": near_stars, "aberration": False}
    )
    report = scene_report(described.scenario)
    assert f"{arcsec_per_px:.2f} arcsec per pixel" in line(report, "camera")
    # At the limb, 1.75 arcsec; elsewhere 4.07 mas / tan(angle / 2).
    deflection = 4.07e-3 / math.tan(math.radians(exclusion_deg) / 2) if exclusion_deg else 1.75
    where = f"{exclusion_deg:g} deg from the Sun" if exclusion_deg else "at the Sun's limb"
    expected = {
        "aberration": (26.0, ""),
        "parallax": (0.412, "for the nearest star"),
        "light deflection": (deflection, where),
    }
    sizes = left_out(report)
    assert list(sizes) == list(expected)
    for effect, (arcsec, note) in expected.items():
        assert sizes[effect][0] == pytest.approx(arcsec, rel=TWO_DIGITS), effect
        assert sizes[effect][1] == pytest.approx(arcsec / arcsec_per_px, rel=TWO_DIGITS), effect
        assert sizes[effect][2] == note


def test_deflection_at_the_papers_exclusion(scene):
    """7.05 mas at 60 degrees, by hand, and the nearest star of the embedded catalog: Rigil Kentaurus, 0.75 to 0.8."""
    sizes = left_out(scene_report(scene.scenario))
    assert list(sizes) == ["parallax", "light deflection"]
    assert sizes["light deflection"][0] == pytest.approx(0.00705, rel=TWO_DIGITS)
    assert 0.7 < sizes["parallax"][0] < 0.85


EFFECTS = ["aberration", "parallax", "light deflection"]


@pytest.mark.parametrize(
    "on", [[], ["parallax"], ["aberration", "light deflection"], ["aberration", "parallax", "light deflection"]]
)
def test_every_effect_is_included_or_left_out(scene, near_stars, on):
    switches = {effect.replace(" ", "_"): effect in on for effect in EFFECTS}
    report = scene_report(scene.replace(sky={"catalog": near_stars, **switches}).scenario)
    places = line(report, "positions")
    included, rest = places.split("; left out: ")
    assert included.split(", ") == ["proper motion", *on]
    if len(on) == 3:
        assert rest == "nothing"
    else:
        assert list(left_out(report)) == [effect for effect in EFFECTS if effect not in on]


def test_without_parallaxes_none_is_left_out(scene):
    made_up = scene.replace(sky={"catalog": "synthetic", "synthetic": {"n_star": 10}})
    assert list(left_out(scene_report(made_up.scenario))) == ["light deflection"]


def test_the_papers_physics_is_named(scene):
    assert "the paper's physics" not in scene_report(scene.scenario)
    assert line(scene_report(scene.replace(sky__physics="paper").scenario), "sky").endswith(", the paper's physics")


NO_LIGHT = "no star of the catalog gives light in these bands"


@pytest.mark.parametrize("flux", ["0", ""], ids=["dark", "unknown"])
def test_a_catalog_without_light_is_warned_of(scene, tmp_path, flux):
    path = tmp_path / "dark.csv"
    path.write_text(f"ra_deg,dec_deg,flux_A_jy\n10,20,{flux}\n30,40,{flux}\n")
    report = scene_report(scene.replace(sky__catalog=str(path)).scenario)
    assert "2 stars, with light in band A 0, C 0, E 0" in line(report, "sky")
    assert line(report, "warning") == NO_LIGHT


def test_light_in_one_band_is_enough(scene, tmp_path):
    path = tmp_path / "red.csv"
    path.write_text("ra_deg,dec_deg,flux_A_jy,flux_C_jy,flux_E_jy\n10,20,0,0,1\n30,40,0,0,0\n50,60,0,2,3\n")
    report = scene_report(scene.replace(sky__catalog=str(path)).scenario)
    assert "3 stars, with light in band A 0, C 1, E 2" in line(report, "sky")
    assert NO_LIGHT not in report


def test_a_sky_without_stars_is_no_fault(scene):
    report = scene_report(scene.replace(sky__catalog="none").scenario)
    assert "0 stars" in line(report, "sky")
    assert line(report, "positions") is None
    assert NO_LIGHT not in report


@pytest.mark.ci
def test_the_rule_that_is_broken_is_named(scene):
    """Each rule has words of its own, and a rule that nothing keeps is broken in every frame."""
    words = {
        "min_range_km": (50_000.0, "too near"),
        "max_elevation_deg": (-89.0, "too high"),
        "min_background_altitude_km": (5_000.0, "against the Earth or too low over it"),
    }
    for field, (limit, name) in words.items():
        report = scene_report(scene.replace(access_rules={field: limit}).scenario)
        assert f"{name} 100%" in line(report, "no access")
    assert set(MARGIN_NAMES) == set(RULE_NAMES)


def test_pointing_is_reported_with_the_views_that_have_the_target(scene):
    report = scene_report(scene.scenario)
    assert line(report, "pointing") == "tracks main, zenith up"
    assert line(report, "in field") == "center in 587 of 587 views"
    jitter = {"rms_urad": 5.0, "correlation_s": 1.0}
    away = scene.replace(pointing={"kind": "fixed", "ra_dec_deg": [10.0, 10.0], "jitter": jitter})
    report = scene_report(away.scenario)
    assert line(report, "pointing") == "fixed, zenith up, jitter 5 urad (rms)"
    assert line(report, "in field") == "center in 0 of 587 views"
    assert "warning    no view has center in the field" in report


@pytest.mark.ci
def test_light_and_heat_are_reported(scene):
    report = scene_report(scene.scenario)
    assert re.search(r"light      sun: kept: up to \S+ NEI", report)
    assert "exposure" not in report
    balance = {"kind": "heat_balance", "start_k": 300.0, "mass_kg": 10.0, "heat_capacity_j_kg_k": 900.0}
    heated = scene.replace(targets__0__temperature=balance, detector__exposure_s=0.02, lighting__albedo=False)
    report = scene_report(heated.scenario)
    assert "light      albedo: off" in report
    assert re.search(r"exposure   0.02 s at \d+ instants, error \de-0\d", report)
    assert re.search(r"heat       center: [\d.]+ to [\d.]+ K, error \S+ K", report)


@pytest.mark.ci
def test_rows_read_in_turn_are_reported(scene):
    """The stars' shift is that of the streaks of an exposure over its rows; long times between rows are warned of."""
    report = scene_report(scene.replace(detector__line_time_s=1e-3, detector__exposure_s=0.1).scenario)
    assert "pixels     0.001 s from row to row" in report
    streak_px, row_px = (
        float(re.search(rf"{words} stars (?:move )?up to (\S+) px", report)[1])
        for words in ("streaks   ", "0.128 s for all rows; from row to row")
    )
    assert row_px == pytest.approx(streak_px / 100, rel=0.1)
    assert "images of sources are drawn as of one time" not in report
    slow = scene_report(scene.replace(detector__line_time_s=-0.02).scenario)
    assert "images of sources are drawn as of one time" in slow
    assert "streaks" not in slow


def test_reasons_without_access_are_of_what_a_sensor_tracks(scene):
    """The other group is too far from all sensors; the first, which no sensor tracks, breaks no rule."""
    far = {
        "name": "far",
        "trajectory": {"kind": "elements", "altitude_km": 36000.0, "inclination_deg": 0.0},
        "targets": [{**scene.to_dict()["groups"][0]["targets"][0], "name": "moon"}],
        "exists_s": [0.0, 807.0],
    }
    looking = scene.replace(
        groups=[scene.to_dict()["groups"][0], far],
        access_rules={"max_range_km": 20000.0},
        sensors__0__pointing={"track": "moon"},
    )
    reasons = line(scene_report(looking.scenario), "no access")
    n_frame = looking.frames.count
    n_there = sum(looking.frames.start_s + k * looking.frames.interval_s <= 807.0 for k in range(n_frame))
    assert f"too far {n_there / n_frame:.0%}" in reasons and f"absent {1 - n_there / n_frame:.0%}" in reasons


def test_a_converter_that_ends_below_sei_is_noted(scene):
    """16,383 counts less the offset of 100 at 5 counts per NEI are 3,256.6 NEI, 54 % of 6,000."""
    noted = "the converter ends below SEI, at 54 % of it in band A: pixels saturate there"
    detector = {"nei_w_cm2": {"A": 5e-19, "C": 1e-18, "E": 1e-18}, "sei_w_cm2": 3e-15}
    report = scene_report(scene.replace(detector=detector).scenario)
    assert line(report, "note") == noted
    assert "converter" not in scene_report(scene.scenario)


# --- bands ---


@pytest.mark.parametrize("per_photon", [False, True])
def test_zero_point_and_photons_against_quadrature(per_photon):
    band = ws.Band.top_hat("x", 0.4, 0.9, per_photon=per_photon)
    light_um_s = SPEED_OF_LIGHT_M_S * 1e6

    def mean(function):
        return integrate.quad(lambda um: function(um) * band.energy_response(um), 0.4, 0.9, epsabs=0, epsrel=1e-11)[0]

    ab_w_cm2 = mean(lambda um: AB_ZERO_JY * 1e-26 * light_um_s / um**2) * 1e-4
    assert band.ab_zero_mag_w_cm2 == pytest.approx(ab_w_cm2, rel=QUADRATURE_RTOL)
    photon_j = PLANCK_J_S * light_um_s * mean(lambda um: 1.0) / mean(lambda um: um)
    assert mean_photon_j(band) == pytest.approx(photon_j, rel=QUADRATURE_RTOL)


def test_each_band_has_its_lines():
    scene = ws.Scene.load("stss").replace(bands=["A", "C"], detector__nei_w_cm2=2e-18)
    text = scene_report(scene.scenario)
    assert "  band       A: 6.8 to 10.8 um at half power, response by energy, mean photon " in text
    assert "magnitude 0 is 8.196e-16 W/cm2, 58.49 Jy" in text
    counts = [int(n.replace(",", "")) for n in re.search(r"stars ([\d,]+) above 1 NEI", text).groups()]
    in_nei = ws.StarCatalog.default().irradiance_w_cm2("A") / 2e-18
    assert counts == [np.count_nonzero(in_nei >= 1)]
    complete = f"complete to {complete_to(in_nei):.2g} NEI"
    assert f"{counts[0] / (360**2 / np.pi):.3g} per deg2 above the noise; {complete}\n" in text


@pytest.mark.ci
def test_stars_are_complete_to_the_same_irradiance_whatever_other_bands_add():
    def ends(*bands: str) -> list[str]:
        surface = {f"targets__{k}__surface": {"reflectance": 0.5} for k in range(4)}
        scene = ws.Scene.load("stss").replace(bands=bands, detector__nei_w_cm2=4e-20, **surface)
        return re.findall(r"above the noise; (.*)", scene_report(scene.scenario))

    assert ends("A", "V") == [*ends("A"), *ends("V")]
    assert ends("A") == ["complete to 45 NEI: more in sky.catalog union, synthetic, or a file"]


def test_completeness_is_where_counts_turn_over():
    steep = 10.0 ** -(np.linspace(0.0, 3.0, 20_001) ** 0.5)  # denser and denser as it fades
    cut = steep.min()
    few_fainter = cut * 10.0 ** -np.linspace(0.1, 2.0, 300)
    for light in (steep, np.concatenate([steep, few_fainter, np.zeros(9)])):
        assert cut <= complete_to(light) < 1.13 * cut
    assert complete_to(np.array([2.0, 3.0])) >= 2.0
    assert np.isnan(complete_to(np.zeros(3)))


def test_surfaces_that_end_within_a_band_are_noted():
    paint = {"reflectance": {"wavelength_um": [0.4, 9.0], "value": [0.9, 0.1]}}
    scene = ws.Scene.load("stss").replace(bands=["A", "C", "V"], targets__0__surface=paint, **{
        f"targets__{k}__surface": {"reflectance": 0.5} for k in (1, 2, 3)
    })  # fmt: skip
    name = scene.targets[0].name
    note = f"  note       {name}: its surface is given from 0.4 to 9 um and constant beyond, as in band A C\n"
    assert note in scene_report(scene.scenario)


def test_bands_that_no_sensor_uses_are_noted():
    mwir = {"half_power_um": [3.0, 5.0]}
    scene = ws.Scene.load("stss").replace(bands=["A"], band={"mwir": mwir, "x": {"file": "none.csv"}})
    assert "\n  note       band mwir x: described, but in the bands of no sensor\n" in scene_report(scene.scenario)
    assert "described, but" not in scene_report(scene.replace(band={}).scenario)


def test_shipped_bands_in_tables_that_no_sensor_uses_are_noted():
    scene = ws.Scene.load("stss").replace(bands=["A"], detector__nei_w_cm2={"A": 1e-18, "W1": 1e-18})
    note = "\n  note       band W1: in detector.nei_w_cm2, but in the bands of no sensor\n"
    assert note in scene_report(scene.scenario)
    warm = scene.replace(detector__nei_w_cm2=1e-18, lighting__earth_k={"W1": 250.0})
    assert note.replace("detector.nei_w_cm2", "lighting.earth_k") in scene_report(warm.scenario)


def test_electrons_cost_the_energy_that_is_printed():
    band = ws.Band.top_hat("x", 3.5, 5.0, per_photon=True)
    text = scene_report(ws.Scene.load("stss").replace(bands=[band], **{
        f"targets__{k}__surface": {"reflectance": 0.5} for k in range(4)
    }).scenario)  # fmt: skip
    assert f", {PLANCK_J_S * SPEED_OF_LIGHT_M_S / 5e-6:.3g} J an electron; AB magnitude 0 is " in text


def _electron_lines(tmp_path, quantum_efficiency, **band):
    """Lines about the band x of a camera that counts electrons."""
    (tmp_path / "filter.csv").write_text("wavelength_um,t\n3.5,0.9\n5.0,0.9\n")
    (tmp_path / "qe.csv").write_text("wavelength_um,qe\n3.0,0.5\n4.0,0.8\n6.0,0.2\n")
    detector = {"kind": "electron", "exposure_s": 0.1, "full_well_e": 1e6, "gain_e_per_count": 100.0}
    fields = {f"targets__{k}__surface": {"reflectance": 0.5} for k in range(4)}
    scene = ws.Scene.load("stss").replace(
        band={"x": band}, bands=["x"], detector=detector | {"quantum_efficiency": quantum_efficiency}, **fields
    )
    lines = scene_report(scene.scenario).splitlines()
    return [line for line in lines if "peaks at" in line or "quantum_efficiency" in line]


@pytest.mark.ci
def test_peak_of_a_product_of_files_is_shown(tmp_path):
    files = [str(tmp_path / name) for name in ("filter.csv", "qe.csv")]
    shown = "             the product of its files peaks at 0.72, and is scaled to 1"
    note = "  note       detector.quantum_efficiency is 1 in band x, whose response peaks at 0.72: give it the peak"
    assert _electron_lines(tmp_path, 0.72, files=files, per_photon=True) == [shown]
    assert _electron_lines(tmp_path, {"x": 1.0}, files=files, per_photon=True) == [shown, note]
    assert _electron_lines(tmp_path, 1.0, files=files) == [shown]  # by energy: no quantum efficiency
    single = "             its response peaks at 0.8, and is scaled to 1"
    assert _electron_lines(tmp_path, 0.8, file=files[1], per_photon=True) == [single]
    assert not _electron_lines(tmp_path, 1.0, half_power_um=[3.5, 5.0], per_photon=True)


@pytest.mark.ci
def test_of_very_many_views_some_are_looked_at(scene, monkeypatch):
    """Access is counted whole; what is looked at in some views says of how many."""
    many = scene.replace(frames={"count": 800, "interval_s": 2.0})
    whole = scene_report(many.scenario)
    for name, most in {
        "check_sensor.MOST_VIEWS_OF_RULES": 500, "check_views.MOST_VIEWS_LOOKED_AT": 300, "check._MOST_SAMPLES": 10,
    }.items():  # fmt: skip
        monkeypatch.setattr(f"warpsim.output.{name}", most)
    part = scene_report(many.scenario)
    assert line(part, "access") == line(whole, "access") and "too far" in line(part, "no access")
    n_view = [
        int(re.search(r"in ([\d,]+) of ([\d,]+) view", line(text, "in field"))[2].replace(",", ""))
        for text in (whole, part)
    ]
    assert 200 <= n_view[1] <= 300 < n_view[0]
