"""The shipped responses read straight from their files, and plain rules of integration over them."""

import csv
import tomllib
from functools import cache
from importlib.resources import files

import numpy as np

DATA = files("warpsim_catalogs")
FACTS = tomllib.loads(DATA.joinpath("responses_v1.toml").read_text())
MSX = ("B1", "B2", "A", "C", "D", "E")
GENERIC = ("SWIR", "MWIR", "LWIR")
SURVEYS = tuple(name for name in FACTS if name not in GENERIC)

LIGHT_UM_S = 299792458e6
JY_W_CM2_HZ = 1e-30
RADIATION_1_W_UM4_M2_SR = 2.0 * 6.62607015e-34 * 299792458.0**2 * 1e24  # 2 h c^2, for W/m2/sr per um
RADIATION_2_UM_K = 14387.768775


def planck_w_m2_sr_um(um, temperature_k):
    return RADIATION_1_W_UM4_M2_SR / um**5 / np.expm1(RADIATION_2_UM_K / (um * temperature_k))


@cache
def nodes(name):
    """Nodes of a band as the file has them: wavelengths [um], responses."""
    rows = csv.DictReader(DATA.joinpath("responses_v1.csv").read_text().splitlines())
    table = np.array([[float(row["wavelength_um"]), float(row["response"])] for row in rows if row["band"] == name])
    return table[:, 0], table[:, 1]


def dense(curve, per_photon, n_part=256):
    """Wavelengths [um], energy response of peak 1 and trapezoid weights [um] of a piecewise-linear curve."""
    wavelength_um, response = curve
    part = np.arange((len(response) - 1) * n_part + 1) / n_part
    at_um = np.interp(part, np.arange(len(response)), wavelength_um)
    value = np.interp(at_um, wavelength_um, response) * (at_um if per_photon else 1.0)
    step_um = np.diff(at_um) / 2.0
    return at_um, value / value.max(), np.append(step_um, 0.0) + np.append(0.0, step_um)


def shipped(name):
    """Wavelengths, energy response and weights of a shipped band."""
    return dense(nodes(name), FACTS[name]["per_photon"])


def hertz(name):
    """In-band irradiance over quoted flux density [Hz], by the survey's own definition."""
    at_um, response, weight_um = shipped(name)
    if FACTS[name]["flux"] == "mean":
        return np.sum(response * weight_um * LIGHT_UM_S / at_um**2)
    return np.sum(response * weight_um / at_um) * LIGHT_UM_S / FACTS[name]["nominal_um"]
