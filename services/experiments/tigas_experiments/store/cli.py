"""The command `tigas store`. Heavy imports wait until it runs."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from typing import Annotated

import typer

from tigas_common.cli import AllowHosts, AllowOrigins, in_a_sentence, log_to_stdout
from tigas_common.settings import load_settings
from tigas_common.topology import PAGE, STORE


def store(
    results: Annotated[
        Path | None, typer.Option(help="Directory of experiments, one folder each.", show_default="results")
    ] = None,
    movements: Annotated[
        Path | None, typer.Option(help="Directory of movement traces.", show_default="traces/movement")
    ] = None,
    render: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Render service that samples are rendered by again.",
            show_default=f"http://{PAGE.loopback}",
        ),
    ] = None,
    http: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="API.", show_default=str(STORE.loopback))
    ] = None,
    allow_hosts: AllowHosts = None,
    allow_origins: AllowOrigins = None,
) -> None:
    """Store experiments made in the page; serve reports and archives of all experiments.

    Settings are also read from table `store` of tigas.toml (or the file that TIGAS_CONFIG names) and TIGAS_STORE_*.
    """
    flags = dict(locals())
    from tigas_common.errors import StartError
    from tigas_experiments.store.main import serve
    from tigas_experiments.store.settings import StoreSettings

    settings = load_settings(StoreSettings, flags)
    log_to_stdout(logging.WARNING)
    with in_a_sentence(StartError):
        asyncio.run(serve(settings))
