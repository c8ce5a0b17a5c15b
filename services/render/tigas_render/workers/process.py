"""The life cycle of a worker's process: it starts on a message, listens, exits in time, and reports failures."""

from __future__ import annotations

import logging
import shutil
import socket
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import uvloop

from tigas_common.cli import log_to_stdout
from tigas_common.errors import StartError
from tigas_common.proxy import run_until
from tigas_common.runner import wait_for_stop
from tigas_common.settings import ServiceSettings
from tigas_render.workers.control import Channel, EdgeStart, EngineStart, Failed, Loaded, Message, Start

Program = Callable[[Channel, Start, AsyncIterator[Message]], Awaitable[None]]
"""A worker's program, called with the channel, its first message, and the messages after that."""


def set_process_name(name: str) -> None:
    """Set the name of this process in ps and top, which has at most 15 bytes."""
    Path("/proc/self/comm").write_text(name)


def run_worker(program: Program) -> None:
    """Run a worker's program and exit, reporting a StartError to the supervisor."""
    ServiceSettings.are_given = True
    log_to_stdout()
    logging.getLogger("quic").setLevel(logging.WARNING)  # aioquic logs every connection
    sys.exit(uvloop.run(_run_program(program)))


async def _run_program(program: Program) -> int:
    channel = await Channel.from_socket(socket.socket(fileno=int(sys.argv[1])))
    channel.send(Loaded())
    try:
        messages = aiter(channel)
        match await anext(messages, None):
            case EngineStart() | EdgeStart() as start:
                set_process_name(start.name)
                try:
                    await program(channel, start, messages)
                finally:
                    if channel.is_closed:  # the supervisor was killed, and cannot remove the directory
                        shutil.rmtree(start.directory, ignore_errors=True)
    except StartError as error:
        channel.send(Failed(detail=str(error)))
        return 1
    else:
        return 0
    finally:
        await channel.close()


async def listen_until_stopped(messages: AsyncIterator[Message], on_message: Callable[[Message], None]) -> None:
    """Handle the supervisor's messages until it exits, or this process gets SIGINT or SIGTERM."""

    async def listen() -> None:
        async for message in messages:
            on_message(message)

    await run_until(wait_for_stop(), listen())
