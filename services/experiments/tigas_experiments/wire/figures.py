"""Constants of the figures of a run."""

from __future__ import annotations

INTERACTIVE_MS = 108.0
"""The motion-to-photon latency that counts as immediate: between the sixth and the seventh frame of a 60 Hz display, as
100 ms are the sixth itself, where a hair decides (docs/experiments.md).
"""
USUAL_INTERVAL_MS = 1000 / 60
"""The interval between a display's frames if a recording does not say it."""
AGE_EVERY_MS = 5.0
"""The interval at which the age of the picture on the screen is sampled."""
