"""The shaper's Prometheus metrics: the link's state, and its traffic."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import get_args

from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from tigas_common.metrics import labelled_counter, labelled_gauge
from tigas_common.wire.shaper import DirectionStatus, PlaybackMode
from tigas_shaper.service import Shaper

BYTES_PER_KBIT = 125


class ShaperMetrics(Collector):
    """Of one link. Names of traces are no labels: anybody may upload some."""

    def __init__(self, shaper: Shaper) -> None:
        self._shaper = shaper

    def collect(self) -> Iterator[Metric]:
        status, sent = self._shaper.status(), self._shaper.sent_bytes
        link, directions = status.link, {"down": status.down, "up": status.up}

        def of_each(value: Callable[[DirectionStatus], float]) -> dict[str, float]:
            return {name: value(direction) for name, direction in directions.items()}

        drops, rates = of_each(lambda one: one.drops), of_each(lambda one: one.target_kbps * BYTES_PER_KBIT)
        waiting, ages = of_each(lambda one: one.queue_bytes), of_each(lambda one: one.queue_ms / 1000)
        modes = {mode: mode == status.mode for mode in get_args(PlaybackMode)}
        yield labelled_counter("tigas_shaper_sent_bytes", "Delivered bytes", "direction", sent)
        yield labelled_counter("tigas_shaper_dropped_packets", "Packets dropped by a full queue", "direction", drops)
        yield labelled_gauge("tigas_shaper_rate_bytes_per_second", "Current rate of the link", "direction", rates)
        yield labelled_gauge("tigas_shaper_queue_bytes", "Waiting bytes", "direction", waiting)
        yield labelled_gauge(
            "tigas_shaper_queue_age_seconds", "Queueing delay of a packet arriving now", "direction", ages
        )
        yield labelled_gauge("tigas_shaper_playback", "Playback state: 1 for the current one", "mode", modes)
        yield GaugeMetricFamily("tigas_shaper_delay_seconds", "Added one-way delay", link.delay_ms / 1000)
        yield GaugeMetricFamily("tigas_shaper_loss_ratio", "Share of packets lost at random", link.loss_pct / 100)
        yield GaugeMetricFamily("tigas_shaper_link_up", "Whether the link is open", status.closed is None)
