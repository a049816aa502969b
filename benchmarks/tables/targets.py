"""Tables of the light of targets."""

from __future__ import annotations

from benchmarks.tables.markdown import Case, table


def signatures_table(cases: list[Case]) -> list[str]:
    """Signatures: observations a second by terms and threads; then time against the error of quadratures."""
    terms = sorted((c for c in cases if c["kind"] == "terms"), key=lambda c: (-c["observations_per_s"], c["n_thread"]))
    errors = sorted((c for c in cases if c["kind"] == "error"), key=lambda c: (c["exposure_s"], -c["asked"]))
    return [
        *table(
            "terms | threads | targets observed per second | us each",
            (
                (c["terms"], c["n_thread"], f"{c['observations_per_s']:,.0f}", f"{c['us_per_observation']:.2f}")
                for c in terms
            ),
        ),
        "",
        *table(
            "exposure [s] | error asked | error of the light | us each",
            (
                (
                    f"{c['exposure_s']:g}",
                    f"{c['asked']:.0e}",
                    f"{c['light_error']:.1e}",
                    f"{c['us_per_observation']:.2f}",
                )
                for c in errors
            ),
        ),
    ]
