"""Tables of orbits and access."""

from __future__ import annotations

from benchmarks.tables.markdown import Case, table


def access_table(cases: list[Case]) -> list[str]:
    """Access: time against the number of satellites and the rules, with what a fine scan says of the intervals."""
    return table(
        "satellites | rules | step [s] | intervals | seconds | us per satellite and step | lost + extra "
        "| worst end [ms]",
        (
            (
                f"{c['n_satellite']:,}",
                c["rules"],
                f"{c['step_s']:g}",
                f"{c['n_interval']:,}",
                f"{c['access_s']:.2f}",
                f"{c['us_per_pair']:.2f}",
                f"{c['lost']} + {c['extra']} of {c['n_right']}",
                f"{c['end_error_ms']:.2f}",
            )
            for c in sorted(cases, key=lambda c: (c["n_satellite"], c["access_s"]))
        ),
    )


def orbits_table(cases: list[Case]) -> list[str]:
    """Orbits: time for a day in steps of 30 s against the error at its end."""
    return table(
        "method | satellites | seconds | error after a day [m]",
        (
            (c["method"], f"{c['n_satellite']:,}", f"{c['propagation_s']:.3f}", f"{c['error_m']:.1e}")
            for c in sorted(cases, key=lambda c: (c["method"], c["n_satellite"]))
        ),
    )
