"""Puts together what each engine of a host knows. No sockets: bodies in, a body out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector
from pydantic import TypeAdapter

from tigas_common.wire.cluster import HostLoad
from tigas_common.wire.render import SceneInfo, Training
from tigas_render.pipe.engines import Engine

STATES = ("loaded", "loading", "unloaded", "broken")
"""A scene's, the best first: it is what it is on any device."""
TRAININGS = ("running", "failed", "done", "idle")
"""A training's: only one engine knows of it."""
_SCENES = TypeAdapter(list[SceneInfo])


class Part(NamedTuple):
    """What one engine answered."""

    engine: str
    body: bytes


def scenes(parts: Sequence[Part]) -> bytes:
    """All scenes, by id."""
    found: dict[str, list[SceneInfo]] = {}
    for part in parts:
        for info in _SCENES.validate_json(part.body):
            found.setdefault(info.id, []).append(info)
    return _SCENES.dump_json([_together(found[id]) for id in sorted(found)])


def scene(parts: Sequence[Part]) -> bytes:
    """One scene."""
    return _together([SceneInfo.model_validate_json(part.body) for part in parts]).model_dump_json().encode()


def training(parts: Sequence[Part]) -> bytes:
    """A scene's training."""
    states = [Training.model_validate_json(part.body) for part in parts]
    return min(states, key=lambda each: TRAININGS.index(each.state)).model_dump_json().encode()


def is_running(body: bytes) -> bool:
    """Whether that is a training which runs."""
    return Training.model_validate_json(body).state == "running"


def load(parts: Sequence[Part]) -> bytes:
    """How busy the host is: engines hear of all edges, but each knows only its own scenes."""
    loads = [HostLoad.model_validate_json(part.body) for part in parts]
    loaded = tuple(sorted({scene for each in loads for scene in each.scenes}))
    return loads[0].model_copy(update={"scenes": loaded}).model_dump_json().encode()


def metrics(parts: Sequence[Part], engines: Sequence[Engine]) -> bytes:
    """Prometheus' text format. What an engine counts has a label `device`; what edges told all is there once."""
    registry = CollectorRegistry()
    registry.register(_Metrics(parts, engines))
    return generate_latest(registry)


class _Metrics(Collector):
    def __init__(self, parts: Sequence[Part], engines: Sequence[Engine]) -> None:
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


def _together(infos: Sequence[SceneInfo]) -> SceneInfo:
    """One scene, as each engine has it. What is known once it was loaded, any may know."""
    best = min(infos, key=lambda info: STATES.index(info.state))
    known = {
        name: next((value for info in infos if (value := getattr(info, name)) is not None), None)
        for name in ("gaussians", "sh_degree", "camera", "file_sha256")
        if getattr(best, name) is None
    }
    if best.state == "loading":
        known["progress"] = max(info.progress or 0 for info in infos)
    return best.model_copy(update={**known, "memory_bytes": sum(info.memory_bytes for info in infos)})
