"""Requests proxied by the director to hosts, and scenes of all hosts as one list."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import httpx
import pytest

from tests.cluster.hosts import FakeFleet, FakeHosts, asking_director, host
from tests.eventually import eventually
from tests.render.fakes import render_request
from tests.scenes import scene
from tests.visitor import Visitor
from tigas_cluster import host_proxy
from tigas_cluster.host_proxy import MAX_WAITING_PER_ADDRESS, HostProxy, HostsBusy
from tigas_common.errors import SceneInUse, problem
from tigas_common.placement import rank_names

pytestmark = pytest.mark.anyio

FIRST, SECOND = rank_names("garden", ("a", "b"))
PAGE = "<!doctype html>"


class Hosts(FakeHosts):
    """Have a page and scenes, and answer anything else with their names."""

    def __init__(self) -> None:
        super().__init__()
        self.scenes = {
            "a": {"garden": "loaded", "pond": "unloaded", "wood": "loading"},
            "b": {"garden": "unloaded", "pond": "broken", "wood": "loaded", "new": "unloaded"},
        }
        self.used: set[str] = set()
        """Hosts with viewers of the scene to unload."""

    @property
    def targets(self) -> list[tuple[str, str]]:
        return [(request.url.host.partition(".")[0], request.url.raw_path.decode()) for request in self.asked]

    def answer(self, name: str, request: httpx.Request) -> httpx.Response:
        target = request.extensions.get("target", request.url.raw_path).decode()
        if target.startswith("/scenes?") or target == "/scenes":
            return httpx.Response(
                200, json=[scene(id=id, state=self.scenes[name][id]).model_dump() for id in self.scenes[name]]
            )
        if target.endswith("/unload"):
            if name in self.used:
                return httpx.Response(409, json=problem(SceneInUse("Somebody views it.")).model_dump())
            return httpx.Response(200, json=scene(state="unloaded").model_dump())
        headers = {
            "Content-Security-Policy": "default-src 'none'; connect-src 'self' https://a.test:*",
            "Content-Type": "text/html; charset=utf-8" if target == "/" else "text/plain",
            "ETag": '"1"',
        }
        body = httpx.ByteStream((PAGE if target == "/" else name).encode())
        return httpx.Response(404 if "nowhere" in target else 200, headers=headers, stream=body)


@pytest.fixture
def hosts() -> Hosts:
    return Hosts()


@pytest.fixture
def fleet() -> FakeFleet:
    return FakeFleet(host("a"), host("b"))


@pytest.fixture
async def client(fleet: FakeFleet, hosts: Hosts) -> AsyncIterator[httpx.AsyncClient]:
    async with asking_director(fleet, transport=hosts) as client:
        yield client


async def test_a_scene_is_asked_for_where_its_viewers_are_sent(client: httpx.AsyncClient, fleet: FakeFleet) -> None:
    assert (await client.get("/scenes/garden/preview")).text == FIRST
    assert (await client.post(f"/scenes/garden/load?host={SECOND}")).text == SECOND
    assert (await client.post("/scenes/garden/load?host=gone")).text == FIRST
    fleet.states = [host(name, draining=name == FIRST) for name in (FIRST, SECOND)]
    assert (await client.get("/scenes/garden/preview")).text == SECOND, "a draining host is asked last"


async def test_a_download_is_resumed_at_the_host_that_began_it(client: httpx.AsyncClient, hosts: Hosts) -> None:
    resumed = {"Range": "bytes=10-", "If-Range": '"1"'}
    answer = await client.get("/scenes/garden/download/compressed", headers=resumed)
    assert (answer.text, answer.headers["etag"]) == (FIRST, '"1"')
    assert {name: hosts.asked[-1].headers[name] for name in resumed} == resumed
    await client.head("/scenes/garden/download/compressed")
    assert hosts.asked[-1].method == "HEAD"
    assert (await client.get("/scenes/nowhere/preview")).status_code == 404, "the host's own answer"


async def test_frames_are_handed_on_only_for_those_who_ask_for_it(client: httpx.AsyncClient) -> None:
    body = render_request(scene="garden").model_dump(mode="json", exclude_none=True)
    assert (await client.post(f"/render?host={SECOND}", json=body)).text == SECOND
    assert (await client.post("/render", json=body)).status_code == 307
    assert (await client.get("/render?host=a")).status_code == 405


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


async def test_a_lost_host_is_not_waited_for(
    client: httpx.AsyncClient, hosts: Hosts, fleet: FakeFleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host_proxy, "CHECK_S", 0.01)
    hosts.silent = {FIRST}
    asking = asyncio.create_task(client.get("/scenes/garden/preview"))
    await eventually(lambda: hosts.asked)
    fleet.states = [state for state in fleet.states if state.name != FIRST]
    assert (await asyncio.wait_for(asking, 20)).text == SECOND


async def listed(client: httpx.AsyncClient, query: str = "") -> dict[str, str]:
    return {info["id"]: info["state"] for info in (await client.get(f"/scenes{query}")).json()}


async def test_a_scene_is_loaded_if_it_is_anywhere(client: httpx.AsyncClient, hosts: Hosts) -> None:
    loaded = {"garden": "loaded", "pond": "unloaded", "wood": "loaded", "new": "unloaded"}
    assert await listed(client) == loaded
    assert (await client.get("/scenes")).json()[0]["memory_bytes"] == 2, "of both hosts"
    hosts.asked.clear()
    assert await listed(client, "?scan=1") == loaded
    assert hosts.targets == [("a", "/scenes?scan=1"), ("b", "/scenes?scan=1")]


async def test_a_host_that_does_not_answer_is_left_out(
    client: httpx.AsyncClient, hosts: Hosts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host_proxy, "ANSWER_S", 0.5)
    hosts.silent = {"b"}
    assert await listed(client) == {"garden": "loaded", "pond": "unloaded", "wood": "loading"}
    hosts.silent = {"a", "b"}
    assert (await client.get("/scenes")).status_code == 503


async def test_a_scene_is_unloaded_everywhere(client: httpx.AsyncClient, hosts: Hosts, fleet: FakeFleet) -> None:
    fleet.states = [host("a", scenes=("gar den", "wood")), host("b", scenes=("gar den",))]
    assert (await client.post("/scenes/gar%20den/unload")).json()["state"] == "unloaded"
    assert (await client.post("/scenes/wood/unload")).status_code == 200
    assert hosts.targets == [
        ("a", "/scenes/gar%20den/unload"),
        ("b", "/scenes/gar%20den/unload"),
        ("a", "/scenes/wood/unload"),
    ]
    hosts.used = {"a"}
    answer = await client.post("/scenes/wood/unload")
    assert (answer.status_code, answer.json()["detail"]) == (409, "Somebody views it.")
    fleet.states = []
    assert (await client.post("/scenes/wood/unload")).status_code == 503


async def test_one_address_does_not_take_all_requests_and_one_that_leaves_frees_its_own(
    fleet: FakeFleet, hosts: Hosts
) -> None:
    hosts.silent = {"a", "b"}
    proxy = HostProxy(fleet, hosts)

    def ask(address: str) -> Visitor:
        return Visitor(proxy, "POST", "/scenes/garden/load", address)

    visitors = [ask("192.0.2.1") for _ in range(MAX_WAITING_PER_ADDRESS)]
    await eventually(lambda: len(hosts.asked) == MAX_WAITING_PER_ADDRESS)
    with pytest.raises(HostsBusy):
        await ask("192.0.2.1").asking
    visitors.append(ask("192.0.2.2"))
    await eventually(lambda: len(hosts.asked) == MAX_WAITING_PER_ADDRESS + 1)
    for visitor in visitors:
        visitor.left.set()
        await visitor.asking
        assert visitor.got == []
    hosts.silent = set()
    await proxy.close()
