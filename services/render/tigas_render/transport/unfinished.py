"""Streams opened by a client without a complete first frame: they count against limits and time out."""

from __future__ import annotations


class UnfinishedStreams:
    """Since when each of a connection's streams has been waiting for its first frame. Times are in seconds."""

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        self._since: dict[int, float] = {}
        """By stream, the oldest first."""

    def __len__(self) -> int:
        return len(self._since)

    def __contains__(self, stream_id: int) -> bool:
        return stream_id in self._since

    def begin(self, stream_id: int, now: float) -> None:
        """Something has arrived on a stream, and it is not enough; the time since the first counts."""
        self._since.setdefault(stream_id, now)

    def end(self, stream_id: int) -> None:
        """A stream waits no longer, if it did."""
        self._since.pop(stream_id, None)

    def clear(self) -> None:
        """No stream waits any longer."""
        self._since.clear()

    @property
    def deadline(self) -> float | None:
        """When `late` is to be asked next."""
        return next((since + self._timeout for since in self._since.values()), None)

    def late(self, now: float) -> list[int]:
        """The streams that have waited too long."""
        return [stream_id for stream_id, since in self._since.items() if since + self._timeout <= now]
