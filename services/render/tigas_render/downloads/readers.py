"""Those who read the files that scenes are downloaded as: whole or in ranges, as many as can be served at once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.types import Receive, Scope, Send

from tigas_common.errors import Overloaded
from tigas_common.peers import client_network
from tigas_common.web import has_already
from tigas_render.downloads.cache import MadeFile
from tigas_render.scenes.source import SceneSource

AT_ONCE, OF_AN_ADDRESS = 128, 32
"""Answers; each holds a connection and an open file for as long as its client takes to read it."""
RETRY_S = 5.0


class Readers:
    """Answers with files, and counts those who read one."""

    def __init__(self) -> None:
        self._readers: Counter[str] = Counter()

    def answer(self, request: Request, source: SceneSource, made: MadeFile) -> Response:
        """A scene's file, or the range of it that is asked for; sending it raises Overloaded if too many read."""
        tag = f'"{made.about.sha256}"'
        headers = {"ETag": tag, "Cache-Control": "no-cache"}
        if has_already(request, tag):
            return Response(status_code=304, headers=headers)
        name = f"{source.id}.{'ply' if made.about.form == 'ply' else 'compressed.ply'}"
        return _Reading(self, made.path, headers=headers, media_type="application/octet-stream", filename=name)

    @contextmanager
    def one_more(self, address: str) -> Iterator[None]:
        """Count somebody for as long as the context lasts. Raises Overloaded."""
        if self._readers.total() >= AT_ONCE or self._readers[address] >= OF_AN_ADDRESS:
            raise Overloaded("As many scenes are being downloaded as may be; try again in a few seconds.", RETRY_S)
        self._readers[address] += 1
        try:
            yield
        finally:
            self._readers[address] -= 1
            self._readers += Counter()  # forgets those who have none


class _Reading(FileResponse):
    """A file that is sent as fast as its client takes it."""

    chunk_size = 256 * 1024

    def __init__(self, readers: Readers, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._readers = readers

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        client = scope.get("client")
        with self._readers.one_more(client_network(client[0]) if client else "unknown"):
            await super().__call__(scope, receive, send)
