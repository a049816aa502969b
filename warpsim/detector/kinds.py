"""All kinds of detectors, as a field of the scene."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Tag

from warpsim.detector.electron import ElectronDetector
from warpsim.detector.nei import NeiDetector


def _kind_of(value: Any) -> Any:
    """The kind that a table of a scene file states; "nei" where it states none."""
    return value.get("kind", "nei") if isinstance(value, dict) else getattr(value, "kind", "nei")


Detector = Annotated[
    Annotated[NeiDetector, Tag("nei")] | Annotated[ElectronDetector, Tag("electron")], Discriminator(_kind_of)
]
