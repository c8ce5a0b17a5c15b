"""Observations of viewers in an interval: of one process, and of all processes together."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Self

from benchmarks.load.viewer import SERVED, Due

MISSING = "missing"
"""The fate of a frame that has no other a while after the end."""


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
    dropped: int
    """Datagrams received and dropped by the socket."""

    @classmethod
    def of(
        cls,
        ended: Sequence[Due],
        waiting: Sequence[float],
        span: tuple[float, float],
        outside: int,
        cpu: float,
        dropped: int = 0,
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
            max(0, dropped),
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
            sum(part.dropped for part in parts),
        )

    def to_json(self) -> str:
        """One line, for `from_json`."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Parse the output of `to_json`."""
        given = json.loads(text)
        return cls(**{**given, "served": [(at, took) for at, took in given["served"]]})


def _ms(seconds: float) -> float:
    return round(1000 * seconds, 3)
