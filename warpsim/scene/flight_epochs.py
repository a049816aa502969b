"""The epoch that ballistic arcs anywhere in a scene share with it, so that a scene states it once."""

from __future__ import annotations

import dataclasses
from typing import Any

from warpsim.errors import InputError
from warpsim.orbit.arc import BallisticArc
from warpsim.orbit.epoch import instant
from warpsim.scene.parts import TargetGroup

_ARC_EPOCH = BallisticArc.__dataclass_fields__["epoch_utc"].default


def is_utc(value: Any) -> bool:
    """Whether a value is a UTC instant, as text or astropy Time."""
    try:
        instant(value if isinstance(value, str) else value.utc.isot)
    except (InputError, AttributeError):
        return False
    return True


def with_epoch(value: Any, epoch_utc: Any) -> Any:
    """Flights anywhere in a value, with the epoch where they have none of their own."""
    if isinstance(value, BallisticArc):
        return dataclasses.replace(value, epoch_utc=epoch_utc) if value.epoch_utc == _ARC_EPOCH else value
    if isinstance(value, TargetGroup):
        return dataclasses.replace(value, trajectory=with_epoch(value.trajectory, epoch_utc))
    if isinstance(value, list | tuple):
        return [with_epoch(item, epoch_utc) for item in value]
    if isinstance(value, dict):
        value = {name: with_epoch(item, epoch_utc) for name, item in value.items()}
        if "start_lon_lat_deg" in value or value.get("kind") == "ballistic_arc":
            return {"epoch_utc": epoch_utc, **value}
    return value


def without_flight_epochs(value: Any) -> Any:
    """Nested dicts in which flights take the epoch of the scene they are put into."""
    if isinstance(value, list):
        return [without_flight_epochs(item) for item in value]
    if isinstance(value, dict):
        is_flight = value.get("kind") == "ballistic_arc"
        return {k: without_flight_epochs(v) for k, v in value.items() if not (is_flight and k == "epoch_utc")}
    return value
