"""Every kernel builds for CUDA, with or without a GPU in the machine: Warp's NVRTC compiles it to PTX."""

import importlib
import inspect
import pkgutil

import pytest
import warp as wp
import warpsim_kernels
from warpsim_kernels.aim import AimFeatures
from warpsim_kernels.detector import ReadOutFeatures
from warpsim_kernels.psf import TABLE_POINTS
from warpsim_kernels.signature import Features
from warpsim_kernels.spots import gaussian_spots, table_spots
from warpsim_kernels.stamp_light import gaussian_light, table_light
from warpsim_kernels.stars import StarFeatures
from warpsim_kernels.table_layout import CELL_DEGREES, TableLayout

from warpsim.render.stages import RUN_THREADS

ARCH = 75  # Turing: the oldest that Warp's CUDA 13 supports; PTX runs on everything newer

EVERYTHING = Features(
    attitude_tables=True, meshes=True, sun=True, earth=True, albedo=True, profile=True, distortion=True, spectral=True
)
SERIES = EVERYTHING._replace(albedo_degree=12, earth_degree=14)
NEI_TERMS = ReadOutFeatures(bad_pixels=True, prnu=True, dsnu=True, column_noise=True, nonlinearity=True)
ELECTRON_TERMS = NEI_TERMS._replace(electrons=True, shot_noise=True, small_means=True, read_noise=True)
READ_OUTS = [ReadOutFeatures(), NEI_TERMS, ELECTRON_TERMS]
NODES = TableLayout(0, 6)
LAYOUTS = [*(TableLayout(degree) for degree in CELL_DEGREES), *(TableLayout(0, n_point) for n_point in TABLE_POINTS)]
FACTORY_ARGUMENTS = {
    "make_aim_kernel": [(AimFeatures(track=True),), (AimFeatures(*[True] * len(AimFeatures._fields)),)],
    "make_observe_targets_kernel": [(Features(),), (EVERYTHING,), (SERIES,)],
    "make_albedo_series_kernel": [(4,), (12,)],
    "make_albedo_table_kernel": [(4,), (12,)],
    "make_split_kernel": [(EVERYTHING,)],
    "make_profile_kernel": [(Features(profile=True),), (EVERYTHING,)],
    "make_reach_kernel": [(False,), (True,)],
    "make_trace_targets_kernel": [(False,), (True,)],
    "make_trace_stars_kernel": [(False,), (True,)],
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
    "make_half_read_out": [],  # functions of the kernels below
    "make_noise_keys": [],
    "make_counts_of_pairs": [],
    "make_read_out_kernel": [(features, ragged) for features in READ_OUTS for ragged in (False, True)],
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
    if ARCH not in wp.get_cuda_supported_archs():
        pytest.skip(f"this build of Warp cannot compile CUDA code for sm_{ARCH}")


def compiled_text(warp_module, folder):
    """PTX of a Warp module."""
    paths = wp.compile_aot_module(warp_module, arch=ARCH, module_dir=folder, use_ptx=True)
    (ptx,) = [path for path in paths if path.suffix == ".ptx"]
    return ptx.read_text()


@pytest.mark.parametrize("module", PLAIN, ids=lambda module: module.__name__.rpartition(".")[2])
@pytest.mark.ci
def test_kernels_of_a_module_build(module, tmp_path):
    text = compiled_text(plain_kernels(module)[0].module, tmp_path)
    assert f".target sm_{ARCH}" in text
    for kernel in plain_kernels(module):
        assert f".entry {kernel.key}_" in text


def _case(factory, arguments):
    """By rules, light from the Earth takes ten seconds to compile."""
    is_long = factory.__name__ == "make_observe_targets_kernel" and arguments == (EVERYTHING,)
    marks = pytest.mark.slow if is_long else ()
    number = FACTORY_ARGUMENTS[factory.__name__].index(arguments)
    return pytest.param(factory, arguments, id=f"{factory.__name__}-{number}", marks=marks)


@pytest.mark.parametrize(("factory", "arguments"), [_case(*made) for made in MADE])
@pytest.mark.ci
def test_made_kernels_build(factory, arguments, tmp_path):
    kernel = factory(*arguments)
    text = compiled_text(kernel.module, tmp_path)
    assert f".target sm_{ARCH}" in text
    assert f".entry {kernel.key}_" in text


def test_no_kernel_is_forgotten():
    """Each factory has arguments here, and the modules are those of the stages."""
    made = {name for module in MODULES for name in factories(module)}
    assert made == set(FACTORY_ARGUMENTS)
    names = {module.__name__.rpartition(".")[2] for module in PLAIN}
    assert names >= {"trace", "stamp_sizes", "shapes"}
