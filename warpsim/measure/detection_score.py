"""Scores of detections in images against truth: precision and recall, false alarms, errors of position."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.arguments import above_zero, finite_number
from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.measure.detection_matches import Flags, Matches, Outcome, find_matches
from warpsim.measure.rows import column, column_names, has_column, numbers

if TYPE_CHECKING:
    from astropy.table import Table

N_THRESHOLD = 30
"""Thresholds of a curve where they are not given."""


@dataclass(frozen=True, repr=False)
class DetectionScore:
    """What became of detections, and of the targets that they were to find.

    A target is found where a detection is assigned to it; merged where another target of its clump is found, or the
    clump as a whole; missed otherwise. `recall` counts merged targets as seen, `recall_resolved` as missed. Errors of
    position are those of found targets that are alone in their clump. Fractions and means of nothing are NaN.
    """

    found: Table
    """The detections: frame, sensor, band, x_px, y_px, snr (where given), outcome ("target", "clump", "ignored" or
    "false"), truth_row (-1 for none) and distance_px."""
    truth: Table
    """The truth as given, and alone (in its clump), outcome ("found", "merged", "missed" or "not counted"), found_row
    (-1 for none), error_x_px and error_y_px (detection less truth) and chi_square, the mean square of both over the
    errors that the detection states."""
    n_image: int
    """Images of the truth, those without targets or detections included."""
    radius_px: float
    """Largest distance of a detection from its target [px]."""
    precision: float
    """Part of the detections that are of targets or clumps; ignored ones do not count."""
    recall: float
    """Part of the targets that are found or merged."""
    recall_resolved: float
    """Part of the targets that are found, each by a detection of its own."""
    false_alarms_per_image: float
    """Detections of nothing, per image."""
    rms_px: float
    """Root mean square distance of found targets that are alone from their detections [px]."""
    bias_px: tuple[float, float]
    """Mean error of position of the same, in x and in y [px]."""
    chi_square: float
    """Mean square of their errors over those that the detections state: 1 where these are right; NaN where they have
    no x_sigma_px and y_sigma_px."""
    _matches: Matches

    def __repr__(self) -> str:
        rates = f"precision {self.precision:.3f}, recall {self.recall:.3f}, resolved {self.recall_resolved:.3f}"
        return f"DetectionScore({rates}, {self.false_alarms_per_image:.3g} false alarms per image)"

    def by(self, name: str, edges: Sequence[float] | None = None) -> Table:
        """Scores of parts of the truth.

        Args:
            name: Column of `truth` to divide by, as "class", "band", "sensor", "target", "snr" or "neighbour_px".
            edges: Bins of numbers, from each edge to below the next; a row for each value when left out.

        Returns:
            A row per value, or per bin (`low`, `high`): n_truth, n_found, n_merged, n_missed, recall, recall_resolved,
            rms_px, bias_x_px, bias_y_px, chi_square; where detections have the column too, n_false and precision.

        Raises:
            InputError: There is no such column, or edges do not ascend.
        """
        from astropy.table import Table

        values = column(self.truth, name, "truth")
        if edges is None:
            parts = [({name: value}, functools.partial(np.equal, value)) for value in np.unique(values)]
        else:
            bounds = numbers({"edges": np.atleast_1d(edges)}, ["edges"], "by")[:, 0]
            if len(bounds) < 2 or not (np.diff(bounds) > 0.0).all() or values.dtype.kind not in "if":
                raise InputError("must ascend, and be of a column of numbers", "edges", edges)
            bins = itertools.pairwise(bounds.tolist())
            parts = [({"low": low, "high": high}, functools.partial(_within, low, high)) for low, high in bins]
        measured = column(self.found, name, "found") if has_column(self.found, name) else None
        rows = []
        for head, belongs in parts:
            found = None if measured is None else self.found[belongs(measured)]
            rows.append(head | _numbers(self.truth[belongs(values)], found))
        return Table(rows=rows)

    def curve(self, thresholds: Sequence[float] | None = None) -> Table:
        """Scores of the detections with an SNR of each threshold or more, assigned anew: ROC, and precision-recall.

        Args:
            thresholds: SNR, in any order; N_THRESHOLD quantiles of the detections' when left out.

        Returns:
            A row per threshold, ascending: snr, n_detection, recall, recall_resolved, precision,
            false_alarms_per_image.

        Raises:
            InputError: Detections have no column snr, or a threshold is not finite.
        """
        from astropy.table import Table

        snr = numbers(self.found, ["snr"], "found")[:, 0]
        if thresholds is None:
            thresholds = list(np.quantile(snr, np.linspace(0.0, 1.0, N_THRESHOLD))) if len(snr) else [0.0]
        levels = np.unique(numbers({"thresholds": np.atleast_1d(thresholds)}, ["thresholds"], "curve"))
        n_truth, rows = int(self._matches.truth.counts.sum()), []
        for level in levels:
            used = snr >= level
            outcome = self._matches.outcome(used)
            n_false = int(outcome.is_false.sum())
            n_right = int(((outcome.target >= 0) | (outcome.clump >= 0)).sum())
            rates = _rates(n_truth, int((outcome.found >= 0).sum()), int(outcome.merged.sum()))
            rates["precision"] = _fraction(n_right, n_right + n_false)
            row = {"snr": level, "n_detection": int(used.sum()), **rates}
            rows.append({**row, "false_alarms_per_image": n_false / self.n_image})
        return Table(rows=rows)


def detections(
    found: Any, truth: Any, radius_px: float = 1.0, least_snr: float = 0.0, ignore: Any | None = None
) -> DetectionScore:
    """Score detections against the truth of the same images.

    In each image detections are assigned to targets one to one, within a radius: as many as can be, and of these ways
    the one with the least sum of distances. Targets of a clump (`clump_id`: those that merge at this PSF) may have one
    detection together: once one of them is found, the others are merged; a detection near the centroid of the light of
    a clump, and near none of its targets, finds the clump as a whole. Truth without `clump_id` has no clumps.

    Targets count that are on the array, with light, and an SNR of least_snr or more. A detection that is left over is
    false, but ignored within the radius of a target with light that does not count, or of a position to ignore.

    Args:
        found: Detections: frame, sensor, band, x_px, y_px; snr for curves; x_sigma_px, y_sigma_px for chi_square. Any
            table with columns: astropy's, pandas', a dict of arrays.
        truth: `FrameSet.truth`, or a table like it, of all images that were searched.
        radius_px: Largest distance of a detection from its target [px].
        least_snr: SNR of the truth from which on targets are to be found.
        ignore: Positions whose detections are neither right nor false: frame, sensor, x_px, y_px, and band where they
            are of one, as `FrameSet.stars`.

    Raises:
        InputError: A column is missing, a number is not finite, or a detection is of an image without truth.
    """
    radius = above_zero("radius_px", radius_px)
    matches, images = find_matches(found, truth, radius, finite_number("least_snr", least_snr), ignore)
    xy_px = numbers(found, ("x_px", "y_px"), "found")
    outcome = matches.outcome(np.ones(len(xy_px), dtype=bool))
    tables = _found_table(found, xy_px, matches, outcome), _truth_table(truth, found, xy_px, matches, outcome)
    total = _numbers(tables[1], tables[0])
    rates = {name: total[name] for name in ("precision", "recall", "recall_resolved", "rms_px", "chi_square")}
    rates["false_alarms_per_image"] = total["n_false"] / len(images)
    rates["bias_px"] = total["bias_x_px"], total["bias_y_px"]
    return DetectionScore(*tables, len(images), radius, _matches=matches, **rates)


def _found_table(found: Any, xy_px: F64, matches: Matches, outcome: Outcome) -> Table:
    """Detections, and what became of them."""
    from astropy.table import Table

    names = ["frame", "sensor", "band", "x_px", "y_px", *(["snr"] if has_column(found, "snr") else [])]
    table = Table({name: column(found, name, "found") for name in names})
    kind = np.where(outcome.is_false, "false", "ignored")
    kind[outcome.clump >= 0] = "clump"
    kind[outcome.target >= 0] = "target"
    table["outcome"], table["truth_row"] = kind, outcome.target
    away = np.linalg.norm(xy_px - matches.truth.xy_px[outcome.target], axis=1)
    table["distance_px"] = np.where(outcome.target >= 0, away, np.nan)
    return table


def _truth_table(truth: Any, found: Any, xy_px: F64, matches: Matches, outcome: Outcome) -> Table:
    """The truth, and what became of it."""
    from astropy.table import Table

    table = Table({name: column(truth, name, "truth") for name in column_names(truth)})
    counts, is_found = matches.truth.counts, outcome.found >= 0
    table["alone"] = matches.truth.clump < 0
    kind = np.where(counts, "missed", "not counted")
    kind[outcome.merged] = "merged"
    kind[is_found] = "found"
    table["outcome"], table["found_row"] = kind, outcome.found
    error = np.full(matches.truth.xy_px.shape, np.nan)
    error[is_found] = xy_px[outcome.found[is_found]] - matches.truth.xy_px[is_found]
    table["error_x_px"], table["error_y_px"] = error.T
    square = np.full(len(counts), np.nan)
    if has_column(found, "x_sigma_px") and has_column(found, "y_sigma_px"):
        names = ("x_sigma_px", "y_sigma_px")
        sigma = np.stack([column(found, name, "found").astype(np.float64) for name in names], axis=1)
        sigma[~((sigma > 0.0) & (sigma < np.inf))] = np.nan  # a position that light does not give has no error
        square[is_found] = ((error[is_found] / sigma[outcome.found[is_found]]) ** 2).mean(axis=1)
    table["chi_square"] = square
    return table


def _numbers(truth: Table, found: Table | None) -> dict[str, Any]:
    """Scores of some rows of the truth, and of some detections where they can be told apart."""
    outcome = np.asarray(truth["outcome"])
    n_found, n_merged, n_missed = (int((outcome == name).sum()) for name in ("found", "merged", "missed"))
    n_truth = n_found + n_merged + n_missed
    row: dict[str, Any] = {"n_truth": n_truth, "n_found": n_found, "n_merged": n_merged, "n_missed": n_missed}
    row |= _rates(n_truth, n_found, n_merged)
    used = (outcome == "found") & np.asarray(truth["alone"])
    x, y, chi = (np.asarray(truth[name])[used] for name in ("error_x_px", "error_y_px", "chi_square"))
    chi = chi[np.isfinite(chi)]
    square, *rest = (float(part.mean()) if len(part) else np.nan for part in (x**2 + y**2, x, y, chi))
    row |= {"rms_px": square**0.5, **dict(zip(("bias_x_px", "bias_y_px", "chi_square"), rest, strict=True))}
    if found is not None:
        kind = np.asarray(found["outcome"])
        n_false, n_right = int((kind == "false").sum()), int(np.isin(kind, ("target", "clump")).sum())
        row |= {"n_false": n_false, "precision": _fraction(n_right, n_right + n_false)}
    return row


def _within(low: float, high: float, values: F64) -> Flags:
    return (values >= low) & (values < high)


def _rates(n_truth: int, n_found: int, n_merged: int) -> dict[str, float]:
    return {"recall": _fraction(n_found + n_merged, n_truth), "recall_resolved": _fraction(n_found, n_truth)}


def _fraction(part: int, whole: int) -> float:
    return part / whole if whole else np.nan
