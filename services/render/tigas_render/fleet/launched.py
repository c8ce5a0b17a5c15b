"""One process of the service from its start to its end, and the channel to it."""

from __future__ import annotations

import signal
import socket
import sys
from asyncio.subprocess import DEVNULL, Process, create_subprocess_exec
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from tigas_render.fleet.control import Channel


@dataclass(frozen=True, slots=True)
class Launched:
    """It waits to be told how to begin."""

    process: Process
    channel: Channel

    @classmethod
    async def start(cls, module: str, inherited: Sequence[int]) -> Launched:
        """module: its program; inherited: the file descriptors that it has of ours."""
        ours, theirs = socket.socketpair()
        with theirs:
            process = await create_subprocess_exec(
                *(sys.executable, "-P", "-m", module, str(theirs.fileno())),
                stdin=DEVNULL,
                pass_fds=(theirs.fileno(), *inherited),
                start_new_session=True,  # Ctrl+C is for the supervisor alone, which asks them to end in turn
            )
        return cls(process, await Channel.over(ours))

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal, unless it is gone."""
        with suppress(ProcessLookupError):
            self.process.send_signal(number)
