"""A frame as an HTTP response, sent without copying it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Final

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from tigas_render.frame import Frame

MOST_LENT: Final = 32 * 1024 * 1024
"""Maximum bytes of frames kept in place for slow readers; other frames need that memory as well."""


class Lending:
    """How much of the memory for frames is held by answers that are being sent."""

    def __init__(self, most: int = MOST_LENT) -> None:
        """most: bytes; beyond, frames are copied."""
        self._most = most
        self._lent = 0

    @contextmanager
    def lent(self, frame: Frame) -> Iterator[bytes | memoryview]:
        """Body chunks of a frame, which is released at the end."""
        body, length = frame.body, len(frame.body)
        if self._lent + length > self._most:
            body, length = bytes(body), 0
            frame.release()
        self._lent += length
        try:
            yield body
        finally:
            self._lent -= length
            frame.release()


class FrameResponse(Response):
    """Holds its frame until the transport has taken all of it, or the client has disconnected."""

    def __init__(self, frame: Frame, lending: Lending, headers: Mapping[str, str]) -> None:
        super().__init__(frame.body, headers=headers, media_type=frame.content_type)
        self._frame = frame
        self._lending = lending

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._lending.lent(self._frame) as self.body:
            await super().__call__(scope, receive, send)
