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
RISING_FROM: Final = 0.6
"""Utilisation above which an engine may soon be under pressure."""
LOW_UNTIL: Final = 0.4
"""Utilisation below which an engine could do twice as much."""

REFUSED_S: Final = 30.0
"""Seconds for which an engine without room for a scene is not asked for it again if another can be."""
WARM_S: Final = 60.0
"""Seconds after a scene's frame for which an engine counts as having the scene loaded."""
WARM_UP: Final = Client("engines", "warming")
"""Client of the frames that serve only to load a scene."""

REFUSALS: Final = (BrokenScene, NoRoom, OutOfDeviceMemory)
"""Errors of an engine that cannot load a scene although another may."""


class Pressure:
    """Whether an engine has as much work as it can handle."""

    def __init__(self) -> None:
        self.is_high = False
        self._utilisation = self._age_s = 0.0

    @property
    def is_rising(self) -> bool:
        """Whether the engine is, or may soon be, under pressure."""
        return self.is_high or self._utilisation >= RISING_FROM

    @property
    def is_low(self) -> bool:
        """Whether the engine could do twice as much."""
        return not self.is_high and self._utilisation < LOW_UNTIL

    def update(self, age_s: float, utilisation: float) -> None:
        """Record the age of the engine's queue in seconds, and its utilisation, 0 to 1. Called ten times per second."""
        self._age_s += SMOOTHING * (age_s - self._age_s)
        self._utilisation += SMOOTHING * (utilisation - self._utilisation)
        if self._utilisation >= BUSY_FROM or self._age_s >= LATE_FROM:
            self.is_high = True
        elif self._utilisation < BUSY_UNTIL and self._age_s < LATE_UNTIL:
            self.is_high = False


class RemoteEngine:
    """An engine behind a pipe."""

    def __init__(self, name: str, pipe: PipeClient, clock: Callable[[], float]) -> None:
        self.name = name
        self.pipe = pipe
        self.candidate = Candidate(name)
        self.pressure = Pressure()
        self.age_s = self.utilisation = 0.0
        self.updated_at = 0.0
        self._clock = clock
        self._frame_at: dict[str, float] = {}
        """Time of the last frame of each scene."""
        self._warming: set[str] = set()
        self._refused_until: dict[str, float] = {}
        """Time until which the engine is not asked for a scene again, by scene."""
        self._connection = 0
        """Number of the connection to which `_frame_at` applies."""

    def update_load(self, age_s: float, utilisation: float) -> None:
        """Record a report of the engine's load: the age of its queue in seconds, and its utilisation, 0 to 1."""
        self.updated_at = self._clock()
        self.age_s, self.utilisation = age_s, utilisation
        self.pressure.update(age_s, utilisation)
        self.candidate = Candidate(self.name, self.pressure.is_high, self.pressure.is_low)

    def has_refused(self, scene: str) -> bool:
        """Whether the engine has recently been unable to load the scene."""
        return bool(self._refused_until) and self._refused_until.get(scene, 0.0) > self._clock()

    def is_warm(self, scene: str) -> bool:
        """Whether the engine has the scene loaded, as far as known."""
        at = self._frame_at.get(scene)
        return at is not None and self._connection == self.pipe.connections and self._clock() - at < WARM_S

    def warm_up(self, request: RenderRequest) -> None:
        """Request a frame only to load the request's scene, unless the engine has it loaded."""
        scene = request.scene
        if scene in self._warming or self.is_warm(scene):
            return
        self._warming.add(scene)

        def on_answer(answer: Frame | Exception) -> None:
            self._warming.discard(scene)
            self.record_answer(scene, answer)
            if isinstance(answer, Frame):
                answer.release()

        patient = request.model_copy(update={"deadline_ms": None, "format": "jpeg", "video": None, "coarse": False})
        self.pipe.request(WARM_UP, patient, self._clock(), on_answer)

    def record_answer(self, scene: str, answer: Frame | Exception) -> None:
        """Record the information in an answer about the engine and the scene."""
        if isinstance(answer, Frame):
            if answer.coarse:
                return
            if self._connection != self.pipe.connections:
                self._frame_at.clear()
                self._connection = self.pipe.connections
            self._frame_at[scene] = self._clock()
        elif isinstance(answer, REFUSALS):
            self._frame_at.pop(scene, None)
            self._refused_until[scene] = self._clock() + REFUSED_S
        elif isinstance(answer, DeviceLost):
            self.pipe.disconnect(answer.detail)
