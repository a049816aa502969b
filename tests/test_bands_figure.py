"""The figure of a scene's bands."""

from __future__ import annotations

import numpy as np
import pytest

import warpsim as ws
from warpsim.radiometry.sun_and_earth import earth_spectrum, solar_spectrum

pytest.importorskip("matplotlib").use("Agg")


@pytest.fixture(scope="module")
def drawn():
    surface = {"reflectance": {"wavelength_um": [0.4, 2.0, 4.0], "value": [0.9, 0.8, 0.1]}}
    changes = {f"targets__{k}__surface": surface for k in range(4)}
    bands = [ws.Band.top_hat("red", 0.6, 0.7, per_photon=True), "A"]
    scene = ws.Scene.load("stss").replace(**changes, bands=bands)
    return scene, ws.plot.plot_bands(scene)


def test_responses_are_areas_with_names(drawn):
    _, ax = drawn
    assert [text.get_text() for text in ax.texts] == ["red", "A"]
    red, infrared = (line.get_xydata() for line in ax.lines)
    np.testing.assert_allclose(red, [[0.6, 0.0], [0.6, 1.0], [0.7, 1.0], [0.7, 0.0]])
    np.testing.assert_array_equal(infrared[1:-1, 1], ws.BANDS["A"].response)
    assert ax.get_xlim() == (0.3, 30.0)


def test_spectra_are_powers_over_their_peak(drawn):
    scene, ax = drawn
    (spectra,) = (other for other in ax.figure.axes if other is not ax)
    lines = {line.get_label(): line.get_xydata() for line in spectra.lines}
    assert list(lines)[:1] == ["Sun"] and "Earth, emitted" in lines
    names = ", ".join(dict.fromkeys(target.spec.name for target in scene.scenario.targets))  # all alike: one line
    assert f"{names}, 350 K" in lines and f"{names}, reflected" in lines
    for label, spectrum in (("Sun", solar_spectrum().at), ("Earth, emitted", earth_spectrum().radiance_w_m2_sr_um)):
        wavelength_um, drawn_power = lines[label].T
        power = wavelength_um * spectrum(wavelength_um)
        np.testing.assert_allclose(drawn_power, power / power.max(), rtol=1e-12)
    peak_um = lines["Sun"][lines["Sun"][:, 1].argmax(), 0]
    assert 0.45 < peak_um < 0.75
    assert 8.0 < lines["Earth, emitted"][lines["Earth, emitted"][:, 1].argmax(), 0] < 13.5
