"""Which places serve a scene: a few at first, more while it is asked for more than they can do."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import blake2b

WIDEN_S = 1.0
"""A scene whose places have all been pressed for so long gets one more, in seconds."""
NARROW_S = 30.0
"""A scene whose places have all been at ease for so long has one fewer, in seconds."""
MOST_NARROW_S = 480.0
"""The same where that was too early before: it doubles each time."""
MOST_SCENES = 1024
"""Remembered at a time; the one that was asked for the longest ago is forgotten."""


@dataclass(frozen=True)
class Place:
    """What can serve a scene: a device to an edge, a host to a director."""

    name: str
    pressed: bool = False
    """It says of itself that it has as much to do as it can."""
    at_ease: bool = True
    """It says that it could do at least as much again."""


@lru_cache(maxsize=8192)
def ranked(key: str, names: tuple[str, ...]) -> tuple[str, ...]:
    """The names in this key's order: highest random weight first (Thaler and Ravishankar, 1998).

    Whoever asks gets the same order, and a name that comes or goes leaves the others in theirs.
    """
    return tuple(sorted(names, key=lambda name: (_weight(key, name), name), reverse=True))


def _weight(key: str, name: str) -> bytes:
    return blake2b(f"{key}\0{name}".encode(), digest_size=8).digest()


@dataclass
class _Width:
    """How many places a scene has, and since when (by the clock) it would need more or fewer."""

    asked: float
    places: int = 1
    pressed_since: float | None = None
    calm_since: float | None = None
    narrowed: float | None = None
    narrow_s: float = NARROW_S


class Placement:
    """Orders places for each scene, and remembers how many it needs."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """clock: in seconds."""
        self._clock = clock
        self._widths: OrderedDict[str, _Width] = OrderedDict()
        """Of scenes that have, had lately, or may soon have more than one place."""

    def places(self, scene: str, up: Sequence[Place]) -> list[str]:
        """The names of the scene's places now, of those that are up, the best first; none if none is up.

        To be called for every request or new viewer: how long its places have been pressed follows from the calls.
        """
        if not up:
            return []
        pressed = {place.name for place in up if place.pressed}
        at_ease = {place.name for place in up if place.at_ease and not place.pressed}
        order = ranked(scene, tuple(place.name for place in up))
        if scene not in self._widths and order[0] not in pressed:
            return [order[0]]
        now = self._clock()
        width = self._width(scene, now)
        count = min(width.places, len(order))
        chosen = order[:count]
        if pressed.issuperset(chosen):
            width.calm_since = None
            width.pressed_since = now if width.pressed_since is None else width.pressed_since
            if now - width.pressed_since >= WIDEN_S and count < len(order):
                _widen(width, count, now)
        else:
            width.pressed_since = None
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
        if now - width.asked > WIDEN_S:  # nobody asked for it meanwhile
            width.pressed_since = None
            width.calm_since = width.asked if width.calm_since is None else width.calm_since
        width.asked = now
        while len(self._widths) > MOST_SCENES:
            self._widths.popitem(last=False)
        return width

    def _forget(self, scene: str, width: _Width, now: float) -> None:
        if width.narrowed is None or now - width.narrowed >= MOST_NARROW_S:
            del self._widths[scene]


def _widen(width: _Width, count: int, now: float) -> None:
    if width.narrowed is not None and now - width.narrowed < width.narrow_s:
        width.narrow_s = min(2 * width.narrow_s, MOST_NARROW_S)
    width.places = count + 1
    width.pressed_since = now


def _narrow(width: _Width, now: float) -> None:
    width.places = max(1, width.places - 1)
    width.calm_since = width.narrowed = now
