"""Supervision of workers, some of which others can replace."""

from __future__ import annotations

import asyncio
import errno
import os
import signal
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import pytest

from tests.eventually import eventually
from tigas_common.errors import StartError
from tigas_common.processes import Backoff
from tigas_render.workers import worker as worker_module
from tigas_render.workers.control import Channel, Failed, Loaded, Message, Ready
from tigas_render.workers.worker import Standby, Worker, WorkerProcess

pytestmark = pytest.mark.anyio

WORKS: Sequence[Message] = (Ready(),)
FAILS: Sequence[Message] = (Failed(detail="It is lost."),)
NO_MEMORY = "no process could be started: Cannot allocate memory"


class Process:
    """A process with scripted output; a ready one ends on request, another at once."""

    def __init__(self, channel: Channel, says: Sequence[Message]) -> None:
        self._channel = channel
        self._says = says
        self._asked = asyncio.Event()
        self._running = asyncio.create_task(self._run())

    async def _run(self) -> int:
        for message in self._says:
            self._channel.send(message)
        if Ready() in self._says:
            await self._asked.wait()
        await self._channel.close()
        return 1

    async def wait(self) -> int:
        return await self._running

    def send_signal(self, number: signal.Signals) -> None:
        self._asked.set()


async def launched(says: Sequence[Message]) -> WorkerProcess:
    ours, theirs = socket.socketpair()
    return WorkerProcess(cast(Any, Process(await Channel.from_socket(theirs), says)), await Channel.from_socket(ours))


async def refuse(*_: object, **__: object) -> None:
    """Fail like a fork without memory."""
    raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))


class Bench:
    """A worker with such processes."""

    def __init__(self, name: str, *lives: Sequence[Message]) -> None:
        """lives: output of each of its processes; the last one repeats."""
        self.lives = lives
        self.starts = 0
        self.refused = 0
        """How many of the next starts fail."""
        self.worker = Worker(name, self._launch, list, lambda worker, message: None)

    async def _launch(self) -> WorkerProcess:
        if self.refused:
            self.refused -= 1
            await refuse()
        self.starts += 1
        self.process = await launched(self.lives[min(self.starts, len(self.lives)) - 1])
        return self.process

    async def killed(self, start: int) -> None:
        """Kill it once it works for the time with this number."""
        await eventually(lambda: self.starts == start and self.worker._is_serving)
        self.process.signal(signal.SIGKILL)


def together(*benches: Bench) -> list[asyncio.Task[None]]:
    for bench in benches:
        bench.worker.others = [other.worker for other in benches if other is not bench]
    return [asyncio.create_task(bench.worker.run()) for bench in benches]


async def ended(benches: Sequence[Bench], tasks: Sequence[asyncio.Task[None]]) -> None:
    await asyncio.gather(*(bench.worker.stop(5) for bench in benches))
    await asyncio.gather(*tasks)


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Backoff, "FIRST_S", 0.001)
    monkeypatch.setattr(worker_module, "RETRY_S", 0.001)
    monkeypatch.setattr(worker_module, "STANDBY_PAUSE_S", 0.001)


async def test_one_that_cannot_be_forked_for_a_moment_is_started_again(capsys: pytest.CaptureFixture[str]) -> None:
    bench = Bench("edge 0", WORKS)
    tasks = together(bench)
    await eventually(bench.worker.ready.is_set)
    bench.refused = 2
    await bench.killed(1)
    await eventually(lambda: bench.starts == 2 and bench.worker._is_serving)
    await ended([bench], tasks)
    assert capsys.readouterr().err.splitlines() == [
        f"The edge 0 exited ({how}); restarting it." for how in ("exit status 1", NO_MEMORY, NO_MEMORY)
    ]


@pytest.mark.parametrize(
    ("name", "life", "refused", "sentence"),
    [("edge 0", WORKS, 1, rf"^The edge 0 did not start \({NO_MEMORY}"), ("engine", FAILS, 0, r"^It is lost\.$")],
)
async def test_one_that_nobody_can_replace_ends_the_start_with_a_sentence(
    name: str, life: Sequence[Message], refused: int, sentence: str
) -> None:
    bench = Bench(name, life)
    bench.refused = refused
    with pytest.raises(StartError, match=sentence):
        await bench.worker.run()


async def test_a_process_that_cannot_be_forked_leaves_no_descriptor(monkeypatch: pytest.MonkeyPatch) -> None:
    def descriptors() -> int:
        return len(list(Path("/proc/self/fd").iterdir()))

    monkeypatch.setattr(worker_module, "create_subprocess_exec", refuse)
    before = descriptors()
    with pytest.raises(OSError, match="Cannot allocate memory"):
        await WorkerProcess.start("engine", ())
    assert descriptors() == before


@pytest.mark.parametrize("is_ending", [False, True])
async def test_a_spare_edge_that_cannot_be_forked_is_started_again_and_does_not_disturb_the_end(
    monkeypatch: pytest.MonkeyPatch, is_ending: bool
) -> None:
    starts, failing = 0, asyncio.Event()

    async def start(program: str, inherited: Sequence[int]) -> WorkerProcess:
        nonlocal starts
        starts += 1
        if starts == 1:
            await failing.wait()
            await refuse()
        return await launched((Loaded(), Ready()))

    monkeypatch.setattr(WorkerProcess, "start", start)
    standby = Standby(())
    keeping = asyncio.create_task(standby.maintain())
    await eventually(lambda: standby._task is not None)
    if is_ending:
        keeping.cancel()
        failing.set()
    else:
        failing.set()
        await eventually(lambda: not standby._loaded.empty())
        keeping.cancel()
    await standby.kill()
    assert starts == (1 if is_ending else 2)


async def test_one_that_does_not_start_is_tried_again_ever_more_rarely_while_another_serves(
    capsys: pytest.CaptureFixture[str],
) -> None:
    benches = Bench("engine on a", FAILS), Bench("engine on b", WORKS)
    tasks = together(*benches)
    await eventually(lambda: benches[0].starts == 5)
    assert benches[1].starts == 1
    await ended(benches, tasks)
    said = capsys.readouterr().err.splitlines()
    for line, delay in zip(said, ("0.001", "0.002", "0.004", "0.008"), strict=False):
        assert line == (
            f"The engine on a did not start: It is lost. It is restarted in {delay} s; others replace it until then."
        )


async def test_one_that_is_lost_for_a_while_serves_again() -> None:
    benches = Bench("engine on a", FAILS, FAILS, WORKS), Bench("engine on b", WORKS)
    tasks = together(*benches)
    await eventually(benches[0].worker.ready.is_set)
    await ended(benches, tasks)


async def test_one_that_ends_too_often_is_tried_again_while_another_serves(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(worker_module, "RETRY_S", 15.0)
    benches = Bench("engine on a", (*WORKS, *FAILS)), Bench("engine on b", WORKS)
    tasks = together(*benches)
    for start in range(1, 6):
        await benches[0].killed(start)
    said: list[str] = []

    def is_said() -> bool:
        said.append(capsys.readouterr().err)
        why = "exited 5 times within 60 s, the last time with exit status 1. It is lost. It is restarted in 15 s"
        return why in "".join(said)

    await eventually(is_said)
    await ended(benches, tasks)


async def test_if_all_are_lost_it_is_over() -> None:
    tasks = together(Bench("engine on a", FAILS), Bench("engine on b", FAILS))
    done, _ = await asyncio.wait(tasks, timeout=20)
    assert len(done) == 2
    for task in tasks:
        with pytest.raises(StartError, match="did not start: It is lost"):
            task.result()
