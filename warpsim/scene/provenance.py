"""What every file says of where it is from: scene, epoch and time scale, seeds, version."""

from __future__ import annotations

from typing import Any

from warpsim.scene.description import SceneDescription
from warpsim.version import __version__

PROVENANCE = {
    "SCENE": "name of the scene",
    "TIMESYS": "time scale of dates",
    "DATEREF": "epoch: instant of TIME_S = 0",
    "SEED": "of the world",
    "NOISSEED": "of the noise",
    "CREATOR": "program and version",
}
"""Words of provenance, as FITS keywords, and what they say."""


def provenance(scene: SceneDescription) -> dict[str, Any]:
    """Return the words of PROVENANCE for a scene: of headers, metadata of tables, attributes and JSON alike.

    Args:
        scene: The scene, or that of one sequence of a data set.
    """
    noise_seed = scene.seed if scene.noise_seed is None else scene.noise_seed
    values = (scene.name, "UTC", scene.epoch_utc, scene.seed, noise_seed, f"warpsim {__version__}")
    return dict(zip(PROVENANCE, values, strict=True))
