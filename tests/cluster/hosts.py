"""Made-up hosts."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Any

import httpx

from tigas_cluster.director import create_director
from tigas_cluster.fleet import Fleet, HostAddress, HostState
from tigas_common.origins import OriginPolicy
from tigas_common.wire.render import DEFAULT_LADDER, HostLoad, ServerConfig


def load(
    viewers: int = 0, *, full: float | None = None, queue_age_s: float = 0.0, scenes: tuple[str, ...] = ()
) -> HostLoad:
    config = ServerConfig(
        version="1",
        ladder=DEFAULT_LADDER,
        certificate_sha256="AQID",
        webtransport_url="https://192.0.2.1:4433/render",
        https_url="https://192.0.2.1:8443/",
        services={"dash": "http://192.0.2.1:8081"},
        retry_after_s=full,
        max_upload_bytes=1_000_000,
    )
    return HostLoad(config=config, viewers=viewers, utilisation=0.1, queue_age_s=queue_age_s, scenes=scenes)


def host(name: str, viewers: int = 0, *, draining: bool = False, **report: Any) -> HostState:
    """A host at http://NAME.test:8080, with a report as of `load`."""
    return HostState(HostAddress(name, f"http://{name}.test:8080", draining=draining), load(viewers, **report))


class FakeFleet(Fleet):
    def __init__(self, *states: HostState) -> None:
        super().__init__((), lambda: 0.0)
        self.states: list[HostState] = list(states)
        self.dead: set[str] = set()
        """Of these it is only noticed when they are suspected."""
        self.suspected: list[str] = []

    def hosts(self) -> Sequence[HostState]:
        return list(self.states)

    async def poll_now(self, name: str) -> None:
        self.suspected.append(name)
        if name in self.dead:
            self.states = [state for state in self.states if state.name != name]


class FakeHosts(httpx.AsyncBaseTransport):
    """Hosts at http://NAME.test, which answer by `answer`; dead ones refuse, and silent ones never answer."""

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
        return self.answer(name, request)

    def answer(self, name: str, request: httpx.Request) -> httpx.Response:
        raise NotImplementedError

    def count(self, name: str) -> int:
        return sum(request.url.host == f"{name}.test" for request in self.asked)


@asynccontextmanager
async def asking_director(fleet: Fleet, **options: Any) -> AsyncIterator[httpx.AsyncClient]:
    """A client of a director of this fleet."""
    async with (
        create_director(fleet, origins=OriginPolicy(), clock=lambda: 0.0, **options) as app,
        httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost:8080") as client,
    ):
        yield client
