"""The commands `tigas cluster up` and `status`. Heavy modules are imported when a command runs."""

from __future__ import annotations

import json
import logging
from typing import Annotated

from tigas_cluster.settings import ClusterSettings
from tigas_common.cli import log_to_stdout
from tigas_common.command import REST, Command, Group, Metavar
from tigas_common.installation import check_versions
from tigas_common.terminal import make_console


class Up(ClusterSettings, Command):
    """Serve scenes from all machines of a Ray cluster until Ctrl+C: open the printed URL.

    RAY_ADDRESS names the cluster, to which this machine belongs; without it, Ray is started on this machine only.
    """

    render_options: Annotated[tuple[str, ...], REST, Metavar("OPTIONS")] = ()
    """Options of each host's render service, such as -- --memory-gb 40"""

    def run(self) -> None:
        from tigas_cluster.connection import check_ray

        check_ray()
        check_versions("uvicorn")
        from tigas_cluster.up import up

        log_to_stdout()
        logging.getLogger("httpx").setLevel(logging.WARNING)  # hosts are polled continuously
        up(self, self.render_options)


class Status(Command):
    """Print the state of each host."""

    json_: bool = False
    """Print as JSON."""

    def run(self) -> None:
        from tigas_cluster.connection import check_ray

        check_ray()
        from tigas_cluster.status import make_table, read_statuses

        found = read_statuses()
        if self.json_:
            print(json.dumps([each.model_dump(mode="json") for each in found], indent=2))
        else:
            make_console().print(make_table(found) if found else "No host is running.")


cluster = Group("Serve scenes from several machines under one address, with Ray.", {"up": Up, "status": Status})
