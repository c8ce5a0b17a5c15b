"""Merged answers of a host's engines. No sockets: bodies in, a body out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector
from pydantic import TypeAdapter

from tigas_common.aggregate import merged_scene, merged_scenes
from tigas_common.wire.cluster import HostLoad
from tigas_common.wire.render import SceneInfo, Training
from tigas_render.pipe.remote_engine import RemoteEngine

TRAININGS = ("running", "failed", "done", "idle")
"""The states of a training, which only one engine knows, the ones that count first."""
_SCENES = TypeAdapter(list[SceneInfo])


class Part(NamedTuple):
    """The answer of one engine."""

    engine: str
    body: bytes


def scenes(parts: Sequence[Part]) -> bytes:
    """Merge lists of scenes."""
    return _SCENES.dump_json(merged_scenes(_SCENES.validate_json(part.body) for part in parts))


def scene(parts: Sequence[Part]) -> bytes:
    """Merge descriptions of one scene."""
    return merged_scene([SceneInfo.model_validate_json(part.body) for part in parts]).model_dump_json().encode()


def training(parts: Sequence[Part]) -> bytes:
    """Merge states of a scene's training."""
    states = [Training.model_validate_json(part.body) for part in parts]
    return min(states, key=lambda each: TRAININGS.index(each.state)).model_dump_json().encode()


def is_running(body: bytes) -> bool:
    """Whether a training runs."""
    return Training.model_validate_json(body).state == "running"


def load(parts: Sequence[Part]) -> bytes:
    """Merge the load of the host: each engine knows all edges, but only its own scenes."""
    loads = [HostLoad.model_validate_json(part.body) for part in parts]
    loaded = tuple(sorted({scene for each in loads for scene in each.scenes}))
    return loads[0].model_copy(update={"scenes": loaded}).model_dump_json().encode()


def metrics(parts: Sequence[Part], engines: Sequence[RemoteEngine]) -> bytes:
    """Merge Prometheus' text format: metrics of engines get a label `device`, and those of edges appear once."""
    registry = CollectorRegistry()
    registry.register(_Metrics(parts, engines))
    return generate_latest(registry)


class _Metrics(Collector):
    def __init__(self, parts: Sequence[Part], engines: Sequence[RemoteEngine]) -> None:
        self._parts = parts
        self._engines = engines

    def collect(self) -> Iterator[Metric]:
        families: dict[str, Metric] = {}
        for number, part in enumerate(self._parts):
            for family in text_string_to_metric_families(part.body.decode()):
                together = families.setdefault(family.name, Metric(family.name, family.documentation, family.type))
                for sample in family.samples:
                    if "edge" not in sample.labels:
                        labels = {**sample.labels, "device": part.engine}
                        together.add_sample(sample.name, labels, sample.value, sample.timestamp, sample.exemplar)
                    elif number == 0:
                        together.samples.append(sample)
        yield from families.values()
        yield from self._devices()

    def _devices(self) -> Iterator[Metric]:
        up = GaugeMetricFamily("tigas_render_device_up", "Whether its engine runs", labels=["device"])
        shares = GaugeMetricFamily(
            "tigas_render_device_utilisation_ratio", "Share of the time at work, 0 to 1", labels=["device"]
        )
        ages = GaugeMetricFamily(
            "tigas_render_device_queue_age_seconds", "How long a client waits for its turn", labels=["device"]
        )
        for engine in self._engines:
            up.add_metric([engine.name], engine.pipe.is_connected)
            if engine.pipe.is_connected:
                shares.add_metric([engine.name], engine.utilisation)
                ages.add_metric([engine.name], engine.age_s)
        yield from (up, shares, ages)
