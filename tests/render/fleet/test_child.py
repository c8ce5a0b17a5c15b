"""How children are kept running, those of whom another can do the work among them."""

from __future__ import annotations

import asyncio
import signal
import socket
from collections.abc import Callable, Sequence
from typing import Any, cast

import pytest

from tigas_common.errors import StartError
from tigas_common.processes import BackOff
from tigas_render.fleet import child as child_module
from tigas_render.fleet.child import Child
from tigas_render.fleet.control import Channel, Failed, Message, Ready
from tigas_render.fleet.launched import Launched

pytestmark = pytest.mark.anyio


class Process:
    """A process that says what it is told to; one that is ready ends when it is asked to, another at once."""

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


class Bench:
    """A child of such processes."""

    def __init__(self, name: str, *lives: Sequence[Message]) -> None:
        """lives: what each of its processes says; the last is that of all that follow."""
        self.lives = list(lives)
        self.starts = 0
        self.processes: list[Process] = []
        self.child = Child(name, self._launch, list, lambda child, message: None)

    async def _launch(self) -> Launched:
        says = self.lives[min(self.starts, len(self.lives) - 1)]
        self.starts += 1
        ours, theirs = socket.socketpair()
        self.processes.append(Process(await Channel.over(theirs), says))
        return Launched(cast(Any, self.processes[-1]), await Channel.over(ours))


def together(*benches: Bench) -> list[asyncio.Task[None]]:
    for bench in benches:
        bench.child.others = [other.child for other in benches if other is not bench]
    return [asyncio.create_task(bench.child.keep()) for bench in benches]


async def ended(benches: Sequence[Bench], tasks: Sequence[asyncio.Task[None]]) -> None:
    await asyncio.gather(*(bench.child.end(5) for bench in benches))
    await asyncio.gather(*tasks)


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(20):
        while not condition():  # noqa: ASYNC110
            await asyncio.sleep(0.001)


WORKS: Sequence[Message] = (Ready(),)
FAILS: Sequence[Message] = (Failed(detail="It is lost."),)


async def test_one_that_does_not_start_is_tried_again_ever_more_rarely_while_another_serves(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(child_module, "RARE_S", 0.001)
    benches = Bench("engine on a", FAILS), Bench("engine on b", WORKS)
    tasks = together(*benches)
    await until(lambda: benches[0].starts == 5)
    assert benches[1].starts == 1
    await ended(benches, tasks)
    said = capsys.readouterr().err.splitlines()
    for line, delay in zip(said, ("0.001", "0.002", "0.004", "0.008"), strict=False):
        assert line == (
            f"The engine on a did not start: It is lost. It is tried again in {delay} s; others do its work meanwhile."
        )


async def test_one_that_is_lost_for_a_while_serves_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child_module, "RARE_S", 0.001)
    benches = Bench("engine on a", FAILS, FAILS, WORKS), Bench("engine on b", WORKS)
    tasks = together(*benches)
    await until(benches[0].child.ready.is_set)
    await ended(benches, tasks)


async def test_one_that_ends_too_often_is_tried_again_while_another_serves(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(BackOff, "FIRST_S", 0.001)
    benches = Bench("engine on a", (*WORKS, *FAILS)), Bench("engine on b", WORKS)
    tasks = together(*benches)
    for start in range(5):
        await until(lambda start=start: benches[0].starts == start + 1 and benches[0].child._serves)  # type: ignore[misc]
        benches[0].processes[-1].send_signal(signal.SIGKILL)
    said = ""

    def is_said() -> bool:
        nonlocal said
        said += capsys.readouterr().err
        return "ended 5 times within 60 s, the last time with exit status 1. It is lost. It is tried again in" in said

    await until(is_said)
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
        await bench.child.keep()
