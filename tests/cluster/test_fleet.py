"""State of polled hosts."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable

import httpx
import pytest

from tests.cluster.hosts import FakeHosts, load
from tests.eventually import eventually
from tigas_cluster import fleet as module
from tigas_cluster.fleet import Fleet, HostAddress

pytestmark = pytest.mark.anyio

A, B = HostAddress("a", "http://a.test:8080"), HostAddress("b", "http://b.test:8080", public_host="b.example")


class Hosts(FakeHosts):
    viewers = 0

    def answer(self, name: str, request: httpx.Request) -> httpx.Response:
        return httpx.Response(200, content=load(self.viewers).model_dump_json())


@pytest.fixture(autouse=True)
def hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("POLL_S", "DOWN_AFTER_S", "POLL_TIMEOUT_S"):
        monkeypatch.setattr(module, name, getattr(module, name) / 10)


@pytest.fixture
def hosts() -> Hosts:
    return Hosts()


@pytest.fixture
async def fleet(hosts: Hosts) -> AsyncIterator[Fleet]:
    async with Fleet([A, B], asyncio.get_running_loop().time, hosts) as fleet:
        yield fleet


def up(fleet: Fleet, *names: str) -> Callable[[], bool]:
    return lambda: [host.name for host in fleet.hosts()] == list(names)


async def test_knows_from_the_start_how_hosts_are_and_hears_what_changes(fleet: Fleet, hosts: Hosts) -> None:
    assert up(fleet, "a", "b")()
    assert {request.headers["host"] for request in hosts.asked} == {"a.test:8080", "b.example:8080"}
    assert {str(request.url) for request in hosts.asked} == {f"{each.api_url}/api/load" for each in (A, B)}
    assert [host.render_url for host in fleet.hosts()] == ["http://a.test:8080", "http://b.example:8080"]
    hosts.viewers = 7
    await eventually(lambda: {host.viewers for host in fleet.hosts()} == {7})


async def test_a_silent_host_is_gone_until_it_answers(fleet: Fleet, hosts: Hosts) -> None:
    hosts.silent = {"a"}
    assert up(fleet, "a", "b")()
    await eventually(up(fleet, "b"))
    hosts.silent = set()
    await eventually(up(fleet, "a", "b"))


@pytest.mark.parametrize("how", ["silent", "dead"])
async def test_a_suspected_host_that_does_not_answer_is_gone_at_once(
    fleet: Fleet, hosts: Hosts, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    monkeypatch.setattr(module, "DOWN_AFTER_S", 60.0)
    setattr(hosts, how, {"a"})
    await asyncio.gather(*(fleet.poll_now("a") for _ in range(5)))
    assert up(fleet, "b")()


async def test_a_suspect_with_a_late_answer_is_gone(
    fleet: Fleet, hosts: Hosts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "POLL_TIMEOUT_S", 60.0)
    monkeypatch.setattr(module, "SUSPECT_S", 0.0)
    hosts.silent = {"a"}
    hosts.asked.clear()
    await eventually(lambda: hosts.count("a"))
    await fleet.poll_now("a")
    assert up(fleet, "b")()
    assert hosts.count("a") == 1


async def test_a_suspect_that_has_just_failed_is_gone(
    fleet: Fleet, hosts: Hosts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "DOWN_AFTER_S", 60.0)
    hosts.dead = {"a"}
    hosts.asked.clear()
    await eventually(lambda: hosts.count("a") >= 3)
    assert up(fleet, "a", "b")(), "not before its time"
    monkeypatch.setattr(module, "POLL_S", 60.0)  # with the next poll
    hosts.asked.clear()
    await eventually(lambda: hosts.count("a"))
    await asyncio.sleep(0)
    hosts.asked.clear()
    await fleet.poll_now("a")
    assert up(fleet, "b")()
    assert hosts.count("a") == 0


async def test_those_who_suspect_a_host_together_ask_it_once(fleet: Fleet, hosts: Hosts) -> None:
    hosts.asked.clear()
    await asyncio.gather(*(fleet.poll_now("a") for _ in range(50)), fleet.poll_now("nobody"))
    assert hosts.count("a") <= 2, "one is the usual poll"
    assert up(fleet, "a", "b")()


async def test_hosts_come_and_go_and_what_is_known_of_the_others_stays(fleet: Fleet) -> None:
    fleet.set_hosts([HostAddress("b", B.api_url, draining=True), HostAddress("c", "http://c.test:8080")])
    assert [(host.name, host.draining) for host in fleet.hosts()] == [("b", True)]
    await eventually(up(fleet, "b", "c"))


async def test_a_host_that_says_nonsense_is_none() -> None:
    nonsense = httpx.MockTransport(lambda request: httpx.Response(200, content=b'{"viewers": "many"}'))
    async with Fleet([A], asyncio.get_running_loop().time, nonsense) as fleet:
        assert fleet.hosts() == []
