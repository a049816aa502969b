"""Machine code of the kernels of a frame on CUDA: registers, stack, spills, instructions; made without a GPU.

    python -m pip install -e '.[gpu-tables]'
    python -m benchmarks.machine_code --json benchmarks/results/machine_code.json

Warp's own compiler (NVRTC) makes the machine code of sm_90, for the threads of a block that the stages launch; nothing
is run. A kernel stands with the first scene that needs it.

**Spilled** are accesses to fixed addresses of a thread's stack, stores and loads as they stand in the code, in a kernel
that uses all the registers that it may: 255, or what its launch bounds leave. Arrays that are addressed by index lie on
the stack, too. In a kernel with registers to spare they are all there is; in one without, the two look alike.

**Instructions of a unit** are those of one pass through the loop that takes a unit, for the units of a pass, or of a
thread's whole work where it has one unit. They are counted as they stand in the code: both sides of every branch, inner
loops once, subroutines for rare cases of divisions and roots not at all. A pixel pair is one thread's part of a pass
through the loop over strips, with reading light and putting it out again; random keys, once for 16 strips, come before
the loop. That loop has no inner one, so the figure is an upper bound. For targets and sources it is the size of the
code, as the rows and columns of a stamp are passed many times. **At least** is the shortest way through the same loop:
for a source one that does not touch the thread's rows, for a star one that is not in view.
"""

from __future__ import annotations

import argparse
import datetime
import json
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import warp as wp
from warpsim_kernels.canvas import N_PAIR, PAIRS_PER_BLOCK

from benchmarks.cubin import PACKAGES, Function, ToolMissingError, read_function, tool
from benchmarks.frame_kernels import SCENES, FrameKernel, compiled, frame_kernels
from benchmarks.loops import Loop, find_loops
from benchmarks.tables import machine_code_table

ARCH = 90


@dataclass(frozen=True)
class Unit:
    """Loop of a kernel, and what one pass is for."""

    name: str
    depth: int = 0
    """Loops around the one that takes a unit. Warp's own loop, of a thread over the grid, has depth 0; of several loops
    as deep, the one with most code counts."""
    per_block: int | None = None
    """Units that a block of threads takes in a pass; one for each thread where left out."""
    is_last: bool = False
    """Of several loops as deep, the last one in the code counts."""


UNITS = {
    "aim": Unit("view"),
    "spread_views": Unit("instant of a view"),
    "reach": Unit("view"),
    "observe_targets": Unit("target", 1),
    "profile": Unit("target and band"),
    "gather_stars": Unit("star", 2),
    "trace_targets": Unit("target"),
    "trace_stars": Unit("star"),
    "deposit_gaussian": Unit("source", 1),
    "deposit_table": Unit("source", 1),
    "read_out": Unit("pixel pair", 1, N_PAIR),
    "find_spots": Unit("source"),
    "deposit_read_out": Unit("pixel pair", 0, PAIRS_PER_BLOCK, is_last=True),
}
"""By the name of the kernel; of others, a thread's whole work."""


@dataclass(frozen=True)
class MachineCode:
    """A row of the table."""

    kernel: str
    scene: str
    block_dim: int
    registers: int
    spill_stores: int
    spill_loads: int
    stack_bytes: int
    instructions: int
    """Of the whole kernel with its subroutines."""
    unit: str
    instructions_per_unit: float
    least_per_unit: float


def machine_code(kernel: FrameKernel, arch: int = ARCH) -> MachineCode:
    """Compile a kernel and look at its machine code.

    Raises:
        ToolMissingError: cuobjdump or nvdisasm is not installed.
    """
    with tempfile.TemporaryDirectory() as folder:
        function = read_function(compiled(kernel, arch, Path(folder) / "cubin"), kernel.kernel.key)
    unit = UNITS.get(kernel.name, Unit("thread"))
    loop = loop_of(unit, find_loops(function.instructions, function.label))
    per_thread = 1.0 if unit.per_block is None else unit.per_block / kernel.block_dim
    stores, loads = spills(function)
    return MachineCode(
        kernel.name,
        kernel.scene,
        kernel.block_dim,
        function.n_register,
        stores,
        loads,
        function.stack_bytes,
        sum(item.opcode != "NOP" for item in function.instructions),
        unit.name,
        loop.n_all / per_thread,
        loop.n_least / per_thread,
    )


def loop_of(unit: Unit, loops: list[Loop]) -> Loop:
    """The loop that takes a unit.

    Raises:
        ValueError: No loop is so deep.
    """
    as_deep = [loop for loop in loops if loop.depth == unit.depth]
    if not as_deep:
        raise ValueError(f"no loop of depth {unit.depth} for a {unit.name}")
    return max(as_deep, key=lambda loop: loop.first if unit.is_last else loop.n_all)


def spills(function: Function) -> tuple[int, int]:
    """Stores and loads of spilled registers; registers are handed out by eights."""
    if function.n_register <= function.most_registers - 8:
        return 0, 0
    opcodes = [item.opcode for item in function.instructions if item.is_in_frame]
    return opcodes.count("STL"), opcodes.count("LDL")


def result(rows: list[MachineCode]) -> dict[str, Any]:
    """Return the rows as the other benchmarks keep theirs, with the compiler instead of the machine."""
    toolkit = ".".join(map(str, wp.get_cuda_toolkit_version()))
    return {
        "compiler": f"sm_{ARCH}, Warp {wp.__version__}, CUDA {toolkit}",
        "datetime": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "benchmarks": [{"name": row.kernel, "extra_info": asdict(row)} for row in rows],
    }


def main(arguments: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures")
    options = parser.parse_args(arguments)
    wp.config.log_level = wp.LOG_ERROR
    try:
        for name in PACKAGES:
            tool(name)
    except ToolMissingError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    rows: list[MachineCode] = []
    for kernel in frame_kernels(SCENES):
        print(f"{kernel.name}: {kernel.scene}", file=sys.stderr, flush=True)
        rows.append(machine_code(kernel))
    data = result(rows)
    print("\n".join([data["compiler"], "", *machine_code_table([asdict(row) for row in rows])]))
    if options.json:
        options.json.write_text(json.dumps(data, indent=1) + "\n", "utf-8")
        print(f"\nfigures in {options.json}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
