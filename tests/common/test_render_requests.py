"""Requests of programs to a service or a cluster."""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace

import httpx
import pytest

from tests.cluster.hosts import FakeFleet, host
from tests.render.fakes import render_request
from tests.scenes import ALONE
from tigas_cluster.director import create_director
from tigas_common.origins import OriginPolicy
from tigas_common.placement import rank_names
from tigas_common.render_requests import HOST_RECHECK_S, HOST_REFRESH_S, RenderClient, SceneHosts, send_with_retries

pytestmark = pytest.mark.anyio

FIRST, SECOND = rank_names("garden", ("a", "b"))


class Cluster:
    """A director, and hosts that answer with their names, unless they are down or busy."""

    def __init__(self) -> None:
        self.fleet = FakeFleet(host("a"), host("b"))
        self.busy: set[str] = set()
        self.gone: set[str] = set()
        self.director_is_up = True
        self.asked: Counter[str] = Counter()
        self.now = 0.0

    async def __call__(self, request: httpx.Request) -> httpx.Response:
        name = request.url.host.partition(".")[0]
        self.asked[name] += 1
        if name in self.gone:
            raise httpx.ConnectError("Connection refused")
        if name in self.busy:
            return httpx.Response(503, text=name)
        return httpx.Response(200, text=name)

    @asynccontextmanager
    async def client(self) -> AsyncIterator[httpx.AsyncClient]:
        """Transport to the director and the hosts."""
        async with create_director(self.fleet, origins=OriginPolicy(), clock=lambda: self.now) as app:
            director = httpx.ASGITransport(app)

            async def at_director(request: httpx.Request) -> httpx.Response:
                self.asked["director"] += 1
                if not self.director_is_up:
                    raise httpx.ConnectError("Connection refused")
                return await director.handle_async_request(request)

            mounts = {"http://localhost": httpx.MockTransport(at_director)}
            hosts = httpx.MockTransport(self)
            async with httpx.AsyncClient(base_url="http://localhost", mounts=mounts, transport=hosts) as http:
                yield http

    async def frame(self, hosts: SceneHosts) -> str:
        return (await hosts.request("garden", "POST", "/render", content="", timeout_s=5)).text


@pytest.fixture
def cluster() -> Cluster:
    return Cluster()


@pytest.fixture
async def hosts(cluster: Cluster) -> AsyncIterator[SceneHosts]:
    async with cluster.client() as http:
        yield SceneHosts(http, lambda: cluster.now)


async def test_frames_come_from_the_scenes_host_and_the_director_is_asked_now_and_then(
    cluster: Cluster, hosts: SceneHosts
) -> None:
    assert [await cluster.frame(hosts) for _ in range(3)] == [FIRST] * 3
    assert cluster.asked == {"director": 1, FIRST: 3}
    cluster.now += HOST_REFRESH_S
    await cluster.frame(hosts)
    assert cluster.asked["director"] == 2


async def test_a_host_that_is_gone_costs_no_frame(cluster: Cluster, hosts: SceneHosts) -> None:
    assert await cluster.frame(hosts) == FIRST
    cluster.gone = {FIRST}
    assert [await cluster.frame(hosts) for _ in range(2)] == [SECOND] * 2
    assert cluster.asked[FIRST] == 2


async def test_a_host_that_drains_is_left(cluster: Cluster, hosts: SceneHosts) -> None:
    assert await cluster.frame(hosts) == FIRST
    cluster.fleet.states = [
        replace(each, address=replace(each.address, draining=each.name == FIRST)) for each in cluster.fleet.states
    ]
    cluster.now += HOST_REFRESH_S
    assert await cluster.frame(hosts) == SECOND


async def test_a_busy_host_is_left_only_when_it_is_full(cluster: Cluster, hosts: SceneHosts) -> None:
    await cluster.frame(hosts)
    cluster.busy = {FIRST}
    cluster.now += HOST_RECHECK_S
    assert [await cluster.frame(hosts) for _ in range(5)] == [FIRST] * 5
    assert cluster.asked["director"] == 2  # not for every frame
    cluster.fleet.states = [host(FIRST, full=2.0), host(SECOND)]
    cluster.now += HOST_RECHECK_S
    assert await cluster.frame(hosts) == SECOND


async def test_frames_go_on_while_the_director_is_away(cluster: Cluster, hosts: SceneHosts) -> None:
    await cluster.frame(hosts)
    cluster.director_is_up = False
    cluster.now += HOST_REFRESH_S
    assert [await cluster.frame(hosts) for _ in range(3)] == [FIRST] * 3
    cluster.gone = {FIRST}
    with pytest.raises(httpx.ConnectError):
        await cluster.frame(hosts)


async def test_a_service_that_is_alone_is_asked_for_all_of_it(cluster: Cluster) -> None:
    paths = []

    def answer(request: httpx.Request) -> httpx.Response:
        paths.append(request.url.path)
        return httpx.Response(200, content=ALONE.model_dump_json())

    async with httpx.AsyncClient(base_url="http://alone", transport=httpx.MockTransport(answer)) as http:
        hosts = SceneHosts(http, lambda: cluster.now)
        for _ in range(3):
            await cluster.frame(hosts)
            cluster.now += HOST_REFRESH_S
    assert paths == ["/config.json", "/render", "/render", "/render"]


async def test_a_client_follows_the_director(cluster: Cluster) -> None:
    request = render_request(scene="garden")
    async with cluster.client() as http:
        assert await RenderClient(http).frame(request) == FIRST.encode()


@pytest.fixture
def slept(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    pauses: list[float] = []

    async def sleep(seconds: float) -> None:
        pauses.append(seconds)

    monkeypatch.setattr("tigas_common.render_requests.asyncio.sleep", sleep)
    return pauses


def answering(*answers: httpx.Response) -> Callable[[], Awaitable[httpx.Response]]:
    left = iter(answers)

    async def ask() -> httpx.Response:
        return next(left)

    return ask


def busy(status: int = 503, **headers: str) -> httpx.Response:
    return httpx.Response(status, headers={name.replace("_", "-"): value for name, value in headers.items()})


async def test_it_waits_as_long_as_the_service_says_within_reason(slept: list[float]) -> None:
    ask = answering(busy(retry_after="3"), busy(429, retry_after="600"), busy(409), busy(retry_after="soon"), busy(200))
    assert (await send_with_retries(ask)).status_code == 200
    assert slept == [3, 10, 1, 1]


async def test_what_stays_busy_has_the_last_word(slept: list[float]) -> None:
    assert (await send_with_retries(answering(*[busy()] * 5))).status_code == 503
    assert len(slept) == 4


async def test_other_refusals_are_final(slept: list[float]) -> None:
    assert (await send_with_retries(answering(busy(404)))).status_code == 404
    assert slept == []
