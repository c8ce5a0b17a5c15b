"""Hosts are started, followed, drained and replaced, over a made-up Ray."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager

import httpx
import pytest

from tests.cluster.hosts import load
from tests.eventually import eventually
from tigas_cluster import fleet, ray_fleet
from tigas_cluster.fleet import Fleet
from tigas_cluster.host import Facts
from tigas_cluster.policy import Scaler
from tigas_cluster.ray_fleet import VERSION, Cluster, Node, RayFleet
from tigas_cluster.settings import HostRange
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
        self.said: list[str] = []
        """Messages for the operator."""
        self.looks = 0
        self.ahead = 0.0
        """Seconds by which the clock is."""

    def clock(self) -> float:
        return asyncio.get_running_loop().time() + self.ahead

    async def looked_at(self) -> None:
        """Wait until the present state has been seen."""
        since = self.looks
        await eventually(lambda: self.looks >= since + 3)

    def nodes(self) -> Sequence[Node]:
        self.looks += 1
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

    def request_hosts(self, number: int) -> None:
        self.asked_for.append(number)

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        node = request.url.host.partition(".")[0]
        if node not in self.up or node in self.silent:
            raise httpx.ConnectError("gone")
        full = 5.0 if node in self.full else None
        return httpx.Response(200, content=load(self.viewers.get(node, 0), full=full).model_dump_json())


@pytest.fixture(autouse=True)
def hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray_fleet, "POLL_S", 0.02)
    for name in ("POLL_S", "DOWN_AFTER_S", "POLL_TIMEOUT_S"):
        monkeypatch.setattr(fleet, name, getattr(fleet, name) / 10)


@pytest.fixture
def cluster() -> FakeCluster:
    return FakeCluster("red", "green", "blue")


@pytest.fixture
async def hosts(cluster: FakeCluster) -> AsyncIterator[RayFleet]:
    async with kept(cluster) as hosts:
        yield hosts


@asynccontextmanager
async def kept(cluster: FakeCluster, allowed: str = "2..3") -> AsyncIterator[RayFleet]:
    scaler = Scaler(HostRange.parse(allowed), 300, 600, cluster.clock)
    async with (
        Fleet((), asyncio.get_running_loop().time, cluster) as polled,
        RayFleet(cluster, scaler, polled, cluster.clock, cluster.said.append) as hosts,
    ):
        yield hosts


def up(hosts: RayFleet, *names: str) -> Callable[[], bool]:
    return lambda: sorted(host.name for host in hosts.fleet.hosts()) == sorted(names)


async def test_as_many_machines_become_hosts_as_are_wanted(hosts: RayFleet, cluster: FakeCluster) -> None:
    await hosts.ready
    await eventually(up(hosts, "host-1", "host-2"))
    assert set(cluster.running.values()) == {"red", "green"}
    assert {host.address.public_host for host in hosts.fleet.hosts()} == {"red.example", "green.example"}


async def test_hosts_that_run_already_are_found_again(cluster: FakeCluster) -> None:
    cluster.running = {"host-7": "blue", "host-1": "red"}
    async with kept(cluster) as hosts:
        await eventually(up(hosts, "host-1", "host-7"))
    assert cluster.running == {"host-7": "blue", "host-1": "red"}


async def test_hosts_outlive_the_fleet_unless_they_are_ended(hosts: RayFleet, cluster: FakeCluster) -> None:
    await eventually(up(hosts, "host-1", "host-2"))
    await hosts.__aexit__()
    assert len(cluster.running) == 2
    await hosts.stop()
    assert cluster.running == {}
    assert cluster.asked_for[-1] == 0


async def test_a_host_that_still_starts_is_ended_too(cluster: FakeCluster, monkeypatch: pytest.MonkeyPatch) -> None:
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
    async with kept(cluster, "1") as hosts:
        await eventually(starting.is_set)
        await hosts.stop()
    await asyncio.get_running_loop().shutdown_default_executor()
    assert cluster.running == {}
    assert cluster.asked_for[-1] == 0


async def test_a_host_whose_machine_is_gone_is_replaced_on_another(hosts: RayFleet, cluster: FakeCluster) -> None:
    await eventually(up(hosts, "host-1", "host-2"))
    cluster.up.remove("red")
    await eventually(
        lambda: {host.address.public_host for host in hosts.fleet.hosts()} == {"green.example", "blue.example"}
    )
    await eventually(lambda: set(cluster.running.values()) == {"green", "blue"})


async def test_machines_are_asked_for_that_are_not_there(cluster: FakeCluster) -> None:
    cluster.up = ["red"]
    async with kept(cluster, "3") as hosts:
        await eventually(up(hosts, "host-1"))
        assert cluster.asked_for == [3]
        await eventually(lambda: len(cluster.said) == 3)
        assert cluster.said == [
            "There is no machine for 2 more hosts yet.",
            "host-1 starts on red.test.",
            "host-1: 1 scene ready on instant.",
        ]
        cluster.up += ["green", "blue"]
        await eventually(up(hosts, "host-1", "host-2", "host-3"))


async def test_a_host_comes_and_goes_with_demand(hosts: RayFleet, cluster: FakeCluster) -> None:
    cluster.full, cluster.viewers = {"red", "green"}, {"red": 70, "green": 70}
    await eventually(up(hosts, "host-1", "host-2"))
    await cluster.looked_at()
    cluster.ahead += 10
    await eventually(up(hosts, "host-1", "host-2", "host-3"))
    assert cluster.asked_for[-1] == 3
    cluster.full, cluster.viewers = set(), {"red": 10, "green": 2, "blue": 5}
    await eventually(lambda: sorted(host.viewers for host in hosts.fleet.hosts()) == [2, 5, 10])
    await cluster.looked_at()
    cluster.ahead += 301
    await eventually(lambda: [host.viewers for host in hosts.fleet.hosts() if host.draining] == [2])
    assert len(cluster.running) == 3
    cluster.viewers["green"] = 0
    await eventually(lambda: any(host.viewers == 0 for host in hosts.fleet.hosts()))
    cluster.ahead += 10
    await eventually(lambda: len(hosts.fleet.hosts()) == 2)
    assert "green" not in cluster.running.values()
    assert [line.partition(" ")[2] for line in cluster.said[-2:]] == [
        "is draining: it gets no new viewers.",
        "exited.",
    ]


async def test_a_host_with_another_version_is_named_and_not_used(cluster: FakeCluster) -> None:
    cluster.version = "0.0.1"
    async with kept(cluster) as hosts:
        with pytest.raises(StartError, match="install the same version everywhere"):
            await hosts.ready
        assert hosts.fleet.hosts() == []
    assert len([line for line in cluster.said if line.startswith("host-1: It has TIGAS 0.0.1")]) == 1


@pytest.mark.parametrize("how", ["failure", "refusal"])
async def test_the_cluster_does_not_begin_where_no_host_can(cluster: FakeCluster, how: str) -> None:
    setattr(cluster, how, "The models directory /nowhere does not exist.")
    async with kept(cluster) as hosts:
        with pytest.raises(StartError, match="/nowhere does not exist"):
            await hosts.ready


async def test_a_host_that_stays_silent_is_replaced(hosts: RayFleet, cluster: FakeCluster) -> None:
    await eventually(up(hosts, "host-1", "host-2"))
    cluster.silent = {"red"}
    await eventually(lambda: "host-1 does not answer." in cluster.said)
    assert up(hosts, "host-2")()
    assert len(cluster.running) == 2
    cluster.ahead += 61
    await eventually(up(hosts, "host-2", "host-3"))
    cluster.silent = set()
    await eventually(up(hosts, "host-1", "host-2", "host-3"))
