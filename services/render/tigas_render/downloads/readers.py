"""Downloads of scenes as files, whole or in ranges, up to a number at a time."""

from __future__ import annotations

from typing import Any

from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.types import Receive, Scope, Send

from tigas_common.address import client_network
from tigas_common.errors import Overloaded
from tigas_common.limits import ConcurrencyLimit
from tigas_common.web import has_already
from tigas_render.downloads.cache import MadeFile
from tigas_render.scenes.source import SceneSource

AT_ONCE, OF_AN_ADDRESS = 128, 32
"""Answers at a time, each of which holds a connection and an open file until its client has read it."""
RETRY_S = 5.0


class Readers:
    """Answers with files, up to the limit."""

    def __init__(self) -> None:
        self.limit = ConcurrencyLimit(AT_ONCE, OF_AN_ADDRESS)

    def answer(self, request: Request, source: SceneSource, made: MadeFile) -> Response:
        """Answer with a scene's file, or a range of it. Sending it raises Overloaded beyond the limit."""
        tag = f'"{made.about.sha256}"'
        headers = {"ETag": tag, "Cache-Control": "no-cache"}
        if has_already(request, tag):
            return Response(status_code=304, headers=headers)
        name = f"{source.id}.compressed.ply"
        return _Reading(self.limit, made.path, headers=headers, media_type="application/octet-stream", filename=name)


class _Reading(FileResponse):
    """A file, sent as fast as its client takes it."""

    chunk_size = 256 * 1024

    def __init__(self, limit: ConcurrencyLimit, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._limit = limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        client = scope.get("client")
        busy = Overloaded("As many scenes are being downloaded as may be; try again in a few seconds.", RETRY_S)
        with self._limit.one_more(client_network(client[0]) if client else "unknown", busy):
            await super().__call__(scope, receive, send)
