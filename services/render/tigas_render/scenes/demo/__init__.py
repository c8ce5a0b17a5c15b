"""The built-in demo scene: a courtyard with arcades, water, trees and a sky, in a folder as in a models directory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tigas_render.scenes.directory import read_source

DEMO_SOURCE = replace(read_source(Path(__file__).parent), id="courtyard", folder=None)
"""The courtyard as a scene source. It is read-only."""
