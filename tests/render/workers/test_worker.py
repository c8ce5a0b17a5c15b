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

from tests.render.transport.serving import eventually
from tigas_common.errors import StartError
from tigas_common.processes import BackOff
from tigas_render.workers import worker as worker_module
from tigas_render.workers.control import Channel, Failed, Loaded, Message, Ready
from tigas_render.workers.worker import Standby, Worker, WorkerProcess

pytestmark = pytest.mark.anyio


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


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


async def refuse(*_: object, **__: object) -> None:
    """Fail like a fork without memory."""
    raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))


class Bench:
    """A worker with such processes."""

    def __init__(self, name: str, *lives: Sequence[Message]) -> None:
        """lives: output of each of its processes; the last one repeats."""
        self.lives = list(lives)
        self.starts = 0
        self.refused = 0
        """How many of the next starts fail."""
        self.processes: list[Process] = []
        self.worker = Worker(name, self._launch, list, lambda worker, message: None)

    async def _launch(self) -> WorkerProcess:
        if self.refused:
            self.refused -= 1
            await refuse()
        says = self.lives[min(self.starts, len(self.lives) - 1)]
        self.starts += 1
        ours, theirs = socket.socketpair()
        self.processes.append(Process(await Channel.over(theirs), says))
        return WorkerProcess(cast(Any, self.processes[-1]), await Channel.over(ours))


def together(*benches: Bench) -> list[asyncio.Task[None]]:
    for bench in benches:
        bench.worker.others = [other.worker for other in benches if other is not bench]
    return [asyncio.create_task(bench.worker.keep()) for bench in benches]


async def ended(benches: Sequence[Bench], tasks: Sequence[asyncio.Task[None]]) -> None:
    await asyncio.gather(*(bench.worker.end(5) for bench in benches))
    await asyncio.gather(*tasks)


WORKS: Sequence[Message] = (Ready(),)
FAILS: Sequence[Message] = (Failed(detail="It is lost."),)


async def test_one_that_cannot_be_forked_for_a_moment_is_started_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(BackOff, "FIRST_S", 0.001)
    bench = Bench("edge 0", WORKS)
    task = asyncio.create_task(bench.worker.keep())
    await eventually(bench.worker.ready.is_set)
    bench.refused = 2
    bench.processes[-1].send_signal(signal.SIGKILL)
    await eventually(lambda: bench.starts == 2 and bench.worker._serves)
    await ended([bench], [task])
    assert capsys.readouterr().err.splitlines() == [
        "The edge 0 has ended (exit status 1); it is started again.",
        "The edge 0 has ended (no process could be started: Cannot allocate memory); it is started again.",
        "The edge 0 has ended (no process could be started: Cannot allocate memory); it is started again.",
    ]


async def test_one_that_cannot_be_forked_at_first_ends_the_start_with_a_sentence() -> None:
    bench = Bench("edge 0", WORKS)
    bench.refused = 1
    with pytest.raises(StartError, match=r"^The edge 0 did not start \(no process could be started: Cannot"):
        await bench.worker.keep()


async def test_a_process_that_cannot_be_forked_leaves_no_descriptor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_module, "create_subprocess_exec", refuse)
    before = descriptors()
    with pytest.raises(OSError, match="Cannot allocate memory"):
        await WorkerProcess.start("engine", ())
    assert descriptors() == before


async def test_a_spare_edge_is_kept_after_one_could_not_be_forked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_module, "STANDBY_PAUSE_S", 0.001)
    starts = 0

    async def start(program: str, inherited: Sequence[int]) -> WorkerProcess:
        nonlocal starts
        starts += 1
        if starts == 1:
            await refuse()
        ours, theirs = socket.socketpair()
        return WorkerProcess(
            cast(Any, Process(await Channel.over(theirs), (Loaded(), Ready()))), await Channel.over(ours)
        )

    monkeypatch.setattr(WorkerProcess, "start", start)
    standby = Standby(())
    keeping = asyncio.create_task(standby.keep())
    await eventually(lambda: not standby._loaded.empty())
    assert starts == 2
    keeping.cancel()
    await standby.end()


async def test_a_spare_edge_that_cannot_be_forked_does_not_disturb_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    failing = asyncio.Event()

    async def start(program: str, inherited: Sequence[int]) -> WorkerProcess:
        await failing.wait()
        await refuse()
        raise AssertionError

    monkeypatch.setattr(WorkerProcess, "start", start)
    standby = Standby(())
    keeping = asyncio.create_task(standby.keep())
    await eventually(lambda: standby._own)
    keeping.cancel()
    failing.set()
    await standby.end()


async def test_one_that_does_not_start_is_tried_again_ever_more_rarely_while_another_serves(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(worker_module, "RARE_S", 0.001)
    benches = Bench("engine on a", FAILS), Bench("engine on b", WORKS)
    tasks = together(*benches)
    await eventually(lambda: benches[0].starts == 5)
    assert benches[1].starts == 1
    await ended(benches, tasks)
    said = capsys.readouterr().err.splitlines()
    for line, delay in zip(said, ("0.001", "0.002", "0.004", "0.008"), strict=False):
        assert line == (
            f"The engine on a did not start: It is lost. It is tried again in {delay} s; others do its work meanwhile."
        )


async def test_one_that_is_lost_for_a_while_serves_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_module, "RARE_S", 0.001)
    benches = Bench("engine on a", FAILS, FAILS, WORKS), Bench("engine on b", WORKS)
    tasks = together(*benches)
    await eventually(benches[0].worker.ready.is_set)
    await ended(benches, tasks)


async def test_one_that_ends_too_often_is_tried_again_while_another_serves(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(BackOff, "FIRST_S", 0.001)
    benches = Bench("engine on a", (*WORKS, *FAILS)), Bench("engine on b", WORKS)
    tasks = together(*benches)
    for start in range(5):
        await eventually(lambda start=start: benches[0].starts == start + 1 and benches[0].worker._serves)  # type: ignore[misc]
        benches[0].processes[-1].send_signal(signal.SIGKILL)
    said = ""

    def is_said() -> bool:
        nonlocal said
        said += capsys.readouterr().err
        return "ended 5 times within 60 s, the last time with exit status 1. It is lost. It is tried again in" in said

    await eventually(is_said)
    await ended(benches, tasks)


async def test_if_all_are_lost_it_is_over() -> None:
    benches = Bench("engine on a", FAILS), Bench("engine on b", FAILS)
    tasks = together(*benches)
    done, _ = await asyncio.wait(tasks, timeout=20)
    assert len(done) == 2
    for task in tasks:
        with pytest.raises(StartError, match="did not start: It is lost"):
            task.result()


async def test_one_that_nobody_can_replace_says_only_what_is_wrong() -> None:
    bench = Bench("engine", FAILS)
    with pytest.raises(StartError, match=r"^It is lost\.$"):
        await bench.worker.keep()
