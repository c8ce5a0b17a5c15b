"""A service's process ends when it is asked to, and otherwise with all that it started."""

from __future__ import annotations

import signal
import subprocess
import sys

import psutil

from tigas_common.processes import end, tigas

STUBBORN = """
import signal, subprocess, sys
signal.signal(signal.SIGTERM, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, "-c", "import signal; signal.pause()"])
print(child.pid, flush=True)
child.wait()
"""


def started(argv: list[str]) -> subprocess.Popen[bytes]:
    """In a session of its own."""
    return subprocess.Popen(argv, stdout=subprocess.PIPE, start_new_session=True)


def test_what_ends_when_it_is_asked_to_is_not_killed() -> None:
    process = started([sys.executable, "-c", "import signal; print(flush=True); signal.pause()"])
    assert process.stdout is not None
    with process.stdout as told:
        told.readline()
        end(process, 10)
    assert process.returncode == -signal.SIGTERM


def test_what_does_not_end_is_killed_with_all_that_it_started() -> None:
    process = started([sys.executable, "-c", STUBBORN])
    assert process.stdout is not None
    with process.stdout as told:
        child = psutil.Process(int(told.readline()))
        end(process, 0.1)
    assert process.returncode == -signal.SIGKILL
    assert psutil.wait_procs([child], timeout=10)[1] == []


def test_a_command_line_is_that_of_this_tigas() -> None:
    done = subprocess.run(tigas("--help"), capture_output=True, text=True, check=True)
    assert "render" in done.stdout
