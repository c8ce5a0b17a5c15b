"""Services as processes of their own: how one is started, and how it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys


def tigas(*arguments: str) -> list[str]:
    """A command line of the `tigas` that this process belongs to."""
    return [sys.executable, "-m", "tigas_common", *arguments]


def end(process: subprocess.Popen[bytes], patience_s: float) -> None:
    """Ask a process that leads a session to end; what has not ended after so long is killed, with all of its group."""
    process.terminate()
    try:
        process.wait(patience_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
