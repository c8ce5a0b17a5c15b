"""Whether an engine has as much to do as it can. No clock, no sockets."""

from __future__ import annotations

from typing import Final

SMOOTHING: Final = 0.2
"""The weight of what is heard in the mean: with ten times a second, half a second's memory."""
BUSY_FROM, BUSY_UNTIL = 0.85, 0.65
"""Utilisation from which on it is pressed, and under which it is no more: at half as much to do it is at ease."""
LATE_FROM, LATE_UNTIL = 0.06, 0.03
"""The same for how long a client waits for its turn, in seconds."""


class Pressure:
    """Hears how busy the engine is, ten times a second or so."""

    def __init__(self) -> None:
        self.pressed = False
        self._utilisation = self._age_s = 0.0

    def heard(self, age_s: float, utilisation: float) -> None:
        """The age of its queue, in seconds, and its utilisation, 0 to 1."""
        self._age_s += SMOOTHING * (age_s - self._age_s)
        self._utilisation += SMOOTHING * (utilisation - self._utilisation)
        if self._utilisation >= BUSY_FROM or self._age_s >= LATE_FROM:
            self.pressed = True
        elif self._utilisation < BUSY_UNTIL and self._age_s < LATE_UNTIL:
            self.pressed = False
