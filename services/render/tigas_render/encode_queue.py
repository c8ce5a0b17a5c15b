"""Images that wait to be encoded, in their order; but no address takes all encoders, if there are several."""

from __future__ import annotations

import threading
from typing import Generic, TypeVar

Item = TypeVar("Item")


class EncodeQueue(Generic[Item]):
    """Between the thread that renders and those that encode: a large picture takes one for a tenth of a second."""

    def __init__(self, encoders: int) -> None:
        self._most = max(1, encoders - 1)
        """Encoders that one address may have at work."""
        self._waiting: list[tuple[str, Item]] = []
        self._at_work: dict[str, int] = {}
        self._changed = threading.Condition()
        self._closed = False

    def put(self, address: str, item: Item) -> None:
        """Add an address's image."""
        with self._changed:
            self._waiting.append((address, item))
            self._changed.notify()

    def take(self) -> tuple[str, Item] | None:
        """Wait for an image that may be encoded now; `done` must follow. None once the queue is closed and empty."""
        with self._changed:
            while True:
                for position, (address, _) in enumerate(self._waiting):
                    at_work = self._at_work.get(address, 0)
                    if at_work < self._most:
                        self._at_work[address] = at_work + 1
                        return self._waiting.pop(position)
                if self._closed and not self._waiting:
                    return None
                self._changed.wait()

    def done(self, address: str) -> None:
        """An image of this address is encoded. Whoever says so takes the next: nobody is woken for it."""
        with self._changed:
            self._at_work[address] -= 1
            if not self._at_work[address]:
                del self._at_work[address]
            if self._closed:
                self._changed.notify_all()

    def close(self) -> None:
        """Nothing more is added."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
