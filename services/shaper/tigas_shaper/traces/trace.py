"""A network trace: the capacity of a link over time. Plain values, without files or clocks."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from dataclasses import dataclass, replace
from functools import cached_property

from tigas_common.errors import TigasError
from tigas_common.wire.shaper import MAX_DURATION_MS, LinkSetting

MAX_STEPS = 250_000
"""Seven hours at 100 ms, almost three days at 1 s. One step takes about 200 bytes of memory."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+=-]{0,99}")


class TraceError(TigasError):
    """The trace is unreadable or out of range."""

    status, type, title = 422, "broken-trace", "The network trace cannot be used"


@dataclass(frozen=True)
class NetworkTrace:
    """A link's states over time, played from the start and repeated from there.

    Raises TraceError if times do not start at 0 and increase, lengths differ, or a limit above is exceeded.
    """

    name: str
    """Letters, digits and any of . _ + = -, at most 100: safe in a file name and in a URL's path."""
    times_ms: tuple[int, ...]
    """Strictly increasing from 0."""
    states: tuple[LinkSetting, ...]
    """One per time: the link's state from that time on."""
    duration_ms: int
    """The end of the last state, after the last time."""

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise TraceError(
                f"A trace's name is 1 to 100 letters, digits and any of . _ + = - and starts with a letter or digit, "
                f"not {self.name[:40]!r}."
            )
        if not self.times_ms:
            raise TraceError("A trace needs at least one step.")
        if len(self.times_ms) > MAX_STEPS:
            raise TraceError(f"A trace may have {MAX_STEPS:,} steps; this one has {len(self.times_ms):,}.")
        if len(self.times_ms) != len(self.states):
            raise TraceError(f"A trace has one state a time, not {len(self.states)} for {len(self.times_ms)}.")
        if self.times_ms[0] != 0:
            raise TraceError(f"A trace starts at 0 ms, not at {self.times_ms[0]} ms.")
        ends = (*self.times_ms[1:], self.duration_ms)
        for time, end in zip(self.times_ms, ends, strict=True):
            if end <= time:
                raise TraceError(f"Times must rise: {end} ms comes after {time} ms.")
        if self.duration_ms > MAX_DURATION_MS:
            raise TraceError(f"A trace may last 30 days; this one ends at {self.duration_ms} ms.")

    def at(self, t_ms: float) -> LinkSetting:
        """The state in force `t_ms` after the start of playing; past the end the trace starts again."""
        return self.states[bisect_right(self.times_ms, t_ms % self.duration_ms) - 1]

    def with_delay(self, delay_ms: float) -> NetworkTrace:
        """The same rates and losses at one constant delay (one way, ms), without jitter. Raises ValueError."""
        return replace(self, states=tuple(replace(state, delay_ms=delay_ms, jitter_ms=0.0) for state in self.states))

    def with_loss(self, loss_pct: float) -> NetworkTrace:
        """The same rates and delays, at one constant loss. Raises ValueError."""
        return replace(self, states=tuple(replace(state, loss_pct=loss_pct) for state in self.states))

    @property
    def down_kbps(self) -> tuple[float, ...]:
        """The rate towards the client, one a time."""
        return tuple(state.down_kbps for state in self.states)

    @property
    def up_kbps(self) -> tuple[float, ...]:
        """The rate from the client, one a time."""
        return tuple(state.up_kbps for state in self.states)

    @cached_property
    def steps_ms(self) -> tuple[int, ...]:
        """How long each state lasts, ms."""
        ends = (*self.times_ms[1:], self.duration_ms)
        return tuple(end - start for start, end in zip(self.times_ms, ends, strict=True))

    @cached_property
    def mean_down_kbps(self) -> float:
        """Mean rate towards the client, weighted by time."""
        return self._mean(self.down_kbps)

    @cached_property
    def mean_up_kbps(self) -> float:
        """Mean rate from the client, weighted by time."""
        return self._mean(self.up_kbps)

    def _mean(self, values: tuple[float, ...]) -> float:
        weighted = (value * step for value, step in zip(values, self.steps_ms, strict=True))
        return math.fsum(weighted) / self.duration_ms
