"""Where a trace is at a given time. Pure: time is an argument."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, replace

from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.trace import NetworkTrace


@dataclass(frozen=True, slots=True)
class Playback:
    """A trace that plays, is paused, or has ended. Times are seconds of one monotonic clock, positions milliseconds."""

    trace: NetworkTrace
    loop: bool
    anchor_ms: float = 0.0
    """The position at `since`, or while paused."""
    since: float | None = None
    """When it began to play from the anchor; None while paused."""

    def position_ms(self, now: float) -> float:
        """The position in the trace, from 0 to its duration."""
        run = self._run_ms(now)
        return run % self.trace.duration_ms if self.loop else min(run, self.trace.duration_ms)

    def ended(self, now: float) -> bool:
        """Whether playback has reached the end and stopped there."""
        return not self.loop and self._run_ms(now) >= self.trace.duration_ms

    def state(self, now: float) -> LinkSetting:
        """The state in force; after the end, the last one."""
        return self.trace.states[-1] if self.ended(now) else self.trace.at(self.position_ms(now))

    def next_change(self, now: float) -> float | None:
        """Time of the next state, or of the trace's end; None if neither will happen."""
        if self.since is None or self.ended(now):
            return None
        run = self._run_ms(now)
        rounds, position = divmod(run, self.trace.duration_ms)
        step = bisect_right(self.trace.times_ms, position)
        times = self.trace.times_ms
        boundary = times[step] if step < len(times) else self.trace.duration_ms
        return self.since + (rounds * self.trace.duration_ms + boundary - self.anchor_ms) / 1e3

    def paused(self, now: float) -> Playback:
        """The same, held where it is."""
        return replace(self, anchor_ms=self.position_ms(now), since=None)

    def playing(self, now: float) -> Playback:
        """The same, going on from where it is; from the start if it had ended."""
        return replace(self, anchor_ms=0.0 if self.ended(now) else self.position_ms(now), since=now)

    def at(self, position_ms: float, now: float) -> Playback:
        """The same, moved to a position within the trace."""
        bounded = min(max(position_ms, 0.0), float(self.trace.duration_ms))
        return replace(self, anchor_ms=bounded, since=None if self.since is None else now)

    def looping(self, loop: bool, now: float) -> Playback:
        """The same, starting again at its end or not."""
        return replace(self.at(self.position_ms(now), now), loop=loop)

    def _run_ms(self, now: float) -> float:
        # Rounded to the nanosecond: a time computed from a boundary must not fall a hair before that boundary.
        return self.anchor_ms if self.since is None else round(self.anchor_ms + (now - self.since) * 1e3, 6)
