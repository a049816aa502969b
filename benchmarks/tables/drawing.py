"""Tables of single stages: drawing sources, reading out."""

from __future__ import annotations

from benchmarks.tables.markdown import Case, shown, table


def deposit_table(cases: list[Case]) -> list[str]:
    """Drawing: time per source against the error of the worst pixel, way by way."""
    return table(
        "what | way | ns per source | error of the worst pixel | light left out",
        (
            (
                c["group"],
                c["way"],
                f"{c['ns_per_source']:,.0f}",
                f"{c['deposit_error']:.1e}",
                shown(c.get("left_out"), ".1e"),
            )
            for c in sorted(cases, key=lambda c: (c["group"], c["ns_per_source"]))
        ),
    )


def read_out_table(cases: list[Case]) -> list[str]:
    """Read-out: time by the terms of the detector, with the error of its noise."""
    return table(
        "detector | ns per pixel | distance from a Gaussian",
        ((c["detector"], f"{c['ns_per_pixel']:.2f}", shown(c["distance"], ".1e")) for c in cases),
    )
