"""Files that can be made again: where they are kept, and how they are written."""

from __future__ import annotations

import contextlib
import logging
import os
from pathlib import Path

from tigas_common.files import read_regular

logger = logging.getLogger(__name__)

KEY_LENGTH = 32
"""Bytes."""


def cache_directory() -> Path:
    """Directory for reproducible data of this user's programs (XDG base directories)."""
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "tigas"


def kept_key(path: Path) -> bytes:
    """The secret in a file private to this user, created if missing; an unusable one is replaced."""
    key = os.urandom(KEY_LENGTH)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path, "xb", opener=lambda name, flags: os.open(name, flags, 0o600)) as file:
            file.write(key)
    except FileExistsError:
        with contextlib.suppress(OSError):
            kept = read_regular(path, KEY_LENGTH)
            return kept if len(kept) == KEY_LENGTH else key
    except OSError:
        pass
    return key


def write_to_cache(path: Path, content: bytes) -> None:
    """Write a file atomically, so that no reader sees a partial one. Failing to write is not an error."""
    temporary = path.with_suffix(f".{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(content)
        temporary.replace(path)
    except OSError as error:
        logger.warning("The cache %s cannot be written: %s", path.parent, error.strerror or error)
        with contextlib.suppress(OSError):
            temporary.unlink()
