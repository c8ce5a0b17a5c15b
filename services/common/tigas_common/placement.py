"""Placement of scenes on several servers, engines of a host or hosts of a cluster, and merging of their scene lists."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import blake2b

from tigas_common.wire.render import SceneInfo

WIDEN_S = 1.0
"""Seconds of pressure on all places of a scene before it gets another one."""
NARROW_S = 30.0
"""Seconds of ease on all places of a scene before it loses one."""
MAX_NARROW_S = 480.0
"""Upper limit of that time, which doubles after each premature reduction."""
MAX_NAME = 256
"""Significant characters of a scene's id, as clients choose it; real ones have at most 128."""
MOST_SCENES = 1024
"""Maximum number of scenes remembered; the least recently requested one is dropped."""

STATES = ("loaded", "loading", "unloaded", "broken")
"""The states of a scene, best first. The best one on any server counts."""


@dataclass(frozen=True)
class Candidate:
    """A server that can hold scenes: a device for an edge process, a host for a director."""

    name: str
    is_overloaded: bool = False
    """Whether it reports full load."""
    has_headroom: bool = True
    """Whether it reports capacity for at least twice its load."""


def rank_names(scene: str, names: tuple[str, ...]) -> tuple[str, ...]:
    """The names in this scene's order: highest random weight first (Thaler and Ravishankar, 1998).

    The order is deterministic, and adding or removing a name does not change that of the others.
    """
    return _ranked(scene[:MAX_NAME], names)


@lru_cache(maxsize=8192)
def _ranked(key: str, names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(sorted(names, key=lambda name: (_weight(key, name), name), reverse=True))


def _weight(key: str, name: str) -> bytes:
    return blake2b(f"{key}\0{name}".encode(), digest_size=8).digest()


@dataclass
class _Width:
    """How many places a scene has, and since when it would need more or fewer."""

    asked: float
    places: int = 1
    overloaded_since: float | None = None
    calm_since: float | None = None
    narrowed_at: float | None = None
    narrow_s: float = NARROW_S


class Placement:
    """Orders the places of each scene, and remembers how many it needs."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """clock: in seconds."""
        self._clock = clock
        self._widths: OrderedDict[str, _Width] = OrderedDict()
        """Scenes that have, recently had, or may soon need more than one place."""

    def places(self, scene: str, up: Sequence[Candidate]) -> list[str]:
        """The names of the scene's available places, best first; empty if none is up.

        Call this for every request or new viewer, as the duration of pressure is measured between calls.
        """
        if not up:
            return []
        pressed = {each.name for each in up if each.is_overloaded}
        at_ease = {each.name for each in up if each.has_headroom and not each.is_overloaded}
        order = rank_names(scene, tuple(each.name for each in up))
        if scene not in self._widths and order[0] not in pressed:
            return [order[0]]
        now = self._clock()
        width = self._width(scene, now)
        count = min(width.places, len(order))
        chosen = order[:count]
        if pressed.issuperset(chosen):
            width.calm_since = None
            width.overloaded_since = now if width.overloaded_since is None else width.overloaded_since
            if now - width.overloaded_since >= WIDEN_S and count < len(order):
                _widen(width, count, now)
        else:
            width.overloaded_since = None
            if not at_ease.issuperset(chosen):
                width.calm_since = None
            elif width.places == 1:
                self._forget(scene, width, now)
            else:
                width.calm_since = now if width.calm_since is None else width.calm_since
                if now - width.calm_since >= width.narrow_s:
                    _narrow(width, now)
        return list(order[: width.places])

    def _width(self, scene: str, now: float) -> _Width:
        width = self._widths.setdefault(scene, _Width(now))
        self._widths.move_to_end(scene)
        if now - width.asked > WIDEN_S:  # no requests in the meantime
            width.overloaded_since = None
            width.calm_since = width.asked if width.calm_since is None else width.calm_since
        width.asked = now
        while len(self._widths) > MOST_SCENES:
            self._widths.popitem(last=False)
        return width

    def _forget(self, scene: str, width: _Width, now: float) -> None:
        if width.narrowed_at is None or now - width.narrowed_at >= MAX_NARROW_S:
            del self._widths[scene]


def _widen(width: _Width, count: int, now: float) -> None:
    if width.narrowed_at is not None and now - width.narrowed_at < width.narrow_s:
        width.narrow_s = min(2 * width.narrow_s, MAX_NARROW_S)
    width.places = count + 1
    width.overloaded_since = now


def _narrow(width: _Width, now: float) -> None:
    width.places = max(1, width.places - 1)
    width.calm_since = width.narrowed_at = now


def merge_scene_lists(lists: Iterable[Sequence[SceneInfo]]) -> list[SceneInfo]:
    """Merge the scene lists of several servers into one, sorted by id."""
    found: dict[str, list[SceneInfo]] = {}
    for infos in lists:
        for info in infos:
            found.setdefault(info.id, []).append(info)
    return [merge_scene_infos(found[id]) for id in sorted(found)]


def merge_scene_infos(infos: Sequence[SceneInfo]) -> SceneInfo:
    """Merge several servers' descriptions of a scene. Facts known only after loading may come from any of them."""
    best = min(infos, key=lambda info: STATES.index(info.state))
    known = {
        name: next((value for info in infos if (value := getattr(info, name)) is not None), None)
        for name in ("gaussians", "sh_degree", "camera", "file_sha256")
        if getattr(best, name) is None
    }
    if best.state == "loading":
        known["progress"] = max(info.progress or 0 for info in infos)
    return best.model_copy(update={**known, "memory_bytes": sum(info.memory_bytes for info in infos)})
