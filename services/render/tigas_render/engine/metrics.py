"""The engine's metrics: counters and histograms for Prometheus, and utilisation."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from itertools import accumulate

from prometheus_client.core import CounterMetricFamily, HistogramMetricFamily
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

from tigas_common.metrics import SceneNames
from tigas_render.frame import Frame, Transport

BUCKETS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.033, 0.05, 0.1, 0.2, 0.5, 1, 2, 5)
BOUNDS = [*map(str, map(float, BUCKETS)), "+Inf"]


class DurationHistogram:
    """A histogram of durations in seconds."""

    def __init__(self) -> None:
        self.sum = 0.0
        self._counts = [0] * len(BOUNDS)

    def add(self, seconds: float) -> None:
        self._counts[bisect_left(BUCKETS, seconds)] += 1
        self.sum += seconds

    @property
    def buckets(self) -> list[tuple[str, float]]:
        """Upper bounds, each with its cumulative count."""
        return list(zip(BOUNDS, accumulate(self._counts), strict=True))


class EngineMetrics(Collector):
    """The engine's counters and histograms.

    Thousands of frames are counted between two reads, all on one thread: prometheus_client's own counters, which take
    locks, would use a twentieth of the engine's CPU time.
    """

    def __init__(self) -> None:
        self._requests = {"frame": 0}
        """Number of requests by outcome."""
        self._frames: dict[tuple[str, int | None, Transport], list[int]] = {}
        """Number of frames and their total bytes, by scene, rung and transport."""
        self._scenes = SceneNames()
        self._queue, self._render, self._encode = DurationHistogram(), DurationHistogram(), DurationHistogram()

    def count_failure(self, outcome: str) -> None:
        """Count a request that ended without a frame. outcome: the error's type, or `cancelled`."""
        self._requests[outcome] = self._requests.get(outcome, 0) + 1

    def count_frame(self, scene: str, transport: Transport, frame: Frame) -> None:
        self._requests["frame"] += 1
        sums = self._frames.get((scene, frame.profile, transport))
        if sums is None:
            sums = self._frames.setdefault((self._scenes.label(scene), frame.profile, transport), [0, 0])
        sums[0] += 1
        sums[1] += len(frame.body)
        timing = frame.timing
        self._queue.add(timing.queue / 1000)
        self._render.add(timing.render / 1000)
        self._encode.add(timing.encode / 1000)

    def collect(self) -> Iterator[Metric]:
        requests = CounterMetricFamily("tigas_render_requests", "Render requests, by outcome", labels=["outcome"])
        for outcome, number in list(self._requests.items()):
            requests.add_metric([outcome], number)
        labels = ["scene", "rung", "transport"]
        frames = CounterMetricFamily("tigas_render_frames", "Frames sent", labels=labels)
        sizes = CounterMetricFamily("tigas_render_frame_bytes", "Their bytes", labels=labels)
        for (scene, rung, transport), (count, size) in list(self._frames.items()):
            values = [scene, "none" if rung is None else str(rung), transport]
            frames.add_metric(values, count)
            sizes.add_metric(values, size)
        seconds = HistogramMetricFamily("tigas_render_frame_seconds", "Time of a frame, by stage", labels=["stage"])
        for stage, times in (("queue", self._queue), ("render", self._render), ("encode", self._encode)):
            seconds.add_metric([stage], times.buckets, times.sum)
        yield from (requests, frames, sizes, seconds)


class Utilisation:
    """The share of time spent working. Starts out busy; all times are seconds of the same clock."""

    def __init__(self, now: float) -> None:
        self._read_at = now
        self._idle = 0.0
        """Idle seconds since the last call of `read`."""
        self._idle_since: float | None = None

    def mark_idle(self, now: float) -> None:
        if self._idle_since is None:
            self._idle_since = now

    def mark_busy(self, now: float) -> None:
        if self._idle_since is not None:
            self._idle += now - max(self._idle_since, self._read_at)
            self._idle_since = None

    def read(self, now: float) -> float:
        """The share of busy time since the last call, 0 to 1."""
        if self._idle_since is not None:
            self._idle += now - max(self._idle_since, self._read_at)
        passed, idle = now - self._read_at, self._idle
        self._read_at, self._idle = now, 0.0
        return 1 - idle / passed if passed > 0 else 0.0
