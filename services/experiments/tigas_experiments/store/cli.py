"""The command `tigas store`. Heavy modules are imported when it runs."""

from __future__ import annotations

import asyncio
import logging

from tigas_common.cli import log_to_stdout
from tigas_common.command import Command
from tigas_common.installation import check_versions
from tigas_experiments.store.settings import StoreSettings


class Store(StoreSettings, Command):
    """Store experiments made in the page; serve reports and archives of all experiments."""

    def run(self) -> None:
        log_to_stdout(logging.WARNING)
        check_versions("uvicorn")
        from tigas_experiments.store.main import serve

        asyncio.run(serve(self))
