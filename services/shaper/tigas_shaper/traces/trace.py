"""A network trace: the capacity of a link over time, and its statistics. Plain values, without files or clocks."""

from __future__ import annotations

import math
import re
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise

from pydantic import ValidationError

from tigas_common.errors import TigasError
from tigas_common.parsing import describe_error
from tigas_common.wire.shaper import MAX_DURATION_MS, LinkSetting

MAX_STEPS = 250_000
"""Seven hours at 100 ms, almost three days at 1 s. One step takes about 200 bytes of memory."""
PERCENTILES = (5, 25, 50, 75, 95)
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+=-]{0,99}")


class TraceError(TigasError):
    status, type, title = 422, "broken-trace", "The network trace cannot be used"


@dataclass(frozen=True)
class NetworkTrace:
    """A link's states over time, played from the start and repeated from there.

    Raises TraceError unless times start at 0 and increase, lengths match, and the limits above are kept.
    """

    name: str
    """Up to 100 letters, digits and any of . _ + = -, safe in file names and URL paths."""
    times_ms: tuple[int, ...]
    """Strictly increasing from 0."""
    states: tuple[LinkSetting, ...]
    """One per time: the link's state from then on."""
    duration_ms: int
    """End of the last state, after the last time."""

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
            raise TraceError(f"A trace has one state for each time, not {len(self.states)} for {len(self.times_ms)}.")
        if self.times_ms[0] != 0:
            raise TraceError(f"A trace starts at 0 ms, not at {self.times_ms[0]} ms.")
        for time, end in pairwise((*self.times_ms, self.duration_ms)):
            if end <= time:
                raise TraceError(f"Times must increase: {end} ms comes after {time} ms.")
        if self.duration_ms > MAX_DURATION_MS:
            raise TraceError(f"A trace may last 30 days; this one ends at {self.duration_ms} ms.")

    def state_at(self, t_ms: float) -> LinkSetting:
        """The state `t_ms` after the start of playback; at its end the trace starts over."""
        return self.states[bisect_right(self.times_ms, t_ms % self.duration_ms) - 1]

    def next_change(self, t_ms: float) -> float:
        """Time of the next state change, for `t_ms` after the start of playback."""
        turn, within = divmod(t_ms, self.duration_ms)
        step = bisect_right(self.times_ms, within)
        return turn * self.duration_ms + (self.times_ms[step] if step < len(self.times_ms) else self.duration_ms)

    def with_delay(self, delay_ms: float) -> NetworkTrace:
        """The same rates and losses with one constant delay (one way, ms) and no jitter. Raises ValueError."""
        return replace(self, states=tuple(replace(state, delay_ms=delay_ms, jitter_ms=0.0) for state in self.states))

    def with_loss(self, loss_pct: float) -> NetworkTrace:
        """The same rates and delays with one constant loss. Raises ValueError."""
        return replace(self, states=tuple(replace(state, loss_pct=loss_pct) for state in self.states))

    def with_uplink(self, up: NetworkTrace) -> NetworkTrace:
        """The same trace with the rates of `up`, a recording of the other direction, as its uplink.

        A shorter uplink repeats. Mahimahi, for example, publishes the two directions as two files. Raises TraceError.
        """
        times: list[int] = []
        states: list[LinkSetting] = []
        time = 0
        while time < self.duration_ms:
            if len(times) == MAX_STEPS:
                raise TraceError(f"A trace may have {MAX_STEPS:,} steps; the two together have more.")
            times.append(time)
            states.append(replace(self.state_at(time), up_kbps=up.state_at(time).down_kbps))
            time = int(min(self.next_change(time), up.next_change(time)))
        return replace(self, times_ms=tuple(times), states=tuple(states))

    @property
    def down_kbps(self) -> tuple[float, ...]:
        """Rate towards the client from each time on."""
        return tuple(state.down_kbps for state in self.states)

    @property
    def up_kbps(self) -> tuple[float, ...]:
        """Rate from the client from each time on."""
        return tuple(state.up_kbps for state in self.states)

    @cached_property
    def steps_ms(self) -> tuple[int, ...]:
        """Duration of each state in ms."""
        return tuple(end - start for start, end in pairwise((*self.times_ms, self.duration_ms)))

    @cached_property
    def mean_down_kbps(self) -> float:
        return self._mean(self.down_kbps)

    @cached_property
    def mean_up_kbps(self) -> float:
        return self._mean(self.up_kbps)

    def _mean(self, values: tuple[float, ...]) -> float:
        weighted = (value * step for value, step in zip(values, self.steps_ms, strict=True))
        return math.fsum(weighted) / self.duration_ms

    @property
    def outages(self) -> list[tuple[int, int]]:
        """Start and length in ms of each period without downlink capacity."""
        found: list[tuple[int, int]] = []
        for time, state, step in zip(self.times_ms, self.states, self.steps_ms, strict=True):
            if state.down_kbps > 0:
                continue
            if found and sum(found[-1]) == time:
                found[-1] = (found[-1][0], found[-1][1] + step)
            else:
                found.append((time, step))
        return found


def rate_percentiles(rates: Sequence[float], steps_ms: Sequence[int]) -> dict[int, float]:
    """Rates that the link does not exceed for each of PERCENTILES of the time."""
    ranked = sorted(zip(rates, steps_ms, strict=True))
    passed = list(accumulate(100 * step for _, step in ranked))
    return {percent: ranked[bisect_left(passed, percent * sum(steps_ms))][0] for percent in PERCENTILES}


class TraceBuilder:
    """Assembles a trace from states and their durations, as found in recordings."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._times: list[int] = []
        self._states: list[LinkSetting] = []
        self._end = 0.0

    def add(
        self,
        line: int,
        lasts_ms: float,
        down_kbps: float,
        up_kbps: float,
        delay_ms: float = 0.0,
        jitter_ms: float = 0.0,
        loss_pct: float = 0.0,
    ) -> None:
        """Append a state. Accumulated times are rounded to whole milliseconds, so that nothing drifts; shorter states
        are dropped.
        """
        start, self._end = round(self._end), self._end + lasts_ms
        if self._end > MAX_DURATION_MS:
            raise TraceError(f"Line {line}: a trace may last 30 days; this one lasts longer.")
        if round(self._end) == start:
            return
        if len(self._times) == MAX_STEPS:
            raise TraceError(f"Line {line}: a trace may have {MAX_STEPS:,} steps; this one has more.")
        try:
            state = LinkSetting(
                down_kbps=down_kbps, up_kbps=up_kbps, delay_ms=delay_ms, jitter_ms=jitter_ms, loss_pct=loss_pct
            )
        except ValidationError as error:
            raise TraceError(f"Line {line}: {describe_error(error)}") from None
        self._times.append(start)
        self._states.append(state)

    def build(self) -> NetworkTrace:
        if not self._times:
            raise TraceError("The file has no step of at least a millisecond.")
        return NetworkTrace(self._name, tuple(self._times), tuple(self._states), round(self._end))
