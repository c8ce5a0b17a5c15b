"""A registry over sources that a test makes up."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from tests.render.scenes import plys
from tigas_render.gaussians import Batches
from tigas_render.raster.base import PreparedScene
from tigas_render.scenes.registry import SceneRegistry
from tigas_render.scenes.scene_file import Listener
from tigas_render.scenes.source import SceneMetadata, SceneSource
from tigas_render.scenes.start_view.view import StartViewCache


@dataclass
class Packed(PreparedScene):
    """Takes one byte for each Gaussian."""

    count: int

    @property
    def nbytes(self) -> int:
        return self.count


@dataclass
class Bench:
    """A registry over sources that the test makes up: opening one waits at its gate, if it has one."""

    budget: int = 1000
    now: float = 0.0
    opened: list[str] = field(default_factory=list)
    started: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(0))
    gates: dict[str, threading.Event] = field(default_factory=dict)
    errors: dict[str, Exception] = field(default_factory=dict)
    builtin: dict[str, SceneSource] = field(default_factory=dict)

    @classmethod
    def of(cls, *ids: str) -> Self:
        """With these scenes."""
        bench = cls()
        for id in ids:
            bench.add(id)
        return bench

    def add(self, id: str, count: int = 100, estimate: int | None = None) -> None:
        def open(listener: Listener) -> Batches:
            self.opened.append(id)
            self.started.release()
            if id in self.gates:
                assert self.gates[id].wait(10)
            if id in self.errors:
                raise self.errors[id]
            return plys.gaussians(count).batches()

        size = count if estimate is None else estimate
        self.builtin[id] = SceneSource(id, SceneMetadata(), "1", open, sh_degree=0, memory_bytes=size)

    def registry(
        self, directory: Path | None = None, *, own_ladders: bool = True, views: StartViewCache | None = None
    ) -> SceneRegistry:
        return SceneRegistry(
            directory,
            lambda scene: Packed(len(scene.read_all())),
            builtin=self.builtin,
            own_ladders=own_ladders,
            views=views,
            memory_budget=self.budget,
            idle_s=60,
            clock=lambda: self.now,
        )


def states(registry: SceneRegistry) -> dict[str, str]:
    """State of each scene, by id."""
    return {info.id: info.state for info in registry.scene_infos()}
