"""State of the running shaper: gateway, link, player, traces, and the link's watchers."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

from tigas_common.errors import StartError
from tigas_common.wire.shaper import DirectionStatus, LinkSetting, ShaperStatus
from tigas_shaper.link.commands import CommandError, Interface
from tigas_shaper.link.delay import detect_backend
from tigas_shaper.link.gateway import Forward, Gateway, remove_leftovers, shaper_lock
from tigas_shaper.link.link import Counters, LinkClosed, ShapedLink
from tigas_shaper.player import Player
from tigas_shaper.settings import ShaperSettings
from tigas_shaper.traces.library import TraceLibrary

SAMPLE_S = 0.2
"""Sampling interval of the link, in seconds."""
_ZERO_COUNTERS = Counters(0, 0, 0)


class Shaper:
    """The running shaper, which `api` exposes over HTTP."""

    def __init__(self, link: ShapedLink, gateway: Gateway, player: Player, library: TraceLibrary) -> None:
        self.player = player
        self.library = library
        self._link = link
        self._gateway = gateway
        self._down = _Meter()
        self._up = _Meter()
        self._sampled = asyncio.Event()
        self._stopping = False

    @classmethod
    @asynccontextmanager
    async def open(
        cls, settings: ShaperSettings, access: Interface, service: Interface, forwards: list[Forward]
    ) -> AsyncIterator[Shaper]:
        """Forward and shape, as a context manager. Raises StartError."""
        async with AsyncExitStack() as stack:
            stack.enter_context(shaper_lock())
            idle = LinkSetting(settings.down_kbps, settings.up_kbps)
            try:
                await remove_leftovers((access, service))
                backend = await detect_backend() if settings.backend == "auto" else settings.backend
                gateway = await stack.enter_async_context(Gateway.open(access, service, forwards))
                link = await stack.enter_async_context(
                    ShapedLink.open(
                        access,
                        service,
                        idle,
                        backend=backend,
                        queue_ms=settings.queue_ms,
                        on_close=gateway.close_gate,
                    )
                )
            except CommandError as error:
                raise StartError(f"The link cannot be shaped: {error}") from None
            except FileNotFoundError as error:
                raise StartError(f"The shaper needs {error.filename}: install iproute2 and nftables.") from None
            shaper = cls(link, gateway, Player(link, idle, clock=time.monotonic), TraceLibrary(settings.traces))
            stack.callback(shaper.player.close)
            # The gate is closed before the shaping is removed, so that no packet ever crosses unshaped.
            stack.push_async_callback(gateway.close)
            gateway.open_gate()
            watching = asyncio.create_task(shaper._keep_sampling())
            stack.callback(watching.cancel)
            yield shaper

    @property
    def closed_reason(self) -> str | None:
        """Reason why the link is closed, in one sentence."""
        return self._link.closed_reason

    @property
    def sent_bytes(self) -> dict[str, int]:
        return {"down": self._down.sent_bytes, "up": self._up.sent_bytes}

    def status(self) -> ShaperStatus:
        """The last sample of the link, and the current playback."""
        player, state = self.player, self.player.state
        return ShaperStatus(
            time_ms=round(time.monotonic() * 1e3, 3),
            mode=player.mode,
            trace=player.trace.name if player.trace else None,
            position_ms=player.position_ms,
            duration_ms=player.trace.duration_ms if player.trace else None,
            loop=player.loop,
            link=state,
            down=self._down.status(state.down_kbps),
            up=self._up.status(state.up_kbps),
            backend=self._link.backend,
            closed=self._link.closed_reason,
        )

    async def watch(self) -> AsyncIterator[ShaperStatus]:
        """Yield the status now and after each sample. A slow reader misses some, and never gets old ones."""
        while not self._stopping:
            yield self.status()
            await self._sampled.wait()

    def stop_watching(self) -> None:
        """End all `watch` iterators, so that the server can stop."""
        self._stopping = True
        self._sampled.set()

    async def _keep_sampling(self) -> None:
        while True:
            try:
                await self._sample()
            except LinkClosed:
                self.player.close()
            self._sampled.set()
            self._sampled = asyncio.Event()
            await asyncio.sleep(SAMPLE_S)

    async def _sample(self) -> None:
        down, up = await self._link.counters()
        try:
            await self._gateway.check()
        except CommandError as error:
            self._link.close(f"Forwarding failed; nothing passes until the shaper is restarted: {error}")
            raise LinkClosed(str(self._link.closed_reason)) from None
        now = time.monotonic()
        self._down.sample(down, now, self.player.state.down_kbps)
        self._up.sample(up, now, self.player.state.up_kbps)


class _Meter:
    """Converts one direction's counters into rates."""

    def __init__(self) -> None:
        self._counters = _ZERO_COUNTERS
        self._at: float | None = None
        self._delivered_kbps = 0.0
        self._rate_kbps = 0.0

    def sample(self, counters: Counters, now: float, rate_kbps: float) -> None:
        """Add counters read at a time in seconds, and the link's rate until then."""
        if self._at is not None:
            sent = counters.sent_bytes - self._counters.sent_bytes
            self._delivered_kbps = max(0, sent) * 8e-3 / (now - self._at)
        self._counters, self._at = counters, now
        self._rate_kbps = rate_kbps or self._rate_kbps

    @property
    def sent_bytes(self) -> int:
        return self._counters.sent_bytes

    def status(self, target_kbps: float) -> DirectionStatus:
        """Status at the last sample."""
        queue = self._counters.queue_bytes
        return DirectionStatus(
            target_kbps=target_kbps,
            delivered_kbps=self._delivered_kbps,
            queue_bytes=queue,
            queue_ms=queue * 8 / self._rate_kbps if self._rate_kbps else 0.0,
            drops=self._counters.dropped_packets,
        )
