"""The frames of several engines as one source. A few engines serve a scene, and one of them serves a session, with the
others in reserve.

`Placement` chooses the engines of a scene. An engine without the scene first gets a request that no viewer is waiting
for, and gets viewers once that is answered, provided that another engine can serve them in the meantime. The same
applies to the next engine of a scene that may soon need it.
"""

from __future__ import annotations

import asyncio
from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Self

from tigas_common.errors import DeviceLost, UnknownScene
from tigas_common.placement import Placement, rank_names
from tigas_common.wire.render import RenderRequest
from tigas_render.admission.load import LoadState
from tigas_render.frame import Cancel, Client, Frame, FrameSource, OnAnswer
from tigas_render.pipe.client import EngineUnavailable, OnState, PipeClient, answer_unavailable
from tigas_render.pipe.remote_engine import REFUSALS, RemoteEngine

SILENCE_TIMEOUT_S: Final = 1.0
"""Seconds without a load report after which an engine counts as stopped; reports are ten times as frequent."""
CHECK_INTERVAL_S: Final = 0.2
SESSION_EXPIRY_S: Final = 5.0
"""Seconds without a request after which a session no longer counts."""


class SessionAssignment:
    """Assigns the sessions of a scene to its engines, stably and evenly."""

    def __init__(self) -> None:
        self._engines: dict[Hashable, tuple[str, float]] = {}
        """Each session's engine, and the time of its last request."""
        self._counts: Counter[str] = Counter()

    def choose(self, session: Hashable, engines: Sequence[str], now: float) -> str:
        """Choose a session's engine among these, best first.

        A session moves only if its engine is not among them, or has more than its share of the sessions.
        """
        kept = self._engines.get(session)
        if kept is not None and kept[0] in engines and self._counts[kept[0]] <= self._fair_share(engines):
            chosen = kept[0]
        else:
            if kept is not None:
                self._counts[kept[0]] -= 1
            chosen = min(engines, key=lambda engine: self._counts[engine])
            self._counts[chosen] += 1
        self._engines[session] = chosen, now
        return chosen

    def expire(self, now: float) -> bool:
        """Drop ended sessions. Returns whether any are left."""
        for session in [session for session, (_, at) in self._engines.items() if now - at >= SESSION_EXPIRY_S]:
            engine, _ = self._engines.pop(session)
            self._counts[engine] -= 1
        return bool(self._engines)

    def _fair_share(self, engines: Sequence[str]) -> int:
        return -(-sum(self._counts[engine] for engine in engines) // len(engines))


class EnginePool(FrameSource):
    """All engines of a host; an async context manager that keeps their pipes open."""

    def __init__(self, sockets: Mapping[str, Path], edge: int, on_state: OnState, clock: Callable[[], float]) -> None:
        """sockets: by the names of the engines' devices. edge: this process's number. on_state: called with the state
        of the least busy engine.
        """
        self._on_state = on_state
        self._clock = clock
        self._placement = Placement(clock)
        self._assignments: defaultdict[str, SessionAssignment] = defaultdict(SessionAssignment)
        """Assignment of sessions by scene, for scenes with recent requests."""
        self._videos: dict[Client, RemoteEngine] = {}
        """The engine that encodes each client's video."""
        self._engines: dict[str, RemoteEngine] = {}
        for name, path in sockets.items():
            self._engines[name] = RemoteEngine(name, PipeClient(path, edge, self._state_handler(name)), clock)

    async def __aenter__(self) -> Self:
        async with AsyncExitStack() as stack:
            for engine in self._engines.values():
                await stack.enter_async_context(engine.pipe)
            checking = asyncio.create_task(self._check_engines())
            stack.callback(checking.cancel)
            self._stack = stack.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()

    @property
    def all(self) -> Sequence[RemoteEngine]:
        """All engines, by number."""
        return tuple(self._engines.values())

    def connected(self) -> list[RemoteEngine]:
        return [engine for engine in self._engines.values() if engine.pipe.is_connected]

    def by_preference(self, scene: str) -> list[RemoteEngine]:
        """The connected engines; those serving the scene, with room for it, come first."""
        up = self.connected()
        names = self._placed_names(scene, self._accepting(scene, up))
        return sorted(up, key=lambda engine: names.index(engine.name) if engine.name in names else len(names))

    def send_stats(self, state: LoadState) -> None:
        """Send this edge's measurements to every engine."""
        for engine in self._engines.values():
            engine.pipe.send_stats(state)

    def request(self, client: Client, request: RenderRequest, arrived: float, on_answer: OnAnswer) -> Cancel:
        engine = self._choose(client, request, self.connected())
        if engine is None:
            return answer_unavailable(on_answer)
        forwarded = _ForwardedRequest(self, engine, client, request, arrived, on_answer)
        forwarded.send()
        return forwarded.cancel

    def forget(self, client: Client) -> None:
        if (engine := self._videos.pop(client, None)) is not None:
            engine.pipe.forget(client)

    def set_video_engine(self, engine: RemoteEngine, client: Client) -> None:
        """Record the engine that encodes a client's video, which no other engine can continue."""
        if self._videos.get(client) is not engine:
            self.forget(client)
            self._videos[client] = engine

    def _choose(self, client: Client, request: RenderRequest, connected: Sequence[RemoteEngine]) -> RemoteEngine | None:
        """A session's engine for a scene, or another one that has it loaded while the session's engine loads it."""
        scene = request.scene
        accepting = self._accepting(scene, connected)
        names = self._placed_names(scene, accepting)
        if not names:
            return None
        own = self._engines[self._assignments[scene].choose(client, names, self._clock())]
        if own.is_warm(scene):
            if own.pressure.is_rising and len(names) < len(accepting):
                self._engines[self._ranked_names(scene, accepting)[len(names)]].warm_up(request)
            return own
        warm = [name for name in self._ranked_names(scene, accepting) if self._engines[name].is_warm(scene)]
        if not warm:
            return own
        own.warm_up(request)
        return self._engines[warm[0]]

    def _ranked_names(self, scene: str, engines: Sequence[RemoteEngine]) -> Sequence[str]:
        return rank_names(scene, tuple(engine.name for engine in engines))

    def _placed_names(self, scene: str, engines: Sequence[RemoteEngine]) -> list[str]:
        return self._placement.places(scene, [engine.candidate for engine in engines])

    def _accepting(self, scene: str, engines: Sequence[RemoteEngine]) -> Sequence[RemoteEngine]:
        """The engines that have not refused the scene recently, or all engines if each of them has."""
        return [engine for engine in engines if not engine.has_refused(scene)] or engines

    def fallback(
        self, client: Client, request: RenderRequest, engine: RemoteEngine, error: Exception
    ) -> RemoteEngine | None:
        """The engine to ask after a failure of another one; None if the failure is final."""
        if not isinstance(error, (*REFUSALS, UnknownScene, EngineUnavailable, DeviceLost)):
            return None
        rest = [each for each in self.connected() if each is not engine and not each.has_refused(request.scene)]
        return self._choose(client, request, rest)

    def _state_handler(self, name: str) -> OnState:
        def on_state(age_s: float, utilisation: float) -> None:
            engine = self._engines[name]
            engine.update_load(age_s, utilisation)
            freest = min(self.connected() or (engine,), key=lambda each: (each.utilisation, each.age_s))
            self._on_state(freest.age_s, freest.utilisation)

        return on_state

    async def _check_engines(self) -> None:
        """Drop silent engines and ended sessions, until cancelled."""
        checked_at = self._clock()
        while True:
            await asyncio.sleep(CHECK_INTERVAL_S)
            now = self._clock()
            if now - checked_at < SILENCE_TIMEOUT_S / 2:  # otherwise this process itself was stopped
                for engine in self.connected():
                    if now - max(engine.updated_at, engine.pipe.connected_at) > SILENCE_TIMEOUT_S:
                        engine.pipe.disconnect(f"The engine on {engine.name} does not answer.")
            checked_at = now
            for scene in [scene for scene, sessions in self._assignments.items() if not sessions.expire(now)]:
                del self._assignments[scene]


@dataclass(slots=True, eq=False)
class _ForwardedRequest:
    """A request, which is passed on to another engine once if the first engine cannot answer it."""

    engines: EnginePool
    engine: RemoteEngine
    client: Client
    request: RenderRequest
    arrived: float
    on_answer: OnAnswer
    is_retry: bool = False
    cancel_current: Cancel = field(init=False)

    def send(self) -> None:
        if self.request.video is not None:
            self.engines.set_video_engine(self.engine, self.client)
        self.cancel_current = self.engine.pipe.request(self.client, self.request, self.arrived, self.handle_answer)

    def cancel(self) -> None:
        self.cancel_current()

    def handle_answer(self, answer: Frame | Exception) -> None:
        self.engine.record_answer(self.request.scene, answer)
        if isinstance(answer, Exception) and not self.is_retry:
            other = self.engines.fallback(self.client, self.request, self.engine, answer)
            if other is not None:
                self.is_retry, self.engine = True, other
                self.send()
                return
        self.on_answer(answer)
