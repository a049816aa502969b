"""Kernels for GPUs, without one: all compile, and their machine code keeps within registers and instructions."""

import importlib
import inspect
import json
import pkgutil
import re

import pytest
import warp as wp
import warpsim_kernels
from on_devices import device_scene
from warpsim_kernels.aim import AimFeatures
from warpsim_kernels.detector import ReadOutFeatures
from warpsim_kernels.psf import TABLE_POINTS
from warpsim_kernels.signature import Features
from warpsim_kernels.spots import gaussian_spots, table_spots
from warpsim_kernels.stamp_gradient import gaussian_stamps, table_stamps
from warpsim_kernels.stamp_light import gaussian_light, table_light
from warpsim_kernels.stars import StarFeatures
from warpsim_kernels.table_layout import CELL_DEGREES, TableLayout

from benchmarks.cubin import PACKAGES, Function, ToolMissingError, parse, tool
from benchmarks.frame_kernels import BAND, SCENES, cuda_stages, frame_kernels
from benchmarks.loops import find_loops
from benchmarks.machine_code import ARCH, UNITS, Unit, loop_of, machine_code, main, spills
from warpsim.render.pipeline import ImageStages, Pipeline
from warpsim.render.stages import RUN_THREADS

PTX_ARCH = 75  # Turing: the oldest that Warp's CUDA 13 supports; PTX runs on everything newer

EVERYTHING = Features(
    attitude_tables=True, meshes=True, sun=True, earth=True, albedo=True, profile=True, distortion=True, spectral=True
)
OF_CURVES = EVERYTHING._replace(profile=False, distortion=False, torque_free=True, patches=True)
NEI_TERMS = ReadOutFeatures(bad_pixels=True, prnu=True, dsnu=True, column_noise=True, nonlinearity=True)
ELECTRON_TERMS = NEI_TERMS._replace(electrons=True, shot_noise=True, small_means=True, read_noise=True)
READ_OUTS = [ReadOutFeatures(), NEI_TERMS, ELECTRON_TERMS]
MAPPED = NEI_TERMS._replace(maps=True)
NODES = TableLayout(0, 6)
LAYOUTS = [*(TableLayout(degree) for degree in CELL_DEGREES), *(TableLayout(0, n_point) for n_point in TABLE_POINTS)]
FACTORY_ARGUMENTS = {
    "make_aim_kernel": [(AimFeatures(track=True),), (AimFeatures(*[True] * len(AimFeatures._fields)),)],
    "make_observe_targets_kernel": [
        (Features(),),
        (EVERYTHING,),
        (EVERYTHING._replace(albedo_degree=12),),
        (EVERYTHING._replace(rolling=True),),
        (EVERYTHING._replace(torque_free=True, patches=True),),
    ],
    "make_split_kernel": [(EVERYTHING._replace(patches=True),)],
    "make_curve_views_kernel": [(Features(),), (OF_CURVES,)],
    "make_light_curve_kernel": [(Features(),), (OF_CURVES,)],
    "make_light_curve_slopes_kernel": [(Features(),), (OF_CURVES,)],
    "make_background_nodes_kernel": [(True, True)],
    "make_add_background_kernel": [(False, 64), (True, 64)],
    "make_background_of_targets_kernel": [(True,)],
    "make_profile_kernel": [(Features(profile=True),), (EVERYTHING._replace(patches=True),)],
    "make_reach_kernel": [(False,), (True,)],
    "make_trace_targets_kernel": [(False,), (True,)],
    "make_trace_stars_kernel": [(False,), (True,)],
    "make_locate_targets_kernel": [(False,), (True,)],
    "make_star_functions": [],  # functions of the kernels below
    "make_gather_stars_kernel": [(StarFeatures(aberration=True), 1), (StarFeatures(*[True] * 5), 32)],
    "make_query_cone_kernel": [(wp.vec3d,), (wp.vec3f,)],
    "make_deposit_gaussian_kernel": [(False,), (True,)],
    "make_deposit_table_kernel": [*((layout, False) for layout in LAYOUTS), (NODES, True), (LAYOUTS[0], True)],
    "make_light_kernel": [
        (light, streaks)
        for light in (gaussian_light(), table_light(NODES), table_light(LAYOUTS[1]))
        for streaks in (False, True)
    ],
    "make_blend_kernel": [(gaussian_light(), False), (table_light(NODES), True), (table_light(LAYOUTS[1]), False)],
    "make_bounds_kernel": [
        (gaussian_light(), gaussian_stamps(False), False, False),
        (table_light(NODES), table_stamps(NODES), True, True),
        (table_light(LAYOUTS[1]), table_stamps(LAYOUTS[1]), True, True),
    ],
    "make_gather_kernel": [
        (gaussian_light(), gaussian_stamps(True), True, False),
        *((table_light(layout), table_stamps(layout), layout == NODES, True) for layout in LAYOUTS),
    ],
    "make_jacobian_kernel": [
        (gaussian_light(), gaussian_stamps(True), False, False),
        (table_light(NODES), table_stamps(NODES), True, True),
        (table_light(LAYOUTS[1]), table_stamps(LAYOUTS[1]), True, True),
    ],
    "make_half_read_out": [],  # functions of the kernels below
    "make_noise_keys": [],
    "make_map_plane": [],
    "make_counts_of_pairs": [],
    "make_read_out_kernel": [(features, ragged) for features in (*READ_OUTS, MAPPED) for ragged in (False, True)],
    "make_find_spots_kernel": [(gaussian_spots(),), (table_spots(TableLayout(5)),), (table_spots(TableLayout(0, 6)),)],
    "make_deposit_read_out_kernel": [
        *((gaussian_spots(), features, RUN_THREADS) for features in READ_OUTS),
        *((table_spots(layout), ReadOutFeatures(), RUN_THREADS) for layout in LAYOUTS),
    ],
}

MODULES = [
    importlib.import_module(f"warpsim_kernels.{item.name}") for item in pkgutil.iter_modules(warpsim_kernels.__path__)
]


def plain_kernels(module):
    """Kernels that the module itself defines."""
    kernels = [item for item in vars(module).values() if isinstance(item, wp.Kernel)]
    return [kernel for kernel in kernels if kernel.func.__module__ == module.__name__]


def factories(module):
    """Functions of the module that make kernels."""
    return {
        name: item
        for name, item in vars(module).items()
        if name.startswith("make_") and callable(item) and inspect.unwrap(item).__module__ == module.__name__
    }


PLAIN = [module for module in MODULES if plain_kernels(module)]
MADE = [
    (factory, arguments)
    for module in MODULES
    for name, factory in factories(module).items()
    for arguments in FACTORY_ARGUMENTS.get(name, [])
]


@pytest.fixture(scope="module", autouse=True)
def _needs_nvrtc():
    wp.init()
    if PTX_ARCH not in wp.get_cuda_supported_archs():
        pytest.skip(f"this build of Warp cannot compile CUDA code for sm_{PTX_ARCH}")


def compiled_text(warp_module, folder):
    """PTX of a Warp module."""
    paths = wp.compile_aot_module(warp_module, arch=PTX_ARCH, module_dir=folder, use_ptx=True)
    (ptx,) = [path for path in paths if path.suffix == ".ptx"]
    return ptx.read_text()


@pytest.mark.parametrize("module", PLAIN, ids=lambda module: module.__name__.rpartition(".")[2])
@pytest.mark.ci
def test_kernels_of_a_module_build(module, tmp_path):
    for kernel in plain_kernels(module):
        text = compiled_text(kernel.module, tmp_path / kernel.key)
        assert f".target sm_{PTX_ARCH}" in text
        assert f".entry {kernel.key}_" in text


def _case(factory, arguments):
    number = FACTORY_ARGUMENTS[factory.__name__].index(arguments)
    is_extreme = number in (0, len(FACTORY_ARGUMENTS[factory.__name__]) - 1)
    marks = pytest.mark.ci if is_extreme else pytest.mark.slow
    return pytest.param(factory, arguments, id=f"{factory.__name__}-{number}", marks=marks)


@pytest.mark.parametrize(("factory", "arguments"), [_case(*made) for made in MADE])
def test_made_kernels_build(factory, arguments, tmp_path):
    kernel = factory(*arguments)
    if factory.__name__ == "make_deposit_read_out_kernel":
        kernel.module.options["block_dim"] = RUN_THREADS  # as it is launched
    text = compiled_text(kernel.module, tmp_path)
    assert f".target sm_{PTX_ARCH}" in text
    assert f".entry {kernel.key}_" in text


def test_no_kernel_is_forgotten():
    """Each factory has arguments here, and the modules are those of the stages."""
    made = {name for module in MODULES for name in factories(module)}
    assert made == set(FACTORY_ARGUMENTS)
    names = {module.__name__.rpartition(".")[2] for module in PLAIN}
    assert names >= {"trace", "stamp_sizes", "shapes"}


MOST_REGISTERS = 128
"""So 512 threads fill a multiprocessor's 65,536 registers; with more a kernel waits for its memory alone."""

MEASURED_WITH = "1.19."
"""Versions of Warp whose compiler the figures below are of."""

# Kernels that do not meet the line yet: registers, spill stores, spill loads, as measured. They may not get worse.
PRESENT = {
    ("aim", "stss, Gaussian"): (160, 0, 0),
    ("observe_targets", "stss, Gaussian"): (255, 52, 61),
    ("observe_targets", "in sunlight, exposure, Gaussian"): (255, 77, 116),
    ("gather_stars", "stss, Gaussian"): (164, 0, 0),
    ("gather_stars", "in sunlight, exposure, Gaussian"): (187, 0, 0),
    ("deposit_gaussian", "in sunlight, exposure, Gaussian"): (168, 0, 0),
    ("deposit_table", "stss, Airy"): (168, 0, 0),
    ("deposit_table", "in sunlight, exposure, Airy"): (255, 4, 0),
}
MOST_PER_PAIR = 100
"""Instructions of a pixel pair where deposit and read-out are one kernel."""

PRESENT_PER_PAIR = 155
"""The same of the stage read_out alone, as measured: it may not get worse."""

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


@pytest.mark.ci
@pytest.mark.parametrize(
    "changes", [{}, {"detector__exposure_s": 0.1, "camera__n_row": 41}, {"detector__line_time_s": 1e-4}]
)
def test_stages_are_those_of_a_pipeline(scene, changes):
    """In order, with the kernels that the pipeline would launch, but in blocks of CUDA's size, and what CUDA adds."""
    on_cpu = device_scene(scene.replace(**changes), [BAND])
    pipeline, on_cuda = Pipeline(on_cpu, 2, 128), cuda_stages(on_cpu)
    ((_, _, (deposit,), (read_out,)),) = ImageStages(on_cpu, pipeline.own, pipeline._stand_in)._parts
    theirs = [*pipeline._view_stages, deposit, read_out]
    added = [] if changes else ["find_spots", "deposit_read_out"]
    assert [stage.name for stage in on_cuda] == [stage.name for stage in theirs] + added
    for stage, other in zip(on_cuda, theirs, strict=False):
        if stage.name == "gather_stars":  # by other numbers of threads
            assert stage.launches[0].kernel.key == other.launches[0].kernel.key
        else:
            assert [launch.kernel for launch in stage.launches] == [launch.kernel for launch in other.launches]
    blocks = [
        [launch.block_dim for launch in read_out.launches],
        [launch.block_dim for launch in on_cuda[-1].launches],
    ]
    assert set(blocks[0]) == {1} and 1 not in blocks[1]


@pytest.mark.ci
def test_list_is_that_of_the_scenes():
    """Every stage has a kernel in it, and what each takes is known."""
    kernels = frame_kernels()
    stages = [
        "aim",
        "observe_targets",
        "gather_stars",
        "trace",
        "deposit",
        "read_out",
        "find_spots",
        "deposit_read_out",
    ]
    assert {kernel.stage for kernel in kernels} == set(stages)
    assert {kernel.scene for kernel in kernels} == set(SCENES)
    assert {kernel.name for kernel in kernels} <= set(UNITS)
    assert {kernel.block_dim for kernel in kernels if kernel.stage == "read_out"} != {1}


@pytest.mark.slow
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
    for name, most in (("deposit_read_out", MOST_PER_PAIR), ("read_out", PRESENT_PER_PAIR)):
        plain = next(row for row in rows if row.kernel == name)
        assert plain.unit == "pixel pair" and 70 < plain.instructions_per_unit <= most, name


@pytest.mark.ci
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
