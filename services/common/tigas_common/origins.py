"""Access control for browsers: the host names that a service answers to, and the web pages that may use it.

Without these checks, any page could use services on its visitor's machine: the browser sends the page's requests, and
considers them same-origin once the page's name resolves to this machine (DNS rebinding).
"""

from __future__ import annotations

import socket
from collections.abc import Iterable
from dataclasses import dataclass

from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware.cors import CORSMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from tigas_common.address import Address, is_address, is_loopback, is_network_name, parse_host, parse_origin_host
from tigas_common.errors import TigasError, problem
from tigas_common.web import problem_response

SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
"""Safe methods (RFC 9110, 9.2.1)."""
SECURITY_HEADERS = {
    "Cross-Origin-Resource-Policy": "same-origin",
    # Not `no-referrer` or `same-origin`: beacons to a service on another port would then have a null origin.
    "Referrer-Policy": "strict-origin",
    "X-Content-Type-Options": "nosniff",
}
DEFAULT_POLICY = "default-src 'none'"
"""Content security policy of answers that are not pages."""


class ForeignHost(TigasError):
    status, type, title = 421, "foreign-host", "This service has another name"


class ForeignOrigin(TigasError):
    status, type, title = 403, "foreign-origin", "This origin may not use the service"


@dataclass(frozen=True, slots=True)
class OriginPolicy:
    """Which pages may use a service: those of its own hosts, on any port, and those listed in `pages`.

    Its own hosts are loopback, every IP address, since DNS cannot redirect one, and the names below.
    """

    hosts: frozenset[str] = frozenset()
    """Host names, in lower case."""
    pages: tuple[str, ...] = ()
    """Origins, as browsers spell them. Origins of other machines may also embed the service's pages in a frame."""
    on_network: bool = False
    """Whether names that only the local network can resolve (`labhost`, `lab.local`) count as own names."""
    programs: bool = True
    """Whether requests without an origin, as from programs other than browsers, may change anything."""

    @classmethod
    def from_addresses(
        cls,
        listening: Iterable[Address],
        hosts: Iterable[str] = (),
        pages: Iterable[str] = (),
        *,
        programs: bool = True,
    ) -> OriginPolicy:
        """The policy for a service that listens on these addresses."""
        names = [address.host for address in listening]
        on_network = not all(map(is_loopback, names))
        own = [*names, socket.gethostname()] if on_network else names
        return cls(frozenset(name.lower() for name in (*own, *hosts)), tuple(pages), on_network, programs)

    def check(self, host: str, origin: str | None, *, changes: bool = True) -> None:
        """Check a request's Host and Origin; `changes`: whether it uses an unsafe method.

        Raises ForeignHost and ForeignOrigin.
        """
        name = parse_host(host)
        if name is None or not self._is_own(name):
            raise ForeignHost(f"This service does not answer under the name {host[:60]!r} (setting allow_hosts).")
        if origin is None:
            if changes and not self.programs:
                raise ForeignOrigin("A request that changes something must have an allowed Origin; this one has none.")
        elif origin not in self.pages and not _is_same_host(parse_origin_host(origin), name):
            raise ForeignOrigin(f"Pages of {origin[:60]!r} may not use this service (setting allow_origins).")

    def check_request(self, method: str, headers: Headers) -> None:
        """Check an HTTP request in the same way, falling back on other headers of browsers if it has no Origin."""
        origin = headers.get("origin")
        self.check(headers.get("host", ""), origin, changes=method not in SAFE_METHODS)
        if origin is None and headers.get("sec-fetch-site") == "cross-site" and not self._is_visit(method, headers):
            raise ForeignOrigin("Pages of another site may not use this service (setting allow_origins).")

    @property
    def frame_ancestors(self) -> str:
        """The directive that lists the origins allowed to embed an answer in a frame."""
        return "frame-ancestors " + (" ".join(self._embedders) or "'none'")

    @property
    def _embedders(self) -> list[str]:
        return [page for page in self.pages if not is_loopback(parse_origin_host(page) or "")]

    def _is_own(self, name: str) -> bool:
        return (
            is_loopback(name) or is_address(name) or name in self.hosts or (self.on_network and is_network_name(name))
        )

    def _is_visit(self, method: str, headers: Headers) -> bool:
        """Whether the request follows a link, or embeds the service in a frame of an allowed page."""
        shown_in = {"document", "iframe"} if self._embedders else {"document"}
        navigates = method in SAFE_METHODS and headers.get("sec-fetch-mode") == "navigate"
        return navigates and headers.get("sec-fetch-dest") in shown_in


class OriginCheck:
    """ASGI middleware around a whole application. Refuses requests that violate the policy, lets allowed pages read the
    answers, and adds headers that keep other pages from using them.
    """

    def __init__(self, app: ASGIApp, policy: OriginPolicy) -> None:
        self._app = app
        self._policy = policy

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            return await self._app(scope, receive, send)
        headers = Headers(scope=scope)
        try:
            self._policy.check_request(scope.get("method", "GET"), headers)
        except TigasError as error:
            refusal = problem_response(problem(error))
            send = self._add_headers(send)
            if scope["type"] == "websocket":
                return await WebSocket(scope, receive, send).send_denial_response(refusal)
            return await refusal(scope, receive, send)
        if scope["type"] == "websocket":
            return await self._app(scope, receive, send)
        origin = headers.get("origin")
        app = self._app if origin is None or _is_page_of(origin, headers["host"]) else _allow_cors(self._app, origin)
        return await app(scope, receive, self._add_headers(send))

    def _add_headers(self, send: Send) -> Send:
        async def protect(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                message.setdefault("headers", [])
                headers = MutableHeaders(scope=message)
                headers.update(SECURITY_HEADERS)
                content = headers.get("content-security-policy", DEFAULT_POLICY)
                headers["Content-Security-Policy"] = f"{content}; {self._policy.frame_ancestors}"
            await send(message)

        return protect


def _allow_cors(app: ASGIApp, origin: str) -> ASGIApp:
    """Wrap the application for an allowed page of another origin, such as the TIGAS page on its own port."""
    methods = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE"]
    # headers of frames, of parts of scenes that a cluster's page requests from a host, and of uploads
    exposed = ["Server-Timing", "Tigas-Frame", "Content-Range", "ETag", "Location", "Upload-Offset", "Upload-Length"]
    return CORSMiddleware(
        app, allow_origins=[origin], allow_methods=methods, allow_headers=["*"], expose_headers=exposed
    )


def _is_page_of(origin: str, host: str) -> bool:
    return origin.partition("://")[2] == host


def _is_same_host(theirs: str | None, ours: str) -> bool:
    return theirs is not None and (theirs == ours or (is_loopback(theirs) and is_loopback(ours)))
