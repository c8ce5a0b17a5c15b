"""How the render service is, for Prometheus: requests that are not answered, scenes and their memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from tigas_render.engine.engine import Engine
from tigas_render.scenes.registry import SceneRegistry


class StateMetrics(Collector):
    """Of one engine and the scenes that it knows."""

    def __init__(self, engine: Engine, scenes: SceneRegistry) -> None:
        self._engine = engine
        self._scenes = scenes

    def collect(self) -> Iterator[Metric]:
        """The present values."""
        waiting = GaugeMetricFamily(
            "tigas_render_requests_in_flight", "Unanswered requests, by stage", labels=["stage"]
        )
        for stage, number in self._engine.in_flight.items():
            waiting.add_metric([stage], number)
        scenes = GaugeMetricFamily("tigas_render_scenes", "Scenes that are offered, by state", labels=["state"])
        for state, number in Counter(info.state for info in self._scenes.infos()).items():
            scenes.add_metric([state], number)
        memory = GaugeMetricFamily("tigas_render_scene_memory_bytes", "Memory of a scene", labels=["scene"])
        for scene, size in self._scenes.memory().items():
            memory.add_metric([scene], size)
        yield from (waiting, scenes, memory)
        yield GaugeMetricFamily(
            "tigas_render_scene_memory_limit_bytes", "Memory limit of all scenes together", self._scenes.budget
        )
