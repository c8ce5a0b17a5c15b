"""Made-up hosts."""

from __future__ import annotations

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
    """A host's report."""
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


def host(
    name: str, viewers: int = 0, *, full: float | None = None, queue_age_s: float = 0.0, draining: bool = False
) -> HostState:
    """A host at http://NAME.test:8080."""
    address = HostAddress(name, f"http://{name}.test:8080", draining=draining)
    return HostState(address, load(viewers, full=full, queue_age_s=queue_age_s))


class FakeFleet(Fleet):
    """A fleet controlled by the test."""

    def __init__(self, *states: HostState) -> None:
        super().__init__((), lambda: 0.0)
        self.states: list[HostState] = list(states)
        self.dead: set[str] = set()
        """Of these it is only noticed when they are suspected."""
        self.suspected: list[str] = []

    def hosts(self) -> Sequence[HostState]:
        return list(self.states)

    async def suspect(self, name: str) -> None:
        self.suspected.append(name)
        if name in self.dead:
            self.states = [state for state in self.states if state.name != name]


@asynccontextmanager
async def asking_director(fleet: Fleet, **options: Any) -> AsyncIterator[httpx.AsyncClient]:
    """A client of a director of this fleet."""
    async with (
        create_director(fleet, origins=OriginPolicy(), clock=lambda: 0.0, **options) as app,
        httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost:8080") as client,
    ):
        yield client
