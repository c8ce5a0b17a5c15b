"""Work in another process, which the system may end."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable

import pytest

from tigas_common.errors import InvalidRequest, Overloaded, TooCostly
from tigas_common.offload import Limit, offload_to_process
from tigas_common.parsing import parse
from tigas_experiments.wire.store import ExperimentRequest

pytestmark = pytest.mark.anyio


def end_myself(how: int) -> None:
    """As the system ends a process that takes too much memory."""
    os.kill(os.getpid(), how)


async def test_work_that_the_system_ends_is_told_and_the_next_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as without:
        without.setattr(sys, "executable", "/nowhere/python")
        with pytest.raises(Overloaded, match="No process could be started"):
            await offload_to_process(os.getppid)
    with pytest.raises(Overloaded, match="The system killed the process"):
        await offload_to_process(end_myself, signal.SIGKILL)
    assert await offload_to_process(os.getppid) == os.getpid()
    with pytest.raises(InvalidRequest) as raised:
        await offload_to_process(parse, ExperimentRequest, b"{")
    assert raised.value.detail.startswith("Invalid JSON")


def fill_memory() -> None:
    """As a body that was made for it."""
    kept = []
    while True:
        kept.append(bytearray(b"x" * 1_000_000))


def spin() -> None:
    while True:
        pass


@pytest.mark.parametrize("costly", [fill_memory, spin])
@pytest.mark.slow
async def test_work_that_takes_more_than_it_may_is_refused_and_the_next_goes_on(costly: Callable[[], None]) -> None:
    with pytest.raises(TooCostly, match="more than 64 MB of memory or 1 s,"):
        await offload_to_process(costly, limit=Limit(memory=64_000_000, cpu_s=1))
    assert len(await offload_to_process(bytearray, 200_000_000)) == 200_000_000


async def test_memory_that_runs_out_in_the_parser_ends_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pydantic's is written in Rust, which may wait for itself for ever when it has no memory to trace where it was."""
    monkeypatch.setenv("RUST_BACKTRACE", "1")
    limit = Limit(memory=20_000_000, cpu_s=10)
    assert await offload_to_process(os.getenv, "RUST_BACKTRACE", limit=limit) == "0"
    body = json.dumps({f"{number:x}": {} for number in range(100_000)}).encode()
    with pytest.raises(TooCostly):
        await offload_to_process(parse, ExperimentRequest, body, len(body), limit=limit)


async def test_a_limit_ends_with_its_work() -> None:
    tight = Limit(memory=64_000_000, cpu_s=1)
    worker = await offload_to_process(os.getpid, limit=tight)
    assert await offload_to_process(len, bytes(200_000_000)) == 200_000_000
    assert await offload_to_process(os.getpid, limit=tight) == worker
