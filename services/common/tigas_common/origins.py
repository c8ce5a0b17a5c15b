"""Which web origins may change something, as browsers tell by `Origin`.

Without this, any page that somebody visits could change that person's link or remove their experiments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import ip_address
from urllib.parse import urlsplit

from starlette.middleware import Middleware
from starlette.middleware.cors import CORSMiddleware
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from tigas_common.errors import TigasError
from tigas_common.web import on_error

LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
"""They change nothing (RFC 9110, 9.2.1)."""


class ForeignOrigin(TigasError):
    """A page that may not, or a program that does not say who it is, asked for a change."""

    status, type, title = 403, "foreign-origin", "This origin may change nothing here"


@dataclass(frozen=True, slots=True)
class OriginPolicy:
    """Who may ask for a change: `pages`, and whoever the rest allows."""

    pages: Sequence[str]
    """Origins, as browsers name them."""
    own_host: bool = False
    """Pages of the service's own host, on any port. A name with dots may be anybody's, who can make it lead here (DNS
    rebinding): pages of such a host have to be named."""
    programs: bool = False
    """Requests without an origin: they come from programs that are no browser."""

    def check(self, origin: str | None, host: str) -> None:
        """Raises ForeignOrigin for a change that `origin` may not ask for; `host` is what the request names ours."""
        if origin is None:
            if not self.programs:
                raise ForeignOrigin("A request that changes something must have an allowed Origin; this one has none.")
        elif origin not in self.pages and not (self.own_host and _same_host(origin, host)):
            raise ForeignOrigin(f"A request that changes something must have an allowed Origin, not {origin[:100]}.")


class OriginCheck:
    """ASGI middleware: refuses requests for a change that the policy does not allow."""

    def __init__(self, app: ASGIApp, policy: OriginPolicy) -> None:
        self._app = app
        self._policy = policy

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and scope["method"] not in SAFE_METHODS:
            request = Request(scope)
            try:
                self._policy.check(request.headers.get("origin"), request.headers.get("host", ""))
            except ForeignOrigin as error:
                return await (await on_error(request, error))(scope, receive, send)
        return await self._app(scope, receive, send)


def cross_origin(readers: Sequence[str] = ("*",)) -> Middleware:
    """Lets pages of these origins read answers: the page is on another port than most services."""
    return Middleware(
        CORSMiddleware, allow_origins=readers, allow_methods=["GET", "POST", "DELETE"], allow_headers=["*"]
    )


def _same_host(origin: str, host: str) -> bool:
    try:
        theirs, ours = urlsplit(origin).hostname, urlsplit(f"//{host}").hostname
    except ValueError:
        return False
    return theirs is not None and ((theirs == ours and _local(theirs)) or LOOPBACK.issuperset((theirs, ours)))


def _local(host: str) -> bool:
    """Whether it is an address, or a name that only the own network can give."""
    try:
        ip_address(host)
    except ValueError:
        return "." not in host or host.endswith((".local", ".internal", ".home.arpa"))
    return True
