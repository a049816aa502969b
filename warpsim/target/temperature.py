"""A target's temperature over a scene: linear, from a table, or by a heat balance."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, PlainValidator, ValidationInfo, model_validator

from warpsim.arrays import F64
from warpsim.config.fields import (
    FileName,
    NonNegative,
    Number,
    Positive,
    closed_interval,
    number_within,
    rows_in,
    rule_error,
)
from warpsim.config.model import config_model
from warpsim.errors import InputError
from warpsim.target.from_file import FromFile
from warpsim.target.timed_rows import TimedRows

if TYPE_CHECKING:
    from warpsim.instant import Epoch


HOTTEST_K = 1e5

EQUILIBRIUM = "equilibrium"
"""Word for the temperature at which a target emits as much as it absorbs."""

Kelvin = Annotated[Positive, closed_interval(0, HOTTEST_K)]
UnitFraction = Annotated[NonNegative, closed_interval(0, 1)]
Times = Annotated[tuple[Number, ...], rows_in("s")]
Kelvins = Annotated[tuple[Kelvin, ...], rows_in("K")]


@dataclass(frozen=True, eq=False)
class TemperatureRows(TimedRows):
    """Temperatures at given times; linear in time between rows, the first and last hold beyond."""

    time_s: F64
    """After the epoch, ascending [s], shape (n,)."""
    temperature_k: F64
    """Shape (n,)."""
    error_k: float = 0.0
    """Largest measured error of a heat balance, interpolation included; 0 for what was given [K]."""
    ripple_k: float = 0.0
    """Swing of a heat balance within one turn of the body in sunlight, which the mean over turns leaves out [K]."""
    source: str = ""
    """File that messages name; nothing for inline rows."""

    _of = "temperatures"

    def at(self, time_s: npt.ArrayLike) -> F64:
        """Temperature at times after the epoch [K], shape (n,).

        Raises:
            InputError: A time lies more than a second outside the rows.
        """
        return interpolated(self.time_s, self.temperature_k, self._times_within(time_s))


def interpolated(node_s: F64, value: F64, time_s: F64) -> F64:
    """Values between nodes, linear in time and constant beyond, as in the kernels; the last axis is time."""
    if len(node_s) == 1:
        return np.repeat(value, len(time_s), axis=-1)
    row = np.clip(np.searchsorted(node_s, time_s, side="right") - 1, 0, len(node_s) - 2)
    fraction = np.clip((time_s - node_s[row]) / (node_s[row + 1] - node_s[row]), 0.0, 1.0)
    start = value[..., row]
    return np.asarray(start + (value[..., row + 1] - start) * fraction)


@config_model
class Temperature:
    """A temperature that changes linearly while the target is there in the scene, or stays.

    Args:
        start_k: At the scene's epoch, or when the target comes [K].
        end_k: At the scene's end, or when the target goes [K]; the same as at the start when left out.
    """

    start_k: Kelvin
    end_k: Kelvin | None = None
    kind: Literal["linear"] = Field(default="linear", kw_only=True)

    def rows(self, start_s: float, end_s: float) -> TemperatureRows:
        """Return its rows from a time to another one [s]."""
        if self.end_k is None or self.end_k == self.start_k:
            return TemperatureRows(np.zeros(1), np.array([self.start_k]))
        return TemperatureRows(np.array([start_s, end_s]), np.array([self.start_k, self.end_k]))


@config_model
class TemperatureTable(FromFile):
    """Temperatures from a table, linear in time between its rows; give time_s and temperature_k, or file.

    A single row holds for all times; more must cover the scene.

    Args:
        time_s: Times after the scene's epoch, strictly ascending [s].
        temperature_k: A temperature for each time [K].
        file: A CSV or ECSV file with the columns time_s (or time_utc) and temperature_k; read on first use, and kept.
        max_gap_s: Longest time between neighbouring rows that is no gap [s]; any if left out.
    """

    time_s: Times | None = None
    temperature_k: Kelvins | None = None
    file: FileName | None = None
    max_gap_s: Positive | None = None
    kind: Literal["table"] = Field(default="table", kw_only=True)

    @model_validator(mode="after")
    def _one_source(self) -> TemperatureTable:
        if self._is_inline("time_s", "temperature_k"):
            self._inline_rows  # noqa: B018  # checked here, where the scene's file is known
        return self

    @cached_property
    def _inline_rows(self) -> TemperatureRows:
        return checked_rows(np.array(self.time_s), np.array(self.temperature_k), self.max_gap_s)

    @cached_property
    def _content(self) -> Any:
        """Times, temperatures and lines of the file."""
        from warpsim.exchange.read_files import read_temperature_table

        return read_temperature_table(self._source)

    def rows(self, epoch: Epoch) -> TemperatureRows:
        """The checked table for a scene's epoch.

        Raises:
            InputError: The file cannot be read, a value is missing or no temperature, or times do not ascend.
        """
        if self.file is None:
            return self._inline_rows
        instants, temperature_k, locations = self._content
        try:
            rows = checked_rows(instants.since(epoch), temperature_k, self.max_gap_s, locations.__getitem__)
        except InputError as error:
            raise error.of(self.file) from None
        return replace(rows, source=self.file)


def checked_rows(
    time_s: F64, temperature_k: F64, max_gap_s: float | None = None, where: Callable[[int], str] = "row {}".format
) -> TemperatureRows:
    """Return a table as given, checked; `where` says what errors call a row."""
    if len(time_s) != len(temperature_k):
        raise InputError(f"must have one for each of {len(time_s)} times", "temperature_k", len(temperature_k))
    if len(time_s) == 0:
        raise InputError("must hold at least one time", "time_s")
    for name, values in (("time_s", time_s), ("temperature_k", temperature_k)):
        (missing,) = np.nonzero(~np.isfinite(values))
        if len(missing):
            row = int(missing[0])
            raise InputError("must be finite, a table must have no gap", name, values[row], "g").of(where(row))
    (wrong,) = np.nonzero(~((temperature_k > 0) & (temperature_k <= HOTTEST_K)))
    if len(wrong):
        row = int(wrong[0])
        raise InputError(f"must be in (0, {HOTTEST_K:g}]", "temperature_k", temperature_k[row], "g").of(where(row))
    step_s = np.diff(time_s)
    (back,) = np.nonzero(step_s <= 0)
    if len(back):
        row = int(back[0]) + 1
        raise InputError(f"must ascend, got {time_s[row]:.17g} after {time_s[row - 1]:.17g}", "time_s").of(where(row))
    (gap,) = np.nonzero(step_s > (math.inf if max_gap_s is None else max_gap_s))
    if len(gap):
        row = int(gap[0]) + 1
        raise InputError(
            f"must be at most max_gap_s ({max_gap_s:g} s) after the row before, got a gap from {time_s[row - 1]:.9g} "
            f"to {time_s[row]:.9g} s",
            "time_s",
        ).of(where(row))
    return TemperatureRows(np.asarray(time_s, dtype=np.float64), np.asarray(temperature_k, dtype=np.float64))


def _start(value: Any, info: ValidationInfo) -> float | str:
    """A temperature, or "equilibrium"."""
    if not isinstance(value, str):
        return number_within(value, info, 0, HOTTEST_K, open_low=True)
    if value != EQUILIBRIUM:
        raise rule_error(f"must be a temperature or {EQUILIBRIUM!r}")
    return value


@config_model
class HeatBalance:
    """Temperature of a lumped-capacitance node that the Sun and the Earth heat and that radiates from its surface.

    Args:
        start_k: At the scene's epoch, or when the target comes or is released [K]; "equilibrium" for the temperature at
            which the body emits as much as it then absorbs.
        mass_kg: Mass that takes part [kg].
        heat_capacity_j_kg_k: Its specific heat capacity [J/(kg K)].
        solar_absorptance: Fraction of sunlight that is absorbed; if left out, the mean of the surface's 1 - reflectance
            over the scene's bands, or over all sunlight where the surface is described by wavelength.
        infrared_emissivity: Emissivity over all thermal radiation; if left out, the same mean over the bands, or that
            over the emission of a blackbody of 300 K.
        earth_w_m2: Thermal exitance of the Earth [W/m2].
        albedo: Fraction of sunlight that the Earth reflects.
    """

    start_k: Annotated[float | Literal["equilibrium"], PlainValidator(_start)]
    mass_kg: Positive
    heat_capacity_j_kg_k: Positive
    solar_absorptance: UnitFraction | None = None
    infrared_emissivity: UnitFraction | None = None
    earth_w_m2: NonNegative = 237.0
    albedo: UnitFraction = 0.3
    kind: Literal["heat_balance"] = Field(default="heat_balance", kw_only=True)
