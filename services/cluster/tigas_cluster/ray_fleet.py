"""The hosts of a Ray cluster: as many as wanted, on the machines that may be hosts."""

from __future__ import annotations

import asyncio
import itertools
import logging
import math
from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any, Protocol, Self

from tigas_cluster.fleet import Fleet, HostAddress
from tigas_cluster.host import Facts
from tigas_cluster.policy import Scaler
from tigas_common.errors import StartError

POLL_S, FAILURE_PAUSE_S = 0.5, 5.0
"""Interval in seconds at which Ray is asked for hosts and machines, and the interval after a failure."""
REPLACE_AFTER_S = 60.0
"""Seconds without an answer after which a host is replaced if another machine is free."""
RETRY_S = 10.0
"""Seconds until a machine that failed to become a host is tried again."""
VERSION = version("tigas")

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Node:
    """A machine of the cluster."""

    id: str
    address: str
    amount: float
    """Amount of the host resource; 0 if it cannot be a host."""
    gpus: float


class Cluster(Protocol):
    """The required operations of Ray. Every call blocks."""

    def nodes(self) -> Sequence[Node]:
        """The machines that are up."""

    def hosts(self) -> Mapping[str, str]:
        """All hosts by name, with the ids of their machines, whether they are serving or not."""

    def facts(self, hosts: Mapping[str, str]) -> Mapping[str, Facts]:
        """Facts reported by these hosts, without those that do not answer."""

    def start(self, name: str, node: Node) -> None:
        """Make a machine a host. Raises StartError."""

    def stop(self, hosts: Mapping[str, str]) -> None:
        """End these hosts."""

    def request_hosts(self, number: int) -> None:
        """Request this number of possible hosts from an autoscaler."""


class RayFleet:
    """An async context manager that manages the hosts, which outlive it."""

    def __init__(
        self,
        cluster: Cluster,
        scaler: Scaler,
        fleet: Fleet,
        clock: Callable[[], float],
        say: Callable[[str], None],
    ) -> None:
        """fleet: gets the hosts' addresses; clock: in seconds; say: prints a message for the operator."""
        self._cluster = cluster
        self._scaler = scaler
        self._clock = clock
        self._say = say
        self.fleet = fleet
        self._facts: dict[str, Facts] = {}
        self._draining: frozenset[str] = frozenset()
        self._up: frozenset[str] = frozenset()
        """Hosts that answered the last time."""
        self._silent_since: dict[str, float] = {}
        """Time since when each other host has been silent."""
        self._failures: dict[str, str] = {}
        """Last reported reasons of hosts and machines that are not serving."""
        self._starting: dict[str, str] = {}
        """Hosts that are being started, with the ids of their machines."""
        self._stopping: set[str] = set()
        self._attempted_at: dict[str, float] = {}
        """Time of the last attempt to make each machine a host."""
        self._requested = 0
        self._missing = 0
        """Number of additional hosts that would run if there were machines for them."""
        self._tasks: set[asyncio.Task[None]] = set()
        self._starts: set[asyncio.Task[None]] = set()
        """Starts of hosts, which cannot be cancelled because they run in threads."""
        self.ready: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Done once a host is serving; has a StartError if none can."""

    async def __aenter__(self) -> Self:
        self._spawn(self._keep_polling(), self._tasks)
        return self

    async def __aexit__(self, *_: object) -> None:
        self._stop_polling()

    async def stop(self) -> None:
        """End all hosts, including those that are still starting."""
        self._stop_polling()
        starts = tuple(self._starts)
        await asyncio.to_thread(self._stop_all)
        if starts:  # a host may have been created after the others were listed
            await asyncio.gather(*starts, return_exceptions=True)
            await asyncio.to_thread(self._stop_all)
        await asyncio.to_thread(self._cluster.request_hosts, 0)

    def _stop_all(self) -> None:
        self._cluster.stop(self._cluster.hosts())

    async def _keep_polling(self) -> None:
        while True:
            try:
                await self._poll()
                await asyncio.sleep(POLL_S)
            except Exception:  # Ray's calls fail in many ways while a machine disappears; the next one may succeed
                logger.exception("Ray did not answer")
                await asyncio.sleep(FAILURE_PAUSE_S)

    async def _poll(self) -> None:
        """Read the cluster's state and act on it."""
        ending = frozenset(self._stopping)  # some may have ended by the time their machines have answered
        nodes, found = await asyncio.to_thread(lambda: (self._cluster.nodes(), self._cluster.hosts()))
        hosts = {**self._starting, **found}
        alive = {node.id for node in nodes}
        present = {name: node for name, node in hosts.items() if node in alive}
        facts = await asyncio.to_thread(self._cluster.facts, present)
        self._facts = {name: each for name, each in {**self._facts, **facts}.items() if name in present}
        self._update_fleet()
        self._report_changes()
        serving = self._update_silent(present) - ending
        plan = self._scaler.plan(self.fleet.hosts(), len(serving - self._up))
        if plan.draining != self._draining:
            for name in sorted(plan.draining - self._draining):
                self._say(f"{name} is draining: it gets no new viewers.")
            self._draining = plan.draining
            self._update_fleet()
        for name in (hosts.keys() - present.keys() | plan.ending) - self._stopping:
            self._spawn(self._stop_host(name, hosts[name]), self._tasks)
        free = [node for node in nodes if node.amount and node.id not in hosts.values()]
        self._start_hosts(plan.wanted - len(serving - self._draining), free, hosts)
        if (machines := plan.wanted + len(self._draining)) != self._requested:
            await asyncio.to_thread(self._cluster.request_hosts, machines)
            self._requested = machines
        if not self.ready.done():
            self._resolve_ready(present)

    def _update_fleet(self) -> None:
        self.fleet.set_hosts(
            HostAddress(name, facts["url"], facts["viewer_address"], name in self._draining)
            for name, facts in self._facts.items()
            if facts["url"] is not None and facts["version"] == VERSION
        )

    def _report_changes(self) -> None:
        up = frozenset(host.name for host in self.fleet.hosts())
        for name in sorted(up - self._up):
            self._say("\n".join(f"{name}: {line}" for line in self._facts[name]["said"]) or f"{name} serves again.")
        for name in sorted(self._up - up):
            self._say(f"{name} does not answer.")
        self._up = up
        for name, facts in self._facts.items():
            self._report_failure(name, _failure(facts))

    def _report_missing(self, number: int) -> None:
        """Report once that there are too few machines."""
        if number > max(0, self._missing):
            self._say(f"There is no machine for {number} more {'host' if number == 1 else 'hosts'} yet.")
        self._missing = number

    def _report_failure(self, name: str, why: str | None) -> None:
        """Report once why a host is not serving."""
        if why is None:
            self._failures.pop(name, None)
        elif self._failures.get(name) != why:
            self._failures[name] = why
            self._say(f"{name}: {why}")

    def _update_silent(self, present: Mapping[str, str]) -> frozenset[str]:
        """Record silent hosts; returns the hosts that are serving, or may be expected to soon."""
        now = self._clock()
        silent = present.keys() - self._up
        self._silent_since = {name: self._silent_since.get(name, now) for name in silent}
        given_up = {name for name, since in self._silent_since.items() if now >= since + REPLACE_AFTER_S}
        return frozenset(present.keys() - given_up - self._stopping)

    def _resolve_ready(self, present: Mapping[str, str]) -> None:
        if self._up:
            self.ready.set_result(None)
        elif self._failures and not self._starting and present.keys() <= self._failures.keys():
            self.ready.set_exception(StartError(next(iter(self._failures.values()))))

    def _start_hosts(self, number: int, free: Sequence[Node], hosts: Mapping[str, str]) -> None:
        """Start up to this number of hosts on free machines."""
        self._report_missing(number - len(free))
        now = self._clock()
        names = (name for each in itertools.count(1) if (name := f"host-{each}") not in hosts)
        ready = (node for node in free if now >= self._attempted_at.get(node.id, -math.inf) + RETRY_S)
        for node in itertools.islice(ready, max(0, number)):
            self._attempted_at[node.id] = now
            self._spawn(self._start_host(next(names), node), self._starts)

    async def _start_host(self, name: str, node: Node) -> None:
        self._starting[name] = node.id
        self._say(f"{name} starts on {node.address}.")
        try:
            await asyncio.to_thread(self._cluster.start, name, node)
        except StartError as error:
            self._report_failure(name, str(error))
        else:
            self._report_failure(name, None)
        finally:
            del self._starting[name]

    async def _stop_host(self, name: str, node: str) -> None:
        self._stopping.add(name)
        try:
            await asyncio.to_thread(self._cluster.stop, {name: node})
            self._facts.pop(name, None)
            self._up -= {name}
            self._update_fleet()
            self._say(f"{name} exited.")
        finally:
            self._stopping.remove(name)

    def _spawn(self, what: Coroutine[Any, Any, None], tasks: set[asyncio.Task[None]]) -> None:
        tasks.add(task := asyncio.create_task(what))
        task.add_done_callback(tasks.discard)

    def _stop_polling(self) -> None:
        for task in self._tasks:
            task.cancel()


def _failure(facts: Facts) -> str | None:
    if facts["version"] != VERSION:
        return f"It has TIGAS {facts['version']}, but this is {VERSION}: install the same version everywhere."
    return facts["failure"]
