"""Contents of a folder."""

from __future__ import annotations

from pathlib import Path


def names(directory: Path) -> set[str]:
    """The names in it."""
    return {path.name for path in directory.iterdir()}
