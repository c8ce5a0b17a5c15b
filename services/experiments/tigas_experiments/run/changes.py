"""What was changed since the runs that an experiment keeps: unlike runs must not be taken together unseen."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from tigas_common.wire.render import Rung, SceneInfo
from tigas_experiments.records.folder import RunRecord
from tigas_experiments.records.machine import Server


@dataclass(frozen=True, slots=True)
class MadeWith:
    """What runs are made with now."""

    commit: str | None
    """Of the experiment's own code."""
    browser: str
    server: Server
    scenes: Mapping[str, SceneInfo]
    """By their ids, loaded, so that the digests of their files are known."""


def changes(kept: Iterable[RunRecord], now: MadeWith) -> list[str]:
    """What differs, each with what it was and what it is; what is unknown differs from nothing."""
    found: dict[str, str] = {}

    def compare(what: str, was: object, new: object) -> None:
        if was is not None and new is not None and was != new:
            found.setdefault(what, f"{what} ({was}, now {new})")

    for record in kept:
        scene = now.scenes.get(record.configuration.scene)
        compare("commit", record.machine.commit, now.commit)
        compare("browser", record.browser, now.browser)
        if record.server is not None:
            compare("render service's commit", record.server.commit, now.server.commit)
            own = scene.ladder if scene is not None else None
            compare("ladder", _rungs(record.server.ladder), _rungs(own or now.server.ladder))
        if scene is not None:
            compare(f"scene {scene.id}", _size(record.scene_bytes), _size(scene.file_bytes))
            compare(f"scene {scene.id}", _digest(record.scene_sha256), _digest(scene.file_sha256))
    return list(found.values())


def _rungs(ladder: Iterable[Rung]) -> str:
    return ", ".join(f"{rung.width}x{rung.height} q{rung.quality}" for rung in ladder)


def _size(size: int | None) -> str | None:
    return None if size is None else f"{size:,} bytes"


def _digest(sha256: str | None) -> str | None:
    return None if sha256 is None else f"SHA-256 {sha256[:12]}…"
