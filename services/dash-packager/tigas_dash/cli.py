"""The command `tigas dash`. Heavy imports wait until it runs."""

from __future__ import annotations

import asyncio
import logging
from typing import Annotated

import typer

from tigas_common.cli import AllowHosts, AllowOrigins, in_a_sentence, log_to_stdout
from tigas_common.settings import load_settings
from tigas_common.topology import DASH, PAGE


def dash(
    render: Annotated[
        str | None, typer.Option(metavar="URL", help="Render service.", show_default=f"http://{PAGE.loopback}")
    ] = None,
    http: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Streams and API.", show_default=str(DASH.loopback))
    ] = None,
    max_sessions: Annotated[
        int | None, typer.Option(help="Maximum number of simultaneous streams.", show_default="4")
    ] = None,
    idle_s: Annotated[
        float | None, typer.Option(help="End streams that nobody watched for this many seconds.", show_default="15")
    ] = None,
    encoder: Annotated[
        str | None, typer.Option(metavar="auto|libx264|h264_nvenc", help="H.264 encoder.", show_default="auto")
    ] = None,
    allow_hosts: AllowHosts = None,
    allow_origins: AllowOrigins = None,
) -> None:
    """Serve streams of the render service's views, one per viewer: low-latency DASH (CMAF), and WebRTC if installed.

    WebRTC is on the UDP port of the same number as the API.

    Settings are also read from table `dash` of tigas.toml (or the file that TIGAS_CONFIG names) and TIGAS_DASH_*.
    """
    flags = dict(locals())
    from tigas_common.errors import StartError
    from tigas_dash.main import serve
    from tigas_dash.settings import DashSettings

    settings = load_settings(DashSettings, flags)
    log_to_stdout(logging.WARNING)
    logging.getLogger("tigas_dash").setLevel(logging.INFO)
    with in_a_sentence(StartError):
        asyncio.run(serve(settings))
