"""Prometheus metrics at `/metrics`, in every service: its build, its process and its HTTP requests.

Services add their own collectors, which read their state on request, so that a frame costs an addition at most. Labels
are names known to the service, never text from a request.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import version
from typing import TypeVar

from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    ProcessCollector,
    disable_created_metrics,
    generate_latest,
)
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tigas_common.installation import this_commit
from tigas_common.web import NO_STORE, TEXT, described

METHODS = frozenset({"DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT"})
OTHER = "other"
"""Label for paths without a route, unusual methods, and scenes beyond the first MAX_SCENES."""
MAX_SCENES = 200
"""Maximum number of scenes with their own metrics: files may appear and disappear during a service's lifetime."""
Family = TypeVar("Family", CounterMetricFamily, GaugeMetricFamily)
RESPONSE_BUCKETS = (0.005, 0.02, 0.1, 0.5, 2, 10)
"""Histogram buckets of response times, in seconds."""

disable_created_metrics()  # type: ignore[no-untyped-call]  # Prometheus ignores these extra series


def new_registry(service: str, *collectors: Collector) -> CollectorRegistry:
    """A registry with these collectors and those for the service's build and process."""
    registry = CollectorRegistry()
    ProcessCollector(registry=registry)
    for collector in (_Build(service), *collectors):
        registry.register(collector)
    return registry


def metrics_route(registry: CollectorRegistry) -> Route:
    @described(gives=(TEXT,))
    async def metrics(request: Request) -> Response:
        """Metrics for Prometheus, in its text format."""
        return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST, headers=NO_STORE)

    return Route("/metrics", metrics)


def labelled_gauge(name: str, help: str, label: str, values: Mapping[str, float]) -> GaugeMetricFamily:
    """A gauge with one time series for each value of a label."""
    return _labelled(GaugeMetricFamily(name, help, labels=[label]), values)


def labelled_counter(name: str, help: str, label: str, values: Mapping[str, float]) -> CounterMetricFamily:
    return _labelled(CounterMetricFamily(name, help, labels=[label]), values)


def _labelled(family: Family, values: Mapping[str, float]) -> Family:
    for key, value in values.items():
        family.add_metric([key], value)
    return family


class SceneNames:
    """Scene names as labels, limited in number."""

    def __init__(self) -> None:
        self._known: set[str] = set()

    def label(self, scene: str) -> str:
        """The label of an existing scene."""
        if scene not in self._known:
            if len(self._known) >= MAX_SCENES:
                return OTHER
            self._known.add(scene)
        return scene


class RequestMetrics:
    """ASGI middleware around a whole application that counts HTTP requests by the route that answered them."""

    def __init__(
        self, app: ASGIApp, routes: Iterable[BaseRoute], registry: CollectorRegistry, besides: str | None = None
    ) -> None:
        """routes: the application's; besides: a path that is counted elsewhere."""
        self._app = app
        self._besides = besides
        self._paths: dict[object, str] = {
            route.endpoint: route.path_format for route in routes if isinstance(route, Route)
        }
        self._answered = Counter(
            "tigas_http_requests", "Answered HTTP requests", ["route", "method", "status"], registry=registry
        )
        self._in_flight = Gauge(
            "tigas_http_requests_in_flight", "HTTP requests with incomplete answers", registry=registry
        )
        self._seconds = Histogram(
            "tigas_http_response_seconds",
            "Time until an answer begins",
            ["route"],
            buckets=RESPONSE_BUCKETS,
            registry=registry,
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["path"] == self._besides:
            return await self._app(scope, receive, send)
        began = time.monotonic()

        async def counting(message: Message) -> None:
            if message["type"] == "http.response.start":
                route = self._paths.get(scope.get("endpoint"), OTHER)
                method = scope["method"] if scope["method"] in METHODS else OTHER
                self._answered.labels(route, method, str(message["status"])).inc()
                self._seconds.labels(route).observe(time.monotonic() - began)
            await send(message)

        with self._in_flight.track_inprogress():
            return await self._app(scope, receive, counting)


class _Build(Collector):
    def __init__(self, service: str) -> None:
        self._labels = {
            "service": service,
            "version": version("tigas"),
            "commit": this_commit() or "unknown",
            "python": platform.python_version(),
        }

    def collect(self) -> Iterator[Metric]:
        build = GaugeMetricFamily("tigas_build_info", "Always 1: the labels identify the build", labels=[*self._labels])
        build.add_metric([*self._labels.values()], 1)
        yield build
