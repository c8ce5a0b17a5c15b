"""Constants for the metrics of a run."""

from __future__ import annotations

INTERACTIVE_MS = 108.0
"""Motion-to-photon latency that counts as immediate: between the sixth and the seventh frame of a 60 Hz display. 100 ms
is the sixth frame itself, where the smallest deviation would decide (docs/experiments.md).
"""
USUAL_INTERVAL_MS = 1000 / 60
"""Interval between a display's frames if a recording does not state it."""
AGE_EVERY_MS = 5.0
"""Interval at which the age of the picture on screen is sampled."""
