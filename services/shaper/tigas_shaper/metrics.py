"""The shaper's Prometheus metrics: the link's state, and its traffic."""

from __future__ import annotations

from collections.abc import Iterator
from typing import get_args

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from tigas_common.wire.shaper import PlaybackMode
from tigas_shaper.service import Shaper

BYTES_PER_KBIT = 125


class ShaperMetrics(Collector):
    """Of one link. Names of traces are no labels: anybody may upload some."""

    def __init__(self, shaper: Shaper) -> None:
        self._shaper = shaper

    def collect(self) -> Iterator[Metric]:
        status, sent = self._shaper.status(), self._shaper.sent_bytes
        link, directions = status.link, {"down": status.down, "up": status.up}
        crossed = CounterMetricFamily("tigas_shaper_sent_bytes", "Bytes that crossed the link", labels=["direction"])
        drops = CounterMetricFamily(
            "tigas_shaper_dropped_packets", "Packets that were lost, as the queue was full", labels=["direction"]
        )
        rates = GaugeMetricFamily(
            "tigas_shaper_rate_bytes_per_second", "Present capacity of the link", labels=["direction"]
        )
        queues = GaugeMetricFamily("tigas_shaper_queue_bytes", "Bytes that wait", labels=["direction"])
        ages = GaugeMetricFamily(
            "tigas_shaper_queue_age_seconds", "Queueing delay of a packet arriving now", labels=["direction"]
        )
        for name, direction in directions.items():
            crossed.add_metric([name], sent[name])
            drops.add_metric([name], direction.drops)
            rates.add_metric([name], direction.target_kbps * BYTES_PER_KBIT)
            queues.add_metric([name], direction.queue_bytes)
            ages.add_metric([name], direction.queue_ms / 1000)
        modes = GaugeMetricFamily("tigas_shaper_playback", "Playback state: 1 for the present one", labels=["mode"])
        for mode in get_args(PlaybackMode):
            modes.add_metric([mode], mode == status.mode)
        yield from (crossed, drops, rates, queues, ages, modes)
        yield GaugeMetricFamily("tigas_shaper_delay_seconds", "One-way delay that is added", link.delay_ms / 1000)
        yield GaugeMetricFamily("tigas_shaper_loss_ratio", "Share of packets that is lost", link.loss_pct / 100)
        yield GaugeMetricFamily("tigas_shaper_link_up", "Whether anything passes at all", status.closed is None)
