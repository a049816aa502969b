"""Distributions of sampled fields of a scene, each a function of one uniform number."""

from __future__ import annotations

import copy
import json
import math
from statistics import NormalDist
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Discriminator, model_validator

from warpsim.config.fields import Integer, NonNegative, Number, Positive, rule_error
from warpsim.config.model import choice, config_model
from warpsim.errors import InputError
from warpsim.files import plain_number

MOST_CHOICES = 1000
"""Values of a choice: a recipe tries the scene with each of them, 10 ms for a small one."""


def _in_order(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise InputError("must be [lowest, highest]", value=list(pair))
    return pair


IN_ORDER = AfterValidator(_in_order)


class _Distribution:
    """A distribution, whose first field is the word that a recipe names it with."""

    @property
    def extremes(self) -> list[Any]:
        """Values between which, or among which, all are."""
        return list(getattr(self, next(iter(self.__dataclass_fields__))))  # type: ignore[attr-defined]


@config_model
class Uniform(_Distribution):
    """Evenly between two numbers.

    Args:
        uniform: Lowest and highest value.
    """

    uniform: Annotated[tuple[Number, Number], IN_ORDER]

    def value(self, u: float) -> float:
        """The value at a uniform number in (0, 1)."""
        low, high = self.uniform
        return min(max(low + (high - low) * u, low), high)


@config_model
class LogUniform(_Distribution):
    """Between two positive numbers, evenly in the logarithm.

    Args:
        log_uniform: Lowest and highest value, above 0.
    """

    log_uniform: Annotated[tuple[Positive, Positive], IN_ORDER]

    def value(self, u: float) -> float:
        """The value at a uniform number in (0, 1)."""
        low, high = self.log_uniform
        return min(max(math.exp(math.log(low) + (math.log(high) - math.log(low)) * u), low), high)


@config_model
class Normal(_Distribution):
    """A Gaussian, cut off at some number of sigmas.

    Args:
        normal: Mean and sigma.
        cut_sigma: Largest distance from the mean, in sigmas.
    """

    normal: tuple[Number, NonNegative]
    cut_sigma: Positive = 4.0

    def value(self, u: float) -> float:
        """The value at a uniform number in (0, 1)."""
        tail = NormalDist().cdf(-self.cut_sigma)
        deviate = NormalDist().inv_cdf(tail + (1 - 2 * tail) * u)
        return self.normal[0] + self.normal[1] * min(max(deviate, -self.cut_sigma), self.cut_sigma)

    @property
    def extremes(self) -> list[Any]:
        """Values between which, or among which, all are."""
        mean, sigma = self.normal
        return [mean - self.cut_sigma * sigma, mean + self.cut_sigma * sigma]


@config_model
class WholeNumbers(_Distribution):
    """Whole numbers, both ends included, all as likely.

    Args:
        integer: Lowest and highest value.
    """

    integer: Annotated[tuple[Integer, Integer], IN_ORDER]

    def value(self, u: float) -> int:
        """The value at a uniform number in (0, 1)."""
        low, high = self.integer
        return min(low + int(u * (high - low + 1)), high)


def _any_values(value: Any) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple) or not value:
        raise rule_error("must be a list of one value or more")
    if len(value) > MOST_CHOICES:
        raise rule_error(f"must be at most {MOST_CHOICES:,} values, each of which is tried")
    try:
        return tuple(json.loads(json.dumps(value, default=plain_number)))  # a copy, of plain values
    except TypeError as error:
        raise rule_error(f"must hold numbers, words and tables of them: {error}") from None


@config_model
class Choice(_Distribution):
    """One of some values: numbers, words, or whole tables of a scene.

    Args:
        choice: The values.
        weights: How likely each is, relative to the others; all alike when left out.
    """

    choice: Annotated[Any, BeforeValidator(_any_values)]
    weights: tuple[NonNegative, ...] | None = None

    @model_validator(mode="after")
    def _as_many(self) -> Choice:
        if self.weights is not None and (len(self.weights) != len(self.choice) or sum(self.weights) <= 0):
            raise InputError("must be one per value, and not all 0", "weights", list(self.weights))
        return self

    def value(self, u: float) -> Any:
        """The value at a uniform number in (0, 1)."""
        weights = self.weights or (1.0,) * len(self.choice)
        left = u * sum(weights)
        for value, weight in zip(self.choice, weights, strict=True):
            left -= weight
            if left < 0 and weight > 0:
                return copy.deepcopy(value)  # further fields may be drawn into it
        return copy.deepcopy(next(v for v, w in zip(self.choice[::-1], weights[::-1], strict=True) if w > 0))


KINDS: dict[str, type[Any]] = {
    "uniform": Uniform, "log_uniform": LogUniform, "normal": Normal, "integer": WholeNumbers, "choice": Choice,
}  # fmt: skip
"""Distributions by the word that a recipe names them with."""


def _kind_of(value: Any) -> str | None:
    return next((kind for kind in KINDS if (kind in value if isinstance(value, dict) else hasattr(value, kind))), None)


Distribution = Annotated[
    Annotated[Uniform, choice("uniform")]
    | Annotated[LogUniform, choice("log_uniform")]
    | Annotated[Normal, choice("normal")]
    | Annotated[WholeNumbers, choice("integer")]
    | Annotated[Choice, choice("choice")],
    Discriminator(_kind_of),
]


def is_distribution(value: Any) -> bool:
    """Return whether a table of a recipe is a distribution, not a table of further fields."""
    if not isinstance(value, dict):
        return isinstance(value, tuple(KINDS.values()))
    return any(kind in value and not isinstance(value[kind], dict) for kind in KINDS)
