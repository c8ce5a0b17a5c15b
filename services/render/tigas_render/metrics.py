"""What the service counts, in Prometheus' terms."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Histogram

from tigas_render.frame import Frame

BUCKETS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.033, 0.05, 0.1, 0.2, 0.5, 1, 2, 5)


class EngineMetrics:
    """The engine's counters and histograms, in a registry of their own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self._requests = Counter(
            "tigas_requests", "Render requests by how they ended", ["outcome"], registry=self.registry
        )
        self._bytes = Counter("tigas_frame_bytes", "Bytes of all frames", registry=self.registry)
        self._seconds = Histogram(
            "tigas_frame_seconds", "Time of a frame by stage", ["stage"], registry=self.registry, buckets=BUCKETS
        )
        # Looked up once: at thousands of frames a second that would be half of what the event loop does.
        self._frames = self._requests.labels("frame")
        self._stages = [(stage, self._seconds.labels(stage)) for stage in ("queue", "render", "encode")]

    def count(self, outcome: str) -> None:
        """One request that ended without a frame, by the error's type or `cancelled`."""
        self._requests.labels(outcome).inc()

    def frame(self, frame: Frame) -> None:
        """One frame that was answered."""
        self._frames.inc()
        self._bytes.inc(len(frame.body))
        for stage, seconds in self._stages:
            seconds.observe(getattr(frame.timing, stage) / 1000)
