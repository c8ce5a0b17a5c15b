"""One HTTP/3 request, answered by the ASGI application."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from urllib.parse import unquote_to_bytes

from aioquic.h3.connection import ErrorCode
from aioquic.h3.events import Headers
from starlette.types import ASGIApp, Message, Scope

from tigas_common.proxy import HOP_BY_HOP
from tigas_common.web import ARRIVED, error_response, problem_response
from tigas_common.wire.render import Problem
from tigas_render.transport.outlet import Outlet, StreamClosed

logger = logging.getLogger(__name__)

FAILED = error_response(Exception())
"""The answer when the application fails."""


def http_scope(headers: Headers, client: tuple[str, int], server: tuple[str, int]) -> Scope:
    pseudo = {name: value for name, value in headers if name.startswith(b":")}
    raw_path, _, query = pseudo.get(b":path", b"/").partition(b"?")
    fields = [(name, value) for name, value in headers if not name.startswith(b":") and name != b"host"]
    return {
        "type": "http",
        "asgi": {"version": "3.0", "spec_version": "2.3"},
        "http_version": "3",
        "method": pseudo[b":method"].decode("latin-1").upper(),
        "scheme": "https",
        "path": unquote_to_bytes(raw_path).decode("utf-8", "replace"),
        "raw_path": raw_path,
        "query_string": query,
        "root_path": "",
        "headers": [(b"host", pseudo[b":authority"]), *fields],
        "client": client,
        "server": server,
        "state": {},
    }


def refusal(status: int, detail: str) -> ASGIApp:
    """An application that refuses every request with this status and sentence."""
    title = HTTPStatus(status).phrase
    return problem_response(Problem(type="about:blank", title=title, status=status, detail=detail))


class HttpRequest:
    """A request and its response."""

    abort_code: int = ErrorCode.H3_REQUEST_CANCELLED

    def __init__(self, outlet: Outlet, scope: Scope, app: ASGIApp) -> None:
        self.outlet = outlet
        self.task: asyncio.Task[None] | None = None
        self._scope = scope
        self._app = app
        self._body = bytearray()
        """Data that the application has not read yet, at most QUIC's stream window."""
        self._ended = False
        self._end_delivered = False
        self._disconnected = False
        self._news = asyncio.Event()
        self._started = False
        self._complete = False

    def data_received(self, data: bytes, ended: bool, arrived: float) -> None:
        """Add the next part of the body. ended: whether it is the last part."""
        self._ended |= ended
        self._scope["state"][ARRIVED] = arrived
        if data and not self._disconnected and not self._complete:
            self._body += data
            self.outlet.set_unread(len(self._body))
        self._news.set()

    def cancelled(self) -> None:
        """Note that the client has cancelled the request or disconnected."""
        self._disconnected = True
        self._clear_body()
        self._news.set()

    def _clear_body(self) -> None:
        self._body.clear()
        self.outlet.set_unread(0)

    def start(self, ended: Callable[[], None]) -> None:
        """Run the application in a task. ended: called when the task is done."""
        self.task = asyncio.create_task(self._run())
        # A callback, because a task that is cancelled before it starts never enters its own `finally`.
        self.task.add_done_callback(partial(_done, ended))

    async def _run(self) -> None:
        try:
            await self._app(self._scope, self.receive, self.send)
            failed = not self._complete and not self._disconnected
        except Exception:
            logger.exception("%s %s failed", self._scope["method"], self._scope["path"])
            failed = True
        if failed and not self._started:
            await FAILED(self._scope, self.receive, self.send)
        elif failed:
            self.outlet.abort(ErrorCode.H3_INTERNAL_ERROR)

    async def receive(self) -> Message:
        """ASGI's receive: the parts of the body, then a disconnect once the client or the response is done."""
        while not (self._disconnected or self._complete):
            self._news.clear()
            if self._body or (self._ended and not self._end_delivered):
                body = bytes(self._body)
                self._clear_body()
                self._end_delivered = self._ended
                return {"type": "http.request", "body": body, "more_body": not self._ended}
            timeout = None if self._ended else self.outlet.limits.request_timeout
            try:
                async with asyncio.timeout(timeout):
                    await self._news.wait()
            except TimeoutError:
                self.outlet.abort(ErrorCode.H3_REQUEST_INCOMPLETE)
                self.cancelled()
        return {"type": "http.disconnect"}

    async def send(self, message: Message) -> None:
        """ASGI's send. Waits while the client or the network cannot keep up.

        Does nothing after a disconnect, as in ASGI 2.3, uvicorn's version; later versions raise an error.
        """
        if self._disconnected:
            return
        match message["type"]:
            case "http.response.start" if not self._started:
                self._started = True
                fields = [(name.lower(), value) for name, value in message.get("headers", ())]
                kept = [field for field in fields if field[0] not in HOP_BY_HOP]  # HTTP/3 forbids them (RFC 9114, 4.2)
                self.outlet.send_headers([(b":status", str(message["status"]).encode()), *kept])
            case "http.response.body" if self._started and not self._complete:
                await self._send_body(message.get("body", b""), message.get("more_body", False))
            case other:
                raise RuntimeError(f"The application sent {other!r} out of order.")

    async def _send_body(self, body: bytes | memoryview, more: bool) -> None:
        try:
            if self._scope["method"] != "HEAD":
                await self.outlet.send_data(memoryview(body))
        except StreamClosed:
            self.outlet.abort(ErrorCode.H3_REQUEST_CANCELLED)
            self.cancelled()
        if not more:
            self.outlet.end()
            self.outlet.stop_reading(ErrorCode.H3_NO_ERROR)
            self._complete = True  # from now on `receive` reports the disconnect
            self._clear_body()
            self._news.set()


def _done(ended: Callable[[], None], task: asyncio.Task[None]) -> None:
    if not task.cancelled() and (error := task.exception()) is not None:
        logger.error("A request's task failed", exc_info=error)
    ended()
