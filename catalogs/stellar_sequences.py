"""Mean colours of dwarfs and giants against BP-RP: what the stellar templates are bent to.

Three kinds of data meet here, in this order of weight:

- measured photometry (`tests/data/star_photometry.csv`, every second star; the others are left to the tests),
- for the visible, the 110,000 stars that Hipparcos and Gaia share (`warpsim.sky.hip_gaia`),
- published mean colours, which carry the ends that few bright single stars reach: Mamajek's dwarf sequence (version
  2022.04.16, Pecaut & Mamajek 2013, ApJS 208, 9; as the package MeanStars carries it), and for cool giants the Gaia DR3
  relations (Gaia DR3 documentation, section 5.5.1), Bessell & Brett (1988, PASP 100, 1134; to 2MASS by Carpenter 2001)
  and 9 and 18 um medians of AKARI.

A mean colour is a piecewise-linear function of BP-RP, fitted robustly with a penalty on its bends.
"""

from __future__ import annotations

import csv
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.sky.hip_gaia import match, read_gaia, read_hipparcos
from warpsim.sky.stellar_templates import DWARF, GIANT, luminosity_class

Array = NDArray[np.float64]

PHOTOMETRY = Path(__file__).parents[1] / "tests" / "data" / "star_photometry.csv"
MAMAJEK = "MeanStars/EEM_dwarf_UBVIJHK_colors_Teff.txt"

VISIBLE = ("B-V", "V-I", "G-V", "Hp-G")
INFRARED = ("G-J", "G-H", "G-Ks", "Ks-W1", "Ks-W2", "Ks-A", "Ks-W3", "Ks-W4")

W4_OFFSET_MAG = 0.025
"""WISE's W4 magnitudes of normal stars are 0.05 mag brighter than Spitzer's at 24 um (40 solar-type planet hosts, with
Spitzer's zero point of A stars), which Engelke's continuum agrees with. The templates go between the two."""

NODES = {
    DWARF: np.concatenate(
        [[-0.5, -0.4, -0.3], np.arange(-0.2, 2.85, 0.1), [3.1, 3.4, 3.8, 4.2, 4.5, 4.7, 4.85, 5.0, 5.2]]
    ),
    GIANT: np.concatenate([[0.8, 0.9], np.arange(1.0, 2.25, 0.1), [2.4, 2.7, 3.0, 3.5, 4.1, 4.8, 5.5, 6.4, 7.2]]),
}
"""BP-RP between which mean colours are linear [mag]."""

LARGEST_BP_RP = {DWARF: 3.2, GIANT: 4.3}
"""Redder stars are too few, or too variable, to take a mean of what was measured at different times."""

# Cool giants, by BP-RP: mean colours of Mira-like stars near us, with their dust; good to 0.1 mag at the top of the
# table and 0.3 mag at its end.
_GIANT_BP_RP = (1.73, 1.95, 2.16, 2.27, 2.50, 2.96, 3.45, 4.10, 4.80, 5.50, 6.40, 7.20)
_GIANT_ANCHORS: Mapping[str, tuple[float, ...]] = {
    "G-Ks": (3.00, 3.29, 3.57, 3.74, 4.09, 4.62, 5.13, 5.72, 6.25, 6.75, 7.20, 7.60),
    "J-Ks": (0.93, 1.01, 1.07, 1.10, 1.13, 1.18, 1.23, 1.27, 1.30, 1.32, 1.36, 1.40),
    "H-Ks": (0.20, 0.22, 0.25, 0.26, 0.27, 0.30, 0.32, 0.33, 0.34, 0.36, 0.40, 0.44),
    "V-I": (1.55, 1.75, 1.96, 2.09, 2.36, 2.76, 3.22, 3.90, 4.50, 5.00, 5.50, 5.90),
    "B-V": (1.50, 1.59, 1.63, 1.63, 1.61, 1.53, 1.45, 1.33, 1.30, 1.30, 1.35, 1.40),
    "Hp-G": (0.70, 0.81, 0.92, 0.98, 1.10, 1.34, 1.59, 1.97, 2.37, 2.73, 3.15, 3.50),
    "Ks-W1": (0.12, 0.13, 0.15, 0.16, 0.18, 0.21, 0.25, 0.31, 0.40, 0.50, 0.65, 0.80),
    "Ks-W2": (0.02, 0.01, 0.00, -0.01, -0.01, 0.01, 0.08, 0.20, 0.40, 0.60, 0.85, 1.05),
    "Ks-A": (0.08, 0.12, 0.15, 0.17, 0.20, 0.28, 0.38, 0.55, 0.80, 1.05, 1.50, 1.90),
    "Ks-W3": (0.08, 0.12, 0.16, 0.18, 0.23, 0.35, 0.49, 0.70, 1.02, 1.33, 1.85, 2.30),
    "Ks-W4": (0.14, 0.18, 0.22, 0.25, 0.31, 0.49, 0.69, 1.05, 1.55, 1.90, 2.40, 2.80),
}


@dataclass(frozen=True)
class Photometry:
    """Measured magnitudes by name, with NaN where unknown, and luminosity classes; shape (n,) each."""

    magnitude: Mapping[str, Array]
    luminosity: NDArray[np.int64]

    def colour(self, name: str) -> Array:
        """Return a colour such as "G-Ks" [mag]; Hipparcos' own B-V and V-I."""
        if name in self.magnitude:
            return self.magnitude[name]
        first, second = name.split("-")
        return self.magnitude[first] - self.magnitude[second]


def read_photometry(path: Path = PHOTOMETRY, half: int = 0) -> Photometry:
    """Return every second star of the measured ones: half 0 makes the sequences, half 1 tests them."""
    with path.open(encoding="ascii", newline="") as stream:
        rows = list(csv.DictReader(stream))[half::2]
    names = [name for name in rows[0] if name not in ("hip", "source")]
    magnitude = {name: np.array([float(row[name] or "nan") for row in rows]) for name in names}
    parallax_mas, pm_mas_yr = magnitude["parallax_mas"], magnitude["pm_mas_yr"]
    luminosity = luminosity_class(magnitude["G"], magnitude["BP-RP"], parallax_mas, pm_mas_yr)
    return Photometry(magnitude, luminosity)


def visible_photometry() -> Photometry:
    """Return the near stars that Hipparcos and Gaia share, neither saturated nor faint."""
    star, gaia = read_hipparcos(), read_gaia()
    partner, _ = match(star, gaia)
    pair = np.flatnonzero((partner >= 0) & (gaia.g_mag > 4.0) & (gaia.g_mag < 8.5))
    row = partner[pair]
    pair, row = pair[star.parallax_mas[row] > 1.0], row[star.parallax_mas[row] > 1.0]
    magnitude = {"G": gaia.g_mag[pair], "BP-RP": gaia.bp_rp_mag[pair], "Hp": star.hp_mag[row]}
    magnitude |= {"B-V": star.b_v_mag[row], "V-I": star.v_i_mag[row]}
    pm_mas_yr = np.hypot(star.pm_ra_mas_yr[row], star.pm_dec_mas_yr[row])
    luminosity = luminosity_class(magnitude["G"], magnitude["BP-RP"], star.parallax_mas[row], pm_mas_yr)
    return Photometry(magnitude, luminosity)


def read_mamajek(wheel: Path) -> dict[str, Array]:
    """Return the columns of Mamajek's dwarf sequence to M9.5 by their names, NaN where they have dots."""
    with zipfile.ZipFile(wheel) as archive:
        lines = archive.read(MAMAJEK).decode("latin-1").splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("SpT"))
    names = lines[first].split()[:-1]
    rows = []
    for line in lines[first + 1 :]:
        words = line.split()
        if not words or words[0].startswith("L"):
            break
        rows.append([_number(word) for word in words[: len(names)]])
    return {name: np.array([row[k] for row in rows]) for k, name in enumerate(names)}


def hot_bp_rp(v_i_mag: ArrayLike) -> Array:
    """BP-RP of hot dwarfs from V-I, both Cousins and Gaia DR3 [mag]: medians of the stars of both, then straight on."""
    return np.asarray(-0.022 + 1.22 * np.asarray(v_i_mag))


def mean_colours(luminosity: int, wheel: Path) -> dict[str, Array]:
    """Return the mean colours of VISIBLE and INFRARED at NODES of a luminosity class; dwarfs have no Ks-A."""
    nodes = NODES[luminosity]
    near, visible = read_photometry(), visible_photometry()
    anchors = _dwarf_anchors(wheel) if luminosity == DWARF else _giant_anchors(wheel)
    colours = {}
    for name in (*VISIBLE, *INFRARED):
        data = visible if name in ("B-V", "V-I", "Hp-G") else near
        x, y = np.empty(0), np.empty(0)
        if name == "Ks-A":  # no catalog of MSX stars to measure it
            if luminosity == DWARF:
                continue
        else:
            x, y = data.magnitude["BP-RP"], data.colour(name)
            used = (data.luminosity == luminosity) & np.isfinite(x + y) & (x < LARGEST_BP_RP[luminosity])
            x, y = x[used], y[used] - (W4_OFFSET_MAG if name == "Ks-W4" else 0.0)
        colours[name] = fit(nodes, x, y, *anchors.get(name, (np.empty(0), np.empty(0))))
    return colours


def fit(nodes: Array, x: Array, y: Array, anchor_x: Array, anchor_y: Array, bend_mag: float = 0.02) -> Array:
    """Return the values at nodes of the piecewise-linear function through the middle of data and anchors.

    An anchor weighs like three stars, and like thirty where there are no stars. A bend (the change of slope from one
    piece to the next) costs as much as a deviation of one star by its scatter where it is bend_mag per 0.1 mag of
    BP-RP; outliers lose their weight.
    """
    all_x, all_y = np.concatenate([x, anchor_x]), np.concatenate([y, anchor_y])
    ends = (x.min(), x.max()) if len(x) else (np.inf, -np.inf)
    alone = (anchor_x < ends[0]) | (anchor_x > ends[1])
    weight = np.concatenate([np.ones(len(x)), np.where(alone, 30.0, 3.0)])
    inside = (all_x >= nodes[0]) & (all_x <= nodes[-1])
    all_x, all_y, weight = all_x[inside], all_y[inside], weight[inside]
    hats = np.stack([np.interp(all_x, nodes, unit) for unit in np.eye(len(nodes))], axis=1)
    slopes = np.diff(np.eye(len(nodes)), axis=0) / np.diff(nodes)[:, None]
    width = (nodes[2:] - nodes[:-2])[:, None] / 2.0
    bends = np.diff(slopes, axis=0) / width * 0.1**2 / bend_mag
    scatter, trust = 0.05, np.ones(len(all_x))
    for _ in range(30):
        root = np.sqrt(weight * trust) / scatter
        system = np.concatenate([hats * root[:, None], bends * np.sqrt(len(nodes))])
        right = np.concatenate([all_y * root, np.zeros(len(bends))])
        values = np.linalg.lstsq(system, right, rcond=None)[0]
        deviation = all_y - hats @ values
        scatter = max(1.48 * float(np.median(np.abs(deviation))), 0.01)
        trust = 1.0 / (1.0 + (deviation / (2.5 * scatter)) ** 2) ** 2
    return np.asarray(values)


def _dwarf_anchors(wheel: Path) -> dict[str, tuple[Array, Array]]:
    """Return mean colours of dwarfs by Mamajek: BP-RP and colour, shape (k,) each."""
    table = read_mamajek(wheel)
    x = dwarf_bp_rp(table)
    ks_w1 = table["Ks-W1"]
    colours = {
        "B-V": table["B-V"],
        "V-I": table["V-Ic"],
        "G-V": table["G-V"],
        "G-Ks": table["G-V"] + table["V-Ks"],
        "G-H": table["G-V"] + table["V-Ks"] - table["H-Ks"],
        "G-J": table["G-V"] + table["V-Ks"] - table["H-Ks"] - table["J-H"],
        "Ks-W1": ks_w1,
        "Ks-W2": ks_w1 + table["W1-W2"],
        "Ks-W3": ks_w1 + table["W1-W3"],
        "Ks-W4": ks_w1 + table["W1-W4"] - W4_OFFSET_MAG,
    }
    known = {name: np.isfinite(x + values) for name, values in colours.items()}
    return {name: (x[known[name]], values[known[name]]) for name, values in colours.items()}


def dwarf_bp_rp(table: Mapping[str, Array]) -> Array:
    """BP-RP of Mamajek's dwarfs, of hot ones by V-I, and of those beyond M7 increasing on, where it turns back."""
    x = np.where(np.isfinite(table["Bp-Rp"]), table["Bp-Rp"], hot_bp_rp(table["V-Ic"]))
    cool = table["Teff"] < 2700.0
    return np.where(cool, np.interp(table["Teff"], (2300.0, 2700.0), (5.2, 4.62)), x)


def _giant_anchors(wheel: Path) -> dict[str, tuple[Array, Array]]:
    """Return mean colours of cool giants, and in the infrared those of dwarfs where giants begin."""
    dwarfs = _dwarf_anchors(wheel)
    x = np.array(_GIANT_BP_RP)
    table = {name: np.array(values) for name, values in _GIANT_ANCHORS.items()}
    g_v = -0.02704 + 0.01424 * x - 0.2156 * x**2 + 0.01426 * x**3  # Gaia DR3 documentation, table 5.9
    colours = {
        "G-V": g_v,
        "G-Ks": table["G-Ks"],
        "G-H": table["G-Ks"] - table["H-Ks"],
        "G-J": table["G-Ks"] - table["J-Ks"],
    }
    colours |= {name: table[name] for name in ("B-V", "V-I", "Hp-G", "Ks-A")}
    anchors = {name: (x, values) for name, values in colours.items()}
    for name in ("Ks-W1", "Ks-W2", "Ks-W3", "Ks-W4"):
        near = (dwarfs[name][0] > 0.75) & (dwarfs[name][0] < 1.15)
        anchors[name] = (
            np.concatenate([dwarfs[name][0][near], x]),
            np.concatenate([dwarfs[name][1][near], table[name]]),
        )
    return anchors


def _number(word: str) -> float:
    try:
        return float(word.rstrip(":"))
    except ValueError:
        return float("nan")
