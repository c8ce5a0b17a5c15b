"""Hosts are started, followed, drained and replaced, over a made-up Ray."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable, Mapping, Sequence

import httpx
import pytest

from tests.cluster.hosts import load
from tigas_cluster import polled_fleet, ray_fleet
from tigas_cluster.host import Facts
from tigas_cluster.polled_fleet import PolledFleet
from tigas_cluster.ray_fleet import VERSION, Cluster, Node, RayFleet
from tigas_cluster.scaling import HostRange, Scaler
from tigas_common.errors import StartError

pytestmark = pytest.mark.anyio


class FakeCluster(Cluster, httpx.AsyncBaseTransport):
    """Machines that become hosts at once, and answer for them."""

    def __init__(self, *nodes: str) -> None:
        self.up = list(nodes)
        self.running: dict[str, str] = {}
        self.viewers: dict[str, int] = {}
        self.full: set[str] = set()
        self.silent: set[str] = set()
        self.failure: str | None = None
        self.refusal: str | None = None
        self.version = VERSION
        self.asked_for: list[int] = []

    def nodes(self) -> Sequence[Node]:
        return [Node("head", "head.test", 0, 0), *(Node(name, f"{name}.test", 1, 1) for name in self.up)]

    def hosts(self) -> Mapping[str, str]:
        return dict(self.running)

    def facts(self, hosts: Mapping[str, str]) -> Mapping[str, Facts]:
        return {
            name: Facts(
                version=self.version,
                address=f"{node}.test",
                viewer_address=f"{node}.example",
                since=0.0,
                url=None if self.failure else f"http://{node}.test:8080",
                said=["1 scene ready on instant."],
                failure=self.failure,
            )
            for name, node in hosts.items()
            if node in self.up
        }

    def start(self, name: str, node: Node) -> None:
        if self.refusal:
            raise StartError(self.refusal)
        assert node.id in self.up
        assert node.id not in self.running.values()
        self.running[name] = node.id

    def stop(self, hosts: Mapping[str, str]) -> None:
        for name in hosts:
            del self.running[name]

    def ask_for(self, number: int) -> None:
        self.asked_for.append(number)

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        node = request.url.host.partition(".")[0]
        if node not in self.up or node in self.silent:
            raise httpx.ConnectError("gone")
        full = 5.0 if node in self.full else None
        return httpx.Response(200, content=load(self.viewers.get(node, 0), full=full).model_dump_json())


@pytest.fixture(autouse=True)
def hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same ten times as fast."""
    monkeypatch.setattr(ray_fleet, "LOOK_S", 0.02)
    for name in ("POLL_S", "GONE_S", "ANSWER_S"):
        monkeypatch.setattr(polled_fleet, name, getattr(polled_fleet, name) / 10)


@pytest.fixture
def cluster() -> FakeCluster:
    return FakeCluster("red", "green", "blue")


class Clock:
    """Seconds, of which the test adds some."""

    def __init__(self) -> None:
        self.ahead = 0.0

    def __call__(self) -> float:
        return asyncio.get_running_loop().time() + self.ahead


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
async def fleet(cluster: FakeCluster, clock: Clock, said: list[str]) -> AsyncIterator[RayFleet]:
    async with looked_after(cluster, clock, said) as fleet:
        yield fleet


def looked_after(cluster: FakeCluster, clock: Clock, said: list[str], allowed: str = "2..3") -> RayFleet:
    scaler = Scaler(HostRange.parse(allowed), 300, 600, clock)
    polled = PolledFleet((), asyncio.get_running_loop().time, cluster)
    return RayFleet(cluster, scaler, polled, clock, said.append)


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(20):
        while not condition():  # noqa: ASYNC110 - Ray is asked, and says nothing by itself
            await asyncio.sleep(0.005)


def names(fleet: RayFleet) -> list[str]:
    return sorted(host.name for host in fleet.hosts())


async def test_as_many_machines_become_hosts_as_are_wanted(fleet: RayFleet, cluster: FakeCluster) -> None:
    await fleet.began
    await until(lambda: names(fleet) == ["host-1", "host-2"])
    assert set(cluster.running.values()) == {"red", "green"}
    assert {host.address.public_host for host in fleet.hosts()} == {"red.example", "green.example"}


async def test_hosts_that_run_already_are_found_again(cluster: FakeCluster, clock: Clock, said: list[str]) -> None:
    cluster.running = {"host-7": "blue", "host-1": "red"}
    async with looked_after(cluster, clock, said) as fleet:
        await until(lambda: names(fleet) == ["host-1", "host-7"])
    assert cluster.running == {"host-7": "blue", "host-1": "red"}


async def test_hosts_outlive_the_fleet_unless_they_are_ended(fleet: RayFleet, cluster: FakeCluster) -> None:
    await until(lambda: len(names(fleet)) == 2)
    await fleet.__aexit__()
    assert len(cluster.running) == 2
    await fleet.end()
    assert cluster.running == {}
    assert cluster.asked_for[-1] == 0


async def test_a_host_that_is_created_while_the_others_end_is_ended_too(
    cluster: FakeCluster, clock: Clock, said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    starting, stopping = threading.Event(), threading.Event()
    start, stop = cluster.start, cluster.stop

    def start_late(name: str, node: Node) -> None:
        starting.set()
        assert stopping.wait(20)
        start(name, node)

    def stop_early(hosts: Mapping[str, str]) -> None:
        stop(hosts)
        stopping.set()

    monkeypatch.setattr(cluster, "start", start_late)
    monkeypatch.setattr(cluster, "stop", stop_early)
    async with looked_after(cluster, clock, said, "1") as fleet:
        await until(starting.is_set)
        await fleet.end()
    await asyncio.get_running_loop().shutdown_default_executor()
    assert cluster.running == {}
    assert cluster.asked_for[-1] == 0


async def test_a_host_whose_machine_is_gone_is_replaced_on_another(fleet: RayFleet, cluster: FakeCluster) -> None:
    await until(lambda: len(names(fleet)) == 2)
    cluster.up.remove("red")
    await until(lambda: {host.address.public_host for host in fleet.hosts()} == {"green.example", "blue.example"})
    await until(lambda: set(cluster.running.values()) == {"green", "blue"})


async def test_machines_are_asked_for_that_are_not_there(cluster: FakeCluster, clock: Clock, said: list[str]) -> None:
    cluster.up = ["red"]
    async with looked_after(cluster, clock, said, "3") as fleet:
        await until(lambda: names(fleet) == ["host-1"])
        assert cluster.asked_for == [3]
        await until(lambda: len(said) == 3)
        assert said[:2] == ["There is no machine for 2 more hosts yet.", "host-1 starts on red.test."]
        assert said[2] == "host-1: 1 scene ready on instant."
        cluster.up += ["green", "blue"]
        await until(lambda: names(fleet) == ["host-1", "host-2", "host-3"])


async def test_another_host_comes_when_all_are_full(fleet: RayFleet, cluster: FakeCluster, clock: Clock) -> None:
    cluster.full, cluster.viewers = {"red", "green"}, {"red": 70, "green": 70}
    await until(lambda: len(names(fleet)) == 2)
    clock.ahead += 10
    await until(lambda: len(names(fleet)) == 3)
    assert cluster.asked_for[-1] == 3


async def test_a_host_that_nobody_needs_drains_and_then_ends(
    fleet: RayFleet, cluster: FakeCluster, clock: Clock, said: list[str]
) -> None:
    cluster.full, cluster.viewers = {"red", "green"}, {"red": 70, "green": 70}
    await until(lambda: len(names(fleet)) == 2)
    clock.ahead += 10
    await until(lambda: len(names(fleet)) == 3)
    cluster.full, cluster.viewers = set(), {"red": 10, "green": 2, "blue": 5}
    await until(lambda: sorted(host.viewers for host in fleet.hosts()) == [2, 5, 10])
    await asyncio.sleep(0.1)
    clock.ahead += 301
    await until(lambda: [host.viewers for host in fleet.hosts() if host.draining] == [2])
    assert len(cluster.running) == 3
    cluster.viewers["green"] = 0
    await until(lambda: any(host.viewers == 0 for host in fleet.hosts()))
    clock.ahead += 10
    await until(lambda: len(names(fleet)) == 2)
    assert "green" not in cluster.running.values()
    assert [line.partition(" ")[2] for line in said[-2:]] == ["drains: it gets no new viewers.", "has ended."]


async def test_a_host_with_another_version_is_named_and_not_used(
    cluster: FakeCluster, clock: Clock, said: list[str]
) -> None:
    cluster.version = "0.0.1"
    async with looked_after(cluster, clock, said) as fleet:
        with pytest.raises(StartError, match="install the same on every machine"):
            await fleet.began
        assert names(fleet) == []
    assert len([line for line in said if line.startswith("host-1: It has TIGAS 0.0.1")]) == 1


@pytest.mark.parametrize("how", ["failure", "refusal"])
async def test_the_cluster_does_not_begin_where_no_host_can(
    cluster: FakeCluster, clock: Clock, said: list[str], how: str
) -> None:
    setattr(cluster, how, "The models directory /nowhere does not exist.")
    async with looked_after(cluster, clock, said) as fleet:
        with pytest.raises(StartError, match="/nowhere does not exist"):
            await fleet.began


async def test_a_host_that_stays_silent_is_replaced(fleet: RayFleet, cluster: FakeCluster, clock: Clock) -> None:
    await until(lambda: len(names(fleet)) == 2)
    cluster.silent = {"red"}
    await until(lambda: names(fleet) == ["host-2"])
    assert len(cluster.running) == 2
    await asyncio.sleep(0.1)
    clock.ahead += 61
    await until(lambda: names(fleet) == ["host-2", "host-3"])
    cluster.silent = set()
    await until(lambda: len(names(fleet)) == 3)
