"""The command `tigas dash`. Heavy modules are imported when it runs."""

from __future__ import annotations

import asyncio
import logging

from tigas_common.cli import log_to_stdout
from tigas_common.command import Command
from tigas_common.installation import check_versions
from tigas_dash.settings import DashSettings


class Dash(DashSettings, Command):
    """Stream the render service's views, one stream per viewer, over low-latency DASH or WebRTC.

    WebRTC uses the UDP port with the same number as the API's port.
    """

    def run(self) -> None:
        log_to_stdout(logging.WARNING)
        logging.getLogger("tigas_dash").setLevel(logging.INFO)
        check_versions("aioice", "aiortc", "uvicorn")
        from tigas_dash.main import serve

        asyncio.run(serve(self))
