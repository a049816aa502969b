"""Identity of a data set: all inputs that its files depend on, and their hash."""

from __future__ import annotations

import os
from typing import Any

from warpsim.dataset.recipe import Recipe
from warpsim.dataset.samples import choices_with_files
from warpsim.dataset.sequences import varied
from warpsim.output.manifest import package_versions
from warpsim.render.stars import catalog_checksums
from warpsim.scene.inputs import input_checksums
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene
from warpsim.scene.scene_files import named_files
from warpsim.scene.sky import BUILT_IN_CATALOGS
from warpsim.version import __version__

STAR_CATALOG = "star catalog"
"""Among the inputs: the scene's, whether it came from a file or not; of each kind of sensor with stars of its own."""

Identity = dict[str, Any]

Stamp = tuple[int, int] | None


def identity_of(recipe: Recipe, device: str) -> Identity:
    """Return all inputs that the bytes of a data set depend on, as plain values, for its manifest.

    Args:
        recipe: The recipe.
        device: Alias of the Warp device; one GPU stands for all.

    Raises:
        InputError: An input file cannot be read.
    """
    return {
        "recipe": recipe.to_dict(),
        "inputs": _inputs(recipe),
        "device": "cuda" if device.startswith("cuda") else "cpu",
        "warpsim": __version__,
        "packages": package_versions(*writers_of(recipe)),
    }


def writers_of(recipe: Recipe) -> list[str]:
    """Packages that write files of this recipe, beyond those that warpsim always needs."""
    return [
        "pyarrow",
        *(["zarr"] if recipe.format == "zarr" else []),
        *(["av"] if recipe.preview == "mp4" else []),
        *(["pycocotools"] if recipe.masks else []),
    ]


def input_files(recipe: Recipe) -> list[str]:
    """Paths of all files that sequences may be made from."""
    scenes = [recipe.scene.to_dict(), *(nested for *_, nested in choices_with_files(recipe.distributions))]
    catalogs = (scene.get("sky", {}).get("catalog", BUILT_IN_CATALOGS[0]) for scene in scenes)
    named = [*(path for scene in scenes for path in named_files(scene)), *catalogs]
    return [path for path in dict.fromkeys(named) if path not in BUILT_IN_CATALOGS]


def stamp_of(path: str) -> Stamp:
    """Return a stamp of a file that changes with its content; None where it is missing."""
    try:
        stat = os.stat(path)  # noqa: PTH116
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_size


def _inputs(recipe: Recipe) -> dict[str, str]:
    """Checksums of all files that sequences may be made from, by path, and of star catalogs."""
    found = _inputs_of(recipe.scene)
    for name, number, value, _ in choices_with_files(recipe.distributions):
        for path, checksum in _inputs_of(varied(recipe, {name: value}, f"sample.{name}")).items():
            if found.get(path) != checksum:
                found[f"{path}, for {name} {number}"] = checksum
    return found


def _inputs_of(scene: Scene) -> dict[str, str]:
    return _catalogs(scene.scenario) | input_checksums(scene.scenario)


def _catalogs(scenario: Scenario) -> dict[str, str]:
    """Checksums of the star catalog: one for all kinds of sensors, or one of each."""
    found = catalog_checksums(scenario)
    if len(set(found.values())) == 1:
        return {STAR_CATALOG: next(iter(found.values()))}
    return {f"{STAR_CATALOG} of {kind}": checksum for kind, checksum in found.items()}
