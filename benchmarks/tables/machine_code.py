"""Table of the machine code of kernels."""

from __future__ import annotations

from benchmarks.tables.markdown import Case, table


def machine_code_table(cases: list[Case]) -> list[str]:
    """Registers, spills and instructions of each kernel, in the order of the stages."""
    return table(
        "kernel | scene | threads of a block | registers | spilled: stores, loads | stack [bytes] | instructions "
        "| unit | instructions of a unit | at least",
        (
            (
                c["kernel"],
                c["scene"],
                c["block_dim"],
                c["registers"],
                f"{c['spill_stores']}, {c['spill_loads']}",
                c["stack_bytes"],
                f"{c['instructions']:,}",
                c["unit"],
                f"{c['instructions_per_unit']:,.0f}",
                f"{c['least_per_unit']:,.0f}",
            )
            for c in cases
        ),
    )
