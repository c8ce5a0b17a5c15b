"""Which pages may change something: those of the store's own host, as browsers tell by `Origin`.

Without this, any page that somebody visits could remove experiments on that person's own machine. Programs that are no
browser say no origin and may do what they like. A name with dots may be anybody's, who can make it lead here (DNS
rebinding): pages of such a host have to be allowed.
"""

from __future__ import annotations

from collections.abc import Sequence
from ipaddress import ip_address
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from tigas_common.problems import on_error
from tigas_experiments.store.errors import ForeignOrigin

LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})


class OriginCheck:
    """Refuses requests of other hosts' pages, but for those that change nothing and those of `allowed` pages."""

    def __init__(self, app: ASGIApp, allowed: Sequence[str]) -> None:
        self._app = app
        self._allowed = frozenset(allowed)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and scope["method"] not in ("GET", "HEAD", "OPTIONS"):
            request = Request(scope)
            origin = request.headers.get("origin")
            if origin is not None and origin not in self._allowed and not _same_host(origin, request.headers):
                error = ForeignOrigin(f"A page of {origin[:100]} may not change experiments here.")
                return await (await on_error(request, error))(scope, receive, send)
        return await self._app(scope, receive, send)


def _same_host(origin: str, headers: Headers) -> bool:
    try:
        pages, ours = urlsplit(origin).hostname, urlsplit(f"//{headers.get('host', '')}").hostname
    except ValueError:
        return False
    return pages is not None and ((pages == ours and _local(pages)) or LOOPBACK.issuperset((pages, ours)))


def _local(host: str) -> bool:
    """Whether it is an address, or a name that only the own network can give."""
    try:
        ip_address(host)
    except ValueError:
        return "." not in host or host.endswith((".local", ".internal", ".home.arpa"))
    return True
