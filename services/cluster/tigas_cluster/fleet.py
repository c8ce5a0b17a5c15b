"""The hosts as known to the director: their addresses, and their reports, polled several times per second."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Self
from urllib.parse import urlsplit

import httpx

from tigas_common.address import bracket_host
from tigas_common.errors import TigasError
from tigas_common.parsing import parse
from tigas_common.wire.render import HostLoad

OVERLOAD_UTILISATION, OVERLOAD_AGE_S = 0.8, 0.06
"""Utilisation, and longest wait in seconds, above which a host counts as under pressure."""
POLL_S = 0.25
"""Polling interval of each host, in seconds."""
DOWN_AFTER_S = 1.0
"""Seconds without an answer after which a host counts as down until it answers."""
POLL_TIMEOUT_S = DOWN_AFTER_S - POLL_S
"""Timeout of an answer, in seconds."""
SUSPECT_S = 0.3
"""Time for a host reported as silent to answer, in seconds."""
MAX_REPORT_BYTES = 1_000_000
"""Maximum size of a report in bytes; it lists scenes."""


@dataclass(frozen=True, slots=True)
class HostAddress:
    """The addresses of a host."""

    name: str
    """Unique name, as shown on pages."""
    api_url: str
    """Its API over plain HTTP for the director, such as `http://10.0.0.5:8080`."""
    public_host: str | None = None
    """Name or address under which pages reach it, if not the one in `api_url`; the ports are the same."""
    draining: bool = False
    """Whether it is about to end: it gets no new viewers, and its viewers move to other hosts."""

    @property
    def public_address(self) -> str:
        """HOST:PORT of its API, as used by pages."""
        url = urlsplit(self.api_url)
        host = bracket_host(self.public_host or url.hostname or "localhost")
        return f"{host}:{url.port}" if url.port else host


@dataclass(frozen=True, slots=True)
class HostState:
    """State of a host that is up."""

    address: HostAddress
    load: HostLoad
    """Its last report."""

    @property
    def name(self) -> str:
        return self.address.name

    @property
    def draining(self) -> bool:
        return self.address.draining

    @property
    def render_url(self) -> str:
        """Base URL for a page's `POST /render`."""
        return f"http://{self.address.public_address}"

    @property
    def viewers(self) -> int:
        return self.load.viewers

    @property
    def retry_after_s(self) -> float | None:
        """Seconds after which a new viewer may try again; None if new viewers are admitted."""
        return self.load.config.retry_after_s

    @property
    def is_overloaded(self) -> bool:
        """Whether its scenes would benefit from another host."""
        busy = self.load.utilisation > OVERLOAD_UTILISATION or self.load.queue_age_s > OVERLOAD_AGE_S
        return busy or self.retry_after_s is not None


class Fleet:
    """An async context manager that polls the hosts. Their list may change at any time."""

    def __init__(
        self,
        addresses: Iterable[HostAddress],
        clock: Callable[[], float],
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        """clock: in seconds; transport: replaces HTTP in tests."""
        self._clock = clock
        self._client = httpx.AsyncClient(
            transport=transport or httpx.AsyncHTTPTransport(limits=httpx.Limits(max_connections=None))
        )
        self._pollers: dict[str, _HostPoller] = {}
        self._running = False
        self.set_hosts(addresses)

    async def __aenter__(self) -> Self:
        """Poll each host once, then start polling regularly."""
        self._running = True
        await asyncio.gather(*(poller.poll() for poller in self._pollers.values()))
        for poller in self._pollers.values():
            poller.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        self._running = False
        for poller in self._pollers.values():
            poller.stop()
        await self._client.aclose()

    def set_hosts(self, addresses: Iterable[HostAddress]) -> None:
        """Set the hosts. The state of known hosts is kept."""
        wanted = {address.name: address for address in addresses}
        for name, poller in list(self._pollers.items()):
            address = wanted.get(name)
            if address is None or address.api_url != poller.address.api_url:
                self._pollers.pop(name).stop()
        for name, address in wanted.items():
            if name in self._pollers:
                self._pollers[name].address = address
                continue
            self._pollers[name] = made = _HostPoller(address, self._client, self._clock)
            if self._running:
                made.start()

    def hosts(self) -> Sequence[HostState]:
        """Hosts that are up, with their last reports."""
        return [state for poller in self._pollers.values() if (state := poller.state) is not None]

    async def poll_now(self, name: str) -> None:
        """Poll a host now, as a viewer reports it as silent. `hosts` reflects the outcome on return."""
        if (poller := self._pollers.get(name)) is not None:
            await poller.check()


class _HostPoller:
    def __init__(self, address: HostAddress, client: httpx.AsyncClient, clock: Callable[[], float]) -> None:
        self.address = address
        self._client = client
        self._clock = clock
        self._load: HostLoad | None = None
        self._answered_at = -math.inf
        self._failing = False
        """Whether the last poll failed, so that a pause of this process alone does not make a host seem down."""
        self._poll_started_at: float | None = None
        """Start of the pending poll, if any."""
        self._polling: asyncio.Task[None] | None = None
        self._checking: asyncio.Task[None] | None = None

    @property
    def state(self) -> HostState | None:
        """State of the host; None if it is down, or has never been up."""
        if self._load is None or (self._failing and self._clock() - self._answered_at >= DOWN_AFTER_S):
            return None
        return HostState(self.address, self._load)

    def start(self) -> None:
        self._polling = asyncio.create_task(self._keep_polling())

    def stop(self) -> None:
        for task in (self._polling, self._checking):
            if task is not None:
                task.cancel()

    async def check(self) -> None:
        """Poll now, sharing the poll among concurrent callers; without an answer, the host is down."""
        if self._checking is None or self._checking.done():
            self._checking = asyncio.create_task(self._check())
        await asyncio.wait([self._checking])

    async def poll(self, limit_s: float | None = None) -> bool:
        """Poll once, and return whether an answer arrived within the limit."""
        began = self._clock()
        try:
            async with asyncio.timeout(limit_s or POLL_TIMEOUT_S):
                answer = await self._client.get(
                    f"{self.address.api_url}/api/load", headers={"Host": self.address.public_address}
                )
            answer.raise_for_status()
            self._load = parse(HostLoad, answer.content, MAX_REPORT_BYTES)
        except (TimeoutError, httpx.HTTPError, TigasError):
            self._failing = True
            return False
        self._answered_at, self._failing = began, False
        return True

    async def _check(self) -> None:
        asked_at = self._clock() if self._poll_started_at is None else self._poll_started_at
        known = self._failing or self._clock() - asked_at >= SUSPECT_S  # it already had time to answer
        if known or not await self.poll(SUSPECT_S):
            self._answered_at, self._failing = -math.inf, True

    async def _keep_polling(self) -> None:
        while True:
            self._poll_started_at = self._clock()
            await self.poll()
            self._poll_started_at = None
            await asyncio.sleep(POLL_S)
