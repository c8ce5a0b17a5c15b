"""The HTTP interface that an edge offers on behalf of engines: of a single one, or aggregated from several."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import httpx
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector
from pydantic import TypeAdapter
from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from tigas_common.errors import Overloaded, TigasError
from tigas_common.limits import ConcurrencyLimit
from tigas_common.origins import OriginPolicy
from tigas_common.parsing import MAX_BODY
from tigas_common.placement import merge_scene_infos, merge_scene_lists
from tigas_common.proxy import (
    client_key,
    forward,
    response_headers,
    run_until,
    send_error,
    stream_response,
    wait_for_disconnect,
)
from tigas_common.web import read_body
from tigas_common.wire.render import HostLoad, SceneInfo, Training
from tigas_render.pipe.engines import EnginePool
from tigas_render.pipe.remote_engine import RemoteEngine

MAX_REQUESTS, MAX_REQUESTS_PER_ADDRESS = 256, 128
"""Maximum number of requests to engines at a time, in total and per address. Each has a connection to an engine."""
MAX_CHANGES, MAX_CHANGES_PER_ADDRESS = 32, 8
"""Maximum number of concurrent changes of the models directory, which continue after their clients have left."""
BUSY = "Too many requests are waiting for the renderer; try again in a few seconds."
BUSY_RETRY_S = 2.0
UNAVAILABLE = "The renderer is starting; try again in a second."
RETRY_S = 1.0
SCENE_REFUSALS = (422, 503)
"""Statuses with which an engine refuses a scene although another may accept it."""

STATE_PRECEDENCE = ("running", "failed", "done", "idle")
"""States of a training in order of precedence, because only one engine knows the actual state."""
_SCENES = TypeAdapter(list[SceneInfo])

Bodies = Mapping[str, bytes]
"""The bodies of the engines' answers, by engine name."""
Merge = Callable[[Bodies], bytes]


class _EnginesApp(ABC):
    """An ASGI application that forwards requests with bodies of up to MAX_BODY bytes to engines."""

    def __init__(self, origins: OriginPolicy) -> None:
        """origins: the pages that may read the application's own answers."""
        self._origins = origins
        self._running = ConcurrencyLimit(MAX_REQUESTS, MAX_REQUESTS_PER_ADDRESS)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            with self._running.acquire(client_key(scope), Overloaded(BUSY, BUSY_RETRY_S)):
                body = await read_body(Request(scope, receive), MAX_BODY)
                answer = await run_until(wait_for_disconnect(receive), self.forward(scope, body))
                if answer is not None:
                    await stream_response(answer, response_headers(answer), receive, send)
        except TigasError as error:
            await send_error(error, self._origins, scope, receive, send)

    @abstractmethod
    async def forward(self, scope: Scope, body: bytes) -> httpx.Response:
        """Return the answer, which the caller must close. Raises Overloaded while there is no engine."""


class EngineProxy(_EnginesApp):
    """A proxy for one engine's application."""

    def __init__(self, path: Path, origins: OriginPolicy) -> None:
        super().__init__(origins)
        self._transport = httpx.AsyncHTTPTransport(
            uds=str(path), limits=httpx.Limits(max_connections=MAX_REQUESTS, keepalive_expiry=2.0)
        )

    async def close(self) -> None:
        await self._transport.aclose()

    async def forward(self, scope: Scope, body: bytes) -> httpx.Response:
        try:
            return await forward(self._transport, "http://engine/", scope, body)
        except httpx.TransportError as error:
            raise Overloaded(UNAVAILABLE, RETRY_S) from error


class EngineAggregator(_EnginesApp):
    """A proxy for several engines' applications, which returns one engine's answer or merges all answers."""

    def __init__(self, engines: EnginePool, proxies: Mapping[str, EngineProxy], origins: OriginPolicy) -> None:
        """proxies: by engine name."""
        super().__init__(origins)
        self._change_limit = ConcurrencyLimit(MAX_CHANGES, MAX_CHANGES_PER_ADDRESS)
        self._engines = engines
        self._proxies = proxies

    async def forward(self, scope: Scope, body: bytes) -> httpx.Response:
        match scope["method"], scope["path"].split("/")[1:]:
            case "GET", ["healthz"]:
                answers = list((await self._ask_all(scope, body)).values())
                healthy = next((each for each in answers if each.is_success), answers[0])
                return _replace_body(healthy, healthy.content)
            case "GET" | "HEAD", ["metrics"]:
                return await self._ask_and_merge(scope, body, lambda bodies: merge_metrics(bodies, self._engines.all))
            case "GET" | "HEAD", ["api", "load"]:
                return await self._ask_and_merge(scope, body, merge_load)
            case "GET" | "HEAD", ["scenes"]:
                return await self._ask_and_merge(scope, body, merge_scenes)
            case "GET" | "HEAD", ["scenes", _]:
                return await self._ask_and_merge(scope, body, merge_scene)
            case "GET" | "HEAD", ["scenes", _, "enhance"]:
                return await self._ask_and_merge(scope, body, merge_training)
            case "DELETE", ["scenes", _, "enhance"]:
                return await self._ask_and_merge(scope, body, merge_training, by_all=True)
            case "POST", ["scenes", _, "unload"]:
                return await self._ask_and_merge(scope, body, merge_scene, by_all=True)
            case ("DELETE" | "PATCH", ["scenes", _]) | ("POST", ["scenes", _, "rename"] | ["uploads", _, "scene"]):
                return await asyncio.shield(self._change(scope, body))  # continues if the client leaves
            case "POST", ["scenes", scene, "enhance"]:
                return await self._ask_in_order(await self._training_engines(scope, scene), scope, body)
            case _, ["scenes", scene, "load" | "preview"] | ["scenes", scene, "download", _]:
                return await self._ask_in_order(self._preferred_engines(scene), scope, body, refusals=SCENE_REFUSALS)
            case _:
                return await self._ask_in_order(self._reachable_engines(), scope, body)

    def _reachable_engines(self) -> Sequence[RemoteEngine]:
        """Return the engines that are up, or all if none seems to be, because one may just have started."""
        return self._engines.connected() or self._engines.all

    def _preferred_engines(self, scene: str) -> Sequence[RemoteEngine]:
        """Return the engines that are up, or all, with the scene's own engines first."""
        return self._engines.by_preference(scene) or self._engines.all

    async def _ask_in_order(
        self,
        engines: Sequence[RemoteEngine],
        scope: Scope,
        body: bytes,
        *,
        refusals: Sequence[int] = (),
        whole: bool = False,
    ) -> httpx.Response:
        """Return the first answer with a status not in `refusals`, or else the last. Raises Overloaded without any."""
        refused: httpx.Response | None = None
        for engine in engines:
            answer = await self._ask(engine, scope, body, whole=whole)
            if answer is None:
                continue
            if refused is not None:
                await refused.aclose()
            if answer.status_code not in refusals:
                return answer
            refused = answer
        if refused is None:
            raise Overloaded(UNAVAILABLE, RETRY_S)
        return refused

    async def _ask_all(self, scope: Scope, body: bytes) -> dict[str, httpx.Response]:
        """Return the engines' answers by name. Raises Overloaded if no engine answers."""
        engines = self._reachable_engines()
        answers = await asyncio.gather(*(self._ask(engine, scope, body, whole=True) for engine in engines))
        found = {engine.name: answer for engine, answer in zip(engines, answers, strict=True) if answer is not None}
        if not found:
            raise Overloaded(UNAVAILABLE, RETRY_S)
        return found

    async def _ask_and_merge(self, scope: Scope, body: bytes, merge: Merge, *, by_all: bool = False) -> httpx.Response:
        """Return the merged answer, or a refusal if all engines refuse. by_all: a single refusal is enough."""
        is_head = scope["method"] == "HEAD"  # answered with the headers of GET; the server omits the body
        answers = await self._ask_all({**scope, "method": "GET"} if is_head else scope, body)
        done = {name: answer for name, answer in answers.items() if answer.status_code == 200}
        refusals = [answer for answer in answers.values() if answer.status_code != 200]
        if refusals and (by_all or not done):
            return _replace_body(refusals[0], refusals[0].content)
        content = merge({name: answer.content for name, answer in done.items()})
        return _replace_body(next(iter(done.values())), content)

    async def _change(self, scope: Scope, body: bytes) -> httpx.Response:
        """Let one engine change the models directory, and then all engines scan it."""
        with self._change_limit.acquire(client_key(scope), Overloaded(BUSY, BUSY_RETRY_S)):
            answer = await self._ask_in_order(self._reachable_engines(), scope, body, whole=True)
            if answer.is_success:
                await self._ask_all({**scope, "method": "GET", "raw_path": b"/scenes", "query_string": b"scan=1"}, b"")
            return _replace_body(answer, answer.content)

    async def _training_engines(self, scope: Scope, scene: str) -> Sequence[RemoteEngine]:
        """Return the engine that is already training a scene's networks, or else the scene's engines."""
        engines = self._preferred_engines(scene)
        states = await self._ask_all({**scope, "method": "GET"}, b"")
        training = {name for name, each in states.items() if each.status_code == 200 and is_training(each.content)}
        return [engine for engine in engines if engine.name in training] or engines

    async def _ask(
        self, engine: RemoteEngine, scope: Scope, body: bytes, *, whole: bool = False
    ) -> httpx.Response | None:
        """Return an engine's answer, with its whole body if `whole`, or None if the engine is lost before answering."""
        if whole:
            scope = {**scope, "headers": [each for each in scope["headers"] if each[0] != b"accept-encoding"]}

        async def ask() -> httpx.Response:
            answer = await self._proxies[engine.name].forward(scope, body)
            if whole:
                await answer.aread()
                await answer.aclose()
            return answer

        try:
            return await (run_until(engine.pipe.closed, ask()) if engine.pipe.is_connected else ask())
        except (Overloaded, httpx.TransportError):
            return None


def _replace_body(answer: httpx.Response, content: bytes) -> httpx.Response:
    headers = [each for each in answer.headers.raw if each[0].lower() not in (b"content-length", b"transfer-encoding")]
    if answer.status_code != httpx.codes.NO_CONTENT:
        headers.append((b"content-length", str(len(content)).encode()))
    return httpx.Response(answer.status_code, headers=headers, stream=httpx.ByteStream(content))


def merge_scenes(bodies: Bodies) -> bytes:
    return _SCENES.dump_json(merge_scene_lists(_SCENES.validate_json(body) for body in bodies.values()))


def merge_scene(bodies: Bodies) -> bytes:
    return (
        merge_scene_infos([SceneInfo.model_validate_json(body) for body in bodies.values()]).model_dump_json().encode()
    )


def merge_training(bodies: Bodies) -> bytes:
    states = [Training.model_validate_json(body) for body in bodies.values()]
    return min(states, key=lambda each: STATE_PRECEDENCE.index(each.state)).model_dump_json().encode()


def is_training(body: bytes) -> bool:
    return Training.model_validate_json(body).state == "running"


def merge_load(bodies: Bodies) -> bytes:
    """Merge the load of a host, of which each engine knows all edges but only its own scenes."""
    loads = [HostLoad.model_validate_json(body) for body in bodies.values()]
    loaded = tuple(sorted({scene for each in loads for scene in each.scenes}))
    return loads[0].model_copy(update={"scenes": loaded}).model_dump_json().encode()


def merge_metrics(bodies: Bodies, engines: Sequence[RemoteEngine]) -> bytes:
    """Merge metrics in Prometheus' text format. Engines' metrics get a label `device`; edges' metrics appear once."""
    registry = CollectorRegistry()
    registry.register(_Metrics(bodies, engines))
    return generate_latest(registry)


class _Metrics(Collector):
    def __init__(self, bodies: Bodies, engines: Sequence[RemoteEngine]) -> None:
        self._bodies = bodies
        self._engines = engines

    def collect(self) -> Iterator[Metric]:
        families: dict[str, Metric] = {}
        for number, (engine, body) in enumerate(self._bodies.items()):
            for family in text_string_to_metric_families(body.decode()):
                together = families.setdefault(family.name, Metric(family.name, family.documentation, family.type))
                for sample in family.samples:
                    if "edge" not in sample.labels:
                        labels = {**sample.labels, "device": engine}
                        together.add_sample(sample.name, labels, sample.value, sample.timestamp, sample.exemplar)
                    elif number == 0:
                        together.samples.append(sample)
        yield from families.values()
        yield from self._devices()

    def _devices(self) -> Iterator[Metric]:
        up, shares, ages = (
            GaugeMetricFamily(f"tigas_render_device_{name}", documentation, labels=["device"])
            for name, documentation in (
                ("up", "Whether its engine is running"),
                ("utilisation_ratio", "Share of time at work, 0 to 1"),
                ("queue_age_seconds", "Longest wait of a client for its turn"),
            )
        )
        for engine in self._engines:
            up.add_metric([engine.name], engine.pipe.is_connected)
            if engine.pipe.is_connected:
                shares.add_metric([engine.name], engine.utilisation)
                ages.add_metric([engine.name], engine.age_s)
        yield from (up, shares, ages)
