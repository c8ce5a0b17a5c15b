"""The built-in demo scene, made by a deterministic generator: a courtyard with arcades, water, trees and a sky."""

from tigas_render.scenes.demo.courtyard import DEMO_METADATA, DEMO_SOURCE, demo_scene

__all__ = ["DEMO_METADATA", "DEMO_SOURCE", "demo_scene"]
