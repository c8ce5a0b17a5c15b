"""Locks on an experiment's folder, and on services with a link that an experiment changes."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from filelock import FileLock, Timeout

from tigas_common.errors import StartError

LOCK_NAME = ".lock"
"""Name of the lock file in an experiment's folder while a command is making it."""
NAMESPACE = Path("/proc/self/ns/net")
"""This process's network namespace, on Linux."""


@contextmanager
def hold_lock(path: Path, otherwise: str) -> Iterator[None]:
    """Hold a lock file during the context; the system releases it if this process is killed.

    Raises StartError with the sentence `otherwise` if another process holds it, and OSError.
    """
    # The file is kept and any user may lock it: the lab needs root, while services at a URL do not.
    lock = FileLock(path, mode=0o666)
    try:
        lock.acquire(blocking=False)
    except Timeout:
        raise StartError(otherwise) from None
    except PermissionError:
        if not path.exists():  # the folder itself is not writable
            raise
        raise StartError(otherwise) from None  # the file belongs to another user
    try:
        yield
    finally:
        lock.release()


def services_lock(url: str) -> Path:
    """Path of the lock file for the services at a URL. Raises StartError for an invalid URL.

    `localhost` is a different host in each network namespace.
    """
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise StartError(f"{url!r} is not a URL: {error}.") from None
    host = parts.hostname or "localhost"
    if host in ("localhost", "127.0.0.1", "::1"):
        host = f"localhost-{NAMESPACE.stat().st_ino}" if NAMESPACE.exists() else "localhost"
    safe = "".join(c if c.isalnum() or c in ".-" else "-" for c in f"{host}-{port or parts.scheme}")
    return Path(tempfile.gettempdir(), f"tigas-{safe}.lock")
