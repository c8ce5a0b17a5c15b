"""Checks before the first run: whether the services can make all runs and have the same versions as earlier runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from tigas_common.errors import StartError
from tigas_common.wire.render import LadderName, Rung, SceneInfo
from tigas_experiments.records.folder import RunRecord
from tigas_experiments.records.machine import Server
from tigas_experiments.run.targets import Target
from tigas_experiments.wire.run import PER_VIEW, Configuration


@dataclass(frozen=True, slots=True)
class RunVersions:
    """Versions and inputs of new runs."""

    commit: str | None
    """Commit of the experiment's code."""
    browser: str | None
    """None if not known yet."""
    server: Server
    scenes: Mapping[str, SceneInfo]
    """Loaded scenes by id, with the digests of their files."""


def check_services(
    runs: Sequence[Configuration], target: Target, scenes: Mapping[str, SceneInfo], ladder: LadderName
) -> None:
    """Check that the services have the packager, downloads, ladder and rungs that the runs need. Raises StartError."""
    for run in runs:
        scene = scenes[run.scene]
        if run.streamed and target.dash is None:
            raise StartError(f"There is no packager behind {target.url}, so {run.mode} cannot be measured.")
        if run.over_h3 and target.config.dash_h3_url is None:
            raise StartError(f"{target.url} offers no DASH over HTTP/3, so {run.mode} cannot be measured over it.")
        if run.local and run.download_form not in {download.form for download in scene.downloads}:
            raise StartError(f"{run.scene} is not offered for download, so {run.mode} cannot be measured.")
        if ladder == "paper" and scene.ladder is not None:
            raise StartError(
                f"The services at {target.url} show {run.scene} with its own ladder, but the experiment needs the "
                "paper's: start the render service with --ladder paper."
            )
        rungs = len(scene.ladder or target.config.ladder)
        if run.mode not in PER_VIEW:
            rung = None if run.dash_representation is None else run.dash_representation.rung
        else:
            rung = run.profile if isinstance(run.profile, int) else None
        if rung is not None and rung >= rungs:
            raise StartError(f"There is no rung {rung}: the ladder at {target.url} has {rungs} rungs, counted from 0.")


def find_changes(kept: Iterable[RunRecord], now: RunVersions) -> list[str]:
    """Differences from earlier runs, each with its old and new value; unknown values do not count."""
    found: dict[str, str] = {}

    def compare(name: str, was: object, new: object) -> None:
        if was is not None and new is not None and was != new:
            found.setdefault(name, f"{name} ({was}, now {new})")

    for record in kept:
        scene = now.scenes.get(record.configuration.scene)
        compare("commit", record.machine.commit, now.commit)
        compare("browser", record.browser, now.browser)
        if record.server is not None:
            compare("render service's commit", record.server.commit, now.server.commit)
            for name in ("congestion_control", "tcp_congestion_control"):
                compare(
                    name.replace("_", " ").replace("tcp", "TCP"),
                    getattr(record.server, name),
                    getattr(now.server, name),
                )
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
