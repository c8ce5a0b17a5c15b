"""Delay, jitter and loss behind the rate: with netem if the kernel has it, otherwise with our own relay."""

from __future__ import annotations

import asyncio
import json
import sys
from abc import ABC, abstractmethod
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, ClassVar

from tigas_common.wire.shaper import Backend, LinkSetting
from tigas_shaper.link.commands import MATCH_ALL, MATCH_MARKED, Channel, CommandError, Interface, run, try_run
from tigas_shaper.link.relay import RelayState

_PROBE = Interface("tigas-probe")


class DelayStage(ABC):
    """Delay, jitter and loss of one direction, applied after the rate device."""

    backend: ClassVar[Backend]

    @abstractmethod
    def set(self, state: LinkSetting, *, blocked: bool) -> None:
        """Change delay, jitter and loss. When blocked, no packet passes. Raises CommandError."""

    @abstractmethod
    async def check(self) -> None:
        """Raise CommandError if the stage no longer works."""


class NetemStage(DelayStage):
    """The kernel's netem. The rate device is an IFB, which returns packets to the interface they came from."""

    backend = "netem"

    def __init__(self, tc: Channel, interface: Interface) -> None:
        self._tc = tc
        self._interface = interface

    @classmethod
    @asynccontextmanager
    async def open(cls, tc: Channel, device: Interface, interface: Interface) -> AsyncIterator[NetemStage]:
        """Create the rate device, and insert netem into the path of marked packets on the interface; all others bypass
        it without queueing. Raises CommandError.
        """
        await run("ip", "link", "add", device, "type", "ifb")
        try:
            await run("ip", "link", "set", device, "up")
            tc.write(
                f"qdisc add dev {interface} root handle 2: htb default 0",
                f"class add dev {interface} parent 2: classid 2:1 htb rate 100gbit burst 1mb cburst 1mb quantum 3028",
                f"qdisc add dev {interface} parent 2:1 handle 20: netem limit 100000",
                f"filter add dev {interface} parent 2: protocol ip prio 1 {MATCH_MARKED} flowid 2:1",
            )
            yield cls(tc, interface)
        finally:
            await try_run("tc", "qdisc", "del", "dev", interface, "root", "handle", "2:")
            await try_run("ip", "link", "del", device)

    def set(self, state: LinkSetting, *, blocked: bool) -> None:
        loss = 100.0 if blocked else state.loss_pct
        # A rate, however high, makes netem keep packets in order despite jitter.
        self._tc.write(
            f"qdisc change dev {self._interface} parent 2:1 handle 20: netem limit 100000 "
            f"delay {_microseconds(state.delay_ms)}us {_microseconds(state.jitter_ms)}us loss {loss:.4f}% rate 100gbit"
        )

    async def check(self) -> None:
        qdiscs: list[dict[str, Any]] = json.loads(await self._tc.ask(f"qdisc show dev {self._interface}", "["))
        if not any(entry["kind"] == "netem" and entry["handle"] == "20:" for entry in qdiscs):
            raise CommandError(f"another program has removed the delay stage of {self._interface}.")


class RelayStage(DelayStage):
    """Our own relay. The rate device is its TAP device."""

    backend = "relay"

    def __init__(self, process: Process) -> None:
        self._process = process

    @classmethod
    @asynccontextmanager
    async def open(cls, tc: Channel, device: Interface, interface: Interface) -> AsyncIterator[RelayStage]:
        """Start the relay, which creates the rate device. Raises CommandError."""
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "tigas_shaper.link.relay", device, stdin=PIPE, stdout=PIPE, start_new_session=True
        )
        assert process.stdin
        assert process.stdout
        try:
            if (answer := await process.stdout.readline()) != b"ready\n":
                raise CommandError(f"The relay could not start: {answer.decode(errors='replace').strip()}.")
            # Without an address, the kernel sends no packets of its own to the device.
            await run("ip", "link", "set", device, "addrgenmode", "none", "up")
            # Packets that the relay writes back leave through the interface.
            tc.write(
                f"qdisc add dev {device} clsact",
                f"filter add dev {device} ingress protocol ip prio 1 {MATCH_ALL} "
                f"action mirred egress redirect dev {interface}",
            )
            yield cls(process)
        finally:
            process.stdin.close()
            await process.wait()

    def set(self, state: LinkSetting, *, blocked: bool) -> None:
        self._check_running()
        assert self._process.stdin
        packed = RelayState(state.delay_ms / 1e3, state.jitter_ms / 1e3, state.loss_pct / 100, blocked).pack()
        self._process.stdin.write(packed)

    async def check(self) -> None:
        self._check_running()

    def _check_running(self) -> None:
        if self._process.returncode is not None:
            raise CommandError("The relay exited.")


async def detect_backend() -> Backend:
    """The best backend that works with this kernel, determined by trying."""
    if not await try_run("ip", "link", "add", _PROBE, "type", "ifb"):
        return "relay"
    try:
        found = await try_run("tc", "qdisc", "add", "dev", _PROBE, "root", "netem", "delay", "1ms")
    finally:
        await try_run("ip", "link", "del", _PROBE)
    return "netem" if found else "relay"


STAGES: dict[Backend, type[NetemStage] | type[RelayStage]] = {"netem": NetemStage, "relay": RelayStage}


def _microseconds(milliseconds: float) -> int:
    return round(milliseconds * 1000)
