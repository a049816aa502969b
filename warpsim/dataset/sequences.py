"""Sequences, functions of the recipe's seed and the sequence's number alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from warpsim.dataset.recipe import Recipe
from warpsim.errors import InputError
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene
from warpsim.streams import uniforms

MOST_ATTEMPTS = 100
"""Draws of a sequence before it is given up: a scene may leave no sensor that sees the targets for long enough."""


@dataclass(frozen=True)
class Sequence:
    """One sequence."""

    number: int
    scene: Scene
    """With the drawn values, a seed of its own, and frames 0 to n_frame - 1."""
    sensors: list[str]
    values: dict[str, Any]
    """What was drawn, by field of the scene."""
    attempt: int
    """Draws before this one in which not enough sensors saw the targets."""

    @property
    def scenario(self) -> Scenario:
        """Scenario of the scene."""
        return self.scene.scenario

    @property
    def by_kind(self) -> dict[str, list[str]]:
        """Sensors by their kind: those of one are rendered together."""
        kinds: dict[str, list[str]] = {}
        for sensor in self.sensors:
            kinds.setdefault(self.scenario.instrument_of(sensor).sensor.name, []).append(sensor)
        return kinds


def draw_sequence(recipe: Recipe, number: int) -> Sequence:
    """Draw a sequence; InputError where the drawn values are not valid in the scene, or no draw has enough sensors."""
    for attempt in range(MOST_ATTEMPTS):
        values = drawn_values(recipe, number, attempt)
        scene = varied(recipe, values, f"sequence {number}", **_of_sequence(recipe, number))
        clips = _any_time(recipe, scene) if recipe.every_frame else _clips(recipe, scene)
        if clips:
            start_s, sensors = _chosen_clip(recipe, clips, number, attempt)
            frames = {"count": recipe.n_frame, "interval_s": recipe.step_s, "start_s": start_s}
            return Sequence(number, scene.replace(frames=frames), sensors, values, attempt)
        if not recipe.distributions:  # all draws are alike
            break
    raise InputError(
        f"in {attempt + 1} draws there were never {recipe.n_sensor} sensors with access to a target for "
        f"{recipe.clip_s:g} s; ask for fewer frames or sensors, or for every_frame = true",
        f"sequence {number}",
    )


def _of_sequence(recipe: Recipe, number: int) -> dict[str, Any]:
    """Fields of the scene of a sequence that the recipe sets: seeds, bands, and the same frames for all sensors."""
    fields: dict[str, Any] = {"seed": _seed(recipe, number), "noise_seed": None}
    for index, (name, instrument) in enumerate(recipe.scenario.instruments.items()):
        fields[f"sensors__{index}__frames"] = None
        if name in recipe.instruments:
            fields[f"sensors__{index}__bands"] = recipe.bands_of(instrument)
    return fields


def drawn_values(recipe: Recipe, number: int, attempt: int = 0) -> dict[str, Any]:
    """Return values of the sampled fields in one draw of a sequence, by field."""
    return {
        name: distribution.value(float(uniforms(recipe.seed, f"dataset.{name}", number, attempt + 1)[attempt]))
        for name, distribution in recipe.distributions.items()
    }


def varied(recipe: Recipe, values: dict[str, Any], where: str, **others: Any) -> Scene:
    """Return the recipe's scene with drawn values, and others; InputError that begins with `where` for bad ones."""
    try:
        scene = recipe.scene.replace(**{name.replace(".", "__"): value for name, value in values.items()}, **others)
        scene.scenario  # noqa: B018  # reads files, flies flights
    except InputError as error:
        shown = ", ".join(f"{name} = {value!r}" for name, value in values.items())
        raise error.of(f"{where} (drawn: {shown})"[:400]) from None
    known = _classes(recipe.scene)
    if new := _classes(scene) - known:  # the categories of all annotations are the same
        raise InputError(
            f"targets must be of the scene's own classes ({', '.join(sorted(known))})", value=new.pop()
        ).of(where)
    return scene


def _classes(scene: Scene) -> set[str]:
    return {spec.class_name for group in scene.groups for spec in group.targets}


def check_extremes(recipe: Recipe) -> None:
    """Check that the extremes of each distribution are valid in the scene, before hours of work."""
    for name, distribution in recipe.distributions.items():
        for value in distribution.extremes:
            varied(recipe, {name: value}, f"sample.{name}")


def split_of(recipe: Recipe) -> dict[str, list[int]]:
    """Return the numbers of the sequences of each split, in order; ratios are met to one sequence."""
    order = np.argsort(uniforms(recipe.seed, "dataset split", 0, recipe.n_sequence), kind="stable")
    total = sum(recipe.ratios.values())
    ends = np.cumsum(list(recipe.ratios.values())) / total * recipe.n_sequence
    edges = [0, *(int(end) for end in np.round(ends))]
    return {
        name: sorted(int(number) for number in order[first:end])
        for name, first, end in zip(recipe.ratios, edges[:-1], edges[1:], strict=True)
    }


def _seed(recipe: Recipe, number: int) -> int:
    """The seed of a sequence's noise and of all that its scene draws."""
    return int(uniforms(recipe.seed, "dataset seed", number, 1)[0] * 2**53)


def _any_time(recipe: Recipe, scene: Scene) -> list[tuple[float, float, list[str]]]:
    """The whole scene, with all sensors; nothing where a drawn constellation has too few."""
    pool = recipe.pool_of(scene.scenario)
    return [(0.0, scene.duration_s - recipe.clip_s, pool)] if len(pool) >= recipe.n_sensor else []


def _clips(recipe: Recipe, scene: Scene) -> list[tuple[float, float, list[str]]]:
    """Earliest and latest start of sequences that the same sensors see whole, and these sensors; enough of them."""
    pool = recipe.pool_of(scene.scenario)
    seen = [
        (instrument.names[sensor], float(start_s), float(end_s - recipe.clip_s))
        for instrument in scene.scenario.instruments.values()
        for sensor, start_s, end_s in zip(
            instrument.access.row, instrument.access.start_s, instrument.access.end_s, strict=True
        )
        if instrument.names[sensor] in pool and end_s - recipe.clip_s >= start_s
    ]
    edges = sorted({edge for _, *edge_s in seen for edge in edge_s})
    clips = []
    for first_s, last_s in zip(edges, edges[1:] or edges, strict=False):
        names = [name for name, start_s, end_s in seen if start_s <= first_s and last_s <= end_s]
        if len(names) >= recipe.n_sensor:
            clips.append((first_s, last_s, names))
    return clips


def _chosen_clip(
    recipe: Recipe, clips: list[tuple[float, float, list[str]]], number: int, attempt: int
) -> tuple[float, list[str]]:
    """Start and sensors of a sequence: any possible start is as likely, and any choice of sensors."""
    fraction = uniforms(recipe.seed, "dataset start", number, attempt + 1)[attempt]
    lengths = np.array([last_s - first_s for first_s, last_s, _ in clips])
    ends = np.cumsum(lengths if lengths.sum() > 0 else np.ones(len(clips)))
    which = min(int(np.searchsorted(ends, fraction * ends[-1], side="right")), len(clips) - 1)
    first_s, last_s, names = clips[which]
    along = (fraction * ends[-1] - (ends[which] - lengths[which])) if lengths.sum() > 0 else 0.0
    order = np.argsort(uniforms(recipe.seed, f"dataset sensors {attempt}", number, len(names)), kind="stable")
    chosen = {names[i] for i in order[: recipe.n_sensor]}
    return min(first_s + float(along), last_s), [name for name in names if name in chosen]
