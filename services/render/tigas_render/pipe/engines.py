"""The frames of several engines as one source: a scene is served by few of them, a session by one, with the others as
reserve.

`Placement` chooses the engines of a scene. An engine without the scene first gets a request on no viewer's behalf, and
gets viewers once that is answered, as long as another engine can serve them meanwhile. The same applies to the next
engine of a scene that may soon need it.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Final, Self

from tigas_common.errors import BrokenScene, DeviceLost, NoRoom, OutOfDeviceMemory, UnknownScene
from tigas_common.placement import Candidate, Placement, ranked
from tigas_common.wire.render import RenderRequest
from tigas_render.frame import Answered, Client, Frame, FrameSource, Withdraw
from tigas_render.pipe.client import EngineGone, OnState, PipeClient, no_engine
from tigas_render.pipe.pressure import Pressure
from tigas_render.pipe.sharing import Sharing

logger = logging.getLogger(__name__)

REFUSED_S: Final = 30.0
"""Seconds for which a device without room for a scene is not asked for it again, if another can be."""
WARM_S: Final = 60.0
"""Seconds for which a device that answered with a scene's frame counts as having it loaded."""
SILENT_S: Final = 1.0
"""Seconds without a load report after which an engine has stopped; reports are ten times as frequent."""
LOOK_S: Final = 0.2
WARMING: Final = Client("engines", "warming")
"""Client of frames that only load a scene."""

REFUSALS: Final = (BrokenScene, NoRoom, OutOfDeviceMemory)
"""Of an engine that cannot have the scene, though another may."""


class RemoteEngine:
    """One engine, as an edge knows it."""

    def __init__(self, name: str, pipe: PipeClient) -> None:
        self.name = name
        self.pipe = pipe
        self.candidate = Candidate(name)
        self.pressure = Pressure()
        self.age_s = self.utilisation = 0.0
        self.heard_at = 0.0
        self.warm: dict[str, float] = {}
        """When it had a frame of each scene last."""
        self.warming: set[str] = set()
        self.refused: dict[str, float] = {}
        """Times until which it is not asked for a scene again."""
        self.link = 0
        """The number of the connection for which all this is true."""


class Engines(FrameSource):
    """All engines of a host; an async context manager that keeps their pipes open."""

    def __init__(self, sockets: Mapping[str, Path], edge: int, on_state: OnState, clock: Callable[[], float]) -> None:
        """sockets: by the names of the engines' devices; edge: this process's number; on_state: called with the least
        busy engine's state.
        """
        self._on_state = on_state
        self._clock = clock
        self._placement = Placement(clock)
        self._sharings: dict[str, Sharing] = {}
        """By scene, where anybody asks for it."""
        self._videos: dict[Client, RemoteEngine] = {}
        """The engine that encodes each client's video."""
        self._engines: dict[str, RemoteEngine] = {}
        for name, path in sockets.items():
            self._engines[name] = RemoteEngine(name, PipeClient(path, edge, self._hears(name)))

    async def __aenter__(self) -> Self:
        async with AsyncExitStack() as stack:
            for engine in self._engines.values():
                await stack.enter_async_context(engine.pipe)
            watching = asyncio.create_task(self._watch())
            stack.callback(watching.cancel)
            self._stack = stack.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()

    @property
    def all(self) -> Sequence[RemoteEngine]:
        """By their numbers."""
        return tuple(self._engines.values())

    def up(self) -> list[RemoteEngine]:
        """Connected engines."""
        return [engine for engine in self._engines.values() if engine.pipe.is_connected]

    def serving(self, scene: str) -> list[RemoteEngine]:
        """Connected engines; the scene's own with room for it come first."""
        up = self.up()
        names = self._places(scene, self._willing(scene, up))
        return sorted(up, key=lambda engine: names.index(engine.name) if engine.name in names else len(names))

    def tell(self, stats: bytes) -> None:
        """Send this edge's measurements to every engine, as JSON."""
        for engine in self._engines.values():
            engine.pipe.tell(stats)

    def request(self, client: Client, request: RenderRequest, arrived: float, answered: Answered) -> Withdraw:
        engine = self._choose(client, request, self.up())
        if engine is None:
            return no_engine(answered)
        asked = _Asked(self, client, request, arrived, answered)
        asked.begin(engine)
        return asked.withdraw

    def forget(self, client: Client) -> None:
        if (engine := self._videos.pop(client, None)) is not None:
            engine.pipe.forget(client)

    def encodes(self, engine: RemoteEngine, client: Client) -> None:
        """Route a client's video to an engine: no other one can continue it."""
        if self._videos.get(client) is not engine:
            self.forget(client)
            self._videos[client] = engine

    # -- routing -----------------------------------------------------------------------------------------------------

    def _choose(self, client: Client, request: RenderRequest, up: Sequence[RemoteEngine]) -> RemoteEngine | None:
        """A session's engine for a scene; another one that has it loaded, if the session's own must load it first."""
        scene = request.scene
        willing = self._willing(scene, up)
        names = self._places(scene, willing)
        if not names:
            return None
        own = self._engines[self._share(scene).choose(client, names, self._clock())]
        if self._is_warm(own, scene):
            if own.pressure.is_near and len(names) < len(willing):
                self._warm_up(self._engines[self._order(scene, willing)[len(names)]], request)
            return own
        warm = [name for name in self._order(scene, willing) if self._is_warm(self._engines[name], scene)]
        if not warm:
            return own
        self._warm_up(own, request)
        return self._engines[warm[0]]

    def _share(self, scene: str) -> Sharing:
        if (sharing := self._sharings.get(scene)) is None:
            sharing = self._sharings[scene] = Sharing()
        return sharing

    def _order(self, scene: str, engines: Sequence[RemoteEngine]) -> Sequence[str]:
        return ranked(scene, tuple(engine.name for engine in engines))

    def _places(self, scene: str, engines: Sequence[RemoteEngine]) -> list[str]:
        return self._placement.places(scene, [engine.candidate for engine in engines])

    def _willing(self, scene: str, engines: Sequence[RemoteEngine]) -> Sequence[RemoteEngine]:
        """Engines that did not refuse the scene lately, or all if each did."""
        now = self._clock()
        return [each for each in engines if each.refused.get(scene, now) <= now] or engines

    def _is_warm(self, engine: RemoteEngine, scene: str) -> bool:
        at = engine.warm.get(scene)
        return at is not None and engine.link == engine.pipe.connections and self._clock() - at < WARM_S

    def _warm_up(self, engine: RemoteEngine, request: RenderRequest) -> None:
        scene = request.scene
        if scene in engine.warming or self._is_warm(engine, scene):
            return
        engine.warming.add(scene)

        def answered(answer: Frame | Exception) -> None:
            engine.warming.discard(scene)
            self.note(engine, scene, answer)
            if isinstance(answer, Frame):
                answer.release()

        patient = request.model_copy(update={"deadline_ms": None, "format": "jpeg", "video": None})
        engine.pipe.request(WARMING, patient, self._clock(), answered)

    # -- answers -----------------------------------------------------------------------------------------------------

    def note(self, engine: RemoteEngine, scene: str, answer: Frame | Exception) -> None:
        """Record an answer's information on its engine and the scene."""
        if isinstance(answer, Frame):
            if engine.link != engine.pipe.connections:
                engine.warm.clear()
                engine.link = engine.pipe.connections
            engine.warm[scene] = self._clock()
        elif isinstance(answer, REFUSALS):
            engine.warm.pop(scene, None)
            engine.refused[scene] = self._clock() + REFUSED_S
        elif isinstance(answer, DeviceLost):
            engine.pipe.give_up(answer.detail)

    def another(
        self, client: Client, request: RenderRequest, engine: RemoteEngine, error: Exception
    ) -> RemoteEngine | None:
        """The engine to ask after another one's failure; None if the failure is final."""
        if not isinstance(error, (*REFUSALS, UnknownScene, EngineGone, DeviceLost)):
            return None
        now = self._clock()
        rest = [each for each in self.up() if each is not engine and each.refused.get(request.scene, now) <= now]
        return self._choose(client, request, rest)

    def _hears(self, name: str) -> OnState:
        def heard(age_s: float, utilisation: float) -> None:
            engine = self._engines[name]
            engine.heard_at = self._clock()
            engine.age_s, engine.utilisation = age_s, utilisation
            engine.pressure.heard(age_s, utilisation)
            engine.candidate = Candidate(name, engine.pressure.pressed, engine.pressure.at_ease)
            freest = min(self.up() or (engine,), key=lambda each: (each.utilisation, each.age_s))
            self._on_state(freest.age_s, freest.utilisation)

        return heard

    async def _watch(self) -> None:
        """Drop silent engines and ended sessions, until cancelled."""
        looked = self._clock()
        while True:
            await asyncio.sleep(LOOK_S)
            now = self._clock()
            if now - looked < SILENT_S / 2:  # else it is this process that has stopped
                for engine in self.up():
                    if now - max(engine.heard_at, engine.pipe.connected_at) > SILENT_S:
                        engine.pipe.give_up(f"The engine on {engine.name} says nothing.")
            looked = now
            self._sharings = {scene: each for scene, each in self._sharings.items() if each.forget(now)}


class _Asked:
    """One request, which is passed on once if the engine that was asked first cannot answer it."""

    __slots__ = ("_answered", "_arrived", "_client", "_engine", "_engines", "_is_second", "_request", "_withdraw")

    def __init__(
        self, engines: Engines, client: Client, request: RenderRequest, arrived: float, answered: Answered
    ) -> None:
        self._engines = engines
        self._client = client
        self._request = request
        self._arrived = arrived
        self._answered = answered
        self._is_second = False

    def begin(self, engine: RemoteEngine) -> None:
        self._engine = engine
        if self._request.video is not None:
            self._engines.encodes(engine, self._client)
        self._withdraw = engine.pipe.request(self._client, self._request, self._arrived, self._take)

    def withdraw(self) -> None:
        self._withdraw()

    def _take(self, answer: Frame | Exception) -> None:
        self._engines.note(self._engine, self._request.scene, answer)
        if isinstance(answer, Exception) and not self._is_second:
            other = self._engines.another(self._client, self._request, self._engine, answer)
            if other is not None:
                self._is_second = True
                self.begin(other)
                return
        self._answered(answer)
