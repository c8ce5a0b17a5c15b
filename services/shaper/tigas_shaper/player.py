"""Plays network traces on a link: start, pause, seek, loop, stop, or one constant state."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Protocol

from tigas_common.wire.shaper import LinkSetting, PlaybackMode
from tigas_shaper.errors import LinkClosed, NothingPlays
from tigas_shaper.playback import Playback
from tigas_shaper.traces.trace import NetworkTrace


class Link(Protocol):
    """The required interface of a link."""

    def apply(self, state: LinkSetting, mean_kbps: tuple[float, float] | None = None) -> None:
        """Change the link, now; `mean_kbps`, down and up, sizes its queues. Raises LinkClosed."""


class Player:
    """Changes a link according to a trace. For use on one event loop.

    Steps are timed from the start of playback, so they do not drift; a missed step is skipped.
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
        self._stepping: asyncio.Task[None] | None = None

    @property
    def state(self) -> LinkSetting:
        """The present state of the link."""
        return self._state

    @property
    def trace(self) -> NetworkTrace | None:
        """The present trace or state."""
        return self._playback.trace if self._playback else None

    @property
    def loop(self) -> bool:
        """Whether the trace starts again at its end."""
        return self._playback is not None and self._playback.loop

    @property
    def position_ms(self) -> float | None:
        """Where the trace is."""
        return self._playback.position_ms(self._clock()) if self._playback else None

    @property
    def mode(self) -> PlaybackMode:
        """Playback status."""
        if self._playback is None:
            return "constant"
        if self._playback.since is None:
            return "paused"
        return "ended" if self._playback.ended(self._clock()) else "playing"

    def start(self, trace: NetworkTrace, *, loop: bool = True) -> None:
        """Play a trace from its start, replacing the present one."""
        self._go(Playback(trace, loop, since=self._clock()), (trace.mean_down_kbps, trace.mean_up_kbps))

    def constant(self, state: LinkSetting) -> None:
        """Hold one state, replacing the present one."""
        self._halt()
        self._apply(state, (state.down_kbps, state.up_kbps))
        self._playback = None

    def stop(self) -> None:
        """Go back to the idle state."""
        self.constant(self._idle)

    def pause(self) -> None:
        """Hold the state in force. Raises NothingPlays."""
        self._go(self._current().paused(self._clock()))

    def resume(self) -> None:
        """Play on. Raises NothingPlays."""
        playback = self._current()
        if playback.since is None or playback.ended(self._clock()):
            self._go(playback.playing(self._clock()))

    def seek(self, position_ms: float) -> None:
        """Go to a position. Raises NothingPlays."""
        self._go(self._current().at(position_ms, self._clock()))

    def set_loop(self, loop: bool) -> None:
        """Start again at the end, or stay there. Raises NothingPlays."""
        self._go(self._current().looping(loop, self._clock()))

    def close(self) -> None:
        """Stop playback, and leave the link unchanged."""
        self._halt()

    def _current(self) -> Playback:
        if self._playback is None:
            raise NothingPlays("No trace is playing; start one first.")
        return self._playback

    def _go(self, playback: Playback, mean_kbps: tuple[float, float] | None = None) -> None:
        self._halt()
        self._apply(playback.state(self._clock()), mean_kbps)
        self._playback = playback
        if playback.since is not None:
            self._stepping = asyncio.create_task(self._step(playback))

    async def _step(self, playback: Playback) -> None:
        try:
            while (change := playback.next_change(now := self._clock())) is not None:
                await self._sleep(change - now)
                # A sleep may end a hair early; the state is then that of the boundary all the same.
                self._apply(playback.state(max(change, self._clock())))
        except LinkClosed:
            return  # watchers of the link report it

    def _apply(self, state: LinkSetting, mean_kbps: tuple[float, float] | None = None) -> None:
        self._link.apply(state, mean_kbps)
        self._state = state

    def _halt(self) -> None:
        if self._stepping:
            self._stepping.cancel()
            self._stepping = None
