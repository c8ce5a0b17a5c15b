"""Playback of network traces on a link: start, pause, seek, loop, stop, or one constant state."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Protocol

from tigas_common.errors import TigasError
from tigas_common.wire.shaper import LinkSetting, PlaybackMode
from tigas_shaper.traces.trace import NetworkTrace


class NotPlaying(TigasError):
    status, type, title = 409, "nothing-plays", "No trace is playing"


class Link(Protocol):
    """The required operations of a link."""

    def apply(self, state: LinkSetting, mean_kbps: tuple[float, float] | None = None) -> None:
        """Change the link now; `mean_kbps`, down and up, sizes its queues. Raises a TigasError if it is closed."""


@dataclass(frozen=True, slots=True)
class Playback:
    """A trace that is playing, paused or ended. Times are seconds on one monotonic clock, positions milliseconds."""

    trace: NetworkTrace
    loop: bool
    anchor_ms: float = 0.0
    """Position at `since`, or while paused."""
    since: float | None = None
    """Time at which it started to play from the anchor; None while paused."""

    def position_ms(self, now: float) -> float:
        run = self._elapsed_ms(now)
        return run % self.trace.duration_ms if self.loop else min(run, self.trace.duration_ms)

    def has_ended(self, now: float) -> bool:
        return not self.loop and self._elapsed_ms(now) >= self.trace.duration_ms

    def state(self, now: float) -> LinkSetting:
        """The current state; after the end, the last one."""
        return self.trace.states[-1] if self.has_ended(now) else self.trace.state_at(self.position_ms(now))

    def next_change(self, now: float) -> float | None:
        """Time of the next state, or of the trace's end; None if neither will occur."""
        if self.since is None or self.has_ended(now):
            return None
        return self.since + (self.trace.next_change(self._elapsed_ms(now)) - self.anchor_ms) / 1e3

    def as_paused(self, now: float) -> Playback:
        return replace(self, anchor_ms=self.position_ms(now), since=None)

    def as_playing(self, now: float) -> Playback:
        """Continue from the current position, or from the start after the end."""
        return replace(self, anchor_ms=0.0 if self.has_ended(now) else self.position_ms(now), since=now)

    def with_position(self, position_ms: float, now: float) -> Playback:
        """The same playback, moved to a position within the trace."""
        bounded = min(max(position_ms, 0.0), float(self.trace.duration_ms))
        return replace(self, anchor_ms=bounded, since=None if self.since is None else now)

    def with_loop(self, loop: bool, now: float) -> Playback:
        """The same playback, with or without starting over at the end."""
        return replace(self.with_position(self.position_ms(now), now), loop=loop)

    def _elapsed_ms(self, now: float) -> float:
        # Rounded to the nanosecond, as a time computed from a boundary must not fall just before that boundary.
        return self.anchor_ms if self.since is None else round(self.anchor_ms + (now - self.since) * 1e3, 6)


class Player:
    """Changes a link according to a trace. For use on one event loop.

    Steps are timed from the start of playback, so that they do not drift; missed steps are skipped.
    """

    def __init__(
        self,
        link: Link,
        idle: LinkSetting,
        *,
        clock: Callable[[], float],
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self._link = link
        self._idle = idle
        self._clock = clock
        self._sleep = sleep
        self._playback: Playback | None = None
        self._state = idle
        self._step_task: asyncio.Task[None] | None = None

    @property
    def state(self) -> LinkSetting:
        return self._state

    @property
    def trace(self) -> NetworkTrace | None:
        return self._playback.trace if self._playback else None

    @property
    def loop(self) -> bool:
        return self._playback is not None and self._playback.loop

    @property
    def position_ms(self) -> float | None:
        return self._playback.position_ms(self._clock()) if self._playback else None

    @property
    def mode(self) -> PlaybackMode:
        if self._playback is None:
            return "constant"
        if self._playback.since is None:
            return "paused"
        return "ended" if self._playback.has_ended(self._clock()) else "playing"

    def start(self, trace: NetworkTrace, *, loop: bool = True) -> None:
        """Play a trace from its start, replacing the current one."""
        means = trace.mean_down_kbps, trace.mean_up_kbps  # slow for a long trace
        self._replace(Playback(trace, loop, since=self._clock()), means)

    def hold(self, state: LinkSetting) -> None:
        """Hold one state, replacing the current one."""
        self._stop_stepping()
        self._apply(state, (state.down_kbps, state.up_kbps))
        self._playback = None

    def stop(self) -> None:
        """Return to the idle state."""
        self.hold(self._idle)

    def pause(self) -> None:
        """Hold the current state. Raises NotPlaying."""
        self._replace(self._current().as_paused(self._clock()))

    def resume(self) -> None:
        """Continue playing. Raises NotPlaying."""
        playback = self._current()
        if playback.since is None or playback.has_ended(self._clock()):
            self._replace(playback.as_playing(self._clock()))

    def seek(self, position_ms: float) -> None:
        """Go to a position. Raises NotPlaying."""
        self._replace(self._current().with_position(position_ms, self._clock()))

    def set_loop(self, loop: bool) -> None:
        """Set whether to start over at the end. Raises NotPlaying."""
        self._replace(self._current().with_loop(loop, self._clock()))

    def close(self) -> None:
        """Stop playback, leaving the link unchanged."""
        self._stop_stepping()

    def _current(self) -> Playback:
        if self._playback is None:
            raise NotPlaying("No trace is playing; start one first.")
        return self._playback

    def _replace(self, playback: Playback, mean_kbps: tuple[float, float] | None = None) -> None:
        self._stop_stepping()
        self._apply(playback.state(self._clock()), mean_kbps)
        self._playback = playback
        if playback.since is not None:
            self._step_task = asyncio.create_task(self._keep_stepping(playback))

    async def _keep_stepping(self, playback: Playback) -> None:
        try:
            while (change := playback.next_change(now := self._clock())) is not None:
                await self._sleep(change - now)
                # A sleep may end slightly early; the state at the boundary applies regardless.
                self._apply(playback.state(max(change, self._clock())))
        except TigasError:
            return  # reported by watchers of the link

    def _apply(self, state: LinkSetting, mean_kbps: tuple[float, float] | None = None) -> None:
        self._link.apply(state, mean_kbps)
        self._state = state

    def _stop_stepping(self) -> None:
        if self._step_task:
            self._step_task.cancel()
            self._step_task = None
