"""The director's HTTP interface: it assigns each viewer to a host with its scene. Frames do not pass through it."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager

import httpx
from prometheus_client import CollectorRegistry, Counter
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from tigas_cluster.fleet import Fleet, HostState
from tigas_cluster.host_proxy import HostProxy, NoHost
from tigas_cluster.policy import HostChooser
from tigas_common.errors import InvalidRequest
from tigas_common.metrics import RequestMetrics, labelled_gauge, metrics_route, new_registry
from tigas_common.openapi import openapi
from tigas_common.origins import OriginCheck, OriginPolicy
from tigas_common.topology import resolve_service_url
from tigas_common.web import (
    EXCEPTION_HANDLERS,
    JSON,
    NO_STORE,
    PICTURES,
    ModelResponse,
    described,
    healthy,
    json_response,
    list_response,
    read_message,
)
from tigas_common.wire.render import RenderRequest, SceneInfo, ServerConfig

MAX_NAME = 256
"""Maximum length of the name of a scene or host in a query."""
HOST_GAUGES: Mapping[str, tuple[str, Callable[[HostState], float]]] = {
    "viewers": ("Viewers of a host", lambda host: host.viewers),
    "host_full": ("Whether it refuses new viewers", lambda host: host.retry_after_s is not None),
    "host_draining": ("Whether it is draining", lambda host: host.draining),
    "host_utilisation_ratio": ("Share of time at work, 0 to 1", lambda host: host.load.utilisation),
    "host_queue_age_seconds": ("Longest wait in the last second", lambda host: host.load.queue_age_s),
}
"""Prometheus gauges of each host, with their help text and value."""


@asynccontextmanager
async def create_director(
    fleet: Fleet,
    *,
    origins: OriginPolicy,
    clock: Callable[[], float],
    services: Mapping[str, str] | None = None,
    transport: httpx.AsyncBaseTransport | None = None,
) -> AsyncIterator[ASGIApp]:
    """The application for a fleet, which the caller opens and closes.

    clock: in seconds. services: base URLs for the page, by name; a bare `:PORT` means the page's own host. transport:
    replaces HTTP to the hosts in tests.
    """
    proxy = HostProxy(fleet, transport)
    registry = new_registry("director", _HostGauges(fleet))
    app = Starlette(
        routes=[
            openapi("Cluster director"),
            Route("/config.json", config),
            Route("/render", _Render(proxy), name="render", methods=["POST"]),
            Route("/scenes", scenes),
            Route("/scenes/{id}/unload", unload, methods=["POST"]),
            Route("/healthz", healthz),
            metrics_route(registry),
        ],
        exception_handlers=EXCEPTION_HANDLERS,
    )
    app.state.director = Director(fleet, clock, services or {}, registry)
    app.state.proxy = proxy
    app.router.default = proxy
    try:
        yield RequestMetrics(OriginCheck(app, origins), app.routes, registry)
    finally:
        await proxy.close()


class Director:
    def __init__(
        self, fleet: Fleet, clock: Callable[[], float], services: Mapping[str, str], registry: CollectorRegistry
    ) -> None:
        self.fleet = fleet
        self._choice = HostChooser(clock)
        self._services = services
        self._placements = Counter("tigas_director_placements", "Viewers sent to a host", ["host"], registry=registry)
        self._redirects = Counter(
            "tigas_director_redirects",
            "Viewers sent to another host: refused ones are `lost`, unanswered ones `silent`, others `moved`",
            ["why"],
            registry=registry,
        )
        for why in ("lost", "silent", "moved"):
            self._redirects.labels(why)

    async def place(
        self, scene: str, *, at: str | None = None, silent: str | None = None, lost: str | None = None
    ) -> HostState:
        """Choose the host for a viewer of this scene: its present one, unless it has to leave. Raises NoHost.

        at: its present host. silent: its present host, which does not answer. lost: a host that refused it.
        """
        if doubted := silent or lost:
            await self.fleet.poll_now(doubted)
        hosts = self.fleet.hosts()
        if silent is not None and any(host.name == silent and host.retry_after_s is None for host in hosts):
            at = silent
        chosen = self._choice.choose(scene, hosts, at=at, avoid=doubted)
        if chosen is None:
            raise NoHost
        left = at or doubted
        if chosen.name != left:
            self._placements.labels(chosen.name).inc()
            if left:
                self._redirects.labels("lost" if lost else "silent" if silent else "moved").inc()
        return chosen

    def config(self, host: HostState, page_host: str) -> ServerConfig:
        """The configuration of this host for a page opened under `page_host`."""
        return host.load.config.model_copy(
            update={
                "host": host.name,
                "render_url": host.render_url,
                "https_url": None,
                "services": {name: resolve_service_url(url, page_host) for name, url in self._services.items()},
                "dash_h3_url": None,  # each host has its own packager
                "max_upload_bytes": None,  # data stored by one host is missing on the others
            }
        )


class _HostGauges(Collector):
    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet

    def collect(self) -> Iterator[Metric]:
        hosts = self._fleet.hosts()
        yield GaugeMetricFamily("tigas_director_hosts", "Hosts that are up", len(hosts))
        for name, (meaning, value) in HOST_GAUGES.items():
            yield labelled_gauge(f"tigas_director_{name}", meaning, "host", {host.name: value(host) for host in hosts})


@described(
    query={
        "scene": "Which it shows.",
        "at": "Name of the present host, if it works.",
        "silent": "Name of the present host, if it does not answer.",
        "lost": "Name of a host that refused the viewer.",
    }
)
async def config(request: Request) -> ModelResponse[ServerConfig]:
    """The page's configuration, including the host of its scene."""
    director = _director(request)
    scene = _query_name(request, "scene") or ""
    host = await director.place(scene, **{why: _query_name(request, why) for why in ("at", "silent", "lost")})
    return json_response(director.config(host, request.url.hostname or "localhost"))


@described(
    query={"host": "Name of a host to which to forward the request."},
    takes=RenderRequest,
    gives=PICTURES,
    also={307: "Redirect to the scene's host."},
)
class _Render:
    """Renders one frame: redirects to the scene's host, for programs that only know this address.

    With `?host=` the request is proxied, for pages over HTTPS without WebTransport: browsers block them from HTTP
    hosts.
    """

    def __init__(self, proxy: HostProxy) -> None:
        self._proxy = proxy

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        request = Request(scope, receive)
        if request.query_params.get("host"):
            return await self._proxy(scope, receive, send)
        asked = await read_message(request, RenderRequest)
        host = await _director(request).place(asked.scene)
        return await RedirectResponse(f"{host.render_url}/render", 307)(scope, receive, send)


@described(query={"scan": "`1`: each host rescans its models directory first."})
async def scenes(request: Request) -> ModelResponse[list[SceneInfo]]:
    """The scenes of all hosts."""
    return list_response(await _proxy(request).scenes(scan=bool(request.query_params.get("scan"))))


@described(gives=SceneInfo)
async def unload(request: Request) -> Response:
    """Unload a scene without viewers, on every host."""
    answer = await _proxy(request).unload(request.path_params["id"])
    return Response(answer.content, answer.status_code, NO_STORE, answer.headers.get("content-type"))


@described(gives=(JSON,))
async def healthz(request: Request) -> Response:
    """Whether any host is up."""
    if not _director(request).fleet.hosts():
        raise NoHost
    return healthy()


def _query_name(request: Request, parameter: str) -> str | None:
    name = request.query_params.get(parameter)
    if name and len(name) > MAX_NAME:
        raise InvalidRequest(f"{parameter}: a name has at most {MAX_NAME} characters.")
    return name or None


def _director(request: Request) -> Director:
    director: Director = request.app.state.director
    return director


def _proxy(request: Request) -> HostProxy:
    proxy: HostProxy = request.app.state.proxy
    return proxy
