"""A proxy for everything except frames, by any host: the page, scenes, previews, networks."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

import httpx
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from tigas_cluster.fleet import Fleet, HostState
from tigas_common.errors import Overloaded
from tigas_common.parsing import MAX_BODY
from tigas_common.placement import ranked
from tigas_common.proxy import ask, hand_back, headers_of, unless
from tigas_common.web import page_policy, read_body

MAX_CONNECTIONS = 128
"""To all hosts together."""
LOOK_S = 0.25
"""Seconds between two looks whether a host that has not answered yet is still up."""
AWAY = "No host of the cluster is up; try again in a few seconds."
RETRY_S = 2.0
FROM_THE_PAGE = frozenset((b"host", b"origin", b"sec-fetch-site", b"sec-fetch-mode", b"sec-fetch-dest"))
"""Fields about the origin of a request: checked by the director, with names unknown to a host."""
PAGES_HOSTS = ("http:", "https:")
"""The sources that a page may connect to: hosts come and go while it is open."""


class HostProxy:
    """An ASGI application in front of any host's. `?host=NAME` chooses one of them."""

    def __init__(self, fleet: Fleet, transport: httpx.AsyncBaseTransport | None = None) -> None:
        """transport: another than HTTP, for tests."""
        self._fleet = fleet
        self._transport = transport or httpx.AsyncHTTPTransport(limits=httpx.Limits(max_connections=MAX_CONNECTIONS))
        self.client = httpx.AsyncClient(transport=self._transport)
        """For the director's own requests over the same connections."""

    async def close(self) -> None:
        """Close the connections."""
        await self.client.aclose()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Raises Overloaded if no host answers."""
        body = await read_body(Request(scope, receive), MAX_BODY)
        for host in self._in_order(scope["path"], Request(scope).query_params.get("host")):
            answer = await self._answer(host, scope, body)
            if answer is not None:
                headers = [each for each in headers_of(answer) if each[0] != b"content-security-policy"]
                if Headers(raw=headers).get("content-type", "").startswith("text/html"):
                    headers.append((b"content-security-policy", page_policy(PAGES_HOSTS).encode()))
                return await hand_back(answer, headers, receive, send)
        raise Overloaded(AWAY, RETRY_S)

    def _in_order(self, path: str, wanted: str | None) -> Sequence[HostState]:
        """Return the hosts in the order to try: the wanted one, then the likeliest one for the scene in the path."""
        hosts = {host.name: host for host in self._fleet.hosts()}
        parts = path.split("/")
        scene = parts[2] if len(parts) > 2 and parts[1] == "scenes" else ""
        order = [hosts[name] for name in ranked(scene, tuple(hosts))]
        return sorted(order, key=lambda host: (host.name != wanted, host.draining))

    async def _answer(self, host: HostState, scope: Scope, body: bytes) -> httpx.Response | None:
        """Return None if the host is lost before it answers."""
        try:
            return await unless(self._lost(host), ask(self._transport, host.api_url, scope, body, FROM_THE_PAGE))
        except httpx.TransportError:
            return None

    async def _lost(self, host: HostState) -> None:
        while any(each.name == host.name for each in self._fleet.hosts()):  # noqa: ASYNC110 - a fleet has no events
            await asyncio.sleep(LOOK_S)
