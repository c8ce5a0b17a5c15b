"""One end of a pipe on the event loop: messages out in batches, messages in one by one, and one sentence at its end."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from typing import Final, cast

from tigas_render.pipe.framing import BadMessage, Splitter

MOST_UNSENT: Final = 8 * 1024 * 1024
"""Bytes that may wait for an end that does not read; then it is given up."""

DELAY_S: Final = 0.01
"""Maximum wait of a message that is not urgent for an urgent one."""


class Link(asyncio.Protocol, ABC):
    """A subclass handles messages; `connection_lost` comes once, however the pipe ends."""

    def __init__(self, most_bytes: int) -> None:
        """most_bytes: in a message that is received."""
        self._splitter = Splitter(most_bytes)
        self._outgoing: list[bytes] = []
        self._outgoing_bytes = 0
        self._is_leaving = self._is_delayed = False
        """Whether outgoing messages are about to be written, or will be after a pause."""
        self._loop = asyncio.get_running_loop()
        self._transport: asyncio.Transport | None = None
        self.reason: str | None = None
        """Why this end has closed the pipe, in a sentence."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)

    @abstractmethod
    def received(self, kind: int, content: bytes) -> None:
        """A message. Raises BadMessage."""

    def send(self, message: bytes) -> None:
        """Send a message with all others of this iteration of the event loop; dropped once the pipe is closed."""
        if self._add(message) and not self._is_leaving:
            self._is_leaving = True
            self._loop.call_soon(self._flush)

    def send_with_next(self, message: bytes) -> None:
        """Send a message with the next that is more urgent, or after a while: each write wakes the other end."""
        if self._add(message) and not (self._is_leaving or self._is_delayed):
            self._is_delayed = True
            self._loop.call_later(DELAY_S, self._flush_delayed)

    def _add(self, message: bytes) -> bool:
        if self._transport is not None and self._transport.is_closing():
            return False
        self._outgoing.append(message)
        self._outgoing_bytes += len(message)
        return True

    @property
    def unsent(self) -> int:
        """Bytes not read by the other end yet."""
        return self._outgoing_bytes + (0 if self._transport is None else self._transport.get_write_buffer_size())

    def data_received(self, data: bytes) -> None:
        try:
            for kind, content in self._splitter.feed(data):
                self.received(kind, content)
        except BadMessage as error:
            self.abort(str(error))

    def abort(self, reason: str) -> None:
        """End the pipe at once."""
        self.reason = self.reason or reason
        if self._transport is not None:
            self._transport.abort()

    def _flush_delayed(self) -> None:
        self._is_delayed = False
        if not self._is_leaving:
            self._flush()

    def _flush(self) -> None:
        self._is_leaving = False
        messages, self._outgoing, self._outgoing_bytes = self._outgoing, [], 0
        if not messages or self._transport is None or self._transport.is_closing():
            return
        self._transport.write(b"".join(messages))
        if self.unsent > MOST_UNSENT:
            self.abort("The other end does not read.")
