"""All streams of a packager: opened, found, and ended when idle."""

from __future__ import annotations

import asyncio
import gc
import logging
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import TypeVar

from tigas_common.render_requests import RenderClient
from tigas_common.wire.dash import SessionRequest
from tigas_dash.clock import Clock
from tigas_dash.encoder import EncoderName, LadderEncoder
from tigas_dash.errors import TooManySessions, UnknownSession
from tigas_dash.metrics import DashMetrics
from tigas_dash.representation import representations
from tigas_dash.session import Session
from tigas_dash.source import ViewSource, ladder
from tigas_dash.stream import Stream

logger = logging.getLogger(__name__)

HOUSEKEEPING_S = 1.0

AnyStream = TypeVar("AnyStream", bound=Stream)


class Sessions:
    def __init__(self, client: RenderClient, encoder: EncoderName, clock: Clock, *, limit: int, idle_s: float) -> None:
        self.clock = clock
        self.encoder = encoder
        self._client = client
        self._limit = limit
        self._idle_s = idle_s
        self._running: dict[str, tuple[Stream, asyncio.Task[None]]] = {}
        self._opening = 0
        self.metrics = DashMetrics(self.all, limit)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[Sessions]:
        """Maintain the sessions, and end them with the context."""
        housekeeping = asyncio.create_task(self._keep_house())
        try:
            yield self
        finally:
            housekeeping.cancel()
            for session in self.all():
                await self._end(session)

    async def open(self, request: SessionRequest) -> Session:
        """A new DASH stream, once its first frame is rendered.

        Raises TooManySessions, InvalidRequest, RenderUnavailable, RenderProblem and EncoderUnavailable.
        """
        return await self.start(lambda: self._make(request))

    async def start(self, make: Callable[[], Awaitable[AnyStream]]) -> AnyStream:
        """Open and run a stream if there is room. Raises TooManySessions, and the errors of making it."""
        if len(self._running) + self._opening >= self._limit:
            raise TooManySessions(
                f"{self._limit} sessions are running already; end one, or start the packager with a higher limit."
            )
        self._opening += 1
        try:
            session = await make()
        finally:
            self._opening -= 1
        task = asyncio.create_task(session.run(), name=session.name)
        task.add_done_callback(self._ended)
        self._running[session.name] = session, task
        await asyncio.sleep(0)  # a task that is cancelled before it has begun never cleans up
        return session

    def get(self, name: str) -> Stream:
        """A running stream, which counts as used by that. Raises UnknownSession."""
        found = self._running.get(name)
        if found is None:
            raise UnknownSession("There is no such session; it may have ended.")
        found[0].used_at = self.clock.now()
        return found[0]

    def all(self) -> list[Stream]:
        return [session for session, _ in self._running.values()]

    async def end(self, name: str) -> None:
        """End a stream. Raises UnknownSession."""
        await self._end(self.get(name))

    async def _end(self, session: Stream) -> None:
        """End a stream, unless it has ended by now."""
        if session.name in self._running:
            _, task = self._running[session.name]
            task.cancel()
            await asyncio.wait([task])

    async def _make(self, request: SessionRequest) -> Session:
        offered = representations(request, await ladder(self._client, request.scene))
        source = ViewSource(self._client, request, offered[0])
        encoder = await asyncio.to_thread(
            LadderEncoder, self.encoder, offered, request.frame_rate, request.frames_per_segment
        )
        return Session(secrets.token_hex(8), request, offered, source, encoder, await source.first(), self.clock)

    def _ended(self, task: asyncio.Task[None]) -> None:
        ended = self._running.pop(task.get_name(), None)
        if ended is not None:
            self.metrics.ended(ended[0])
        gc.collect()  # encoders and frames are in reference cycles, which would be collected late
        if not task.cancelled() and (error := task.exception()):
            logger.error("Session %s failed", task.get_name(), exc_info=error)

    async def _keep_house(self) -> None:
        while True:
            await asyncio.sleep(HOUSEKEEPING_S)
            for session in self.all():
                if not session.watched and self.clock.now() - session.used_at > self._idle_s:
                    logger.info("Session %s ends: it was not watched for %g s", session.name, self._idle_s)
                    await self._end(session)
