"""Scenes: loading, the registry, the built-in demo scene and previews."""
