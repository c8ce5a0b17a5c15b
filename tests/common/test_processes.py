"""A service's process ends on request together with its children, and is restarted if it dies."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable

import psutil
import pytest

from tigas_common import processes
from tigas_common.errors import StartError
from tigas_common.processes import Backoff, Service, keep_running, terminate, tigas_command

STUBBORN = """
import signal, subprocess, sys
signal.signal(signal.SIGTERM, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, "-c", "import signal; signal.pause()"])
print(child.pid, flush=True)
child.wait()
"""


def started(argv: list[str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(argv, stdout=subprocess.PIPE, start_new_session=True)


def test_what_ends_when_it_is_asked_to_is_not_killed() -> None:
    process = started([sys.executable, "-c", "import signal; print(flush=True); signal.pause()"])
    assert process.stdout is not None
    with process.stdout as told:
        told.readline()
        terminate(process, 10)
    assert process.returncode == -signal.SIGTERM


def test_what_does_not_end_is_killed_with_all_that_it_started() -> None:
    process = started([sys.executable, "-c", STUBBORN])
    assert process.stdout is not None
    with process.stdout as told:
        child = psutil.Process(int(told.readline()))
        terminate(process, 0.1)
    assert process.returncode == -signal.SIGKILL
    assert psutil.wait_procs([child], timeout=10)[1] == []


def test_a_command_line_is_that_of_this_tigas() -> None:
    done = subprocess.run(tigas_command("--help"), capture_output=True, text=True, check=True)
    assert "render" in done.stdout


def test_waits_grow_and_too_many_ends_are_the_last() -> None:
    back_off = Backoff()
    assert [back_off.next_delay_s(now) for now in (0, 10, 20, 30, 40)] == [0.5, 1, 2, 4, None]


def test_what_has_run_for_long_is_started_again_at_once() -> None:
    back_off = Backoff()
    assert [back_off.next_delay_s(now) for now in (0, 10, 100, 161)] == [0.5, 1, 0.5, 0.5]


class Started:
    """A service's processes, in the order of their starts. `then` is called with their number."""

    def __init__(self, argv: list[str], then: Callable[[int], None]) -> None:
        self.processes: list[subprocess.Popen[bytes]] = []
        self._argv = argv
        self._then = then

    def __call__(self) -> subprocess.Popen[bytes]:
        self.processes.append(subprocess.Popen(self._argv, start_new_session=True))
        self._then(len(self.processes))
        return self.processes[-1]


WAITS = [sys.executable, "-c", "import signal; signal.pause()"]


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Backoff, "FIRST_S", 0.02)
    monkeypatch.setattr(processes, "POLL_S", 0.01)


def test_a_service_that_is_killed_comes_back_and_the_others_stay(
    at_once: None, capfd: pytest.CaptureFixture[str]
) -> None:
    stop = threading.Event()

    def killed_once(starts: int) -> None:
        if starts == 1:
            threading.Timer(0.1, lambda: os.kill(dies.processes[0].pid, signal.SIGKILL)).start()
        else:
            stop.set()

    dies, stays = Started(WAITS, killed_once), Started(WAITS, lambda _: None)
    keep_running([Service("one", stays), Service("other", dies)], stop)
    assert [process.returncode for process in dies.processes] == [-signal.SIGKILL, -signal.SIGTERM]
    assert [process.returncode for process in stays.processes] == [-signal.SIGTERM]
    assert capfd.readouterr().err == "The other exited (signal SIGKILL); restarting it in 0.02 s.\n"


def test_one_that_ends_again_and_again_is_given_up_with_the_others(
    at_once: None, capfd: pytest.CaptureFixture[str]
) -> None:
    ends, stays = Started([sys.executable, "-c", ""], lambda _: None), Started(WAITS, lambda _: None)
    with pytest.raises(StartError, match=r"^The one exited 5 times within 60 s, the last time with exit status 0"):
        keep_running([Service("other", stays), Service("one", ends)], threading.Event())
    assert len(ends.processes) == 5
    assert capfd.readouterr().err.count("restarting it") == 4
    assert stays.processes[0].returncode == -signal.SIGTERM


def test_one_with_wrong_settings_is_not_tried_again(at_once: None) -> None:
    wrong = Started([sys.executable, "-c", "raise SystemExit(2)"], lambda _: None)
    with pytest.raises(StartError, match=r"^The one did not start \(exit status 2\)"):
        keep_running([Service("one", wrong)], threading.Event())
    assert len(wrong.processes) == 1


def test_one_that_cannot_be_forked_for_a_moment_is_tried_again(at_once: None) -> None:
    stop = threading.Event()

    class Refused(Started):
        def __call__(self) -> subprocess.Popen[bytes]:
            if len(self.processes) == 1 and not refused:
                refused.append(True)
                raise refusal
            return super().__call__()

    refused: list[bool] = []
    refusal = BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
    service = Refused(WAITS, lambda starts: service.processes[0].kill() if starts == 1 else stop.set())
    keep_running([Service("one", service)], stop)
    assert refused
    assert len(service.processes) == 2


def test_one_that_cannot_be_forked_at_all_is_a_sentence(at_once: None) -> None:
    def refuse() -> subprocess.Popen[bytes]:
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    with pytest.raises(StartError, match=r"^The one did not start \(no process could be started: Resource temporarily"):
        keep_running([Service("one", refuse)], threading.Event())
