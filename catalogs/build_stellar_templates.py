"""Build `stellar_templates_v1.npz`: spectra of dwarfs and giants from 2,300 to 35,000 K, 0.28 to 45 um.

    pip install '.[catalogs]'
    pip download --no-deps exosims==3.6.6 meanstars==3.6.1
    python catalogs/build_stellar_templates.py exosims-3.6.6-py3-none-any.whl meanstars-3.6.1-py3-none-any.whl

A template is made in three steps:

1. The shape between 0.28 and 2.3 um is that of the UVK library of Pickles (1998, PASP 110, 863; the package EXOSIMS
   carries the files of STScI's reference atlases), between the two spectral types nearest in their own BP-RP.
2. Engelke's continuum (1992, AJ 104, 1248) goes on from there.
3. A smooth factor bends it until its colours are the mean ones of the stars measured (`stellar_sequences`). In the
   fundamental band of CO, 4.25 to 5.4 um, the factor may have a trough.

The numbers are rounded to 5 digits: solvers of linear systems differ in the 12th from machine to machine.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import io
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import stellar_sequences as sequences
from astropy.io import fits
from build_hip_gaia_ir import npz_bytes
from condense_curve import planck
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from warpsim.radiometry.bands import as_band
from warpsim.sky.stellar_templates import DWARF, GIANT

Array = NDArray[np.float64]

OUTPUT = Path(__file__).parent / "warpsim_catalogs" / "stellar_templates_v1.npz"
SHA256 = {
    "exosims": "09238a29e7df461d2f65327bcf03f5521f0165992c43d97a6bfc79280637ad29",
    "meanstars": "ed740c346dcb522742d16eed00c8cd3a14df9157b0d6f7d5cf2bb9ef9538ff67",
}
LIBRARY = "EXOSIMS/TargetList/dat_uvk/"

DWARF_TYPES = (
    "O5V", "O9V", "B0V", "B1V", "B3V", "B57V", "B8V", "B9V", "A0V", "A2V", "A3V", "A5V", "A7V", "F0V", "F2V", "F5V",
    "F6V", "F8V", "G0V", "G2V", "G5V", "G8V", "K0V", "K2V", "K3V", "K4V", "K5V", "K7V", "M0V", "M1V", "M2V", "M3V",
    "M4V", "M5V", "M6V",
)  # fmt: skip
GIANT_TYPES = (
    "G0III", "G5III", "G8III", "K0III", "K1III", "K2III", "K4III", "K5III", "M0III", "M1III", "M2III", "M3III",
    "M4III", "M5III", "M6III", "M7III", "M8III",
)  # fmt: skip
ALIKE_ABOVE_K = 5400.0
"""Hotter giants have the spectrum of dwarfs."""

TEMPERATURE_K = np.round(
    np.concatenate(
        [np.geomspace(2300, 4600, 28), np.geomspace(4600, 10_000, 17)[1:], np.geomspace(10_000, 35_000, 11)[1:]]
    )
)
WAVELENGTH_UM = np.round(
    np.concatenate(
        [
            np.geomspace(0.28, 1.1, 241),
            np.geomspace(1.1, 2.4, 81)[1:],
            np.geomspace(2.4, 5.6, 61)[1:],
            np.geomspace(5.6, 45.0, 101)[1:],
        ]
    ),
    5,
)
FINE_UM = np.geomspace(0.27, 46.0, 10_000)
JOIN_UM = (2.2, 2.35)
"""Between these the continuum takes over from the library."""

HOT_K = (6500.0, 8000.0)
HOT_JOIN_UM = (0.99, 1.05)
"""Of hot stars the library has no infrared spectra: there Planck's law goes between HOT_JOIN_UM and JOIN_UM, for all
stars above the second temperature and none below the first."""

KNOT_UM = np.array([0.33, 0.40, 0.48, 0.56, 0.65, 0.75, 0.87, 1.0, 1.24, 1.65, 2.16, 3.35, 4.6, 6.0, 8.6, 12.0, 22.0])
CO_KNOT = 12
"""Giants have the trough of CO instead of this knot."""

CO_UM = (4.22, 4.40, 4.75, 5.05, 5.40)
CO_DEPTH = (0.0, 1.0, 1.0, 0.3, 0.0)
BEND = 0.08
"""What a bend of the factor's logarithm from knot to knot may be, as one standard deviation."""

LEVEL = 0.3
"""The same for its value at the blue end, and for the trough of CO."""

TOLERANCE_MAG = {
    "BP-RP": 0.001, "Hp-G": 0.03, "G-V": 0.03, "B-V": 0.05, "G-J": 0.01, "G-H": 0.01, "G-Ks": 0.005,
    "Ks-W1": 0.01, "Ks-W2": 0.01, "Ks-A": 0.02, "Ks-W3": 0.01, "Ks-W4": 0.01,
}  # fmt: skip
BANDS = ("Hp", "BP", "RP", "G", "B", "V", "Ic", "J", "H", "Ks", "W1", "W2", "A", "W3", "W4")

# Temperatures of cool giants by BP-RP: the scale of spectral types of Pickles (1998, table 2) and van Belle et al.
# (1999, AJ 117, 521), +/- 80 K.
GIANT_SCALE = (
    (1.75, 1.95, 2.16, 2.50, 2.96, 3.45, 4.10, 4.80, 5.50, 6.40, 7.20),
    (3985, 3810, 3690, 3545, 3390, 3250, 3080, 2900, 2740, 2540, 2380),
)


class Responses:
    """Quadratures over the bands on one fine grid, and their zero points."""

    def __init__(self) -> None:
        """Sample the bands."""
        self.weight, self.zero = {}, {}
        step_um = np.gradient(FINE_UM)
        for name in BANDS:
            band = as_band(name)
            self.weight[name] = band.energy_response(FINE_UM) * step_um
            self.zero[name] = band.zero_mag_w_cm2

    def light(self, name: str, spectrum: Array) -> Array:
        """In-band light over that of magnitude 0, of spectra (..., m)."""
        return np.asarray(spectrum @ self.weight[name] / self.zero[name])

    def colour(self, name: str, spectrum: Array) -> float:
        """Return a colour such as "G-Ks" of a spectrum [mag]."""
        first, second = name.split("-")
        return float(-2.5 * np.log10(self.light(first, spectrum) / self.light(second, spectrum)))


def main(arguments: list[str] | None = None) -> int:
    """Build the templates and write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("exosims", type=Path, help="exosims-3.6.6-py3-none-any.whl")
    parser.add_argument("meanstars", type=Path, help="meanstars-3.6.1-py3-none-any.whl")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="file to write (default: %(default)s)")
    options = parser.parse_args(arguments)
    for name, sha256 in SHA256.items():
        wheel: Path = getattr(options, name)
        if hashlib.sha256(wheel.read_bytes()).hexdigest() != sha256:
            raise SystemExit(f"{wheel}: not the wheel of {name} that this recipe was made for")
    columns = build(options.exosims, options.meanstars)
    data = npz_bytes(columns)
    options.output.write_bytes(data)
    print(f"{options.output}: {len(data)} bytes, sha256 {hashlib.sha256(data).hexdigest()}")
    return 0


def build(exosims: Path, meanstars: Path) -> dict[str, NDArray[np.generic]]:
    """Return the columns of the file."""
    responses = Responses()
    spectra, listed = {}, {}
    for luminosity, types in ((DWARF, DWARF_TYPES), (GIANT, GIANT_TYPES)):
        bp_rp = bp_rp_of_temperature(luminosity, meanstars)
        colours = sequences.mean_colours(luminosity, meanstars)
        nodes = sequences.NODES[luminosity]
        mean = {name: np.interp(bp_rp, nodes, values) for name, values in colours.items()} | {"BP-RP": bp_rp}
        shapes = library_shapes(exosims, types, responses)
        spectra[luminosity] = np.stack(
            [
                condensed(
                    bent(shapes(x), float(t), {name: float(mean[name][k]) for name in mean}, luminosity, responses)
                )
                for k, (x, t) in enumerate(zip(bp_rp, TEMPERATURE_K, strict=True))
            ]
        )
        listed[luminosity] = {name: mean[name] for name in ("V-I", "B-V")}
    hot = TEMPERATURE_K > ALIKE_ABOVE_K
    spectra[GIANT][hot] = spectra[DWARF][hot]
    for name, values in listed[GIANT].items():
        values[hot] = listed[DWARF][name][hot]
    spectrum = np.stack([spectra[DWARF], spectra[GIANT]])
    columns: dict[str, NDArray[np.generic]] = {
        "wavelength_um": WAVELENGTH_UM,
        "temperature_k": TEMPERATURE_K,
        "spectrum": rounded(spectrum).astype(np.float32),
    }
    for key, name in (("v_i_mag", "V-I"), ("b_v_mag", "B-V")):
        columns[key] = np.round(np.stack([listed[DWARF][name], listed[GIANT][name]]), 4).astype(np.float32)
    return columns


def bp_rp_of_temperature(luminosity: int, meanstars: Path) -> Array:
    """BP-RP at TEMPERATURE_K: dwarfs by Mamajek, giants by Mucciarelli et al. (2021, A&A 653, A90) and GIANT_SCALE."""
    if luminosity == DWARF:
        table = sequences.read_mamajek(meanstars)
        temperature_k, bp_rp = table["Teff"], sequences.dwarf_bp_rp(table)
    else:
        bp_rp = np.arange(0.4, 1.7, 0.05)
        theta = 0.5323 + 0.4775 * bp_rp - 0.0344 * bp_rp**2
        bp_rp = np.concatenate([bp_rp, GIANT_SCALE[0]])
        temperature_k = np.concatenate([5040.0 / theta, GIANT_SCALE[1]])
    known = np.isfinite(bp_rp) & np.isfinite(temperature_k)
    order = np.argsort(temperature_k[known])
    ln_k = np.log(temperature_k[known][order])
    values = np.interp(np.log(TEMPERATURE_K), ln_k, bp_rp[known][order])
    # Beyond the last giant the scale goes straight on.
    slope = (bp_rp[known][order][1] - bp_rp[known][order][0]) / (ln_k[1] - ln_k[0])
    return np.asarray(values + slope * np.minimum(np.log(TEMPERATURE_K) - ln_k[0], 0.0))


def library_shapes(exosims: Path, types: tuple[str, ...], responses: Responses) -> Callable[[float], Array]:
    """Return a function of BP-RP that gives the library's spectrum at FINE_UM, up to JOIN_UM."""
    with zipfile.ZipFile(exosims) as wheel:
        index = fits.getdata(io.BytesIO(wheel.read(LIBRARY + "pickles_uk.fits")))
        files = {str(kind).strip(): str(name).strip() for name, kind in index}
        logs = []
        for kind in types:
            table = fits.getdata(io.BytesIO(wheel.read(f"{LIBRARY}{files[kind]}.fits")))
            wavelength_um, flux = (np.asarray(table.field(k), dtype=np.float64) for k in (0, 1))
            logs.append(np.log(np.maximum(np.interp(FINE_UM, wavelength_um * 1e-4, flux), flux.max() * 1e-6)))
    own = np.array([responses.colour("BP-RP", np.exp(values)) for values in logs])
    order = np.argsort(own)
    stack = np.stack(logs)[order]

    def shape(bp_rp: float) -> Array:
        """Mix the two nearest types; beyond the last one its shape stays."""
        right = int(np.clip(np.searchsorted(own[order], bp_rp), 1, len(own) - 1))
        low, high = own[order][right - 1], own[order][right]
        part = float(np.clip((bp_rp - low) / (high - low), 0.0, 1.0))
        return np.asarray(np.exp((1.0 - part) * stack[right - 1] + part * stack[right]))

    return shape


def bent(shape: Array, temperature_k: float, mean: dict[str, float], luminosity: int, responses: Responses) -> Array:
    """Return the spectrum at FINE_UM with the mean colours: library, continuum, and a smooth factor."""
    base = joined(shape, temperature_k)
    basis, prior = factor_basis(luminosity)
    names = [name for name in TOLERANCE_MAG if name != "Ks-A" or (luminosity == GIANT and mean["BP-RP"] > 1.7)]
    tolerance_mag = np.array([TOLERANCE_MAG[name] for name in names])
    level = np.zeros(basis.shape[1])
    for _ in range(12):
        spectrum = base * np.exp(basis @ level)
        slopes, misses_mag = [], []
        for name in names:
            share = [
                (responses.weight[band] * spectrum) @ basis / (responses.weight[band] @ spectrum)
                for band in name.split("-")
            ]
            slopes.append(-2.5 / np.log(10.0) * (share[0] - share[1]))
            misses_mag.append(mean[name] - responses.colour(name, spectrum))
        system = np.concatenate([np.array(slopes) / tolerance_mag[:, None], prior])
        right = np.concatenate([np.array(misses_mag) / tolerance_mag, -prior @ level])
        level = level + np.linalg.lstsq(system, right, rcond=None)[0]
    return np.asarray(base * np.exp(basis @ level))


def joined(shape: Array, temperature_k: float) -> Array:
    """Return the library's spectrum at FINE_UM with continua in place of what it does not have."""
    hot = float(np.clip(np.log(temperature_k / HOT_K[0]) / np.log(HOT_K[1] / HOT_K[0]), 0.0, 1.0))
    infrared = shape ** (1.0 - hot) * crossed(shape, planck(FINE_UM, temperature_k), HOT_JOIN_UM) ** hot
    return crossed(infrared, engelke_continuum(FINE_UM, temperature_k), JOIN_UM)


def crossed(blue: Array, red: Array, join_um: tuple[float, float]) -> Array:
    """Return a spectrum that goes from one to the other, scaled to meet it, between two wavelengths."""
    joint = slice(*np.searchsorted(FINE_UM, join_um))
    part = np.clip(np.log(FINE_UM / join_um[0]) / np.log(join_um[1] / join_um[0]), 0.0, 1.0)
    return np.asarray(blue ** (1.0 - part) * (red * np.mean(blue[joint] / red[joint])) ** part)


def engelke_continuum(wavelength_um: Array, temperature_k: float) -> Array:
    """Continuum of a star between 2 and 60 um, relative: Planck's law at Engelke's brightness temperature."""
    brightness_k = 0.738 * temperature_k * (1.0 + 79450.0 / (wavelength_um * temperature_k)) ** 0.182
    return planck(wavelength_um, brightness_k)


def factor_basis(luminosity: int) -> tuple[Array, Array]:
    """Logarithm of the factor at FINE_UM by knot, and rows that keep it smooth.

    Cubic splines in ln(wavelength), 1 at one knot and 0 at the others, flat at both ends and constant beyond; and the
    trough of CO for giants.
    """
    knot_um = np.delete(KNOT_UM, CO_KNOT) if luminosity == GIANT else KNOT_UM
    ln_knot, n_knot = np.log(knot_um), len(knot_um)
    ln_um = np.clip(np.log(FINE_UM), ln_knot[0], ln_knot[-1])
    basis = CubicSpline(ln_knot, np.eye(n_knot), bc_type="clamped")(ln_um)
    if luminosity == GIANT:
        trough = -np.interp(FINE_UM, CO_UM, CO_DEPTH, left=0.0, right=0.0)
        basis = np.concatenate([basis, trough[:, None]], axis=1)
    n_level = basis.shape[1]
    bends = np.zeros((n_knot - 2, n_level))
    for k in range(n_knot - 2):
        left, right = np.diff(ln_knot[k : k + 3])
        bends[k, k : k + 3] = np.array([right, -left - right, left]) / (left + right) / BEND
    levels = np.eye(n_level)[[0, -1]] / LEVEL
    return basis, np.concatenate([bends, levels])


def condensed(spectrum: Array) -> Array:
    """Return the values at WAVELENGTH_UM that keep the light around each node, of integral 1 over wavelength."""
    values = (
        _hats() @ (spectrum * FINE_UM**4) / WAVELENGTH_UM**4
    )  # a product that hardly bends where nodes are far apart
    ends = [0, -1]
    values[ends] = np.interp(WAVELENGTH_UM[ends], FINE_UM, spectrum)
    return np.asarray(values / np.trapezoid(values, WAVELENGTH_UM))


@functools.cache
def _hats() -> Array:
    """Weights at FINE_UM of the mean around each of WAVELENGTH_UM, (m, n_fine)."""
    hats = np.stack(
        [np.interp(FINE_UM, WAVELENGTH_UM, unit, left=0.0, right=0.0) for unit in np.eye(len(WAVELENGTH_UM))]
    )
    hats *= np.gradient(FINE_UM)
    return np.asarray(hats / hats.sum(axis=1, keepdims=True))


def rounded(values: Array) -> Array:
    """Keep 5 significant digits."""
    unit = 10.0 ** (np.floor(np.log10(values)) - 4)
    return np.round(values / unit) * unit


if __name__ == "__main__":
    sys.exit(main())
