"""Breakdown of frame age: the mean of each part, over the frames that first showed a new pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tigas_experiments.wire.recording import Input, Reply, ShownFrame

PART_TITLES = {
    "wait": "Wait for a request",
    "queue": "Server queue",
    "render": "Rendering",
    "encode": "Encoding",
    "network": "Network",
    "enhance": "Enhancement",
    "page": "Page and display",
}


@dataclass(frozen=True, slots=True)
class LatencyParts:
    """Consecutive parts in ms; their sum is the mean age of these frames."""

    wait: float
    """From the input to the request, while the limit of requests in flight is reached."""
    queue: float
    render: float
    encode: float
    network: float
    """Both directions, including the server's time outside queue, rendering and encoding."""
    enhance: float
    """The page's enhancement; 0 without it."""
    page: float
    """The remainder from the last byte to the screen: decoding and the next display refresh."""

    @classmethod
    def of(cls, inputs: Sequence[Input], frames: Sequence[ShownFrame], replies: Sequence[Reply]) -> LatencyParts | None:
        """Parts from a run's records; None without server times, as in DASH."""
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
