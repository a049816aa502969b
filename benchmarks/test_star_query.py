"""Star look-up: time against the size of the catalog, the memory it takes, and the stars it gets wrong.

    python -m pytest benchmarks/test_star_query.py --benchmark-json=benchmarks/results/star_query.json
    python benchmarks/report.py benchmarks/results/star_query.json

Cones of 0.72 degrees, the half diagonal of a 1 x 1 degree image and a little more, in random directions. `BandIndex`
with float64 and float32 directions is compared with SciPy's k-d tree and with a scalar product over all stars, all with
rows sorted; the index's time includes the transfers. Beside its time each case carries its errors: stars lost and
added, against exact angles in float64, and how far the stored directions are from the catalog's.

Views per second should depend on how many stars are near, not on how many there are elsewhere: `test_fixed_density`
asks the same questions of catalogs that cover a hundredth, a tenth and all of the sky equally densely.

Ten million stars take about 6 GB and a few minutes: leave them out with -k "not 1e7".
"""

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import warp as wp
from scipy.spatial import cKDTree
from warpsim_kernels.band_index import cone_cover, run_of_stars

import warpsim as ws
from benchmarks.devices import benchmark_devices

SIZES = {"1e5": 100_000, "1e6": 1_000_000, "1e7": 10_000_000}
N_CONE, RADIUS_RAD = 2_000, np.radians(0.72)
N_CONE_BRUTE = 10
N_CONE_CHECKED = 20
"""Cones in which the reference itself is checked by brute force."""
SEED = 8280
SMALLER = 5_000
"""Divisor of sizes when benchmarks are disabled: only to see that it runs."""

DTYPES = ("float64", "float32")
OTHER_METHODS = {"test_query": ["k-d tree", "brute force"], "test_build": ["k-d tree"]}
"""Catalogs that the index is compared with, by test; on the host only."""

# A hundredth of the sky: 18 degrees wide, sin(dec) from -0.2 to 0.2. A tenth: ten times as wide.
ZONES = {"1e5": (18.0, 0.2), "1e6": (180.0, 0.2), "1e7": (360.0, 1.0)}

by_size = pytest.mark.parametrize("size", SIZES)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Ask an index of either kind of directions on each device, and the other methods."""
    indexes = [f"index {dtype}, {device}" for device in benchmark_devices(metafunc.config) for dtype in DTYPES]
    metafunc.parametrize("method", [*indexes, *OTHER_METHODS.get(metafunc.function.__name__, [])])


def is_index(method: str) -> bool:
    return method.startswith("index ")


@dataclass(frozen=True)
class Case:
    """A catalog and the cones that are looked up in it."""

    catalog: ws.StarCatalog
    axis: np.ndarray
    """Shape (n_cone, 3)."""

    @functools.cached_property
    def tree(self) -> cKDTree:
        """SciPy's index of the same stars."""
        return cKDTree(self.catalog.direction_icrs)

    @functools.cached_property
    def pairs(self) -> np.ndarray:
        """The right answer: sorted numbers cone * n_star + row."""
        near = self.tree.query_ball_point(self.axis, 2 * np.sin(RADIUS_RAD / 2) + 1e-9)
        cone = np.repeat(np.arange(len(near)), [len(rows) for rows in near])
        row = np.concatenate([*near, []]).astype(np.int64)
        star, axis = self.catalog.direction_icrs[row], self.axis[cone]
        angle = 2 * np.arctan2(np.linalg.norm(star - axis, axis=1), np.linalg.norm(star + axis, axis=1))
        inside = angle <= RADIUS_RAD
        pairs = np.sort(cone[inside] * len(self.catalog) + row[inside])
        n_checked = min(N_CONE_CHECKED, len(self.axis))
        by_hand = pairs_of(brute_force(self, n_checked), len(self.catalog))
        assert np.array_equal(by_hand, pairs[pairs < n_checked * len(self.catalog)])
        return pairs


@functools.lru_cache(maxsize=1)
def case_of(n_star: int, n_cone: int) -> Case:
    """Synthetic sky, as dense in the galactic plane as the default catalog's."""
    catalog = ws.StarCatalog.synthetic(n_star, sky="astrometric", seed=SEED)
    return Case(catalog, random_directions(n_cone))


def random_directions(n: int) -> np.ndarray:
    axis = np.random.default_rng(SEED).normal(size=(n, 3))
    return axis / np.linalg.norm(axis, axis=1, keepdims=True)


def make_index(catalog: ws.StarCatalog, method: str) -> ws.BandIndex:
    dtype, device = method.removeprefix("index ").split(", ")
    index = ws.BandIndex(catalog, device=device, dtype=np.dtype(dtype))
    wp.synchronize_device(device)
    return index


def brute_force(case: Case, n_cone: int) -> tuple[np.ndarray, np.ndarray]:
    """Start and rows, as BandIndex.query_many() returns them, by a scalar product with every star."""
    rows = [np.flatnonzero(case.catalog.direction_icrs @ axis >= np.cos(RADIUS_RAD)) for axis in case.axis[:n_cone]]
    return np.cumsum([0, *map(len, rows)]), np.concatenate(rows)


def by_tree(case: Case) -> tuple[np.ndarray, np.ndarray]:
    chord = 2 * np.sin(RADIUS_RAD / 2)
    rows = case.tree.query_ball_point(case.axis, chord, return_sorted=True, workers=1)
    return np.cumsum([0, *map(len, rows)]), np.concatenate([*rows, []]).astype(np.int64)


def pairs_of(answer: tuple[np.ndarray, np.ndarray], n_star: int) -> np.ndarray:
    start, rows = answer
    return np.repeat(np.arange(len(start) - 1), np.diff(start)) * n_star + rows


def sizes(benchmark, size: str) -> tuple[int, int]:
    """Number of stars and of cones."""
    return (SIZES[size], N_CONE) if benchmark.enabled else (SIZES[size] // SMALLER, 20)


@by_size
def test_query(benchmark, size, method):
    n_star, n_cone = sizes(benchmark, size)
    case = case_of(n_star, n_cone)
    index = make_index(case.catalog, method) if is_index(method) else None
    if index:
        radius = np.full(n_cone, RADIUS_RAD)
        ask = functools.partial(index.query_many, case.axis, radius)
    elif method == "k-d tree":
        assert case.tree.n == n_star  # built before the clock starts
        ask = functools.partial(by_tree, case)
    else:
        n_cone = min(n_cone, N_CONE_BRUTE)
        ask = functools.partial(brute_force, case, n_cone)
    answer = benchmark.pedantic(ask, rounds=9, warmup_rounds=1, iterations=1)

    found = pairs_of(answer, n_star)
    right = case.pairs[case.pairs < n_cone * n_star]
    lost, extra = (len(np.setdiff1d(*sets, assume_unique=True)) for sets in ((right, found), (found, right)))
    if "float32" not in method:
        assert (lost, extra) == (0, 0)
    facts = {"lost": lost, "extra": extra, "n_found": len(found), "n_right": len(right)}
    if index:
        facts |= index_facts(index, case, found)
    facts |= {"n_cone": n_cone, "radius_deg": float(np.degrees(RADIUS_RAD))}
    note(benchmark, "query", method, n_star, "us_per_cone", 1e6 / n_cone, **facts)


def note(benchmark, kind: str, method: str, n_star: int, unit: str, per_s: float, **facts: float) -> None:
    """Keep what was measured, its time in some unit."""
    if benchmark.stats is not None:
        facts[unit] = benchmark.stats.stats.median * per_s
    device = wp.get_device(method.split(", ")[1]).name if is_index(method) else "host"
    benchmark.extra_info.update(kind=kind, method=method.split(",")[0], device=device, n_star=n_star, **facts)


def index_facts(index: ws.BandIndex, case: Case, found: np.ndarray) -> dict[str, float]:
    """Memory on the device, displacement of the directions kept there, and stars tested for each star found."""
    arrays = [value for value in vars(index).values() if isinstance(value, wp.array)]
    n_byte = sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in arrays)
    kept = index.direction_array.numpy().astype(np.float64)
    right = case.catalog.direction_icrs[index.star_row]
    across = np.linalg.norm(np.cross(kept, right), axis=1)
    return {
        "device_mb": n_byte / 1e6,
        "bytes_per_star": n_byte / len(case.catalog),
        "displaced_arcsec": float(np.degrees(np.max(across, initial=0.0)) * 3600),
        "tested_per_found": count_tested(index, case.axis) / max(1, len(found)),
    }


def count_tested(index: ws.BandIndex, axis: np.ndarray) -> int:
    """Stars that the index compares with the cones."""
    cones = wp.array(axis, dtype=wp.vec3d, device=index.device)
    n_tested = wp.zeros(len(axis), dtype=wp.int32, device=index.device)
    inputs = [index.cell_start_array, index.direction_array, cones, wp.float64(RADIUS_RAD)]
    kernel = make_count_tested_kernel(index.direction_array.dtype)
    wp.launch(kernel, len(axis), inputs=inputs, outputs=[n_tested], device=index.device)
    return int(n_tested.numpy().sum())


@functools.cache
def make_count_tested_kernel(direction_type: Any) -> wp.Kernel:
    """Kernel that counts the stars in the runs of each cone, for directions of wp.vec3d or wp.vec3f."""

    @wp.kernel(module="unique", enable_backward=False)
    def count_tested_kernel(
        # in
        cell_start: wp.array[wp.int32],  # (180 * 360 + 1,)
        star_direction: wp.array[direction_type],  # (n_star,)
        cone_direction: wp.array[wp.vec3d],  # (n_cone,)
        radius_rad: wp.float64,
        # out
        n_tested: wp.array[wp.int32],  # (n_cone,)
    ):
        cone = wp.tid()
        cover = cone_cover(cone_direction[cone], radius_rad)
        n = int(0)  # noqa: RUF046, UP018 (Warp's way to say that n changes)
        for band in range(cover.first_band, cover.last_band + 1):
            for part in range(2):
                run = run_of_stars(cell_start, star_direction, band, cover, part)
                n += wp.max(run[1] - run[0], 0)
        n_tested[cone] = n

    return count_tested_kernel


@by_size
def test_build(benchmark, size, method):
    """From directions in host memory to the first possible query."""
    n_star, n_cone = sizes(benchmark, size)
    catalog = case_of(n_star, n_cone).catalog
    build = cKDTree if method == "k-d tree" else functools.partial(make_index, method=method)
    argument = catalog.direction_icrs if method == "k-d tree" else catalog
    made = benchmark.pedantic(build, args=(argument,), rounds=3, warmup_rounds=0)
    assert (made.n if method == "k-d tree" else len(made)) == n_star
    note(benchmark, "build", method, n_star, "build_s", 1.0)


@by_size
def test_fixed_density(benchmark, size, method):
    """The same views of the same stars, in catalogs that go on beyond them or do not."""
    n_cone = N_CONE if benchmark.enabled else 20
    smallest = zone_catalog("1e5", benchmark.enabled)
    catalog = zone_catalog(size, benchmark.enabled)
    rng = np.random.default_rng(SEED)
    ra, dec = np.radians(rng.uniform(1, 17, n_cone)), np.radians(rng.uniform(-10.5, 10.5, n_cone))
    axis = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=1)
    radius = np.full(n_cone, RADIUS_RAD)
    ask = functools.partial(make_index(catalog, method).query_many, axis, radius)
    start, rows = benchmark.pedantic(ask, rounds=15, warmup_rounds=2, iterations=1)
    # Every catalog begins with the stars of the smallest: rows are the same.
    start_smallest, rows_smallest = make_index(smallest, method).query_many(axis, radius)
    assert np.array_equal(start, start_smallest) and np.array_equal(rows, rows_smallest)
    facts = {"n_cone": n_cone, "n_found": len(rows)}
    note(benchmark, "fixed density", method, len(catalog), "us_per_cone", 1e6 / n_cone, **facts)


@functools.lru_cache(maxsize=2)
def zone_catalog(size: str, full: bool) -> ws.StarCatalog:
    """Stars of equal density in a zone of the sky; those of the smaller zones come first."""
    rng = np.random.default_rng(SEED)
    places = np.empty((2, 0))  # right ascension [deg], sin(dec)
    inner = (0.0, 0.0)
    for name, zone in ZONES.items():
        n = SIZES[name] if full else SIZES[name] // SMALLER
        drawn = np.stack([rng.uniform(0, zone[0], n), rng.uniform(-zone[1], zone[1], n)])
        beyond = (drawn[0] >= inner[0]) | (np.abs(drawn[1]) >= inner[1])
        places, inner = np.concatenate([places, drawn[:, beyond]], axis=1), zone
        if name == size:
            break
    n_star = places.shape[1]
    # Names are not needed: empty ones save a gigabyte.
    return ws.StarCatalog.from_arrays(
        places[0], np.degrees(np.arcsin(places[1])), {"A": np.ones(n_star)}, id=np.full(n_star, "")
    )
