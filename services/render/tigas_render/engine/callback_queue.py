"""Calls from any thread to the event loop, in batches: one wakeup for all items until the loop reads them."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")

logger = logging.getLogger(__name__)


class CallbackQueue(Generic[Item]):
    """Passes items from threads to `receive`, in order, on the event loop that created it.

    A wakeup costs the thread a system call, and with it the interpreter's lock.
    """

    def __init__(self, receive: Callable[[Item], None]) -> None:
        self._receive = receive
        self._loop = asyncio.get_running_loop()
        self._items: deque[Item] = deque()
        self._is_woken = False

    def put(self, item: Item) -> None:
        """Hand over an item, from any thread; the loop receives it soon, never at once."""
        self._items.append(item)
        if not self._is_woken:
            self._is_woken = True
            self._loop.call_soon_threadsafe(self.deliver)

    def deliver(self) -> None:
        """Receive all items so far. On the event loop."""
        self._is_woken = False  # first of all: the thread of any later item wakes the loop again
        for _ in range(len(self._items)):
            try:
                self._receive(self._items.popleft())
            except Exception:  # the others' answers are not to be lost with one
                logger.exception("An answer was not delivered")
