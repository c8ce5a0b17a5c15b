"""Which request is rendered next: every client in turn, each client's newest request first. No clock, no threads."""

from __future__ import annotations

from collections import OrderedDict
from typing import Generic, TypeVar

Work = TypeVar("Work")


class FairSchedule(Generic[Work]):
    """Waiting work by client. Clients take turns; a client's newest work goes first: it is what the viewer waits for.

    Each client keeps at most `depth` waiting items: the newest wins, so one more pushes its oldest out.
    """

    def __init__(self, depth: int) -> None:
        self._depth = depth
        # Each client's work, oldest first; the clients in the order of their turns.
        self._clients: OrderedDict[str, list[Work]] = OrderedDict()
        self._length = 0

    def __len__(self) -> int:
        return self._length

    def push(self, client: str, work: Work) -> Work | None:
        """Add a client's newest work; returns the work that it pushed out, if any."""
        waiting = self._clients.setdefault(client, [])
        waiting.append(work)
        if len(waiting) > self._depth:
            return waiting.pop(0)
        self._length += 1
        return None

    def pop(self) -> Work:
        """Take the newest work of the client whose turn it is; that client goes to the end of the line.

        Raises IndexError if nothing waits.
        """
        if not self._clients:
            raise IndexError("nothing waits")
        client, waiting = next(iter(self._clients.items()))
        work = waiting.pop()
        self._length -= 1
        if waiting:
            self._clients.move_to_end(client)
        else:
            del self._clients[client]
        return work

    def remove(self, client: str, work: Work) -> bool:
        """Withdraw work that no longer matters; False if it does not wait any more."""
        waiting = self._clients.get(client, [])
        if work not in waiting:
            return False
        waiting.remove(work)
        self._length -= 1
        if not waiting:
            del self._clients[client]
        return True
