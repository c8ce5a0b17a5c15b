"""The packager's Prometheus metrics: present streams, and totals since the start."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, Literal, Protocol

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from tigas_common.metrics import SceneNames
from tigas_common.wire.dash import SessionStatus

Transport = Literal["dash", "webrtc"]
TRANSPORTS: Final[tuple[Transport, ...]] = ("dash", "webrtc")

COUNTERS: Mapping[str, tuple[str, Sequence[str]]] = {
    "tigas_dash_frames": ("Frames that were encoded, in each representation", ("scene", "rung", "transport")),
    "tigas_dash_sent_bytes": ("Bytes of segments or datagrams that were sent", ("scene", "rung", "transport")),
    "tigas_dash_repeated_frames": ("Frames that show the last view again, as no newer came", ("transport",)),
    "tigas_dash_dropped_frames": ("Frames that were left out, as the stream was late", ("transport",)),
    "tigas_dash_poses": ("Poses that came from viewers", ("transport",)),
    "tigas_dash_render_failures": ("Requests that the render service did not answer with a frame", ("transport",)),
    "tigas_dash_encoder_failures": ("Frames that an encoder refused", ("transport",)),
}
"""Help text and labels of each counter."""


class CountedStream(Protocol):
    """The required interface of a stream."""

    @property
    def transport(self) -> Transport:
        """How it reaches its viewer."""

    @property
    def rungs(self) -> Sequence[int]:
        """Its rungs, one per representation."""

    @property
    def sent_bytes(self) -> Mapping[int, int]:
        """By rung."""

    @property
    def behind_s(self) -> float:
        """For how long its next frame has been due, in seconds."""

    @property
    def status(self) -> SessionStatus:
        """How it does."""


class DashMetrics(Collector):
    """Of all streams of a packager. Nothing is counted here while they run."""

    def __init__(self, streams: Callable[[], Sequence[CountedStream]], limit: int) -> None:
        """streams: the running ones; limit: their maximum number."""
        self._streams = streams
        self._limit = limit
        self._past: Counter[tuple[str, tuple[str, ...]]] = Counter()
        """Totals of ended streams, by counter and labels."""
        self._scenes = SceneNames()

    def ended(self, stream: CountedStream) -> None:
        """A stream runs no more."""
        self._past.update(self._counts(stream))

    def collect(self) -> Iterator[Metric]:
        """The present values."""
        streams, totals = self._streams(), self._past.copy()
        for stream in streams:
            totals.update(self._counts(stream))
        for name, (tells, labels) in COUNTERS.items():
            family = CounterMetricFamily(name, tells, labels=labels)
            for (counter, values), total in totals.items():
                if counter == name:
                    family.add_metric(values, total)
            yield family
        running = GaugeMetricFamily("tigas_dash_sessions", "Streams that run", labels=["transport"])
        behind = GaugeMetricFamily(
            "tigas_dash_behind_seconds", "For how long the most belated frame has been due", labels=["transport"]
        )
        for transport in TRANSPORTS:
            alike = [stream for stream in streams if stream.transport == transport]
            running.add_metric([transport], len(alike))
            behind.add_metric([transport], max((stream.behind_s for stream in alike), default=0.0))
        yield from (running, behind)
        yield GaugeMetricFamily("tigas_dash_session_limit", "Streams that may run", self._limit)

    def _counts(self, stream: CountedStream) -> Counter[tuple[str, tuple[str, ...]]]:
        status, transport = stream.status, stream.transport
        scene = self._scenes.label(status.scene)
        counts: Counter[tuple[str, tuple[str, ...]]] = Counter()
        for rung in stream.rungs:
            counts["tigas_dash_frames", (scene, str(rung), transport)] += status.frames
        for rung, size in stream.sent_bytes.items():
            counts["tigas_dash_sent_bytes", (scene, str(rung), transport)] += size
        counts["tigas_dash_repeated_frames", (transport,)] += status.repeated
        counts["tigas_dash_dropped_frames", (transport,)] += status.dropped
        counts["tigas_dash_poses", (transport,)] += status.poses
        counts["tigas_dash_render_failures", (transport,)] += status.render_failures
        counts["tigas_dash_encoder_failures", (transport,)] += status.encoder_failures
        return counts
