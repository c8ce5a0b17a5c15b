"""A bidirectional stream that a client opened, and the task that answers it."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod

from tigas_render.transport.outlet import Outlet


class Stream(ABC):
    """What an HTTP request and a WebTransport stream have in common."""

    abort_code: int
    """The error code for a stream whose task ends before the stream is finished."""

    def __init__(self, outlet: Outlet) -> None:
        self.outlet = outlet
        self.task: asyncio.Task[None] | None = None

    @abstractmethod
    def data_received(self, data: bytes, ended: bool) -> None:
        """The next part of what the client sends; `ended` with the last."""

    @abstractmethod
    def cancelled(self) -> None:
        """The client wants no answer any more, has reset its side, or is gone."""

    @abstractmethod
    async def run(self) -> None:
        """Answer the client. What is not finished when it returns is reset."""
