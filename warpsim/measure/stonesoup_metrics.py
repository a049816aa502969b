"""Stone Soup's metrics of tracks; importing it imports Stone Soup."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import numpy as np
from stonesoup.dataassociator.tracktotrack import TrackToTruth
from stonesoup.measures import Euclidean
from stonesoup.metricgenerator.manager import MultiManager
from stonesoup.metricgenerator.ospametric import GOSPAMetric, OSPAMetric
from stonesoup.metricgenerator.tracktotruthmetrics import SIAPMetrics
from stonesoup.types.array import StateVector
from stonesoup.types.association import AssociationSet
from stonesoup.types.groundtruth import GroundTruthPath
from stonesoup.types.state import State
from stonesoup.types.track import Track

from warpsim.measure.paths import POSITION, VELOCITY, States
from warpsim.measure.rows import naive_utc


class _Associations(AssociationSet):  # type: ignore[misc]
    """Associations that hold at the times at which both have a state; Stone Soup fails at gaps."""

    def associations_at_timestamp(self, timestamp: datetime) -> AssociationSet:
        """Associations of states at a time."""
        found = super().associations_at_timestamp(timestamp)
        return AssociationSet(
            {pair for pair in found if all(any(state.timestamp == timestamp for state in one) for one in pair.objects)}
        )


class _Associator(TrackToTruth):  # type: ignore[misc]
    """Stone Soup's associator, of tracks with gaps too."""

    def associate_tracks(self, tracks_set: set[Track], truth_set: set[GroundTruthPath]) -> AssociationSet:
        """Associate tracks with truths."""
        return _Associations(super().associate_tracks(tracks_set, truth_set).associations)


def metrics_of(
    of_tracks: States, of_truth: States, cutoff_m: float, order: float, switching_m: float, counts: tuple[int, int]
) -> dict[str, Any]:
    """Metrics by their titles, without "SIAP": numbers, or lists with one for each time of the truth."""
    position, velocity = Euclidean(mapping=POSITION), Euclidean(mapping=VELOCITY)
    siap = SIAPMetrics(position_measure=position, velocity_measure=velocity)
    ospa = OSPAMetric(p=order, c=cutoff_m, measure=position)
    gospa = GOSPAMetric(p=order, c=cutoff_m, measure=position, switching_penalty=switching_m)
    associator = _Associator(
        measure=position, association_threshold=cutoff_m, consec_pairs_confirm=counts[0], consec_misses_end=counts[1]
    )
    manager = MultiManager([siap, ospa, gospa], associator)
    manager.add_data(
        {"tracks": _sequences(of_tracks, Track), "groundtruth_paths": _sequences(of_truth, GroundTruthPath)}
    )
    found = manager.generate_metrics()
    values = {title.removeprefix("SIAP "): _value(metric) for title, metric in found["siap_generator"].items()}
    for name in ("OSPA", "GOSPA"):
        (metric,) = found[f"{name.lower()}_generator"].values()
        values[name] = _value(metric)
    return values


def _value(metric: Any) -> Any:
    value = metric.value
    return [_value(part) for part in value] if isinstance(value, list) else value


def _sequences(states: States, kind: Any) -> set[Any]:
    """Tracks or paths of states."""
    when, vector = naive_utc(states.when), np.nan_to_num(states.vector)  # measures take no NaN
    made = [State(StateVector(one), timestamp=time) for one, time in zip(vector, when, strict=True)]
    rows = {name: np.flatnonzero(states.name == name) for name in np.unique(states.name)}
    return {kind([made[row] for row in own], id=str(name)) for name, own in rows.items()}
