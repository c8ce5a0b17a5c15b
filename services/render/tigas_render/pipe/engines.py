"""The frames of several engines as those of one: a scene's from few, a session's from one, if need be from another.

Which engines a scene has follows from `Placement`. One that has yet to load the scene is asked for a frame that nobody
waits for, and gets viewers once that is there, as long as another engine can answer meanwhile. So is the next one for a
scene that may soon need it.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Final, Self

from tigas_common.errors import BrokenScene, DeviceLost, NoRoom, OutOfDeviceMemory, UnknownScene
from tigas_common.placement import Place, Placement, ranked
from tigas_common.wire.render import RenderRequest
from tigas_render.frame import Answered, Client, Frame, FrameSource, Withdraw
from tigas_render.pipe.client import EngineGone, OnState, PipeClient, no_engine
from tigas_render.pipe.pressure import Pressure
from tigas_render.pipe.sharing import Sharing

logger = logging.getLogger(__name__)

REFUSED_S: Final = 30.0
"""A device that had no room for a scene is not asked for it again for so long, while another can be, in seconds."""
WARM_S: Final = 60.0
"""A device that had a frame of a scene so lately has it loaded, in seconds."""
SILENT_S: Final = 1.0
"""An engine that has not said for so long how busy it is has stopped, in seconds; it says so ten times as often."""
LOOK_S: Final = 0.2
WARMING: Final = Client("engines", "warming")
"""Whom frames are for that nobody waits for."""

REFUSALS: Final = (BrokenScene, NoRoom, OutOfDeviceMemory)
"""Of an engine that cannot have the scene, though another may."""


class Engine:
    """One engine, as an edge knows it."""

    def __init__(self, name: str, pipe: PipeClient) -> None:
        self.name = name
        self.pipe = pipe
        self.place = Place(name)
        self.pressure = Pressure()
        self.age_s = self.utilisation = 0.0
        self.heard_at = 0.0
        self.warm: dict[str, float] = {}
        """When it had a frame of each scene last."""
        self.warming: set[str] = set()
        self.refused: dict[str, float] = {}
        """Until when it is not asked for a scene again."""
        self.link = 0
        """The number of the connection for which all this is true."""


class Engines(FrameSource):
    """All engines of a host; an async context manager that keeps their pipes open."""

    def __init__(self, sockets: Mapping[str, Path], edge: int, on_state: OnState, clock: Callable[[], float]) -> None:
        """sockets: by the names of what the engines render on; edge: this process's number; on_state: hears of the
        engine that has the least to do.
        """
        self._on_state = on_state
        self._clock = clock
        self._placement = Placement(clock)
        self._sharings: dict[str, Sharing] = {}
        """By scene, where anybody asks for it."""
        self._videos: dict[Client, Engine] = {}
        """Who encodes each client's video."""
        self._engines: dict[str, Engine] = {}
        for name, path in sockets.items():
            self._engines[name] = Engine(name, PipeClient(path, edge, self._hears(name)))

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
    def all(self) -> Sequence[Engine]:
        """By their numbers."""
        return tuple(self._engines.values())

    def up(self) -> list[Engine]:
        """Those that are connected."""
        return [engine for engine in self._engines.values() if engine.pipe.is_connected]

    def serving(self, scene: str) -> list[Engine]:
        """Those that are connected; the scene's own, as far as they have room for it, come first."""
        up = self.up()
        names = self._places(scene, self._willing(scene, up))
        return sorted(up, key=lambda engine: names.index(engine.name) if engine.name in names else len(names))

    def tell(self, stats: bytes) -> None:
        """Tell every engine what this edge has measured, as JSON."""
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

    def encodes(self, engine: Engine, client: Client) -> None:
        """An engine is asked for the next frame of a client's video: no other one knows how to go on with it."""
        if self._videos.get(client) is not engine:
            self.forget(client)
            self._videos[client] = engine

    # -- who is asked ------------------------------------------------------------------------------------------------

    def _choose(self, client: Client, request: RenderRequest, up: Sequence[Engine]) -> Engine | None:
        """A session's engine for a scene; one that has it loaded, if the session's own has yet to load it."""
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

    def _order(self, scene: str, engines: Sequence[Engine]) -> Sequence[str]:
        return ranked(scene, tuple(engine.name for engine in engines))

    def _places(self, scene: str, engines: Sequence[Engine]) -> list[str]:
        return self._placement.places(scene, [engine.place for engine in engines])

    def _willing(self, scene: str, engines: Sequence[Engine]) -> Sequence[Engine]:
        """Those that did not refuse the scene lately, or all if each did."""
        now = self._clock()
        return [each for each in engines if each.refused.get(scene, now) <= now] or engines

    def _is_warm(self, engine: Engine, scene: str) -> bool:
        at = engine.warm.get(scene)
        return at is not None and engine.link == engine.pipe.connections and self._clock() - at < WARM_S

    def _warm_up(self, engine: Engine, request: RenderRequest) -> None:
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

    # -- what becomes of it ------------------------------------------------------------------------------------------

    def note(self, engine: Engine, scene: str, answer: Frame | Exception) -> None:
        """Remember what an engine's answer says about it and the scene."""
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

    def another(self, client: Client, request: RenderRequest, engine: Engine, error: Exception) -> Engine | None:
        """Who may answer what one engine has failed to answer; None if that is the answer."""
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
            engine.place = Place(name, engine.pressure.pressed, engine.pressure.at_ease)
            freest = min(self.up() or (engine,), key=lambda each: (each.utilisation, each.age_s))
            self._on_state(freest.age_s, freest.utilisation)

        return heard

    async def _watch(self) -> None:
        """Give up engines that say nothing, and forget sessions that are gone, for ever."""
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

    def begin(self, engine: Engine) -> None:
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
