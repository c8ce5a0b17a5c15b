"""The experiment file: a matrix in TOML or JSON, and its runs (docs/experiments.md)."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from random import Random
from typing import Annotated, Any, Self, TypeVar

from pydantic import AfterValidator, BeforeValidator, Field, ValidationError

from tigas_common.errors import StartError
from tigas_common.files import read_regular
from tigas_common.parsing import describe_error, quotable
from tigas_common.wire.dash import RepresentationRequest
from tigas_common.wire.model import WireModel
from tigas_common.wire.render import LadderName
from tigas_experiments.run.parsing import capture_interval_ms, parse_network, parse_viewport
from tigas_experiments.run.segments import movement_offsets, trace_offsets
from tigas_experiments.wire.run import (
    AUTO,
    DASH,
    LOCAL,
    MAX_OFFSET_S,
    MAX_RTT_MS,
    MODES,
    OFF,
    PER_VIEW,
    Configuration,
    DashTransport,
    FrameRate,
    Mode,
    ModelName,
    Network,
    Overscan,
    PredictorName,
)
from tigas_experiments.wire.store import MOST_FILE_CHARACTERS, ExperimentName

MAX_VALUES, MAX_VARIANTS = 1000, 100
"""Maximum lengths of lists in a file, and of the list of variants."""
MAX_RUNS = 10_000
MAX_S = 31 * 86_400
"""Maximum duration; a longer experiment is assumed to be a mistake."""
OVERHEAD_S = 2.0
"""Approximate time per run outside its warm-up, movement and captures."""
PICTURE_S, MEGAPIXEL_S = 0.1, 1.2
"""Time for comparing a capture with ground truth on two cores, and additional time per megapixel."""

Value = TypeVar("Value")


def _no_path(name: str) -> str:
    if name in (".", "..") or not name.isprintable() or any(separator in name for separator in "/\\"):
        raise ValueError(f"{name!r} must not be a path")
    return name


def _made(mode: Mode) -> Mode:
    if mode not in MODES:
        raise ValueError(f"the mode {mode!r} was removed; use 'local-compressed'")
    return mode


def _several(values: tuple[Value, ...]) -> tuple[Value, ...]:
    if not values:
        raise ValueError("there must be at least one")
    if len(values) > MAX_VALUES:
        raise ValueError(f"there are {len(values)}; the limit is {MAX_VALUES}")
    for index, value in enumerate(values):
        if value in values[:index]:
            raise ValueError(f"{value!r} occurs twice")
    return values


def _one_or_several(value: object) -> object:
    return tuple(value) if isinstance(value, list | tuple) else (value,)


def _rung(controller: int | str) -> int | str:
    return int(controller) if isinstance(controller, str) and re.fullmatch("[0-9]{1,9}", controller) else controller


ADAPTIVE = "adaptive"
Fields = list[dict[str, Any]]
"""Alternative values for some fields of a run."""
Chosen = tuple[Mode, dict[str, Any]]
"""A mode, with the fields of a run that select its quality."""
Inputs = tuple[str, str, tuple[int, Network]]
"""Scene, movement, and network with the number of its segment."""
RunMode = Annotated[Mode, AfterValidator(_made)]
Name = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_no_path)]
Controller = Annotated[int | Annotated[str, Field(min_length=1, max_length=40)], AfterValidator(_rung)]
Representation = Annotated[str, Field(pattern=rf"^({ADAPTIVE}|r[0-9]{{1,3}}-[0-9]{{2,6}})$")]
Text = Annotated[str, Field(min_length=1, max_length=1000)]
Several = Annotated[tuple[Value, ...], AfterValidator(_several)]
OneOrSeveral = Annotated[tuple[Value, ...], BeforeValidator(_one_or_several), AfterValidator(_several)]


class Variant(WireModel):
    """Overrides of the file's values; omitted values are inherited."""

    modes: Several[RunMode] | None = None
    controllers: Several[Controller] | None = None
    restore: ModelName | None = None
    upscale: ModelName | None = None
    reprojection: OneOrSeveral[bool] | None = None
    prediction: OneOrSeveral[PredictorName] | None = None
    overscan: Overscan | None = None
    depth: bool | None = None
    surround: bool | None = None


class ExperimentPlan(WireModel):
    name: Annotated[ExperimentName, AfterValidator(_no_path)]
    scenes: Several[Name]
    movements: Several[Text]
    """Movement trace files, and names of generated movements."""
    networks: Several[Text]
    """Networks in the syntax of `parse_network`."""
    rtts_ms: Several[Annotated[float, Field(ge=0, le=MAX_RTT_MS)]] | None = None
    """Round trips that replace the networks' own; by default, each network keeps its own."""
    modes: Several[RunMode] = ("stateless",)
    controllers: Several[Controller] = ("seen",)
    """Modes `stateless` and `video`: names of controllers, and fixed rungs of the ladder."""
    ladder: LadderName = "scene"
    """Each scene's own ladder, if it has one, or the paper's for all."""
    restore: ModelName = OFF
    """Modes `stateless` and `video`: the model that restores frames (docs/experiments.md), or `off`."""
    upscale: ModelName = OFF
    """Model that enlarges frames afterwards, or `off`."""
    reprojection: OneOrSeveral[bool] = (False,)
    """Whether the page reprojects the newest frame to each animation frame's pose; both values, to compare."""
    prediction: OneOrSeveral[PredictorName] = (OFF,)
    """Predictor of requested poses, or `off`."""
    overscan: Overscan = AUTO
    """Reprojection: additional margin on each side, or `auto`."""
    depth: bool = True
    """Reprojection: whether frames include a coarse depth map."""
    surround: bool = True
    """Reprojection in the modes `stateless` and `video`: whether small pictures in all directions are requested."""
    variants: Annotated[tuple[Variant, ...], Field(min_length=1, max_length=MAX_VARIANTS)] = (Variant(),)
    """Comparisons that are not a product of the above; each variant has its own runs."""
    dash_frame_rate: FrameRate | None = None
    """DASH modes: frames per second; the preset's by default."""
    dash_representations: Several[Representation] = (ADAPTIVE,)
    """DASH modes: `adaptive`, or single representations by rung and kbit/s, such as `r2-1414`."""
    dash_transports: Several[DashTransport] = ("tcp",)
    """DASH modes: `tcp`, or `h3` for HTTP/3 from the render service."""
    segments: int = Field(default=1, ge=1, le=1000)
    """Number of different parts of the traces and movements, chosen by the seed; 1 uses their beginnings."""
    movements_in_turn: bool = False
    """Whether movements alternate over the parts of the traces, instead of each movement using all parts."""
    repeats: int = Field(default=1, ge=1, le=1000)
    duration_s: float = Field(default=20.0, ge=1, le=7200)
    viewport: str = "640x360"
    seed: int = 1
    """Seed of generated movements, segments, the order of runs, and controllers, for all repeats."""
    shuffled: bool = True
    """Whether runs are made in random order."""
    capture_every_s: float = Field(default=0.0, ge=0)
    sample_stride: int = Field(default=0, ge=0, le=100_000)
    """Mode `stateless`: sample every n-th displayed frame; 0 samples none."""
    warm_up_s: float = 3.0
    trace_offset_s: float = Field(default=0.0, ge=0, le=MAX_OFFSET_S)
    """Position at which network traces start."""

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read an experiment file. Raises StartError with one sentence."""
        try:
            text = read_regular(path, 4 * MOST_FILE_CHARACTERS).decode("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise StartError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
        return cls.parse(text, str(path))

    @classmethod
    def parse(cls, text: str, source: str) -> Self:
        """Parse the text of a file, TOML or JSON, which messages call `source`. Raises StartError with one sentence."""
        if len(text) > MOST_FILE_CHARACTERS:
            raise StartError(f"{source} has more than {MOST_FILE_CHARACTERS:,} characters.")
        is_json = text.lstrip().startswith("{")
        try:
            data = json.loads(text) if is_json else tomllib.loads(text)
        except (ValueError, RecursionError) as error:
            raise StartError(f"{source} is not {'JSON' if is_json else 'TOML'}: {quotable(str(error), 200)}.") from None
        return cls.from_data(data, source)

    @classmethod
    def from_data(cls, data: dict[str, Any], source: str) -> Self:
        """Parse a file's content. Raises StartError with one sentence."""
        if unknown := [key for key in data if key not in cls.model_fields]:
            raise StartError(f"{source}: unknown key {unknown[0][:100]!r}; the keys are {', '.join(cls.model_fields)}.")
        try:
            # Validated as JSON, so that TOML's lists become tuples and nothing else is converted.
            return cls.model_validate_json(json.dumps(data, default=str))
        except ValidationError as error:
            raise StartError(f"{source}: {describe_error(error)}") from None
        except RecursionError:
            raise StartError(f"{source} is nested too deeply.") from None

    def runs(self, directory: Path, traces_s: Mapping[str, float] = {}) -> list[Configuration]:
        """All runs, in order; paths are relative to `directory` and kept unchanged.

        `traces_s` are the durations of the shaper's traces, which segments need.

        Repeats are outermost, so that an interrupted experiment has equal numbers of each kind; controllers are
        innermost, so that drift of the machine affects all of them. Within that order, the seed shuffles. Raises
        StartError with one sentence.
        """
        profiles = self._profiles()
        count = (
            self.repeats
            * self.segments
            * math.prod(map(len, (self.scenes, self.networks, self.rtts_ms or (0,), profiles)))
            * (1 if self.movements_in_turn else len(self.movements))
        )
        if count > MAX_RUNS:
            raise StartError(f"{self.name} would have {count} runs; the limit is {MAX_RUNS}.")
        for movement in self.movements:
            _check_movement(movement, directory)
        try:
            width, height = parse_viewport(self.viewport)
            networks, movements = self._networks(directory, traces_s), self._movements(directory)
            runs = [
                Configuration(
                    scene=scene,
                    movement=movement,
                    movement_offset_s=movements[movement][segment],
                    network=network,
                    mode=mode,
                    dash_frame_rate=self.dash_frame_rate,
                    duration_s=self.duration_s,
                    width=width,
                    height=height,
                    seed=self.seed,
                    segment=segment,
                    repeat=repeat,
                    capture_every_ms=capture_interval_ms(self.capture_every_s, self.duration_s),
                    sample_stride=self.sample_stride if mode == "stateless" else 0,
                    warm_up_s=self.warm_up_s,
                    **chosen,
                )
                for repeat, (scene, movement, (segment, network)), (mode, chosen) in self._ordered(networks, profiles)
            ]
        except ValidationError as error:
            raise StartError(f"{self.name}: {describe_error(error)}") from None
        except ValueError as error:
            raise StartError(f"{self.name}: {error}.") from None
        if estimate_seconds(runs) > MAX_S:
            raise StartError(f"{self.name} would take {format_duration(runs)}; the limit is {MAX_S // 86_400} days.")
        _check_folders(runs)
        return runs

    def _profiles(self) -> list[Chosen]:
        found: dict[str, Chosen] = {}
        for variant in self.variants:
            own = self.model_copy(update=variant.model_dump(exclude_none=True))
            for profile in own._own_profiles():
                found.setdefault(repr(profile), profile)
                if len(found) > MAX_RUNS:
                    raise StartError(f"{self.name} would have more than {MAX_RUNS} runs, which is the limit.")
        return list(found.values())

    def _own_profiles(self) -> Iterator[Chosen]:
        """Each mode, with each of its controllers or representations and each kind of motion compensation."""
        models = {"restore": self.restore, "upscale": self.upscale}
        controllers: Fields = [{"profile": controller, **models} for controller in self.controllers]
        representations: Fields = [{"dash_representation": _representation(name)} for name in self.dash_representations]
        motions: Fields = [
            {"reprojection": reprojection, "prediction": prediction}
            | self.model_dump(include={"overscan", "depth", "surround"})
            for reprojection, prediction in product(self.reprojection, self.prediction)
        ]
        transports: Fields = [{"dash_transport": transport} for transport in self.dash_transports]
        nothing: Fields = [{}]
        for mode in self.modes:
            choices = controllers if mode in PER_VIEW else representations if mode in DASH else nothing
            ways = transports if mode in DASH else nothing
            for choice, way, motion in product(choices, ways, nothing if mode in LOCAL else motions):
                yield mode, choice | way | motion

    def _ordered(
        self, networks: Sequence[tuple[int, Network]], profiles: Sequence[Chosen]
    ) -> Iterator[tuple[int, Inputs, Chosen]]:
        """A randomised block design: compared runs are close in time, in unbiased order."""
        rng = Random(self.seed)

        def in_order(values: Iterable[Value]) -> list[Value]:
            every = list(values)
            return rng.sample(every, len(every)) if self.shuffled else every

        for repeat in range(self.repeats):
            for inputs in in_order(self._inputs(networks)):
                for profile in in_order(profiles):
                    yield repeat, inputs, profile

    def _inputs(self, networks: Sequence[tuple[int, Network]]) -> Iterator[Inputs]:
        names = list(dict.fromkeys(network.name for _, network in networks))
        for scene, (place, movement), (segment, network) in product(self.scenes, enumerate(self.movements), networks):
            turn = (names.index(network.name) + segment) % len(self.movements)
            if place == turn or not self.movements_in_turn:
                yield scene, movement, (segment, network)

    def _networks(self, directory: Path, traces_s: Mapping[str, float]) -> list[tuple[int, Network]]:
        """The networks with each start position and round trip, and the numbers of the segments."""
        found: list[tuple[int, Network]] = []
        for network in (parse_network(text, directory) for text in self.networks):
            for segment, offset in enumerate(self._trace_offsets(network, directory, traces_s)):
                begun = network if network.trace is None else network.model_copy(update={"offset_s": offset})
                rtts = self.rtts_ms
                found += [(segment, each) for each in ([begun] if rtts is None else map(begun.with_rtt, rtts))]
        return found

    def _trace_offsets(self, network: Network, directory: Path, traces_s: Mapping[str, float]) -> list[float]:
        if self.segments == 1 or network.trace is None:
            return [self.trace_offset_s] * self.segments
        return trace_offsets(
            network,
            directory,
            traces_s,
            begin_s=self.trace_offset_s,
            length_s=self.duration_s,
            count=self.segments,
            seed=self.seed,
        )

    def _movements(self, directory: Path) -> dict[str, list[float]]:
        """Start times of each movement's segments."""
        if self.segments == 1:
            return {movement: [0.0] for movement in self.movements}
        return {
            movement: movement_offsets(
                movement, directory, length_s=self.duration_s, count=self.segments, seed=self.seed
            )
            for movement in self.movements
        }


def _representation(name: str) -> RepresentationRequest | None:
    if name == ADAPTIVE:
        return None
    rung, bitrate_kbps = map(int, name.removeprefix("r").split("-"))
    try:
        return RepresentationRequest(rung=rung, bitrate_kbps=bitrate_kbps)
    except ValidationError as error:
        raise StartError(f"There is no representation {name!r}: {describe_error(error)}") from None


def estimate_seconds(runs: Sequence[Configuration]) -> float:
    """Approximate duration of runs in seconds."""
    return sum(run.warm_up_s + run.duration_s + OVERHEAD_S + _comparing_s(run) for run in runs)


def _comparing_s(run: Configuration) -> float:
    pictures = run.duration_s * 1000 / run.capture_every_ms if run.capture_every_ms else 0
    return pictures * (PICTURE_S + MEGAPIXEL_S * run.width * run.height / 1e6)


def format_duration(runs: Sequence[Configuration]) -> str:
    """Approximate duration of runs, for people: `6 minutes`."""
    whole = estimate_seconds(runs)
    for unit, size, digits in (("days", 86_400, 1), ("hours", 3600, 1), ("minutes", 60, 0)):
        if whole >= 2 * size:
            return f"{round(whole / size, digits):g} {unit}"
    return f"{whole:.0f} seconds"


def _check_movement(text: str, directory: Path) -> None:
    """Raise StartError if the text is a path without a file. It may be the name of a generated movement instead."""
    path = directory / text
    if not path.is_file() and (Path(text).name != text or Path(text).suffix):
        raise StartError(f"There is no movement file {str(path)!r}.")


def _check_folders(runs: Sequence[Configuration]) -> None:
    folders: dict[str, Configuration] = {}
    for run in runs:
        other = folders.setdefault(run.slug.lower(), run)
        if other is not run:
            differ = [
                f"{getattr(other, name)!r} and {getattr(run, name)!r}"
                for name in ("scene", "movement", "profile", "dash_representation")
                if getattr(other, name) != getattr(run, name)
            ] or [f"{other.network.label!r} and {run.network.label!r}"]
            raise StartError(f"{differ[0]} would get the same folders, {run.slug}: give one of them another name.")
