"""Where the engines' sockets are, in a directory that only the service's own user may enter."""

from __future__ import annotations

from pathlib import Path


def http_socket(directory: Path, engine: int) -> Path:
    """Of an engine's HTTP interface, by its number."""
    return directory / f"http-{engine}.sock"


def frames_socket(directory: Path, engine: int) -> Path:
    """Of its frames."""
    return directory / f"frames-{engine}.sock"
