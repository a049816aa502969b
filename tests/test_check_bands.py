"""What `warpsim check` says of a scene's bands."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy import integrate

import warpsim as ws
from warpsim.constants import PLANCK_J_S, SPEED_OF_LIGHT_M_S
from warpsim.output.check import scene_report
from warpsim.output.check_sensor import mean_photon_j
from warpsim.radiometry.band import AB_ZERO_JY
from warpsim.sky.star_counts import complete_to

QUADRATURE_RTOL = 1e-9


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
