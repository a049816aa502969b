"""Registers, spills and instructions of the kernels of a frame on sm_90: made without a GPU, held to lines."""

import json
import re

import pytest
import warp as wp

from benchmarks.cubin import PACKAGES, Function, ToolMissingError, parse, tool
from benchmarks.frame_kernels import SCENES, frame_kernels
from benchmarks.loops import find_loops
from benchmarks.machine_code import ARCH, UNITS, Unit, loop_of, machine_code, main, spills
from warpsim.render.stages import IMAGE_STAGES, VIEW_STAGES

MOST_REGISTERS = 128
"""Two blocks of 256 threads fill a multiprocessor's 65,536 registers; with more a kernel waits for its memory alone."""

MEASURED_WITH = "1.19."
"""Versions of Warp whose compiler the figures below are of."""

# Kernels that do not meet the line yet: registers, spill stores, spill loads, as measured. They may not get worse.
PRESENT = {
    ("aim", "stss, Gaussian"): (168, 0, 0),
    ("observe_targets", "stss, Gaussian"): (255, 81, 93),
    ("observe_targets", "in sunlight, exposure, Gaussian"): (255, 103, 136),
    ("gather_stars", "in sunlight, exposure, Gaussian"): (135, 0, 0),
    ("trace_targets", "in sunlight, exposure, Gaussian"): (144, 0, 0),
    ("deposit_gaussian", "stss, Gaussian"): (167, 0, 0),
    ("deposit_gaussian", "in sunlight, exposure, Gaussian"): (168, 0, 0),
    ("deposit_table", "in sunlight, exposure, Airy"): (255, 4, 3),
}
PRESENT_PER_PAIR = 167
"""Instructions of a pixel pair of the plain read-out, as measured: it may not get worse, either."""

# A loop with an inner one and a rare case that is laid out behind the exit; a subroutine, which nothing jumps to.
LOOPS = """
        /*0000*/                   LDC R1, c[0x0][0x28] ;
.L_x_0:
        /*0010*/                   IADD3 R2, R2, 0x1, RZ ;
        /*0020*/              @!P1 BRA `(.L_x_2) ;
.L_x_1:
        /*0030*/                   FFMA R3, R3, R4, R5 ;
        /*0040*/                   FADD R3, R3, R3 ;
        /*0050*/                   BRA P0, `(.L_x_1) ;
        /*0060*/                   STL [R1+0x4], R3 ;
.L_x_3:
        /*0070*/                   LDL R3, [R1+0x4] ;
        /*0080*/                   LDL R4, [R7] ;
        /*0090*/               @P0 BRA `(.L_x_0) ;
        /*00a0*/                   EXIT ;
.L_x_2:
        /*00b0*/                   MOV R3, RZ ;
        /*00c0*/                   BRA `(.L_x_3) ;
$slow:
        /*00d0*/                   RET.REL.NODEC R8 `(kernel) ;
.L_x_9:
        /*00e0*/                   BRA `(.L_x_9);
        /*00f0*/                   NOP ;
"""


def needs_tools():
    """Skip where there is no compiler for the machine code, or nothing to read it with."""
    wp.init()
    if ARCH not in wp.get_cuda_supported_archs():
        pytest.skip(f"this build of Warp cannot compile CUDA code for sm_{ARCH}")
    try:
        for name in PACKAGES:
            tool(name)
    except ToolMissingError as error:
        pytest.skip(str(error))


def test_loops_are_found_from_branches():
    instructions, label = parse(LOOPS)
    assert len(instructions) == 16 and label[".L_x_3"] == 7 and instructions[2].predicate == "!P1"
    outer, inner = find_loops(instructions, label)
    assert (outer.first, outer.depth, outer.n_all) == (1, 0, 11)
    assert outer.n_least == 2 + 2 + 3  # by the rare case
    assert (inner.first, inner.depth, inner.n_all, inner.n_least) == (3, 1, 3, 3)
    assert loop_of(Unit("pixel", 1), [outer, inner]) is inner
    with pytest.raises(ValueError, match="no loop of depth 2 for a pixel"):
        loop_of(Unit("pixel", 2), [outer, inner])


@pytest.mark.parametrize(("n_register", "most", "spilled"), [(255, 255, (1, 1)), (96, 255, (0, 0)), (64, 64, (1, 1))])
def test_stack_counts_as_spilled_where_registers_are_used_up(n_register, most, spilled):
    instructions, label = parse(LOOPS)
    assert spills(Function(n_register, most, 32, instructions, label)) == spilled


def test_list_is_that_of_the_stages():
    """In CUDA's sizes, every stage with a kernel in it, and what each takes is known."""
    kernels = frame_kernels()
    assert {kernel.stage for kernel in kernels} == {stage.__name__ for stage in (*VIEW_STAGES, *IMAGE_STAGES)}
    assert {kernel.scene for kernel in kernels} == set(SCENES)
    assert {kernel.name for kernel in kernels} <= set(UNITS)
    assert {kernel.block_dim for kernel in kernels if kernel.stage == "read_out"} != {1}


def test_kernels_of_a_frame_stay_within_the_line():
    needs_tools()
    if not wp.__version__.startswith(MEASURED_WITH):
        pytest.skip(f"the figures are of the compiler of Warp {MEASURED_WITH}x")
    rows = [machine_code(kernel) for kernel in frame_kernels()]
    too_much = []
    for row in rows:
        most = PRESENT.get((row.kernel, row.scene), (MOST_REGISTERS, 0, 0))
        found = row.registers, row.spill_stores, row.spill_loads
        if any(value > limit for value, limit in zip(found, most, strict=True)):
            too_much.append(f"{row.kernel}, {row.scene}: registers, spill stores, spill loads {found}, at most {most}")
    assert not too_much, "\n".join(too_much)
    plain = next(row for row in rows if row.kernel == "read_out")
    assert plain.unit == "pixel pair" and plain.instructions_per_unit <= PRESENT_PER_PAIR


def test_table_and_figures(capsys, monkeypatch, tmp_path):
    needs_tools()
    kernels = [kernel for kernel in frame_kernels({"stss": {}}) if kernel.name == "read_out"]
    monkeypatch.setattr("benchmarks.machine_code.frame_kernels", lambda scenes: kernels)
    path = tmp_path / "machine_code.json"
    assert main(["--json", str(path)]) == 0
    (case,) = [item["extra_info"] for item in json.loads(path.read_text())["benchmarks"]]
    assert case["kernel"] == "read_out" and case["block_dim"] == kernels[0].block_dim
    assert 0 < case["least_per_unit"] <= case["instructions_per_unit"] < case["instructions"]
    out = capsys.readouterr().out
    assert re.search(rf"^\| read_out \| stss \| \d+ \| {case['registers']} \| 0, 0 \| 0 \| ", out, re.MULTILINE)


def test_tool_is_named_where_it_is_missing(monkeypatch, capsys):
    monkeypatch.setitem(PACKAGES, "cuobjdump", "no-such-wheel")
    monkeypatch.setattr("shutil.which", lambda name: None)
    with pytest.raises(ToolMissingError, match=re.escape("needs cuobjdump: pip install no-such-wheel")):
        tool("cuobjdump")
    with pytest.raises(SystemExit) as stopped:
        main([])
    assert stopped.value.code == 2 and "needs cuobjdump" in capsys.readouterr().err
