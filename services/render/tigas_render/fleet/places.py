"""Where the engine's sockets are, in a directory that only the service's own user may enter."""

from __future__ import annotations

from pathlib import Path


def http_socket(directory: Path) -> Path:
    """Of its HTTP interface."""
    return directory / "http.sock"


def frames_socket(directory: Path) -> Path:
    """Of its frames."""
    return directory / "frames.sock"
