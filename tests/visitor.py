"""A client of an ASGI application that may leave before it has its answer."""

from __future__ import annotations

import asyncio

from starlette.types import ASGIApp, Message


class Visitor:
    """A client with one request, which it gives up when it is told to."""

    def __init__(self, app: ASGIApp, method: str, path: str, address: str = "192.0.2.1", *, body: bytes = b"") -> None:
        self.left = asyncio.Event()
        self.got: list[Message] = []
        scope = {
            "type": "http",
            "scheme": "http",
            "method": method,
            "path": path,
            "raw_path": path.encode(),
            "query_string": b"",
            "headers": [(b"host", b"localhost")],
            "client": (address, 1),
        }
        self._body = iter([{"type": "http.request", "body": body, "more_body": False}])
        self.asking = asyncio.ensure_future(app(scope, self._receive, self._send))

    @property
    def status(self) -> int | None:
        return self.got[0]["status"] if self.got else None

    async def _receive(self) -> Message:
        for message in self._body:
            return message
        await self.left.wait()
        return {"type": "http.disconnect"}

    async def _send(self, message: Message) -> None:
        self.got.append(message)
