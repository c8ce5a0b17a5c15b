"""Access from browsers: the hosts that a service answers under, and the web pages that may use it.

Without these checks, any visited page could use services on the visitor's machine: the browser sends its requests, and
treats it as our own page once its name resolves to this machine (DNS rebinding).
"""

from __future__ import annotations

import socket
from collections.abc import Iterable
from dataclasses import dataclass

from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware.cors import CORSMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from tigas_common.address import Address, host_of, host_of_origin, is_address, is_loopback, is_network_name
from tigas_common.errors import TigasError, problem
from tigas_common.web import problem_response

SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
"""Safe methods (RFC 9110, 9.2.1)."""
SECURITY_HEADERS = {
    "Cross-Origin-Resource-Policy": "same-origin",
    # Not `no-referrer`, nor `same-origin`: beacons to a service on another port would say that they come from nowhere.
    "Referrer-Policy": "strict-origin",
    "X-Content-Type-Options": "nosniff",
}
NOTHING = "default-src 'none'"
"""The content security policy of an answer that is no page."""


class ForeignHost(TigasError):
    status, type, title = 421, "foreign-host", "This service has another name"


class ForeignOrigin(TigasError):
    status, type, title = 403, "foreign-origin", "This origin may not use the service"


@dataclass(frozen=True, slots=True)
class OriginPolicy:
    """Pages of the service's own host may use it, on any port; others if `pages` names them.

    Its own hosts are loopback, every address, since no name server can make one lead elsewhere, and the names below.
    """

    hosts: frozenset[str] = frozenset()
    """Names, in small letters."""
    pages: tuple[str, ...] = ()
    """Origins, as browsers name them. Origins of other machines may also embed the service's pages in a frame."""
    on_network: bool = False
    """Names that only the local network can resolve (`labhost`, `lab.local`) count as own names."""
    programs: bool = True
    """Whether changes may be requested without an origin, as by programs other than browsers."""

    @classmethod
    def of(
        cls,
        listening: Iterable[Address],
        hosts: Iterable[str] = (),
        pages: Iterable[str] = (),
        *,
        programs: bool = True,
    ) -> OriginPolicy:
        """The policy of a service that listens on these addresses."""
        names = [address.host for address in listening]
        on_network = not all(map(is_loopback, names))
        own = [*names, socket.gethostname()] if on_network else names
        return cls(frozenset(name.lower() for name in (*own, *hosts)), tuple(pages), on_network, programs)

    def check(self, host: str, origin: str | None, *, changes: bool = True) -> None:
        """Check a request with this Host and Origin; `changes`: it uses an unsafe method.

        Raises ForeignHost and ForeignOrigin.
        """
        name = host_of(host)
        if name is None or not self._is_own(name):
            raise ForeignHost(f"This service does not answer under the name {host[:60]!r} (setting allow_hosts).")
        if origin is None:
            if changes and not self.programs:
                raise ForeignOrigin("A request that changes something must have an allowed Origin; this one has none.")
        elif origin not in self.pages and not _same(host_of_origin(origin), name):
            raise ForeignOrigin(f"Pages of {origin[:60]!r} may not use this service (setting allow_origins).")

    def check_request(self, method: str, headers: Headers) -> None:
        """The same for an HTTP request, using the browser's other headers if it has no Origin."""
        origin = headers.get("origin")
        self.check(headers.get("host", ""), origin, changes=method not in SAFE_METHODS)
        if origin is None and headers.get("sec-fetch-site") == "cross-site" and not self._is_visit(method, headers):
            raise ForeignOrigin("Pages of another site may not use this service (setting allow_origins).")

    @property
    def frame_ancestors(self) -> str:
        """The directive with the origins that may embed an answer in a frame."""
        return "frame-ancestors " + (" ".join(self._embedders) or "'none'")

    @property
    def _embedders(self) -> list[str]:
        return [page for page in self.pages if not is_loopback(host_of_origin(page) or "")]

    def _is_own(self, name: str) -> bool:
        return (
            is_loopback(name) or is_address(name) or name in self.hosts or (self.on_network and is_network_name(name))
        )

    def _is_visit(self, method: str, headers: Headers) -> bool:
        """Whether the request follows a link, or embeds us in a frame of an allowed page."""
        shown_in = {"document", "iframe"} if self._embedders else {"document"}
        navigates = method in SAFE_METHODS and headers.get("sec-fetch-mode") == "navigate"
        return navigates and headers.get("sec-fetch-dest") in shown_in


class OriginCheck:
    """ASGI middleware around a whole application: refuses requests against the policy, lets allowed pages read the
    answers, and adds the headers that keep other pages from using them.
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
            send = self._protecting(send)
            if scope["type"] == "websocket":
                return await WebSocket(scope, receive, send).send_denial_response(refusal)
            return await refusal(scope, receive, send)
        if scope["type"] == "websocket":
            return await self._app(scope, receive, send)
        origin = headers.get("origin")
        app = self._app if origin is None or _is_page_of(origin, headers["host"]) else _readable(self._app, origin)
        return await app(scope, receive, self._protecting(send))

    def _protecting(self, send: Send) -> Send:
        async def protect(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                message.setdefault("headers", [])
                headers = MutableHeaders(scope=message)
                headers.update(SECURITY_HEADERS)
                content = headers.get("content-security-policy", NOTHING)
                headers["Content-Security-Policy"] = f"{content}; {self._policy.frame_ancestors}"
            await send(message)

        return protect


def _readable(app: ASGIApp, origin: str) -> ASGIApp:
    """The application for an allowed page of another origin: to most services the page is one, by its port."""
    methods = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE"]
    # of frames, and of parts of scenes, that a page of the cluster's asks a host for; and of uploads
    exposed = ["Server-Timing", "Tigas-Frame", "Content-Range", "ETag", "Location", "Upload-Offset", "Upload-Length"]
    return CORSMiddleware(
        app, allow_origins=[origin], allow_methods=methods, allow_headers=["*"], expose_headers=exposed
    )


def _is_page_of(origin: str, host: str) -> bool:
    return origin.partition("://")[2] == host


def _same(theirs: str | None, ours: str) -> bool:
    return theirs is not None and (theirs == ours or (is_loopback(theirs) and is_loopback(ours)))
