"""Where a frame's age comes from: the mean of each of its parts, over the frames that showed a new pose first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from tigas_common.wire.recording import Input, Reply, ShownFrame


@dataclass(frozen=True, slots=True)
class LatencyParts:
    """ms; their sum is the mean age of these frames."""

    wait: float
    """From the input to the request: as many are in flight as may be."""
    queue: float
    render: float
    encode: float
    network: float
    """Up and down, and what the server does beside the three."""
    enhance: float
    """What the page's enhancement took; 0 where it was off."""
    page: float
    """The rest from the last byte to the screen: decoding, and the display's next refresh."""

    @property
    def by_name(self) -> dict[str, float]:
        """In the order in which they follow one another."""
        return asdict(self)

    @classmethod
    def of(cls, inputs: Sequence[Input], frames: Sequence[ShownFrame], replies: Sequence[Reply]) -> LatencyParts | None:
        """None if no reply tells of the server's times, as in DASH."""
        sampled = {entry.pose: entry.at for entry in inputs if not entry.missed}
        answers = {reply.pose: reply for reply in reversed(replies) if reply.server is not None}  # the first of a pose
        found = []
        newest = -1
        for frame in frames:
            reply, at = answers.get(frame.pose), sampled.get(frame.pose)
            if frame.pose > newest and at is not None and reply is not None and reply.at <= frame.at:
                assert reply.server is not None
                queue, render, encode = reply.server.queue, reply.server.render, reply.server.encode
                network = reply.time_ms - queue - render - encode
                enhance = min(frame.enhance_ms or 0.0, frame.at - reply.at)
                page = frame.at - reply.at - enhance
                found.append((reply.asked_at - at, queue, render, encode, network, enhance, page))
            newest = max(newest, frame.pose)
        if not found:
            return None
        return cls(*(sum(column) / len(found) for column in zip(*found, strict=True)))


PART_TITLES = {
    "wait": "Wait for a request",
    "queue": "Server's queue",
    "render": "Rendering",
    "encode": "Encoding",
    "network": "Network",
    "enhance": "Enhancement",
    "page": "Page and display",
}
