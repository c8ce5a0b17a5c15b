"""What several engines answer over HTTP, as one: any answers what all know; what each knows alone is put together."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence

import httpx
from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from tigas_common.errors import Overloaded, TigasError
from tigas_common.origins import OriginPolicy
from tigas_common.parsing import MAX_BODY
from tigas_common.proxy import hand_back, headers_of, refuse
from tigas_common.web import read_body
from tigas_render.fleet import merging
from tigas_render.fleet.proxy import AWAY, RETRY_S, EngineProxy
from tigas_render.pipe.engines import Engine, Engines

CANNOT = (422, 503)
"""The status with which an engine refuses a scene that another may take."""

Merge = Callable[[Sequence[merging.Part]], bytes]


class United:
    """An ASGI application, as which all engines' appear."""

    def __init__(self, engines: Engines, proxies: Mapping[str, EngineProxy], origins: OriginPolicy) -> None:
        """proxies: by engines' names; origins: which pages may read the answers that are its own."""
        self._engines = engines
        self._proxies = proxies
        self._origins = origins

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            answer = await self._answer(scope, await read_body(Request(scope, receive), MAX_BODY))
        except TigasError as error:
            await refuse(error, self._origins, scope, receive, send)
        else:
            await hand_back(answer, headers_of(answer), receive, send)

    async def _answer(self, scope: Scope, body: bytes) -> httpx.Response:
        match scope["method"], scope["path"].split("/")[1:]:
            case "GET", ["healthz"]:
                answers = list((await self._all(scope, body)).values())
                healthy = next((each for each in answers if each.is_success), answers[0])
                return _with_body(healthy, healthy.content)
            case "GET", ["metrics"]:
                return await self._merged(scope, body, lambda parts: merging.metrics(parts, self._engines.all))
            case "GET", ["api", "load"]:
                return await self._merged(scope, body, merging.load)
            case "GET", ["scenes"]:
                return await self._merged(scope, body, merging.scenes)
            case "GET", ["scenes", _]:
                return await self._merged(scope, body, merging.scene)
            case "GET", ["scenes", _, "enhance"]:
                return await self._merged(scope, body, merging.training)
            case "DELETE", ["scenes", _, "enhance"]:
                return await self._merged(scope, body, merging.training, by_all=True)
            case "POST", ["scenes", _, "unload"]:
                return await self._merged(scope, body, merging.scene, by_all=True)
            case ("DELETE", ["scenes", _]) | ("POST", ["scenes", _, "rename"] | ["uploads", _, "scene"]):
                return await self._change(scope, body)
            case "POST", ["scenes", scene, "enhance"]:
                return await self._first(await self._trainers(scope, scene), scope, body)
            case _, ["scenes", scene, "load" | "preview"] | ["scenes", scene, "download", _]:
                return await self._first(self._own(scene), scope, body, unless=CANNOT)
            case _:
                return await self._first(self._reachable(), scope, body)

    def _reachable(self) -> Sequence[Engine]:
        """Engines that are up; if none is, one may have started just now."""
        return self._engines.up() or self._engines.all

    def _own(self, scene: str) -> Sequence[Engine]:
        """The same, a scene's own first."""
        return self._engines.serving(scene) or self._engines.all

    async def _first(
        self, engines: Sequence[Engine], scope: Scope, body: bytes, unless: Sequence[int] = ()
    ) -> httpx.Response:
        """What the first answers that is not gone; the next one if its status is in `unless`. Raises Overloaded."""
        refused: httpx.Response | None = None
        for engine in engines:
            answer = await self._ask(engine, scope, body)
            if answer is None:
                continue
            if refused is not None:
                await refused.aclose()
            if answer.status_code not in unless:
                return answer
            refused = answer
        if refused is None:
            raise Overloaded(AWAY, RETRY_S)
        return refused

    async def _all(self, scope: Scope, body: bytes) -> dict[str, httpx.Response]:
        """What each answers that is not gone, by name. Raises Overloaded if none does."""
        whole = {**scope, "headers": [each for each in scope["headers"] if each[0] != b"accept-encoding"]}
        engines = self._reachable()
        answers = await asyncio.gather(*(self._ask(engine, whole, body, whole=True) for engine in engines))
        found = {engine.name: answer for engine, answer in zip(engines, answers, strict=True) if answer is not None}
        if not found:
            raise Overloaded(AWAY, RETRY_S)
        return found

    async def _merged(self, scope: Scope, body: bytes, merge: Merge, *, by_all: bool = False) -> httpx.Response:
        """What engines answer, as one; a refusal, if all refuse, or one does what is to be done by all."""
        answers = await self._all(scope, body)
        done = {name: answer for name, answer in answers.items() if answer.status_code == 200}
        refusals = [answer for answer in answers.values() if answer.status_code != 200]
        if refusals and (by_all or not done):
            return _with_body(refusals[0], refusals[0].content)
        content = merge([merging.Part(name, answer.content) for name, answer in done.items()])
        return _with_body(next(iter(done.values())), content)

    async def _change(self, scope: Scope, body: bytes) -> httpx.Response:
        """What one does to the models directory, at which the others look again then."""
        answer = await self._first(self._reachable(), scope, body)
        if answer.is_success:
            await self._all({**scope, "method": "GET", "raw_path": b"/scenes", "query_string": b"scan=1"}, b"")
        return answer

    async def _trainers(self, scope: Scope, scene: str) -> Sequence[Engine]:
        """Whom to ask to train a scene's networks: who does already knows that, else the scene's own engine."""
        engines = self._own(scene)
        states = {name: merging.is_running(answer.content) for name, answer in (await self._all(
            {**scope, "method": "GET"}, b""
        )).items() if answer.status_code == 200}  # fmt: skip
        return [engine for engine in engines if states.get(engine.name)] or engines

    async def _ask(self, engine: Engine, scope: Scope, body: bytes, *, whole: bool = False) -> httpx.Response | None:
        """An engine's answer, with all of its body if `whole`; None if it is gone, or goes meanwhile."""

        async def ask() -> httpx.Response:
            answer = await self._proxies[engine.name].ask(scope, body)
            if whole:
                await answer.aread()
                await answer.aclose()
            return answer

        asking = asyncio.create_task(ask())
        lost = (engine.pipe.lost,) if engine.pipe.is_connected else ()
        try:
            await asyncio.wait((asking, *lost), return_when=asyncio.FIRST_COMPLETED)
            return asking.result() if asking.done() else None
        except (Overloaded, httpx.TransportError):
            return None
        finally:
            asking.cancel()


def _with_body(answer: httpx.Response, content: bytes) -> httpx.Response:
    """An answer with another body, to be handed back."""
    headers = [each for each in answer.headers.raw if each[0].lower() not in (b"content-length", b"transfer-encoding")]
    headers.append((b"content-length", str(len(content)).encode()))
    return httpx.Response(answer.status_code, headers=headers, stream=httpx.ByteStream(content))
