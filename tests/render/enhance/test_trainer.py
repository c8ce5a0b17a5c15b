"""The training child process: progress, failures, exclusiveness, and termination on request."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from tigas_common.wire.render import Training
from tigas_render.enhance.trainer import NICENESS, Trainer, TrainingRunning, training_command

pytestmark = pytest.mark.anyio

REPORT = "import json, os, sys, time; say = lambda p: print(json.dumps({'stage': 'here', 'progress': p}), flush=True); "


class Told:
    """A trainer with a child that runs this code, with the output file as its argument."""

    def __init__(self, code: str) -> None:
        self.trainer = Trainer("cpu", lambda scene, out, url, device: [sys.executable, "-c", REPORT + code, str(out)])


@pytest.fixture
async def endless() -> AsyncIterator[Trainer]:
    trainer = Told("print(os.getpid(), file=open(sys.argv[1], 'w'), flush=True); say(0.25); time.sleep(600)").trainer
    yield trainer
    await trainer.close()


async def until(trainer: Trainer, *states: str, progress: float = 0) -> Training:
    while (found := trainer.state("scene")).state not in states or found.progress < progress:  # noqa: ASYNC110 - the child decides
        await asyncio.sleep(0.01)
    return found


async def test_a_training_reports_and_is_done(tmp_path: Path) -> None:
    trainer = Told("say(0.5); open(sys.argv[1], 'w').write(str(os.getpriority(os.PRIO_PROCESS, 0)))").trainer
    assert trainer.state("scene").state == "idle"
    assert trainer.start("scene", tmp_path / "out", "").state == "running"
    assert (await until(trainer, "done", "failed")) == Training(state="done", progress=1)
    assert int((tmp_path / "out").read_text()) == NICENESS


@pytest.mark.parametrize(
    ("code", "problem"),
    [
        ("sys.exit('It was\\nAll views of the scene are empty.')", "All views of the scene are empty."),
        ("sys.exit(3)", "The training ended with status 3."),
        ("print('no JSON', flush=True); time.sleep(600)", "The training failed; the server's log says why."),
    ],
)
async def test_a_failure_is_told_in_the_childs_last_words(code: str, problem: str, tmp_path: Path) -> None:
    trainer = Told(code).trainer
    trainer.start("scene", tmp_path, "")
    assert (await until(trainer, "done", "failed")) == Training(state="failed", problem=problem)


async def test_a_child_that_cannot_be_started_is_a_failure(tmp_path: Path) -> None:
    trainer = Trainer("cpu", lambda *_: [str(tmp_path / "nothing")])
    trainer.start("scene", tmp_path, "")
    assert "could not be started" in ((await until(trainer, "failed")).problem or "")


async def test_only_one_runs_at_a_time_and_a_stopped_one_has_ended(endless: Trainer, tmp_path: Path) -> None:
    endless.start("scene", tmp_path / "pid", "")
    running = await until(endless, "running", progress=0.25)
    assert running.stage == "here"
    for scene in ("scene", "other"):
        with pytest.raises(TrainingRunning, match="scene"):
            endless.start(scene, tmp_path / "pid", "")
    assert (await endless.stop("other")).state == "idle"
    assert endless.state("scene").state == "running"
    assert (await endless.stop("scene")).state == "idle"
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)
    endless.start("other", tmp_path / "pid", "")
    await endless.close()
    assert endless.state("other").state == "idle"


def test_a_scenes_name_is_no_option() -> None:
    assert training_command("--help", Path("out"), "http://localhost", "cpu")[-2:] == ["--", "--help"]
