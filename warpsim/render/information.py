"""What measurements say about parameters: Fisher information, Cramer-Rao bounds, and what they do not tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from warpsim.arrays import F64
from warpsim.errors import InputError

LEAST_SINGULAR_VALUE = 1e-8
"""Of the weighted Jacobian with columns of length 1, below which measurements do not tell its parameters apart."""

LEAST_COLUMN = 1e-12
"""Part of the weighted light's length below which a column of the weighted Jacobian is rounding: nothing is known."""

_LEAST_PART = 1e-3
"""Part of the largest below which a parameter is not named in a direction."""


@dataclass(frozen=True)
class Information:
    """Fisher information of parameters in independent Gaussian measurements.

    It is kept as a triangular root, which has twice the digits of the matrix.
    """

    names: list[str]
    """Of the parameters."""
    root: F64
    """R of the matrix R'R, (n_param, n_param)."""
    least_length: float = 0.0
    """Length of a column of the root up to which its parameter counts as not known."""

    @property
    def matrix(self) -> F64:
        """Fisher information matrix, (n_param, n_param)."""
        return np.asarray(self.root.T @ self.root)

    @cached_property
    def _decomposed(self) -> tuple[F64, F64, F64]:
        """Lengths of the columns, 0 if not known, singular values of the scaled root, and their directions as rows."""
        length = np.linalg.norm(self.root, axis=0)
        length[length <= self.least_length] = 0.0
        scaled = np.where(length > 0.0, self.root, 0.0) / np.where(length > 0.0, length, 1.0)
        _, values, rows = np.linalg.svd(scaled)
        return length, values, rows

    @property
    def least_singular_value(self) -> float:
        """Smallest singular value of the weighted Jacobian with columns of length 1: from 0, nothing known, to 1."""
        return float(self._decomposed[1][-1])

    @property
    def weakest(self) -> dict[str, float]:
        """The least known combination: changes of parameters that the measurements notice least, one of them 1."""
        return self._changes(self._decomposed[2][-1])

    def _changes(self, row: F64) -> dict[str, float]:
        """A direction among scaled parameters as changes of those that take part, one of them 1."""
        length = self._decomposed[0]
        part = row / np.abs(row).max()
        change = part / np.where(length > 0.0, length, 1.0)
        first = int(np.argmax(np.abs(part)))
        chosen = np.flatnonzero(np.abs(part) > _LEAST_PART)
        return {self.names[k]: float(change[k] / change[first]) for k in chosen}

    @property
    def degenerate(self) -> str:
        """A line that names the combinations of parameters that the measurements do not change with; else empty."""
        _, values, rows = self._decomposed
        found = []
        for row in _sparse(rows[values < LEAST_SINGULAR_VALUE]):
            changes = self._changes(row)
            ratio = " : ".join(f"{value:.3g}" for value in changes.values())
            found.append(" : ".join(changes) + (f" = {ratio}" if len(changes) > 1 else ""))
        return f"the measurements do not change with {'; or '.join(found)}" if found else ""

    @property
    def covariance(self) -> F64:
        """Cramer-Rao bound of the parameters' covariance, (n_param, n_param).

        Raises:
            InputError: The matrix is singular; the message names the direction.
        """
        if self.degenerate:
            raise InputError(f"the information is singular: {self.degenerate}")
        length, values, rows = self._decomposed
        inverse = (rows.T / values) / length[:, None]
        return np.asarray(inverse @ inverse.T)

    @property
    def sigma(self) -> dict[str, float]:
        """Cramer-Rao bound of each parameter's standard deviation; InputError as of covariance."""
        return dict(zip(self.names, np.sqrt(np.diagonal(self.covariance)).tolist(), strict=True))


def _sparse(rows: F64) -> F64:
    """Return combinations of rows with as many zeros as Gauss and Jordan's elimination makes."""
    out = rows.copy()
    for number in range(len(out)):
        column = int(np.argmax(np.abs(out[number])))
        out[number] /= out[number, column]
        others = np.arange(len(out)) != number
        out[others] -= out[others, column, None] * out[number]
    return out


def information_of(names: Sequence[str], weighted: F64, light: F64 | float = 0.0) -> Information:
    """Return the information of measurements by their Jacobian over their errors, (n_measured, n_param).

    What is measured, over its errors as well, tells which columns are but its rounding.
    """
    n_param = weighted.shape[1]
    root = np.linalg.qr(np.concatenate([weighted, np.zeros((n_param, n_param))]), mode="r")
    return Information(list(names), np.asarray(root), LEAST_COLUMN * float(np.linalg.norm(light)))
