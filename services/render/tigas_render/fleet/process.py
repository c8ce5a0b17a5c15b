"""What every child of the supervisor does: begin as it is told, listen, end in time, and say why it could not go on."""

from __future__ import annotations

import asyncio
import logging
import shutil
import socket
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import uvloop

from tigas_common.cli import log_to_stdout
from tigas_common.errors import StartError
from tigas_common.runner import until_stopped
from tigas_render.fleet.control import Channel, EdgeStart, EngineStart, Failed, Loaded, Message, Start

Program = Callable[[Channel, Start, AsyncIterator[Message]], Awaitable[None]]
"""Gets the channel, how to begin, and what the supervisor says after that."""


def call_it(name: str) -> None:
    """Let ps, top and the like show this process by a name of at most 15 bytes."""
    Path("/proc/self/comm").write_text(name)


def run(program: Program) -> None:
    """Run a child's program to its end; the supervisor hears why, if it is a StartError."""
    log_to_stdout()
    logging.getLogger("quic").setLevel(logging.WARNING)  # aioquic tells the story of every connection
    sys.exit(uvloop.run(_run(program)))


async def _run(program: Program) -> int:
    channel = await Channel.over(socket.socket(fileno=int(sys.argv[1])))
    channel.send(Loaded())
    try:
        news = aiter(channel)
        match await anext(news, None):
            case EngineStart() | EdgeStart() as start:
                call_it(start.name)
                try:
                    await program(channel, start, news)
                finally:
                    if channel.is_over:  # the supervisor was killed, so that it removes nothing itself
                        shutil.rmtree(start.directory, ignore_errors=True)
    except StartError as error:
        channel.send(Failed(detail=str(error)))
        return 1
    else:
        return 0
    finally:
        await channel.close()


async def until_told(news: AsyncIterator[Message], heard: Callable[[Message], None]) -> None:
    """Listen to the supervisor until it says to stop, or is gone."""

    async def listen() -> None:
        async for message in news:
            heard(message)

    listening, stopped = asyncio.create_task(listen()), asyncio.create_task(until_stopped())
    try:
        await asyncio.wait((listening, stopped), return_when=asyncio.FIRST_COMPLETED)
        if listening.done():
            listening.result()
    finally:
        listening.cancel()
        stopped.cancel()
