"""An edge's view of one engine: its load, and the scenes that it has loaded."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tigas_common.errors import BrokenScene, DeviceLost, NoRoom, OutOfDeviceMemory
from tigas_common.placement import Candidate
from tigas_common.wire.render import RenderRequest
from tigas_render.frame import Client, Frame
from tigas_render.pipe.client import PipeClient

SMOOTHING: Final = 0.2
"""Weight of the newest report in the running mean. At ten reports per second, the mean spans half a second."""
BUSY_FROM, BUSY_UNTIL = 0.85, 0.65
"""Utilisation above which an engine is under pressure, and below which it is not any more."""
LATE_FROM, LATE_UNTIL = 0.06, 0.03
"""Wait of a client for its turn, in seconds, above which an engine is under pressure, and below which it is not."""
NEAR_FROM: Final = 0.6
"""Utilisation above which an engine may soon be under pressure."""
EASY_UNTIL: Final = 0.4
"""Utilisation below which an engine could do twice as much."""

REFUSED_S: Final = 30.0
"""Seconds for which an engine without room for a scene is not asked for it again if another can be."""
WARM_S: Final = 60.0
"""Seconds after a scene's frame for which an engine counts as having the scene loaded."""
WARMING: Final = Client("engines", "warming")
"""Client of the frames that serve only to load a scene."""

REFUSALS: Final = (BrokenScene, NoRoom, OutOfDeviceMemory)
"""Errors of an engine that cannot load a scene although another may."""


class Pressure:
    """Whether an engine has as much work as it can handle."""

    def __init__(self) -> None:
        self.pressed = False
        self._utilisation = self._age_s = 0.0

    @property
    def is_near(self) -> bool:
        """Whether the engine is, or may soon be, under pressure."""
        return self.pressed or self._utilisation >= NEAR_FROM

    @property
    def at_ease(self) -> bool:
        """Whether the engine could do twice as much."""
        return not self.pressed and self._utilisation < EASY_UNTIL

    def heard(self, age_s: float, utilisation: float) -> None:
        """Record the age of the engine's queue in seconds, and its utilisation, 0 to 1. Called ten times per second."""
        self._age_s += SMOOTHING * (age_s - self._age_s)
        self._utilisation += SMOOTHING * (utilisation - self._utilisation)
        if self._utilisation >= BUSY_FROM or self._age_s >= LATE_FROM:
            self.pressed = True
        elif self._utilisation < BUSY_UNTIL and self._age_s < LATE_UNTIL:
            self.pressed = False


class RemoteEngine:
    """An engine behind a pipe."""

    def __init__(self, name: str, pipe: PipeClient, clock: Callable[[], float]) -> None:
        self.name = name
        self.pipe = pipe
        self.candidate = Candidate(name)
        self.pressure = Pressure()
        self.age_s = self.utilisation = 0.0
        self.heard_at = 0.0
        self._clock = clock
        self._warm: dict[str, float] = {}
        """Time of the last frame of each scene."""
        self._warming: set[str] = set()
        self._refused: dict[str, float] = {}
        """Time until which the engine is not asked for a scene again, by scene."""
        self._connection = 0
        """Number of the connection to which `_warm` applies."""

    def heard(self, age_s: float, utilisation: float) -> None:
        """Record a report of the engine's load: the age of its queue in seconds, and its utilisation, 0 to 1."""
        self.heard_at = self._clock()
        self.age_s, self.utilisation = age_s, utilisation
        self.pressure.heard(age_s, utilisation)
        self.candidate = Candidate(self.name, self.pressure.pressed, self.pressure.at_ease)

    def refuses(self, scene: str) -> bool:
        """Whether the engine has recently been unable to load the scene."""
        return bool(self._refused) and self._refused.get(scene, 0.0) > self._clock()

    def is_warm(self, scene: str) -> bool:
        """Whether the engine has the scene loaded, as far as known."""
        at = self._warm.get(scene)
        return at is not None and self._connection == self.pipe.connections and self._clock() - at < WARM_S

    def warm_up(self, request: RenderRequest) -> None:
        """Request a frame only to load the request's scene, unless the engine has it loaded."""
        scene = request.scene
        if scene in self._warming or self.is_warm(scene):
            return
        self._warming.add(scene)

        def on_answer(answer: Frame | Exception) -> None:
            self._warming.discard(scene)
            self.note(scene, answer)
            if isinstance(answer, Frame):
                answer.release()

        patient = request.model_copy(update={"deadline_ms": None, "format": "jpeg", "video": None, "coarse": False})
        self.pipe.request(WARMING, patient, self._clock(), on_answer)

    def note(self, scene: str, answer: Frame | Exception) -> None:
        """Record the information in an answer about the engine and the scene."""
        if isinstance(answer, Frame):
            if answer.coarse:
                return
            if self._connection != self.pipe.connections:
                self._warm.clear()
                self._connection = self.pipe.connections
            self._warm[scene] = self._clock()
        elif isinstance(answer, REFUSALS):
            self._warm.pop(scene, None)
            self._refused[scene] = self._clock() + REFUSED_S
        elif isinstance(answer, DeviceLost):
            self.pipe.give_up(answer.detail)
