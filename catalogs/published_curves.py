"""Read published spectral responses and spectra: tables beside the recipe, and files of installed packages.

A file is named as in published_responses/bands.toml: "iras.csv" beside it, or "package:path" within an installed
package, whose bytes must have the sha256 that the list gives.
"""

from __future__ import annotations

import csv
import hashlib
import importlib.util
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from astropy.io import fits
from astropy.io.fits.verify import VerifyWarning
from astropy.io.votable import parse_single_table
from numpy.typing import NDArray

Array = NDArray[np.float64]
Curve = tuple[Array, Array]

TABLES = Path(__file__).parent / "published_responses"

_KANG_UM = 0.1
"""1000 Angstrom [um]."""

_ANGSTROM_UM = 1e-4


class MissingPackageError(RuntimeError):
    """A package that carries a published curve is not installed."""


def source_path(name: str, sha256: Mapping[str, str]) -> Path:
    """Return the path of a source, after checking its bytes.

    Args:
        name: "table.csv" or "package:path within it".
        sha256: Hash of every file of a package, by that name.

    Raises:
        MissingPackageError: The package is not there.
        SystemExit: The file is not the one that the hash was taken of.
    """
    package, _, inside = name.rpartition(":")
    if not package:
        return TABLES / inside
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise MissingPackageError(f"{name}: package {package} is not installed")
    path = Path(next(iter(spec.submodule_search_locations))) / inside
    if hashlib.sha256(path.read_bytes()).hexdigest() != sha256[name]:
        raise SystemExit(f"{path}: not the file that the recipe was written for (its sha256 differs)")
    return path


def read_curve(path: Path, band: str) -> Curve:
    """Read wavelengths [um] and responses of one band, as the file has them.

    Args:
        path: A table with the columns band, wavelength_um, response, or a file of one of the packages.
        band: Name of the band in such a table.
    """
    if path.parent == TABLES:
        with path.open(encoding="ascii") as lines:
            rows = [row for row in csv.DictReader(lines) if row["band"] == band]
        return _columns([(float(row["wavelength_um"]), float(row["response"])) for row in rows])
    if path.parent.parent.parent.name == "svo_filters":
        table = parse_single_table(path).to_table()
        return np.asarray(table["Wavelength"], float) * _ANGSTROM_UM, np.asarray(table["Transmission"], float)
    text = path.read_text(encoding="utf-8").splitlines()
    rows_of_text = [line.replace(",", " ").split()[:2] for line in text if line.lstrip()[:1].isdigit()]
    wavelength, response = _columns([(float(first), float(second)) for first, second in rows_of_text])
    return (wavelength if wavelength[0] < 100.0 else wavelength * _ANGSTROM_UM), response


@cache
def read_spectrum(path: Path) -> Curve:
    """Read a CALSPEC spectrum: wavelengths [um] and spectral irradiances [W/cm2/um]."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", VerifyWarning)  # a null value that is no whole number
        table = fits.getdata(path, 1)
    wavelength_um = np.asarray(table["WAVELENGTH"], np.float64) * _ANGSTROM_UM
    erg_s_cm2_angstrom = np.asarray(table["FLUX"], np.float64)
    return wavelength_um, erg_s_cm2_angstrom * 1e-7 / _ANGSTROM_UM


def times_wavelength_kang(curve: Curve) -> Curve:
    """Multiply a response by the wavelength in 1000 Angstrom, to the three decimals that were printed."""
    wavelength_um, response = curve
    return wavelength_um, np.round(response * wavelength_um / _KANG_UM, 3)


def _columns(rows: list[tuple[float, float]]) -> Curve:
    table = np.array(rows, np.float64)
    return table[:, 0].copy(), table[:, 1].copy()
