"""Wires the store together and serves its API until it is stopped."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from functools import partial

from tigas_common.address import say_if_open
from tigas_common.limits import HttpLimits
from tigas_common.loop_share import LoopShare
from tigas_common.offload import offload_to_process
from tigas_common.origins import OriginPolicy
from tigas_common.resources import keep_together
from tigas_common.runner import explained, serve_listener, until_stopped
from tigas_experiments.records.load import EVERY_S, watching_load
from tigas_experiments.records.machine import this_machine
from tigas_experiments.store.app import Store, create_app
from tigas_experiments.store.experiments import Experiments
from tigas_experiments.store.movements import Movements
from tigas_experiments.store.planner import Planner, render_service
from tigas_experiments.store.reports import Reports
from tigas_experiments.store.rerendering import Rerendering
from tigas_experiments.store.settings import StoreSettings
from tigas_experiments.store.workspace import Workspace

REMEMBERED_S = 3 * 3600
"""The machine's load is: longer than the longest run and its upload."""


async def serve(settings: StoreSettings) -> None:
    """Run the store until SIGINT or SIGTERM. Raises StartError."""
    keep_together()
    limits = HttpLimits.of(settings.http_limits)
    async with AsyncExitStack() as stack:
        with explained(settings.http, "--http"):  # before anything that takes time
            listener = stack.enter_context(settings.http.listen(limits.unread_s))
        workspace = stack.enter_context(Workspace.opened(settings.results))
        load = await stack.enter_async_context(watching_load(keep=int(REMEMBERED_S / EVERY_S)))
        experiments = Experiments(settings.results, workspace)
        store = Store(
            workspace=workspace,
            experiments=experiments,
            reports=Reports(experiments, workspace, offload_to_process),
            movements=Movements(settings.movements),
            planner=Planner(
                experiments,
                workspace,
                offload_to_process,
                movements=settings.movements,
                render=settings.render,
                services=partial(render_service, settings.render.rstrip("/")),
                machine=await asyncio.to_thread(this_machine),
                load=load,
            ),
            rerendering=await stack.enter_async_context(Rerendering.opened(experiments, settings.render)),
        )
        policy = OriginPolicy.of([settings.http], settings.allow_hosts, settings.allow_origins)
        app = LoopShare(create_app(store, policy), limits.loop_share_per_address, policy)
        port = await stack.enter_async_context(serve_listener(app, listener, limits))
        say_if_open([settings.http])
        print(f"Experiments in {settings.results} on http://{settings.http.reachable_host}:{port}/", flush=True)
        await until_stopped()
