"""Scenes of several servers as one list: those of a host's engines, or of a cluster's hosts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from tigas_common.wire.render import SceneInfo

STATES = ("loaded", "loading", "unloaded", "broken")
"""The states of a scene, the best first. The best one on any server counts."""


def merged_scenes(lists: Iterable[Sequence[SceneInfo]]) -> list[SceneInfo]:
    """Merge several servers' lists into one, sorted by id."""
    found: dict[str, list[SceneInfo]] = {}
    for infos in lists:
        for info in infos:
            found.setdefault(info.id, []).append(info)
    return [merged_scene(found[id]) for id in sorted(found)]


def merged_scene(infos: Sequence[SceneInfo]) -> SceneInfo:
    """Merge several servers' descriptions of a scene. Facts that are known after loading may come from any of them."""
    best = min(infos, key=lambda info: STATES.index(info.state))
    known = {
        name: next((value for info in infos if (value := getattr(info, name)) is not None), None)
        for name in ("gaussians", "sh_degree", "camera", "file_sha256")
        if getattr(best, name) is None
    }
    if best.state == "loading":
        known["progress"] = max(info.progress or 0 for info in infos)
    return best.model_copy(update={**known, "memory_bytes": sum(info.memory_bytes for info in infos)})
