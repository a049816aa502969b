"""Print the tables of docs/reference/bands.md, from the shipped data.

python catalogs/list_responses.py
"""

from __future__ import annotations

from itertools import groupby

import numpy as np
from astropy.table import Row

import warpsim


def number_lines() -> list[str]:
    """Return the lines of the Markdown table of half power, zero points and condensing errors."""
    lines = [
        "| band | curve by | half power um | nodes | error | zero point Jy | in-band W/cm2 | Vega Jy | difference |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    bands = warpsim.bands()
    for row in bands.to_table():
        curve = "photon" if row["per_photon"] else "energy"
        half_power = f"{row['lower_um']:.4g}-{row['upper_um']:.4g}"
        error = f"{100 * row['condensing_error']:.2g} %" if row["condensing_error"] else "0"
        facts = [row["name"], curve, half_power, str(len(bands[row["name"]].wavelength_um)), error]
        lines.append("| " + " | ".join(facts + _zero_point(row)) + " |")
    return lines


def source_lines() -> list[str]:
    """Return the lines of the Markdown table of sources and licences, bands of the same ones together."""
    lines = ["| bands | curve | zero point | licence |", "|---|---|---|---|"]
    for texts, rows in groupby(warpsim.bands().to_table(), key=_texts):
        names = ", ".join(str(row["name"]) for row in rows)
        lines.append(f"| {names} | " + " | ".join(text or "-" for text in texts) + " |")
    return lines


def _zero_point(row: Row) -> list[str]:
    if np.isnan(row["zero_mag_jy"]):
        return ["-"] * 4
    difference = f"{100 * (row['zero_mag_jy'] / row['vega_jy'] - 1):+.1f} %"
    return [f"{row['zero_mag_jy']:.6g}", f"{row['zero_mag_w_cm2']:.4g}", f"{row['vega_jy']:.5g}", difference]


def _texts(row: Row) -> tuple[str, str, str]:
    return str(row["source"]), str(row["zero_point_source"]), str(row["licence"])


if __name__ == "__main__":
    print("\n".join([*number_lines(), "", *source_lines()]))
