"""Build `responses_v1`: the spectral responses that warpsim ships, condensed to nodes, with their zero points.

    pip install --no-deps pyphot==2.1.1 astro-sedpy==0.4.1 speclite==1.0.0 svo_filters==0.5.3
    python catalogs/build_responses.py      # writes catalogs/warpsim_catalogs/responses_v1.csv and .toml

`published_responses/bands.toml` says where each curve and zero point comes from: "iras.csv" beside it, or
"package:path" within an installed package. Of the packages only data files are read, which are checked by sha256; they
are not imported. Building again gives the same bytes. catalogs/README.md tells what the columns and fields mean.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import importlib.util
import json
import math
import sys
import tomllib
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from astropy.io import fits
from astropy.io.fits.verify import VerifyWarning
from astropy.io.votable import parse_single_table
from condense_curve import Curve, blackbodies, condense
from numpy.typing import NDArray

from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import band_radiance_w_m2_sr

Array = NDArray[np.float64]

TABLES = Path(__file__).parent / "published_responses"
OUTPUT = Path(__file__).parent / "warpsim_catalogs"
STARS = ("pyphot:libs/alpha_lyr_stis_011.fits", "pyphot:libs/sun_reference_stis_001.fits")
"""Spectra whose in-band integrals are kept beside those of blackbodies: Vega and the Sun."""

LONGEST_WHOLE_TABLE = 60
"""A published table of no more nodes is kept as it is."""

_ROUNDING = 1e-7
"""Errors below come from the decimals that are written."""

_LIGHT_UM_S = SPEED_OF_LIGHT_M_S * 1e6
_JY_W_CM2_HZ = 1e-30
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


def read_definitions() -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """Return the bands by name, each with the fields of its family, and the sha256 of the files by name."""
    with (TABLES / "bands.toml").open("rb") as lines:
        text = tomllib.load(lines)
    return {name: text["family"][fields["family"]] | fields for name, fields in text["band"].items()}, text["files"]


def published_curve(name: str, fields: dict[str, Any], sha256: dict[str, str]) -> Curve:
    """Wavelengths [um] and responses of a band, as published."""
    if "edges_um" in fields:
        return np.array(fields["edges_um"]), np.ones(2)
    curve = read_curve(source_path(fields["file"], sha256), name)
    return times_wavelength_kang(curve) if fields.get("times_wavelength_kang") else curve


def published_band(name: str, fields: dict[str, Any], sha256: dict[str, str]) -> Band:
    """A band with all its published nodes."""
    return Band(name, *published_curve(name, fields, sha256), per_photon=fields["scale"] == "per photon")


def condensed_curve(curve: Curve, fields: dict[str, Any], stars: list[Curve]) -> Curve:
    """Nodes of a band, of peak 1, rounded as they are written; those of MSX as they are."""
    if "condensing_error" in fields:
        return curve
    wavelength_um, response = curve
    if len(wavelength_um) > LONGEST_WHOLE_TABLE:
        upper_um = Band("published", *curve).half_power_um[1]
        temperatures_k = list(blackbodies(upper_um).values())
        wavelength_um, response = condense(curve, fields["scale"] == "per photon", temperatures_k, stars)
    return np.round(wavelength_um, 6), np.round(response / response.max(), 6)


def irradiance_w_cm2(band: Band, spectrum: Curve) -> float:
    """In-band irradiance of a spectrum: the integral of the energy response times it, by the trapezoid rule."""
    low_um, high_um = band.wavelength_um[[0, -1]]
    fine_um = np.geomspace(low_um, high_um, 20_001)
    inside = spectrum[0][(spectrum[0] > low_um) & (spectrum[0] < high_um)]
    at_um = np.unique(np.concatenate([fine_um, inside, band.wavelength_um]))
    return float(np.trapezoid(band.energy_response(at_um) * np.interp(at_um, *spectrum), at_um))


def condensing_error(published: Band, condensed: Band, stars: list[Curve]) -> float:
    """Largest relative error of an in-band integral: of blackbodies with light in the band, Vega and the Sun."""
    temperature_k = np.array(list(blackbodies(published.half_power_um[1]).values()))
    ratio = band_radiance_w_m2_sr(temperature_k, condensed) / band_radiance_w_m2_sr(temperature_k, published)
    star = [irradiance_w_cm2(condensed, spectrum) / irradiance_w_cm2(published, spectrum) for spectrum in stars]
    return float(np.max(np.abs(np.concatenate([ratio, star]) - 1.0)))


def width_hz(band: Band, flux: str, nominal_um: float) -> float:
    """In-band irradiance over flux density, as the survey quotes it [Hz]; the same for every spectrum.

    "mean": the width of the energy response in frequency. "nominal": the width that nu F_nu = constant fills, at the
    wavelength nominal_um.
    """
    node_um, weight_um = band.quadrature_um
    if flux == "mean":
        return float(np.sum(weight_um * _LIGHT_UM_S / node_um**2))
    return float(np.sum(weight_um / node_um) * _LIGHT_UM_S / nominal_um)


def vega_jy(band: Band, fields: dict[str, Any], sha256: dict[str, str]) -> float:
    """Flux density of magnitude 0 [Jy] by the spectrum of Vega, as the survey quotes flux densities."""
    spectrum = read_spectrum(source_path(fields["vega"], sha256))
    scale = 10.0 ** (0.4 * fields["vega_mag"])
    if "vega_w_m2_nm_at_550_nm" in fields:
        scale *= fields["vega_w_m2_nm_at_550_nm"] / (np.interp(0.55, *spectrum) * 1e1)
    hz = width_hz(band, fields["flux"], fields.get("nominal_um", np.nan))
    return float(scale * irradiance_w_cm2(band, spectrum) / (hz * _JY_W_CM2_HZ))


def zero_point(band: Band, bands: dict[str, dict[str, Any]], sha256: dict[str, str]) -> dict[str, Any]:
    """Fields of a band's zero point: published, in-band, and what Vega's spectrum gives."""
    fields = bands[band.name]
    synthetic_jy = vega_jy(band, fields, sha256)
    if "zero_mag_of" in fields:
        other = bands[fields["zero_mag_of"]]
        other_jy = vega_jy(published_band(fields["zero_mag_of"], other, sha256), other, sha256)
        zero_mag_jy = _digits(synthetic_jy * other["zero_mag_jy"] / other_jy)
    else:
        zero_mag_jy = fields["zero_mag_jy"]
    hz = width_hz(band, fields["flux"], fields.get("nominal_um", np.nan))
    zero_mag_w_cm2 = fields.get("zero_mag_w_cm2", _digits(zero_mag_jy * _JY_W_CM2_HZ * hz))
    return {
        "zero_mag_jy": zero_mag_jy,
        "zero_mag_w_cm2": zero_mag_w_cm2,
        "w_cm2_per_jy": fields.get("w_cm2_per_jy", zero_mag_w_cm2 / zero_mag_jy),
        "flux": fields["flux"],
        "zero_point_source": fields["zero_point_source"],
        "vega_jy": _digits(synthetic_jy),
        "vega": Path(fields["vega"]).stem.rpartition("/")[2],
        "vega_mag": fields["vega_mag"],
    }


def _digits(value: float) -> float:
    """Round to six digits."""
    return float(f"{value:.6g}")


def build() -> tuple[str, str]:
    """Return the table of nodes (CSV) and that of the bands (TOML)."""
    bands, sha256 = read_definitions()
    stars = [read_spectrum(source_path(name, sha256)) for name in STARS]
    csv_lines, toml_lines = ["band,wavelength_um,response"], [_HEADER]
    for name, fields in bands.items():
        published = published_band(name, fields, sha256)
        wavelength_um, response = condensed_curve(published_curve(name, fields, sha256), fields, stars)
        band = Band(name, wavelength_um, response, per_photon=published.per_photon)
        entry: dict[str, Any] = {"title": fields["title"], "per_photon": band.per_photon}
        entry |= {key: fields[key] for key in ("isophotal_um", "nominal_um", "half_power_um") if key in fields}
        if "flux" in fields:
            entry |= zero_point(band, bands, sha256)
        entry |= {"source": fields["source"], "licence": fields["licence"]}
        error = fields.get("condensing_error") or condensing_error(published, band, stars)
        entry |= {"condensing_error": math.ceil(error * 1e5) / 1e5 if error > _ROUNDING else 0.0}
        nodes = zip(wavelength_um.tolist(), response.tolist(), strict=True)
        csv_lines += [f"{name},{um:.10g},{value:.10g}" for um, value in nodes]
        toml_lines += ["", f"[{name}]", *(f"{key} = {json.dumps(value)}" for key, value in entry.items())]
    return "\n".join(csv_lines) + "\n", "\n".join(toml_lines) + "\n"


_HEADER = """# Spectral bands shipped with warpsim; nodes in responses_v1.csv. Made by catalogs/build_responses.py.
# Licences and credits: LICENSE-responses.md."""


def main(arguments: list[str] | None = None) -> int:
    """Build both files and write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="folder to write to (default: %(default)s)")
    output: Path = parser.parse_args(arguments).output
    try:
        texts = build()
    except MissingPackageError as error:
        raise SystemExit(str(error)) from None
    for suffix, text in zip((".csv", ".toml"), texts, strict=True):
        path = output / f"responses_v1{suffix}"
        path.write_bytes(text.encode("ascii"))
        print(f"{path}: {len(text)} bytes, sha256 {hashlib.sha256(text.encode()).hexdigest()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
