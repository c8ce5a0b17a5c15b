"""Whether an engine has as much to do as it can. No clock, no sockets."""

from __future__ import annotations

from typing import Final

SMOOTHING: Final = 0.2
"""Weight of the newest report in the mean: at ten per second, half a second's memory."""
BUSY_FROM, BUSY_UNTIL = 0.85, 0.65
"""Utilisation from which on it is pressed, and under which it is no more."""
LATE_FROM, LATE_UNTIL = 0.06, 0.03
"""The same for how long a client waits for its turn, in seconds."""
NEAR_FROM: Final = 0.6
"""Utilisation from which on it may soon be pressed."""
EASY_UNTIL: Final = 0.4
"""Utilisation under which it could do as much again."""


class Pressure:
    """Called with the engine's load, about ten times per second."""

    def __init__(self) -> None:
        self.pressed = False
        self._utilisation = self._age_s = 0.0

    @property
    def is_near(self) -> bool:
        """Whether it is pressed, or soon may be."""
        return self.pressed or self._utilisation >= NEAR_FROM

    @property
    def at_ease(self) -> bool:
        """Whether it could do as much again."""
        return not self.pressed and self._utilisation < EASY_UNTIL

    def heard(self, age_s: float, utilisation: float) -> None:
        """The age of its queue, in seconds, and its utilisation, 0 to 1."""
        self._age_s += SMOOTHING * (age_s - self._age_s)
        self._utilisation += SMOOTHING * (utilisation - self._utilisation)
        if self._utilisation >= BUSY_FROM or self._age_s >= LATE_FROM:
            self.pressed = True
        elif self._utilisation < BUSY_UNTIL and self._age_s < LATE_UNTIL:
            self.pressed = False
