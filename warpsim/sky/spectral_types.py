"""Temperature and luminosity class of spectral types: "K3III", "M2.5V", "G2 V", "B0.5Iab", "F5".

Temperatures are those of the templates (`stellar_templates`), which follow colours: a star of a type has the mean
colours of that type. Dwarfs have the scale of Mamajek (version 2022.04.16; Pecaut & Mamajek 2013, ApJS 208, 9). Giants
and supergiants from G0 on have the temperature of the giant template with the BP-RP of the spectrum of their type in
the library of Pickles (1998, PASP 110, 863); hotter ones have the scale of dwarfs, as the templates do.
"""

from __future__ import annotations

import re
import warnings

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64
from warpsim.sky.stellar_templates import DWARF, GIANT

CLASS_UNKNOWN = -1
"""Of types without a luminosity class, such as "F5"."""

_LETTERS = "OBAFGKM"

_DWARF_K = {
    "O3": 44900, "O4": 42900, "O5": 41400, "O6": 39500, "O7": 37100, "O8": 35100, "O9": 33300, "O9.5": 31900,
    "B0": 31400, "B0.5": 29000, "B1": 26000, "B1.5": 24500, "B2": 20600, "B2.5": 18500, "B3": 17000, "B4": 16400,
    "B5": 15700, "B6": 14500, "B7": 14000, "B8": 12300, "B9": 10700, "B9.5": 10400,
    "A0": 9700, "A1": 9300, "A2": 8800, "A3": 8600, "A4": 8250, "A5": 8100, "A6": 7910, "A7": 7760, "A8": 7590,
    "A9": 7400, "F0": 7220, "F1": 7020, "F2": 6820, "F3": 6750, "F4": 6670, "F5": 6550, "F6": 6350, "F7": 6280,
    "F8": 6180, "F9": 6050, "F9.5": 5990, "G0": 5930, "G1": 5860, "G2": 5770, "G3": 5720, "G4": 5680, "G5": 5660,
    "G6": 5600, "G7": 5550, "G8": 5480, "G9": 5380, "K0": 5270, "K1": 5170, "K2": 5100, "K3": 4830, "K4": 4600,
    "K5": 4440, "K6": 4300, "K7": 4100, "K8": 3990, "K9": 3930, "M0": 3850, "M0.5": 3770, "M1": 3660, "M1.5": 3620,
    "M2": 3560, "M2.5": 3470, "M3": 3430, "M3.5": 3270, "M4": 3210, "M4.5": 3110, "M5": 3060, "M5.5": 2930,
    "M6": 2810, "M6.5": 2740, "M7": 2680, "M7.5": 2630, "M8": 2570, "M8.5": 2420, "M9": 2380, "M9.5": 2350,
}  # fmt: skip
_GIANT_K = {
    "G0": 5620, "G5": 5080, "G8": 4950, "K0": 4870, "K1": 4730, "K2": 4590, "K3": 4510, "K4": 4240, "K5": 4030,
    "M0": 3930, "M1": 3850, "M2": 3770, "M3": 3660, "M4": 3530, "M5": 3390, "M6": 3250, "M7": 3080, "M8": 2960,
}  # fmt: skip

_TYPE = re.compile(r"(?P<prefix>sd|d|g)?(?P<letter>[OBAFGKM])(?P<subtype>\d(?:\.\d+)?)(?P<rest>[^+]*)")
"""Of a composite spectrum the first part; white dwarfs, carbon stars and letters alone do not fit."""

_CLASS = re.compile(
    r"(?:[^A-Za-z]|[OBAFGKM](?=\d)|[efmnpsw])*"  # "/9" of a range, "-M4" of another, "e" of emission
    r"(?P<roman>[IV]++(?=[a-hk-pswz]*(?:var)?(?![a-z]))|[iv]++(?=(?:ab?|b)?(?![a-z])))"
)
"""Follows the subtype. Letters behind it are those of peculiarities: "IIIvar" is a class, the V of "Var" is none."""

_ROMAN = ("I", "II", "III", "IV", "V", "VI")
_CLASS_OF_PREFIX = {"sd": "VI", "d": "V", "g": "III"}


def of_spectral_types(types: NDArray[np.str_]) -> tuple[F64, NDArray[np.int8]]:
    """Return temperatures [K] of a dwarf and of a giant of each type, (n, 2), and its luminosity class, (n,).

    Both are the same for a type with a class; NaN and CLASS_UNKNOWN where a type is not understood. Subgiants (IV)
    count as dwarfs up to G9 and as giants from K0 on, as their absolute magnitudes do.
    """
    kinds, kind = np.unique(np.char.strip(types.astype(np.str_)), return_inverse=True)
    known = [_of_type(str(one)) for one in kinds]
    temperature_k = np.array([of_class_k for of_class_k, _ in known], dtype=np.float64).reshape(-1, 2)
    luminosity = np.array([luminosity for _, luminosity in known], dtype=np.int8)
    return temperature_k[kind], luminosity[kind]


def warn_unknown_types(name: str, types: NDArray[np.str_], temperature_k: F64) -> None:
    """Warn about stars whose type is not understood: how many, and the first types; blanks are no types."""
    unknown = types[np.isnan(temperature_k[:, DWARF]) & (np.char.strip(types.astype(np.str_)) != "")]
    if len(unknown):
        kinds = list(dict.fromkeys(unknown.tolist()))
        shown = ", ".join(kinds[:5]) + (", ..." if len(kinds) > 5 else "")
        warnings.warn(f"{name}: {len(unknown)} of {len(types)} spectral types are unknown ({shown})", stacklevel=2)


def _of_type(text: str) -> tuple[tuple[float, float], int]:
    """Temperatures of a dwarf and of a giant of a type [K], and its luminosity class."""
    parts = _TYPE.match(text)
    if parts is None:
        return (np.nan, np.nan), CLASS_UNKNOWN
    number = 10.0 * _LETTERS.index(parts["letter"]) + float(parts["subtype"])
    found = _CLASS.match(parts["rest"])
    roman = found["roman"].upper() if found else _CLASS_OF_PREFIX.get(parts["prefix"] or "")
    dwarf_k, giant_k = (float(np.interp(number, *_scale(scale_k))) for scale_k in (_DWARF_K, _GIANT_K))
    if number < _number("G0"):
        giant_k = dwarf_k
    if roman not in _ROMAN:
        return (dwarf_k, giant_k), CLASS_UNKNOWN
    if roman in ("V", "VI") or (roman == "IV" and parts["letter"] in "OBAFG"):
        return (dwarf_k, dwarf_k), DWARF
    return (giant_k, giant_k), GIANT


def _number(type_name: str) -> float:
    """Spectral type as a number, tens for the letter: 45 is G5."""
    return 10.0 * _LETTERS.index(type_name[0]) + float(type_name[1:])


def _scale(temperatures_k: dict[str, int]) -> tuple[list[float], list[int]]:
    return [_number(one) for one in temperatures_k], list(temperatures_k.values())
