"""The command `tigas shaper`. Heavy imports wait until it runs."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated

import typer

from tigas_common.cli import AllowHosts, AllowOrigins, in_a_sentence, log_to_stdout
from tigas_common.settings import load_settings
from tigas_common.topology import SHAPER


def shaper(
    access: Annotated[
        str | None, typer.Option(metavar="NAME|NETWORK", help="Interface towards the clients, such as eth0.")
    ] = None,
    service: Annotated[
        str | None, typer.Option(metavar="NAME|NETWORK", help="Interface towards the services, such as 172.30.2.0/24.")
    ] = None,
    forward: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PROTOCOL:PORT=HOST:PORT", help="What to forward, such as tcp:8080=render:8080. Repeatable."
        ),
    ] = None,
    traces: Annotated[Path | None, typer.Option(help="Directory of network traces.")] = None,
    trace: Annotated[str | None, typer.Option(help="Trace to play at start-up.")] = None,
    http: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="API.", show_default=str(SHAPER.loopback))
    ] = None,
    down_kbps: Annotated[
        float | None, typer.Option(help="Rate to the clients when no trace plays.", show_default="100000")
    ] = None,
    up_kbps: Annotated[
        float | None, typer.Option(help="Rate from the clients when no trace plays.", show_default="100000")
    ] = None,
    queue_ms: Annotated[
        float | None, typer.Option(help="Queue length in ms at the mean rate.", show_default="150")
    ] = None,
    backend: Annotated[
        str | None,
        typer.Option(metavar="auto|netem|relay", help="What applies delay, jitter and loss.", show_default="auto"),
    ] = None,
    allow_hosts: AllowHosts = None,
    allow_origins: AllowOrigins = None,
) -> None:
    """Forward between clients and services over a link that replays a network trace.

    Settings are also read from table `shaper` of tigas.toml (or the file that TIGAS_CONFIG names) and TIGAS_SHAPER_*.
    """
    flags = dict(locals())
    from tigas_common.errors import StartError
    from tigas_shaper.main import check_rights, serve
    from tigas_shaper.settings import ShaperSettings

    with in_a_sentence(StartError):
        check_rights()
        settings = load_settings(ShaperSettings, flags)
        log_to_stdout()
        asyncio.run(serve(settings))
