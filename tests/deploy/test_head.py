"""deploy/head.sh, with a Ray and a `tigas cluster up` that only say that they run."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.eventually import wait_until

HEAD = Path(__file__).parents[2] / "deploy/head.sh"
RAY = """#!/bin/sh
[ "$1" = health-check ] && exit 0
echo $$ > ray.pid
exec sleep 60
"""
TIGAS = """#!/bin/sh
echo "$*" >> starts
echo $$ > up.pid
exec sleep 60
"""


class Head:
    """The script, in a separate folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name, script in (("ray", RAY), ("tigas", TIGAS)):
            (folder / name).write_text(script)
            (folder / name).chmod(0o755)
        environment = {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"}
        self.process = subprocess.Popen((HEAD, "ray", "start", "--head"), cwd=folder, env=environment)

    def kill(self, name: str) -> None:
        """Kill Ray, or `up`."""
        os.kill(int((self.folder / f"{name}.pid").read_text()), signal.SIGKILL)

    @property
    def starts(self) -> list[str]:
        """How `tigas` was called."""
        starts = self.folder / "starts"
        return starts.read_text().splitlines() if starts.exists() else []

    def runs(self, name: str) -> bool:
        """Whether Ray, or `up`, is there."""
        return Path("/proc", (self.folder / f"{name}.pid").read_text().strip()).exists()


@pytest.fixture
def head(tmp_path: Path) -> Iterator[Head]:
    """A head that runs."""
    made = Head(tmp_path)
    try:
        wait_until(lambda: len(made.starts) == 1)
        yield made
    finally:
        made.process.terminate()
        made.process.wait(10)


def test_what_ends_by_itself_is_started_again(head: Head) -> None:
    head.kill("up")
    wait_until(lambda: len(head.starts) == 2)
    assert head.starts == ["cluster up", "cluster up"]
    assert head.runs("ray")


def test_it_ends_with_ray(head: Head) -> None:
    head.kill("ray")
    assert head.process.wait(10) == 1
    assert not head.runs("up")


def test_it_ends_both_when_told_to(head: Head) -> None:
    head.process.terminate()
    assert head.process.wait(10) == 0
    assert not head.runs("ray")
    assert not head.runs("up")
