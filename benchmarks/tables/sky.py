"""Tables of stars: look-up and apparent places."""

from __future__ import annotations

from benchmarks.tables.markdown import Case, shown, table


def places_table(cases: list[Case]) -> list[str]:
    """Apparent places: time against error."""
    return table(
        "steps on | us per view | error [arcsec] | bytes per star",
        (
            (c["switches"], f"{c['us_per_view']:.2f}", f"{c['error_arcsec']:.1e}", f"{c['bytes_per_star']:.1f}")
            for c in sorted(cases, key=lambda c: -c["error_arcsec"])
        ),
    )


def star_tables(cases: list[Case]) -> list[str]:
    """Star look-up: time, errors and memory against the number of stars; then time at a fixed density."""
    queries = sorted((c for c in cases if c["kind"] == "query"), key=lambda c: (c["n_star"], c["method"], c["device"]))
    zones = sorted(
        (c for c in cases if c["kind"] == "fixed density"), key=lambda c: (c["device"], c["method"], c["n_star"])
    )
    lines = _query_table(queries, {_key(c): c["build_s"] for c in cases if c["kind"] == "build"}) if queries else []
    if zones:
        lines += ["", "The same views of equally dense catalogs:", ""]
        lines += table(
            "stars in the catalog | method | device | us per cone | stars found per cone",
            (
                (f"{c['n_star']:,}", c["method"], c["device"], f"{c['us_per_cone']:.1f}", _found(c))
                for c in zones
            ),
        )  # fmt: skip
    return lines


def _query_table(queries: list[Case], build_s: dict[tuple[int, str, str], float]) -> list[str]:
    return table(
        "stars | method | device | us per cone | stars found per cone | lost + extra | displaced [arcsec] "
        "| tested per found | bytes per star | on the device [MB] | build [s]",
        (
            (
                f"{c['n_star']:,}",
                c["method"],
                c["device"],
                f"{c['us_per_cone']:,.3g}" if c["us_per_cone"] < 100 else f"{c['us_per_cone']:,.0f}",
                _found(c),
                f"{c['lost']} + {c['extra']} of {c['n_right']:,}",
                shown(c.get("displaced_arcsec"), ".2g"),
                shown(c.get("tested_per_found"), ".1f"),
                shown(c.get("bytes_per_star"), ".1f"),
                shown(c.get("device_mb"), ",.1f"),
                shown(build_s.get(_key(c)), ".3g"),
            )
            for c in queries
        ),
    )


def _found(case: Case) -> str:
    return f"{case['n_found'] / case['n_cone']:.1f}"


def _key(case: Case) -> tuple[int, str, str]:
    """Columns common to a query and the building of its index."""
    return case["n_star"], case["method"], case["device"]
