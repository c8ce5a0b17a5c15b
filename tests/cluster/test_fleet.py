"""State of polled hosts."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable

import httpx
import pytest

from tests.cluster.hosts import load
from tigas_cluster import fleet as fleet_module
from tigas_cluster.fleet import Fleet, HostAddress

pytestmark = pytest.mark.anyio

A, B = HostAddress("a", "http://a.test:8080"), HostAddress("b", "http://b.test:8080", public_host="b.example")


class Hosts(httpx.AsyncBaseTransport):
    """Answer at once, unless they are silent, or refuse."""

    def __init__(self) -> None:
        self.viewers = 0
        self.silent: set[str] = set()
        self.refusing: set[str] = set()
        self.asked: list[httpx.Request] = []

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        self.asked.append(request)
        name = request.url.host.partition(".")[0]
        if name in self.silent:
            await asyncio.Event().wait()
        if name in self.refusing:
            raise httpx.ConnectError("refused")
        return httpx.Response(200, content=load(self.viewers).model_dump_json())


@pytest.fixture(autouse=True)
def hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same ten times as fast."""
    for name in ("POLL_S", "GONE_S", "ANSWER_S"):
        monkeypatch.setattr(fleet_module, name, getattr(fleet_module, name) / 10)


@pytest.fixture
def hosts() -> Hosts:
    return Hosts()


@pytest.fixture
async def fleet(hosts: Hosts) -> AsyncIterator[Fleet]:
    async with Fleet([A, B], asyncio.get_running_loop().time, hosts) as fleet:
        yield fleet


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(20):
        while not condition():  # noqa: ASYNC110 - hosts are asked, and say nothing by themselves
            await asyncio.sleep(0.005)


def names(fleet: Fleet) -> list[str]:
    return [host.name for host in fleet.hosts()]


async def test_knows_from_the_start_how_hosts_are_and_hears_what_changes(fleet: Fleet, hosts: Hosts) -> None:
    assert names(fleet) == ["a", "b"]
    hosts.viewers = 7
    await until(lambda: {host.viewers for host in fleet.hosts()} == {7})


async def test_a_host_is_asked_under_the_name_that_pages_use(fleet: Fleet, hosts: Hosts) -> None:
    assert {request.headers["host"] for request in hosts.asked} == {"a.test:8080", "b.example:8080"}
    assert {str(request.url) for request in hosts.asked} == {f"{each.api_url}/api/load" for each in (A, B)}
    assert [host.render_url for host in fleet.hosts()] == ["http://a.test:8080", "http://b.example:8080"]


async def test_a_silent_host_is_gone_until_it_answers(fleet: Fleet, hosts: Hosts) -> None:
    hosts.silent = {"a"}
    assert names(fleet) == ["a", "b"]
    await until(lambda: names(fleet) == ["b"])
    hosts.silent = set()
    await until(lambda: names(fleet) == ["a", "b"])


@pytest.mark.parametrize("how", ["silent", "refusing"])
async def test_a_suspected_host_that_does_not_answer_is_gone_at_once(
    fleet: Fleet, hosts: Hosts, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    monkeypatch.setattr(fleet_module, "GONE_S", 60.0)
    setattr(hosts, how, {"a"})
    await asyncio.gather(*(fleet.suspect("a") for _ in range(5)))
    assert names(fleet) == ["b"]


async def test_a_host_that_has_kept_its_director_waiting_already_is_gone_without_another_question(
    fleet: Fleet, hosts: Hosts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet_module, "ANSWER_S", 60.0)
    monkeypatch.setattr(fleet_module, "GONE_S", 60.0)
    hosts.silent = {"a"}
    hosts.asked.clear()
    await until(lambda: any(request.url.host == "a.test" for request in hosts.asked))
    await asyncio.sleep(fleet_module.SUSPECT_S)
    await fleet.suspect("a")
    assert names(fleet) == ["b"]
    assert sum(request.url.host == "a.test" for request in hosts.asked) == 1


async def test_a_host_that_has_just_failed_to_answer_is_gone_once_a_viewer_suspects_it(
    fleet: Fleet, hosts: Hosts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet_module, "GONE_S", 60.0)
    monkeypatch.setattr(fleet_module, "POLL_S", 60.0)  # with the next poll
    hosts.refusing = {"a"}
    hosts.asked.clear()
    await until(lambda: any(request.url.host == "a.test" for request in hosts.asked))
    await asyncio.sleep(0)
    hosts.asked.clear()
    await fleet.suspect("a")
    assert (names(fleet), hosts.asked) == (["b"], [])


async def test_those_who_suspect_a_host_together_ask_it_once(fleet: Fleet, hosts: Hosts) -> None:
    hosts.asked.clear()
    await asyncio.gather(*(fleet.suspect("a") for _ in range(50)), fleet.suspect("nobody"))
    assert len([request for request in hosts.asked if request.url.host == "a.test"]) <= 2, "one is the usual poll"
    assert names(fleet) == ["a", "b"]


async def test_answers_that_fail_make_no_host_gone_before_its_time(
    fleet: Fleet, hosts: Hosts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet_module, "GONE_S", 60.0)
    hosts.refusing = {"a"}
    hosts.asked.clear()
    await until(lambda: sum(request.url.host == "a.test" for request in hosts.asked) >= 3)
    assert names(fleet) == ["a", "b"]


async def test_hosts_come_and_go_and_what_is_known_of_the_others_stays(fleet: Fleet) -> None:
    fleet.follow([HostAddress("b", B.api_url, draining=True), HostAddress("c", "http://c.test:8080")])
    assert [(host.name, host.draining) for host in fleet.hosts()] == [("b", True)]
    await until(lambda: names(fleet) == ["b", "c"])


async def test_a_host_that_says_nonsense_is_none(hosts: Hosts) -> None:
    async def nonsense(request: httpx.Request) -> httpx.Response:
        return httpx.Response(200, content=b'{"viewers": "many"}')

    async with Fleet([A], asyncio.get_running_loop().time, httpx.MockTransport(nonsense)) as fleet:
        assert fleet.hosts() == []
