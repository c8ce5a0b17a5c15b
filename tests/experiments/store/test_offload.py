"""Work in another process, which the system may end."""

from __future__ import annotations

import os
import signal
import sys

import pytest

from tigas_common.errors import InvalidRequest, Overloaded
from tigas_common.parsing import parse
from tigas_common.wire.store import ExperimentRequest
from tigas_experiments.store.offload import offload_to_process

pytestmark = pytest.mark.anyio


def end_myself(how: int) -> None:
    """As the system ends a process that takes too much memory."""
    os.kill(os.getpid(), how)


async def test_work_that_the_system_ends_is_told_and_the_next_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as without:
        without.setattr(sys, "executable", "/nowhere/python")
        with pytest.raises(Overloaded, match="No process can be started"):
            await offload_to_process(os.getppid)
    with pytest.raises(Overloaded, match="ended by the system"):
        await offload_to_process(end_myself, signal.SIGKILL)
    assert await offload_to_process(os.getppid) == os.getpid()
    with pytest.raises(InvalidRequest) as raised:
        await offload_to_process(parse, ExperimentRequest, b"{")
    assert raised.value.detail.startswith("Invalid JSON")
