"""What a target radiates: its temperature and its surface."""

from __future__ import annotations

from typing import Annotated

from pydantic import model_validator

from warpsim.describe import NonNegative, Positive, closed_interval, part, part_error

Kelvin = Annotated[Positive, closed_interval(0, 1e5)]


@part
class Temperature:
    """A temperature that changes linearly from the scene's start to its end, or stays.

    Args:
        start_k: At the scene's epoch [K].
        end_k: At the scene's end [K]; the same as at the start when left out.
    """

    start_k: Kelvin
    end_k: Kelvin | None = None


@part
class Graybody:
    """Surface that emits and reflects the same in all bands.

    Opaque: emissivity = 1 - reflectance. Giving both inconsistently is an error.

    Args:
        reflectance: Diffuse reflectance, 0 to 1.
        emissivity: Emissivity, 0 to 1.
    """

    reflectance: Annotated[NonNegative, closed_interval(0, 1)] | None = None
    emissivity: Annotated[NonNegative, closed_interval(0, 1)] | None = None

    @model_validator(mode="after")
    def _opaque(self) -> Graybody:
        if self.reflectance is None and self.emissivity is None:
            raise part_error("give reflectance or emissivity")
        if self.reflectance is not None and self.emissivity is not None:
            total = self.reflectance + self.emissivity
            if abs(total - 1) > 1e-9:
                raise part_error(f"emissivity + reflectance: must be 1 (opaque graybody), got {total:g}")
        return self

    @property
    def emissivity_value(self) -> float:
        """Emissivity, whichever of the two was given."""
        if self.emissivity is not None:
            return self.emissivity
        return 1.0 - float(self.reflectance or 0.0)
