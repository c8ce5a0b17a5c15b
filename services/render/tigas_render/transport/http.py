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
from tigas_common.web import ARRIVAL_KEY, error_response, problem_response
from tigas_common.wire.render import Problem
from tigas_render.transport.sending import StreamClosed, StreamWriter

logger = logging.getLogger(__name__)

FAILURE_RESPONSE = error_response(Exception())
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


def refusal_app(status: int, detail: str) -> ASGIApp:
    """An application that refuses every request with this status and sentence."""
    title = HTTPStatus(status).phrase
    return problem_response(Problem(type="about:blank", title=title, status=status, detail=detail))


class HttpRequest:
    """A request and its response."""

    abort_code: int = ErrorCode.H3_REQUEST_CANCELLED

    def __init__(self, writer: StreamWriter, scope: Scope, app: ASGIApp) -> None:
        self.writer = writer
        self.task: asyncio.Task[None] | None = None
        self._scope = scope
        self._app = app
        self._body = bytearray()
        """Data that the application has not read yet, at most QUIC's stream window."""
        self._ended = False
        self._end_delivered = False
        self._disconnected = False
        self._changed = asyncio.Event()
        self._started = False
        self._complete = False

    def data_received(self, data: bytes, end_stream: bool, arrived: float) -> None:
        """Add the next part of the body. end_stream: whether it is the last part."""
        self._ended |= end_stream
        self._scope["state"][ARRIVAL_KEY] = arrived
        if data and not self._disconnected and not self._complete:
            self._body += data
            self.writer.set_unread_bytes(len(self._body))
        self._changed.set()

    def cancel(self) -> None:
        """Note that the client has cancelled the request or disconnected."""
        self._disconnected = True
        self._clear_body()
        self._changed.set()

    def _clear_body(self) -> None:
        self._body.clear()
        self.writer.set_unread_bytes(0)

    def start(self, on_done: Callable[[], None]) -> None:
        """Run the application in a task. on_done: called when the task is done."""
        self.task = asyncio.create_task(self._run())
        # A callback, because a task that is cancelled before it starts never enters its own `finally`.
        self.task.add_done_callback(partial(_handle_task_done, on_done))

    async def _run(self) -> None:
        try:
            await self._app(self._scope, self.receive, self.send)
            failed = not self._complete and not self._disconnected
        except Exception:
            logger.exception("%s %s failed", self._scope["method"], self._scope["path"])
            failed = True
        if failed and not self._started:
            await FAILURE_RESPONSE(self._scope, self.receive, self.send)
        elif failed:
            self.writer.abort(ErrorCode.H3_INTERNAL_ERROR)

    async def receive(self) -> Message:
        """ASGI's receive: the parts of the body, then a disconnect once the client or the response is done."""
        while not (self._disconnected or self._complete):
            self._changed.clear()
            if self._body or (self._ended and not self._end_delivered):
                body = bytes(self._body)
                self._clear_body()
                self._end_delivered = self._ended
                return {"type": "http.request", "body": body, "more_body": not self._ended}
            timeout = None if self._ended else self.writer.limits.request_timeout
            try:
                async with asyncio.timeout(timeout):
                    await self._changed.wait()
            except TimeoutError:
                self.writer.abort(ErrorCode.H3_REQUEST_INCOMPLETE)
                self.cancel()
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
                self.writer.send_headers([(b":status", str(message["status"]).encode()), *kept])
            case "http.response.body" if self._started and not self._complete:
                await self._send_body(message.get("body", b""), message.get("more_body", False))
            case other:
                raise RuntimeError(f"The application sent {other!r} out of order.")

    async def _send_body(self, body: bytes | memoryview, more: bool) -> None:
        try:
            if self._scope["method"] != "HEAD":
                await self.writer.send_data(memoryview(body))
        except StreamClosed:
            self.writer.abort(ErrorCode.H3_REQUEST_CANCELLED)
            self.cancel()
        if not more:
            self.writer.end()
            self.writer.stop_reading(ErrorCode.H3_NO_ERROR)
            self._complete = True  # from now on `receive` reports the disconnect
            self._clear_body()
            self._changed.set()


def _handle_task_done(on_done: Callable[[], None], task: asyncio.Task[None]) -> None:
    if not task.cancelled() and (error := task.exception()) is not None:
        logger.error("A request's task failed", exc_info=error)
    on_done()
