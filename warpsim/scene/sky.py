"""The star background of a scene."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, model_validator

from warpsim.config.fields import Count, Integer, Positive, Switch, closed_interval, whole_path
from warpsim.config.model import config_model
from warpsim.errors import InputError

BUILT_IN_CATALOGS = ("default", "union", "synthetic", "none")
"""Words for `Sky.catalog` that name no file."""


def _word_or_path(value: Any) -> str:
    rule = f"must be one of {', '.join(BUILT_IN_CATALOGS)}, or the path of a file"
    return value if isinstance(value, str) and value in BUILT_IN_CATALOGS else whole_path(value, rule)


@config_model
class SyntheticStars:
    """Synthetic stars over the whole sky; give n_star or limit_jy.

    Args:
        n_star: How many.
        limit_jy: Flux density of the faintest in band A [Jy].
        sky: "astrometric", as dense as a catalog selected in visible light, or "infrared", as dense as the true sky.
        seed: Of their random numbers; the scene's seed plays no part.
    """

    n_star: Annotated[Count, closed_interval(1, 10**8)] | None = None
    limit_jy: Annotated[Positive, closed_interval(1e-6, 1e6)] | None = None
    sky: Literal["astrometric", "infrared"] = "astrometric"
    seed: Annotated[Integer, closed_interval(0, 2**63 - 1)] = 0

    @model_validator(mode="after")
    def _one_size(self) -> SyntheticStars:
        if (self.n_star is None) == (self.limit_jy is None):
            raise InputError("exactly one must be given", "n_star, limit_jy")
        return self


@config_model
class Sky:
    """The star background.

    Args:
        catalog: "default" (embedded), "union" (all of its sources, needs the extra `catalogs`), "synthetic", "none", or
            the path of a catalog file.
        synthetic: What to make, for catalog = "synthetic".
        physics: "physical", or "paper": motion by its Eq. 5 and irradiance by its zero points, which are known in the
            bands of MSX only.
        aberration: Whether apparent positions include the aberration of the sensor's motion.
        parallax: Whether they include the parallax of nearby stars.
        light_deflection: Whether they include the bending of light by the Sun.
    """

    catalog: Annotated[str, BeforeValidator(_word_or_path)] = "default"
    synthetic: SyntheticStars | None = None
    physics: Literal["physical", "paper"] = "physical"
    aberration: Switch = True
    parallax: Switch = False
    light_deflection: Switch = False

    @model_validator(mode="after")
    def _synthetic_is_described(self) -> Sky:
        if (self.catalog == "synthetic") != (self.synthetic is not None):
            raise InputError('must be given with catalog = "synthetic", and only then', "synthetic")
        return self
