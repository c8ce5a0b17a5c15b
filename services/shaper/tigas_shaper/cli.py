"""The command `tigas shaper`. Heavy modules are imported when it runs."""

from __future__ import annotations

import asyncio

from tigas_common.cli import log_to_stdout
from tigas_common.command import Command
from tigas_common.installation import check_versions
from tigas_shaper.settings import ShaperSettings


class Shaper(ShaperSettings, Command):
    """Forward between clients and services over a link that replays a network trace."""

    def run(self) -> None:
        check_versions("uvicorn")
        from tigas_shaper.main import check_rights, serve

        check_rights()
        log_to_stdout()
        asyncio.run(serve(self))
