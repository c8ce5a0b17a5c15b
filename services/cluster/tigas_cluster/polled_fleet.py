"""A fleet of hosts with known addresses, each polled several times per second."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Self

import httpx

from tigas_cluster.fleet import Fleet, HostAddress, HostState
from tigas_common.errors import TigasError
from tigas_common.parsing import parse
from tigas_common.wire.render import HostLoad

POLL_S = 0.25
"""Polling interval of each host, in seconds."""
GONE_S = 1.0
"""A host without an answer for this many seconds is down until it answers."""
ANSWER_S = GONE_S - POLL_S
"""How long it has to answer, in seconds."""
SUSPECT_S = 0.3
"""Time for a host reported as silent to answer, in seconds."""
MAX_LOAD = 1_000_000
"""Maximum length of an answer, in bytes: it lists scenes."""


class PolledFleet(Fleet):
    """An async context manager that polls the hosts. Their list may change any time."""

    def __init__(
        self,
        addresses: Iterable[HostAddress],
        clock: Callable[[], float],
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        """clock: in seconds; transport: another than HTTP, for tests."""
        self._clock = clock
        self._client = httpx.AsyncClient(
            transport=transport or httpx.AsyncHTTPTransport(limits=httpx.Limits(max_connections=None))
        )
        self._polled: dict[str, _Polled] = {}
        self._running = False
        self.follow(addresses)

    async def __aenter__(self) -> Self:
        """Knows, once it is entered, how those hosts are that answer at once."""
        self._running = True
        await asyncio.gather(*(polled.ask() for polled in self._polled.values()))
        for polled in self._polled.values():
            polled.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        self._running = False
        for polled in self._polled.values():
            polled.stop()
        await self._client.aclose()

    def follow(self, addresses: Iterable[HostAddress]) -> None:
        """Set the hosts. The state of hosts already known is kept."""
        wanted = {address.name: address for address in addresses}
        for name in self._polled.keys() - {each.name for each in wanted.values()}:
            self._polled.pop(name).stop()
        for name, address in wanted.items():
            known = self._polled.get(name)
            if known is not None and known.address.api_url == address.api_url:
                known.address = address
                continue
            if known is not None:
                known.stop()
            self._polled[name] = made = _Polled(address, self._client, self._clock)
            if self._running:
                made.start()

    def hosts(self) -> Sequence[HostState]:
        return [state for polled in self._polled.values() if (state := polled.state) is not None]

    async def suspect(self, name: str) -> None:
        if (polled := self._polled.get(name)) is not None:
            await polled.check()


class _Polled:
    """One host."""

    def __init__(self, address: HostAddress, client: httpx.AsyncClient, clock: Callable[[], float]) -> None:
        self.address = address
        self._client = client
        self._clock = clock
        self._load: HostLoad | None = None
        self._answered_at = -math.inf
        self._failing = False
        """Whether the last poll failed. A pause of this process alone does not make a host look down."""
        self._asked_at: float | None = None
        """Start of the pending poll, if any."""
        self._polling: asyncio.Task[None] | None = None
        self._checking: asyncio.Task[None] | None = None

    @property
    def state(self) -> HostState | None:
        """None if it is down, or has never been up."""
        if self._load is None or (self._failing and self._clock() - self._answered_at >= GONE_S):
            return None
        return HostState(self.address, self._load)

    def start(self) -> None:
        """Ask again and again."""
        self._polling = asyncio.create_task(self._poll())

    def stop(self) -> None:
        """Ask no more."""
        for task in (self._polling, self._checking):
            if task is not None:
                task.cancel()

    async def check(self) -> None:
        """Poll at once, shared by concurrent callers; without an answer, the host is down."""
        if self._checking is None or self._checking.done():
            self._checking = asyncio.create_task(self._check())
        await asyncio.wait([self._checking])

    async def ask(self, limit_s: float = ANSWER_S) -> bool:
        """Poll once; whether an answer came within the limit."""
        began = self._clock()
        try:
            async with asyncio.timeout(limit_s):
                answer = await self._client.get(
                    f"{self.address.api_url}/api/load", headers={"Host": self.address.public}
                )
            answer.raise_for_status()
            self._load = parse(HostLoad, answer.content, MAX_LOAD)
        except (TimeoutError, httpx.HTTPError, TigasError):
            self._failing = True
            return False
        self._answered_at, self._failing = began, False
        return True

    async def _check(self) -> None:
        asked_at = self._clock() if self._asked_at is None else self._asked_at
        known = self._failing or self._clock() - asked_at >= SUSPECT_S  # it had its time to answer already
        if known or not await self.ask(SUSPECT_S):
            self._answered_at, self._failing = -math.inf, True

    async def _poll(self) -> None:
        while True:
            self._asked_at = self._clock()
            await self.ask()
            self._asked_at = None
            await asyncio.sleep(POLL_S)
