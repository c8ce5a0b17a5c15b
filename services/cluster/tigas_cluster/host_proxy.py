"""The hosts' HTTP interface behind the director's address: everything except frames, which pages fetch directly."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from contextlib import suppress
from urllib.parse import quote

import httpx
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from tigas_cluster.fleet import Fleet, HostState
from tigas_common.errors import Overloaded, TigasError
from tigas_common.limits import ConcurrencyLimit
from tigas_common.parsing import MAX_BODY, parse
from tigas_common.placement import merge_scene_lists, rank_names
from tigas_common.proxy import (
    client_key,
    forward,
    response_headers,
    run_until,
    stream_response,
    wait_for_disconnect,
)
from tigas_common.web import page_policy, read_body
from tigas_common.wire.render import SceneInfo

MAX_CONNECTIONS = 128
"""Maximum number of connections to all hosts together."""
MAX_WAITING, MAX_WAITING_PER_ADDRESS = 96, 48
"""Requests that may wait for hosts at a time, in total and per address; other connections are for scene lists."""
CHECK_S = 0.25
"""Interval in seconds of checking whether a host that has not answered yet is still up."""
ANSWER_S = 4.0
"""Seconds for a host to list its scenes before it is left out; the page waits for 5 s."""
MAX_LIST = 10_000_000
"""Maximum size of a scene list, in bytes."""
ORIGIN_HEADERS = frozenset((b"host", b"origin", b"sec-fetch-site", b"sec-fetch-mode", b"sec-fetch-dest"))
"""Headers about a request's origin, which the director checks, as a host does not know the names in them."""
PAGE_SOURCES = ("http:", "https:")
"""Sources to which a page may connect: any host, as hosts come and go while it is open."""


class HostsBusy(Overloaded):
    """Too many requests wait for hosts."""

    def __init__(self) -> None:
        super().__init__("Too many requests wait for the cluster's hosts; try again in a few seconds.", 2.0)


class NoHost(Overloaded):
    """No host of the cluster answers."""

    def __init__(self) -> None:
        super().__init__("No host of the cluster is up; try again in a few seconds.", retry_after_s=2.0)


def _headers(answer: httpx.Response) -> list[tuple[bytes, bytes]]:
    """Headers of a host's answer, with the director's policy for pages."""
    headers = response_headers(answer)
    content_type = Headers(raw=headers).get("content-type", "")
    if not content_type.startswith("text/javascript"):  # scripts have the same policy on all hosts
        headers = [each for each in headers if each[0] != b"content-security-policy"]
    if content_type.startswith("text/html"):
        headers.append((b"content-security-policy", page_policy(PAGE_SOURCES).encode()))
    return headers


class HostProxy:
    """An ASGI application that forwards requests to a host: the one in `?host=NAME`, or the likeliest for the scene."""

    def __init__(self, fleet: Fleet, transport: httpx.AsyncBaseTransport | None = None) -> None:
        """transport: replaces HTTP in tests."""
        self._fleet = fleet
        self._transport = transport or httpx.AsyncHTTPTransport(limits=httpx.Limits(max_connections=MAX_CONNECTIONS))
        self._client = httpx.AsyncClient(transport=self._transport)
        self._running = ConcurrencyLimit(MAX_WAITING, MAX_WAITING_PER_ADDRESS)

    async def close(self) -> None:
        await self._client.aclose()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward a request. Raises NoHost and HostsBusy."""
        with self._running.acquire(client_key(scope), HostsBusy()):
            body = await read_body(Request(scope, receive), MAX_BODY)
            answer = await run_until(wait_for_disconnect(receive), self._try_hosts(scope, body))
            if answer is not None:
                await stream_response(answer, _headers(answer), receive, send)

    async def _try_hosts(self, scope: Scope, body: bytes) -> httpx.Response:
        for host in self._rank_hosts(scope["path"], Request(scope).query_params.get("host")):
            answer = await self._answer(host, scope, body)
            if answer is not None:
                return answer
        raise NoHost

    async def scenes(self, *, scan: bool) -> list[SceneInfo]:
        """The scenes of all hosts, by id; a scene is loaded if any host has loaded it. Raises NoHost."""
        target = "/scenes?scan=1" if scan else "/scenes"
        lists = await asyncio.gather(*(self._scenes_of(host.address.api_url + target) for host in self._fleet.hosts()))
        answered = [each for each in lists if each is not None]
        if not answered:
            raise NoHost
        return merge_scene_lists(answered)

    async def unload(self, scene: str) -> httpx.Response:
        """Unload a scene on all hosts. Returns the answer of a host that refused, or the last one. Raises NoHost."""
        hosts, answer = self._fleet.hosts(), None
        for host in [each for each in hosts if scene in each.load.scenes] or hosts[:1]:
            url = f"{host.address.api_url}/scenes/{quote(scene, safe='')}/unload"
            try:
                answer = await self._client.post(url, timeout=ANSWER_S)
            except httpx.TransportError as error:
                raise NoHost from error
            if answer.is_error:
                break
        if answer is None:
            raise NoHost
        return answer

    async def _scenes_of(self, url: str) -> list[SceneInfo] | None:
        with suppress(TimeoutError, httpx.HTTPError, TigasError):
            async with asyncio.timeout(ANSWER_S):
                answer = await self._client.get(url)
            return parse(list[SceneInfo], answer.raise_for_status().content, MAX_LIST)
        return None

    def _rank_hosts(self, path: str, wanted: str | None) -> Sequence[HostState]:
        """The hosts in the order in which to try them: the wanted one, then the likeliest for the scene in the path."""
        hosts = {host.name: host for host in self._fleet.hosts()}
        parts = path.split("/")
        scene = parts[2] if len(parts) > 2 and parts[1] == "scenes" else ""
        order = [hosts[name] for name in rank_names(scene, tuple(hosts))]
        return sorted(order, key=lambda host: (host.name != wanted, host.draining))

    async def _answer(self, host: HostState, scope: Scope, body: bytes) -> httpx.Response | None:
        """A host's answer; None if the host is lost before it answers."""
        try:
            asking = forward(self._transport, host.address.api_url, scope, body, ORIGIN_HEADERS)
            return await run_until(self._wait_until_lost(host), asking)
        except httpx.PoolTimeout:
            raise HostsBusy from None
        except httpx.TransportError:
            return None

    async def _wait_until_lost(self, host: HostState) -> None:
        while any(each.name == host.name for each in self._fleet.hosts()):  # noqa: ASYNC110 - a fleet has no events
            await asyncio.sleep(CHECK_S)
