"""Fractions by wavelength: reflectance or emissivity of a surface, from nodes or from a file."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import model_validator

from warpsim.config.fields import FileName, NonNegative, Number, closed_interval, rows_in
from warpsim.config.model import config_model
from warpsim.errors import InputError
from warpsim.exchange.curve_file import CurveFile, read_curve
from warpsim.radiometry.curve import Curve
from warpsim.radiometry.curve_nodes import checked_curve

Wavelengths = Annotated[tuple[Number, ...], rows_in("um")]
Fractions = Annotated[tuple[Annotated[NonNegative, closed_interval(0, 1)], ...], rows_in("")]


@config_model
class ByWavelength:
    """A fraction by wavelength, linear between nodes and constant beyond; give wavelength_um and value, or file.

    Args:
        wavelength_um: Nodes, increasing, two or more [um].
        value: The fraction at each, 0 to 1.
        file: A table (CSV, ECSV, FITS) with a column of wavelengths that states its unit, as in `wavelength_um`, and a
            column of fractions; read on first use, and kept.
        column: Name of the column of fractions, for a file with several.
    """

    wavelength_um: Wavelengths | None = None
    value: Fractions | None = None
    file: FileName | None = None
    column: str | None = None

    @model_validator(mode="after")
    def _one_source(self) -> ByWavelength:
        inline = self.wavelength_um is not None or self.value is not None
        if inline == (self.file is not None):
            raise InputError("exactly one of a file, or wavelength_um with value, must be given", "file, wavelength_um")
        if inline:
            if self.wavelength_um is None or self.value is None:
                raise InputError("both must be given", "wavelength_um, value")
            if self.column is not None:
                raise InputError("belongs to a file, which is not given", "column", self.column)
            self.curve  # noqa: B018  # checked here, where the field's path is known
        return self

    @cached_property
    def _content(self) -> CurveFile:
        return read_curve(str(self.file), self.column)

    @cached_property
    def curve(self) -> Curve:
        """Nodes and values.

        Raises:
            InputError: The file cannot be read, or holds no fractions.
        """
        if self.file is None:
            return Curve(*checked_curve(np.array(self.wavelength_um), np.array(self.value), "value"))
        wavelength_um, value, _ = self._content
        if value.max() > 1.0:
            raise InputError("must hold fractions from 0 to 1", value=float(value.max()), form="g").of(self.file)
        return Curve(wavelength_um, value)

    @property
    def checksum(self) -> str | None:
        """SHA-256 of the file, in hexadecimal; None for nodes.

        Raises:
            InputError: The file cannot be read.
        """
        return None if self.file is None else self._content.sha256


FIELDS = frozenset(ByWavelength.__dataclass_fields__)
"""Names that tell such a table from one by band."""


def as_dict(given: ByWavelength) -> dict[str, Any]:
    """Return the fields that are given, as plain values."""
    values = {name: getattr(given, name) for name in ("wavelength_um", "value", "file", "column")}
    return {
        name: list(value) if isinstance(value, tuple) else value for name, value in values.items() if value is not None
    }
