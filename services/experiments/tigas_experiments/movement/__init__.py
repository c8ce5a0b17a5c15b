"""Movements of a viewer: traces, generated or recorded, and their placement in a scene (docs/experiments.md)."""
