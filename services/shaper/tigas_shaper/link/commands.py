"""Commands of iproute2 and nftables: validated names and filters, and a dialogue with a running tool."""

from __future__ import annotations

import asyncio
import fcntl
import re
import socket
import struct
from asyncio.subprocess import DEVNULL, PIPE, STDOUT, Process
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress

TIMEOUT_S = 5
"""Seconds without an answer after which a tool is considered dead."""
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,14}")
_LINE = re.compile(r"[ -~]+")
MARK = 0x7469
"""Firewall mark that the gateway sets on forwarded packets."""
# Classic BPF, with instructions as "code jump-true jump-false operand"; the mark is at SKF_AD_OFF + SKF_AD_MARK. It is
# one word for tc, which splits lines at blanks outside quotes.
SIOCGIFMTU = 0x8921
IFREQ = struct.Struct("16si20x")
"""An interface's name and an integer (netdevice(7))."""
MATCH_MARKED = f'bpf bytecode "4,32 0 0 4294963220,21 0 1 {MARK},6 0 0 4294967295,6 0 0 0"'
MATCH_ALL = 'bpf bytecode "1,6 0 0 4294967295"'


class Interface(str):
    """Name of a network interface. Raises ValueError if it is invalid."""

    __slots__ = ()

    def __new__(cls, name: str) -> Interface:
        if not _NAME.fullmatch(name):
            raise ValueError(f"{name!r} is not the name of a network interface")
        return super().__new__(cls, name)

    @property
    def number(self) -> int | None:
        """The kernel's index of the interface; None if it does not exist. A recreated interface has a new index."""
        try:
            return socket.if_nametoindex(self)
        except OSError:
            return None

    @property
    def mtu(self) -> int:
        """Maximum length of the interface's packets, in bytes. Raises OSError if it does not exist."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
            answer = fcntl.ioctl(any_socket, SIOCGIFMTU, IFREQ.pack(self.encode(), 0))
        return int(IFREQ.unpack(answer)[1])


class CommandError(Exception):
    """The tool refused a line, or has exited. The message is the tool's."""


class Channel:
    """A running tool. After a CommandError the dialogue is out of step, so close it.

    No shell is involved: a tool gets whole lines that our own code composes from numbers and validated names.
    """

    def __init__(self, process: Process, failure: str) -> None:
        self._process = process
        self._failure = failure
        self._asking = asyncio.Lock()
        self._ended = False

    @classmethod
    @asynccontextmanager
    async def open(cls, argv: Sequence[str], failure: str) -> AsyncIterator[Channel]:
        """Run a tool, as a context manager. `failure` is the prefix of the last line of its error messages."""
        # In a separate session, so that Ctrl+C reaches only the shaper, which then ends the tool in an orderly way.
        process = await asyncio.create_subprocess_exec(
            *argv, stdin=PIPE, stdout=PIPE, stderr=STDOUT, start_new_session=True
        )
        try:
            yield cls(process, failure)
        finally:
            assert process.stdin
            process.stdin.close()
            try:
                async with asyncio.timeout(1):
                    await process.wait()
            except TimeoutError:
                process.kill()
                await process.wait()

    def write(self, *lines: str) -> None:
        """Send lines without waiting; the next `ask` reports errors. Raises CommandError."""
        for line in lines:
            if not _LINE.fullmatch(line):
                raise CommandError(f"{line!r} is not one line of plain text.")
        assert self._process.stdin
        if self._ended or self._process.returncode is not None:
            raise CommandError("The tool exited.")
        self._process.stdin.write("".join(line + "\n" for line in lines).encode())

    async def ask(self, line: str, answer: str) -> str:
        """Send a line and return the first output line that starts with `answer`.

        Raises CommandError if this line or an earlier one was refused.
        """
        async with self._asking:
            self.write(line)
            messages: list[str] = []
            try:
                async with asyncio.timeout(TIMEOUT_S):
                    while (text := await self._read()) is not None:
                        if text.startswith(answer):
                            return text
                        if text.startswith(self._failure):
                            raise CommandError(" ".join((*messages, text)))
                        if text.strip() and not text.startswith("Warning:"):
                            messages.append(text.strip())
            except TimeoutError:
                raise CommandError("The tool does not answer.") from None
            self._ended = True
            raise CommandError(" ".join(messages) or "The tool exited.")

    async def _read(self) -> str | None:
        assert self._process.stdout
        line = await self._process.stdout.readline()
        return line.decode(errors="replace").rstrip("\n") if line else None


async def run(*argv: str) -> None:
    """Run a command to its end. Raises CommandError with its error output."""
    process = await asyncio.create_subprocess_exec(*argv, stdin=DEVNULL, stdout=DEVNULL, stderr=PIPE)
    _, stderr = await process.communicate()
    if process.returncode:
        raise CommandError(" ".join(stderr.decode(errors="replace").split()) or f"{argv[0]} failed.")


async def try_run(*argv: str) -> bool:
    """Run a command that may fail, and return whether it succeeded."""
    with suppress(CommandError):
        await run(*argv)
        return True
    return False
