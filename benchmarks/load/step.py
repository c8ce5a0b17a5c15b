"""One step of a measurement: observations of a number of viewers, figures, and whether their processes kept up."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from benchmarks.load.viewer import SERVED, Due

MISSING = "missing"
"""The fate of a frame that has no other a while after the end."""
LEAST_SPANS = 6
"""Minimum spans of an interval: with fewer, all of them have the same sign by chance in more than 5 % of all cases."""
SPAN_MS = 500.0
"""Length of a span: latencies are correlated from frame to frame, but hardly from span to span."""
RESAMPLES = 400
SEED = 1
MOST_CPU = 0.85
"""A viewers' process that is busy for a larger share of the time is itself the bottleneck."""
MOST_LAG_MS, MOST_LAG_SHARE = 5.0, 0.1
"""So late the viewers' processes may be, as a 95th percentile: in milliseconds, or as a share of the frames' own."""

Floats = NDArray[np.float64]
Interval = tuple[float, float]
"""The 95 % interval of the value, by a bootstrap over spans; nan with too few."""


@dataclass(frozen=True, slots=True)
class Observed:
    """Of the frames that were due from its begin to its end; times are in milliseconds."""

    fates: dict[str, int]
    """How many ended how."""
    served: list[tuple[float, float]]
    """When each frame that was served was due, from the begin, and how long it took."""
    there: list[float]
    """Arrival times of frames' last bytes since the start, for any due time."""
    bytes: int
    """Of all that was served."""
    outside: int
    """Viewers without a session at the end."""
    lags: list[float]
    """How late the viewers' process was itself with each frame that was served."""
    cpu: list[float]
    """Of each process: seconds that it computed."""

    @classmethod
    def of(
        cls, ended: Sequence[Due], waiting: Sequence[float], span: tuple[float, float], outside: int, cpu: float
    ) -> Self:
        """By one process. span: begin and end; as in `ended`, seconds of the monotonic clock."""
        begin, end = span
        due = [one for one in ended if begin <= one.at < end]
        served = [one for one in due if one.fate == SERVED]
        fates = Counter(one.fate for one in due)
        fates[MISSING] = sum(begin <= at < end for at in waiting)
        return cls(
            dict(+fates),
            [(_ms(one.at - begin), _ms(one.took)) for one in served],
            [_ms(one.there - begin) for one in ended if one.fate == SERVED and begin <= one.there < end],
            sum(one.size for one in served),
            outside,
            [_ms(one.lag) for one in served],
            [cpu],
        )

    @classmethod
    def together(cls, parts: Sequence[Self]) -> Self:
        """By several processes in the same time."""
        return cls(
            dict(sum((Counter(part.fates) for part in parts), Counter[str]())),
            [each for part in parts for each in part.served],
            [each for part in parts for each in part.there],
            sum(part.bytes for part in parts),
            sum(part.outside for part in parts),
            [lag for part in parts for lag in part.lags],
            [seconds for part in parts for seconds in part.cpu],
        )

    def to_json(self) -> str:
        """One line, for `from_json`."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Parse the output of `to_json`."""
        return TypeAdapter(cls).validate_json(text)


@dataclass(frozen=True, slots=True)
class Generator:
    """How the viewers' own processes did."""

    cpu: float
    """The share of the time that the busiest computed."""
    cpu_ms: float
    """Processor time of all of them for a frame, in milliseconds."""
    lag_p95_ms: float
    """Delays of sending requests."""


@dataclass(frozen=True, slots=True)
class ServerUse:
    """Resources that the service and its processes use."""

    cores: float
    """Processor time over time."""
    megabytes: float
    """Resident memory at the end."""
    open_files: int
    """At the end."""


@dataclass(frozen=True, slots=True)
class Step:
    """Figures of a number of viewers."""

    viewers: int
    outside: int
    """Viewers without a session at the end: turned away, or thrown out."""
    due: int
    """Frames wanted by these viewers."""
    fates: dict[str, int]
    """How many of them ended how; see `viewer.Due`."""
    p50_ms: float
    p50_interval: Interval
    p95_ms: float
    """From sending a request to the last byte, of frames that were served."""
    p95_interval: Interval
    frames_per_s: float
    """Frames received during the measurement, for any due time."""
    frames_interval: Interval
    mbit_per_s: float
    kilobytes: float
    """Of a frame."""
    generator: Generator
    server: ServerUse | None
    """None if it runs elsewhere."""

    @property
    def served(self) -> float:
        """The share of frames received."""
        return self.fates.get(SERVED, 0) / self.due if self.due else 0.0

    @property
    def lost(self) -> dict[str, int]:
        """All others, by their fates."""
        return {fate: count for fate, count in sorted(self.fates.items()) if fate != SERVED}

    @property
    def bottleneck(self) -> str | None:
        """Reason to blame the viewers' own processes for long waits; None if they kept up."""
        if self.generator.cpu > MOST_CPU:
            return f"a process of viewers computed {self.generator.cpu:.0%} of the time"
        if self.generator.lag_p95_ms > max(MOST_LAG_MS, MOST_LAG_SHARE * self.p95_ms):
            return f"the viewers' processes were {self.generator.lag_p95_ms:.0f} ms late themselves (p95)"
        return None

    @classmethod
    def of(cls, viewers: int, seconds: float, observed: Observed, server: ServerUse | None) -> Self:
        """From observations over this many seconds."""
        spans = max(1, round(1000 * seconds / SPAN_MS))
        due = sum(observed.fates.values())
        took = _by_span(observed.served, spans, 1000 * seconds)
        arrivals = np.histogram(observed.there, bins=spans, range=(0, 1000 * seconds))[0] * spans / seconds
        middle, late = _percentiles(took)
        served = len(observed.served)
        return cls(
            viewers=viewers,
            outside=observed.outside,
            due=due,
            fates=observed.fates,
            p50_ms=middle[0],
            p50_interval=middle[1],
            p95_ms=late[0],
            p95_interval=late[1],
            frames_per_s=float(np.mean(arrivals)),
            frames_interval=_mean_interval(arrivals),
            mbit_per_s=8e-6 * observed.bytes / seconds,
            kilobytes=observed.bytes / served / 1000 if served else math.nan,
            generator=Generator(
                max(observed.cpu) / seconds,
                1000 * sum(observed.cpu) / served if served else math.nan,
                float(np.percentile(observed.lags, 95)) if served else 0.0,
            ),
            server=server,
        )


def _ms(seconds: float) -> float:
    return round(1000 * seconds, 3)


def _by_span(served: list[tuple[float, float]], spans: int, length_ms: float) -> list[Floats]:
    at, took = np.array(served, np.float64).reshape(-1, 2).T
    span = np.minimum((at / length_ms * spans).astype(int), spans - 1)
    return [took[span == number] for number in range(spans)]


def _percentiles(spans: list[Floats]) -> list[tuple[float, Interval]]:
    """The 50th and 95th percentile of all spans together, each with its interval; nan without data."""
    whole = np.concatenate(spans)
    if not len(whole):
        return [(math.nan, (math.nan, math.nan))] * 2
    values = np.percentile(whole, (50, 95)).tolist()
    filled = [span for span in spans if len(span)]
    if len(filled) < LEAST_SPANS:
        return [(value, (math.nan, math.nan)) for value in values]
    drawn = [np.percentile(np.concatenate([filled[n] for n in chosen]), (50, 95)) for chosen in _resamples(len(filled))]
    low, high = np.percentile(drawn, (2.5, 97.5), axis=0).tolist()
    return list(zip(values, zip(low, high, strict=True), strict=True))


def _mean_interval(values: Floats) -> Interval:
    if len(values) < LEAST_SPANS:
        return math.nan, math.nan
    low, high = np.percentile(values[_resamples(len(values))].mean(axis=1), (2.5, 97.5)).tolist()
    return low, high


def _resamples(count: int) -> NDArray[np.int64]:
    """For each resample, the indices of its values [RESAMPLES, count]."""
    return np.random.default_rng(SEED).integers(count, size=(RESAMPLES, count))
