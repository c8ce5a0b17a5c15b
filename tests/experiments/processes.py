"""`tigas` commands in separate processes, as started by a user."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

PATIENCE_S = 90


def started(*arguments: str) -> subprocess.Popen[str]:
    """A command in a process group, like a terminal's."""
    return subprocess.Popen(
        [str(Path(sys.executable).with_name("tigas")), *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | {"COLUMNS": "120"},
    )


def until(process: subprocess.Popen[str], happened: Callable[[], bool], otherwise: str) -> None:
    """Wait for an effect of a running command; AssertionError if it ends first, or takes too long."""
    end = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < end, otherwise
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)


def finished(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Status, output and error output, once it has ended. A command that takes too long is ended."""
    with process:
        try:
            output, errors = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
    return process.returncode, output, errors
