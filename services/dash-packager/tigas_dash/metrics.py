"""The packager's Prometheus metrics: present streams, and totals since the start."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import get_args

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from tigas_common.metrics import SceneNames, labelled_gauge
from tigas_dash.stream import Stream, Transport

_OF_RUNGS = ("scene", "rung", "transport")
COUNTERS: Mapping[str, tuple[str, Sequence[str]]] = {
    "frames": ("Encoded frames, in each representation", _OF_RUNGS),
    "sent_bytes": ("Sent bytes of segments or datagrams", _OF_RUNGS),
    "repeated_frames": ("Frames that repeat the last view, as there was no newer one", ("transport",)),
    "dropped_frames": ("Frames skipped because the stream was late", ("transport",)),
    "poses": ("Poses received from viewers", ("transport",)),
    "render_failures": ("Requests that the render service did not answer with a frame", ("transport",)),
    "encoder_failures": ("Frames that an encoder refused", ("transport",)),
}
"""Help text and labels of each counter, without its prefix."""


class DashMetrics(Collector):
    """Of all streams of a packager. Nothing is counted here while they run."""

    def __init__(self, streams: Callable[[], Sequence[Stream]], limit: int) -> None:
        """streams: the running ones; limit: their maximum number."""
        self._streams = streams
        self._limit = limit
        self._past: Counter[tuple[str, tuple[str, ...]]] = Counter()
        """Totals of ended streams, by counter and labels."""
        self._scenes = SceneNames()

    def ended(self, stream: Stream) -> None:
        self._past.update(self._counts(stream))

    def collect(self) -> Iterator[Metric]:
        streams, totals = self._streams(), self._past.copy()
        for stream in streams:
            totals.update(self._counts(stream))
        for name, (text, labels) in COUNTERS.items():
            family = CounterMetricFamily(f"tigas_dash_{name}", text, labels=labels)
            for (counter, values), total in totals.items():
                if counter == name:
                    family.add_metric(values, total)
            yield family
        alike = {name: [each for each in streams if each.transport == name] for name in get_args(Transport)}
        running = {name: len(own) for name, own in alike.items()}
        yield labelled_gauge("tigas_dash_sessions", "Running streams", "transport", running)
        behind = {name: max((each.behind_s for each in own), default=0.0) for name, own in alike.items()}
        text = "How overdue the latest frame is"
        yield labelled_gauge("tigas_dash_behind_seconds", text, "transport", behind)
        yield GaugeMetricFamily("tigas_dash_session_limit", "Maximum number of streams", self._limit)

    def _counts(self, stream: Stream) -> Counter[tuple[str, tuple[str, ...]]]:
        status, transport = stream.status, stream.transport
        scene = self._scenes.label(status.scene)
        counts: Counter[tuple[str, tuple[str, ...]]] = Counter()
        for rung in stream.rungs:
            counts["frames", (scene, str(rung), transport)] += status.frames
            counts["sent_bytes", (scene, str(rung), transport)] = stream.sent_bytes[rung]
        counts["repeated_frames", (transport,)] = status.repeated
        counts["dropped_frames", (transport,)] = status.dropped
        for name in ("poses", "render_failures", "encoder_failures"):
            counts[name, (transport,)] = getattr(status, name)
        return counts
