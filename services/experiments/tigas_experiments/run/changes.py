"""What was changed since the runs that an experiment keeps: unlike runs must not be taken together unseen."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from tigas_experiments.records.folder import RunRecord
from tigas_experiments.records.machine import Server


@dataclass(frozen=True, slots=True)
class MadeWith:
    """What runs are made with now."""

    commit: str | None
    """Of the experiment's own code."""
    browser: str
    server: Server
    scene_bytes: Mapping[str, int | None]
    """Of each scene's file."""


def changes(kept: Iterable[RunRecord], now: MadeWith) -> list[str]:
    """What differs, each with what it was and what it is; what is unknown differs from nothing."""
    found: dict[str, str] = {}

    def compare(what: str, was: object, new: object) -> None:
        if was is not None and new is not None and was != new:
            found.setdefault(what, f"{what} ({was}, now {new})")

    for record in kept:
        compare("commit", record.machine.commit, now.commit)
        compare("browser", record.browser, now.browser)
        if record.server is not None:
            compare("render service's commit", record.server.commit, now.server.commit)
            compare("ladder", _rungs(record.server), _rungs(now.server))
        scene = record.configuration.scene
        compare(f"scene {scene}", _size(record.scene_bytes), _size(now.scene_bytes.get(scene)))
    return list(found.values())


def _rungs(server: Server) -> str:
    return ", ".join(f"{rung.width}x{rung.height} q{rung.quality}" for rung in server.ladder)


def _size(size: int | None) -> str | None:
    return None if size is None else f"{size:,} bytes"
