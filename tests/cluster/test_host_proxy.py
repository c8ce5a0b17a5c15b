"""Requests proxied by the director to hosts."""

from __future__ import annotations

import asyncio

import httpx
import pytest

from tests.cluster.hosts import FakeFleet, host
from tests.render.fakes import render_request
from tigas_cluster import host_proxy
from tigas_common.placement import ranked

pytestmark = pytest.mark.anyio

FIRST, SECOND = ranked("garden", ("a", "b"))
PAGE = "<!doctype html>"


class Hosts(httpx.AsyncBaseTransport):
    """Each answers with its name; dead ones refuse, and silent ones never answer."""

    def __init__(self) -> None:
        self.dead: set[str] = set()
        self.silent: set[str] = set()
        self.asked: list[httpx.Request] = []

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        self.asked.append(request)
        name = request.url.host.partition(".")[0]
        if name in self.dead:
            raise httpx.ConnectError("refused")
        if name in self.silent:
            await asyncio.Event().wait()
        target = request.extensions["target"]
        page = target == b"/"
        headers = {
            "Content-Security-Policy": "default-src 'none'; connect-src 'self' https://a.test:*",
            "Content-Type": "text/html; charset=utf-8" if page else "text/plain",
            "ETag": '"1"',
        }
        body = httpx.ByteStream((PAGE if page else name).encode())
        return httpx.Response(404 if b"nowhere" in target else 200, headers=headers, stream=body)


@pytest.fixture
def hosts() -> Hosts:
    return Hosts()


async def test_a_scene_is_asked_for_where_its_viewers_are_sent(client: httpx.AsyncClient) -> None:
    assert (await client.get("/scenes/garden/preview")).text == FIRST
    assert (await client.post(f"/scenes/garden/load?host={SECOND}")).text == SECOND
    assert (await client.post("/scenes/garden/load?host=gone")).text == FIRST


async def test_a_download_is_resumed_at_the_host_that_began_it(client: httpx.AsyncClient, hosts: Hosts) -> None:
    resumed = {"Range": "bytes=10-", "If-Range": '"1"'}
    answer = await client.get("/scenes/garden/download/compressed", headers=resumed)
    assert (answer.text, answer.headers["etag"]) == (FIRST, '"1"')
    assert {name: hosts.asked[-1].headers[name] for name in resumed} == resumed
    await client.head("/scenes/garden/download/compressed")
    assert hosts.asked[-1].method == "HEAD"


async def test_frames_are_handed_on_only_for_those_who_ask_for_it(client: httpx.AsyncClient) -> None:
    body = render_request(scene="garden").model_dump(mode="json", exclude_none=True)
    assert (await client.post(f"/render?host={SECOND}", json=body)).text == SECOND
    assert (await client.post("/render", json=body)).status_code == 307
    assert (await client.get("/render?host=a")).status_code == 405


async def test_answers_are_the_hosts_own(client: httpx.AsyncClient) -> None:
    answer = await client.get("/scenes/nowhere/preview")
    assert (answer.status_code, answer.headers["etag"]) == (404, '"1"')


async def test_the_page_may_speak_with_hosts_that_come_later(client: httpx.AsyncClient) -> None:
    answer = await client.get("/")
    assert answer.text == PAGE
    policy = dict(each.strip().split(" ", 1) for each in answer.headers["content-security-policy"].split(";"))
    assert policy["connect-src"] == "'self' http: https: ws: wss:"
    assert policy["default-src"] == "'self'"
    preview = await client.get("/scenes/garden/preview")
    assert preview.headers["content-security-policy"] == "default-src 'none'; frame-ancestors 'none'"


async def test_a_host_hears_who_asked_and_is_asked_under_its_own_name(client: httpx.AsyncClient, hosts: Hosts) -> None:
    page = {"Origin": "http://localhost:8080", "Sec-Fetch-Site": "same-origin", "X-Forwarded-For": "192.0.2.9"}
    assert (await client.post("/scenes/garden/load", headers=page)).status_code == 200
    [asked] = hosts.asked
    assert asked.headers["host"] == f"{FIRST}.test:8080"
    assert asked.headers["x-forwarded-for"] == "127.0.0.1"
    assert not {"origin", "sec-fetch-site"} & asked.headers.keys()


async def test_what_a_dead_host_does_not_answer_another_one_does(client: httpx.AsyncClient, hosts: Hosts) -> None:
    hosts.dead = {FIRST}
    assert (await client.get("/scenes/garden/preview")).text == SECOND
    hosts.dead = {FIRST, SECOND}
    assert (await client.get("/scenes/garden/preview")).status_code == 503


async def test_nobody_waits_for_a_host_that_is_gone(
    client: httpx.AsyncClient, hosts: Hosts, fleet: FakeFleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host_proxy, "LOOK_S", 0.01)
    hosts.silent = {FIRST}
    asking = asyncio.create_task(client.get("/scenes/garden/preview"))
    async with asyncio.timeout(20):
        while not hosts.asked:  # noqa: ASYNC110 - a request has no event
            await asyncio.sleep(0.005)
        fleet.states = [state for state in fleet.states if state.name != FIRST]
        assert (await asking).text == SECOND


async def test_a_draining_host_is_asked_last(client: httpx.AsyncClient, fleet: FakeFleet) -> None:
    fleet.states = [host(name, draining=name == FIRST) for name in (FIRST, SECOND)]
    assert (await client.get("/scenes/garden/preview")).text == SECOND
