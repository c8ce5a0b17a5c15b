"""Delay, jitter and loss behind the rate: by netem where the kernel has it, otherwise by our own relay."""

from __future__ import annotations

import asyncio
import sys
from abc import ABC, abstractmethod
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import ClassVar

from tigas_common.wire.shaper import Backend, LinkSetting
from tigas_shaper.link.channel import Channel, CommandError, attempt, run
from tigas_shaper.link.direction import Direction
from tigas_shaper.link.interfaces import Interface
from tigas_shaper.link.relay import RelayState

_PROBE = Interface("tigas-probe")


class DelayStage(ABC):
    """What happens to one direction's packets once they have left the rate device."""

    backend: ClassVar[Backend]

    @abstractmethod
    def set(self, state: LinkSetting, *, blocked: bool) -> None:
        """Change delay, jitter and loss; when blocked, nothing passes. Raises CommandError."""

    @abstractmethod
    def check(self) -> None:
        """Raises CommandError if the stage no longer works."""


class NetemStage(DelayStage):
    """The kernel's own. The rate device is an IFB, which gives packets back to the interface they came from."""

    backend = "netem"

    def __init__(self, tc: Channel, direction: Direction) -> None:
        self._tc = tc
        self._direction = direction

    @classmethod
    @asynccontextmanager
    async def open(cls, tc: Channel, direction: Direction) -> AsyncIterator[NetemStage]:
        """Make the rate device and the stage behind it. Raises CommandError."""
        device = direction.device
        await run("ip", "link", "add", device, "type", "ifb")
        try:
            await run("ip", "link", "set", device, "up")
            tc.write(*direction.netem_lines())
            yield cls(tc, direction)
        finally:
            await attempt("tc", "qdisc", "del", "dev", direction.interface, "root", "handle", "2:")
            await attempt("ip", "link", "del", device)

    def set(self, state: LinkSetting, *, blocked: bool) -> None:
        loss = 100.0 if blocked else state.loss_pct
        self._tc.write(self._direction.change_netem_line(state.delay_ms, state.jitter_ms, loss))

    def check(self) -> None:
        pass  # tc's channel complains of whatever is gone


class RelayStage(DelayStage):
    """Our own relay. The rate device is its TAP device."""

    backend = "relay"

    def __init__(self, process: Process) -> None:
        self._process = process

    @classmethod
    @asynccontextmanager
    async def open(cls, tc: Channel, direction: Direction) -> AsyncIterator[RelayStage]:
        """Start the relay, which makes the rate device. Raises CommandError."""
        device = direction.device
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "tigas_shaper.link.relay", device, stdin=PIPE, stdout=PIPE, start_new_session=True
        )
        assert process.stdin
        assert process.stdout
        try:
            if (answer := await process.stdout.readline()) != b"ready\n":
                raise CommandError(f"The relay cannot start: {answer.decode(errors='replace').strip()}.")
            # Without an address of its own, the kernel sends nothing into the device of its own accord.
            await run("ip", "link", "set", device, "addrgenmode", "none", "up")
            tc.write(*direction.return_lines())
            yield cls(process)
        finally:
            process.stdin.close()
            await process.wait()

    def set(self, state: LinkSetting, *, blocked: bool) -> None:
        self.check()
        assert self._process.stdin
        packed = RelayState(state.delay_ms / 1e3, state.jitter_ms / 1e3, state.loss_pct / 100, blocked).pack()
        self._process.stdin.write(packed)

    def check(self) -> None:
        if self._process.returncode is not None:
            raise CommandError("The relay has ended.")


async def detect() -> Backend:
    """The best backend that this kernel has, found out by trying."""
    if not await attempt("ip", "link", "add", _PROBE, "type", "ifb"):
        return "relay"
    try:
        found = await attempt("tc", "qdisc", "add", "dev", _PROBE, "root", "netem", "delay", "1ms")
    finally:
        await attempt("ip", "link", "del", _PROBE)
    return "netem" if found else "relay"


STAGES: dict[Backend, type[NetemStage] | type[RelayStage]] = {"netem": NetemStage, "relay": RelayStage}
