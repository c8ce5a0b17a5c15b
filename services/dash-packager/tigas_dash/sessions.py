"""All streams of a packager: opened, found, counted, and ended when idle."""

from __future__ import annotations

import asyncio
import gc
import logging
import secrets
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager
from typing import TypeVar, get_args

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from tigas_common.metrics import SceneNames, labelled_gauge
from tigas_common.render_requests import RenderClient
from tigas_common.wire.dash import SessionRequest
from tigas_dash.clock import Clock
from tigas_dash.encoder import EncoderName, LadderEncoder
from tigas_dash.errors import TooManySessions, UnknownSession
from tigas_dash.representation import choose_representations
from tigas_dash.session import DashStream
from tigas_dash.source import ViewSource, fetch_ladder
from tigas_dash.stream import Stream, Transport

logger = logging.getLogger(__name__)

HOUSEKEEPING_S = 1.0
_RUNG_LABELS = ("scene", "rung", "transport")
COUNTERS: Mapping[str, tuple[str, Sequence[str]]] = {
    "frames": ("Encoded frames, in each representation", _RUNG_LABELS),
    "sent_bytes": ("Sent bytes of segments or datagrams", _RUNG_LABELS),
    "repeated_frames": ("Frames that repeat the last view, as there was no newer one", ("transport",)),
    "dropped_frames": ("Frames skipped because the stream was late", ("transport",)),
    "poses": ("Poses received from viewers", ("transport",)),
    "render_failures": ("Requests that the render service did not answer with a frame", ("transport",)),
    "encoder_failures": ("Frames that an encoder refused", ("transport",)),
}
"""Help text and labels of each counter, by name without prefix."""

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
    async def run(self) -> AsyncIterator[Sessions]:
        """Maintain the sessions, and end them with the context."""
        housekeeping = asyncio.create_task(self._end_idle())
        try:
            yield self
        finally:
            housekeeping.cancel()
            for session in self.all():
                await self._end(session)

    async def open(self, request: SessionRequest) -> DashStream:
        """Open a DASH stream and render its first frame.

        Raises TooManySessions, InvalidRequest, RenderUnavailable, RenderProblem and EncoderUnavailable.
        """
        return await self.start(lambda: self._create(request))

    async def start(self, make: Callable[[], Awaitable[AnyStream]]) -> AnyStream:
        """Create and run a stream if there is room. Raises TooManySessions, and the errors of `make`."""
        if len(self._running) + self._opening >= self._limit:
            raise TooManySessions(
                f"{self._limit} sessions are already running; end one, or start the packager with a higher limit."
            )
        self._opening += 1
        try:
            session = await make()
        finally:
            self._opening -= 1
        task = asyncio.create_task(session.run(), name=session.name)
        task.add_done_callback(self._on_end)
        self._running[session.name] = session, task
        await asyncio.sleep(0)  # a task cancelled before its start would not clean up
        return session

    def get(self, name: str) -> Stream:
        """A running stream, whose idle time restarts. Raises UnknownSession."""
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
        """End a stream, unless it has already ended."""
        if session.name in self._running:
            _, task = self._running[session.name]
            if not task.cancelling():
                task.cancel()
            await asyncio.wait([task])

    async def _create(self, request: SessionRequest) -> DashStream:
        offered = choose_representations(request, await fetch_ladder(self._client, request.scene))
        source = ViewSource(self._client, request, offered[0])
        encoder = await asyncio.to_thread(
            LadderEncoder, self.encoder, offered, request.frame_rate, request.frames_per_segment
        )
        return DashStream(
            secrets.token_hex(8), request, offered, source, encoder, await source.first_frame(), self.clock
        )

    def _on_end(self, task: asyncio.Task[None]) -> None:
        ended = self._running.pop(task.get_name(), None)
        if ended is not None:
            self.metrics.add_ended(ended[0])
        gc.collect()  # encoders and frames are in reference cycles, which would be collected late
        if not task.cancelled() and (error := task.exception()):
            logger.error("Session %s failed", task.get_name(), exc_info=error)

    async def _end_idle(self) -> None:
        while True:
            await asyncio.sleep(HOUSEKEEPING_S)
            for session in self.all():
                if not session.is_watched and self.clock.now() - session.used_at > self._idle_s:
                    logger.info("Session %s ends: it was not watched for %g s", session.name, self._idle_s)
                    await self._end(session)


class DashMetrics(Collector):
    """Metrics of all streams, collected on request so that streams need not count here."""

    def __init__(self, streams: Callable[[], Sequence[Stream]], limit: int) -> None:
        """streams: the running ones; limit: their maximum number."""
        self._streams = streams
        self._limit = limit
        self._ended_totals: Counter[tuple[str, tuple[str, ...]]] = Counter()
        """Totals of ended streams, by counter and labels."""
        self._scenes = SceneNames()

    def add_ended(self, stream: Stream) -> None:
        self._ended_totals.update(self._count(stream))

    def collect(self) -> Iterator[Metric]:
        streams, totals = self._streams(), self._ended_totals.copy()
        for stream in streams:
            totals.update(self._count(stream))
        for name, (text, labels) in COUNTERS.items():
            family = CounterMetricFamily(f"tigas_dash_{name}", text, labels=labels)
            for (counter, values), total in totals.items():
                if counter == name:
                    family.add_metric(values, total)
            yield family
        alike = {name: [each for each in streams if each.transport == name] for name in get_args(Transport)}
        running = {name: len(own) for name, own in alike.items()}
        yield labelled_gauge("tigas_dash_sessions", "Running streams", "transport", running)
        behind = {name: max((each.behind_s for each in own), default=0.0) for name, own in alike.items()}
        text = "How overdue the latest frame is"
        yield labelled_gauge("tigas_dash_behind_seconds", text, "transport", behind)
        yield GaugeMetricFamily("tigas_dash_session_limit", "Maximum number of streams", self._limit)

    def _count(self, stream: Stream) -> Counter[tuple[str, tuple[str, ...]]]:
        status, transport = stream.status, stream.transport
        scene = self._scenes.label(status.scene)
        counts: Counter[tuple[str, tuple[str, ...]]] = Counter()
        for rung in stream.rungs:
            counts["frames", (scene, str(rung), transport)] += status.frames
            counts["sent_bytes", (scene, str(rung), transport)] = stream.sent_bytes[rung]
        counts["repeated_frames", (transport,)] = status.repeated
        counts["dropped_frames", (transport,)] = status.dropped
        for name in ("poses", "render_failures", "encoder_failures"):
            counts[name, (transport,)] = getattr(status, name)
        return counts
