"""The recipe of a data set: a scene, its sampled fields, and the files to write."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, ValidationError, ValidationInfo, model_validator

from warpsim.config.distributions import KINDS, Distribution, is_distribution
from warpsim.config.fields import (
    Count,
    Integer,
    Name,
    NonNegative,
    Positive,
    Switch,
    as_tuple,
    closed_interval,
    rule_error,
)
from warpsim.config.model import adapter, config_model, input_error
from warpsim.dataset.crossings import Crossing, check_crossings
from warpsim.detector.hits_and_flicker import has_artifacts
from warpsim.errors import InputError
from warpsim.labels.boxes import LEAST_BOX_PX
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene
from warpsim.scene.scene_files import (
    named_files,
    presets,
    read_scene_data,
    with_absolute_paths,
    with_relative_paths,
    write_scene_data,
)

if TYPE_CHECKING:
    from typing import Self

FORMATS = ("fits", "fits-frames", "png", "tiff", "zarr", "webdataset")
"""How counts are written: FITS cubes, an extension or an image file each, one Zarr array per split, tar archives."""

SHARDED = ("zarr", "webdataset")
"""Formats that put several sequences into one file."""

SEQUENCES_PER_SHARD = 8
"""Of sharded formats, unless the recipe says otherwise; fewer where a Zarr shard would be larger than SHARD_BYTES."""

SHARD_BYTES = 128 * 2**20
"""Of a Zarr shard at most, but for a single frame: what is held in memory before it is written."""

MOST_SEQUENCES = 10_000_000

SAMPLED_ELSEWHERE = ("frames", "seed", "noise_seed", "bands", "duration_s")
"""Fields of the scene, or of its sensors, that the recipe has fields of its own for, or that are the same in all
sequences."""

IMAGE_SIZE = ("camera", "camera.n_row", "camera.n_col")
"""Fields of a sensor that set the size of its images."""


def flat_names(value: Any) -> dict[str, Any]:
    """Distributions by their field's whole name, however deep the tables are that lead there."""
    if not isinstance(value, Mapping):
        raise rule_error("must be a table of fields and distributions")
    flat: dict[str, Any] = {}

    def walk(items: Mapping[Any, Any], above: str) -> None:
        for key, item in items.items():
            name = f"{above}{str(key).replace('__', '.')}"
            if name in flat:
                raise rule_error(f"must name each field once; {name} comes twice")
            if is_distribution(item):
                flat[name] = item
            elif isinstance(item, Mapping) and item:
                walk(item, f"{name}.")
            else:
                raise rule_error(f"must have one of {', '.join(KINDS)} for {name}, as in {{ uniform = [1, 2] }}")

    walk(value, "")
    return flat


def with_absolute_choices(distributions: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Distributions by field, in which relative paths among the values of choices are taken from a folder."""
    return {
        name: item | {"choice": [_absolute(name, value, folder) for value in item["choice"]]}
        if isinstance(item, dict) and isinstance(item.get("choice"), list | tuple)
        else item
        for name, item in distributions.items()
    }


def choices_with_files(distributions: Mapping[str, Any]) -> Iterator[tuple[str, int, Any, dict[str, Any]]]:
    """Choices that name a file, a list of files, or a star catalog: field, index, value, and value in tables."""
    for name, distribution in distributions.items():
        for number, value in enumerate(getattr(distribution, "choice", ())):
            nested = _nested(name, value)
            if named_files(nested) or "catalog" in nested.get("sky", ()):
                yield name, number, value, nested


def _absolute(name: str, value: Any, folder: Path) -> Any:
    nested: Any = with_absolute_paths(_nested(name, value), folder)
    for part in name.split("."):
        nested = nested[0 if part.isdecimal() else part]
    return nested


def _nested(name: str, value: Any) -> dict[str, Any]:
    """A value in tables and lists by the parts of its name."""
    for part in reversed(name.split(".")):
        value = [value] if part.isdecimal() else {part: value}
    nested: dict[str, Any] = value
    return nested


def _scene(value: Any, info: ValidationInfo) -> Scene:
    if isinstance(value, Scene):
        return value
    if isinstance(value, str | os.PathLike):
        return Scene.load(value if value in presets() else _folder(info) / value)
    if isinstance(value, Mapping):
        return Scene.from_dict(with_absolute_paths(dict(value), _folder(info)))
    raise rule_error("must be a Scene, the name of a preset, or the path of a file")


def _samples(value: Any, info: ValidationInfo) -> dict[str, Any]:
    """Distributions by field; paths become absolute, so that workers find their files."""
    return with_absolute_choices(flat_names(value), Path.cwd() / _folder(info))


def drawn_words(values: dict[str, Any], where: str) -> str:
    """Return the place of an error in a scene with drawn values."""
    shown = ", ".join(f"{name} = {value!r}" for name, value in values.items())
    return f"{where} (drawn: {shown})"[:400]


def _classes(scene: Scene) -> set[str]:
    return {spec.class_name for group in scene.groups for spec in group.targets}


def _folder(info: ValidationInfo) -> Path:
    """Return the base of relative paths: the recipe's folder, if it came from a file."""
    return Path((info.context or {}).get("folder", ""))


def _ratios(value: dict[str, float]) -> dict[str, float]:
    if not value or sum(value.values()) <= 0:
        raise rule_error("must name splits and their sizes, not all 0")
    if clash := {name.lower() for name in value} & {"annotations", "manifest.json", "sequences.parquet", "recipe.toml"}:
        raise rule_error(f"must not be called {clash.pop()}, which is another part of the data set")
    return value


@config_model
class Recipe:
    """Recipe of a data set.

    Args:
        scene: The scene that sequences are variations of: a `Scene`, the name of a preset, or the path of a file.
        n_sequence: Sequences.
        n_frame: Frames of each.
        interval_s: Time between frames [s]; the scene's when left out.
        n_sensor: Sensors of each sequence, drawn among those that have access from its first frame to its last. They
            take their frames at the same times.
        sensors: Sensors to draw from, or kinds of them; all of the scene when left out.
        every_frame: Access plays no part: any sensor, at any time of the scene.
        bands: Band names; all of each sensor when left out. Sensors that have none of them are not drawn.
        seed: Seed of everything that is drawn.
        split: Splits, and how large each is relative to the others.
        sample: What is drawn for each sequence: distributions by field of the scene.
        crossings: Groups of the scene that cross the field of a sensor of each sequence, on paths that are drawn: by
            name, how far away, and how fast.
        format: How images are written, one of FORMATS.
        sequences_per_shard: Sequences that are written as one; when left out 1, and 8 in sharded formats, or as many as
            128 MiB of a Zarr shard hold.
        coco: Write annotations of each split in COCO's form.
        satnet: Write annotations of each image in the form of the SatNet data set.
        masks: Write which target is in which pixel.
        contributions: Write the light of each target apart [W/cm2].
        signal: Write noiseless images [W/cm2].
        stars: Write the stars of each image.
        artifacts: Write the pixels that radiation hits and flickering pixels change in each image.
        preview: Draw a small animation of each sequence: "gif" or "mp4".
        least_nei: Light in a pixel, over the NEI, from which on a mask says that a target is there.
        least_box_px: Least width and height of boxes [px]; 1e-3 leaves them as narrow as the light.

    Raises:
        InputError: One line: field, rule, value.
    """

    scene: Annotated[Scene, BeforeValidator(_scene)]
    n_sequence: Annotated[Count, closed_interval(1, MOST_SEQUENCES)] = 10
    n_frame: Annotated[Count, closed_interval(1, 1_000_000)] = 32
    interval_s: Positive | None = None
    n_sensor: Annotated[Count, closed_interval(1, 10_000)] = 1
    sensors: Annotated[tuple[str, ...], BeforeValidator(as_tuple)] | None = None
    every_frame: Switch = False
    bands: Annotated[tuple[str, ...], BeforeValidator(as_tuple)] | None = None
    seed: Annotated[Integer, closed_interval(0, 2**63 - 1)] = 0
    split: Annotated[dict[Name, NonNegative], AfterValidator(_ratios)] | None = None
    sample: Annotated[dict[str, Distribution], BeforeValidator(_samples)] | None = None
    crossings: dict[str, Crossing] | None = None
    format: Literal["fits", "fits-frames", "png", "tiff", "zarr", "webdataset"] = "fits"
    sequences_per_shard: Annotated[Count, closed_interval(1, 100_000)] | None = None
    coco: Switch = True
    satnet: Switch = False
    masks: Switch = False
    contributions: Switch = False
    signal: Switch = False
    stars: Switch = False
    artifacts: Switch = False
    preview: Literal["gif", "mp4"] | None = None
    least_nei: Positive = 1.0
    least_box_px: Positive = LEAST_BOX_PX

    @model_validator(mode="after")
    def _possible(self) -> Recipe:
        scenario = self.scenario
        for what, names, known in (
            ("sensors", self.sensors, [*scenario.instruments, *scenario.sensor_names]),
            ("bands", self.bands, list(scenario.bands)),
        ):
            for name in names or ():
                if name not in known:
                    raise InputError("must be among those of the scene", what, name)
            if names is not None and (not names or len(set(names)) < len(names)):
                raise InputError("must name one or more, each once", what)
        pool = self.pool_of(scenario)
        if self.n_sensor > len(pool):
            raise InputError(f"must be at most {len(pool)}, the sensors to draw from", "n_sensor", self.n_sensor)
        if self.clip_s > self.scene.duration_s:
            raise InputError(f"must fit into duration_s = {self.scene.duration_s:g}, take {self.clip_s:g} s", "n_frame")
        for what in ("preview", "satnet"):
            if self.format in SHARDED and getattr(self, what):
                raise InputError("needs a format with a folder for each sequence", what, self.format)
        if self.format == "zarr" and len(self.instruments) > 1:
            rule = f"images of one Zarr array must be of one kind of sensor ({', '.join(self.instruments)})"
            raise InputError(f"{rule}; name one, or choose another format", "sensors")
        drawn = any(re.search(r"\bdetector\b|\bsensors$", name) for name in self.distributions)
        if self.artifacts and not drawn and not any(has_artifacts(kind.sensor.detector) for kind in self._kinds):
            raise InputError("needs a detector with hits or flicker", "artifacts", self.artifacts)
        check_crossings(self.scene, self.crossings or {})
        self._check_sampled()
        return self

    def _check_sampled(self) -> None:
        for name in self.distributions:
            of_sensor = re.sub(r"^sensors\.\d+\.", "", name)
            head = of_sensor.partition(".")[0]
            if head in SAMPLED_ELSEWHERE:
                raise InputError(f"{head} cannot be sampled; see the recipe's own fields", f"sample.{name}")
            if self.format == "zarr" and of_sensor in IMAGE_SIZE:
                raise InputError(
                    "images of one Zarr array must be of one size; choose another format", f"sample.{name}"
                )
            for value in self.distributions[name].extremes:
                self.described({name: value}, f"sample.{name}")

    def described(self, values: dict[str, Any], where: str, **others: Any) -> Scene:
        """Return the scene with drawn values, and other changes; InputError that begins with `where` for bad ones.

        It only describes: no file is read, no orbit solved.
        """
        try:
            scene = self.scene.replace(**{name.replace(".", "__"): value for name, value in values.items()}, **others)
        except InputError as error:
            raise error.of(drawn_words(values, where)) from None
        known = _classes(self.scene)
        if new := _classes(scene) - known:  # the categories of all annotations are the same
            raise InputError(
                f"targets must be of the scene's own classes ({', '.join(sorted(known))})", value=new.pop()
            ).of(where)
        return scene

    @classmethod
    def load(cls, source: str | os.PathLike[str], **changes: Any) -> Recipe:
        """Load a recipe (.toml or .json), which names its `scene`; or take a scene (preset or file) as it is.

        Args:
            source: Preset or path. Relative paths in a recipe count from its folder.
            **changes: Fields that replace those of the file.

        Raises:
            InputError: No such file, or one of its values is not valid; the text begins with the source.
        """
        where = os.fspath(source)
        data = read_scene_data(source)
        if "scene" not in data and not ("constellation" in data or "epoch_utc" in data):
            raise InputError("must be a scene, or a recipe with a field `scene`").of(where)
        if "scene" not in data:
            data = {"scene": Scene.load(source)}
        return cls._from_dict({**data, **changes}, where, {"folder": Path(source).parent})

    @classmethod
    def _from_dict(cls, data: dict[str, Any], where: str, context: dict[str, Any] | None = None) -> Self:
        try:
            return adapter(cls).validate_python(data, context=context)  # type: ignore[no-any-return]
        except ValidationError as error:
            raise input_error(error).of(where) from None

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Return the recipe of nested dicts as from `to_dict`."""
        return cls._from_dict(data, cls.__name__)

    def to_dict(self) -> dict[str, Any]:
        """Return nested dicts and lists of plain values, without what is None."""
        plain = adapter(type(self)).dump_python(self, mode="json", exclude={"scene"}, exclude_none=True)
        return {"scene": self.scene.to_dict(), **plain}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a recipe file (.toml or .json), with the whole scene, that loads back equal.

        Paths of the scene's files beside it or below are written relative to its folder.

        Raises:
            InputError: The path cannot be written, or ends in something else.
        """
        data = self.to_dict()
        write_scene_data(data | {"scene": with_relative_paths(data["scene"], Path(path).parent)}, path)

    @property
    def distributions(self) -> dict[str, Any]:
        """Distributions of the sampled fields of the scene."""
        return self.sample or {}

    @property
    def scenario(self) -> Scenario:
        """Scenario of the scene."""
        return self.scene.scenario

    def bands_of(self, instrument: Instrument) -> list[str]:
        """Return the bands of a kind of sensor that are written."""
        known = instrument.sensor.bands
        return list(known) if self.bands is None else [band for band in self.bands if band in known]

    def pool_of(self, scenario: Scenario) -> list[str]:
        """Return the sensors to draw from, of the recipe's scene or of a variation of it."""
        kinds = {name: instrument for name, instrument in scenario.instruments.items() if self.bands_of(instrument)}
        known = [name for instrument in kinds.values() for name in instrument.names]
        found: list[str] = []
        for name in known if self.sensors is None else self.sensors:
            found += [name] if name in known or name not in kinds else kinds[name].names
        return [name for name in dict.fromkeys(found) if name in known]

    @property
    def instruments(self) -> dict[str, Instrument]:
        """The kinds of the sensors to draw from, by name."""
        pool = set(self.pool_of(self.scenario))
        return {name: kind for name, kind in self.scenario.instruments.items() if pool & set(kind.names)}

    @property
    def band_names(self) -> list[str]:
        """Bands that are written."""
        return list(dict.fromkeys(band for kind in self.instruments.values() for band in self.bands_of(kind)))

    @property
    def step_s(self) -> float:
        """Time between frames [s]."""
        return self.interval_s or self.scene.frames.interval_s

    @property
    def clip_s(self) -> float:
        """Time from the first frame of a sequence to its last [s]."""
        return (self.n_frame - 1) * self.step_s

    @property
    def ratios(self) -> dict[str, float]:
        """Splits and how large each is relative to the others."""
        return self.split or {"train": 0.8, "val": 0.1, "test": 0.1}

    @property
    def n_image(self) -> int:
        """Images of the data set, at most: sensors of several kinds may have some of the bands only."""
        return self.n_sequence * self.n_frame * self.n_sensor * max(map(len, map(self.bands_of, self._kinds)))

    @property
    def frame_bytes(self) -> int:
        """Largest size of one frame of a sequence with all planes [bytes]."""
        per_pixel = 2 + 4 * self.signal + 2 * self.masks + 4 * len(self.scenario.targets) * self.contributions
        return per_pixel * self.n_sensor * max(map(self.pixels_of, self._kinds))

    def pixels_of(self, instrument: Instrument) -> int:
        """Return the pixels of a kind of sensor in all bands that are written."""
        camera = instrument.sensor.camera
        return camera.n_row * camera.n_col * len(self.bands_of(instrument))

    @property
    def _kinds(self) -> list[Instrument]:
        return list(self.instruments.values())

    @property
    def frames_per_shard(self) -> int:
        """Frames of a Zarr shard: all of its sequences, or as many of one sequence as SHARD_BYTES hold."""
        return self.n_frame if self.shard_size > 1 else max(1, min(self.n_frame, SHARD_BYTES // self.frame_bytes))

    @property
    def shard_size(self) -> int:
        """Sequences that are written as one."""
        if self.sequences_per_shard:
            return self.sequences_per_shard
        if self.format == "zarr":
            return max(1, min(SEQUENCES_PER_SHARD, SHARD_BYTES // (self.n_frame * self.frame_bytes)))
        return SEQUENCES_PER_SHARD if self.format in SHARDED else 1
