"""The HTTP interface of engines as an edge offers it: of one, or aggregated from several."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import httpx
from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from tigas_common.errors import Overloaded, TigasError
from tigas_common.origins import OriginPolicy
from tigas_common.parsing import MAX_BODY
from tigas_common.proxy import ask, hand_back, headers_of, refuse, unless
from tigas_common.web import read_body
from tigas_render.pipe.engines import Engines
from tigas_render.pipe.remote_engine import RemoteEngine
from tigas_render.workers import merging

MAX_CONNECTIONS = 256
AWAY = "The renderer is starting; try again in a second."
RETRY_S = 1.0
CANNOT = (422, 503)
"""The statuses with which an engine refuses a scene that another may take."""

Merge = Callable[[Sequence[merging.Part]], bytes]


class EngineProxy:
    """An ASGI application in front of one engine's, for bodies of up to MAX_BODY bytes."""

    def __init__(self, path: Path, origins: OriginPolicy) -> None:
        """origins: the pages that may read its own answers."""
        self._transport = httpx.AsyncHTTPTransport(
            uds=str(path), limits=httpx.Limits(max_connections=MAX_CONNECTIONS, keepalive_expiry=2.0)
        )
        self._origins = origins

    async def close(self) -> None:
        """Close the connections."""
        await self._transport.aclose()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            answer = await self.ask(scope, await read_body(Request(scope, receive), MAX_BODY))
        except TigasError as error:
            await refuse(error, self._origins, scope, receive, send)
        else:
            await hand_back(answer, headers_of(answer), receive, send)

    async def ask(self, scope: Scope, body: bytes) -> httpx.Response:
        """Return the engine's answer, for the caller to close. Raises Overloaded while there is no engine."""
        try:
            return await ask(self._transport, "http://engine/", scope, body)
        except httpx.TransportError as error:
            raise Overloaded(AWAY, RETRY_S) from error


class Aggregate:
    """An ASGI application in front of several engines': any of them answers, or their answers are merged."""

    def __init__(self, engines: Engines, proxies: Mapping[str, EngineProxy], origins: OriginPolicy) -> None:
        """proxies: by engines' names; origins: the pages that may read its own answers."""
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
            case "GET" | "HEAD", ["metrics"]:
                return await self._merged(scope, body, lambda parts: merging.metrics(parts, self._engines.all))
            case "GET" | "HEAD", ["api", "load"]:
                return await self._merged(scope, body, merging.load)
            case "GET" | "HEAD", ["scenes"]:
                return await self._merged(scope, body, merging.scenes)
            case "GET" | "HEAD", ["scenes", _]:
                return await self._merged(scope, body, merging.scene)
            case "GET" | "HEAD", ["scenes", _, "enhance"]:
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
                return await self._first(self._own(scene), scope, body, refusals=CANNOT)
            case _:
                return await self._first(self._reachable(), scope, body)

    def _reachable(self) -> Sequence[RemoteEngine]:
        """Return the engines that are up, or all, since one may have started just now."""
        return self._engines.up() or self._engines.all

    def _own(self, scene: str) -> Sequence[RemoteEngine]:
        """Return the same, a scene's own engines first."""
        return self._engines.serving(scene) or self._engines.all

    async def _first(
        self, engines: Sequence[RemoteEngine], scope: Scope, body: bytes, refusals: Sequence[int] = ()
    ) -> httpx.Response:
        """Return the first answer, or the next one if its status is in `refusals`. Raises Overloaded without any."""
        refused: httpx.Response | None = None
        for engine in engines:
            answer = await self._ask(engine, scope, body)
            if answer is None:
                continue
            if refused is not None:
                await refused.aclose()
            if answer.status_code not in refusals:
                return answer
            refused = answer
        if refused is None:
            raise Overloaded(AWAY, RETRY_S)
        return refused

    async def _all(self, scope: Scope, body: bytes) -> dict[str, httpx.Response]:
        """Return the engines' answers, by name. Raises Overloaded without any."""
        whole = {**scope, "headers": [each for each in scope["headers"] if each[0] != b"accept-encoding"]}
        engines = self._reachable()
        answers = await asyncio.gather(*(self._ask(engine, whole, body, whole=True) for engine in engines))
        found = {engine.name: answer for engine, answer in zip(engines, answers, strict=True) if answer is not None}
        if not found:
            raise Overloaded(AWAY, RETRY_S)
        return found

    async def _merged(self, scope: Scope, body: bytes, merge: Merge, *, by_all: bool = False) -> httpx.Response:
        """Return the merged answer, or a refusal: if all refuse, or if one does and `by_all`."""
        is_head = scope["method"] == "HEAD"  # a HEAD answer has the length of the merged body, and no body
        answers = await self._all({**scope, "method": "GET"} if is_head else scope, body)
        done = {name: answer for name, answer in answers.items() if answer.status_code == 200}
        refusals = [answer for answer in answers.values() if answer.status_code != 200]
        if refusals and (by_all or not done):
            return _with_body(refusals[0], refusals[0].content, is_head=is_head)
        content = merge([merging.Part(name, answer.content) for name, answer in done.items()])
        return _with_body(next(iter(done.values())), content, is_head=is_head)

    async def _change(self, scope: Scope, body: bytes) -> httpx.Response:
        """Let one engine change the models directory, and the others scan it after that."""
        answer = await self._first(self._reachable(), scope, body)
        if answer.is_success:
            await self._all({**scope, "method": "GET", "raw_path": b"/scenes", "query_string": b"scan=1"}, b"")
        return answer

    async def _trainers(self, scope: Scope, scene: str) -> Sequence[RemoteEngine]:
        """Return the engine that trains a scene's networks already, else the scene's own engines."""
        engines = self._own(scene)
        states = {name: merging.is_running(answer.content) for name, answer in (await self._all(
            {**scope, "method": "GET"}, b""
        )).items() if answer.status_code == 200}  # fmt: skip
        return [engine for engine in engines if states.get(engine.name)] or engines

    async def _ask(
        self, engine: RemoteEngine, scope: Scope, body: bytes, *, whole: bool = False
    ) -> httpx.Response | None:
        """Return an engine's answer, with all of its body if `whole`, or None if the engine is lost before it."""

        async def ask() -> httpx.Response:
            answer = await self._proxies[engine.name].ask(scope, body)
            if whole:
                await answer.aread()
                await answer.aclose()
            return answer

        try:
            return await (unless(engine.pipe.lost, ask()) if engine.pipe.is_connected else ask())
        except (Overloaded, httpx.TransportError):
            return None


def _with_body(answer: httpx.Response, content: bytes, *, is_head: bool = False) -> httpx.Response:
    """Return an answer with another body, or with only its length."""
    headers = [each for each in answer.headers.raw if each[0].lower() not in (b"content-length", b"transfer-encoding")]
    headers.append((b"content-length", str(len(content)).encode()))
    return httpx.Response(answer.status_code, headers=headers, stream=httpx.ByteStream(b"" if is_head else content))
