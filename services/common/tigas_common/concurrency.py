"""A limit on concurrent work."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from tigas_common.errors import TigasError


class ConcurrencyLimit:
    """Counts concurrent work, in total and for each client."""

    def __init__(self, most: int, most_per_client: int) -> None:
        self._most = most
        self._most_per_client = most_per_client
        self._running: Counter[str] = Counter()

    @contextmanager
    def one_more(self, client: str, refusal: TigasError) -> Iterator[None]:
        """Count one item, as a context manager. Raises `refusal` above the limit."""
        if self._running.total() >= self._most or self._running[client] >= self._most_per_client:
            raise refusal
        self._running[client] += 1
        try:
            yield
        finally:
            self._running[client] -= 1
            if not self._running[client]:
                del self._running[client]
